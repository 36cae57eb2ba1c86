"""Warnings about a compiled scene: values that are allowed and probably not intended."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.compile import Compiled, grams, mass_path, warning
from physgen.compile.world import Body, Wall
from physgen.geometry.convex import distance_to_outline, overlap_depth
from physgen.geometry.polygon import bounds, translated_outline
from physgen.maps import Percepts
from physgen.problems import Problem, by_place
from physgen.scene.scene import JointKind, Motion, Scene, Solid, View, held

Array = NDArray[np.float64]
U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class WarningLimits:
    """Thresholds of warnings."""

    away: float = 0.5
    """px by which a view may be moved without anyone seeing it."""
    reach: int = 5
    """px beyond a mask's border that its soft coverage may reach."""
    near: int = 5
    """px around what is covered in which `background.png` need not be the photo: soft borders fade there."""
    over: int = 5
    """px a side of the squares over which differences are averaged: what compression leaves of a photo is gone then."""
    levels: int = 8
    """Grey levels of such a mean from which on a pixel is not the photo's."""
    least: int = 64
    """Such pixels in one piece from which on the map counts as painted: 8 x 8 px."""
    overlap: float = 0.25
    """px of overlap at t = 0 that the engine resolves without anyone seeing it."""
    missed: float = 0.05
    """Part of a mask that its shape may miss."""
    apart: float = 1e3
    """Masses that touch or are joined: of a heavier one by a lighter, contacts come out soft or are slow to settle."""
    touch: float = 1.0
    """px between two objects that count as touching."""
    far: float = 4.0
    """px outside an object that the end of a joint may lie, however small the object is."""
    leaps: int = 4
    """Times its size that a body may move in a step before the user is warned: a few shorter steps cost nothing."""
    support: float = 4.0
    """px below an object in which its support must lie; outlines and floors of photos are off by as much."""


LIMITS = WarningLimits()
PARTS = (1.0, 0.75, 0.5, 0.25, 0.125)
"""Of the way down to its support, at which it is tried; 0.5 px is less than any object's height."""


def lint(scene: Scene, compiled: Compiled, maps: Percepts | None = None) -> list[Problem]:
    """Every warning, sorted by place; those of the photo's maps where `maps` are given."""
    rules: tuple[Callable[[Scene, Compiled], Iterator[Problem]], ...] = (
        _overlaps,
        _unsupported,
        _without_effect,
        _masses_apart,
        _too_fast,
        _far_springs,
        _missed_masks,
        _views,
    )
    found = [problem for rule in rules for problem in rule(scene, compiled)]
    return by_place([*found, *photo_differs(scene, compiled, maps)])


