"""Golden files: a clip's quantised motion and a few small frames, written and read."""

from __future__ import annotations

import io
import json
import platform
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from hashlib import sha256
from math import floor, log10, radians
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen.batch.tolerances import GoldenOptions, Motion
from physgen.compile.world import World
from physgen.files import write_atomic
from physgen.pipeline import Warm
from physgen.pipeline.cache_keys import ROOMS, code_version
from physgen.pipeline.filming import Filming
from physgen.problems import InputError
from physgen.report.record import RunRecord, inputs, json_text, versions
from physgen.scene.scene import Scene
from physgen.simulate.trajectory import Trajectory

# ----------------------------------------------------------------------
# Trajectory -> places, angles and, where asked for, velocities as whole numbers of a unit far below the
# tolerance.

Array = NDArray[np.float64]
Whole = NDArray[np.int64]

MOST_POSES = 10_000
"""Samples times objects that are kept; of a longer clip or a larger heap, fewer samples are, evenly spread."""
FEWEST = 12
"""Samples that are kept of any clip that has them."""
LATE = 1e-9
"""s: how times may be rounded."""


@dataclass(frozen=True)
class Units:
    """What 1 stands for in a `Track`."""

    px: float
    degrees: float
    px_per_s: float | None
    """None: velocities are not kept."""
    degrees_per_s: float | None

    @property
    def pose(self) -> Array:
        """(3,) px, px, degrees."""
        return np.array([self.px, self.px, self.degrees])

    @property
    def turn(self) -> float:
        """Of a quaternion's parts: a turn by an angle changes them by half of it, in rad, at most."""
        return decade(radians(self.degrees))

    @property
    def velocity(self) -> Array | None:
        """(3,) px/s, px/s, degrees/s; what is not kept counts as 1."""
        if self.px_per_s is None and self.degrees_per_s is None:
            return None
        return np.array([self.px_per_s or 1.0, self.px_per_s or 1.0, self.degrees_per_s or 1.0])


def decade(amount: float) -> float:
    """The power of ten that is a tenth of an amount, or up to ten times less.

    >>> decade(0.1), decade(0.05), decade(1e-6)
    (0.01, 0.001, 1e-07)
    """
    return float(f"1e{floor(log10(amount) + 1e-9) - 1}")


def units(allowed: Motion) -> Units:
    """Such that rounding is at most a twentieth of what is allowed."""
    speed, spin = allowed.px_per_s, allowed.degrees_per_s
    return Units(
        decade(allowed.px),
        decade(allowed.degrees),
        None if speed is None else decade(speed),
        None if spin is None else decade(spin),
    )


@dataclass(frozen=True)
class Track:
    """How N objects move, at T samples."""

    names: tuple[str, ...]
    samples: Whole
    """(T,): which of the clip's."""
    times: Array
    """(T,) s."""
    units: Units
    poses: Whole
    """(T, N, 3) units of px, px, degrees: of the centre of mass, image axes."""
    turns: Whole
    """(T, N, 4): quaternions, see `Trajectory.turns`; (T, 0, 4) without."""
    velocities: Whole | None
    """(T, N, 3) units of px/s, px/s, degrees/s."""

    @cached_property
    def places(self) -> Array:
        """(T, N, 2) px."""
        return np.asarray(self.poses[..., :2] * self.units.px)


