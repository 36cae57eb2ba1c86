"""Events of a motion as JSON: pushes, starts, collisions, picture borders and rests.

The number of frames and their rate change nothing: the motion is sampled again, evenly and around impacts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from math import ceil, radians
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.export.labels import Clip, Writer, write_json
from physgen.geometry.polygon import Array, rotation
from physgen.render.camera import Shot
from physgen.render.contacts import Impact, find_impacts
from physgen.scene.scene import Load, Motion, Play, Point
from physgen.simulate.trajectory import (
    REST_SPEED,
    REST_TURN,
    Trajectory,
    rest_times,
    resting_mask,
)


@dataclass(frozen=True)
class EventLimits:
    """What counts as a motion and a touch, and how finely the motion is sampled."""

    shift: float = 0.005
    """Of the photo's longer side, by which an object's centre or rim must leave its place at t = 0: less is settling,
    which is hardly seen."""
    rate: float = 240.0
    least: int = 720  # samples of the motion: a second, and in all; no more than the engine's steps
    most: int = 2_000_000  # samples times objects
    before: float = 1e-6  # s before the beginning of a touch
    after: float = 1.5  # steps of the engine after which an impact is over


LIMITS = EventLimits()

SIDES = ("left", "right", "top", "bottom")


class EventKind(Enum):
    """Kinds of events, in the order in which those of one moment are listed."""

    MOVING = "moving"
    """It moves when the clip starts, because the scene says so."""
    PUSH = "push"
    """An impulse is given to it, or a force or torque acts until `until`."""
    MOVE = "move"
    """It starts to move, and leaves its place by more than `LIMITS.shift`."""
    COLLISION = "collision"
    """An impact between two surfaces."""
    LEAVE = "leave"
    """The last of it leaves the picture."""
    ENTER = "enter"
    """The first of it comes into the picture."""
    REST = "rest"
    """It has moved, and rests from then on."""


@dataclass(frozen=True)
class Event:
    """One event. Surfaces are numbered as in `World.surfaces`: bodies, then walls."""

    kind: EventKind
    time: float  # s of the motion
    surfaces: tuple[int, ...]
    """One, or the two of a collision: the one that moves faster towards the other first."""
    at: Point  # px of the photo: the point of contact or of a push; else the centre of mass
    until: float | None = (
        None  # s: the end of a lasting push; None: it outlasts the clip, or has no length
    )
    impulse: float | None = (
        None  # g·px/s: of a collision or an impulse, without lasting pressure
    )
    vector: Point | None = None
    """Of a collision the unit vector in which the second pushes the first; of a push g·px/s or g·px/s²; else px/s."""
    torque: float = 0.0  # g·px²/s²
    closing: float | None = None
    """px/s at which the contact points of a collision approach each other just before."""
    side: str = ""
    """Of the picture, where an object leaves or enters: one of SIDES."""


def events(clip: Clip) -> tuple[Event, ...]:
    """All events to the end of the motion, by time. Of a clip of one frame, the events at its moment."""
    world, seen = clip.world, clip.trajectory
    if not world.bodies or not len(seen.times):
        return ()
    if len(seen.times) > 1:
        seen = _resampled(world, seen)
    impacts = find_impacts(world, seen, 1 / LIMITS.rate) if len(seen.times) > 1 else []
    found = [
        *_pushes(world, seen),
        *(_collision(world, seen, impact) for impact in impacts),
        *_motions(world, seen),
        *_borders(world, seen, clip.shot),
    ]
    order = list(EventKind)
    return tuple(
        sorted(
            found,
            key=lambda event: (event.time, order.index(event.kind), event.surfaces),
        )
    )


def _resampled(world: World, clip: Trajectory) -> Trajectory:
    """Evenly, and just before and after the beginnings of touches."""
    most, end = max(LIMITS.most // len(world.bodies), 2), world.duration
    rate = min(max(LIMITS.rate, LIMITS.least / end), world.steps_per_second)
    even = np.linspace(0.0, end, min(ceil(end * rate - 1e-6), most) + 1)
    whole = clip.sampled(np.array([0.0, end]))  # the last frame is before the end
    begins = whole.contacts.touch_times[:most, 0]
    step = LIMITS.after / world.steps_per_second
    pushes = np.array([push.start for push in world.pushes])
    every = np.unique(
        np.concatenate(
            [even, begins, begins - LIMITS.before, begins - step, begins + step, pushes]
        )
    )
    return whole.sampled(every[(every >= 0) & (every <= end)])


def _sample(seen: Trajectory, time: float) -> int:
    """The first at a time or after it."""
    return min(int(np.searchsorted(seen.times, time - 1e-9)), len(seen.times) - 1)


def _pair(values: Array) -> Point:
    x, y = values[:2].tolist()
    return x, y


def _pushes(world: World, seen: Trajectory) -> Iterator[Event]:
    last = float(seen.times[-1])

    for push in world.pushes:
        if world.bodies[push.body].motion is not Motion.DYNAMIC or push.start > last:
            continue
        pose = seen.poses[_sample(seen, push.start), push.body]
        at = _pair(pose[:2] + rotation(float(pose[2])) @ push.at)
        vector = _pair(push.vector) if push.vector.any() else None
        sudden = push.load is Load.IMPULSE
        until = push.end if not sudden and push.end <= last else None
        impulse = float(np.hypot(*push.vector)) if sudden else None
        yield Event(
            EventKind.PUSH,
            push.start,
            (push.body,),
            at,
            until,
            impulse,
            vector,
            push.torque,
        )


def _collision(world: World, seen: Trajectory, impact: Impact) -> Event:
    step = LIMITS.after / world.steps_per_second
    # where other impacts came earlier in the same engine step, the sample just before is after them
    earlier = (impact.time - LIMITS.before, impact.time - step)
    samples = [
        *(_sample(seen, time) for time in earlier),
        _sample(seen, impact.time) - 1,
    ]
    nearing = max(
        (_nearing(world, seen, k, impact) for k in samples if k >= 0),
        key=sum,
        default=(0.0, 0.0),
    )
    pair, way = impact.pair, impact.way
    if nearing[1] > nearing[0] and pair[1] < len(world.bodies):
        pair, way = pair[::-1], -way
    at, vector = _pair(impact.at), _pair(way)
    return Event(
        EventKind.COLLISION,
        impact.time,
        pair,
        at,
        None,
        impact.impulse,
        vector,
        closing=sum(nearing),
    )


def _nearing(
    world: World, seen: Trajectory, sample: int, impact: Impact
) -> tuple[float, float]:
    """px/s at which the contact point of each surface approaches the other, along the impact's direction."""
    speeds = [0.0, 0.0]
    for n, (k, sign) in enumerate(zip(impact.pair, (-1.0, 1.0), strict=True)):
        if k < len(world.bodies):
            x, y, spin = seen.velocities[sample, k]
            arm = impact.at - seen.poses[sample, k, :2]
            speeds[n] = sign * float(
                np.array([x - spin * arm[1], y + spin * arm[0]]) @ impact.way
            )
    return speeds[0], speeds[1]


