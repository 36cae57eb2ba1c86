"""How accurate the last steps were -> how much work the next ones do: sweeps of the solver, and what still bounces."""

from __future__ import annotations

import numpy as np

from physgen.compile.world import World
from physgen.scene.model import JointKind

FEWEST, MANY, MOST = 12, 60, 120
"""Sweeps of the contact solver a step: at least; where shapes overlap, blows fell or joints hold; at most."""
WORK = 50_000
"""Sweeps times contacts of a step: heaps of hundreds get fewer sweeps, as nobody sees the last hundredth of a pixel."""
SLACK = 0.02
"""Closing speed that a step may leave, in units of gravity x step."""
DEEP = 0.02
"""px of overlap that is pushed apart with more sweeps."""
REST = 3.0
"""Speed, in units of gravity x step, below which contacts do not bounce."""
STILL = 0.01
"""px/s below which contacts do not bounce where there is no gravity."""
BUSY = 6.0
"""Blows a step above which ever faster contacts no longer bounce, up to `LOUDEST` x the speed of rest: 94 px/s under
980 px/s², which is where Box2D always stops bounces (1 m/s, at 100 px/m)."""
LOUDEST = 32.0
CROWD = 200
"""Contacts above which a step is first taken with a single sweep, only to see whether blows fall."""


class Governor:
    """Picks what the engine does a step, from what the last steps left; the same on every run."""

    def __init__(self, world: World, iterations: int | None) -> None:
        self._fixed = iterations
        self._gravity = float(np.hypot(*world.gravity))
        self._jointed = any(joint.kind is not JointKind.SPRING for joint in world.joints)
        self._most = MOST
        self._loud = 1.0
        self._blows = self._contacts = 0
        self.sweeps = iterations or MANY  # the first steps find all contacts anew
        self.most_sweeps = self.sweeps
        self.loudest = 1.0
        """Highest factor on the speed of rest so far."""

    @property
    def after_blows(self) -> int:
        """Sweeps of a step that is taken again: its solver starts from impulses that are wrong by now."""
        return self._fixed or min(self._most, max(self.sweeps, MANY))

    @property
    def crowded(self) -> bool:
        """Whether a try with a single sweep pays."""
        return self._contacts > CROWD

    def threshold(self, h: float) -> float:
        """px/s below which a contact does not bounce, in a step of h seconds."""
        return max(REST * self._loud * self._gravity * h, STILL)

    def stillest(self, h: float) -> float:
        """px/s: the highest threshold so far, for steps of h seconds."""
        return max(REST * self.loudest * self._gravity * h, STILL)

    def note(self, blows: int) -> None:
        """Count the blows of a step."""
        self._blows += blows

    def review(self, steps: int, contacts: int, residual: float, overlap: float, h: float) -> None:
        """What the last steps left: contacts now, the fastest closing, px/s, the deepest overlap, px."""
        self._contacts = contacts
        limit = SLACK * max(self._gravity * h, STILL)
        self._most = max(2 * FEWEST, min(MOST, WORK // max(self._contacts, 1)))
        now, least = self.sweeps, MANY if overlap > DEEP or self._jointed else FEWEST
        if residual > limit:
            now += now // 2
        elif residual < limit / 10:
            now -= now // 8
        self.sweeps = self._fixed or min(self._most, max(least, now))
        self.most_sweeps = max(self.most_sweeps, self.sweeps)
        if self._blows > BUSY * steps:
            self._loud = min(LOUDEST, self._loud * 2)
        elif self._blows < BUSY * steps / 4:
            self._loud = max(1.0, self._loud / 2)
        self.loudest = max(self.loudest, self._loud)
        self._blows = 0
