"""All pushes of one object -> how its motion answers: along each direction, by direction, and with no push at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import isclose

import numpy as np

from physgen.evaluate.controllability.monotone import EQUAL, Rise, rise
from physgen.evaluate.controllability.outcomes import Array, Outcome, Push, between
from physgen.evaluate.controllability.sweep import Swept

SEEN = 0.5
"""px from which on an answer has a direction."""


@dataclass(frozen=True)
class Along:
    """Pushes of one direction."""

    angle: float
    """degrees: 0 to the right, 90 down."""
    outcomes: tuple[Outcome, ...]
    """By size."""
    rise: Rise | None
    """None: one push alone."""
    met: int
    """Pushes by which it met somebody."""


@dataclass(frozen=True)
class Aim:
    """degrees between pushes and answers."""

    count: int
    """Answers of half a pixel or more; the others have no direction."""
    median: float | None
    worst: float | None


@dataclass(frozen=True)
class Answers:
    """Of one object."""

    along: tuple[Along, ...]
    first: Aim
    """Until it meets anybody."""
    last: Aim
    """At the end."""
    sideways: tuple[int, int]
    """Of the pushes to the left or right, and answers of half a pixel or more: those to the same side, of all."""
    turns: tuple[int, int]
    """From one direction to the next, with the hardest push: steps that turn the answer the same way, of all."""
    still: float | None
    """px that it moves without a push, None where nobody knows."""
    law: tuple[int, float] | None
    """Pushes that meet nobody: how many, and the largest error over the closed form, as a part; None: there is none."""

    @property
    def correlations(self) -> list[float]:
        """Spearman's, of every direction that has one: a push alone has none."""
        rises = [one.rise for one in self.along if one.rise is not None]
        return [one.spearman for one in rises if one.spearman is not None]

    @property
    def correlation(self) -> tuple[float, float] | None:
        """Spearman's over directions: the least and the mean."""
        found = self.correlations
        return (min(found), float(np.mean(found))) if found else None

    @property
    def steps(self) -> tuple[int, int]:
        """From a push to the next harder one of the same direction: how many have a larger answer, of all."""
        rises = [one.rise for one in self.along if one.rise is not None]
        return sum(one.rising for one in rises), sum(one.steps for one in rises)

    @property
    def free(self) -> tuple[int, int]:
        """The same of the pushes by which it meets nobody."""
        rising = steps = 0
        for one in self.along:
            part = [each for each in one.outcomes if not each.met]
            if len({each.push.size for each in part}) > 1:
                found = rise([each.push.size for each in part], [each.length for each in part])
                rising, steps = rising + found.rising, steps + found.steps
        return rising, steps


def answers(swept: Swept) -> Answers:
    """What all pushes say together."""
    along = []
    for angle in sorted({_whole(one) for one in swept.outcomes}):
        part = sorted((o for o in swept.outcomes if _whole(o) == angle), key=lambda o: o.push.size)
        sizes = [one.push.size for one in part]
        found = rise(sizes, [one.length for one in part]) if len(set(sizes)) > 1 else None
        along.append(Along(float(angle), tuple(part), found, sum(one.met for one in part)))
    return Answers(
        tuple(along),
        _aim([(one.push, one.at_first) for one in swept.outcomes]),
        _aim([(one.push, one.response) for one in swept.outcomes]),
        _sideways(swept.outcomes),
        _turns(along),
        None if swept.still is None else float(np.hypot(*(swept.still.places[-1] - swept.still.places[0]))),
        _law(swept),
    )


def _whole(one: Outcome) -> int:
    """The direction, to a degree."""
    return round(one.push.angle) % 360


def _aim(pairs: Sequence[tuple[Push, Array]]) -> Aim:
    off = [between((push.x, push.y), answer) for push, answer in pairs if np.hypot(*answer) >= SEEN]
    return Aim(len(off), float(np.median(off)), max(off)) if off else Aim(0, None, None)


def _sideways(outcomes: Sequence[Outcome]) -> tuple[int, int]:
    """Until it meets anybody: gravity brings down what is pushed up, and leaves this alone."""
    pairs = [
        (one.push.x, float(one.at_first[0]))
        for one in outcomes
        if abs(one.push.x) > 1e-6 * one.push.size and abs(one.at_first[0]) >= SEEN
    ]
    return sum(push * answer > 0 for push, answer in pairs), len(pairs)


def _turns(along: Sequence[Along]) -> tuple[int, int]:
    """Directions stand in order of their angles; the last turns on to the first where they go all round."""
    hardest = [one.outcomes[-1] for one in along if one.outcomes[-1].length >= SEEN]
    pairs = list(pairwise(hardest))
    if len(hardest) > 2:
        pairs.append((hardest[-1], hardest[0]))
    same = count = 0
    for one, other in pairs:
        asked = (other.push.angle - one.push.angle) % 360
        if not 0 < asked < 180:
            continue  # which way round that is, nobody can say
        a, b = one.response, other.response
        count += 1
        same += bool(a[0] * b[1] - a[1] * b[0] > 0)
    return same, count


def _law(swept: Swept) -> tuple[int, float] | None:
    if swept.law is None:
        return None
    errors = []
    for one in swept.outcomes:
        exact = swept.law.way(one.push.size, float(one.path.times[-1]))
        if not one.met and exact > EQUAL:
            errors.append(abs(one.length / exact - 1))
    return (len(errors), max(errors)) if errors else None


def exactly(one: Outcome, swept: Swept) -> float | None:
    """px by the closed form, where it holds."""
    if swept.law is None or one.met:
        return None
    exact = swept.law.way(one.push.size, float(one.path.times[-1]))
    return 0.0 if isclose(exact, 0) else exact
