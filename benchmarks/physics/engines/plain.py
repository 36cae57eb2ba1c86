"""World -> Trajectory on pymunk as it comes: the figures of `plain` in physics.md.

1/60 s steps, 10 iterations, a slop of 0.1 px and 3 steps of contact memory, all pymunk's own defaults; nothing is
swept, substepped or corrected. Pair coefficients are ours exactly: Chipmunk multiplies the two factors.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pymunk
from numpy.typing import NDArray

from physgen.compile.world import Body, Joint, Surface, Wall, World
from physgen.scene.scene import JointKind, Load, Motion
from physgen.simulate.trajectory import Trajectory

from .stepping import Demand, loads, record, refuse, script

Array = NDArray[np.float64]

STEP = 1 / 60
"""s: what pymunk's examples use."""

CANNOT = {
    Demand.TABLE: "Chipmunk knows forces in the plane only",
    Demand.ROLLING: "Chipmunk has friction of sliding only",
    Demand.FIELDS: "they would be our own formula again",
    Demand.MACHINES: "they are not written for it",
    Demand.LINES: "they are not written for it",
    Demand.SURFACES: "they are not written for it",
    Demand.NUMBERS: "they are not written for it",
    Demand.CURVES: "they are not written for it",
}


def run(world: World, times: Array, step: float = STEP) -> Trajectory:
    """Motion at `times` (T,) s; raises Unsupported for what is in `CANNOT`."""
    refuse("plain pymunk", world, CANNOT)
    return record(_Space(world), world, times, step)


class _Space:
    def __init__(self, world: World) -> None:
        self._world, self._space = world, pymunk.Space()
        self.iterations = self._space.iterations
        self._space.gravity = _pair(world.gravity)
        self._bodies = [_body(self._space, model) for model in world.bodies]
        for wall in world.walls:
            _wall(self._space, wall)
        for joint in world.joints:
            _joint(self._space, self._bodies, joint)

    def state(self) -> Array:
        """As `stepping.Engine`."""
        rows = [
            (*b.position, b.angle, *b.velocity, b.angular_velocity, 0.0, 0.0)
            for b in self._bodies
        ]
        return np.array(rows, np.float64).reshape(-1, 8)

    def step(self, begin: float, end: float) -> None:
        """As `stepping.Engine`."""
        for model, body in zip(self._world.bodies, self._bodies, strict=True):
            if model.motion is Motion.SCRIPTED:
                rate = (script(model.path, end) - script(model.path, begin)) / (
                    end - begin
                )
                body.velocity, body.angular_velocity = _pair(rate), float(rate[2])
        for push, part in loads(self._world, begin, end):
            body = self._bodies[push.body]
            where = body.local_to_world(_pair(push.point))
            if push.load is Load.IMPULSE:
                body.apply_impulse_at_world_point(_pair(push.vector), where)
            elif push.load is Load.FORCE:
                body.apply_force_at_world_point(_pair(push.vector * part), where)
            else:
                body.torque += push.torque * part
        self._space.step(end - begin)


def _body(space: pymunk.Space, model: Body) -> pymunk.Body:
    if model.motion is Motion.DYNAMIC:
        body = pymunk.Body(model.mass, model.moment)
        body.velocity, body.angular_velocity = _pair(model.velocity), model.spin
    else:
        static = model.motion is Motion.STATIC
        body = pymunk.Body(
            body_type=pymunk.Body.STATIC if static else pymunk.Body.KINEMATIC
        )
    body.position = _pair(model.center)
    space.add(body)
    if model.radius is not None:
        _coat(space, pymunk.Circle(body, model.radius), model.surface)
    for piece in model.pieces:
        _coat(space, pymunk.Poly(body, piece.tolist()), model.surface)
    return body


def _wall(space: pymunk.Space, wall: Wall) -> None:
    body = pymunk.Body(
        body_type=pymunk.Body.STATIC
    )  # not the one that joints hold on to
    space.add(body)
    for chain in wall.chains:
        for a, b in pairwise(chain.tolist()):
            _coat(space, pymunk.Segment(body, a, b, 0.0), wall.surface)


def _coat(space: pymunk.Space, shape: pymunk.Shape, surface: Surface) -> None:
    shape.friction, shape.elasticity = surface.friction, surface.elasticity
    space.add(shape)


def _joint(space: pymunk.Space, bodies: list[pymunk.Body], joint: Joint) -> None:
    first = bodies[joint.first]
    second = space.static_body if joint.second is None else bodies[joint.second]
    ends = _pair(joint.first_at), _pair(joint.second_at)
    parts: list[pymunk.Constraint]
    if joint.kind is JointKind.SPRING:
        parts = [
            pymunk.DampedSpring(
                first, second, *ends, joint.length, joint.stiffness, joint.damping
            )
        ]
    else:
        parts = [pymunk.PivotJoint(first, second, *ends)]
    if joint.kind is JointKind.WELD:
        parts.append(pymunk.GearJoint(first, second, 0.0, 1.0))
    if joint.kind is JointKind.MOTOR:
        motor = pymunk.SimpleMotor(first, second, joint.speed)
        motor.max_force = joint.limit
        parts.append(motor)
    for part in parts:
        part.collide_bodies = joint.collide
        space.add(part)


def _pair(vector: Array) -> tuple[float, float]:
    return float(vector[0]), float(vector[1])
