"""Search for the parameters of a motion: robust least squares from many starts.

The fitted time grows, since early frames determine velocities before contacts begin. If
residuals at a length exceed the noise, random values of contacts are drawn and the best
draws are refined, because another order of contacts is another valley of the cost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physgen.arrays import F64
from physgen.fit.parameters import Scale
from physgen.fit.residuals import RESIDUALS, Model, robust_cost
from physgen.progress import Progress


@dataclass(frozen=True)
class SearchTuning:
    """Lengths of time, random starts and limits of least squares."""

    horizons: tuple[float, ...] = (0.2, 0.35, 0.55, 0.8, 1.0, 1.0)
    """Shares of the time that are fitted in turn."""
    least_times: int = 4
    """Times in the first fit, at least."""
    draws: int = 8
    """Random starts at each length."""
    refinements: int = 2
    """Number of starts for least squares, the best first."""
    draw_width: float = 0.7
    """Standard deviation of the draws, as a share of the prior's."""
    reset_distance: float = 0.3
    """Distance from the prior, in its widths, from which the prior is tried again."""
    final_rate: float = 480.0
    """Steps of the last fit and of intervals, 1/s, at most the scene's own."""
    trial_steps: int = 8
    """Steps of least squares before the last fit, at most."""
    final_steps: int = 6
    """Steps of the last fit, at most."""
    cost_tolerance: float = 1e-4
    """Share of the cost that the last step of least squares saves."""
    number_tolerance: float = 1e-6
    """Relative change of the numbers in the last step."""
    min_effect: float = 0.05
    """Change of residuals over a prior's width below which a parameter is left out."""


SEARCH = SearchTuning()


@dataclass(frozen=True)
class Solution:
    """Numbers after least squares."""

    numbers: F64
    active_columns: tuple[int, ...]
    """Parameters with an effect on the residuals."""


def find_numbers(model: Model, seed: int, progress: Progress) -> F64:
    """Return the numbers (P,) with the least cost."""
    stage_count = len(SEARCH.horizons) + 2
    progress("fit", 0, stage_count)
    numbers = _search_valleys(model, np.random.default_rng(seed), progress)
    # The last fit has the fine steps of the final simulation.
    total = len(model.tracks.times)
    model.rate = min(SEARCH.final_rate, model.compiled_scene.world.steps_per_second)
    progress("fit", len(SEARCH.horizons), stage_count)
    model.measure_steps(numbers, total)
    numbers = refine(model, numbers, total, SEARCH.final_steps).numbers
    progress("fit", len(SEARCH.horizons) + 1, stage_count)
    model.measure_steps(numbers, total)
    return numbers


def _search_valleys(
    model: Model, generator: np.random.Generator, progress: Progress
) -> F64:
    """Return the best numbers of all starts, with long steps of the simulation."""
    best = model.prior.copy()
    total = len(model.tracks.times)
    # A chaotic motion has one valley for short times and many for long ones: the time
    # grows.
    for k, share in enumerate(SEARCH.horizons):
        progress("fit", k, len(SEARCH.horizons) + 2)
        count = min(max(SEARCH.least_times, round(share * total)), total)
        model.measure_steps(best, count)
        solution = refine(model, best, count, SEARCH.trial_steps)
        best = solution.numbers
        if not model.has_good_residuals(best, count):
            # The errors by steps were those of another motion.
            model.measure_steps(best, count)
        # A good fit of a short time is a start for a longer one.
        if model.has_good_residuals(best, count):
            if count == total:
                break
            continue
        best = _try_other_valleys(model, solution, count, generator)
    return best


def _try_other_valleys(
    model: Model, solution: Solution, count: int, generator: np.random.Generator
) -> F64:
    """Return the best numbers of a solution and of random starts around it."""
    candidates = [solution.numbers]
    for start in draw_starts(model, solution, count, generator):
        candidates.append(refine(model, start, count, SEARCH.trial_steps).numbers)
    costs = []
    for numbers in candidates:
        costs.append(robust_cost(model.residuals(numbers, count)))
    return candidates[int(np.argmin(costs))]


