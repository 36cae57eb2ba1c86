"""Fan -> for each body what the photo decides of it, what it does not, and which number that hangs on; in sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.fan.fan import Fan
from physgen.fan.outcome import PART, Fate, Outcome
from physgen.fan.statistics import along, correlation, radius, telling, wilson

Array = NDArray[np.float64]

VERBS = {Fate.STAYS: "stays", Fate.MOVES: "moves", Fate.LEAVES: "leaves the photo", Fate.FALLS: "falls"}
"""What is said of one body."""


@dataclass(frozen=True)
class Cause:
    """A number that goes with an outcome."""

    paths: tuple[str, ...]
    """Where it is written; several where they are drawn alike."""
    text: str
    """Whose it is."""
    correlation: float
    """Spearman's, with the outcome."""
    outcome: str = "fate"
    """`fate`: that the event happens; `place`: where it ends, along the line on which ends differ most."""


@dataclass(frozen=True)
class Verdict:
    """What becomes of one body in N draws."""

    name: str
    counts: Mapping[Fate, int]
    """Of draws that could be simulated."""
    event: Fate
    """What is counted: the largest fate that occurs."""
    interval: tuple[float, float]
    """0..1: within which the share of all draws lies in which that happens."""
    radius: float
    """px about the middle of its last places within which 9 of 10 lie."""
    size: float
    """px; see `outcome.size`."""
    parted: float
    """s from which 9 of 10 draws need a circle larger than its size; infinite: never."""
    rests: int
    """Draws in which it has come to rest by the end."""
    touches: Mapping[str, int]
    """Whom it touches first, and in how many draws; `nothing` where nobody."""
    cause: Cause | None
    """Of what is not decided, of its fate before its place; None where all is, or where no number tells."""
    own: Fate
    """In the clip."""

    @property
    def total(self) -> int:
        """Draws that could be simulated."""
        return sum(self.counts.values())

    @property
    def share(self) -> float:
        """0..1: of draws in which the event happens."""
        return self.counts[self.event] / self.total

    @property
    def decided(self) -> bool:
        """Whether every draw ends alike."""
        return self.counts[self.event] == self.total

    @property
    def placed(self) -> bool:
        """Whether the photo decides where it ends, too, as far as its own size tells."""
        return self.radius <= PART * self.size

    def sentences(self) -> list[str]:
        """What is decided and what is not, without the body's name."""
        lines = [self._fate()]
        if self.event is not Fate.STAYS and not (self.placed and not self.decided):
            lines.append(self._place())
        if self.cause is not None:
            lines.append(self._why(self.cause))
        return lines

    def _fate(self) -> str:
        low, high = (percent(end) for end in self.interval)
        if self.decided:
            return (
                f"Decided by the photo: {VERBS[self.event]} in all {self.total} draws "
                f"(95 % interval {low} to {high})."
            )
        others = [
            f"{VERBS[fate]} in {self.counts[fate]}"
            for fate in sorted(Fate, reverse=True)
            if fate is not self.event and self.counts[fate]
        ]
        return (
            f"Not decided: {VERBS[self.event]} in {self.counts[self.event]} of {self.total} draws "
            f"({percent(self.share)}, 95 % interval {low} to {high}), {', '.join(others)}."
        )

    def _place(self) -> str:
        if self.placed:
            return f"Where it ends is decided, too: 9 of 10 draws lie within {self.radius:.3g} px."
        parts = (
            "" if np.isinf(self.parted) else f"; from {self.parted:.2f} s on they are apart by its own size"
        )
        return (
            f"Where it ends is not decided: 9 of 10 draws lie within {self.radius:.3g} px of their middle, "
            f"{self.radius / self.size:.2g} times its size{parts}."
        )

    def _why(self, cause: Cause) -> str:
        told = f"{abs(cause.correlation):.2f}"
        if cause.outcome == "place":  # which end of the line is which means nothing
            return f"What matters most for where: {cause.text} (rank correlation {told})."
        way, sign = ("larger", "") if cause.correlation > 0 else ("smaller", "−")
        return (
            f"What matters most: {cause.text}; the {way}, the more often it {VERBS[self.event]} "
            f"(rank correlation {sign}{told})."
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "draws": {fate.name.lower(): self.counts[fate] for fate in Fate if self.counts[fate]},
            "decided": self.decided,
            "event": self.event.name.lower(),
            "share": round(self.share, 6),
            "interval": [round(end, 6) for end in self.interval],
            "place_decided": self.placed,
            "place_radius_px": round(self.radius, 3),
            "size_px": round(self.size, 3),
            "parted_s": None if np.isinf(self.parted) else round(self.parted, 6),
            "rests": self.rests,
            "touches_first": dict(self.touches),
            "clip": self.own.name.lower(),
            "matters_most": None
            if self.cause is None
            else {
                "of": self.cause.outcome,
                "paths": list(self.cause.paths),
                "rank_correlation": round(self.cause.correlation, 4),
            },
            "verdict": " ".join(self.sentences()),
        }


