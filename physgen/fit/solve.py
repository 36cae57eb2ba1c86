"""Estimate parameters from tracks: robust least squares on poses, from many starts.

The time that is fitted grows: early frames tell velocities before contacts begin. If
residuals at a length exceed the noise, values of contacts are drawn at random, and the
best draws are refined, because another order of contacts is another valley of the cost.
After a few impacts a motion depends on the steps of its simulation: what two lengths of
steps make of it is noise, too, so that such frames count less. Intervals follow the profile of
the likelihood along the line on which the other parameters move with one of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from physgen.arrays import F64, Mask
from physgen.compile.compile import CompiledScene, compile_shapes
from physgen.fit.parameters import (
    Kind,
    Parameter,
    Scale,
    Starts,
    free_parameters,
    with_values,
)
from physgen.fit.tracks import Tracks
from physgen.messages import Message
from physgen.problems import InputError
from physgen.progress import Progress, silent
from physgen.scene.scene import Scene
from physgen.simulate.engine import simulate


@dataclass(frozen=True)
class FitTuning:
    """Noise, lengths of time, starts and limits of a fit."""

    noise: float = 0.5
    """px, standard deviation of a coordinate, if tracks are too short to tell it."""
    track_noise: float = 0.1
    """px of tracks, at least: followed objects are off by as much in many frames alike."""
    step_noise: float = 1.0
    """Of the change of a motion with shorter steps, that counts as its error."""
    finer: float = 2.0
    """Times as many steps, with which a motion is compared."""
    largest_step_noise: float = 20.0
    """px of that error, at most."""
    good: float = 1.25
    """Cost of a residual up to which no other start is tried."""
    step_limit: float = 2.0
    """Errors of steps, of the tracks' noise, that make a residual good, at most."""
    passable: float = 2.5
    """The same before all times are fitted: later ones show a wrong valley clearly."""
    horizons: tuple[float, ...] = (0.2, 0.35, 0.55, 0.8, 1.0, 1.0)
    """Shares of the time that are fitted one after the other."""
    draws: int = 8
    """Random starts at each length."""
    refined: int = 2
    """Starts that are refined, the best first."""
    width: float = 0.7
    """Width of the draws, of a prior's."""
    astray: float = 0.3
    """Of a prior's width, from which a value is also tried as it was before."""
    rate: float = 240.0
    """1/s: steps of trial simulations."""
    fine_rate: float = 480.0
    """1/s: steps of the last fit and of intervals, at most the scene's own."""
    trials: int = 8
    """Steps of a refinement on the way, at most."""
    last: int = 6
    """Steps of the last refinement, at most."""
    tolerance: float = 1e-4
    """Share of the cost by which the last step of a refinement lowers it."""
    straight: float = 1.6
    """Factor of an interval's end, from 1, up to which it is not looked for again."""
    robust: float = 3.0
    """Standard deviations from which a residual counts less."""
    quantile: float = 1.645
    """Of the normal distribution, for an interval of 90 %."""
    inert: float = 0.05
    """Change, in standard deviations, over a prior's width below which a parameter rests."""
    determined: float = 0.5
    """Share of a prior's width from which a value counts as undetermined."""
    first: float = 0.2
    """s in which velocities at the start are first estimated."""
    moving: float = 4.0
    """Standard errors from which an object moves at the start."""
    correlated: float = 0.9
    """Correlation of neighbouring residuals, at most."""
    failed: float = 1e3
    """Residual of a motion that cannot be simulated."""


FIT = FitTuning()
MAD = 1.4826
"""Standard deviation of normal noise, of its median absolute value."""
THIRD_DIFFERENCE = 20**0.5
"""Standard deviation of third differences of noise, of the noise's."""


@dataclass(frozen=True)
class Estimate:
    """One fitted number, in the scene's units; angles in rad."""

    parameter: Parameter
    value: float
    low: float
    high: float
    """Ends of the interval of 90 %."""
    is_determined: bool


