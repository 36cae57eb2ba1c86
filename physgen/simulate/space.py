"""The Chipmunk space of a world; the only module that imports pymunk."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pymunk
import pymunk.batch as batch
from numpy.typing import NDArray
from pymunk.batch import ArbiterFields, BodyFields

from physgen.compile.world import Body, Joint, Wall, World
from physgen.scene.scene import JointKind, Motion

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SLOP = 0.005
"""px of overlap that is let stand: keeps resting contacts alive without a visible sink."""
SEAM = 0.5
"""px between the ends of two walls that make one smooth line."""
LEAP = 2.0
"""px in a step by which no contact creeps."""
STRAIGHT = 0.999
"""Cosine of the angle up to which two walls that meet make one smooth line."""

_STATE = BodyFields.POSITION | BodyFields.ANGLE | BodyFields.VELOCITY | BodyFields.ANGULAR_VELOCITY
_LOAD = BodyFields.FORCE | BodyFields.TORQUE
_CONTACT = (
    ArbiterFields.BODY_A_ID
    | ArbiterFields.BODY_B_ID
    | ArbiterFields.TOTAL_IMPULSE
    | ArbiterFields.NORMAL
    | ArbiterFields.CONTACT_COUNT
    | ArbiterFields.POINT_A_1
    | ArbiterFields.POINT_B_1
    | ArbiterFields.DISTANCE_1
    | ArbiterFields.POINT_A_2
    | ArbiterFields.POINT_B_2
    | ArbiterFields.DISTANCE_2
)
WORDS, NUMBERS = 3, 14
"""Integers and floats of one contact."""
CONTACT_BYTES = 8 * WORDS
"""Of the integers."""
_ON_FIRST, _ON_SECOND, _DISTANCE = ([4, 5, 9, 10], [6, 7, 11, 12], [8, 13])


@dataclass(frozen=True)
class Touching:
    """K pairs of shapes that touch; things count the bodies first, then the walls."""

    first: Index
    """(K,)."""
    second: Index
    count: Index
    """(K,): 1 or 2 points."""
    impulse: Array
    """(K, 2) g·px/s that the second gave the first in the last step."""
    normal: Array
    """(K, 2): from the first to the second."""
    on_first: Array
    """(K, 2, 2) px: the points, on the first's surface; those beyond `count` are zeros."""
    on_second: Array
    depth: Array
    """(K, 2) px of overlap."""


