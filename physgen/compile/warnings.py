"""Warnings about a compiled scene: values that are allowed and probably not intended."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import ceil, sqrt

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.affinity import translate

from physgen.compile.compile import Compiled
from physgen.compile.shapes import U16
from physgen.compile.starts import velocities_that_joints_allow
from physgen.geometry.convex import outline_shape, overlap_depth
from physgen.geometry.raster import coverage_box
from physgen.maps import U8, Percepts
from physgen.messages import Message
from physgen.problems import Problem, by_place
from physgen.scene.files import equal
from physgen.scene.load import EARTH
from physgen.scene.scene import (
    Auto,
    FieldKind,
    JointKind,
    Motion,
    Scene,
    Solid,
    View,
    collides,
    held,
)
from physgen.text import listed, percent, quoted

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class WarningLimits:
    """Thresholds of warnings."""

    away: float = 0.5  # px by which a view may be moved without anyone seeing it
    reach: int = 5  # px beyond a mask's border that its soft coverage may reach
    pairs: int = (
        200  # overlapping pairs that are named, about; further ones are counted
    )
    overlap: float = (
        0.25  # px of overlap at t = 0 that the engine resolves without anyone seeing it
    )
    near: float = 42 / 512
    """Of the photo's longer side: around what is covered `background.png` need not be the photo; rims and contact
    shadows are filled there."""
    over: int = 5
    """px a side of the squares over which differences are averaged: what compression leaves of a photo is gone then."""
    levels: int = (
        8  # grey levels of such a mean from which on a pixel is not the photo's
    )
    least: int = (
        64  # such pixels in one piece from which on a map counts as different: 8 x 8 px
    )
    missed: float = 0.03
    """Part of a mask that its shape may miss, or by which it may reach beyond what the photo shows of any object."""
    seen: float = 0.08
    """Of a mask's size (root of its area): how far it may reach beyond the hull of its shape.

    The photo also shows a top, an inside or a rim nearer the lens."""
    thin: int = 5  # px: threads and wires narrower than this need no shape
    frames: int = 1800  # a minute of video at 30 a second: more is seldom meant
    excluded: float = (
        0.01  # part of a velocity at t = 0 that joints may change unnoticed
    )
    weak: float = 0.1
    """Of the Earth's gravity: the Moon's is 0.17 of it; a weaker one is m/s² without the unit."""
    fall: float = 0.2
    """px by which gravity moves an object within a step, from which on stacks sink by 0.4 px and more."""
    most_steps: float = 1e5
    """1/s: steps that a scene may ask for."""
    visible: float = 0.5  # px from the centre: a smaller object fills no pixel
    draws: float = (
        0.03  # s for a frame of 512 x 512 px and its files, about, on two cores of 2020
    )
    support: float = 4.0
    """px below an object in which its support must lie; outlines and floors of photos are off by as much."""


LIMITS = WarningLimits()
PARTS = (1.0, 0.75, 0.5, 0.25, 0.125)
"""Of the way down to its support, at which an object is tried; 0.5 px is less than any object's height."""
TOUCH = 1e-6  # px of overlap that rounding makes of none
SAMPLES = 32  # places along a boundary within an object at which its depth is taken


def lint(
    scene: Scene, compiled: Compiled, maps: Percepts | None = None
) -> list[Problem]:
    """Every warning, sorted by place; those of the photo's maps where `maps` are given."""
    rules = (
        _overlaps,
        _unsupported,
        _without_effect,
        _excluded_starts,
        _weak_gravity,
        _coarse_steps,
        _invisible,
        _missed_masks,
        _views,
        _followed,
        _long,
    )
    found = [problem for rule in rules for problem in rule(scene, compiled)]
    return by_place(
        [*found, *photo_differs(scene, compiled, maps), *_doubtful(scene, maps)]
    )


def warning(
    scene: Scene, path: str, found: str, message: Message, **values: object
) -> Problem:
    """Return a warning at the place where `path` was written."""
    return message.warning(scene.place(path), path, found, **values)


