"""Point tracks in the TAP-Vid format (Doersch et al., NeurIPS 2022)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import IO, Any
from zipfile import ZipFile, ZipInfo

import cv2
import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.export.correspondence import is_ball
from physgen.export.labels import Clip, Moment

# ----------------------------------------------------------------------
# A label map <-> its runs of equal values, row by row: a hundredth of the memory, at hardly any cost.

U16 = NDArray[np.uint16]


@dataclass(frozen=True)
class LabelRuns:
    """A label map (H, W)."""

    shape: tuple[int, int]
    values: U16
    """(R,)."""
    lengths: NDArray[np.int32]
    """(R,) px; they may go on in the next row."""

    @classmethod
    def of(cls, ids: U16) -> LabelRuns:
        """The runs of `ids` (H, W).

        >>> Runs.of(np.array([[0, 0, 3], [3, 3, 1]], np.uint16)).lengths.tolist()
        [2, 3, 1]
        """
        flat = ids.ravel()
        ends = np.flatnonzero(flat[1:] != flat[:-1]) + 1
        starts = np.concatenate([[0], ends])
        lengths = np.diff(starts, append=flat.size).astype(np.int32)
        return cls((ids.shape[0], ids.shape[1]), flat[starts], lengths)

    def map(self) -> U16:
        """(H, W) again."""
        return np.repeat(self.values, self.lengths).reshape(self.shape)

    def areas(self, count: int) -> NDArray[np.float64]:
        """(count,) px of each value below `count`."""
        return np.asarray(np.bincount(self.values, self.lengths, count), np.float64)


# ----------------------------------------------------------------------
# Points drawn in views -> where they are in every view of the clip, in closed form; and how they are drawn.

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

MARGIN = 2
"""px around a pixel that show the same thing, where points are drawn; less where a thing is too thin for it."""
UNDER = 1e-9
"""Radii below a ball's widest part from which a point is underneath."""


@dataclass(frozen=True)
class CameraPath:
    """T views."""

    lenses: Array
    """(T, 2, 3): photo px -> video px."""
    poses: Array
    """(T, N, 3): x px, y px, angle rad, of bodies in the photo."""
    spaces: Array | None
    """(T, N, 3, 3): how bodies have turned in space; None: in the picture alone."""


@dataclass(frozen=True)
class Points:
    """K points as they were drawn."""

    body: Index
    """(K,): whose; -1 the background's."""
    frame: Index
    """(K,): the view in which they were drawn."""
    at: Array
    """(K, 2) px of that view."""


def tracked(points: Points, filmed: CameraPath, world: World) -> tuple[Array, Mask]:
    """(K, T, 2) px of each view, also where they are hidden or out of the picture; and (K, T) who is underneath."""
    large = filmed.lenses[:, 0, 0]
    shift = filmed.lenses[:, 0, 2] + 1j * filmed.lenses[:, 1, 2]
    photo = (points.at[:, 0] + 1j * points.at[:, 1] - shift[points.frame]) / large[points.frame]
    there = np.empty((len(photo), len(large)), np.complex128)
    under = np.zeros(there.shape, bool)
    for body in np.unique(points.body).tolist():
        own = points.body == body
        frame, place = points.frame[own], photo[own]
        if body < 0:
            there[own] = place[:, None]
            continue
        poses, thing = filmed.poses[:, body], world.bodies[body]
        middle = poses[:, 0] + 1j * poses[:, 1]
        if filmed.spaces is not None and is_ball(thing) and thing.radius is not None:
            moved, under[own] = _rolled((place - middle[frame]) / thing.radius, frame, filmed.spaces[:, body])
            there[own] = middle + thing.radius * moved
        else:
            turn = np.exp(1j * poses[:, 2])
            there[own] = middle + ((place - middle[frame]) / turn[frame])[:, None] * turn
    seen = large * there + shift
    return np.stack([seen.real, seen.imag], axis=-1), under


