"""Contacts of surfaces that run, that stick harder than they slide, and that let others pass in one direction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Passage, Surface, World

Array = NDArray[np.float64]
Index = NDArray[np.int64]

STICKS = 1.0
"""Of the speed that gravity gives in a step: what touches anew and slides more slowly is held by static friction."""
STEADY = 8
"""Steps over which normal impulses are averaged: the engine's vary when a contact settles."""
LOOSE = 3
"""Steps in a row after which a contact that is loose slides."""
SATURATED = 1 - 1e-3
"""Of the greatest friction: a contact with more, and that slides ever faster, is loose."""
LEAST = 1e-3
"""px/s of the same without gravity."""

Key = tuple[int, int]


class SpecialSurfaces:
    """What the engine asks about contacts of some bodies and walls, in each step before it solves them."""

    def __init__(self, world: World, owners: dict[int, int]) -> None:
        """owners: id of an engine's body -> number of a body or wall."""
        parts: Sequence[Any] = (*world.bodies, *world.walls)
        self._surfaces: list[Surface] = [part.surface for part in parts]
        self._passages: list[Passage] = [part.passage for part in parts]
        self._owners = owners
        gravity = max(float(np.hypot(*world.gravity)), world.press)
        self._slow = max(STICKS * gravity / world.steps_per_second, LEAST)
        self._slides: dict[Any, bool] = {}
        """Shapes that touch -> whether they slid against each other in the last step."""
        self._slips: dict[Any, float] = {}
        """Shapes that touch -> px/s at which they slid before this step."""
        self._loose: dict[Any, int] = {}
        """Shapes that touch -> steps in a row in which they were loose."""
        self._normals: dict[Any, float] = {}
        """Shapes that touch -> mean of their normal impulses in the last steps, g·px/s."""
        self.passing: dict[Key, int] = {}
        """Owners that pass through each other now, and the shapes of theirs that do."""

    @staticmethod
    def owners_of(world: World) -> list[int]:
        """Return the bodies and walls whose contacts are asked about."""
        parts: Sequence[Any] = (*world.bodies, *world.walls)
        return [
            number
            for number, part in enumerate(parts)
            if part.surface.conveyor
            or part.surface.static_friction is not None
            or part.passage.one_way is not None
        ]

    def begin(self, arbiter: Any, space: Any, data: Any) -> None:
        """Let another pass if it comes from the side from which it may."""
        first, second = self._pair(arbiter)
        key = min(first, second), max(first, second)
        is_passing = key in self.passing
        for owner, sign in ((first, 1.0), (second, -1.0)):
            way = self._passages[owner].one_way
            if way is not None and not is_passing:
                nx, ny = arbiter.normal
                is_passing = sign * (nx * way[0] + ny * way[1]) <= 0
        if is_passing:
            self.passing[key] = self.passing.get(key, 0) + 1
            arbiter.process_collision = False

    def separate(self, arbiter: Any, space: Any, data: Any) -> None:
        """Forget two shapes that no longer touch."""
        if any(shape.body is None for shape in arbiter.shapes):
            return  # the space is being freed
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
        """Set the friction of a contact, and the speed at which its surfaces run."""
        first, second = self._pair(arbiter)
        one, other = self._surfaces[first], self._surfaces[second]
        nx, ny = arbiter.normal
        belt = one.conveyor + other.conveyor
        if belt:
            arbiter.surface_velocity = ny * belt, -nx * belt
        if one.static_friction is None and other.static_friction is None:
            return
        shapes = arbiter.shapes
        self._slips[shapes] = self._slip(arbiter, belt)
        if shapes not in self._slides:
            self._slides[shapes] = self._slips[shapes] >= self._slow
        if not self._slides[shapes]:
            arbiter.friction = _static(one) * _static(other)

    def note(self, arbiter: Any, space: Any, data: Any) -> None:
        """Note whether a contact slid: its friction was all that there can be."""
        if arbiter.shapes not in self._slides:
            return
        jx, jy = arbiter.total_impulse
        nx, ny = arbiter.normal
        normal, side = abs(jx * nx + jy * ny), abs(jx * ny - jy * nx)
        mean = self._normals.get(arbiter.shapes, normal)
        self._normals[arbiter.shapes] = mean + (normal - mean) / STEADY
        if normal > 0:
            most = arbiter.friction * max(normal, mean)
            one, other = self._pair(arbiter)
            belt = self._surfaces[one].conveyor + self._surfaces[other].conveyor
            slip = self._slip(arbiter, belt)
            is_loose = side >= SATURATED * most and slip > self._slips[arbiter.shapes]
            count = self._loose.get(arbiter.shapes, 0) + 1 if is_loose else 0
            self._loose[arbiter.shapes] = count
            is_sliding = self._slides[arbiter.shapes] and is_loose
            is_sliding |= count >= LOOSE or slip >= self._slow
            self._slides[arbiter.shapes] = is_sliding

    @staticmethod
    def _slip(arbiter: Any, belt: float) -> float:
        """Return the px/s at which the first contact point slides."""
        place = arbiter.contact_point_set.points[0].point_a
        nx, ny = arbiter.normal
        speeds = []
        for shape in arbiter.shapes:
            vx, vy = shape.body.velocity_at_world_point(place)
            speeds.append(float(nx * vy - ny * vx))
        return abs(speeds[1] - speeds[0] - belt)

    def _pair(self, arbiter: Any) -> Key:
        first, second = arbiter.shapes
        return self._owners[first.body.id], self._owners[second.body.id]


def _static(surface: Surface) -> float:
    return (
        surface.friction if surface.static_friction is None else surface.static_friction
    )


def belt_velocities(
    conveyors: Array, first: Index, second: Index, normal: Array
) -> tuple[Array, Array]:
    """Return the velocities (K, 2) at which the surfaces of K contacts run, px/s.

    conveyors (N,) px/s of bodies and walls; first, second (K,); normal (K, 2) from the
    first to the second.
    """
    along = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    return conveyors[first, None] * along, -conveyors[second, None] * along


def belt_energies(
    conveyors: Array, first: Index, second: Index, normal: Array, impulse: Array
) -> tuple[Array, Array]:
    """Return what belts add to the loss and to the work of K contacts, g·px²/s².

    impulse (K, 2) g·px/s on the first; the rest as for `belt_velocities`.
    """
    one, other = belt_velocities(conveyors, first, second, normal)
    done = ((other - one) * impulse).sum(axis=1)
    return done, done