def _without_effect(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """What a reader would expect to change the clip, and does not."""
    motion = {item.name: item.motion for item in scene.objects}
    above = scene.world.view is View.TOP
    if scene.world.table_friction > 0 and not above:
        found = f"{scene.world.table_friction:g}"
        yield warning(scene, "world.table.friction", found, Message.TABLE_FROM_SIDE)
    for item, body in zip(scene.objects, compiled.world.bodies, strict=True):
        path, dynamic = f"objects.{item.name}", item.motion is Motion.DYNAMIC
        motion_name = item.motion.value
        sphere = body.radius is not None and body.solid is Solid.SPHERE
        if not dynamic and (any(item.velocity) or item.spin):
            key = "velocity" if any(item.velocity) else "spin"
            not_dynamic = Message.NO_EFFECT_ON_MOTION
            yield warning(scene, f"{path}.{key}", key, not_dynamic, motion=motion_name)
        is_round = body.radius is not None or bool(body.wheels)
        if item.wheels and not body.wheels:
            path_of_wheels = f"{path}.wheels"
            if above:
                message = Message.WHEELS_FROM_ABOVE
                yield warning(scene, path_of_wheels, "wheels", message)
            else:
                message = Message.NO_EFFECT_ON_MOTION
                yield warning(
                    scene, path_of_wheels, "wheels", message, motion=motion_name
                )
        if item.rolling > 0 and not (dynamic and (sphere if above else is_round)):
            where, found = f"{path}.rolling", f"{item.rolling:g}"
            if dynamic:
                round_bodies = "spheres" if above else "circles"
                message = Message.ROLLING_HAS_NO_EFFECT
                yield warning(scene, where, found, message, shapes=round_bodies)
            else:
                message = Message.NO_EFFECT_ON_MOTION
                yield warning(scene, where, found, message, motion=motion_name)
        rocks = dynamic and body.radius is None and not above
        if item.rocking and not rocks:
            where, found = f"{path}.rocking", f"{item.rocking:g}"
            yield warning(scene, where, found, Message.ROCKING_HAS_NO_EFFECT)
        if item.roll != "natural" and not (
            dynamic and sphere and above and scene.world.table_friction > 0
        ):
            yield warning(scene, f"{path}.roll", "roll", Message.ROLL_HAS_NO_EFFECT)
    for k, force in enumerate(scene.forces):
        if motion[force.object] is not Motion.DYNAMIC:
            yield warning(
                scene,
                f"forces[{k}]",
                force.load.value,
                Message.FORCE_HAS_NO_EFFECT,
                name=force.object,
                motion=motion[force.object].value,
            )
        elif force.start >= compiled.world.duration:
            where, found = f"forces[{k}].start", f"{force.start:g}"
            late, end = Message.FORCE_AFTER_END, compiled.world.duration
            yield warning(scene, where, found, late, end=end)
    for joint in scene.joints:
        if all(motion[name] is not Motion.DYNAMIC for name in joint.objects):
            where, nothing = f"joints.{joint.name}", Message.MOVES_NO_OBJECT
            yield warning(scene, where, joint.name, nothing)
    yield from _gears_without_pins(scene, motion)
    for field in scene.fields:
        if not any(motion[name] is Motion.DYNAMIC for name in field.objects or motion):
            where, nothing = f"fields.{field.name}", Message.MOVES_NO_OBJECT
            yield warning(scene, where, field.name, nothing)
        has_table = above and scene.world.table_friction > 0
        if field.kind in (FieldKind.BELT, FieldKind.TURNTABLE) and not has_table:
            where, idle = f"fields.{field.name}", Message.CARRIES_NOTHING
            yield warning(scene, where, field.name, idle)


def _gears_without_pins(
    scene: Scene, motion: Mapping[str, Motion]
) -> Iterator[Problem]:
    """Gears of dynamic objects that nothing holds in place."""
    pinned = set[str]()
    for joint in scene.joints:
        if joint.kind in (JointKind.PIVOT, JointKind.MOTOR, JointKind.WELD):
            pinned.update(joint.objects)
    for joint in scene.joints:
        if joint.kind is not JointKind.GEAR:
            continue
        loose = [
            name
            for name in joint.objects
            if name not in pinned and motion[name] is Motion.DYNAMIC
        ]
        if loose:
            names = listed(loose, "and")
            message = Message.GEAR_WITHOUT_PIN
            yield warning(
                scene, f"joints.{joint.name}", joint.name, message, names=names
            )


def _excluded_starts(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """Velocities at t = 0 that joints exclude, with those that they allow."""
    world = compiled.world
    if not world.joints:
        return
    allowed = velocities_that_joints_allow(world)
    for k, (item, body) in enumerate(zip(scene.objects, world.bodies, strict=True)):
        if body.motion is not Motion.DYNAMIC or not (any(item.velocity) or item.spin):
            continue
        change = allowed[k] - (*body.velocity, body.spin)
        speed = float(np.hypot(*body.velocity)) + abs(body.spin) * body.reach
        off = float(np.hypot(*change[:2])) + abs(change[2]) * body.reach
        if off <= LIMITS.excluded * speed:
            continue
        x, y, spin = allowed[k, 0], allowed[k, 1], np.degrees(allowed[k, 2])
        key = "velocity" if any(item.velocity) else "spin"
        path, excluded = f"objects.{item.name}.{key}", Message.JOINTS_EXCLUDE_START
        yield warning(scene, path, key, excluded, x=x, y=y, spin=spin)


def _weak_gravity(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """Gravity without a unit that is too weak to be meant in px/s²."""
    world = scene.world
    strength = float(np.hypot(*world.gravity)) / world.pixels_per_meter
    is_stated = "world.gravity" in scene.places and not world.gravity_in_units
    if world.view is View.TOP or not is_stated or strength == 0:
        return
    if strength < LIMITS.weak * EARTH:
        x, y = world.gravity
        yield warning(
            scene,
            "world.gravity",
            f"[{x:g}, {y:g}]",
            Message.GRAVITY_WEAK,
            strength=strength,
            x=x,
            y=y,
        )


def _coarse_steps(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """Steps in which gravity moves objects so far that stacks sink or fall."""
    world = compiled.world
    strength = float(np.hypot(*world.gravity))
    fall = strength / world.steps_per_second**2
    if fall <= LIMITS.fall:
        return
    steps = 100 * ceil(sqrt(strength / LIMITS.fall) / 100)
    message = Message.STEPS_COARSE
    if steps > LIMITS.most_steps:
        message = Message.SCALE_TOO_FINE
    path, found = "world.steps_per_second", f"{world.steps_per_second:g}"
    yield warning(scene, path, found, message, fall=fall, steps=steps)


def _invisible(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """Objects smaller than a pixel, as sizes in meters are."""
    for item, body in zip(scene.objects, compiled.world.bodies, strict=True):
        if body.reach >= LIMITS.visible:
            continue
        found = f"{item.name} of {2 * body.reach:.2g} px"
        path = f"objects.{item.name}.shape"
        yield warning(scene, path, found, Message.SHAPE_INVISIBLE)


def _followed(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """Numbers that follow a label or a scale, where the file still has those for another."""
    record, scale = scene.record, scene.world.pixels_per_meter
    stated = "world.pixels_per_meter" in scene.places
    if stated and record.scale is not None and not equal(record.scale, scale):
        changed = Message.SCALE_CHANGED
        if record.world.get("by_labels"):
            changed = Message.SCALE_OF_NEW_LABELS
        where, found = "world.pixels_per_meter", f"{scale:g}"
        yield warning(scene, where, found, changed, perceived=record.scale)
    for item in scene.objects:
        was = record.entry(item.name, scene.document["objects"][item.name])
        if was.get("label", item.label) != item.label:
            ours = item.provenance.keys() & was.keys()
            keys = [key for key in ("mass", "friction", "elasticity") if key in ours]
            now = [
                f"{key} {getattr(item, key):g}"
                for key in keys
                if not equal(getattr(item, key), was[key])
            ]
            if now:
                where, found = f"objects.{item.name}.label", quoted(item.label)
                changed, values = Message.LABEL_CHANGED, ", ".join(now)
                yield warning(scene, where, found, changed, values=values)


def _long(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """A clip of many frames, which takes long."""
    frames, (width, height) = len(compiled.world.times), scene.video_size
    if frames > LIMITS.frames:
        minutes = frames * LIMITS.draws * max(width * height / 512**2, 1) / 60
        yield warning(
            scene,
            "world.duration",
            f"{scene.world.duration:g} s",
            Message.CLIP_LONG,
            frames=frames,
            length=frames / scene.render.fps / 60,
            minutes=minutes,
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
                yield warning(
                    scene,
                    f"{path}.center",
                    found,
                    Message.VIEW_AT_BORDER,
                    zoom=sight.zoom,
                    x=x,
                    y=y,
                )
        end = compiled.world.duration
        if sight.time > end:
            where, late = f"{path}.time", Message.VIEW_AFTER_END
            yield warning(scene, where, f"{sight.time:g}", late, end=end)


def maps_cover_masks(maps: Percepts, labels: U16, scenery: Mask) -> bool:
    """Whether what was stored of coverage and background was made for masks like the scene's.

    `labels` (H, W) are the scene's objects, 0 = none; `scenery` (H, W) are pixels that show a boundary.
    """
    if ((labels > 0) & (maps.cut_out == 0)).any():
        return False
    if maps.coverage is None or not scenery.any():
        return True
    near = _grown(labels > 0, LIMITS.reach)
    return not (maps.coverage[scenery & ~near] > 0.5).any()


def photo_differs(
    scene: Scene, compiled: Compiled, maps: Percepts | None
) -> Iterator[Problem]:
    """A photo that was edited since its maps were made: where no object is, the clip shows `background.png`.

    Where `clean.png` is more like the photo than like the background, the background was painted on purpose.
    """
    if (
        maps is None
        or maps.coverage is None
        or maps.background is None
        or scene.image is None
    ):
        return
    if not maps_cover_masks(
        maps, compiled.labels, compiled.scenery
    ):  # it is made anew, of the photo
        return
    bare = ~_grown(
        (maps.coverage > 0) | (maps.cut_out > 0) | (compiled.labels > 0),
        round(LIMITS.near * max(scene.size)),
    )
    if cv2.norm(maps.rgb, maps.background, cv2.NORM_INF, bare.astype(np.uint8)) == 0:
        return
    off = _mean_difference(maps.rgb, maps.background, bare)
    differs = (np.abs(off) > LIMITS.levels).any(axis=2) & bare
    if maps.clean is not None:
        cleaned = _mean_difference(maps.clean, maps.background, bare)
        differs &= np.abs(cleaned - off).sum(axis=2) >= np.abs(cleaned).sum(axis=2)
    _, ids, stats, _ = cv2.connectedComponentsWithStats(differs.astype(np.uint8))
    large = stats[:, cv2.CC_STAT_AREA] >= LIMITS.least  # compression leaves specks
    large[0] = False
    rows, columns = np.nonzero(large[ids])
    if len(rows):
        where = f"x {columns.min()} to {columns.max()}, y {rows.min()} to {rows.max()}"
        edited, count = Message.PHOTO_EDITED, len(rows)
        name = scene.image.name
        yield warning(scene, "image", name, edited, count=count, place=where)


def _doubtful(scene: Scene, maps: Percepts | None) -> Iterator[Problem]:
    """Doubtful ids that no region has, or an object."""
    owners, named = (
        {
            name: one["mask"]
            for name, one in entries.items()
            if isinstance(one.get("mask"), int)
        }
        for entries in (scene.document["objects"], scene.document.get("doubtful", {}))
    )
    owners = {mask: name for name, mask in owners.items()}
    there = (
        set(np.unique(maps.labels).tolist())
        if named and maps is not None
        else set(named.values())
    )
    for name, mask in named.items():
        if mask in owners:
            where, owned = f"doubtful.{name}.mask", Message.DOUBTFUL_IS_OBJECT
            yield warning(scene, where, str(mask), owned, name=owners[mask])
        elif mask not in there:
            where = f"doubtful.{name}.mask"
            yield warning(scene, where, str(mask), Message.DOUBTFUL_ID_MISSING)


def _mean_difference(one: U8, other: U8, within: Mask) -> NDArray[np.int16]:
    """(H, W, 3) grey levels from the other picture to the one, means over squares of what is `within`."""
    off = cv2.subtract(one, other, dtype=cv2.CV_16S)
    off[~within] = 0
    return np.asarray(cv2.blur(off, (LIMITS.over, LIMITS.over)), np.int16)


def _grown(mask: Mask, by: int) -> Mask:
    """(H, W): the mask and all within `by` px of it, along rows, columns and diagonals."""
    return np.asarray(
        cv2.dilate(mask.astype(np.uint8), np.ones((2 * by + 1, 2 * by + 1), np.uint8))
        > 0
    )


def _missed_masks(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """Written shapes that differ from the object's mask."""
    for k, (item, outline) in enumerate(
        zip(scene.objects, compiled.shapes.written, strict=True)
    ):
        mask = compiled.labels == k + 1
        area, (x, y, w, h) = (
            np.count_nonzero(mask),
            cv2.boundingRect(mask.astype(np.uint8)),
        )
        if outline is None or item.mask is None or not area:
            continue
        hull = outline_shape(outline).convex_hull.buffer(LIMITS.seen * area**0.5)
        corners = np.rint(shapely.get_coordinates(hull)).astype(np.int32)
        cover, (x0, y0) = coverage_box(outline, (0, 0, mask.shape[1], mask.shape[0]))
        # a spike without area is a part of the coverage's box and not of the hull
        drawn = [[x0, y0], [x0 + cover.shape[1], y0 + cover.shape[0]]]
        around = np.concatenate([corners, drawn, [[x, y], [x + w, y + h]]])
        left, top = np.maximum(around.min(axis=0) - LIMITS.thin, 0).tolist()
        right, bottom = (around.max(axis=0) + LIMITS.thin).tolist()
        here = np.s_[top:bottom, left:right]
        box = np.s_[
            y0 - top : y0 - top + cover.shape[0], x0 - left : x0 - left + cover.shape[1]
        ]
        mask = mask[here]
        seen = np.zeros(mask.shape, np.uint8)
        cv2.fillPoly(seen, [corners - np.array([left, top], np.int32)], 1)
        shown = (compiled.labels[here] > 0) | compiled.scenery[here] | _filled(mask)
        if isinstance(item.shape, Auto):
            # perception lays a flat base under what the photo shows from above
            shown |= np.logical_or.accumulate(mask, axis=0)
        bare = (cover >= 0.5) & ~shown[box]
        thin = np.ones((LIMITS.thin, LIMITS.thin), np.uint8)
        path, fix = f"objects.{item.name}.shape", "correct the outline or the mask"
        if scene.document["objects"][item.name].get("shape") != "outline":
            fix = f"write shape: outline, or {fix}"
        for part, message in (
            (mask & (seen == 0), Message.SHAPE_MISSES_MASK),
            (bare, Message.SHAPE_BEYOND_MASK),
        ):
            if not part.size:  # a shape beyond the picture
                continue
            share = (
                cv2.morphologyEx(part.astype(np.uint8), cv2.MORPH_OPEN, thin).sum()
                / area
            )
            if share > LIMITS.missed:
                yield warning(
                    scene, path, "the shape", message, share=percent(share), fix=fix
                )


def _filled(mask: Mask) -> Mask:
    """(H, W): the mask with its holes, such as the one of a handle."""
    outside = np.pad((~mask).astype(np.uint8), 1, constant_values=1)
    cv2.floodFill(outside, None, (0, 0), 2)
    return np.asarray(outside[1:-1, 1:-1] != 2)


def _overlaps(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    shapes = [outline_shape(outline) for outline in compiled.outlines]
    tree = shapely.STRtree(shapes)
    # a wheel may lie before the car that it is joined to
    through = {frozenset(joint.objects) for joint in scene.joints if not joint.collide}
    named = more = 0
    for i, item in enumerate(scene.objects):
        path = f"objects.{item.name}.shape"
        near = tree.query(shapes[i])
        near = np.sort(near[near < i])
        if named >= LIMITS.pairs:
            more += len(near)
            near = near[:0]
        for j in near.tolist():
            other = scene.objects[j].name
            if {item.name, other} not in through and collides(item, scene.objects[j]):
                depth = overlap_depth(compiled.outlines[i], compiled.outlines[j])
                if depth > LIMITS.overlap:
                    named += 1
                    overlap = Message.OVERLAP_AT_START
                    yield warning(
                        scene, path, item.name, overlap, other=other, depth=depth
                    )
        for edge, wall in zip(scene.boundaries, compiled.world.walls, strict=True):
            is_passed = not collides(item, edge) or edge.one_way is not None
            if item.motion is not Motion.DYNAMIC or is_passed:
                continue
            depth = max(
                (
                    depth_across(shapes[i], shapely.LineString(chain))
                    for chain in wall.chains
                ),
                default=0.0,
            )
            if depth > LIMITS.overlap:
                across = Message.ACROSS_BOUNDARY
                yield warning(
                    scene, path, item.name, across, depth=depth, name=wall.name
                )
    if more:
        pairs = f"{more:,} more pairs"
        yield warning(scene, "objects", pairs, Message.MORE_OVERLAPS)


def depth_across(shape: shapely.Geometry, wall: shapely.LineString) -> float:
    """How far a shape reaches across a wall, px: the greatest distance of the wall within it from its border."""
    inside = shape.intersection(wall)
    if inside.length == 0:
        return 0.0
    points = shapely.points(
        shapely.get_coordinates(shapely.segmentize(inside, inside.length / SAMPLES))
    )
    return float(shapely.distance(points, shape.boundary).max())


# Support


def supports(scene: Scene, compiled: Compiled) -> list[list[str]]:
    """Names of what each object meets on its way down; all empty without gravity in the photo's plane.

    What only touches an object's side is no support.
    """
    gravity = compiled.world.gravity
    if scene.world.view is View.TOP or not gravity.any():
        return [[] for _ in scene.objects]
    down = gravity / float(np.hypot(*gravity)) * LIMITS.support
    shapes = [outline_shape(outline) for outline in compiled.outlines]
    chains = [
        (wall.name, shapely.LineString(chain))
        for wall in compiled.world.walls
        for chain in wall.chains
    ]
    names = [item.name for item in scene.objects] + [name for name, _ in chains]
    others = shapely.STRtree([*shapes, *(line for _, line in chains)])

    def met(i: int) -> list[str]:
        lowered = (translate(shapes[i], *(down * part)) for part in PARTS)
        way = shapely.union_all(list(lowered)).buffer(-TOUCH)
        found = sorted(int(k) for k in others.query(way, "intersects") if k != i)
        return list(dict.fromkeys(names[k] for k in found))

    return [met(i) for i in range(len(shapes))]


def _unsupported(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """Objects of a photo, at rest where they are in it, with nothing under them or under what they are joined to."""
    if (
        scene.image is None
        or scene.world.view is View.TOP
        or not compiled.world.gravity.any()
    ):
        return
    held_by = supports(scene, compiled)
    hanging = [
        i
        for group in _joined(scene)
        if not any(held_by[k] for k in group)
        for i in group
    ]
    for item in (scene.objects[i] for i in sorted(hanging)):
        if not (any(item.velocity) or item.place):
            path = f"objects.{item.name}"
            yield warning(scene, path, item.name, Message.UNSUPPORTED)


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
