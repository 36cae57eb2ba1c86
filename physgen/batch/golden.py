"""Check a scene against its golden files, and write a report page when its clip differs."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import floor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen import __version__
from physgen.batch.compare import (
    F64,
    SCENE_SUFFIXES,
    U8,
    Distances,
    changed_environment,
    changed_files,
    changed_values,
    distances,
    few,
    level_differences,
    value_text,
)
from physgen.batch.golden_files import (
    PICTURE,
    TIME_ROUNDING,
    DamagedError,
    Golden,
    GoldenClip,
    KeptMotion,
    Made,
    Still,
    Units,
    make_clip,
    read,
    save,
)
from physgen.batch.tolerances import GoldenOptions, Motion, Pixels
from physgen.compile.world import World
from physgen.files import write_atomic
from physgen.pipeline import Stages
from physgen.problems import InputError
from physgen.report.html import template
from physgen.report.perception import Comparison, Picture
from physgen.simulate.trajectory import Trajectory

UNITS = {"px": " px", "degrees": "°", "px_per_s": " px/s", "degrees_per_s": "°/s"}
"""Of the tolerances of Motion, as written after a number."""
ROUNDING = 1 + 1e-9
"""Factor of tolerances: 30 units of 0.01 are 0.3."""
SAFE_SHARE = 0.9
"""Of the time at which chaos shows, up to which comparing is advised."""
MAX_LISTED = 6
MAX_ROWS = 200
"""Objects in the page's table."""
LABEL_WIDTH = 9
"""Characters of the label of a line."""
GAINS = (64, 32, 16, 8, 4, 2, 1)
"""By which differences are amplified in the page, as far as the largest stays below MAX_GAINED grey levels."""
MAX_GAINED = 320


@dataclass(frozen=True)
class Strayed:
    """An object that is farther from where it was than allowed."""

    name: str
    sample: int
    """The first at which it is."""
    time: float
    """s."""
    there: Mapping[str, float]
    """How far it is then, by the tolerances' names."""
    most: Mapping[str, tuple[float, float]]
    """The largest distance, and its time, s."""


@dataclass(frozen=True)
class MotionResult:
    """How a clip's motion compares with the kept one."""

    allowed: Motion
    then: KeptMotion
    now: KeptMotion
    samples: NDArray[np.int64]
    """(T,): those that both have."""
    found: Distances

    @cached_property
    def amounts(self) -> dict[str, F64]:
        """(T, N) each, by the names of the tolerances that are compared."""
        found = self.found
        amounts = {"px": found.px, "degrees": np.degrees(np.maximum(found.rad, found.turned))}
        amounts |= {"px_per_s": found.px_s, "degrees_per_s": np.degrees(found.rad_s)}
        return {name: amount for name, amount in amounts.items() if getattr(self.allowed, name) is not None}

    @property
    def retimed(self) -> bool:
        """Whether the clip is longer or shorter, or sampled at other times."""
        return not len(self.then.times) == len(self.samples) == len(self.now.times)

    @cached_property
    def strayed(self) -> tuple[Strayed, ...]:
        """The first to stray first; of those at the same sample, the farthest."""
        excess = np.max([amount / getattr(self.allowed, k) for k, amount in self.amounts.items()], axis=0)
        beyond = excess > ROUNDING
        found = []
        for k in np.flatnonzero(beyond.any(axis=0)).tolist():
            row = int(beyond[:, k].argmax())
            tops = {name: int(amount[:, k].argmax()) for name, amount in self.amounts.items()}
            strayed = Strayed(
                self.found.names[k],
                int(self.samples[row]),
                float(self.found.times[row]),
                {name: float(amount[row, k]) for name, amount in self.amounts.items()},
                {
                    n: (float(self.amounts[n][top, k]), float(self.found.times[top]))
                    for n, top in tops.items()
                },
            )
            found.append((row, -excess[row, k], strayed))
        return tuple(item for *_, item in sorted(found, key=lambda entry: entry[:2]))

    @property
    def agrees(self) -> bool:
        """Whether nothing differs by more than is allowed."""
        return not (self.strayed or self.found.gone or self.found.new or self.retimed)

    def most(self, name: str) -> float:
        """The largest amount of the clip."""
        return float(self.amounts[name].max(initial=0.0))

    def text(self) -> str:
        """For a person."""
        if self.agrees:
            most = _amounts({name: self.most(name) for name in self.amounts})
            return f"agrees: nothing is farther than {most} from where it was"
        parts = []
        if self.strayed:
            first = self.strayed[0]
            over = {name: v for name, v in first.there.items() if v > getattr(self.allowed, name)}
            allowed = _amounts({name: getattr(self.allowed, name) for name in over})
            where = f"in sample {first.sample} ({first.time:.3f} s)"
            parts.append(f"{first.name} strays first, {where}, by {_amounts(over)} ({allowed} allowed)")
            far = max(self.strayed, key=lambda item: item.most["px"][0])
            most = f"{_number(far.most['px'][0])} px"
            count, total = len(self.strayed), len(self.found.names)
            if count == 1:
                parts.append(f"it alone of {total} does, by {most} at most, at {far.most['px'][1]:.3f} s")
            else:
                parts.append(
                    f"{count} of {total} objects do, {far.name} most: {most} at {far.most['px'][1]:.3f} s"
                )
        else:
            parts.append("where both can be compared, it agrees")
        for names, what in ((self.found.gone, "is gone"), (self.found.new, "is new")):
            parts += [f"{few(names, MAX_LISTED)} {what}"] if names else []
        if self.retimed:
            then, now = (
                f"{len(part.times)} samples up to {part.times[-1] if len(part.times) else 0:.3f} s"
                for part in (self.then, self.now)
            )
            parts.append(f"it is {now} now, was {then}; what is at other times is not compared")
        return "; ".join(parts)


