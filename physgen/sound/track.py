"""The sound track of a clip: stereo samples of its contacts, with captions."""

from __future__ import annotations

import io
import wave
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from html import escape

import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F64
from physgen.compile.world import World
from physgen.export.events import ClipTimes, Event, collisions
from physgen.export.labels import Clip
from physgen.scene.scene import Motion, Play, Solid, SoundLevel, View
from physgen.simulate.moving_tables import MovingTable
from physgen.simulate.trajectory import Trajectory
from physgen.sound.friction import TUNING as FRICTION
from physgen.sound.friction import Rubbing, friction_noise
from physgen.sound.impact import contact_time, pair_mass
from physgen.sound.resonators import Resonator, world_resonators
from physgen.sound.synthesis import RATE, Strike, add_room, click, pan, ring

I16 = NDArray[np.int16]

PEAK = 10 ** (-3 / 20)
"""Peak of the loudest event over full scale: -3 dBFS."""
FULL_SCALE = 6.3
"""Pressure at full scale for `level: fixed`, Pa: 110 dB at 1 m."""
FRICTION_RATE = 120.0
"""Samples of the motion for sliding and rolling, 1/s."""
MAX_LOAD = 4.0
"""Maximum load of a contact, in weights of the body. Higher loads are impacts with
their own sound.
"""
TOUCH_DELAY = 0.03
TOUCH_LENGTH = 0.08
"""Interval after an impact for a damping touch, s: the touch must start before
TOUCH_DELAY and end after TOUCH_LENGTH.
"""
MAX_CUES = 400
"""Maximum number of captions of a clip, the loudest impacts."""
LONGEST = 300.0
"""Maximum duration of a clip with sound, s. All samples are in memory, 2 MB a
second.
"""
CUE_LENGTH = 0.6
"""Duration of a caption, s."""


@dataclass(frozen=True)
class Caption:
    """One impact in words."""

    time: float
    """s of the clip."""
    text: str
    impulse: float
    """N·s."""


@dataclass(frozen=True)
class SoundTrack:
    """The sound of a clip."""

    samples: I16
    """(N, 2): left and right, RATE samples/s."""
    captions: tuple[Caption, ...]
    """Sorted by time."""

    def add_silence(self, seconds: float) -> SoundTrack:
        """Return the track after a silence, for the time of the held photo."""
        if not seconds:
            return self
        silence = np.zeros((round(seconds * RATE), 2), np.int16)
        captions = []
        for caption in self.captions:
            captions.append(replace(caption, time=caption.time + seconds))
        return SoundTrack(np.concatenate([silence, self.samples]), tuple(captions))

    def wav(self) -> bytes:
        """Return the samples as a WAV file, 16 bits, stereo."""
        buffer = io.BytesIO()
        with wave.open(buffer, "wb") as file:
            file.setnchannels(2)
            file.setsampwidth(2)
            file.setframerate(RATE)
            file.writeframes(self.samples.astype("<i2").tobytes())
        return buffer.getvalue()

    def vtt(self) -> str:
        """Return the captions as WebVTT."""
        cues = ["WEBVTT\n"]
        for caption in self.captions:
            begin = _timestamp(caption.time)
            end = _timestamp(caption.time + CUE_LENGTH)
            text = escape(" ".join(caption.text.split()), quote=False)
            cues.append(f"{begin} --> {end}\n{text}\n")
        return "\n".join(cues)


def _timestamp(seconds: float) -> str:
    milliseconds = round(seconds * 1000)
    minutes, rest = divmod(milliseconds, 60_000)
    hours, minutes = divmod(minutes, 60)
    return f"{hours:02d}:{minutes:02d}:{rest // 1000:02d}.{rest % 1000:03d}"


