"""Golden tests: a clip's motion and a few small frames, kept as files, and compared with the clip as it is now.

The archive NAME.npz holds, without pickles: `names` (N,); `times` (T,) s; `poses` (T, N, 3) px, px, rad of the centres
of mass; `turns` (T, N, 4) or (T, 0, 4) quaternions; `velocities` (T, N, 3) px/s, px/s, rad/s, where they are compared;
`frames` (K,), which of the clip's frames lie side by side in the picture NAME.webp, which is lossless, and
`frame_times` (K,) s; `made`, JSON with the format and the picture's hash.
"""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen.batch.compare import (
    ROUNDING,
    TIME_ROUNDING,
    U8,
    Samples,
    level_differences,
    motion_difference,
    number,
)
from physgen.batch.tolerances import GoldenOptions, Pixels
from physgen.files import write_atomic
from physgen.pipeline import Stages
from physgen.pipeline.stages import Film
from physgen.problems import InputError
from physgen.report.record import RunRecord
from physgen.simulate.trajectory import Trajectory

FORMAT = 2
PICTURE = ".webp"
WEBP = {"lossless": True, "exact": True, "quality": 60, "method": 4}
"""Encoded in 0.1 s; the highest effort takes 2 s and saves 2 %."""
REGENERATE = "--force-regen keeps the clip as it is now; look at it before you commit it"


class DamagedError(Exception):
    """Golden files that cannot be used, with the reason."""


@dataclass(frozen=True)
class Still:
    """A kept frame."""

    index: int
    """In the clip, from 0."""
    time: float
    """s of the motion."""
    rgb: U8
    """(h, w, 3) sRGB, small."""


@dataclass(frozen=True)
class Golden:
    """Content of golden files."""

    motion: Samples | None
    """None: motion is not kept."""
    stills: tuple[Still, ...] | None
    """None: frames are not kept."""


def make_clip(path: Path, options: GoldenOptions, warm: Stages) -> tuple[Trajectory, Golden]:
    """Simulates a scene and draws the frames to keep, without the cache on disk. Raises InputError."""
    scene = warm.load(path, options.overrides, options.variant, options.allow_outside)
    maps = warm.maps(scene)
    compiled = warm.compile(scene, maps)
    trajectory = warm.simulate(compiled.world)
    stills = None
    if options.pixels is not None:
        filming = Film(scene, compiled, maps, RunRecord(scene=scene.name, command=[]), warm)
        order = filming.shot(trajectory).order
        picked = _picked_frames(options, [float(trajectory.times[sample]) for sample in order])
        frames = filming.frames(trajectory, [order[index] for index in picked])
        drawn = filming.annotated(frames, trajectory)
        stills = tuple(
            Still(k, frame.time, _small(frame.rgb, options.side))
            for k, frame in zip(picked, drawn, strict=True)
        )
    motion = None
    if options.motion is not None:
        motion = Samples.of(trajectory, options.until)
        if options.motion.px_per_s is None and options.motion.degrees_per_s is None:
            motion = replace(motion, velocities=None)
    return trajectory, Golden(motion, stills)


def _picked_frames(options: GoldenOptions, times: Sequence[float]) -> list[int]:
    """Which frames of a clip are kept, by the time, s, that each of them shows. Raises InputError."""
    until = options.until
    early = [k for k, time in enumerate(times) if until is None or time <= until + TIME_ROUNDING]
    if isinstance(options.frames, int):
        picks = np.linspace(0, len(early) - 1, min(options.frames, len(early))).round().astype(int)
        return [early[k] for k in dict.fromkeys(picks.tolist())]
    if late := [index for index in options.frames if index not in early]:
        found = f"are not among the clip's first {len(early)}"
        raise InputError.of("frames", ", ".join(map(str, late)), found, "frames are counted from 0")
    return sorted(set(options.frames))


def _small(rgb: U8, side: int) -> U8:
    """(H, W, 3) to (h, w, 3), its longer side at most `side`: means of encoded pixels."""
    height, width = rgb.shape[:2]
    factor = side / max(height, width)
    if factor >= 1:
        return rgb
    size = max(1, round(width * factor)), max(1, round(height * factor))
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)


