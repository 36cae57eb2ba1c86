"""What every rival needs: what it refuses, its units, the loads of a step, and a fixed step -> Trajectory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from math import isfinite
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, Joint, Passage, Push, Wall, World
from physgen.scene.scene import JointKind, Load, Motion, Solid
from physgen.simulate.ramps import has_ramp
from physgen.simulate.trajectory import Contacts, Effort, Energy, Trajectory

Array = NDArray[np.float64]


BEYOND = 1e100
"""px, px/s: what is further or faster has left all numbers."""


class Demand(Enum):
    """What a world may ask of an engine beyond bodies, walls, pushes and joints."""

    TABLE = "bodies that rub on a table or roll over it"
    FACES = "bodies that rub on a table with a face"
    ROLLING = "rolling resistance"
    FIELDS = "force fields"
    LINES = "rails, ropes, pulleys and pins with limits or friction"
    MACHINES = "gears, fingers and joints that break"
    SURFACES = "belts, static friction, one-way surfaces and collision groups"
    NUMBERS = "own damping or gravity, rocking, ramps, and forces with a profile"
    CURVES = "smooth curves, solid scenery and discs with a centre of mass elsewhere"
    TABLE_JOINTS = "a joint on a ball that rolls over a table"


class Unsupported(Exception):  # noqa: N818  # it says what, not that something broke
    """The world asks for what this engine cannot express."""

    def __init__(self, engine: str, reasons: Mapping[str, str]) -> None:
        """`reasons`: what is asked -> why the engine has no word for it."""
        super().__init__(
            f"{engine}: "
            + "; ".join(f"no {what} ({why})" for what, why in reasons.items())
        )
        self.engine = engine
        self.reasons = dict(reasons)


def demands(world: World) -> frozenset[Demand]:
    """What the world asks for."""
    dynamic = [body for body in world.bodies if body.motion is Motion.DYNAMIC]
    found = set()
    if lies_on_table(world):
        found.add(Demand.TABLE)
        if any(
            body.surface.friction * world.table.friction > 0 and not is_ball(body)
            for body in dynamic
        ):
            found.add(Demand.FACES)
        jointed = [
            world.bodies[k]
            for j in world.joints
            for k in (j.first, j.second)
            if k is not None
        ]
        if any(body.motion is Motion.DYNAMIC and is_ball(body) for body in jointed):
            found.add(Demand.TABLE_JOINTS)
    if any(body.rolling > 0 for body in dynamic):
        found.add(Demand.ROLLING)
    found |= {demand for joint in world.joints if (demand := joint_demand(joint))}
    parts = (*world.bodies, *world.walls)
    if any(has_special_surface(part) for part in parts):
        found.add(Demand.SURFACES)
    if any(map(has_own_numbers, dynamic)) or any(push.profile for push in world.pushes):
        found.add(Demand.NUMBERS)
    curved = any(wall.is_smooth or wall.pieces or wall.disc for wall in world.walls)
    if curved or any(body.disc for body in dynamic):
        found.add(Demand.CURVES)
    if world.fields:
        found.add(Demand.FIELDS)
    return frozenset(found)


def joint_demand(joint: Joint) -> Demand | None:
    """What a joint asks for; None of a pin, a spring, a weld or a motor."""
    plain = JointKind.PIVOT, JointKind.SPRING, JointKind.WELD, JointKind.MOTOR
    lines = JointKind.SLIDER, JointKind.ROPE, JointKind.PULLEY
    if isfinite(joint.breaks) or joint.kind not in (*plain, *lines):
        return Demand.MACHINES
    is_plain = joint.kind in plain and joint.limits is None and joint.friction == 0
    return None if is_plain else Demand.LINES


def has_special_surface(part: Body | Wall) -> bool:
    """Whether contacts of a body or a wall are more than friction and elasticity."""
    surface = part.surface
    return bool(
        surface.conveyor
        or surface.static_friction is not None
        or part.passage != Passage()
    )


def has_own_numbers(body: Body) -> bool:
    """Whether a body is damped, rocks, falls in its own way, or reaches its velocity by a ramp."""
    has_own_motion = body.damping or body.rocking or body.gravity_scale != 1
    return bool(has_own_motion or has_ramp(body))


def lies_on_table(world: World) -> bool:
    """Whether the table below the bodies changes their motion: it rubs, or some of them roll at t = 0."""
    dynamic = [body for body in world.bodies if body.motion is Motion.DYNAMIC]
    rubs = world.press > 0 and any(
        body.surface.friction * world.table.friction > 0 for body in dynamic
    )
    return rubs or any(np.any(body.roll) for body in dynamic)


def is_ball(body: Body) -> bool:
    """Whether the body can roll over a table: a sphere, not a disc that lies on its face."""
    return body.radius is not None and body.solid is Solid.SPHERE


def refuse(engine: str, world: World, cannot: Mapping[Demand, str]) -> None:
    """Raise Unsupported where the world asks for what stands in the engine's table `cannot`."""
    reasons = {
        what.value: why for what, why in cannot.items() if what in demands(world)
    }
    if reasons:
        raise Unsupported(engine, reasons)


@dataclass(frozen=True)
class Units:
    """An engine's own units, tuned by its authors to things of about 1."""

    length: float
    """px."""
    mass: float
    """g."""
    time: float = 1.0
    """s."""

    @property
    def speed(self) -> float:
        """px/s."""
        return self.length / self.time

    @property
    def moment(self) -> float:
        """g·px²."""
        return self.mass * self.length**2