def sound_track(clip: Clip, level: SoundLevel) -> SoundTrack | None:
    """Return the sound of a clip.

    Return None for a backward or silent clip, for one frame, and for more than
    `LONGEST` s.
    """
    has_motion = clip.count > 1 and len(clip.world.bodies) > 0
    if not has_motion or clip.scene.render.play is Play.BACKWARD:
        return None
    if clip.count / clip.fps > LONGEST:
        return None
    count = round(clip.count / clip.fps * RATE)
    times = ClipTimes(clip)
    impacts = collisions(clip)
    resonators = world_resonators(clip.scene, clip.world)
    strikes = []
    for event in impacts:
        strikes += event_strikes(clip, resonators, event, times)
    pressure = ring(resonators, strikes, count) + click(resonators, strikes, count)
    pressure += friction_noise(rubbings(clip, times), count)
    samples = _as_samples(add_room(pressure), level)
    if samples is None:
        return None
    return SoundTrack(samples, _captions(clip, impacts, times))


def _as_samples(pressure: F64, level: SoundLevel) -> I16 | None:
    """Return 16-bit samples of Pa, or None if all samples are silent."""
    peak = float(np.abs(pressure).max(initial=0.0))
    if peak <= 0:
        return None
    if level is SoundLevel.PEAK:
        scale = PEAK / peak
    else:
        scale = 1 / FULL_SCALE
    codes = np.round(np.clip(pressure * scale, -1, 1) * np.iinfo(np.int16).max)
    if not codes.any():
        return None
    return codes.astype(np.int16)


def event_strikes(
    clip: Clip, resonators: Sequence[Resonator], event: Event, times: ClipTimes
) -> list[Strike]:
    """Return the strikes of both partners of a collision."""
    world = clip.world
    sides = [resonators[k].surface for k in event.surfaces]
    speed = (event.closing or 0.0) / world.pixels_per_meter
    impulse = _newton_seconds(clip, event)
    # Bodies under pressure from others have no closing speed, but an impulse.
    speed = max(speed, impulse / (2 * pair_mass(sides[0], sides[1])))
    duration = contact_time(sides[0], sides[1], speed)
    place = clip.shot.affine(event.time) @ (*event.place, 1.0)
    polarity = 1.0
    if event.vector is not None and event.vector[1] < 0:
        polarity = -1.0
    gains = pan(float(place[0]) / clip.size[0])
    strikes = []
    for surface in event.surfaces:
        strike = Strike(
            time=times.clip_time(event.time),
            resonator=surface,
            impulse=impulse,
            contact_time=duration,
            gains=gains,
            has_contact=_has_contact(world, clip.trajectory, surface, event),
            polarity=polarity,
        )
        strikes.append(strike)
    return strikes


def _newton_seconds(clip: Clip, event: Event) -> float:
    """Return the impulse of a collision, N·s. An assumed scale counts as a
    known one.
    """
    return (event.impulse or 0.0) / 1000 / clip.world.pixels_per_meter


def _has_contact(
    world: World, trajectory: Trajectory, surface: int, event: Event
) -> bool:
    """Return whether another contact touches a surface during and after the impact."""
    if surface >= len(world.bodies):
        return False
    # Seen from above, every body lies on the table.
    if world.view is View.TOP:
        return True
    contacts = trajectory.contacts
    first, second = contacts.touch_pairs.T
    begin, end = contacts.touch_times.T
    is_own = (first == surface) | (second == surface)
    is_lasting = (begin <= event.time + TOUCH_DELAY) & (
        end >= event.time + TOUCH_LENGTH
    )
    return bool((is_own & is_lasting).any())


def rubbings(clip: Clip, times: ClipTimes) -> list[Rubbing]:
    """Return sliding and rolling of all pairs; in a view from above, with the
    table's.
    """
    world = clip.world
    count = max(int(world.duration * FRICTION_RATE), 2)
    moments = np.linspace(0.0, world.duration, count + 1)
    motion = clip.trajectory.resample(moments)
    clip_times = np.array([times.clip_time(float(time)) for time in moments])
    result = _pair_rubbings(clip, motion, clip_times)
    if world.view is View.TOP and world.press > 0:
        result += _table_rubbings(clip, motion, clip_times)
    return result


