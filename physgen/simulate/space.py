"""The space of pymunk: Chipmunk finds contacts and solves normal forces, friction and
joints.

No other module uses pymunk. Shapes have no elasticity: `collisions` computes bounces.
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
"""Relative position of the owners of two shapes, px, along x and y, and their
rotations.
"""

SPECIAL = 1
"""Collision type of shapes with callbacks for their contacts."""
SLOP = 0.005
"""Permitted overlap, px: it keeps resting contacts alive and is invisible."""
SEAM = 0.5
"""Gap between the ends of two walls, px, within which they form one smooth line."""
NUDGE = 1e-6
"""Displacement, px, of a circle whose centre is in line with a side of a polygon."""
LEAST_ASIDE = 1e-3
"""Share of a circle's radius by which a contact with a wrong normal is beside it."""
STRAIGHT = 0.999
"""Cosine of the angle up to which two walls form one smooth line."""

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
"""Chipmunk's cpContactPointSet: count and normal, then for each of two points the
places on both shapes and the distance.
"""

DEPTH = 8
"""Place of the distance at the first point among the numbers of a contact."""

LIVING: WeakSet[Space] = WeakSet()
"""All spaces of this process."""


@atexit.register
def disown_spaces() -> None:
    """Leave the memory of all spaces to the operating system at the end of the process.

    pymunk frees memory by functions that use names of its modules. The interpreter may
    have cleared these names before the last space is freed, and pymunk then reports
    errors on stderr. Freeing the memory here would crash threads that still simulate.
    """
    for space in LIVING:
        space.disown()


