"""Lines that show joints and fields: rods, ropes, rails, springs, pulleys, water, belts, turntables and magnets."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, pairwise

import numpy as np

from physgen.compile.world import Field, Joint, Wall, World
from physgen.geometry.polygon import Array, rotation
from physgen.render.drawing import circle
from physgen.scene.scene import FieldKind, JointKind

PIN = 4.0
"""px of the photo: radius of a pin's ring."""
BROKEN = 2.0
"""px by which the ends of a whole joint may be apart."""
COILS = 8
"""Of a spring."""
COIL = 0.06
"""Of a spring's length: half its width."""
MARK = 24.0
"""px: length of a belt's arrow."""


def joint_lines(world: World, poses: Array, time: float) -> Iterator[Array]:
    """Yield chains (K, 2) px of the photo that show whole joints at the poses (N, 3) of a time, s."""
    for joint in world.joints:
        first = _place(poses, joint.first, joint.first_at)
        second = _place(poses, joint.second, joint.second_at)
        apart = float(np.hypot(*(first - second)))
        match joint.kind:
            case JointKind.SPRING:
                yield _spring(first, second)
            case JointKind.ROPE:
                if apart <= joint.length + BROKEN:
                    yield np.stack([first, second])
            case JointKind.PULLEY:
                yield from _pulley(joint, first, second)
            case JointKind.SLIDER:
                yield from _rail(joint, poses)
                yield circle(first, PIN)
            case JointKind.GEAR:
                if joint.second is not None:
                    yield poses[[joint.first, joint.second], :2]
            case JointKind.FINGER:
                yield from _finger(joint, first, time)
            case _:
                if apart <= BROKEN:
                    yield circle(first, PIN)


def field_lines(world: World, poses: Array, time: float) -> Iterator[Array]:
    """Yield chains (K, 2) px of the photo that show fields, and belts of boundaries, at a time, s."""
    for field in world.fields:
        match field.kind:
            case FieldKind.WATER | FieldKind.BELT:
                yield _frame(field)
                if field.velocity is not None and field.velocity.any():
                    middle = field.vector + np.array(field.extent) / 2
                    way = field.velocity / np.hypot(*field.velocity)
                    yield from _arrow(middle, way)
            case FieldKind.TURNTABLE:
                radius, turned = field.extent[0], field.spin * time
                yield circle(field.vector, radius)
                rim = radius * np.array([np.cos(turned), np.sin(turned)])
                yield np.stack([field.vector, field.vector + rim])
            case FieldKind.MAGNET:
                for pair in combinations(field.bodies, 2):
                    yield poses[list(pair), :2]
            case FieldKind.ATTRACTOR:
                yield circle(field.vector, 2 * PIN)
            case _:
                pass
    for wall in world.walls:
        yield from _conveyor(wall)


def _place(poses: Array, body: int | None, at: Array) -> Array:
    """Return the place (2,) px of a joint's side."""
    if body is None:
        return at
    return np.asarray(poses[body, :2] + rotation(float(poses[body, 2])) @ at)


def _spring(first: Array, second: Array) -> Array:
    """Return a zigzag between two points."""
    along = second - first
    across = COIL * np.array([-along[1], along[0]])
    part = np.linspace(0, 1, 2 * COILS + 1)
    side = np.where(np.arange(len(part)) % 2 == 1, 1.0, 0.0)
    side[3::4] = -1.0
    return np.asarray(first + part[:, None] * along + side[:, None] * across)


def _pulley(joint: Joint, first: Array, second: Array) -> Iterator[Array]:
    chain = np.stack([first, *joint.guide, second])
    if np.hypot(*np.diff(chain, axis=0).T).sum() > joint.length + BROKEN:
        return
    yield chain
    for point in joint.guide:
        yield circle(point, PIN)


def _rail(joint: Joint, poses: Array) -> Iterator[Array]:
    way = joint.guide[0]
    ends = [_place(poses, joint.second, joint.second_at + k * way) for k in (0, 1)]
    yield np.stack(ends)
    stop = 2 * PIN * (ends[1] - ends[0])[::-1] * (-1, 1) / float(np.hypot(*way))
    for end in ends:
        yield np.stack([end - stop, end + stop])


def _finger(joint: Joint, held: Array, time: float) -> Iterator[Array]:
    knots = joint.knots
    if knots is None or not knots[0, 0] <= time <= knots[-1, 0]:
        return
    tip = np.array([np.interp(time, knots[:, 0], knots[:, k]) for k in (1, 2)])
    yield np.stack([held, tip])
    yield circle(tip, 2 * PIN)


def _frame(field: Field) -> Array:
    """Return the border of water or of a belt."""
    (x, y), (width, height) = field.vector.tolist(), field.extent
    right, low = x + width, y + height
    return np.array([[x, y], [right, y], [right, low], [x, low], [x, y]])


def _arrow(middle: Array, way: Array) -> Iterator[Array]:
    """Yield an arrow along a direction (2,)."""
    tip = middle + MARK / 2 * way
    side = np.array([-way[1], way[0]])
    yield np.stack([middle - MARK / 2 * way, tip])
    back = tip - MARK / 3 * way
    yield np.stack([back + MARK / 5 * side, tip, back - MARK / 5 * side])


def _conveyor(wall: Wall) -> Iterator[Array]:
    """Yield an arrow over the longest segment of a wall that runs: to the right on its top."""
    if not wall.surface.conveyor:
        return
    segments = [pair for chain in wall.chains for pair in pairwise(chain)]
    a, b = max(segments, key=lambda pair: float(np.hypot(*(pair[1] - pair[0]))))
    way = (b - a) / np.hypot(*(b - a))
    if way[0] < 0:
        way = -way
    sign = float(np.sign(wall.surface.conveyor))
    yield from _arrow((a + b) / 2 + PIN * np.array([way[1], -way[0]]), sign * way)
