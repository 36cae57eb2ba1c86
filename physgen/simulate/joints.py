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
    BoundedGroup,
    BoundedMotion,
    BoundedRow,
    bounds_of,
    guide_rows,
    has_bounds,
    motor_bound,
    motor_row,
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


class JointGroup(NamedTuple):
    """Bodies that joints connect, in one linear system.

    Static and scripted bodies are part of the system, too, with infinite mass.
    """

    joints: list[Joint]
    bodies: list[int]
    inverse_masses: list[float]  # 1/mass, 1/mass, 1/moment of each body; 0 if infinite
    first_columns: dict[int, int]
    """Body -> its first place among the velocities of the group."""

    @property
    def size(self) -> int:
        """Return the number of velocities."""
        return 3 * len(self.bodies)


class GroupEquations(NamedTuple):
    """R equations of a group: speeds of joints in terms of the group's velocities."""

    rows: list[list[float]]
    speeds: list[float]
    """Speeds that the joints should have, px/s or rad/s."""
    limits: list[float]
    """Largest impulses; infinite except for motors."""
    gaps: list[float]
    """Gaps of pins and welds, px or rad, which come before each motor's row."""


class GroupMotion(NamedTuple):
    """The effect of joints without bounds on one group in a step."""

    velocities: list[list[float]]  # of each body: px/s, px/s, rad/s
    work: float = 0.0  # g·px²/s² of work by motors
    loss: float = 0.0  # g·px²/s² taken by contradictory joints
    shift: Array | None = None  # (n, 3): displacements that close gaps at once