def _places(clip: Clip, motion: Trajectory, body: int) -> F64:
    """Return (T,) positions of a body from the left border (0) to the right
    border (1).
    """
    centers = motion.poses[:, body, :2]
    if not clip.shot.moves:
        scale, _, shift = clip.shot.affine(0.0)[0].tolist()
        return np.asarray((centers[:, 0] * scale + shift) / clip.size[0])
    places = []
    for time, center in zip(motion.times.tolist(), centers.tolist(), strict=True):
        lens = clip.shot.affine(time)
        places.append(float(lens[0] @ (*center, 1.0)) / clip.size[0])
    return np.array(places)


def _table_rubbings(clip: Clip, motion: Trajectory, clip_times: F64) -> list[Rubbing]:
    """Return rolling and sliding of all bodies on the table, in a view from above."""
    world = clip.world
    meters = 1 / world.pixels_per_meter
    velocities = motion.velocities[:, :, :2] - _table_velocities(world, motion)
    result = []
    for k, body in enumerate(world.bodies):
        speed = np.hypot(*velocities[:, k].T) * meters
        if body.motion is not Motion.DYNAMIC or not speed.any():
            continue
        load = body.mass / 1000 * world.press * meters
        if body.solid is Solid.SPHERE:
            power = FRICTION.rolling_efficiency * body.rolling * load * speed
        else:
            friction = body.surface.friction * world.table.friction
            power = FRICTION.sliding_efficiency * friction * load * speed
        result.append(Rubbing(clip_times, power, speed, _places(clip, motion, k)))
    return result


def _table_velocities(world: World, motion: Trajectory) -> F64:
    """Return (T, N, 2) px/s of belts and turntables below the bodies."""
    table = MovingTable(world)
    rows = []
    for places in motion.poses[:, :, :2]:
        rows.append(table.velocities(places)[:, :2])
    return np.array(rows)


def _pair_rubbings(clip: Clip, motion: Trajectory, clip_times: F64) -> list[Rubbing]:
    """Return sliding and rolling of all pairs with contacts."""
    rows = motion.contacts.impulse_rows
    if not len(rows):
        return []
    count = len(motion.contacts.surfaces)
    codes = rows[:, 1].astype(np.int64) * count + rows[:, 2]
    result = []
    for code in np.unique(codes).tolist():
        members = np.flatnonzero(codes == code)
        result.append(_pair_rubbing(clip, motion, clip_times, members))
    return result


def _pair_rubbing(
    clip: Clip, motion: Trajectory, clip_times: F64, members: NDArray[np.intp]
) -> Rubbing:
    """Return the friction of one pair; `members` are its rows of impulses."""
    world = clip.world
    meters = 1 / world.pixels_per_meter
    rows = motion.contacts.impulse_rows[members]
    samples = rows[:, 0]
    pair = (int(rows[0, 1]), int(rows[0, 2]))
    impulses = motion.contacts.impulses[members]
    sizes = np.hypot(*impulses.T)
    forces = sizes / (motion.times[1] - motion.times[0])
    load = np.minimum(forces, _max_load(world, pair)) * meters / 1000
    # A vehicle rolls on its wheels: its surface does not slide over the road.
    slip = np.zeros(len(samples))
    if not any(map(partial(_has_wheels, world), pair)):
        normals = impulses / np.maximum(sizes, 1e-300)[:, None]
        slip = np.abs(_slip_speeds(world, motion, samples, pair, normals)) * meters
    relative = _center_velocities(world, motion, samples, pair[0])
    relative = relative - _center_velocities(world, motion, samples, pair[1])
    center_speed = np.hypot(*relative.T) * meters
    power = np.zeros(len(motion.times))
    speed = np.zeros(len(motion.times))
    power[samples] = _friction_power(world, pair, load, slip, center_speed)
    speed[samples] = np.maximum(slip, center_speed)
    return Rubbing(clip_times, power, speed, _places(clip, motion, _mover(world, pair)))


def _has_wheels(world: World, k: int) -> bool:
    """Return whether a surface is a body with wheels."""
    return k < len(world.bodies) and bool(world.bodies[k].wheels)


