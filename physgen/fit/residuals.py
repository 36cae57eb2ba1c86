"""Residuals of a simulated motion against tracks, in standard deviations.

After a few impacts a motion depends on the steps of its simulation. The difference between
two step lengths is noise, too, so that frames after impacts count less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from physgen.arrays import F64
from physgen.compile.compile import CompiledScene, compile_shapes
from physgen.fit.parameters import Parameter, Starts, with_values
from physgen.fit.tracks import Tracks
from physgen.problems import InputError
from physgen.scene.scene import Scene
from physgen.simulate.engine import simulate


@dataclass(frozen=True)
class ResidualTuning:
    """Noise of tracks and of simulations."""

    default_noise: float = 0.5
    """Standard deviation of a coordinate in tracks that are too short to measure it, px."""
    min_noise: float = 0.1
    """Noise of tracks, px, at least: followed objects have equal errors in many frames."""
    step_noise: float = 1.0
    """Error of a motion, as a share of its change by shorter steps."""
    step_factor: float = 2.0
    """Number of steps of the compared simulation, as a multiple."""
    max_step_noise: float = 20.0
    """Error of a motion by its steps, px, at most."""
    trial_rate: float = 240.0
    """Steps of trial simulations, 1/s."""
    outlier: float = 3.0
    """Residual from which the weight falls, in standard deviations."""
    good_cost: float = 1.25
    """Mean cost of a residual of a good fit, at most."""
    passable_cost: float = 2.5
    """The same before all times are fitted: later times show a wrong valley clearly."""
    max_excuse: float = 2.0
    """Errors by steps that excuse residuals, as a multiple of the tracks' noise, at most."""
    failure: float = 1e3
    """Residual of a motion that cannot be simulated."""


RESIDUALS = ResidualTuning()
MAD = 1.4826
"""Standard deviation of normal noise, as a multiple of its median absolute value."""
THIRD_DIFFERENCE = 20**0.5
"""Standard deviation of third differences of noise, as a multiple of the noise's own."""


def track_noise(tracks: Tracks) -> float:
    """Return the noise of coordinates, px, from third differences over time.

    Third differences of an even acceleration are zero, and impacts are few.
    """
    differences = np.diff(tracks.poses[..., :2], n=3, axis=0)
    sizes = np.abs(differences[np.isfinite(differences)])
    if not len(sizes):
        return RESIDUALS.default_noise
    deviation = MAD * float(np.median(sizes)) / THIRD_DIFFERENCE
    return max(deviation, RESIDUALS.min_noise)


def robust_cost(residuals: F64) -> float:
    """Return twice the robust cost (soft L1) of residuals, near their sum of squares."""
    scale = RESIDUALS.outlier**2
    # Nearly quadratic for small residuals, and linear for large ones: an outlier pulls
    # little.
    parts = 2 * scale * (np.sqrt(1 + residuals**2 / scale) - 1)
    return float(parts.sum())


