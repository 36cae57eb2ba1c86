"""What was found of a clip, as data, as one line, and as JSON."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any

from physgen.batch.verify.motion import Apart, Farthest, Motion
from physgen.batch.verify.pictures import Amount
from physgen.problems import Problem

NAMED = 3
"""Things that a line names; the rest is counted, and is in the JSON."""


class Outcome(Enum):
    """How a clip did."""

    EQUAL = "equal"
    DIFFERS = "differs"
    UNKNOWN = "not verified"
    """It could not be rendered again."""


class Recorded(Enum):
    """What the scene gives as the manifest has it, with every value as it was then."""

    SAME = "the scene as the manifest has it still gives that clip"
    OTHER = "nor does the scene as the manifest has it give that clip"
    UNREAD = "the scene as the manifest has it cannot be read any more"


class Why(Enum):
    """What frames differ by."""

    MOTION = "because of the motion alone"
    """Drawn with the old motion, they are as they were."""
    DRAWING = "drawn differently: the motion is the same"
    BOTH = "drawn differently, besides the motion"
    """They differ even where the old motion is drawn."""
    UNTOLD = "whether by the motion alone is not known"


@dataclass(frozen=True)
class Frames:
    """How the frames differ."""

    frame: int
    """The first."""
    time: float
    """s of the motion: what it shows."""
    differ: int
    """How many do, of those that both clips have."""
    counts: tuple[int, int]
    """How many frames there were, and are."""
    why: Why
    first: Amount | None = None
    """How much the first differs; None where that could not be measured."""
    most: Amount | None = None
    """Of the frame in which most grey levels differ."""
    film: str = ""
    """What that was measured in; empty where that loses nothing."""
    loss: int = 0
    """Grey levels that this film loses by itself: less says nothing."""
    unmeasured: str = ""
    drawn: int | None = None
    """With `BOTH`: the first frame that differs though the old motion is drawn."""
    untold: str = ""
    """With `UNTOLD`: why."""


@dataclass(frozen=True)
class Verdict:
    """What was found of one clip."""

    clip: str
    """Its folder."""
    outcome: Outcome
    samples: int = 0
    """Of its motion, as its manifest has it."""
    frames: int = 0
    files: int = 0
    changed: tuple[str, ...] = ()
    """What the run read and is not as it was."""
    elsewhere: tuple[str, ...] = ()
    """Versions, machine and device that are not the run's."""
    damaged: tuple[str, ...] = ()
    """Output files that are not as they were written."""
    motion: Motion | None = None
    pictures: Frames | None = None
    recorded: Recorded | None = None
    """Where the scene has changed and the clip differs."""
    notes: tuple[str, ...] = ()
    problems: tuple[Problem, ...] = ()
    """Why it could not be rendered."""

    def line(self) -> str:
        """For a person.

        >>> Verdict("out/pool", Outcome.EQUAL, 48, 48, 4).line()
        'out/pool: equal: 48 samples, 48 frames, 4 files'
        """
        parts: list[str] = []
        if self.outcome is Outcome.EQUAL:
            parts.append(
                f"{_count(self.samples, 'sample')}, {_count(self.frames, 'frame')}, {_count(self.files, 'file')}"
            )
        if self.changed:
            parts.append(f"since then {_some(self.changed)}")
        parts += [str(problem) for problem in self.problems]
        parts += [_some(self.damaged)] if self.damaged else []
        parts += [*_of_motion(self.motion)] if self.motion else []
        parts += [*_of_frames(self.pictures)] if self.pictures else []
        if self.outcome is Outcome.DIFFERS and (self.motion or self.pictures):
            cause = f"made with {_some(self.elsewhere)}" if self.elsewhere else ""
            if not (self.changed or self.elsewhere):
                cause = "nothing that it reads has changed, nor have versions or the machine"
            parts += [cause] if cause else []
        parts += [self.recorded.value] if self.recorded else []
        parts += self.notes
        return f"{self.clip}: {self.outcome.value}: {'; '.join(parts)}"

    def as_dict(self) -> dict[str, Any]:
        """For a program."""
        return {
            "clip": self.clip,
            "outcome": self.outcome.value,
            "samples": self.samples,
            "frames": self.frames,
            "files": self.files,
            "changed": self.changed,
            "elsewhere": self.elsewhere,
            "damaged": self.damaged,
            "motion": None if self.motion is None else asdict(self.motion),
            "pictures": None
            if self.pictures is None
            else {**asdict(self.pictures), "why": self.pictures.why.name.lower()},
            "recorded": None if self.recorded is None else self.recorded.name.lower(),
            "notes": self.notes,
            "problems": [problem.as_dict() for problem in self.problems],
        }


