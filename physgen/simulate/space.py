"""The one space of pymunk: Chipmunk finds contacts and solves normal forces, friction and joints.

No other module uses pymunk. Shapes have no elasticity: bounces are computed in `collisions`.
"""

from __future__ import annotations

import atexit
from collections.abc import Sequence
from enum import Flag
from itertools import pairwise
from math import hypot
from struct import Struct
from typing import Any
from weakref import WeakSet

import numpy as np
import pymunk
import pymunk.batch as batch
from numpy.typing import NDArray
from pymunk._chipmunk_cffi import ffi, lib
from pymunk.batch import ArbiterFields, BodyFields

from physgen.compile.world import EVERY_GROUP, Body, Joint, Passage, Wall, World
from physgen.scene.scene import SPRINGS, JointKind, Motion
from physgen.simulate.contacts import (
    CONTACT,
    NO_CONTACTS,
    WORDS,
    Array,
    Order,
    Pair,
)
from physgen.simulate.internal_edges import (
    Contact,
    Frames,
    ShapeOutline,
    internal_edges,
)
from physgen.simulate.surfaces import SpecialSurfaces

Index = NDArray[np.int64]
Distances = tuple[float, float, float, float]
"""px by which the owners of two shapes are apart, along x and y, and turned."""

SPECIAL = 1
"""The engine's type of shapes whose contacts are asked about."""
SLOP = 0.005
"""px of overlap that is let stand: keeps resting contacts alive without a visible sink."""
SEAM = 0.5
"""px between the ends of two walls that make one smooth line."""
NUDGE = 1e-6
"""px by which a circle is moved whose centre is in line with a side of a polygon."""
LEAST_ASIDE = 1e-3
"""Of a radius, by which a circle's contact is beside its normal if the normal is wrong."""
STRAIGHT = 0.999
"""Cosine of the angle up to which two walls that meet make one smooth line."""

_STATE = (
    BodyFields.POSITION
    | BodyFields.ANGLE
    | BodyFields.VELOCITY
    | BodyFields.ANGULAR_VELOCITY
)
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


TOUCH = Struct("@i2d10d")
"""Chipmunk's cpContactPointSet: a count, the normal, and of two points, if there are
so many, the places on both shapes and the distance."""

LIVING: WeakSet[Space] = WeakSet()
"""All spaces of this process."""


@atexit.register
def disown_spaces() -> None:
    """Leave the memory of all spaces to the operating system at the end of the process.

    pymunk frees memory by functions that use names of its modules. The interpreter may have cleared these names before
    the last space goes, which pymunk then reports on stderr. To free the memory here would crash threads that still
    simulate.
    """
    for space in LIVING:
        space.disown()