class Assemblies:
    """Groups of dynamic bodies connected by pins, welds and motors.

    Springs do not connect bodies here, since they yield within an impact.
    """

    def __init__(self, world: World) -> None:
        is_dynamic = [body.motion is Motion.DYNAMIC for body in world.bodies]
        joints = [joint for joint in world.joints if joint.kind not in SPRINGS]
        root = _connected_bodies(joints, is_dynamic)
        self._root: dict[int, int] = {}
        """Group of each dynamic body with joints."""
        self._joints: dict[int, list[Joint]] = {}
        """Joints by group."""
        for joint in joints:
            bodies = _dynamic_bodies(joint, is_dynamic)
            for body in bodies:
                self._root[body] = find(root, body)
            if bodies:
                self._joints.setdefault(self._root[bodies[0]], []).append(joint)
        # Joints of one group share bodies, directly or through others, and are solved
        # together.
        self.busy = bool(self._joints)
        self.members: dict[int, list[int]] = {}
        """Bodies by group."""
        for body in sorted(self._root):
            self.members.setdefault(self._root[body], []).append(body)
        self.bodies = sorted(self._root)
        """All bodies with joints."""
        self._groups: list[JointGroup] = []
        self._bounded_groups: dict[int, BoundedGroup] = {}
        """By number: groups with bounds of some joints."""
        for number, (_, group_joints) in enumerate(sorted(self._joints.items())):
            self._groups.append(_joint_group(world, group_joints))
            if any(map(has_bounds, group_joints)):
                self._bounded_groups[number] = BoundedGroup()
        all_bodies = {body for group in self._groups for body in group.bodies}
        self._all_bodies = sorted(all_bodies)
        self._scripted_bodies = {
            body for body in all_bodies if world.bodies[body].motion is Motion.SCRIPTED
        }
        self.has_scripts = bool(self._scripted_bodies)
        """Whether joints connect a dynamic body with a scripted one."""
        self._gravity = float(np.hypot(*world.gravity))
        """px/s²: gaps that close more slowly than a fall are no jolts."""

    @property
    def has_bounds(self) -> bool:
        """Check whether joints have limits, lengths or friction."""
        return bool(self._bounded_groups)

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
        start_velocities: Array | None = None,
    ) -> ConstrainedMotion:
        """Return the velocities (N, 3) that close all joints a step of h seconds later.

        `pose` (N, 3) now; `start_velocities` (N, 3): before this step's forces. One
        linear system per group, so that chains and welds hold at any length and mass
        ratio (SHAKE, Ryckaert et al. 1977). A motor turns its two sides at its speed,
        with at most `strength` times its limit; `strength` None: only what the pins
        permit now.
        """
        # Plain numbers are faster than arrays for the few bodies of a usual group.
        spots = _Spots(pose, self._all_bodies)
        shift = np.zeros(pose.shape)
        velocities = velocity.take(self._all_bodies, axis=0).tolist()
        speeds = dict(zip(self._all_bodies, velocities, strict=True))
        work = loss = early_loss = script_loss = 0.0
        # Joined bodies form groups, and each group has its own linear system.
        for number, group in enumerate(self._groups):
            bodies = group.bodies
            before = [speed for body in bodies for speed in speeds[body]]
            if number in self._bounded_groups:
                bounded = self._constrain_bounded(
                    number, spots, before, h, strength, start_velocities
                )
                work += bounded.work
                loss += bounded.loss
                early_loss += bounded.early_loss
                if not self._scripted_bodies.isdisjoint(bodies):
                    script_loss += bounded.loss
                after = bounded.velocity.reshape(-1, 3).tolist()
            else:
                motion = self._constrain_group(group, spots, before, h, strength)
                work += motion.work
                loss += motion.loss
                if motion.shift is not None:
                    shift[bodies] += motion.shift
                after = motion.velocities
            speeds.update(zip(bodies, after, strict=True))
        velocity = velocity.copy()
        velocity[self._all_bodies] = list(speeds.values())
        return ConstrainedMotion(velocity, work, loss, shift, early_loss, script_loss)

    def _constrain_group(
        self,
        group: JointGroup,
        spots: _Spots,
        before: list[float],
        h: float,
        strength: float | None,
    ) -> GroupMotion:
        """Return the effect of `constrain` on a group without bounds."""
        equations = _group_equations(group, spots, h, strength)
        masses = group.inverse_masses
        max_speed = self._gravity * h
        # The common case of a few joints without limits is solved in plain numbers.
        if len(equations.rows) <= 8 and min(equations.limits) == inf:
            change = _few_changes(equations.rows, masses, before, equations.speeds)
            if change and (
                strength is None or not is_jolt(masses, before, change, max_speed)
            ):
                return GroupMotion(_triples(list(map(add, before, change))))
        # Velocities after the step must satisfy J v = goal with impulses of the joints
        # alone: v' = v + M⁻¹ Jᵀ j, so that (J M⁻¹ Jᵀ) j = goal - J v.
        jacobian = np.array(equations.rows)
        velocities = np.array(before)
        response = (jacobian * masses) @ jacobian.T
        # A tiny regularisation keeps the diagonal above the rounding errors.
        response.ravel()[:: len(response) + 1] *= 1 + 1e-12
        speed_changes = np.array(equations.speeds) - jacobian @ velocities
        impulse = _limited_impulses(response, speed_changes, equations.limits)
        after = velocities + masses * (jacobian.T @ impulse)
        # A motor may give any speed within its limit. Without motors, a large change of
        # velocity reveals joints that contradict each other.
        has_motors = len(equations.gaps) < len(equations.rows)
        if strength is not None and not has_motors:
            change = (after - velocities).tolist()
            if is_jolt(masses, before, change, max_speed):
                motion = _close_gaps_at_rest(
                    group, equations, response, velocities, after, max_speed
                )
                if motion is not None:
                    return motion
        work = _motor_work(equations, masses, impulse, (velocities + after) / 2)
        return GroupMotion(after.reshape(-1, 3).tolist(), work)

    def _constrain_bounded(
        self,
        number: int,
        spots: _Spots,
        before: list[float],
        h: float,
        strength: float | None,
        start_velocities: Array | None,
    ) -> BoundedMotion:
        """Return the effect of `constrain` on a group with bounds of some joints."""
        group = self._groups[number]
        columns = group.first_columns
        size = group.size
        rows: list[list[float]] = []
        speeds: list[float] = []
        bounds: list[BoundedRow] = []
        for joint in group.joints:
            # Equations hold always, bounds only if they are reached: both go into one
            # system, because a rope may pull on a hinge.
            joint_rows, gaps = _rows(joint, columns, spots, size)
            rows += joint_rows
            # Each gap should be closed at the end of the step.
            speeds += [-gap / h if strength is not None else 0.0 for gap in gaps]
            bounds += bounds_of(joint, columns, spots, size, h, strength)
            if strength is not None and joint.kind is JointKind.MOTOR:
                bounds.append(motor_bound(joint, columns, spots, size, h, strength))
        group_velocities = None
        if start_velocities is not None:
            group_velocities = start_velocities[group.bodies].ravel()
        return self._bounded_groups[number].constrain(
            rows, speeds, bounds, group.inverse_masses, before, group_velocities
        )

    def scripted_work(
        self, pose: Array, impulse: Array, velocities: Array, is_linear: bool
    ) -> Array:
        """Return the work of scripted partners of joints in a step, g·px²/s², (K,).

        `velocities` (K, N, 3): the work is computed for each; `impulse` (N, 3) of all
        joints on bodies; `is_linear`: angular impulses are unknown.
        """
        spots = _Spots(pose, self._all_bodies)
        work = np.zeros(len(velocities))
        for group in self._groups:
            if self._scripted_bodies.isdisjoint(group.bodies):
                continue
            # Joints without a scripted side do no work from outside.
            rows, is_scripted = self._script_rows(group, spots)
            if not rows:
                continue
            jacobian = np.array(rows)
            weights = np.sqrt(np.array(group.inverse_masses))
            axes = [1.0, 1.0, float(not is_linear)]
            impulses = _joint_impulses(
                jacobian,
                weights * np.tile(axes, len(group.bodies)),
                impulse[group.bodies].ravel(),
            )
            group_velocities = velocities[:, group.bodies].reshape(len(velocities), -1)
            speeds = group_velocities @ (jacobian * (weights > 0)).T
            work += (impulses * speeds)[:, is_scripted].sum(axis=1)
        return work

    def _script_rows(
        self, group: JointGroup, spots: _Spots
    ) -> tuple[list[list[float]], list[bool]]:
        """Return the rows of a group's joints and bounds, and whether a scripted body
        is a partner.
        """
        rows: list[list[float]] = []
        is_scripted: list[bool] = []
        columns = group.first_columns
        size = group.size
        for joint in group.joints:
            joint_rows, _ = _rows(joint, columns, spots, size)
            # Only bounds that this step meets have rows.
            bounds = bounds_of(joint, columns, spots, size, inf, None, MET_IN_STEP)
            joint_rows += [bounded_row.row for bounded_row in bounds]
            rows += joint_rows
            partners = joint.first, joint.second
            has_script = not self._scripted_bodies.isdisjoint(partners)
            is_scripted += [has_script] * len(joint_rows)
        return rows, is_scripted

    def taut_rows(self, bodies: list[int], pose: Array) -> Array:
        """Return the rows (B, 3n) of speeds that ropes and limits keep above 0 at a
        pose (N, 3).

        All members of a group must be among the n bodies.
        """
        size = 3 * len(bodies)
        rows: list[list[float]] = []
        if not self._bounded_groups:
            return np.array(rows).reshape(-1, size)
        spots = _Spots(pose, self._all_bodies)
        columns = _first_columns(bodies)
        for number in self._bounded_groups:
            group = self._groups[number]
            # Groups without any of these bodies do not matter.
            if columns.keys().isdisjoint(group.bodies):
                continue
            for joint in group.joints:
                bounds = bounds_of(
                    joint, columns, spots, size, inf, None, TAUT_IN_IMPACT
                )
                rows += [bounded_row.row for bounded_row in bounds]
        return np.array(rows).reshape(-1, size)

    def reactions(
        self, pose: Array, impulse: Array, is_linear: bool
    ) -> dict[str, float]:
        """Return the size of the impulse in each joint, g·px/s, by name.

        `impulse` (N, 3) of all joints on bodies; `is_linear`: angular impulses are
        unknown.
        """
        spots = _Spots(pose, self._all_bodies)
        sizes = dict[str, float]()
        for group in self._groups:
            rows, owners = _reaction_rows(group, spots)
            if not rows:
                continue
            # After impacts the angular impulses are unknown, and get no weight.
            weights = np.sqrt(np.array(group.inverse_masses))
            if is_linear:
                weights[2::3] = 0.0
            group_impulse = impulse[group.bodies].ravel()
            impulses = _joint_impulses(np.array(rows), weights, group_impulse)
            for owner, size in zip(owners, impulses.tolist(), strict=True):
                sizes[owner] = hypot(sizes.get(owner, 0.0), size)
        return sizes

    def response(self, bodies: list[int], inverse: Array, *poses: Array) -> Array:
        """Return the changes (3n, 3n) of n bodies' velocities by unit impulses, with
        joints.

        `inverse` (3n,): 1/mass, 1/mass, 1/moment of each; `poses` (N, 3), at each of
        which the joints hold. All members of a group must be among the bodies.
        """
        free_response = np.diag(inverse)
        groups = sorted({self._root[body] for body in bodies if body in self._root})
        if not groups:
            return free_response
        columns = _first_columns(bodies)
        size = 3 * len(bodies)
        rows: list[list[float]] = []
        for pose in poses:
            spots = _Spots(pose, self._all_bodies)
            for group in groups:
                for joint in self._joints[group]:
                    rows += _rows(joint, columns, spots, size)[0]
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


