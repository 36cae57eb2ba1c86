"""Bodies connected by joints: velocities under constraints, and responses to
impulses.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, inf, sqrt
from operator import add, mul
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Joint, World
from physgen.scene.scene import SPRINGS, JointKind, Motion
from physgen.simulate.bounds import (
    MET_IN_STEP,
    TAUT_IN_IMPACT,
    Bound,
    BoundedGroup,
    BoundedMotion,
    bounds_of,
    guide_rows,
    has_bounds,
    motor_bound,
)
from physgen.simulate.contacts import Order

Array = NDArray[np.float64]


def find(root: dict[int, int], k: int) -> int:
    """Return the root of the tree of `k`, and shorten its branch on
    the way.
    """
    while root[k] != k:
        root[k] = root[root[k]]
        k = root[k]
    return k


SINGULAR = 1e-10
"""Relative size of singular values that count as 0, since joints may be redundant."""
JOLT = 0.002
"""Share of a group's kinetic energy that the closing of gaps may have; a rotation by
0.06 rad in a step has 0.001.
"""
SOFTNESS = 1e-3
"""Compliance of joints, relative to their response, while gaps are closed without
speed.
"""


class ConstrainedMotion(NamedTuple):
    """The effect of joints on N bodies in a step."""

    velocity: Array  # (N, 3): px/s, px/s, rad/s
    work: float  # g·px²/s² of work by motors
    loss: float
    """Energy taken by contradictory joints, g·px²/s²."""
    shift: Array  # (N, 3): px, px, rad: displacements that close gaps at once
    early_loss: float
    """Part of `loss` that is already missing in the mean of both velocities."""
    script_loss: float
    """Part of `loss` in groups with scripted bodies, which did that work."""


class Assemblies:
    """Groups of dynamic bodies connected by pins, welds and motors.

    Springs do not connect bodies here, since they yield within an impact.
    """

    def __init__(self, world: World) -> None:
        is_dynamic = [body.motion is Motion.DYNAMIC for body in world.bodies]
        self.members: dict[int, list[int]] = {}
        """Bodies by group."""
        self._joints: dict[int, list[Joint]] = {}
        # Union-find: bodies that a chain of joints connects have the same root.
        root = {k: k for k in range(len(world.bodies))}
        joints = [j for j in world.joints if j.kind not in SPRINGS]
        for joint in joints:
            if (
                joint.second is not None
                and is_dynamic[joint.first]
                and is_dynamic[joint.second]
            ):
                root[find(root, joint.first)] = find(root, joint.second)
        self.busy = any(
            is_dynamic[j.first] or (j.second is not None and is_dynamic[j.second])
            for j in joints
        )
        self._root: dict[int, int] = {}
        for joint in joints:
            for body in (joint.first, joint.second):
                if body is not None and is_dynamic[body]:
                    self._root[body] = find(root, body)
            dynamic_body = next(
                (
                    b
                    for b in (joint.first, joint.second)
                    if b is not None and is_dynamic[b]
                ),
                None,
            )
            if dynamic_body is not None:
                self._joints.setdefault(find(root, dynamic_body), []).append(joint)
        for body, group in self._root.items():
            self.members.setdefault(group, []).append(body)
        for members in self.members.values():
            members.sort()
        self.bodies = sorted(self._root)
        """All bodies with joints."""
        # Static and scripted bodies are part of the linear system, too, with infinite
        # mass.
        self._held: list[tuple[list[Joint], list[int], list[float]]] = []
        for _, joints in sorted(self._joints.items()):
            bodies = sorted(
                {
                    b
                    for joint in joints
                    for b in (joint.first, joint.second)
                    if b is not None
                }
            )
            weights = [
                (body.mass, body.mass, body.moment)
                for body in (world.bodies[b] for b in bodies)
            ]
            inverse_masses = [
                1 / m if is_dynamic[b] else 0.0
                for b, inertia in zip(bodies, weights, strict=True)
                for m in inertia
            ]
            self._held.append((joints, bodies, inverse_masses))
        self._scripted = {
            body
            for _, bodies, _ in self._held
            for body in bodies
            if world.bodies[body].motion is Motion.SCRIPTED
        }
        self.has_scripts = bool(self._scripted)
        """Whether joints connect a dynamic body with a scripted one."""
        self._jolt = float(np.hypot(*world.gravity))
        """Gravity, px/s²: gaps that close more slowly than a fall are no jolts."""
        self._all = sorted({body for _, bodies, _ in self._held for body in bodies})
        self._places = [
            {body: 3 * k for k, body in enumerate(bodies)}
            for _, bodies, _ in self._held
        ]
        """Of each group: body -> its place in the velocities of the group."""
        self._bounded = {
            number: BoundedGroup()
            for number, (joints, _, _) in enumerate(self._held)
            if any(map(has_bounds, joints))
        }

    @property
    def has_bounds(self) -> bool:
        """Whether joints have limits, lengths or friction."""
        return bool(self._bounded)

    def group_of(self, body: int) -> int | None:
        """Return the group of a body; None for a body without joints."""
        return self._root.get(body)

    def jointed_rows(self, order: Order) -> list[int]:
        """Return the rows of contacts, in pymunk's order, of bodies with joints."""
        if order.jointed_rows is None:
            has_joint = np.isin(order.contacts[:, :2], self.bodies).any(axis=1)
            order.jointed_rows = np.flatnonzero(has_joint).tolist()
        return order.jointed_rows

    def project_velocities(self, pose: Array, velocity: Array) -> Array:
        """Return the velocities (N, 3) that the joints permit at a pose (N, 3).

        They are the given velocities plus the effect of the joints' impulses.
        """
        return self.constrain(pose, velocity, 1.0, None).velocity

    def constrain(
        self,
        pose: Array,
        velocity: Array,
        h: float,
        strength: float | None,
        within: Array | None = None,
    ) -> ConstrainedMotion:
        """Return the velocities (N, 3) that close all joints a step of h seconds later.

        `pose` (N, 3) now; `within` (N, 3): velocities before this step's forces. One
        linear system per group, so that chains and welds hold at any length and mass
        ratio (SHAKE, Ryckaert et al. 1977). A motor turns its two sides at its speed,
        with at most `strength` times its limit; `strength` None: only what the pins
        permit now.
        """
        work, has_motors, spots = 0.0, strength is not None, _Spots(pose, self._all)
        loss = early_loss = script_loss = 0.0
        shift = np.zeros(pose.shape)
        speeds = dict(
            zip(self._all, velocity.take(self._all, axis=0).tolist(), strict=True)
        )
        for number, (joints, bodies, inverse_masses) in enumerate(self._held):
            first_column = self._places[number]
            if number in self._bounded:
                speeds_before = [speed for body in bodies for speed in speeds[body]]
                bounded = self._hold_bounded(
                    number, first_column, spots, speeds_before, h, strength, within
                )
                work, loss = work + bounded.work, loss + bounded.lost
                early_loss += bounded.early
                if not self._scripted.isdisjoint(bodies):
                    script_loss += bounded.lost
                speeds.update(
                    zip(bodies, bounded.velocity.reshape(-1, 3).tolist(), strict=True)
                )
                continue
            rows: list[list[float]] = []
            wanted_speeds: list[float] = []
            limits: list[float] = []
            gaps: list[float] = []
            for joint in joints:
                joint_rows, joint_gaps = _rows(
                    joint, first_column, spots, 3 * len(bodies)
                )
                rows += joint_rows
                wanted_speeds += [-gap / h if has_motors else 0.0 for gap in joint_gaps]
                limits += [inf] * len(joint_rows)
                gaps += joint_gaps
                if has_motors and joint.kind is JointKind.MOTOR:
                    motor_row = [0.0] * (3 * len(bodies))
                    for body, sign in ((joint.first, 1.0), (joint.second, -1.0)):
                        if body is not None:
                            motor_row[first_column[body] + 2] = sign
                    rows.append(motor_row)
                    wanted_speeds.append(joint.speed)
                    limits.append(joint.limit * h * (strength or 0.0))
            # The common case of a few joints without limits is solved in plain numbers.
            velocities_before = [speed for body in bodies for speed in speeds[body]]
            if (
                len(rows) <= 8
                and min(limits) == inf
                and (
                    change := _few_changes(
                        rows, inverse_masses, velocities_before, wanted_speeds
                    )
                )
                and not (
                    has_motors
                    and is_jolt(
                        inverse_masses, velocities_before, change, self._jolt * h
                    )
                )
            ):
                for k, body in enumerate(bodies):
                    speeds[body] = list(
                        map(add, speeds[body], change[3 * k : 3 * k + 3])
                    )
                continue
            jacobian, before = np.array(rows), np.array(velocities_before)
            response = (jacobian * inverse_masses) @ jacobian.T
            response.ravel()[:: len(response) + 1] *= 1 + 1e-12
            speed_changes = np.array(wanted_speeds) - jacobian @ before
            impulse = _solved(response, speed_changes)
            # A motor beyond its limit acts with the limit, and the other rows are
            # solved again.
            motor_rows = [k for k, limit in enumerate(limits) if limit < inf]
            if (
                motor_rows
                and (
                    is_saturated := np.isfinite(limits) & (np.abs(impulse) > limits)
                ).any()
            ):
                limited_impulses = np.where(
                    is_saturated,
                    np.sign(impulse) * np.minimum(limits, np.abs(impulse)),
                    0.0,
                )
                is_free = ~is_saturated
                impulse = limited_impulses
                impulse[is_free] = _solved(
                    response[np.ix_(is_free, is_free)],
                    speed_changes[is_free]
                    - response[np.ix_(is_free, is_saturated)]
                    @ limited_impulses[is_saturated],
                )
            after = before + inverse_masses * (jacobian.T @ impulse)
            change = (after - before).tolist()
            is_driven = len(gaps) < len(rows)
            if (
                has_motors
                and not is_driven
                and is_jolt(inverse_masses, velocities_before, change, self._jolt * h)
            ):
                # Near a pose of contradictory joints, closing a gap
                # within
                # a step would take a speed that the motion never had. The gap is closed
                # by a displacement without velocity instead.
                still_velocities = before - inverse_masses * (
                    jacobian.T @ _solved(response, jacobian @ before)
                )
                if is_jolt(
                    inverse_masses,
                    still_velocities,
                    (after - still_velocities).tolist(),
                    self._jolt * h,
                ):
                    softness = np.diag(response) * SOFTNESS
                    closing_impulses = np.linalg.solve(
                        response + np.diag(softness), np.array(gaps)
                    )
                    displacements = np.array(inverse_masses) * (
                        jacobian.T @ closing_impulses
                    )
                    shift[bodies] -= displacements.reshape(-1, 3)
                    loss += _energy(inverse_masses, before) - _energy(
                        inverse_masses, still_velocities
                    )
                    after = still_velocities
            if motor_rows:
                mean_speeds = (
                    (jacobian * (np.array(inverse_masses) > 0)) @ (before + after) / 2
                )
                work += float((impulse * mean_speeds)[motor_rows].sum())
            speeds.update(zip(bodies, after.reshape(-1, 3).tolist(), strict=True))
        velocity = velocity.copy()
        velocity[self._all] = list(speeds.values())
        return ConstrainedMotion(velocity, work, loss, shift, early_loss, script_loss)

    def _hold_bounded(
        self,
        number: int,
        place: dict[int, int],
        spots: _Spots,
        before: list[float],
        h: float,
        strength: float | None,
        within: Array | None,
    ) -> BoundedMotion:
        """Return the effect of `constrain` on a group with bounds of some joints."""
        joints, bodies, inverse_masses = self._held[number]
        size = len(before)
        rows: list[list[float]] = []
        speeds: list[float] = []
        bounds: list[Bound] = []
        for joint in joints:
            joint_rows, gaps = _rows(joint, place, spots, size)
            rows += joint_rows
            # Each gap should be closed at the end of the step.
            speeds += [-gap / h if strength is not None else 0.0 for gap in gaps]
            bounds += bounds_of(joint, place, spots, size, h, strength)
            if strength is not None and joint.kind is JointKind.MOTOR:
                bounds.append(motor_bound(joint, place, spots, size, h, strength))
        velocities_before = None if within is None else within[bodies].ravel()
        group = self._bounded[number]
        return group.hold(
            rows, speeds, bounds, inverse_masses, before, velocities_before
        )

    def scripted_work(
        self, pose: Array, impulse: Array, velocities: Array, is_linear: bool
    ) -> Array:
        """Return the work of scripted partners of joints in a step, g·px²/s², (K,).

        `velocities` (K, N, 3): the work is computed for each; `impulse` (N, 3) of all
        joints on bodies; `is_linear`: angular impulses are unknown.
        """
        spots, work = _Spots(pose, self._all), np.zeros(len(velocities))
        for joints, bodies, inverse_masses in self._held:
            scripted_bodies = {b for b in bodies if b in self._scripted}
            if not scripted_bodies:
                continue
            first_column = {body: 3 * k for k, body in enumerate(bodies)}
            rows: list[list[float]] = []
            is_by_script: list[bool] = []
            for joint in joints:
                joint_rows, _ = _rows(joint, first_column, spots, 3 * len(bodies))
                bounds = bounds_of(
                    joint, first_column, spots, 3 * len(bodies), inf, None, MET_IN_STEP
                )
                joint_rows += [bound.row for bound in bounds]
                rows += joint_rows
                is_led = not scripted_bodies.isdisjoint((joint.first, joint.second))
                is_by_script += [is_led] * len(joint_rows)
            if not rows:
                continue
            J, weights = np.array(rows), np.sqrt(np.array(inverse_masses))
            scales = weights * np.tile([1.0, 1.0, float(not is_linear)], len(bodies))
            # The impulses of single joints follow from those on bodies, in the
            # least-squares sense for redundant joints.
            goal = scales * impulse[bodies].ravel()
            impulses = np.linalg.lstsq((J * scales).T, goal, rcond=SINGULAR)[0]
            group_velocities = velocities[:, bodies].reshape(len(velocities), -1)
            speeds = group_velocities @ (J * (weights > 0)).T
            work += (impulses * speeds)[:, is_by_script].sum(axis=1)
        return work

    def taut_rows(self, bodies: list[int], pose: Array) -> Array:
        """Return the rows (B, 3n) of speeds that ropes and limits keep above 0 at a
        pose (N, 3).

        All members of a group must be among the n bodies.
        """
        size = 3 * len(bodies)
        rows: list[list[float]] = []
        if self._bounded:
            spots, first_column = (
                _Spots(pose, self._all),
                {b: 3 * k for k, b in enumerate(bodies)},
            )
            for number in self._bounded:
                joints, members, _ = self._held[number]
                # Groups without any of these bodies do not matter.
                if not first_column.keys() & set(members):
                    continue
                for joint in joints:
                    bounds = bounds_of(
                        joint, first_column, spots, size, inf, None, TAUT_IN_IMPACT
                    )
                    rows += [bound.row for bound in bounds]
        return np.array(rows).reshape(-1, size)

    def reactions(
        self, pose: Array, impulse: Array, is_linear: bool
    ) -> dict[str, float]:
        """Return the size of the impulse in each joint, g·px/s, by name.

        `impulse` (N, 3) of all joints on bodies; `is_linear`: angular impulses are
        unknown.
        """
        spots, sizes = _Spots(pose, self._all), dict[str, float]()
        for joints, bodies, inverse_masses in self._held:
            first_column = {body: 3 * k for k, body in enumerate(bodies)}
            rows: list[list[float]] = []
            owners: list[str] = []
            for joint in joints:
                joint_rows, _ = _rows(joint, first_column, spots, 3 * len(bodies))
                bounds = bounds_of(
                    joint, first_column, spots, 3 * len(bodies), inf, None
                )
                pulls = [bound.row for bound in bounds] if joint.kind in GUIDES else []
                rows += [*joint_rows, *pulls]
                # Only the first rows of a joint count, its forces; later ones are
                # torques.
                count = min(len(joint_rows), 1 if joint.kind in GUIDES else 2)
                owners += [joint.name] * count + [""] * (len(joint_rows) - count)
                owners += [joint.name] * len(pulls)
            if not rows:
                continue
            # Weighted least squares finds the joint impulses that explain those on the
            # bodies. After impacts the angular impulses are unknown, and get no weight.
            weights = np.sqrt(np.array(inverse_masses))
            if is_linear:
                weights[2::3] = 0.0
            goal = weights * impulse[bodies].ravel()
            impulses = np.linalg.lstsq(
                (np.array(rows) * weights).T, goal, rcond=SINGULAR
            )[0]
            for owner, size in zip(owners, impulses.tolist(), strict=True):
                sizes[owner] = hypot(sizes.get(owner, 0.0), size)
        return sizes

    def response(self, bodies: list[int], inverse: Array, *poses: Array) -> Array:
        """Return the changes (3n, 3n) of n bodies' velocities by unit impulses, with
        joints.

        `inverse` (3n,): 1/mass, 1/mass, 1/moment of each; `poses` (N, 3), at each of
        which the joints hold. All members of a group must be among the bodies.
        """
        first_column = {body: 3 * k for k, body in enumerate(bodies)}
        free_response = np.diag(inverse)
        groups = sorted(
            {g for body in bodies if (g := self.group_of(body)) is not None}
        )
        if not groups:
            return free_response
        size = 3 * len(bodies)
        rows = [
            row
            for spots in (_Spots(pose, self._all) for pose in poses)
            for group in groups
            for joint in self._joints[group]
            for row in _rows(joint, first_column, spots, size)[0]
        ]
        if not rows:
            return free_response  # the groups have only ropes, which are inequalities
        # Project the free response on the motions that the joints permit: R - R Jᵀ (J R
        # Jᵀ)⁻¹ J R, with a pseudoinverse for redundant joints.
        jacobian = np.array(rows)
        joint_response = jacobian @ free_response
        return np.asarray(
            free_response
            - joint_response.T
            @ np.linalg.pinv(joint_response @ jacobian.T, rcond=SINGULAR)
            @ joint_response
        )


