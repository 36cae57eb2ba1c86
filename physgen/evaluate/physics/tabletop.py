"""Rows of objects seen from above, on a table: pucks that slide and spin, balls that are struck, a break."""

from __future__ import annotations

from math import cos, degrees, inf, log, radians, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.physics.scorecard import (
    Case,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    Unit,
    worst,
)
from physgen.evaluate.physics.sliding_disc import Stop, stop
from physgen.evaluate.physics.staging import GRAVITY, box, circle, scene

Array = NDArray[np.float64]

STILL = 1e-3
"""Part of its first speed that a object at rest has at most."""


def _table(mu: float) -> dict[str, Any]:
    return {"view": "top", "table": {"friction": mu}}


def _break(draw: Draw) -> list[Case]:
    """Largest distance at any time between a ball and the mirror image of its partner across the axis."""
    overlap = 0.0 if draw.index in (0, 3) else 0.5
    rolling = draw.index % 2 == 0
    radius = draw.number(12, 16, 0)
    ball = {
        "solid": "sphere", "mass": draw.number(100, 200, 0), "friction": 0.06,
        "elasticity": draw.number(0.9, 0.98) if draw.index else 0.95,
    }  # fmt: skip
    apart, axis = 2 * radius - overlap, 300.0
    objects = {
        "cue": circle(
            (120, axis), radius, velocity=[draw.number(800, 1400, 0), 0], **ball
        )
    }
    mirrored = [("cue", "cue")]
    for i in range(5):
        for j in range(i + 1):
            at = (360 + i * apart * sqrt(0.75), axis + (j - i / 2) * apart)
            objects[f"ball-{i + 1}-{j + 1}"] = circle(at, radius, **ball)
            mirrored.append((f"ball-{i + 1}-{j + 1}", f"ball-{i + 1}-{i - j + 1}"))

    def measure(run: Run) -> Errors:
        off = 0.0
        for name, partner in mirrored:
            a, b = run.track(name).at, run.track(partner).at
            off = max(
                off,
                float(np.hypot(a[:, 0] - b[:, 0], a[:, 1] + b[:, 1] - 2 * axis).max()),
            )
        broken = all(
            np.hypot(*run.track(name).moved[-1]) > radius
            for name in ("ball-5-1", "ball-5-5")
        )
        return {"mirror": off if broken else 1000.0}

    return [
        Case(
            scene((1000, 600), 1.0, objects, world=_table(0.2 if rolling else 0.0)),
            measure,
        )
    ]


def _puck(draw: Draw) -> list[Case]:
    """Distance of the end from where the closed form puts it, over the distance."""
    mu = draw.number(0.2, 0.5, 3)
    objects, ends = {}, {}
    for k, name in enumerate(("disc", "plate")):
        angle, speed = (
            radians(draw.number(-70, 70, 0) + 180 * k),
            draw.number(150, 320, 0),
        )
        velocity = [speed * cos(angle), speed * sin(angle)]
        keys = {"mass": draw.mass(), "friction": mu, "velocity": velocity}
        at, size = (320 + 60 - 120 * k, 270), draw.number(12, 28)
        objects[name] = (
            circle(at, size, **keys)
            if k == 0
            else box(at, (2 * size, size), draw.number(0, 90, 0), **keys)
        )
        ends[name] = np.array(velocity) * speed / (2 * mu * GRAVITY)

    def measure(run: Run) -> Errors:
        errors = []
        for name, end in ends.items():
            track = run.track(name)
            off = np.hypot(*(track.moved[-1] - end)) / np.hypot(*end)
            errors.append(1.0 if track.speed[-1] > STILL * track.speed[0] else off)
        return {"distance": worst(errors)}

    duration = 320 / (mu * GRAVITY) + 0.1
    return [Case(scene((640, 540), duration, objects, world=_table(mu)), measure)]


def mean_distance(width: float, height: float) -> float:
    """px: of a rectangle's points from its middle. Times mu m g it is friction's moment, as 2/3 R is for a disc."""
    diagonal = sqrt(width**2 + height**2)
    along = width**2 / (2 * height) * log((height + diagonal) / width)
    across = height**2 / (2 * width) * log((width + diagonal) / height)
    return (diagonal + along + across) / 6


