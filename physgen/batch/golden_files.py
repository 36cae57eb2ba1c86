"""Golden files `NAME.npz` and `NAME.webp`: a clip's rounded motion, a few small frames, and what it was made of.

The archive holds, without pickles: `names` (N,); `samples` (T,), which of the clip's; `times` (T,) s; `poses` (T, N, 3)
and `poses_unit` (3,), whose product is x px, y px, degrees, of the centre of mass; `turns` (T, N, 4) or (T, 0, 4) and
`turns_unit`, likewise quaternions; `velocities` and `velocities_unit`, px/s and degrees/s, where they are compared;
`frames` (K,), which of the clip's frames lie side by side in the picture, and `frame_times` (K,) s; `made`, JSON of
what the clip was made of. The picture is lossless.
"""

from __future__ import annotations

import io
import json
import platform
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
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
from physgen.pipeline import Stages
from physgen.pipeline.cache_keys import ROOMS, code_version
from physgen.pipeline.stages import Film
from physgen.problems import InputError
from physgen.report.record import RunRecord, inputs, json_text, versions
from physgen.simulate.trajectory import Trajectory

F64 = NDArray[np.float64]
Int = NDArray[np.int64]
U8 = NDArray[np.uint8]

FORMAT = 1
PICTURE = ".webp"
WEBP = {"lossless": True, "exact": True, "quality": 60, "method": 4}
"""Encoded in 0.1 s; the highest effort takes 2 s and saves 2 %."""
MAX_POSES = 10_000
"""Samples times objects that are kept; of a longer clip or more objects, fewer samples are, evenly spread."""
MIN_SAMPLES = 12
TIME_ROUNDING = 1e-9
"""s."""
MAX_DOCUMENT = 200_000
"""Characters of a resolved scene, as JSON, that are kept."""
IN_DEGREES = np.array([1.0, 1.0, 180 / np.pi])
"""px, px, rad to px, px, degrees."""


class DamagedError(Exception):
    """Golden files that cannot be used, with the reason."""


@dataclass(frozen=True)
class Units:
    """Units of the integers of a KeptMotion."""

    px: float
    degrees: float
    px_per_s: float | None
    """None: velocities are not kept."""
    degrees_per_s: float | None

    @classmethod
    def of(cls, allowed: Motion) -> Units:
        """Powers of ten, such that rounding is at most a twentieth of the tolerance."""

        def unit(amount: float | None) -> float | None:
            return None if amount is None else float(f"1e{floor(log10(amount) + 1e-9) - 1}")

        px, degrees = unit(allowed.px), unit(allowed.degrees)
        assert px is not None
        assert degrees is not None
        return cls(px, degrees, unit(allowed.px_per_s), unit(allowed.degrees_per_s))

    @property
    def pose(self) -> F64:
        """(3,) px, px, degrees."""
        return np.array([self.px, self.px, self.degrees])

    @property
    def turn(self) -> float:
        """Of a quaternion's parts: a rotation changes them by at most half its angle in rad."""
        return float(f"1e{floor(log10(radians(self.degrees)) + 1e-9) - 1}")

    @property
    def velocity(self) -> F64 | None:
        """(3,) px/s, px/s, degrees/s; 1 for what is not kept."""
        if self.px_per_s is None and self.degrees_per_s is None:
            return None
        return np.array([self.px_per_s or 1.0, self.px_per_s or 1.0, self.degrees_per_s or 1.0])


