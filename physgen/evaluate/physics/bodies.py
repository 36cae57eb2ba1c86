"""Rows of bodies with their own centre of mass, moment, damping and gravity,
round scenery, and repeated paths.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import cos, exp, radians, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.physics.elliptic import runge_kutta
from physgen.evaluate.physics.scorecard import (
    Case,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    worst,
)
from physgen.evaluate.physics.staging import GRAVITY, box, circle, scene, segment

Array = NDArray[np.float64]


def _swing_error(
    run: Run, *, rate: Callable[[Array], Array], spin: float, swing: float
) -> Errors:
    """Return the largest deviation of the angle over the swing."""
    track = run.track("toy")
    exact = runge_kutta(rate, np.array([0.0, spin]), 2.0, 480)
    count = min(len(exact), len(track.angle))
    deviation = np.abs(track.angle[:count] - exact[:count, 0])
    return {"angle": float(deviation.max()) / radians(swing)}


@dataclass(frozen=True)
class _RolyPoly:
    """A rolling disc with its centre of mass below its middle."""

    radius: float
    """px."""
    low: float
    """Distance from the middle to the centre of mass, px."""
    mass: float
    """g."""
    moment: float
    """g·px²."""

    def rate(self, state: Array) -> Array:
        """Return the rates of angle and spin."""
        angle, speed = state
        # Squared distance from the contact point to the centre of mass.
        middle_term = 2 * self.radius * self.low * cos(angle)
        arm_square = self.radius**2 + self.low**2 - middle_term
        inertia = self.moment + self.mass * arm_square
        # The weight turns the disc back, and so does the centripetal force of the middle.
        pull = self.mass * self.low * sin(angle) * (GRAVITY + self.radius * speed**2)
        return np.array([speed, -pull / inertia])


def _roly_poly(draw: Draw) -> list[Case]:
    """Return the case of a roly-poly. Error: largest deviation of the angle over the
    swing from the Lagrange equation of a rolling disc.

    (I + m (R² + d² - 2 R d cos a)) a'' + m R d sin a a'² + m g d sin a = 0, with the
    centre of mass d below the middle.
    """
    radius = draw.number(40, 70, 1)
    mass = draw.mass()
    low = draw.number(0.25, 0.6) * radius
    swing = draw.number(15, 50, 1)
    moment = draw.number(0.3, 0.6) * mass * radius**2
    # Energy at the lowest point, 1/2 J w² with J about the floor, equals that at the
    # greatest angle.
    least = moment + mass * (radius - low) ** 2
    versine = 1 - cos(radians(swing))
    spin = sqrt(2 * mass * GRAVITY * low * versine / least)
    spin *= draw.sign()
    middle = np.array([320.0, 300 - radius])
    # At the start the toy is upright and rolls: its centre of mass, at the distance R -
    # d over the floor, moves with the spin times this distance.
    objects = {
        "toy": circle(
            middle,
            radius,
            mass=mass,
            moment=moment,
            center_of_mass=[middle[0], middle[1] + low],
            spin=float(np.degrees(spin)),
            velocity=[spin * (radius - low), 0.0],
            friction=1.0,
            elasticity=0.0,
        )
    }
    floor = segment((20, 300), (620, 300), friction=1.0)
    toy = _RolyPoly(radius, low, mass, moment)
    measure = partial(_swing_error, rate=toy.rate, spin=spin, swing=swing)

    return [Case(scene((640, 340), 2.0, objects, {"floor": floor}), measure)]


def _motion_error(
    run: Run, *, damping: float, scale: float, speed: float, spin: float, gain: float
) -> Errors:
    """Return the largest deviation of the three motions from their closed forms."""
    slowed = run.track("slowed")
    light = run.track("light")
    turned = run.track("turned")
    # Damping shrinks every speed by the factor e^(-c t).
    left = np.exp(-damping * slowed.times)
    # With the speed v e^(-c t), the path is v / c (1 - e^(-c t)): its share of v / c
    # must be 1 - e^(-c t).
    covered_part = slowed.displacements[:, 0] * damping / speed
    fall = scale * GRAVITY * light.times**2 / 2
    fall_error = np.abs(light.displacements[:, 1] - fall).max()
    # A constant torque gives a constant angular acceleration, torque / moment.
    final_spin = gain * turned.times[-1]
    errors = [
        np.abs(covered_part - (1 - left)).max(),
        np.abs(slowed.spin / radians(spin) - left).max(),
        fall_error / np.abs(fall).max(),
        abs(turned.spin[-1] / final_spin - 1),
    ]
    return {"motion": worst(list(map(float, errors)))}


def _own_numbers(draw: Draw) -> list[Case]:
    """Return the case of damped, light, heavy and turning bodies, the last with its own
    moment. Error: largest deviation of each motion over its size.
    """
    damping = draw.number(0.5, 4)
    scale = draw.number(-0.4, 0.6)
    speed = draw.number(80, 160, 0)
    spin = draw.sign() * draw.number(200, 600, 0)
    mass = draw.mass()
    gain = draw.number(3, 9)
    time = 1.0
    size = draw.number(30, 60), draw.number(20, 40)
    moment = mass * draw.number(200, 2000, 0)
    # Without gravity, only the number in question changes the motion of the body.
    floats = {"gravity_scale": 0}
    objects = {
        "slowed": box(
            (120, 100), size, mass=mass, damping=damping, spin=spin,
            velocity=[speed, 0], **floats,
        ),
        "light": box((340, 240), size, mass=draw.mass(), gravity_scale=scale),
        "turned": box((500, 100), size, mass=mass, moment=moment, **floats),
    }  # fmt: skip
    forces = [{"object": "turned", "torque": gain * moment}]

    measure = partial(
        _motion_error, damping=damping, scale=scale, speed=speed, spin=spin, gain=gain
    )

    document = scene((640, 480), time, objects, forces=forces)
    return [Case(document, measure)]


def _round_hill(draw: Draw) -> list[Case]:
    """Return the case of bodies on a round hill. Error: deviation of the horizontal
    speed at the end over its closed form.

    A sliding body leaves the hill at cos a = 2/3 + v0²/(3 g R), R to its middle, with
    the speed sqrt(g R cos a).
    """
    radius = draw.number(100, 150, 1)
    ball = draw.number(8, 16)
    side = draw.sign()
    whole = radius + ball
    speed = draw.number(0.2, 0.5) * sqrt(GRAVITY * whole)
    top = 280.0 - radius
    objects = {
        "ball": circle(
            (320, top - ball), ball, mass=draw.mass(), velocity=[side * speed, 0],
            friction=0.0, elasticity=0.0,
        )
    }  # fmt: skip
    shape = {"circle": {"center": [320.0, 280.0], "radius": radius}}
    # The normal force is 0 where g cos a equals v²/R.
    cosine = 2 / 3 + speed**2 / (3 * GRAVITY * whole)
    # In flight, the horizontal speed stays that of the last contact.
    leaves = sqrt(GRAVITY * whole * cosine) * cosine

    def measure(run: Run) -> Errors:
        end = run.track("ball").velocities[-1, 0]
        return {"speed": abs(side * float(end) / leaves - 1)}

    hill = {"hill": {"shape": shape, "friction": 0.0, "elasticity": 0.0}}
    duration = 1.6 * whole / speed * exp(-speed / sqrt(GRAVITY * whole))
    document = scene((640, 420), min(duration, 1.2), objects, hill)
    return [Case(document, measure)]


def _shuttle(draw: Draw) -> list[Case]:
    """Return the case of a shuttle with repeated knots. Error: largest deviation of its
    place over its path.
    """
    period = draw.number(0.3, 0.7, 3)
    way = draw.number(60, 200, 1)
    turn = draw.number(-90, 90, 0)
    # The path is repeated from its last knot on: the place returns, and the angle goes
    # on.
    knots = [
        [0, 200.0, 100.0, 0],
        [period / 2, 200 + way, 100.0, turn],
        [period, 200.0, 100.0, 2 * turn],
    ]
    objects = {
        "shuttle": box((200, 100), (40, 20), motion={"path": knots, "loop": True})
    }

    def measure(run: Run) -> Errors:
        track = run.track("shuttle")
        # The place is a triangle wave, and the angle adds up with each period.
        phase = (track.times / period) % 1.0
        place = way * (1 - np.abs(2 * phase - 1))
        turned = radians(turn) * 2 * track.times / period
        place_error = np.abs(track.displacements[:, 0] - place).max() / way
        angle_error = np.abs(track.angle - turned).max()
        return {"place": float(max(place_error, angle_error))}

    document = scene((480, 200), 2.0, objects)
    return [Case(document, measure)]


ROWS = (
    Row(
        51, "roly-poly", "roly-poly that rolls with a low centre of mass",
        "(I + m (R² + d² - 2 R d cos a)) a'' + m d sin a (g + R a'²) = 0",
        "discs of 40 to 70 px, the centre of mass 0.25 to 0.6 R below the middle, swings of 15 to 50 degrees",
        "Largest deviation of the angle in 2 s over the swing, against Runge and Kutta's method. Smooth motion, but "
        "the phase adds up over several swings: 1 %.",
        (Measure("angle", 1e-2),), _roly_poly,
    ),
    Row(
        52, "own-numbers", "damping, gravity_scale and moment", "v0 e to the -c t; s g t²/2; M t/I",
        "damping 0.5 to 4 a second, gravity -0.4 to 0.6 times, 20 to 500 g",
        "Largest deviation of way and spin over their closed forms. Smooth motion: 0.3 %.",
        (Measure("motion", 3e-3),), _own_numbers,
    ),
    Row(
        53, "round-hill", "ball that slides off a round hill", "leaves at cos a = 2/3 + v0²/(3 g R)",
        "hills of 100 to 150 px, balls of 8 to 16 px at 0.2 to 0.5 sqrt(g R), to either side",
        "Horizontal speed after it leaves over its closed form. Steps cut a curve short: 1 %.",
        (Measure("speed", 1e-2),), _round_hill,
    ),
    Row(
        54, "shuttle", "path that begins again", "x(t) = x(t mod T)",
        "periods of 0.3 to 0.7 s, ways of 60 to 200 px, turning by -90 to 90 degrees each way",
        "Largest deviation of the place over the way, and of the angle. Written as it is: 1e-6.",
        (Measure("place", 1e-6),), _shuttle,
    ),
)  # fmt: skip
