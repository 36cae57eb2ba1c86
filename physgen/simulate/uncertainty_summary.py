"""Statistics of an ensemble of simulations, and sentences that summarise objects and shadows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot, sqrt
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.geometry.shadows import LEAST_LIGHT_HEIGHT
from physgen.scene.scene import Scene, View
from physgen.simulate.uncertain_values import widest
from physgen.simulate.uncertainty import PART, Ensemble, Fate, Outcome

# ----------------------------------------------------------------------
# Counts and columns of draws -> shares with their intervals, rank correlations, spreads of places.

Array = NDArray[np.float64]

SURE = 0.95
"""Of intervals, and that a correlation is no chance."""
MOST = 0.9
"""Part of all draws that a spread holds."""


def wilson(count: int, total: int) -> tuple[float, float]:
    """The 95 % interval of a share of which `count` of `total` draws are known (Wilson, J. Am. Stat. Assoc. 22, 1927).

    >>> [round(end, 3) for end in wilson(13, 32)]
    [0.255, 0.577]
    """
    z = NormalDist().inv_cdf((1 + SURE) / 2)
    share, part = count / total, z * z / total
    middle = (share + part / 2) / (1 + part)
    half = z / (1 + part) * sqrt(share * (1 - share) / total + part / (4 * total))
    return max(middle - half, 0.0), min(middle + half, 1.0)


def interval_of_mean(first: tuple[int, int], second: tuple[int, int]) -> tuple[float, float]:
    """The 95 % interval of the mean of two independent shares (count, total), by Wilson's of each (Newcombe 1998).

    >>> [round(end, 3) for end in mean_of_two((69, 72), (349, 366))]
    [0.917, 0.972]
    """
    shares = [count / total for count, total in (first, second)]
    (low, high), (lower, higher) = wilson(*first), wilson(*second)
    middle = sum(shares) / 2
    below, above = hypot(shares[0] - low, shares[1] - lower), hypot(high - shares[0], higher - shares[1])
    return middle - below / 2, middle + above / 2


def ranks(values: Array) -> Array:
    """(N,) places in rising order, the mean place where some are equal.

    >>> ranks(np.array([3.0, 1.0, 3.0])).tolist()
    [1.5, 0.0, 1.5]
    """
    _, back, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts) - 1
    return np.asarray((last - (counts - 1) / 2)[back.ravel()], np.float64)


def correlation(first: Array, second: Array) -> float:
    """Spearman's rank correlation of two columns (N,); 0 where one of them is all the same."""
    a, b = (rank - rank.mean() for rank in (ranks(first), ranks(second)))
    scale = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / scale if scale > 0 else 0.0


def chance_level(draws: int, columns: int) -> float:
    """Size of a rank correlation from which it is no chance, that of the best of `columns` being looked at."""
    if draws < 4 or not columns:
        return 1.0
    return min(NormalDist().inv_cdf(1 - (1 - SURE) / 2 / columns) / sqrt(draws - 1), 1.0)


def radius(places: Array) -> float:
    """px about their middle within which 9 of 10 places `(N, 2)` lie."""
    off = places - np.median(places, axis=0)
    return float(np.quantile(np.hypot(*off.T), MOST, method="higher")) if len(places) else 0.0


def along(places: Array) -> Array:
    """(N,) px: how far each of the places `(N, 2)` lies along the line on which they differ most."""
    off = places - places.mean(axis=0)
    way = np.linalg.svd(off, full_matrices=False)[2][0]
    return np.asarray(off @ (way if way[np.argmax(np.abs(way))] > 0 else -way))


# ----------------------------------------------------------------------
# Fan -> for each body what the photo decides of it, what it does not, and which number that hangs on; in
# sentences.

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


def verdicts(fan: Ensemble) -> list[Verdict]:
    """One a body; none where no draw could be simulated."""
    whole = fan.whole
    if not whole:
        return []
    told = [one for one in fan.outcomes if one is not None]
    columns = _columns(fan, whole)
    return [_verdict(fan, b, told, fan.poses[whole, :, b, :2], columns) for b in range(len(fan.names))]


def headline(fan: Ensemble, found: Sequence[Verdict]) -> str:
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
    fan: Ensemble, b: int, told: list[Outcome], ways: Array, columns: list[tuple[Array, Cause]]
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