@dataclass(frozen=True)
class KeptMotion:
    """Motion of N objects at T samples, in integer multiples of units."""

    names: tuple[str, ...]
    samples: Int
    """(T,): which of the clip's."""
    times: F64
    """(T,) s."""
    units: Units
    kept_poses: Int
    """(T, N, 3)."""
    kept_turns: Int
    """(T, N, 4) or (T, 0, 4)."""
    kept_velocities: Int | None
    """(T, N, 3)."""

    @classmethod
    def of(cls, trajectory: Trajectory, units: Units, until: float | None) -> KeptMotion:
        """The motion of a clip, up to a time if one is given."""
        times, bodies = trajectory.times, max(len(trajectory.names), 1)
        count = (
            len(times) if until is None else int(np.searchsorted(times, until + TIME_ROUNDING, side="right"))
        )
        most = min(count, max(MIN_SAMPLES, MAX_POSES // bodies))
        picked = np.unique(np.linspace(0, count - 1, most).round().astype(np.int64))
        velocities = None
        if units.velocity is not None:
            velocities = _rounded(trajectory.velocities[picked] * IN_DEGREES, units.velocity)
        return cls(
            names=trajectory.names,
            samples=picked,
            times=times[picked],
            units=units,
            kept_poses=_rounded(trajectory.poses[picked] * IN_DEGREES, units.pose),
            kept_turns=_rounded(trajectory.turns[picked], units.turn),
            kept_velocities=velocities,
        )

    @property
    def poses(self) -> F64:
        """(T, N, 3): px, px, rad."""
        return np.asarray(self.kept_poses * (self.units.pose / IN_DEGREES))

    @property
    def turns(self) -> F64:
        """(T, N, 4) quaternions."""
        return np.asarray(self.kept_turns * self.units.turn)

    @property
    def velocities(self) -> F64 | None:
        """(T, N, 3): px/s, px/s, rad/s."""
        if self.kept_velocities is None or self.units.velocity is None:
            return None
        return np.asarray(self.kept_velocities * (self.units.velocity / IN_DEGREES))


def _rounded(values: F64, unit: F64 | float) -> Int:
    return np.asarray(np.rint(values / unit).astype(np.int64))


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
class Made:
    """What a clip was made of, as JSON data."""

    asked: dict[str, Any]
    """`overrides`, `variant` and `until`."""
    inputs: dict[str, str]
    """SHA-256 of the files that were read, by path relative to the scene's folder."""
    document: dict[str, Any] | None
    """The resolved scene; None where it is too long."""
    versions: dict[str, str]
    """Of physgen, Python and libraries; `sources`: a hash of physgen's code."""
    machine: dict[str, str]
    """`kind` of processor, `system`, and which `instructions` OpenCV uses there."""
    size: tuple[int, int]
    """Width and height of the video, px."""
    on_photo: bool
    """Whether the first frame shows the whole photo at t = 0."""


@dataclass(frozen=True)
class Golden:
    """Content of golden files."""

    motion: KeptMotion | None
    """None: motion is not kept."""
    stills: tuple[Still, ...] | None
    """None: frames are not kept."""
    made: Made


@dataclass(frozen=True)
class GoldenClip:
    """A clip that was just made."""

    trajectory: Trajectory
    world: World
    golden: Golden
    """What would be kept of it."""


def make_clip(path: Path, options: GoldenOptions, warm: Stages) -> GoldenClip:
    """Simulates a scene and draws the frames to keep, without the cache on disk. Raises InputError."""
    scene = warm.load(path, options.overrides, options.variant, options.allow_outside)
    maps = warm.maps(scene)
    compiled = warm.compile(scene, maps)
    trajectory = warm.simulate(compiled.world, cached=False)
    filming = Film(scene, compiled, maps, RunRecord(scene=scene.name, command=[]), warm)
    shot = filming.shot(trajectory)
    stills = None
    if options.pixels is not None:
        picked = _picked_frames(options, [float(trajectory.times[sample]) for sample in shot.order])
        frames = filming.frames(trajectory, [shot.order[index] for index in picked])
        drawn = filming.annotated(frames, trajectory)
        stills = tuple(
            Still(k, frame.time, _small(frame.rgb, options.side))
            for k, frame in zip(picked, drawn, strict=True)
        )
    document = json.loads(json_text(scene.document))
    made = Made(
        asked={"overrides": list(options.overrides), "variant": options.variant, "until": options.until},
        inputs=inputs(scene, path, warm.hash),
        document=document if len(json.dumps(document)) <= MAX_DOCUMENT else None,
        versions={**versions(), "sources": code_version(ROOMS)["sources"]},
        machine={
            "kind": platform.machine(),
            "system": platform.system(),
            "instructions": cv2.getCPUFeaturesLine(),
        },
        size=scene.video_size,
        on_photo=shot.opens_on_photo,
    )
    motion = None
    if options.motion is not None:
        motion = KeptMotion.of(trajectory, Units.of(options.motion), options.until)
    return GoldenClip(trajectory, compiled.world, Golden(motion, stills, made))


def _picked_frames(options: GoldenOptions, times: Sequence[float]) -> list[int]:
    """Which frames of a clip are kept, by the time, s, that each of them shows. Raises InputError."""
    until = options.until
    early = [k for k, time in enumerate(times) if until is None or time <= until + TIME_ROUNDING]
    if isinstance(options.frames, int):
        picks = np.linspace(0, len(early) - 1, min(options.frames, len(early))).round().astype(int)
        return [early[k] for k in dict.fromkeys(picks.tolist())]
    if late := [index for index in options.frames if index not in early]:
        found = (
            f"are not among the clip's first {len(early)}" if until is None else f"are not before {until} s"
        )
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
    arrays: dict[str, Any] = {}
    made: dict[str, Any] = {"format": FORMAT, **asdict(golden.made)}
    motion, picture = golden.motion, path.with_suffix(PICTURE)
    if motion is not None:
        made["units"] = asdict(motion.units)
        arrays |= {"names": np.array(motion.names, dtype=np.str_)}
        arrays |= {"samples": motion.samples, "times": motion.times}
        arrays |= {"poses": _compact(motion.kept_poses), "poses_unit": motion.units.pose}
        arrays |= {"turns": _compact(motion.kept_turns), "turns_unit": np.array(motion.units.turn)}
        if motion.kept_velocities is not None:
            arrays |= {"velocities": _compact(motion.kept_velocities)}
            arrays |= {"velocities_unit": motion.units.velocity}
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
    arrays["made"] = np.frombuffer(json.dumps(made, ensure_ascii=False).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    write_atomic(path, buffer.getvalue())


def read(path: Path, picture: Path) -> Golden:
    """The inverse of `save`; nothing is unpickled. Raises DamagedError."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        data = json.loads(arrays["made"].tobytes())
        if data.pop("format") != FORMAT:
            raise DamagedError(f"{path.name} was written by another physgen, in another format")
        units, digest = data.pop("units", None), data.pop("picture", None)
        made = Made(**{**data, "size": tuple(data["size"])})
        motion = None if units is None else _read_motion(arrays, Units(**units))
        if digest is None:
            return Golden(motion, None, made)
        if not picture.is_file():
            raise DamagedError(f"{picture.name} is missing: it holds the frames")
        with Image.open(picture) as opened:
            sheet = np.asarray(opened.convert("RGB"), np.uint8)
        if _digest(sheet) != digest:
            raise DamagedError(
                f"{picture.name} is not the picture that {path.name} was written with: keep both"
            )
        parts = np.split(sheet, len(arrays["frames"]), axis=1)
        rows = zip(arrays["frames"].tolist(), arrays["frame_times"].tolist(), parts, strict=True)
        return Golden(motion, tuple(Still(int(index), float(time), rgb) for index, time, rgb in rows), made)
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise DamagedError(f"{path.name} is no golden file of physgen, or damaged") from error


def _read_motion(arrays: dict[str, NDArray[Any]], units: Units) -> KeptMotion:
    """Raises ValueError or KeyError."""
    names = tuple(map(str, arrays["names"].tolist()))
    samples, times = arrays["samples"], arrays["times"]
    poses, turns = arrays["poses"].astype(np.int64), arrays["turns"].astype(np.int64)
    velocities = arrays["velocities"].astype(np.int64) if "velocities" in arrays else None
    shape = len(times), len(names), 3
    turn_shapes = (len(times), 0, 4), (len(times), len(names), 4)
    fit = samples.shape == times.shape and poses.shape == shape and turns.shape in turn_shapes
    if not fit or (velocities is not None and velocities.shape != shape):
        raise ValueError("arrays of sizes that do not fit")
    return KeptMotion(names, samples, times, units, poses, turns, velocities)


def _digest(sheet: U8) -> str:
    return sha256(f"{sheet.shape}".encode() + np.ascontiguousarray(sheet).tobytes()).hexdigest()


def _compact(values: Int) -> NDArray[Any]:
    """The same in 32 bits, if they fit."""
    fits = not values.size or np.abs(values).max() <= np.iinfo(np.int32).max
    return values.astype(np.int32) if fits else values
