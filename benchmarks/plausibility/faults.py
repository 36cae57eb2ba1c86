"""A right world -> the same with one body made wrong, by running it in pieces; None where it would not show.

Whether it shows is decided by the engine's contacts, not from what the judge sees.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from physgen.compile.world import World
from physgen.evaluate.plausibility.tracks import Array
from physgen.scene.scene import View
from physgen.simulate.engine import simulate
from physgen.simulate.trajectory import Trajectory

from .balls import FREE
from .pieces import in_two

Rng = np.random.Generator
SHORT = 0.02
"""s that a blow lasts, at most."""


def _touches(trajectory: Trajectory, body: int) -> list[tuple[float, float, int]]:
    """Begin, end and partner of each touch of a body, by time."""
    contacts = trajectory.contacts
    found = []
    for (one, other), (begin, end) in zip(
        contacts.touch_pairs.tolist(), contacts.touch_times.tolist(), strict=True
    ):
        if body in (one, other):
            found.append((begin, end, other if one == body else one))
    return sorted(found)


def _free(trajectory: Trajectory, body: int, start: float, end: float) -> bool:
    """Whether it touches nothing between two moments, all of them in the clip."""
    if start < 0 or end > trajectory.times[-1]:
        return False
    return all(
        last < start or first > end for first, last, _ in _touches(trajectory, body)
    )


def _velocity(trajectory: Trajectory, body: int, time: float) -> Array:
    k = int(np.searchsorted(trajectory.times, time))
    return np.asarray(
        trajectory.velocities[min(k, len(trajectory.times) - 1), body, :2]
    )


def _moved(world: World, body: int, velocity: Array) -> World:
    bodies = list(world.bodies)
    bodies[body] = replace(bodies[body], velocity=np.asarray(velocity, np.float64))
    if world.view is View.TOP:
        bodies[body] = replace(bodies[body], roll=np.zeros(2))
    return replace(world, bodies=tuple(bodies))


def gravity(world: World, times: Array, run: Trajectory, rng: Rng) -> Array | None:
    """Weaker, stronger or turned from some moment on, while something flies before and something after."""
    if world.view is View.TOP or world.joints:
        return None
    moment = float(rng.uniform(0.3, 0.65)) * float(times[-1])
    flying = [
        k
        for k in range(len(world.bodies))
        if _free(run, k, moment - 1.2 * FREE, moment)
    ]
    if not flying:
        return None
    factor = float(rng.choice([rng.uniform(0.1, 0.6), rng.uniform(1.6, 2.5)]))

    def change(then: World) -> World:
        return replace(then, gravity=then.gravity * factor)

    poses = in_two(world, times, moment, change)
    # and something must still fly after it
    return (
        poses
        if any(_free(run, k, moment - FREE, moment + FREE) for k in flying)
        else None
    )


def energy(world: World, times: Array, run: Trajectory, rng: Rng) -> Array | None:
    """Something parts faster than it came, after a bounce that nothing else is near in time."""
    count = len(world.bodies)
    blows = [
        (body, begin, end, other)
        for body in rng.permutation(count).tolist()
        for begin, end, other in _touches(run, body)
        if end - begin < SHORT
        and _free(run, body, begin - FREE, begin - 1e-6)
        and _free(run, body, end + 1e-6, end + FREE)
    ]
    for body, begin, end, other in blows:
        if other < count and not (
            _free(run, other, begin - FREE, begin - 1e-6)
            and _free(run, other, end + 1e-6, end + FREE)
        ):
            continue
        still = np.zeros(2) if other >= count else _velocity(run, other, begin - 0.004)
        later = np.zeros(2) if other >= count else _velocity(run, other, end + 0.006)
        came, parts = (
            _velocity(run, body, begin - 0.004) - still,
            _velocity(run, body, end + 0.006) - later,
        )
        if np.hypot(*came) < 60 or np.hypot(*parts) < 20:
            continue
        faster = later + parts / np.hypot(*parts) * np.hypot(*came) * float(
            rng.uniform(1.35, 2.0)
        )
        poses = in_two(
            world,
            times,
            end + 0.002,
            partial(_moved, body=body, velocity=faster),
            (body,),
            0.15,
        )
        if poses is not None:
            return poses
    return None


def jump(world: World, times: Array, run: Trajectory, rng: Rng) -> Array | None:
    """Something that moves freely is elsewhere from one frame to the next."""
    moment = float(rng.uniform(0.25, 0.75)) * float(times[-1])
    free = [
        k
        for k in range(len(world.bodies))
        if _free(run, k, moment - FREE, moment + FREE)
    ]
    if not free or world.joints:
        return None
    body = int(rng.choice(free))
    far = max(30.0, float(rng.uniform(1.5, 4.0)) * world.bodies[body].reach)
    for _ in range(20):
        angle = rng.uniform(0, 2 * np.pi)
        shift = far * np.array([np.cos(angle), np.sin(angle)])

        def change(then: World, shift: Array = shift) -> World:
            bodies = list(then.bodies)
            bodies[body] = replace(bodies[body], center=bodies[body].center + shift)
            return replace(then, bodies=tuple(bodies))

        if _room(world, run, body, moment, shift):
            return in_two(world, times, moment, change)
    return None


def _room(
    world: World, run: Trajectory, body: int, moment: float, shift: Array
) -> bool:
    sample = int(np.searchsorted(run.times, moment))
    place = run.poses[min(sample, len(run.times) - 1), body, :2] + shift
    reach = world.bodies[body].reach
    for k, other in enumerate(world.bodies):
        if (
            k != body
            and np.hypot(*(run.poses[sample, k, :2] - place)) < reach + other.reach + 3
        ):
            return False
    for wall in world.walls:
        for chain in wall.chains:
            for a, b in pairwise(chain):
                if _crosses(place - shift, place, a, b, reach + 3):
                    return False
    return bool((place > reach).all() and (place < np.array(world.size) - reach).all())


def _crosses(start: Array, end: Array, a: Array, b: Array, reach: float) -> bool:
    """Whether a way comes within a reach of a segment."""
    for part in np.linspace(0, 1, 20):
        point = start + part * (end - start)
        along = b - a
        where = np.clip((point - a) @ along / (along @ along), 0, 1)
        if np.hypot(*(point - a - where * along)) < reach:
            return True
    return False


def momentum(world: World, times: Array, run: Trajectory, rng: Rng) -> Array | None:
    """Two meet and one takes no notice, or both are thrown the same way, or one across; they part all the same."""
    count = len(world.bodies)
    for body in rng.permutation(count).tolist():
        for begin, end, other in _touches(run, body):
            if other >= count or end - begin > SHORT:
                continue
            alone = all(
                _free(run, k, begin - FREE, begin - 1e-6)
                and _free(run, k, end + 1e-6, end + FREE)
                for k in (body, other)
            )
            change = _velocity(run, body, end + 0.006) - _velocity(
                run, body, begin - 0.004
            )
            if not alone or np.hypot(*change) < 60:
                continue
            old = _velocity(run, other, begin - 0.004) + 0.006 * world.gravity
            ratio = world.bodies[body].mass / world.bodies[other].mass
            ways = [
                old,
                old + 0.5 * ratio * change,
                old + ratio * change[::-1] * (1, -1),
            ]
            apart = np.subtract(
                *run.poses[int(np.searchsorted(run.times, end)), [body, other], :2]
            )
            for k in rng.permutation(3).tolist():
                if (
                    _velocity(run, body, end + 0.006) - ways[k]
                ) @ apart > 20 * np.hypot(*apart):
                    poses = in_two(
                        world,
                        times,
                        end + 0.002,
                        partial(_moved, body=other, velocity=ways[k]),
                        (body, other),
                        0.15,
                    )
                    if poses is not None:
                        return poses
    return None


def passing(world: World, times: Array, run: Trajectory, rng: Rng) -> Array | None:
    """Two that would meet go through each other: each is run without the other."""
    count = len(world.bodies)
    if world.joints:
        return None
    pairs = [
        tuple(pair) for pair in run.contacts.touch_pairs.tolist() if max(pair) < count
    ]
    for at in rng.permutation(len(pairs)).tolist():
        one, other = pairs[at]
        closing = _velocity(run, one, 0.0) - _velocity(run, other, 0.0)
        if np.hypot(*closing) < 60:
            continue
        poses = np.empty((len(times), count, 3))
        for left_out, taken in (
            (one, [k for k in range(count) if k != one]),
            (other, [other, one]),
        ):
            kept = [k for k in range(count) if k != left_out]
            alone = simulate(
                replace(world, bodies=tuple(world.bodies[k] for k in kept)), times
            )
            for k in taken:
                if k in kept:
                    poses[:, k] = alone.poses[:, kept.index(k)]
        away = np.hypot(*(poses[:, one, :2] - poses[:, other, :2]).T)
        fine = np.interp(
            np.linspace(0, len(times) - 1, 8 * len(times)), np.arange(len(times)), away
        )
        a, b = world.bodies[one], world.bodies[other]
        if (
            a.radius
            and b.radius
            and fine.min() < a.radius + b.radius - 0.8 * min(a.radius, b.radius)
        ):
            return poses
    return None


Fault = Callable[[World, Array, Trajectory, Rng], Array | None]
FAULTS: dict[str, Fault] = {
    "gravity changes": gravity,
    "energy is gained": energy,
    "a jump": jump,
    "momentum is lost": momentum,
    "one through another": passing,
}
