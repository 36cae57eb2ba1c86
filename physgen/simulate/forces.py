"""Forces, impulses, springs, fields and scripted motion of a world."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, Field, Joint, Push, World
from physgen.geometry.polygon import Array, polygon_moments, rotation
from physgen.scene.scene import (
    SPRINGS,
    FieldKind,
    JointKind,
    Load,
    Motion,
    Profile,
    ProfileKind,
)
from physgen.simulate.friction import Resistance, Table
from physgen.simulate.moving_tables import MovingTable
from physgen.simulate.ramps import Ramps, has_ramp

Flags = NDArray[np.bool_]

STEPS_AHEAD = 32
"""Steps of table friction that are computed at once for bodies without contacts."""


def spring_joints(world: World) -> list[Joint]:
    """Return the springs among the joints of a world."""
    return [joint for joint in world.joints if joint.kind in SPRINGS]


def spring_compliance(world: World, spring: Joint) -> float:
    """Return the inverse of the effective mass at a spring's ends, 1/g."""
    compliance = 0.0
    for index, at in (
        (spring.first, spring.first_at),
        (spring.second, spring.second_at),
    ):
        if index is not None and world.bodies[index].motion is Motion.DYNAMIC:
            body = world.bodies[index]
            compliance += 1 / body.mass + float(at @ at) / body.moment
    return compliance


def stiffest_spring(world: World) -> tuple[float, str]:
    """Return the fastest oscillation by springs, rad/s, and the stiffest spring.

    The frequency is that of the body with the largest stiffness of all its springs
    together.
    """
    stiffness_sums: dict[int, float] = {}
    largest_stiffness = 0.0
    name = ""
    for spring in spring_joints(world):
        # A spring off the centre of mass also turns its body, which yields more: the
        # compliance of that point makes it act stiffer.
        stiffness = spring.stiffness * spring_compliance(world, spring)
        if stiffness > largest_stiffness:
            largest_stiffness = stiffness
            name = spring.name
        for index in (spring.first, spring.second):
            if index is not None and world.bodies[index].motion is Motion.DYNAMIC:
                stiffness_sums[index] = stiffness_sums.get(index, 0.0) + stiffness
    return max(stiffness_sums.values(), default=0.0) ** 0.5, name


@dataclass(frozen=True)
class EnergyEvent:
    """A change of energy at one time, g·px²/s²."""

    time: float  # s
    loss: float
    work: float


class Impulses:
    """The future impulses of a world."""

    def __init__(self, world: World) -> None:
        dynamic = [body.motion is Motion.DYNAMIC for body in world.bodies]
        self._bodies = world.bodies
        self._queue = sorted(
            (p for p in world.pushes if p.load is Load.IMPULSE and dynamic[p.body]),
            key=lambda p: p.start,
        )

    def has_due(self, end: float) -> bool:
        """Check whether an impulse is given before `end`, s."""
        return bool(self._queue) and self._queue[0].start < end - 1e-12

    def time_until_next(self, begin: float) -> float:
        """Return the time from `begin` to the next impulse, s."""
        return max(0.0, self._queue[0].start - begin)

    def give(self, velocity: Array, pose: Array, since: float) -> EnergyEvent:
        """Apply the next impulse to the velocities (N, 3).

        `since`: time, s, since the bodies had the pose (N, 3).
        """
        push = self._queue.pop(0)
        body = self._bodies[push.body]
        old_velocity = velocity[push.body]
        arm = _rotate(push.point, pose[push.body, 2] + old_velocity[2] * since)
        change = np.array(
            [*push.vector, arm[0] * push.vector[1] - arm[1] * push.vector[0]]
        )
        change /= [body.mass, body.mass, body.moment]
        # The work of an impulse: impulse times the mean of the velocities before and
        # after.
        work = body.mass * (change[:2] @ (old_velocity[:2] + change[:2] / 2))
        work += body.moment * change[2] * (old_velocity[2] + change[2] / 2)
        velocity[push.body] += change
        return EnergyEvent(push.start, 0.0, float(work))


@dataclass(frozen=True)
class LoadSum:
    """Loads on the N bodies, each (N, 3): g·px/s², g·px/s², g·px²/s²."""

    hold: Array  # loads with a potential: springs, attractors
    drive: Array  # loads with work: pushes, wind
    spend: Array  # loads that dissipate energy: dampers


def _inverse(values: Array, is_dynamic: Flags) -> Array:
    """Return the inverse masses or moments (N,); 0 for bodies that are not dynamic."""
    return np.divide(1.0, values, out=np.zeros(len(values)), where=is_dynamic)


def _lasting_pushes(world: World, is_dynamic: Flags) -> list[Push]:
    """Return the forces and torques on dynamic bodies."""
    pushes = []
    for push in world.pushes:
        if push.load is not Load.IMPULSE and is_dynamic[push.body]:
            pushes.append(push)
    return pushes


