"""Warnings about a compiled scene: values that are allowed and probably not intended."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import ceil, floor

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.compile import Compiled, grams, mass_path, warning
from physgen.compile.support import WallSegments, unsupported
from physgen.compile.world import Body
from physgen.geometry.convex import distance_to_outline, overlap_depth
from physgen.geometry.framing import held, room
from physgen.geometry.polygon import bounds, translated_outline
from physgen.maps import Percepts
from physgen.problems import Problem, by_place
from physgen.scene.scene import CameraView, FieldKind, JointKind, Motion, Object, Overlay, Scene, Solid, View


def without_effect(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """What a reader would expect to change the clip, and does not."""
    yield from _stages(scene)
    for item, body in zip(scene.objects, compiled.world.bodies, strict=True):
        yield from _object(scene, item, body)
    motion = {item.name: item.motion for item in scene.objects}
    yield from _forces(scene, motion)
    yield from _joints(scene, motion)
    yield from _fields(scene, motion)


def _stages(scene: Scene) -> Iterator[Problem]:
    yield from _refine(scene)
    friction = scene.world.table_friction
    if friction > 0 and scene.world.view is View.SIDE:
        why = "has no effect seen from the side"
        yield warning(scene, "world.table.friction", f"{friction:g}", why, "take it out, or write view: top")
    for kind, what, there in (
        (Overlay.FORCES, "forces", bool(scene.forces)),
        (Overlay.WEIGHT, "gravity in the picture's plane", any(scene.world.gravity)),
        (Overlay.BOUNDARIES, "boundaries", bool(scene.boundaries)),
    ):
        if kind in scene.render.overlay and not there:
            why = f"has no effect: the scene has no {what}"
            yield warning(scene, "render.overlay", kind.value, why, "take it out")
    if scene.world.view is View.TOP:
        for key in ("tilt", "backdrop"):
            if f"world.{key}" in scene.places:
                why = "has no effect seen from above: shadows fall on the table"
                yield warning(scene, f"world.{key}", key, why, "take it out, or write view: side")


def _refine(scene: Scene) -> Iterator[Problem]:
    refine = scene.refine
    if refine.backend == "none":
        for path, place in scene.places.items():
            if path.startswith("refine.") and place.file.startswith("--set") and path != "refine.backend":
                why = "has no effect: no backend refines"
                value = str(getattr(refine, path.removeprefix("refine.")))
                yield warning(scene, path, value, why, "write --refine animatediff, or another backend")
        return
    run = floor(refine.steps * refine.strength + 0.5)
    if refine.stop >= run:
        why = f"leaves none of the {run} steps that run in which objects are drawn to the guidance"
        yield warning(scene, "refine.stop", f"{refine.stop}", why, f"write less than {run}, or more steps")
    if refine.negative and refine.guidance == 1:
        why = "has no effect: the model listens to no prompt at guidance 1"
        yield warning(scene, "refine.negative", refine.negative, why, "take it out, or write more guidance")


def _object(scene: Scene, item: Object, body: Body) -> Iterator[Problem]:
    path = f"objects.{item.name}"
    fixed = f"has no effect on an object whose motion is {item.motion.value}"
    if item.motion is not Motion.DYNAMIC and (any(item.velocity) or item.spin):
        key = "velocity" if any(item.velocity) else "spin"
        yield warning(scene, f"{path}.{key}", key, fixed, "take it out, or write motion: dynamic")
    sphere = body.radius is not None and body.solid is Solid.SPHERE
    above = scene.world.view is View.TOP
    if item.rolling > 0:
        why = fix = ""
        if item.motion is not Motion.DYNAMIC:
            why, fix = fixed, "take it out, or write motion: dynamic"
        elif body.radius is None:
            why, fix = "has no effect: only circles roll", "take it out, or write shape: {circle: ...}"
        elif above and not sphere:
            why = f"has no effect seen from above: a {body.solid.value} lies flat and does not roll"
            fix = "take it out, or write solid: sphere"
        if why:
            yield warning(scene, f"{path}.rolling", f"{item.rolling:g}", why, fix)
    if item.roll != "natural":
        why = fix = ""
        if not above:
            why, fix = "has no effect seen from the side", "take it out, or write view: top"
        elif item.motion is not Motion.DYNAMIC:
            why, fix = fixed, "take it out, or write motion: dynamic"
        elif not sphere:
            why = f"has no effect: a {body.solid.value} does not roll on a table"
            fix = "take it out, or write solid: sphere and shape: {circle: ...}"
        elif scene.world.table_friction == 0:
            why, fix = "has no effect: the table has no friction", "write world: {table: {friction: 0.2}}"
        if why:
            found = item.roll if isinstance(item.roll, str) else f"[{item.roll[0]:g}, {item.roll[1]:g}]"
            yield warning(scene, f"{path}.roll", found, why, fix)


def _forces(scene: Scene, motion: dict[str, Motion]) -> Iterator[Problem]:
    end = scene.world.duration
    for k, force in enumerate(scene.forces):
        how = motion[force.object]
        if how is not Motion.DYNAMIC:
            why = f"has no effect: the motion of {force.object} is {how.value}"
            fix = "take it out, or write motion: dynamic"
            yield warning(scene, f"forces[{k}]", force.load.value, why, fix)
        elif force.start >= end:
            why = f"begins after the end of the clip at {end:g} s"
            fix = "begin earlier or lengthen the duration"
            yield warning(scene, f"forces[{k}].start", f"{force.start:g}", why, fix)


def _joints(scene: Scene, motion: dict[str, Motion]) -> Iterator[Problem]:
    for item in scene.joints:
        path = f"joints.{item.name}"
        if all(motion[name] is not Motion.DYNAMIC for name in item.objects):
            fixed = [f"{name} is {motion[name].value}" for name in item.objects]
            why = f"has no effect: {' and '.join(fixed)}"
            yield warning(scene, path, item.name, why, "take it out, or write motion: dynamic")
        elif item.collide and len(item.objects) == 1:
            why = f"has no effect: {item.objects[0]} is joined to the world, which it bumps into anyway"
            yield warning(scene, f"{path}.collide", "true", why, "take it out")


def _fields(scene: Scene, motion: dict[str, Motion]) -> Iterator[Problem]:
    for item in scene.fields:
        path = f"fields.{item.name}"
        fix = "take it out, or write motion: dynamic"
        if not item.objects and all(how is not Motion.DYNAMIC for how in motion.values()):
            yield warning(scene, path, item.name, "has no effect: no object is dynamic", fix)
        for name in dict.fromkeys(item.objects):
            if motion[name] is not Motion.DYNAMIC:
                why = f"has no effect on {name}, whose motion is {motion[name].value}"
                yield warning(scene, f"{path}.objects", item.name, why, fix)
        key, strength = "drag", item.drag
        if item.kind is FieldKind.ATTRACTOR:
            key, strength = "strength", item.strength
        if strength == 0:
            yield warning(scene, f"{path}.{key}", f"{strength:g}", "has no effect", "write another number")


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
    fastest: int = 100_000
    """steps_per_second at most, as in the schema."""
    far: float = 4.0
    """px outside an object that the end of a joint may lie, however small the object is."""
    leaps: int = 4
    """Times its size that a body may move in a step before the user is warned: a few shorter steps cost nothing."""


LIMITS = WarningLimits()


def camera_warnings(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """Views that would leave the photo, or that are reached when the clip is over."""
    for index, sight in enumerate(scene.render.camera):
        path = "render.camera"
        if f"{path}[{index}]" in scene.places:
            path += f"[{index}]"
        yield from _still(scene, sight, path)
        end = scene.world.duration
        if sight.time > end:
            expected = f"is after the end of the motion at {end:g} s: this view is never reached"
            fix = "make it earlier, or lengthen the duration"
            yield warning(scene, f"{path}.time", f"{sight.time:g}", expected, fix)


def _still(scene: Scene, sight: CameraView, path: str) -> Iterator[Problem]:
    photo, video = scene.size, scene.video_size
    if sight.center is not None:
        x, y = held(sight.center, photo, video, sight.zoom)
        if max(abs(x - sight.center[0]), abs(y - sight.center[1])) > LIMITS.away:
            found = f"[{sight.center[0]:g}, {sight.center[1]:g}]"
            expected = (
                f"is too near the photo's border for zoom {sight.zoom:g}: the view stops at [{x:g}, {y:g}]"
            )
            fix = "zoom in further, or move it there"
            yield warning(scene, f"{path}.center", found, expected, fix)
    elif sight.follow is not None:
        low, high = room(photo, video, sight.zoom)
        if max(high[0] - low[0], high[1] - low[1]) < 1:
            expected = f"has no effect: at zoom {sight.zoom:g} all of the photo is seen"
            yield warning(
                scene, f"{path}.follow", sight.follow, expected, "write zoom: 1.5 or more beside it"
            )


U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
Mask = NDArray[np.bool_]


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


Array = NDArray[np.float64]


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
        camera_warnings,
    )
    found = [problem for rule in rules for problem in rule(scene, compiled)]
    return by_place([*found, *photo_differs(scene, compiled, maps)])


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
    rate = scene.world.steps_per_second
    for item, body in zip(scene.objects, compiled.world.bodies, strict=True):
        step = float(np.hypot(*body.velocity)) / rate
        if step > LIMITS.leaps * body.size:
            expected = (
                f"moves {step:.0f} px a step, over its size of {body.size:.0f} px: "
                "steps are divided where it could pass through something, which takes time"
            )
            even = ceil(step / body.size * rate - 1e-6)
            fix = "lower the velocity"
            if even <= LIMITS.fastest:
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

    A pin of one object may, and one between two: it is the end of a rod that is not drawn.
    """
    index = {item.name: k for k, item in enumerate(scene.objects)}
    boxes = np.array([bounds(outline) for outline in compiled.outlines]).reshape(-1, 4)
    useful = {joint.name for joint in compiled.world.joints}

    def outside(name: str, point: Array) -> float:
        """px, 0 where it is near enough: within as far again as the object reaches."""
        body = compiled.world.bodies[index[name]]
        away = distance_to_outline(compiled.outlines[index[name]], point)
        return away if away > max(body.reach, LIMITS.far) else 0.0

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
        if missed > LIMITS.missed:
            expected = f"misses {missed:.0%} of its mask"
            fix = "write shape: auto, or correct the outline"
            yield warning(scene, f"objects.{item.name}.shape", "the shape", expected, fix)