def _motions(world: World, seen: Trajectory) -> Iterator[Event]:
    """Starts and rests of each body by itself."""
    resting, least = resting_mask(seen), LIMITS.shift * max(world.size)
    for k, (body, rest) in enumerate(zip(world.bodies, rest_times(seen), strict=True)):
        poses = seen.poses[:, k]
        turned = np.abs(poses[:, 2] - poses[0, 2])
        reach = np.maximum(
            np.hypot(*(poses[:, :2] - poses[0, :2]).T), turned * body.reach
        )
        gone = np.flatnonzero(reach > least)
        if not len(gone):
            continue
        yield _start(world, seen, k, int(gone[0]), resting[:, k])
        if rest is not None:
            yield Event(EventKind.REST, rest, (k,), _pair(poses[_sample(seen, rest)]))


def _crossing(times: Array, values: Array, at: int) -> float:
    """s: where values pass 0 between sample `at` - 1 and `at`."""
    low, high = float(values[at - 1]), float(values[at])
    return float(times[at - 1] + low / (low - high) * (times[at] - times[at - 1]))


def _start(
    world: World, seen: Trajectory, k: int, gone: int, resting: NDArray[np.bool_]
) -> Event:
    """`gone` is the first sample away from the place at t = 0."""
    body, poses, velocities = world.bodies[k], seen.poses[:, k], seen.velocities[:, k]
    if body.motion is Motion.SCRIPTED:
        moves = bool(np.abs(velocities[0]).max() > 0)
    else:  # by the scene; an impulse at t = 0 does not count
        slow = np.hypot(*body.velocity) < REST_SPEED and abs(body.spin) < radians(
            REST_TURN
        )
        moves = not slow or bool(body.roll.any())
    if moves:
        return Event(
            EventKind.MOVING, 0.0, (k,), _pair(poses[0]), vector=_pair(velocities[0])
        )
    at = max(
        np.flatnonzero(resting[: gone + 1]).tolist(), default=0
    )  # an impulse at t = 0 shows at once
    at += at > 0  # after a rest, it moves in the first sample that shows it
    time, place = float(seen.times[at]), _pair(poses[at])
    return Event(EventKind.MOVE, time, (k,), place, vector=_pair(velocities[gone]))


def _borders(world: World, seen: Trajectory, shot: Shot) -> Iterator[Event]:
    """An object is in the picture as long as any of its outline is."""
    lenses = np.stack([shot.affine(float(time)) for time in seen.times])
    for k, body in enumerate(world.bodies):
        center = (
            np.einsum("tij,tj->ti", lenses[:, :, :2], seen.poses[:, k, :2])
            + lenses[:, :, 2]
        )
        if (_beyond(center, center, shot.video) <= 0).all():
            continue
        beyond = _outside(body, seen.poses[:, k], lenses, shot.video)
        far = beyond.max(axis=1)
        for at in (np.flatnonzero((far[1:] > 0) != (far[:-1] > 0)) + 1).tolist():
            leaves = far[at] > 0
            kind = EventKind.LEAVE if leaves else EventKind.ENTER
            side = SIDES[int(beyond[at if leaves else at - 1].argmax())]
            yield Event(
                kind,
                _crossing(seen.times, far, at),
                (k,),
                _pair(seen.poses[at, k]),
                side=side,
            )