def _extra_weights(world: World, is_dynamic: Flags) -> Array:
    """Return the weight beyond that by the world's gravity, (N, 2) g·px/s²."""
    scale = np.array([body.gravity_scale for body in world.bodies])
    mass = np.array([body.mass for body in world.bodies])
    extra_weight = np.where(is_dynamic, (scale - 1) * mass, 0.0)
    return np.asarray(extra_weight[:, None] * world.gravity)


def _fields_of(world: World, *kinds: FieldKind) -> list[Field]:
    """Return the fields of some kinds, in the order of the world."""
    return [field for field in world.fields if field.kind in kinds]


def _count_dampers(springs: Sequence[Joint]) -> dict[int, int]:
    """Return the number of damped springs at each body with a spring."""
    counts: dict[int, int] = {}
    for spring in springs:
        for body in (spring.first, spring.second):
            if body is not None:
                counts[body] = counts.get(body, 0) + (spring.damping > 0)
    return counts


class ForceFields:
    """All lasting forces of a world."""

    def __init__(self, world: World) -> None:
        bodies = world.bodies
        self._N = len(bodies)
        is_dynamic = np.array([b.motion is Motion.DYNAMIC for b in bodies], bool)
        self._mass = np.array([b.mass for b in bodies])
        self._moment = np.array([b.moment for b in bodies])
        self._gravity = world.gravity
        self._lightness = _inverse(self._mass, is_dynamic)
        self._ease = _inverse(self._moment, is_dynamic)
        self._pushes = _lasting_pushes(world, is_dynamic)
        springs = spring_joints(world)
        # Fingers follow a path and do work; springs store energy. Both are joints in
        # the scene but loads in the engine.
        self._fingers = [s for s in springs if s.kind is JointKind.FINGER]
        self._springs = [s for s in springs if s.kind is JointKind.SPRING]
        self._winds = _fields_of(world, FieldKind.WIND, FieldKind.AIR)
        self._pools = [Pool(f, bodies) for f in _fields_of(world, FieldKind.WATER)]
        self._magnets = _fields_of(world, FieldKind.MAGNET)
        self._attractors = _fields_of(world, FieldKind.ATTRACTOR)
        # Drag grows with the width across the flow. The diameter of a disc of the same
        # area does not depend on the orientation of the body.
        self._width = np.zeros(0)
        if self._winds or self._pools:
            self._width = np.array([2 * np.sqrt(area(body) / pi) for body in bodies])
        self._broken: list[tuple[Joint, float]] = []
        """Broken springs, and the times of their breaking, s."""
        # Dampers on one body share the step, see `_spring`.
        self._dampers = _count_dampers(self._springs)
        self._lift = _extra_weights(world, is_dynamic)
        self._lifts = bool(self._lift.any())
        self._damping = np.where(is_dynamic, [b.damping for b in bodies], 0.0)
        self._damped = np.flatnonzero(self._damping)
        self.has_centres = bool(self._attractors or self._magnets)
        """Whether `fastest_rate` may limit the step."""
        self.ramps = Ramps(world)
        self.busy = self._has_loads()

    def _has_loads(self) -> bool:
        """Return whether any force may act besides gravity."""
        loads = (
            *self._pushes,
            *self._springs,
            *self._fingers,
            *self._winds,
            *self._pools,
            *self._magnets,
            *self._attractors,
        )
        has_own_terms = self._lifts or len(self._damped) or self.ramps.busy
        return bool(loads or has_own_terms)

    def release(self, joint: Joint, pose: Array, time: float) -> float:
        """Remove a spring from a time on, s; return its energy at that time."""
        if joint not in self._springs:
            return 0.0
        self._springs = [spring for spring in self._springs if spring is not joint]
        self._broken.append((joint, time))
        return self._compute_spring_energy(joint, pose)

    def _compute_spring_energy(self, spring: Joint, pose: Array) -> float:
        """Return the energy of a spring, g·px²/s²."""
        length = float(np.hypot(*self._ends(spring, pose)[2]))
        return spring.stiffness / 2 * (length - spring.length) ** 2

    def fastest_rate(self, pose: Array, velocity: Array) -> float:
        """Return the fastest relative change of an attractor's pull, 1/s."""
        fastest_rate = 0.0
        for field in self._attractors:
            bodies = np.array(field.bodies, np.int64)
            distance = ((field.vector - pose[bodies, :2]) ** 2).sum(
                axis=1
            ) + field.soften**2
            # Two rates limit the step: that of a circular orbit at this distance, and
            # that of passing by at the present speed.
            distance = np.sqrt(np.maximum(distance, 1e-12))
            orbital_rate = np.sqrt(abs(field.strength) / distance**3)
            passing_rate = np.sqrt((velocity[bodies, :2] ** 2).sum(axis=1)) / distance
            fastest_rate = max(
                fastest_rate, float(np.maximum(orbital_rate, passing_rate).max())
            )
        for field in self._magnets:
            for first, second in combinations(field.bodies, 2):
                offset = pose[first, :2] - pose[second, :2]
                distance = max(float(offset @ offset) + field.soften**2, 1e-12) ** 0.5
                inverse_mass = self._lightness[first] + self._lightness[second]
                relative_velocity = velocity[first, :2] - velocity[second, :2]
                orbital_rate = (abs(field.pull) * inverse_mass / distance**3) ** 0.5
                fastest_rate = max(
                    fastest_rate,
                    orbital_rate,
                    float(np.hypot(*relative_velocity)) / distance,
                )
        return fastest_rate

    def mean_loads(
        self, pose: Array, velocity: Array, begin: float, end: float
    ) -> LoadSum:
        """Return the mean loads from `begin` to `end`, s.

        `pose` (N, 3) is that of the middle, `velocity` (N, 3) that of half the time
        before.
        """
        total = LoadSum(
            np.zeros((self._N, 3)), np.zeros((self._N, 3)), np.zeros((self._N, 3))
        )
        # The order matters: wind and damping predict the velocity in the middle of the
        # step from the loads summed up so far.
        h = end - begin
        for push in self._pushes:
            self._push(push, pose, (begin, end), total)
        for spring in self._springs:
            self._spring(spring, pose, velocity, h, total)
        for attractor in self._attractors:
            self._pull(attractor, pose, total)
        if self._lifts:
            total.hold[:, :2] += self._lift
        if len(self._damped):
            self._damp(velocity, h, total)
        for wind in self._winds:
            self._blow(wind, velocity, h, total)
        for magnet in self._magnets:
            self._attract(magnet, pose, total)
        for pool in self._pools:
            self._float(pool, pose, velocity, h, total)
        if self.ramps.busy:
            self.ramps.add(velocity, begin, end, total.drive)
        for finger in self._fingers:
            self._lead(finger, pose, velocity, (begin, end), total)
        return total

    def _push(
        self, push: Push, pose: Array, span: tuple[float, float], total: LoadSum
    ) -> None:
        """Add the force and the torque of a push during `span`, s."""
        begin, end = span
        # A push may begin or end within the step: its mean over the step is the force
        # times the share of time in which it acts.
        share = (min(push.end, end) - max(push.start, begin)) / (end - begin)
        if share <= 0:
            return
        if push.profile is not None:
            share = mean_factor(push, begin, end)
        # The point of application turns with the body.
        arm = _rotate(push.point, pose[push.body, 2])
        force = push.vector * share
        total.drive[push.body, :2] += force
        total.drive[push.body, 2] += (
            push.torque * share + arm[0] * force[1] - arm[1] * force[0]
        )

    def _pull(self, field: Field, pose: Array, total: LoadSum) -> None:
        """Add the forces of an attractor: strength * mass / distance², softened."""
        bodies = np.array(field.bodies, np.int64)
        # Newton's law with a softened distance (Plummer): the force stays finite in the
        # centre and belongs to the potential in `potential`.
        offsets = field.vector - pose[bodies, :2]
        square_distances = (offsets**2).sum(axis=1) + field.soften**2
        pull = (
            self._mass[bodies]
            * field.strength
            / np.maximum(square_distances, 1e-12) ** 1.5
        )
        total.hold[bodies, :2] += pull[:, None] * offsets

    def _blow(self, field: Field, velocity: Array, h: float, total: LoadSum) -> None:
        """Add the drag of a wind or of still air."""
        bodies = np.array(field.bodies, np.int64)
        # Drag acts on the velocity of the middle of the step, which other forces
        # have changed.
        known_acceleration = (
            self._gravity + total.hold[bodies, :2] * self._lightness[bodies, None]
        )
        relative_velocity = (
            field.vector - velocity[bodies, :2] - h / 2 * known_acceleration
        )
        # Quadratic drag alone divides the relative velocity by 1 + k |u| t: this
        # closed form is exact, and never overshoots the wind's own speed.
        slowing = (
            field.drag
            * self._width[bodies]
            * self._lightness[bodies]
            * np.hypot(*relative_velocity.T)
            * h
        )
        share = slowing / (1 + slowing)
        # With linear drag as well, split the step: linear drag first reduces the
        # relative velocity exponentially, and quadratic drag then acts on the rest.
        if field.linear > 0:
            rate = field.linear * self._width[bodies] * self._lightness[bodies] * h
            linear_decay = np.exp(-rate)
            share = 1 - linear_decay / (1 + slowing * linear_decay)
        if field.kind is FieldKind.AIR:
            # Still air only takes energy. A wind can also give energy, and then counts
            # as work from outside.
            loads = total.spend
        else:
            loads = total.drive
        loads[bodies, :2] += (self._mass[bodies] * share / h)[
            :, None
        ] * relative_velocity

    def _attract(self, magnet: Field, pose: Array, total: LoadSum) -> None:
        """Add the forces between magnets: pull / distance², softened."""
        # Both magnets get opposite forces, which conserves their momentum.
        for first, second in combinations(magnet.bodies, 2):
            offset = pose[second, :2] - pose[first, :2]
            square_distance = max(float(offset @ offset) + magnet.soften**2, 1e-12)
            force = magnet.pull / square_distance**1.5 * offset
            total.hold[first, :2] += force
            total.hold[second, :2] -= force

    def _float(
        self, pool: Pool, pose: Array, velocity: Array, h: float, total: LoadSum
    ) -> None:
        """Add the lift of the displaced water as work, and drag on the immersed
        part.
        """
        for body, displaced, center in pool.immersions(pose):
            # Archimedes: the lift is the weight of the displaced water, and acts at the
            # centre of the immersed part. Beside the centre of mass it turns the body
            # upright.
            lift = -pool.field.density * displaced * self._gravity
            arm = center - pose[body, :2]
            total.drive[body, :2] += lift
            total.drive[body, 2] += arm[0] * lift[1] - arm[1] * lift[0]
            # Drag acts on the immersed part only. The decay over the step is
            # exponential with the rate at its beginning, so that it never reverses the
            # velocity.
            immersed_share = displaced / pool.areas[body]
            speed = float(np.hypot(*velocity[body, :2]))
            area_per_mass = self._width[body] * immersed_share * self._lightness[body]
            drag_rate = (pool.field.linear + pool.field.drag * speed) * area_per_mass
            decay = -np.expm1(-drag_rate * h) / h
            inertia = self._mass[body], self._mass[body], self._moment[body]
            total.spend[body] -= np.array(inertia) * decay * velocity[body]

    def _lead(
        self,
        finger: Joint,
        pose: Array,
        velocity: Array,
        span: tuple[float, float],
        total: LoadSum,
    ) -> None:
        """Add the pull of a finger, while it holds."""
        knots = finger.knots
        begin, end = span
        if knots is None or end <= knots[0, 0] or begin >= knots[-1, 0]:
            return
        h = end - begin
        # The finger holds the body by a spring to its place in the middle of the step,
        # and lets go at both ends of its path.
        time = (begin + end) / 2
        target = np.array([np.interp(time, knots[:, 0], knots[:, k]) for k in (1, 2)])
        time_share = (min(end, knots[-1, 0]) - max(begin, knots[0, 0])) / h
        body = finger.first
        arm = _rotate(finger.first_at, pose[body, 2])
        pull = finger.stiffness * (target - pose[body, :2] - arm)
        # Change of the speed of the held point by a unit impulse: translation and
        # rotation both yield.
        compliance = self._lightness[body] + self._ease[body] * float(arm @ arm)
        rate = max(finger.damping * compliance * h, 1e-300)
        # The closed form of a damper alone: it never overshoots.
        brake = finger.damping * float(-np.expm1(-rate) / rate)
        force = time_share * (pull - brake * _velocity_at(velocity[body], arm))
        total.drive[body, :2] += force
        total.drive[body, 2] += arm[0] * force[1] - arm[1] * force[0]

    def _damp(self, velocity: Array, h: float, total: LoadSum) -> None:
        """Add the loads that take velocity and spin out; exact while they act alone."""
        bodies = self._damped
        # The velocity in the middle of the step contains half of the change by the
        # other loads. Its decay over h is exp(-damping * h), of which the loads give
        # the mean.
        inertia = np.stack([self._mass, self._mass, self._moment], axis=1)[bodies]
        known_acceleration = (total.hold + total.drive)[bodies] / inertia
        known_acceleration[:, :2] += self._gravity
        decay = -np.expm1(-self._damping[bodies] * h)[:, None] / h
        total.spend[bodies] -= (
            inertia * decay * (velocity[bodies] + h / 2 * known_acceleration)
        )

    def potential(self, pose: Array, time: float) -> float:
        """Return the energy stored in springs and attractors at a time, s: g·px²/s²."""
        stored = 0.0
        if self._lifts:
            stored = -float((self._lift * pose[:, :2]).sum())
        # Samples before the breaking still see the spring.
        for spring, end in self._broken:
            if time < end:
                stored += self._compute_spring_energy(spring, pose)
        for spring in self._springs:
            offset = self._ends(spring, pose)[2]
            stored += (
                spring.stiffness / 2 * (float(np.hypot(*offset)) - spring.length) ** 2
            )
        # The potential of pull / distance² is -pull / distance, with the same softening
        # as the force.
        for magnet in self._magnets:
            for first, second in combinations(magnet.bodies, 2):
                offsets_of_magnets = pose[second, :2] - pose[first, :2]
                square_distance = max(
                    float(offsets_of_magnets @ offsets_of_magnets) + magnet.soften**2,
                    1e-12,
                )
                stored -= magnet.pull / square_distance**0.5
        for field in self._attractors:
            bodies = np.array(field.bodies, np.int64)
            square_distance = ((field.vector - pose[bodies, :2]) ** 2).sum(
                axis=1
            ) + field.soften**2
            stored -= float(
                (
                    self._mass[bodies]
                    * field.strength
                    / np.sqrt(np.maximum(square_distance, 1e-12))
                ).sum()
            )
        return stored

    def _ends(self, spring: Joint, pose: Array) -> tuple[Array, Array, Array]:
        """Return both arms and the vector from the second end to the first, px."""
        arm1 = _rotate(spring.first_at, pose[spring.first, 2])
        end1 = pose[spring.first, :2] + arm1
        if spring.second is None:
            return arm1, np.zeros(2), end1 - spring.second_at
        arm2 = _rotate(spring.second_at, pose[spring.second, 2])
        return arm1, arm2, end1 - pose[spring.second, :2] - arm2

    def _spring(
        self, spring: Joint, pose: Array, velocity: Array, h: float, total: LoadSum
    ) -> None:
        """Add the force and the damping of a spring."""
        arm1, arm2, offset = self._ends(spring, pose)
        # A spring without length has no direction.
        length = float(np.hypot(*offset))
        if length < 1e-9:
            return
        direction = offset / length
        spring_force = -spring.stiffness * (length - spring.length)
        # Body, lever and sign of each end.
        sides = [(spring.first, _lever(arm1, direction), 1.0)]
        if spring.second is not None:
            sides.append((spring.second, _lever(arm2, direction), -1.0))
        damping_force = 0.0
        if spring.damping:
            damping_force = self._damping_force(
                spring, sides, direction, velocity, h, spring_force
            )
        # The elastic force keeps energy, which `potential` returns; the damper spends
        # energy.
        for body, lever, sign in sides:
            for part, force in (
                (total.hold, spring_force),
                (total.spend, damping_force),
            ):
                part[body, :2] += sign * force * direction
                part[body, 2] += sign * force * lever

    def _damping_force(
        self,
        spring: Joint,
        sides: list[tuple[int, float, float]],
        direction: Array,
        velocity: Array,
        h: float,
        spring_force: float,
    ) -> float:
        """Return the force of the damper of a spring, g·px/s²."""
        # `compliance` is the change of the relative speed of both ends by a unit
        # impulse along the spring, and `speed` the present one.
        compliance = speed = 0.0
        for body, lever, sign in sides:
            compliance += self._lightness[body] + self._ease[body] * lever**2
            speed += sign * float(
                velocity[body, :2] @ direction + velocity[body, 2] * lever
            )
        if not compliance:
            return 0.0
        # Dampers that share a body reduce the same velocity: each acts as if the step
        # were longer by their number, so that together they never overshoot.
        share = max(self._dampers.get(body, 1) for body, _, _ in sides)
        rate = spring.damping * compliance * h * share
        # The damper alone lets the relative speed decay as exp(-rate * t / h): its mean
        # over the step is (1 - exp(-rate)) / rate of the initial one. The speed
        # contains half of the change by the spring, as in the middle of the step.
        return float(
            -spring.damping
            * (speed + h / 2 * compliance * spring_force)
            * -np.expm1(-rate)
            / rate
        )