class Space:
    """One space in motion; states are (M, 6): x, y, angle, vx, vy, spin of the bodies that are not static."""

    def __init__(self, world: World) -> None:
        space = pymunk.Space()
        space.gravity = tuple(world.gravity.tolist())
        space.collision_slop = SLOP
        space.collision_persistence = (
            1  # else the batch reader still lists contacts that have parted
        )
        self._space, self._gravity = space, world.gravity
        bodies = [_add_body(space, body) for body in world.bodies]
        by_passage: dict[Passage, list[Wall]] = {}
        for wall in world.walls:
            by_passage.setdefault(wall.passage, []).append(wall)
        # what passes through one wall meets the end of another
        smooth = {p: _neighbours(alike) for p, alike in by_passage.items()}
        walls = [_add_wall(space, wall, smooth[wall.passage]) for wall in world.walls]
        self._bodies = bodies
        self._anchor = pymunk.Body(body_type=pymunk.Body.STATIC)
        space.add(self._anchor)
        self._parts = _add_joints(space, world.joints, bodies, self._anchor)
        """Name of a joint -> what holds it in the engine."""
        ids = np.array(
            [body.id for body in (*bodies, *walls)], np.uint64
        )  # memory addresses
        self._by_id = np.argsort(ids)
        self._ids = ids[self._by_id]
        self.moving = np.flatnonzero(
            [body.motion is not Motion.STATIC for body in world.bodies]
        )
        """(M,): bodies that the state lists, in order."""
        M = len(self.moving)
        self._states, self._contacts = batch.Buffer(), batch.Buffer()
        self._read_states = _batched(
            space, "pmSpaceBodyGetIteratorFuncBatched", _STATE, self._states
        )
        self._read_contacts = _batched(
            space, "pmSpaceArbiterIteratorFuncBatched", _CONTACT, self._contacts
        )
        # the batch functions go through the bodies that move in the order they were added, then the static ones
        still = [b.center for b in world.bodies if b.motion is Motion.STATIC] + [
            np.zeros(2)
        ] * (len(walls) + 1)
        self._placing, self._pushing = (
            np.zeros((M + len(still), 6)),
            np.zeros((M + len(still), 3)),
        )
        self._placing[M:, :2] = np.array(still).reshape(-1, 2)
        self._place_buffer, self._push_buffer = batch.Buffer(), batch.Buffer()
        if M:
            self._place_buffer.set_float_buf(self._placing)
            self._push_buffer.set_float_buf(self._pushing)
        writer = "pmSpaceBodySetIteratorFuncBatched"
        self._write_states = _batched(space, writer, _STATE, self._place_buffer)
        self._write_loads = _batched(space, writer, _LOAD, self._push_buffer)
        self._brakes: dict[Pair, tuple[pymunk.SimpleMotor, Any]] = {}
        self._braking: Sequence[Pair] = ()
        self._motors: list[Any] = []
        """Of the pairs that brake now."""
        self._special = self._watch(world, [*bodies, *walls])
        self._smooth = frozenset(
            len(bodies) + k for k, wall in enumerate(world.walls) if wall.is_smooth
        )
        """Curves: their chords have no edges."""
        self._sweeps = int(space.iterations)
        self._orders: dict[bytes, Order] = {}
        """By contacts as pymunk lists them: few lists come again and again."""
        places = [*bodies, *walls]
        self._still_poses = [(*body.position, body.angle) for body in places]
        self._shapes = [shape._shape for body in places for shape in body.shapes]
        self._numbers = {shape: k for k, shape in enumerate(self._shapes)}
        outlines = tuple(
            _shape_outline(shape, owner)
            for owner, body in enumerate(places)
            for shape in body.shapes
        )
        self._outlines = outlines
        self._dynamic = {
            k for k, b in enumerate(world.bodies) if b.motion is Motion.DYNAMIC
        }
        self._circles = {o.owner: o for o in outlines if not o.corners}
        self._owners = [outline.owner for outline in outlines]
        reach = [hypot(*outline.center) + outline.reach for outline in outlines]
        self._reach = [
            far if outline.corners else 0.0
            for far, outline in zip(reach, outlines, strict=True)
        ]
        poses = tuple(self._still_poses)
        self._edges = internal_edges(outlines, _pairs_apart(world), poses)
        self._partners: dict[int, set[int]] = {}
        """Owners that each owner touched when contacts at internal edges were last looked for."""
        self.hidden: dict[Pair, tuple[float, Distances]] = {}
        """Shapes whose contact at an internal edge is left out of the solution.

        The px that they may move before this is looked at again, and where they are.
        """
        self.nudges: dict[int, tuple[float, float]] = {}
        """Bodies whose contacts have a wrong normal, and the px by which to move them."""
        self.parting: list[Joint] = []
        """Broken joints with bodies that still pass through each other."""
        LIVING.add(self)

    def _watch(self, world: World, parts: list[pymunk.Body]) -> SpecialSurfaces | None:
        """Ask about contacts of surfaces that run, stick or let others pass; None if there are none."""
        passages = [body.passage for body in world.bodies]
        passages += [wall.passage for wall in world.walls]
        has_groups = any(
            passage.group != 1 or passage.collides_with != EVERY_GROUP
            for passage in passages
        )
        for passage, own in zip(passages if has_groups else (), parts, strict=False):
            for shape in own.shapes:
                shape.filter = pymunk.ShapeFilter(
                    categories=passage.group, mask=passage.collides_with
                )
        owners = SpecialSurfaces.owners_of(world)
        if not owners:
            return None
        for owner in owners:
            for shape in parts[owner].shapes:
                shape.collision_type = SPECIAL
        special = SpecialSurfaces(world, {body.id: k for k, body in enumerate(parts)})
        self._space.on_collision(
            SPECIAL,
            None,
            begin=special.begin,
            pre_solve=special.solve,
            post_solve=special.note,
            separate=special.separate,
        )
        return special

    def disown(self) -> None:
        """Keep pymunk from freeing the memory of this space and of all in it."""
        ffi.gc(self._space._space, None)
        for body in self._space.bodies:
            ffi.gc(body._body, None)
        for shape in self._space.shapes:
            ffi.gc(shape._shape, None)
        for constraint in self._space.constraints:
            ffi.gc(constraint._constraint, None)

    @property
    def iterations(self) -> int:
        """Sweeps of the contact solver a step."""
        return self._sweeps

    @iterations.setter
    def iterations(self, count: int) -> None:
        if count != self._sweeps:
            self._space.iterations = self._sweeps = count

    def step(self, h: float) -> tuple[bytes, Order, bytes]:
        """Move by the velocities, then find contacts and change the velocities; states, and contacts as listed."""
        # what pymunk does around these calls takes as long as a small step
        lib.cpSpaceStep(self._read_states[0], h)
        states, words, numbers = (
            self._states._float_arr,
            self._contacts._int_arr,
            self._contacts._float_arr,
        )
        states.num = words.num = numbers.num = 0
        lib.cpSpaceEachBody(*self._read_states)
        lib.cpSpaceEachCachedArbiter(*self._read_contacts)
        moved: bytes = ffi.buffer(states.arr, 48 * len(self.moving))[:]
        if not words.num:
            return moved, NO_CONTACTS, b""
        if self.hidden or (self._special and self._special.passing):
            return moved, *self._visible_contacts()
        listed = ffi.buffer(words.arr, 8 * words.num)[:]
        order = self._orders.get(listed) or self._order(listed)
        return moved, order, ffi.buffer(numbers.arr, 8 * numbers.num)[:]

    def _visible_contacts(self) -> tuple[Order, bytes]:
        """Return the contacts that were read without those that are left out of the solution, which have no points."""
        words, numbers = self._contacts._int_arr, self._contacts._float_arr
        raw = ffi.buffer(words.arr, 8 * words.num)[:]
        pairs = np.frombuffer(raw, np.int64).reshape(-1, WORDS)
        is_visible = pairs[:, 2] > 0
        if not is_visible.any():
            return NO_CONTACTS, b""
        rows = np.frombuffer(ffi.buffer(numbers.arr, 8 * numbers.num)[:])
        listed = pairs[is_visible].tobytes()
        shown = rows.reshape(len(pairs), -1)[is_visible]
        return self._orders.get(listed) or self._order(listed), shown.tobytes()

    def hide_internal_edges(
        self, pairs: frozenset[Pair] | None, order: Order, numbers: bytes
    ) -> bool:
        """Leave contacts at internal edges out of the next steps; return whether there is one that acted in this step.

        pairs: of objects, the lesser first, that may touch at such an edge; None: all.
        The contacts of the step and their numbers are as listed.
        """
        meetings = order.meetings
        self._partners = meetings.partners
        frames = self._frames()
        doubtful: set[Pair] = set()
        for pair in meetings.rows if pairs is None else pairs:
            if not self._smooth.isdisjoint(pair):
                continue
            for row in meetings.rows.get(pair, ()):
                if self._is_doubtful(frames, meetings.listed[row], row, numbers):
                    doubtful.add(pair)
                    break
        is_changed = False
        for arbiter in self._arbiters() if doubtful else ():
            if not arbiter.count:
                continue
            key = self._numbers[arbiter.a], self._numbers[arbiter.b]
            first, second = self._owners[key[0]], self._owners[key[1]]
            pair = (first, second) if first < second else (second, first)
            if pair not in doubtful:
                continue
            if self._nudge(frames, arbiter, key):
                is_changed = True
                continue
            room = self._room(frames, key)
            if room > 0:
                lib.cpArbiterSetProcessCollision(arbiter, False)
                self.hidden[key] = room, self._distances(frames, key)
                is_changed = True
        return is_changed

    def _is_doubtful(
        self, frames: Frames, words: list[int], row: int, numbers: bytes
    ) -> bool:
        """Return whether a contact may be at an internal edge or have a wrong normal.

        words: partners and count of points of the contact in this row, as listed.
        """
        first, second, count = words
        contact = CONTACT.unpack_from(numbers, CONTACT.size * row)
        nx, ny, ax, ay, bx, by = contact[2:8]
        for owner, x, y in ((first, bx, by), (second, ax, ay)):
            circle = self._circles.get(owner)
            if circle is not None:
                cx, cy = frames.of(owner).place(circle.center)
                aside = nx * (y - cy) - ny * (x - cx)
                if abs(aside) > LEAST_ASIDE * circle.reach / 2:
                    return True
        points = [((ax + bx) / 2, (ay + by) / 2)]
        if count > 1:
            ax, ay, bx, by = contact[9:13]
            points.append(((ax + bx) / 2, (ay + by) / 2))
        pair = first, second
        touch = Contact((nx, ny), points)
        return self._edges.may_cover(frames, pair, self._partners, touch)

    def _nudge(self, frames: Frames, arbiter: Any, key: Pair) -> bool:
        """Note by how much to move a circle in contact with a corner of a polygon if the normal is wrong.

        If the centre is in line with a side, the engine takes the normal of the side for
        that of the corner, and the radius for the overlap.
        """
        first, second = self._outlines[key[0]], self._outlines[key[1]]
        is_second = not second.corners
        circle, other = (second, first) if is_second else (first, second)
        if circle.corners or len(other.corners) < 3:
            return False
        center = frames.of(circle.owner).place(circle.center)
        pose = frames.poses[other.owner]
        arm = arbiter.contacts[0].r1 if is_second else arbiter.contacts[0].r2
        nx, ny = arbiter.n.x, arbiter.n.y
        aside = nx * (pose[1] + arm.y - center[1]) - ny * (pose[0] + arm.x - center[0])
        if abs(aside) < LEAST_ASIDE * circle.reach:
            return False
        step = NUDGE if is_second else -NUDGE
        owner = circle.owner
        if owner not in self._dynamic:
            owner, step = other.owner, -step
        if owner not in self._dynamic:
            return False
        self.nudges[owner] = step * nx, step * ny
        return True

    def review_internal_edges(self) -> None:
        """Let those contacts act again that are no longer at an internal edge."""
        frames = self._frames()
        ended: list[Pair] = []
        for key, (room, before) in self.hidden.items():
            now = self._distances(frames, key)
            apart = abs(now[0] - before[0]) + abs(now[1] - before[1])
            if apart + abs(now[2] - before[2]) + abs(now[3] - before[3]) < room:
                continue
            room = self._room(frames, key)
            self.hidden[key] = room, now
            if not room > 0:
                ended.append(key)
        if not ended:
            return
        for key in ended:
            del self.hidden[key]
        for arbiter in self._arbiters():
            key = self._numbers[arbiter.a], self._numbers[arbiter.b]
            if key in ended:
                lib.cpArbiterSetProcessCollision(arbiter, True)

    def _arbiters(self) -> list[Any]:
        found: list[Any] = []
        handle = ffi.new_handle(found)
        collect = lib.ext_cpArbiterIteratorFunc
        lib.cpSpaceEachCachedArbiter(self._space._space, collect, handle)
        return found

    def _frames(self) -> Frames:
        """Return the frames of all owners after the last step."""
        poses = self._still_poses.copy()
        states = ffi.buffer(self._states._float_arr.arr, 48 * len(self.moving))
        rows = np.frombuffer(states).reshape(-1, 6)[:, :3].tolist()
        for owner, pose in zip(self.moving.tolist(), rows, strict=True):
            poses[owner] = pose
        return Frames(poses)

    def _distances(self, frames: Frames, key: Pair) -> Distances:
        """Return px by which the owners of two shapes are apart and turned."""
        first, second = self._owners[key[0]], self._owners[key[1]]
        one, other = frames.poses[first], frames.poses[second]
        turns = self._reach[key[0]] * one[2], self._reach[key[1]] * other[2]
        return one[0] - other[0], one[1] - other[1], turns[0], turns[1]

    def _room(self, frames: Frames, key: Pair) -> float:
        """Return `InternalEdges.room` of two shapes; 0 if they do not touch."""
        touching = lib.cpShapesCollide(self._shapes[key[0]], self._shapes[key[1]])
        # to read its parts by name takes ten times as long
        count, *touch = TOUCH.unpack(ffi.buffer(ffi.addressof(touching)))
        if not count:
            return 0.0
        # places of a first point on both shapes and its distance, then of a second one
        points = [((touch[2] + touch[4]) / 2, (touch[3] + touch[5]) / 2)]
        if count > 1:
            points.append(((touch[7] + touch[9]) / 2, (touch[8] + touch[10]) / 2))
        contact = Contact((touch[0], touch[1]), points)
        return self._edges.room(frames, key, self._partners, contact)

    def _order(self, listed: bytes) -> Order:
        """Of contacts as pymunk lists them: by their bodies' ids, in the order of memory addresses."""
        if len(self._orders) * max(len(listed), 8000) >= 8_000_000:
            self._orders.clear()
        pairs = np.frombuffer(listed, np.int64).reshape(-1, WORDS).copy()
        pairs[:, :2] = self._by_id[
            np.searchsorted(self._ids, pairs[:, :2].view(np.uint64))
        ]
        self._orders[listed] = Order(pairs)
        return self._orders[listed]

    def release(self, joint: Joint) -> None:
        """Let a joint hold no more; its bodies collide once they are apart."""
        for part in self._parts.get(joint.name, ()):
            part.max_force = 0.0
        if joint.second is not None and not joint.collide:
            self.parting.append(joint)

    def separate_broken(self) -> None:
        """Let the parts of broken joints collide that no longer overlap."""
        self.parting = [joint for joint in self.parting if not self._part(joint)]

    def _part(self, joint: Joint) -> bool:
        """Let the two bodies of a broken joint collide if they do not overlap; return whether they do now."""
        assert joint.second is not None
        first, second = (self._bodies[k] for k in (joint.first, joint.second))
        for one in first.shapes:
            for other in second.shapes:
                touch = lib.cpShapesCollide(one._shape, other._shape)
                depths = [-touch.points[k].distance for k in range(touch.count)]
                if max(depths, default=0.0) > SEAM:
                    return False
        for part in self._parts.get(joint.name, ()):
            part.collide_bodies = True
        self._edges.unite(joint.first, joint.second)
        return True

    def weaken(self, part: float) -> None:
        """Let gravity act with a part of its strength."""
        self._space.gravity = tuple((self._gravity * part).tolist())

    def place(self, state: Array) -> None:
        """Set positions and velocities, (M, 6)."""
        self._placing[: len(state)] = state
        if len(state):
            self._place_buffer._float_arr.num = (
                0  # as pymunk does: from the first number on
            )
            lib.cpSpaceEachBody(*self._write_states)

    def push(self, load: Array) -> None:
        """Forces and torques for the next step, (M, 3): g·px/s², g·px/s², g·px²/s²."""
        self._pushing[: len(load)] = load
        if len(load):
            self._push_buffer._float_arr.num = 0
            lib.cpSpaceEachBody(*self._write_loads)

    def brake(self, pairs: Sequence[Pair], torques: list[float]) -> None:
        """Let torques of at most so much resist the turning of one body against another or the world."""
        if pairs is not self._braking:
            self._braking, before = pairs, self._motors
            for key in pairs:
                if key not in self._brakes:
                    other = self._anchor if key[1] < 0 else self._bodies[key[1]]
                    motor = pymunk.SimpleMotor(self._bodies[key[0]], other, 0.0)
                    self._space.add(motor)
                    self._brakes[key] = motor, motor._constraint
            self._motors = [self._brakes[key][1] for key in pairs]
            for motor in before:
                lib.cpConstraintSetMaxForce(motor, 0.0)
        for motor, torque in zip(self._motors, torques, strict=True):
            lib.cpConstraintSetMaxForce(motor, torque)

    def braked(self) -> list[float]:
        """Size of the angular impulse that each brake gave in the last step, g·px²/s."""
        return [lib.cpConstraintGetImpulse(motor) for motor in self._motors]