def _spinning(draw: Draw) -> list[Case]:
    """Angle turned to rest over its closed form; spin after half the time, its deviation over the first."""
    mu = draw.number(0.1, 0.3, 3)
    radius, width, height = (
        draw.number(16, 32),
        draw.number(30, 60),
        draw.number(30, 60),
    )
    objects, exact = {}, {}
    slowing = {
        "disc": 4 * mu * GRAVITY / (3 * radius),
        "plate": 12
        * mu
        * GRAVITY
        * mean_distance(width, height)
        / (width**2 + height**2),
    }
    for k, (name, deceleration) in enumerate(slowing.items()):
        spin = draw.sign() * round(degrees(deceleration * draw.number(0.6, 1.0)), 0)
        keys = {"mass": draw.mass(), "friction": mu, "spin": spin}
        at = (100 + 140 * k, 90)
        objects[name] = (
            circle(at, radius, **keys) if k == 0 else box(at, (width, height), **keys)
        )
        exact[name] = (radians(spin), deceleration)

    def measure(run: Run) -> Errors:
        errors = []
        for name, (spin, deceleration) in exact.items():
            track = run.track(name)
            half = track.sample(abs(spin) / deceleration / 2)
            slower = abs(spin) - deceleration * track.times[half]
            errors.append(abs(abs(track.spin[half]) - slower) / abs(spin))
            errors.append(
                abs(track.angle[-1] * 2 * deceleration / (spin * abs(spin)) - 1)
            )
            errors.append(1.0 if abs(track.spin[-1]) > STILL * abs(spin) else 0.0)
        return {"spin": worst(errors)}

    return [Case(scene((340, 180), 1.1, objects, world=_table(mu)), measure)]


FARKAS = (300.0, 15.0, 20.0, 0.25)
"""Speed px/s, spin rad/s, radius px and friction of the first disc of the first draw: slides 234 px."""


def _coupled(draw: Draw) -> list[Case]:
    """Distance, angle and times to rest over their closed forms; speed and spin at any time, over the first ones."""
    objects, exact = {}, {}
    mu = FARKAS[3] if draw.index == 0 else draw.number(0.15, 0.4, 3)
    for k, name in enumerate(("first", "second")):
        if draw.index == 0 and k == 0:
            speed, spin, radius, angle = *FARKAS[:3], 0.0
        else:
            speed, radius = draw.number(120, 300, 0), draw.number(15, 30)
            angle, spin = (
                radians(draw.number(-60, 60, 0)),
                speed / radius / draw.number(0.3, 3),
            )
        turn = draw.sign() * round(degrees(spin), 6)
        objects[name] = circle(
            (80, 160 + 240 * k), radius, mass=draw.mass(), friction=mu,
            velocity=[speed * cos(angle), speed * sin(angle)], spin=turn,
        )  # fmt: skip
        exact[name] = (angle, stop(speed, radians(turn), radius, mu, GRAVITY))

    def measure(run: Run) -> Errors:
        errors: list[float] = []
        for name, (angle, end) in exact.items():
            track = run.track(name)
            errors.append(
                np.hypot(*(track.moved[-1] / end.way - (cos(angle), sin(angle))))
            )
            errors.append(abs(track.angle[-1] / end.turned - 1))
            for motion, exactly in (
                (track.speed, end.speeds),
                (np.abs(track.spin), np.abs(end.spins)),
            ):
                errors.append(
                    _rest(track.times, motion) / end.times[-1] - 1
                )  # they stop together
                at_times = np.interp(track.times, end.times, exactly, right=0)
                errors.append(np.abs(motion - at_times).max() / motion[0])
        return {"motion": worst(np.abs(errors).tolist())}

    ends: list[Stop] = [end for _, end in exact.values()]
    duration = max(end.times[-1] for end in ends) + 0.1
    return [
        Case(scene((560, 540), duration, objects, world=_table(mu)), measure, rate=480)
    ]


def _rest(times: Array, motion: Array) -> float:
    """s at which a motion ends: it falls evenly at last, so the last two samples that have some of it tell."""
    last = int(np.flatnonzero(motion > STILL * motion[0])[-1])
    fall = (motion[last - 1] - motion[last]) / (times[last] - times[last - 1])
    return float(times[last] + motion[last] / fall) if fall > 0 else inf


def _struck(draw: Draw) -> list[Case]:
    """Deviation of the last velocity over the first speed of the ball that is struck."""
    return [_struck_balls(draw), _follow_shot(draw)]