class Pool:
    """Water, and the bodies with buoyancy in it."""

    def __init__(self, field: Field, bodies: Sequence[Body]) -> None:
        self.field = field
        left, top = field.vector.tolist()
        width, height = field.extent
        self._box = left, top, left + width, top + height
        self._shapes = {k: _pieces(bodies[k]) for k in field.bodies}
        self._reach = {k: bodies[k].reach for k in field.bodies}
        self.areas = {k: area(bodies[k]) for k in field.bodies}

    def immersions(self, pose: Array) -> Iterator[tuple[int, float, Array]]:
        """Yield each body in the water, with its immersed area, px², and centre, px."""
        left, top, right, bottom = self._box
        for body in self._shapes:
            # A body is immersed as one whole: the moments of its pieces add up.
            x, y, angle = pose[body].tolist()
            reach = self._reach[body]
            # Most bodies are not in the water: the circle around a body tells so at
            # once.
            if (
                x + reach < left
                or x - reach > right
                or y + reach < top
                or y - reach > bottom
            ):
                continue
            area_sum, moment_sum = self._immersed_moments(body, (x, y), angle)
            if area_sum > 0:
                yield body, area_sum, moment_sum / area_sum

    def _immersed_moments(
        self, body: int, center: tuple[float, float], angle: float
    ) -> tuple[float, Array]:
        """Return the immersed area of a body, px², and its first moment, (2,) px³."""
        left, top, right, bottom = self._box
        sides = ((0, left, 1.0), (0, right, -1.0), (1, top, 1.0), (1, bottom, -1.0))
        rotation_matrix = rotation(angle)
        area_sum = 0.0
        moment_sum = np.zeros(2)
        for piece in self._shapes[body]:
            corners = piece @ rotation_matrix.T + center
            # Clip the convex piece at the four sides of the water, one after the other.
            for axis, bound, sign in sides:
                corners = _clip_outline(corners, axis, bound, sign)
            if len(corners) >= 3:
                moments = polygon_moments(corners)
                piece_area = abs(moments.area)
                area_sum += piece_area
                moment_sum = moment_sum + piece_area * moments.center
        return area_sum, moment_sum