class Space:
    """One space in motion; states are (M, 6): x, y, angle, vx, vy, spin of the bodies that are not static."""

    def __init__(self, world: World) -> None:
        space = pymunk.Space()
        space.gravity = tuple(world.gravity.tolist())
        space.collision_slop = SLOP
        space.collision_persistence = 1  # else the batch reader still lists contacts that have parted
        self._space, self._gravity = space, world.gravity
        bodies = [_add_body(space, body) for body in world.bodies]
        smooth = _neighbours(world.walls)
        walls = [_add_wall(space, wall, smooth) for wall in world.walls]
        self._bodies = bodies
        self._anchor = pymunk.Body(body_type=pymunk.Body.STATIC)
        space.add(self._anchor)
        _add_joints(space, world.joints, bodies, self._anchor)
        ids = np.array([body.id for body in (*bodies, *walls)], np.uint64)
        self._by_id = np.argsort(ids)
        self._ids = ids[self._by_id]
        self.moving = np.flatnonzero([body.motion is not Motion.STATIC for body in world.bodies])
        """(M,): bodies that the state lists, in order."""
        M = len(self.moving)
        self._states, self._contacts = batch.Buffer(), batch.Buffer()
        # the batch functions go through the bodies that move in the order they were added, then the static ones
        still = [b.center for b in world.bodies if b.motion is Motion.STATIC] + [np.zeros(2)] * (
            len(walls) + 1
        )
        self._placing, self._pushing = np.zeros((M + len(still), 6)), np.zeros((M + len(still), 3))
        self._placing[M:, :2] = np.array(still).reshape(-1, 2)
        self._place_buffer, self._push_buffer = batch.Buffer(), batch.Buffer()
        if M:
            self._place_buffer.set_float_buf(self._placing)
            self._push_buffer.set_float_buf(self._pushing)
        self._brakes: dict[tuple[int, int], pymunk.SimpleMotor] = {}

    @property
    def iterations(self) -> int:
        """Sweeps of the contact solver a step."""
        return int(self._space.iterations)

    @iterations.setter
    def iterations(self, count: int) -> None:
        self._space.iterations = count

    def step(self, h: float) -> tuple[bytes, bytes, bytes]:
        """Move by the velocities, then find contacts and change the velocities; states, contact words and numbers."""
        self._space.step(h)
        self._states.clear()
        batch.get_space_bodies(self._space, _STATE, self._states)
        self._contacts.clear()
        batch.get_space_arbiters(self._space, _CONTACT, self._contacts)
        return (bytes(self._states.float_buf()[: 48 * len(self.moving)]), *self._in_order())

    def _in_order(self) -> tuple[bytes, bytes]:
        """Contacts by things and places; the engine's names of bodies, and its order, are those of memory addresses."""
        words = np.array(self._contacts.int_buf()).view(np.int64).reshape(-1, WORDS)
        words[:, :2] = self._by_id[np.searchsorted(self._ids, words[:, :2].view(np.uint64))]
        rows = np.frombuffer(self._contacts.float_buf()).reshape(-1, NUMBERS)
        if len(words) < 2:
            return words.tobytes(), rows.tobytes()
        pair = words[:, 0] << 32 | words[:, 1]
        order = np.argsort(pair)
        if len(set(pair.tolist())) < len(pair):
            # several pieces or segments, of which some touch at one and the same corner
            order = np.lexsort((*rows.T[[3, 2, 1, 0, 10, 9, 5, 4]], pair))
        return words[order].tobytes(), rows[order].tobytes()

    def weaken(self, part: float) -> None:
        """Let gravity act with a part of its strength."""
        self._space.gravity = tuple((self._gravity * part).tolist())

    def place(self, state: Array) -> None:
        """Set positions and velocities, (M, 6)."""
        self._placing[: len(state)] = state
        if len(state):
            batch.set_space_bodies(self._space, _STATE, self._place_buffer)

    def push(self, load: Array) -> None:
        """Forces and torques for the next step, (M, 3): g·px/s², g·px/s², g·px²/s²."""
        self._pushing[: len(load)] = load
        if len(load):
            batch.set_space_bodies(self._space, _LOAD, self._push_buffer)

    def brake(self, first: int, second: int | None, torque: float) -> None:
        """Let a torque of at most so much resist the turning of one body against another or the world."""
        key = (first, -1 if second is None else second)
        if key not in self._brakes:
            other = self._anchor if second is None else self._bodies[second]
            motor = pymunk.SimpleMotor(self._bodies[first], other, 0.0)
            self._space.add(motor)
            self._brakes[key] = motor
        self._brakes[key].max_force = torque

    def braked(self) -> dict[tuple[int, int], float]:
        """Size of the angular impulse that each brake gave in the last step, g·px²/s."""
        return {key: float(motor.impulse) for key, motor in self._brakes.items()}

    def touching(self, words: bytes, numbers: bytes | None) -> Touching:
        """Contacts of one or more steps as they were read, in their order; without numbers, only who touches whom."""
        ints = np.frombuffer(words, np.int64).reshape(-1, WORDS)
        rows = (
            np.zeros((len(ints), NUMBERS)) if numbers is None else np.frombuffer(numbers).reshape(-1, NUMBERS)
        )
        return Touching(
            first=ints[:, 0],
            second=ints[:, 1],
            count=ints[:, 2],
            impulse=rows[:, :2],
            normal=rows[:, 2:4],
            on_first=rows[:, _ON_FIRST].reshape(-1, 2, 2),
            on_second=rows[:, _ON_SECOND].reshape(-1, 2, 2),
            depth=-rows[:, _DISTANCE],
        )


def contact_places(numbers: bytes) -> Array:
    """(K, 9) px: where contacts are, on both partners."""
    return np.frombuffer(numbers).reshape(-1, NUMBERS)[:, 4:13]


def contacts_jumped(now: Array, before: Array) -> bool:
    """Whether contacts of the same pairs, in the same order, are elsewhere at once: another corner has come down."""
    return len(now) == len(before) > 0 and float(np.abs(now - before).max()) > LEAP