def kept_samples(times: Array, bodies: int, until: float | None) -> Whole:
    """Which samples of a clip at `times` (T,) s are kept."""
    count = len(times) if until is None else int(np.searchsorted(times, until + LATE, side="right"))
    most = max(FEWEST, MOST_POSES // max(bodies, 1))
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


def track(trajectory: Trajectory, of: Units, until: float | None) -> Track:
    """The clip's motion, up to a time if one is given, in units."""
    picked = kept_samples(trajectory.times, len(trajectory.names), until)
    poses, velocities = (_in_degrees(part[picked]) for part in (trajectory.poses, trajectory.velocities))
    return Track(
        names=trajectory.names,
        samples=picked,
        times=trajectory.times[picked],
        units=of,
        poses=_whole(poses, of.pose),
        turns=_whole(trajectory.turns[picked], of.turn),
        velocities=None if of.velocity is None else _whole(velocities, of.velocity),
    )


def _in_degrees(values: Array) -> Array:
    """(..., 3) with its angles, the last of three, in degrees."""
    return np.asarray(values * np.array([1.0, 1.0, 180 / np.pi]))


def _whole(values: Array, unit: Array | float) -> Whole:
    return np.asarray(np.rint(values / unit).astype(np.int64))


# ----------------------------------------------------------------------
# Scene file -> its clip as golden files keep it: the motion, a few small frames, and what they were made of.

U8 = NDArray[np.uint8]

LONGEST = 200_000
"""Letters of a resolved scene, as JSON, that are kept: deflated, a tenth of that."""


@dataclass(frozen=True)
class Still:
    """A frame that is kept."""

    index: int
    """In the clip, from 0."""
    time: float
    """s of the motion."""
    rgb: U8
    """(h, w, 3) sRGB, small."""


@dataclass(frozen=True)
class Made:
    """What a clip was made of, as JSON data."""

    asked: dict[str, Any]
    """`overrides`, `variant` and `until`."""
    inputs: dict[str, str]
    """SHA-256 of the files that were read, by path relative to the scene's folder."""
    document: dict[str, Any] | None
    """The resolved scene; None for one that is too long to be kept."""
    versions: dict[str, str]
    """Of physgen, Python and libraries; `sources`: a hash of physgen's own."""
    machine: dict[str, str]
    """`kind` of processor, `system`, and which `instructions` OpenCV uses there."""
    size: tuple[int, int]
    """Width and height of the video, px."""
    on_photo: bool
    """Whether the video's first frame shows the whole canvas, as it is at t = 0."""


@dataclass(frozen=True)
class Clip:
    """A clip that was just made."""

    trajectory: Trajectory
    stills: tuple[Still, ...] | None
    """None: nobody asked."""
    made: Made
    world: World


def taken(path: Path, asked: GoldenOptions, warm: Warm) -> Clip:
    """Simulate a scene and draw the frames that are kept; nothing comes from the disk's cache. Raises InputError."""
    scene = warm.load(path, asked.overrides, asked.variant, asked.allow_outside)
    maps = warm.maps(scene)
    compiled = warm.compile(scene, maps)
    trajectory = warm.simulate(compiled.world, cached=False)
    filming = Filming(scene, compiled, maps, "cpu", RunRecord(scene=scene.name, command=[]), warm)
    shot = filming.shot(trajectory)
    stills = None
    if asked.pixels is not None:
        shown = _shown(asked, [float(trajectory.times[sample]) for sample in shot.order])
        frames = filming.frames(trajectory, [shot.order[index] for index in shown])
        drawn = filming.annotated(frames, trajectory)
        stills = tuple(
            Still(index, frame.time, small(frame.rgb, asked.side))
            for index, frame in zip(shown, drawn, strict=True)
        )
    return Clip(
        trajectory,
        stills,
        _made(scene, path, asked, warm, shot.opens_on_photo),
        compiled.world,
    )


def _shown(asked: GoldenOptions, times: Sequence[float]) -> list[int]:
    """Which frames of a clip are kept, by the time, s, that each of them shows."""
    early = [k for k, time in enumerate(times) if asked.until is None or time <= asked.until + LATE]
    if isinstance(asked.frames, int):
        picks = np.linspace(0, len(early) - 1, min(asked.frames, len(early))).round().astype(int)
        return [early[k] for k in dict.fromkeys(picks.tolist())]
    if late := [index for index in asked.frames if index not in early]:
        found = ", ".join(map(str, late))
        what = (
            f"are not among the clip's first {len(early)}"
            if asked.until is None
            else f"are not before {asked.until} s"
        )
        raise InputError.of("frames", found, what, "frames are counted from 0")
    return sorted(set(asked.frames))


def small(rgb: U8, side: int) -> U8:
    """(H, W, 3) -> (h, w, 3), its longer side at most `side`: means of the pixels, as they are encoded."""
    height, width = rgb.shape[:2]
    factor = side / max(height, width)
    if factor >= 1:
        return rgb
    size = max(1, round(width * factor)), max(1, round(height * factor))
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)


def _made(scene: Scene, path: Path, asked: GoldenOptions, warm: Warm, on_photo: bool) -> Made:
    document = json.loads(json_text(scene.document))
    return Made(
        asked={"overrides": list(asked.overrides), "variant": asked.variant, "until": asked.until},
        inputs=inputs(scene, path, warm.hash),
        document=document if len(json.dumps(document)) <= LONGEST else None,
        versions={**versions(), "sources": code_version(ROOMS)["sources"]},
        machine={
            "kind": platform.machine(),
            "system": platform.system(),
            "instructions": cv2.getCPUFeaturesLine(),
        },
        size=scene.video_size,
        on_photo=on_photo,
    )


# ----------------------------------------------------------------------
# Golden clips <-> `NAME.npz` and `NAME.webp`, which NumPy and Pillow read.
#
# In the archive, without pickles: `names` (N,); `samples` (T,), which of the clip's; `times` (T,) s; `poses`
# (T, N, 3)
# and `poses_unit` (3,), whose product is x px, y px, degrees, of the centre of mass; `turns` (T, N, 4) or (T,
# 0, 4) and
# `turns_unit`, likewise quaternions; `velocities` and `velocities_unit` where they were asked for, px/s and
# degrees/s;
# `frames` (K,), which of the clip's frames lie side by side in the picture, and `frame_times` (K,) s; `made`,
# what all of
# it was made of, as bytes of JSON. The picture is lossless.

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
        write_atomic(path, buffer.getvalue())
        return [path]
    drawn = io.BytesIO()
    Image.fromarray(sheet).save(drawn, "WEBP", lossless=True, exact=True, **EFFORT)
    write_atomic(picture, drawn.getvalue())
    write_atomic(path, buffer.getvalue())
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