def body_units(world: World, across: float = 1.0) -> Units:
    """Units in which the median of the moving bodies is `across` wide and weighs 1."""
    moving = [body for body in world.bodies if body.motion is Motion.DYNAMIC] or list(
        world.bodies
    )
    if not moving:
        return Units(1.0, 1.0)
    size = float(np.median([body.size for body in moving]))
    return Units(size / across, float(np.median([body.mass for body in moving])))


def loads(world: World, begin: float, end: float) -> Iterator[tuple[Push, float]]:
    """The pushes of one step (s), each with the part of the step in which it acts; an impulse acts once, in full."""
    for push in world.pushes:
        if world.bodies[push.body].motion is not Motion.DYNAMIC:
            continue
        if push.load is Load.IMPULSE:
            if begin <= push.start + 1e-12 < end:
                yield push, 1.0
        elif (
            part := (min(push.end, end) - max(push.start, begin)) / (end - begin)
        ) > 0:
            yield push, part


def script(path: Array, time: float) -> Array:
    """(3,): px, px, rad of a scripted body's path `(K, 4)`; straight between knots."""
    return np.array([np.interp(time, path[:, 0], path[:, k]) for k in (1, 2, 3)])


class Engine(Protocol):
    """A world in motion."""

    @property
    def iterations(self) -> int:
        """Sweeps of its contact solver a step, at most."""
        ...

    def state(self) -> Array:
        """(N, 8), fresh: x px, y px, angle rad, px/s, px/s, spin rad/s, and the roll about +x and +y, rad/s."""
        ...

    def step(self, begin: float, end: float) -> None:
        """Go from `begin` to `end`, s."""
        ...


def record(engine: Engine, world: World, times: Array, step: float) -> Trajectory:
    """Step by `step` s and read poses and velocities at `times` (T,) s, on a straight line between two steps.

    No rival tells contacts, work or losses as we do: contacts name no surface, so that looking one up fails instead of
    finding nothing, and work and dissipated are NaN. Raises ArithmeticError where the engine leaves all numbers.
    """
    times = np.asarray(times, np.float64)
    states = np.zeros((len(times), len(world.bodies), 8))
    before = after = engine.state()
    taken = 0
    for index, time in enumerate(times.tolist()):
        while taken * step < time - 1e-9 * step:
            before = after
            engine.step(taken * step, (taken + 1) * step)
            after = engine.state()
            taken += 1
        part = min(max(time / step - (taken - 1), 0.0), 1.0)
        states[index] = before + part * (after - before)
    lost = ~(np.abs(states) < BEYOND).all(axis=(1, 2))
    if lost.any():
        raise ArithmeticError(
            f"{type(engine).__module__}: left all numbers by t = {times[lost][0]:.3f} s"
        )
    rolls = states[:, :, 6:] if lies_on_table(world) else states[:, :0, 6:]
    return Trajectory(
        times=times,
        names=tuple(body.name for body in world.bodies),
        poses=np.ascontiguousarray(states[:, :, :3]),
        velocities=np.ascontiguousarray(states[:, :, 3:6]),
        rolls=np.ascontiguousarray(rolls),
        turns=np.zeros((len(times), 0, 4)),
        contacts=_no_contacts(),
        energy=_energy(world, states),
        effort=Effort(
            steps=taken,
            divided=0,
            most_parts=1,
            iterations=engine.iterations,
            impacts=0,
            still=0.0,
        ),
    )


def _energy(world: World, states: Array) -> Energy:
    """Of states `(T, N, 8)`; a ball's moment is the same about every axis."""
    dynamic = [body.motion is Motion.DYNAMIC for body in world.bodies]
    mass = np.where(dynamic, [body.mass for body in world.bodies], 0.0)
    moment = np.where(dynamic, [body.moment for body in world.bodies], 0.0)
    linear, angular = (
        (states[:, :, 3:5] ** 2).sum(axis=2),
        (states[:, :, 5:] ** 2).sum(axis=2),
    )
    kinetic = (mass * linear + moment * angular).sum(axis=1) / 2
    potential = -(mass * (states[:, :, :2] @ world.gravity)).sum(axis=1)
    for spring in world.joints:
        if spring.kind is JointKind.SPRING:
            ends = [
                _point(states, spring.first, spring.first_at),
                _point(states, spring.second, spring.second_at),
            ]
            stretch = np.hypot(*(ends[1] - ends[0]).T) - spring.length
            potential += spring.stiffness * stretch**2 / 2
    untold = np.full(len(states), np.nan)
    return Energy(kinetic=kinetic, potential=potential, dissipated=untold, work=untold)


def _point(states: Array, body: int | None, at: Array) -> Array:
    """(T, 2) px: where a body's point `at` is; a point of the photo stays."""
    if body is None:
        return np.broadcast_to(at, (len(states), 2))
    c, s = np.cos(states[:, body, 2]), np.sin(states[:, body, 2])
    turned = np.stack([c * at[0] - s * at[1], s * at[0] + c * at[1]], axis=1)
    return np.asarray(states[:, body, :2] + turned)


def _no_contacts() -> Contacts:
    return Contacts(
        surfaces=(),
        touch_pairs=np.zeros((0, 2), np.int32),
        touch_times=np.zeros((0, 2)),
        impulse_rows=np.zeros((0, 3), np.int32),
        impulses=np.zeros((0, 2)),
    )