def _clip_outline(corners: Array, axis: int, limit: float, sign: float) -> Array:
    """Return a convex outline (K, 2) clipped at `limit` on one axis.

    The part below the bound (sign 1) or above it (-1) is removed.
    """
    if len(corners):
        depth = sign * (corners[:, axis] - limit)
    else:
        depth = np.zeros(0)
    if (depth >= 0).all():
        return corners
    # Sutherland and Hodgman's algorithm: walk along the outline, keep corners on the
    # inner side, and add the crossing point for each edge that changes sides.
    kept_corners: list[Array] = []
    for k in range(len(corners)):
        previous_depth = depth[k - 1]
        depth_of_corner = depth[k]
        if previous_depth * depth_of_corner < 0:
            part = previous_depth / (previous_depth - depth_of_corner)
            kept_corners.append(corners[k - 1] + part * (corners[k] - corners[k - 1]))
        if depth_of_corner >= 0:
            kept_corners.append(corners[k])
    return np.array(kept_corners).reshape(-1, 2)


def _pieces(body: Body) -> tuple[Array, ...]:
    """Return the convex pieces of a body; of a circle, a polygon of its area."""
    if body.radius is None:
        return body.pieces
    # A polygon with corners on the circle has a smaller area. Its radius is raised so
    # that the area, and with it the lift, is that of the circle.
    angle = np.arange(CORNERS) * (2 * pi / CORNERS)
    corner_radius = body.radius * (2 * pi / CORNERS / np.sin(2 * pi / CORNERS)) ** 0.5
    return (corner_radius * np.stack([np.cos(angle), np.sin(angle)], axis=1),)