def _energy(light: Sequence[float], speeds: Sequence[float] | Array) -> float:
    """Return the kinetic energy of bodies with finite mass, g·px²/s².

    `light`: 1/mass and 1/moment, 0 for infinite mass.
    """
    doubled = 0.0
    for m, v in zip(light, speeds, strict=True):
        if m:
            doubled += v * v / m
    return float(doubled / 2)


def is_jolt(
    light: Sequence[float],
    before: Sequence[float] | Array,
    change: Sequence[float],
    least: float,
) -> bool:
    """Check whether a change of velocities has more energy than the motion can explain.

    `least`: speed, px/s, that any group may get.
    """
    energy, usual = _energy(light, change), JOLT * _energy(light, before)
    if energy <= usual:
        return False
    mass = sum(1 / m for m in light[::3] if m)
    return energy > usual + mass * least * least


def _few_changes(
    rows: list[list[float]],
    light: list[float],
    before: list[float],
    wanted: list[float],
) -> list[float]:
    """Return the changes of velocities by which a few rows reach the wanted speeds.

    Cholesky's method in plain numbers; empty for nearly redundant joints.
    """
    # Solve J M⁻¹ Jᵀ y = wanted - J v, with rows J and inverse masses `light`. The
    # matrix is symmetric: build its Cholesky factor row by row, with forward
    # substitution.
    triangle: list[list[float]] = []
    y: list[float] = []
    for row, goal in zip(rows, wanted, strict=True):
        weighted_row, triangle_row = list(map(mul, row, light)), list[float]()
        for other, earlier_row in zip(rows, triangle, strict=False):
            triangle_row.append(
                (
                    sum(map(mul, weighted_row, other))
                    - sum(map(mul, triangle_row, earlier_row))
                )
                / earlier_row[-1]
            )
        diagonal = sum(map(mul, weighted_row, row))
        remainder = diagonal - sum(map(mul, triangle_row, triangle_row))
        # A row dependent on those before it leaves no remainder.
        if remainder <= 1e-9 * diagonal:
            return []
        y.append(
            (goal - sum(map(mul, row, before)) - sum(map(mul, triangle_row, y)))
            / sqrt(remainder)
        )
        triangle.append([*triangle_row, sqrt(remainder)])
    # Backward substitution.
    for k in reversed(range(len(y))):
        known_part = 0.0
        for i in range(k + 1, len(y)):
            known_part += triangle[i][k] * y[i]
        y[k] = (y[k] - known_part) / triangle[k][k]
    # The impulses y change the velocities by M⁻¹ Jᵀ y.
    columns = zip(light, zip(*rows, strict=True), strict=True)
    return [m * sum(map(mul, y, column)) if m else 0.0 for m, column in columns]