@dataclass(frozen=True)
class Fit:
    """What a fit found."""

    scene: Scene
    """With the estimates that are determined."""
    estimates: tuple[Estimate, ...]
    flat: tuple[str, ...]
    """What the clip cannot determine, in words."""
    poses: F64
    """(T, N, 3): simulated, at the times of the tracks."""
    residuals: F64
    """(T, N, 3) px: observed minus simulated, the angle at the radius of gyration."""
    noise: float
    """px: standard deviation of residuals."""
    simulations: int


class Model:
    """Residuals of a scene's motion against tracks, by the numbers of its parameters."""

    def __init__(
        self,
        scene: Scene,
        compiled: CompiledScene,
        tracks: Tracks,
        starts: Starts,
        parameters: Sequence[Parameter],
    ) -> None:
        self.scene, self.compiled = scene, compiled
        self.tracks, self.starts = tracks, starts
        self.parameters = tuple(parameters)
        self.noise = track_noise(tracks)
        self.step_errors = np.zeros_like(tracks.poses)
        """(T, N, 3) px: errors of simulated poses, by their steps."""
        self.rate = min(FIT.rate, compiled.world.steps_per_second)
        self.simulations = 0
        self._recent: tuple[bytes, F64] = (b"", np.empty(0))
        bodies = compiled.world.bodies
        self.gyration = np.array([(b.moment / b.mass) ** 0.5 for b in bodies])
        self.prior = np.array([one.start for one in self.parameters])
        self.spread = np.array([one.spread for one in self.parameters])

    def edited(self, numbers: F64) -> Scene:
        """Return the scene with these numbers."""
        return with_values(self.scene, self.parameters, numbers, self.starts)

    def poses(self, numbers: F64, times: F64) -> F64:
        """Return simulated poses (T, N, 3). Raises InputError."""
        self.simulations += 1
        world = compile_shapes(self.edited(numbers), self.compiled.shapes).world
        world = replace(
            world, steps_per_second=self.rate, duration=float(times[-1]) + 1e-6
        )
        grid = times if times[0] == 0.0 else np.concatenate([[0.0], times])
        return simulate(world, grid).poses[len(grid) - len(times) :]

    def measure_steps(self, numbers: F64, count: int) -> None:
        """Note how far poses of the first `count` times depend on the length of steps."""
        times, rate = self.tracks.times[:count], self.rate
        try:
            poses = self.poses(numbers, times)
            self.rate = FIT.finer * rate
            change = np.abs(self.poses(numbers, times) - poses)
        except InputError:
            return
        finally:
            self.rate = rate
        change[..., 2] *= self.gyration
        change = np.maximum.accumulate(FIT.step_noise * change, axis=0)
        # an error of one coordinate is soon one of the others
        largest = change.max(axis=2, keepdims=True)
        self.step_errors[:count] = np.minimum(largest, FIT.largest_step_noise)
        self.step_errors[count:] = self.step_errors[count - 1]
        self._recent = (b"", np.empty(0))

    def deviations(self, count: int) -> F64:
        """Return the standard deviations (count, N, 3) of residuals, px."""
        return np.hypot(self.noise, self.step_errors[:count])

    def differences(self, poses: F64) -> F64:
        """Return (T, N, 3) px: observed minus simulated, NaN without observation."""
        offset = self.tracks.poses[: len(poses)] - poses
        offset[..., 2] *= self.gyration
        return offset

    def residuals(self, numbers: F64, count: int) -> F64:
        """Return residuals of the first `count` times, in standard deviations, with the prior's."""
        key = numbers.tobytes() + bytes(str((count, self.rate, self.noise)), "ascii")
        if self._recent[0] != key:
            self._recent = (key, self._new_residuals(numbers, count))
        return self._recent[1]

    def _new_residuals(self, numbers: F64, count: int) -> F64:
        known = np.isfinite(self.tracks.poses[:count])
        prior = (numbers - self.prior) / self.spread
        try:
            offset = self.differences(self.poses(numbers, self.tracks.times[:count]))
        except InputError:
            failed = np.full(int(known.sum()), FIT.failed)
            return np.concatenate([failed, prior])
        scaled = offset / self.deviations(count)
        return np.concatenate([scaled[known], prior])

    def has_good_residuals(self, numbers: F64, count: int) -> bool:
        """Return whether residuals are as small as the noise of the tracks.

        A wrong motion may be chaotic: its large errors of steps do not excuse it.
        """
        residuals = self.residuals(numbers, count).copy()
        observed = len(residuals) - len(numbers)
        errors = np.minimum(self.step_errors[:count], FIT.step_limit * self.noise)
        factors = self.deviations(count) / np.hypot(self.noise, errors)
        known = np.isfinite(self.tracks.poses[:count])
        residuals[:observed] *= factors[known]
        limit = FIT.passable
        if count == len(self.tracks.times):
            limit = FIT.good
        return robust_cost(residuals) < limit * observed

    def jacobian(
        self, numbers: F64, count: int, columns: Sequence[int], base: F64 | None = None
    ) -> F64:
        """Return difference quotients of residuals for some columns; central without `base`."""
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