CORNERS = 180
"""Number of corners of a circle in water: the error of its lift is below 1e-3."""


def mean_factor(push: Push, begin: float, end: float) -> float:
    """Return the mean factor of a push over a step from `begin` to `end`, s."""
    low = max(push.start, begin)
    high = min(push.end, end)
    profile = push.profile
    if profile is None or high <= low:
        return 0.0
    # The mean of a profile over a step is the difference of its integral: a pulse much
    # shorter than the step still has its full effect.
    a = low - push.start
    b = high - push.start
    return (_integral(profile, b) - _integral(profile, a)) / (end - begin)


def _integral(profile: Profile, time: float) -> float:
    """Return the integral of a profile's factor from 0 to a time, s."""
    first, second = profile.numbers[0]
    match profile.kind:
        case ProfileKind.RAMP:
            rise_time = min(time, first)
            return rise_time**2 / (2 * first) + max(time - first, 0.0)
        case ProfileKind.SINE:
            rate = 2 * pi * first
            return float((1 - np.cos(rate * time)) / rate)
        case ProfileKind.PULSE:
            # A pulse is on for the first seconds of each period, and off for the
            # others.
            rounds, rest = divmod(time, first + second)
            return rounds * first + min(rest, first)
        case _:
            # Factors between knots are linear, and constant after the last.
            times, factors = np.array(profile.numbers).T
            knot_times = np.clip(times, 0.0, time)
            values = np.interp(knot_times, times, factors)
            rest_integral = max(time - float(times[-1]), 0.0) * float(factors[-1])
            return float(np.trapezoid(values, knot_times)) + rest_integral


