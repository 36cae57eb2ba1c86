"""Impacts: contact points that close, and the velocities after them.

Newton's elasticity and Coulomb's friction at each point. Points that close at the same instant are solved together;
then the next points that close, so that an impact travels on through what touches: the last of a row of balls takes
all, whether their gaps are 0, a hair, or a hair of overlap, and a symmetric rack stays symmetric. Few points close at a
time, so the rounds use plain numbers, and only bodies that an impact has moved are looked at again.
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
    few: int = (
        30  # passes over points that close together, at most; few in a heap of hundreds
    )
    rounds: int = 400
    """Impacts in a row within one instant; what still closes then is left to the engine, as if it did not bounce."""
    faint: float = 1e-4
    """Of a step's hardest impact: what closes more slowly after it is left to the engine, or echoes would never end."""
    exact: float = 1e-13
    nearly: float = 1e-5
    """Relative change of an impulse at which points that close together are solved: usually, and in a heap."""
    base: float = 2e6
    per_second: float = 1e6
    """Passes over points that close together that a run may begin with, and more a second of the scene: over 100 times
    what the bundled scenes need. Beyond it each step has one round: a ton on a saucer cannot keep a run for hours."""
    crowd: int = 500  # contact points of a heap
    dense: int = 40
    """Speeds that a point changes, above which arrays are faster than lists: measured with 10 to 100 points."""
    aheads: int = 2
    """Poses at which joints are asked what they allow: now, and a step later."""
    together: float = 0.02  # part of a step within which two contacts of one body count as simultaneous


TUNING = CollisionTuning()
LEAST_JOLT = 0.1
"""Of the threshold of impacts: slower motion is not asked whether joints hold it."""


class WorkBudget:
    """Passes over points that close together, which a run may make."""

    def __init__(self, bodies: int) -> None:
        self._crowd = 1 + bodies / TUNING.crowd
        self._left = TUNING.base * self._crowd
        self.exceeded_by: tuple[int, int] | None = None
        """The pair that closed fastest when nothing was left."""

    def grant(self, seconds: float) -> None:
        """Add what a step of the scene brings."""
        self._left += TUNING.per_second * seconds * self._crowd

    def spend(self, passes: int, points: list[Point]) -> None:
        """Count passes over points."""
        self._left -= passes * len(points)
        if self._left < 0 and self.exceeded_by is None:
            self.exceeded_by = points[0].a, points[0].b


def single_point_impulse(
    nn: float, nt: float, tt: float, elasticity: float, mu: float, vn: float, vt: float
) -> tuple[float, float]:
    """Impulse of a lone point in closed form: sticking where friction can hold, else sliding; no gain of energy.

    nn, nt, tt: changes of closing and sliding speed by a unit of impulse, normal and along the surface; vn (negative:
    closing), vt: the speeds.
    """
    target = -(1 + elasticity) * vn
    if mu == 0:
        return target / nn, 0.0
    det = nn * tt - nt * nt
    jn, jt = (target * tt + nt * vt) / det, (-nt * target - nn * vt) / det
    if jn <= 0 or abs(jt) > mu * jn:
        side = (1.0 if jt > 0 else -1.0) if jt else (-1.0 if vt > 0 else 1.0)
        grip = nn + side * mu * nt
        if grip < 1e-9 * nn:  # it would wedge
            return target / nn, 0.0
        jn = target / grip
        jt = side * mu * jn
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
    """Impulses (2P,), normal and along the surface in turn, of points that close together; and passes over them.

    matrix (2P, 2P) gives the changes of their speeds; before (2P,) the speeds; exact: the relative change of an impulse
    at which they count as found. Newton's rule with friction can make energy (Kane and Levinson 1985): then as much of
    the bounce as makes none.
    """
    full, passes = _swept(matrix, before, elasticity, friction, exact)
    is_bumper = max(elasticity, default=0.0) > 1
    if not any(elasticity) or is_bumper or _gain(matrix, before, full) <= 0:
        return full, passes
    dead, more = _swept(matrix, before, [0.0] * len(elasticity), friction, exact)
    part, step = 0.0, 0.5
    for _ in range(30):
        if _gain(matrix, before, dead + (part + step) * (full - dead)) <= 0:
            part += step
        step /= 2
    return dead + part * (full - dead), passes + more


