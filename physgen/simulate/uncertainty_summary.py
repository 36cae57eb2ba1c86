"""Statistics of an ensemble of simulations, and sentences that summarise objects and shadows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.geometry.shadows import LEAST_LIGHT_HEIGHT
from physgen.scene.scene import Scene, View
from physgen.simulate.uncertainty import SIZE_SHARE, Ensemble, Fate, Outcome

Array = NDArray[np.float64]

LEVEL = 0.95
"""Of confidence intervals, and of the test of correlations."""
MOST = 0.9
"""Share of the draws that a radius holds."""
VERBS = {Fate.STAYS: "stays", Fate.MOVES: "moves", Fate.LEAVES: "leaves the photo", Fate.FALLS: "falls"}
MIN_SIDE_REACH = 0.1
"""px sideways per px of height, up to which a shadow falls to neither side."""


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


def ranks(values: Array) -> Array:
    """(N,) ranks from 0, the mean rank for equal values.

    >>> ranks(np.array([3.0, 1.0, 3.0])).tolist()
    [1.5, 0.0, 1.5]
    """
    _, back, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts) - 1
    return np.asarray((last - (counts - 1) / 2)[back.ravel()], np.float64)


def correlation(first: Array, second: Array) -> float:
    """Spearman's rank correlation of two columns (N,); 0 where one of them is constant."""
    a, b = (rank - rank.mean() for rank in (ranks(first), ranks(second)))
    scale = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / scale if scale > 0 else 0.0


def chance_level(draws: int, columns: int) -> float:
    """The rank correlation from which on the best of `columns` is significant."""
    if draws < 4 or not columns:
        return 1.0
    return min(NormalDist().inv_cdf(1 - (1 - LEVEL) / 2 / columns) / sqrt(draws - 1), 1.0)


def radius(places: Array) -> float:
    """px about their median within which 9 of 10 places `(N, 2)` lie."""
    off = places - np.median(places, axis=0)
    return float(np.quantile(np.hypot(*off.T), MOST, method="higher")) if len(places) else 0.0


def along(places: Array) -> Array:
    """(N,) px: coordinates of the places `(N, 2)` along the line on which they differ most."""
    off = places - places.mean(axis=0)
    direction = np.linalg.svd(off, full_matrices=False)[2][0]
    return np.asarray(off @ (direction if direction[np.argmax(np.abs(direction))] > 0 else -direction))


def percent(share: float) -> str:
    """A share as text.

    >>> percent(0.4062), percent(1.0), percent(0.997)
    ('41 %', '100 %', '99.7 %')
    """
    shown = 100 * share
    return f"{shown:.1f} %" if 0 < shown < 1 or 99 < shown < 100 else f"{shown:.0f} %"


@dataclass(frozen=True)
class Cause:
    """An uncertain value that correlates with an outcome."""

    paths: tuple[str, ...]
    """Its key; several where they are drawn alike."""
    text: str
    """Its name for people."""
    correlation: float
    """Spearman's, with the outcome."""
    outcome: str = "fate"
    """`fate`: that the event happens; `place`: where it ends, along the line on which ends differ most."""


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
    parted: float
    """s from which 9 of 10 draws need a circle larger than its size; infinite: never."""
    rests: int
    """Draws in which it rests at the end."""
    touches: Mapping[str, int]
    """What it touches first, and in how many draws; `nothing` for no contact."""
    cause: Cause | None
    """Of what is not decided: of its fate before its place."""
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
        if self.decided:
            lines = [f"Decided by the photo: {verb} in all {total} draws (95 % interval {low} to {high})."]
        else:
            others = [
                f"{VERBS[fate]} in {self.counts[fate]}"
                for fate in sorted(Fate, reverse=True)
                if fate is not self.event and self.counts[fate]
            ]
            lines = [
                f"Not decided: {verb} in {count} of {total} draws "
                f"({percent(self.share)}, 95 % interval {low} to {high}), {', '.join(others)}."
            ]
        if self.event is not Fate.STAYS and not (self.placed and not self.decided):
            lines.append(self._place())
        if self.cause is not None:
            size, text = f"{abs(self.cause.correlation):.2f}", self.cause.text
            if self.cause.outcome == "place":  # the direction of the line has no meaning
                lines.append(f"What matters most for where: {text} (rank correlation {size}).")
            else:
                change, sign = ("larger", "") if self.cause.correlation > 0 else ("smaller", "−")
                lines.append(
                    f"What matters most: {text}; the {change}, the more often it {verb} "
                    f"(rank correlation {sign}{size})."
                )
        return lines

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

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        cause = None
        if self.cause is not None:
            cause = {
                "of": self.cause.outcome,
                "paths": list(self.cause.paths),
                "rank_correlation": round(self.cause.correlation, 4),
            }
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
            "matters_most": cause,
            "verdict": " ".join(self.sentences()),
        }