def compare_motion(
    then: KeptMotion, trajectory: Trajectory, allowed: Motion, until: float | None
) -> MotionResult:
    """Compares at the samples that both have; `then` is fine enough, see `too_coarse`."""
    now = KeptMotion.of(trajectory, then.units, until)
    _, one, other = np.intersect1d(then.samples, now.samples, return_indices=True)
    alike = np.abs(then.times[one] - now.times[other]) <= TIME_ROUNDING
    rows = one[alike], other[alike]
    return MotionResult(allowed, then, now, then.samples[rows[0]], distances(then, now, rows))


def too_coarse(units: Units, allowed: Motion) -> str:
    """Why a motion kept in these units cannot be compared as closely as is asked; empty where it can."""
    for name, unit in UNITS.items():
        asked, kept = getattr(allowed, name), getattr(units, name)
        if asked is not None and kept is None:
            return f"velocities are not kept, and {asked:g}{unit} are asked for"
        if asked is not None and kept > asked * ROUNDING:
            return f"it is kept to {kept:g}{unit} only, and {asked:g}{unit} are asked for"
    return ""


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

    @property
    def worst(self) -> int:
        """Grey levels: the most that any pixel differs by."""
        return 255 if self.levels is None else int(self.levels.max())

    def text(self, allowed: Pixels) -> str:
        """How much differs, for a person."""
        if self.levels is None:
            then, now = (" x ".join(map(str, still.rgb.shape[1::-1])) for still in (self.then, self.now))
            return f"kept it is {then} px, now {now} px"
        return (
            f"{_number(100 * self.share)} % of its pixels differ by more than {_levels(allowed.levels)} "
            f"({_number(100 * allowed.share)} % allowed), by {self.worst} at most; {_number(self.mean)} in the mean "
            f"({_number(allowed.mean)} allowed)"
        )


@dataclass(frozen=True)
class FramesResult:
    """How the kept frames compare."""

    allowed: Pixels
    frames: tuple[FrameResult, ...]
    """Those that are in both."""
    kept: tuple[int, ...]
    asked: tuple[int, ...]

    @property
    def first(self) -> FrameResult | None:
        """The first bad one."""
        return next((frame for frame in self.frames if frame.bad), None)

    @property
    def agrees(self) -> bool:
        """Whether nothing differs by more than is allowed."""
        return self.first is None and self.kept == self.asked

    @property
    def worst(self) -> int:
        """Grey levels."""
        return max((frame.worst for frame in self.frames), default=0)

    def text(self, motion: MotionResult | None) -> str:
        """For a person; `motion` tells whether pixels follow it."""
        if self.agrees:
            count = len(self.frames)
            return f"agree: no pixel of the {count} frames that are kept differs by more than {_levels(self.worst)}"
        parts, first = [], self.first
        if first is not None:
            where = f"frame {first.then.index} ({first.then.time:.3f} s)"
            found = first.text(self.allowed)
            parts.append(f"{where} is the first of {len(self.frames)} kept that is bad: {found}")
            if motion is not None and motion.agrees:
                parts.append("they alone differ, the motion does not")
            elif motion is not None:
                early = not motion.strayed or motion.strayed[0].time <= first.then.time
                parts.append("pixels follow the motion" if early else "that is before the motion differs")
        if self.kept != self.asked:
            kept, asked = (few(list(map(str, part)), 12) for part in (self.kept, self.asked))
            parts.append(f"frames {kept} are kept, {asked} are asked for")
        return "; ".join(parts)


