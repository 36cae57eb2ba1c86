"""Detection of events in a motion: collisions, contacts, pushes, falls, tips, rests and picture borders."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from math import ceil, hypot, pi, radians

import numpy as np
from cv2 import convexHull
from numpy.typing import NDArray

from physgen.compile.world import Body, Push, World
from physgen.geometry.polygon import rotation
from physgen.render.camera import Shot
from physgen.render.contacts import Impact, contact_points_between, find_impacts
from physgen.scene.scene import FieldKind, Load, Motion, Point, Solid, View
from physgen.simulate.engine import simulate
from physgen.simulate.trajectory import (
    REST_DURATION,
    REST_SPEED,
    REST_TURN,
    Trajectory,
    new_touches,
    resting_mask,
)

Array = NDArray[np.float64]


class EventKind(Enum):
    """Kinds of events, in the order in which those of one moment are listed."""

    MOVING = "moving"
    """It moves when the clip starts."""
    OUTSIDE = "outside"
    """It is completely outside the picture when the clip starts."""
    STAY = "stay"
    """It does not move in the clip."""
    PUSH = "push"
    """An impulse is given to it."""
    PUSH_START = "push_start"
    """A force or torque begins to act."""
    PUSH_END = "push_end"
    CONTACT = "contact"
    """Two surfaces touch, until `until`."""
    COLLISION = "collision"
    """An impact between two surfaces."""
    FIRST_TOUCH = "first_touch"
    """Its first contact with a surface that it did not touch from the start."""
    MOVE = "move"
    """It starts to move, and moves by more than SHIFT."""
    FALL = "fall"
    """The same without contact, joint or push: gravity alone moves it."""
    TIP = "tip"
    """It has turned by 45 degrees; not for balls and discs, and only in side view."""
    LEAVE = "leave"
    """The last of it leaves the picture."""
    ENTER = "enter"
    """The first of it comes into the picture."""
    REST = "rest"
    """It has moved, and rests from then on."""
    GOES_ON = "goes_on"
    """It still moves when the clip ends."""


@dataclass(frozen=True)
class Event:
    """One event. Surfaces are numbered as in `World.surfaces`: bodies, then walls."""

    kind: EventKind
    time: float
    """s of the motion."""
    surfaces: tuple[int, ...]
    """One, or the two of a contact or collision; of a first touch, the object first."""
    at: Point | None = None
    """px of the photo: where they touch, or the push acts; the centre of mass where an object does something alone."""
    until: float | None = None
    """s: the end of a contact or of a lasting push; None: it outlasts the clip, or has no length."""
    impulse: float | None = None
    """g·px/s: of a collision or an impulse; what presses for longer is not in it."""
    vector: Point | None = None
    """Of a collision the unit vector in which the second pushes the first; of a push g·px/s or g·px/s²; px/s of what
    moves."""
    torque: float | None = None
    """g·px²/s²."""
    before: tuple[float, ...] = ()
    """px/s: speed of each surface just before a collision."""
    after: tuple[float, ...] = ()
    """px/s: just after."""
    nearing: tuple[float, float] | None = None
    """px/s at which the point of each that meets the other's comes nearer just before a collision, along `vector`."""
    parting: float | None = None
    """px/s at which they part after it."""
    far: float | None = None
    """px by which what moves or starts to comes away from where it was at t = 0, or its rim turns, at most."""
    side: str = ""
    """Of the picture, where something leaves or comes in: left, right, top or bottom."""

    @property
    def closing(self) -> float:
        """px/s at which the points that meet come together before a collision."""
        return 0.0 if self.nearing is None else sum(self.nearing)


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
    quiet = resting_mask(seen)
    for k, body in enumerate(world.bodies):
        poses = seen.poses[:, k]
        away = np.hypot(*(poses[:, :2] - poses[0, :2]).T)
        turned = np.abs(poses[:, 2] - poses[0, 2])
        far = np.maximum(away, turned * body.reach)
        gone = np.flatnonzero(far > SHIFT)
        if not len(gone):
            yield Event(EventKind.STAY, 0.0, (k,), _center(seen, 0, k), far=float(far.max()))
            continue
        yield replace(_start(world, seen, k, int(gone[0]), quiet[:, k]), far=float(far.max()))
        if tips(world, body) and turned.max() > TIPPED:
            yield _tipped(seen, k, turned)
        rest = _rest(seen, k, quiet[:, k], body.reach)
        at = len(seen.times) - 1 if rest is None else int(np.searchsorted(seen.times, rest - 1e-9))
        kind = EventKind.GOES_ON if rest is None else EventKind.REST
        yield Event(kind, float(seen.times[at]), (k,), _center(seen, at, k), vector=_velocity(seen, at, k))


