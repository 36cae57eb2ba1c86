"""Estimate the motion at t = 0 from the first frames of tracks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physgen.arrays import F64, Mask
from physgen.compile.compile import CompiledScene
from physgen.compile.world import Body
from physgen.fit.parameters import Kind, Starts
from physgen.fit.residuals import RESIDUALS, track_noise
from physgen.fit.tracks import Tracks


@dataclass(frozen=True)
class StartTuning:
    """Limits of the first estimate of velocities."""

    duration: float = 0.2
    """Time in which velocities at the start are estimated, s."""
    moving: float = 4.0
    """Velocity of a moving object, in standard errors, at least."""


START = StartTuning()
FIRST_FRAMES = 3
"""Frames after the first one that are used in any case, however slow the film is."""


def estimate_starts(
    compiled_scene: CompiledScene, tracks: Tracks, kinds: Sequence[Kind]
) -> Starts:
    """Return velocities at t = 0 from the first frames, and the moving objects."""
    bodies = compiled_scene.world.bodies
    index = min(FIRST_FRAMES, len(tracks.times) - 1)
    duration = max(START.duration, tracks.times[index])
    is_early = (tracks.times > 0) & (tracks.times <= duration)
    velocities = np.zeros((len(bodies), 3))
    moves, spins, supported_axes = [], [], []
    for k, body in enumerate(bodies):
        is_supported = find_supported_axes(compiled_scene, tracks, is_early, k)
        offsets = tracks.poses[is_early, k] - np.array([*body.center.tolist(), 0.0])
        velocity, is_moving = _estimate_velocity(
            tracks.times[is_early], offsets, _pose_errors(body), (*is_supported, False)
        )
        # Velocities of an object at rest are noise.
        if is_moving:
            velocities[k] = velocity
        moves.append(is_moving)
        supported_axes.append(is_supported)
        angle_share = np.isfinite(tracks.poses[:, k, 2]).mean()
        spins.append(bool(angle_share > 0.5))
    return Starts(
        velocities=velocities,
        moves=tuple(moves),
        spins=tuple(spins),
        rolls=tuple(body.radius is not None for body in bodies),
        supported_axes=tuple(supported_axes),
        observations=_observed_starts(tracks.poses[is_early], spins, kinds),
    )


def _pose_errors(body: Body) -> F64:
    """Return the standard deviations of x, y (px) and angle (rad) of a tracked body."""
    noise = RESIDUALS.default_noise
    gyration = (body.moment / body.mass) ** 0.5
    return np.array([noise, noise, noise / max(gyration, 1.0)])


def _estimate_velocity(
    times: F64, offsets: F64, errors: F64, is_supported: Sequence[bool]
) -> tuple[F64, bool]:
    """Return the velocity (3,) of one object, and whether the object moves.

    `offsets` (T, 3) are the changes of its pose since t = 0, `errors` (3,) their standard
    deviations. Components within their error are 0.
    """
    velocity = np.zeros(3)
    is_moving = False
    for axis in range(3):
        observed = np.isfinite(offsets[:, axis])
        if is_supported[axis] or not observed.any():
            continue
        # Least squares of a line through the pose at t = 0, known from the scene.
        observed_times = times[observed]
        weight = float((observed_times**2).sum())
        product = float((observed_times * offsets[observed, axis]).sum())
        component = product / weight
        # The error of the slope is that of a coordinate over the root of the summed
        # squares of the times.
        if abs(component) > START.moving * errors[axis] / weight**0.5:
            velocity[axis] = component
            is_moving = True
    return velocity, is_moving


def find_supported_axes(
    compiled_scene: CompiledScene, tracks: Tracks, is_early: Mask, k: int
) -> tuple[bool, bool]:
    """Return whether an object rests in x and in y although gravity pulls it.

    Such an object has a support. Otherwise a hop within the noise could explain a motion
    without friction.
    """
    body = compiled_scene.world.bodies[k]
    gravity = compiled_scene.world.gravity
    limit = START.moving * track_noise(tracks)
    is_supported = []
    for axis in (0, 1):
        offsets = tracks.poses[is_early, k, axis] - body.center[axis]
        observed = np.isfinite(offsets)
        time = float(tracks.times[is_early][observed].max(initial=0.0))
        # A throw that returns after this time rises by g t^2 / 8.
        would_fall = abs(gravity[axis]) * time**2 / 8 > limit
        rests = bool((np.abs(offsets[observed]) < limit).all())
        is_supported.append(bool(would_fall) and rests)
    return is_supported[0], is_supported[1]


def _observed_starts(
    poses: F64, spins: Sequence[bool], kinds: Sequence[Kind]
) -> tuple[tuple[bool, bool], ...]:
    """Return whether early poses (T, N, 3) replace velocity and spin of each object."""
    result = []
    for k, has_angles in enumerate(spins):
        is_visible = bool(np.isfinite(poses[:, k, 0]).any())
        has_velocity = is_visible and Kind.VELOCITY in kinds
        has_spin = is_visible and has_angles and Kind.SPIN in kinds
        result.append((has_velocity, has_spin))
    return tuple(result)
