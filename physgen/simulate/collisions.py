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
    few: int = 30
    """Maximum number of passes over points that close together; `few` for heaps."""
    rounds: int = 400
    """Rounds of impacts within one instant; the engine treats the remaining points as
    inelastic."""
    faint: float = 1e-4
    """Share of a step's largest closing speed below which the engine treats a later
    impact as inelastic: echoes would never end otherwise."""
    exact: float = 1e-13
    nearly: float = 1e-5
    """Relative change of impulses at which a solution has converged; `nearly` for
    heaps.
    """
    base: float = 2e6
    per_second: float = 1e6
    """Work of a run, in passes over points: at its begin, and per second of the scene.

    The bundled scenes need less than 1 % of it. Beyond the limit, each step has one
    round: a ton on a saucer must not take hours."""
    crowd: int = 500  # contact points of a heap
    dense: int = 40
    """Number of speeds that a point changes above which arrays are faster than lists,
    measured with 10 to 100 points.
    """
    aheads: int = 2
    """Number of poses at which the joints must allow a velocity: now, and a
    step later.
    """
    together: float = 0.02
    """Share of a step within which two contacts of one body are simultaneous."""


TUNING = CollisionTuning()
LEAST_JOLT = 0.1
"""Share of the threshold of impacts below which motion is not tested against joints."""


class WorkBudget:
    """The limit on a run's work: passes over points that close together."""

    def __init__(self, bodies: int) -> None:
        self._crowd = 1 + bodies / TUNING.crowd
        self._left = TUNING.base * self._crowd
        self.exceeded_by: tuple[int, int] | None = None
        """The first pair of the group that used up the budget."""

    def grant(self, seconds: float) -> None:
        """Add the work for a step of the scene."""
        self._left += TUNING.per_second * seconds * self._crowd

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
    target = -(1 + elasticity) * vn
    if mu == 0:
        return target / nn, 0.0
    determinant = nn * tt - nt * nt
    jn, jt = (
        (target * tt + nt * vt) / determinant,
        (-nt * target - nn * vt) / determinant,
    )
    if jn <= 0 or abs(jt) > mu * jn:
        # Friction cannot hold the point: it acts with its full coefficient against the
        # sliding.
        side = (1.0 if jt > 0 else -1.0) if jt else (-1.0 if vt > 0 else 1.0)
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
    full, passes = _solve_impulses(matrix, before, elasticity, friction, exact)
    is_bumper = max(elasticity, default=0.0) > 1
    if not any(elasticity) or is_bumper or _gain(matrix, before, full) <= 0:
        return full, passes
    inelastic, more_passes = _solve_impulses(
        matrix, before, [0.0] * len(elasticity), friction, exact
    )
    # Bisect between the inelastic and the full solution.
    share, step = 0.0, 0.5
    for _ in range(30):
        if _gain(matrix, before, inelastic + (share + step) * (full - inelastic)) <= 0:
            share += step
        step /= 2
    return inelastic + share * (full - inelastic), passes + more_passes


