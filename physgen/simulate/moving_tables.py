"""Belts and turntables of a table seen from above: the velocity of the table under a
body.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Field, World
from physgen.scene.scene import FieldKind

Array = NDArray[np.float64]


class MovingTable:
    """The moving parts of a world's table; the centre of a body decides on which part
    it is.
    """

    def __init__(self, world: World) -> None:
        kinds = (FieldKind.BELT, FieldKind.TURNTABLE)
        self._parts = [field for field in world.fields if field.kind in kinds]
        self.busy = bool(self._parts) and world.press > 0

    def velocities(self, places: Array) -> Array:
        """Return the table's velocity (N, 3) px/s, px/s, rad/s at places (N, 2) px."""
        velocities = np.zeros((len(places), 3))
        for part in self._parts:
            bodies = np.array(part.bodies, np.int64)
            if part.kind is FieldKind.BELT:
                carried_bodies = bodies[_is_on_belt(part, places[bodies])]
                velocities[carried_bodies] = 0.0
                if part.velocity is not None:
                    velocities[carried_bodies, :2] = part.velocity
                continue
            offsets = places[bodies] - part.vector
            # A turntable carries bodies within its radius; their speed is spin x
            # distance.
            is_carried = (offsets**2).sum(axis=1) <= part.extent[0] ** 2
            carried_bodies, (x, y) = bodies[is_carried], offsets[is_carried].T
            spin = np.full(len(x), part.spin)
            velocities[carried_bodies] = np.stack([-spin * y, spin * x, spin], axis=1)
        return velocities


def _is_on_belt(belt: Field, places: Array) -> NDArray[np.bool_]:
    """Return the mask of the places (K, 2) px on a belt."""
    is_inside = (places >= belt.vector) & (places <= belt.vector + belt.extent)
    return np.asarray(is_inside.all(axis=1))
