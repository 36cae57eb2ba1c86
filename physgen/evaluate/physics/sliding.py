"""Rows of blocks that slide, hold or tip: on floors, on slopes, over seams and on one another."""

from __future__ import annotations

from itertools import pairwise
from math import acosh, sqrt

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
from physgen.evaluate.physics.staging import GRAVITY, Slope, box, scene, segment

CREEP = 0.1
"""px: what holds moves less."""


def _to_rest(draw: Draw) -> list[Case]:
    """Distance to rest of two blocks, one to the right and one to the left."""
    slides = {"lower": (330, 1), "upper": (160, -1)}
    objects, floors, exact = {}, {}, {}
    for name, (y, side) in slides.items():
        mu, speed = draw.number(0.25, 0.7, 3), draw.number(150, 350, 0)
        size = (draw.number(30, 60, 0), draw.number(15, 30, 0))
        surface = {"friction": mu, "elasticity": draw.number(0, 0.5)}
        at = (320 - 260 * side, y - size[1] / 2)
        objects[name] = box(
            at, size, mass=draw.mass(), velocity=[speed * side, 0], **surface
        )
        floors[f"{name}-floor"] = segment((20, y), (620, y), **surface)
        exact[name] = (side * speed**2 / (2 * mu * GRAVITY), speed / (mu * GRAVITY))

    def measure(run: Run) -> Errors:
        errors = []
        for name, (way, _) in exact.items():
            track = run.track(name)
            errors.append(
                1.0 if track.speed[-1] > 1 else abs(track.moved[-1, 0] / way - 1)
            )
        return {"distance": worst(errors)}

    duration = max(time for _, time in exact.values()) + 0.1
    return [Case(scene((640, 360), duration, objects, floors), measure)]


def _incline(draw: Draw) -> list[Case]:
    """Blocks on slopes of 0.99, 1.01 and 1.5 to 2.5 times the friction; the distance after 0.8 s on the steep one."""
    mu, steep = draw.number(0.2, 0.45, 3), draw.number(1.5, 2.5)
    surface = {"friction": mu, "elasticity": draw.number(0, 0.5)}
    objects, walls, slopes = {}, {}, {}
    for k, (name, part) in enumerate(
        {"holds": 0.99, "slips": 1.01, "slides": steep}.items()
    ):
        side = draw.sign()
        slope = Slope(
            (60 + 300 * k + (0 if side > 0 else 240), 60), part * mu, side, 260
        )
        size = (draw.number(30, 44, 0), draw.number(14, 20, 0))
        objects[name] = box(
            slope.point(35, size[1] / 2),
            size,
            slope.turned,
            mass=draw.mass(),
            **surface,
        )
        walls[f"{name}-slope"] = slope.wall(**surface)
        slopes[name] = slope

    def measure(run: Run) -> Errors:
        ways, exact = {}, {}
        for name, slope in slopes.items():
            track = run.track(name)
            part = slope.tangent / mu - 1
            exact[name] = (
                GRAVITY
                * mu
                * part
                * slope.down[1]
                / slope.tangent
                * track.times[-1] ** 2
                / 2
            )
            ways[name] = track.moved[-1] @ slope.down
        switch = abs(ways["holds"]) > CREEP or ways["slips"] < exact["slips"] / 2
        return {
            "switch": float(switch),
            "distance": abs(ways["slides"] / exact["slides"] - 1),
        }

    return [Case(scene((920, 330), 0.8, objects, walls), measure)]


def _tipping(draw: Draw) -> list[Case]:
    """Tall blocks on slopes of 0.99 and 1.01 times their width over height."""
    size = (draw.number(14, 24), draw.number(40, 60))
    ratio, radius = size[0] / size[1], sqrt(size[0] ** 2 + size[1] ** 2) / 2
    surface = {"friction": 1.5, "elasticity": draw.number(0, 0.3)}
    objects, walls = {}, {}
    for k, (name, part) in enumerate({"holds": 0.99, "tips": 1.01}.items()):
        side = draw.sign()
        slope = Slope(
            (60 + 340 * k + (0 if side > 0 else 260), 110), part * ratio, side, 290
        )
        objects[name] = box(
            slope.point(80, size[1] / 2),
            size,
            slope.turned,
            mass=draw.mass(),
            **surface,
        )
        walls[f"{name}-slope"] = slope.wall(**surface)
    # about its lower edge a block falls as cosh(t sqrt(3 g/(4 r))), begun by the little that it stands beyond balance
    beyond = np.arctan(1.01 * ratio) - np.arctan(ratio)
    duration = 1.2 * acosh(1 + 0.4 / beyond) / sqrt(3 * GRAVITY / (4 * radius))

    def measure(run: Run) -> Errors:
        holds, tips = run.track("holds"), run.track("tips")
        stood = (
            np.abs(holds.angle).max() < 0.01 and np.hypot(*holds.moved.T).max() < 0.5
        )
        return {"switch": float(not (stood and np.abs(tips.angle).max() > 0.3))}

    return [Case(scene((720, 300), duration, objects, walls), measure)]


