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
from physgen.simulate.ramps import Ramps, is_ramped


def spring_joints(world: World) -> list[Joint]:
    """Those of a world's joints that are springs."""
    return [joint for joint in world.joints if joint.kind in SPRINGS]


def spring_compliance(world: World, spring: Joint) -> float:
    """1/g: how easily a spring's ends move."""
    total = 0.0
    for index, at in (
        (spring.first, spring.first_at),
        (spring.second, spring.second_at),
    ):
        if index is not None and world.bodies[index].motion is Motion.DYNAMIC:
            body = world.bodies[index]
            total += 1 / body.mass + float(at @ at) / body.moment
    return total


def stiffest_spring(world: World) -> tuple[float, str]:
    """rad/s of the body that its springs, all together, swing fastest, and the name of the one that pulls hardest."""
    pulls: dict[int, float] = {}
    hardest, name = 0.0, ""
    for spring in spring_joints(world):
        pull = spring.stiffness * spring_compliance(world, spring)
        if pull > hardest:
            hardest, name = pull, spring.name
        for index in (spring.first, spring.second):
            if index is not None and world.bodies[index].motion is Motion.DYNAMIC:
                pulls[index] = pulls.get(index, 0.0) + pull
    return max(pulls.values(), default=0.0) ** 0.5, name


@dataclass(frozen=True)
class EnergyEvent:
    """What happened to the energy at one time, g·px²/s²."""

    time: float  # s
    lost: float
    work: float


class Impulses:
    """The impulses that are still to come."""

    def __init__(self, world: World) -> None:
        dynamic = [body.motion is Motion.DYNAMIC for body in world.bodies]
        self._bodies = world.bodies
        self._coming = sorted(
            (p for p in world.pushes if p.load is Load.IMPULSE and dynamic[p.body]),
            key=lambda p: p.start,
        )

    def due(self, end: float) -> bool:
        """Whether one is given before `end`, s."""
        return bool(self._coming) and self._coming[0].start < end - 1e-12

    def since(self, begin: float) -> float:
        """s from `begin` to the next one."""
        return max(0.0, self._coming[0].start - begin)

    def give(self, velocity: Array, pose: Array, since: float) -> EnergyEvent:
        """Give the next one to the velocities (N, 3), `since` s after the bodies had the pose (N, 3)."""
        push = self._coming.pop(0)
        body = self._bodies[push.body]
        v = velocity[push.body]
        arm = _turned(push.at, pose[push.body, 2] + v[2] * since)
        change = np.array(
            [*push.vector, arm[0] * push.vector[1] - arm[1] * push.vector[0]]
        )
        change /= [body.mass, body.mass, body.moment]
        work = body.mass * (change[:2] @ (v[:2] + change[:2] / 2))
        work += body.moment * change[2] * (v[2] + change[2] / 2)
        velocity[push.body] += change
        return EnergyEvent(push.start, 0.0, float(work))


@dataclass(frozen=True)
class LoadSum:
    """Loads on the N bodies, each (N, 3): g·px/s², g·px/s², g·px²/s²."""

    hold: Array  # has a potential: springs, attractors
    drive: Array  # does work: pushes, wind
    spend: Array  # takes energy out: dampers