class Space:
    """One space in motion.

    States are (M, 6): x, y, angle, vx, vy, spin of all bodies except the static ones.
    """

    def __init__(self, world: World) -> None:
        space = pymunk.Space()
        space.gravity = tuple(world.gravity.tolist())
        space.collision_slop = SLOP
        # With a longer persistence, the batch reader also lists former contacts.
        space.collision_persistence = 1
        self._space = space
        self._gravity = world.gravity
        bodies = [_add_body(space, body) for body in world.bodies]
        walls = _add_walls(space, world.walls)
        self._bodies = bodies
        self._anchor = pymunk.Body(body_type=pymunk.Body.STATIC)
        space.add(self._anchor)
        self._parts = _add_joints(space, world.joints, bodies, self._anchor)
        """Constraints of the engine by the name of a joint."""
        # The engine's ids are memory addresses.
        owners = [*bodies, *walls]
        ids = np.array([body.id for body in owners], np.uint64)
        self._by_id = np.argsort(ids)
        self._ids = ids[self._by_id]
        self._prepare_buffers(world)
        self._brakes: dict[Pair, tuple[pymunk.SimpleMotor, Any]] = {}
        self._brake_pairs: Sequence[Pair] = ()
        self._motors: list[Any] = []
        """Motors of the present brakes."""
        self._special = self._watch(world, owners)
        self._sweeps = int(space.iterations)
        self._orders: dict[bytes, Order] = {}
        """Orders by pymunk's list of contacts: a run has few different lists."""
        self._index_shapes(world, owners)
        self._partners: dict[int, set[int]] = {}
        """Touched owners of each owner at the latest search for internal edges."""
        self.hidden: dict[Pair, tuple[float, Distances]] = {}
        """Pairs of shapes with contacts at internal edges, which are not solved.

        With each, the distance that they may move before the next test, px, and their
        relative position at the last one.
        """
        self.nudges: dict[int, tuple[float, float]] = {}
        """Bodies whose contacts have a wrong normal, and the px by which to move them.
        """
        self.parting: list[Joint] = []
        """Broken joints of bodies that still overlap, and do not collide yet."""
        LIVING.add(self)

    def _prepare_buffers(self, world: World) -> None:
        """Prepare the memory in which the engine's states and loads are read and
        written at once.
        """
        # pymunk's batch functions copy all states in one call. Attributes of Python
        # objects would take longer than the step itself.
        space = self._space
        self.moving = np.flatnonzero(
            [body.motion is not Motion.STATIC for body in world.bodies]
        )
        """Bodies of the state in its order, (M,)."""
        M = len(self.moving)
        self._states = batch.Buffer()
        self._contacts = batch.Buffer()
        self._read_states = _prepare_batch_arguments(
            space, "pmSpaceBodyGetIteratorFuncBatched", _STATE, self._states
        )
        self._read_contacts = _prepare_batch_arguments(
            space, "pmSpaceArbiterIteratorFuncBatched", _CONTACT, self._contacts
        )
        # The batch functions visit the moving bodies in the order of addition, and then
        # the static ones: bodies, walls and the anchor.
        static_centers = [
            body.center for body in world.bodies if body.motion is Motion.STATIC
        ]
        static_centers += [np.zeros(2)] * (len(world.walls) + 1)
        self._placing = np.zeros((M + len(static_centers), 6))
        self._pushing = np.zeros((M + len(static_centers), 3))
        self._placing[M:, :2] = np.array(static_centers).reshape(-1, 2)
        self._place_buffer = batch.Buffer()
        self._push_buffer = batch.Buffer()
        if M:
            self._place_buffer.set_float_buf(self._placing)
            self._push_buffer.set_float_buf(self._pushing)
        writer = "pmSpaceBodySetIteratorFuncBatched"
        self._write_states = _prepare_batch_arguments(
            space, writer, _STATE, self._place_buffer
        )
        self._write_loads = _prepare_batch_arguments(
            space, writer, _LOAD, self._push_buffer
        )

    def _index_shapes(self, world: World, owners: Sequence[pymunk.Body]) -> None:
        """Number the shapes of all owners, and find their internal edges."""
        smooth_walls = [k for k, wall in enumerate(world.walls) if wall.is_smooth]
        self._smooth = frozenset(len(world.bodies) + k for k in smooth_walls)
        """Smooth curves, without internal edges."""
        # Poses at the start suffice for static owners, which never move.
        self._still_poses = [(*body.position, body.angle) for body in owners]
        self._shapes: list[Any] = []
        outlines: list[ShapeOutline] = []
        for owner, body in enumerate(owners):
            for shape in body.shapes:
                self._shapes.append(shape._shape)
                outlines.append(_shape_outline(shape, owner))
        self._numbers = {shape: k for k, shape in enumerate(self._shapes)}
        self._outlines = tuple(outlines)
        self._dynamic = {
            k for k, body in enumerate(world.bodies) if body.motion is Motion.DYNAMIC
        }
        self._circles = {o.owner: o for o in outlines if not o.corners}
        self._owners = [outline.owner for outline in outlines]
        self._reach = list(map(_reach_of_corners, outlines))
        self._edges = internal_edges(
            self._outlines, _pairs_apart(world), tuple(self._still_poses)
        )

    def _watch(self, world: World, parts: list[pymunk.Body]) -> SpecialSurfaces | None:
        """Register callbacks for surfaces that move, stick or let others pass.

        None if the world has no such surface.
        """
        passages = [body.passage for body in world.bodies]
        passages += [wall.passage for wall in world.walls]
        # Keep the default filter, which lets all collide, unless some object ignores
        # others.
        if not all(map(_lets_all_collide, passages)):
            for passage, part in zip(passages, parts, strict=False):
                _set_filter(part, passage)
        owners = SpecialSurfaces.owners_of(world)
        if not owners:
            return None
        for owner in owners:
            for shape in parts[owner].shapes:
                shape.collision_type = SPECIAL
        # A callback runs for every contact of these shapes, so that only they get the
        # type.
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
        """Keep pymunk from freeing the memory of this space and of its parts."""
        ffi.gc(self._space._space, None)
        for body in self._space.bodies:
            ffi.gc(body._body, None)
        for shape in self._space.shapes:
            ffi.gc(shape._shape, None)
        for constraint in self._space.constraints:
            ffi.gc(constraint._constraint, None)

    @property
    def iterations(self) -> int:
        """Return the number of sweeps of the contact solver per step."""
        return self._sweeps

    @iterations.setter
    def iterations(self, count: int) -> None:
        if count != self._sweeps:
            self._space.iterations = self._sweeps = count

    def step(self, h: float) -> tuple[bytes, Order, bytes]:
        """Advance a step of h seconds; return states, the order of contacts and their
        numbers.

        The engine first moves bodies by their velocities, then finds contacts and
        changes the velocities. Numbers are in pymunk's order.
        """
        # pymunk's own methods around these calls take as long as a small step.
        lib.cpSpaceStep(self._read_states[0], h)
        states = self._states._float_arr
        words = self._contacts._int_arr
        numbers = self._contacts._float_arr
        states.num = words.num = numbers.num = 0
        lib.cpSpaceEachBody(*self._read_states)
        lib.cpSpaceEachCachedArbiter(*self._read_contacts)
        new_states: bytes = ffi.buffer(states.arr, 48 * len(self.moving))[:]
        if not words.num:
            return new_states, NO_CONTACTS, b""
        if self.hidden or (self._special and self._special.passing):
            return new_states, *self._visible_contacts()
        contact_list = ffi.buffer(words.arr, 8 * words.num)[:]
        order = self._orders.get(contact_list) or self._order(contact_list)
        return new_states, order, ffi.buffer(numbers.arr, 8 * numbers.num)[:]

    def _visible_contacts(self) -> tuple[Order, bytes]:
        """Return the contacts without those that are left out of the solution.

        Contacts without a solution have no points.
        """
        # Rows of words (partners and count) and numbers belong together: both are
        # filtered by the same mask.
        words = self._contacts._int_arr
        numbers = self._contacts._float_arr
        raw = ffi.buffer(words.arr, 8 * words.num)[:]
        pairs = np.frombuffer(raw, np.int64).reshape(-1, WORDS)
        is_visible = pairs[:, 2] > 0
        if not is_visible.any():
            return NO_CONTACTS, b""
        rows = np.frombuffer(ffi.buffer(numbers.arr, 8 * numbers.num)[:])
        contact_list = pairs[is_visible].tobytes()
        visible_numbers = rows.reshape(len(pairs), -1)[is_visible]
        return self._orders.get(contact_list) or self._order(
            contact_list
        ), visible_numbers.tobytes()

    def hide_internal_edges(
        self, pairs: frozenset[Pair] | None, order: Order, numbers: bytes
    ) -> bool:
        """Leave contacts at internal edges out of the next steps.

        `pairs`: of objects, the lesser first, that may touch at such an edge; None for
        all. The contacts and their numbers are as listed. Returns whether such a contact
        acted in this step.
        """
        meetings = order.meetings
        self._partners = meetings.partners
        frames = self._frames()
        doubtful_rows: list[int] = []
        for pair in meetings.rows if pairs is None else pairs:
            rows = meetings.rows.get(pair, [])
            if not self._smooth.isdisjoint(pair):
                continue
            doubtful = [
                row
                for row in rows
                if self._is_doubtful(frames, meetings.contacts[row], row, numbers)
            ]
            doubtful_rows += doubtful
            if not doubtful:
                continue
            # Two corners without distance have any normal, so that a second look may
            # find another one.
            doubtful_rows += [row for row in rows if not _has_depth(row, numbers)]
        is_changed = False
        if doubtful_rows:
            arbiters = self._arbiters()
        else:
            arbiters = []
        # The engine lists contacts in one order, here with those without points.
        if len(arbiters) > len(meetings.contacts):
            arbiters = [arbiter for arbiter in arbiters if arbiter.count]
        for row in sorted(set(doubtful_rows)):
            arbiter = arbiters[row]
            if not arbiter.count:
                continue
            key = self._numbers[arbiter.a], self._numbers[arbiter.b]
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
        # A circle touches on the line from its centre along the normal: another point
        # shows a wrong normal.
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
        # The case needs a circle and a polygon: other pairs have right normals.
        first = self._outlines[key[0]]
        second = self._outlines[key[1]]
        is_second = not second.corners
        if is_second:
            circle, other = (second, first)
        else:
            circle, other = (first, second)
        if circle.corners or len(other.corners) < 3:
            return False
        center = frames.of(circle.owner).place(circle.center)
        pose = frames.poses[other.owner]
        if is_second:
            arm = arbiter.contacts[0].r1
        else:
            arm = arbiter.contacts[0].r2
        nx = arbiter.n.x
        ny = arbiter.n.y
        # Distance of the corner from the line through the centre along the normal.
        aside = nx * (pose[1] + arm.y - center[1]) - ny * (pose[0] + arm.x - center[0])
        if abs(aside) < LEAST_ASIDE * circle.reach:
            return False
        if is_second:
            step = NUDGE
        else:
            step = -NUDGE
        # Only dynamic bodies can move out of the way.
        owner = circle.owner
        if owner not in self._dynamic:
            owner = other.owner
            step = -step
        if owner not in self._dynamic:
            return False
        self.nudges[owner] = step * nx, step * ny
        return True

    def review_internal_edges(self) -> None:
        """Activate the contacts no longer at an internal edge."""
        frames = self._frames()
        ended_pairs: list[Pair] = []
        for key, (room, old_distances) in self.hidden.items():
            new_distances = self._distances(frames, key)
            displacement = abs(new_distances[0] - old_distances[0]) + abs(
                new_distances[1] - old_distances[1]
            )
            # Within its room, a pair cannot have left the internal edge: skip the full
            # test.
            if (
                displacement
                + abs(new_distances[2] - old_distances[2])
                + abs(new_distances[3] - old_distances[3])
                < room
            ):
                continue
            room = self._room(frames, key)
            self.hidden[key] = room, new_distances
            if not room > 0:
                ended_pairs.append(key)
        if not ended_pairs:
            return
        for key in ended_pairs:
            del self.hidden[key]
        for arbiter in self._arbiters():
            key = self._numbers[arbiter.a], self._numbers[arbiter.b]
            if key in ended_pairs:
                lib.cpArbiterSetProcessCollision(arbiter, True)

    def _arbiters(self) -> list[Any]:
        """List the contacts of the engine."""
        arbiters: list[Any] = []
        handle = ffi.new_handle(arbiters)
        collect = lib.ext_cpArbiterIteratorFunc
        lib.cpSpaceEachCachedArbiter(self._space._space, collect, handle)
        return arbiters

    def _frames(self) -> Frames:
        """Return the frames of all owners after the last step."""
        poses = self._still_poses.copy()
        states = ffi.buffer(self._states._float_arr.arr, 48 * len(self.moving))
        rows = np.frombuffer(states).reshape(-1, 6)[:, :3].tolist()
        for owner, pose in zip(self.moving.tolist(), rows, strict=True):
            poses[owner] = pose
        return Frames(poses)

    def _distances(self, frames: Frames, key: Pair) -> Distances:
        """Return the relative position and the rotations of the owners of two shapes,
        px.
        """
        first = self._owners[key[0]]
        second = self._owners[key[1]]
        first_pose = frames.poses[first]
        second_pose = frames.poses[second]
        # A rotation counts as the path of the farthest point, so that all four numbers
        # are comparable lengths.
        turns = (
            self._reach[key[0]] * first_pose[2],
            self._reach[key[1]] * second_pose[2],
        )
        return (
            first_pose[0] - second_pose[0],
            first_pose[1] - second_pose[1],
            turns[0],
            turns[1],
        )

    def _room(self, frames: Frames, key: Pair) -> float:
        """Return `InternalEdges.room` of two shapes; 0 if they do not touch."""
        point_set = lib.cpShapesCollide(self._shapes[key[0]], self._shapes[key[1]])
        # Reading the fields by name takes ten times as long.
        count, *touch = TOUCH.unpack(ffi.buffer(ffi.addressof(point_set)))
        if not count:
            return 0.0
        # The numbers are the place of the first point on both shapes and its distance,
        # then the same of the second point.
        points = [((touch[2] + touch[4]) / 2, (touch[3] + touch[5]) / 2)]
        if count > 1:
            points.append(((touch[7] + touch[9]) / 2, (touch[8] + touch[10]) / 2))
        contact = Contact((touch[0], touch[1]), points)
        return self._edges.room(frames, key, self._partners, contact)

    def _order(self, contact_list: bytes) -> Order:
        """Return the order of pymunk's list of contacts, which is by memory
        addresses.
        """
        if len(self._orders) * max(len(contact_list), 8000) >= 8_000_000:
            self._orders.clear()
        # Memory addresses differ from run to run: replace them by our numbers of
        # bodies.
        pairs = np.frombuffer(contact_list, np.int64).reshape(-1, WORDS).copy()
        pairs[:, :2] = self._by_id[
            np.searchsorted(self._ids, pairs[:, :2].view(np.uint64))
        ]
        self._orders[contact_list] = Order(pairs)
        return self._orders[contact_list]

    def release(self, joint: Joint) -> None:
        """Remove the effect of a joint; its bodies collide once they do not overlap."""
        for part in self._parts.get(joint.name, ()):
            part.max_force = 0.0
        if joint.second is not None and not joint.collide:
            self.parting.append(joint)

    def separate_broken(self) -> None:
        """Let the bodies of broken joints collide if they no longer overlap."""
        self.parting = [joint for joint in self.parting if not self._part(joint)]

    def _part(self, joint: Joint) -> bool:
        """Let the bodies of a broken joint collide unless they overlap; return whether
        they do.
        """
        assert joint.second is not None
        first, second = (self._bodies[k] for k in (joint.first, joint.second))
        for first_shape in first.shapes:
            for second_shape in second.shapes:
                point_set = lib.cpShapesCollide(first_shape._shape, second_shape._shape)
                depths = [-point_set.points[k].distance for k in range(point_set.count)]
                if max(depths, default=0.0) > SEAM:
                    return False
        for part in self._parts.get(joint.name, ()):
            part.collide_bodies = True
        self._edges.unite(joint.first, joint.second)
        return True

    def weaken(self, part: float) -> None:
        """Set gravity to a part of its strength."""
        self._space.gravity = tuple((self._gravity * part).tolist())

    def place(self, state: Array) -> None:
        """Set positions and velocities, (M, 6)."""
        self._placing[: len(state)] = state
        if len(state):
            # As in pymunk, the reader begins at the first number.
            self._place_buffer._float_arr.num = 0
            lib.cpSpaceEachBody(*self._write_states)

    def push(self, load: Array) -> None:
        """Set forces and torques of the next step, (M, 3): g·px/s², g·px/s²,
        g·px²/s².
        """
        self._pushing[: len(load)] = load
        if len(load):
            self._push_buffer._float_arr.num = 0
            lib.cpSpaceEachBody(*self._write_loads)

    def brake(self, pairs: Sequence[Pair], torques: list[float]) -> None:
        """Set brakes: limits of torques against the spin of a body relative to another
        one.
        """
        if pairs is not self._brake_pairs:
            self._brake_pairs = pairs
            old_motors = self._motors
            for key in pairs:
                if key not in self._brakes:
                    if key[1] < 0:
                        other = self._anchor
                    else:
                        other = self._bodies[key[1]]
                    # A motor of speed 0 with a limited torque is a brake.
                    motor = pymunk.SimpleMotor(self._bodies[key[0]], other, 0.0)
                    self._space.add(motor)
                    self._brakes[key] = motor, motor._constraint
            self._motors = [self._brakes[key][1] for key in pairs]
            # Unused motors stay in the space, without torque.
            for motor in old_motors:
                lib.cpConstraintSetMaxForce(motor, 0.0)
        for motor, torque in zip(self._motors, torques, strict=True):
            lib.cpConstraintSetMaxForce(motor, torque)

    def brake_impulses(self) -> list[float]:
        """Return the size of each brake's angular impulse in the last step, g·px²/s."""
        return [lib.cpConstraintGetImpulse(motor) for motor in self._motors]


