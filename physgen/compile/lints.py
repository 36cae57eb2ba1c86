"""Scene + Compiled -> warnings: things that are allowed and probably not meant."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import ceil

import numpy as np
from numpy.typing import NDArray

from physgen.compile.assemble import Compiled
from physgen.compile.effects import without_effect
from physgen.compile.film import filming
from physgen.compile.masses import grams, mass_path
from physgen.compile.reach import Lines, distance, moved
from physgen.compile.stored import unlike_photo
from physgen.compile.support import unsupported
from physgen.compile.warning import warning
from physgen.outline.outline import bounds
from physgen.outline.overlap import overlap_depth
from physgen.percepts.maps import Percepts
from physgen.problems import Problem, by_place
from physgen.scene.model import JointKind, Motion, Scene

Array = NDArray[np.float64]

OVERLAP = 0.25
"""px of overlap at t = 0 that the engine resolves without anyone seeing it."""
MISSED = 0.05
"""Part of a mask that its shape may miss."""
APART = 1e3
"""Masses that touch or are joined: of a heavier one by a lighter, contacts come out soft or are slow to settle."""
TOUCH = 1.0
"""px between two objects that count as touching."""
FASTEST = 100_000
"""steps_per_second at most, as in the schema."""
FAR = 4.0
"""px outside an object that the end of a joint may lie, however small the object is."""
LEAPS = 4
"""Times its size that a body may move in a step before anyone is told: a few shorter steps cost nothing."""


def lint(scene: Scene, compiled: Compiled, maps: Percepts | None = None) -> list[Problem]:
    """Every warning, sorted by place; those of the photo's maps where `maps` are given."""
    rules: tuple[Callable[[Scene, Compiled], Iterator[Problem]], ...] = (
        _overlaps,
        unsupported,
        without_effect,
        _masses_apart,
        _too_fast,
        _paths_that_end,
        _far_joints,
        _missed_masks,
        filming,
    )
    found = [problem for rule in rules for problem in rule(scene, compiled)]
    return by_place([*found, *unlike_photo(scene, compiled, maps)])


