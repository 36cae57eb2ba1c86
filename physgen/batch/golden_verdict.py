"""Judge a clip against its golden files and summarise the differences as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import floor

import numpy as np

from physgen.batch.changes import Causes, causes
from physgen.batch.compare import MEASURES, Compared, Drawn, Moved, drawn, moved, too_coarse
from physgen.batch.golden_files import Clip, Golden
from physgen.batch.tolerances import GoldenOptions
from physgen.compile.world import World
from physgen.problems import InputError

# ----------------------------------------------------------------------
# Golden files, the clip now and what is asked -> whether it moves and looks as it did, and what has changed
# since.

EARLIER = 0.9
"""Of the time at which chaos shows, up to which comparing is advised."""


@dataclass(frozen=True)
class Foretold:
    """How long a motion can be foretold."""

    until: float | None
    """s: when runs a hair apart have parted by a pixel; None: never."""
    verdict: str


@dataclass(frozen=True)
class Verdict:
    """How a clip compares with its golden files."""

    scene: str
    """As the test names it."""
    golden: Golden
    clip: Clip
    asked: GoldenOptions
    moved: Moved | None
    """None: motion is not compared."""
    drawn: Drawn | None
    """None: frames are not."""
    unkept: tuple[str, ...]
    """What cannot be compared as it is asked, since it is not kept so: sentences."""
    causes: Causes
    foretold: Foretold | None
    """Worked out only where the same scene moves differently."""

    @property
    def right(self) -> bool:
        """Whether the clip is as it was."""
        return not self.unkept and all(part is None or part.agrees for part in (self.moved, self.drawn))

    @property
    def pixels_alone(self) -> bool:
        """Whether things move as they did, and look different."""
        return (
            self.moved is not None and self.moved.agrees and self.drawn is not None and not self.drawn.agrees
        )


def judged(scene: str, golden: Golden, clip: Clip, asked: GoldenOptions) -> Verdict:
    """Compare a clip with golden files; runs the scene's neighbours where the same scene moves differently."""
    unkept, moves, frames = [], None, None
    if asked.motion is not None:
        if golden.track is None:
            unkept.append("motion is to be compared, and is not kept")
        elif coarse := too_coarse(golden.track.units, asked.motion):
            unkept.append(f"motion cannot be compared: {coarse}")
        else:
            moves = moved(golden.track, clip.trajectory, asked.motion, asked.until)
    if asked.pixels is not None and clip.stills is not None:
        if golden.stills is None:
            unkept.append("frames are to be compared, and none are kept")
        else:
            frames = drawn(golden.stills, clip.stills, asked.pixels)
    since = causes(golden.made, clip.made)
    foretold = None
    if moves is not None and moves.strayed and not since.scene:
        foretold = _foretold(clip.world)
    return Verdict(scene, golden, clip, asked, moves, frames, tuple(unkept), since, foretold)


def _foretold(world: World) -> Foretold | None:
    """What the engine's own test of chaos says; None where it cannot be run."""
    from physgen.simulate.chaos import NUDGES, WILD, chaos

    try:
        found = chaos(world)
    except InputError:
        return None
    wild = found.distance[:, :NUDGES].max(axis=1) > WILD if found.distance.size else np.zeros(0, bool)
    until = float(found.parted[wild, :NUDGES].min()) if wild.any() else None
    return Foretold(until, found.verdict())


# ----------------------------------------------------------------------
# A verdict -> what is said of it in a few lines.

MOST = 6
"""Changes that are told of."""

Line = tuple[str, str]
"""What it is about, and a sentence or two."""


def summary_lines(verdict: Verdict) -> list[Line]:
    """Motion, pixels and what has changed since, apart from each other."""
    said = [("kept", f"{text}; --force-regen keeps it anew") for text in verdict.unkept]
    if verdict.moved is not None:
        said.append(("motion", _of_motion(verdict.moved)))
    if verdict.drawn is not None:
        said.append(("pixels", _of_pixels(verdict.drawn, verdict)))
    said += [("since", text) for text in since(verdict)]
    if verdict.foretold is not None:
        said.append(("chaos?", _of_chaos(verdict)))
    return said


