"""Statistics of an ensemble of simulations, and sentences that summarise objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.simulate.uncertainty import SIZE_SHARE, Ensemble, Fate, Outcome

Array = NDArray[np.float64]

LEVEL = 0.95
"""Of confidence intervals."""
MOST = 0.9
"""Share of the draws that a radius holds."""
VERBS = {Fate.STAYS: "stays", Fate.MOVES: "moves", Fate.LEAVES: "leaves the photo", Fate.FALLS: "falls"}


def wilson(count: int, total: int) -> tuple[float, float]:
    """The 95 % interval of a share of `count` in `total` draws (Wilson, J. Am. Stat. Assoc. 22, 1927).

    >>> [round(end, 3) for end in wilson(13, 32)]
    [0.255, 0.577]
    """
    z = NormalDist().inv_cdf((1 + LEVEL) / 2)
    share, part = count / total, z * z / total
    middle = (share + part / 2) / (1 + part)
    half = z / (1 + part) * sqrt(share * (1 - share) / total + part / (4 * total))
    return max(middle - half, 0.0), min(middle + half, 1.0)


def radius(places: Array) -> float:
    """px about their median within which 9 of 10 places `(N, 2)` lie."""
    off = places - np.median(places, axis=0)
    return float(np.quantile(np.hypot(*off.T), MOST, method="higher")) if len(places) else 0.0


def percent(share: float) -> str:
    """A share as text.

    >>> percent(0.4062), percent(1.0), percent(0.997)
    ('41 %', '100 %', '99.7 %')
    """
    shown = 100 * share
    return f"{shown:.1f} %" if 0 < shown < 1 or 99 < shown < 100 else f"{shown:.0f} %"


@dataclass(frozen=True)
class Verdict:
    """What becomes of one body in all draws."""

    name: str
    counts: Mapping[Fate, int]
    """Of draws that could be simulated."""
    event: Fate
    """The largest fate that occurs."""
    interval: tuple[float, float]
    """0..1: of the share of draws in which the event happens."""
    radius: float
    """px about the median of its final places within which 9 of 10 lie."""
    size: float
    """px; see `uncertainty.size`."""
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
        """Whether every draw has the same fate."""
        return self.counts[self.event] == self.total

    @property
    def placed(self) -> bool:
        """Whether the final place is decided, too, relative to the body's size."""
        return self.radius <= SIZE_SHARE * self.size

    def sentences(self) -> list[str]:
        """What is decided and what is not, without the body's name."""
        low, high = (percent(end) for end in self.interval)
        count, total, verb = self.counts[self.event], self.total, VERBS[self.event]
        interval = f"95 % interval {low} to {high}"
        if self.decided:
            lines = [f"Decided by the photo: {verb} in all {total} draws ({interval})."]
        else:
            others = ", ".join(
                f"{VERBS[fate]} in {self.counts[fate]}"
                for fate in sorted(Fate, reverse=True)
                if fate is not self.event and self.counts[fate]
            )
            lines = [
                f"Not decided: {verb} in {count} of {total} draws ({percent(self.share)}, {interval}), {others}."
            ]
        if self.event is not Fate.STAYS:
            decided = "is" if self.placed else "is not"
            lines.append(f"Where it ends {decided} decided: 9 of 10 draws lie within {self.radius:.3g} px.")
        return lines

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
            "clip": self.own.name.lower(),
            "verdict": " ".join(self.sentences()),
        }


def verdicts(fan: Ensemble) -> list[Verdict]:
    """One per body; none where no draw could be simulated."""
    whole = fan.whole
    outcomes = [outcome for outcome in fan.outcomes if outcome is not None]
    bodies = range(len(fan.names)) if whole else ()
    return [_verdict(fan, b, outcomes) for b in bodies]


def headline(fan: Ensemble, found: Sequence[Verdict]) -> str:
    """One sentence about all bodies."""
    if not found:
        return (
            f"None of the {len(fan.outcomes)} draws could be simulated." if fan.names else "Nothing can move."
        )
    count, fates = len(found), sum(v.decided for v in found)
    places = sum(v.decided and v.placed for v in found)
    objects = f"{count} object{'s' * (count != 1)}"
    return f"The photo decides what becomes of {fates} of {objects}, and where {places} of {count} end."


def _verdict(fan: Ensemble, b: int, outcomes: list[Outcome]) -> Verdict:
    fates = [Fate(int(outcome.fates[b])) for outcome in outcomes]
    counts = {fate: fates.count(fate) for fate in Fate}
    event = max(fates)
    return Verdict(
        name=fan.names[b],
        counts=counts,
        event=event,
        interval=wilson(counts[event], len(outcomes)),
        radius=radius(np.array([outcome.final[b, :2] for outcome in outcomes])),
        size=float(fan.sizes[b]),
        own=Fate(int(fan.own.fates[b])),
    )