def _prepare_batch_arguments(
    space: pymunk.Space, name: str, fields: Flag, buffer: batch.Buffer
) -> tuple[Any, Any, Any]:
    """Return the arguments of Chipmunk's batch functions for some fields of bodies or
    contacts.
    """
    request = ffi.new("pmBatchedData *")
    request.fields = fields.value
    request.floatArray = buffer._float_arr
    request.intArray = buffer._int_arr
    return space._space, ffi.addressof(lib, name), request


def _has_depth(row: int, numbers: bytes) -> bool:
    """Check whether the shapes of a listed contact are apart or overlap."""
    return bool(CONTACT.unpack_from(numbers, CONTACT.size * row)[DEPTH])


def _set_filter(part: pymunk.Body, passage: Passage) -> None:
    """Set the groups of the shapes of a body or wall."""
    for shape in part.shapes:
        shape.filter = pymunk.ShapeFilter(
            categories=passage.group, mask=passage.collides_with
        )


def _reach_of_corners(outline: ShapeOutline) -> float:
    """Return the distance from an owner's centre to a shape's corners, px; 0 for a
    circle.
    """
    if not outline.corners:
        return 0.0
    return hypot(*outline.center) + outline.reach


def _shape_outline(shape: pymunk.Shape, owner: int) -> ShapeOutline:
    """Convert a shape to plain numbers; corners are clockwise in the image."""
    # The circle around the middle of the bounding box is not the smallest one, but
    # quick to compute, and large enough for a first exclusion.
    assert shape.body is not None
    is_static = shape.body.body_type == pymunk.Body.STATIC
    if isinstance(shape, pymunk.Circle):
        x, y = shape.offset
        return ShapeOutline(owner, is_static, (), (x, y), shape.radius)
    corners = _shape_corners(shape)
    xs = [x for x, _ in corners] or [0.0]
    ys = [y for _, y in corners] or [0.0]
    x = (min(xs) + max(xs)) / 2
    y = (min(ys) + max(ys)) / 2
    reach = max(map(hypot, [u - x for u in xs], [v - y for v in ys]))
    return ShapeOutline(owner, is_static, tuple(corners), (x, y), reach)