def _dynamic_bodies(joint: Joint, is_dynamic: list[bool]) -> list[int]:
    """Return the dynamic bodies that a joint connects."""
    bodies = [joint.first]
    if joint.second is not None:
        bodies.append(joint.second)
    return [body for body in bodies if is_dynamic[body]]


def _connected_bodies(joints: list[Joint], is_dynamic: list[bool]) -> dict[int, int]:
    """Return a forest in which bodies that a chain of joints connects share a root."""
    root = {k: k for k in range(len(is_dynamic))}
    for joint in joints:
        bodies = _dynamic_bodies(joint, is_dynamic)
        if len(bodies) == 2:
            root[find(root, bodies[0])] = find(root, bodies[1])
    return root


def _joint_group(world: World, joints: list[Joint]) -> JointGroup:
    """Return the linear system of a group's joints."""
    connected_bodies: set[int] = set()
    for joint in joints:
        connected_bodies.add(joint.first)
        if joint.second is not None:
            connected_bodies.add(joint.second)
    bodies = sorted(connected_bodies)
    inverse_masses: list[float] = []
    for number in bodies:
        body = world.bodies[number]
        if body.motion is Motion.DYNAMIC:
            inverse_masses += [1 / body.mass, 1 / body.mass, 1 / body.moment]
        else:
            inverse_masses += [0.0, 0.0, 0.0]
    return JointGroup(joints, bodies, inverse_masses, _first_columns(bodies))


