"""Rows of impulses, forces and torques of a scene, and of an attracting centre."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import cos, pi, radians, sin, sqrt
from typing import Any

import numpy as np

from physgen.evaluate.physics.scorecard import (
    Array,
    Case,
    Document,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    Track,
    worst,
)
from physgen.evaluate.physics.staging import FLOATING, Point, box, circle, scene

DURATION = 0.6
"""Duration of the row of pushes, s."""


def _unit(angle: float) -> Array:
    """Return the unit vector of a direction (rad)."""
    return np.array([cos(angle), sin(angle)])


@dataclass(frozen=True)
class _Block:
    """A pushed box, and the numbers of its push."""

    center: Array
    """(2,) px."""
    mass: float
    """g."""
    size: Point
    """px."""
    tilt: float
    """degrees."""
    start: float
    """Start of the push, s."""
    duration: float
    """Duration of the push, s."""
    arm: Array
    """(2,) px from the centre to the pushed point, along the box's long side."""
    direction: Array
    """(2,) unit vector of the push."""

    @classmethod
    def random(cls, draw: Draw, k: int) -> _Block:
        """Return box `k` of four in a square."""
        mass = draw.mass()
        size = (draw.number(40, 70), draw.number(20, 40))
        tilt = draw.number(0, 180, 0)
        # Times between the engine's steps.
        start = draw.number(0.05, 0.2, 3)
        duration = draw.number(0.2, 0.35, 3)
        arm = draw.number(0.3, 0.5) * size[0] * _unit(radians(tilt))
        angle = radians(tilt + draw.sign() * draw.number(50, 90, 0))
        center = np.array([160 + 240 * (k % 2), 130 + 240 * (k // 2)])
        return cls(center, mass, size, tilt, start, duration, arm, _unit(angle))

    @property
    def moment(self) -> float:
        """Return the moment of inertia, g·px²."""
        width, height = self.size
        return self.mass * (width**2 + height**2) / 12

    def point(self) -> list[float]:
        """Return the pushed point, px."""
        return list(map(float, self.arm + self.center))


@dataclass(frozen=True)
class _Gain:
    """The gain of velocity and spin from a push."""

    velocity: Array
    """(2,) px/s."""
    spin: float
    """rad/s."""


_Push = tuple[Document, _Gain]
"""A push in the scene file's form, and its closed form."""


def _strike(draw: Draw, block: _Block) -> _Push:
    """Return an impulse at a point."""
    impulse = block.mass * draw.number(50, 120) * block.direction
    push = {"impulse": impulse.tolist(), "at": block.point(), "start": block.start}
    arm = block.arm
    # The moment of the impulse about the centre is r x J.
    twist = float(arm[0] * impulse[1] - arm[1] * impulse[0])
    return push, _Gain(impulse / block.mass, twist / block.moment)


def _shove(draw: Draw, block: _Block) -> _Push:
    """Return a force through the centre."""
    acceleration = draw.number(200, 400) * block.direction
    push = {
        "force": (block.mass * acceleration).tolist(),
        "start": block.start,
        "duration": block.duration,
    }
    return push, _Gain(acceleration * block.duration, 0.0)


def _twist(draw: Draw, block: _Block) -> _Push:
    """Return a torque."""
    acceleration = draw.sign() * draw.number(10, 30)
    push = {
        "torque": block.moment * acceleration,
        "start": block.start,
        "duration": block.duration,
    }
    return push, _Gain(np.zeros(2), acceleration * block.duration)


@dataclass(frozen=True)
class _Ride:
    """A force at a moving point of a body. The spin depends on the motion."""

    force: Array
    """(2,) g·px/s²."""
    arm: Array
    """(2,) px at t = 0."""
    moment: float
    """g·px²."""

    def spin(self, track: Track) -> float:
        """Return the last spin (rad/s) of a motion from the work of the force: I w²/2 =
        F x (displacement of the point).
        """
        # The pushed point rides on the body, so that the moment changes with its angle.
        c = cos(track.angle[-1])
        s = sin(track.angle[-1])
        rotation = np.array([[c, -s], [s, c]])
        work = float(self.force @ (rotation @ self.arm - self.arm))
        speed = sqrt(max(2 * work / self.moment, 0.0))
        # The energy of the spin does not contain its sense.
        return float(np.sign(track.spin[-1])) * speed


_PUSHES = {"struck": _strike, "pushed": _shove, "turned": _twist}


def _pushes(draw: Draw) -> list[Case]:
    """Return the case of an impulse, a force, a torque and a force at a
    moving point.
    """
    objects: dict[str, Any] = {}
    forces: list[dict[str, Any]] = []
    gains: dict[str, _Gain] = {}
    for k, (name, push_block) in enumerate(_PUSHES.items()):
        block = _Block.random(draw, k)
        objects[name] = box(block.center, block.size, block.tilt, mass=block.mass)
        push, gains[name] = push_block(draw, block)
        forces.append({"object": name, **push})
    # The force at a moving point acts for the whole duration, and needs no start.
    name = "ridden"
    block = _Block.random(draw, len(_PUSHES))
    objects[name] = box(block.center, block.size, block.tilt, mass=block.mass)
    force = block.mass * draw.number(60, 120) * block.direction
    forces.append({"object": name, "force": force.tolist(), "at": block.point()})
    gains[name] = _Gain(force / block.mass * DURATION, 0.0)
    ride = _Ride(force, block.arm, block.moment)
    # Without gravity, the momentum after the pushes is the integral of the force alone.
    document = scene((560, 500), DURATION, objects, world=FLOATING, forces=forces)
    measure = partial(_push_error, gains, ride)
    return [Case(document, measure)]


def _push_error(gains: Mapping[str, _Gain], ride: _Ride, run: Run) -> Errors:
    """Return the largest relative deviation of a velocity or spin at the end."""
    errors = []
    for name, gain in gains.items():
        track = run.track(name)
        if name == "ridden":
            spin = ride.spin(track)
        else:
            spin = gain.spin
        # A torque alone must not move the centre: its deviation has no scale.
        if gain.velocity.any():
            deviation = np.hypot(*(track.velocity[-1] - gain.velocity))
            errors.append(deviation / np.hypot(*gain.velocity))
        if spin:
            errors.append(abs(track.spin[-1] / spin - 1))
        else:
            errors.append(abs(track.spin[-1]))
    return {"velocity": worst(errors)}


NEWTON_STEPS = 60
"""Number of Newton steps: more than any eccentricity of the draws needs."""


def kepler(axis: float, eccentricity: float, strength: float, times: Array) -> Array:
    """Return places (T, 2) px from the centre, along the directions of the first place
    and the first velocity.

    The motion begins at the farthest place. `axis` is the half long axis, px;
    `strength` px³/s². Newton's method solves Kepler's equation M = E - e sin E.
    """
    # The mean anomaly is 0 at the nearest place, and pi at the farthest.
    mean = pi + times * sqrt(strength / axis**3)
    anomaly = mean.copy()
    for _ in range(NEWTON_STEPS):
        # Newton's step for f(E) = E - e sin E - M.
        slope = 1 - eccentricity * np.cos(anomaly)
        anomaly -= (anomaly - eccentricity * np.sin(anomaly) - mean) / slope
    short_axis = axis * sqrt(1 - eccentricity**2)
    x = axis * (np.cos(anomaly) - eccentricity)
    y = short_axis * np.sin(anomaly)
    # The ellipse has its farthest place at -x: turn it by half a turn.
    return -np.stack([x, y], axis=1)


CENTER = np.array([260.0, 260.0])
"""Place of the attractor, px."""


@dataclass(frozen=True)
class _Orbit:
    """An ellipse about the attractor."""

    axis: float
    """Half the long axis, px."""
    eccentricity: float
    frame: Array
    """(2, 2): unit vectors of the first place and of the first velocity."""
    strength: float
    """px³/s²."""

    def places(self, times: Array) -> Array:
        """Return the places (T, 2) px at these times (s)."""
        places = kepler(self.axis, self.eccentricity, self.strength, times)
        return CENTER + places @ self.frame


def _attractor_strength(draw: Draw) -> float:
    """Return a strength, px³/s², by Kepler's third law for a period of 1.6 to 2.4 s at
    150 px.
    """
    period = draw.number(1.6, 2.4)
    return round(4 * pi**2 * 150**3 / period**2, -4)


def _orbits(draw: Draw) -> list[Case]:
    """Return the case of a circle and an ellipse about an attractor."""
    strength = _attractor_strength(draw)
    ellipses = {
        "circling": (draw.number(195, 215, 1), 0.0),
        "falling": (draw.number(90, 110, 1), draw.number(0.3, 0.5, 3)),
    }
    objects, orbits = {}, {}
    for name, (axis, eccentricity) in ellipses.items():
        angle = draw.angle()
        outward = np.array([cos(angle), sin(angle)])
        sideways = draw.sign() * np.array([-sin(angle), cos(angle)])
        orbits[name] = _Orbit(
            axis, eccentricity, np.array([outward, sideways]), strength
        )
        # A body starts at its farthest point, at which its velocity is across the line
        # to the attractor.
        farthest = axis * (1 + eccentricity)
        # The vis-viva equation: v² = strength (2/r - 1/a).
        speed = sqrt(strength * (2 / farthest - 1 / axis))
        objects[name] = circle(
            CENTER + farthest * outward,
            draw.number(6, 12),
            mass=draw.mass(),
            velocity=(speed * sideways).tolist(),
        )
    # Kepler's third law.
    period = 2 * pi * sqrt(orbits["circling"].axis ** 3 / strength)
    fields = {"sun": {"attractor": CENTER.tolist(), "strength": strength}}
    document = scene((520, 520), 1.1 * period, objects, world=FLOATING, fields=fields)
    return [Case(document, partial(_orbit_errors, orbits))]


def _orbit_errors(orbits: Mapping[str, _Orbit], run: Run) -> Errors:
    """Return the distance from Kepler's place at any time over the half axis, and the
    relative change of energy.
    """
    distances, changes = [], []
    for name, orbit in orbits.items():
        track = run.track(name)
        deviation = track.positions - orbit.places(track.times)
        distances.append(np.hypot(*deviation.T).max() / orbit.axis)
        radius = np.hypot(*(track.positions - CENTER).T)
        # The potential of a force strength/r² is -strength/r.
        energy = track.speed**2 / 2 - orbit.strength / radius
        changes.append(np.abs(energy / energy[0] - 1).max())
    return {"place": worst(distances), "energy": worst(changes)}


ROWS = (
    Row(
        22, "pushes", "impulse J, force F for t, torque for t, off-centre force that rides on the body",
        "dv = J/m, F t/m; dw = torque t/I, (r x J)/I",
        "boxes of 40 to 70 x 20 to 40 px turned anyhow, 20 to 500 g; starts and ends off the engine's steps",
        "Velocity and spin at the end over their closed forms. The riding force's spin is that of its work.",
        (Measure("velocity", 1e-3),), _pushes,
    ),
    Row(
        36, "orbits", "orbits about an attractor", "T² = 4 pi² a³/strength; energy is constant; Kepler's equation",
        "a circle of 195 to 215 px and an ellipse of 90 to 110 px with eccentricity 0.3 to 0.5, either way round",
        "Distance from where Kepler's equation puts the body, over the half axis, during 1.1 turns of the circle and "
        "over two of the ellipse; change of energy over its first value. Smooth motion, so 0.3 %.",
        (Measure("place", 3e-3), Measure("energy", 3e-3)), _orbits,
    ),
)  # fmt: skip
