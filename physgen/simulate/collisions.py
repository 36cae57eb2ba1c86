"""Impacts: closing contact points, and the velocities after them.

Newton's elasticity and Coulomb's friction hold at each point. Points that close at the
same instant are solved together, then the next points that close. An impact therefore
travels on through touching bodies: the last of a row of balls gets all the momentum,
whether the gaps are 0, tiny, or tiny overlaps, and a symmetric rack stays symmetric.
Few points close at a time, so the rounds use plain numbers, and only bodies that an
impact has moved are checked again.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from physgen.simulate.contacts import (
    Array,
    ContactProperties,
    Flags,
    Point,
    Points,
    point_at_closing,
)
from physgen.simulate.joints import Assemblies, find, is_jolt

Index = NDArray[np.int64]


@dataclass(frozen=True)
class CollisionTuning:
    """Limits and tolerances of the impact solver."""

    sweeps: int = 300
    heap_sweeps: int = 30
    """Maximum number of passes over points that close together; `heap_sweeps` for heaps."""
    rounds: int = 400
    """Rounds of impacts within one instant; the engine treats the remaining points as
    inelastic."""
    echo_share: float = 1e-4
    """Share of a step's largest closing speed below which the engine treats a later
    impact as inelastic: echoes would never end otherwise."""
    tolerance: float = 1e-13
    heap_tolerance: float = 1e-5
    """Relative change of impulses at which a solution has converged; `heap_tolerance`
    for heaps.
    """
    start_work: float = 2e6
    work_per_second: float = 1e6
    """Work of a run, in passes over points: at its begin, and per second of the scene.

    The bundled scenes need less than 1 % of it. Beyond the limit, each step has one
    round: a ton on a saucer must not take hours."""
    heap_points: int = 500  # contact points of a heap
    dense_count: int = 40
    """Number of speeds that a point changes above which arrays are faster than lists,
    measured with 10 to 100 points.
    """
    max_poses: int = 2
    """Number of poses at which the joints must allow a velocity: now, and a
    step later.
    """
    simultaneity: float = 0.02
    """Share of a step within which two contacts of one body are simultaneous."""


TUNING = CollisionTuning()
MIN_JOLT = 0.1
"""Share of the threshold of impacts below which motion is not tested against joints."""


class WorkBudget:
    """The limit on a run's work: passes over points that close together."""

    def __init__(self, bodies: int) -> None:
        self._crowd = 1 + bodies / TUNING.heap_points
        self._left = TUNING.start_work * self._crowd
        self.exceeded_by: tuple[int, int] | None = None
        """The first pair of the group that used up the budget."""

    def grant(self, seconds: float) -> None:
        """Add the work for a step of the scene."""
        self._left += TUNING.work_per_second * seconds * self._crowd

    def spend(self, passes: int, points: list[Point]) -> None:
        """Subtract passes over points."""
        self._left -= passes * len(points)
        if self._left < 0 and self.exceeded_by is None:
            self.exceeded_by = points[0].a, points[0].b


def single_point_impulse(
    nn: float, nt: float, tt: float, elasticity: float, mu: float, vn: float, vt: float
) -> tuple[float, float]:
    """Return the impulse of a single point in closed form, normal and along the
    surface.

    The point sticks if friction suffices, else it slides; kinetic energy never grows.
    `nn`, `nt`, `tt`: changes of closing and sliding speed by a unit impulse, normal and
    along the surface; `vn` (negative if it closes), `vt`: the speeds.
    """
    # Newton's rule: the point leaves with `elasticity` times its closing speed, so that
    # its speed along the normal changes by this amount.
    target = -(1 + elasticity) * vn
    if mu == 0:
        return target / nn, 0.0
    # Assume first that the point sticks. The impulses must change both speeds as
    # wanted: nn * jn + nt * jt = target, and nt * jn + tt * jt = -vt. Cramer's rule
    # solves these two equations.
    determinant = nn * tt - nt * nt
    jn = (target * tt + nt * vt) / determinant
    jt = (-nt * target - nn * vt) / determinant
    if jn <= 0 or abs(jt) > mu * jn:
        # Friction cannot hold the point: it acts with its full coefficient against the
        # sliding.
        if jt > 0:
            side = 1.0
        else:
            side = -1.0
        if jt == 0:
            side = 1.0
            if vt > 0:
                side = -1.0
        # A sliding point has jt = side * mu * jn. The equation along the normal then
        # has one unknown: (nn + side * mu * nt) * jn = target.
        grip = nn + side * mu * nt
        # With this friction, the point would wedge: no finite impulse reverses it.
        if grip < 1e-9 * nn:
            return target / nn, 0.0
        jn = target / grip
        jt = side * mu * jn
    # Newton's rule with friction can create energy for an oblique contact: then leave
    # out friction.
    gain = jn * (2 * vn + nn * jn + nt * jt) + jt * (2 * vt + tt * jt + nt * jn)
    if elasticity <= 1 and gain > 1e-12 * abs(jn * vn):
        return target / nn, 0.0
    return jn, jt