def _shape_corners(shape: pymunk.Shape) -> list[tuple[float, float]]:
    """Return the corners of a polygon, clockwise, or the ends of a segment."""
    match shape:
        case pymunk.Poly():
            corners = [(float(x), float(y)) for x, y in shape.get_vertices()]
            sides = zip(corners, (*corners[1:], corners[0]), strict=True)
            # Chipmunk may store corners in either direction.
            if sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in sides) < 0:
                corners.reverse()
            return corners
        case pymunk.Segment():
            return [(float(x), float(y)) for x, y in (shape.a, shape.b)]
        case _:
            return []


def _pairs_apart(world: World) -> frozenset[tuple[int, int]]:
    """Return the pairs of bodies and walls, in both orders, that may overlap.

    A joint or their groups permit the overlap.
    """
    pairs = [
        (joint.first, joint.second)
        for joint in world.joints
        if joint.second is not None and not joint.collide
    ]
    passages = [body.passage for body in world.bodies]
    passages += [wall.passage for wall in world.walls]
    for first, first_passage in enumerate(passages):
        if _lets_all_collide(first_passage):
            continue
        for second, second_passage in enumerate(passages):
            # Both objects must permit the collision.
            is_collision = (
                first_passage.group & second_passage.collides_with
                and second_passage.group & first_passage.collides_with
            )
            if not is_collision:
                pairs.append((first, second))
    # Both orders are stored, so that a look-up needs no sorting.
    reversed_pairs = [(second, first) for first, second in pairs]
    return frozenset([*pairs, *reversed_pairs])