def _overlaps(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    boxes = np.array([bounds(outline) for outline in compiled.outlines]).reshape(-1, 4)
    lines = Lines(compiled.world.walls)
    # a wheel may lie before the car that it is joined to
    through = {frozenset(joint.objects) for joint in scene.joints if not joint.collide}
    for i, item in enumerate(scene.objects):
        path = f"objects.{item.name}.shape"
        for j in _near(boxes, i, 0.0):
            if {item.name, scene.objects[j].name} in through:
                continue
            depth = overlap_depth(compiled.outlines[i], compiled.outlines[j])
            if depth > OVERLAP:
                expected = f"overlaps {scene.objects[j].name} by {depth:.1f} px at t = 0"
                fix = "move or shrink one of them, or they are pushed apart"
                yield warning(scene, path, item.name, expected, fix)
        if item.motion is Motion.DYNAMIC:
            for wall, depth in lines.across(compiled.world.bodies[i]).items():
                if depth > OVERLAP:
                    name = scene.boundaries[wall].name
                    expected = f"reaches {depth:.1f} px across boundary {name} at t = 0"
                    yield warning(scene, path, item.name, expected, "move the boundary or the object")


def _near(boxes: Array, i: int, margin: float) -> list[int]:
    """Indices below i of the boxes (N, 4) that meet the i-th, grown by a margin."""
    x0, y0, x1, y1 = boxes[i] + (-margin, -margin, margin, margin)
    meet = (boxes[:i, 0] < x1) & (boxes[:i, 2] > x0) & (boxes[:i, 1] < y1) & (boxes[:i, 3] > y0)
    found: list[int] = np.flatnonzero(meet).tolist()
    return found


def _masses_apart(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    bodies = compiled.world.bodies
    dynamic = np.array([body.motion is Motion.DYNAMIC for body in bodies], bool)
    if not dynamic.any():
        return
    mass = np.array([body.mass for body in bodies])
    if mass[dynamic].max() <= APART * mass[dynamic].min():
        return
    pairs = {
        (min(joint.first, joint.second), max(joint.first, joint.second)): "is joined to"
        for joint in compiled.world.joints
        if joint.second is not None
    }
    boxes = np.array([bounds(outline) for outline in compiled.outlines]).reshape(-1, 4)
    for i in np.flatnonzero(dynamic).tolist():
        for j in _near(boxes, i, TOUCH):
            if _apart(mass[i], mass[j]) and _touch(compiled, i, j):
                pairs.setdefault((j, i), "touches")
    for (i, j), how in sorted(pairs.items()):
        if not (dynamic[i] and dynamic[j] and _apart(mass[i], mass[j])):
            continue
        light, heavy = (i, j) if mass[i] < mass[j] else (j, i)
        name, other = bodies[light].name, bodies[heavy].name
        expected = (
            f"{how} {other}, which is {mass[heavy] / mass[light]:.1e} times as heavy: the motion is not exact"
        )
        found = f"{name} of {grams(mass[light])}"
        yield warning(scene, mass_path(scene, name), found, expected, "bring the masses nearer")


def _apart(a: float, b: float) -> bool:
    return max(a, b) > APART * min(a, b)


def _touch(compiled: Compiled, i: int, j: int) -> bool:
    one, other = compiled.outlines[i], compiled.outlines[j]
    way = compiled.world.bodies[j].center - compiled.world.bodies[i].center
    step = way / max(float(np.hypot(*way)), 1e-9) * TOUCH
    return overlap_depth(one, other) > 0 or overlap_depth(moved(one, step), other) > 0


def _too_fast(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    rate = scene.world.steps_per_second
    for item, body in zip(scene.objects, compiled.world.bodies, strict=True):
        step = float(np.hypot(*body.velocity)) / rate
        if step > LEAPS * body.size:
            expected = (
                f"moves {step:.0f} px a step, over its size of {body.size:.0f} px: "
                "steps are divided where it could pass through something, which takes time"
            )
            even = ceil(step / body.size * rate - 1e-6)
            fix = "lower the velocity"
            if even <= FASTEST:
                fix += f", or write world.steps_per_second: {even} for steps of one length"
            yield warning(scene, f"objects.{item.name}.velocity", item.name, expected, fix)


def _paths_that_end(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    end = scene.world.duration
    for item in scene.objects:
        if item.path and item.path[-1].time < end:
            expected = (
                f"ends at {item.path[-1].time:g} s, the clip at {end:g} s: it stays where it is from then on"
            )
            path = f"objects.{item.name}.motion.path"
            yield warning(scene, path, item.name, expected, f"add a knot at {end:g} s")


def _far_joints(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """An end of a spring, or a pin of two objects, that lies away from what it rides on.

    A pin of one object may, and one between two: it is the end of a rod that nobody draws.
    """
    index = {item.name: k for k, item in enumerate(scene.objects)}
    boxes = np.array([bounds(outline) for outline in compiled.outlines]).reshape(-1, 4)
    useful = {joint.name for joint in compiled.world.joints}

    def outside(name: str, point: Array) -> float:
        """px, 0 where it is near enough: within as far again as the object reaches."""
        body = compiled.world.bodies[index[name]]
        away = distance(compiled.outlines[index[name]], point)
        return away if away > max(body.reach, FAR) else 0.0

    for item in scene.joints:
        if item.name not in useful:
            continue
        path = f"joints.{item.name}.{item.kind.value}"
        points = [np.array(point) for point in item.points]
        if item.kind is JointKind.SPRING:
            off = [outside(name, at) for name, at in zip(item.objects, points, strict=False)]
            turned = zip(item.objects, reversed(points), strict=False)
            swapped = len(item.objects) == 2 and not any(outside(name, at) for name, at in turned)
            for k, away in enumerate(off):
                if away:
                    expected = f"{'begins' if k == 0 else 'ends'} {away:.0f} px outside {item.objects[k]}"
                    fix = "write the two points the other way round" if swapped else "move that end onto it"
                    yield warning(scene, path, item.name, expected, fix)
        elif len(item.objects) == 2:
            a, b = item.objects
            one, other = outside(a, points[0]), outside(b, points[0])
            both = boxes[[index[a], index[b]]].reshape(2, 2, 2)
            between = (both[:, 0].min(axis=0) <= points[0]) & (points[0] <= both[:, 1].max(axis=0))
            if one and other and not between.all():
                expected = f"lies {one:.0f} px outside {a} and {other:.0f} px outside {b}"
                yield warning(scene, path, item.name, expected, "move it onto one of them")


def _missed_masks(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    for item, missed in zip(scene.objects, compiled.shapes.missed, strict=True):
        if missed > MISSED:
            expected = f"misses {missed:.0%} of its mask"
            fix = "write shape: auto, or correct the outline"
            yield warning(scene, f"objects.{item.name}.shape", "the shape", expected, fix)