def _rolled(place: Complex, frame: Index, spaces: Array) -> tuple[Complex, Mask]:
    """Points of a ball, radii from its middle in their views -> (K, T) those of all views; who is underneath.

    What a mask has beyond the rim goes with the rim, as `places.Ball` has it.
    """
    rim = place / np.maximum(np.abs(place), 1)
    towards = np.sqrt(np.maximum(1 - np.abs(rim) ** 2, 0))
    normals = np.stack([rim.real, rim.imag, -towards], axis=-1)
    first = np.einsum("kij,ki->kj", spaces[frame], normals)  # as they were at t = 0
    turned = np.einsum("tij,kj->kti", spaces, first)
    return turned[..., 0] + 1j * turned[..., 1] + (place - rim)[:, None], turned[..., 2] > UNDER


def point_counts(areas: Array, most: int, least: int, ground: float) -> Index:
    """(N + 1,) how many points each owner gets of `most`, by areas (N + 1,) px, the background's first.

    A share `ground` is the background's; things get `least` each where they are seen at all, the rest by area.
    """
    things = areas[1:]
    seen = things > 0
    counts = np.zeros(len(areas), np.int64)
    counts[0] = 0 if areas[0] == 0 else round(most * ground) if seen.any() else most
    counts[1:][seen] = least
    left = most - int(counts.sum())
    if left > 0 and seen.any():
        exact = left * things / things.sum()
        counts[1:] += np.floor(exact).astype(np.int64)
        short = left - int(np.floor(exact).sum())
        counts[1:][np.argsort(np.floor(exact) - exact, kind="stable")[:short]] += 1
    return counts