def _lets_all_collide(passage: Passage) -> bool:
    """Return whether a passage is the default one."""
    return passage.group == 1 and passage.collides_with == EVERY_GROUP


def _add_body(space: pymunk.Space, model: Body) -> pymunk.Body:
    """Add a body and its shapes to the space."""
    if model.motion is Motion.DYNAMIC:
        body = pymunk.Body(model.mass, model.moment)
    elif model.motion is Motion.STATIC:
        body = pymunk.Body(body_type=pymunk.Body.STATIC)
    else:
        body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
    # The centre of mass is the origin of all shapes: Chipmunk expects the centre there.
    body.position = tuple(model.center.tolist())
    space.add(body)
    if model.radius is not None:
        shapes: list[pymunk.Shape] = [pymunk.Circle(body, model.radius)]
    else:
        shapes = [pymunk.Poly(body, piece.tolist()) for piece in model.pieces]
    # A disc with its mass off its middle is a circle with an offset.
    if model.disc is not None:
        offset, radius = model.disc
        shapes = [pymunk.Circle(body, radius, (float(offset[0]), float(offset[1])))]
    for shape in shapes:
        shape.friction = model.surface.friction
        space.add(shape)
    return body


def _add_walls(space: pymunk.Space, walls: Sequence[Wall]) -> list[pymunk.Body]:
    """Add the walls to the space; return their bodies.

    Only walls of one passage are neighbours: a body that passes through one wall still
    hits the end of another.
    """
    by_passage: dict[Passage, list[Wall]] = {}
    for wall in walls:
        by_passage.setdefault(wall.passage, []).append(wall)
    neighbours = {key: _neighbours(group) for key, group in by_passage.items()}
    return [_add_wall(space, wall, neighbours[wall.passage]) for wall in walls]