class ForceFields:
    """All lasting forces of a world."""

    def __init__(self, world: World) -> None:
        bodies = world.bodies
        self._N = len(bodies)
        dynamic = np.array([b.motion is Motion.DYNAMIC for b in bodies], bool)
        self._mass = np.array([b.mass for b in bodies])
        self._gravity = world.gravity
        self._lightness = np.divide(
            1.0, self._mass, out=np.zeros(self._N), where=dynamic
        )
        moment = np.array([b.moment for b in bodies])
        self._ease = np.divide(1.0, moment, out=np.zeros(self._N), where=dynamic)
        self._pushes = [
            p for p in world.pushes if p.load is not Load.IMPULSE and dynamic[p.body]
        ]
        self._springs = spring_joints(world)
        self._fingers = [s for s in self._springs if s.kind is JointKind.FINGER]
        self._springs = [s for s in self._springs if s.kind is JointKind.SPRING]
        self._winds = [
            f for f in world.fields if f.kind in (FieldKind.WIND, FieldKind.AIR)
        ]
        self._pools = [
            Pool(f, bodies) for f in world.fields if f.kind is FieldKind.WATER
        ]
        self._magnets = [f for f in world.fields if f.kind is FieldKind.MAGNET]
        self._attractors = [f for f in world.fields if f.kind is FieldKind.ATTRACTOR]
        self._width = np.array(
            [2 * np.sqrt(area(b) / pi) for b in bodies if self._winds or self._pools]
        )
        self._broken: list[tuple[Joint, float]] = []
        """Springs that pull no more, and since when, s."""
        self._dampers: dict[int, int] = {}
        for spring in self._springs:
            for body in (spring.first, spring.second):
                if body is not None:
                    self._dampers[body] = self._dampers.get(body, 0) + (
                        spring.damping > 0
                    )
        scale = np.array([b.gravity_scale for b in bodies])
        lift = np.where(dynamic, (scale - 1) * self._mass, 0.0)
        self._lift = lift[:, None] * world.gravity
        """(N, 2) g·px/s²: what gravity is more than usual."""
        self._lifts = bool(self._lift.any())
        self._damping = np.where(dynamic, [b.damping for b in bodies], 0.0)
        self._damped = np.flatnonzero(self._damping)
        self._moment = moment
        self.steers = bool(self._attractors or self._magnets)
        """Whether `pace` has anything to say."""
        self.busy = bool(
            self._pushes or self._springs or self._winds or self._attractors
        ) or bool(self._lifts or len(self._damped) or self._fingers)
        self.ramps = Ramps(world)
        self.busy |= bool(self._pools or self._magnets or self.ramps.busy)

    def release(self, joint: Joint, pose: Array, time: float) -> float:
        """Let a spring pull no more from a time on, s; return the energy that it has then."""
        if joint not in self._springs:
            return 0.0
        self._springs = [spring for spring in self._springs if spring is not joint]
        self._broken.append((joint, time))
        return self._stored(joint, pose)

    def _stored(self, spring: Joint, pose: Array) -> float:
        length = float(np.hypot(*self._ends(spring, pose)[2]))
        return spring.stiffness / 2 * (length - spring.length) ** 2

    def pace(self, pose: Array, velocity: Array) -> float:
        """1/s: how fast the pull of an attractor changes, at most; 0 without attractors."""
        top = 0.0
        for field in self._attractors:
            on = np.array(field.bodies, np.int64)
            near = ((field.vector - pose[on, :2]) ** 2).sum(axis=1) + field.soften**2
            near = np.sqrt(np.maximum(near, 1e-12))
            swing = np.sqrt(abs(field.strength) / near**3)
            pass_by = np.sqrt((velocity[on, :2] ** 2).sum(axis=1)) / near
            top = max(top, float(np.maximum(swing, pass_by).max()))
        for field in self._magnets:
            for first, second in combinations(field.bodies, 2):
                between = pose[first, :2] - pose[second, :2]
                near = max(float(between @ between) + field.soften**2, 1e-12) ** 0.5
                ease = self._lightness[first] + self._lightness[second]
                rush = velocity[first, :2] - velocity[second, :2]
                swing = (abs(field.pull) * ease / near**3) ** 0.5
                top = max(top, swing, float(np.hypot(*rush)) / near)
        return top

    def at(self, pose: Array, velocity: Array, begin: float, end: float) -> LoadSum:
        """Mean loads from `begin` to `end`, s, about the time at which the bodies have the pose (N, 3).

        velocity (N, 3) is that of half the time before.
        """
        total = LoadSum(
            np.zeros((self._N, 3)), np.zeros((self._N, 3)), np.zeros((self._N, 3))
        )
        h = end - begin
        for push in self._pushes:
            part = (min(push.end, end) - max(push.start, begin)) / h
            if part > 0:
                if push.profile is not None:
                    part = mean_factor(push, begin, end)
                arm = _turned(push.at, pose[push.body, 2])
                force = push.vector * part
                total.drive[push.body, :2] += force
                total.drive[push.body, 2] += (
                    push.torque * part + arm[0] * force[1] - arm[1] * force[0]
                )
        for spring in self._springs:
            self._spring(spring, pose, velocity, h, total)
        for field in self._attractors:
            on = np.array(field.bodies, np.int64)
            away = field.vector - pose[on, :2]
            near = (away**2).sum(axis=1) + field.soften**2
            pull = self._mass[on] * field.strength / np.maximum(near, 1e-12) ** 1.5
            total.hold[on, :2] += pull[:, None] * away
        if self._lifts:
            total.hold[:, :2] += self._lift
        if len(self._damped):
            self._damp(velocity, h, total)
        for field in self._winds:
            on = np.array(field.bodies, np.int64)
            known = self._gravity + total.hold[on, :2] * self._lightness[on, None]
            rush = field.vector - velocity[on, :2] - h / 2 * known
            # drag alone brakes by 1 / (1 + k |u| t): exact, and never beyond the wind's own speed
            slows = (
                field.drag
                * self._width[on]
                * self._lightness[on]
                * np.hypot(*rush.T)
                * h
            )
            part = slows / (1 + slows)
            if field.linear > 0:
                rate = field.linear * self._width[on] * self._lightness[on] * h
                left = np.exp(-rate)
                part = 1 - left / (1 + slows * left)
            taken = total.spend if field.kind is FieldKind.AIR else total.drive
            taken[on, :2] += (self._mass[on] * part / h)[:, None] * rush
        for magnet in self._magnets:
            self._attract(magnet, pose, total)
        for pool in self._pools:
            self._float(pool, pose, velocity, h, total)
        if self.ramps.busy:
            self.ramps.add(velocity, begin, end, total.drive)
        for finger in self._fingers:
            self._lead(finger, pose, velocity, (begin, end), total)
        return total

    def _attract(self, magnet: Field, pose: Array, total: LoadSum) -> None:
        for first, second in combinations(magnet.bodies, 2):
            away = pose[second, :2] - pose[first, :2]
            near = max(float(away @ away) + magnet.soften**2, 1e-12)
            force = magnet.pull / near**1.5 * away
            total.hold[first, :2] += force
            total.hold[second, :2] -= force

    def _float(
        self, pool: Pool, pose: Array, velocity: Array, h: float, total: LoadSum
    ) -> None:
        """Add the lift of what is displaced, which does work, and drag on the part that is in the water."""
        for body, displaced, center in pool.displaced(pose):
            lift = -pool.field.density * displaced * self._gravity
            arm = center - pose[body, :2]
            total.drive[body, :2] += lift
            total.drive[body, 2] += arm[0] * lift[1] - arm[1] * lift[0]
            share = displaced / pool.areas[body]
            speed = float(np.hypot(*velocity[body, :2]))
            size = self._width[body] * share * self._lightness[body]
            rate = (pool.field.linear + pool.field.drag * speed) * size
            part = -np.expm1(-rate * h) / h
            weight = self._mass[body], self._mass[body], self._moment[body]
            total.spend[body] -= np.array(weight) * part * velocity[body]

    def _lead(
        self,
        finger: Joint,
        pose: Array,
        velocity: Array,
        span: tuple[float, float],
        total: LoadSum,
    ) -> None:
        """Add the pull of a finger, while it holds."""
        knots, (begin, end) = finger.knots, span
        if knots is None or end <= knots[0, 0] or begin >= knots[-1, 0]:
            return
        h = end - begin
        time = (begin + end) / 2
        x, y = (float(np.interp(time, knots[:, 0], knots[:, k])) for k in (1, 2))
        part = (min(end, knots[-1, 0]) - max(begin, knots[0, 0])) / h
        body = finger.first
        arm = _turned(finger.first_at, pose[body, 2])
        vx, vy, spin = velocity[body]
        speed = np.array([vx - spin * arm[1], vy + spin * arm[0]])
        pull = finger.stiffness * (np.array([x, y]) - pose[body, :2] - arm)
        give = self._lightness[body] + self._ease[body] * float(arm @ arm)
        rate = max(finger.damping * give * h, 1e-300)
        # exact while it acts alone, so that it never overshoots
        brake = finger.damping * float(-np.expm1(-rate) / rate)
        force = part * (pull - brake * speed)
        total.drive[body, :2] += force
        total.drive[body, 2] += arm[0] * force[1] - arm[1] * force[0]

    def _damp(self, velocity: Array, h: float, total: LoadSum) -> None:
        """Add what takes velocity and spin out: exact while it acts alone."""
        on = self._damped
        weight = np.stack([self._mass, self._mass, self._moment], axis=1)[on]
        known = (total.hold + total.drive)[on] / weight
        known[:, :2] += self._gravity
        part = -np.expm1(-self._damping[on] * h)[:, None] / h
        total.spend[on] -= weight * part * (velocity[on] + h / 2 * known)

    def potential(self, pose: Array, time: float) -> float:
        """Energy stored in springs and attractors at a time, s: g·px²/s²."""
        stored = -float((self._lift * pose[:, :2]).sum()) if self._lifts else 0.0
        for spring, end in self._broken:
            if time < end:
                stored += self._stored(spring, pose)
        for spring in self._springs:
            between = self._ends(spring, pose)[2]
            stored += (
                spring.stiffness / 2 * (float(np.hypot(*between)) - spring.length) ** 2
            )
        for magnet in self._magnets:
            for first, second in combinations(magnet.bodies, 2):
                away = pose[second, :2] - pose[first, :2]
                near = max(float(away @ away) + magnet.soften**2, 1e-12)
                stored -= magnet.pull / near**0.5
        for field in self._attractors:
            on = np.array(field.bodies, np.int64)
            near = ((field.vector - pose[on, :2]) ** 2).sum(axis=1) + field.soften**2
            stored -= float(
                (
                    self._mass[on] * field.strength / np.sqrt(np.maximum(near, 1e-12))
                ).sum()
            )
        return stored

    def _ends(self, spring: Joint, pose: Array) -> tuple[Array, Array, Array]:
        """Both arms from the centres, and the line from the second end to the first."""
        arm1 = _turned(spring.first_at, pose[spring.first, 2])
        end1 = pose[spring.first, :2] + arm1
        if spring.second is None:
            return arm1, np.zeros(2), end1 - spring.second_at
        arm2 = _turned(spring.second_at, pose[spring.second, 2])
        return arm1, arm2, end1 - pose[spring.second, :2] - arm2

    def _spring(
        self, spring: Joint, pose: Array, velocity: Array, h: float, total: LoadSum
    ) -> None:
        arm1, arm2, between = self._ends(spring, pose)
        length = float(np.hypot(*between))
        if length < 1e-9:
            return
        along = between / length
        pull = -spring.stiffness * (length - spring.length)
        sides = [(spring.first, arm1, 1.0)]
        if spring.second is not None:
            sides.append((spring.second, arm2, -1.0))
        give = speed = 0.0
        for body, arm, sign in sides:
            lever = arm[0] * along[1] - arm[1] * along[0]
            give += self._lightness[body] + self._ease[body] * lever**2
            speed += sign * float(
                velocity[body, :2] @ along + velocity[body, 2] * lever
            )
        damp = 0.0
        if spring.damping and give:
            # as many dampers as share a body take their part each: together they never overshoot
            share = max(self._dampers.get(body, 1) for body, _, _ in sides)
            rate = spring.damping * give * h * share
            damp = (
                -spring.damping
                * (speed + h / 2 * give * pull)
                * -np.expm1(-rate)
                / rate
            )
        for body, arm, sign in sides:
            lever = arm[0] * along[1] - arm[1] * along[0]
            for part, force in ((total.hold, pull), (total.spend, damp)):
                part[body, :2] += sign * force * along
                part[body, 2] += sign * force * lever