def _first_columns(bodies: list[int]) -> dict[int, int]:
    """Return the place of each body's velocity in a vector of all velocities."""
    return {body: 3 * k for k, body in enumerate(bodies)}


def _triples(values: list[float]) -> list[list[float]]:
    """Return plain numbers by threes."""
    return [values[k : k + 3] for k in range(0, len(values), 3)]


def _group_equations(
    group: JointGroup, spots: _Spots, h: float, strength: float | None
) -> GroupEquations:
    """Return the equations of a group's pins, welds and motors in a step of h s."""
    equations = GroupEquations([], [], [], [])
    columns = group.first_columns
    size = group.size
    for joint in group.joints:
        joint_rows, gaps = _rows(joint, columns, spots, size)
        equations.rows.extend(joint_rows)
        equations.gaps.extend(gaps)
        equations.limits.extend([inf] * len(joint_rows))
        if strength is None:
            equations.speeds.extend([0.0] * len(gaps))
            continue
        # Each gap should be closed at the end of the step.
        equations.speeds.extend([-gap / h for gap in gaps])
        if joint.kind is JointKind.MOTOR:
            equations.rows.append(motor_row(joint, columns, size))
            equations.speeds.append(joint.speed)
            equations.limits.append(joint.limit * h * strength)
    return equations


def _limited_impulses(response: Array, goal: Array, limits: list[float]) -> Array:
    """Return the impulses (R,) that change the speeds of joints by `goal` (R,).

    A motor beyond its limit acts with the limit, and the other rows are solved again.
    """
    # Solve without limits first. In most steps no motor is at its limit.
    impulse = _solve_system(response, goal)
    if min(limits) == inf:
        return impulse
    is_saturated = np.isfinite(limits) & (np.abs(impulse) > limits)
    if not is_saturated.any():
        return impulse
    limited_impulses = np.sign(impulse) * np.minimum(limits, np.abs(impulse))
    limited_impulses = np.where(is_saturated, limited_impulses, 0.0)
    # Move the known impulses to the right side of the system, and solve for the others.
    is_free = ~is_saturated
    free_response = response[np.ix_(is_free, is_free)]
    coupling = response[np.ix_(is_free, is_saturated)]
    free_goal = goal[is_free] - coupling @ limited_impulses[is_saturated]
    limited_impulses[is_free] = _solve_system(free_response, free_goal)
    return limited_impulses