def _add_wall(
    space: pymunk.Space, wall: Wall, neighbours: dict[tuple[float, ...], list[float]]
) -> pymunk.Body:
    """Add a wall as a body of its own, to identify the wall in contacts."""
    body = pymunk.Body(body_type=pymunk.Body.STATIC)
    space.add(body)
    solid_shapes: list[pymunk.Shape] = [
        pymunk.Poly(body, p.tolist()) for p in wall.pieces
    ]
    # A round wall is a true circle: a polygon would make balls jump at its corners.
    if wall.disc is not None:
        (x, y), radius = wall.disc
        solid_shapes = [pymunk.Circle(body, radius, (float(x), float(y)))]
    for shape in solid_shapes:
        shape.friction = wall.surface.friction
        space.add(shape)
    for line in wall.chains if not solid_shapes else ():
        for a, b in pairwise(line.tolist()):
            segment = pymunk.Segment(body, a, b, 0.0)
            segment.friction = wall.surface.friction
            before = neighbours.get((*a, *b))
            after = neighbours.get((*b, *a))
            if before is not None or after is not None:
                # Without a neighbour, a point on the segment's own line permits hits of
                # its end only from outside.
                segment.set_neighbors(tuple(before or a), tuple(after or b))
            space.add(segment)
    return body