def draw_points(ids: U16, wanted: Sequence[tuple[int, int]], rng: np.random.Generator) -> list[Array]:
    """(k, 2) px anywhere within pixels of a view, for each id and number k of `wanted`: well inside, where that is."""
    kernel = np.ones((2 * MARGIN + 1, 2 * MARGIN + 1), np.uint8)
    inner = cv2.erode(ids, kernel) == cv2.dilate(ids, kernel)
    found = []
    for id_, count in wanted:
        own = ids == id_
        where = np.flatnonzero(own & inner)
        where = where if len(where) else np.flatnonzero(own)
        picked = rng.choice(where, count)
        pixels = np.column_stack([picked % ids.shape[1], picked // ids.shape[1]])
        found.append(pixels + rng.uniform(-0.5, 0.5, (count, 2)))
    return found


# ----------------------------------------------------------------------
# Views -> tapvid.npz: point tracks as TAP-Vid has them (Doersch et al., NeurIPS 2022), without a pickle.
#
# `video` (T, H, W, 3) uint8; `points` (N, T, 2) float32, x and y, 0 at the left and upper edge of the picture
# and 1 at
# the other, so that the first pixel's centre is at half a pixel; `occluded` (N, T) bool, true also out of the
# picture;
# `query_points` (N, 3) float32, frame, y and x in px from the picture's corner: where each point is first
# seen.

POINTS = 256
"""Of a clip unless told, as of one of TAP-Vid's Kubric; more where things are so many that each would not get LEAST."""
LEAST = 4
"""Of each thing that is ever seen."""
GROUND = 0.25
"""Share of the background."""


class Tapvid:
    """The video goes into the file as it comes; of each view no more is kept than poses, and ids as runs."""

    def __init__(self, folder: Path, clip: Clip, points: int = POINTS) -> None:
        self._clip, self._most = clip, points
        self._lenses: list[Array] = []
        self._poses: list[Array] = []
        self._spaces: list[Array] = []
        self._ids: list[LabelRuns] = []
        width, height = clip.size
        self._zip = _Archive(folder / "tapvid.npz", "w")
        self._video = _begun(self._zip, "video", np.dtype(np.uint8), (clip.count, height, width, 3))

    def add(self, moment: Moment) -> None:
        """A view's picture, and what tells where points are in it."""
        view = moment.view
        self._video.write(np.ascontiguousarray(view.rgb).data)
        self._ids.append(LabelRuns.of(view.ids))
        self._lenses.append(view.lens)
        self._poses.append(view.poses)
        if view.spaces is not None:
            self._spaces.append(view.spaces)

    def close(self) -> None:
        """Points are drawn, and their tracks written."""
        self._video.close()
        spaces = np.stack(self._spaces) if self._spaces else None
        filmed = CameraPath(np.stack(self._lenses), np.stack(self._poses), spaces)
        points = _points(self._ids, len(self._clip.names), self._most, _drawing(self._clip.name))
        places, under = tracked(points, filmed, self._clip.world)
        occluded = under | ~_shown(places, points, self._ids)
        for name, array in self._arrays(points, places, occluded).items():
            with _begun(self._zip, name, array.dtype, array.shape) as file:
                file.write(np.ascontiguousarray(array).tobytes())
        self._zip.close()

    def _arrays(self, points: Points, places: Array, occluded: Mask) -> Mapping[str, NDArray[Any]]:
        """What is in the file beside the video."""
        first = np.argmin(occluded, axis=1)
        x, y = (places[np.arange(len(first)), first] + 0.5).T
        return {
            "points": ((places + 0.5) / self._clip.size).astype(np.float32),
            "occluded": occluded,
            "query_points": np.column_stack([first, y, x]).astype(np.float32),
            "object": (points.body + 1).astype(np.int32),
            "names": np.array(["background", *self._clip.names]),
            "fps": np.array(self._clip.fps),
        }


class _Archive(ZipFile):
    """One that may be left half-way, as where a clip fails: its folder goes, and nobody is told of the file."""

    def __del__(self) -> None:
        """Whoever is done has closed it."""


def _begun(archive: ZipFile, name: str, kind: np.dtype[Any], shape: tuple[int, ...]) -> IO[bytes]:
    """An array of an npz, to be written piece by piece; without the time of day, so that bytes stay the same."""
    entry = ZipInfo(f"{name}.npy", (1980, 1, 1, 0, 0, 0))
    entry.file_size = (
        int(np.prod(shape, dtype=np.int64)) * kind.itemsize + 1024
    )  # at most: 4 GB ask for zip64
    file = archive.open(entry, "w")
    npy.write_array_header_1_0(file, {"descr": kind.str, "fortran_order": False, "shape": shape})
    return file


def _drawing(name: str) -> np.random.Generator:
    """Of a clip's name: the same every time, and in clips of one photo not the same places again."""
    return np.random.default_rng(int.from_bytes(sha256(name.encode()).digest()[:8], "big"))


def _points(ids: list[LabelRuns], count: int, most: int, rng: np.random.Generator) -> Points:
    """Points drawn in views at random: of each owner, as likely in each as it is seen there."""
    areas = np.stack([runs.areas(count + 1) for runs in ids])
    totals = areas.sum(axis=0)
    numbers = point_counts(totals, most, LEAST, GROUND)
    owners = np.repeat(np.arange(count + 1), numbers)
    frames = np.concatenate(
        [rng.choice(len(ids), n, p=areas[:, k] / totals[k]) for k, n in enumerate(numbers) if n]
    )
    at = np.empty((len(owners), 2))
    for frame in np.unique(frames):
        here = [
            (k, np.flatnonzero((frames == frame) & (owners == k))) for k in np.unique(owners[frames == frame])
        ]
        picked = draw_points(ids[frame].map(), [(int(k), len(which)) for k, which in here], rng)
        for (_, which), places in zip(here, picked, strict=True):
            at[which] = places
    return Points(owners - 1, frames, at)


def _shown(places: Array, points: Points, ids: list[LabelRuns]) -> Mask:
    """(K, T): the pixel that a point (K, T, 2) is in shows the thing that it is on."""
    height, width = ids[0].shape
    column, row = (np.rint(places[..., k]).astype(np.int64) for k in (0, 1))
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    place = np.where(inside, row * width + column, 0)
    seen = np.stack([runs.map().ravel()[place[:, frame]] for frame, runs in enumerate(ids)], axis=1)
    return np.asarray(inside & (seen == points.body[:, None] + 1))