def simultaneous_impulses(
    matrix: Array,
    before: Array,
    elasticity: list[float],
    friction: list[float],
    exact: float,
) -> tuple[Array, int]:
    """Return the impulses (2P,) of points that close together, and the number of
    passes.

    Impulses alternate between normal and along the surface. `matrix` (2P, 2P): changes
    of speeds by unit impulses; `before` (2P,): the speeds; `exact`: the relative change
    at which impulses have converged. Newton's rule with friction can create energy
    (Kane and Levinson 1985): the bounce is then reduced until it creates none.
    """
    # For most impacts the full solution creates no energy, and this costs a single
    # product. Bumpers create energy on purpose, and inelastic impacts cannot create
    # any.
    full, passes = _solve_impulses(matrix, before, elasticity, friction, exact)
    is_bumper = max(elasticity, default=0.0) > 1
    if not any(elasticity) or is_bumper or _gain(matrix, before, full) <= 0:
        return full, passes
    # An inelastic impact never gains energy. Between it and the full solution the
    # energy is a quadratic function of the share, so that there is a largest share
    # without gain.
    inelastic, more_passes = _solve_impulses(
        matrix, before, [0.0] * len(elasticity), friction, exact
    )
    # Bisect between the inelastic and the full solution.
    share = 0.0
    step = 0.5
    # Thirty halvings find the share to about 1e-9, below the tolerance of `_gain`.
    for _ in range(30):
        if _gain(matrix, before, inelastic + (share + step) * (full - inelastic)) <= 0:
            share += step
        step /= 2
    return inelastic + share * (full - inelastic), passes + more_passes


def _gain(matrix: Array, before: Array, impulse: Array) -> float:
    """Return the kinetic energy added by impulses, g·px²/s²; 0 within rounding
    errors.
    """
    # The change of kinetic energy is j·v + j·A·j / 2, for impulses j, speeds v before
    # and the matrix A of responses. The positive and negative terms nearly cancel in an
    # elastic impact: compare the sum with the size of its terms.
    change = impulse * (before + matrix @ impulse / 2)
    gain = float(change.sum())
    if gain > 1e-9 * float(np.abs(change).sum()):
        return gain
    return 0.0


def _solve_impulses(
    matrix: Array,
    before: Array,
    elasticity: list[float],
    friction: list[float],
    exact: float,
) -> tuple[Array, int]:
    """Solve for impulses by projected Gauss-Seidel to the last digits.

    No point pulls, each rebounds as wanted, and friction stays within its cone.
    """
    if np.count_nonzero(matrix) > TUNING.dense_count * len(before):
        return _solve_dense_impulses(matrix, before, elasticity, friction, exact)
    speed = before.tolist()
    impulse = [0.0] * len(before)
    points = _point_equations(matrix, speed, elasticity, friction)
    largest_change = 0.0
    for passes in range(1, 1 + _max_passes(exact)):  # noqa: B007 - counts
        # Each point in turn takes the impulse that would give it its goal, while all
        # others keep theirs; the passes converge as in any Gauss-Seidel method. The
        # loop calls no functions, because it takes most of the time of a heap.
        largest_change = largest_impulse = 0.0
        for n, t, goal, mu, inverse_nn, inverse_tt, n_column, t_column in points:
            new_impulse = impulse[n] + (goal - speed[n]) * inverse_nn
            # A contact pushes and never pulls. `not >` also catches NaN.
            if not new_impulse > 0.0:
                new_impulse = 0.0
            change = new_impulse - impulse[n]
            if change:
                impulse[n] = new_impulse
                for k, value in n_column:
                    speed[k] += change * value
                if change > largest_change or -change > largest_change:
                    largest_change = abs(change)
            if new_impulse > largest_impulse:
                largest_impulse = new_impulse
            # Coulomb's law: friction stops the slip, within mu times the normal
            # impulse.
            if mu > 0:
                limit = mu * new_impulse
                new_impulse = impulse[t] - speed[t] * inverse_tt
                if not -limit < new_impulse < limit:
                    if new_impulse > 0.0:
                        new_impulse = limit
                    else:
                        new_impulse = -limit
                change = new_impulse - impulse[t]
                if change:
                    impulse[t] = new_impulse
                    for k, value in t_column:
                        speed[k] += change * value
                    if change > largest_change or -change > largest_change:
                        largest_change = abs(change)
        # The change of a pass relative to the largest impulse estimates the relative
        # error.
        if largest_change <= exact * largest_impulse:
            break
    return np.array(impulse), passes


def _max_passes(exact: float) -> int:
    """Return the largest number of passes for a relative change of impulses."""
    # Heaps are solved to a coarse tolerance, and a few passes suffice for it.
    if exact < 1e-6:
        return TUNING.sweeps
    return TUNING.heap_sweeps