def percent(share: float) -> str:
    """A share in words of a hundred.

    >>> percent(0.4062), percent(1.0), percent(0.997)
    ('41 %', '100 %', '99.7 %')
    """
    shown = 100 * share
    return f"{shown:.1f} %" if 0 < shown < 1 or 99 < shown < 100 else f"{shown:.0f} %"


def verdicts(fan: Fan) -> list[Verdict]:
    """One a body; none where no draw could be simulated."""
    whole = fan.whole
    if not whole:
        return []
    told = [one for one in fan.outcomes if one is not None]
    columns = _columns(fan, whole)
    return [_verdict(fan, b, told, fan.poses[whole, :, b, :2], columns) for b in range(len(fan.names))]


def headline(fan: Fan, found: Sequence[Verdict]) -> str:
    """One sentence of all bodies."""
    if not found:
        return (
            f"None of the {len(fan.outcomes)} draws could be simulated."
            if fan.names
            else "Nothing is there to move."
        )
    count, fates = len(found), sum(v.decided for v in found)
    places = sum(v.decided and v.placed for v in found)
    if count == 1:
        where = ", and where it ends" if places else ", but not where it ends"
        return (
            f"The photo decides what becomes of the one object{where}."
            if fates
            else ("The photo does not decide what becomes of the one object.")
        )
    if fates == places == count:
        return f"The photo decides what becomes of all {count} objects, and where they end."
    if not fates:
        return f"The photo decides of none of {count} objects what becomes of it."
    every = f"all {count}" if fates == count else f"{fates} of {count}"
    where = "not where any ends" if not places else f"where {places} of them end{'s' * (places == 1)}"
    if places == fates:
        where = "where it ends" if fates == 1 else "where they end"
    return f"The photo decides what becomes of {every} objects, {'and ' if places else 'but '}{where}."


def _verdict(
    fan: Fan, b: int, told: list[Outcome], ways: Array, columns: list[tuple[Array, Cause]]
) -> Verdict:
    fates = np.array([one.fates[b] for one in told])
    counts = {fate: int((fates == fate).sum()) for fate in Fate}
    event = max(fate for fate in Fate if counts[fate])
    last, size = ways[:, -1], float(fan.sizes[b])
    spread = [2 * radius(ways[:, k]) for k in range(ways.shape[1])]
    apart = [float(t) for t, px in zip(fan.times.tolist(), spread, strict=True) if px > size]
    far = radius(last)
    cause = None
    if counts[event] < len(told):
        cause = _cause((fates == event).astype(np.float64), columns)
    if cause is None and far > PART * size:
        cause = _cause(along(last), columns)
        cause = cause and replace(cause, outcome="place")
    firsts = [int(one.first[b]) for one in told]
    touches = {("nothing" if k < 0 else fan.surfaces[k]): firsts.count(k) for k in sorted(set(firsts))}
    return Verdict(
        name=fan.names[b],
        counts=counts,
        event=event,
        interval=wilson(counts[event], len(told)),
        radius=far,
        size=size,
        parted=min(apart, default=float("inf")),
        rests=sum(bool(np.isfinite(one.rests[b])) for one in told),
        touches=dict(sorted(touches.items(), key=lambda item: -item[1])),
        cause=cause,
        own=Fate(int(fan.own.fates[b])),
    )


def _columns(fan: Fan, whole: list[int]) -> list[tuple[Array, Cause]]:
    """What was drawn, columns in one order told as one: numbers of things alike rise together."""
    groups: dict[bytes, list[int]] = {}
    for p in range(len(fan.doubts)):
        groups.setdefault(np.argsort(fan.values[whole, p], kind="stable").tobytes(), []).append(p)
    found = []
    for members in groups.values():
        doubts = [fan.doubts[p] for p in members]
        first = doubts[0]
        text = f"{first.parameter} of {first.thing}"
        if len(doubts) > 1:
            text = f"{first.parameter} of all {len(doubts)} called “{first.label or first.thing}”"
        cause = Cause(tuple(doubt.path for doubt in doubts), text, 0.0)
        found.append((np.asarray(fan.values[whole, members[0]]), cause))
    return found


def _cause(outcomes: Array, columns: list[tuple[Array, Cause]]) -> Cause | None:
    """The number that goes with outcomes (N,) best, where that is no chance."""
    each = [(correlation(values, outcomes), cause) for values, cause in columns]
    best = max(each, key=lambda one: abs(one[0]), default=None)
    if best is None or abs(best[0]) < telling(len(outcomes), len(columns)):
        return None
    return Cause(best[1].paths, best[1].text, best[0])
