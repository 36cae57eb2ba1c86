"""World -> Trajectory, on Chipmunk through pymunk; the only module that imports it."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import ceil

import numpy as np
import pymunk
import pymunk.batch as batch
from numpy.typing import NDArray
from pymunk.batch import ArbiterFields, BodyFields

from physgen.compile.world import Body, Push, Wall, World
from physgen.problems import InputError
from physgen.scene.model import Load, Motion
from physgen.simulate.contacts import ContactLog
from physgen.simulate.trajectory import Energy, Trajectory

Array = NDArray[np.float64]
Index = NDArray[np.int32]

ITERATIONS = 30
"""Solver sweeps a step. Chipmunk's default of 10 leaves stacks and racks soft."""
SLOP = 0.02
"""px of overlap that the engine lets stand; keeps resting contacts alive without a visible sink."""

_STATE = BodyFields.POSITION | BodyFields.ANGLE | BodyFields.VELOCITY | BodyFields.ANGULAR_VELOCITY
_CONTACT = (
    ArbiterFields.BODY_A_ID
    | ArbiterFields.BODY_B_ID
    | ArbiterFields.TOTAL_IMPULSE
    | ArbiterFields.CONTACT_COUNT
    | ArbiterFields.POINT_A_1
    | ArbiterFields.POINT_B_1
    | ArbiterFields.POINT_A_2
    | ArbiterFields.POINT_B_2
)


Progress = Callable[[str, int, int], None]
"""Told the stage, samples done and samples in all."""


def silent(stage: str, done: int, total: int) -> None:
    """Progress that nobody watches."""


def simulate(world: World, times: Array | None = None, progress: Progress = silent) -> Trajectory:
    """Run the world and sample it at `times` (s, rising, the world's own frame times unless given).

    Raises InputError where a body leaves all numbers.

    Steps never depend on the samples: both lie on their own grids and samples are interpolated between two steps.
    """
    times = world.times if times is None else np.asarray(times, np.float64)
    dt = 1.0 / world.steps_per_second
    run = _Run(world, dt)
    T, N = len(times), len(world.bodies)
    states = np.empty((T, N, 6))
    energy = np.empty((T, 3))
    before, index, step = run.state(), 0, 0
    lost_before = 0.0
    while index < T and times[index] <= 0.0:
        states[index], energy[index] = before, (*run.energy(before), 0.0)
        index += 1
    for step in range(1, ceil(float(times[-1]) / dt - 1e-9) + 1 if T else 1):
        run.step(step)
        after = run.state()
        while index < T and times[index] <= step * dt * (1 + 1e-12):
            part = times[index] / dt - (step - 1)
            if part > 1 - 1e-9:
                states[index], lost = after, run.dissipated
            else:
                states[index], lost = run.between(before, after, max(float(part), 0.0)), lost_before
            energy[index] = (*run.energy(states[index]), lost)
            _refuse_infinities(world, states[index], float(times[index]))
            run.log.sample(index)
            index += 1
        before, lost_before = after, run.dissipated
        if step % 256 == 0:
            progress("simulate", index, T)
    return Trajectory(
        times=times,
        names=tuple(body.name for body in world.bodies),
        poses=np.ascontiguousarray(states[:, :, [0, 1, 2]]),
        velocities=np.ascontiguousarray(states[:, :, [3, 4, 5]]),
        contacts=run.log.result(),
        energy=Energy(*np.ascontiguousarray(energy.T)),
        steps=step,
    )


def _refuse_infinities(world: World, state: Array, time: float) -> None:
    wrong = np.flatnonzero(~np.isfinite(state).all(axis=1))
    if len(wrong):
        expected = f"leaves all numbers by t = {time:.3f} s"
        fix = "bring its mass, velocity and forces nearer to the others'"
        raise InputError.of(f"objects.{world.bodies[wrong[0]].name}", "", expected, fix)


