"""World -> Trajectory on Box2D 2.3 (the wheel `Box2D`), in single precision, at 240 steps a second.

8 velocity and 3 position iterations, warm starting and continuous collision against walls, as its manual advises;
nothing sleeps. A body of the median size is 4 units across and weighs 1. Polygons and walls carry a skin of 0.01 units
each, of which 0.005 may overlap: a box rests 0.4 % of its size above a floor, a circle 0.1 %.

Friction and restitution of a pair are ours exactly, set on the contact when it begins (Box2D itself would take the
geometric mean and the maximum). Restitution is dropped below 1 unit of speed, a constant in the wheel: the unit of
time is chosen so that this speed is what gravity adds in two steps. Springs are forces that we compute; its own go
by a frequency that changes with the bodies' pose.
"""

from __future__ import annotations

from itertools import pairwise
from math import isfinite
from typing import Any

import Box2D
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, Joint, Surface, Wall, World
from physgen.scene.scene import JointKind, Load, Motion
from physgen.simulate.trajectory import Trajectory

from .stepping import (
    Demand,
    Units,
    Unsupported,
    body_units,
    loads,
    record,
    refuse,
    script,
)

Array = NDArray[np.float64]

STEP = 1 / 240
"""s."""
ACROSS = 4.0
"""Units: the median size of what moves. Box2D is made for things of 0.1 to 10; its tolerances are fixed lengths."""
ITERATIONS = 8, 3
"""Of velocity and of position, from Box2D's manual, "Simulating the World"."""
QUIETEST = 0.1
"""px/s: without gravity, a slower hit does not bounce."""
CORNERS = 16
"""b2_maxPolygonVertices in this wheel."""
TORQUE_WITHOUT_END = 1e12
"""Units, for a motor that has as much as it takes."""
LARGEST = 1e38
"""Of single precision, about."""
SLACK = 1e6
"""Units of rope, beside a spring."""

CANNOT = {
    Demand.TABLE: "Box2D knows forces in the plane only",
    Demand.ROLLING: "Box2D has friction of sliding only",
    Demand.FIELDS: "they would be our own formula again",
    Demand.MACHINES: "they are not written for it",
    Demand.SURFACES: "they are not written for it",
    Demand.NUMBERS: "they are not written for it",
    Demand.CURVES: "they are not written for it",
}


def run(world: World, times: Array, step: float = STEP) -> Trajectory:
    """Motion at `times` (T,) s; raises Unsupported for what is in `CANNOT` and slivers thinner than its slop."""
    refuse("Box2D", world, CANNOT)
    return record(_World(world, _units(world, step)), world, times, step)


def _units(world: World, step: float) -> Units:
    """As told on top: the unit of time makes the speed below which nothing bounces as low as gravity lets it be."""
    body = body_units(world, ACROSS)
    quietest = max(2 * float(np.hypot(*world.gravity)) * step, QUIETEST)
    return Units(body.length, body.mass, body.length / quietest)


class _PairSurface(Box2D.b2ContactListener):  # type: ignore[misc]  # the wheel has no types
    """Gives a new contact the product of its two factors."""

    def BeginContact(self, contact: Any) -> None:  # noqa: N802
        a, b = contact.fixtureA.userData, contact.fixtureB.userData
        contact.friction, contact.restitution = (
            a.friction * b.friction,
            a.elasticity * b.elasticity,
        )