def _close_gaps_at_rest(
    group: JointGroup,
    equations: GroupEquations,
    response: Array,
    before: Array,
    after: Array,
    max_speed: float,
) -> GroupMotion | None:
    """Close the gaps of a group by displacements; None if velocities may close them.

    Near a pose of contradictory joints, closing a gap within a step would take a speed
    that the motion never had: `after`, if it is a jolt. The gap is closed by a
    displacement without velocity instead.
    """
    # Remove from the present velocities all parts that the joints exclude: this is the
    # motion that the joints permit, without any attempt to close gaps.
    masses = group.inverse_masses
    jacobian = np.array(equations.rows)
    resting_impulses = _solve_system(response, jacobian @ before)
    rest_velocities = before - masses * (jacobian.T @ resting_impulses)
    change = (after - rest_velocities).tolist()
    if not is_jolt(masses, rest_velocities, change, max_speed):
        return None
    # At contradictory joints the system is nearly singular. A softness by the diagonal
    # limits the displacements, and the next steps close the rest of the gaps.
    compliance = np.diag(np.diag(response) * SOFTNESS)
    closing_impulses = np.linalg.solve(response + compliance, np.array(equations.gaps))
    displacements = np.array(masses) * (jacobian.T @ closing_impulses)
    # The removed velocities took their energy along.
    loss = _energy(masses, before) - _energy(masses, rest_velocities)
    velocities = rest_velocities.reshape(-1, 3).tolist()
    return GroupMotion(velocities, 0.0, loss, -displacements.reshape(-1, 3))


def _reaction_rows(
    group: JointGroup, spots: _Spots
) -> tuple[list[list[float]], list[str]]:
    """Return the rows of a group's joints, and the joint of each; "" for torques."""
    rows: list[list[float]] = []
    owners: list[str] = []
    columns = group.first_columns
    size = group.size
    for joint in group.joints:
        joint_rows, _ = _rows(joint, columns, spots, size)
        bounds = bounds_of(joint, columns, spots, size, inf, None)
        # A slider or a rope also acts through its bounds, whose forces count for its
        # load.
        is_guide = joint.kind in GUIDES
        if is_guide:
            pulls = [bounded_row.row for bounded_row in bounds]
        else:
            pulls = []
        rows += [*joint_rows, *pulls]
        # Only the first rows of a joint count, its forces; later ones are torques.
        count = min(len(joint_rows), 1 if is_guide else 2)
        owners += [joint.name] * count + [""] * (len(joint_rows) - count)
        owners += [joint.name] * len(pulls)
    return rows, owners


def _joint_impulses(jacobian: Array, weights: Array, impulse: Array) -> Array:
    """Return the impulses (R,) of joints that explain those on bodies (3n,).

    They are the solution of weighted least squares; redundant joints share an impulse.
    """
    matrix = (jacobian * weights).T
    return np.asarray(np.linalg.lstsq(matrix, weights * impulse, rcond=SINGULAR)[0])


def _energy(inverse_masses: Sequence[float], speeds: Sequence[float] | Array) -> float:
    """Return the kinetic energy of bodies with finite mass, g·px²/s².

    `inverse_masses`: 1/mass and 1/moment, 0 for infinite mass.
    """
    double_energy = 0.0
    for m, v in zip(inverse_masses, speeds, strict=True):
        if m:
            double_energy += v * v / m
    return float(double_energy / 2)


def is_jolt(
    inverse_masses: Sequence[float],
    before: Sequence[float] | Array,
    change: Sequence[float],
    max_speed: float,
) -> bool:
    """Check whether a change of velocities has more energy than the motion can explain.

    `max_speed`: px/s, that any group may get.
    """
    energy = _energy(inverse_masses, change)
    usual_energy = JOLT * _energy(inverse_masses, before)
    if energy <= usual_energy:
        return False
    mass = sum(1 / m for m in inverse_masses[::3] if m)
    return energy > usual_energy + mass * max_speed * max_speed


