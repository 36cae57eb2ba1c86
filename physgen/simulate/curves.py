"""Smooth curves of boundaries: what slides along them keeps its energy.

A step's velocity points along the tangent where the step began, and so into the curve where
it ends. The contact takes that part, again and again: of a loop at 500 px/s some percent.
The step also ends a little inside the curve. What pushes the body out does work against
gravity, which a body that follows the curve does not get: a ball in a bowl gained 1 % in 2 s.
"""

from __future__ import annotations

from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.scene.scene import Motion
from physgen.simulate.collisions import Impacts
from physgen.simulate.contacts import NUMBERS, Order

Array = NDArray[np.float64]
Index = NDArray[np.int64]

RECENT = 8
"""Steps after which a touch is a new one: a light contact opens for some."""
GENTLE = 0.1
"""Of a body's speed: what closes faster has not followed the curve."""
MOST_LIFTED = 0.1
"""Of a body's kinetic energy: what is pushed out farther overlapped from the start."""


class CurvedWalls:
    """The walls of a world that are smooth curves, and the bodies that slid along them."""

    def __init__(self, world: World, moving: Index, held: list[int]) -> None:
        """held: bodies that joints hold, which are left as they are."""
        count = len(world.bodies)
        self._walls = {
            count + k for k, wall in enumerate(world.walls) if wall.is_smooth
        }
        rows = {int(body): row for row, body in enumerate(moving)}
        self._rows = {
            body: row
            for body, row in rows.items()
            if world.bodies[body].motion is Motion.DYNAMIC and body not in held
        }
        self._mass = [body.mass for body in world.bodies]
        scales = np.array([body.gravity_scale for body in world.bodies])
        self._weight = scales[:, None] * np.array(self._mass)[:, None] * world.gravity
        """(N, 2) g·px/s²."""
        self._steps = 0
        self._touched: dict[tuple[int, int], int] = {}
        """Bodies and walls that touched -> the step in which they last did."""

    @property
    def busy(self) -> bool:
        """Whether there are any."""
        return bool(self._walls)

    def restore(
        self,
        begun: Array,
        state: Array,
        h: float,
        order: Order,
        numbers: bytes,
        impacts: list[Impacts],
    ) -> tuple[float, float]:
        """Give bodies the energy back that curves took from them in a step of h seconds.

        begun (M, 6): states before the step; state (M, 6) after it, which is changed.
        Return that energy, and the work against gravity by which curves pushed bodies
        out and which bodies lose in return, g·px²/s².
        """
        taken: dict[int, float] = {}
        lifted: dict[int, float] = {}
        pushes: dict[int, tuple[float, float]] = {}
        blows = _blows(impacts)
        self._steps += 1
        contacts = np.frombuffer(numbers).reshape(-1, NUMBERS).tolist()
        for (first, second, count), contact in zip(
            order.listed.tolist(), contacts, strict=True
        ):
            body, wall, sign = first, second, 1.0
            if first in self._walls:
                body, wall, sign = second, first, -1.0
            if wall not in self._walls or body not in self._rows or not count:
                continue
            last = self._touched.get((body, wall), -RECENT)
            self._touched[body, wall] = self._steps
            if self._steps - last >= RECENT:
                continue
            row = self._rows[body]
            if not impacts:
                shift = state[row, :2] - begun[row, :2] - h * begun[row, 3:5]
                lifted[body] = -float(self._weight[body] @ shift)
            # the normal towards the wall
            nx, ny = sign * contact[2], sign * contact[3]
            ix, iy = blows.pop((body, wall), (0.0, 0.0))
            ix, iy = ix + sign * contact[0], iy + sign * contact[1]
            sum_x, sum_y = pushes.get(body, (0.0, 0.0))
            pushes[body] = sum_x + ix, sum_y + iy
            push = -(ix * nx + iy * ny)
            px, py = contact[4], contact[5]
            arm = (px - state[row, 0]) * ny - (py - state[row, 1]) * nx
            closing, left = (
                float(speed[0] * nx + speed[1] * ny + speed[2] * arm)
                for speed in (begun[row, 3:], state[row, 3:])
            )
            speed = hypot(begun[row, 3], begun[row, 4])
            if 0 < closing < GENTLE * speed:
                taken[body] = taken.get(body, 0.0) + push * (closing + left) / 2
        return self._give(taken, lifted, pushes, state)

    def _give(
        self,
        taken: dict[int, float],
        lifted: dict[int, float],
        pushes: dict[int, tuple[float, float]],
        state: Array,
    ) -> tuple[float, float]:
        """Change speeds in the state (M, 6) by energies of bodies; return both sums.

        pushes: impulses by the curves. Their work is recorded at the mean of the
        velocities before and after, with what is given here: that part is taken off.
        """
        given = worked = 0.0
        for body in {**taken, **lifted}:
            row = self._rows[body]
            kinetic = self._mass[body] * float(state[row, 3:5] @ state[row, 3:5]) / 2
            if kinetic <= 0:
                continue
            back, work = max(taken.get(body, 0.0), 0.0), lifted.get(body, 0.0)
            if abs(work) > MOST_LIFTED * kinetic:
                work = 0.0
            if back == work:
                continue
            change = state[row, 3:5] * (sqrt(1 + (back - work) / kinetic) - 1)
            state[row, 3:5] += change
            given += back - float(change @ pushes[body]) / 2
            worked += work
        return given, worked


def _blows(impacts: list[Impacts]) -> dict[tuple[int, int], tuple[float, float]]:
    """Return the impulses of impacts, g·px/s: of each pair in both orders, on the first of it."""
    found: dict[tuple[int, int], tuple[float, float]] = {}
    for impact in impacts:
        rows = zip(impact.first, impact.second, impact.impulse, strict=True)
        for first, second, (x, y) in rows:
            for key, sign in (
                ((int(first), int(second)), 1),
                ((int(second), int(first)), -1),
            ):
                before = found.get(key, (0.0, 0.0))
                found[key] = before[0] + sign * float(x), before[1] + sign * float(y)
    return found
