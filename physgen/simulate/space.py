"""The one space of pymunk: Chipmunk finds contacts and solves normal forces, friction and joints.

No other module uses pymunk. Shapes have no elasticity: bounces are computed in `collisions`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Flag
from itertools import pairwise
from typing import Any

import numpy as np
import pymunk
import pymunk.batch as batch
from numpy.typing import NDArray
from pymunk._chipmunk_cffi import ffi, lib
from pymunk.batch import ArbiterFields, BodyFields

from physgen.compile.world import Body, Joint, Wall, World
from physgen.scene.scene import JointKind, Motion
from physgen.simulate.contacts import (
    CONTACT_BYTES,
    NUMBERS,
    WORDS,
    Array,
    contact_places,
    contacts_jumped,
    normal_impulse,
)
from physgen.simulate.friction import Pair

Index = NDArray[np.int64]

SLOP = 0.005
"""px of overlap that is let stand: keeps resting contacts alive without a visible sink."""
SEAM = 0.5
"""px between the ends of two walls that make one smooth line."""
STRAIGHT = 0.999
"""Cosine of the angle up to which two walls that meet make one smooth line."""

GLIDE = 8
"""Steps that are taken in one go at most."""

Order = tuple[Index, list[tuple[int, int]], Index, bytes]
"""(K,) the order of contacts by pairs and counts, runs that are alike in both, all of each run but its first, and the
words in that order; an order that changes nothing is empty."""
_PLACE = [4, 5, 9, 10, 0, 1, 2, 3]
"""Numbers of a contact by which those of one pair are sorted: points on both bodies, impulse, normal."""
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


@dataclass(frozen=True)
class Glide:
    """S steps in a row with the same contacts."""

    states: Array
    """(S, M, 6)."""
    numbers: list[bytes]
    """Of the contacts of each step."""
    braked: Array
    """(S, B) g·px²/s: sizes of the angular impulses that the brakes in use gave."""
    torques: dict[Pair, float]
    """Of those B brakes, after the last step."""
    begun: tuple[bytes, bytes, bytes] | None
    """What `Space.step` would have given for the step after them, in which contacts are others."""


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
        self._by_id = {body.id: number for number, body in enumerate((*bodies, *walls))}
        self.moving = np.flatnonzero([body.motion is not Motion.STATIC for body in world.bodies])
        """(M,): bodies that the state lists, in order."""
        M = len(self.moving)
        self._states, self._contacts = batch.Buffer(), batch.Buffer()
        self._read_states = _batched(space, "pmSpaceBodyGetIteratorFuncBatched", _STATE, self._states)
        self._read_contacts = _batched(space, "pmSpaceArbiterIteratorFuncBatched", _CONTACT, self._contacts)
        # the batch functions go through the bodies that move in the order they were added, then the static ones
        still = [b.center for b in world.bodies if b.motion is Motion.STATIC] + [np.zeros(2)] * (
            len(walls) + 1
        )
        self._placing, self._pushing = np.zeros((M + len(still), 6)), np.zeros((GLIDE, M + len(still), 3))
        self._placing[M:, :2] = np.array(still).reshape(-1, 2)
        self._place_buffer, self._push_buffer = batch.Buffer(), batch.Buffer()
        if M:
            self._place_buffer.set_float_buf(self._placing)
            self._push_buffer.set_float_buf(self._pushing)
        writer = "pmSpaceBodySetIteratorFuncBatched"
        self._write_states = _batched(space, writer, _STATE, self._place_buffer)
        self._write_loads = _batched(space, writer, _LOAD, self._push_buffer)
        self._brakes: dict[Pair, tuple[pymunk.SimpleMotor, Any]] = {}
        self._sweeps = int(space.iterations)
        self._listed = b""
        """Contacts of the last step, as pymunk lists them."""
        self._orders: dict[bytes, Order] = {b"": (np.zeros(0, np.int64), [], np.zeros(0, np.int64), b"")}
        """By contacts as pymunk lists them: few lists come again and again."""

    @property
    def iterations(self) -> int:
        """Sweeps of the contact solver a step."""
        return self._sweeps

    @iterations.setter
    def iterations(self, count: int) -> None:
        if count != self._sweeps:
            self._space.iterations = self._sweeps = count

    def step(self, h: float) -> tuple[bytes, bytes, bytes]:
        """Move by the velocities, then find contacts and change the velocities; states, contact words and numbers."""
        # what pymunk does around these calls takes as long as a small step
        lib.cpSpaceStep(self._read_states[0], h)
        states, words, numbers = self._states._float_arr, self._contacts._int_arr, self._contacts._float_arr
        states.num = words.num = numbers.num = 0
        lib.cpSpaceEachBody(*self._read_states)
        lib.cpSpaceEachCachedArbiter(*self._read_contacts)
        return self._read(0, 0)

    def _read(self, steps: int, contacts: int) -> tuple[bytes, bytes, bytes]:
        """States, contact words and numbers that were listed last, after those of some steps and contacts."""
        states, words, numbers = self._states._float_arr, self._contacts._int_arr, self._contacts._float_arr
        moved: bytes = ffi.buffer(states.arr + steps * self._placing.size, 48 * len(self.moving))[:]
        fresh = words.num // WORDS - contacts
        self._listed = ffi.buffer(words.arr + WORDS * contacts, CONTACT_BYTES * fresh)[:] if fresh else b""
        found = ffi.buffer(numbers.arr + NUMBERS * contacts, 8 * NUMBERS * fresh)[:] if fresh else b""
        return moved, *self._in_order(self._listed, found)

    def glide(
        self,
        spans: Sequence[float],
        loads: Array | None,
        braking: Sequence[tuple[Pair, float, list[int]]],
        places: Array | None,
        hold: Callable[[Array, float], None] | None,
    ) -> Glide:
        """Steps of so many seconds each, until contacts are not those of the step before, or elsewhere at once.

        loads (S, M, 3): forces and torques in each; braking: brakes, levers and contacts by which their torques follow
        the normal forces of the step before; places (K, 9): where the contacts were; None where none can leap;
        hold: changes the state (M, 6) after each step, of so many seconds.
        """
        states, words, numbers = self._states._float_arr, self._contacts._int_arr, self._contacts._float_arr
        states.num = words.num = numbers.num = 0
        if loads is not None:
            self._pushing[: len(loads), : loads.shape[1]] = loads
            self._push_buffer._float_arr.num = 0
        listed = self._listed
        K, M, held = len(listed) // CONTACT_BYTES, len(self.moving), list[Array]()
        order, _, later, _ = self._orders[listed]
        mixed = len(order) > 0 and not len(later)  # the rows are brought in order once, at the end
        used = {key for key, _, _ in braking}
        gauges = {key: (motor, list[Any]()) for key, (_, motor) in self._brakes.items() if key in used}
        for key, lever, rows in braking:
            gauges[key][1].append((lever, order[rows].tolist() if mixed else rows))
        if mixed and places is not None:
            sorted_places, places = places, np.empty_like(places)
            places[order] = sorted_places
        done, chunks, braked, torques, begun = 0, list[bytes](), list[float](), list[float](), None
        for h in spans:
            if loads is not None:
                lib.cpSpaceEachBody(*self._write_loads)
            lib.cpSpaceStep(self._read_states[0], h)
            lib.cpSpaceEachBody(*self._read_states)
            lib.cpSpaceEachCachedArbiter(*self._read_contacts)
            alike = words.num == WORDS * K * (done + 1)
            if alike and K:
                alike = ffi.buffer(words.arr + WORDS * K * done, CONTACT_BYTES * K)[:] == listed
                chunk: bytes = ffi.buffer(numbers.arr + NUMBERS * K * done, 8 * NUMBERS * K)[:]
                if alike and not mixed:
                    chunk = self._in_order(listed, chunk)[1]
                if alike and places is not None:
                    before, places = places, contact_places(chunk)
                    alike = not contacts_jumped(places, before)
            if not alike:
                begun = self._read(done, K * done)
                break
            if hold is not None:
                bare = ffi.buffer(states.arr + self._placing.size * done, 48 * M)
                state = np.frombuffer(bare[:]).reshape(M, 6).copy()
                hold(state, h)
                self.place(state)
                held.append(state)
            done += 1
            if K:
                chunks.append(chunk)
            torques.clear()
            for motor, parts in gauges.values():
                torque = 0.0
                for lever, rows in parts:
                    for normal in sorted([normal_impulse(chunk, k) for k in rows]):
                        torque += lever * normal / h
                lib.cpConstraintSetMaxForce(motor, torque)
                braked.append(lib.cpConstraintGetImpulse(motor))
                torques.append(torque)
        if mixed and done:
            ordered = np.frombuffer(b"".join(chunks)).reshape(done, K, NUMBERS).take(order, axis=1)
            chunks = [rows.tobytes() for rows in ordered]
        listed_states = ffi.buffer(states.arr, 8 * self._placing.size * done)[:] if done else b""
        moved = np.frombuffer(listed_states).reshape(done, len(self._placing), 6)[:, :M]
        return Glide(
            np.array(held) if held else moved,
            chunks or [b""] * done,
            np.array(braked).reshape(done, len(gauges)),
            dict(zip(gauges, torques, strict=bool(done))),
            begun,
        )

    def _in_order(self, listed: bytes, numbers: bytes) -> tuple[bytes, bytes]:
        """Contacts by bodies and places; pymunk's ids and order are those of memory addresses."""
        if listed not in self._orders:
            if len(self._orders) >= 1000:
                self._orders.clear()
            self._orders[listed] = self._order(listed)
        order, alike, later, words = self._orders[listed]
        if not len(order):
            return words, numbers
        rows = np.frombuffer(numbers).reshape(-1, NUMBERS)
        in_order = rows.take(order, axis=0)
        if len(later):
            # most lists come in the order of the last one; only places that tie need more than the first number
            first = in_order[:, _PLACE[0]]
            if (first.take(later) <= first.take(later - 1)).any():
                places = rows[:, _PLACE].tolist()
                for start, end in alike:
                    order[start:end] = sorted(order[start:end].tolist(), key=places.__getitem__)
                in_order = rows.take(order, axis=0)
        return words, in_order.tobytes()

    def _order(self, listed: bytes) -> Order:
        """Contacts as pymunk lists them: their order by our numbers of bodies, runs of one pair in it, and words."""
        ids = np.frombuffer(listed, np.uint64).reshape(-1, WORDS).tolist()
        words = [(self._by_id[a], self._by_id[b], count) for a, b, count in ids]
        order = sorted(range(len(words)), key=words.__getitem__)
        # several pieces or segments, of which some touch at one and the same corner
        alike, later = list[tuple[int, int]](), list[int]()
        for k in range(1, len(order)):
            if words[order[k]] == words[order[k - 1]]:
                start = alike.pop()[0] if alike and alike[-1][1] == k else k - 1
                alike.append((start, k + 1))
                later.append(k)
        ordered = np.array([words[k] for k in order], np.int64).tobytes()
        if not alike and order == list(range(len(order))):
            order = []
        return np.array(order, np.int64), alike, np.array(later, np.int64), ordered

    def weaken(self, part: float) -> None:
        """Let gravity act with a part of its strength."""
        self._space.gravity = tuple((self._gravity * part).tolist())

    def place(self, state: Array) -> None:
        """Set positions and velocities, (M, 6)."""
        self._placing[: len(state)] = state
        if len(state):
            self._place_buffer._float_arr.num = 0  # as pymunk does: from the first number on
            lib.cpSpaceEachBody(*self._write_states)

    def push(self, load: Array) -> None:
        """Forces and torques for the next step, (M, 3): g·px/s², g·px/s², g·px²/s²."""
        self._pushing[0, : len(load)] = load
        if len(load):
            self._push_buffer._float_arr.num = 0
            lib.cpSpaceEachBody(*self._write_loads)

    def brake(self, torques: Mapping[Pair, float]) -> None:
        """Let torques of at most so much resist the turning of one body against another or the world."""
        for key, torque in torques.items():
            if key not in self._brakes:
                other = self._anchor if key[1] < 0 else self._bodies[key[1]]
                motor = pymunk.SimpleMotor(self._bodies[key[0]], other, 0.0)
                self._space.add(motor)
                self._brakes[key] = motor, motor._constraint
            lib.cpConstraintSetMaxForce(self._brakes[key][1], torque)

    def braked(self) -> dict[Pair, float]:
        """Size of the angular impulse that each brake gave in the last step, g·px²/s."""
        return {key: lib.cpConstraintGetImpulse(motor) for key, (_, motor) in self._brakes.items()}


def _batched(space: pymunk.Space, name: str, fields: Flag, buffer: batch.Buffer) -> tuple[Any, Any, Any]:
    """What `pymunk.batch` hands to Chipmunk to read or set some fields of all bodies, or of all contacts."""
    request = ffi.new("pmBatchedData *")
    request.fields, request.floatArray, request.intArray = fields.value, buffer._float_arr, buffer._int_arr
    return space._space, ffi.addressof(lib, name), request


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
