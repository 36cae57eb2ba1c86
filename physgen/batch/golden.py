"""Golden tests: a clip's motion and a few small frames, kept as files, and compared with the clip as it is now.

The archive NAME.npz holds, without pickles: `names` (N,); `times` (T,) s; `poses` (T, N, 3) px, px, rad of the centres
of mass; `turns` (T, N, 4) or (T, 0, 4) quaternions; `velocities` (T, N, 3) px/s, px/s, rad/s, where they are compared;
`frames` (K,), which of the clip's frames lie side by side in the picture NAME.webp, which is lossless, and
`frame_times` (K,) s; `made`, JSON of what the clip was made of.
"""

from __future__ import annotations

import base64
import io
import json
import platform
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen import __version__
from physgen.batch.compare import (
    ROUNDING,
    SCENE_SUFFIXES,
    TIME_ROUNDING,
    U8,
    MotionDifference,
    Samples,
    changed_environment,
    changed_files,
    changed_values,
    few,
    level_differences,
    motion_difference,
    number,
    value_text,
)
from physgen.batch.tolerances import GoldenOptions, Pixels
from physgen.files import write_atomic
from physgen.pipeline import Stages
from physgen.pipeline.cache_keys import ROOMS, code_version
from physgen.pipeline.stages import Film
from physgen.problems import InputError
from physgen.report.html import template
from physgen.report.record import RunRecord, inputs, json_text, versions
from physgen.simulate.trajectory import Trajectory

FORMAT = 2
PICTURE = ".webp"
WEBP = {"lossless": True, "exact": True, "quality": 60, "method": 4}
"""Encoded in 0.1 s; the highest effort takes 2 s and saves 2 %."""
MAX_LISTED = 6
"""Changes in a message."""
LABEL_WIDTH = 9
"""Characters of the label of a line."""
MAX_GAIN, MAX_GAINED = 64, 320
"""Differences are amplified in the page by a power of 2, as far as the largest stays below so many grey levels."""


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
class Made:
    """What a clip was made of, as JSON data."""

    asked: dict[str, Any]
    """`overrides`, `variant` and `until`."""
    inputs: dict[str, str]
    """SHA-256 of the files that were read, by path relative to the scene's folder."""
    document: dict[str, Any]
    """The resolved scene."""
    environment: dict[str, str]
    """Versions of physgen, Python and libraries; `sources`: a hash of physgen's code; the processor and its system."""


@dataclass(frozen=True)
class Golden:
    """Content of golden files."""

    motion: Samples | None
    """None: motion is not kept."""
    stills: tuple[Still, ...] | None
    """None: frames are not kept."""
    made: Made


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
    made = Made(
        asked={"overrides": list(options.overrides), "variant": options.variant, "until": options.until},
        inputs=inputs(scene, path, warm.hash),
        document=json.loads(json_text(scene.document)),
        environment={
            **versions(),
            "sources": code_version(ROOMS)["sources"],
            "the processor": f"{platform.machine()} {platform.system()}",
            "the processor's instructions": cv2.getCPUFeaturesLine(),
        },
    )
    return trajectory, Golden(motion, stills, made)


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
    made: dict[str, Any] = {"format": FORMAT, **asdict(golden.made)}
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
        digest = data.pop("picture", None)
        made = Made(**data)
        motion = _read_motion(arrays) if "poses" in arrays else None
        if digest is None:
            return Golden(motion, None, made)
        if not picture.is_file():
            raise DamagedError(f"{picture.name} is missing: it holds the frames")
        with Image.open(picture) as opened:
            sheet = np.asarray(opened.convert("RGB"), np.uint8)
        if _digest(sheet) != digest:
            found = f"{picture.name} is not the picture that {path.name} was written with"
            raise DamagedError(f"{found}: keep both")
        parts = np.split(sheet, len(arrays["frames"]), axis=1)
        rows = zip(arrays["frames"].tolist(), arrays["frame_times"].tolist(), parts, strict=True)
        return Golden(motion, tuple(Still(int(index), float(time), rgb) for index, time, rgb in rows), made)
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise DamagedError(f"{path.name} is no golden file of physgen, or damaged") from error


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


