"""Rows of free flight: falling, thrown, bouncing, and falling through air."""

from __future__ import annotations

from math import ceil, cos, radians, sin, sqrt
from typing import Any

import numpy as np

from physgen.evaluate.physics.events import flights
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


def _free_fall(draw: Draw) -> list[Case]:
    """Deviation from g t²/2 at any time, as a part of the whole fall."""
    gravity = draw.number(300, 1500, 0)
    objects = {
        "ball": circle((80, draw.number(30, 60)), draw.number(8, 28), mass=draw.mass(), spin=draw.number(-400, 400, 0)),
        "box": box(
            (180, draw.number(30, 60)),
            (draw.number(20, 50), draw.number(20, 50)),
            draw.number(0, 90, 0),
            mass=draw.mass(),
            spin=draw.number(-400, 400, 0),
        ),
        "hoop": circle((280, draw.number(30, 60)), draw.number(8, 28), mass=draw.mass(), solid="hoop"),
    }  # fmt: skip

    def measure(run: Run) -> Errors:
        errors = []
        for name in objects:
            track = run.track(name)
            fall = gravity * track.times**2 / 2
            off = np.hypot(track.moved[:, 0], track.moved[:, 1] - fall)
            errors.append(off.max() / fall[-1])
        return {"fall": worst(errors)}

    size = (360, 100 + ceil(gravity / 2 / 20) * 20)
    return [Case(scene(size, 1.0, objects, world={"gravity": [0, gravity]}), measure)]


def _projectile(draw: Draw) -> list[Case]:
    """Distance from the parabola at any time, as a part of the path flown by then."""
    throws = {
        "ball": (draw.number(300, 600, 0), draw.number(35, 75, 0)),
        "box": (draw.number(300, 600, 0), draw.number(105, 145, 0)),
    }
    objects = {}
    for name, (speed, degrees) in throws.items():
        keys: dict[str, Any] = {
            "mass": draw.mass(),
            "velocity": [speed * cos(radians(degrees)), -speed * sin(radians(degrees))],
            "spin": draw.number(-400, 400, 0),
        }
        size = draw.number(10, 20)
        ball = name == "ball"
        objects[name] = (
            circle((500, 220), size, **keys)
            if ball
            else box((430, 220), (2 * size, size), **keys)
        )

    def measure(run: Run) -> Errors:
        errors = []
        for name, (speed, degrees) in throws.items():
            track = run.track(name)
            t = track.times
            vx, vy = speed * cos(radians(degrees)), speed * sin(radians(degrees))
            exact = np.stack([vx * t, GRAVITY * t**2 / 2 - vy * t], axis=1)
            path = np.hypot(*np.diff(exact, axis=0).T).cumsum()
            errors.append((np.hypot(*(track.moved - exact)[1:].T) / path).max())
        return {"path": worst(errors)}

    return [Case(scene((930, 440), 1.0, objects), measure)]


def _bounce(draw: Draw) -> list[Case]:
    """Speed and height after the first bounce, each against what e makes of those before, at the height of contact."""
    drops = {
        f"ball-{int(e * 10)}": (e, draw.number(100, 260, 1), draw.number(8, 26))
        for e in (0.3, 0.5, 0.8, 1.0)
    }
    objects, pads = {}, {}
    for k, (name, (e, height, radius)) in enumerate(drops.items()):
        x, surface = 70 + 130 * k, {"friction": 0.5, "elasticity": e}
        objects[name] = circle(
            (x, 360 - height - radius), radius, mass=draw.mass(), **surface
        )
        pads[name.replace("ball", "pad")] = segment(
            (x - 55, 360), (x + 55, 360), **surface
        )

    def measure(run: Run) -> Errors:
        speeds, heights = [], []
        for name, (e, height, radius) in drops.items():
            parts = flights(run.track(name), 360 - radius, GRAVITY)
            if len(parts) < 2:
                return {"speed": 1.0, "height": 1.0}
            speeds.append(abs(parts[1].leaving / parts[0].landing / e - 1))
            heights.append(abs(parts[1].apex / (e * e * height) - 1))
        return {"speed": worst(speeds), "height": worst(heights)}

    duration = 2.1 * sqrt(2 * max(height for _, height, _ in drops.values()) / GRAVITY)
    return [Case(scene((530, 400), duration, objects, pads), measure)]


BOUNCES = 4


