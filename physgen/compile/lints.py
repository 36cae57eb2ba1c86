"""Scene + Compiled -> warnings: things that are allowed and probably not meant."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from physgen.compile.assemble import Compiled
from physgen.compile.world import Body, Wall
from physgen.outline.outline import Disc, Outline, Region, Ring, bounds
from physgen.outline.overlap import overlap_depth
from physgen.outline.raster import coverage_box
from physgen.problems import Problem, Severity, by_place
from physgen.scene.model import Auto, Motion, Scene, View

Array = NDArray[np.float64]

OVERLAP = 0.25
"""px of overlap at t = 0 that the engine resolves without anyone seeing it."""
REACH = 4.0
"""px below an object in which its support must lie; outlines and floors of photos are off by as much."""
MISSED = 0.05
"""Part of a mask that its shape may miss."""


def lint(scene: Scene, compiled: Compiled) -> list[Problem]:
    """Every warning, sorted by place."""
    rules: tuple[Callable[[Scene, Compiled], Iterator[Problem]], ...] = (
        _overlaps,
        _unsupported,
        _without_effect,
        _too_fast,
        _missed_masks,
    )
    return by_place(problem for rule in rules for problem in rule(scene, compiled))


def _warning(scene: Scene, path: str, found: str, expected: str, fix: str) -> Problem:
    return Problem(scene.place(path), path, found, expected, fix, Severity.WARNING)


def _overlaps(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    boxes = np.array([bounds(outline) for outline in compiled.outlines]).reshape(-1, 4)
    for i, item in enumerate(scene.objects):
        path = f"objects.{item.name}.shape"
        near = np.flatnonzero(
            (boxes[:i, 0] < boxes[i, 2])
            & (boxes[:i, 2] > boxes[i, 0])
            & (boxes[:i, 1] < boxes[i, 3])
            & (boxes[:i, 3] > boxes[i, 1])
        )
        for j in near.tolist():
            depth = overlap_depth(compiled.outlines[i], compiled.outlines[j])
            if depth > OVERLAP:
                other = scene.objects[j].name
                expected = f"overlaps {other} by {depth:.1f} px at t = 0"
                yield _warning(
                    scene, path, item.name, expected, "move or shrink one of them, or they are pushed apart"
                )
        if item.motion is Motion.DYNAMIC:
            for wall in compiled.world.walls:
                depth = _sunk(compiled.world.bodies[i], wall)
                if depth > OVERLAP:
                    expected = f"reaches {depth:.1f} px across boundary {wall.name} at t = 0"
                    yield _warning(scene, path, item.name, expected, "move the boundary or the object")


def _unsupported(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    gravity = compiled.world.gravity
    strength = float(np.hypot(*gravity))
    if scene.world.view is View.TOP or strength == 0 or scene.image is None:
        return  # seen from above, or a lesson, where things hang in the air on purpose
    step = gravity / strength * REACH
    boxes = np.array([bounds(outline) for outline in compiled.outlines]).reshape(-1, 4)
    for i, item in enumerate(scene.objects):
        if item.motion is not Motion.DYNAMIC or any(item.velocity):
            continue
        lowered = _moved(compiled.outlines[i], step)
        x0, y0, x1, y1 = bounds(lowered)
        near = np.flatnonzero(
            (boxes[:, 0] < x1) & (boxes[:, 2] > x0) & (boxes[:, 1] < y1) & (boxes[:, 3] > y0)
        )
        if any(j != i and overlap_depth(lowered, compiled.outlines[j]) > 0 for j in near.tolist()):
            continue
        if any(_sunk(compiled.world.bodies[i], wall, step) > 0 for wall in compiled.world.walls):
            continue
        expected = "is supported by nothing and falls at once"
        yield _warning(
            scene,
            f"objects.{item.name}",
            item.name,
            expected,
            "put a boundary under it, or write motion: static",
        )


def _without_effect(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    world = scene.world
    if scene.render.motion_blur > 0:
        why = "has no effect yet: the shutter is not simulated"
        yield _warning(scene, "render.motion_blur", f"{scene.render.motion_blur:g}", why, "take it out")
    if scene.refine.backend != "none":
        why = "has no effect yet: no refinement backend is installed"
        yield _warning(scene, "refine.backend", scene.refine.backend, why, "write none")
    if scene.world.table_friction > 0:
        why = (
            "has no effect seen from the side"
            if world.view is View.SIDE
            else "has no effect yet: tables are not simulated"
        )
        yield _warning(scene, "world.table.friction", f"{scene.world.table_friction:g}", why, "take it out")
    for item in scene.objects:
        path = f"objects.{item.name}"
        if item.rolling > 0:
            why = "has no effect yet: rolling resistance is not simulated"
            yield _warning(scene, f"{path}.rolling", f"{item.rolling:g}", why, "take it out")
        if item.roll != "natural":
            why = "has no effect yet: rolling on a table is not simulated"
            yield _warning(scene, f"{path}.roll", str(item.roll), why, "take it out")
        if item.motion is not Motion.DYNAMIC and (any(item.velocity) or item.spin):
            key = "velocity" if any(item.velocity) else "spin"
            why = f"has no effect on an object whose motion is {item.motion.value}"
            yield _warning(scene, f"{path}.{key}", key, why, "take it out, or write motion: dynamic")
    for k, force in enumerate(scene.forces):
        target = next(item for item in scene.objects if item.name == force.object)
        if target.motion is not Motion.DYNAMIC:
            why = f"has no effect: the motion of {target.name} is {target.motion.value}"
            yield _warning(
                scene, f"forces[{k}]", force.load.value, why, "take it out, or write motion: dynamic"
            )
        elif force.start >= world.duration:
            why = f"begins after the end of the clip at {world.duration:g} s"
            yield _warning(
                scene, f"forces[{k}].start", f"{force.start:g}", why, "begin earlier or lengthen the duration"
            )


def _too_fast(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    for item, body in zip(scene.objects, compiled.world.bodies, strict=True):
        step = float(np.hypot(*body.velocity)) / scene.world.steps_per_second
        if step > body.size:
            expected = f"moves {step:.0f} px a step, over its size of {body.size:.0f} px, and can pass through things"
            yield _warning(
                scene, f"objects.{item.name}.velocity", item.name, expected, "raise world.steps_per_second"
            )


def _missed_masks(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    for k, item in enumerate(scene.objects):
        if item.mask is None or isinstance(item.shape, Auto):
            continue
        mask = compiled.labels == k + 1
        area = int(mask.sum())
        box, (x0, y0) = coverage_box(compiled.outlines[k], (0, 0, *scene.size))
        hit = np.count_nonzero(mask[y0 : y0 + box.shape[0], x0 : x0 + box.shape[1]] & (box >= 0.5))
        missed = 1 - hit / max(area, 1)
        if missed > MISSED:
            expected = f"misses {missed:.0%} of its mask"
            yield _warning(
                scene,
                f"objects.{item.name}.shape",
                "the shape",
                expected,
                "write shape: auto, or correct the outline",
            )


def _moved(outline: Outline, by: Array) -> Outline:
    if isinstance(outline, Disc):
        return Disc(outline.center + by, outline.radius)
    return Region(tuple(Ring(r.outer + by, tuple(h + by for h in r.holes)) for r in outline.rings))


def _sunk(body: Body, wall: Wall, by: Array | None = None) -> float:
    """How far a body at t = 0, moved by `by`, reaches across a wall's segments, px; 0 when it does not touch."""
    center = body.center if by is None else body.center + by
    deepest = 0.0
    for a, b in (pair for chain in wall.chains for pair in pairwise(chain)):
        along = b - a
        length = float(np.hypot(*along))
        along = along / length
        across = np.array([-along[1], along[0]])
        if body.radius is not None:
            at = float(np.clip((center - a) @ along, 0, length))
            deepest = max(deepest, body.radius - float(np.hypot(*(center - a - at * along))))
            continue
        for piece in body.pieces:
            points = piece + center - a
            deepest = max(deepest, _across(points @ along, points @ across, length))
    return deepest


def _across(x: Array, y: Array, length: float) -> float:
    """How far a convex piece lies on both sides of the segment y = 0, 0 <= x <= length, within that length, px."""
    ends = [(x, y), (np.roll(x, -1), np.roll(y, -1))]
    heights = [y[(x >= 0) & (x <= length)]]
    for at in (0.0, length):  # where edges cross the segment's ends
        (x0, y0), (x1, y1) = ends
        cut = (x0 < at) != (x1 < at)
        heights.append(y0[cut] + (at - x0[cut]) / (x1[cut] - x0[cut]) * (y1[cut] - y0[cut]))
    inside = np.concatenate(heights)
    if not len(inside):
        return 0.0
    return max(0.0, float(min(inside.max(), -inside.min())))