def _few_changes(
    rows: list[list[float]],
    inverse_masses: list[float],
    before: list[float],
    goals: list[float],
) -> list[float]:
    """Return the changes of velocities by which a few rows reach their goals.

    Cholesky's method in plain numbers; empty for nearly redundant joints.
    """
    # Solve J M⁻¹ Jᵀ y = goals - J v, with rows J and inverse masses M⁻¹. The matrix is
    # symmetric: build its Cholesky factor row by row, with forward substitution.
    triangle: list[list[float]] = []
    y: list[float] = []
    for row, goal in zip(rows, goals, strict=True):
        weighted_row = list(map(mul, row, inverse_masses))
        triangle_row: list[float] = []
        for other, earlier_row in zip(rows, triangle, strict=False):
            product = sum(map(mul, weighted_row, other))
            known_part = sum(map(mul, triangle_row, earlier_row))
            triangle_row.append((product - known_part) / earlier_row[-1])
        diagonal = sum(map(mul, weighted_row, row))
        remainder = diagonal - sum(map(mul, triangle_row, triangle_row))
        # A row dependent on those before it leaves no remainder.
        if remainder <= 1e-9 * diagonal:
            return []
        root = sqrt(remainder)
        speed_change = goal - sum(map(mul, row, before))
        y.append((speed_change - sum(map(mul, triangle_row, y))) / root)
        triangle.append([*triangle_row, root])
    _substitute_backward(triangle, y)
    # The impulses y change the velocities by M⁻¹ Jᵀ y.
    columns = zip(inverse_masses, zip(*rows, strict=True), strict=True)
    return [m * sum(map(mul, y, column)) if m else 0.0 for m, column in columns]


def _motor_work(
    equations: GroupEquations, inverse_masses: list[float], impulse: Array, mean: Array
) -> float:
    """Return the work of motors at the mean velocities (3n,), g·px²/s²."""
    motor_rows = [k for k, limit in enumerate(equations.limits) if limit < inf]
    if not motor_rows:
        return 0.0
    is_movable = np.array(inverse_masses) > 0
    mean_speeds = (np.array(equations.rows) * is_movable) @ mean
    return float((impulse * mean_speeds)[motor_rows].sum())


def _substitute_backward(triangle: list[list[float]], y: list[float]) -> None:
    """Solve Lᵀ x = y in place, with the lower triangle L."""
    for k in reversed(range(len(y))):
        known_part = 0.0
        for i in range(k + 1, len(y)):
            known_part += triangle[i][k] * y[i]
        y[k] = (y[k] - known_part) / triangle[k][k]


def _solve_system(matrix: Array, goal: Array) -> Array:
    """Solve a system; the smallest solution if joints are redundant."""
    try:
        solution = np.linalg.solve(matrix, goal)
        tolerance = 1e-6 * max(map(abs, goal.tolist()), default=0.0)
        residuals = (matrix @ solution - goal).tolist()
        if all(abs(residual) <= tolerance for residual in residuals):
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
        self._placed_bodies = dict(zip(bodies, turns, strict=True))

    def find(self, body: int, point: Array) -> tuple[list[float], float, float]:
        """Return the pose of a body, and px from its centre to the point (2,) of
        it.
        """
        pose, c, s = self._placed_bodies[body]
        x, y = point.tolist()
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
            # The world has no velocity and no columns: only the place of its pin
            # counts.
            gaps[0] -= x
            gaps[1] -= y
            continue
        if body not in place:
            continue
        # The velocity of a point at (x, y) from the centre is v + spin * (-y, x).
        k = place[body]
        (px, py, angle), x, y = spots.find(body, at)
        gaps[0] += sign * (px + x)
        gaps[1] += sign * (py + y)
        gaps[2] += sign * angle
        rows[0][k], rows[0][k + 2] = sign, -sign * y
        rows[1][k + 1], rows[1][k + 2] = sign, sign * x
        if len(rows) == 3:
            rows[2][k + 2] = sign
    return rows, gaps[: len(rows)]