class _Run:
    """One space in motion."""

    def __init__(self, world: World, dt: float) -> None:
        self._world, self._dt = world, dt
        space = pymunk.Space()
        space.gravity = tuple(world.gravity.tolist())
        space.iterations = ITERATIONS
        space.collision_slop = SLOP
        space.collision_persistence = 1  # else the batch reader still lists contacts that have parted
        self._space = space
        self._bodies = [_add_body(space, body) for body in world.bodies]
        walls = [_add_wall(space, wall) for wall in world.walls]
        everything = [*self._bodies, *walls]
        self._id_order = np.array([body.id for body in everything], np.uint64)
        self._by_id = np.argsort(self._id_order)
        # the batch reader skips static bodies and goes by the order in which bodies were added
        self._moving = np.array([b.motion is not Motion.STATIC for b in world.bodies], bool)
        self._at_rest = np.array([[*b.center, 0.0, 0.0, 0.0, 0.0] for b in world.bodies]).reshape(-1, 6)
        dynamic = np.array([b.motion is Motion.DYNAMIC for b in world.bodies], bool)
        self._mass = np.where(dynamic, [b.mass for b in world.bodies], 0.0)
        self._moment = np.where(dynamic, [b.moment for b in world.bodies], 0.0)
        self._wall_states = np.zeros((len(walls), 6))
        self._state_buffer, self._contact_buffer = batch.Buffer(), batch.Buffer()
        self.log = ContactLog(tuple(name for name, _ in world.surfaces))
        self.dissipated = 0.0
        self._touching: set[int] = set()
        self._state = self._read_state()

    def state(self) -> Array:
        """(N, 6): x, y, angle, vx, vy, spin."""
        return self._state

    def between(self, before: Array, after: Array, part: float) -> Array:
        """The state a part of the last step after its beginning.

        The engine moves bodies by the velocity they have, then changes it: contacts act at the step's end.
        """
        state: Array = before + part * (after - before)
        touched = np.zeros(len(before), bool)
        touched[[k for k in self._touching if k < len(before)]] = True
        state[touched, 3:] = before[touched, 3:]
        falling = touched & (self._mass > 0)
        state[falling, 3:5] += self._world.gravity * (part * self._dt)
        return state

    def energy(self, state: Array) -> tuple[float, float]:
        """Kinetic and potential energy of the dynamic bodies."""
        v2 = state[:, 3] ** 2 + state[:, 4] ** 2
        kinetic = float((self._mass * v2 + self._moment * state[:, 5] ** 2).sum() / 2)
        return kinetic, -float((self._mass * (state[:, :2] @ self._world.gravity)).sum())

    def step(self, number: int) -> None:
        """Take step `number` (from 1), which ends at number x dt."""
        begin, end = (number - 1) * self._dt, number * self._dt
        for body, model in zip(self._bodies, self._world.bodies, strict=True):
            if model.motion is Motion.SCRIPTED:
                _follow(body, model.path, begin, end)
        for push in self._world.pushes:
            _apply(self._bodies[push.body], push, begin, end)
        before = self._state
        self._space.step(self._dt)
        self._state = self._read_state()
        self._read_contacts(end, before)

    def _read_state(self) -> Array:
        self._state_buffer.clear()
        batch.get_space_bodies(self._space, _STATE, self._state_buffer)
        rows = np.frombuffer(self._state_buffer.float_buf(), np.float64).reshape(-1, 6)
        state = self._at_rest.copy()
        state[self._moving] = rows[: int(self._moving.sum())][:, [0, 1, 2, 3, 4, 5]]
        return state

    def _read_contacts(self, time: float, before: Array) -> None:
        self._contact_buffer.clear()
        batch.get_space_arbiters(self._space, _CONTACT, self._contact_buffer)
        ints = np.frombuffer(self._contact_buffer.int_buf(), np.uint64).reshape(-1, 3)
        floats = np.frombuffer(self._contact_buffer.float_buf(), np.float64).reshape(-1, 10)
        partners = self._by_id[np.searchsorted(self._id_order[self._by_id], ints[:, :2])].astype(np.int32)
        # the engine lists contacts in an order that depends on memory addresses: sort before any sum
        order = np.lexsort((floats[:, 3], floats[:, 2], partners[:, 1], partners[:, 0]))
        first, second = partners[order, 0], partners[order, 1]
        count, impulse = ints[order, 2], floats[order, :2]
        points = floats[order, 2:].reshape(-1, 4, 2)
        self.log.step(time, first, second, impulse)
        self._touching = set(first.tolist()) | set(second.tolist())
        if len(order):
            one = (points[:, 0] + points[:, 1]) / 2
            both = (one + (points[:, 2] + points[:, 3]) / 2) / 2
            where = np.where((count > 1)[:, None], both, one)
            self.dissipated += self._work_against(first, second, impulse, where, before)

    def _work_against(
        self, first: Index, second: Index, impulse: Array, where: Array, before: Array
    ) -> float:
        """Impulse times the mean of the partners' relative velocity before and after the step, where they touch.

        The step is x += v dt, then v += g dt + J/m: the change of kinetic plus potential energy is exactly J times
        that mean velocity, but for a term m g dt dv/2 that cancels over the run.
        """
        mean = (before + self._state) / 2
        mean[:, :2] = self._state[:, :2]
        states = np.concatenate([mean, self._wall_states])

        def velocity(index: Index) -> Array:
            state = states[index]
            arm = where - state[:, :2]
            spin = state[:, 5:]
            return np.asarray(state[:, 3:5] + np.concatenate([-spin * arm[:, 1:], spin * arm[:, :1]], axis=1))

        return -float((impulse * (velocity(first) - velocity(second))).sum())


