"""Warnings about a compiled scene: values that are allowed but probably not
intended.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import ceil, sqrt
from typing import Any

import numpy as np
import shapely
from shapely.affinity import translate

from physgen.compile.compile import CompiledScene
from physgen.compile.photo_warnings import doubtful_ids, missed_masks, photo_differs
from physgen.compile.starts import velocities_that_joints_allow
from physgen.compile.warning_limits import LIMITS, warning
from physgen.compile.world import Body
from physgen.geometry.convex import outline_shape, overlap_depth
from physgen.geometry.polygon import Array
from physgen.maps import Percepts
from physgen.messages import Message
from physgen.problems import Problem, by_place
from physgen.scene.construction import EARTH
from physgen.scene.files import equal
from physgen.scene.framing import confine_center
from physgen.scene.scene import (
    FieldKind,
    JointKind,
    Load,
    Motion,
    Object,
    Play,
    Scene,
    Solid,
    Striker,
    View,
    collides,
)
from physgen.text import listed, quoted

PARTS = (1.0, 0.75, 0.5, 0.25, 0.125)
"""Shares of the way down to the support for trial positions; the smallest, 0.5 px, is
less than any object's height.
"""
# Overlap from rounding, px.
TOUCH = 1e-6
# Number of points along a boundary within an object for its depth.
SAMPLES = 32


def lint(
    scene: Scene, compilation: CompiledScene, maps: Percepts | None = None
) -> list[Problem]:
    """Return all warnings, sorted by place. With `maps`, also return those of the
    photo's maps.
    """
    rules = (
        _overlaps,
        _unsupported_objects,
        _without_effect,
        _idle_striker,
        _excluded_starts,
        _weak_gravity,
        _coarse_steps,
        _invisible,
        missed_masks,
        _views,
        _outdated_values,
        _long,
    )
    problems: list[Problem] = []
    for rule in rules:
        problems.extend(rule(scene, compilation))
    return by_place(
        [
            *problems,
            *photo_differs(scene, compilation, maps),
            *doubtful_ids(scene, maps),
        ]
    )


def _idle_striker(scene: Scene, compilation: CompiledScene) -> Iterator[Problem]:
    """Yield a warning about a striking hand or finger that has nothing to push."""
    enter = scene.render.enter
    if enter is Striker.NONE:
        return
    # A striker needs an object with a push at t = 0, and time that runs forwards.
    pushed = set()
    for push in scene.forces:
        if push.load is Load.IMPULSE and push.start == 0 and any(push.vector):
            pushed.add(push.object)
    moves = []
    for item in scene.objects:
        if any(item.velocity) or item.name in pushed:
            moves.append(item)
    why = ""
    if scene.image is None:
        why = "the scene has no photo"
    elif not any(item.motion is Motion.DYNAMIC for item in moves):
        why = "no dynamic object has a velocity or an impulse at t = 0"
    elif scene.render.play is Play.BACKWARD:
        why = "the clip plays backward"
    if why:
        found, message = enter.value, Message.NOTHING_TO_STRIKE
        yield warning(scene, "render.enter", found, message, why=why)


def _without_effect(scene: Scene, compilation: CompiledScene) -> Iterator[Problem]:
    """Yield warnings about keys that a reader expects to change the clip, but that do
    not.
    """
    # A key without an effect is probably a mistake, but no error.
    motion = {item.name: item.motion for item in scene.objects}
    if scene.world.table_friction > 0 and scene.world.view is not View.TOP:
        friction = f"{scene.world.table_friction:g}"
        message = Message.TABLE_FROM_SIDE
        yield warning(scene, "world.table.friction", friction, message)
    for item, body in zip(scene.objects, compilation.world.bodies, strict=True):
        yield from _object_keys_without_effect(scene, item, body)
    yield from _forces_without_effect(scene, compilation, motion)
    for joint in scene.joints:
        if all(motion[name] is not Motion.DYNAMIC for name in joint.objects):
            path = f"joints.{joint.name}"
            yield warning(scene, path, joint.name, Message.MOVES_NO_OBJECT)
    yield from _gears_without_pins(scene, motion)
    yield from _fields_without_objects(scene, motion)
    yield from _belts_without_table(scene)


def _fields_without_objects(
    scene: Scene, motion: Mapping[str, Motion]
) -> Iterator[Problem]:
    """Yield warnings about fields without a dynamic object."""
    for field in scene.fields:
        motions = [motion[name] for name in field.objects or motion]
        if Motion.DYNAMIC not in motions:
            path = f"fields.{field.name}"
            yield warning(scene, path, field.name, Message.MOVES_NO_OBJECT)


def _belts_without_table(scene: Scene) -> Iterator[Problem]:
    """Yield warnings about belts and turntables without a load."""
    is_from_above = scene.world.view is View.TOP
    if is_from_above and scene.world.table_friction > 0:
        return
    for field in scene.fields:
        if field.kind in (FieldKind.BELT, FieldKind.TURNTABLE):
            path = f"fields.{field.name}"
            yield warning(scene, path, field.name, Message.CARRIES_NOTHING)


def _object_keys_without_effect(
    scene: Scene, item: Object, body: Body
) -> Iterator[Problem]:
    """Yield warnings about keys of one object without effect on its motion."""
    path = f"objects.{item.name}"
    is_from_above = scene.world.view is View.TOP
    if item.motion is not Motion.DYNAMIC:
        yield from _keys_of_fixed_object(scene, item)
    if item.wheels and not body.wheels:
        if is_from_above:
            message = Message.WHEELS_FROM_ABOVE
            yield warning(scene, f"{path}.wheels", "wheels", message)
        else:
            yield _no_effect_on_motion(scene, item, "wheels", "wheels")
    yield from _rolling_without_effect(scene, item, body)
    rocks = item.motion is Motion.DYNAMIC and body.radius is None and not is_from_above
    if item.rocking and not rocks:
        rocking = f"{item.rocking:g}"
        message = Message.ROCKING_HAS_NO_EFFECT
        yield warning(scene, f"{path}.rocking", rocking, message)
    if item.roll != "natural" and not _rolls_on_table(scene, item, body):
        yield warning(scene, f"{path}.roll", "roll", Message.ROLL_HAS_NO_EFFECT)


def _no_effect_on_motion(scene: Scene, item: Object, key: str, value: str) -> Problem:
    path = f"objects.{item.name}.{key}"
    message = Message.NO_EFFECT_ON_MOTION
    return warning(scene, path, value, message, motion=item.motion.value)


def _keys_of_fixed_object(scene: Scene, item: Object) -> Iterator[Problem]:
    """Yield a warning about the velocity or the spin of an object that is not
    dynamic.
    """
    if any(item.velocity):
        yield _no_effect_on_motion(scene, item, "velocity", "velocity")
    elif item.spin:
        yield _no_effect_on_motion(scene, item, "spin", "spin")


def _rolling_without_effect(
    scene: Scene, item: Object, body: Body
) -> Iterator[Problem]:
    """Yield a warning about the rolling resistance of an object that cannot roll."""
    if item.rolling <= 0:
        return
    resistance = f"{item.rolling:g}"
    if item.motion is not Motion.DYNAMIC:
        yield _no_effect_on_motion(scene, item, "rolling", resistance)
        return
    shapes = "circles"
    can_roll = body.radius is not None or bool(body.wheels)
    if scene.world.view is View.TOP:
        shapes = "spheres"
        can_roll = _is_sphere(body)
    if not can_roll:
        path, message = f"objects.{item.name}.rolling", Message.ROLLING_HAS_NO_EFFECT
        yield warning(scene, path, resistance, message, shapes=shapes)


def _is_sphere(body: Body) -> bool:
    return body.radius is not None and body.solid is Solid.SPHERE


def _rolls_on_table(scene: Scene, item: Object, body: Body) -> bool:
    """Return whether an object is a dynamic sphere on a table seen from above."""
    if item.motion is not Motion.DYNAMIC or scene.world.view is not View.TOP:
        return False
    return _is_sphere(body) and scene.world.table_friction > 0


def _forces_without_effect(
    scene: Scene, compilation: CompiledScene, motion: Mapping[str, Motion]
) -> Iterator[Problem]:
    """Yield warnings about forces on fixed objects, and about forces after the end."""
    end = compilation.world.duration
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
        elif force.start >= end:
            start = f"{force.start:g}"
            message = Message.FORCE_AFTER_END
            yield warning(scene, f"forces[{k}].start", start, message, end=end)


def _gears_without_pins(
    scene: Scene, motion: Mapping[str, Motion]
) -> Iterator[Problem]:
    """Yield warnings about gears of dynamic objects without a pin."""
    pinned_names = set[str]()
    for joint in scene.joints:
        if joint.kind in (JointKind.PIVOT, JointKind.MOTOR, JointKind.WELD):
            pinned_names.update(joint.objects)
    for joint in scene.joints:
        if joint.kind is not JointKind.GEAR:
            continue
        loose = []
        for name in joint.objects:
            if name not in pinned_names and motion[name] is Motion.DYNAMIC:
                loose.append(name)
        if loose:
            names = listed(loose, "and")
            message = Message.GEAR_WITHOUT_PIN
            yield warning(
                scene, f"joints.{joint.name}", joint.name, message, names=names
            )


def _excluded_starts(scene: Scene, compilation: CompiledScene) -> Iterator[Problem]:
    """Yield warnings about velocities at t = 0 that joints exclude, with the allowed
    velocities.
    """
    world = compilation.world
    if not world.joints:
        return
    # Project the written velocities onto the motion that the joints permit, with masses
    # as weights.
    allowed_velocities = velocities_that_joints_allow(world)
    for k, (item, body) in enumerate(zip(scene.objects, world.bodies, strict=True)):
        if body.motion is not Motion.DYNAMIC or not (any(item.velocity) or item.spin):
            continue
        change = allowed_velocities[k] - (*body.velocity, body.spin)
        # A spin counts as the speed of the farthest point, so that both have one unit.
        speed = float(np.hypot(*body.velocity)) + abs(body.spin) * body.reach
        change_size = float(np.hypot(*change[:2])) + abs(change[2]) * body.reach
        if change_size <= LIMITS.start_change * speed:
            continue
        x = allowed_velocities[k, 0]
        y = allowed_velocities[k, 1]
        spin = np.degrees(allowed_velocities[k, 2])
        key = "spin"
        if any(item.velocity):
            key = "velocity"
        path, message = f"objects.{item.name}.{key}", Message.JOINTS_EXCLUDE_START
        yield warning(scene, path, key, message, x=x, y=y, spin=spin)


def _weak_gravity(scene: Scene, compilation: CompiledScene) -> Iterator[Problem]:
    """Yield warnings about gravity without a unit, if it is too weak for px/s²."""
    world = scene.world
    strength = float(np.hypot(*world.gravity)) / world.pixels_per_meter
    is_stated = "world.gravity" in scene.places and not world.gravity_in_units
    if world.view is View.TOP or not is_stated or strength == 0:
        return
    if strength < LIMITS.min_gravity * EARTH:
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


def _coarse_steps(scene: Scene, compilation: CompiledScene) -> Iterator[Problem]:
    """Yield warnings about steps with such a long fall that stacks sink or collapse."""
    world = compilation.world
    strength = float(np.hypot(*world.gravity))
    fall = strength / world.steps_per_second**2
    if fall <= LIMITS.fall:
        return
    # Suggest a round number of steps.
    steps = 100 * ceil(sqrt(strength / LIMITS.fall) / 100)
    message = Message.STEPS_COARSE
    if steps > LIMITS.most_steps:
        message = Message.SCALE_TOO_FINE
    path, found = "world.steps_per_second", f"{world.steps_per_second:g}"
    yield warning(scene, path, found, message, fall=fall, steps=steps)


def _invisible(scene: Scene, compilation: CompiledScene) -> Iterator[Problem]:
    """Yield warnings about objects smaller than a pixel, a sign of sizes in metres."""
    for item, body in zip(scene.objects, compilation.world.bodies, strict=True):
        if body.reach >= LIMITS.visible:
            continue
        size_text = f"{item.name} of {2 * body.reach:.2g} px"
        path = f"objects.{item.name}.shape"
        yield warning(scene, path, size_text, Message.SHAPE_INVISIBLE)


def _outdated_values(scene: Scene, compilation: CompiledScene) -> Iterator[Problem]:
    """Yield warnings about numbers that belong to an earlier label or scale."""
    # Perception derived masses and speeds from its own scale and labels. Values of the
    # user stay, and may not fit the new scale any more.
    record, scale = scene.record, scene.world.pixels_per_meter
    is_stated = "world.pixels_per_meter" in scene.places
    if is_stated and record.scale is not None and not equal(record.scale, scale):
        message = Message.SCALE_CHANGED
        if record.world.get("by_labels"):
            message = Message.SCALE_OF_NEW_LABELS
        key_path, scale_text = "world.pixels_per_meter", f"{scale:g}"
        yield warning(scene, key_path, scale_text, message, perceived=record.scale)
    for item in scene.objects:
        entry = record.entry(item.name, scene.document["objects"][item.name])
        if entry.get("label", item.label) == item.label:
            continue
        values = ", ".join(_values_of_earlier_label(item, entry))
        if values:
            key_path, label = f"objects.{item.name}.label", quoted(item.label)
            message = Message.LABEL_CHANGED
            yield warning(scene, key_path, label, message, values=values)


def _values_of_earlier_label(item: Object, entry: Mapping[str, Any]) -> Iterator[str]:
    """Yield the values of an object that differ from those of its recorded label."""
    for key in ("mass", "friction", "elasticity"):
        if key not in item.provenance or key not in entry:
            continue
        value = getattr(item, key)
        if not equal(value, entry[key]):
            yield f"{key} {value:g}"


def _long(scene: Scene, compilation: CompiledScene) -> Iterator[Problem]:
    """Yield a warning about a slow clip with many frames."""
    frames, (width, height) = len(compilation.world.times), scene.video_size
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


def _views(scene: Scene, compilation: CompiledScene) -> Iterator[Problem]:
    """Yield warnings about camera views beyond the photo's border, or after the end of
    the clip.
    """
    for index, sight in enumerate(scene.render.camera):
        path = "render.camera"
        if f"{path}[{index}]" in scene.places:
            path += f"[{index}]"
        if sight.center is not None:
            x, y = confine_center(
                sight.center, scene.size, scene.video_size, sight.zoom
            )
            if (
                max(abs(x - sight.center[0]), abs(y - sight.center[1]))
                > LIMITS.view_shift
            ):
                center_text = f"[{sight.center[0]:g}, {sight.center[1]:g}]"
                yield warning(
                    scene,
                    f"{path}.center",
                    center_text,
                    Message.VIEW_AT_BORDER,
                    zoom=sight.zoom,
                    x=x,
                    y=y,
                )
        end = compilation.world.duration
        if sight.time > end:
            time_path, message = f"{path}.time", Message.VIEW_AFTER_END
            yield warning(scene, time_path, f"{sight.time:g}", message, end=end)


def _overlaps(scene: Scene, compilation: CompiledScene) -> Iterator[Problem]:
    shapes = list(map(outline_shape, compilation.outlines))
    tree = shapely.STRtree(shapes)
    # A wheel may lie in front of its car.
    joined_pairs = set()
    for joint in scene.joints:
        if not joint.collide:
            joined_pairs.add(frozenset(joint.objects))
    pair_count = extra_count = 0
    for i, item in enumerate(scene.objects):
        neighbours = tree.query(shapes[i])
        # Earlier objects only, so that each pair is named once.
        neighbours = np.sort(neighbours[neighbours < i])
        if pair_count >= LIMITS.pairs:
            extra_count += len(neighbours)
            neighbours = neighbours[:0]
        for j in neighbours.tolist():
            partner = scene.objects[j]
            if frozenset((item.name, partner.name)) in joined_pairs:
                continue
            problem = _overlap(scene, compilation, i, j)
            if problem is not None:
                pair_count += 1
                yield problem
        yield from _boundaries_across(scene, compilation, item, shapes[i])
    if extra_count:
        pairs = f"{extra_count:,} more pairs"
        yield warning(scene, "objects", pairs, Message.MORE_OVERLAPS)


def _overlap(
    scene: Scene, compilation: CompiledScene, i: int, j: int
) -> Problem | None:
    """Return a warning about the overlap of two objects that collide, or None."""
    item = scene.objects[i]
    partner = scene.objects[j]
    if not collides(item, partner):
        return None
    depth = overlap_depth(compilation.outlines[i], compilation.outlines[j])
    if depth <= LIMITS.overlap:
        return None
    path, message = f"objects.{item.name}.shape", Message.OVERLAP_AT_START
    return warning(scene, path, item.name, message, other=partner.name, depth=depth)


def _boundaries_across(
    scene: Scene, compilation: CompiledScene, item: Object, shape: shapely.Geometry
) -> Iterator[Problem]:
    """Yield warnings about boundaries through a dynamic object."""
    if item.motion is not Motion.DYNAMIC:
        return
    path, message = f"objects.{item.name}.shape", Message.ACROSS_BOUNDARY
    for edge, wall in zip(scene.boundaries, compilation.world.walls, strict=True):
        if edge.one_way is not None or not collides(item, edge):
            continue
        depth = 0.0
        for chain in wall.chains:
            depth = max(depth, depth_across(shape, shapely.LineString(chain)))
        if depth > LIMITS.overlap:
            yield warning(scene, path, item.name, message, depth=depth, name=wall.name)


def depth_across(shape: shapely.Geometry, wall: shapely.LineString) -> float:
    """Return the depth of a shape across a wall, px: the greatest distance from the
    wall's part inside the shape to its border.
    """
    inside = shape.intersection(wall)
    if inside.length == 0:
        return 0.0
    points = shapely.points(
        shapely.get_coordinates(shapely.segmentize(inside, inside.length / SAMPLES))
    )
    return float(shapely.distance(points, shape.boundary).max())


# ---- support


def supports(scene: Scene, compilation: CompiledScene) -> list[list[str]]:
    """Return the names of the objects and boundaries in each object's way down; all
    empty without gravity in the photo's plane.

    A contact at an object's side only is not a support.
    """
    if not _has_gravity(scene, compilation):
        return [[] for _ in scene.objects]
    gravity = compilation.world.gravity
    # Shift each outline a little down: everything it then meets supports it.
    down = gravity / float(np.hypot(*gravity)) * LIMITS.support
    shapes = list(map(outline_shape, compilation.outlines))
    names = [item.name for item in scene.objects]
    lines: list[shapely.LineString] = []
    for wall in compilation.world.walls:
        names += [wall.name] * len(wall.chains)
        lines += map(shapely.LineString, wall.chains)
    tree = shapely.STRtree([*shapes, *lines])
    support_names = []
    for index, shape in enumerate(shapes):
        rows = sorted(tree.query(_way_down(shape, down), "intersects").tolist())
        # Each name once, in the order of the rows.
        rows_of_names = dict.fromkeys(names[k] for k in rows if k != index)
        support_names.append(list(rows_of_names))
    return support_names


def _has_gravity(scene: Scene, compilation: CompiledScene) -> bool:
    """Return whether gravity acts in the plane of the photo."""
    return scene.world.view is not View.TOP and bool(compilation.world.gravity.any())


def _way_down(shape: shapely.Geometry, down: Array) -> shapely.Geometry:
    """Return the region that a shape covers on its way along `down`, px."""
    lowered_shapes = [translate(shape, *(down * part)) for part in PARTS]
    # The shrunken region leaves out neighbours with a common side.
    return shapely.union_all(lowered_shapes).buffer(-TOUCH)


def _unsupported_objects(scene: Scene, compilation: CompiledScene) -> Iterator[Problem]:
    """Yield warnings about objects of a photo at rest without a support below them or
    below their joined partners.
    """
    if scene.image is None or not _has_gravity(scene, compilation):
        return
    supports_by_object = supports(scene, compilation)
    hanging_objects: list[int] = []
    for group in _joined_groups(scene):
        if not any(supports_by_object[k] for k in group):
            hanging_objects += group
    for index in sorted(hanging_objects):
        item = scene.objects[index]
        if not (any(item.velocity) or item.place):
            path = f"objects.{item.name}"
            yield warning(scene, path, item.name, Message.UNSUPPORTED)


def _joined_groups(scene: Scene) -> list[set[int]]:
    """Return the groups of dynamic objects with joints between them, without groups
    that hang on fixed things.
    """
    index = {item.name: k for k, item in enumerate(scene.objects)}
    root = list(range(len(scene.objects) + 1))
    # The world and all fixed objects.
    world_index = len(scene.objects)

    def find(k: int) -> int:
        while root[k] != k:
            root[k] = k = root[root[k]]
        return k

    for k, item in enumerate(scene.objects):
        if item.motion is not Motion.DYNAMIC:
            root[k] = world_index
    for joint in scene.joints:
        ends = [index[name] for name in joint.objects]
        root[find(ends[0])] = find(ends[1] if len(ends) == 2 else world_index)
    groups: dict[int, set[int]] = {}
    for k in range(len(scene.objects)):
        if find(k) != find(world_index):
            groups.setdefault(find(k), set()).add(k)
    return list(groups.values())