def tips(world: World, body: Body) -> bool:
    """Whether it can tip: seen from the side, and not round."""
    round_ = body.radius is not None or body.solid is Solid.SPHERE
    return world.view is View.SIDE and not round_ and body.motion is Motion.DYNAMIC


def _start(world: World, seen: Trajectory, k: int, gone: int, quiet: NDArray[np.bool_]) -> Event:
    """`gone` is the first sample in which it is away from where it stood."""
    if _moves(world.bodies[k], seen, k):
        return Event(EventKind.MOVING, 0.0, (k,), _center(seen, 0, k), vector=_velocity(seen, 0, k))
    at = max(np.flatnonzero(quiet[: gone + 1]).tolist(), default=0)  # an impulse at t = 0 shows at once
    at += at > 0  # what stood still for a while moves in the first sample that shows it
    time = float(seen.times[at])
    kind = EventKind.FALL if _falls(world, seen, k, time) else EventKind.MOVE
    return Event(kind, time, (k,), _center(seen, at, k), vector=_velocity(seen, gone, k))


def _moves(body: Body, seen: Trajectory, k: int) -> bool:
    """Whether the scene has it move as it begins; an impulse then is another matter."""
    if body.motion is Motion.SCRIPTED:
        return bool(np.abs(seen.velocities[0, k]).max() > 0)
    return bool(
        np.hypot(*body.velocity) >= REST_SPEED or abs(body.spin) >= radians(REST_TURN) or body.roll.any()
    )


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
    over = since > last or seen.times[-1] - seen.times[since] < REST_DURATION - 1e-9
    return None if over else float(seen.times[since])


def _tipped(seen: Trajectory, k: int, turned: NDArray[np.float64]) -> Event:
    at = int(np.argmax(turned > TIPPED))
    low, high = turned[at - 1], turned[at]
    part = float((TIPPED - low) / (high - low))
    time = float(seen.times[at - 1] + part * (seen.times[at] - seen.times[at - 1]))
    spin = float(seen.poses[at, k, 2] - seen.poses[0, k, 2])
    return Event(EventKind.TIP, time, (k,), _center(seen, at, k), side="right" if spin > 0 else "left")


def _center(seen: Trajectory, sample: int, k: int) -> Point:
    x, y = seen.poses[sample, k, :2].tolist()
    return x, y


def _velocity(seen: Trajectory, sample: int, k: int) -> Point:
    x, y = seen.velocities[sample, k, :2].tolist()
    return x, y


SIDES = ("left", "right", "top", "bottom")


def borders(world: World, seen: Trajectory, shot: Shot) -> Iterator[Event]:
    """Only what is wholly out has left: as soon as any of its outline is within the border, it is in."""
    lenses = np.stack([shot.affine(float(time)) for time in seen.times])
    for k, body in enumerate(world.bodies):
        middle = np.einsum("tij,tj->ti", lenses[:, :, :2], seen.poses[:, k, :2]) + lenses[:, :, 2]
        if (_beyond(middle, middle, shot.video) <= 0).all():  # it lies within the outline
            continue
        beyond = outside(body, seen.poses[:, k], lenses, shot.video)
        far = beyond.max(axis=1)
        if far[0] > 0:
            x, y = seen.poses[0, k, :2].tolist()
            yield Event(EventKind.OUTSIDE, 0.0, (k,), (x, y), side=SIDES[int(beyond[0].argmax())])
        for at in np.flatnonzero((far[1:] > 0) != (far[:-1] > 0)) + 1:
            low, high = far[at - 1], far[at]
            part = float(low / (low - high))
            time = float(seen.times[at - 1] + part * (seen.times[at] - seen.times[at - 1]))
            out = at if high > 0 else at - 1
            kind = EventKind.LEAVE if high > 0 else EventKind.ENTER
            x, y = seen.poses[at, k, :2].tolist()
            yield Event(kind, time, (k,), (x, y), side=SIDES[int(beyond[out].argmax())])