SEAMS = (0.0, 0.1, 0.3, 0.5)
"""px between the parts of a floor; the fifth draw takes a gap at random."""


def _seams(draw: Draw) -> list[Case]:
    """Distance to rest over floors made of segments, of separate pieces, and of one outline that is cut into pieces."""
    gap = SEAMS[draw.index] if draw.index < len(SEAMS) else draw.number(0, 0.5, 3)
    mu, speed, size = (
        draw.number(0.25, 0.4, 3),
        draw.number(280, 330, 0),
        (draw.number(28, 40, 0), 20.0),
    )
    surface = {"friction": mu, "elasticity": draw.number(0, 0.3)}
    way = speed**2 / (2 * mu * GRAVITY)
    cuts = sorted(
        round(70 + part * way, 2)
        for part in (draw.number(0.2, 0.4), draw.number(0.5, 0.8))
    )
    edges = [20.0, *cuts, 420.0]
    spans = [(a + gap * (k > 0), b) for k, (a, b) in enumerate(pairwise(edges))]
    walls = {
        f"floor-{k}": segment((a, 80), (b, 80), **surface)
        for k, (a, b) in enumerate(spans, 1)
    }
    pieces = [
        {"outline": [[a, 180.0], [b, 180.0], [b, 200.0], [a, 200.0]]} for a, b in spans
    ]
    left, right = cuts
    below = [
        [420.0, 300.0],
        [right, 285.0],
        [right - 20, 300.0],
        [left + 5, 284.0],
        [20.0, 300.0],
    ]
    objects: dict[str, Document] = {
        "shelf": {"shape": {"polygons": pieces}, "motion": "static", **surface},
        "comb": {
            "shape": {"polygon": [[20.0, 280.0], [420.0, 280.0], *below]},
            "motion": "static",
            **surface,
        },
    }
    riders = {"on-segments": 80, "on-pieces": 180, "on-one-outline": 280}
    for name, y in riders.items():
        objects[name] = box(
            (60, y - size[1] / 2),
            size,
            mass=draw.mass(),
            velocity=[speed, 0],
            **surface,
        )

    def measure(run: Run) -> Errors:
        return {
            "distance": worst(
                [abs(run.track(name).moved[-1, 0] / way - 1) for name in riders]
            )
        }

    return [
        Case(scene((440, 320), speed / (mu * GRAVITY) + 0.1, objects, walls), measure)
    ]


def _pulled(draw: Draw) -> list[Case]:
    """Distance of the blocks on top while the lowest is pulled from under them."""
    mu, upper = draw.number(0.15, 0.35, 3), draw.count(2, 3)
    surface = {"friction": mu, "elasticity": draw.number(0, 0.3)}
    width, height = draw.number(100, 120, 0), draw.number(16, 24, 0)
    masses = [draw.mass() for _ in range(upper + 1)]
    side = draw.sign()
    time = 0.6
    slab, objects = 360.0, {}
    middle = 320 - 90 * side
    for k, mass in enumerate(masses):
        size = (slab if k == 0 else width, height)
        objects[f"block-{k}"] = box(
            (middle, 240 - height * (k + 0.5)), size, mass=mass, **surface
        )
    more: Document = {}
    if draw.index % 2:  # by a script, at a speed that friction does not reach in time
        speed = side * draw.number(1.2, 1.6) * mu * GRAVITY * time
        center = objects["block-0"]["shape"]["box"]["center"]
        objects["block-0"]["motion"] = {
            "path": [[0, *center], [1, center[0] + speed, center[1]]]
        }
        del objects["block-0"]["mass"]
    else:  # by a force that takes it along at 2 to 3 times mu g
        drag = mu * GRAVITY * (sum(masses[1:]) + sum(masses))
        force = masses[0] * draw.number(2, 3) * mu * GRAVITY + drag
        more["forces"] = [{"object": "block-0", "force": [side * force, 0]}]

    def measure(run: Run) -> Errors:
        errors = []
        for k in range(1, upper + 1):
            track = run.track(f"block-{k}")
            end = track.sample(time)
            exact = side * mu * GRAVITY * track.times[end] ** 2 / 2
            errors.append(abs(track.moved[end, 0] / exact - 1))
        return {"distance": worst(errors)}

    floor = {"floor": segment((-400, 240), (1000, 240), **surface)}
    return [Case(scene((640, 280), time, objects, floor, **more), measure, rate=480)]


