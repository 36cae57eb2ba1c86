"""Rows of bodies held by pins, springs, welds and motors."""

from __future__ import annotations

from math import cos, exp, pi, radians, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.physics.elliptic import complete, runge_kutta
from physgen.evaluate.physics.events import crossings
from physgen.evaluate.physics.scorecard import (
    Case,
    Document,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    Unit,
    worst,
)
from physgen.evaluate.physics.staging import GRAVITY, INERTIA, box, circle, scene

Array = NDArray[np.float64]

FLOATING = {"gravity": [0, 0]}


def _pendulum(draw: Draw) -> list[Case]:
    """Deviation of the times of the first three passes through the lowest point, over the period."""
    objects: dict[str, Document] = {}
    joints, periods = {}, {}
    for k, name in enumerate(("bob", "rod")):
        swing, side = draw.number((20, 80)[k], (80, 130)[k], 1), draw.sign()
        pivot = np.array([130.0 + 310 * k, 190.0])
        arm, mass = draw.number(50, 90, 1), draw.mass()
        out = np.array([side * sin(radians(swing)), cos(radians(swing))])
        at = pivot + arm * out
        if name == "bob":
            radius = draw.number(14, 26)
            objects[name] = circle(at, radius, mass=mass)
            moment = mass * radius**2 / 2
        else:
            size = (draw.number(10, 20), round(2 * arm + 10, 1))
            objects[name] = box(at, size, -side * swing, mass=mass)
            moment = mass * (size[0] ** 2 + size[1] ** 2) / 12
        joints[f"{name}-pin"] = {"objects": [name], "pivot": pivot.tolist()}
        full = (
            4
            * sqrt((moment + mass * arm**2) / (mass * GRAVITY * arm))
            * complete(sin(radians(swing / 2)))[0]
        )
        periods[name] = (full, side * radians(swing))

    def measure(run: Run) -> Errors:
        errors = []
        for name, (period, swing) in periods.items():
            track = run.track(name)
            passes = crossings(
                track.times, track.angle - swing, track.spin
            )  # hanging is turned back by the swing
            exact = (np.arange(3) + 0.5) * period / 2
            if len(passes) < 3:
                return {"period": 1.0}
            errors.append(np.abs(passes[:3] - exact).max() / period)
        return {"period": worst(errors)}

    duration = 1.3 * max(period for period, _ in periods.values())
    return [Case(scene((640, 390), duration, objects, joints=joints), measure)]


def _springs(draw: Draw) -> list[Case]:
    """Frequency and amplitude at the end over their closed forms.

    With x the stretch, d = c/(2 m) and w² = k/m - d², the pair x and (x' + d x)/w goes round a circle that shrinks as
    e to the -d t: its angle is the phase and its radius the amplitude, at any time. The lowest of three lanes has a
    body at either end, which swing against each other with m = m1 m2/(m1 + m2).
    """
    objects, joints, exact = {}, {}, {}
    for k, (lane, part) in enumerate(
        {"free": 0.0, "damped": draw.number(0.03, 0.1, 3), "pair": 0.0}.items()
    ):
        y, mass, rest = 80.0 + 110 * k, draw.mass(), draw.number(120, 160, 0)
        stretch, frequency = draw.sign() * draw.number(20, 50, 0), draw.number(1.5, 3)
        other = draw.mass() if lane == "pair" else 0.0
        reduced = mass * other / (mass + other) if other else mass
        stiffness = round(reduced * (2 * pi * frequency) ** 2, 2)
        damping = round(2 * part * sqrt(stiffness * reduced), 3)
        anchor, at = [60.0, y], [60.0 + rest + stretch, y]
        objects[lane] = circle(at, draw.number(12, 22), mass=mass)
        if other:
            objects["partner"] = box(anchor, (30, 30), mass=other)
        joints[f"{lane}-spring"] = {
            "objects": [lane, "partner"] if other else [lane],
            "spring": [at, anchor], "stiffness": stiffness, "damping": damping, "length": rest,
        }  # fmt: skip
        decay = damping / (2 * reduced)
        exact[lane] = (rest, decay, sqrt(stiffness / reduced - decay**2))

    def measure(run: Run) -> Errors:
        frequencies, amplitudes = [], []
        for lane, (rest, decay, omega) in exact.items():
            track = run.track(lane)
            x, rate = track.x - 60 - rest, track.velocities[:, 0]
            if lane == "pair":
                partner = run.track("partner")
                x, rate = x + 60 - partner.x, rate - partner.velocities[:, 0]
            aside = (rate + decay * x) / omega
            time = track.times[-1]
            phase = np.unwrap(np.arctan2(-aside, x))
            size = np.hypot(x, aside)
            frequencies.append(abs((phase[-1] - phase[0]) / (omega * time) - 1))
            amplitudes.append(abs(size[-1] / size[0] * exp(decay * time) - 1))
        return {"frequency": worst(frequencies), "amplitude": worst(amplitudes)}

    return [
        Case(scene((360, 380), 2.0, objects, world=FLOATING, joints=joints), measure)
    ]