def outside(body: Body, poses: Array, lenses: Array, size: tuple[int, int]) -> Array:
    """(T, 4) video px by which all of a body is beyond the left, right, top and bottom border; below 0: some is not.

    poses (T, 3), lenses (T, 2, 3). The border of a picture is half a pixel beyond the centres of its first pixels.
    """
    scale, shift = lenses[:, 0, 0, None], lenses[:, :, 2]
    if body.radius is not None:
        low, high = poses[:, :2] - body.radius, poses[:, :2] + body.radius
    else:
        rim = np.concatenate(body.rings)
        rim = rim[convexHull(rim.astype(np.float32), returnPoints=False).ravel()]
        c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
        ways = (c * rim[:, 0] - s * rim[:, 1], s * rim[:, 0] + c * rim[:, 1])
        low, high = (
            poses[:, :2] + np.stack([end(way, axis=1) for way in ways], axis=1) for end in (np.min, np.max)
        )
    return _beyond(low * scale + shift, high * scale + shift, size)


def _beyond(low: Array, high: Array, size: tuple[int, int]) -> Array:
    """(T, 4): how far all from `low` to `high` (T, 2) is beyond each border."""
    width, height = size
    return np.stack(
        [-0.5 - high[:, 0], low[:, 0] - (width - 0.5), -0.5 - high[:, 1], low[:, 1] - (height - 0.5)], axis=1
    )


Sampled = Callable[[Array], Trajectory]

RATE, LEAST = 240.0, 720
"""Times that the motion is looked at: a second, and in all; no finer than the engine's steps."""
MOST = 2_000_000
"""Samples times objects of such a closer look."""
BEFORE = 1e-6
"""s before a touch begins at which nothing has happened yet."""
DONE = 1.5
"""Steps of the engine after which an impact is over."""

ORDER = {kind: number for number, kind in enumerate(EventKind)}


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
    struck = find_impacts(world, seen, 1 / RATE) if len(seen.times) > 1 else []
    found = [
        *_pushes(world, seen),
        *_contacts(world, seen),
        *(_collision(world, seen, impact) for impact in struck),
        *_first_touches(world, seen),
        *alone(world, seen),
        *borders(world, seen, shot),
    ]
    return tuple(sorted(found, key=lambda event: (event.time, ORDER[event.kind], event.surfaces)))


