"""Find events of a motion and write them as JSON: pushes, starts, collisions, picture
borders and rests.

The frames have no influence: the motion is sampled again, evenly and around impacts.
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
from physgen.simulate.ramps import has_ramp
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
    """Minimum shift of a moving object's centre or rim from t = 0, over the photo's
    longer side. A smaller shift is invisible settling.
    """
    rate: float = 240.0
    """Minimum sampling rate of the motion, 1/s, up to the engine's steps."""
    min_samples: int = 720
    """Minimum number of samples of the whole motion."""
    max_samples: int = 2_000_000
    """Maximum number of samples times objects."""
    lead: float = 1e-6
    """Time of a sample before the beginning of a touch, s."""
    impact_steps: float = 1.5
    """Duration of an impact in steps of the engine."""


LIMITS = EventLimits()
TIME_TOLERANCE = 1e-9
"""Rounding error of sample times, s."""

SIDES = ("left", "right", "top", "bottom")


class EventKind(Enum):
    """Kinds of events, in the order of simultaneous events."""

    MOVING = "moving"
    """A motion from the start of the clip, given in the scene."""
    PUSH = "push"
    """An impulse, or a force or torque until `until`."""
    MOVE = "move"
    """The start of a motion by more than `LIMITS.shift`."""
    COLLISION = "collision"
    """An impact between two surfaces."""
    LEAVE = "leave"
    """The last part of an object leaves the picture."""
    ENTER = "enter"
    """The first part of an object enters the picture."""
    REST = "rest"
    """The final rest after a motion."""


@dataclass(frozen=True)
class Event:
    """One event. Surfaces have the numbers of `World.surfaces`: bodies, then walls."""

    kind: EventKind
    time: float
    """s of the motion."""
    surfaces: tuple[int, ...]
    """One surface, or the two of a collision, with the faster approaching one first."""
    place: Point
    """px of the photo: the point of contact or of a push, otherwise the
    centre of mass.
    """
    end: float | None = None
    """End of a lasting push, s; None: after the end of the clip, or without
    duration.
    """
    impulse: float | None = None
    """Impulse of a collision or a push without lasting pressure, g·px/s."""
    vector: Point | None = None
    """For a collision: the unit vector from the second to the first; for a push: g·px/s
    or g·px/s²; otherwise px/s.
    """
    torque: float = 0.0
    """g·px²/s²."""
    closing: float | None = None
    """Closing speed of the contact points just before a collision, px/s."""
    side: str = ""
    """Side of the picture at which an object leaves or enters: one of SIDES."""


def events(clip: Clip) -> tuple[Event, ...]:
    """Return all events to the end of the motion, by time. For a clip of one frame,
    return the events at its time.
    """
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
    # Simultaneous events have a fixed order, so that files do not change between runs.
    kinds = list(EventKind)
    found.sort(key=lambda event: (event.time, kinds.index(event.kind), event.surfaces))
    return tuple(found)


def collisions(clip: Clip) -> list[Event]:
    """Return only the events of impacts, by time, to the end of the motion."""
    if not clip.world.bodies or len(clip.trajectory.times) < 2:
        return []
    trajectory = _resample(clip.world, clip.trajectory)
    return sorted(_collisions(clip.world, trajectory), key=lambda event: event.time)


def _collisions(world: World, trajectory: Trajectory) -> list[Event]:
    """Return the events of impacts, or nothing for a single sample."""
    if len(trajectory.times) < 2:
        return []
    impacts = find_impacts(world, trajectory, 1 / LIMITS.rate)
    return [_collision(world, trajectory, impact) for impact in impacts]