def _inverse_diagonal(matrix: Array) -> list[float]:
    """Return the inverse of each diagonal element; large numbers for zeros."""
    return [1.0 / max(d, 1e-300) for d in np.diag(matrix).tolist()]


def _leaving_speeds(elasticity: list[float], speed: list[float]) -> list[float]:
    """Return the speeds at which points should leave, by Newton's rule.

    `speed` (2P,): normal and along the surface in turn; negative if a point closes.
    """
    # Points that already leave have a goal of 0: an impact elsewhere must not press
    # them together.
    pairs = zip(elasticity, speed[::2], strict=True)
    return [-e * min(v, 0.0) for e, v in pairs]


Column = list[tuple[int, float]]
"""Rows and values of the nonzero elements of a matrix column."""
PointEquation = tuple[int, int, float, float, float, float, Column, Column]
"""Of one point: its rows, normal and along the surface; the speed to leave with; the
coefficient of friction; the inverse diagonal elements; the columns of both rows.
"""


def _point_equations(
    matrix: Array, speed: list[float], elasticity: list[float], friction: list[float]
) -> list[PointEquation]:
    """Return the equation of each point, with the columns of a sparse matrix."""
    columns = _sparse_columns(matrix)
    inverse_diagonal = _inverse_diagonal(matrix)
    goals = _leaving_speeds(elasticity, speed)
    points: list[PointEquation] = []
    for number, (goal, mu) in enumerate(zip(goals, friction, strict=True)):
        n, t = 2 * number, 2 * number + 1
        diagonal = inverse_diagonal[n], inverse_diagonal[t]
        points.append((n, t, goal, mu, *diagonal, columns[n], columns[t]))
    return points


def _sparse_columns(matrix: Array) -> list[Column]:
    """Return the columns of a matrix; each point changes the speeds of few others."""
    columns: list[Column] = [[] for _ in matrix]
    rows, column_numbers = np.nonzero(matrix)
    values = matrix[rows, column_numbers].tolist()
    elements = zip(rows.tolist(), column_numbers.tolist(), values, strict=True)
    for row, column_number, value in elements:
        columns[column_number].append((row, value))
    return columns


def _solve_dense_impulses(
    matrix: Array,
    before: Array,
    elasticity: list[float],
    friction: list[float],
    exact: float,
) -> tuple[Array, int]:
    """Solve like `_solve_impulses`, to the bit, for points that change the speeds of many
    others.
    """
    speed = before.copy()
    impulse = [0.0] * len(before)
    # One product with a whole column is faster than a loop over many entries.
    columns = np.ascontiguousarray(matrix.T)
    inverse_diagonal = _inverse_diagonal(matrix)
    goals = _leaving_speeds(elasticity, before.tolist())
    for passes in range(1, 1 + _max_passes(exact)):  # noqa: B007 - counts
        # As in `_solve_impulses`: each point in turn takes the impulse that gives it
        # its goal.
        largest_change = largest_impulse = 0.0
        for point, (goal, mu) in enumerate(zip(goals, friction, strict=True)):
            n, t = 2 * point, 2 * point + 1
            new_impulse = impulse[n] + (goal - speed.item(n)) * inverse_diagonal[n]
            if not new_impulse > 0.0:
                new_impulse = 0.0
            impulse_step = new_impulse - impulse[n]
            if impulse_step:
                impulse[n] = new_impulse
                speed += impulse_step * columns[n]
                largest_change = max(largest_change, abs(impulse_step))
            largest_impulse = max(largest_impulse, new_impulse)
            if mu <= 0:
                continue
            friction_limit = mu * new_impulse
            tangent_impulse = impulse[t] - speed.item(t) * inverse_diagonal[t]
            if not -friction_limit < tangent_impulse < friction_limit:
                if tangent_impulse > 0.0:
                    tangent_impulse = friction_limit
                else:
                    tangent_impulse = -friction_limit
            impulse_step = tangent_impulse - impulse[t]
            if impulse_step:
                impulse[t] = tangent_impulse
                speed += impulse_step * columns[t]
                largest_change = max(largest_change, abs(impulse_step))
        if largest_change <= exact * largest_impulse:
            break
    return np.array(impulse), passes


class ImpactEquations(NamedTuple):
    """P points and taut joints that close together, on n bodies."""

    jacobian: Array  # (2P, 3n): closing and sliding speeds by velocities of bodies
    speeds: Array  # (2P,) px/s before the impact
    elasticity: list[float]  # (P,)
    friction: list[float]  # (P,) coefficients
    inverse_masses: Array  # (3n,): 1/mass, 1/mass, 1/moment of each body


class ImpactSolution(NamedTuple):
    """The impulses of points that close together, with the effect of joints."""

    impulses: Array  # (2P,)
    response_to_points: Array  # (3n, 2P): changes of velocities by unit impulses
    removed_velocities: Array  # (3n,): parts that joints exclude