def _solved(matrix: Array, goal: Array) -> Array:
    """Solve a system; the smallest solution if joints are redundant."""
    try:
        solution = np.linalg.solve(matrix, goal)
        tolerance = 1e-6 * max(map(abs, goal.tolist()), default=0.0)
        if all(
            abs(residual) <= tolerance
            for residual in (matrix @ solution - goal).tolist()
        ):
            return np.asarray(solution)
    except np.linalg.LinAlgError:
        pass
    return np.asarray(np.linalg.lstsq(matrix, goal, rcond=SINGULAR)[0])


class _Spots:
    """Positions of points of bodies in plain numbers, which are faster than arrays
    here.
    """

    def __init__(self, pose: Array, bodies: list[int]) -> None:
        """Store the poses (N, 3) of the bodies with their sines and cosines."""
        pose = pose.take(bodies, axis=0)
        angle = pose[:, 2]
        turns = zip(
            pose.tolist(), np.cos(angle).tolist(), np.sin(angle).tolist(), strict=True
        )
        self._of = dict(zip(bodies, turns, strict=True))

    def find(self, body: int, at: Array) -> tuple[list[float], float, float]:
        """Return the pose of a body, and px from its centre to the point `at` (2,) of
        it.
        """
        (pose, c, s), (x, y) = self._of[body], at.tolist()
        return pose, c * x - s * y, s * x + c * y