def _neighbours(walls: Sequence[Wall]) -> dict[tuple[float, ...], list[float]]:
    """Return the far end of the neighbour of each end (near, far) of a segment.

    A neighbour continues the segment in a straight line. With known neighbours, the end
    of a segment no longer stops an object that slides over the seam.
    """
    ends = _segment_ends(walls)
    neighbours: dict[tuple[float, ...], list[float]] = {}
    if not len(ends):
        return neighbours
    nears = ends[:, 0]
    directions = ends[:, 1] - nears
    directions /= np.maximum(np.hypot(*directions.T), 1e-12)[:, None]
    # Ends sorted by x: only those within a narrow band can be near.
    order = np.argsort(nears[:, 0], kind="stable")
    sorted_x = nears[order, 0]
    for k, near in enumerate(nears):
        low, high = np.searchsorted(sorted_x, [near[0] - SEAM, near[0] + SEAM])
        others = order[low:high]
        # The next segment must begin at this end and go on in the same direction: the
        # two outward directions are then opposite.
        is_near = np.hypot(*(nears[others] - near).T) <= SEAM
        is_straight = directions[others] @ directions[k] <= -STRAIGHT
        for other in others[is_near & is_straight].tolist():
            if other // 2 != k // 2:
                key = tuple(ends[k].ravel().tolist())
                neighbours.setdefault(key, ends[other, 1].tolist())
    return neighbours