def _seesaw(draw: Draw) -> list[Case]:
    """Angle and spin after 0.5 s against the motion of one rigid body; 1 where the balance tips to the wrong side.

    Moment x angular acceleration = torque: (J) a'' = g (m2 d2 - m1 d1) cos a + g (m1 h1 + m2 h2) sin a, for weights at
    d to the left and right of the pin and h above it, J with all parallel axes. Three see-saws: one far from balance,
    two with moments of 0.99 and 1.01.
    """
    objects: dict[str, Document] = {}
    joints, exact = {}, {}
    surface = {"friction": 0.9, "elasticity": 0.0}
    for k, name in enumerate(("light", "heavy", "far")):
        part = (0.99, 1.01, draw.number(1.1, 1.25))[k]
        pin = np.array([180.0 + 320 * k, 150.0])
        plank, own = (draw.number(220, 260, 0), draw.number(8, 14, 0)), draw.mass()
        left, first, second = (
            draw.number(60, 90, 1),
            draw.number(22, 34, 0),
            draw.number(22, 34, 0),
        )
        mass = draw.number(60, 200, 0)
        right, other = draw.number(60, 90, 1), 0.0
        other = part * mass * left / right
        heights = plank[1] / 2 + first / 2, plank[1] / 2 + second / 2
        objects[f"{name}-plank"] = box(pin, plank, mass=own, **surface)
        objects[f"{name}-left"] = box(
            (pin[0] - left, pin[1] - heights[0]), (first, first), mass=mass, **surface
        )
        objects[f"{name}-right"] = box(
            (pin[0] + right, pin[1] - heights[1]),
            (second, second),
            mass=other,
            **surface,
        )
        joints[f"{name}-pin"] = {"objects": [f"{name}-plank"], "pivot": pin.tolist()}
        moment = (
            own * (plank[0] ** 2 + plank[1] ** 2) / 12
            + mass * (left**2 + heights[0] ** 2 + first**2 / 6)
            + other * (right**2 + heights[1] ** 2 + second**2 / 6)
        )
        torque = GRAVITY * (other * right - mass * left)
        tilting = GRAVITY * (mass * heights[0] + other * heights[1])
        exact[name] = (torque / moment, tilting / moment)

    time = 0.4

    def measure(run: Run) -> Errors:
        ends = {name: run.track(f"{name}-plank") for name in exact}
        a, b = exact["far"]

        def rate(state: Array) -> Array:
            return np.array([state[1], a * cos(state[0]) + b * sin(state[0])])

        angle, spin = runge_kutta(rate, np.zeros(2), time, 400)[-1]
        end = ends["far"].sample(time)
        turned = (
            abs(ends["far"].angle[end] / angle - 1),
            abs(ends["far"].spin[end] / spin - 1),
        )
        tipped = ends["light"].angle[-1] < 0 < ends["heavy"].angle[-1]
        return {"acceleration": worst(turned), "balance": float(not tipped)}

    return [Case(scene((1000, 300), 1.0, objects, joints=joints), measure)]


def _motor(draw: Draw) -> list[Case]:
    """Largest deviation of the spin at any time, over the speed that the motor is set to.

    One wheel is on the world, of the other pair both turn: the motor's moment acts on each, with 1/I = 1/I1 + 1/I2.
    """
    objects, joints, exact = {}, {}, {}
    for k, name in enumerate(("wheel", "fan")):
        at, radius, mass = [110.0 + 200 * k, 110.0], draw.number(30, 55), draw.mass()
        solid = ("disc", "hoop", "sphere")[draw.count(0, 2)]
        inverse = 1 / (INERTIA[solid] * mass * radius**2)
        objects[name] = circle(at, radius, solid=solid, mass=mass)
        partner = []
        if name == "fan":
            size, other = (draw.number(30, 60), draw.number(90, 140)), draw.mass()
            objects["base"] = box(at, size, mass=other)
            inverse += 12 / (other * (size[0] ** 2 + size[1] ** 2))
            partner = ["base"]
        speed, time = draw.sign() * draw.number(300, 900, 0), draw.number(0.4, 0.8, 3)
        limit = radians(abs(speed)) / time / inverse
        joints[f"{name}-motor"] = {
            "objects": [name, *partner],
            "motor": at,
            "speed": speed,
            "limit": limit,
        }
        exact[name] = (radians(speed), time)

    def measure(run: Run) -> Errors:
        errors = []
        for name, (speed, time) in exact.items():
            track = run.track(name)
            spin = track.spin - (run.track("base").spin if name == "fan" else 0.0)
            errors.append(
                np.abs(spin / speed - np.minimum(track.times / time, 1)).max()
            )
        return {"spin": worst(errors)}

    return [
        Case(scene((420, 220), 1.0, objects, world=FLOATING, joints=joints), measure)
    ]