def _gain(matrix: Array, before: Array, impulse: Array) -> float:
    """Return the kinetic energy added by impulses, g·px²/s²; 0 within rounding
    errors.
    """
    change = impulse * (before + matrix @ impulse / 2)
    gain = float(change.sum())
    return gain if gain > 1e-9 * float(np.abs(change).sum()) else 0.0


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
    if np.count_nonzero(matrix) > TUNING.dense * len(before):
        return _solve_dense_impulses(matrix, before, elasticity, friction, exact)
    speed = before.tolist()
    impulse, inverse_diagonal = (
        [0.0] * len(speed),
        [1.0 / max(d, 1e-300) for d in np.diag(matrix).tolist()],
    )
    goals = [-e * min(v, 0.0) for e, v in zip(elasticity, speed[::2], strict=True)]
    # Each point changes the speeds of few others: store the matrix by sparse columns.
    columns: list[list[tuple[int, float]]] = [[] for _ in speed]
    rows, columns_of_values = np.nonzero(matrix)
    for row, column_index, value in zip(
        rows.tolist(),
        columns_of_values.tolist(),
        matrix[rows, columns_of_values].tolist(),
        strict=True,
    ):
        columns[column_index].append((row, value))
    normals, sides = range(0, len(speed), 2), range(1, len(speed), 2)
    points = list(
        zip(
            normals,
            sides,
            goals,
            friction,
            inverse_diagonal[::2],
            inverse_diagonal[1::2],
            columns[::2],
            columns[1::2],
            strict=True,
        )
    )
    for passes in range(1, 1 + (TUNING.sweeps if exact < 1e-6 else TUNING.few)):  # noqa: B007 - counts
        # Each point in turn takes the impulse that would give it its goal, while all
        # others keep theirs; the passes converge as in any Gauss-Seidel method.
        largest_change = largest_impulse = 0.0
        for (
            normal_row,
            tangent_row,
            goal,
            mu,
            inverse_normal,
            inverse_tangent,
            normal_column,
            tangent_column,
        ) in points:
            new_impulse = (
                impulse[normal_row] + (goal - speed[normal_row]) * inverse_normal
            )
            # A contact pushes and never pulls. `not >` also catches NaN.
            if not new_impulse > 0.0:
                new_impulse = 0.0
            impulse_step = new_impulse - impulse[normal_row]
            if impulse_step:
                impulse[normal_row] = new_impulse
                for k, value in normal_column:
                    speed[k] += impulse_step * value
                if impulse_step > largest_change or -impulse_step > largest_change:
                    largest_change = abs(impulse_step)
            if new_impulse > largest_impulse:
                largest_impulse = new_impulse
            # Coulomb's law: friction stops the slip, within mu times the normal
            # impulse.
            if mu > 0:
                friction_limit, new_impulse = (
                    mu * new_impulse,
                    impulse[tangent_row] - speed[tangent_row] * inverse_tangent,
                )
                if not -friction_limit < new_impulse < friction_limit:
                    new_impulse = (
                        friction_limit if new_impulse > 0.0 else -friction_limit
                    )
                impulse_step = new_impulse - impulse[tangent_row]
                if impulse_step:
                    impulse[tangent_row] = new_impulse
                    for k, value in tangent_column:
                        speed[k] += impulse_step * value
                    if impulse_step > largest_change or -impulse_step > largest_change:
                        largest_change = abs(impulse_step)
        # The change of a pass relative to the largest impulse estimates the relative
        # error.
        if largest_change <= exact * largest_impulse:
            break
    return np.array(impulse), passes


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
    speed, impulse = before.copy(), [0.0] * len(before)
    # One product with a whole column is faster than a loop over many entries.
    columns = np.ascontiguousarray(matrix.T)
    inverse_diagonal = [1.0 / max(d, 1e-300) for d in np.diag(matrix).tolist()]
    goals = [
        -e * min(v, 0.0) for e, v in zip(elasticity, before[::2].tolist(), strict=True)
    ]
    maximum = TUNING.sweeps if exact < 1e-6 else TUNING.few
    for passes in range(1, 1 + maximum):  # noqa: B007 - counts
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
                tangent_impulse = (
                    friction_limit if tangent_impulse > 0.0 else -friction_limit
                )
            impulse_step = tangent_impulse - impulse[t]
            if impulse_step:
                impulse[t] = tangent_impulse
                speed += impulse_step * columns[t]
                largest_change = max(largest_change, abs(impulse_step))
        if largest_change <= exact * largest_impulse:
            break
    return np.array(impulse), passes


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
        touched: Flags,
        h: float,
        threshold: float,
        within: Array | None = None,
    ) -> None:
        """Find the points that close in a step.

        `touched` (K,): pairs that already touched a step ago. `within`: (N, 3)
        velocities within the step, if those of `motion` are the ones at its end: the
        contacts then act over the whole step.
        """
        points = points.sorted()
        self._within = within
        half_step = h / 2 if within is None else 0.0
        self._middle = motion.pose - motion.velocity * half_step
        """Poses (N, 3) in the middle of the step, where joints permit its
        velocities.
        """
        self._allowed: Array | None = None
        self._properties, self._assemblies = properties, assemblies
        self._pose, self._velocity, self._drift = (
            motion.pose,
            motion.velocity,
            motion.drift,
        )
        self._found, self._h, self._threshold = points, h, threshold
        self._own = points.closing > threshold
        self._earlier = points.earlier(self._own, touched, h)
        self._exact = (
            TUNING.exact if len(points.first) < TUNING.crowd else TUNING.nearly
        )
        # A sorted list of points by body finds the points beside a body by bisection.
        partners = np.concatenate([points.first, points.second])
        order = np.argsort(partners, kind="stable")
        self._owner, self._listed = partners[order], order % len(points.first)
        self._points: dict[int, Point] = {}
        self._v: dict[int, list[float]] = {}
        self._shift: dict[int, list[float]] = {}
        self._when: dict[int, float] = {}
        self._leap: dict[int, tuple[float, float]] = {}
        self._rows: list[tuple[int, int, float, float, float]] = []
        self._loss = self._work = 0.0

    def run(self, budget: WorkBudget) -> Impacts:
        """Resolve rounds of impacts until no point closes, or one round if the budget
        is spent.

        The engine treats the remaining points as inelastic.
        """
        self._budget = budget
        closing = [int(k) for k in np.flatnonzero(self._own)]
        smallest_speed = max(
            self._threshold, TUNING.faint * float(self._found.closing.max())
        )
        for number in range(TUNING.rounds):
            if not closing or (number and budget.exceeded_by):
                break
            closing_times = {k: self._time(k, number) for k in closing}
            # Of all points that close, only the first of each body are solved: they
            # change which other points close, and when.
            leading_points = self._leading(closing, closing_times)
            self._begin(leading_points, closing_times)
            moved_bodies = set[int]().union(
                *(
                    self._solve(group, closing_times)
                    for group in self._groups(leading_points)
                )
            )
            nearby_points = set(closing).union(
                *(self._beside(body) for body in sorted(moved_bodies))
            )
            points = ((k, self._point(k)) for k in sorted(nearby_points))
            closing = [
                k
                for k, point in points
                if point.leaving(self._speeds(point.a), self._speeds(point.b))
                < -smallest_speed
            ]
        velocity, shift = self._velocity.copy(), np.zeros_like(self._velocity)
        for body, (vx, vy, spin) in self._v.items():
            leap_x, leap_y = self._leap.get(body, (0.0, 0.0))
            # The engine's velocities are those between two steps: remove the part of
            # the drift that `_begin` has added.
            velocity[body] = vx - leap_x, vy - leap_y, spin
            if self._allowed is not None:
                velocity[body] += self._velocity[body] - self._allowed[body]
        for body, moved_by in self._shift.items():
            shift[body] = moved_by
        rows = np.array(self._rows).reshape(-1, 5)
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

    def _free(self, body: int) -> bool:
        """Check whether a body can be moved by an impact."""
        return self._properties.lightness[body] > 0

    def _beside(self, body: int) -> list[int]:
        """Return the points at a movable body; a wall does not pass an impact on."""
        if not self._free(body):
            return []
        begin, end = self._owner.searchsorted([body, body + 1])
        point_rows: list[int] = self._listed[begin:end].tolist()
        return point_rows

    def _speeds(self, body: int) -> list[float]:
        """Return the present velocity of a body, which is changed in place by
        impacts.
        """
        if body not in self._v:
            velocity = self._velocity
            if self._assemblies.group_of(body) is not None:
                velocity = self._velocity_allowed()
            self._v[body] = velocity[body].tolist()
        return self._v[body]

    def _velocity_allowed(self) -> Array:
        """Return the permitted velocities (N, 3) of joints in the middle of the step.

        The rest, by which a chord differs from a tangent, takes no part in impacts: it
        would create energy.
        """
        if self._allowed is None:
            self._allowed = self._assemblies.project_velocities(
                self._middle, self._velocity
            )
        return self._allowed

    def _time(self, k: int, number: int) -> float:
        """Return the time of an impact, s before the step's end.

        It is the point's own closing time, or that of the impact that moved a partner.
        """
        point = self._point(k)
        if number == 0 or (point.own and point.earlier > 0):
            return point.earlier
        return max(0.0, self._when.get(point.a, 0.0), self._when.get(point.b, 0.0))

    def _leading(self, closing: Iterable[int], times: dict[int, float]) -> list[int]:
        """Return the points that close first among those with a common body."""
        largest_times: dict[int, float] = {}
        for k in closing:
            point = self._point(k)
            for body in (point.a, point.b):
                largest_times[body] = max(largest_times.get(body, -1.0), times[k])
        # Times count back from the end of the step, so that the first impact of a body
        # has the largest time. Points within the slack close together.
        slack = TUNING.together * self._h
        leading_points = []
        for k in closing:
            point = self._point(k)
            if all(
                not self._free(body) or times[k] >= largest_times[body] - slack
                for body in (point.a, point.b)
            ):
                leading_points.append(k)
        return leading_points

    def _begin(self, struck: Iterable[int], times: dict[int, float]) -> None:
        """Move the velocities of struck bodies to the impact's time.

        Velocities of a step are those of its middle, to which the drift is added.
        """
        for k in struck:
            point = self._point(k)
            for body in (point.a, point.b):
                if body not in self._when and self._free(body):
                    self._when[body] = times[k]
                    # Velocities are those at the middle of the step. Gravity changes
                    # them until the impact.
                    time_from_middle = self._h / 2 - times[k]
                    leap = (
                        float(self._drift[body, 0]) * time_from_middle,
                        float(self._drift[body, 1]) * time_from_middle,
                    )
                    self._leap[body] = leap
                    velocity = self._speeds(body)
                    velocity[0] += leap[0]
                    velocity[1] += leap[1]

    def _groups(self, struck: list[int]) -> list[list[int]]:
        """Group the points that share movable bodies or groups of joints."""
        if len(struck) == 1:
            return [struck]
        # Union-find: points on the same movable body, or on one group of joints,
        # interact.
        root = {k: k for k in struck}
        point_of_owner: dict[int, int] = {}
        for k in struck:
            point = self._point(k)
            for body in (point.a, point.b):
                if self._free(body):
                    joint_group = self._assemblies.group_of(body)
                    first_point = point_of_owner.setdefault(
                        body if joint_group is None else joint_group, k
                    )
                    root[find(root, k)] = find(root, first_point)
        groups: dict[int, list[int]] = {}
        for k in struck:
            groups.setdefault(find(root, k), []).append(k)
        return list(groups.values())

    def _point(self, k: int) -> Point:
        """Return a contact point at its closing time."""
        if k not in self._points:
            self._points[k] = point_at_closing(
                self._properties,
                self._found,
                k,
                self._pose,
                self._velocity,
                self._earlier,
                self._own,
            )
        return self._points[k]

    # Effects of an impact

    def _solve(self, group: list[int], times: dict[int, float]) -> set[int]:
        """Solve for the impulses of points that close together, apply them, and return
        the bodies.
        """
        points = [self._point(k) for k in group]
        speeds_before = [
            point.motion(self._speeds(point.a), self._speeds(point.b))
            for point in points
        ]
        bodies = {
            body for point in points for body in (point.a, point.b) if self._free(body)
        }
        joint_groups = {self._assemblies.group_of(body) for body in bodies} - {None}
        drive_speeds = [self._drive(point) for point in points]
        if len(points) == 1 and not joint_groups:
            (single_point,) = points
            impulses = [
                single_point_impulse(
                    single_point.nn,
                    single_point.nt,
                    single_point.tt,
                    single_point.elasticity,
                    single_point.friction,
                    *speeds_before[0],
                )
            ]
            self._give(self._v, points[0], *impulses[0], 1.0)
            self._give(self._shift, points[0], *impulses[0], times[group[0]])
        else:
            for joint_group in joint_groups:
                bodies |= (
                    set(self._assemblies.members[joint_group])
                    if joint_group is not None
                    else set()
                )
            impulses, speeds_before = self._apply_joint_impulses(
                points, speeds_before, sorted(bodies), [times[k] for k in group]
            )
        for k, point, (jn, jt), (vn, vt), (dn, dt) in zip(
            group, points, impulses, speeds_before, drive_speeds, strict=True
        ):
            self._rows.append(
                (
                    point.a,
                    point.b,
                    jt * point.ny - jn * point.nx,
                    -jn * point.ny - jt * point.nx,
                    times[k],
                )
            )
            leaving_speed, sliding_speed = point.motion(
                self._speeds(point.a), self._speeds(point.b)
            )
            if self._within is not None:
                velocities_within = (
                    self._within[point.a].tolist(),
                    self._within[point.b].tolist(),
                )
                vn, vt = point.motion(*velocities_within)
            # An impulse does its work at the mean of the speeds before and after.
            energy_change = (
                jn * (vn + leaving_speed) / 2 + jt * (vt + sliding_speed) / 2
            )
            # The energy of a bumper counts as work.
            if point.elasticity > 1 and energy_change > 0:
                self._work += energy_change
            else:
                self._loss -= energy_change
            self._work += jn * dn + jt * dt
        return bodies

    def _give(
        self, to: dict[int, list[float]], p: Point, jn: float, jt: float, part: float
    ) -> None:
        """Add the changes of velocity by an impulse on two free bodies, times
        `part`.
        """
        # Rotate the impulse from normal and tangent to the axes of the image.
        fx, fy = (jn * p.nx - jt * p.ny) * part, (jn * p.ny + jt * p.nx) * part
        for body, m, turn, sign in (
            (p.a, p.ma, p.ea * (p.na * jn + p.ta * jt) * part, -1.0),
            (p.b, p.mb, p.eb * (p.nb * jn + p.tb * jt) * part, 1.0),
        ):
            if m > 0:
                changes = (
                    self._speeds(body)
                    if to is self._v
                    else to.setdefault(body, [0.0, 0.0, 0.0])
                )
                changes[0] += sign * m * fx
                changes[1] += sign * m * fy
                changes[2] += sign * turn

    def _apply_joint_impulses(
        self,
        points: list[Point],
        was: list[tuple[float, float]],
        bodies: list[int],
        times: list[float],
    ) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
        """Apply the impulses of points with common bodies or with joints.

        Returns the impulses, and the speeds at which the points close: those of `was`
        without the part that joints exclude.
        """
        properties = self._properties
        inverse = np.array(
            [
                [properties.lightness[b], properties.lightness[b], properties.ease[b]]
                for b in bodies
            ]
        ).ravel()
        response = self._assemblies.response(bodies, inverse, self._middle)
        first_column = {body: 3 * k for k, body in enumerate(bodies)}
        # Jacobian: rows are the closing and sliding speeds of points by velocities of
        # bodies.
        J = np.zeros((2 * len(points), len(inverse)))
        for i, p in enumerate(points):
            for body, sign, turn, slide in (
                (p.a, -1.0, p.na, p.ta),
                (p.b, 1.0, p.nb, p.tb),
            ):
                if body in first_column:
                    k = first_column[body]
                    J[2 * i, k : k + 3] = sign * p.nx, sign * p.ny, sign * turn
                    J[2 * i + 1, k : k + 3] = -sign * p.ny, sign * p.nx, sign * slide
        taut_rows = self._assemblies.taut_rows(bodies, self._middle)
        zeros = [0.0] * len(taut_rows)
        elasticity = [p.elasticity for p in points] + zeros
        friction = [p.friction for p in points] + zeros
        exact = TUNING.nearly if self._budget.exceeded_by else self._exact
        closing_speeds = np.array(was).ravel()
        if len(taut_rows):
            # Ropes and limits act like contacts without rebound and friction.
            pulls = np.zeros((2 * len(taut_rows), len(inverse)))
            pulls[::2] = taut_rows
            speeds = np.array([self._speeds(body) for body in bodies]).ravel()
            J = np.concatenate([J, pulls])
            closing_speeds = np.concatenate([closing_speeds, pulls @ speeds])
        removed_velocities = np.zeros(len(inverse))
        # Solve with the joints as they are; if the bodies would then violate joints
        # within the next step, solve again with both poses.
        for attempt in range(TUNING.aheads):
            response_to_points = response @ J.T
            impulses, passes = simultaneous_impulses(
                J @ response_to_points,
                closing_speeds + J @ removed_velocities,
                elasticity,
                friction,
                exact,
            )
            self._budget.spend(passes, points)
            if attempt == TUNING.aheads - 1:
                break
            later_pose = self._pose_ahead(
                bodies, response_to_points @ impulses, inverse
            )
            if later_pose is None:
                break
            response = self._assemblies.response(
                bodies, inverse, self._middle, later_pose
            )
            removed_velocities = self._excluded_speeds(bodies, inverse, response)
        change = response_to_points @ impulses + removed_velocities
        # An impulse earlier in the step also displaces the bodies at its end.
        times_of_impulses = np.repeat([*times, *[max(times)] * len(taut_rows)], 2)
        displacement = response_to_points @ (
            impulses * times_of_impulses
        ) + removed_velocities * max(times)
        for body, k in first_column.items():
            v, shift = self._speeds(body), self._shift.setdefault(body, [0.0, 0.0, 0.0])
            for axis in range(3):
                v[axis] += float(change[k + axis])
                shift[axis] += float(displacement[k + axis])
        closing_before, count = closing_speeds + J @ removed_velocities, 2 * len(points)
        if len(taut_rows):
            closing_after = closing_before + J @ (response_to_points @ impulses)
            self._loss -= (
                float((impulses * (closing_before + closing_after))[count:].sum()) / 2
            )
        return _as_pairs(impulses[:count]), _as_pairs(closing_before[:count])

    def _excluded_speeds(
        self, bodies: list[int], inverse: Array, response: Array
    ) -> Array:
        """Return the changes (3n,) that remove the velocities excluded by joints.

        Chains that become taut stop at once: a partner that met them at their old
        speed, while they no longer yield, would get energy from nowhere. The loss is
        counted.
        """
        speeds = np.array([self._speeds(body) for body in bodies]).ravel()
        is_free = inverse > 0
        mass = np.divide(1.0, inverse, out=np.zeros_like(inverse), where=is_free)
        changes = np.where(is_free, response @ (mass * speeds) - speeds, 0.0)
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
        smallest_speed = self._threshold * LEAST_JOLT
        return (
            later_pose
            if is_jolt(inverse_masses, speeds, removed_velocities, smallest_speed)
            else None
        )

    def _drive(self, p: Point) -> tuple[float, float]:
        """Return the speeds of the first's point minus the second's, px/s, if they are
        scripted.

        The speeds are along the normal and along the surface.
        """
        sides = [
            [0.0] * 3 if self._free(body) else self._speeds(body) for body in (p.a, p.b)
        ]
        if not (any(sides[0]) or any(sides[1]) or p.belt):
            return 0.0, 0.0
        leaving_speed, sliding_speed = p.motion(*sides)
        return -leaving_speed, -sliding_speed
