"""Belts and turntables of a table seen from above: how fast the table moves under each body."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Field, World
from physgen.scene.scene import FieldKind

Array = NDArray[np.float64]


class MovingTable:
    """The parts of a world's table that move; the middle of a body decides on which it is."""

    def __init__(self, world: World) -> None:
        kinds = (FieldKind.BELT, FieldKind.TURNTABLE)
        self._parts = [field for field in world.fields if field.kind in kinds]
        self.busy = bool(self._parts) and world.press > 0

    def velocities(self, places: Array) -> Array:
        """Return the table's velocity and spin (N, 3) at places (N, 2) px: px/s, px/s, rad/s."""
        found = np.zeros((len(places), 3))
        for part in self._parts:
            on = np.array(part.bodies, np.int64)
            if part.kind is FieldKind.BELT:
                carried = on[_is_on_belt(part, places[on])]
                found[carried] = 0.0
                if part.velocity is not None:
                    found[carried, :2] = part.velocity
                continue
            away = places[on] - part.vector
            is_carried = (away**2).sum(axis=1) <= part.extent[0] ** 2
            carried, (x, y) = on[is_carried], away[is_carried].T
            spin = np.full(len(x), part.spin)
            found[carried] = np.stack([-spin * y, spin * x, spin], axis=1)
        return found


def _is_on_belt(belt: Field, places: Array) -> NDArray[np.bool_]:
    """Return which of the places (K, 2) px are on a belt."""
    inside = (places >= belt.vector) & (places <= belt.vector + belt.extent)
    return np.asarray(inside.all(axis=1))