def _weld(draw: Draw) -> list[Case]:
    """Deviation of both bodies' spins and of their common middle's velocity, over what one rigid body gets.

    A ball at v hits the flush side of two welded boxes b beside their middle, without friction: the impulse is
    (1 + e) v/(1/m + 1/M + b²/I) with I about the common middle, by the parallel-axis theorem.
    """
    e, speed, m, radius = (
        draw.number(0.2, 1.0),
        draw.number(150, 300, 0),
        draw.mass(),
        draw.number(10, 18),
    )
    surface = {"friction": 0.0, "elasticity": e}
    sizes = [(draw.number(24, 60, 0), draw.number(50, 80, 0)) for _ in range(2)]
    masses = [draw.mass(), draw.mass()]
    side, x, seam = draw.sign(), 260.0, 180.0
    middles = [
        np.array([x + side * sizes[0][0] / 2, seam - sizes[0][1] / 2]),
        np.array([x + side * sizes[1][0] / 2, seam + sizes[1][1] / 2]),
    ]
    total = sum(masses)
    common = (masses[0] * middles[0] + masses[1] * middles[1]) / total
    moment = sum(
        mass * ((w * w + h * h) / 12 + float((at - common) @ (at - common)))
        for mass, (w, h), at in zip(masses, sizes, middles, strict=True)
    )
    y = (
        seam - draw.number(0.4, 0.9) * sizes[0][1]
        if draw.sign() > 0
        else seam + draw.number(0.4, 0.9) * sizes[1][1]
    )
    objects: dict[str, Document] = {
        "ball": circle(
            (x - side * 120, y), radius, mass=m, velocity=[side * speed, 0], **surface
        ),
        "upper": box(middles[0], sizes[0], mass=masses[0], **surface),
        "lower": box(middles[1], sizes[1], mass=masses[1], **surface),
    }
    joints = {
        "weld": {
            "objects": ["upper", "lower"],
            "weld": [x + side * min(sizes[0][0], sizes[1][0]) / 2, seam],
        }
    }
    aside = y - common[1]
    impulse = side * (1 + e) * speed / (1 / m + 1 / total + aside**2 / moment)
    velocity, spin = np.array([impulse / total, 0.0]), -aside * impulse / moment

    def measure(run: Run) -> Errors:
        upper, lower = run.track("upper"), run.track("lower")
        after = upper.sample(
            (120 - radius) / speed + 0.1
        )  # before the boxes can swing into the ball again
        moved = (
            masses[0] * upper.velocity[after] + masses[1] * lower.velocity[after]
        ) / total
        return {
            "spin": worst(
                [abs(track.spin[after] / spin - 1) for track in (upper, lower)]
            ),
            "velocity": float(np.hypot(*(moved - velocity)) / np.hypot(*velocity)),
        }

    return [
        Case(scene((520, 360), 1.1, objects, world=FLOATING, joints=joints), measure)
    ]


ROWS = (
    Row(
        28, "pendulum", "pendulum on a pivot, any swing", "T = 4 sqrt(J/(m g L)) K(sin(a/2)), J = I + m L²",
        "a ball released at 20 to 80 degrees and a rod at 80 to 130, 50 to 90 px below the pin",
        "Times of the first three passes through the lowest point, over the period. Smooth motion, so 0.3 %. K by the "
        "arithmetic-geometric mean.",
        (Measure("period", 3e-3),), _pendulum,
    ),
    Row(
        29, "springs", "masses on springs, damped or not", "w² = k/m - (c/(2 m))², amplitude e to the -c t/(2 m)",
        "20 to 500 g, 1.5 to 3 swings a second, stretched by 20 to 50 px, damping 0 and 3 to 10 % of critical; one "
        "pair of bodies on one spring",
        "Phase and amplitude after 2 s over their closed forms. Smooth motion, so 0.3 %.",
        (Measure("frequency", 3e-3), Measure("amplitude", 3e-3)), _springs,
    ),
    Row(
        33, "see-saw", "see-saw with two weights",
        "angular acceleration = torque / moment of all; tips at 1.01, back at 0.99",
        "planks of 220 to 260 px, boxes of 22 to 34 px at 60 to 90 px, moments of 0.99, 1.01 and 1.1 to 1.25",
        "Angle and spin after 0.4 s over those of one rigid body. As for rolling: 0.3 %.",
        (Measure("acceleration", 3e-3), Measure("balance", 0, Unit.SWITCH)), _seesaw,
    ),
    Row(
        34, "motor", "motor with a limit", "spin = limit x t/I up to its speed, then constant",
        "wheels of 30 to 55 px on the world and on a base that turns too, 300 to 900 degrees/s reached in 0.4 to 0.8 s",
        "Largest deviation at any time over the speed. 0.3 %: one step of the ramp is that much.",
        (Measure("spin", 3e-3),), _motor,
    ),
    Row(
        37, "weld", "two welded boxes hit off-centre", "one rigid body with the parallel-axis moment",
        "boxes of 24 to 60 x 50 to 80 px, ball of 10 to 18 px at 150 to 300 px/s, e 0.2 to 1, from either side",
        "Spins of both and velocity of their middle over their closed forms. Algebra, as for rows 11 and 30: 0.3 %.",
        (Measure("spin", 3e-3), Measure("velocity", 3e-3)), _weld,
    ),
)  # fmt: skip
