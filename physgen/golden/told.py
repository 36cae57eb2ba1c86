"""A verdict -> what is said of it in a few lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import floor

from physgen.golden.drawn import Compared, Drawn
from physgen.golden.judging import EARLIER, Verdict
from physgen.golden.moved import MEASURES, Moved

MOST = 6
"""Changes that are told of."""

Line = tuple[str, str]
"""What it is about, and a sentence or two."""


def lines(verdict: Verdict) -> list[Line]:
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
