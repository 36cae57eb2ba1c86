"""Smooth curves of boundaries: a body that slides along them keeps its energy.

The velocity of a step is tangential to the curve at the step's start, and points into
the curve at its end. The contact removes the normal part in every step: some percent of
the energy in a loop at 500 px/s. The step also ends a little inside the curve. The
correction of this overlap does work against gravity: a ball in a bowl gained 1 % in 2 s.
"""

from __future__ import annotations

from collections.abc import Iterator
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
"""Steps after which a touch counts as new: a light contact opens for some steps."""
GENTLE = 0.1
"""Share of a body's speed: a body with a higher closing speed has not followed the
curve.
"""
MOST_LIFTED = 0.1
"""Share of a body's kinetic energy: a larger work of a correction is that of a body that
overlapped from the start.
"""


def _closing_speed(state: Array, normal: tuple[float, float], lever: float) -> float:
    """Return the speed of a point of a body along a normal, px/s.

    `state` (6,) as in `Space`; `lever` of the normal about the body's centre, px.
    """
    nx, ny = normal
    return float(state[3] * nx + state[4] * ny + state[5] * lever)


def _gentle_closing(
    old_state: Array, state: Array, normal: tuple[float, float], lever: float
) -> float | None:
    """Return the sum of the closing speeds before and after a step, px/s.

    None if the body has not followed the curve before. `old_state` and `state` (6,) as
    in `Space`.
    """
    closing_before = _closing_speed(old_state, normal, lever)
    speed = hypot(old_state[3], old_state[4])
    if not 0 < closing_before < GENTLE * speed:
        return None
    return closing_before + _closing_speed(state, normal, lever)


def _closing_energy(
    old_state: Array,
    state: Array,
    sign: float,
    contact: list[float],
    impulse: tuple[float, float],
) -> float | None:
    """Return the energy, g·px²/s², that the normal impulse of a contact removes.

    None if the body has not followed the curve before. With `sign` 1, the contact's
    normal points towards the wall.
    """
    nx = sign * contact[2]
    ny = sign * contact[3]
    # The work of the normal impulse: impulse times the mean closing speed of the step.
    normal_impulse = -(impulse[0] * nx + impulse[1] * ny)
    lever = (contact[4] - state[0]) * ny - (contact[5] - state[1]) * nx
    closing_sum = _gentle_closing(old_state, state, (nx, ny), lever)
    if closing_sum is None:
        return None
    return normal_impulse * closing_sum / 2