def _add_body(space: pymunk.Space, model: Body) -> pymunk.Body:
    if model.motion is Motion.DYNAMIC:
        body = pymunk.Body(model.mass, model.moment)
    elif model.motion is Motion.STATIC:
        body = pymunk.Body(body_type=pymunk.Body.STATIC)
    else:
        body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
    body.position = tuple(model.center.tolist())
    space.add(body)
    if model.radius is not None:
        shapes: list[pymunk.Shape] = [pymunk.Circle(body, model.radius)]
    else:
        shapes = [pymunk.Poly(body, piece.tolist()) for piece in model.pieces]
    for shape in shapes:
        shape.friction = model.surface.friction
        space.add(shape)
    return body


def _add_wall(space: pymunk.Space, wall: Wall, smooth: dict[tuple[float, ...], list[float]]) -> pymunk.Body:
    """A body of its own, so that contacts know which wall they touch."""
    body = pymunk.Body(body_type=pymunk.Body.STATIC)
    space.add(body)
    for chain in wall.chains:
        for a, b in pairwise(chain.tolist()):
            segment = pymunk.Segment(body, a, b, 0.0)
            segment.friction = wall.surface.friction
            before, after = smooth.get((*a, *b)), smooth.get((*b, *a))
            if before is not None or after is not None:
                # without a neighbour, a point on the segment's own line lets its end be hit from outside only
                segment.set_neighbors(tuple(before or a), tuple(after or b))
            space.add(segment)
    return body


def _neighbours(walls: tuple[Wall, ...]) -> dict[tuple[float, ...], list[float]]:
    """(near end, far end) of a segment -> far end of the one that carries on from its near end in a straight line.

    Told of its neighbours, a segment's end no longer trips what slides over the seam.
    """
    ends = [
        (np.array(near), np.array(far))
        for wall in walls
        for chain in wall.chains
        for a, b in pairwise(chain.tolist())
        for near, far in ((a, b), (b, a))
    ]
    found: dict[tuple[float, ...], list[float]] = {}
    if not ends:
        return found
    nears = np.array([near for near, _ in ends])
    away = np.array([far - near for near, far in ends])
    away /= np.maximum(np.hypot(*away.T), 1e-12)[:, None]
    order = np.argsort(nears[:, 0], kind="stable")
    sorted_x = nears[order, 0]
    for k in range(len(ends)):
        low, high = np.searchsorted(sorted_x, [nears[k, 0] - SEAM, nears[k, 0] + SEAM])
        others = order[low:high]
        meets = np.hypot(*(nears[others] - nears[k]).T) <= SEAM
        straight = away[others] @ away[k] <= -STRAIGHT
        for other in others[meets & straight].tolist():
            if other // 2 != k // 2:
                key = (*ends[k][0].tolist(), *ends[k][1].tolist())
                found.setdefault(key, ends[other][1].tolist())
    return found


def _add_joints(
    space: pymunk.Space, joints: tuple[Joint, ...], bodies: list[pymunk.Body], world: pymunk.Body
) -> None:
    """Pins and welds, so that contacts are solved with them. They keep velocities only: where joints are, and motors,
    is for joined.py, which solves them exactly after each step; springs are loads.

    Where a weld sits does not matter; between the two centres it turns by the shortest levers.
    """
    for joint in joints:
        if joint.kind is JointKind.SPRING:
            continue
        a = bodies[joint.first]
        b = world if joint.second is None else bodies[joint.second]
        first, second = joint.first_at, joint.second_at
        if joint.kind is JointKind.WELD:
            one, two = np.array(a.position), np.array(b.position)
            middle = (
                one
                if joint.second is None
                else (a.mass * one + b.mass * two) / (a.mass + b.mass)
                if a.mass + b.mass < np.inf
                else two
            )
            first, second = middle - one, middle - two
        parts: list[pymunk.Constraint] = [pymunk.PivotJoint(a, b, first.tolist(), second.tolist())]
        if joint.kind is JointKind.WELD:
            parts.append(pymunk.GearJoint(a, b, 0.0, 1.0))
        for part in parts:
            part.error_bias = 1.0
            part.collide_bodies = joint.collide
            space.add(part)