def compare_frames(then: Sequence[Still], now: Sequence[Still], allowed: Pixels) -> FramesResult:
    """Compares frames by their number."""
    frames = {still.index: still for still in now}
    return FramesResult(
        allowed,
        tuple(_compare_frame(still, frames[still.index], allowed) for still in then if still.index in frames),
        tuple(still.index for still in then),
        tuple(frames),
    )


def _compare_frame(then: Still, now: Still, allowed: Pixels) -> FrameResult:
    differences = level_differences(then.rgb, now.rgb)
    if differences is None:
        return FrameResult(then, now, None, 1.0, 255.0, bad=True)
    levels = differences.max(axis=-1)
    share, mean = float((levels > allowed.levels).mean()), float(differences.mean())
    bad = share > allowed.share * ROUNDING or mean > allowed.mean * ROUNDING
    return FrameResult(then, now, levels, share, mean, bad)


@dataclass(frozen=True)
class Changes:
    """What is different from when the golden files were written: sentences."""

    scene: tuple[str, ...]
    """In the scene, the test's options, or the input files."""
    environment: tuple[str, ...]
    """Versions and machine."""

    def texts(self) -> list[str]:
        """For a person."""
        scene = f"the scene is another one: {few(self.scene, MAX_LISTED, '; ')}" if self.scene else ""
        if not self.scene:
            same = "" if self.environment else ", and so are physgen, the libraries and the kind of processor"
            scene = f"the scene is the same{same}"
        return [scene, *([few(self.environment, MAX_LISTED, "; ")] if self.environment else [])]


def changes(then: Made, now: Made) -> Changes:
    """Scenes are compared by meaning: comments and the order of keys do not count."""
    scene = [
        f"the test says {key}={value_text(now.asked.get(key))} now, not {value_text(value)}"
        for key, value in then.asked.items()
        if value != now.asked.get(key)
    ]
    known = then.document is not None and now.document is not None
    scene += changed_values(then.document, now.document) if known else []
    scene += changed_files(then.inputs, now.inputs, SCENE_SUFFIXES if known else ())
    environment = [{**made.versions, **_machine(made)} for made in (then, now)]
    return Changes(tuple(scene), tuple(changed_environment(environment[0], environment[1])))


def _machine(made: Made) -> dict[str, str]:
    names = {"kind": "the processor", "system": "the system", "instructions": "the processor's instructions"}
    return {name: str(made.machine.get(key)) for key, name in names.items()}


@dataclass(frozen=True)
class Check:
    """One clip of a test, just made."""

    test: str
    """The test's node id."""
    scene: str
    """As messages name it."""
    options: GoldenOptions
    clip: GoldenClip

    def write(self, file: Path) -> None:
        """Writes golden files: `file`, and the picture beside it."""
        save(self.clip.golden, file)

    def differs(self, expected: Path, picture: Path, folder: Path) -> tuple[str, list[Path]]:
        """What differs from golden files, empty if nothing does; and the files that show it, written to `folder`."""
        try:
            golden = read(expected, picture)
        except DamagedError as error:
            return f"{error}; --force-regen writes them anew", []
        verdict = judge(golden, self.clip, self.options)
        if verdict.right:
            return "", []
        page = folder / f"{expected.stem}.html"
        obtained = folder / f"{expected.stem}.obtained{expected.suffix}"
        self.write(obtained)
        write_atomic(page, render_page(verdict, self).encode("utf-8"))
        lines = [*verdict.lines(), ("page", str(page))]
        lines.append(("right?", "--force-regen keeps the clip as it is now; look at it before you commit it"))
        text = [f"{self.scene} is not the clip of {expected.name}. {verdict.headline()}"]
        text += [f"  {label:<{LABEL_WIDTH}}{line}" for label, line in lines]
        has_picture = self.clip.golden.stills is not None
        return "\n".join(text), [page, obtained, *([obtained.with_suffix(PICTURE)] if has_picture else [])]