def robust_cost(residuals: F64) -> float:
    """Return twice the robust cost (soft L1) of residuals, near their sum of squares."""
    scale = FIT.robust**2
    parts = 2 * scale * (np.sqrt(1 + residuals**2 / scale) - 1)
    return float(parts.sum())


def estimate_starts(
    compiled: CompiledScene, tracks: Tracks, kinds: Sequence[Kind]
) -> Starts:
    """Return velocities at t = 0 from the first frames, and which objects move."""
    bodies = compiled.world.bodies
    velocities = np.zeros((len(bodies), 3))
    moves, spins = [], []
    held = []
    early = (tracks.times > 0) & (
        tracks.times <= max(FIT.first, tracks.times[min(3, len(tracks.times) - 1)])
    )
    for k, body in enumerate(bodies):
        start = np.array([*body.center.tolist(), 0.0])
        gyration = (body.moment / body.mass) ** 0.5
        errors = np.array([FIT.noise, FIT.noise, FIT.noise / max(gyration, 1.0)])
        is_moving = False
        is_held = (*_held_axes(compiled, tracks, early, k), False)
        for axis in np.flatnonzero(np.logical_not(is_held)).tolist():
            offsets = tracks.poses[early, k, axis] - start[axis]
            known = np.isfinite(offsets)
            times = tracks.times[early][known]
            if not len(times):
                continue
            weight = float((times**2).sum())
            velocity = float((times * offsets[known]).sum()) / weight
            velocities[k, axis] = velocity
            if abs(velocity) > FIT.moving * errors[axis] / weight**0.5:
                is_moving = True
            else:
                velocities[k, axis] = 0.0
        if not is_moving:
            velocities[k] = 0.0
        moves.append(is_moving)
        held.append(is_held[:2])
        spins.append(bool(np.isfinite(tracks.poses[:, k, 2]).mean() > 0.5))
    is_round = tuple(body.radius is not None for body in bodies)
    sets = _tell_starts(tracks.poses[early], spins, kinds)
    return Starts(velocities, tuple(moves), tuple(spins), is_round, tuple(held), sets)


def _held_axes(
    compiled: CompiledScene, tracks: Tracks, early: Mask, k: int
) -> tuple[bool, bool]:
    """Return whether early frames show x and y of an object at rest against gravity.

    Without a support it would fall. A hop too small to be seen would otherwise pass for
    sliding without friction.
    """
    body, gravity = compiled.world.bodies[k], compiled.world.gravity
    limit = FIT.moving * track_noise(tracks)
    held = []
    for axis in (0, 1):
        offsets = tracks.poses[early, k, axis] - body.center[axis]
        known = np.isfinite(offsets)
        time = float(tracks.times[early][known].max(initial=0.0))
        # a throw that comes back in this time rises by g t^2 / 8
        would_fall = abs(gravity[axis]) * time**2 / 8 > limit
        rests = bool((np.abs(offsets[known]) < limit).all())
        held.append(bool(would_fall) and rests)
    return held[0], held[1]


def _tell_starts(
    poses: F64, spins: Sequence[bool], kinds: Sequence[Kind]
) -> tuple[tuple[bool, bool], ...]:
    """Return whether early poses tell velocity and spin of each object, if they are free."""
    seen = [bool(np.isfinite(poses[:, k, 0]).any()) for k in range(poses.shape[1])]
    has_velocity, has_spin = Kind.VELOCITY in kinds, Kind.SPIN in kinds
    return tuple(
        (is_seen and has_velocity, is_seen and turns and has_spin)
        for is_seen, turns in zip(seen, spins, strict=True)
    )