class Pool:
    """Water, and the bodies that it may lift."""

    def __init__(self, field: Field, bodies: Sequence[Body]) -> None:
        self.field = field
        left, top = field.vector.tolist()
        width, height = field.extent
        self._box = left, top, left + width, top + height
        self._shapes = {k: _pieces(bodies[k]) for k in field.bodies}
        self._reach = {k: bodies[k].reach for k in field.bodies}
        self.areas = {k: area(bodies[k]) for k in field.bodies}

    def displaced(self, pose: Array) -> Iterator[tuple[int, float, Array]]:
        """Yield each body in the water, the area of it that is, px², and that area's middle (2,) px."""
        left, top, right, low = self._box
        for body, pieces in self._shapes.items():
            x, y, angle = pose[body].tolist()
            far = self._reach[body]
            if x + far < left or x - far > right or y + far < top or y - far > low:
                continue
            turn = rotation(angle)
            total, middle = 0.0, np.zeros(2)
            for piece in pieces:
                corners = piece @ turn.T + (x, y)
                for axis, bound, sign in (
                    (0, left, 1.0),
                    (0, right, -1.0),
                    (1, top, 1.0),
                    (1, low, -1.0),
                ):
                    corners = _clipped(corners, axis, bound, sign)
                if len(corners) < 3:
                    continue
                moments = polygon_moments(corners)
                size = abs(moments.area)
                total, middle = total + size, middle + size * moments.center
            if total > 0:
                yield body, total, middle / total


