"""Rows of standing, falling and toppling boxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import asin, atan2, cos, degrees, inf, sin, sqrt

import numpy as np

from physgen.evaluate.physics.events import find_crossings
from physgen.evaluate.physics.scorecard import (
    Array,
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
from physgen.evaluate.physics.staging import GRAVITY, Point, box, scene, segment

REMOVALS = {
    "left-corner": (("box-1-1", "box-1-2"), "box-2-1"),
    "right-corner": (("box-1-5", "box-1-6"), "box-2-5"),
    "left-under-top": (("box-5-1",), "box-6-1"),
    "right-under-top": (("box-5-2",), "box-6-1"),
    "lifted": ((), "box-6-1"),
}
"""One draw each: removed boxes of the pyramid, and the box that must fall. The last
draw lifts the top instead.
"""
LEVELS = 6
LIFT = 5.0
"""Height of the lifted top, px. A box without support falls farther."""
HALF_PIXEL = 0.5
"""px."""


def _stack_boxes(
    draw: Draw, size: tuple[float, float], distance: float, surface: Document
) -> dict[str, Document]:
    """Return the boxes of a pyramid, `distance` px apart, by name."""
    objects = {}
    for level in range(1, LEVELS + 1):
        # Each level has one box less than the level below it.
        boxes = LEVELS + 1 - level
        y = 260 - (level - 0.5) * size[1]
        for k in range(1, boxes + 1):
            center = (220 + (k - (boxes + 1) / 2) * distance, y)
            mass = draw.number(60, 180, 0)
            objects[f"box-{level}-{k}"] = box(center, size, mass=mass, **surface)
    return objects


def _pyramid(draw: Draw) -> list[Case]:
    """Return the cases of a pyramid at rest, and of one with an unsupported box."""
    size = (draw.number(30, 44, 0), draw.number(18, 32, 0))
    distance = size[0] + draw.number(4, 8, 0)
    surface = {"friction": draw.number(0.4, 0.8), "elasticity": draw.number(0, 0.4)}
    objects = _stack_boxes(draw, size, distance, surface)
    floor = {"floor": segment((0, 260), (440, 260), **surface)}
    pyramid = scene((440, 280), 5.0, objects, floor)
    # Each draw takes one way to break the pyramid.
    label, (removals, falling_box) = list(REMOVALS.items())[draw.index]
    changed_objects = {}
    for name, body in objects.items():
        if name not in removals:
            changed_objects[name] = body
    if not removals:
        changed_objects[falling_box] = _lift(changed_objects[falling_box])
    changed_pyramid = scene((440, 280), 1.0, changed_objects, floor)
    is_lifted = not removals
    return [
        Case(pyramid, partial(_rest_error, tuple(objects)), rate=60),
        Case(
            changed_pyramid,
            partial(_fall_error, falling_box, is_lifted),
            label,
            rate=60,
        ),
    ]


def _lift(object: Document) -> Document:
    """Return a box that is LIFT higher."""
    shape = object["shape"]["box"]
    x, y = shape["center"]
    lifted_shape = {"center": [x, y - LIFT], "size": shape["size"]}
    return {**object, "shape": {"box": lifted_shape}}


def _rest_error(names: Sequence[str], run: Run) -> Errors:
    """Return the largest displacement of a box, px."""
    displacements = []
    for name in names:
        distances = np.hypot(*run.track(name).displacements.T)
        displacements.append(distances.max())
    return {"at rest": worst(displacements)}


def _fall_error(name: str, is_lifted: bool, run: Run) -> Errors:
    """Return 1 unless a box falls, a lifted one by LIFT."""
    fall = float(run.track(name).displacements[-1, 1])
    has_fallen = fall > LIFT
    if is_lifted:
        has_fallen = abs(fall - LIFT) < HALF_PIXEL
    return {"falls": float(not has_fallen)}


DOMINOES = 10
FALL_ANGLE = 3
"""Minimum turn of a domino in the wave, degrees."""
FIRST_TIMED, LAST_TIMED = 4, 8
"""Dominoes at the start and end of the timed wave."""


def _dominoes(draw: Draw) -> list[Case]:
    """Return the case of a domino wave under g and 4 g.

    The first domino leans beyond its balance and falls from rest, so that only gravity
    sets the time.
    """
    thickness, height = _draw_domino(draw)
    distance = round(height * draw.number(0.45, 0.6))
    surface = {"friction": draw.number(0.3, 0.5), "elasticity": draw.number(0, 0.2)}
    mass = draw.number(10, 60, 0)
    floor_y = 160.0
    lean = _first_lean(thickness, height, distance)
    objects = {}
    for k in range(1, DOMINOES + 1):
        center = (40.0 + k * distance, floor_y - height / 2)
        tilt = 0.0
        if k == 1:
            corner = 40.0 + distance + thickness / 2, floor_y
            # The first domino stands on its lower right corner.
            center = _leaning_center(corner, (thickness, height), lean)
            tilt = degrees(lean)
        objects[f"domino-{k}"] = box(
            center, (thickness, height), tilt, mass=mass, **surface
        )
    # The wave is faster than 0.8 sqrt(g L).
    duration = 0.5 + 13 * distance / sqrt(GRAVITY * height)
    width = 100 + 11 * int(distance)
    document = scene(
        (width, 200),
        duration,
        objects,
        {"floor": segment((0, floor_y), (width, floor_y), **surface)},
        world={"gravity": [0, GRAVITY]},
        variants={"four-g": {"world.gravity": [0, 4 * GRAVITY]}},
    )
    return [Case(document, _wave_error, variants=(None, "four-g"), rate=480)]


def _first_lean(thickness: float, height: float, distance: float) -> float:
    """Return the lean of the first domino (rad), between balance and contact with the
    second one.
    """
    # At this lean, the centre is above the corner.
    balance = atan2(thickness, height)
    # At this lean, the upper corner touches the next domino.
    contact = asin((distance - thickness) / height)
    return (balance + contact) / 2


def _draw_domino(draw: Draw) -> Point:
    """Return thickness and height of a domino, px."""
    height = draw.number(56, 80, 0)
    return draw.number(5, 7, 0), height


def _leaning_center(corner: Point, size: Point, lean: float) -> Point:
    """Return the centre (px) of a domino on its lower right corner with a
    lean (rad).
    """
    half_thickness = size[0] / 2
    half_height = size[1] / 2
    # From the corner to the centre along both turned sides.
    x = corner[0] - half_thickness * cos(lean) + half_height * sin(lean)
    y = corner[1] - half_thickness * sin(lean) - half_height * cos(lean)
    return x, y


def _wave_error(run: Run, heavy_run: Run) -> Errors:
    """Return the error of the ratio of wave speeds under 4 g and g, against 2."""
    # By dimensional analysis, the speed of a wave grows with sqrt(g).
    ratio = _wave_time(run) / _wave_time(heavy_run)
    return {"ratio": abs(ratio / 2 - 1)}


def _wave_time(run: Run) -> float:
    """Return the time of the wave between two dominoes, s."""
    return _start_of_fall(run, LAST_TIMED) - _start_of_fall(run, FIRST_TIMED)


def _start_of_fall(run: Run, k: int) -> float:
    """Return the time (s) of a turn by FALL_ANGLE, or infinity if a domino stays up."""
    track = run.track(f"domino-{k}")
    angle = track.angle - np.radians(FALL_ANGLE)
    passes = find_crossings(track.times, angle, track.spin)
    if len(passes):
        return float(passes[0])
    return inf


def _weights(draw: Draw) -> list[Case]:
    """Return the case of a stack of four boxes."""
    size = (draw.number(60, 90, 0), draw.number(24, 36, 0))
    surface = {"friction": draw.number(0.3, 0.8), "elasticity": draw.number(0, 0.4)}
    masses = [draw.mass() for _ in range(4)]
    objects = {}
    for k, mass in enumerate(masses, 1):
        center = (130, 200 - (k - 0.5) * size[1])
        objects[f"box-{k}"] = box(center, size, mass=mass, **surface)
    floor = {"floor": segment((0, 200), (260, 200), **surface)}
    document = scene((260, 230), 1.0, objects, floor)
    return [Case(document, partial(_weight_error, masses))]


def _weight_error(masses: Sequence[float], run: Run) -> Errors:
    """Return the largest error of the mean force below a box, from contact
    impulses in the second half.
    """
    errors = []
    for k in range(1, len(masses) + 1):
        if k == 1:
            support = "floor"
        else:
            support = f"box-{k - 1}"
        # The mean force is the impulse over its time. Upwards is negative.
        force = -run.impulse(f"box-{k}", support, 0.5, 1.0)[1] / 0.5
        # Each box carries itself and all boxes above it.
        weight = sum(masses[k - 1 :]) * GRAVITY
        errors.append(abs(force / weight - 1))
    return {"force": worst(errors)}


LAST_ANGLE = np.radians(80)
"""Maximum counted angle of a falling plank, rad."""
SHORT_FALL = 1.0
"""Minimum final angle of a fallen plank, rad."""


@dataclass(frozen=True)
class _Plank:
    """A falling plank on a gliding lower corner. Angles are relative to the upright,
    rad.
    """

    half_size: Point
    """Half its thickness and half its length, px."""
    lean: float
    """rad at t = 0."""
    side: int
    """1: to the right, -1: to the left."""

    def height(self, angle: Array | float) -> Array:
        """Return the height of the centre above the floor, px."""
        thickness, length = self.half_size
        return np.asarray(length * np.cos(angle) + thickness * np.sin(angle))

    def lever(self, angle: Array) -> Array:
        """Return the horizontal distance from the corner to the centre, px: the
        absolute derivative of the height.
        """
        thickness, length = self.half_size
        return np.asarray(thickness * np.cos(angle) - length * np.sin(angle))


def _falling_plank(draw: Draw) -> list[Case]:
    """Return the case of a plank with a lean beyond its balance."""
    size = (draw.number(10, 24), draw.number(80, 130))
    lean = draw.number(5, 20) + degrees(atan2(size[0], size[1]))
    side = draw.sign()
    plank = _Plank((size[0] / 2, size[1] / 2), np.radians(lean), side)
    smooth = {"friction": 0.0, "elasticity": 0.0}
    center = (180, 160 - float(plank.height(plank.lean)))
    body = box(center, size, side * lean, mass=draw.mass(), **smooth)
    floor = {"floor": segment((0, 160), (360, 160), **smooth)}
    document = scene((360, 190), 0.9, {"plank": body}, floor)
    return [Case(document, partial(_plank_error, plank), rate=480)]


def _plank_error(plank: _Plank, run: Run) -> Errors:
    """Return the largest error of the spin over its last value, and of the sideways
    motion over the length.
    """
    track = run.track("plank")
    body = run.body("plank")
    angle = plank.lean + plank.side * track.angle
    # Only samples up to the first one beyond the last angle count.
    is_beyond = ~(angle < LAST_ANGLE)
    end = int(np.argmax(is_beyond)) or len(angle)
    angle = angle[:end]
    spin = plank.side * track.spin[:end]
    # Without friction the centre falls straight: (I + m lever²) w²/2 = m g fall.
    fall = np.maximum(plank.height(plank.lean) - plank.height(angle), 0)
    inertia = body.moment / body.mass + plank.lever(angle) ** 2
    expected = np.sqrt(2 * GRAVITY * fall / inertia)
    spin_error = np.abs(spin - expected).max() / expected[-1]
    length = 2 * plank.half_size[1]
    drift = np.abs(track.displacements[:end, 0]).max() / length
    is_short = float(angle[-1] < SHORT_FALL)
    return {"spin": worst([spin_error, drift, is_short])}


ROWS = (
    Row(
        16, "pyramid", "pyramid of 21 boxes at rest, 5 s", "nothing moves, and not by sleeping: what loses its support "
        "falls",
        "boxes of 30 to 44 x 18 to 32 px, 4 to 8 px apart, 60 to 180 g each, mu 0.4 to 0.8; then without two corner "
        "boxes (left, right), without either box under the top, and with the top lifted by 5 px, a draw each",
        "Largest displacement of any box. Falls: by over 5 px in 1 s; the lifted one by 5 px, to half a pixel.",
        (Measure("at rest", 0.5, Unit.PX), Measure("falls", 0, Unit.SWITCH)), _pyramid,
    ),
    Row(
        17, "dominoes", "domino wave under 4 g", "its speed doubles: v = sqrt(g L) G(d/L)",
        "ten dominoes of 56 to 80 x 5 to 7 px, 0.45 to 0.6 heights apart, mu 0.3 to 0.5, e to 0.2",
        "Ratio of the times from the fourth to the eighth, over 2. Source: dimensional analysis.",
        (Measure("ratio", 1e-2),), _dominoes,
    ),
    Row(
        39, "falling-over", "plank falling over on a frictionless floor",
        "w² = 2 g (y0 - y)/(I/m + (dy/da)²), the middle falls straight down",
        "planks of 10 to 24 x 80 to 130 px, 5 to 20 degrees beyond balance, to either side",
        "Deviation of the spin up to 80 degrees, over its last value; displacement aside over the length. Energy of a "
        "body that glides on its corner; smooth motion, so 0.3 %.",
        (Measure("spin", 3e-3),), _falling_plank,
    ),
    Row(
        40, "weights", "forces inside a stack at rest", "each level carries the weight above it",
        "four boxes of 60 to 90 x 24 to 36 px, 20 to 500 g each",
        "Contact impulses of half a second over weight times time, each level by itself; 0.3 %: what is at rest is in "
        "balance, so only what moves unseen can spoil it.",
        (Measure("force", 3e-3),), _weights,
    ),
)  # fmt: skip