def _segment_ends(walls: Sequence[Wall]) -> Array:
    """Return both ends of each segment as near and far end, (2K, 2, 2) px."""
    ends = []
    for wall in walls:
        for line in wall.chains:
            for start, end in pairwise(line.tolist()):
                ends += [(start, end), (end, start)]
    return np.array(ends)


GUIDES = (JointKind.SLIDER, JointKind.ROPE, JointKind.PULLEY, JointKind.GEAR)
ENDLESS = 1e6
"""Length, px, of the engine's rail beyond its ends, which bounds.py limits."""


def _add_guide(
    space: pymunk.Space, joint: Joint, bodies: list[pymunk.Body], world: pymunk.Body
) -> list[pymunk.Constraint]:
    """Add the constraints of a slider or a gear.

    For a rope or a pulley, add only a constraint that keeps two bodies from colliding.
    """
    first = bodies[joint.first]
    if joint.second is None:
        second = world
    else:
        second = bodies[joint.second]
    parts: list[pymunk.Constraint] = []
    if joint.kind is JointKind.SLIDER:
        direction = joint.guide[0] / float(np.hypot(*joint.guide[0])) * ENDLESS
        ends = [(joint.second_at + sign * direction).tolist() for sign in (-1, 1)]
        parts = [
            pymunk.GrooveJoint(
                second, first, ends[0], ends[1], joint.first_at.tolist()
            ),
            pymunk.GearJoint(first, second, 0.0, 1.0),
        ]
    elif joint.kind is JointKind.GEAR:
        parts = [pymunk.GearJoint(first, second, 0.0, joint.ratio)]
    elif joint.second is not None:
        # This constraint has no force: joints.py computes the rope, and Chipmunk only
        # needs to know that its bodies do not collide.
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
    """Add pins and welds, to solve contacts together with them.

    They only constrain velocities: joints.py solves positions and motors exactly after
    each step, and springs are loads. The place of a weld is arbitrary; between the two
    centres its levers are shortest.
    """
    added: dict[str, list[pymunk.Constraint]] = {}
    for joint in joints:
        if joint.kind in SPRINGS:
            continue
        if joint.kind in GUIDES:
            added[joint.name] = _add_guide(space, joint, bodies, world)
            continue
        a = bodies[joint.first]
        if joint.second is None:
            b = world
        else:
            b = bodies[joint.second]
        first = joint.first_at
        second = joint.second_at
        if joint.kind is JointKind.WELD:
            first_centre = np.array(a.position)
            second_centre = np.array(b.position)
            if joint.second is None:
                middle = first_centre
            else:
                if a.mass + b.mass < np.inf:
                    middle = (a.mass * first_centre + b.mass * second_centre) / (
                        a.mass + b.mass
                    )
                else:
                    middle = second_centre
            first = middle - first_centre
            second = middle - second_centre
        # A weld is a pin together with a gear for the relative angle.
        parts: list[pymunk.Constraint] = [
            pymunk.PivotJoint(a, b, first.tolist(), second.tolist())
        ]
        if joint.kind is JointKind.WELD:
            parts.append(pymunk.GearJoint(a, b, 0.0, 1.0))
        added[joint.name] = parts
        for part in parts:
            # An error bias of 1 lets Chipmunk leave all position errors alone, since
            # joints.py closes gaps.
            part.error_bias = 1.0
            part.collide_bodies = joint.collide
            space.add(part)
    return added
