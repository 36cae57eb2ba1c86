"""Find events of a motion and write them as JSON: pushes, starts, collisions, picture borders and rests.

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
from physgen.simulate.ramps import is_ramped
from physgen.simulate.trajectory import (
    REST_SPEED,
    REST_TURN,
    Trajectory,
    rest_times,
    resting_mask,
)


@dataclass(frozen=True)
class EventLimits:
    """Limits of motions and touches, and the sampling of the motion."""

    shift: float = 0.005
    """Of the photo's longer side, by which an object's centre or rim must leave its place at t = 0: less is settling,
    which is hardly visible."""
    rate: float = 240.0
    """1/s: samples of the motion, at least, but no more than the engine's steps."""
    min_samples: int = 720
    """Samples of the whole motion."""
    max_samples: int = 2_000_000
    """Samples times objects."""
    lead: float = 1e-6
    """s before the beginning of a touch."""
    impact_steps: float = 1.5
    """Steps of the engine after which an impact is over."""


LIMITS = EventLimits()
TIME_TOLERANCE = 1e-9
"""s by which times of samples may be rounded."""

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
    time: float
    """s of the motion."""
    surfaces: tuple[int, ...]
    """One, or the two of a collision: the one that moves faster towards the other first."""
    place: Point
    """px of the photo: the point of contact or of a push; else the centre of mass."""
    end: float | None = None
    """s: the end of a lasting push; None: it outlasts the clip, or has no length."""
    impulse: float | None = None
    """g·px/s: of a collision or an impulse, without lasting pressure."""
    vector: Point | None = None
    """Of a collision the unit vector in which the second pushes the first; of a push g·px/s or g·px/s²; else px/s."""
    torque: float = 0.0
    """g·px²/s²."""
    closing: float | None = None
    """px/s at which the contact points of a collision approach each other just before."""
    side: str = ""
    """Of the picture, at which an object leaves or enters: one of SIDES."""


def events(clip: Clip) -> tuple[Event, ...]:
    """Return all events to the end of the motion, by time. Of a clip of one frame, the events at its moment."""
    world, trajectory = clip.world, clip.trajectory
    if not world.bodies or not len(trajectory.times):
        return ()
    if len(trajectory.times) > 1:
        trajectory = _resample(world, trajectory)
    found = [
        *_pushes(world, trajectory),
        *_collisions(world, trajectory),
        *_motions(world, trajectory),
        *_border_crossings(world, trajectory, clip.shot),
    ]
    kinds = list(EventKind)
    found.sort(key=lambda event: (event.time, kinds.index(event.kind), event.surfaces))
    return tuple(found)


def collisions(clip: Clip) -> list[Event]:
    """Return the events of impacts alone, by time, to the end of the motion."""
    if not clip.world.bodies or len(clip.trajectory.times) < 2:
        return []
    trajectory = _resample(clip.world, clip.trajectory)
    return sorted(_collisions(clip.world, trajectory), key=lambda event: event.time)


def _collisions(world: World, trajectory: Trajectory) -> list[Event]:
    """Return the events of impacts; none of a single sample."""
    if len(trajectory.times) < 2:
        return []
    impacts = find_impacts(world, trajectory, 1 / LIMITS.rate)
    return [_collision(world, trajectory, impact) for impact in impacts]