def _of_motion(moved: Moved) -> str:
    if moved.agrees:
        return f"agrees: nothing is farther than {_amounts({k: moved.most(k) for k in moved.apart})} from where it was"
    said = []
    if moved.strayed:
        first = moved.strayed[0]
        over = {name: value for name, value in first.there.items() if value > getattr(moved.allowed, name)}
        allowed = _amounts({name: getattr(moved.allowed, name) for name in over})
        said.append(
            f"{first.name} strays first, in sample {first.sample} ({first.time:.3f} s), by {_amounts(over)} "
            f"({allowed} allowed)"
        )
        far = max(moved.strayed, key=lambda item: item.most["px"][0])
        amount, when = far.most["px"]
        if len(moved.strayed) == 1:
            said.append(
                f"it alone of {len(moved.names)} does, by {_number(amount)} px at most, at {when:.3f} s"
            )
        else:
            count = f"{len(moved.strayed)} of {len(moved.names)} objects do"
            said.append(f"{count}, {far.name} most: {_number(amount)} px at {when:.3f} s")
    else:
        said.append("where both can be compared, it agrees")
    for names, what in ((moved.gone, "is gone"), (moved.new, "is new")):
        if names:
            more = f" and {len(names) - MOST} more" if len(names) > MOST else ""
            said.append(f"{', '.join(names[:MOST])}{more} {what}")
    if moved.retimed:
        then, now = (
            f"{len(part.times)} samples up to {part.times[-1] if len(part.times) else 0:.3f} s"
            for part in (moved.then, moved.now)
        )
        said.append(f"it is {now} now, was {then}; what is at other times is not compared")
    return "; ".join(said)


def _of_pixels(drawn: Drawn, verdict: Verdict) -> str:
    said = []
    first = drawn.first
    if first is not None:
        said.append(
            f"frame {first.then.index} ({first.then.time:.3f} s) is the first of {len(drawn.frames)} kept that is bad: "
            f"{of_frame(first, drawn)}"
        )
        said.append(_whence(first, verdict))
    elif drawn.agrees:
        count = len(drawn.frames)
        return (
            f"agree: no pixel of the {count} frames that are kept differs by more than {_levels(drawn.worst)}"
        )
    if drawn.kept != drawn.asked:
        said.append(f"frames {_listed(drawn.kept)} are kept, {_listed(drawn.asked)} are asked for")
    return "; ".join(filter(None, said))


def of_frame(frame: Compared, drawn: Drawn) -> str:
    """How much of a frame differs."""
    if frame.levels is None:
        sizes = (" x ".join(map(str, still.rgb.shape[1::-1])) for still in (frame.now, frame.then))
        return "kept it is {1} px, now {0} px".format(*sizes)
    allowed = drawn.allowed
    return (
        f"{_percent(frame.share)} of its pixels differ by more than {_levels(allowed.levels)} "
        f"({_percent(allowed.share)} allowed), by {frame.worst} at most; {_number(frame.mean)} in the mean "
        f"({_number(allowed.mean)} allowed)"
    )


def _whence(first: Compared, verdict: Verdict) -> str:
    """Whether pixels follow the motion."""
    moved = verdict.moved
    if moved is None:
        return ""
    if moved.agrees:
        return "they alone differ, the motion does not"
    if not moved.strayed or moved.strayed[0].time <= first.then.time:
        return "pixels follow the motion"
    return "that is before the motion differs"


def since(verdict: Verdict) -> list[str]:
    """What has changed since the files were written."""
    found = verdict.causes
    if found.scene:
        said = [f"the scene is another one: {_few(found.scene)}"]
    else:
        said = ["the scene is the same"]
    if found.versions:
        said.append(_few(found.versions))
    if found.machine:
        said.append(_few(found.machine))
    if not found.scene and not found.versions and not found.machine:
        said[0] += ", and so are physgen, the libraries and the kind of processor"
    return said


def _of_chaos(verdict: Verdict) -> str:
    assert verdict.foretold is not None
    said, until = verdict.foretold.verdict, verdict.foretold.until
    if until is None or (verdict.asked.until is not None and verdict.asked.until <= until):
        return said
    early = floor(until * EARLIER * 100) / 100
    return f"{said} Say until={early:g} to compare what can be foretold"


def _few(sentences: Sequence[str]) -> str:
    more = f"; and {len(sentences) - MOST} more" if len(sentences) > MOST else ""
    return "; ".join(sentences[:MOST]) + more


def _amounts(amounts: Mapping[str, float]) -> str:
    return " and ".join(f"{_number(value)}{MEASURES[name]}" for name, value in amounts.items())


def _number(value: float) -> str:
    """Three digits.

    >>> [_number(v) for v in (0.0, 0.123456, 41.26, 12345.6)]
    ['0', '0.123', '41.3', '12346']
    """
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _percent(share: float) -> str:
    return f"{_number(100 * share)} %"


def _levels(levels: float) -> str:
    return f"{levels:g} grey level{'' if levels == 1 else 's'}"


def _listed(indices: Sequence[int]) -> str:
    return ", ".join(map(str, indices[:12])) + (", ..." if len(indices) > 12 else "")
