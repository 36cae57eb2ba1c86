"""Sudden changes of velocity -> impacts of one object, or of two that met."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from physgen.evaluate.plausibility.motion import Motion, Segment, VelocityChange
from physgen.evaluate.plausibility.tracks import Array

SAME = 1.0
"""Frames within which turns of two bodies are one blow."""
LATE = 2.5
"""Frames within which they may have been one, where they are not known well."""
MISSED = 0.12
"""Of what the change of velocity makes in a frame: by so much ways may miss each other."""
SIDEWAYS = 0.45
"""A blow's part along the line of centres, at least: friction of 2 turns it by no more."""
RESTING = 0.3
"""Of the speed after a blow: what came slower was probably hit, and the caller was near."""
CLOSE = 2.0
"""px: a third body so near has a part in it."""
SURE = 3.0
"""Standard deviations."""


@dataclass(frozen=True, eq=False)
class Part:
    """One body's share in a blow."""

    body: int
    before: Segment
    after: Segment
    time: float
    shown: bool = True
    """Whether it turned at all, as far as one can tell."""

    @property
    def arrives(self) -> Array:
        """(2,) px/s."""
        return self.before.velocity(self.time)

    @property
    def leaves(self) -> Array:
        """(2,) px/s."""
        return self.after.velocity(self.time)

    @property
    def change(self) -> Array:
        """(2,) px/s; exactly nothing where one stretch goes on and cannot be parted."""
        return self.leaves - self.arrives

    @property
    def error(self) -> float:
        """px/s, of the change along any direction."""
        if self.before is self.after:
            return self.before.velocity_error(self.time)
        return float(np.hypot(self.before.velocity_error(self.time), self.after.velocity_error(self.time)))

    @property
    def missed(self) -> float:
        """px by which the ways before and after miss each other at its time, beyond what noise explains."""
        if self.before is self.after:
            return 0.0
        error = float(np.hypot(self.before.place_error(self.time), self.after.place_error(self.time)))
        return float(np.hypot(*(self.after.place(self.time) - self.before.place(self.time)))) - SURE * error

    @property
    def place(self) -> Array:
        """(2,) px."""
        return (self.before.place(self.time) + self.after.place(self.time)) / 2


@dataclass(frozen=True, eq=False)
class Impact:
    """Of one body alone, or of two and no one else."""

    frame: int
    time: float
    parts: tuple[Part, ...]

    @property
    def bodies(self) -> tuple[int, ...]:
        """Indices."""
        return tuple(part.body for part in self.parts)

    def single(self, step: float) -> bool:
        """Whether one blow explains it: ways meet at its time; where two come in one frame, they do not."""
        change = max(float(np.hypot(*part.change)) for part in self.parts)
        return all(part.missed <= MISSED * change * step for part in self.parts if part.shown)


def impacts(motion: Motion) -> list[Impact]:
    """All that concern one or two bodies that are free, measured and not in a crowd; each once."""
    found: list[Impact] = []
    for turns in motion.turns:
        for turn in turns:
            blow = _blow(motion, turn) if turn.sudden and _askable(motion, turn) else None
            if blow is None or _known(found, blow, motion.tracks.step):
                continue
            if blow.single(motion.tracks.step):
                found.append(blow)
    return found


def _askable(motion: Motion, turn: VelocityChange) -> bool:
    step = motion.tracks.step
    return motion.free(turn.body) and not motion.was_pushed(turn.body, turn.time - step, turn.time + step)


def _blow(motion: Motion, turn: VelocityChange) -> Impact | None:
    first, last = turn.before.last, turn.after.first
    mine = Part(turn.body, turn.before, turn.after, turn.time)
    others = []
    for body in motion.near(turn.body, first, last):
        other = _partner(motion, body, turn)
        if other is None:
            return None
        met = _met(motion, mine, other)
        if met is None or (met is False and _turns(motion, body, turn.time, LATE)):
            return None
        if met:
            others.append(other)
    if not others:
        return Impact(turn.frame, turn.time, (mine,))
    if len(others) > 1 or not motion.free(others[0].body):
        return None
    return _together(motion, mine, others[0])


def _turns(motion: Motion, body: int, time: float, frames: float) -> bool:
    """Whether it turns suddenly within some frames of a moment."""
    return any(
        turn.sudden and abs(turn.time - time) <= frames * motion.tracks.step for turn in motion.turns[body]
    )


def _partner(motion: Motion, body: int, turn: VelocityChange) -> Part | None:
    """What it did then; None where that is unknown."""
    for other in motion.turns[body]:
        if abs(other.time - turn.time) <= SAME * motion.tracks.step:
            return Part(body, other.before, other.after, turn.time)
    for stretch in motion.stretches[body]:
        if stretch.good and stretch.first <= turn.before.last and turn.after.first <= stretch.last:
            parted = motion.parted(body, stretch, turn.time)
            return Part(body, *(parted or (stretch, stretch)), turn.time, shown=False)
    return None


def _met(motion: Motion, one: Part, other: Part) -> bool | None:
    """Whether they touched at the blow; None where no one can tell.

    They did where they are that near, and, of round bodies, pushed along the line of their centres.
    """
    a, b = motion.tracks.forms[one.body], motion.tracks.forms[other.body]
    close = (
        1.0
        + 3 * float(np.hypot(motion.sigma[one.body], motion.sigma[other.body]))
        + 0.05 * (a.reach + b.reach)
    )
    apart = one.place - other.place
    size = float(np.hypot(*apart))
    gap = size - a.reach - b.reach
    if gap > close:
        slack = (
            SURE * max(part.before.place_error(part.time) for part in (one, other))
            + MISSED / 2 * float(np.hypot(*one.change) + np.hypot(*other.change)) * motion.tracks.step
        )
        sure = other.after.first - other.before.last <= 1 and np.hypot(*one.arrives) > RESTING * np.hypot(
            *one.leaves
        )
        return False if sure and gap > close + slack else None
    if a.round and b.round and size > 0:
        along = abs(float(one.change @ apart)) / size
        return True if along > SIDEWAYS * float(np.hypot(*one.change)) - 2 * one.error else None
    return True


def _together(motion: Motion, one: Part, other: Part) -> Impact | None:
    """At the time that suits both best; None where a third was at the second."""
    both = {one.body, other.body}
    for body in motion.near(other.body, one.before.last, one.after.first):
        if body in both:
            continue
        gap = motion.clearance.least(other.body, body)[one.before.last : one.after.first + 1]
        if _turns(motion, body, one.time, LATE) or np.nanmin(gap, initial=np.inf) < CLOSE:
            return None
    step = motion.tracks.step
    ticks = one.time + np.linspace(-step / 2, step / 2, 41)
    missed = [
        sum(float(np.sum((p.after.place(t) - p.before.place(t)) ** 2)) for p in (one, other)) for t in ticks
    ]
    time = float(ticks[int(np.argmin(missed))])
    return Impact(one.before.last, time, (replace(one, time=time), replace(other, time=time)))


def _known(found: list[Impact], blow: Impact, step: float) -> bool:
    return any(
        set(blow.bodies) == set(one.bodies)
        and len(one.bodies) == 2
        and abs(one.time - blow.time) <= SAME * step
        for one in found
    )