def fit_scene(
    scene: Scene,
    compiled: CompiledScene,
    tracks: Tracks,
    kinds: Sequence[Kind],
    seed: int = 0,
    progress: Progress = silent,
) -> Fit:
    """Return the parameters with which a scene moves as its tracks do. Raises InputError."""
    starts = estimate_starts(compiled, tracks, kinds)
    parameters = free_parameters(scene, tracks, kinds, starts)
    if not parameters:
        raise _nothing_free(scene, tracks, kinds, starts)
    model = Model(scene, compiled, tracks, starts, parameters)
    progress("fit", 0, len(FIT.horizons) + 2)
    best = _search(model, np.random.default_rng(seed), progress)
    total = len(tracks.times)
    model.rate = min(FIT.fine_rate, compiled.world.steps_per_second)
    progress("fit", len(FIT.horizons), len(FIT.horizons) + 2)
    model.measure_steps(best, total)
    best = _refine(model, best, total, FIT.last).numbers
    progress("fit", len(FIT.horizons) + 1, len(FIT.horizons) + 2)
    model.measure_steps(best, total)
    return _with_intervals(model, best)


def _search(model: Model, generator: np.random.Generator, progress: Progress) -> F64:
    """Return the best numbers of all starts, with long steps."""
    best = model.prior.copy()
    total = len(model.tracks.times)
    for k, share in enumerate(FIT.horizons):
        progress("fit", k, len(FIT.horizons) + 2)
        count = min(max(4, round(share * total)), total)
        model.measure_steps(best, count)
        first = _refine(model, best, count, FIT.trials)
        best = first.numbers
        if not model.has_good_residuals(best, count):
            # the errors of steps were those of another motion
            model.measure_steps(best, count)
        if model.has_good_residuals(best, count):
            if count == total:
                break
            continue
        candidates = _candidates(model, first, count, generator)
        refined = [_refine(model, one, count, FIT.trials) for one in candidates]
        tried = [best, *(one.numbers for one in refined)]
        best = min(tried, key=lambda one: robust_cost(model.residuals(one, count)))
    return best


def absent_kinds(
    scene: Scene, compiled: CompiledScene, tracks: Tracks, kinds: Sequence[Kind]
) -> tuple[Kind, ...]:
    """Return the kinds of which this scene and clip have no parameter."""
    starts = estimate_starts(compiled, tracks, kinds)
    # asked for together, since gravity leaves out its direction
    parameters = free_parameters(scene, tracks, kinds, starts)
    free = {one.kind for one in parameters}
    return tuple(kind for kind in kinds if kind not in free)


def _nothing_free(
    scene: Scene, tracks: Tracks, kinds: Sequence[Kind], starts: Starts
) -> InputError:
    """Return the refusal of kinds that this scene and clip lack, with those they have."""
    offered = [
        kind.value for kind in Kind if free_parameters(scene, tracks, [kind], starts)
    ]
    fix = "give a scene and a clip with dynamic objects"
    if offered:
        fix = f"choose from {', '.join(offered)}"
    names = ",".join(kind.value for kind in kinds)
    return Message.FIT_NOTHING_FREE.error("free", names, fix=fix)


def track_noise(tracks: Tracks) -> float:
    """Return the noise of coordinates, px, from third differences over time.

    Even accelerations leave none, and impacts are few.
    """
    differences = np.diff(tracks.poses[..., :2], n=3, axis=0)
    known = np.abs(differences[np.isfinite(differences)])
    if not len(known):
        return FIT.noise
    spread = MAD * float(np.median(known)) / THIRD_DIFFERENCE
    return max(spread, FIT.track_noise)


@dataclass(frozen=True)
class _Refined:
    """Numbers after least squares."""

    numbers: F64
    active: tuple[int, ...]
    """Columns that change anything."""