def _resample(world: World, trajectory: Trajectory) -> Trajectory:
    """Return even samples, and samples just before and after the beginnings of touches."""
    limit = max(LIMITS.max_samples // len(world.bodies), 2)
    end = world.duration
    rate = max(LIMITS.rate, LIMITS.min_samples / end)
    rate = min(rate, world.steps_per_second)
    steps = min(ceil(end * rate - 1e-6), limit)
    even_times = np.linspace(0.0, end, steps + 1)
    # the last frame is before the end
    whole = trajectory.sampled(np.array([0.0, end]))
    touches = whole.contacts.touch_times[:limit, 0]
    step = LIMITS.impact_steps / world.steps_per_second
    pushes = np.array([push.start for push in world.pushes])
    before = touches - LIMITS.lead
    earlier = touches - step
    later = touches + step
    times = np.concatenate([even_times, touches, before, earlier, later, pushes])
    times = np.unique(times)
    return whole.sampled(times[(times >= 0) & (times <= end)])


def _sample(trajectory: Trajectory, time: float) -> int:
    """Return the first sample at a time (s) or after it."""
    sample = int(np.searchsorted(trajectory.times, time - TIME_TOLERANCE))
    return min(sample, len(trajectory.times) - 1)


def _point(values: Array) -> Point:
    x, y = values[:2].tolist()
    return x, y


def _pushes(world: World, trajectory: Trajectory) -> Iterator[Event]:
    """Yield the pushes of bodies that can be pushed."""
    end = float(trajectory.times[-1])
    for push in world.pushes:
        if world.bodies[push.body].motion is not Motion.DYNAMIC or push.start > end:
            continue
        pose = trajectory.poses[_sample(trajectory, push.start), push.body]
        place = _point(pose[:2] + rotation(float(pose[2])) @ push.at)
        is_impulse = push.load is Load.IMPULSE
        has_end = not is_impulse and push.end <= end
        yield Event(
            EventKind.PUSH,
            push.start,
            (push.body,),
            place,
            end=push.end if has_end else None,
            impulse=float(np.hypot(*push.vector)) if is_impulse else None,
            vector=_point(push.vector) if push.vector.any() else None,
            torque=push.torque,
        )


def _collision(world: World, trajectory: Trajectory, impact: Impact) -> Event:
    """Return the event of an impact, with the surface first that moves faster towards the other."""
    step = LIMITS.impact_steps / world.steps_per_second
    # if other impacts came earlier in the same engine step, the sample just before is after them
    samples = [
        _sample(trajectory, impact.time - LIMITS.lead),
        _sample(trajectory, impact.time - step),
        _sample(trajectory, impact.time) - 1,
    ]
    approaches = []
    for sample in samples:
        if sample >= 0:
            approaches.append(_approach(world, trajectory, sample, impact))
    approach = max(approaches, key=sum, default=(0.0, 0.0))
    pair, direction = impact.pair, impact.way
    if approach[1] > approach[0] and pair[1] < len(world.bodies):
        pair = pair[::-1]
        direction = -direction
    return Event(
        EventKind.COLLISION,
        impact.time,
        pair,
        _point(impact.at),
        impulse=impact.impulse,
        vector=_point(direction),
        closing=sum(approach),
    )


def _approach(
    world: World, trajectory: Trajectory, sample: int, impact: Impact
) -> tuple[float, float]:
    """Return the speeds (px/s) at which the contact point of each surface approaches the other.

    They are along the impact's direction.
    """
    speeds = [0.0, 0.0]
    for n, (k, sign) in enumerate(zip(impact.pair, (-1.0, 1.0), strict=True)):
        if k < len(world.bodies):
            x, y, spin = trajectory.velocities[sample, k]
            arm = impact.at - trajectory.poses[sample, k, :2]
            point_x = x - spin * arm[1]
            point_y = y + spin * arm[0]
            speed = np.array([point_x, point_y]) @ impact.way
            speeds[n] = sign * float(speed)
    return speeds[0], speeds[1]


def _motions(world: World, trajectory: Trajectory) -> Iterator[Event]:
    """Yield starts and rests of each body by itself."""
    is_resting = resting_mask(trajectory)
    rests = rest_times(trajectory)
    min_shift = LIMITS.shift * max(world.size)
    for k, (body, rest) in enumerate(zip(world.bodies, rests, strict=True)):
        poses = trajectory.poses[:, k]
        rim_shift = np.abs(poses[:, 2] - poses[0, 2]) * body.reach
        center_shift = np.hypot(*(poses[:, :2] - poses[0, :2]).T)
        shift = np.maximum(center_shift, rim_shift)
        moved_samples = np.flatnonzero(shift > min_shift)
        if not len(moved_samples):
            continue
        yield _start(world, trajectory, k, int(moved_samples[0]), is_resting[:, k])
        if rest is not None:
            place = _point(poses[_sample(trajectory, rest)])
            yield Event(EventKind.REST, rest, (k,), place)


def _crossing_time(times: Array, values: Array, sample: int) -> float:
    """Return the time (s) at which values pass 0 between a sample and the one before."""
    low = float(values[sample - 1])
    high = float(values[sample])
    step = times[sample] - times[sample - 1]
    return float(times[sample - 1] + low / (low - high) * step)


def _start(
    world: World,
    trajectory: Trajectory,
    k: int,
    moved_sample: int,
    is_resting: NDArray[np.bool_],
) -> Event:
    """Return the start of a motion; `moved_sample` is the first one away from the place at t = 0."""
    poses = trajectory.poses[:, k]
    velocities = trajectory.velocities[:, k]
    if _moves_at_start(world.bodies[k], velocities[0]):
        place = _point(poses[0])
        velocity = _point(velocities[0])
        return Event(EventKind.MOVING, 0.0, (k,), place, vector=velocity)
    # an impulse at t = 0 is visible at once
    rests = np.flatnonzero(is_resting[: moved_sample + 1]).tolist()
    sample = max(rests, default=0)
    if sample > 0:
        # after a rest, the body moves in the first sample that shows it
        sample += 1
    time = float(trajectory.times[sample])
    place = _point(poses[sample])
    velocity = _point(velocities[moved_sample])
    return Event(EventKind.MOVE, time, (k,), place, vector=velocity)


def _moves_at_start(body: Body, velocity: Array) -> bool:
    """Return whether a body moves at t = 0 by the scene; an impulse at t = 0 does not count."""
    if body.motion is Motion.SCRIPTED:
        return bool(np.abs(velocity).max() > 0)
    if is_ramped(body):
        return False
    is_fast = np.hypot(*body.velocity) >= REST_SPEED
    is_spinning = abs(body.spin) >= radians(REST_TURN)
    return bool(is_fast or is_spinning or body.roll.any())


def _border_crossings(
    world: World, trajectory: Trajectory, shot: Shot
) -> Iterator[Event]:
    """Yield the times at which objects leave and enter the picture.

    An object is in the picture as long as any of its outline is.
    """
    times = trajectory.times
    lenses = np.stack([shot.affine(float(time)) for time in times])
    for k, body in enumerate(world.bodies):
        poses = trajectory.poses[:, k]
        centers = np.einsum("tij,tj->ti", lenses[:, :, :2], poses[:, :2])
        centers = centers + lenses[:, :, 2]
        if (_border_distances(centers, centers, shot.video) <= 0).all():
            continue
        distances = _outside_distances(body, poses, lenses, shot.video)
        farthest = distances.max(axis=1)
        is_outside = farthest > 0
        changes = np.flatnonzero(is_outside[1:] != is_outside[:-1]) + 1
        for sample in changes.tolist():
            kind, outside_sample = EventKind.ENTER, sample - 1
            if farthest[sample] > 0:
                kind, outside_sample = EventKind.LEAVE, sample
            yield Event(
                kind,
                _crossing_time(times, farthest, sample),
                (k,),
                _point(poses[sample]),
                side=SIDES[int(distances[outside_sample].argmax())],
            )


def _outside_distances(
    body: Body, poses: Array, lenses: Array, size: tuple[int, int]
) -> Array:
    """Return the video px (T, 4) by which all of a body is beyond each of SIDES; below 0 a part of it is not.

    poses (T, 3), lenses (T, 2, 3).
    """
    scale = lenses[:, 0, 0, None]
    shift = lenses[:, :, 2]
    places = poses[:, :2]
    if body.radius is not None:
        low = places - body.radius
        high = places + body.radius
    else:
        x, y = np.concatenate(body.rings).T
        c = np.cos(poses[:, 2:])
        s = np.sin(poses[:, 2:])
        rim_x = c * x - s * y
        rim_y = s * x + c * y
        rim = np.stack([rim_x, rim_y], axis=1)
        low = places + rim.min(axis=2)
        high = places + rim.max(axis=2)
    return _border_distances(low * scale + shift, high * scale + shift, size)


def _border_distances(low: Array, high: Array, size: tuple[int, int]) -> Array:
    """Return the distance (T, 4) px of boxes from `low` to `high` (T, 2) beyond each border of a picture.

    Borders are half a px outside the first centres.
    """
    width, height = size
    left = -0.5 - high[:, 0]
    right = low[:, 0] - (width - 0.5)
    top = -0.5 - high[:, 1]
    bottom = low[:, 1] - (height - 0.5)
    return np.stack([left, right, top, bottom], axis=1)


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
    """Times of the motion as frames and seconds of the clip; the first time counts if a state is shown twice."""

    def __init__(self, clip: Clip) -> None:
        self._times = clip.trajectory.times
        self._order = clip.shot.order
        self._fps = clip.fps
        self._is_backward = clip.scene.render.play is Play.BACKWARD
        self._step = 1.0
        if len(self._times) > 1:
            self._step = float(self._times[1] - self._times[0])

    def frame(self, time: float) -> int:
        """Return the first frame that shows the state after a moment of the motion; played backward, before it."""
        if self._is_backward:
            after = np.searchsorted(self._times, time + TIME_TOLERANCE, side="right")
            sample = max(int(after) - 1, 0)
        else:
            before = np.searchsorted(self._times, time - TIME_TOLERANCE)
            sample = min(int(before), len(self._times) - 1)
        return self._order.index(sample)

    def clip_time(self, time: float) -> float:
        """Return the s from the clip's start as it plays; played backward, states after the last sample are at 0."""
        samples = time / self._step
        if self._is_backward:
            samples = max(len(self._times) - 1 - samples, 0.0)
        return samples / self._fps


class Events(Writer):
    """`events.json`."""

    def close(self) -> None:
        """Write the file."""
        clip = self._clip
        objects = []
        for item, label in zip(clip.scene.objects, clip.labels, strict=True):
            objects.append({"name": item.name, "label": label})
        record = {
            "version": 3,
            "clip": clip.name,
            "frames": clip.count,
            "fps": clip.fps,
            "size": list(clip.size),
            "scale": clip.scale.as_dict(),
            "units": UNITS,
            "objects": objects,
            "boundaries": [wall.name for wall in clip.world.walls],
            "events": [_event_json(clip, event) for event in events(clip)],
        }
        write_json(self._folder / "events.json", record)


def _event_json(clip: Clip, event: Event) -> dict[str, Any]:
    """Return an event for JSON, without empty fields."""
    times = ClipTimes(clip)
    names = [name for name, _ in clip.world.surfaces]
    video_place = clip.shot.affine(event.time) @ (*event.place, 1.0)
    impulse = None
    if event.impulse is not None:
        newton_seconds = clip.scale.newton_seconds(event.impulse)
        impulse = {"g_px_s": event.impulse, "N_s": newton_seconds}
    row: dict[str, Any] = {
        "kind": event.kind.value,
        "time": event.time,
        "clip_time": times.clip_time(event.time),
        "until": event.end,
        "frame": times.frame(event.time),
        "who": [names[k] for k in event.surfaces],
        "place": {"photo": list(event.place), "video": video_place.tolist()},
        "impulse": impulse,
        "vector": None if event.vector is None else list(event.vector),
        "torque": event.torque or None,
        "closing": event.closing,
        "side": event.side or None,
    }
    return {key: value for key, value in row.items() if value is not None}