def _columns(fan: Ensemble, whole: list[int]) -> list[tuple[Array, Cause]]:
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
    if best is None or abs(best[0]) < chance_level(len(outcomes), len(columns)):
        return None
    return Cause(best[1].paths, best[1].text, best[0])


# ----------------------------------------------------------------------
# Draws of the light's direction -> where shadows fall in them, and how far shading turns; in sentences.

STRAIGHT = 0.1
"""px sideways for a px of height, up to which a shadow falls to neither side."""


@dataclass(frozen=True)
class ShadowSpread:
    """What N draws of the light do to shadows and shading."""

    said: str
    """Who found the light, and how sure."""
    apart: float
    """degrees from the file's direction within which 9 of 10 draws lie."""
    own: Array
    """(2,) px in the photo by which the shadow of a thing 1 px high reaches, as the file has it."""
    drawn: Array
    """(N, 2): the same of each draw."""
    sides: tuple[tuple[str, int], ...]
    """Whither shadows fall, and in how many draws; the most frequent first."""
    own_light: Array
    """(3,) the file's direction."""
    lights: Array
    """(N, 3)."""

    def sentences(self) -> list[str]:
        """What of it the photo decides."""
        total = len(self.drawn)
        side, count = self.sides[0]
        low, high = (percent(end) for end in wilson(count, total))
        lines = [
            f"Light ({self.said}): 9 of 10 draws come from within {self.apart:.0f}° of the file's direction. "
            "It moves nothing, but shadows and shading turn with it."
        ]
        if count == total:
            lines.append(f"Decided by the photo: shadows fall {side} in all {total} draws.")
        else:
            others = ", ".join(f"{other} in {n}" for other, n in self.sides[1:])
            lines.append(
                f"Not decided: shadows fall {side} in {count} of {total} draws ({percent(count / total)}, "
                f"95 % interval {low} to {high}), {others}."
            )
        long = np.hypot(*self.drawn.T)
        low_long, high_long = np.quantile(long, [(1 - MOST) / 2, (1 + MOST) / 2])
        lines.append(
            f"A thing 100 px high throws one of {100 * low_long:.0f} to {100 * high_long:.0f} px in 9 of 10 draws; "
            f"the file's light one of {100 * float(np.hypot(*self.own)):.0f} px."
        )
        return lines

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "from": self.said,
            "within_degrees": round(self.apart, 2),
            "shadows": dict(self.sides),
            "verdict": " ".join(self.sentences()),
        }


def shadow_spread(scene: Scene, fan: Ensemble) -> ShadowSpread | None:
    """None where the light is certain, or there is none."""
    if fan.light is None or scene.light is None:
        return None
    own = _reach(np.array([scene.light.direction]), scene)[0]
    drawn = _reach(fan.directions, scene)
    sides = [_side(reach, scene.world.view) for reach in drawn]
    counts = {side: sides.count(side) for side in dict.fromkeys(sides)}
    told = fan.light.source
    return ShadowSpread(
        said=f"{told.text}, {percent(told.sure or 0.0)} sure",
        apart=float(np.degrees(widest(fan.light.cone.concentration, MOST))),
        own=own,
        drawn=drawn,
        sides=tuple(sorted(counts.items(), key=lambda item: -item[1])),
        own_light=np.array(scene.light.direction),
        lights=fan.directions,
    )


def _reach(lights: Array, scene: Scene) -> Array:
    """(N, 2) px of the photo by which a shadow reaches for each px of height: on the floor, or on the table.

    As `shadow.cast` has it: light that is lower than `LOWEST` throws no longer ones.
    """
    x, y, z = lights.T
    if scene.world.view is View.TOP:
        rise = np.maximum(z, LEAST_LIGHT_HEIGHT)
        return np.stack([-x / rise, -y / rise], axis=1)
    rise = np.maximum(-y, LEAST_LIGHT_HEIGHT)
    return np.stack([-x / rise, -z / rise * _tilt(scene)], axis=1)


def _tilt(scene: Scene) -> float:
    """px of the photo for a px of the floor's depth."""
    return float(np.tan(np.radians(scene.world.tilt)))


def _side(reach: Array, view: View) -> str:
    """Whither a shadow falls: of a table seen from above, the nearest of four ways."""
    across, along = reach.tolist()
    if view is View.TOP and abs(along) > abs(across):
        across, sides = along, ("up", "down")
    else:
        sides = ("to the left", "to the right")
    return "to neither side" if abs(across) <= STRAIGHT else sides[across > 0]