def _candidates(
    model: Model, first: _Refined, count: int, generator: np.random.Generator
) -> list[F64]:
    """Return the best few of random values of contacts, among those that act so far."""
    best = first.numbers
    is_drawn = np.zeros(len(best), bool)
    is_drawn[list(first.active)] = True
    is_drawn &= [one.scale is not Scale.LINEAR for one in model.parameters]
    if not is_drawn.any():
        return []
    starts = []
    for k in np.flatnonzero(is_drawn).tolist():
        # a value that an earlier valley drove far away
        if abs(best[k] - model.prior[k]) > FIT.astray * model.spread[k]:
            starts.append(_spliced(best, [k], model.prior[[k]]))
    for _ in range(FIT.draws):
        draw = generator.normal(size=len(best)) * model.spread * FIT.width
        starts.append(_limited(model, best + np.where(is_drawn, draw, 0.0)))
    costs = [robust_cost(model.residuals(one, count)) for one in starts]
    order = np.argsort(costs, kind="stable")
    return [starts[k] for k in order[: FIT.refined].tolist()]


def _limited(model: Model, numbers: F64) -> F64:
    """Return numbers within the limits of their parameters."""
    low = np.array([one.low for one in model.parameters])
    high = np.array([one.high for one in model.parameters])
    margin = 1e-6 * model.spread
    return np.asarray(np.clip(numbers, low + margin, high - margin))


def _refine(model: Model, numbers: F64, count: int, most: int) -> _Refined:
    """Return numbers after robust least squares over those that change anything."""
    from scipy.optimize import least_squares

    numbers = _limited(model, numbers)
    base = model.residuals(numbers, count)
    every = range(len(numbers))
    slopes = model.jacobian(numbers, count, every, base)
    data = slopes[: len(base) - len(numbers)]
    effect = np.hypot.reduce(data, axis=0) * model.spread if len(numbers) else base[:0]
    active = [k for k in every if effect[k] > FIT.inert]
    if not active:
        return _Refined(numbers, ())

    def residuals(part: F64) -> F64:
        return model.residuals(_spliced(numbers, active, part), count)

    def jacobian(part: F64) -> F64:
        if np.array_equal(part, numbers[active]):
            return slopes[:, active]
        whole = _spliced(numbers, active, part)
        return model.jacobian(whole, count, active, model.residuals(whole, count))

    chosen = [model.parameters[k] for k in active]
    result = least_squares(
        residuals,
        numbers[active],
        jacobian,
        bounds=([one.low for one in chosen], [one.high for one in chosen]),
        x_scale=model.spread[active],
        loss="soft_l1",
        f_scale=FIT.robust,
        max_nfev=most,
        ftol=FIT.tolerance,
        xtol=1e-6,
    )
    numbers = _spliced(numbers, active, np.asarray(result.x, np.float64))
    return _Refined(numbers, tuple(active))


def _spliced(numbers: F64, columns: Sequence[int], part: F64) -> F64:
    """Return numbers with other values in some columns."""
    whole = numbers.copy()
    whole[list(columns)] = part
    return whole


def _with_intervals(model: Model, best: F64) -> Fit:
    """Return the fit with an interval of each number."""
    total = len(model.tracks.times)
    residuals = model.residuals(best, total)
    observed = residuals[: len(residuals) - len(best)]
    spread = _residual_spread(observed, len(best))
    model.noise = max(model.noise * spread, FIT.track_noise)
    model.step_errors *= max(spread, 1.0)
    slopes = model.jacobian(best, total, range(len(best)))
    covariance: F64 = np.linalg.pinv(slopes.T @ slopes).astype(np.float64)
    poses = model.poses(best, model.tracks.times)
    offset = model.differences(poses)
    inflation = _inflation(offset / model.deviations(total))
    widths = np.sqrt(np.diag(covariance)) * inflation
    is_determined = widths < FIT.determined * model.spread
    cost = robust_cost(model.residuals(best, total))
    estimates = []
    for k, parameter in enumerate(model.parameters):
        ends = [best[k], best[k]]
        if is_determined[k]:
            profile = _Profile(model, best, k, slopes, cost, inflation)
            ends = [
                best[k] + side * profile.distance(side, widths[k])
                for side in (-1.0, 1.0)
            ]
        low, high = (parameter.value(float(end)) for end in ends)
        value = parameter.value(float(best[k]))
        estimates.append(Estimate(parameter, value, low, high, bool(is_determined[k])))
    kept = [one.parameter for one in estimates if one.is_determined]
    return Fit(
        scene=with_values(model.scene, kept, best[is_determined], model.starts),
        estimates=tuple(estimates),
        flat=flat_directions(model.parameters, covariance, model.spread),
        poses=poses,
        residuals=offset,
        noise=model.noise,
        simulations=model.simulations,
    )