class _World:
    iterations = ITERATIONS[0]

    def __init__(self, world: World, units: Units) -> None:
        self._model, self._units = world, units
        self._listener = _PairSurface()  # the engine keeps no reference of its own
        self._world = Box2D.b2World(
            gravity=_vector(world.gravity * units.time / units.speed),
            doSleep=False,
            contactListener=self._listener,
        )
        self._walls, self._ground = (
            self._world.CreateStaticBody(),
            self._world.CreateStaticBody(),
        )
        self._bodies = [self._body(model) for model in world.bodies]
        for wall in world.walls:
            self._wall(wall)
        for joint in world.joints:
            self._joint(joint)

    def state(self) -> Array:
        """As `stepping.Engine`."""
        u = self._units
        rows = [
            (*b.position, b.angle, *b.linearVelocity, b.angularVelocity, 0.0, 0.0)
            for b in self._bodies
        ]
        scale = [u.length, u.length, 1.0, u.speed, u.speed, 1 / u.time, 1.0, 1.0]
        return np.array(rows, np.float64).reshape(-1, 8) * scale

    def step(self, begin: float, end: float) -> None:
        """As `stepping.Engine`."""
        u = self._units
        for model, body in zip(self._model.bodies, self._bodies, strict=True):
            if model.motion is Motion.SCRIPTED:
                rate = (script(model.path, end) - script(model.path, begin)) / (
                    end - begin
                )
                body.linearVelocity = _vector(rate / u.speed)
                body.angularVelocity = float(rate[2]) * u.time
        for push, part in loads(self._model, begin, end):
            body = self._bodies[push.body]
            where = body.GetWorldPoint(_vector(push.point / u.length))
            impulse = push.vector / (u.mass * u.speed)
            if push.load is Load.IMPULSE:
                body.ApplyLinearImpulse(_vector(impulse), where, True)
            elif push.load is Load.FORCE:
                body.ApplyForce(_vector(impulse * u.time * part), where, True)
            else:
                body.ApplyTorque(push.torque * part * u.time**2 / u.moment, True)
        for joint in self._model.joints:
            if joint.kind is JointKind.SPRING:
                self._pull(joint)
        self._world.Step((end - begin) / u.time, *ITERATIONS)
        self._world.ClearForces()

    def _body(self, model: Body) -> Any:
        u = self._units
        kind = {
            Motion.DYNAMIC: Box2D.b2_dynamicBody,
            Motion.STATIC: Box2D.b2_staticBody,
            Motion.SCRIPTED: Box2D.b2_kinematicBody,
        }[model.motion]
        body = self._world.CreateBody(
            type=kind, position=_vector(model.center / u.length)
        )
        if model.radius is not None:
            _coat(
                body, Box2D.b2CircleShape(radius=model.radius / u.length), model.surface
            )
        for piece in model.pieces:
            for part in _few_corners(piece):
                corners = [_vector(point / u.length) for point in part]
                try:
                    _coat(body, Box2D.b2PolygonShape(vertices=corners), model.surface)
                except (AssertionError, ValueError) as error:
                    why = f"{model.name} has a piece that it does not take: {error}"
                    raise Unsupported("Box2D", {"thin slivers": why}) from error
        if model.motion is Motion.DYNAMIC:
            body.massData = Box2D.b2MassData(
                mass=model.mass / u.mass, center=(0, 0), I=model.moment / u.moment
            )
            body.linearVelocity = _vector(model.velocity / u.speed)
            body.angularVelocity = float(model.spin * u.time)
        return body

    def _wall(self, wall: Wall) -> None:
        """Single edges: a chain would smooth its own seams over, but it takes no points nearer than its slop."""
        for chain in wall.chains:
            for a, b in pairwise(chain / self._units.length):
                _coat(
                    self._walls,
                    Box2D.b2EdgeShape(vertices=[_vector(a), _vector(b)]),
                    wall.surface,
                )

    def _joint(self, joint: Joint) -> None:
        u = self._units
        first, first_at = self._bodies[joint.first], _vector(joint.first_at / u.length)
        second = self._ground if joint.second is None else self._bodies[joint.second]
        second_at = _vector(joint.second_at / u.length)
        ends = {
            "bodyA": second,
            "bodyB": first,
            "localAnchorA": second_at,
            "localAnchorB": first_at,
        }
        ends |= {"collideConnected": joint.collide}
        if (
            joint.kind is JointKind.SPRING
        ):  # slack: it only says whether the two collide
            self._world.CreateJoint(Box2D.b2RopeJointDef(maxLength=SLACK, **ends))
            return
        if joint.kind is JointKind.WELD:
            self._world.CreateJoint(Box2D.b2WeldJointDef(referenceAngle=0.0, **ends))
            return
        if joint.kind in (JointKind.SLIDER, JointKind.ROPE, JointKind.PULLEY):
            self._line(joint, first, second, ends)
            return
        limit = (
            joint.limit * u.time**2 / u.moment
            if isfinite(joint.limit)
            else TORQUE_WITHOUT_END
        )
        motor = {
            "enableMotor": True,
            "motorSpeed": joint.speed * u.time,
            "maxMotorTorque": limit,
        }
        turns = motor if joint.kind is JointKind.MOTOR else {}
        if joint.friction > 0:
            grip = joint.friction * u.time**2 / u.moment
            turns = {"enableMotor": True, "motorSpeed": 0.0, "maxMotorTorque": grip}
        if joint.limits is not None:
            low, high = joint.limits
            turns |= {"enableLimit": True, "lowerAngle": low, "upperAngle": high}
        self._world.CreateJoint(Box2D.b2RevoluteJointDef(**ends, **turns))

    def _line(
        self, joint: Joint, first: Any, second: Any, ends: dict[str, Any]
    ) -> None:
        """Add a rope, a pulley or a rail with its ends and its drive."""
        u = self._units
        if joint.kind is JointKind.ROPE:
            length = joint.length / u.length
            self._world.CreateJoint(Box2D.b2RopeJointDef(maxLength=length, **ends))
            return
        if joint.kind is JointKind.PULLEY:
            anchors = (joint.second_at, joint.first_at)
            bodies = (second, first)
            places = [
                np.array(body.GetWorldPoint(_vector(at / u.length)))
                for body, at in zip(bodies, anchors, strict=True)
            ]
            points = [point / u.length for point in joint.guide[::-1]]
            spans = [
                float(np.hypot(*(place - point)))
                for place, point in zip(places, points, strict=True)
            ]
            self._world.CreateJoint(
                Box2D.b2PulleyJointDef(
                    bodyA=second,
                    bodyB=first,
                    groundAnchorA=_vector(points[0]),
                    groundAnchorB=_vector(points[1]),
                    localAnchorA=ends["localAnchorA"],
                    localAnchorB=ends["localAnchorB"],
                    lengthA=spans[0],
                    lengthB=spans[1],
                    ratio=1.0,
                )
            )
            return
        length = float(np.hypot(*joint.guide[0]))
        rail = {
            "localAxisA": _vector(joint.guide[0] / length),
            "enableLimit": True,
            "lowerTranslation": 0.0,
            "upperTranslation": length / u.length,
        }
        if joint.drive is not None:
            force = joint.force / (u.mass * u.speed / u.time)
            rail |= {
                "enableMotor": True,
                "motorSpeed": joint.drive / u.speed,
                "maxMotorForce": force if isfinite(force) else TORQUE_WITHOUT_END,
            }
        self._world.CreateJoint(
            Box2D.b2PrismaticJointDef(referenceAngle=0.0, **ends, **rail)
        )

    def _pull(self, joint: Joint) -> None:
        """Stiffness and damping along the line between the ends, equal and opposite."""
        u = self._units
        first = self._bodies[joint.first]
        second = self._ground if joint.second is None else self._bodies[joint.second]
        ends = [
            body.GetWorldPoint(_vector(at / u.length))
            for body, at in ((first, joint.first_at), (second, joint.second_at))
        ]
        apart = np.subtract(ends[1], ends[0]) * u.length
        speeds = [
            body.GetLinearVelocityFromWorldPoint(end)
            for body, end in zip((first, second), ends, strict=True)
        ]
        length = float(np.hypot(*apart))
        along = apart / max(length, 1e-9)
        opening = float(np.subtract(speeds[1], speeds[0]) @ along) * u.speed
        force = (
            joint.stiffness * (length - joint.length) + joint.damping * opening
        ) * along
        scaled = force * u.time / (u.mass * u.speed)
        first.ApplyForce(_vector(scaled), ends[0], True)
        second.ApplyForce(_vector(-scaled), ends[1], True)


def _coat(body: Any, shape: Any, surface: Surface) -> None:
    body.CreateFixture(Box2D.b2FixtureDef(shape=shape, density=1.0, userData=surface))


def _few_corners(piece: Array) -> list[Array]:
    """A convex piece (K, 2) as slices of at most `CORNERS` corners."""
    if len(piece) <= CORNERS:
        return [piece]
    return [
        piece[:CORNERS],
        *_few_corners(np.concatenate([piece[:1], piece[CORNERS - 1 :]])),
    ]


def _vector(vector: Array) -> tuple[float, float]:
    """As the engine takes it; raises ArithmeticError for what single precision does not hold."""
    x, y = float(vector[0]), float(vector[1])
    if not max(abs(x), abs(y)) < LARGEST:
        raise ArithmeticError(
            f"Box2D: ({x:g}, {y:g}) units are beyond single precision"
        )
    return x, y