def _gain(matrix: Array, before: Array, impulse: Array) -> float:
    """Kinetic energy that impulses add, g·px²/s²; 0 within rounding."""
    change = impulse * (before + matrix @ impulse / 2)
    gain = float(change.sum())
    return gain if gain > 1e-9 * float(np.abs(change).sum()) else 0.0


def _swept(
    matrix: Array,
    before: Array,
    elasticity: list[float],
    friction: list[float],
    exact: float,
) -> tuple[Array, int]:
    """Projected Gauss-Seidel to the last digits: no pull, the wanted rebound, friction within its cone."""
    if np.count_nonzero(matrix) > TUNING.dense * len(before):
        return _swept_dense(matrix, before, elasticity, friction, exact)
    speed = before.tolist()
    impulse, give = (
        [0.0] * len(speed),
        [1.0 / max(d, 1e-300) for d in np.diag(matrix).tolist()],
    )
    goals = [-e * min(v, 0.0) for e, v in zip(elasticity, speed[::2], strict=True)]
    columns: list[list[tuple[int, float]]] = [
        [] for _ in speed
    ]  # a point changes the speeds of few others
    rows, by = np.nonzero(matrix)
    for row, one, value in zip(
        rows.tolist(), by.tolist(), matrix[rows, by].tolist(), strict=True
    ):
        columns[one].append((row, value))
    normals, sides = range(0, len(speed), 2), range(1, len(speed), 2)
    points = list(
        zip(
            normals,
            sides,
            goals,
            friction,
            give[::2],
            give[1::2],
            columns[::2],
            columns[1::2],
            strict=True,
        )
    )
    for passes in range(1, 1 + (TUNING.sweeps if exact < 1e-6 else TUNING.few)):  # noqa: B007 - counts
        change = size = 0.0
        for n, t, goal, mu, give_n, give_t, by_n, by_t in points:
            new = impulse[n] + (goal - speed[n]) * give_n
            if not new > 0.0:
                new = 0.0
            step = new - impulse[n]
            if step:
                impulse[n] = new
                for k, value in by_n:
                    speed[k] += step * value
                if step > change or -step > change:
                    change = abs(step)
            if new > size:
                size = new
            if mu > 0:
                edge, new = mu * new, impulse[t] - speed[t] * give_t
                if not -edge < new < edge:
                    new = edge if new > 0.0 else -edge
                step = new - impulse[t]
                if step:
                    impulse[t] = new
                    for k, value in by_t:
                        speed[k] += step * value
                    if step > change or -step > change:
                        change = abs(step)
        if change <= exact * size:
            break
    return np.array(impulse), passes


def _swept_dense(
    matrix: Array,
    before: Array,
    elasticity: list[float],
    friction: list[float],
    exact: float,
) -> tuple[Array, int]:
    """Return what `_swept` does, to the bit, of points that change the speeds of many."""
    speed, impulse = before.copy(), [0.0] * len(before)
    columns = np.ascontiguousarray(matrix.T)
    give = [1.0 / max(d, 1e-300) for d in np.diag(matrix).tolist()]
    goals = [
        -e * min(v, 0.0) for e, v in zip(elasticity, before[::2].tolist(), strict=True)
    ]
    most = TUNING.sweeps if exact < 1e-6 else TUNING.few
    for passes in range(1, 1 + most):  # noqa: B007 - counts
        change = size = 0.0
        for point, (goal, mu) in enumerate(zip(goals, friction, strict=True)):
            n, t = 2 * point, 2 * point + 1
            new = impulse[n] + (goal - speed.item(n)) * give[n]
            if not new > 0.0:
                new = 0.0
            step = new - impulse[n]
            if step:
                impulse[n] = new
                speed += step * columns[n]
                change = max(change, abs(step))
            size = max(size, new)
            if mu <= 0:
                continue
            edge = mu * new
            slid = impulse[t] - speed.item(t) * give[t]
            if not -edge < slid < edge:
                slid = edge if slid > 0.0 else -edge
            step = slid - impulse[t]
            if step:
                impulse[t] = slid
                speed += step * columns[t]
                change = max(change, abs(step))
        if change <= exact * size:
            break
    return np.array(impulse), passes


