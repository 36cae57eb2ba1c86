"""Contacts of conveyors, of surfaces with static friction, and of one-way passages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Passage, Surface, World

Array = NDArray[np.float64]
Index = NDArray[np.int64]

STICKS = 1.0
"""Share of the speed that gravity gives in a step, below which a new contact is held by
static friction.
"""
STEADY = 8
"""Steps over which normal impulses are averaged: those of the engine vary while a
contact settles.
"""
LOOSE = 3
"""Consecutive steps after which a loose contact slides."""
SATURATED = 1 - 1e-3
"""Share of the maximum friction above which a contact with growing speed is loose."""
LEAST = 1e-3
"""Speed below which a contact is held without gravity, px/s."""

Key = tuple[int, int]


class SpecialSurfaces:
    """Callbacks for contacts of some bodies and walls, before and after each
    solution.
    """

    def __init__(self, world: World, owners: dict[int, int]) -> None:
        """Collect the surfaces; `owners`: numbers of bodies and walls by engine id."""
        parts: Sequence[Any] = (*world.bodies, *world.walls)
        self._surfaces: list[Surface] = [part.surface for part in parts]
        self._passages: list[Passage] = [part.passage for part in parts]
        self._owners = owners
        gravity = max(float(np.hypot(*world.gravity)), world.press)
        self._slow = max(STICKS * gravity / world.steps_per_second, LEAST)
        self._slides: dict[Any, bool] = {}
        """Whether two touching shapes slid against each other in the last step."""
        self._slips: dict[Any, float] = {}
        """Sliding speed of two touching shapes before this step, px/s."""
        self._loose: dict[Any, int] = {}
        """Consecutive steps in which two touching shapes were loose."""
        self._normals: dict[Any, float] = {}
        """Mean of the recent normal impulses of two touching shapes, g·px/s."""
        self.passing: dict[Key, int] = {}
        """Owners now passing through each other, with the number of their shapes."""

    @staticmethod
    def owners_of(world: World) -> list[int]:
        """List the bodies and walls with special contacts."""
        parts: Sequence[Any] = (*world.bodies, *world.walls)
        return [
            number
            for number, part in enumerate(parts)
            if part.surface.conveyor
            or part.surface.static_friction is not None
            or part.passage.one_way is not None
        ]

    def begin(self, arbiter: Any, space: Any, data: Any) -> None:
        """Let a partner pass if it comes from the permitted side."""
        first, second = self._pair(arbiter)
        key = min(first, second), max(first, second)
        is_passing = key in self.passing
        for owner, sign in ((first, 1.0), (second, -1.0)):
            direction = self._passages[owner].one_way
            if direction is not None and not is_passing:
                nx, ny = arbiter.normal
                is_passing = sign * (nx * direction[0] + ny * direction[1]) <= 0
        if is_passing:
            self.passing[key] = self.passing.get(key, 0) + 1
            arbiter.process_collision = False

    def separate(self, arbiter: Any, space: Any, data: Any) -> None:
        """Remove the records of two shapes that no longer touch."""
        if any(shape.body is None for shape in arbiter.shapes):
            return  # pymunk calls this while it frees the space, too
        first, second = self._pair(arbiter)
        key = min(first, second), max(first, second)
        self._slides.pop(arbiter.shapes, None)
        self._normals.pop(arbiter.shapes, None)
        self._slips.pop(arbiter.shapes, None)
        self._loose.pop(arbiter.shapes, None)
        if key in self.passing:
            self.passing[key] -= 1
            if self.passing[key] <= 0:
                del self.passing[key]

    def solve(self, arbiter: Any, space: Any, data: Any) -> None:
        """Set the friction of a contact, and the speed of its moving surfaces."""
        first, second = self._pair(arbiter)
        first_surface = self._surfaces[first]
        second_surface = self._surfaces[second]
        nx, ny = arbiter.normal
        belt = first_surface.conveyor + second_surface.conveyor
        if belt:
            arbiter.surface_velocity = ny * belt, -nx * belt
        if (
            first_surface.static_friction is None
            and second_surface.static_friction is None
        ):
            return
        shapes = arbiter.shapes
        self._slips[shapes] = self._slip(arbiter, belt)
        # A new contact slides if its slip is fast; a known one keeps the state that
        # `note` recorded.
        if shapes not in self._slides:
            self._slides[shapes] = self._slips[shapes] >= self._slow
        if not self._slides[shapes]:
            arbiter.friction = _static(first_surface) * _static(second_surface)

    def note(self, arbiter: Any, space: Any, data: Any) -> None:
        """Record whether a contact slid, with friction at its maximum."""
        if arbiter.shapes not in self._slides:
            return
        # Split the impulse into its normal part and the friction along the surface,
        # whose signs do not matter.
        jx, jy = arbiter.total_impulse
        nx, ny = arbiter.normal
        normal_impulse = abs(jx * nx + jy * ny)
        side_impulse = abs(jx * ny - jy * nx)
        # Normal impulses of stacks fluctuate from step to step. Their exponential mean
        # prevents a contact from seeming to slide in each weak step.
        mean = self._normals.get(arbiter.shapes, normal_impulse)
        self._normals[arbiter.shapes] = mean + (normal_impulse - mean) / STEADY
        if normal_impulse > 0:
            maximum_friction = arbiter.friction * max(normal_impulse, mean)
            first_owner, second_owner = self._pair(arbiter)
            belt = (
                self._surfaces[first_owner].conveyor
                + self._surfaces[second_owner].conveyor
            )
            slip = self._slip(arbiter, belt)
            # At the maximum friction a contact may still be held; it slides if it also
            # accelerates for some steps.
            is_loose = (
                side_impulse >= SATURATED * maximum_friction
                and slip > self._slips[arbiter.shapes]
            )
            count = 0
            if is_loose:
                count = self._loose.get(arbiter.shapes, 0) + 1
            self._loose[arbiter.shapes] = count
            is_sliding = self._slides[arbiter.shapes] and is_loose
            is_sliding |= count >= LOOSE or slip >= self._slow
            self._slides[arbiter.shapes] = is_sliding

    @staticmethod
    def _slip(arbiter: Any, belt: float) -> float:
        """Return the sliding speed of the first contact point, px/s."""
        place = arbiter.contact_point_set.points[0].point_a
        nx, ny = arbiter.normal
        speeds = []
        for shape in arbiter.shapes:
            vx, vy = shape.body.velocity_at_world_point(place)
            speeds.append(float(nx * vy - ny * vx))
        return abs(speeds[1] - speeds[0] - belt)

    def _pair(self, arbiter: Any) -> Key:
        """Return the numbers of the two owners of a contact."""
        first, second = arbiter.shapes
        return self._owners[first.body.id], self._owners[second.body.id]


def _static(surface: Surface) -> float:
    """Return the static friction of a surface; by default its sliding friction."""
    if surface.static_friction is None:
        return surface.friction
    return surface.static_friction


def belt_velocities(
    conveyors: Array, first: Index, second: Index, normal: Array
) -> tuple[Array, Array]:
    """Return the velocities (K, 2) of both moving surfaces of K contacts, px/s.

    `conveyors` (N,) px/s of bodies and walls; `first`, `second` (K,); `normal` (K, 2)
    from the first to the second.
    """
    tangents = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    return conveyors[first, None] * tangents, -conveyors[second, None] * tangents


def belt_energies(
    conveyors: Array, first: Index, second: Index, normal: Array, impulse: Array
) -> tuple[Array, Array]:
    """Return the additional loss and work of K contacts by belts, g·px²/s².

    `impulse` (K, 2) g·px/s on the first; other parameters as in `belt_velocities`.
    """
    first_velocity, second_velocity = belt_velocities(conveyors, first, second, normal)
    works = ((second_velocity - first_velocity) * impulse).sum(axis=1)
    return works, works