def _batched(
    space: pymunk.Space, name: str, fields: Flag, buffer: batch.Buffer
) -> tuple[Any, Any, Any]:
    """What `pymunk.batch` hands to Chipmunk to read or set some fields of all bodies, or of all contacts."""
    request = ffi.new("pmBatchedData *")
    request.fields, request.floatArray, request.intArray = (
        fields.value,
        buffer._float_arr,
        buffer._int_arr,
    )
    return space._space, ffi.addressof(lib, name), request


def _shape_outline(shape: pymunk.Shape, owner: int) -> ShapeOutline:
    """Return a shape in plain numbers; corners go clockwise to the eye."""
    match shape:
        case pymunk.Poly():
            corners = [(float(x), float(y)) for x, y in shape.get_vertices()]
            turned = zip(corners, (*corners[1:], corners[0]), strict=True)
            if sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in turned) < 0:
                corners.reverse()
        case pymunk.Segment():
            corners = [(float(x), float(y)) for x, y in (shape.a, shape.b)]
        case _:
            corners = []
    assert shape.body is not None
    is_static = shape.body.body_type == pymunk.Body.STATIC
    xs, ys = [x for x, _ in corners] or [0.0], [y for _, y in corners] or [0.0]
    x, y = (min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2
    reach = max(map(hypot, [u - x for u in xs], [v - y for v in ys]))
    if isinstance(shape, pymunk.Circle):
        (x, y), reach = shape.offset, shape.radius
    return ShapeOutline(owner, is_static, tuple(corners), (x, y), reach)


def _pairs_apart(world: World) -> frozenset[tuple[int, int]]:
    """Return pairs of bodies and walls, in both orders, that a joint or their groups let overlap."""
    pairs = [
        (joint.first, joint.second)
        for joint in world.joints
        if joint.second is not None and not joint.collide
    ]
    passages = [body.passage for body in world.bodies]
    passages += [wall.passage for wall in world.walls]
    for first, one in enumerate(passages):
        if one.group == 1 and one.collides_with == EVERY_GROUP:
            continue
        for second, other in enumerate(passages):
            is_met = one.group & other.collides_with and other.group & one.collides_with
            if not is_met:
                pairs.append((first, second))
    return frozenset([*pairs, *((second, first) for first, second in pairs)])


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
    if model.disc is not None:
        offset, radius = model.disc
        shapes = [pymunk.Circle(body, radius, (float(offset[0]), float(offset[1])))]
    for shape in shapes:
        shape.friction = model.surface.friction
        space.add(shape)
    return body


def _add_wall(
    space: pymunk.Space, wall: Wall, smooth: dict[tuple[float, ...], list[float]]
) -> pymunk.Body:
    """A body of its own, so that contacts know which wall they touch."""
    body = pymunk.Body(body_type=pymunk.Body.STATIC)
    space.add(body)
    solid: list[pymunk.Shape] = [pymunk.Poly(body, p.tolist()) for p in wall.pieces]
    if wall.disc is not None:
        (x, y), radius = wall.disc
        solid = [pymunk.Circle(body, radius, (float(x), float(y)))]
    for shape in solid:
        shape.friction = wall.surface.friction
        space.add(shape)
    for line in wall.chains if not solid else ():
        for a, b in pairwise(line.tolist()):
            segment = pymunk.Segment(body, a, b, 0.0)
            segment.friction = wall.surface.friction
            before, after = smooth.get((*a, *b)), smooth.get((*b, *a))
            if before is not None or after is not None:
                # without a neighbour, a point on the segment's own line lets its end be hit from outside only
                segment.set_neighbors(tuple(before or a), tuple(after or b))
            space.add(segment)
    return body


def _neighbours(walls: Sequence[Wall]) -> dict[tuple[float, ...], list[float]]:
    """(near end, far end) of a segment -> far end of the one that carries on from its near end in a straight line.

    Told of its neighbours, a segment's end no longer trips what slides over the seam.
    """
    ends = [
        (np.array(near), np.array(far))
        for wall in walls
        for line in wall.chains
        for a, b in pairwise(line.tolist())
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


GUIDES = (JointKind.SLIDER, JointKind.ROPE, JointKind.PULLEY, JointKind.GEAR)
ENDLESS = 1e6
"""px that the engine's rail goes on beyond its ends, which bounds.py holds."""


def _add_guide(
    space: pymunk.Space, joint: Joint, bodies: list[pymunk.Body], world: pymunk.Body
) -> list[pymunk.Constraint]:
    """Add a slider or a gear, or, for a rope and a pulley, what keeps two bodies from bumping into each other."""
    first = bodies[joint.first]
    second = world if joint.second is None else bodies[joint.second]
    parts: list[pymunk.Constraint] = []
    if joint.kind is JointKind.SLIDER:
        way = joint.guide[0] / float(np.hypot(*joint.guide[0])) * ENDLESS
        ends = [(joint.second_at + sign * way).tolist() for sign in (-1, 1)]
        parts = [
            pymunk.GrooveJoint(
                second, first, ends[0], ends[1], joint.first_at.tolist()
            ),
            pymunk.GearJoint(first, second, 0.0, 1.0),
        ]
    elif joint.kind is JointKind.GEAR:
        parts = [pymunk.GearJoint(first, second, 0.0, joint.ratio)]
    elif joint.second is not None:
        parts = [pymunk.SlideJoint(first, second, (0, 0), (0, 0), 0, joint.length)]
        parts[0].max_force = 0.0
    for part in parts:
        part.error_bias = 1.0
        part.collide_bodies = joint.collide
        space.add(part)
    return parts


def _add_joints(
    space: pymunk.Space,
    joints: tuple[Joint, ...],
    bodies: list[pymunk.Body],
    world: pymunk.Body,
) -> dict[str, list[pymunk.Constraint]]:
    """Pins and welds, so that contacts are solved with them. They keep velocities only: where joints are, and motors,
    is for joined.py, which solves them exactly after each step; springs are loads.

    Where a weld sits does not matter; between the two centres it turns by the shortest levers.
    """
    added: dict[str, list[pymunk.Constraint]] = {}
    for joint in joints:
        if joint.kind in SPRINGS:
            continue
        if joint.kind in GUIDES:
            added[joint.name] = _add_guide(space, joint, bodies, world)
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
        parts: list[pymunk.Constraint] = [
            pymunk.PivotJoint(a, b, first.tolist(), second.tolist())
        ]
        if joint.kind is JointKind.WELD:
            parts.append(pymunk.GearJoint(a, b, 0.0, 1.0))
        added[joint.name] = parts
        for part in parts:
            part.error_bias = 1.0
            part.collide_bodies = joint.collide
            space.add(part)
    return added