def _residual_spread(residuals: F64, count: int) -> float:
    """Return the standard deviation of residuals without outliers, after a fit of `count` values.

    The larger of two estimates: an interval should rather be too wide.
    """
    if not len(residuals):
        return 1.0
    median = MAD * float(np.median(np.abs(residuals)))
    regular = residuals[np.abs(residuals) < FIT.robust * max(median, 1e-9)]
    root = float(np.sqrt((regular**2).mean())) if len(regular) else median
    freedom = max(len(residuals) - count, 1)
    return max(median, root) * float(np.sqrt(len(residuals) / freedom))


def _inflation(offset: F64) -> float:
    """Return the factor of all widths by which neighbouring residuals are alike."""
    before, after = offset[:-1], offset[1:]
    known = np.isfinite(before) & np.isfinite(after)
    if known.sum() < 3:
        return 1.0
    power = float((before[known] ** 2).mean() + (after[known] ** 2).mean()) / 2
    product = float((before[known] * after[known]).mean())
    alike = min(max(product / max(power, 1e-12), 0.0), FIT.correlated)
    return float(np.sqrt((1 + alike) / (1 - alike)))


@dataclass(frozen=True)
class _Profile:
    """The least cost for other values of one parameter; the others follow it."""

    model: Model
    best: F64
    column: int
    slopes: F64
    """(R, P): derivatives of residuals at the best numbers."""
    cost: float
    inflation: float

    def distance(self, side: float, width: float) -> float:
        """Return how far the interval reaches to one side."""
        target = (FIT.quantile * self.inflation) ** 2
        reach = FIT.quantile * width
        for _ in range(2):
            rise = self._rise(side * reach)
            factor = (target / max(rise, target / 9)) ** 0.5
            reach *= min(max(factor, 0.5), 2.0)
            if 1 / FIT.straight < factor < FIT.straight:
                break
        return float(reach)

    def _rise(self, change: float) -> float:
        """Return the rise of the cost for a change of the parameter."""
        count = len(self.model.tracks.times)
        others = np.arange(len(self.best)) != self.column
        slopes = self.slopes[:, others]
        numbers = self.best.copy()
        numbers[self.column] += change
        # the slopes at the best numbers tell how the others follow, and correct it once
        residuals = self.slopes[:, self.column] * change
        costs = []
        for _ in range(2):
            step = np.linalg.lstsq(slopes, -residuals, rcond=None)[0]
            numbers[others] += step
            residuals = self.model.residuals(numbers, count)
            costs.append(robust_cost(residuals))
        return min(costs) - self.cost


def flat_directions(
    parameters: Sequence[Parameter], covariance: F64, spread: F64
) -> tuple[str, ...]:
    """Return in words what data do not determine: single parameters and combinations."""
    if not len(parameters):
        return ()
    scaled = covariance / np.outer(spread, spread)
    values, vectors = np.linalg.eigh(scaled)
    sentences = []
    for k in np.argsort(-values).tolist():
        if values[k] < FIT.determined**2:
            break
        vector = vectors[:, k]
        members = [
            (parameters[j].path, float(vector[j]))
            for j in np.argsort(-np.abs(vector)).tolist()
            if abs(vector[j]) > 0.35
        ]
        names = [name for name, _ in members]
        if len(members) == 1:
            sentences.append(names[0])
        elif len(members) == 2 and members[0][1] * members[1][1] < 0:
            sentences.append(f"{names[0]} against {names[1]}: only their combination")
        else:
            sentences.append(f"{', '.join(names)}: only combinations of them")
    return tuple(dict.fromkeys(sentences))