def _clipped(corners: Array, axis: int, bound: float, sign: float) -> Array:
    """Return a convex outline (K, 2) without its part below `bound` (sign 1) or above it (-1) on one axis."""
    depth = sign * (corners[:, axis] - bound) if len(corners) else np.zeros(0)
    if (depth >= 0).all():
        return corners
    kept: list[Array] = []
    for k in range(len(corners)):
        here, there = depth[k - 1], depth[k]
        if here * there < 0:
            part = here / (here - there)
            kept.append(corners[k - 1] + part * (corners[k] - corners[k - 1]))
        if there >= 0:
            kept.append(corners[k])
    return np.array(kept).reshape(-1, 2)


def _pieces(body: Body) -> tuple[Array, ...]:
    """Return convex pieces of a body; of a circle, a polygon of its area."""
    if body.radius is None:
        return body.pieces
    angle = np.arange(CORNERS) * (2 * pi / CORNERS)
    wide = body.radius * (2 * pi / CORNERS / np.sin(2 * pi / CORNERS)) ** 0.5
    return (wide * np.stack([np.cos(angle), np.sin(angle)], axis=1),)


CORNERS = 180
"""Of a circle in water: its lift is right to 1e-3."""


def mean_factor(push: Push, begin: float, end: float) -> float:
    """Return the mean factor of a push over a step from `begin` to `end`, s."""
    low, high = max(push.start, begin), min(push.end, end)
    profile = push.profile
    if profile is None or high <= low:
        return 0.0
    a, b = low - push.start, high - push.start
    return (_integral(profile, b) - _integral(profile, a)) / (end - begin)