def _outside(body: Body, poses: Array, lenses: Array, size: tuple[int, int]) -> Array:
    """(T, 4) video px by which all of a body is beyond each of SIDES; below 0: some of it is not.

    poses (T, 3), lenses (T, 2, 3).
    """
    scale, shift = lenses[:, 0, 0, None], lenses[:, :, 2]
    if body.radius is not None:
        low, high = poses[:, :2] - body.radius, poses[:, :2] + body.radius
    else:
        rim = np.concatenate(body.rings)
        c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
        turned = np.stack(
            [c * rim[:, 0] - s * rim[:, 1], s * rim[:, 0] + c * rim[:, 1]], axis=1
        )
        low, high = poses[:, :2] + turned.min(axis=2), poses[:, :2] + turned.max(axis=2)
    return _beyond(low * scale + shift, high * scale + shift, size)


def _beyond(low: Array, high: Array, size: tuple[int, int]) -> Array:
    """(T, 4): how far boxes from `low` to `high` (T, 2) are beyond each border, half a px outside the first centres."""
    width, height = size
    return np.stack(
        [
            -0.5 - high[:, 0],
            low[:, 0] - (width - 0.5),
            -0.5 - high[:, 1],
            low[:, 1] - (height - 0.5),
        ],
        axis=1,
    )


# ---- the file ----

UNITS = {
    "time, until": "s of the motion",
    "clip_time": "s of the clip as it plays",
    "frame": "of the clip, from 0",
    "place": "px, +x right, +y down, (0, 0) the centre of the top-left pixel",
    "impulse": "g·px/s and N·s",
    "vector": "collision: where the second pushes the first, unit; push: g·px/s or g·px/s²; what moves: px/s",
    "torque": "g·px²/s², positive turns +x towards +y",
    "closing": "px/s at which the two come together at the place where they meet",
}


class ClipTimes:
    """Times of the motion as frames and seconds of the clip; of what is shown twice, the first time counts."""

    def __init__(self, clip: Clip) -> None:
        self._times, self._order, self._fps = (
            clip.trajectory.times,
            clip.shot.order,
            clip.fps,
        )
        self._backward = clip.scene.render.play is Play.BACKWARD
        self._step = (
            float(self._times[1] - self._times[0]) if len(self._times) > 1 else 1.0
        )

    def frame(self, time: float) -> int:
        """The first frame that shows the state after a moment of the motion; played backward, the state before it."""
        last = len(self._times) - 1
        if self._backward:
            sample = max(
                int(np.searchsorted(self._times, time + 1e-9, side="right")) - 1, 0
            )
        else:
            sample = min(int(np.searchsorted(self._times, time - 1e-9)), last)
        return self._order.index(sample)

    def shown(self, time: float) -> float:
        """s from the clip's start as it plays; what comes after the last sample is not shown before the start."""
        samples = time / self._step
        if self._backward:
            samples = max(len(self._times) - 1 - samples, 0.0)
        return samples / self._fps


class Events(Writer):
    """`events.json`."""

    def close(self) -> None:
        """Write the file."""
        clip = self._clip
        about = {
            "version": 3,
            "clip": clip.name,
            "frames": clip.count,
            "fps": clip.fps,
            "size": list(clip.size),
            "scale": clip.scale.as_dict(),
            "units": UNITS,
            "objects": [
                {"name": item.name, "label": label}
                for item, label in zip(clip.scene.objects, clip.labels, strict=True)
            ],
            "boundaries": [wall.name for wall in clip.world.walls],
            "events": [_event_json(clip, event) for event in events(clip)],
        }
        write_json(self._folder / "events.json", about)


def _event_json(clip: Clip, event: Event) -> dict[str, Any]:
    """An event as JSON, without empty fields."""
    times, names = ClipTimes(clip), [name for name, _ in clip.world.surfaces]
    impulse, seen = event.impulse, clip.shot.affine(event.time) @ (*event.at, 1.0)
    row: dict[str, Any] = {
        "kind": event.kind.value,
        "time": event.time,
        "clip_time": times.shown(event.time),
        "until": event.until,
        "frame": times.frame(event.time),
        "who": [names[k] for k in event.surfaces],
        "place": {"photo": list(event.at), "video": seen.tolist()},
        "impulse": None
        if impulse is None
        else {"g_px_s": impulse, "N_s": clip.scale.newton_seconds(impulse)},
        "vector": None if event.vector is None else list(event.vector),
        "torque": event.torque or None,
        "closing": event.closing,
        "side": event.side or None,
    }
    return {key: value for key, value in row.items() if value is not None}
