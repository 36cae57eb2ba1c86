"""A world and its motion up to a moment -> the world from that moment on, to be changed and run further."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from physgen.compile.world import World
from physgen.evaluate.plausibility.tracks import Array
from physgen.geometry.polygon import rotation
from physgen.simulate.engine import simulate
from physgen.simulate.trajectory import Trajectory

Change = Callable[[World], World]


def continued(world: World, trajectory: Trajectory, sample: int) -> World:
    """Everything as it is at a sample, at t = 0 of a new world; angles begin at 0 again."""
    bodies = []
    turns = [rotation(angle).T for angle in trajectory.poses[sample, :, 2]]
    for k, body in enumerate(world.bodies):
        x, y, _ = trajectory.poses[sample, k]
        vx, vy, spin = trajectory.velocities[sample, k]
        turn = turns[k]
        bodies.append(
            replace(
                body,
                center=np.array([x, y]),
                pieces=tuple(piece @ turn for piece in body.pieces),
                rings=tuple(ring @ turn for ring in body.rings),
                velocity=np.array([vx, vy]),
                spin=float(spin),
                roll=trajectory.rolls[sample, k].copy()
                if trajectory.rolls.shape[1]
                else body.roll,
            )
        )
    joints = tuple(
        replace(
            joint,
            first_at=joint.first_at @ turns[joint.first],
            second_at=joint.second_at
            if joint.second is None
            else joint.second_at @ turns[joint.second],
        )
        for joint in world.joints
    )
    return replace(
        world,
        bodies=tuple(bodies),
        joints=joints,
        duration=world.duration - float(trajectory.times[sample]),
    )


def in_two(
    world: World,
    times: Array,
    moment: float,
    change: Change,
    calm: tuple[int, ...] = (),
    seconds: float = 0.0,
) -> Array | None:
    """(T, N, 3) poses at `times`: as it is to the moment, then as changed.

    None where one of `calm` touches something within some seconds after it, so that no one could tell.
    """
    before, after = times[times <= moment], times[times > moment]
    first = simulate(
        world, np.append(before, moment) if before[-1] < moment else before
    )
    then = change(continued(world, first, len(first.times) - 1))
    rest = simulate(then, np.concatenate([[0.0], after - moment]))
    for pair, begin in zip(
        rest.contacts.touch_pairs.tolist(),
        rest.contacts.touch_times[:, 0].tolist(),
        strict=True,
    ):
        if 0.004 < begin < seconds and set(pair) & set(calm):
            return None
    poses = rest.poses[1:].copy()
    poses[..., 2] += first.poses[-1, :, 2]
    return np.concatenate([first.poses[: len(before)], poses])
