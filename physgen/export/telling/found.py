"""A clip -> its events, by time: the motion looked at once more, with samples where things touch.

How many frames the clip has, and how fast they play, changes nothing of that: moments are chosen by time alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from math import ceil

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Push, World
from physgen.export.telling.alone import alone
from physgen.export.telling.event import Event, Happening
from physgen.export.telling.picture import borders
from physgen.geometry import rotation
from physgen.render.shot import Shot
from physgen.render.touches import Blow, between, blows
from physgen.scene.model import Load, Motion, Point
from physgen.simulate.engine import simulate
from physgen.simulate.settled import fresh
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]
Sampled = Callable[[Array], Trajectory]

RATE, LEAST = 240.0, 720
"""Times that the motion is looked at: a second, and in all; no finer than the engine's steps."""
MOST = 2_000_000
"""Samples times objects of such a closer look."""
HAIR = 1e-6
"""s before a touch begins at which nothing has happened yet."""
DONE = 1.5
"""Steps of the engine after which a blow is over."""

ORDER = {kind: number for number, kind in enumerate(Happening)}


def events(
    world: World, trajectory: Trajectory, shot: Shot, sampled: Sampled | None = None
) -> tuple[Event, ...]:
    """All of them, to the end of the motion; `trajectory` has the samples of the frames, played forward.

    `sampled` has the same motion at other times, where that is at hand; it is simulated again without. Of a clip of one
    frame, what is so at its moment.
    """
    if not world.bodies or not len(trajectory.times):
        return ()
    seen = closer(world, trajectory, sampled or partial(simulate, world))
    struck = blows(world, seen, 1 / RATE) if len(seen.times) > 1 else []
    found = [
        *_pushes(world, seen),
        *_contacts(world, seen),
        *(_collision(world, seen, blow) for blow in struck),
        *_first_touches(world, seen),
        *alone(world, seen),
        *borders(world, seen, shot),
    ]
    return tuple(sorted(found, key=lambda event: (event.time, ORDER[event.kind], event.who)))


def closer(world: World, trajectory: Trajectory, sampled: Sampled) -> Trajectory:
    """All of the same motion, looked at evenly, and where touches begin, just before and just after."""
    if len(trajectory.times) < 2:
        return trajectory
    most, end = max(MOST // len(world.bodies), 2), world.duration
    rate = min(max(RATE, LEAST / end), world.steps_per_second)
    even = np.linspace(0.0, end, min(ceil(end * rate - 1e-6), most) + 1)
    begins = sampled(np.array([0.0, end])).contacts.touch_times[:most, 0]
    step = DONE / world.steps_per_second
    times = [even, begins, begins - HAIR, begins - step, begins + step]
    every = np.unique(np.concatenate([*times, np.array([push.start for push in world.pushes])]))
    return sampled(every[(every >= 0) & (every <= end)])


def _sample(seen: Trajectory, time: float) -> int:
    """The first at a time or after it."""
    return min(int(np.searchsorted(seen.times, time - 1e-9)), len(seen.times) - 1)


def _place(world: World, seen: Trajectory, time: float, pair: tuple[int, int]) -> Point:
    """px of the photo where two surfaces are nearest."""
    points, _ = between(world, seen.poses[_sample(seen, time)], *pair)
    x, y = points.mean(axis=0).tolist()
    return x, y


def _pairs(seen: Trajectory) -> list[tuple[int, int]]:
    return [(int(one), int(other)) for one, other in seen.contacts.touch_pairs]


def _contacts(world: World, seen: Trajectory) -> Iterator[Event]:
    last = float(seen.times[-1])
    for pair, (begin, end) in zip(_pairs(seen), seen.contacts.touch_times.tolist(), strict=True):
        until = end if end <= last else None
        yield Event(Happening.CONTACT, begin, pair, _place(world, seen, begin, pair), until)


def _first_touches(world: World, seen: Trajectory) -> Iterator[Event]:
    """Of each body that moves or is moved, as tables of sweeps have it."""
    met: set[int] = set()
    contacts = seen.contacts
    order = np.argsort(contacts.touch_times[:, 0], kind="stable")
    new = fresh(seen)
    for k in order[new[order]].tolist():
        time = float(contacts.touch_times[k, 0])
        one, other = contacts.touch_pairs[k].tolist()
        for who, whom in ((one, other), (other, one)):
            if who < len(world.bodies) and who not in met:
                met.add(who)
                yield Event(Happening.FIRST_TOUCH, time, (who, whom), _place(world, seen, time, (one, other)))


def _collision(world: World, seen: Trajectory, blow: Blow) -> Event:
    step = DONE / world.steps_per_second
    # where others struck earlier in the same step of the engine, the hair's breadth before is after it
    earlier = (_sample(seen, blow.time - HAIR), _sample(seen, blow.time - step), _sample(seen, blow.time) - 1)
    before = max((k for k in earlier if k >= 0), key=lambda k: sum(_nearing(world, seen, k, blow)), default=0)
    after = _sample(seen, blow.time + step)
    if seen.times[after] - blow.time > 4 * step:
        after = min(_sample(seen, blow.time) + 1, len(seen.times) - 1)
    x, y = blow.at.tolist()
    wx, wy = blow.way.tolist()
    return Event(
        Happening.COLLISION,
        blow.time,
        blow.pair,
        (x, y),
        impulse=blow.impulse,
        vector=(wx, wy),
        before=_speeds(world, seen, before, blow.pair),
        after=_speeds(world, seen, after, blow.pair),
        nearing=_nearing(world, seen, before, blow),
        parting=-sum(_nearing(world, seen, after, blow)),
    )


def _speeds(world: World, seen: Trajectory, sample: int, pair: tuple[int, int]) -> tuple[float, ...]:
    """px/s of the centres of mass; walls stand."""
    return tuple(
        float(np.hypot(*seen.velocities[sample, k, :2])) if k < len(world.bodies) else 0.0 for k in pair
    )


def _nearing(world: World, seen: Trajectory, sample: int, blow: Blow) -> tuple[float, float]:
    """px/s at which the point of each that meets the other's comes nearer, along the blow."""
    speeds = [0.0, 0.0]
    for n, (k, sign) in enumerate(zip(blow.pair, (-1.0, 1.0), strict=True)):
        if k < len(world.bodies):
            x, y, spin = seen.velocities[sample, k]
            arm = blow.at - seen.poses[sample, k, :2]
            speeds[n] = sign * float(np.array([x - spin * arm[1], y + spin * arm[0]]) @ blow.way)
    return speeds[0], speeds[1]


def _pushes(world: World, seen: Trajectory) -> Iterator[Event]:
    last = float(seen.times[-1])
    for push in world.pushes:
        if world.bodies[push.body].motion is not Motion.DYNAMIC or push.start > last:
            continue
        until = push.end if push.end <= last else None
        if push.load is Load.IMPULSE:
            size = float(np.hypot(*push.vector))
            yield _push(Happening.PUSH, push, push.start, seen, None, size)
            continue
        yield _push(Happening.PUSH_START, push, push.start, seen, until, None)
        if until is not None:
            yield _push(Happening.PUSH_END, push, until, seen, None, None)


def _push(
    kind: Happening, push: Push, time: float, seen: Trajectory, until: float | None, impulse: float | None
) -> Event:
    pose = seen.poses[_sample(seen, time), push.body]
    x, y = (pose[:2] + rotation(float(pose[2])) @ push.at).tolist()
    vx, vy = push.vector.tolist()
    vector = (vx, vy) if vx or vy else None
    return Event(kind, time, (push.body,), (x, y), until, impulse, vector, push.torque or None)
