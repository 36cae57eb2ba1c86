"""Rows of rolling objects: down slopes, out of a slide, to rest, and on an accelerating
platform.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import degrees, tan

import numpy as np

from physgen.evaluate.physics.scorecard import (
    Case,
    Document,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    worst,
)
from physgen.evaluate.physics.staging import (
    GRAVITY,
    INERTIA,
    Slope,
    box,
    circle,
    scene,
    segment,
)


@dataclass(frozen=True)
class _Roll:
    """A body rolling down a slope without slip."""

    slope: Slope
    acceleration: float
    """px/s²."""


def _rolling(draw: Draw) -> list[Case]:
    """Return the case of three round bodies on slopes."""
    objects = {}
    walls = {}
    rolls = {}
    for j, (solid, k) in enumerate(INERTIA.items()):
        side = draw.sign()
        tangent = tan(np.radians(draw.number(10, 35)))
        radius = draw.number(10, 26)
        surface = {"friction": 1.0, "elasticity": draw.number(0, 0.5)}
        left = 70 + 320 * j
        if side < 0:
            left += 230
        # Friction of 1 holds the body on slopes of at most 35 degrees: it rolls without
        # slip.
        slope = Slope((left, 70), tangent, side, 270)
        center = slope.point(30, radius)
        objects[solid] = circle(
            center, radius, solid=solid, mass=draw.mass(), **surface
        )
        walls[f"{solid}-slope"] = slope.wall(**surface)
        # Rolling without slip adds I/R² = k m to the inertia: a = g sin a/(1 + k).
        rolls[solid] = _Roll(slope, GRAVITY * slope.direction[1] / (1 + k))
    document = scene((1000, 270), 0.8, objects, walls)
    return [Case(document, partial(_rolling_error, rolls))]


def _rolling_error(rolls: Mapping[str, _Roll], run: Run) -> Errors:
    """Return the largest error of the distance at the end."""
    errors = []
    for solid, roll in rolls.items():
        track = run.track(solid)
        distance = track.displacements[-1] @ roll.slope.direction
        expected = roll.acceleration * track.times[-1] ** 2 / 2
        errors.append(abs(distance / expected - 1))
    return {"distance": worst(errors)}


def _slide_to_roll(draw: Draw) -> list[Case]:
    """Return the case of three round bodies with a sliding start."""
    objects = {}
    walls = {}
    final_velocities = {}
    times = []
    for j, (solid, k) in enumerate(INERTIA.items()):
        side = draw.sign()
        mu = draw.number(0.2, 0.5, 3)
        radius = draw.number(12, 28)
        speed = draw.number(100, 300, 0)
        y = 80 + 80 * j
        surface = {"friction": mu, "elasticity": draw.number(0, 0.5)}
        objects[solid] = circle(
            (320 - 260 * side, y - radius),
            radius,
            solid=solid,
            mass=draw.mass(),
            velocity=[side * speed, 0],
            **surface,
        )
        walls[f"{solid}-floor"] = segment((0, y), (640, y), **surface)
        # Angular momentum about the contact point is constant: v + k R w = v0.
        final_velocities[solid] = side * speed / (1 + k)
        # Friction decelerates with mu g until the body rolls.
        times.append(speed * k / ((1 + k) * mu * GRAVITY))
    # Rolling has begun for all bodies before the end of the clip.
    document = scene((640, 260), 1.1 * max(times) + 0.1, objects, walls)
    measure = partial(_final_speed_error, final_velocities)
    return [Case(document, measure)]


def _final_speed_error(final_velocities: Mapping[str, float], run: Run) -> Errors:
    """Return the largest error of a velocity to the right at the end."""
    errors = []
    for name, expected in final_velocities.items():
        velocity = run.track(name).velocities[-1, 0]
        errors.append(abs(velocity / expected - 1))
    return {"speed": worst(errors)}


@dataclass(frozen=True)
class _Brake:
    """A body with rolling resistance up to rest."""

    side: int
    """1 for a motion to the right, -1 to the left."""
    speed: float
    """px/s at t = 0."""
    deceleration: float
    """px/s²."""

    def time(self) -> float:
        """Return the time to rest, s."""
        return self.speed / self.deceleration


def _roll_to_rest(
    draw: Draw, solid: str, inertia: float, y: float
) -> tuple[Document, Document, _Brake]:
    """Return a round body, its floor at `y`, and its way to rest.

    `inertia` is the moment of inertia over m R².
    """
    side = draw.sign()
    radius = draw.number(12, 28)
    resistance = draw.number(0.06, 0.2, 3)
    time = draw.number(0.8, 1.5)
    # The moment c N R brakes the spin and, through friction, the speed.
    deceleration = resistance * GRAVITY / (1 + inertia)
    speed = round(deceleration * time, 1)
    surface = {"friction": 0.8, "elasticity": draw.number(0, 0.5)}
    # The first spin fits the speed, so that the body rolls from the beginning.
    body = circle(
        (250 - 210 * side, y - radius),
        radius,
        solid=solid,
        mass=draw.mass(),
        rolling=resistance,
        velocity=[side * speed, 0],
        spin=side * degrees(speed / radius),
        **surface,
    )
    floor = segment((0, y), (500, y), **surface)
    return body, floor, _Brake(side, speed, deceleration)


def _rolling_resistance(draw: Draw) -> list[Case]:
    """Return the case of three round bodies rolling to rest."""
    objects = {}
    walls = {}
    brakes = {}
    for j, (solid, inertia) in enumerate(INERTIA.items()):
        body, floor, brake = _roll_to_rest(draw, solid, inertia, 80 + 80 * j)
        objects[solid] = body
        walls[f"{solid}-floor"] = floor
        brakes[solid] = brake
    duration = max(brake.time() for brake in brakes.values()) + 0.1
    document = scene((500, 260), duration, objects, walls)
    measure = partial(_resistance_error, brakes)
    return [Case(document, measure)]


def _resistance_error(brakes: Mapping[str, _Brake], run: Run) -> Errors:
    """Return the largest error of the distance to rest, and of the speed after half the
    time over the first speed.
    """
    errors = []
    for name, brake in brakes.items():
        side = brake.side
        speed = brake.speed
        deceleration = brake.deceleration
        track = run.track(name)
        half_time = track.sample(speed / deceleration / 2)
        expected = speed - deceleration * track.times[half_time]
        errors.append(abs(side * track.velocities[half_time, 0] - expected) / speed)
        distance = side * track.displacements[-1, 0]
        errors.append(abs(distance * 2 * deceleration / speed**2 - 1))
    return {"motion": worst(errors)}


KNOT = 1 / 60
"""Time between the knots of the platform's script, s."""
KNOTS = 48
LATE = 0.8
"""Part of an interval after which the balls have the platform's motion."""


