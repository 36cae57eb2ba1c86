"""Forces that last -> force and torque on each body at one time: pushes, springs, wind, attractors."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from physgen.compile.springs import springs
from physgen.compile.world import Body, Joint, World
from physgen.geometry import polygon_moments
from physgen.scene.model import FieldKind, Load, Motion

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sum:
    """Loads on the N bodies, each (N, 3): g·px/s², g·px/s², g·px²/s²."""

    hold: Array
    """Has a potential: springs, attractors."""
    drive: Array
    """Does work: pushes, wind."""
    spend: Array
    """Takes energy out: dampers."""


class Loads:
    """All lasting forces of a world."""

    def __init__(self, world: World) -> None:
        bodies = world.bodies
        self._N = len(bodies)
        dynamic = np.array([b.motion is Motion.DYNAMIC for b in bodies], bool)
        self._mass = np.array([b.mass for b in bodies])
        self._gravity = world.gravity
        self._lightness = np.divide(1.0, self._mass, out=np.zeros(self._N), where=dynamic)
        moment = np.array([b.moment for b in bodies])
        self._ease = np.divide(1.0, moment, out=np.zeros(self._N), where=dynamic)
        self._width = np.array([2 * np.sqrt(_area(b) / pi) for b in bodies])
        self._pushes = [p for p in world.pushes if p.load is not Load.IMPULSE and dynamic[p.body]]
        self._springs = springs(world)
        self._winds = [f for f in world.fields if f.kind is FieldKind.WIND]
        self._attractors = [f for f in world.fields if f.kind is FieldKind.ATTRACTOR]
        self._dampers: dict[int, int] = {}
        for spring in self._springs:
            for body in (spring.first, spring.second):
                if body is not None:
                    self._dampers[body] = self._dampers.get(body, 0) + (spring.damping > 0)
        self.steers = bool(self._attractors)
        """Whether `pace` has anything to say."""
        self.busy = bool(self._pushes or self._springs or self._winds or self._attractors)

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
        return top

    def at(self, pose: Array, velocity: Array, begin: float, end: float) -> Sum:
        """Mean loads from `begin` to `end`, s, about the time at which the bodies have the pose (N, 3).

        velocity (N, 3) is that of half the time before.
        """
        total = Sum(np.zeros((self._N, 3)), np.zeros((self._N, 3)), np.zeros((self._N, 3)))
        h = end - begin
        for push in self._pushes:
            part = (min(push.end, end) - max(push.start, begin)) / h
            if part > 0:
                arm = _turned(push.at, pose[push.body, 2])
                force = push.vector * part
                total.drive[push.body, :2] += force
                total.drive[push.body, 2] += push.torque * part + arm[0] * force[1] - arm[1] * force[0]
        for spring in self._springs:
            self._spring(spring, pose, velocity, h, total)
        for field in self._attractors:
            on = np.array(field.bodies, np.int64)
            away = field.vector - pose[on, :2]
            near = (away**2).sum(axis=1) + field.soften**2
            pull = self._mass[on] * field.strength / np.maximum(near, 1e-12) ** 1.5
            total.hold[on, :2] += pull[:, None] * away
        for field in self._winds:
            on = np.array(field.bodies, np.int64)
            known = self._gravity + total.hold[on, :2] * self._lightness[on, None]
            rush = field.vector - velocity[on, :2] - h / 2 * known
            # drag alone brakes by 1 / (1 + k |u| t): exact, and never beyond the wind's own speed
            slows = field.drag * self._width[on] * self._lightness[on] * np.hypot(*rush.T) * h
            part = slows / (1 + slows)
            total.drive[on, :2] += (self._mass[on] * part / h)[:, None] * rush
        return total

    def potential(self, pose: Array) -> float:
        """Energy stored in springs and attractors, g·px²/s²."""
        stored = 0.0
        for spring in self._springs:
            between = self._ends(spring, pose)[2]
            stored += spring.stiffness / 2 * (float(np.hypot(*between)) - spring.length) ** 2
        for field in self._attractors:
            on = np.array(field.bodies, np.int64)
            near = ((field.vector - pose[on, :2]) ** 2).sum(axis=1) + field.soften**2
            stored -= float((self._mass[on] * field.strength / np.sqrt(np.maximum(near, 1e-12))).sum())
        return stored

    def _ends(self, spring: Joint, pose: Array) -> tuple[Array, Array, Array]:
        """Both arms from the centres, and the line from the second end to the first."""
        arm1 = _turned(spring.first_at, pose[spring.first, 2])
        end1 = pose[spring.first, :2] + arm1
        if spring.second is None:
            return arm1, np.zeros(2), end1 - spring.second_at
        arm2 = _turned(spring.second_at, pose[spring.second, 2])
        return arm1, arm2, end1 - pose[spring.second, :2] - arm2

    def _spring(self, spring: Joint, pose: Array, velocity: Array, h: float, total: Sum) -> None:
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
            speed += sign * float(velocity[body, :2] @ along + velocity[body, 2] * lever)
        damp = 0.0
        if spring.damping and give:
            # as many dampers as share a body take their part each: together they never overshoot
            share = max(self._dampers.get(body, 1) for body, _, _ in sides)
            rate = spring.damping * give * h * share
            damp = -spring.damping * (speed + h / 2 * give * pull) * -np.expm1(-rate) / rate
        for body, arm, sign in sides:
            lever = arm[0] * along[1] - arm[1] * along[0]
            for part, force in ((total.hold, pull), (total.spend, damp)):
                part[body, :2] += sign * force * along
                part[body, 2] += sign * force * lever


def _area(body: Body) -> float:
    if body.radius is not None:
        return pi * body.radius**2
    return float(sum(abs(polygon_moments(piece).area) for piece in body.pieces))


def _turned(at: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * at[0] - s * at[1], s * at[0] + c * at[1]])