def _without_effect(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """What a reader would expect to change the clip, and does not."""
    motion = {item.name: item.motion for item in scene.objects}
    above = scene.world.view is View.TOP
    if scene.world.table_friction > 0 and not above:
        found, why = f"{scene.world.table_friction:g}", "has no effect seen from the side"
        yield warning(scene, "world.table.friction", found, why, "take it out, or write view: top")
    for item, body in zip(scene.objects, compiled.world.bodies, strict=True):
        path, dynamic = f"objects.{item.name}", item.motion is Motion.DYNAMIC
        fixed = f"has no effect on an object whose motion is {item.motion.value}"
        sphere = body.radius is not None and body.solid is Solid.SPHERE
        if not dynamic and (any(item.velocity) or item.spin):
            key = "velocity" if any(item.velocity) else "spin"
            yield warning(scene, f"{path}.{key}", key, fixed, "take it out, or write motion: dynamic")
        if item.rolling > 0 and not (dynamic and (sphere if above else body.radius is not None)):
            why = fixed if not dynamic else f"has no effect: only {'spheres' if above else 'circles'} roll"
            yield warning(scene, f"{path}.rolling", f"{item.rolling:g}", why, "take it out")
        if item.roll != "natural" and not (dynamic and sphere and above and scene.world.table_friction > 0):
            why = "has no effect: only dynamic spheres on a table with friction roll"
            yield warning(scene, f"{path}.roll", "roll", why, "take it out")
    for k, force in enumerate(scene.forces):
        if motion[force.object] is not Motion.DYNAMIC:
            why = f"has no effect: the motion of {force.object} is {motion[force.object].value}"
            fix = "take it out, or write motion: dynamic"
            yield warning(scene, f"forces[{k}]", force.load.value, why, fix)
        elif force.start >= scene.world.duration:
            why = f"begins after the end of the clip at {scene.world.duration:g} s"
            fix = "begin earlier or lengthen the duration"
            yield warning(scene, f"forces[{k}].start", f"{force.start:g}", why, fix)
    for joint in scene.joints:
        if all(motion[name] is not Motion.DYNAMIC for name in joint.objects):
            why = "has no effect: no object of it is dynamic"
            yield warning(
                scene, f"joints.{joint.name}", joint.name, why, "take it out, or write motion: dynamic"
            )
    for field in scene.fields:
        if not any(motion[name] is Motion.DYNAMIC for name in field.objects or motion):
            why = "has no effect: no object of it is dynamic"
            yield warning(
                scene, f"fields.{field.name}", field.name, why, "take it out, or write motion: dynamic"
            )


def _views(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """Views of the camera that would leave the photo, or that are reached when the clip is over."""
    for index, sight in enumerate(scene.render.camera):
        path = "render.camera"
        if f"{path}[{index}]" in scene.places:
            path += f"[{index}]"
        if sight.center is not None:
            x, y = held(sight.center, scene.size, scene.video_size, sight.zoom)
            if max(abs(x - sight.center[0]), abs(y - sight.center[1])) > LIMITS.away:
                found = f"[{sight.center[0]:g}, {sight.center[1]:g}]"
                expected = f"is too near the photo's border for zoom {sight.zoom:g}: the view stops at [{x:g}, {y:g}]"
                yield warning(scene, f"{path}.center", found, expected, "zoom in further, or move it there")
        end = scene.world.duration
        if sight.time > end:
            expected = f"is after the end of the motion at {end:g} s: this view is never reached"
            fix = "make it earlier, or lengthen the duration"
            yield warning(scene, f"{path}.time", f"{sight.time:g}", expected, fix)


# The photo's maps


def maps_cover_masks(maps: Percepts, labels: U16, scenery: Mask) -> bool:
    """Whether what was stored of coverage and background was made for masks like the scene's.

    `labels` (H, W) are the scene's objects, 0 = none; `scenery` (H, W) are pixels that show a boundary.
    """
    if ((labels > 0) & (maps.labels == 0)).any():
        return False
    if maps.coverage is None or not scenery.any():
        return True
    near = _grown(labels > 0, LIMITS.reach)
    return not (maps.coverage[scenery & ~near] > 0.5).any()


def photo_differs(scene: Scene, compiled: Compiled, maps: Percepts | None) -> Iterator[Problem]:
    """A photo that was edited since its maps were made: where nothing covers it, the clip shows `background.png`.

    Where `clean.png` is more like the photo than like the background, that one was painted, and is meant to differ.
    """
    if maps is None or maps.coverage is None or maps.background is None or scene.image is None:
        return
    if not maps_cover_masks(maps, compiled.labels, compiled.scenery):  # it is made anew, of the photo
        return
    open_ = ~_grown((maps.coverage > 0) | (maps.labels > 0) | (compiled.labels > 0), LIMITS.near)
    alike = cv2.inRange(
        cv2.absdiff(maps.rgb, maps.background), (0, 0, 0), (LIMITS.levels, LIMITS.levels, LIMITS.levels)
    )
    if not (open_ & (alike == 0)).any():  # as ever: nothing more to be worked out
        return
    off = _off(maps.rgb, maps.background, open_)
    differs = (np.abs(off) > LIMITS.levels).any(axis=2) & open_
    if maps.clean is not None and differs.any():
        cleaned = _off(maps.clean, maps.background, open_)
        differs &= np.abs(cleaned - off).sum(axis=2) >= np.abs(cleaned).sum(axis=2)
    differs = _large(differs)
    count = int(differs.sum())
    if not count:
        return
    rows, columns = np.flatnonzero(differs.any(axis=1)), np.flatnonzero(differs.any(axis=0))
    where = f"x {columns[0]} to {columns[-1]}, y {rows[0]} to {rows[-1]}"
    expected = (
        f"differs from background.png in {count:,} px beside the objects ({where}): the clip shows that one"
    )
    fix = "if the photo was edited, physgen perceive --refresh makes the maps anew; if the map was painted, all is well"
    yield warning(scene, "image", scene.image.name, expected, fix)


def _off(one: U8, other: U8, within: Mask) -> NDArray[np.int16]:
    """(H, W, 3) grey levels from the other to the one, means over squares of what is `within`."""
    off = cv2.subtract(one, other, dtype=cv2.CV_16S)
    off[~within] = 0
    return np.asarray(cv2.blur(off, (LIMITS.over, LIMITS.over)), np.int16)


def _large(mask: Mask) -> Mask:
    """(H, W): its connected pieces of `LIMITS.least` px or more; compression leaves specks."""
    _, ids, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    large = stats[:, cv2.CC_STAT_AREA] >= LIMITS.least
    large[0] = False
    return np.asarray(large[ids])


def _grown(mask: Mask, by: int) -> Mask:
    """(H, W): the mask and all within `by` px of it, to the sides and aslant."""
    reach = np.ones((2 * by + 1, 2 * by + 1), np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), reach) > 0)