def _friction_power(
    world: World, pair: tuple[int, int], load: F64, slip: F64, center_speed: F64
) -> F64:
    """Return the power of sliding and rolling that becomes sound, (K,) W.

    `load` N; `slip` and `center_speed` m/s.
    """
    surfaces = [surface for _, surface in world.surfaces]
    friction = surfaces[pair[0]].friction * surfaces[pair[1]].friction
    sliding_power = FRICTION.sliding_efficiency * friction * load * slip
    rolling = _rolling(world, pair)
    rolling_power = FRICTION.rolling_efficiency * rolling * load * center_speed
    return np.asarray(sliding_power + rolling_power)


def _center_velocities(
    world: World, motion: Trajectory, samples: NDArray[np.int32], k: int
) -> F64:
    """Return (K, 2) px/s of a surface's centre. Scenery rests."""
    if k >= len(world.bodies):
        return np.zeros((len(samples), 2))
    return np.asarray(motion.velocities[samples, k, :2])


def _rolling(world: World, pair: tuple[int, int]) -> float:
    """Return the rolling resistance of the rolling partner, or 0 without one."""
    values = [0.0]
    for k in pair:
        if k < len(world.bodies):
            body = world.bodies[k]
            if body.radius is not None or body.wheels:
                values.append(body.rolling)
    return max(values)


def _mover(world: World, pair: tuple[int, int]) -> int:
    """Return the lighter body of a pair. It moves, and the sound comes from its
    position.
    """
    bodies = [k for k in pair if k < len(world.bodies)]
    dynamic = [k for k in bodies if world.bodies[k].motion is Motion.DYNAMIC]
    return min(dynamic or bodies, key=lambda k: world.bodies[k].mass)


def _max_load(world: World, pair: tuple[int, int]) -> float:
    """Return the maximum load of a contact of two surfaces, g·px/s²."""
    masses = []
    for k in pair:
        if k < len(world.bodies) and world.bodies[k].motion is Motion.DYNAMIC:
            masses.append(world.bodies[k].mass)
    gravity = max(float(np.hypot(*world.gravity)), world.press)
    return MAX_LOAD * gravity * min(masses, default=0.0)


def _slip_speeds(
    world: World,
    motion: Trajectory,
    samples: NDArray[np.int32],
    pair: tuple[int, int],
    normals: F64,
) -> F64:
    """Return (K,) px/s of the two surfaces along each other; normals (K, 2) point to
    the first.
    """
    tangents = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
    surfaces = [surface for _, surface in world.surfaces]
    # A conveyor runs clockwise around each of the two surfaces.
    belts = surfaces[pair[0]].conveyor + surfaces[pair[1]].conveyor
    speeds = np.full(len(samples), -belts)
    for k, sign in zip(pair, (1.0, -1.0), strict=True):
        if k >= len(world.bodies):
            continue
        x, y, spin = motion.velocities[samples, k].T
        along = x * tangents[:, 0] + y * tangents[:, 1]
        # The rim is on the partner's side: along the normal for the second body.
        rim_speed = -sign * spin * _rim(world, k)
        speeds += sign * (along + rim_speed)
    return speeds


def _rim(world: World, k: int) -> float:
    """Return the distance (px) from a body's centre to its resting faces."""
    body = world.bodies[k]
    if body.radius is not None:
        return body.radius
    return min(body.reach, body.size / 2)


def _captions(
    clip: Clip, impacts: Sequence[Event], times: ClipTimes
) -> tuple[Caption, ...]:
    """Return the loudest impacts in words, sorted by time."""
    names = _spoken_names(clip)
    captions = []
    for event in impacts:
        first, second = (names[k] for k in event.surfaces)
        impulse = _newton_seconds(clip, event)
        text = f"{first} hits {second}"
        captions.append(Caption(times.clip_time(event.time), text, impulse))
    captions.sort(key=lambda caption: -caption.impulse)
    return tuple(sorted(captions[:MAX_CUES], key=lambda caption: caption.time))


def _spoken_names(clip: Clip) -> list[str]:
    """Return the names of all surfaces: labels, or names for objects with a common
    label.
    """
    counts = Counter(clip.labels)
    names = []
    for name, label in zip(clip.names, clip.labels, strict=True):
        names.append(label if counts[label] == 1 else name)
    names += [wall.name for wall in clip.world.walls]
    return names