def _platform(draw: Draw) -> list[Case]:
    """Return the case of three round bodies on a scripted platform.

    The script's speed rises by a x KNOT at each knot. Friction of over twice a k/(1 +
    k) lets the balls catch up in less than half an interval. Then they have exactly
    k/(1 + k) of the platform's speed.
    """
    acceleration = draw.number(200, 500, 0)
    side = draw.sign()
    left = 570
    if side > 0:
        left = 330
    # The script contains the squares of the times, so that the speed rises at each
    # knot.
    path = []
    for n in range(KNOTS + 1):
        x = left + side * acceleration * (n * KNOT) ** 2 / 2
        path.append([round(n * KNOT, 9), x, 200.0])
    surface = {"friction": 1.5, "elasticity": 0.0}
    platform = box((left, 200), (600, 20), motion={"path": path}, **surface)
    objects = {"platform": platform}
    for j, solid in enumerate(INERTIA):
        radius = draw.number(12, 30)
        center = (left + (j - 1) * 130 - 60 * side, 190 - radius)
        objects[solid] = circle(
            center, radius, solid=solid, mass=draw.mass(), **surface
        )
    document = scene((900, 240), KNOTS * KNOT, objects)
    measure = partial(_platform_error, side * acceleration)
    return [Case(document, measure, rate=480)]


def _platform_error(acceleration: float, run: Run) -> Errors:
    """Return the largest deviation of a speed late in each interval of the script, over
    the last speed.
    """
    errors = []
    for solid, k in INERTIA.items():
        track = run.track(solid)
        samples = [track.sample((n + LATE) * KNOT) for n in range(KNOTS)]
        # Between two knots the platform has the mean speed of the interval.
        expected = acceleration * KNOT * (np.arange(KNOTS) + 0.5) * k / (1 + k)
        deviations = np.abs(track.velocities[samples, 0] - expected)
        errors.append(deviations.max() / abs(expected[-1]))
    return {"speed": worst(errors)}


ROWS = (
    Row(
        8, "rolling", "rolling down an incline, no slip", "a = g sin a/(1 + k): disc k = 1/2, sphere 2/5, hoop 1",
        "radii 10 to 26 px, slopes 10 to 35 degrees, mu 1, left and right",
        "Distance after 0.8 s over a t²/2.",
        (Measure("distance", 3e-3),), _rolling,
    ),
    Row(
        9, "slide-to-roll", "sliding to rolling on a floor", "v = v0/(1 + k): disc 2/3, sphere 5/7, hoop 1/2",
        "radii 12 to 28 px, 100 to 300 px/s, mu 0.2 to 0.5, both ways",
        "Speed at the end over its closed form.",
        (Measure("speed", 3e-3),), _slide_to_roll,
    ),
    Row(
        10, "rolling-resistance", "rolling resistance (moment c N R) on a flat floor",
        "a = c g/(1 + k), stops after v²/(2 a)",
        "disc, sphere and hoop of 12 to 28 px, c 0.06 to 0.2, at rest after 0.8 to 1.5 s, both ways",
        "Distance over its closed form; speed after half the time, its deviation over the first speed.",
        (Measure("motion", 1e-2),), _rolling_resistance,
    ),
    Row(
        32, "platform", "balls on a scripted platform that speeds up", "rolls without slip: a_ball = a k/(1 + k)",
        "disc, sphere and hoop of 12 to 30 px, a 200 to 500 px/s², left and right",
        "The script is straight between knots 1/60 s apart, so speeds are compared late in each interval, when the "
        "balls have caught up; deviation over the last speed. 0.3 %, as for rolling down an incline.",
        (Measure("speed", 3e-3),), _platform,
    ),
)  # fmt: skip