def _point_jacobian(points: list[Point], bodies: list[int]) -> Array:
    """Return the closing and sliding speeds of points by velocities of bodies.

    Its shape is (2P, 3n); the rows alternate between both directions.
    """
    # The speed of a point is n·v + lever * spin of the second body minus the same of
    # the first. Only movable bodies have columns: walls and scripted bodies do not
    # react.
    first_column = {body: 3 * k for k, body in enumerate(bodies)}
    jacobian = np.zeros((2 * len(points), 3 * len(bodies)))
    for i, p in enumerate(points):
        sides = (p.a, -1.0, p.na, p.ta), (p.b, 1.0, p.nb, p.tb)
        for body, sign, normal_lever, tangent_lever in sides:
            if body not in first_column:
                continue
            k = first_column[body]
            jacobian[2 * i, k : k + 3] = sign * p.nx, sign * p.ny, sign * normal_lever
            # The direction along the surface is the normal turned by 90 degrees: (-ny,
            # nx).
            jacobian[2 * i + 1, k : k + 3] = (
                -sign * p.ny,
                sign * p.nx,
                sign * tangent_lever,
            )
    return jacobian


def _as_pairs(values: Array) -> list[tuple[float, float]]:
    """Return values (2P,), normal and along the surface in turn, as P pairs."""
    return [(float(normal), float(side)) for normal, side in values.reshape(-1, 2)]


@dataclass(frozen=True)
class Impacts:
    """The effects of the impacts of one step."""

    velocity: Array  # (N, 3): px/s, px/s, rad/s after the last impact
    shift: Array
    """Displacements at the step's end, (N, 3) px, px, rad, since the velocities changed
    within the step."""
    first: Index  # (B,): first bodies of the struck pairs
    second: Index
    impulse: Array  # (B, 2) g·px/s on the first bodies
    earlier: Array  # (B,) s before the end of the step
    loss: float  # g·px²/s² lost to elasticity below 1 and to friction
    work: float  # g·px²/s² of work by scripted bodies


@dataclass(frozen=True)
class StepMotion:
    """The motion of N bodies and walls in one step, before contacts."""

    pose: Array  # (N, 3) at the step's end
    velocity: Array  # (N, 3) within the step
    drift: Array  # (N, 2) px/s²: acceleration of free bodies, 0 for others