def _add_body(space: pymunk.Space, model: Body) -> pymunk.Body:
    if model.motion is Motion.DYNAMIC:
        body = pymunk.Body(model.mass, model.moment)
        body.velocity = tuple(model.velocity.tolist())
        body.angular_velocity = model.spin
    elif model.motion is Motion.STATIC:
        body = pymunk.Body(body_type=pymunk.Body.STATIC)
    else:
        body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        _follow(body, model.path, 0.0, 1e-6)
    body.position = tuple(model.center.tolist())
    space.add(body)
    if model.radius is not None:
        shapes: list[pymunk.Shape] = [pymunk.Circle(body, model.radius)]
    else:
        shapes = [pymunk.Poly(body, piece.tolist()) for piece in model.pieces]
    for shape in shapes:
        shape.friction, shape.elasticity = model.surface.friction, model.surface.elasticity
        space.add(shape)
    return body


def _add_wall(space: pymunk.Space, wall: Wall) -> pymunk.Body:
    """A body of its own, so that contacts know which wall they touch."""
    body = pymunk.Body(body_type=pymunk.Body.STATIC)
    space.add(body)
    for a, b in (pair for chain in wall.chains for pair in pairwise(chain.tolist())):
        segment = pymunk.Segment(body, a, b, 0.0)
        segment.friction, segment.elasticity = wall.surface.friction, wall.surface.elasticity
        space.add(segment)
    return body


def _follow(body: pymunk.Body, path: Array, begin: float, end: float) -> None:
    """Give a scripted body the velocity that brings it to the path's next pose at the step's end."""
    now, then = (np.array([np.interp(t, path[:, 0], path[:, k]) for k in (1, 2, 3)]) for t in (begin, end))
    velocity = (then - now) / (end - begin)
    body.velocity = (float(velocity[0]), float(velocity[1]))
    body.angular_velocity = float(velocity[2])


def _apply(body: pymunk.Body, push: Push, begin: float, end: float) -> None:
    """Impulses once in the step that begins nearest after their start; forces for the part of the step they last."""
    if push.load is Load.IMPULSE:
        if begin <= push.start + 1e-12 < end:
            body.apply_impulse_at_world_point(
                tuple(push.vector.tolist()), body.local_to_world(push.at.tolist())
            )
        return
    part = (min(push.end, end) - max(push.start, begin)) / (end - begin)
    if part <= 0:
        return
    if push.load is Load.TORQUE:
        body.torque += push.torque * part
    else:
        force = push.vector * part
        body.apply_force_at_world_point(tuple(force.tolist()), body.local_to_world(push.at.tolist()))
