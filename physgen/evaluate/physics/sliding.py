"""Rows of sliding, sticking and tipping blocks: on floors, on slopes, over seams and on
one another.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from math import acosh, sqrt
from typing import Any

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
"""Maximum motion of a holding block, px."""


@dataclass(frozen=True)
class _Slide:
    """A block stopped by friction."""

    displacement: float
    """px to the right."""
    time: float
    """s."""


def _to_rest(draw: Draw) -> list[Case]:
    """Return the case of two blocks that slide to rest, one to the right and
    one to the left.
    """
    objects = {}
    floors = {}
    slides = {}
    for name, y, side in (("lower", 330, 1), ("upper", 160, -1)):
        mu = draw.number(0.25, 0.7, 3)
        speed = draw.number(150, 350, 0)
        size = (draw.number(30, 60, 0), draw.number(15, 30, 0))
        surface = {"friction": mu, "elasticity": draw.number(0, 0.5)}
        objects[name] = box(
            (320 - 260 * side, y - size[1] / 2),
            size,
            mass=draw.mass(),
            velocity=[speed * side, 0],
            **surface,
        )
        floors[f"{name}-floor"] = segment((20, y), (620, y), **surface)
        # Friction decelerates with mu g, whatever the mass.
        displacement = side * speed**2 / (2 * mu * GRAVITY)
        slides[name] = _Slide(displacement, speed / (mu * GRAVITY))
    # Some time after the stop shows that friction holds the block.
    duration = max(slide.time for slide in slides.values()) + 0.1
    document = scene((640, 360), duration, objects, floors)
    return [Case(document, partial(_slide_error, slides))]


def _slide_error(slides: Mapping[str, _Slide], run: Run) -> Errors:
    """Return the largest error of a distance. A block in motion counts as 100 %."""
    errors = []
    for name, slide in slides.items():
        track = run.track(name)
        if track.speed[-1] > 1:
            errors.append(1.0)
        else:
            errors.append(abs(track.displacements[-1, 0] / slide.displacement - 1))
    return {"distance": worst(errors)}


@dataclass(frozen=True)
class _Slopes:
    """Places of the slopes of one row."""

    left: int
    """Upper end of the first slope, if it goes down to the right, px."""
    distance: int
    """Distance of neighbours, px."""
    width: int
    """Width from the left end to the right end, px."""
    top: int
    """Height of the upper ends, px."""
    length: int
    """px."""

    def slope(self, k: int, tangent: float, side: int) -> Slope:
        """Return slope number `k`, down to the right (1) or to the left (-1)."""
        # A slope down to the left has its upper end at its right side.
        left = self.left + self.distance * k
        if side < 0:
            left += self.width
        return Slope((left, self.top), tangent, side, self.length)


INCLINES = _Slopes(left=60, distance=300, width=240, top=60, length=260)


def _incline(draw: Draw) -> list[Case]:
    """Return the case of blocks on slopes of 0.99, 1.01 and 1.5 to 2.5 times
    the friction.
    """
    mu = draw.number(0.2, 0.45, 3)
    steep = draw.number(1.5, 2.5)
    surface = {"friction": mu, "elasticity": draw.number(0, 0.5)}
    objects = {}
    walls = {}
    slopes = {}
    parts = {"holds": 0.99, "slips": 1.01, "slides": steep}
    for k, (name, part) in enumerate(parts.items()):
        # A block slips on a slope with a tangent above mu. One per cent on either side
        # of it is the sharpest test.
        slope = INCLINES.slope(k, part * mu, draw.sign())
        size = (draw.number(30, 44, 0), draw.number(14, 20, 0))
        objects[name] = box(
            slope.point(35, size[1] / 2),
            size,
            slope.box_angle,
            mass=draw.mass(),
            **surface,
        )
        walls[f"{name}-slope"] = slope.wall(**surface)
        slopes[name] = slope
    document = scene((920, 330), 0.8, objects, walls)
    measure = partial(_incline_errors, slopes, mu)
    return [Case(document, measure)]


def _incline_errors(slopes: Mapping[str, Slope], mu: float, run: Run) -> Errors:
    """Return whether a block holds or slips wrongly, and the error of the distance on
    the steep slope.
    """
    distances, expected = {}, {}
    for name, slope in slopes.items():
        track = run.track(name)
        excess = slope.tangent / mu - 1
        # The acceleration is g (sin a - mu cos a) with cos a = sin a / tan a.
        acceleration = GRAVITY * mu * excess * slope.direction[1] / slope.tangent
        expected[name] = acceleration * track.times[-1] ** 2 / 2
        distances[name] = track.displacements[-1] @ slope.direction
    # A block that slips may start late, but not stay.
    creeps = abs(distances["holds"]) > CREEP
    sticks = distances["slips"] < expected["slips"] / 2
    return {
        "switch": float(creeps or sticks),
        "distance": abs(distances["slides"] / expected["slides"] - 1),
    }


TIPPING_SLOPES = _Slopes(left=60, distance=340, width=260, top=110, length=290)


def _tipping(draw: Draw) -> list[Case]:
    """Return the case of tall blocks on slopes of 0.99 and 1.01 times their
    width over height.
    """
    size = (draw.number(14, 24), draw.number(40, 60))
    # A block tips if the vertical through its centre passes its lower edge: at a
    # tangent of width over height.
    ratio = size[0] / size[1]
    surface = {"friction": 1.5, "elasticity": draw.number(0, 0.3)}
    objects, walls = {}, {}
    for k, (name, part) in enumerate({"holds": 0.99, "tips": 1.01}.items()):
        slope = TIPPING_SLOPES.slope(k, part * ratio, draw.sign())
        objects[name] = box(
            slope.point(80, size[1] / 2),
            size,
            slope.box_angle,
            mass=draw.mass(),
            **surface,
        )
        walls[f"{name}-slope"] = slope.wall(**surface)
    # Tipping about the lower edge follows cosh(t sqrt(3 g/(4 r))) from a small angle.
    radius = sqrt(size[0] ** 2 + size[1] ** 2) / 2
    excess_angle = np.arctan(1.01 * ratio) - np.arctan(ratio)
    # With r half the diagonal, the moment about an edge is 4 m r²/3.
    growth_rate = sqrt(3 * GRAVITY / (4 * radius))
    # The time of a turn by 0.4 rad, more than the test asks for.
    fall_time = acosh(1 + 0.4 / excess_angle) / growth_rate
    document = scene((720, 300), 1.2 * fall_time, objects, walls)
    return [Case(document, _tipping_error)]


def _tipping_error(run: Run) -> Errors:
    """Return 1 unless one block holds and the other tips."""
    holds = run.track("holds")
    tips = run.track("tips")
    is_upright = np.abs(holds.angle).max() < 0.01
    is_in_place = np.hypot(*holds.displacements.T).max() < 0.5
    is_tipping = np.abs(tips.angle).max() > 0.3
    return {"switch": float(not (is_upright and is_in_place and is_tipping))}


SEAMS = (0.0, 0.1, 0.3, 0.5)
"""Gaps between the parts of a floor, px. The fifth draw takes a random gap."""
SEAM_EDGES = (20.0, 420.0)
"""Ends of the floors, px."""
RIDERS = {"on-segments": 80, "on-pieces": 180, "on-one-outline": 280}
"""Heights of the floor below each block, px."""


def _seams(draw: Draw) -> list[Case]:
    """Return the case of floors from segments, from separate pieces, and from one
    outline that is cut into pieces.
    """
    if draw.index < len(SEAMS):
        gap = SEAMS[draw.index]
    else:
        gap = draw.number(0, 0.5, 3)
    mu = draw.number(0.25, 0.4, 3)
    speed = draw.number(280, 330, 0)
    size = (draw.number(28, 40, 0), 20.0)
    surface = {"friction": mu, "elasticity": draw.number(0, 0.3)}
    distance = speed**2 / (2 * mu * GRAVITY)
    parts = (draw.number(0.2, 0.4), draw.number(0.5, 0.8))
    # Both seams are within the way of the block.
    cuts = sorted(round(70 + part * distance, 2) for part in parts)
    spans = _floor_spans(cuts, gap)
    # Every floor is level and has the same friction: the seams must not change the
    # path.
    objects = {"shelf": _shelf(spans, surface), "comb": _comb(cuts, surface)}
    for name, y in RIDERS.items():
        objects[name] = box(
            (60, y - size[1] / 2),
            size,
            mass=draw.mass(),
            velocity=[speed, 0],
            **surface,
        )
    duration = speed / (mu * GRAVITY) + 0.1
    document = scene((440, 320), duration, objects, _segments(spans, surface))
    return [Case(document, partial(_seam_error, distance))]


def _segments(
    spans: Sequence[tuple[float, float]], surface: Document
) -> dict[str, Document]:
    """Return a floor of one boundary for each span."""
    walls = {}
    for k, (left, right) in enumerate(spans, 1):
        walls[f"floor-{k}"] = segment((left, 80), (right, 80), **surface)
    return walls


def _floor_spans(cuts: Sequence[float], gap: float) -> list[tuple[float, float]]:
    """Return left and right ends (px) of the parts of a floor, with a gap after each
    but the last.
    """
    first, last = SEAM_EDGES
    spans = list(pairwise([first, *cuts, last]))
    later_spans = [(left + gap, right) for left, right in spans[1:]]
    return [spans[0], *later_spans]


def _shelf(spans: Sequence[tuple[float, float]], surface: Document) -> Document:
    """Return a fixed object of separate pieces."""
    pieces = []
    for left, right in spans:
        outline = [[left, 180.0], [right, 180.0], [right, 200.0], [left, 200.0]]
        pieces.append({"outline": outline})
    return {"shape": {"polygons": pieces}, "motion": "static", **surface}


def _comb(cuts: Sequence[float], surface: Document) -> Document:
    """Return a fixed object of one outline. Notches in its lower side make the program
    cut it into pieces.
    """
    left, right = cuts
    begin, end = SEAM_EDGES
    outline = [
        [begin, 280.0],
        [end, 280.0],
        [end, 300.0],
        [right, 285.0],
        [right - 20, 300.0],
        [left + 5, 284.0],
        [begin, 300.0],
    ]
    return {"shape": {"polygon": outline}, "motion": "static", **surface}


def _seam_error(distance: float, run: Run) -> Errors:
    """Return the largest error of the distance to rest."""
    errors = []
    for name in RIDERS:
        track = run.track(name)
        errors.append(abs(track.displacements[-1, 0] / distance - 1))
    return {"distance": worst(errors)}


PULL_TIME = 0.6
"""s."""
SLAB_WIDTH = 360.0
"""Width of the lowest block, px: it stays below the others until PULL_TIME."""


def _pulled_slab(draw: Draw) -> list[Case]:
    """Return the case of a stack with a pull on its lowest block."""
    mu = draw.number(0.15, 0.35, 3)
    upper_blocks = draw.count(2, 3)
    surface = {"friction": mu, "elasticity": draw.number(0, 0.3)}
    width = draw.number(100, 120, 0)
    height = draw.number(16, 24, 0)
    masses = [draw.mass() for _ in range(upper_blocks + 1)]
    side = draw.sign()
    objects = {}
    for k, mass in enumerate(masses):
        objects[f"block-{k}"] = box(
            (320 - 90 * side, 240 - height * (k + 0.5)),
            (width if k else SLAB_WIDTH, height),
            mass=mass,
            **surface,
        )
    sections: Document = {}
    if draw.index % 2:
        _script_slab(objects["block-0"], side, mu, draw)
    else:
        # The pull exceeds friction below the others and on the ground.
        pull = side * _slab_force(masses, mu, draw)
        sections["forces"] = [{"object": "block-0", "force": [pull, 0]}]
    sections["boundaries"] = {"floor": segment((-400, 240), (1000, 240), **surface)}
    document = scene((640, 280), PULL_TIME, objects, **sections)
    # Friction alone moves the blocks above, each with at most mu g.
    acceleration = side * mu * GRAVITY
    return [Case(document, partial(_pull_error, upper_blocks, acceleration), rate=480)]


def _script_slab(slab: dict[str, Any], side: int, mu: float, draw: Draw) -> None:
    """Move a block by a script, too fast for friction to reach its speed in time."""
    speed = side * draw.number(1.2, 1.6) * mu * GRAVITY * PULL_TIME
    x, y = slab["shape"]["box"]["center"]
    slab["motion"] = {"path": [[0, x, y], [1, x + speed, y]]}
    del slab["mass"]


def _slab_force(masses: Sequence[float], mu: float, draw: Draw) -> float:
    """Return a force (g·px/s²) that moves the slab at 2 to 3 times mu g, in spite of
    friction on both sides.
    """
    # The blocks above press on the slab, and the slab and these blocks on the floor.
    friction = mu * GRAVITY * (sum(masses[1:]) + sum(masses))
    return masses[0] * draw.number(2, 3) * mu * GRAVITY + friction


def _pull_error(upper_blocks: int, acceleration: float, run: Run) -> Errors:
    """Return the largest error of the distance of the blocks on top."""
    errors = []
    for k in range(1, upper_blocks + 1):
        track = run.track(f"block-{k}")
        # The blocks on top accelerate with mu g, since the slab slides below them.
        end = track.sample(PULL_TIME)
        expected = acceleration * track.times[end] ** 2 / 2
        errors.append(abs(track.displacements[end, 0] / expected - 1))
    return {"distance": worst(errors)}


def _friction_rules(draw: Draw) -> list[Case]:
    """Return the case of one block under both rules for the friction of a pair."""
    block_friction = draw.number(0.3, 0.9, 3)
    floor_friction = draw.number(0.3, 0.9, 3)
    speed = draw.number(150, 250, 0)
    size = (draw.number(40, 60, 0), draw.number(16, 24, 0))
    block = box(
        (60, 120 - size[1] / 2),
        size,
        mass=draw.mass(),
        velocity=[speed, 0],
        friction=block_friction,
    )
    # The two coefficients differ, so that both rules give different paths.
    floor = segment((20, 120), (480, 120), friction=floor_friction)
    # The product is smaller than the geometric mean, and gives the longer way.
    product = block_friction * floor_friction
    document = scene(
        (500, 160),
        speed / (product * GRAVITY) + 0.1,
        {"block": block},
        {"floor": floor},
        variants={"multiplied": {"world.combine": "multiply"}},
    )
    measure = partial(_rules_error, speed, (sqrt(product), product))
    return [Case(document, measure, variants=(None, "multiplied"))]


def _rules_error(speed: float, frictions: Sequence[float], *runs: Run) -> Errors:
    """Return the largest error of the distance to rest, from one run for each
    coefficient.
    """
    errors = []
    for run, mu in zip(runs, frictions, strict=True):
        distance = run.track("block").displacements[-1, 0]
        errors.append(abs(distance * 2 * mu * GRAVITY / speed**2 - 1))
    return {"distance": worst(errors)}


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
        (Measure("distance", 3e-3),), _pulled_slab,
    ),
    Row(
        38, "combine", "two rules for a pair's friction",
        "geometric: mu = sqrt(mu1 mu2); multiply: mu = mu1 mu2; d = v²/(2 mu g)",
        "coefficients 0.3 to 0.9, 150 to 250 px/s",
        "Distance over its closed form; 0.3 %, as for any block that slides.",
        (Measure("distance", 3e-3),), _friction_rules,
    ),
)  # fmt: skip