class ImpactSolver:
    """Resolves the contacts that close faster than `threshold` px/s in one step of h
    seconds.
    """

    def __init__(
        self,
        properties: ContactProperties,
        assemblies: Assemblies,
        motion: StepMotion,
        points: Points,
        has_touched: Flags,
        h: float,
        threshold: float,
        step_velocities: Array | None = None,
    ) -> None:
        """Find the points that close in a step.

        `has_touched` (K,): pairs that already touched a step ago. `step_velocities`:
        (N, 3) within the step, if those of `motion` are the ones at its end: the
        contacts then act over the whole step.
        """
        # A sorted order makes the result independent of the order in which the engine
        # lists contacts.
        points = points.sort()
        self._step_velocities = step_velocities
        # Velocities of a step connect the poses at both of its ends, and are tangents
        # of the path in the middle.
        half_step = 0.0
        if step_velocities is None:
            half_step = h / 2
        self._middle = motion.pose - motion.velocity * half_step
        """Poses (N, 3) in the middle of the step, where joints permit its
        velocities.
        """
        self._joint_velocities: Array | None = None
        self._properties = properties
        self._assemblies = assemblies
        self._pose = motion.pose
        self._velocity = motion.velocity
        self._drift = motion.drift
        self._contact_points = points
        self._h = h
        self._threshold = threshold
        # Slower points are resting contacts: the engine's own solver treats them
        # without a rebound.
        self._is_closing = points.closing > threshold
        self._earlier = points.times_since_closing(self._is_closing, has_touched, h)
        if len(points.first) < TUNING.heap_points:
            self._tolerance = TUNING.tolerance
        else:
            self._tolerance = TUNING.heap_tolerance
        # A sorted list of points by body finds the points beside a body by bisection.
        partners = np.concatenate([points.first, points.second])
        order = np.argsort(partners, kind="stable")
        self._owners = partners[order]
        self._point_rows = order % len(points.first)
        self._points: dict[int, Point] = {}
        self._velocities: dict[int, list[float]] = {}
        self._shifts: dict[int, list[float]] = {}
        self._impact_times: dict[int, float] = {}
        self._drift_changes: dict[int, tuple[float, float]] = {}
        self._impulse_rows: list[tuple[int, int, float, float, float]] = []
        self._loss = self._work = 0.0

    def run(self, budget: WorkBudget) -> Impacts:
        """Resolve rounds of impacts until no point closes, or one round if the budget
        is spent.

        The engine treats the remaining points as inelastic.
        """
        self._budget = budget
        # Impacts bounce back and forth with ever smaller speeds, as between a falling
        # ball and a box on the ground. Below a share of the fastest closing speed, they
        # end.
        closing = [int(k) for k in np.flatnonzero(self._is_closing)]
        smallest_speed = max(
            self._threshold,
            TUNING.echo_share * float(self._contact_points.closing.max()),
        )
        for number in range(TUNING.rounds):
            if not closing or (number and budget.exceeded_by):
                break
            times = {k: self._closing_time(k, number) for k in closing}
            # Of all points that close, only the first of each body are solved: they
            # change which other points close, and when.
            first_points = self._first_points(closing, times)
            self._add_drift(first_points, times)
            moved_bodies: set[int] = set()
            for group in self._groups(first_points):
                moved_bodies |= self._solve(group, times)
            # Only points of bodies that an impact has just moved can close anew.
            nearby_points = set(closing)
            for body in sorted(moved_bodies):
                nearby_points.update(self._points_of(body))
            closing = self._closing_points(nearby_points, smallest_speed)
        return self._result()

    def _closing_points(self, points: set[int], smallest_speed: float) -> list[int]:
        """Return the points that close faster than `smallest_speed`, px/s."""
        closing = []
        for k in sorted(points):
            point = self._point(k)
            speed = point.leaving(self._speeds(point.a), self._speeds(point.b))
            if speed < -smallest_speed:
                closing.append(k)
        return closing

    def _result(self) -> Impacts:
        """Return the velocities after all impacts, and the impulses."""
        velocity = self._velocity.copy()
        shift = np.zeros_like(self._velocity)
        for body, (vx, vy, spin) in self._velocities.items():
            drift_x, drift_y = self._drift_changes.get(body, (0.0, 0.0))
            # The engine's velocities are those between two steps: remove the part of
            # the drift that `_add_drift` has added.
            velocity[body] = vx - drift_x, vy - drift_y, spin
            if self._joint_velocities is not None:
                velocity[body] += self._velocity[body] - self._joint_velocities[body]
        for body, displacement in self._shifts.items():
            shift[body] = displacement
        rows = np.array(self._impulse_rows).reshape(-1, 5)
        return Impacts(
            velocity=velocity,
            shift=shift,
            first=rows[:, 0].astype(np.int64),
            second=rows[:, 1].astype(np.int64),
            impulse=rows[:, 2:4],
            earlier=rows[:, 4],
            loss=self._loss,
            work=self._work,
        )

    # Points and times

    def _is_free(self, body: int) -> bool:
        """Check whether a body can be moved by an impact."""
        return self._properties.lightness[body] > 0

    def _points_of(self, body: int) -> list[int]:
        """Return the points at a movable body; a wall does not pass an impact on."""
        if not self._is_free(body):
            return []
        begin, end = self._owners.searchsorted([body, body + 1])
        point_rows: list[int] = self._point_rows[begin:end].tolist()
        return point_rows

    def _speeds(self, body: int) -> list[float]:
        """Return the present velocity of a body, which is changed in place by
        impacts.
        """
        if body not in self._velocities:
            velocity = self._velocity
            if self._assemblies.group_of(body) is not None:
                velocity = self._joint_velocity()
            self._velocities[body] = velocity[body].tolist()
        return self._velocities[body]

    def _joint_velocity(self) -> Array:
        """Return the permitted velocities (N, 3) of joints in the middle of the step.

        The rest, by which a chord differs from a tangent, takes no part in impacts: it
        would create energy.
        """
        if self._joint_velocities is None:
            self._joint_velocities = self._assemblies.project_velocities(
                self._middle, self._velocity
            )
        return self._joint_velocities

    def _closing_time(self, k: int, number: int) -> float:
        """Return the time of an impact, s before the step's end.

        It is the point's own closing time, or that of the impact that moved a partner.
        """
        # In the first round, and for points that closed without any impact, the time is
        # known from the motion. Points that close because of an impact do so just then.
        point = self._point(k)
        if number == 0 or (point.is_first and point.earlier > 0):
            return point.earlier
        return max(
            0.0,
            self._impact_times.get(point.a, 0.0),
            self._impact_times.get(point.b, 0.0),
        )

    def _first_points(
        self, closing: Iterable[int], times: dict[int, float]
    ) -> list[int]:
        """Return the points that close first among those with a common body."""
        largest_times: dict[int, float] = {}
        for k in closing:
            point = self._point(k)
            for body in (point.a, point.b):
                largest_times[body] = max(largest_times.get(body, -1.0), times[k])
        # Times count back from the end of the step, so that the first impact of a body
        # has the largest time. Points within the slack close together.
        slack = TUNING.simultaneity * self._h
        leading_points = []
        for k in closing:
            point = self._point(k)
            if all(
                not self._is_free(body) or times[k] >= largest_times[body] - slack
                for body in (point.a, point.b)
            ):
                leading_points.append(k)
        return leading_points

    def _add_drift(self, points: Iterable[int], times: dict[int, float]) -> None:
        """Move the velocities of struck bodies to the impact's time.

        Velocities of a step are those of its middle, to which the drift is added.
        """
        for k in points:
            point = self._point(k)
            for body in (point.a, point.b):
                if body not in self._impact_times and self._is_free(body):
                    self._impact_times[body] = times[k]
                    # Velocities are those at the middle of the step. Gravity changes
                    # them until the impact.
                    time_from_middle = self._h / 2 - times[k]
                    leap = (
                        float(self._drift[body, 0]) * time_from_middle,
                        float(self._drift[body, 1]) * time_from_middle,
                    )
                    self._drift_changes[body] = leap
                    velocity = self._speeds(body)
                    velocity[0] += leap[0]
                    velocity[1] += leap[1]

    def _groups(self, struck_points: list[int]) -> list[list[int]]:
        """Group the points that share movable bodies or groups of joints."""
        if len(struck_points) == 1:
            return [struck_points]
        # Union-find: points on the same movable body, or on one group of joints,
        # interact.
        root = {k: k for k in struck_points}
        point_of_owner: dict[int, int] = {}
        for k in struck_points:
            point = self._point(k)
            for body in (point.a, point.b):
                if self._is_free(body):
                    joint_group = self._assemblies.group_of(body)
                    first_point = point_of_owner.setdefault(
                        body if joint_group is None else joint_group, k
                    )
                    root[find(root, k)] = find(root, first_point)
        # Groups without a common body do not influence each other, and small systems
        # are solved faster than a large one.
        groups: dict[int, list[int]] = {}
        for k in struck_points:
            groups.setdefault(find(root, k), []).append(k)
        return list(groups.values())

    def _point(self, k: int) -> Point:
        """Return a contact point at its closing time."""
        if k not in self._points:
            self._points[k] = point_at_closing(
                self._properties,
                self._contact_points,
                k,
                self._pose,
                self._velocity,
                self._earlier,
                self._is_closing,
            )
        return self._points[k]

    # Effects of an impact

    def _solve(self, group: list[int], times: dict[int, float]) -> set[int]:
        """Solve for the impulses of points that close together, apply them, and return
        the bodies.
        """
        # All points of a group use the speeds before any of its impulses: the solution
        # is simultaneous, and its result does not depend on the order of points.
        points = [self._point(k) for k in group]
        point_times = [times[k] for k in group]
        speeds = [p.motion(self._speeds(p.a), self._speeds(p.b)) for p in points]
        script_speeds = [self._script_speeds(point) for point in points]
        bodies = self._free_bodies(points)
        joint_groups = {self._assemblies.group_of(body) for body in bodies} - {None}
        # One point between free bodies has a closed form; points and joints together
        # need a solver.
        if len(points) == 1 and not joint_groups:
            impulses = [
                self._apply_single_impulse(points[0], speeds[0], point_times[0])
            ]
        else:
            for joint_group in joint_groups:
                if joint_group is not None:
                    bodies.update(self._assemblies.members[joint_group])
            impulses, speeds = self._apply_joint_impulses(
                points, speeds, sorted(bodies), point_times
            )
        # Sum the energies after all impulses have acted, because each impulse works at
        # the mean of both speeds.
        for number, point in enumerate(points):
            self._note_impulse(point, impulses[number], point_times[number])
            self._count_energy(
                point, impulses[number], speeds[number], script_speeds[number]
            )
        return bodies

    def _free_bodies(self, points: list[Point]) -> set[int]:
        """Return the movable bodies with these points."""
        partners = {body for point in points for body in (point.a, point.b)}
        return {body for body in partners if self._is_free(body)}

    def _note_impulse(
        self, point: Point, impulse: tuple[float, float], time: float
    ) -> None:
        """Record the impulse on the first body, along the axes of the image."""
        # The normal points from the first body to the second, and a positive impulse
        # pushes the first one back: hence both signs.
        jn, jt = impulse
        jx = jt * point.ny - jn * point.nx
        jy = -jn * point.ny - jt * point.nx
        self._impulse_rows.append((point.a, point.b, jx, jy, time))

    def _apply_single_impulse(
        self, point: Point, speeds: tuple[float, float], time: float
    ) -> tuple[float, float]:
        """Apply the impulse of a point that closes alone, and return it.

        `time`: s before the step's end.
        """
        jn, jt = single_point_impulse(
            point.nn,
            point.nt,
            point.tt,
            point.elasticity,
            point.friction,
            *speeds,
        )
        # An impulse `time` s before the end of the step also shifts the pose at its
        # end, by the change of velocity times this time.
        self._give(self._velocities, point, jn, jt, 1.0)
        self._give(self._shifts, point, jn, jt, time)
        return jn, jt

    def _count_energy(
        self,
        point: Point,
        impulse: tuple[float, float],
        speeds: tuple[float, float],
        script_speeds: tuple[float, float],
    ) -> None:
        """Add the loss and the work of a point's impulse to the sums.

        An impulse does its work at the mean of the speeds before and after; both pairs
        are along the normal and along the surface.
        """
        jn, jt = impulse
        vn, vt = speeds
        script_vn, script_vt = script_speeds
        leaving_speed, sliding_speed = point.motion(
            self._speeds(point.a), self._speeds(point.b)
        )
        # The contact then acts over the whole step, so that its work begins at the
        # velocity within the step.
        if self._step_velocities is not None:
            vn, vt = point.motion(
                self._step_velocities[point.a].tolist(),
                self._step_velocities[point.b].tolist(),
            )
        energy_change = jn * (vn + leaving_speed) / 2 + jt * (vt + sliding_speed) / 2
        # The energy of a bumper counts as work.
        if point.elasticity > 1 and energy_change > 0:
            self._work += energy_change
        else:
            self._loss -= energy_change
        # A scripted body keeps its velocity in an impact: the script provides the
        # energy.
        self._work += jn * script_vn + jt * script_vt

    def _give(
        self,
        changes_by_body: dict[int, list[float]],
        p: Point,
        jn: float,
        jt: float,
        part: float,
    ) -> None:
        """Add the changes of velocity by an impulse on two free bodies, times
        `part`.
        """
        # Rotate the impulse from normal and tangent to the axes of the image.
        fx = (jn * p.nx - jt * p.ny) * part
        fy = (jn * p.ny + jt * p.nx) * part
        # Action and reaction: the same impulse acts on both bodies with opposite signs,
        # linear changes by 1/mass, spins by the lever over the moment.
        for body, m, turn, sign in (
            (p.a, p.ma, p.ea * (p.na * jn + p.ta * jt) * part, -1.0),
            (p.b, p.mb, p.eb * (p.nb * jn + p.tb * jt) * part, 1.0),
        ):
            if m > 0:
                if changes_by_body is self._velocities:
                    changes = self._speeds(body)
                else:
                    changes = changes_by_body.setdefault(body, [0.0, 0.0, 0.0])
                changes[0] += sign * m * fx
                changes[1] += sign * m * fy
                changes[2] += sign * turn

    def _apply_joint_impulses(
        self,
        points: list[Point],
        speeds: list[tuple[float, float]],
        bodies: list[int],
        times: list[float],
    ) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
        """Apply the impulses of points with common bodies or with joints.

        Returns the impulses, and the speeds at which the points close: those of
        `speeds` without the part that joints exclude.
        """
        # Velocities change by M⁻¹ Jᵀ j, corrected for the joints: `response_to_points`
        # contains this matrix.
        equations = self._impact_equations(points, speeds, bodies)
        solution = self._solve_with_joints(points, bodies, equations)
        impulses = solution.impulses
        removed = solution.removed_velocities
        impulse_change = solution.response_to_points @ impulses
        # An impulse earlier in the step also displaces the bodies at its end.
        last_time = max(times)
        count = 2 * len(points)
        taut_count = (len(impulses) - count) // 2
        impulse_times = np.repeat([*times, *[last_time] * taut_count], 2)
        displacement = solution.response_to_points @ (impulses * impulse_times)
        self._move_bodies(
            bodies, impulse_change + removed, displacement + removed * last_time
        )
        jacobian = equations.jacobian
        closing_before = equations.speeds + jacobian @ removed
        # Ropes that become taut stop without a rebound. Their loss of energy belongs to
        # no point, and is counted here.
        if taut_count:
            closing_after = closing_before + jacobian @ impulse_change
            works = impulses * (closing_before + closing_after)
            self._loss -= float(works[count:].sum()) / 2
        return _as_pairs(impulses[:count]), _as_pairs(closing_before[:count])

    def _move_bodies(
        self, bodies: list[int], change: Array, displacement: Array
    ) -> None:
        """Add changes of velocity and displacements (3n,) to those of n bodies."""
        for number, body in enumerate(bodies):
            velocity = self._speeds(body)
            shift = self._shifts.setdefault(body, [0.0, 0.0, 0.0])
            for axis in range(3):
                velocity[axis] += float(change[3 * number + axis])
                shift[axis] += float(displacement[3 * number + axis])

    def _impact_equations(
        self, points: list[Point], speeds: list[tuple[float, float]], bodies: list[int]
    ) -> ImpactEquations:
        """Return the equations of points and of the taut joints of n bodies."""
        # Three velocities per body: two have the inverse mass, and the spin has the
        # inverse moment.
        inverse_masses = []
        for body in bodies:
            lightness = self._properties.lightness[body]
            inverse_masses += [lightness, lightness, self._properties.ease[body]]
        jacobian = _point_jacobian(points, bodies)
        closing_speeds = np.array(speeds).ravel()
        taut_rows = self._assemblies.taut_rows(bodies, self._middle)
        if len(taut_rows):
            # Ropes and limits act like contacts without rebound and friction.
            pulls = np.zeros((2 * len(taut_rows), 3 * len(bodies)))
            pulls[::2] = taut_rows
            body_speeds = np.array([self._speeds(body) for body in bodies]).ravel()
            jacobian = np.concatenate([jacobian, pulls])
            closing_speeds = np.concatenate([closing_speeds, pulls @ body_speeds])
        zeros = [0.0] * len(taut_rows)
        return ImpactEquations(
            jacobian,
            closing_speeds,
            [point.elasticity for point in points] + zeros,
            [point.friction for point in points] + zeros,
            np.array(inverse_masses),
        )

    def _solve_with_joints(
        self, points: list[Point], bodies: list[int], equations: ImpactEquations
    ) -> ImpactSolution:
        """Solve for the impulses of points with the response of joints.

        Solve with the joints as they are; if the bodies would then violate joints
        within the next step, solve again with both poses.
        """
        jacobian = equations.jacobian
        inverse = equations.inverse_masses
        response = self._assemblies.response(bodies, inverse, self._middle)
        removed_velocities = np.zeros(len(inverse))
        tolerance = self._tolerance
        if self._budget.exceeded_by:
            tolerance = TUNING.heap_tolerance
        # A joint turns while an impulse acts: its response is that of both poses
        # together.
        for attempt in range(TUNING.max_poses):
            response_to_points = response @ jacobian.T
            impulses, passes = simultaneous_impulses(
                jacobian @ response_to_points,
                equations.speeds + jacobian @ removed_velocities,
                equations.elasticity,
                equations.friction,
                tolerance,
            )
            self._budget.spend(passes, points)
            # The last attempt is final. Each further pose would add equations that
            # could contradict each other.
            if attempt == TUNING.max_poses - 1:
                break
            change = response_to_points @ impulses
            later_pose = self._pose_ahead(bodies, change, inverse)
            if later_pose is None:
                break
            response = self._assemblies.response(
                bodies, inverse, self._middle, later_pose
            )
            removed_velocities = self._remove_excluded_speeds(bodies, inverse, response)
        return ImpactSolution(impulses, response_to_points, removed_velocities)

    def _remove_excluded_speeds(
        self, bodies: list[int], inverse: Array, response: Array
    ) -> Array:
        """Return the changes (3n,) that remove the velocities excluded by joints.

        Chains that become taut stop at once: a partner that met them at their old
        speed, while they no longer yield, would get energy from nowhere. The loss is
        counted.
        """
        # The response K times the mass matrix projects velocities onto those that the
        # joints permit. Immovable bodies have no mass here, and their velocities do not
        # change.
        speeds = np.array([self._speeds(body) for body in bodies]).ravel()
        is_free = inverse > 0
        mass = np.divide(1.0, inverse, out=np.zeros_like(inverse), where=is_free)
        changes = np.where(is_free, response @ (mass * speeds) - speeds, 0.0)
        # Kinetic energy changes by m * change * (speed + change / 2), the mean speed
        # times the change of momentum.
        self._loss -= float((mass * changes * (speeds + changes / 2)).sum())
        return changes

    def _pose_ahead(
        self, bodies: list[int], change: Array, inverse: Array
    ) -> Array | None:
        """Return the poses (N, 3) a step later, if joints then exclude the bodies' new
        velocities.

        Bars in a line yield to an impact at first but not any further: they resist at
        once.
        """
        held_rows = [
            k
            for k, body in enumerate(bodies)
            if self._assemblies.group_of(body) is not None
        ]
        if not held_rows:
            return None
        # Add the changes of this step's impacts to the velocities, and move on for a
        # step.
        velocity = self._velocity.copy()
        for k, body in enumerate(bodies):
            velocity[body] = self._speeds(body)
            velocity[body] += change[3 * k : 3 * k + 3]
        later_pose = self._middle + velocity * self._h
        permitted_velocities = self._assemblies.project_velocities(later_pose, velocity)
        rows = [bodies[k] for k in held_rows]
        removed_velocities = (velocity - permitted_velocities)[rows].ravel().tolist()
        speeds = velocity[rows].ravel().tolist()
        inverse_masses = inverse.reshape(-1, 3)[held_rows].ravel().tolist()
        # Tiny corrections, such as those by the curvature of a circular path, are no
        # jolt: the first solution then stands.
        smallest_speed = self._threshold * MIN_JOLT
        if is_jolt(inverse_masses, speeds, removed_velocities, smallest_speed):
            return later_pose
        return None

    def _script_speeds(self, p: Point) -> tuple[float, float]:
        """Return the speeds of the first's point minus the second's, px/s, if they are
        scripted.

        The speeds are along the normal and along the surface.
        """
        # Free bodies contribute no speed here: only the motion that a script or a belt
        # imposes on the contact does work from outside.
        sides = [
            [0.0] * 3 if self._is_free(body) else self._speeds(body)
            for body in (p.a, p.b)
        ]
        if not (any(sides[0]) or any(sides[1]) or p.belt):
            return 0.0, 0.0
        leaving_speed, sliding_speed = p.motion(*sides)
        return -leaving_speed, -sliding_speed
