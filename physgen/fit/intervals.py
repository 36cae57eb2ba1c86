"""Intervals of fitted numbers, and directions that a clip does not determine.

Intervals follow the profile of the likelihood: one parameter moves, and the others follow
along the line of the least cost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physgen.arrays import F64
from physgen.fit.parameters import Parameter, with_values
from physgen.fit.residuals import MAD, RESIDUALS, Model, robust_cost
from physgen.scene.scene import Scene


@dataclass(frozen=True)
class IntervalTuning:
    """Limits of intervals."""

    quantile: float = 1.645
    """Half of an interval of 90 % of the normal distribution, in standard deviations."""
    max_width: float = 0.5
    """Standard deviation of a determined value, as a share of the prior's, at most."""
    reach_factor: float = 1.6
    """Correction of an interval's end up to which the search ends."""
    searches: int = 2
    """Searches for an interval's end, at most."""
    max_correlation: float = 0.9
    """Correlation of neighbouring residuals, at most."""
    least_pairs: int = 3
    """Pairs of neighbouring residuals for a correlation, at least."""
    named_share: float = 0.35
    """Component of a flat direction from which its parameter is named."""


INTERVAL = IntervalTuning()


@dataclass(frozen=True)
class Estimate:
    """One fitted number with its interval of 90 %, in the scene's units; angles in rad."""

    parameter: Parameter
    value: float
    low: float
    high: float
    is_determined: bool


@dataclass(frozen=True)
class Fit:
    """The results of a fit."""

    scene: Scene
    """The scene with all determined estimates."""
    estimates: tuple[Estimate, ...]
    flat_directions: tuple[str, ...]
    """Values and combinations without an interval, in words."""
    poses: F64
    """(T, N, 3): simulated, at the times of the tracks."""
    residuals: F64
    """(T, N, 3) px: observed minus simulated, the angle at the radius of gyration."""
    noise: float
    """Standard deviation of residuals, px."""
    simulations: int


def fit_with_intervals(model: Model, numbers: F64) -> Fit:
    """Return the fit of the best numbers (P,), with the interval of each number."""
    total = len(model.tracks.times)
    _adapt_noise(model, numbers)
    slopes = model.jacobian(numbers, total, range(len(numbers)))
    # Residuals are in standard deviations, so that no further scale is needed.
    covariance: F64 = np.linalg.pinv(slopes.T @ slopes).astype(np.float64)
    poses = model.poses(numbers, model.tracks.times)
    differences = model.differences(poses)
    inflation = _correlation_inflation(differences / model.deviations(total))
    widths = np.sqrt(np.diag(covariance)) * inflation
    is_determined = widths < INTERVAL.max_width * model.spread
    cost = robust_cost(model.residuals(numbers, total))
    estimates, determined_parameters = [], []
    for k, parameter in enumerate(model.parameters):
        interval = None
        if is_determined[k]:
            determined_parameters.append(parameter)
            # The linear width is only a start: the profile follows the true cost.
            profile = Profile(model, numbers, k, slopes, cost, inflation)
            interval = profile.interval(widths[k])
        estimates.append(_estimate(parameter, float(numbers[k]), interval))
    return Fit(
        scene=with_values(
            model.scene, determined_parameters, numbers[is_determined], model.starts
        ),
        estimates=tuple(estimates),
        flat_directions=name_flat_directions(
            model.parameters, covariance, model.spread
        ),
        poses=poses,
        residuals=differences,
        noise=model.noise,
        simulations=model.simulations,
    )


def _estimate(
    parameter: Parameter, number: float, interval: tuple[float, float] | None = None
) -> Estimate:
    """Return the estimate of a parameter; its interval is None if undetermined."""
    low, high = number, number
    if interval is not None:
        low, high = interval
    return Estimate(
        parameter=parameter,
        value=parameter.value(number),
        low=parameter.value(low),
        high=parameter.value(high),
        is_determined=interval is not None,
    )


def _adapt_noise(model: Model, numbers: F64) -> None:
    """Scale the noise of a model by the residuals of its fit."""
    residuals = model.residuals(numbers, len(model.tracks.times))
    observed_residuals = residuals[: len(residuals) - len(numbers)]
    factor = _residual_deviation(observed_residuals, len(numbers))
    model.noise = max(model.noise * factor, RESIDUALS.min_noise)
    # Errors by steps are measured, so that small residuals do not reduce them.
    model.step_errors *= max(factor, 1.0)