def _of_motion(motion: Motion) -> Iterable[str]:
    before, now = motion.samples
    if before != now:
        yield f"{_count(before, 'sample')} then, {now} now"
    if motion.gone:
        yield f"without {_some(motion.gone)} now"
    if motion.new:
        yield f"with {_some(motion.new)} now"
    where = f"motion from sample {motion.sample} ({motion.time:.3g} s)"
    if motion.unnamed:
        yield f"{where}; objects cannot be told: {motion.unnamed}"
    elif motion.objects:
        ends = [
            _far(end, unit)
            for end, unit in ((motion.most_px, "px"), (motion.most_rad, "rad"))
            if end is not None
        ]
        yield f"{where}: {_some([_apart(item) for item in motion.objects])}" + (
            f"; at most {' and '.join(ends)}" if ends else ""
        )
    elif not (motion.gone or motion.new or before != now):
        yield where
    if motion.retimed:
        yield "samples are at other times now"
    if motion.rounding is not None:
        sample, time, names = motion.rounding
        yield f"by rounding from sample {sample} ({time:.3g} s): {_some(names)}"


def _of_frames(frames: Frames) -> Iterable[str]:
    before, now = frames.counts
    if before != now:
        yield f"{_count(before, 'frame')} then, {now} now"
    if not frames.differ:
        return
    where = f"frames from {frames.frame} ({frames.time:.3g} s)"
    often = f"{frames.differ} of {min(before, now)}"
    how = ""
    if frames.first is not None:
        how = f": {f'in {frames.film} ' if frames.film else ''}{_much(frames.first, frames.loss)}"
        most = frames.most
        if most is not None and most.frame != frames.first.frame and most.levels > frames.loss:
            how += f", {_much(most, frames.loss)} in frame {most.frame}"
        how += f" (beyond the {frames.loss} that it may lose)" if frames.loss else ""
    elif frames.unmeasured:
        how = f", how much cannot be told: {frames.unmeasured}"
    yield f"{where}, {often}{how}"
    if frames.why is Why.BOTH:
        yield f"{frames.why.value}, from frame {frames.drawn}"
    else:
        yield frames.why.value + (f": {frames.untold}" if frames.untold else "")


def _much(amount: Amount, loss: int) -> str:
    if amount.levels <= loss:
        return "nothing that it shows"
    return f"{amount.pixels} px by up to {_count(amount.levels, 'grey level')}"


def _apart(item: Apart) -> str:
    if item.rounding:
        return f"{item.object} by rounding"
    amounts = [(item.px, "px"), (item.rad, "rad")]
    if not any(amount for amount, _ in amounts):
        amounts = [(item.px_s, "px/s"), (item.rad_s, "rad/s"), (item.turned, "rad in space")]
    told = [f"{amount:.3g} {unit}" for amount, unit in amounts if amount]
    return f"{item.object} by {' and '.join(told)}"


def _far(end: Farthest, unit: str) -> str:
    return f"{end.amount:.3g} {unit} ({end.object} at {end.time:.3g} s)"


def _some(things: Sequence[str]) -> str:
    """Few of them by name."""
    more = len(things) - NAMED
    return ", ".join(things[:NAMED]) + (f" and {more} more" if more > 0 else "")


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"