GUIDES = (JointKind.SLIDER, JointKind.ROPE, JointKind.PULLEY, JointKind.GEAR)
"""Joints without a pin."""


def _rows(
    joint: Joint, place: dict[int, int], spots: _Spots, size: int
) -> tuple[list[list[float]], list[float]]:
    """Return the rows of the speeds that a joint keeps at 0, and its gaps.

    The speeds are those of one side's pin relative to the other's and, of a weld, their
    relative spin; the gaps are px, px and rad.
    """
    if joint.kind in GUIDES:
        return guide_rows(joint, place, spots, size)
    rows = [[0.0] * size for _ in range(3 if joint.kind is JointKind.WELD else 2)]
    gaps = [0.0, 0.0, 0.0]
    for body, at, sign in (
        (joint.first, joint.first_at, 1.0),
        (joint.second, joint.second_at, -1.0),
    ):
        if body is None:
            x, y = at.tolist()
            gaps[0] -= x
            gaps[1] -= y
            continue
        if body not in place:
            continue
        # The velocity of a point at (x, y) from the centre is v + spin * (-y, x).
        k, ((px, py, angle), x, y) = place[body], spots.find(body, at)
        gaps[0] += sign * (px + x)
        gaps[1] += sign * (py + y)
        gaps[2] += sign * angle
        rows[0][k], rows[0][k + 2] = sign, -sign * y
        rows[1][k + 1], rows[1][k + 2] = sign, sign * x
        if len(rows) == 3:
            rows[2][k + 2] = sign
    return rows, gaps[: len(rows)]