def closer(world: World, trajectory: Trajectory, sampled: Sampled) -> Trajectory:
    """All of the same motion, looked at evenly, and where touches begin, just before and just after."""
    if len(trajectory.times) < 2:
        return trajectory
    most, end = max(MOST // len(world.bodies), 2), world.duration
    rate = min(max(RATE, LEAST / end), world.steps_per_second)
    even = np.linspace(0.0, end, min(ceil(end * rate - 1e-6), most) + 1)
    begins = sampled(np.array([0.0, end])).contacts.touch_times[:most, 0]
    step = DONE / world.steps_per_second
    times = [even, begins, begins - BEFORE, begins - step, begins + step]
    every = np.unique(np.concatenate([*times, np.array([push.start for push in world.pushes])]))
    return sampled(every[(every >= 0) & (every <= end)])


def _sample(seen: Trajectory, time: float) -> int:
    """The first at a time or after it."""
    return min(int(np.searchsorted(seen.times, time - 1e-9)), len(seen.times) - 1)


def _place(world: World, seen: Trajectory, time: float, pair: tuple[int, int]) -> Point:
    """px of the photo where two surfaces are nearest."""
    points, _ = contact_points_between(world, seen.poses[_sample(seen, time)], *pair)
    x, y = points.mean(axis=0).tolist()
    return x, y


def _pairs(seen: Trajectory) -> list[tuple[int, int]]:
    return [(int(one), int(other)) for one, other in seen.contacts.touch_pairs]


def _contacts(world: World, seen: Trajectory) -> Iterator[Event]:
    last = float(seen.times[-1])
    for pair, (begin, end) in zip(_pairs(seen), seen.contacts.touch_times.tolist(), strict=True):
        until = end if end <= last else None
        yield Event(EventKind.CONTACT, begin, pair, _place(world, seen, begin, pair), until)


def _first_touches(world: World, seen: Trajectory) -> Iterator[Event]:
    """Of each body that moves or is moved, as tables of sweeps have it."""
    met: set[int] = set()
    contacts = seen.contacts
    order = np.argsort(contacts.touch_times[:, 0], kind="stable")
    new = new_touches(seen)
    for k in order[new[order]].tolist():
        time = float(contacts.touch_times[k, 0])
        one, other = contacts.touch_pairs[k].tolist()
        for body, partner in ((one, other), (other, one)):
            if body < len(world.bodies) and body not in met:
                met.add(body)
                yield Event(
                    EventKind.FIRST_TOUCH, time, (body, partner), _place(world, seen, time, (one, other))
                )


def _collision(world: World, seen: Trajectory, impact: Impact) -> Event:
    step = DONE / world.steps_per_second
    # where others struck earlier in the same step of the engine, the hair's breadth before is after it
    earlier = (
        _sample(seen, impact.time - BEFORE),
        _sample(seen, impact.time - step),
        _sample(seen, impact.time) - 1,
    )
    before = max(
        (k for k in earlier if k >= 0), key=lambda k: sum(_nearing(world, seen, k, impact)), default=0
    )
    after = _sample(seen, impact.time + step)
    if seen.times[after] - impact.time > 4 * step:
        after = min(_sample(seen, impact.time) + 1, len(seen.times) - 1)
    x, y = impact.at.tolist()
    wx, wy = impact.way.tolist()
    return Event(
        EventKind.COLLISION,
        impact.time,
        impact.pair,
        (x, y),
        impulse=impact.impulse,
        vector=(wx, wy),
        before=_speeds(world, seen, before, impact.pair),
        after=_speeds(world, seen, after, impact.pair),
        nearing=_nearing(world, seen, before, impact),
        parting=-sum(_nearing(world, seen, after, impact)),
    )


def _speeds(world: World, seen: Trajectory, sample: int, pair: tuple[int, int]) -> tuple[float, ...]:
    """px/s of the centres of mass; walls stand."""
    return tuple(
        float(np.hypot(*seen.velocities[sample, k, :2])) if k < len(world.bodies) else 0.0 for k in pair
    )


def _nearing(world: World, seen: Trajectory, sample: int, impact: Impact) -> tuple[float, float]:
    """px/s at which the point of each that meets the other's comes nearer, along the impact's direction."""
    speeds = [0.0, 0.0]
    for n, (k, sign) in enumerate(zip(impact.pair, (-1.0, 1.0), strict=True)):
        if k < len(world.bodies):
            x, y, spin = seen.velocities[sample, k]
            arm = impact.at - seen.poses[sample, k, :2]
            speeds[n] = sign * float(np.array([x - spin * arm[1], y + spin * arm[0]]) @ impact.way)
    return speeds[0], speeds[1]


def _pushes(world: World, seen: Trajectory) -> Iterator[Event]:
    last = float(seen.times[-1])
    for push in world.pushes:
        if world.bodies[push.body].motion is not Motion.DYNAMIC or push.start > last:
            continue
        until = push.end if push.end <= last else None
        if push.load is Load.IMPULSE:
            size = float(np.hypot(*push.vector))
            yield _push(EventKind.PUSH, push, push.start, seen, None, size)
            continue
        yield _push(EventKind.PUSH_START, push, push.start, seen, until, None)
        if until is not None:
            yield _push(EventKind.PUSH_END, push, until, seen, None, None)


def _push(
    kind: EventKind, push: Push, time: float, seen: Trajectory, until: float | None, impulse: float | None
) -> Event:
    pose = seen.poses[_sample(seen, time), push.body]
    x, y = (pose[:2] + rotation(float(pose[2])) @ push.at).tolist()
    vx, vy = push.vector.tolist()
    vector = (vx, vy) if vx or vy else None
    return Event(kind, time, (push.body,), (x, y), until, impulse, vector, push.torque or None)