class Model:
    """Residuals of a scene's motion as a function of parameters.

    `numbers` (P,) are the values of all parameters on their transformed scales.
    """

    def __init__(
        self,
        scene: Scene,
        compiled_scene: CompiledScene,
        tracks: Tracks,
        starts: Starts,
        parameters: Sequence[Parameter],
    ) -> None:
        self.scene, self.compiled_scene = scene, compiled_scene
        self.tracks, self.starts = tracks, starts
        self.parameters = tuple(parameters)
        self.noise = track_noise(tracks)
        self.step_errors = np.zeros_like(tracks.poses)
        """(T, N, 3) px: errors of simulated poses by their steps."""
        self.rate = min(RESIDUALS.trial_rate, compiled_scene.world.steps_per_second)
        self.simulations = 0
        # Least squares asks for the residuals of one point several times.
        self._recent: tuple[bytes, F64] = (b"", np.empty(0))
        bodies = compiled_scene.world.bodies
        self.gyration = np.array([(b.moment / b.mass) ** 0.5 for b in bodies])
        self.prior = np.array([parameter.start for parameter in self.parameters])
        self.spread = np.array([parameter.spread for parameter in self.parameters])

    def scene_with(self, numbers: F64) -> Scene:
        """Return the scene with these numbers."""
        return with_values(self.scene, self.parameters, numbers, self.starts)

    def poses(self, numbers: F64, times: F64) -> F64:
        """Return simulated poses (T, N, 3). Raises InputError."""
        self.simulations += 1
        scene = self.scene_with(numbers)
        world = compile_shapes(scene, self.compiled_scene.shapes).world
        # A little more time than the last sample, so that rounding does not cut it off.
        duration = float(times[-1]) + 1e-6
        world = replace(world, steps_per_second=self.rate, duration=duration)
        # A simulation starts at 0, tracks may start later.
        if times[0] == 0.0:
            sample_times = times
        else:
            sample_times = np.concatenate([[0.0], times])
        poses = simulate(world, sample_times).poses
        return poses[len(sample_times) - len(times) :]

    def measure_steps(self, numbers: F64, count: int) -> None:
        """Measure the errors by steps in the first `count` times."""
        times = self.tracks.times[:count]
        rate = self.rate
        try:
            poses = self.poses(numbers, times)
            self.rate = RESIDUALS.step_factor * rate
            change = np.abs(self.poses(numbers, times) - poses)
        except InputError:
            return
        finally:
            self.rate = rate
        change[..., 2] *= self.gyration
        # An error lasts: the motion after it is another one.
        change = np.maximum.accumulate(RESIDUALS.step_noise * change, axis=0)
        # An error of one coordinate soon becomes an error of the others.
        largest = change.max(axis=2, keepdims=True)
        self.step_errors[:count] = np.minimum(largest, RESIDUALS.max_step_noise)
        self.step_errors[count:] = self.step_errors[count - 1]
        self._recent = (b"", np.empty(0))

    def deviations(self, count: int) -> F64:
        """Return the standard deviations (count, N, 3) of residuals, px."""
        return np.hypot(self.noise, self.step_errors[:count])

    def differences(self, poses: F64) -> F64:
        """Return observed minus simulated poses (T, N, 3), px; NaN without observation.

        Angles count as shifts at the radius of gyration.
        """
        differences = self.tracks.poses[: len(poses)] - poses
        differences[..., 2] *= self.gyration
        return differences

    def residuals(self, numbers: F64, count: int) -> F64:
        """Return residuals (R + P,) of the first `count` times and of the priors.

        Their unit is the standard deviation.
        """
        # The residuals depend on the numbers, the times, the step and the noise.
        settings = str((count, self.rate, self.noise))
        key = numbers.tobytes() + bytes(settings, "ascii")
        if self._recent[0] != key:
            self._recent = (key, self._compute_residuals(numbers, count))
        return self._recent[1]

    def _compute_residuals(self, numbers: F64, count: int) -> F64:
        """Simulate a motion and return its residuals, as `residuals`."""
        observed = np.isfinite(self.tracks.poses[:count])
        prior = (numbers - self.prior) / self.spread
        try:
            poses = self.poses(numbers, self.tracks.times[:count])
        except InputError:
            # The search leaves numbers with a motion that cannot be simulated.
            failures = np.full(int(observed.sum()), RESIDUALS.failure)
            return np.concatenate([failures, prior])
        scaled_differences = self.differences(poses) / self.deviations(count)
        return np.concatenate([scaled_differences[observed], prior])

    def has_good_residuals(self, numbers: F64, count: int) -> bool:
        """Return whether residuals are as small as the noise of the tracks.

        A wrong motion may be chaotic: its large errors by steps do not excuse it.
        """
        residuals = self.residuals(numbers, count).copy()
        observation_count = len(residuals) - len(numbers)
        # Residuals count in units of noise with limited step errors here.
        largest_excuse = RESIDUALS.max_excuse * self.noise
        limits = np.minimum(self.step_errors[:count], largest_excuse)
        factors = self.deviations(count) / np.hypot(self.noise, limits)
        observed = np.isfinite(self.tracks.poses[:count])
        residuals[:observation_count] *= factors[observed]
        mean_cost = RESIDUALS.passable_cost
        if count == len(self.tracks.times):
            mean_cost = RESIDUALS.good_cost
        return robust_cost(residuals) < mean_cost * observation_count

    def jacobian(
        self, numbers: F64, count: int, columns: Sequence[int], base: F64 | None = None
    ) -> F64:
        """Return difference quotients (R + P, C) of residuals for some parameters.

        They are central, or from the residuals `base` at `numbers` to one side, which
        takes half the simulations.
        """
        slopes = []
        for k in columns:
            step = np.zeros(len(numbers))
            step[k] = self.parameters[k].step
            upper = self.residuals(numbers + step, count)
            if base is None:
                lower = self.residuals(numbers - step, count)
                slopes.append((upper - lower) / (2 * step[k]))
            else:
                slopes.append((upper - base) / step[k])
        return np.array(slopes).T