def _integral(profile: Profile, time: float) -> float:
    """Return the integral of a profile's factor from 0 to a time, s."""
    first, second = profile.numbers[0]
    match profile.kind:
        case ProfileKind.RAMP:
            rising = min(time, first)
            return rising**2 / (2 * first) + max(time - first, 0.0)
        case ProfileKind.SINE:
            rate = 2 * pi * first
            return float((1 - np.cos(rate * time)) / rate)
        case ProfileKind.PULSE:
            rounds, rest = divmod(time, first + second)
            return rounds * first + min(rest, first)
        case _:
            times, factors = np.array(profile.numbers).T
            inside = np.clip(times, 0.0, time)
            values = np.interp(inside, times, factors)
            late = max(time - float(times[-1]), 0.0) * float(factors[-1])
            return float(np.trapezoid(values, inside)) + late


def area(body: Body) -> float:
    """px²."""
    if body.radius is not None:
        return pi * body.radius**2
    return float(sum(abs(polygon_moments(piece).area) for piece in body.pieces))


def _turned(at: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * at[0] - s * at[1], s * at[0] + c * at[1]])


class Forces(NamedTuple):
    """Lasting forces of one step, each (N, 3): g·px/s², g·px/s², g·px²/s²."""

    total: Array
    drive: Array | None  # the part that does work
    spend: Array | None  # the part that takes energy out
    rolled: Array | None  # (N, 2) rad/s: change of the spheres' roll on the table
    carried: float = 0.0  # g·px²/s² that belts and turntables do in the step