def _struck_balls(draw: Draw) -> Case:
    """Back spin, top spin, and a roll across the way, which bends it; three lanes of one direction."""
    mu, turned = draw.number(0.15, 0.3, 3), draw.angle()
    lanes = {
        "back-spin": (-1.0, 0.0, -1),
        "top-spin": (1.8, 0.0, 0),
        "masse": (0.0, 1.0, 1),
    }
    objects, exact, longest = {}, {}, 0.0
    for name, (along, across, lane) in lanes.items():
        angle, speed, radius = (
            turned + radians(draw.number(-8, 8, 0)),
            draw.number(100, 250, 0),
            draw.number(12, 24),
        )
        part = draw.number(0.4, 1.0)
        velocity = speed * np.array([cos(angle), sin(angle)])
        natural = part * along * velocity + part * across * velocity[::-1] * (
            -1,
            1,
        )  # what its roll would go with
        at = (
            300 - 90 * cos(turned) - 110 * lane * sin(turned),
            300 - 90 * sin(turned) + 110 * lane * cos(turned),
        )
        objects[name] = circle(
            at, radius, solid="sphere", mass=draw.mass(), friction=mu, velocity=velocity.tolist(),
            roll=[round(degrees(natural[1] / radius), 9), round(degrees(-natural[0] / radius), 9)],
        )  # fmt: skip
        exact[name] = (5 * velocity + 2 * natural) / 7
        longest = max(
            longest, 2 * float(np.hypot(*(velocity - natural))) / (7 * mu * GRAVITY)
        )

    def measure(run: Run) -> Errors:
        tracks = {name: run.track(name) for name in exact}
        return {
            "roll": worst(
                [
                    np.hypot(*(t.velocity[-1] - exact[name])) / t.speed[0]
                    for name, t in tracks.items()
                ]
            )
        }

    return Case(
        scene((600, 600), longest + 0.1, objects, world=_table(mu)), measure, "struck"
    )


def _follow_shot(draw: Draw) -> Case:
    """A rolling cue ball meets another head-on.

    A pair's coefficient is a geometric mean, so a table of 10 and balls of mu²/10 give mu on the table and next to
    nothing between the balls, which would spoil the closed form by mu²/10.
    """
    mu = draw.number(0.15, 0.3, 3)
    angle, speed, radius = (
        radians(draw.number(-25, 25, 0)),
        draw.number(200, 320, 0),
        draw.number(12, 20),
    )
    ball = {
        "solid": "sphere",
        "mass": draw.mass(),
        "friction": mu**2 / 10,
        "elasticity": 1.0,
    }
    way = np.array([cos(angle), sin(angle)])
    objects = {
        "cue": circle((60, 180), radius, velocity=(speed * way).tolist(), **ball),
        "object-ball": circle(way * (2 * radius + 40) + (60, 180), radius, **ball),
    }

    def measure(run: Run) -> Errors:
        ends = (("cue", 2 / 7), ("object-ball", 5 / 7))
        off = [run.track(name).velocity[-1] - part * speed * way for name, part in ends]
        return {"follow shot": worst(np.hypot(*np.transpose(off)) / speed)}

    duration = 40 / speed + 2 * speed / (7 * mu * GRAVITY) + 0.1
    return Case(
        scene((460, 360), duration, objects, world=_table(10.0)), measure, "follow"
    )


ROWS = (
    Row(
        15, "break", "15-ball break, cue on the axis, rack touching or overlapping by 0.5 px", "mirror symmetry",
        "balls of 12 to 16 px, 800 to 1400 px/s, e 0.9 to 0.98; on a table with friction and rolling, or without",
        "Largest distance at any time within 1 s between a ball and the mirror image of its partner.",
        (Measure("mirror", 0.5, Unit.PX),), _break,
    ),
    Row(
        18, "puck", "from above: puck sliding without spin", "d = v²/(2 mu g)",
        "a disc and a plate of 12 to 28 px, any direction, 150 to 320 px/s, mu 0.2 to 0.5",
        "Distance of the end from where it should be, over the distance.",
        (Measure("distance", 3e-3),), _puck,
    ),
    Row(
        19, "spinning", "from above: disc spinning in place", "spin falls at 4 mu g/(3 R)",
        "a disc of 16 to 32 px and a plate of 30 to 60 px a side, at rest after 0.6 to 1 s, mu 0.1 to 0.3",
        "Angle turned over its closed form; spin after half the time. For a plate, 2/3 R is its points' mean distance "
        "from the middle.",
        (Measure("spin", 1e-2),), _spinning,
    ),
    Row(
        20, "coupled", "from above: disc sliding and spinning",
        "coupled by the elliptic integrals of Farkas et al. 2003; they stop together",
        "two discs of 15 to 30 px, 120 to 300 px/s, v/(R w) 0.3 to 3, mu 0.15 to 0.4; the first: 300 px/s, 15 rad/s, "
        "R = 20, mu = 0.25 slides 234 px",
        "Distance, angle and both times to rest over their closed forms; speed and spin at any time, over the first "
        "ones.",
        (Measure("motion", 2e-2),), _coupled,
    ),
    Row(
        21, "struck-ball", "from above: sphere struck with v0 and spin w0; follow shot", "rolls at (5 v0 + 2 R w0)/7; "
        "cue ends at 2/7 v, object ball at 5/7 v",
        "back spin, top spin and a roll across, any direction, 100 to 320 px/s, 12 to 24 px, mu 0.15 to 0.3",
        "Deviation of the last velocity over the struck ball's first speed.",
        (Measure("roll", 1e-2), Measure("follow shot", 1e-2)), _struck,
    ),
)  # fmt: skip
