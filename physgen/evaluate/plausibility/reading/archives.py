"""NumPy archives -> tracks: TAP-Vid's points, or a trajectory of ours by itself. Nothing is unpickled."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, is_zipfile

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.plausibility.reading.asked import FPS, Asked, title
from physgen.evaluate.plausibility.reading.clips import EXACT
from physgen.evaluate.plausibility.tracks import Array, Form, Given, Tracks
from physgen.problems import InputError

SHAKE = 0.05
"""px."""
FEWEST = 3
"""Points of a thing that tell how it lies."""


def from_archive(path: Path, asked: Asked) -> Tracks:
    """Raises InputError for archives that hold neither."""
    if path.is_file() and not is_zipfile(path):
        fix = "give TAP-Vid's points or trajectory.npz, as numpy.savez writes them"
        raise InputError.of(str(path), "", "is no NumPy archive", fix)
    try:
        with np.load(path, allow_pickle=False) as file:
            held = {name: file[name] for name in file.files if name != "video"}
            size = _size(file) if "video" in file.files else None
    except (OSError, ValueError, BadZipFile) as error:
        fix = "give TAP-Vid's points as an npz without pickles, or trajectory.npz"
        raise InputError.of(str(path), "", f"cannot be read: {error}", fix) from None
    if {"times", "names", "poses"} <= set(held):
        return _trajectory(path, held, asked)
    if {"points", "occluded"} <= set(held):
        return _points(path, held, size, asked)
    fix = "it needs points and occluded, or times, names and poses"
    raise InputError.of(str(path), f'"{", ".join(held)}"', "are no tracks", fix)


def _size(file: Any) -> tuple[int, int]:
    """Width and height of the video, px."""
    height, width = file["video"].shape[1:3]
    return int(width), int(height)


def _trajectory(path: Path, held: Mapping[str, NDArray[Any]], asked: Asked) -> Tracks:
    names, poses = tuple(map(str, held["names"])), np.asarray(held["poses"], np.float64)
    forms = tuple(Form(0.0, 0.0) for _ in names)
    return Tracks(
        title(path), np.asarray(held["times"], np.float64), names, poses[..., :2].copy(), poses[..., 2].copy(), forms,
        np.ones(len(names)), False, asked.view, EXACT, "poses without outlines: the scene is not at hand", flat=False,
    )  # fmt: skip


def _points(
    path: Path, held: Mapping[str, NDArray[Any]], size: tuple[int, int] | None, asked: Asked
) -> Tracks:
    points, hidden = np.asarray(held["points"], np.float64), np.asarray(held["occluded"], bool)
    if points.ndim != 3 or points.shape[2] != 2 or hidden.shape != points.shape[:2]:
        found = f"points of {points.shape}, occluded of {hidden.shape}"
        raise InputError.of(str(path), found, "do not belong together", "give (N, T, 2) and (N, T)")
    if not np.isfinite(points[~hidden]).all():
        found = f"{np.count_nonzero(~np.isfinite(points[~hidden]).all(axis=-1))} points"
        raise InputError.of(str(path), found, "are seen at no place: NaN", "say that they are occluded")
    if size is None:
        fix = "keep the video's array in the archive: points are told in parts of it"
        raise InputError.of(str(path), "", "does not say how large the video is", fix)
    if len(points) == 0:
        raise InputError.of(str(path), "", "has no tracks", "give what moves in it points")
    places = np.where(hidden[..., None], np.nan, points * size - 0.5).transpose(1, 0, 2)
    fps = asked.fps or (float(held["fps"]) if "fps" in held else None)
    said = "" if fps else ", 30 frames a second assumed"
    times = np.arange(len(places)) / (fps or FPS)
    owners = held.get("object")
    if owners is None:
        count = places.shape[1]
        names = tuple(f"point {k + 1}" for k in range(count))
        return Tracks(
            title(path), times, names, places, np.full(places.shape[:2], np.nan), (Form(0.0, 0.0),) * count,
            np.ones(count), False, asked.view, SHAKE, f"single points, TAP-Vid{said}", Given(), flat=False,
        )  # fmt: skip
    told = [str(name) for name in held["names"]] if "names" in held else []
    first = 1 if told[:1] == ["background"] else 0
    things = [one for one in np.unique(owners).tolist() if one >= first]
    rigid = [_rigid(places[:, owners == one]) for one in things]
    names = tuple(told[one] if 0 <= one < len(told) else f"thing {one}" for one in things)
    forms = tuple(form for _, _, form in rigid)
    return Tracks(
        title(path), times, names, np.stack([place for place, _, _ in rigid], axis=1),
        np.stack([angle for _, angle, _ in rigid], axis=1), forms,
        np.array([max(form.reach, 1.0) ** 2 for form in forms]), False, asked.view, SHAKE,
        f"points of each thing as one body, TAP-Vid{said}", Given(), flat=False,
    )  # fmt: skip


def _rigid(places: Array) -> tuple[Array, Array, Form]:
    """Points (T, K, 2) of one thing -> its place (T, 2), the mean of all of them, its angle (T,), and how far they lie.

    Frames that show fewer than 3 of them tell nothing. Procrustes analysis against the frame that shows most.
    """
    seen = np.asarray(np.isfinite(places).all(axis=2))
    shown = seen.sum(axis=1)
    best = int(np.argmax(shown))
    known = seen[best]
    model = places[best, known] - places[best, known].mean(axis=0)
    place, angle = np.full((len(places), 2), np.nan), np.full(len(places), np.nan)
    for frame in range(len(places)):
        both = seen[frame, known]
        if both.sum() < min(FEWEST, max(int(known.sum()), 1)):
            continue
        a, b = model[both], places[frame, known][both]
        turn = 0.0
        if len(a) > 1:
            p, q = a - a.mean(axis=0), b - b.mean(axis=0)
            turn = float(np.arctan2((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum(), (p * q).sum()))
        c, s = np.cos(turn), np.sin(turn)
        place[frame] = b.mean(axis=0) - a.mean(axis=0) @ np.array([[c, s], [-s, c]])
        angle[frame] = turn
    reach = float(np.hypot(*model.T).max(initial=0.0))
    return place, angle, Form(0.0, 1.3 * reach, 0.7 * reach)