class CurvedWalls:
    """The walls of a world that are smooth curves, and the bodies that slide along
    them.
    """

    def __init__(self, world: World, moving: Index, held_bodies: list[int]) -> None:
        """Collect the walls; bodies on joints are left out."""
        count = len(world.bodies)
        # Walls follow the bodies in the numbering of surfaces.
        self._walls = {
            count + k for k, wall in enumerate(world.walls) if wall.is_smooth
        }
        rows = {int(body): row for row, body in enumerate(moving)}
        self._rows = {
            body: row
            for body, row in rows.items()
            if world.bodies[body].motion is Motion.DYNAMIC and body not in held_bodies
        }
        self._mass = [body.mass for body in world.bodies]
        scales = np.array([body.gravity_scale for body in world.bodies])
        self._weight = scales[:, None] * np.array(self._mass)[:, None] * world.gravity
        """(N, 2) g·px/s²."""
        self._steps = 0
        self._touched: dict[tuple[int, int], int] = {}
        """The latest step with a touch, by body and wall."""

    @property
    def busy(self) -> bool:
        """Check whether the world has smooth curves."""
        return bool(self._walls)

    def restore(
        self,
        old_state: Array,
        state: Array,
        h: float,
        order: Order,
        numbers: bytes,
        impacts: list[Impacts],
    ) -> tuple[float, float]:
        """Return the energy to bodies that curves took from them in a step of h
        seconds.

        `old_state` (M, 6): states before the step; `state` (M, 6) after it is changed
        in place. Returns this energy, and the work of corrected overlaps against
        gravity, which bodies lose, g·px²/s².
        """
        lost_energies: dict[int, float] = {}
        lift_works: dict[int, float] = {}
        impulses: dict[int, tuple[float, float]] = {}
        impact_impulses = _blows(impacts)
        self._steps += 1
        for body, wall, sign, contact in self._slides(order, numbers):
            row = self._rows[body]
            if not impacts:
                # Beyond its velocity, a body moves only by the correction of overlaps.
                shift = state[row, :2] - old_state[row, :2] - h * old_state[row, 3:5]
                lift_works[body] = -float(self._weight[body] @ shift)
            ix, iy = impact_impulses.pop((body, wall), (0.0, 0.0))
            impulse = ix + sign * contact[0], iy + sign * contact[1]
            total = impulses.get(body, (0.0, 0.0))
            impulses[body] = total[0] + impulse[0], total[1] + impulse[1]
            energy = _closing_energy(old_state[row], state[row], sign, contact, impulse)
            if energy is not None:
                lost_energies[body] = lost_energies.get(body, 0.0) + energy
        return self._scale_speeds(lost_energies, lift_works, impulses, state)

    def _slides(
        self, order: Order, numbers: bytes
    ) -> Iterator[tuple[int, int, float, list[float]]]:
        """Yield body, wall and contact of each body that slides along a curve.

        With each, the sign of the contact's normal: 1 if it points towards the wall.
        """
        contacts = np.frombuffer(numbers).reshape(-1, NUMBERS).tolist()
        rows = zip(order.contacts.tolist(), contacts, strict=True)
        for (first, second, count), contact in rows:
            # The normal of a contact points from the first to the second shape.
            body, wall, sign = first, second, 1.0
            if first in self._walls:
                body, wall, sign = second, first, -1.0
            if wall not in self._walls or body not in self._rows or not count:
                continue
            # A new touch is an impact, and its loss is real.
            if not self._is_new_touch(body, wall):
                yield body, wall, sign, contact

    def _is_new_touch(self, body: int, wall: int) -> bool:
        """Note a touch; return whether it is the first one in a while.

        Only a body that has touched the curve for a while slides along it; a body that
        lands on the curve loses its closing speed as on any wall.
        """
        last_step = self._touched.get((body, wall), -RECENT)
        self._touched[body, wall] = self._steps
        return self._steps - last_step >= RECENT

    def _scale_speeds(
        self,
        lost_energies: dict[int, float],
        lift_works: dict[int, float],
        impulses: dict[int, tuple[float, float]],
        state: Array,
    ) -> tuple[float, float]:
        """Scale speeds in the state (M, 6) by energies of bodies; return both sums.

        `impulses` of the curves: their work is recorded at the mean of the velocities
        before and after the step, which this changes; that part is subtracted.
        """
        total = total_work = 0.0
        for body in {**lost_energies, **lift_works}:
            row = self._rows[body]
            # Scaling the speed changes the energy and keeps the direction along the
            # curve.
            kinetic = self._mass[body] * float(state[row, 3:5] @ state[row, 3:5]) / 2
            if kinetic <= 0:
                continue
            energy = max(lost_energies.get(body, 0.0), 0.0)
            work = lift_works.get(body, 0.0)
            if abs(work) > MOST_LIFTED * kinetic:
                work = 0.0
            if energy == work:
                continue
            # New over old speed: the root of the ratio of kinetic energies.
            change = state[row, 3:5] * (sqrt(1 + (energy - work) / kinetic) - 1)
            state[row, 3:5] += change
            total += energy - float(change @ impulses[body]) / 2
            total_work += work
        return total, total_work


def _blows(impacts: list[Impacts]) -> dict[tuple[int, int], tuple[float, float]]:
    """Return the impulses of impacts, g·px/s, for each pair in both orders, on its
    first body.
    """
    # Action and reaction: in the other order of the pair, the impulse has the opposite
    # sign.
    impulses: dict[tuple[int, int], tuple[float, float]] = {}
    for impact in impacts:
        rows = zip(impact.first, impact.second, impact.impulse, strict=True)
        for first, second, (x, y) in rows:
            for key, sign in (
                ((int(first), int(second)), 1),
                ((int(second), int(first)), -1),
            ):
                earlier = impulses.get(key, (0.0, 0.0))
                impulses[key] = (
                    earlier[0] + sign * float(x),
                    earlier[1] + sign * float(y),
                )
    return impulses