def _combined(draw: Draw) -> list[Case]:
    """Distance to rest of one block under both rules of combining."""
    of_block, of_floor = draw.number(0.3, 0.9, 3), draw.number(0.3, 0.9, 3)
    speed, size = (
        draw.number(150, 250, 0),
        (draw.number(40, 60, 0), draw.number(16, 24, 0)),
    )
    block = box(
        (60, 120 - size[1] / 2),
        size,
        mass=draw.mass(),
        velocity=[speed, 0],
        friction=of_block,
    )
    floor = segment((20, 120), (480, 120), friction=of_floor)

    def measure(geometric: Run, multiplied: Run) -> Errors:
        errors = []
        for run, mu in (
            (geometric, sqrt(of_block * of_floor)),
            (multiplied, of_block * of_floor),
        ):
            way = run.track("block").moved[-1, 0]
            errors.append(abs(way * 2 * mu * GRAVITY / speed**2 - 1))
        return {"distance": worst(errors)}

    duration = speed / (of_block * of_floor * GRAVITY) + 0.1
    text = scene(
        (500, 160), duration, {"block": block}, {"floor": floor},
        variants={"multiplied": {"world.combine": "multiply"}},
    )  # fmt: skip
    return [Case(text, measure, variants=(None, "multiplied"))]


ROWS = (
    Row(
        5, "slide", "block sliding to rest", "d = v²/(2 mu g)",
        "blocks of 30 to 60 x 15 to 30 px, 150 to 350 px/s, mu 0.25 to 0.7, both ways",
        "Distance over its closed form.",
        (Measure("distance", 3e-3),), _to_rest,
    ),
    Row(
        6, "incline", "block on an incline", "holds at tan a = 0.99 mu, slips at 1.01 mu; a = g (sin a - mu cos a)",
        "mu 0.2 to 0.45; a third slope of 1.5 to 2.5 mu; left and right",
        f"Holds: moves less than {CREEP} px in 0.8 s. Slips: at least half the closed form's distance. "
        "On the steep slope: distance after 0.8 s.",
        (Measure("switch", 0, Unit.SWITCH), Measure("distance", 3e-3)), _incline,
    ),
    Row(
        7, "tipping", "block tipping on an incline", "holds at tan a = 0.99 w/h, tips at 1.01 w/h",
        "blocks of 14 to 24 x 40 to 60 px, mu 1.5, left and right",
        "Holds: turns by less than 0.01 rad. Tips: by more than 0.3 rad in 1.2 times the time that it takes by the "
        "linear equation.",
        (Measure("switch", 0, Unit.SWITCH),), _tipping,
    ),
    Row(
        26, "seams", "block sliding over seams, 0 to 0.5 px wide", "as if there were no seam: d = v²/(2 mu g)",
        "gaps 0, 0.1, 0.3, 0.5 px and one at random; collinear segments, pieces of a shape, one outline cut into "
        "pieces",
        "Distance over its closed form.",
        (Measure("distance", 1e-2),), _seams,
    ),
    Row(
        31, "pulled", "lowest block pulled from under others", "those above get mu g, whatever pulls",
        "2 or 3 blocks on a slab, 20 to 500 g each, mu 0.15 to 0.35; by a force of 2 to 3 mu g more than friction, "
        "or a script",
        "Distance of each upper block after 0.6 s over mu g t²/2; 0.3 %, as for any block that slides.",
        (Measure("distance", 3e-3),), _pulled,
    ),
    Row(
        38, "combine", "two rules for a pair's friction",
        "geometric: mu = sqrt(mu1 mu2); multiply: mu = mu1 mu2; d = v²/(2 mu g)",
        "coefficients 0.3 to 0.9, 150 to 250 px/s",
        "Distance over its closed form; 0.3 %, as for any block that slides.",
        (Measure("distance", 3e-3),), _combined,
    ),
)  # fmt: skip