def _residual_deviation(residuals: F64, parameter_count: int) -> float:
    """Return the standard deviation of residuals of a fit, without outliers.

    The result is the larger of two estimates, since an interval should rather be too wide.
    """
    if not len(residuals):
        return 1.0
    median = MAD * float(np.median(np.abs(residuals)))
    limit = RESIDUALS.outlier * max(median, 1e-9)
    inliers = residuals[np.abs(residuals) < limit]
    if len(inliers):
        root = float(np.sqrt((inliers**2).mean()))
    else:
        root = median
    # Each fitted number removes one residual's worth of noise.
    freedom = max(len(residuals) - parameter_count, 1)
    return max(median, root) * float(np.sqrt(len(residuals) / freedom))


def _correlation_inflation(residuals: F64) -> float:
    """Return the factor of all widths by the correlation of neighbouring frames.

    Least squares assumes independent residuals (T, N, 3); those of a film are similar in
    neighbouring frames, so that a film contains less information.
    """
    before = residuals[:-1]
    after = residuals[1:]
    observed = np.isfinite(before) & np.isfinite(after)
    if observed.sum() < INTERVAL.least_pairs:
        return 1.0
    power = float((before[observed] ** 2).mean() + (after[observed] ** 2).mean()) / 2
    product = float((before[observed] * after[observed]).mean())
    correlation = product / max(power, 1e-12)
    correlation = min(max(correlation, 0.0), INTERVAL.max_correlation)
    # The factor of an autoregressive process of first order.
    return float(np.sqrt((1 + correlation) / (1 - correlation)))


@dataclass(frozen=True)
class Profile:
    """The least cost for other values of one parameter; the other parameters follow."""

    model: Model
    numbers: F64
    """The best numbers (P,)."""
    column: int
    """Index of the parameter."""
    slopes: F64
    """(R + P, P): derivatives of residuals at the best numbers."""
    cost: float
    inflation: float

    def interval(self, width: float) -> tuple[float, float]:
        """Return both ends of the interval; `width` as in `distance`."""
        number = self.numbers[self.column]
        low = float(number - self.distance(-1.0, width))
        high = float(number + self.distance(1.0, width))
        return low, high

    def distance(self, side: float, width: float) -> float:
        """Return the distance from the best number to one end of the interval.

        `side` is -1 or 1; `width` is the standard deviation of a linear model.
        """
        # A sum of squares rises by z² at z standard deviations.
        target = (INTERVAL.quantile * self.inflation) ** 2
        reach = INTERVAL.quantile * width
        for _ in range(INTERVAL.searches):
            rise = self._cost_rise(side * reach)
            # The cost rises nearly as a square.
            factor = (target / max(rise, target / 9)) ** 0.5
            reach *= min(max(factor, 0.5), 2.0)
            if 1 / INTERVAL.reach_factor < factor < INTERVAL.reach_factor:
                break
        return float(reach)

    def _cost_rise(self, change: float) -> float:
        """Return the rise of the least cost for a change of the parameter."""
        count = len(self.model.tracks.times)
        others = np.arange(len(self.numbers)) != self.column
        slopes = self.slopes[:, others]
        numbers = self.numbers.copy()
        numbers[self.column] += change
        # The slopes at the best numbers predict the other numbers. A second step with
        # simulated residuals corrects the prediction.
        residuals = self.slopes[:, self.column] * change
        costs = []
        for _ in range(2):
            step = np.linalg.lstsq(slopes, -residuals, rcond=None)[0]
            numbers[others] += step
            residuals = self.model.residuals(numbers, count)
            costs.append(robust_cost(residuals))
        return min(costs) - self.cost


def name_flat_directions(
    parameters: Sequence[Parameter], covariance: F64, spread: F64
) -> tuple[str, ...]:
    """Return the single parameters and combinations that data do not determine."""
    if not len(parameters):
        return ()
    # In units of the priors, all parameters are comparable.
    scaled_covariance = covariance / np.outer(spread, spread)
    variances, directions = np.linalg.eigh(scaled_covariance)
    sentences = []
    for k in np.argsort(-variances).tolist():
        # Variances fall in this order: all further directions are determined.
        if variances[k] < INTERVAL.max_width**2:
            break
        sentences.append(_direction_text(parameters, directions[:, k]))
    return tuple(dict.fromkeys(sentences))


def _direction_text(parameters: Sequence[Parameter], direction: F64) -> str:
    """Return a direction (P,) of parameters in words."""
    names: list[str] = []
    components: list[float] = []
    for j in np.argsort(-np.abs(direction)).tolist():
        if abs(direction[j]) > INTERVAL.named_share:
            names.append(parameters[j].path)
            components.append(float(direction[j]))
    if len(names) == 1:
        return names[0]
    if len(names) == 2 and components[0] * components[1] < 0:
        return f"{names[0]} against {names[1]}: only their combination"
    return f"{', '.join(names)}: only combinations of them"