def verdicts(fan: Ensemble) -> list[Verdict]:
    """One per body; none where no draw could be simulated."""
    whole = fan.whole
    outcomes = [outcome for outcome in fan.outcomes if outcome is not None]
    columns = _columns(fan, whole)
    bodies = range(len(fan.names)) if whole else ()
    return [_verdict(fan, b, outcomes, fan.poses[whole, :, b, :2], columns) for b in bodies]


def headline(fan: Ensemble, found: Sequence[Verdict]) -> str:
    """One sentence about all bodies."""
    if not found:
        if not fan.names:
            return "Nothing is there to move."
        return f"None of the {len(fan.outcomes)} draws could be simulated."
    count, fates = len(found), sum(v.decided for v in found)
    places = sum(v.decided and v.placed for v in found)
    if count == 1:
        if not fates:
            return "The photo does not decide what becomes of the one object."
        where = "and where it ends" if places else "but not where it ends"
        return f"The photo decides what becomes of the one object, {where}."
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
    fan: Ensemble, b: int, outcomes: list[Outcome], paths: Array, columns: list[tuple[Array, Cause]]
) -> Verdict:
    fates = np.array([outcome.fates[b] for outcome in outcomes])
    counts = {fate: int((fates == fate).sum()) for fate in Fate}
    event = max(fate for fate in Fate if counts[fate])
    last, size = paths[:, -1], float(fan.sizes[b])
    widths = [2 * radius(paths[:, k]) for k in range(paths.shape[1])]
    apart = [float(t) for t, px in zip(fan.times.tolist(), widths, strict=True) if px > size]
    far = radius(last)
    cause = None
    if counts[event] < len(outcomes):
        cause = _best_cause((fates == event).astype(np.float64), columns)
    if cause is None and far > SIZE_SHARE * size:
        cause = _best_cause(along(last), columns)
        cause = cause and replace(cause, outcome="place")
    firsts = [int(outcome.first[b]) for outcome in outcomes]
    touches = {("nothing" if k < 0 else fan.surfaces[k]): firsts.count(k) for k in sorted(set(firsts))}
    return Verdict(
        name=fan.names[b],
        counts=counts,
        event=event,
        interval=wilson(counts[event], len(outcomes)),
        radius=far,
        size=size,
        parted=min(apart, default=float("inf")),
        rests=sum(bool(np.isfinite(outcome.rests[b])) for outcome in outcomes),
        touches=dict(sorted(touches.items(), key=lambda item: -item[1])),
        cause=cause,
        own=Fate(int(fan.own.fates[b])),
    )


def _columns(fan: Ensemble, whole: list[int]) -> list[tuple[Array, Cause]]:
    """The drawn values; values that rise together, as those of similar objects do, are one column."""
    groups: dict[bytes, list[int]] = {}
    for p in range(len(fan.doubts)):
        groups.setdefault(np.argsort(fan.values[whole, p], kind="stable").tobytes(), []).append(p)
    found = []
    for members in groups.values():
        values = [fan.doubts[p] for p in members]
        first = values[0]
        text = f"{first.parameter} of {first.name}"
        if len(values) > 1:
            text = f"{first.parameter} of all {len(values)} called “{first.label or first.name}”"
        cause = Cause(tuple(value.path for value in values), text, 0.0)
        found.append((np.asarray(fan.values[whole, members[0]]), cause))
    return found


