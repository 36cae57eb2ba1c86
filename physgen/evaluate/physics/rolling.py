"""Rows of round objects that roll: down slopes, out of a slide, to rest, and on a platform that speeds up."""

from __future__ import annotations

from math import degrees, tan

import numpy as np

from physgen.evaluate.physics.scorecard import (
    Case,
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


def _down(draw: Draw) -> list[Case]:
    """Distance down the slope after 0.8 s."""
    objects, walls, slopes = {}, {}, {}
    for j, (solid, k) in enumerate(INERTIA.items()):
        side, tangent, radius = (
            draw.sign(),
            tan(np.radians(draw.number(10, 35))),
            draw.number(10, 26),
        )
        surface = {"friction": 1.0, "elasticity": draw.number(0, 0.5)}
        slope = Slope((70 + 320 * j + (0 if side > 0 else 230), 70), tangent, side, 270)
        objects[solid] = circle(
            slope.point(30, radius), radius, solid=solid, mass=draw.mass(), **surface
        )
        walls[f"{solid}-slope"] = slope.wall(**surface)
        slopes[solid] = (slope, GRAVITY * slope.down[1] / (1 + k))

    def measure(run: Run) -> Errors:
        errors = []
        for solid, (slope, acceleration) in slopes.items():
            track = run.track(solid)
            way = track.moved[-1] @ slope.down
            errors.append(abs(way / (acceleration * track.times[-1] ** 2 / 2) - 1))
        return {"distance": worst(errors)}

    return [Case(scene((1000, 270), 0.8, objects, walls), measure)]


def _out_of_a_slide(draw: Draw) -> list[Case]:
    """Speed when the sliding has ended."""
    objects, walls, exact, times = {}, {}, {}, []
    for j, (solid, k) in enumerate(INERTIA.items()):
        side, mu, radius = draw.sign(), draw.number(0.2, 0.5, 3), draw.number(12, 28)
        speed, y = draw.number(100, 300, 0), 80 + 80 * j
        surface = {"friction": mu, "elasticity": draw.number(0, 0.5)}
        at = (320 - 260 * side, y - radius)
        objects[solid] = circle(
            at,
            radius,
            solid=solid,
            mass=draw.mass(),
            velocity=[side * speed, 0],
            **surface,
        )
        walls[f"{solid}-floor"] = segment((0, y), (640, y), **surface)
        exact[solid] = side * speed / (1 + k)
        times.append(speed * k / ((1 + k) * mu * GRAVITY))

    def measure(run: Run) -> Errors:
        return {
            "speed": worst(
                [
                    abs(run.track(name).velocities[-1, 0] / v - 1)
                    for name, v in exact.items()
                ]
            )
        }

    return [Case(scene((640, 260), 1.1 * max(times) + 0.1, objects, walls), measure)]


def _resisted(draw: Draw) -> list[Case]:
    """Distance to rest, and speed after half the time that it takes, over the first speed."""
    objects, walls, exact = {}, {}, {}
    for j, (solid, k) in enumerate(INERTIA.items()):
        side, radius, y = draw.sign(), draw.number(12, 28), 80 + 80 * j
        resistance, time = draw.number(0.06, 0.2, 3), draw.number(0.8, 1.5)
        deceleration = resistance * GRAVITY / (1 + k)
        speed = round(deceleration * time, 1)
        surface = {"friction": 0.8, "elasticity": draw.number(0, 0.5)}
        objects[solid] = circle(
            (250 - 210 * side, y - radius), radius, solid=solid, mass=draw.mass(), rolling=resistance,
            velocity=[side * speed, 0], spin=side * degrees(speed / radius), **surface,
        )  # fmt: skip
        walls[f"{solid}-floor"] = segment((0, y), (500, y), **surface)
        exact[solid] = (side, speed, deceleration)

    def measure(run: Run) -> Errors:
        errors = []
        for name, (side, speed, deceleration) in exact.items():
            track = run.track(name)
            half = track.sample(speed / deceleration / 2)
            slower = speed - deceleration * track.times[half]
            errors.append(abs(side * track.velocities[half, 0] - slower) / speed)
            errors.append(
                abs(side * track.moved[-1, 0] * 2 * deceleration / speed**2 - 1)
            )
        return {"motion": worst(errors)}

    duration = (
        max(speed / deceleration for _, speed, deceleration in exact.values()) + 0.1
    )
    return [Case(scene((500, 260), duration, objects, walls), measure)]


KNOT = 1 / 60
"""s between the knots of the platform's script."""


def _on_a_platform(draw: Draw) -> list[Case]:
    """Speed of each ball late in each interval of the script, over the last speed.

    The script's speed rises by a x KNOT at each knot; friction of over twice a k/(1 + k) lets the balls catch up in
    less than half an interval, and then they have exactly k/(1 + k) of the platform's speed.
    """
    acceleration, side = draw.number(200, 500, 0), draw.sign()
    knots = 48
    left = 330 if side > 0 else 570
    path = [
        [round(n * KNOT, 9), left + side * acceleration * (n * KNOT) ** 2 / 2, 200.0]
        for n in range(knots + 1)
    ]
    surface = {"friction": 1.5, "elasticity": 0.0}
    objects = {
        "platform": box((left, 200), (600, 20), motion={"path": path}, **surface)
    }
    for j, solid in enumerate(INERTIA):
        radius = draw.number(12, 30)
        objects[solid] = circle(
            (left + (j - 1) * 130 - 60 * side, 190 - radius),
            radius,
            solid=solid,
            mass=draw.mass(),
            **surface,
        )

    def measure(run: Run) -> Errors:
        errors = []
        for solid, k in INERTIA.items():
            track = run.track(solid)
            late = [track.sample((n + 0.8) * KNOT) for n in range(knots)]
            exact = side * acceleration * KNOT * (np.arange(knots) + 0.5) * k / (1 + k)
            errors.append(
                np.abs(track.velocities[late, 0] - exact).max() / abs(exact[-1])
            )
        return {"speed": worst(errors)}

    return [Case(scene((900, 240), knots * KNOT, objects), measure, rate=480)]


ROWS = (
    Row(
        8, "rolling", "rolling down an incline, no slip", "a = g sin a/(1 + k): disc k = 1/2, sphere 2/5, hoop 1",
        "radii 10 to 26 px, slopes 10 to 35 degrees, mu 1, left and right",
        "Distance after 0.8 s over a t²/2.",
        (Measure("distance", 3e-3),), _down,
    ),
    Row(
        9, "slide-to-roll", "sliding to rolling on a floor", "v = v0/(1 + k): disc 2/3, sphere 5/7, hoop 1/2",
        "radii 12 to 28 px, 100 to 300 px/s, mu 0.2 to 0.5, both ways",
        "Speed at the end over its closed form.",
        (Measure("speed", 3e-3),), _out_of_a_slide,
    ),
    Row(
        10, "rolling-resistance", "rolling resistance (moment c N R) on a flat floor",
        "a = c g/(1 + k), stops after v²/(2 a)",
        "disc, sphere and hoop of 12 to 28 px, c 0.06 to 0.2, at rest after 0.8 to 1.5 s, both ways",
        "Distance over its closed form; speed after half the time, its deviation over the first speed.",
        (Measure("motion", 1e-2),), _resisted,
    ),
    Row(
        32, "platform", "balls on a scripted platform that speeds up", "rolls without slip: a_ball = a k/(1 + k)",
        "disc, sphere and hoop of 12 to 30 px, a 200 to 500 px/s², left and right",
        "The script is straight between knots 1/60 s apart, so speeds are compared late in each interval, when the "
        "balls have caught up; deviation over the last speed. 0.3 %, as for rolling down an incline.",
        (Measure("speed", 3e-3),), _on_a_platform,
    ),
)  # fmt: skip