def save(golden: Golden, path: Path) -> None:
    """Writes `path`, and the picture beside it where there are frames; the same bytes for the same clip."""
    arrays: dict[str, NDArray[Any]] = {}
    made: dict[str, Any] = {"format": FORMAT}
    picture = path.with_suffix(PICTURE)
    if golden.motion is not None:
        kept = {key: value for key, value in vars(golden.motion).items() if value is not None}
        arrays |= {**kept, "names": np.array(golden.motion.names, dtype=np.str_)}
    path.parent.mkdir(parents=True, exist_ok=True)
    if golden.stills is None:
        picture.unlink(missing_ok=True)
    else:
        sheet = np.concatenate([still.rgb for still in golden.stills], axis=1)
        made["picture"] = _digest(sheet)
        arrays["frames"] = np.array([still.index for still in golden.stills])
        arrays["frame_times"] = np.array([still.time for still in golden.stills])
        encoded = io.BytesIO()
        Image.fromarray(sheet).save(encoded, "WEBP", **WEBP)
        write_atomic(picture, encoded.getvalue())
    arrays["made"] = np.frombuffer(json.dumps(made).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    write_atomic(path, buffer.getvalue())


def read(path: Path, picture: Path) -> Golden:
    """The inverse of `save`; nothing is unpickled. Raises DamagedError."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        made = json.loads(arrays["made"].tobytes())
        if made["format"] != FORMAT:
            raise DamagedError(f"{path.name} was written by another physgen, in another format")
        motion = _read_motion(arrays) if "poses" in arrays else None
        if "frames" not in arrays:
            return Golden(motion, None)
        with Image.open(picture) as opened:
            sheet = np.asarray(opened.convert("RGB"), np.uint8)
        if _digest(sheet) != made["picture"]:
            found = f"{picture.name} is not the picture that {path.name} was written with"
            raise DamagedError(f"{found}: keep both")
        parts = np.split(sheet, len(arrays["frames"]), axis=1)
        rows = zip(arrays["frames"].tolist(), arrays["frame_times"].tolist(), parts, strict=True)
        return Golden(motion, tuple(Still(int(index), float(time), rgb) for index, time, rgb in rows))
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        found = f"{path.name} is no golden file of physgen, or it or its picture is damaged or missing"
        raise DamagedError(found) from error


def _read_motion(arrays: dict[str, NDArray[Any]]) -> Samples:
    """Raises ValueError or KeyError."""
    names = tuple(map(str, arrays["names"].tolist()))
    times, poses, turns = (np.asarray(arrays[name], float) for name in ("times", "poses", "turns"))
    velocities = np.asarray(arrays["velocities"], float) if "velocities" in arrays else None
    count, shape = len(times), (len(times), len(names), 3)
    fit = poses.shape == shape and turns.shape in ((count, 0, 4), (count, len(names), 4))
    if not fit or (velocities is not None and velocities.shape != shape):
        raise ValueError("arrays of sizes that do not fit")
    return Samples(names, times, poses, turns, velocities)


def _digest(sheet: U8) -> str:
    return sha256(f"{sheet.shape}".encode() + np.ascontiguousarray(sheet).tobytes()).hexdigest()


def differences(path: Path, picture: Path, now: Golden, options: GoldenOptions) -> list[str]:
    """What of a clip differs from its golden files, a line each; none where it is as it was."""
    try:
        then = read(path, picture)
    except DamagedError as error:
        return [f"{error}; --force-regen writes them anew"]
    lines = [
        *_motion_lines(then.motion, now.motion, options),
        *_frame_lines(then.stills, now.stills, options),
    ]
    return [*lines, REGENERATE] if lines else []


def _motion_lines(then: Samples | None, now: Samples | None, options: GoldenOptions) -> list[str]:
    allowed = options.motion
    if allowed is None or now is None:
        return []
    if then is None or (then.velocities is None and now.velocities is not None):
        what = "motion is" if then is None else "velocities are"
        return [f"{what} to be compared, and not kept"]
    found = motion_difference(then, now, allowed)
    if found is None:
        return []
    return [f"motion {found.text()} ({allowed.px:g} px and {allowed.degrees:g}° allowed)"]


def _frame_lines(
    then: Sequence[Still] | None, now: Sequence[Still] | None, options: GoldenOptions
) -> list[str]:
    if options.pixels is None or now is None:
        return []
    kept = {still.index: still for still in then or ()}
    if kept.keys() != {still.index for still in now}:
        return [f"frames {', '.join(map(str, kept)) or 'none'} are kept, others are asked for"]
    for still in now:
        if text := frame_difference(kept[still.index].rgb, still.rgb, options.pixels):
            return [f"frame {still.index} ({still.time:.3f} s) is the first that differs: {text}"]
    return []


def frame_difference(then: U8, now: U8, allowed: Pixels) -> str:
    """How much two frames, (h, w, 3) each, differ; empty where that is allowed."""
    found = level_differences(then, now)
    if found is None:
        sizes = [" x ".join(map(str, rgb.shape[1::-1])) for rgb in (then, now)]
        return f"kept it is {sizes[0]} px, now {sizes[1]} px"
    levels = found.max(axis=-1)
    share, mean = float((levels > allowed.levels).mean()), float(found.mean())
    if share <= allowed.share * ROUNDING and mean <= allowed.mean * ROUNDING:
        return ""
    return (
        f"{number(100 * share)} % of its pixels differ by more than {allowed.levels:g} grey levels "
        f"({number(100 * allowed.share)} % allowed), by {levels.max()} at most; "
        f"{number(mean)} in the mean ({number(allowed.mean)} allowed)"
    )
