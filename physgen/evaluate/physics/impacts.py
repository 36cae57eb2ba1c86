"""Rows of bodies that hit each other or a wall, without gravity."""

from __future__ import annotations

from math import cos, degrees, sin, sqrt

import numpy as np

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
from physgen.evaluate.physics.staging import INERTIA, Point, circle, scene, segment

FLOATING = {"gravity": [0, 0]}


def toward(at: Point, angle: float, along: float, across: float = 0.0) -> Point:
    """px: so far along a direction (rad) from `at`, and so far to its side (+x turned towards +y by 90 degrees)."""
    c, s = cos(angle), sin(angle)
    return at[0] + along * c - across * s, at[1] + along * s + across * c


def _head_on(draw: Draw) -> list[Case]:
    """Deviation of both velocities, over the first speed; four pairs in any direction."""
    objects, pairs = {}, {}
    for k, e in enumerate((0.0, 0.3, draw.number(0.4, 0.9), 1.0)):
        angle, speed, mass = (
            draw.angle(),
            draw.number(150, 300, 0),
            draw.number(20, 200, 0),
        )
        middle = (130.0 + 260 * (k % 2), 130.0 + 260 * (k // 2))
        surface = {"friction": draw.number(0, 0.6), "elasticity": e}
        objects[f"light-{k}"] = circle(
            toward(middle, angle, -85), draw.number(8, 18), mass=mass,
            velocity=list(toward((0, 0), angle, speed)), **surface,
        )  # fmt: skip
        objects[f"heavy-{k}"] = circle(
            middle, draw.number(12, 28), mass=3 * mass, **surface
        )
        pairs[k] = (angle, speed, e)

    def measure(run: Run) -> Errors:
        errors = []
        for k, (angle, speed, e) in pairs.items():
            for name, part in (
                (f"light-{k}", (1 - 3 * e) / 4),
                (f"heavy-{k}", (1 + e) / 4),
            ):
                exact = toward((0, 0), angle, part * speed)
                errors.append(np.hypot(*(run.track(name).velocity[-1] - exact)) / speed)
        return {"velocity": worst(errors)}

    return [Case(scene((520, 520), 0.8, objects, world=FLOATING), measure)]


GAPS = {"touching": 0.0, "apart": 1e-6, "pressed": -1e-6, "overlapping": -0.5}
DIRECTIONS = (0.0, 90.0, 37.0)
"""degrees; the last two draws take one at random, and 0 again."""


def _row_of_balls(draw: Draw) -> list[Case]:
    """Deviation of every ball's velocity, over the first speed; a lane for each gap.

    Three draws send a ball into a row of five at rest; in two, the first of the five itself has the speed at t = 0.
    """
    struck = draw.index < len(DIRECTIONS)
    turned = (
        DIRECTIONS[draw.index]
        if struck
        else (float(draw.count(0, 359)), 0.0)[draw.index - 3]
    )
    # along an axis, whole px and no rounding of the direction: a gap of 0 is 0 to the last bit
    c, s = (round(float(f(np.radians(turned))), 15) for f in (np.cos, np.sin))
    speed, radius, mass = draw.number(200, 350, 0), draw.number(12, 16, 0), draw.mass()
    objects: dict[str, Document] = {}
    for j, (lane, gap) in enumerate(GAPS.items()):
        aside = (j - 1.5) * 70
        for k in range(-1 if struck else 0, 5):
            along = -100 + k * (2 * radius + gap) - (40 if k < 0 else 0)
            at = (260 + along * c - aside * s, 260 + along * s + aside * c)
            moving = (
                {"velocity": [speed * c, speed * s]}
                if k == (-1 if struck else 0)
                else {}
            )
            name = f"{lane}-cue" if k < 0 else f"{lane}-{k + 1}"
            objects[name] = circle(
                at,
                radius,
                solid="sphere",
                mass=mass,
                friction=0.0,
                elasticity=1.0,
                **moving,
            )

    def measure(run: Run) -> Errors:
        errors = []
        for name in objects:
            exact = np.array([c, s]) * (speed if name.endswith("-5") else 0)
            errors.append(np.hypot(*(run.track(name).velocity[-1] - exact)) / speed)
        return {"velocity": worst(errors)}

    return [Case(scene((520, 520), 0.5, objects, world=FLOATING), measure)]


def _oblique(draw: Draw) -> list[Case]:
    """Degrees that the two paths differ from a right angle, and the struck ball's from the line of centres."""
    objects, hits = {}, {}
    for k in range(4):
        angle, speed, radius = (
            draw.angle(),
            draw.number(250, 400, 0),
            draw.number(10, 20),
        )
        aside = draw.sign() * 2 * radius * draw.number(0.15, 0.85)
        middle = (150.0 + 300 * (k % 2), 150.0 + 300 * (k // 2))
        ball = {"mass": draw.mass(), "friction": 0.0, "elasticity": 1.0}
        objects[f"cue-{k}"] = circle(
            toward(middle, angle, -90, aside),
            radius,
            velocity=list(toward((0, 0), angle, speed)),
            **ball,
        )
        objects[f"struck-{k}"] = circle(middle, radius, **ball)
        hits[k] = toward((0, 0), angle, sqrt(4 * radius**2 - aside**2), -aside)

    def between(a: Point, b: Point) -> float:
        return degrees(np.arctan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]))

    def measure(run: Run) -> Errors:
        right, line = [], []
        for k, centres in hits.items():
            cue, struck = (
                tuple(run.track(f"{name}-{k}").velocity[-1])
                for name in ("cue", "struck")
            )
            right.append(abs(abs(between(cue, struck)) - 90))
            line.append(abs(between(struck, centres)))
        return {"paths": worst(right), "line of centres": worst(line)}

    return [Case(scene((600, 600), 0.5, objects, world=FLOATING), measure)]


def _spin_transfer(draw: Draw) -> list[Case]:
    """Deviation of the changes of spin and of speed along the surface, over the change itself.

    A ball against a wall, and two spinning balls head-on; once with u, the sliding speed at the contact, too high for
    friction to stop it, once low enough.
    """
    objects: dict[str, Document] = {}
    exact: dict[str, list[tuple[str, float, float]]] = {"sliding": [], "sticking": []}
    walls = {}
    for j, kind in enumerate(exact):
        part = draw.number(1.5, 3) if kind == "sliding" else draw.number(0.2, 0.8)
        for against_wall in (True, False):
            mu, e, speed = (
                draw.number(0.1, 0.4, 3),
                draw.number(0.3, 1.0),
                draw.number(150, 300, 0),
            )
            surface = {"friction": mu, "elasticity": e}
            m, r, solid = (
                draw.mass(),
                draw.number(12, 24),
                ("disc", "sphere", "hoop")[draw.count(0, 2)],
            )
            k = INERTIA[solid]
            name, y = f"{kind}-{'ball' if against_wall else 'first'}", 100.0 + 200 * j
            if against_wall:
                reduced, tangential = m, m / (1 + 1 / k)
                other = ""
            else:
                m2, r2, solid2 = (
                    draw.mass(),
                    draw.number(12, 24),
                    ("disc", "sphere", "hoop")[draw.count(0, 2)],
                )
                k2 = INERTIA[solid2]
                reduced = m * m2 / (m + m2)
                tangential = 1 / (1 / m + 1 / m2 + 1 / (k * m) + 1 / (k2 * m2))
                other = f"{kind}-second"
            limit = mu * (1 + e) * reduced * speed
            spin = draw.sign() * round(degrees(part * limit / tangential / r), 1)
            slip = np.radians(spin) * r
            push = -np.sign(slip) * min(limit, abs(slip) * tangential)
            x = 110 if against_wall else 410
            objects[name] = circle(
                (x - 70, y),
                r,
                solid=solid,
                mass=m,
                velocity=[speed, 0],
                spin=spin,
                **surface,
            )
            exact[kind].append((name, push / m, push / (k * m * r)))
            if against_wall:
                walls[f"{kind}-wall"] = segment(
                    (x + 50, y - 90), (x + 50, y + 90), **surface
                )
            else:
                objects[other] = circle((x, y), r2, solid=solid2, mass=m2, **surface)
                exact[kind].append((other, -push / m2, push / (k2 * m2 * r2)))

    def measure(run: Run) -> Errors:
        errors: dict[str, float] = {}
        for kind, changes in exact.items():
            found = []
            for name, along, turn in changes:
                track = run.track(name)
                found.append(
                    abs((track.velocities[-1, 1] - track.velocities[0, 1]) / along - 1)
                )
                found.append(abs((track.spin[-1] - track.spin[0]) / turn - 1))
            errors[kind] = worst(found)
        return errors

    return [Case(scene((640, 400), 0.9, objects, walls, world=FLOATING), measure)]


ROWS = (
    Row(
        11, "head-on", "head-on, masses 1:3", "v1 = (1 - 3 e) v/4, v2 = (1 + e) v/4",
        "e 0, 0.3, 1 and one between; any direction, 150 to 300 px/s, radii 8 to 28 px",
        "Deviation of each velocity over the first speed.",
        (Measure("velocity", 1e-3),), _head_on,
    ),
    Row(
        12, "row-of-balls", "row of 5 touching equal balls, e = 1", "the last takes all",
        "gaps 0, 1e-6, -1e-6 and -0.5 px in each draw; directions 0, 90, 37 degrees and at random; struck by a sixth "
        "ball, or the first moving at t = 0",
        "Deviation of every ball's velocity over the first speed.",
        (Measure("velocity", 1e-2),), _row_of_balls,
    ),
    Row(
        13, "oblique", "oblique hit of equal balls, e = 1, no friction", "paths part at 90 degrees, the struck ball "
        "leaves along the line of centres",
        "four pairs: aside by 0.15 to 0.85 diameters, any direction, 250 to 400 px/s, radii 10 to 20 px",
        "Angles between the velocities after the hit.",
        (Measure("paths", 0.5, Unit.DEGREES), Measure("line of centres", 0.5, Unit.DEGREES)), _oblique,
    ),
    Row(
        30, "spin-transfer", "spin in a hit with friction", "sliding: impulse mu (1 + e) m_red v_n; sticking: u m_t",
        "ball at a wall and two balls head-on; u 1.5 to 3 and 0.2 to 0.8 of the limit; mu 0.1 to 0.4, e 0.3 to 1",
        "Changes of spin (impulse x R/I) and of speed along the surface over themselves. Algebra, as for row 11; 0.3 % "
        "leaves room for where in a step the hit falls. m_t = 1/(1/m1 + 1/m2 + R1²/I1 + R2²/I2).",
        (Measure("sliding", 3e-3), Measure("sticking", 3e-3)), _spin_transfer,
    ),
)  # fmt: skip