class StepForces:
    """Pushes, springs, fields, the table, rolling resistance and motors of a world."""

    def __init__(
        self, world: World, moving: NDArray[np.int64], loads: ForceFields
    ) -> None:
        bodies = world.bodies
        self._moving, self._loads, self._table = moving, loads, Table(world)
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
        rolls = [0 * b.roll if is_ramped(b) else b.roll for b in bodies]
        self.roll = np.array(rolls).reshape(-1, 2)
        """(N, 2) rad/s: how spheres on a table roll now."""
        self._foreseen: list[tuple[Array, Array]] = []
        """What the table does in the next steps while nothing touches, the last first."""
        self.pushes = loads.busy or self._table.busy
        """Whether forces are to be set before a step."""

    def release(self, joint: Joint, pose: Array, time: float) -> EnergyEvent:
        """Let a spring pull no more from a time on, s; its energy is lost."""
        return EnergyEvent(time, self._loads.release(joint, pose, time), 0.0)

    def end(self, load: Forces) -> None:
        """The step is over: one that was taken again started from where it began."""
        if load.rolled is not None:
            self.roll = self.roll + load.rolled

    def drift(self, load: Forces | None) -> Array:
        """(N, 2) px/s²: acceleration of each body while nothing touches it."""
        fall: Array = self._fall[:, :2]
        if load is None:
            return fall
        return np.asarray(
            fall + (load.total / self._weight)[:, :2] * self._dynamic[:, None]
        )

    def change(self, load: Forces | None, h: float, strength: float) -> Array:
        """Return (N, 3) px/s and rad/s that gravity, at a part of its strength, and `load` add in h seconds."""
        fall = self._fall * (strength * h)
        if load is None:
            return fall
        return np.asarray(fall + load.total / self._weight * h * self._dynamic[:, None])

    def push(
        self, state: Array, end: float, h: float, *, first: bool, alone: bool
    ) -> Forces:
        """Lasting forces for the step to `end`, taken where the bodies then are; `alone`: nothing touched in the step
        before, no joint holds, and nothing stepped in since."""
        velocity = self._spread(state[:, 3:], self._nothing)
        load = Forces(self._nothing, None, None, None)
        if self._loads.busy:
            pose = self._spread(state[:, :3] + state[:, 3:] * h, self._center)
            begin, part = (end, 0.5) if first else (end - h / 2, 1.0)
            loads = self._loads.at(pose, velocity, begin, end + h / 2)
            drive, spend = loads.drive * part, loads.spend * part
            load = Forces(loads.hold * part + drive + spend, drive, spend, None)
        if self._table.busy:
            part = h / 2 if first else h
            trial = (
                velocity + load.total / self._weight * h
                if self._loads.busy
                else velocity
            )
            trial = trial + self._fall * part if self._falls else trial
            alone &= not (self._loads.busy or self._falls or self._belts.busy)
            ground = None
            if self._belts.busy:
                # where bodies are when they have their new velocities
                middle = self._spread(
                    state[:, :3] + 1.5 * h * state[:, 3:], self._center
                )
                ground = self._belts.velocities(middle[:, :2])
                trial = trial - ground
            roll, made = self.roll, None
            if self._loads.ramps.busy:
                begin = end if first else end - h / 2
                made = self._loads.ramps.roll_change(begin, end + h / 2, len(roll))
                roll = roll + made
            if not (alone and self._foreseen):
                self._foreseen = self._table.foreseen(
                    trial, roll, part, 32 if alone else 1
                )
            change, rolled = self._foreseen.pop()
            if made is not None:
                rolled = rolled + made
            grip = change * self._weight
            carried = 0.0 if ground is None else float((grip * ground).sum())
            if made is not None:
                middle_roll = self.roll + rolled / 2
                carried += float((self._weight[:, 2:] * middle_roll * made).sum())
            grip /= h
            spend = grip if load.spend is None else load.spend + grip
            load = Forces(
                load.total + grip if self._loads.busy else grip,
                load.drive,
                spend,
                rolled,
                carried,
            )
        return load

    def _spread(self, rows: Array, others: Array) -> Array:
        """(M, 3) of the bodies that move -> (N, 3) of all."""
        if len(rows) == len(others):
            return rows
        out = others.copy()
        out[self._moving] = rows
        return out


class ScriptedMotion:
    """Paths of a world's scripted bodies."""

    def __init__(self, world: World) -> None:
        self._paths = [
            (k, body.path)
            for k, body in enumerate(world.bodies)
            if body.motion is Motion.SCRIPTED
        ]
        self.busy = bool(self._paths)
        self._knots = np.sort(
            np.concatenate([np.zeros(0), *(path[:, 0] for _, path in self._paths)])
        )

    def jump(self, begin: float, end: float) -> bool:
        """Whether a path's velocity changes after `begin`, up to `end`, s."""
        low, high = np.searchsorted(self._knots, [begin, end], side="right")
        return bool(high > low)

    def drive(self, time: float, h: float, state: Array, row: dict[int, int]) -> None:
        """Set each scripted row of the state (M, 6): to be at its place at `time` after a move of h seconds, with the
        velocity of the h seconds after, which is what pushes others then."""
        for body, path in self._paths:
            now, then = _pose(path, time), _pose(path, time + h)
            velocity = (then - now) / h
            state[row[body], :3] = now - velocity * h
            state[row[body], 3:] = velocity

    def rows(self, row: dict[int, int]) -> list[int]:
        """Rows of the scripted bodies in the state."""
        return [row[body] for body, _ in self._paths]

    def sample(self, time: float, pose: Array, velocity: Array) -> None:
        """Write the exact pose and velocity of the scripted bodies into (N, 3) arrays."""
        for body, path in self._paths:
            pose[body] = _pose(path, time)
            after = int(np.searchsorted(path[:, 0], time, side="right"))
            if 0 < after < len(path):
                velocity[body] = (path[after, 1:] - path[after - 1, 1:]) / (
                    path[after, 0] - path[after - 1, 0]
                )
            else:
                velocity[body] = 0.0


def _pose(path: Array, time: float) -> Array:
    return np.array([np.interp(time, path[:, 0], path[:, k]) for k in (1, 2, 3)])