def checked(path: Path, scene: str, test: str, options: GoldenOptions, warm: Stages) -> Check:
    """Makes the clip of the scene file at `path`. Raises InputError."""
    return Check(test, scene, options, make_clip(path, options, warm))


@dataclass(frozen=True)
class Verdict:
    """How a clip compares with its golden files."""

    golden: Golden
    clip: GoldenClip
    motion: MotionResult | None
    """None: motion is not compared."""
    frames: FramesResult | None
    """None: frames are not."""
    not_kept: tuple[str, ...]
    """What cannot be compared as asked: sentences."""
    changes: Changes
    chaos: str
    """How long the motion is predictable; only where the same scene moves differently."""

    @property
    def right(self) -> bool:
        """Whether the clip is as it was."""
        return not self.not_kept and all(part is None or part.agrees for part in (self.motion, self.frames))

    def headline(self) -> str:
        """In a few words."""
        if self.motion is not None and not self.motion.agrees:
            same = self.frames is not None and self.frames.agrees
            return "Moves differently" + (", looks the same in the frames kept" if same else "")
        if self.frames is not None and not self.frames.agrees:
            if self.motion is None:
                return "Looks different; motion was not compared"
            return "Moves as it did, looks different"
        return "Cannot be compared as it is asked"

    def lines(self) -> list[tuple[str, str]]:
        """Label and text of each part of the result."""
        lines = [("kept", f"{text}; --force-regen keeps it anew") for text in self.not_kept]
        lines += [("motion", self.motion.text())] if self.motion is not None else []
        lines += [("pixels", self.frames.text(self.motion))] if self.frames is not None else []
        lines += [("since", text) for text in self.changes.texts()]
        lines += [("chaos?", self.chaos)] if self.chaos else []
        return lines


def judge(golden: Golden, clip: GoldenClip, options: GoldenOptions) -> Verdict:
    """Compares a clip with golden files; tests for chaos where the same scene moves differently."""
    not_kept, motion, frames = [], None, None
    if options.motion is not None:
        if golden.motion is None:
            not_kept.append("motion is to be compared, and is not kept")
        elif coarse := too_coarse(golden.motion.units, options.motion):
            not_kept.append(f"motion cannot be compared: {coarse}")
        else:
            motion = compare_motion(golden.motion, clip.trajectory, options.motion, options.until)
    if options.pixels is not None and clip.golden.stills is not None:
        if golden.stills is None:
            not_kept.append("frames are to be compared, and none are kept")
        else:
            frames = compare_frames(golden.stills, clip.golden.stills, options.pixels)
    found = changes(golden.made, clip.golden.made)
    chaos = ""
    if motion is not None and motion.strayed and not found.scene:
        chaos = _chaos(clip.world, options.until)
    return Verdict(golden, clip, motion, frames, tuple(not_kept), found, chaos)


def _chaos(world: World, until: float | None) -> str:
    """The engine's test of chaos, with the time up to which comparing makes sense."""
    from physgen.simulate.chaos import NUDGES, WILD, chaos

    try:
        found = chaos(world)
    except InputError:
        return ""
    wild = found.distance[:, :NUDGES].max(axis=1) > WILD if found.distance.size else np.zeros(0, bool)
    if not wild.any():
        return found.verdict()
    parted = float(found.parted[wild, :NUDGES].min())
    if until is not None and until <= parted:
        return found.verdict()
    early = floor(parted * SAFE_SHARE * 100) / 100
    return f"{found.verdict()} Say until={early:g} to compare what can be predicted"