def area(body: Body) -> float:
    """Return the area of a body, px²."""
    if body.radius is not None:
        return pi * body.radius**2
    return float(sum(abs(polygon_moments(piece).area) for piece in body.pieces))


def _rotate(vector: Array, angle: float) -> Array:
    """Rotate a vector by an angle, rad."""
    c = np.cos(angle)
    s = np.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def _lever(arm: Array, direction: Array) -> float:
    """Return the lever of a force at the end of an arm, px."""
    return float(arm[0] * direction[1] - arm[1] * direction[0])


def _velocity_at(velocity: Array, arm: Array) -> Array:
    """Return the velocity (2,) px/s of a body's point at an arm from its centre."""
    vx, vy, spin = velocity
    return np.array([vx - spin * arm[1], vy + spin * arm[0]])


class Forces(NamedTuple):
    """Lasting forces of one step, each (N, 3): g·px/s², g·px/s², g·px²/s²."""

    total: Array
    drive: Array | None  # the working part
    spend: Array | None  # the dissipating part
    roll_change: Array | None  # (N, 2) rad/s: change of the spheres' roll on the table
    table_work: float = 0.0  # g·px²/s² of work by belts and turntables in the step


class StepForces:
    """Pushes, springs, fields, the table, rolling resistance and motors of a world."""

    def __init__(
        self, world: World, moving: NDArray[np.int64], loads: ForceFields
    ) -> None:
        bodies = world.bodies
        self._moving = moving
        self._loads = loads
        self._table = Table(world)
        self._belts = MovingTable(world)
        self.resistance = Resistance(world)
        self._center = np.array([[*b.center, 0.0] for b in bodies]).reshape(-1, 3)
        self._dynamic = np.array([b.motion is Motion.DYNAMIC for b in bodies], bool)
        mass = np.array([b.mass for b in bodies]).reshape(-1)
        moment = np.array([b.moment for b in bodies]).reshape(-1)
        self._weight = np.stack([mass, mass, moment], axis=1)
        self._nothing = np.zeros((len(bodies), 3))
        self._fall = np.where(self._dynamic[:, None], [*world.gravity, 0.0], 0.0)
        self._falls = bool(world.gravity.any())
        # A sphere with a ramp begins at rest and gets its roll during the ramp.
        rolls = [0 * b.roll if has_ramp(b) else b.roll for b in bodies]
        self.roll = np.array(rolls).reshape(-1, 2)
        """Present roll of spheres on a table, (N, 2) rad/s."""
        self._foreseen: list[tuple[Array, Array]] = []
        """Friction of the table in the next steps without contacts, the last step
        first.
        """
        self.is_acting = loads.busy or self._table.busy
        """Whether forces are to be set before a step."""

    def release(self, joint: Joint, pose: Array, time: float) -> EnergyEvent:
        """Remove a spring from a time on, s; its energy is lost."""
        return EnergyEvent(time, self._loads.release(joint, pose, time), 0.0)

    def end(self, load: Forces) -> None:
        """Complete a step: until then, the step may be taken again from its start."""
        if load.roll_change is not None:
            self.roll = self.roll + load.roll_change

    def drift(self, load: Forces | None) -> Array:
        """Return the acceleration of each body without contacts, (N, 2) px/s²."""
        fall: Array = self._fall[:, :2]
        if load is None:
            return fall
        return np.asarray(
            fall + (load.total / self._weight)[:, :2] * self._dynamic[:, None]
        )

    def change(self, load: Forces | None, h: float, strength: float) -> Array:
        """Return the change of velocity (N, 3) in h seconds, px/s and rad/s.

        Gravity acts with a part `strength` of its strength, in addition to `load`.
        """
        fall = self._fall * (strength * h)
        if load is None:
            return fall
        return np.asarray(fall + load.total / self._weight * h * self._dynamic[:, None])

    def push(
        self, state: Array, end: float, h: float, *, is_half_step: bool, is_free: bool
    ) -> Forces:
        """Return the lasting forces of the step to `end`, at the bodies' future places.

        `is_half_step`: the half step to t = 0. `is_free`: no contact in the step before, no
        joint, and no other change since, so that several steps of table friction can be
        computed at once.
        """
        # Velocities of the state are those of the middle of the last step, and forces
        # change them to those of the next: a leapfrog scheme. The forces therefore
        # belong to the pose between both steps, at which the bodies arrive by their
        # present velocities.
        velocity = self._spread(state[:, 3:], self._nothing)
        load = Forces(self._nothing, None, None, None)
        if self._loads.busy:
            pose = self._spread(state[:, :3] + state[:, 3:] * h, self._center)
            if is_half_step:
                begin, duration = (end, 0.5)
            else:
                begin, duration = (end - h / 2, 1.0)
            loads = self._loads.mean_loads(pose, velocity, begin, end + h / 2)
            drive = loads.drive * duration
            spend = loads.spend * duration
            load = Forces(loads.hold * duration + drive + spend, drive, spend, None)
        if not self._table.busy:
            return load
        if is_half_step:
            duration = h / 2
        else:
            duration = h
        predicted_velocity = velocity
        if self._loads.busy:
            predicted_velocity = velocity + load.total / self._weight * h
        if self._falls:
            predicted_velocity = predicted_velocity + self._fall * duration
        table_velocity = self._table_velocity(state, h)
        if table_velocity is not None:
            predicted_velocity = predicted_velocity - table_velocity
        # With no other force, the friction of the next steps follows from the present
        # motion, and is computed for many steps at once.
        is_free &= not (self._loads.busy or self._falls or self._belts.busy)
        if is_half_step:
            begin = end
        else:
            begin = end - h / 2
        friction, roll_change, work = self._rub(
            predicted_velocity,
            table_velocity,
            self._loads.ramps.roll_change(begin, end + h / 2, len(self.roll)),
            duration,
            steps=STEPS_AHEAD if is_free else 1,
        )
        # Friction is computed as an impulse; loads are impulses by the length of a
        # step.
        friction /= h
        if load.spend is None:
            spend = friction
        else:
            spend = load.spend + friction
        if self._loads.busy:
            total = load.total + friction
        else:
            total = friction
        return Forces(total, load.drive, spend, roll_change, work)

    def _table_velocity(self, state: Array, h: float) -> Array | None:
        """Return the velocities (N, 3) of the table below the bodies at the time of
        their new velocities; None if it does not move.
        """
        if not self._belts.busy:
            return None
        # The new velocities are those in the middle of the next step: one and a half
        # steps ahead of the present poses.
        middle = self._spread(state[:, :3] + 1.5 * h * state[:, 3:], self._center)
        return self._belts.velocities(middle[:, :2])

    def _rub(
        self,
        velocity: Array,
        table_velocity: Array | None,
        pushed_roll: Array | None,
        duration: float,
        *,
        steps: int,
    ) -> tuple[Array, Array, float]:
        """Return the impulses of the table's friction (N, 3), the changes of the roll
        (N, 2), and the work of belts and of pushes of the roll.

        `velocity` (N, 3) is relative to the table at `table_velocity` (N, 3);
        `pushed_roll` (N, 2) is the change of the roll by pushes. The friction of
        `steps` steps is computed at once.
        """
        roll = self.roll
        if pushed_roll is not None:
            roll = roll + pushed_roll
        # Friction that was predicted for this step is used up first; the prediction
        # holds as long as nothing else acts.
        if steps == 1 or not self._foreseen:
            self._foreseen = self._table.predict(velocity, roll, duration, steps)
        change, roll_change = self._foreseen.pop()
        friction = change * self._weight
        work = 0.0
        # The belt moves with its own velocity while it drags a body along: this power
        # comes from outside.
        if table_velocity is not None:
            work = float((friction * table_velocity).sum())
        if pushed_roll is not None:
            roll_change = roll_change + pushed_roll
            middle_roll = self.roll + roll_change / 2
            inertia = self._weight[:, 2:]
            work += float((inertia * middle_roll * pushed_roll).sum())
        return friction, roll_change, work

    def _spread(self, rows: Array, others: Array) -> Array:
        """Expand rows (M, 3) of moving bodies to all bodies (N, 3)."""
        if len(rows) == len(others):
            return rows
        out = others.copy()
        out[self._moving] = rows
        return out