def _bounces(draw: Draw) -> list[Case]:
    """Length of each of the first four flights, from landing to landing."""
    drops = {
        f"ball-{k}": (
            draw.number(low, low + 0.1, 3),
            draw.number(150, 250, 1),
            draw.number(8, 26),
        )
        for k, low in enumerate((0.5, 0.6, 0.7), 1)
    }
    objects, pads = {}, {}
    for k, (name, (e, height, radius)) in enumerate(drops.items()):
        x, surface = 80 + 150 * k, {"friction": 0.5, "elasticity": e}
        objects[name] = circle(
            (x, 330 - height - radius), radius, mass=draw.mass(), **surface
        )
        pads[name.replace("ball", "pad")] = segment(
            (x - 60, 330), (x + 60, 330), **surface
        )

    def measure(run: Run) -> Errors:
        errors = []
        for name, (e, height, radius) in drops.items():
            parts = flights(run.track(name), 330 - radius, GRAVITY)
            if len(parts) <= BOUNCES:
                return {"times": 1.0}
            for n in range(1, BOUNCES + 1):
                exact = 2 * sqrt(2 * height / GRAVITY) * e**n
                errors.append(abs((parts[n].end - parts[n - 1].end) / exact - 1))
        return {"times": worst(errors)}

    longest = max(
        sqrt(2 * h / GRAVITY) * (1 + 2 * sum(e**n for n in range(1, BOUNCES + 1)))
        for e, h, _ in drops.values()
    )
    return [Case(scene((460, 360), longest + 0.05, objects, pads), measure, rate=480)]


def _air(draw: Draw) -> list[Case]:
    """Speed and distance at any time, over their last values; in every other draw a wind in place of gravity."""
    blown = draw.index % 2 == 1
    wind = draw.number(150, 400, 0)
    drag = draw.number(0.02, 0.08, 4)
    bodies = {
        "ball": (draw.number(10, 25), draw.mass()),
        "box": (draw.number(20, 40), draw.mass()),
    }
    objects = {
        "ball": circle((60, 60), bodies["ball"][0], mass=bodies["ball"][1]),
        "box": box((60, 150) if blown else (140, 60), (bodies["box"][0],) * 2, mass=bodies["box"][1]),
    }  # fmt: skip
    widths = {"ball": 2 * bodies["ball"][0], "box": 2 * bodies["box"][0] / sqrt(np.pi)}

    def measure(run: Run) -> Errors:
        errors = []
        for name, (_, mass) in bodies.items():
            track = run.track(name)
            t, k = track.times, drag * widths[name] / mass
            if blown:  # u' = -k u², u = wind - v
                speed = wind - wind / (1 + wind * k * t)
                way = wind * t - np.log1p(wind * k * t) / k
            else:
                final = sqrt(GRAVITY / k)
                speed = final * np.tanh(GRAVITY * t / final)
                way = final**2 / GRAVITY * np.log(np.cosh(GRAVITY * t / final))
            axis = 0 if blown else 1
            errors.append(np.abs(track.velocities[:, axis] - speed).max() / speed[-1])
            errors.append(np.abs(track.moved[:, axis] - way).max() / way[-1])
        return {"motion": worst(errors)}

    field = {"air": {"wind": [wind, 0] if blown else [0, 0], "drag": drag}}
    world = {"gravity": [0, 0]} if blown else {}
    return [
        Case(
            scene(
                (420, 220) if blown else (220, 580),
                1.0,
                objects,
                world=world,
                fields=field,
            ),
            measure,
        )
    ]


ROWS = (
    Row(
        1, "free-fall", "free fall", "y = g t²/2",
        "a ball, a box and a hoop; sizes 8 to 28 px, 20 to 500 g, spins to 400 degrees/s, g 300 to 1500 px/s²; 1 s",
        "Largest deviation at any time over the whole fall. Steps of v += g dt, x += v dt are off by dt/t.",
        (Measure("fall", 1e-4),), _free_fall,
    ),
    Row(
        2, "projectile", "projectile, at any time", "x = v t cos a, y = g t²/2 - v t sin a",
        "a ball and a box thrown at 300 to 600 px/s, 35 to 75 degrees, turning; 1 s",
        "Distance from the parabola over the length flown by then, the largest.",
        (Measure("path", 1e-3),), _projectile,
    ),
    Row(
        3, "bounce", "bounce, e = 0.3, 0.5, 0.8, 1", "speed after = e x speed before; height e² h",
        "balls of 8 to 26 px and 20 to 500 g dropped from 100 to 260 px",
        "Speeds are taken at the height of contact, by the energy of free fall from samples beside the bounce.",
        (Measure("speed", 1e-3), Measure("height", 1e-2)), _bounce,
    ),
    Row(
        4, "bounces", "four bounces", "flight n lasts (2 v/g) e^n",
        "three balls, e 0.5 to 0.8, dropped from 150 to 250 px",
        "From landing to landing, each against its own length. A bounce put off to the end of its step adds up.",
        (Measure("times", 1e-2),), _bounces,
    ),
    Row(
        35, "air", "falling through air; a wind from the side", "v = v_t tanh(g t/v_t), v_t = sqrt(m g/(drag x width))",
        "a ball of 10 to 25 px and a box of 20 to 40 px, 20 to 500 g, drag 0.02 to 0.08 g/px²; wind 150 to 400 px/s",
        "Speed and distance over their last values. The force is smooth, so only the integrator can err: 0.3 %, as for "
        "sliding. Width is that of the disc of equal area; the wind's form is w - w/(1 + w k t).",
        (Measure("motion", 3e-3),), _air,
    ),
)  # fmt: skip