@dataclass(frozen=True)
class FrameResult:
    """A kept frame, and the same frame now."""

    then: Still
    now: Still
    levels: U8 | None
    """(h, w): the most grey levels by which a channel differs; None where the sizes differ."""
    share: float
    """Of pixels that differ by more levels than allowed."""
    mean: float
    """Grey levels."""
    bad: bool

    def text(self, allowed: Pixels) -> str:
        """How much differs, for a person."""
        if self.levels is None:
            then, now = (" x ".join(map(str, still.rgb.shape[1::-1])) for still in (self.then, self.now))
            return f"kept it is {then} px, now {now} px"
        return (
            f"{number(100 * self.share)} % of its pixels differ by more than {allowed.levels:g} grey levels "
            f"({number(100 * allowed.share)} % allowed), by {self.levels.max()} at most; "
            f"{number(self.mean)} in the mean ({number(allowed.mean)} allowed)"
        )


def compare_frame(then: Still, now: Still, allowed: Pixels) -> FrameResult:
    """Compares one frame."""
    differences = level_differences(then.rgb, now.rgb)
    if differences is None:
        return FrameResult(then, now, None, 1.0, 255.0, bad=True)
    levels = differences.max(axis=-1)
    share, mean = float((levels > allowed.levels).mean()), float(differences.mean())
    bad = share > allowed.share * ROUNDING or mean > allowed.mean * ROUNDING
    return FrameResult(then, now, levels, share, mean, bad)


@dataclass(frozen=True)
class Verdict:
    """How a clip compares with its golden files."""

    motion: MotionDifference | None
    """None: it agrees, or is not compared."""
    frames: tuple[FrameResult, ...]
    """Those that are in both."""
    faults: tuple[tuple[str, str], ...]
    """Label and text of everything that is wrong; empty where the clip is as it was."""
    scene: tuple[str, ...]
    """What is different in the scene, the test's options, or the input files: sentences."""
    environment: tuple[str, ...]
    """What is different in versions and machine: sentences."""

    def lines(self) -> list[tuple[str, str]]:
        """Label and text of each part of the result."""
        same = "the scene is the same" + (
            "" if self.environment else ", and so are physgen, the libraries and the kind of processor"
        )
        lines = [*self.faults, ("since", few(self.scene, MAX_LISTED, "; ") if self.scene else same)]
        if self.environment:
            lines.append(("since", few(self.environment, MAX_LISTED, "; ")))
        if self.motion is not None and not self.scene:
            advice = "chaotic motion strays everywhere; until= compares the time before"
            lines.append(("chaos?", advice))
        return lines


def judge(golden: Golden, now: Golden, options: GoldenOptions) -> Verdict:
    """Compares a clip with golden files."""
    faults: list[tuple[str, str]] = []
    motion: MotionDifference | None = None
    frames: tuple[FrameResult, ...] = ()
    allowed, pixels = options.motion, options.pixels
    if allowed is not None and now.motion is not None:
        if golden.motion is None or (golden.motion.velocities is None and now.motion.velocities is not None):
            what = "motion is" if golden.motion is None else "velocities are"
            faults.append(("kept", f"{what} to be compared, and not kept; --force-regen keeps them"))
        else:
            motion = motion_difference(golden.motion, now.motion, allowed)
        if motion is not None:
            limits = f"{allowed.px:g} px and {allowed.degrees:g}° allowed"
            faults.append(("motion", f"{motion.text()} ({limits})"))
    if pixels is not None and now.stills is not None:
        kept = {still.index: still for still in golden.stills or ()}
        frames = tuple(
            compare_frame(kept[still.index], still, pixels) for still in now.stills if still.index in kept
        )
        if kept.keys() != {still.index for still in now.stills}:
            numbers = ", ".join(map(str, kept)) or "no"
            faults.append(
                ("kept", f"frames {numbers} are kept, others are asked for; --force-regen keeps them")
            )
        if bad := [frame for frame in frames if frame.bad]:
            where = f"frame {bad[0].then.index} ({bad[0].then.time:.3f} s)"
            text = f"{where} is the first of {len(frames)} kept that is bad: {bad[0].text(pixels)}"
            faults.append(("pixels", text + ("" if motion else "; the motion is as it was")))
    return Verdict(motion, frames, tuple(faults), *_changes(golden.made, now.made))