class ScriptedMotion:
    """The paths of a world's scripted bodies."""

    def __init__(self, world: World) -> None:
        self._paths = [
            (k, body.path)
            for k, body in enumerate(world.bodies)
            if body.motion is Motion.SCRIPTED
        ]
        self.busy = bool(self._paths)
        # Between two knots of a path the velocity is constant; at a knot it jumps.
        self._knots = np.sort(
            np.concatenate([np.zeros(0), *(path[:, 0] for _, path in self._paths)])
        )

    def has_jump(self, begin: float, end: float) -> bool:
        """Check whether a path's velocity changes after `begin`, up to `end`, s."""
        # A knot lies within the span if the two ends have different numbers of knots
        # before them.
        low, high = np.searchsorted(self._knots, [begin, end], side="right")
        return bool(high > low)

    def drive(self, time: float, h: float, state: Array, row: dict[int, int]) -> None:
        """Set the rows of scripted bodies in the state (M, 6).

        After a move of h seconds, a body is at its place at `time`. It has the velocity
        of the h seconds after, with which it pushes others.
        """
        for body, path in self._paths:
            present_pose = _pose(path, time)
            next_pose = _pose(path, time + h)
            velocity = (next_pose - present_pose) / h
            # The engine will add velocity * h to the pose: start so much earlier that
            # the body arrives at its place exactly.
            state[row[body], :3] = present_pose - velocity * h
            state[row[body], 3:] = velocity

    def rows(self, row: dict[int, int]) -> list[int]:
        """Return the rows of the scripted bodies in the state."""
        return [row[body] for body, _ in self._paths]

    def sample(self, time: float, pose: Array, velocity: Array) -> None:
        """Write the exact pose and velocity of scripted bodies into (N, 3) arrays."""
        for body, path in self._paths:
            pose[body] = _pose(path, time)
            next_knot = int(np.searchsorted(path[:, 0], time, side="right"))
            if 0 < next_knot < len(path):
                velocity[body] = (path[next_knot, 1:] - path[next_knot - 1, 1:]) / (
                    path[next_knot, 0] - path[next_knot - 1, 0]
                )
            else:
                velocity[body] = 0.0


def _pose(path: Array, time: float) -> Array:
    """Return the pose (3,) of a path at a time, s, by linear interpolation."""
    return np.array([np.interp(time, path[:, 0], path[:, k]) for k in (1, 2, 3)])
