"""Step division for fast bodies, and solver effort from the accuracy of recent steps."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import ceil

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.scene.scene import SPRINGS, Load, Motion

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class StepTuning:
    """Limits of steps, and of the effort of the contact solver."""

    share: float = 0.3
    """Part of its own smallest extent that a body may move in a step: its middle never crosses a line unseen."""
    most_parts_of_fast: int = 4096  # parts of a step
    parts_at_once: int = 10_000
    parts_a_step: int = 100
    """Parts that a run may spend, and more for each step: a corner that reaches far out would take hours otherwise."""
    fewest: int = 12
    many: int = 60
    most: int = 120
    """Sweeps of the contact solver a step: at least; where shapes overlap, impacts fell or joints hold; at most."""
    work: int = (
        50_000  # sweeps times contacts of a step: heaps of hundreds get fewer sweeps
    )
    slack: float = (
        0.02  # closing speed that a step may leave, in units of gravity x step
    )
    deep: float = 0.02  # px of overlap that is pushed apart with more sweeps
    rest: float = (
        3.0  # speed, in units of gravity x step, below which contacts do not bounce
    )
    still: float = (
        0.01  # px/s below which contacts do not bounce where there is no gravity
    )
    busy: float = 6.0
    """Impacts a step above which ever faster contacts no longer bounce, up to `loudest` x the speed of rest: 94 px/s at
    980 px/s², which is where Box2D always stops bounces (1 m/s, at 100 px/m)."""
    loudest: float = 32.0
    crowd: int = 200
    """Contacts above which a step is first taken with a single sweep, only to see whether impacts fall."""


TUNING = StepTuning()


class StepDivider:
    """Watches the bodies that move far in a step."""

    def __init__(self, world: World, moving: Index) -> None:
        bodies = [world.bodies[k] for k in moving.tolist()]
        self._limit = np.array([TUNING.share * body.size for body in bodies]).reshape(
            -1
        )
        self._reach = np.array([body.reach for body in bodies]).reshape(-1)
        self._turns = np.array(
            [0.0 if body.radius is not None else body.reach for body in bodies], float
        )
        boxes = [
            (*np.minimum(a, b), *np.maximum(a, b))
            for wall in world.walls
            for chain in wall.chains
            for a, b in pairwise(chain)
        ]
        boxes += [
            (*(body.center - body.reach), *(body.center + body.reach))
            for body in world.bodies
            if body.motion is Motion.STATIC
        ]
        self._still = np.array(boxes, np.float64).reshape(-1, 4)
        self._jolt = np.zeros(len(bodies))
        """(M,) px/s that pushes may add in a step."""
        row = {int(body): k for k, body in enumerate(moving.tolist())}
        for push in world.pushes:
            if push.load is Load.FORCE and push.body in row:
                body = world.bodies[push.body]
                force = float(np.hypot(*push.vector)) / world.steps_per_second
                self._jolt[row[push.body]] += force / body.mass * 2
        self.watchful = False
        """Whether something is fast enough to be looked at every step."""
        self._spare = TUNING.parts_at_once
        self.overworked_by: int | None = None
        """The row of the body that asked for more parts than a run may spend."""

    def _ratio(self, state: Array, h: float, more: Array | float = 0.0) -> Array:
        """(M,): movement in h seconds over what is allowed."""
        speed = (
            np.hypot(state[:, 3], state[:, 4])
            + np.abs(state[:, 5]) * self._turns
            + more
        )
        return np.asarray(speed * h / self._limit)

    def look(self, state: Array, ahead: float, gravity: float, h: float) -> None:
        """Start to watch where something may move too far in a step of h seconds within the time `ahead`."""
        self.watchful = bool(
            (self._ratio(state, h, gravity * ahead + self._jolt) > 1).any()
        )

    def parts(self, state: Array, h: float) -> int:
        """Parts of a step of h seconds; 1 where what is fast has nothing in its way."""
        ratio = self._ratio(state, h, self._jolt)
        fast = np.flatnonzero((ratio > 1) & np.isfinite(ratio))
        if not len(fast):
            self.watchful = False
            return 1
        here, there = state[:, :2], state[:, :2] + state[:, 3:5] * h
        reach = self._reach[:, None] + 2.0
        low, high = np.minimum(here, there) - reach, np.maximum(here, there) + reach
        self._spare += TUNING.parts_a_step
        parts = 1
        for k in fast.tolist():
            meets = (low[:, 0] < high[k, 0]) & (high[:, 0] > low[k, 0])
            meets &= (low[:, 1] < high[k, 1]) & (high[:, 1] > low[k, 1])
            meets[k] = False
            still = self._still
            blocked = (still[:, 0] < high[k, 0]) & (still[:, 2] > low[k, 0])
            blocked &= (still[:, 1] < high[k, 1]) & (still[:, 3] > low[k, 1])
            if meets.any() or blocked.any():
                parts = max(parts, min(TUNING.most_parts_of_fast, ceil(ratio[k])))
                if parts > self._spare and self.overworked_by is None:
                    self.overworked_by = k
        parts = min(parts, self._spare)
        self._spare -= parts
        return parts


class Governor:
    """Picks what the engine does a step, from what the last steps left; the same on every run."""

    def __init__(self, world: World) -> None:
        self._gravity = float(np.hypot(*world.gravity))
        self._jointed = any(joint.kind not in SPRINGS for joint in world.joints)
        self._most = TUNING.most
        self.loud = 1.0
        """Factor on the speed of rest."""
        self._blows = self._contacts = 0
        self.sweeps = TUNING.many  # the first steps find all contacts anew
        self.most_sweeps = self.sweeps
        self.loudest = 1.0
        """The highest so far."""

    @property
    def after_impacts(self) -> int:
        """Sweeps of a step that is taken again: its solver starts from impulses that are wrong by now."""
        return min(self._most, max(self.sweeps, TUNING.many))

    @property
    def crowded(self) -> bool:
        """Whether a try with a single sweep pays."""
        return self._contacts > TUNING.crowd

    def threshold(self, h: float, loud: float) -> float:
        """px/s below which a contact does not bounce, in a step of h seconds, by a factor on the speed of rest."""
        return max(TUNING.rest * loud * self._gravity * h, TUNING.still)

    def note(self, impacts: int) -> None:
        """Count the impacts of a step."""
        self._blows += impacts

    def review(
        self, steps: int, contacts: int, residual: float, overlap: float, h: float
    ) -> None:
        """What the last steps left: contacts now, the fastest closing, px/s, the deepest overlap, px."""
        self._contacts = contacts
        limit = TUNING.slack * max(self._gravity * h, TUNING.still)
        self._most = max(
            2 * TUNING.fewest, min(TUNING.most, TUNING.work // max(self._contacts, 1))
        )
        now, least = (
            self.sweeps,
            TUNING.many if overlap > TUNING.deep or self._jointed else TUNING.fewest,
        )
        if residual > limit:
            now += now // 2
        elif residual < limit / 10:
            now -= now // 8
        self.sweeps = min(self._most, max(least, now))
        self.most_sweeps = max(self.most_sweeps, self.sweeps)
        if self._blows > TUNING.busy * steps:
            self.loud = min(TUNING.loudest, self.loud * 2)
        elif self._blows < TUNING.busy * steps / 4:
            self.loud = max(1.0, self.loud / 2)
        self.loudest = max(self.loudest, self.loud)
        self._blows = 0
