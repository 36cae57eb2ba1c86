"""Rows of objects on belts and turntables, seen from above."""

from __future__ import annotations

from math import cos, degrees, pi, sin

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.physics.scorecard import (
    Case,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
)
from physgen.evaluate.physics.staging import GRAVITY, circle, scene

Array = NDArray[np.float64]

MIDDLE = np.array([320.0, 320.0])
"""Centre of the turntable, px."""
BALL_RATE = 2 / 7
"""Angular velocity of a rolling sphere's circle over the turntable's."""


def _belt(draw: Draw) -> Case:
    """Return the case of a puck on a belt. Errors: largest deviation of its path over
    the pick-up distance, and of the belt's work over m u².
    """
    mu, mass = draw.number(0.15, 0.6), draw.mass()
    angle, speed = draw.angle(), draw.number(80, 240, 0)
    way = np.array([cos(angle), sin(angle)])
    gain = mu * GRAVITY
    reach = speed**2 / (2 * gain)
    time = speed / gain
    puck = circle(MIDDLE, draw.number(12, 24), mass=mass, friction=mu)
    belt = {"belt": [0, 0, 640, 640], "velocity": (speed * way).tolist()}
    world = {"view": "top", "table": {"friction": mu}}

    def measure(run: Run) -> Errors:
        track = run.track("puck")
        rising = np.minimum(track.times, time)
        exact = gain * rising**2 / 2 + speed * (track.times - rising)
        off = np.abs(track.displacements @ way - exact).max()
        work = float(run.trajectory.energy.work[-1]) / (mass * speed**2)
        return {"way": float(off) / reach, "work": abs(work - 1)}

    fields = {"belt": belt}
    document = scene((640, 640), time + 0.3, {"puck": puck}, world=world, fields=fields)
    return Case(document, measure, "belt")


def _turntable(draw: Draw) -> Case:
    """Return the case of a rolling ball and a riding puck. Errors: largest deviations
    of their places over their circles.

    The ball's velocity turns with 2/7 of the table's rate (Earnshaw 1844), for every
    initial velocity.
    """
    turning = draw.sign() * draw.number(1.5, 3.0)
    rate = BALL_RATE * turning
    start = MIDDLE + draw.number(30, 60) * np.array([1.0, 0.0])
    speed = draw.number(0.6, 1.2) * 40
    heading = draw.angle()
    velocity = speed * np.array([cos(heading), sin(heading)])
    radius = draw.number(8, 14)
    slip = velocity - turning * (start - MIDDLE)[::-1] * (-1, 1)
    roll = np.degrees([slip[1] / radius, -slip[0] / radius])
    far, side = draw.number(160, 220), draw.angle()
    mu = draw.number(1.3, 2.0) * turning**2 * far / GRAVITY
    arm = far * np.array([cos(side), sin(side)])
    ride = turning * arm[::-1] * (-1, 1)
    objects = {
        "ball": circle(
            start,
            radius,
            solid="sphere",
            mass=draw.mass(),
            friction=mu,
            velocity=velocity.tolist(),
            roll=roll.tolist(),
            collides_with=["main"],
            collision_group="ball",
        ),
        "puck": circle(
            MIDDLE + arm,
            14,
            mass=draw.mass(),
            friction=mu,
            velocity=ride.tolist(),
            spin=degrees(turning),
            collides_with=["main"],
            collision_group="puck",
        ),
    }
    fields = {"disc": {"turntable": [320, 320, 310], "spin": degrees(turning)}}
    world = {"view": "top", "table": {"friction": mu}}
    duration = 2 * pi / abs(turning)

    def measure(run: Run) -> Errors:
        ball, puck = run.track("ball"), run.track("puck")
        turned = np.exp(1j * rate * ball.times)
        begun = complex(*velocity)
        place = complex(*start) + begun * (turned - 1) / (1j * rate)
        off = np.abs(ball.x + 1j * ball.y - place).max() * abs(rate) / speed
        circled = complex(*arm) * np.exp(1j * turning * puck.times)
        rode = np.abs(puck.x + 1j * puck.y - complex(*MIDDLE) - circled).max()
        return {"ball": float(off), "puck": float(rode) / far}

    document = scene((640, 640), duration, objects, world=world, fields=fields)
    return Case(document, measure, "turntable")


def _cases(draw: Draw) -> list[Case]:
    return [_belt(draw), _turntable(draw)]


ROWS = (
    Row(
        63, "carried", "from above: belt and turntable",
        "u²/(2 mu g) to the belt's speed; work m u²; a ball circles with 2/7 of the turntable",
        "belts at 80 to 240 px/s in any direction, mu 0.15 to 0.6; turntables of 1.5 to 3 rad/s either way, a ball "
        "at 24 to 48 px/s, a puck 160 to 220 px from the middle",
        "Way over the pick-up distance, work over its closed form, and places over the radius of their circles.",
        (Measure("way", 3e-3), Measure("work", 3e-3), Measure("ball", 3e-3), Measure("puck", 3e-3)), _cases,
    ),
)  # fmt: skip
