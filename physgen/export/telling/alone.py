"""World and motion -> what each object does by itself: it starts to move, falls, tips, comes to rest, or does not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import hypot, pi, radians

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.export.telling.event import Event, Happening
from physgen.scene.model import FieldKind, Load, Motion, Point, Solid, View
from physgen.simulate.settled import LASTING, STILL, STILL_TURN, still
from physgen.simulate.trajectory import Trajectory

SHIFT = 1.0
"""px by which its centre must come away from where it was at t = 0, or its rim turn: less is settling, no motion."""
TIPPED = pi / 4
"""rad."""
CREAK, BRIEF = 0.05, 0.005
"""px by which what rests may slip, or its rim turn, within so many s, and rest all the same."""
LOOSE = 1e-3
"""s within which a touch that ends does not hold any more."""


def alone(world: World, seen: Trajectory) -> Iterator[Event]:
    """All of it as fine as the samples of `seen`; tables of sweeps tell of rest as fine as frames."""
    quiet = still(seen)
    for k, body in enumerate(world.bodies):
        poses = seen.poses[:, k]
        away = np.hypot(*(poses[:, :2] - poses[0, :2]).T)
        turned = np.abs(poses[:, 2] - poses[0, 2])
        far = np.maximum(away, turned * body.reach)
        gone = np.flatnonzero(far > SHIFT)
        if not len(gone):
            yield Event(Happening.STAY, 0.0, (k,), _center(seen, 0, k), far=float(far.max()))
            continue
        yield replace(_start(world, seen, k, int(gone[0]), quiet[:, k]), far=float(far.max()))
        if tips(world, body) and turned.max() > TIPPED:
            yield _tipped(seen, k, turned)
        rest = _rest(seen, k, quiet[:, k], body.reach)
        at = len(seen.times) - 1 if rest is None else int(np.searchsorted(seen.times, rest - 1e-9))
        kind = Happening.GOES_ON if rest is None else Happening.REST
        yield Event(kind, float(seen.times[at]), (k,), _center(seen, at, k), vector=_velocity(seen, at, k))


def tips(world: World, body: Body) -> bool:
    """Whether it can tip: seen from the side, and not round."""
    round_ = body.radius is not None or body.solid is Solid.SPHERE
    return world.view is View.SIDE and not round_ and body.motion is Motion.DYNAMIC


def _start(world: World, seen: Trajectory, k: int, gone: int, quiet: NDArray[np.bool_]) -> Event:
    """`gone` is the first sample in which it is away from where it stood."""
    if _moves(world.bodies[k], seen, k):
        return Event(Happening.MOVING, 0.0, (k,), _center(seen, 0, k), vector=_velocity(seen, 0, k))
    at = max(np.flatnonzero(quiet[: gone + 1]).tolist(), default=0)  # an impulse at t = 0 shows at once
    at += at > 0  # what stood still for a while moves in the first sample that shows it
    time = float(seen.times[at])
    kind = Happening.FALL if _falls(world, seen, k, time) else Happening.MOVE
    return Event(kind, time, (k,), _center(seen, at, k), vector=_velocity(seen, gone, k))


def _moves(body: Body, seen: Trajectory, k: int) -> bool:
    """Whether the scene has it move as it begins; an impulse then is another matter."""
    if body.motion is Motion.SCRIPTED:
        return bool(np.abs(seen.velocities[0, k]).max() > 0)
    return bool(np.hypot(*body.velocity) >= STILL or abs(body.spin) >= radians(STILL_TURN) or body.roll.any())


def _falls(world: World, seen: Trajectory, k: int, time: float) -> bool:
    """Whether nothing but gravity is there that could move it."""
    if world.view is not View.SIDE or not world.gravity.any() or world.bodies[k].motion is not Motion.DYNAMIC:
        return False
    held = any(k in (joint.first, joint.second) for joint in world.joints)
    blown = any(k in field.bodies for field in world.fields if field.kind in FieldKind)
    contacts = seen.contacts
    begin, end = contacts.touch_times.T
    mine = (contacts.touch_pairs == k).any(axis=1)
    touched = (mine & (begin <= time + LOOSE) & (end > time + LOOSE)).any()
    pushed = any(
        push.body == k
        and push.start <= time + LOOSE
        and (push.end > time or (push.load is Load.IMPULSE and push.start >= time - LOOSE))
        for push in world.pushes
    )
    return not (held or blown or touched or pushed)


def _rest(seen: Trajectory, k: int, quiet: NDArray[np.bool_], reach: float) -> float | None:
    """s: from when on it rests but for creaks, which frames hardly ever show; None: it moves to the end."""
    last = len(quiet) - 1
    moving = np.flatnonzero(~quiet)
    since = 0
    while len(moving):
        run = moving[int(np.flatnonzero(np.diff(moving, prepend=-2) > 1)[-1]) :]
        first, since = max(int(run[0]) - 1, 0), int(run[-1]) + 1
        x, y, angle = (seen.poses[min(since, last), k] - seen.poses[first, k]).tolist()
        brief = seen.times[min(since, last)] - seen.times[first] < BRIEF
        if not brief or max(hypot(x, y), abs(angle) * reach) > CREAK:
            break
        moving, since = moving[: -len(run)], 0
    over = since > last or seen.times[-1] - seen.times[since] < LASTING - 1e-9
    return None if over else float(seen.times[since])


def _tipped(seen: Trajectory, k: int, turned: NDArray[np.float64]) -> Event:
    at = int(np.argmax(turned > TIPPED))
    low, high = turned[at - 1], turned[at]
    part = float((TIPPED - low) / (high - low))
    time = float(seen.times[at - 1] + part * (seen.times[at] - seen.times[at - 1]))
    spin = float(seen.poses[at, k, 2] - seen.poses[0, k, 2])
    return Event(Happening.TIP, time, (k,), _center(seen, at, k), side="right" if spin > 0 else "left")


def _center(seen: Trajectory, sample: int, k: int) -> Point:
    x, y = seen.poses[sample, k, :2].tolist()
    return x, y


def _velocity(seen: Trajectory, sample: int, k: int) -> Point:
    x, y = seen.velocities[sample, k, :2].tolist()
    return x, y