def render_page(verdict: Verdict, check: Check) -> str:
    """One HTML page without external resources: what was expected, what came, and the difference."""
    frames = verdict.frames
    first = None if frames is None else frames.first
    html: str = template("golden.html.j2").render(
        test=check.test,
        scene=check.scene,
        headline=verdict.headline(),
        lines=verdict.lines(),
        first=None if first is None or frames is None else _comparison(first, frames.allowed),
        frames=[] if frames is None else [_frame(frame, frames) for frame in frames.frames],
        moved=None if verdict.motion is None else _motion(verdict.motion, verdict.clip.golden.made),
        causes=verdict.changes,
        made=_made(verdict.golden.made, verdict.clip.golden.made),
        version=__version__,
    )
    return html


def _comparison(frame: FrameResult, allowed: Pixels) -> Comparison | None:
    """The frame then and now, to slide between."""
    if frame.levels is None:
        return None
    before = _picture(frame.then.rgb, "expected", f"Frame {frame.then.index} as it was")
    after = _picture(frame.now.rgb, "got", f"Frame {frame.now.index} as it is now")
    title = f"Frame {frame.then.index}, {frame.then.time:.3f} s"
    return Comparison("first", title, f"{_capital(frame.text(allowed))}.", before, after)


def _frame(frame: FrameResult, frames: FramesResult) -> dict[str, Any]:
    index = frame.then.index
    stills = ((frame.then, "expected"), (frame.now, "got"))
    pictures = [_picture(still.rgb, name, f"{name} frame {index}") for still, name in stills]
    if frame.levels is not None:
        gain = next((gain for gain in GAINS if gain * frame.worst <= MAX_GAINED), 1)
        strong = np.minimum(frame.levels.astype(np.int32) * gain, 255).astype(np.uint8)
        heat = np.asarray(cv2.applyColorMap(strong, cv2.COLORMAP_INFERNO)[:, :, ::-1], np.uint8)
        pictures.append(_picture(heat, f"difference × {gain}", f"where frame {index} differs"))
    text = f"Right: no pixel differs by more than {frame.worst}" if frame.worst else "Equal, bit by bit"
    return {
        "index": index,
        "time": f"{frame.then.time:.3f}",
        "bad": frame.bad,
        "first": frame is frames.first,
        "text": _capital(frame.text(frames.allowed)) if frame.bad else text,
        "pictures": pictures,
    }


def _picture(rgb: U8, title: str, alt: str) -> Picture:
    """Lossless."""
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, "WEBP", lossless=True, quality=40, method=2)
    uri = "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
    return Picture(title, title, "", alt, uri, rgb.shape[1], rgb.shape[0])


def _motion(motion: MotionResult, made: Made) -> dict[str, Any]:
    objects: Mapping[str, Any] = (made.document or {}).get("objects") or {}
    return {
        "agrees": motion.agrees,
        "apart": [
            (UNITS[name].strip(), f"{motion.most(name):.3g}", f"{getattr(motion.allowed, name):g}")
            for name in motion.amounts
        ],
        "rows": [
            {
                "name": item.name,
                "label": str((objects.get(item.name) or {}).get("label") or ""),
                "sample": item.sample,
                "time": f"{item.time:.3f}",
                "there": [f"{item.there[name]:.3g}{UNITS[name]}" for name in motion.amounts],
                "most": [f"{item.most[name][0]:.3g}{UNITS[name]}" for name in motion.amounts],
                "when": f"{item.most['px'][1]:.3f}",
            }
            for item in motion.strayed[:MAX_ROWS]
        ],
        "strayed": len(motion.strayed),
        "objects": len(motion.found.names),
    }


def _made(then: Made, now: Made) -> list[tuple[str, str, str]]:
    """What both clips were made with: name, then, now."""
    sides = [
        {
            **{name: value[:12] if name == "sources" else value for name, value in made.versions.items()},
            **_machine(made),
            **{name: digest[:12] for name, digest in made.inputs.items()},
        }
        for made in (then, now)
    ]
    then_side, now_side = sides
    names = {**then_side, **now_side}
    return [(name, then_side.get(name, "none"), now_side.get(name, "none")) for name in names]


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _amounts(amounts: Mapping[str, float]) -> str:
    return " and ".join(f"{_number(value)}{UNITS[name]}" for name, value in amounts.items())


def _number(value: float) -> str:
    """Three digits.

    >>> [_number(v) for v in (0.0, 0.123456, 41.26, 12345.6)]
    ['0', '0.123', '41.3', '12346']
    """
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _levels(levels: float) -> str:
    return f"{levels:g} grey level{'' if levels == 1 else 's'}"