def _as_pairs(values: Array) -> list[tuple[float, float]]:
    """Return values (2P,), normal and along the surface in turn, as P pairs."""
    return [(float(normal), float(side)) for normal, side in values.reshape(-1, 2)]


@dataclass(frozen=True)
class Impacts:
    """What the impacts of one step did."""

    velocity: Array  # (N, 3): px/s, px/s, rad/s after the last
    shift: Array
    """(N, 3): how far the impacts, having fallen within the step, move the bodies at its end: px, px, rad."""
    first: Index  # (B,): the struck pairs
    second: Index
    impulse: Array  # (B, 2) g·px/s that the second gave the first
    earlier: Array  # (B,) s before the end of the step
    lost: float  # g·px²/s² that went into elasticity below 1 and friction
    work: float  # g·px²/s² that scripted bodies did


@dataclass(frozen=True)
class StepMotion:
    """How N bodies and walls move in one step, before contacts."""

    pose: Array  # (N, 3) at the step's end
    velocity: Array  # (N, 3) within the step
    drift: Array  # (N, 2) px/s²: acceleration of what flies freely, 0 for the rest


class ImpactSolver:
    """Resolves what closes faster than `threshold` px/s in one step of h seconds."""

    def __init__(
        self,
        properties: ContactProperties,
        joined: Assemblies,
        motion: StepMotion,
        points: Points,
        touched: Flags,
        h: float,
        threshold: float,
        within: Array | None = None,
    ) -> None:
        """`touched` (K,): whether the pair touched a step ago already.

        within: (N, 3) velocities within the step, if the motion's are those at its
        end: the contacts last, and act in the course of the step.
        """
        points = points.sorted()
        self._within = within
        span = h / 2 if within is None else 0.0
        self._middle = motion.pose - motion.velocity * span
        """(N, 3): poses in the middle of the step, at which its velocities are those of joints."""
        self._allowed: Array | None = None
        self._properties, self._joined = properties, joined
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
        both = np.concatenate([points.first, points.second])
        order = np.argsort(both, kind="stable")
        self._owner, self._listed = both[order], order % len(points.first)
        self._points: dict[int, Point] = {}
        self._v: dict[int, list[float]] = {}
        self._shift: dict[int, list[float]] = {}
        self._when: dict[int, float] = {}
        self._leap: dict[int, tuple[float, float]] = {}
        self._rows: list[tuple[int, int, float, float, float]] = []
        self._lost = self._work = 0.0

    def run(self, budget: WorkBudget) -> Impacts:
        """Rounds until nothing closes, or one where the budget is spent: what closes then is left to the engine."""
        self._budget = budget
        closing = [int(k) for k in np.flatnonzero(self._own)]
        faint = max(self._threshold, TUNING.faint * float(self._found.closing.max()))
        for number in range(TUNING.rounds):
            if not closing or (number and budget.exceeded_by):
                break
            times = {k: self._time(k, number) for k in closing}
            struck = self._leading(closing, times)
            self._begin(struck, times)
            moved = set[int]().union(
                *(self._solve(group, times) for group in self._groups(struck))
            )
            near = set(closing).union(*(self._beside(body) for body in sorted(moved)))
            points = ((k, self._point(k)) for k in sorted(near))
            closing = [
                k
                for k, p in points
                if p.leaving(self._speeds(p.a), self._speeds(p.b)) < -faint
            ]
        velocity, shift = self._velocity.copy(), np.zeros_like(self._velocity)
        for body, (vx, vy, spin) in self._v.items():
            lx, ly = self._leap.get(body, (0.0, 0.0))
            velocity[body] = vx - lx, vy - ly, spin
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
            lost=self._lost,
            work=self._work,
        )

    # Who and when

    def _free(self, body: int) -> bool:
        return self._properties.lightness[body] > 0

    def _beside(self, body: int) -> list[int]:
        """Points at a body that can move; a wall is no messenger."""
        if not self._free(body):
            return []
        begin, end = self._owner.searchsorted([body, body + 1])
        found: list[int] = self._listed[begin:end].tolist()
        return found

    def _speeds(self, body: int) -> list[float]:
        if body not in self._v:
            velocity = self._velocity
            if self._joined.of(body) is not None:
                velocity = self._velocity_allowed()
            self._v[body] = velocity[body].tolist()
        return self._v[body]

    def _velocity_allowed(self) -> Array:
        """Return the velocities (N, 3) that joints allow in the middle of the step.

        What they exclude, as a chord is no tangent, takes no part in impacts: it would
        make energy.
        """
        if self._allowed is None:
            self._allowed = self._joined.allowed(self._middle, self._velocity)
        return self._allowed

    def _time(self, k: int, number: int) -> float:
        """s before the step's end: a point's own time, or that of the impact that a partner brings."""
        p = self._point(k)
        if number == 0 or (p.own and p.earlier > 0):
            return p.earlier
        return max(0.0, self._when.get(p.a, 0.0), self._when.get(p.b, 0.0))

    def _leading(self, closing: Iterable[int], times: dict[int, float]) -> list[int]:
        """The points that close first among those that share a body with them."""
        latest: dict[int, float] = {}
        for k in closing:
            p = self._point(k)
            for body in (p.a, p.b):
                latest[body] = max(latest.get(body, -1.0), times[k])
        slack = TUNING.together * self._h
        leads = []
        for k in closing:
            p = self._point(k)
            if all(
                not self._free(body) or times[k] >= latest[body] - slack
                for body in (p.a, p.b)
            ):
                leads.append(k)
        return leads

    def _begin(self, struck: Iterable[int], times: dict[int, float]) -> None:
        """Velocities between two steps are those of the middle: bring what is struck first to the impact's time."""
        for k in struck:
            p = self._point(k)
            for body in (p.a, p.b):
                if body not in self._when and self._free(body):
                    self._when[body] = times[k]
                    part = self._h / 2 - times[k]
                    leap = (
                        float(self._drift[body, 0]) * part,
                        float(self._drift[body, 1]) * part,
                    )
                    self._leap[body] = leap
                    v = self._speeds(body)
                    v[0] += leap[0]
                    v[1] += leap[1]

    def _groups(self, struck: list[int]) -> list[list[int]]:
        """Points that share movable bodies, together."""
        if len(struck) == 1:
            return [struck]
        root = {k: k for k in struck}
        holder: dict[int, int] = {}
        for k in struck:
            p = self._point(k)
            for body in (p.a, p.b):
                if self._free(body):
                    whole = self._joined.of(body)
                    other = holder.setdefault(body if whole is None else whole, k)
                    root[find(root, k)] = find(root, other)
        groups: dict[int, list[int]] = {}
        for k in struck:
            groups.setdefault(find(root, k), []).append(k)
        return list(groups.values())

    def _point(self, k: int) -> Point:
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

    # What an impact does

    def _solve(self, group: list[int], times: dict[int, float]) -> set[int]:
        """Find the impulses of points that close together, and carry them out; the bodies that they move."""
        points = [self._point(k) for k in group]
        was = [p.motion(self._speeds(p.a), self._speeds(p.b)) for p in points]
        bodies = {body for p in points for body in (p.a, p.b) if self._free(body)}
        wholes = {self._joined.of(body) for body in bodies} - {None}
        driven = [self._drive(p) for p in points]
        if len(points) == 1 and not wholes:
            (q,) = points
            found = [
                single_point_impulse(
                    q.nn, q.nt, q.tt, q.elasticity, q.friction, *was[0]
                )
            ]
            self._give(self._v, points[0], *found[0], 1.0)
            self._give(self._shift, points[0], *found[0], times[group[0]])
        else:
            for whole in wholes:
                bodies |= (
                    set(self._joined.members[whole]) if whole is not None else set()
                )
            found, was = self._together(
                points, was, sorted(bodies), [times[k] for k in group]
            )
        for k, p, (jn, jt), (vn, vt), (dn, dt) in zip(
            group, points, found, was, driven, strict=True
        ):
            self._rows.append(
                (p.a, p.b, jt * p.ny - jn * p.nx, -jn * p.ny - jt * p.nx, times[k])
            )
            leaves, slides = p.motion(self._speeds(p.a), self._speeds(p.b))
            if self._within is not None:
                sides = self._within[p.a].tolist(), self._within[p.b].tolist()
                vn, vt = p.motion(*sides)
            taken = jn * (vn + leaves) / 2 + jt * (vt + slides) / 2
            if p.elasticity > 1 and taken > 0:  # of a bumper
                self._work += taken
            else:
                self._lost -= taken
            self._work += jn * dn + jt * dt
        return bodies

    def _give(
        self, to: dict[int, list[float]], p: Point, jn: float, jt: float, part: float
    ) -> None:
        """Add the changes of velocity by an impulse on two free bodies, times `part`."""
        fx, fy = (jn * p.nx - jt * p.ny) * part, (jn * p.ny + jt * p.nx) * part
        for body, m, turn, sign in (
            (p.a, p.ma, p.ea * (p.na * jn + p.ta * jt) * part, -1.0),
            (p.b, p.mb, p.eb * (p.nb * jn + p.tb * jt) * part, 1.0),
        ):
            if m > 0:
                row = (
                    self._speeds(body)
                    if to is self._v
                    else to.setdefault(body, [0.0, 0.0, 0.0])
                )
                row[0] += sign * m * fx
                row[1] += sign * m * fy
                row[2] += sign * turn

    def _together(
        self,
        points: list[Point],
        was: list[tuple[float, float]],
        bodies: list[int],
        times: list[float],
    ) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
        """Carry out the impulses of points that share bodies, or whose bodies joints hold.

        Returns the impulses, and the speeds at which the points close: those in `was`
        without what joints exclude.
        """
        properties = self._properties
        inverse = np.array(
            [
                [properties.lightness[b], properties.lightness[b], properties.ease[b]]
                for b in bodies
            ]
        ).ravel()
        response = self._joined.response(bodies, inverse, self._middle)
        place = {body: 3 * k for k, body in enumerate(bodies)}
        J = np.zeros((2 * len(points), len(inverse)))
        for i, p in enumerate(points):
            for body, sign, turn, slide in (
                (p.a, -1.0, p.na, p.ta),
                (p.b, 1.0, p.nb, p.tb),
            ):
                if body in place:
                    k = place[body]
                    J[2 * i, k : k + 3] = sign * p.nx, sign * p.ny, sign * turn
                    J[2 * i + 1, k : k + 3] = -sign * p.ny, sign * p.nx, sign * slide
        taut = self._joined.taut_rows(bodies, self._middle)
        bare = [0.0] * len(taut)
        elasticity = [p.elasticity for p in points] + bare
        friction = [p.friction for p in points] + bare
        exact = TUNING.nearly if self._budget.exceeded_by else self._exact
        approach = np.array(was).ravel()
        if len(taut):
            # ropes and limits act as contacts without rebound and friction
            pulls = np.zeros((2 * len(taut), len(inverse)))
            pulls[::2] = taut
            speeds = np.array([self._speeds(body) for body in bodies]).ravel()
            J = np.concatenate([J, pulls])
            approach = np.concatenate([approach, pulls @ speeds])
        removed = np.zeros(len(inverse))
        for attempt in range(TUNING.aheads):
            spread = response @ J.T
            found, passes = simultaneous_impulses(
                J @ spread, approach + J @ removed, elasticity, friction, exact
            )
            self._budget.spend(passes, points)
            if attempt == TUNING.aheads - 1:
                break
            ahead = self._pose_ahead(bodies, spread @ found, inverse)
            if ahead is None:
                break
            response = self._joined.response(bodies, inverse, self._middle, ahead)
            removed = self._excluded_speeds(bodies, inverse, response)
        change = spread @ found + removed
        acted = np.repeat([*times, *[max(times)] * len(taut)], 2)
        moved = spread @ (found * acted) + removed * max(times)
        for body, k in place.items():
            v, shift = self._speeds(body), self._shift.setdefault(body, [0.0, 0.0, 0.0])
            for axis in range(3):
                v[axis] += float(change[k + axis])
                shift[axis] += float(moved[k + axis])
        closing, count = approach + J @ removed, 2 * len(points)
        if len(taut):
            leaving = closing + J @ (spread @ found)
            self._lost -= float((found * (closing + leaving))[count:].sum()) / 2
        return _as_pairs(found[:count]), _as_pairs(closing[:count])

    def _excluded_speeds(
        self, bodies: list[int], inverse: Array, response: Array
    ) -> Array:
        """Return the changes (3n,) of velocities that take out what joints exclude.

        Chains that become taut stop at once: a partner that met them at the speed they
        still have, while they yield to nothing, would get energy from nowhere. The loss
        is counted.
        """
        speeds = np.array([self._speeds(body) for body in bodies]).ravel()
        is_free = inverse > 0
        mass = np.divide(1.0, inverse, out=np.zeros_like(inverse), where=is_free)
        removed = np.where(is_free, response @ (mass * speeds) - speeds, 0.0)
        self._lost -= float((mass * removed * (speeds + removed / 2)).sum())
        return removed

    def _pose_ahead(
        self, bodies: list[int], change: Array, inverse: Array
    ) -> Array | None:
        """Return the poses (N, 3) a step later, if joints then exclude the velocities that the bodies get.

        Bars in a line yield to an impact, and no further: they hold it at once.
        """
        held = [k for k, body in enumerate(bodies) if self._joined.of(body) is not None]
        if not held:
            return None
        velocity = self._velocity.copy()
        for k, body in enumerate(bodies):
            velocity[body] = self._speeds(body)
            velocity[body] += change[3 * k : 3 * k + 3]
        ahead = self._middle + velocity * self._h
        after = self._joined.allowed(ahead, velocity)
        rows = [bodies[k] for k in held]
        taken = (velocity - after)[rows].ravel().tolist()
        speeds = velocity[rows].ravel().tolist()
        light = inverse.reshape(-1, 3)[held].ravel().tolist()
        least = self._threshold * LEAST_JOLT
        return ahead if is_jolt(light, speeds, taken, least) else None

    def _drive(self, p: Point) -> tuple[float, float]:
        """px/s, along the normal and the surface, of the first's point less the second's, where they are scripted."""
        sides = [
            [0.0] * 3 if self._free(body) else self._speeds(body) for body in (p.a, p.b)
        ]
        if not (any(sides[0]) or any(sides[1]) or p.belt):
            return 0.0, 0.0
        leaves, slides = p.motion(*sides)
        return -leaves, -slides