def _resample(world: World, trajectory: Trajectory) -> Trajectory:
    """Return even samples, and samples just before and after the beginnings
    of touches.
    """
    limit = max(LIMITS.max_samples // len(world.bodies), 2)
    end = world.duration
    rate = max(LIMITS.rate, LIMITS.min_samples / end)
    # Finer samples than the engine's steps have no new information.
    rate = min(rate, world.steps_per_second)
    steps = min(ceil(end * rate - 1e-6), limit)
    even_times = np.linspace(0.0, end, steps + 1)
    # The last frame is before the end of the motion.
    whole = trajectory.resample(np.array([0.0, end]))
    touches = whole.contacts.touch_times[:limit, 0]
    step = LIMITS.impact_steps / world.steps_per_second
    pushes = np.array([push.start for push in world.pushes])
    # An impact needs velocities before, at and after its touch.
    before = touches - LIMITS.lead
    earlier = touches - step
    later = touches + step
    times = np.concatenate([even_times, touches, before, earlier, later, pushes])
    times = np.unique(times)
    return whole.resample(times[(times >= 0) & (times <= end)])


def _sample(trajectory: Trajectory, time: float) -> int:
    """Return the first sample at or after a time (s)."""
    sample = int(np.searchsorted(trajectory.times, time - TIME_TOLERANCE))
    return min(sample, len(trajectory.times) - 1)


def _point(values: Array) -> Point:
    x, y = values[:2].tolist()
    return x, y


def _pushes(world: World, trajectory: Trajectory) -> Iterator[Event]:
    """Yield the pushes of dynamic bodies."""
    end = float(trajectory.times[-1])
    for push in world.pushes:
        if world.bodies[push.body].motion is not Motion.DYNAMIC or push.start > end:
            continue
        # The point of application turns with the body: its place is that at the time of
        # the push.
        pose = trajectory.poses[_sample(trajectory, push.start), push.body]
        offset = rotation(float(pose[2])) @ push.point
        place = _point(pose[:2] + offset)
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
    """Return the event of an impact, with the faster approaching surface first."""
    step = LIMITS.impact_steps / world.steps_per_second
    # After earlier impacts in the same engine step, the sample just before is too late.
    samples = [
        _sample(trajectory, impact.time - LIMITS.lead),
        _sample(trajectory, impact.time - step),
        _sample(trajectory, impact.time) - 1,
    ]
    approaches = []
    for sample in samples:
        if sample >= 0:
            approaches.append(_approach(world, trajectory, sample, impact))
    # The fastest approach is that before any impulse of the same impact.
    approach = max(approaches, key=sum, default=(0.0, 0.0))
    pair, direction = impact.pair, impact.way
    if approach[1] > approach[0] and pair[1] < len(world.bodies):
        pair = pair[::-1]
        direction = -direction
    return Event(
        EventKind.COLLISION,
        impact.time,
        pair,
        _point(impact.place),
        impulse=impact.impulse,
        vector=_point(direction),
        closing=sum(approach),
    )


def _approach(
    world: World, trajectory: Trajectory, sample: int, impact: Impact
) -> tuple[float, float]:
    """Return the speeds (px/s) at which the contact point of each surface approaches
    the other, along the impact's direction.
    """
    speeds = [0.0, 0.0]
    for n, (k, sign) in enumerate(zip(impact.pair, (-1.0, 1.0), strict=True)):
        if k < len(world.bodies):
            x, y, spin = trajectory.velocities[sample, k]
            arm = impact.place - trajectory.poses[sample, k, :2]
            # The velocity of a body's point is v + w x r.
            point_x = x - spin * arm[1]
            point_y = y + spin * arm[0]
            speed = np.array([point_x, point_y]) @ impact.way
            speeds[n] = sign * float(speed)
    return speeds[0], speeds[1]


def _motions(world: World, trajectory: Trajectory) -> Iterator[Event]:
    """Yield the starts and rests of each body."""
    is_resting = resting_mask(trajectory)
    rests = rest_times(trajectory)
    min_shift = LIMITS.shift * max(world.size)
    for k, (body, rest) in enumerate(zip(world.bodies, rests, strict=True)):
        poses = trajectory.poses[:, k]
        # A turn moves the rim, even if the centre rests.
        displacement = poses - poses[0]
        rim_shift = np.abs(displacement[:, 2]) * body.reach
        center_shift = np.hypot(*displacement[:, :2].T)
        shift = np.maximum(center_shift, rim_shift)
        moved_samples = np.flatnonzero(shift > min_shift)
        if not len(moved_samples):
            continue
        yield _start(world, trajectory, k, int(moved_samples[0]), is_resting[:, k])
        if rest is not None:
            place = _point(poses[_sample(trajectory, rest)])
            yield Event(EventKind.REST, rest, (k,), place)


def _crossing_time(times: Array, values: Array, sample: int) -> float:
    """Return the time (s) of the zero of values between a sample and the
    previous one.
    """
    # Between two samples, the value is taken as linear.
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
    """Return the start of a motion; `moved_sample` is the first one away from the place
    at t = 0.
    """
    poses = trajectory.poses[:, k]
    velocities = trajectory.velocities[:, k]
    if _moves_at_start(world.bodies[k], velocities[0]):
        place = _point(poses[0])
        velocity = _point(velocities[0])
        return Event(EventKind.MOVING, 0.0, (k,), place, vector=velocity)
    # An impulse at t = 0 is visible at once.
    rests = np.flatnonzero(is_resting[: moved_sample + 1]).tolist()
    sample = max(rests, default=0)
    if sample > 0:
        # After a rest, the first different sample shows the motion.
        sample += 1
    time = float(trajectory.times[sample])
    place = _point(poses[sample])
    velocity = _point(velocities[moved_sample])
    return Event(EventKind.MOVE, time, (k,), place, vector=velocity)


def _moves_at_start(body: Body, velocity: Array) -> bool:
    """Return whether the scene makes a body move at t = 0. An impulse at t = 0 does not
    count.
    """
    if body.motion is Motion.SCRIPTED:
        return bool(np.abs(velocity).max() > 0)
    # A push that starts smoothly is a start of motion, not a motion at t = 0.
    if has_ramp(body):
        return False
    is_fast = np.hypot(*body.velocity) >= REST_SPEED
    is_spinning = abs(body.spin) >= radians(REST_TURN)
    return bool(is_fast or is_spinning or body.roll.any())


def _border_crossings(
    world: World, trajectory: Trajectory, shot: Shot
) -> Iterator[Event]:
    """Yield the times at which objects leave and enter the picture.

    An object is in the picture if any part of its outline is.
    """
    times = trajectory.times
    lenses = np.stack([shot.affine(float(time)) for time in times])
    for k, body in enumerate(world.bodies):
        poses = trajectory.poses[:, k]
        magnified_centers = np.einsum("tij,tj->ti", lenses[:, :, :2], poses[:, :2])
        centers = magnified_centers + lenses[:, :, 2]
        # A body with its centre always inside cannot be outside: most bodies end here.
        if (_border_distances(centers, centers, shot.video) <= 0).all():
            continue
        distances = _outside_distances(body, poses, lenses, shot.video)
        farthest = distances.max(axis=1)
        is_outside = farthest > 0
        # A sample on another side than the one before it is a crossing.
        changes = np.flatnonzero(is_outside[1:] != is_outside[:-1]) + 1
        for sample in changes.tolist():
            # The sample outside shows which border the object crosses.
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
    """Return the distance (T, 4) of a whole body beyond each of SIDES, video px. A
    negative distance means that a part is inside.

    poses (T, 3), lenses (T, 2, 3).
    """
    # The camera neither turns nor distorts: it scales and shifts.
    scale = lenses[:, 0, 0, None]
    shift = lenses[:, :, 2]
    places = poses[:, :2]
    if body.radius is not None:
        low = places - body.radius
        high = places + body.radius
    else:
        # The extent of a turned outline, at every sample at once.
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
    """Return the distance (T, 4) px of boxes from `low` to `high` (T, 2) beyond each
    border of a picture.

    Borders are half a px outside the first centres.
    """
    width, height = size
    left = -0.5 - high[:, 0]
    right = low[:, 0] - (width - 0.5)
    top = -0.5 - high[:, 1]
    bottom = low[:, 1] - (height - 0.5)
    return np.stack([left, right, top, bottom], axis=1)


# ---- the file

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
    """Times of the motion as frames and seconds of the clip. For a repeated state, the
    first time counts.
    """

    def __init__(self, clip: Clip) -> None:
        self._times = clip.trajectory.times
        self._order = clip.shot.order
        self._fps = clip.fps
        self._is_backward = clip.scene.render.play is Play.BACKWARD
        self._step = 1.0
        if len(self._times) > 1:
            self._step = float(self._times[1] - self._times[0])

    def frame(self, time: float) -> int:
        """Return the first frame with the state after a time of the motion, or before
        it in a backward clip.
        """
        if self._is_backward:
            after = np.searchsorted(self._times, time + TIME_TOLERANCE, side="right")
            sample = max(int(after) - 1, 0)
        else:
            before = np.searchsorted(self._times, time - TIME_TOLERANCE)
            sample = min(int(before), len(self._times) - 1)
        return self._order.index(sample)

    def clip_time(self, time: float) -> float:
        """Return the time since the clip's start, s. In a backward clip, states after
        the last sample are at 0.
        """
        samples = time / self._step
        if self._is_backward:
            samples = max(len(self._times) - 1 - samples, 0.0)
        return samples / self._fps


class Events(Writer):
    """Writes `events.json`."""

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
    # Empty fields are left out below, so that readers can test for a key.
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
