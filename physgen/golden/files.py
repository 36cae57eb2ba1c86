"""Golden clips <-> `NAME.npz` and `NAME.webp`, which NumPy and Pillow read.

In the archive, without pickles: `names` (N,); `samples` (T,), which of the clip's; `times` (T,) s; `poses` (T, N, 3)
and `poses_unit` (3,), whose product is x px, y px, degrees, of the centre of mass; `turns` (T, N, 4) or (T, 0, 4) and
`turns_unit`, likewise quaternions; `velocities` and `velocities_unit` where they were asked for, px/s and degrees/s;
`frames` (K,), which of the clip's frames lie side by side in the picture, and `frame_times` (K,) s; `made`, what all of
it was made of, as bytes of JSON. The picture is lossless.
"""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen.golden.taking import Made, Still
from physgen.golden.tracks import Track, Units
from physgen.whole import write_whole

U8 = NDArray[np.uint8]

FORMAT = 1
PICTURE = ".webp"
EFFORT = {"quality": 60, "method": 4}
"""Of the lossless encoder: 0.1 s; all it can do takes 2 s and saves 2 %."""
UNREADABLE = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error)


class DamagedError(Exception):
    """Golden files that cannot be used; says why."""


@dataclass(frozen=True)
class Golden:
    """What golden files hold."""

    track: Track | None
    """None: motion is not kept."""
    stills: tuple[Still, ...] | None
    """None: no frames are."""
    made: Made


def save(golden: Golden, path: Path) -> list[Path]:
    """Write `path`, and the picture beside it where there are frames; returns what was written.

    The same bytes for the same clip, on one version of the libraries. A picture that has no use any more goes.
    """
    arrays: dict[str, NDArray[Any]] = {}
    told: dict[str, Any] = {"format": FORMAT, **asdict(golden.made)}
    if golden.track is not None:
        track = golden.track
        told["units"] = asdict(track.units)
        arrays["names"] = np.array(track.names, dtype=np.str_)
        arrays |= {"samples": track.samples, "times": track.times}
        arrays |= {"poses": _short(track.poses), "poses_unit": track.units.pose}
        arrays |= {"turns": _short(track.turns), "turns_unit": np.array(track.units.turn)}
        if track.velocities is not None and track.units.velocity is not None:
            arrays |= {"velocities": _short(track.velocities), "velocities_unit": track.units.velocity}
    picture = path.with_suffix(PICTURE)
    if golden.stills is not None:
        sheet = np.concatenate([still.rgb for still in golden.stills], axis=1)
        told["picture"] = _digest(sheet)
        arrays["frames"] = np.array([still.index for still in golden.stills])
        arrays["frame_times"] = np.array([still.time for still in golden.stills])
    arrays["made"] = np.frombuffer(json.dumps(told, ensure_ascii=False).encode(), np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    if golden.stills is None:
        picture.unlink(missing_ok=True)
        write_whole(path, buffer.getvalue())
        return [path]
    drawn = io.BytesIO()
    Image.fromarray(sheet).save(drawn, "WEBP", lossless=True, exact=True, **EFFORT)
    write_whole(picture, drawn.getvalue())
    write_whole(path, buffer.getvalue())
    return [path, picture]


def read(path: Path, picture: Path) -> Golden:
    """The inverse of `save`; nothing is unpickled. Raises DamagedError."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        told = json.loads(arrays["made"].tobytes())
        if told.pop("format") != FORMAT:
            raise DamagedError(f"{path.name} was written by another physgen, in another way")
        units, digest = told.pop("units", None), told.pop("picture", None)
        made = Made(**{**told, "size": tuple(told["size"])})
        track = None if units is None else _track(arrays, Units(**units))
    except UNREADABLE as error:
        raise DamagedError(f"{path.name} is no golden file of physgen, or damaged") from error
    if digest is None:
        return Golden(track, None, made)
    sheet = _sheet(picture)
    if _digest(sheet) != digest:
        raise DamagedError(f"{picture.name} is not the picture that {path.name} was written with: keep both")
    try:
        parts = np.split(sheet, len(arrays["frames"]), axis=1)
        rows = zip(arrays["frames"].tolist(), arrays["frame_times"].tolist(), parts, strict=True)
        stills = tuple(Still(int(index), float(time), rgb) for index, time, rgb in rows)
    except UNREADABLE as error:
        raise DamagedError(f"{path.name} is damaged") from error
    return Golden(track, stills, made)


def _track(arrays: dict[str, NDArray[Any]], units: Units) -> Track:
    names = tuple(map(str, arrays["names"].tolist()))
    samples, times = arrays["samples"], arrays["times"]
    poses, turns = arrays["poses"].astype(np.int64), arrays["turns"].astype(np.int64)
    velocities = arrays["velocities"].astype(np.int64) if "velocities" in arrays else None
    shape = len(times), len(names), 3
    turned = turns.shape[:1] == shape[:1] and turns.shape[1] in (0, len(names)) and turns.shape[2:] == (4,)
    if samples.shape != times.shape or poses.shape != shape or not turned:
        raise ValueError("arrays of sizes that do not fit")
    if velocities is not None and velocities.shape != shape:
        raise ValueError("arrays of sizes that do not fit")
    return Track(names, samples, times, units, poses, turns, velocities)


def _sheet(picture: Path) -> U8:
    if not picture.is_file():
        raise DamagedError(f"{picture.name} is missing: it holds the frames")
    try:
        with Image.open(picture) as opened:
            return np.asarray(opened.convert("RGB"), np.uint8)
    except UNREADABLE as error:
        raise DamagedError(f"{picture.name} is damaged") from error


def _digest(sheet: U8) -> str:
    return sha256(f"{sheet.shape}".encode() + np.ascontiguousarray(sheet).tobytes()).hexdigest()


def _short(values: NDArray[np.int64]) -> NDArray[Any]:
    """The same in 32 bits, if they fit."""
    if values.size and np.abs(values).max() > np.iinfo(np.int32).max:
        return values
    return values.astype(np.int32)
