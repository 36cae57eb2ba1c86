"""Sudden turns -> blows: of one thing against something that has no track, or of two that met."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physgen.evaluate.plausibility.motion import Motion, Turn
from physgen.evaluate.plausibility.stretches import Stretch
from physgen.evaluate.plausibility.tracks import Array

SAME = 1.5
"""Frames within which turns of two things are one blow."""
MISSED = 0.1
"""Of what the change of velocity makes in a frame: by so much ways may miss each other."""
SURE = 4.0
"""Standard deviations."""


@dataclass(frozen=True, eq=False)
class Part:
    """One thing's share in a blow."""

    thing: int
    before: Stretch
    after: Stretch
    time: float

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
        """(2,) px/s; exactly nothing where one stretch goes on."""
        return self.leaves - self.arrives

    @property
    def error(self) -> float:
        """px/s, of the change along any direction."""
        if self.before is self.after:
            return self.before.velocity_error(self.time)
        return float(np.hypot(self.before.velocity_error(self.time), self.after.velocity_error(self.time)))

    def single(self, step: float) -> bool:
        """Whether one blow explains it: the ways before and after meet at its time, or there were two at once."""
        if self.before is self.after:
            return True
        missed = float(np.hypot(*(self.after.place(self.time) - self.before.place(self.time))))
        error = float(np.hypot(self.before.place_error(self.time), self.after.place_error(self.time)))
        return missed <= SURE * error + MISSED * float(np.hypot(*self.change)) * step

    @property
    def place(self) -> Array:
        """(2,) px."""
        return (self.before.place(self.time) + self.after.place(self.time)) / 2


@dataclass(frozen=True, eq=False)
class Blow:
    """Of one thing alone, or of two and nobody else."""

    frame: int
    time: float
    parts: tuple[Part, ...]

    @property
    def things(self) -> tuple[int, ...]:
        """Indices."""
        return tuple(part.thing for part in self.parts)


def blows(motion: Motion) -> list[Blow]:
    """All that concern one or two things that are free, told and not in a crowd; each once."""
    found: list[Blow] = []
    for turns in motion.turns:
        for turn in turns:
            blow = _blow(motion, turn) if turn.sudden and _askable(motion, turn) else None
            if blow is None or _known(found, blow, motion.tracks.step):
                continue
            if all(part.single(motion.tracks.step) for part in blow.parts):
                found.append(blow)
    return found


def _askable(motion: Motion, turn: Turn) -> bool:
    step = motion.tracks.step
    return motion.free(turn.thing) and not motion.was_pushed(turn.thing, turn.time - step, turn.time + step)


def _blow(motion: Motion, turn: Turn) -> Blow | None:
    first, last = turn.before.last, turn.after.first
    mine = Part(turn.thing, turn.before, turn.after, turn.time)
    near = motion.near(turn.thing, first, last)
    if not near:
        return Blow(turn.frame, turn.time, (mine,))
    if len(near) > 1 or not motion.free(near[0]):
        return None
    if set(motion.near(near[0], first, last)) - {turn.thing}:
        return None
    other = _partner(motion, near[0], turn)
    return None if other is None else Blow(turn.frame, turn.time, (mine, other))


def _partner(motion: Motion, thing: int, turn: Turn) -> Part | None:
    """What it did then; None where that cannot be told."""
    for other in motion.turns[thing]:
        if abs(other.time - turn.time) <= SAME * motion.tracks.step:
            return Part(thing, other.before, other.after, turn.time)
    for stretch in motion.stretches[thing]:
        if stretch.good and stretch.first <= turn.before.last and turn.after.first <= stretch.last:
            return Part(thing, stretch, stretch, turn.time)
    return None


def _known(found: list[Blow], blow: Blow, step: float) -> bool:
    return any(
        set(blow.things) == set(one.things) and len(one.things) == 2 and abs(one.time - blow.time) <= SAME * step
        for one in found
    )
