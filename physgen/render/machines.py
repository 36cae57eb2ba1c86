"""Lines that show joints and fields, from rods and ropes to belts and magnets."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, pairwise

import numpy as np

from physgen.compile.world import Field, Joint, Wall, World
from physgen.geometry.polygon import Array, rotation
from physgen.render.drawing import circle
from physgen.scene.scene import FieldKind, JointKind

PIN = 4.0
"""Radius of a pin's ring, px of the photo."""
BROKEN = 2.0
"""Largest distance of the ends of an unbroken joint, px."""
COILS = 8
"""Number of coils of a spring."""
COIL = 0.06
"""Half the width of a spring, as a share of its length."""
MARK = 24.0
"""Length of a belt's arrow, px."""


def joint_lines(world: World, poses: Array, time: float) -> Iterator[Array]:
    """Yield chains (K, 2) px of the photo for the unbroken joints at poses (N, 3).

    `time`: that of the poses, s.
    """
    for joint in world.joints:
        first = _place(poses, joint.first, joint.first_at)
        second = _place(poses, joint.second, joint.second_at)
        distance = float(np.hypot(*(first - second)))
        match joint.kind:
            case JointKind.SPRING:
                yield _spring(first, second)
            case JointKind.ROPE:
                if distance <= joint.length + BROKEN:
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
            # A pin with a gap is broken.
            case _:
                if distance <= BROKEN:
                    yield circle(first, PIN)


def field_lines(world: World, poses: Array, time: float) -> Iterator[Array]:
    """Yield chains (K, 2) px of the photo for fields, and belts of boundaries, at a
    time, s.
    """
    for field in world.fields:
        match field.kind:
            case FieldKind.WATER | FieldKind.BELT:
                yield _frame(field)
                if field.velocity is not None and field.velocity.any():
                    middle = field.vector + np.array(field.extent) / 2
                    direction = field.velocity / np.hypot(*field.velocity)
                    yield from _arrow(middle, direction)
            case FieldKind.TURNTABLE:
                radius = field.extent[0]
                angle = field.spin * time
                yield circle(field.vector, radius)
                rim = radius * np.array([np.cos(angle), np.sin(angle)])
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


def _place(poses: Array, body: int | None, center: Array) -> Array:
    """Return the place (2,) px of a joint's side."""
    if body is None:
        return center
    return np.asarray(poses[body, :2] + rotation(float(poses[body, 2])) @ center)


def _spring(first: Array, second: Array) -> Array:
    """Return a zigzag between two points."""
    axis = second - first
    half_width = COIL * np.array([-axis[1], axis[0]])
    positions = np.linspace(0, 1, 2 * COILS + 1)
    side = np.where(np.arange(len(positions)) % 2 == 1, 1.0, 0.0)
    side[3::4] = -1.0
    return np.asarray(first + positions[:, None] * axis + side[:, None] * half_width)


def _pulley(joint: Joint, first: Array, second: Array) -> Iterator[Array]:
    """Yield the rope and the wheels of a pulley."""
    chain = np.stack([first, *joint.guide, second])
    if np.hypot(*np.diff(chain, axis=0).T).sum() > joint.length + BROKEN:
        return
    yield chain
    for point in joint.guide:
        yield circle(point, PIN)


def _rail(joint: Joint, poses: Array) -> Iterator[Array]:
    """Yield a rail with stops at its ends."""
    vector = joint.guide[0]
    ends = [_place(poses, joint.second, joint.second_at + k * vector) for k in (0, 1)]
    yield np.stack(ends)
    stop = 2 * PIN * (ends[1] - ends[0])[::-1] * (-1, 1) / float(np.hypot(*vector))
    for end in ends:
        yield np.stack([end - stop, end + stop])


def _finger(joint: Joint, hold: Array, time: float) -> Iterator[Array]:
    """Yield the line from a held point to the finger, and the finger's ring."""
    knots = joint.knots
    if knots is None or not knots[0, 0] <= time <= knots[-1, 0]:
        return
    tip = np.array([np.interp(time, knots[:, 0], knots[:, k]) for k in (1, 2)])
    yield np.stack([hold, tip])
    yield circle(tip, 2 * PIN)


def _frame(field: Field) -> Array:
    """Return the border of water or of a belt."""
    (x, y), (width, height) = field.vector.tolist(), field.extent
    right, bottom = x + width, y + height
    return np.array([[x, y], [right, y], [right, bottom], [x, bottom], [x, y]])


def _arrow(middle: Array, way: Array) -> Iterator[Array]:
    """Yield an arrow along a direction (2,)."""
    tip = middle + MARK / 2 * way
    side = np.array([-way[1], way[0]])
    yield np.stack([middle - MARK / 2 * way, tip])
    root = tip - MARK / 3 * way
    yield np.stack([root + MARK / 5 * side, tip, root - MARK / 5 * side])


def _conveyor(wall: Wall) -> Iterator[Array]:
    """Yield an arrow over the longest segment of a conveyor; positive: right on its
    top.
    """
    if not wall.surface.conveyor:
        return
    segments = [pair for chain in wall.chains for pair in pairwise(chain)]
    start, end = max(segments, key=lambda pair: float(np.hypot(*(pair[1] - pair[0]))))
    direction = (end - start) / np.hypot(*(end - start))
    if direction[0] < 0:
        direction = -direction
    sign = float(np.sign(wall.surface.conveyor))
    yield from _arrow(
        (start + end) / 2 + PIN * np.array([direction[1], -direction[0]]),
        sign * direction,
    )
