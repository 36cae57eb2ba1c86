"""Wheels of vehicles: bodies on pins in the engine, parts of vehicles in the result.

The engine knows only bodies and joints. A world with wheels becomes a world in which
each wheel is a disc after the scene's own bodies. Touches and impulses of a wheel are
added to those of its vehicle.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, Joint, Wheel, World
from physgen.geometry.polygon import Array
from physgen.scene.scene import JointKind, Motion, Solid
from physgen.simulate.trajectory import Contacts, Effort, Index, Trajectory

WHEEL_MASS = 0.02
"""Share of a vehicle's mass in each wheel: its inertia delays a stop by 1 %."""
CIRCLE_CORNERS = 48


def worlds_wheels(world: World) -> list[tuple[int, Wheel]]:
    """Return every wheel, with the index of its body, in order."""
    return [(k, wheel) for k, body in enumerate(world.bodies) for wheel in body.wheels]


def world_on_wheels(world: World) -> World:
    """Return the world with a body for each wheel after its own bodies, on a pin."""
    wheels = worlds_wheels(world)
    if not wheels:
        return world
    # The chassis loses the mass of its wheels, which become bodies of their own.
    bodies = [_chassis(body) if body.wheels else body for body in world.bodies]
    joints = list(world.joints)
    for k, wheel in wheels:
        vehicle = world.bodies[k]
        number = len(bodies)
        bodies.append(_wheel_body(vehicle, wheel))
        joints.append(
            Joint(
                name=f"{vehicle.name} wheel {number}",
                kind=JointKind.PIVOT,
                first=number,
                second=k,
                first_at=np.zeros(2),
                second_at=wheel.axle,
                length=0.0,
                stiffness=0.0,
                damping=0.0,
                speed=0.0,
                limit=inf,
                collide=False,
            )
        )
    return replace(world, bodies=tuple(bodies), joints=tuple(joints))


def _chassis(vehicle: Body) -> Body:
    """Return the vehicle without the mass and the moment of its wheels."""
    mass, moment = vehicle.mass, vehicle.moment
    for wheel in vehicle.wheels:
        own_mass = WHEEL_MASS * vehicle.mass
        mass -= own_mass
        distance = float(wheel.axle @ wheel.axle)
        moment -= own_mass * (distance + wheel.radius**2 / 2)
    return replace(
        vehicle, mass=mass, moment=max(moment, 0.3 * vehicle.moment), wheels=()
    )


def _wheel_body(vehicle: Body, wheel: Wheel) -> Body:
    """Return a disc with the rolling speed of its vehicle at t = 0."""
    mass = WHEEL_MASS * vehicle.mass
    x, y = wheel.axle
    # The axle moves with the vehicle, and the wheel rolls without slip on the ground.
    speed = vehicle.velocity + vehicle.spin * np.array([-y, x])
    turns = 2 * np.pi * np.arange(CIRCLE_CORNERS) / CIRCLE_CORNERS
    ring = wheel.radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    return replace(
        vehicle,
        motion=Motion.DYNAMIC,
        center=vehicle.center + wheel.axle,
        mass=mass,
        moment=mass * wheel.radius**2 / 2,
        radius=wheel.radius,
        pieces=(),
        rings=(ring,),
        solid=Solid.DISC,
        patch=wheel.radius,
        velocity=speed,
        spin=float(speed[0]) / wheel.radius,
        wheels=(),
        rest=None,
        rocking=0.0,
    )


def fold_wheels(trajectory: Trajectory, world: World) -> Trajectory:
    """Return the motion of the world's own bodies, and the turns of their wheels."""
    wheels = worlds_wheels(world)
    if not wheels:
        return trajectory
    # The engine's bodies are those of the world, then all wheels.
    count = len(world.bodies)
    owners = np.array([k for k, _ in wheels], np.int32)
    # A wheel's turn counts relative to its vehicle.
    angles = trajectory.poses[:, :, 2]
    return replace(
        trajectory,
        names=trajectory.names[:count],
        poses=trajectory.poses[:, :count],
        velocities=trajectory.velocities[:, :count],
        rolls=trajectory.rolls[:, :count],
        turns=trajectory.turns[:, :count],
        contacts=_fold_contacts(trajectory.contacts, count, owners),
        effort=_fold_effort(trajectory.effort, count, owners),
        wheel_turns=angles[:, count:] - angles[:, owners],
    )


def _vehicle_index(partners: NDArray[np.integer], count: int, owners: Index) -> Index:
    """Return the indices of partners (R,) in the world without bodies for wheels."""
    wheels = len(owners)
    is_wheel = (partners >= count) & (partners < count + wheels)
    owner = owners[np.clip(partners - count, 0, wheels - 1)]
    others = np.where(partners >= count + wheels, partners - wheels, partners)
    return np.where(is_wheel, owner, others).astype(np.int32)


def _fold_contacts(contacts: Contacts, count: int, owners: Index) -> Contacts:
    """Return the contacts with those of wheels assigned to their vehicles."""
    # Wheels are bodies of the engine only: outside, their contacts are those of their
    # vehicle.
    surfaces = contacts.surfaces
    pairs = _vehicle_index(contacts.touch_pairs, count, owners)
    pairs, times = _merged_touches(pairs, contacts.touch_times)
    rows = contacts.impulse_rows.copy()
    rows[:, 1:] = _vehicle_index(rows[:, 1:], count, owners)
    # Two wheels on one floor in one sample become one row with the sum of impulses.
    rows, row_numbers = np.unique(rows, axis=0, return_inverse=True)
    impulses = np.zeros((len(rows), 2))
    np.add.at(impulses, row_numbers.ravel(), contacts.impulses)
    return replace(
        contacts,
        surfaces=surfaces[:count] + surfaces[count + len(owners) :],
        touch_pairs=pairs,
        touch_times=times,
        impulse_rows=rows.astype(np.int32),
        impulses=impulses,
    )


def _merged_touches(pairs: Index, times: Array) -> tuple[Index, Array]:
    """Merge the touches of one pair that overlap in time."""
    # Sorted by pair and begin, touches that overlap follow each other.
    order = np.lexsort((times[:, 0], pairs[:, 1], pairs[:, 0]))
    merged_pairs: list[tuple[int, int]] = []
    merged_times: list[list[float]] = []
    for first, second, begin, end in np.column_stack([pairs, times])[order].tolist():
        pair = (int(first), int(second))
        is_same = bool(merged_pairs) and merged_pairs[-1] == pair
        if is_same and begin <= merged_times[-1][1]:
            merged_times[-1][1] = max(merged_times[-1][1], end)
            continue
        merged_pairs.append(pair)
        merged_times.append([begin, end])
    # Contacts of a trajectory are in the order of their begins.
    by_time = sorted(range(len(merged_pairs)), key=lambda k: merged_times[k][0])
    all_pairs = np.array([merged_pairs[k] for k in by_time], np.int32).reshape(-1, 2)
    all_times = np.array([merged_times[k] for k in by_time], np.float64)
    return all_pairs, all_times.reshape(-1, 2)


def _fold_effort(effort: Effort, count: int, owners: Index) -> Effort:
    """Return the effort with the pair of bodies without wheels."""
    pair = np.array([effort.overworked, effort.overworked_by])
    is_pair = pair >= 0
    vehicle_pair = np.where(is_pair, _vehicle_index(pair, count, owners), pair).tolist()
    return replace(effort, overworked=vehicle_pair[0], overworked_by=vehicle_pair[1])
