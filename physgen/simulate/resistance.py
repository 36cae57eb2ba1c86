"""Rolling resistance seen from the side: a moment of c x normal force x radius against turning where two touch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.scene.model import Motion
from physgen.simulate.chipmunk import Chipmunk, Touching

Array = NDArray[np.float64]


class Resistance:
    """Brakes between round bodies and what they roll on; solved with the contacts, so that they hold at rest."""

    def __init__(self, world: World) -> None:
        self._lever = np.array(
            [
                b.rolling * b.radius if b.radius is not None and b.motion is Motion.DYNAMIC else 0.0
                for b in world.bodies
            ]
            + [0.0] * len(world.walls)
        )
        self._bodies = len(world.bodies)
        self._static = [b.motion is Motion.STATIC for b in world.bodies] + [True] * len(world.walls)
        self.busy = bool(self._lever.any()) and world.press == 0
        self._force: dict[tuple[int, int], float] = {}

    def press(self, space: Chipmunk) -> None:
        """Set the brakes by the normal forces of the last step."""
        for (first, second), torque in self._force.items():
            space.brake(first, None if second < 0 else second, torque)

    def settle(self, space: Chipmunk, touch: Touching, mean: Array, h: float) -> float:
        """Energy that the brakes took in a step of mean velocities (N, 3), g·px²/s²; note its normal forces."""
        lost = 0.0
        for (first, second), impulse in space.braked().items():
            against = mean[second, 2] if second >= 0 else 0.0
            lost += impulse * abs(float(mean[first, 2] - against))
        self._force = dict.fromkeys(self._force, 0.0)
        normal = np.abs((touch.impulse * touch.normal).sum(axis=1))
        order = np.lexsort((normal, touch.second, touch.first))
        for k in order.tolist():
            a, b = int(touch.first[k]), int(touch.second[k])
            lever = self._lever[a] + self._lever[b]
            if lever > 0:
                if self._lever[a] == 0:
                    a, b = b, a
                if self._lever[a] > 0 and b < self._bodies and self._lever[b] > 0:
                    a, b = min(a, b), max(a, b)
                key = (a, -1 if self._static[b] else b)
                self._force[key] = self._force.get(key, 0.0) + lever * float(normal[k]) / h
        return lost