def _changes(then: Made, now: Made) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What is different in the scene and in the environment: comments and the order of keys do not count."""
    scene = [
        f"the test says {key}={value_text(now.asked.get(key))} now, not {value_text(value)}"
        for key, value in then.asked.items()
        if value != now.asked.get(key)
    ]
    scene += changed_values(then.document, now.document)
    scene += changed_files(then.inputs, now.inputs, SCENE_SUFFIXES)
    return tuple(scene), tuple(changed_environment(then.environment, now.environment))


@dataclass(frozen=True)
class Check:
    """One clip of a test, just made."""

    test: str
    """The test's node id."""
    scene: str
    """As messages name it."""
    options: GoldenOptions
    trajectory: Trajectory
    golden: Golden
    """What would be kept of it."""

    def write(self, file: Path) -> None:
        """Writes golden files: `file`, and the picture beside it."""
        save(self.golden, file)

    def differs(self, expected: Path, picture: Path, folder: Path) -> tuple[str, list[Path]]:
        """What differs from golden files, empty if nothing does; and the files that show it, written to `folder`."""
        try:
            golden = read(expected, picture)
        except DamagedError as error:
            return f"{error}; --force-regen writes them anew", []
        verdict = judge(golden, self.golden, self.options)
        if not verdict.faults:
            return "", []
        page = folder / f"{expected.stem}.html"
        obtained = folder / f"{expected.stem}.obtained{expected.suffix}"
        self.write(obtained)
        write_atomic(page, render_page(verdict, golden, self).encode("utf-8"))
        lines = [*verdict.lines(), ("page", str(page))]
        lines.append(("right?", "--force-regen keeps the clip as it is now; look at it before you commit it"))
        text = [f"{self.scene} is not the clip of {expected.name}."]
        text += [f"  {label:<{LABEL_WIDTH}}{line}" for label, line in lines]
        has_picture = self.golden.stills is not None
        return "\n".join(text), [page, obtained, *([obtained.with_suffix(PICTURE)] if has_picture else [])]


def checked(path: Path, scene: str, test: str, options: GoldenOptions, warm: Stages) -> Check:
    """Makes the clip of the scene file at `path`. Raises InputError."""
    return Check(test, scene, options, *make_clip(path, options, warm))


def render_page(verdict: Verdict, golden: Golden, check: Check) -> str:
    """One HTML page without external resources: what was expected, what came, and the difference."""
    then, now = ({**made.environment, **made.inputs} for made in (golden.made, check.golden.made))
    made = [(name, then.get(name, "none")[:40], now.get(name, "none")[:40]) for name in {**then, **now}]
    pixels = check.options.pixels
    html: str = template("golden.html.j2").render(
        test=check.test,
        scene=check.scene,
        lines=verdict.lines(),
        frames=[] if pixels is None else [_frame(frame, pixels) for frame in verdict.frames],
        made=made,
        version=__version__,
    )
    return html


def _frame(frame: FrameResult, allowed: Pixels) -> dict[str, Any]:
    pictures = [("expected", frame.then.rgb), ("got", frame.now.rgb)]
    if frame.levels is not None:
        gain = MAX_GAIN
        while gain > 1 and gain * int(frame.levels.max()) > MAX_GAINED:
            gain //= 2
        strong = np.minimum(frame.levels.astype(np.int32) * gain, 255).astype(np.uint8)
        heat = np.asarray(cv2.applyColorMap(strong, cv2.COLORMAP_INFERNO)[:, :, ::-1], np.uint8)
        pictures.append((f"difference × {gain}", heat))
    return {
        "index": frame.then.index,
        "time": f"{frame.then.time:.3f}",
        "bad": frame.bad,
        "text": frame.text(allowed),
        "pictures": [(title, _data_url(rgb)) for title, rgb in pictures],
    }


def _data_url(rgb: U8) -> str:
    """Lossless."""
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, "WEBP", lossless=True, quality=40, method=2)
    return "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