# Contacts, masses and speeds


def _overlaps(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    boxes = np.array([bounds(outline) for outline in compiled.outlines]).reshape(-1, 4)
    lines = WallSegments(compiled.world.walls)
    # a wheel may lie before the car that it is joined to
    through = {frozenset(joint.objects) for joint in scene.joints if not joint.collide}
    for i, item in enumerate(scene.objects):
        path = f"objects.{item.name}.shape"
        for j in _near(boxes, i, 0.0):
            if {item.name, scene.objects[j].name} in through:
                continue
            depth = overlap_depth(compiled.outlines[i], compiled.outlines[j])
            if depth > LIMITS.overlap:
                expected = f"overlaps {scene.objects[j].name} by {depth:.1f} px at t = 0"
                fix = "move or shrink one of them, or they are pushed apart"
                yield warning(scene, path, item.name, expected, fix)
        if item.motion is Motion.DYNAMIC:
            for wall, depth in lines.across(compiled.world.bodies[i]).items():
                if depth > LIMITS.overlap:
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
    if mass[dynamic].max() <= LIMITS.apart * mass[dynamic].min():
        return
    pairs = {
        (min(joint.first, joint.second), max(joint.first, joint.second)): "is joined to"
        for joint in compiled.world.joints
        if joint.second is not None
    }
    boxes = np.array([bounds(outline) for outline in compiled.outlines]).reshape(-1, 4)
    for i in np.flatnonzero(dynamic).tolist():
        for j in _near(boxes, i, LIMITS.touch):
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
    return max(a, b) > LIMITS.apart * min(a, b)


def _touch(compiled: Compiled, i: int, j: int) -> bool:
    one, other = compiled.outlines[i], compiled.outlines[j]
    way = compiled.world.bodies[j].center - compiled.world.bodies[i].center
    step = way / max(float(np.hypot(*way)), 1e-9) * LIMITS.touch
    return overlap_depth(one, other) > 0 or overlap_depth(translated_outline(one, step), other) > 0


def _too_fast(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    for item, body in zip(scene.objects, compiled.world.bodies, strict=True):
        step = float(np.hypot(*body.velocity)) / scene.world.steps_per_second
        if step > LIMITS.leaps * body.size:
            expected = (
                f"moves {step:.0f} px a step, over its size of {body.size:.0f} px: "
                "steps are divided where it could pass through something, which takes time"
            )
            fix = "lower the velocity, or raise world.steps_per_second"
            yield warning(scene, f"objects.{item.name}.velocity", item.name, expected, fix)


def _far_springs(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """Ends of springs that lie away from what they ride on: farther than the object reaches."""
    index = {item.name: k for k, item in enumerate(scene.objects)}
    for item in scene.joints:
        if item.kind is JointKind.SPRING:
            for name, point, end in zip(item.objects, item.points, ("begins", "ends"), strict=False):
                away = distance_to_outline(compiled.outlines[index[name]], np.array(point))
                if away > max(compiled.world.bodies[index[name]].reach, LIMITS.far):
                    expected = f"{end} {away:.0f} px outside {name}"
                    fix = "move that end onto it"
                    yield warning(scene, f"joints.{item.name}.spring", item.name, expected, fix)


def _missed_masks(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    for item, missed in zip(scene.objects, compiled.shapes.missed, strict=True):
        if missed > LIMITS.missed:
            expected = f"misses {missed:.0%} of its mask"
            fix = "write shape: auto, or correct the outline"
            yield warning(scene, f"objects.{item.name}.shape", "the shape", expected, fix)


# Support


def _unsupported(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """Objects of a photo, at rest, with nothing under them or under what they are joined to."""
    gravity = compiled.world.gravity
    if scene.image is None or scene.world.view is View.TOP or not gravity.any():
        return
    lines = WallSegments(compiled.world.walls)
    step = gravity / float(np.hypot(*gravity)) * LIMITS.support
    boxes = np.array([bounds(outline) for outline in compiled.outlines]).reshape(-1, 4)

    def rests(i: int) -> bool:
        lowered = translated_outline(compiled.outlines[i], step)
        x0, y0, x1, y1 = bounds(lowered)
        near = np.flatnonzero(
            (boxes[:, 0] < x1) & (boxes[:, 2] > x0) & (boxes[:, 1] < y1) & (boxes[:, 3] > y0)
        )
        if any(j != i and overlap_depth(lowered, compiled.outlines[j]) > 0 for j in near.tolist()):
            return True
        # what is thinner than the step would be past the line under it
        return any(lines.across(compiled.world.bodies[i], step * part) for part in PARTS)

    hanging = [i for group in _joined(scene) if not any(map(rests, group)) for i in group]
    for item in (scene.objects[i] for i in sorted(hanging)):
        if not any(item.velocity):
            expected = "is supported by nothing and falls at once"
            fix = "put a boundary under it, hold it with a joint, or write motion: static"
            yield warning(scene, f"objects.{item.name}", item.name, expected, fix)


def _joined(scene: Scene) -> list[set[int]]:
    """The dynamic objects that joints hold together; those that are held to what does not fall are left out."""
    index = {item.name: k for k, item in enumerate(scene.objects)}
    root = list(range(len(scene.objects) + 1))
    fixed = len(scene.objects)  # the world, and all that stands in it

    def find(k: int) -> int:
        while root[k] != k:
            root[k] = k = root[root[k]]
        return k

    for k, item in enumerate(scene.objects):
        if item.motion is not Motion.DYNAMIC:
            root[k] = fixed
    for joint in scene.joints:
        ends = [index[name] for name in joint.objects]
        root[find(ends[0])] = find(ends[1] if len(ends) == 2 else fixed)
    groups: dict[int, set[int]] = {}
    for k in range(len(scene.objects)):
        if find(k) != find(fixed):
            groups.setdefault(find(k), set()).add(k)
    return list(groups.values())


class WallSegments:
    """The segments of all walls, found by where they lie."""

    def __init__(self, walls: Sequence[Wall]) -> None:
        chains = [(k, chain) for k, wall in enumerate(walls) for chain in wall.chains]
        none = np.zeros((0, 2))
        self.start = np.concatenate([none, *(chain[:-1] for _, chain in chains)])
        self.end = np.concatenate([none, *(chain[1:] for _, chain in chains)])
        self.wall = np.repeat([k for k, _ in chains], [len(chain) - 1 for _, chain in chains]).astype(np.intp)
        self._low, self._high = np.minimum(self.start, self.end), np.maximum(self.start, self.end)

    def across(self, body: Body, by: Array | None = None) -> dict[int, float]:
        """Index of every wall that a body, moved by `by` (2,) px, reaches across, and how far, px."""
        points = _extremes(body) + body.center + (0.0 if by is None else by)
        meet = (self._low <= points.max(axis=0)) & (self._high >= points.min(axis=0))
        deepest: dict[int, float] = {}
        for k in np.flatnonzero(meet.all(axis=1)).tolist():
            depth = _sunk(body, self.start[k], self.end[k], by)
            wall = int(self.wall[k])
            if depth > deepest.get(wall, 0.0):
                deepest[wall] = depth
        return deepest


def _extremes(body: Body) -> Array:
    if body.radius is not None:
        return np.array([[-body.radius, -body.radius], [body.radius, body.radius]])
    return np.concatenate(body.pieces)


def _sunk(body: Body, a: Array, b: Array, by: Array | None) -> float:
    """How far a body reaches across the segment from a to b, px; 0 when it does not touch."""
    center = body.center if by is None else body.center + by
    along = b - a
    length = float(np.hypot(*along))
    if length == 0:
        return 0.0
    along = along / length
    if body.radius is not None:
        at = float(np.clip((center - a) @ along, 0, length))
        return max(0.0, body.radius - float(np.hypot(*(center - a - at * along))))
    across = np.array([-along[1], along[0]])
    places = (piece + center - a for piece in body.pieces)
    return max(_across(points @ along, points @ across, length) for points in places)


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