def draw_starts(
    model: Model, solution: Solution, count: int, generator: np.random.Generator
) -> list[F64]:
    """Return the best of random values of contacts, among those with an effect."""
    best = solution.numbers
    is_drawn = np.zeros(len(best), bool)
    is_drawn[list(solution.active_columns)] = True
    # Velocities and gravity have no valleys of their own.
    is_drawn &= [one.scale is not Scale.LINEAR for one in model.parameters]
    if not is_drawn.any():
        return []
    starts = []
    for k in np.flatnonzero(is_drawn).tolist():
        # An earlier valley may have moved a value far away.
        distance = abs(best[k] - model.prior[k])
        if distance > SEARCH.reset_distance * model.spread[k]:
            starts.append(_replace_columns(best, [k], model.prior[[k]]))
    for _ in range(SEARCH.draws):
        draw = generator.normal(size=len(best)) * model.spread * SEARCH.draw_width
        change = np.where(is_drawn, draw, 0.0)
        starts.append(clip_numbers(model, best + change))
    # A simulation is cheap beside a fit: only the best starts are refined.
    costs = [robust_cost(model.residuals(start, count)) for start in starts]
    order = np.argsort(costs, kind="stable")
    return [starts[k] for k in order[: SEARCH.refinements].tolist()]


def clip_numbers(model: Model, numbers: F64) -> F64:
    """Return numbers inside the limits of their parameters."""
    low = np.array([parameter.low for parameter in model.parameters])
    high = np.array([parameter.high for parameter in model.parameters])
    # Least squares refuses a start on a limit.
    margin = 1e-6 * model.spread
    return np.asarray(np.clip(numbers, low + margin, high - margin))


def refine(model: Model, numbers: F64, count: int, max_steps: int) -> Solution:
    """Return numbers after robust least squares over parameters with an effect."""
    # scipy belongs to the extra `fit`.
    from scipy.optimize import least_squares

    numbers = clip_numbers(model, numbers)
    base = model.residuals(numbers, count)
    slopes = model.jacobian(numbers, count, range(len(numbers)), base)
    columns = _active_columns(model, slopes)
    if not columns:
        return Solution(numbers, ())

    def residuals(values: F64) -> F64:
        return model.residuals(_replace_columns(numbers, columns, values), count)

    def jacobian(values: F64) -> F64:
        # The slopes at the start are known already.
        if np.array_equal(values, numbers[columns]):
            return slopes[:, columns]
        new_numbers = _replace_columns(numbers, columns, values)
        new_base = model.residuals(new_numbers, count)
        return model.jacobian(new_numbers, count, columns, new_base)

    active_parameters = [model.parameters[k] for k in columns]
    low = [parameter.low for parameter in active_parameters]
    high = [parameter.high for parameter in active_parameters]
    result = least_squares(
        residuals,
        numbers[columns],
        jacobian,
        bounds=(low, high),
        x_scale=model.spread[columns],
        loss="soft_l1",
        f_scale=RESIDUALS.outlier,
        max_nfev=max_steps,
        ftol=SEARCH.cost_tolerance,
        xtol=SEARCH.number_tolerance,
    )
    values = np.asarray(result.x, np.float64)
    return Solution(_replace_columns(numbers, columns, values), tuple(columns))


def _active_columns(model: Model, slopes: F64) -> list[int]:
    """Return the parameters with an effect on the residuals, by slopes (R + P, P)."""
    count = slopes.shape[1]
    # The last rows belong to the priors.
    observed_slopes = slopes[: len(slopes) - count]
    effect = np.hypot.reduce(observed_slopes, axis=0) * model.spread
    return [k for k in range(count) if effect[k] > SEARCH.min_effect]


def _replace_columns(numbers: F64, columns: Sequence[int], values: F64) -> F64:
    """Return a copy of numbers with other values in some columns."""
    result = numbers.copy()
    result[list(columns)] = values
    return result