def _best_cause(outcomes: Array, columns: list[tuple[Array, Cause]]) -> Cause | None:
    """The value that correlates best with outcomes (N,), if that is significant."""
    found = [replace(cause, correlation=correlation(values, outcomes)) for values, cause in columns]
    best = max(found, key=lambda cause: abs(cause.correlation), default=None)
    if best is None or abs(best.correlation) < chance_level(len(outcomes), len(columns)):
        return None
    return best


@dataclass(frozen=True)
class ShadowSpread:
    """How shadows and shading vary over N draws of the light."""

    source: str
    """Who found the light, and the confidence."""
    apart: float
    """degrees from the file's direction within which 9 of 10 draws lie."""
    own: Array
    """(2,) px in the photo by which the shadow of an object 1 px high reaches, for the file's light."""
    drawn: Array
    """(N, 2): the same of each draw."""
    sides: tuple[tuple[str, int], ...]
    """Where shadows fall, and in how many draws; the most frequent first."""
    own_light: Array
    """(3,) the file's direction."""
    lights: Array
    """(N, 3)."""

    def sentences(self) -> list[str]:
        """What the photo decides."""
        total = len(self.drawn)
        side, count = self.sides[0]
        lines = [
            f"Light ({self.source}): 9 of 10 draws come from within {self.apart:.0f}° of the file's direction. "
            "It moves nothing, but shadows and shading turn with it."
        ]
        if count == total:
            lines.append(f"Decided by the photo: shadows fall {side} in all {total} draws.")
        else:
            low, high = (percent(end) for end in wilson(count, total))
            others = ", ".join(f"{other} in {n}" for other, n in self.sides[1:])
            lines.append(
                f"Not decided: shadows fall {side} in {count} of {total} draws ({percent(count / total)}, "
                f"95 % interval {low} to {high}), {others}."
            )
        lengths = 100 * np.hypot(*self.drawn.T)
        shortest, longest = np.quantile(lengths, [(1 - MOST) / 2, (1 + MOST) / 2])
        lines.append(
            f"An object 100 px high casts one of {shortest:.0f} to {longest:.0f} px in 9 of 10 draws; "
            f"the file's light one of {100 * float(np.hypot(*self.own)):.0f} px."
        )
        return lines

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "from": self.source,
            "within_degrees": round(self.apart, 2),
            "shadows": dict(self.sides),
            "verdict": " ".join(self.sentences()),
        }


def shadow_spread(scene: Scene, fan: Ensemble) -> ShadowSpread | None:
    """None where the light is certain, or there is none."""
    if fan.light is None or scene.light is None:
        return None
    drawn = _reach(fan.directions, scene)
    sides = [_side(reach, scene.world.view) for reach in drawn]
    counts = {side: sides.count(side) for side in dict.fromkeys(sides)}
    source = fan.light.source
    return ShadowSpread(
        source=f"{source.text}, {percent(source.sure or 0.0)} sure",
        apart=float(np.degrees(fan.light.cone.angle(MOST))),
        own=_reach(np.array([scene.light.direction]), scene)[0],
        drawn=drawn,
        sides=tuple(sorted(counts.items(), key=lambda item: -item[1])),
        own_light=np.array(scene.light.direction),
        lights=fan.directions,
    )


def _reach(lights: Array, scene: Scene) -> Array:
    """(N, 2) px of the photo by which a shadow on the floor or table reaches per px of height.

    As in `geometry.shadows`: light lower than `LEAST_LIGHT_HEIGHT` casts no longer ones.
    """
    x, y, z = lights.T
    if scene.world.view is View.TOP:
        rise = np.maximum(z, LEAST_LIGHT_HEIGHT)
        return np.stack([-x / rise, -y / rise], axis=1)
    rise = np.maximum(-y, LEAST_LIGHT_HEIGHT)
    depth_scale = float(np.tan(np.radians(scene.world.tilt)))
    """px of the photo per px of the floor's depth."""
    return np.stack([-x / rise, -z / rise * depth_scale], axis=1)


def _side(reach: Array, view: View) -> str:
    """Where a shadow falls; on a table seen from above, the nearest of four directions."""
    across, away = reach.tolist()
    if view is View.TOP and abs(away) > abs(across):
        across, sides = away, ("up", "down")
    else:
        sides = ("to the left", "to the right")
    return "to neither side" if abs(across) <= MIN_SIDE_REACH else sides[across > 0]
