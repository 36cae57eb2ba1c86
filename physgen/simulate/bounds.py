"""One-sided and limited joints: ropes, rails with ends, limits of angles, drives,
friction in pins.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, inf
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Joint
from physgen.scene.scene import JointKind

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Vector = tuple[float, float]

UNIFORM = (JointKind.PIVOT, JointKind.MOTOR)
"""Joints with limits and friction of the rotation."""
TAUT = 1e-6
"""Distance, px or rad, within which a bound holds at once."""
TAUT_IN_IMPACT = 0.05
"""Distance, px, within which a bound takes part in impacts: between two steps the end
of a rope moves along a chord, not along a circle.
"""
MET_IN_STEP = 8.0
"""Distance, px, beyond which a bound cannot be met within a step."""
ANGLE_NEAR = 0.02
"""Conversion of these distances for angles, rad per px."""
CATCH = 2
"""Steps in a row in which a bound takes energy: it is met within the first and reached
at the end of the second.
"""
JERK = 0.1
"""Share of a group's speed, in terms of energy: a bound that closes faster is
met anew.
"""
EXCHANGES = 8
"""Number of exchanges of all wrong bounds at once; then they are exchanged one by one,
which always terminates (Murty 1974).
"""
MOST_EXCHANGES = 200
"""Limit on the number of exchanges."""
WHEEL = 4.0
"""Radius of a pulley's wheels, px, at which ends stop; nearer, they would turn around
the point within a step.
"""
LEEWAY = 1e-9
"""Relative tolerance of impulses and speeds at their bounds."""
SINGULAR = 1e-10
"""Relative size of singular values that count as 0; see joints.py."""


class Places(Protocol):
    """Positions of points on bodies."""

    def find(self, body: int, point: Array) -> tuple[list[float], float, float]:
        """Return the pose of a body, and px from its centre to the point (2,) of
        it.
        """


class BoundedRow(NamedTuple):
    """A speed of a group's motion with a lower limit.

    An impulse between `low` and `high` keeps the speed from falling below the limit.
    `row` gives the speed in terms of the group's velocities.
    """

    row: list[float]
    speed: float
    """Least speed; for a bound of both directions, the wanted speed."""
    low: float
    high: float
    is_motor: bool = False
    """Whether the bound does the work of a motor."""


def has_bounds(joint: Joint) -> bool:
    """Check whether a joint has inequalities, not only equations."""
    if joint.kind in (JointKind.ROPE, JointKind.PULLEY, JointKind.SLIDER):
        return True
    return joint.limits is not None or joint.friction > 0


def end(
    joint: Joint, number: int, spots: Places
) -> tuple[int | None, float, float, float, float]:
    """Return the body of one side (0, 1) of a joint, its point, px, and the arm from
    its centre.
    """
    body, at = (
        (joint.first, joint.first_at),
        (joint.second, joint.second_at),
    )[number]
    if body is None:
        x, y = at.tolist()
        return None, x, y, 0.0, 0.0
    (px, py, _), x, y = spots.find(body, at)
    return body, px + x, py + y, x, y


def _angle(body: int | None, spots: Places) -> float:
    """Return the angle of a body, rad; 0 for the world."""
    if body is None:
        return 0.0
    return spots.find(body, np.zeros(2))[0][2]


def _add(
    row: list[float],
    place: dict[int, int],
    body: int | None,
    way: Vector,
    arm: Vector,
) -> None:
    """Add the speed along `way` of a body's point at `arm` to a row."""
    if body is None or body not in place:
        return
    k = place[body]
    row[k] += way[0]
    row[k + 1] += way[1]
    row[k + 2] += arm[0] * way[1] - arm[1] * way[0]


def _turning(
    joint: Joint, place: dict[int, int], size: int, part: float
) -> list[float]:
    """Return the row of the first side's spin less `part` times that of the second."""
    row = [0.0] * size
    for body, sign in ((joint.first, 1.0), (joint.second, -part)):
        if body is not None and body in place:
            row[place[body] + 2] += sign
    return row


def motor_row(joint: Joint, place: dict[int, int], size: int) -> list[float]:
    """Return the row of the first side's spin relative to the second."""
    return _turning(joint, place, size, 1.0)


def _rail(
    joint: Joint, place: dict[int, int], spots: Places, size: int
) -> tuple[list[float], list[float], float, float, float]:
    """Return the rows of the speeds along and across a rail, the position, and its
    length.

    The position is px along and across the rail from its first point.
    """
    body, x, y, *arm = end(joint, 0, spots)
    other, x0, y0, *_ = end(joint, 1, spots)
    ux, uy = joint.guide[0].tolist()
    arm2 = (0.0, 0.0)
    # A rail on a moving body turns with it.
    if other is not None:
        pose, ux, uy = spots.find(other, joint.guide[0])
        arm2 = x - pose[0], y - pose[1]
    length = hypot(ux, uy)
    ux, uy = ux / length, uy / length
    along_row = [0.0] * size
    across_row = [0.0] * size
    # Both rows measure the relative speed: one along the rail, one across it.
    for row, (wx, wy) in ((along_row, (ux, uy)), (across_row, (-uy, ux))):
        _add(row, place, body, (wx, wy), (arm[0], arm[1]))
        _add(row, place, other, (-wx, -wy), arm2)
    # Scalar and vector product with the direction of the rail give the position along
    # and across it.
    dx, dy = x - x0, y - y0
    return along_row, across_row, dx * ux + dy * uy, dy * ux - dx * uy, length


def guide_rows(
    joint: Joint, place: dict[int, int], spots: Places, size: int
) -> tuple[list[list[float]], list[float]]:
    """Return the rows of speeds that a slider or a gear keeps at 0, and its errors, px
    or rad.
    """
    # A slider keeps its body on the rail and parallel to it. A gear keeps the ratio of
    # two angles. Ropes and pulleys have no equations but only bounds.
    first_angle = _angle(joint.first, spots)
    second_angle = _angle(joint.second, spots)
    match joint.kind:
        case JointKind.SLIDER:
            _, across_row, _, gap, _ = _rail(joint, place, spots, size)
            turning = _turning(joint, place, size, 1.0)
            return [across_row, turning], [gap, first_angle - second_angle]
        case JointKind.GEAR:
            turning = _turning(joint, place, size, joint.ratio)
            return [turning], [first_angle - joint.ratio * second_angle]
        case _:
            return [], []


def bounds_of(
    joint: Joint,
    place: dict[int, int],
    spots: Places,
    size: int,
    h: float,
    strength: float | None,
    reach: float = TAUT,
) -> list[BoundedRow]:
    """Return the bounds of a joint in a step of h seconds; motors have `strength` times
    their limit.

    With `strength` None, return only the bounds that hold at once: those nearer than
    `reach` px, or `reach` times `ANGLE_NEAR` rad.
    """
    rows: list[tuple[list[float], float]] = []
    bounds: list[BoundedRow] = []
    unit = 1.0
    if joint.kind is JointKind.SLIDER:
        along_row, _, position, _, length = _rail(joint, place, spots, size)
        # Two ends of the rail: the distance to each one must not become negative.
        rows = [(along_row, position), ([-v for v in along_row], length - position)]
        if joint.drive is not None and strength is not None:
            # The drive reaches its speed with at most its force, and does not run
            # beyond the ends.
            largest_impulse = joint.force * h * strength
            speed = _speed_in_bounds(joint.drive, position, length - position, h)
            drive = BoundedRow(
                along_row, speed, -largest_impulse, largest_impulse, True
            )
            bounds.append(drive)
    elif joint.kind in (JointKind.ROPE, JointKind.PULLEY):
        rows = [_rope(joint, place, spots, size)]
        if joint.kind is JointKind.PULLEY:
            rows += _stops(joint, place, spots, size)
    elif joint.kind in UNIFORM:
        unit = ANGLE_NEAR
        turning = _turning(joint, place, size, 1.0)
        rows = _angle_limits(joint, turning, spots)
        if joint.friction > 0 and strength is not None:
            # Friction in the hinge is a motor with the goal 0 and a limited torque.
            largest_impulse = joint.friction * h * strength
            friction = BoundedRow(turning, 0.0, -largest_impulse, largest_impulse, True)
            bounds.append(friction)
    for row, distance in rows:
        # Within a step, a bound may close at the speed with which it is reached at the
        # step's end.
        if strength is not None:
            bounds.append(BoundedRow(row, -distance / h, 0.0, inf))
        elif distance <= max(TAUT, reach * unit):
            bounds.append(BoundedRow(row, 0.0, 0.0, inf))
    return bounds


def _angle_limits(
    joint: Joint, turning: list[float], spots: Places
) -> list[tuple[list[float], float]]:
    """Return the rows of a pin's limits, and the angles to them, rad.

    `turning` is the row of the relative spin.
    """
    if joint.limits is None:
        return []
    smallest, largest = joint.limits
    # A motor slows down before a stop of its joint, so that it arrives there at rest.
    angle = _angle(joint.first, spots) - _angle(joint.second, spots)
    opposite = [-value for value in turning]
    return [(turning, angle - smallest), (opposite, largest - angle)]


def _speed_in_bounds(
    speed: float, distance_behind: float, ahead: float, h: float
) -> float:
    """Return the speed of a drive such that it stops at the ends, and does not push
    against them.

    `distance_behind`, `ahead`: px or rad to the ends.
    """
    return min(max(speed, -distance_behind / h), ahead / h)


def motor_bound(
    joint: Joint,
    place: dict[int, int],
    spots: Places,
    size: int,
    h: float,
    strength: float,
) -> BoundedRow:
    """Return the bound of a motor in a step of h seconds, with `strength` times its
    limit.
    """
    speed = joint.speed
    # The limit is a torque: its impulse in a step is the torque times the time.
    largest_impulse = joint.limit * h * strength
    if joint.limits is not None:
        angle = _angle(joint.first, spots) - _angle(joint.second, spots)
        room_behind = angle - joint.limits[0]
        room_ahead = joint.limits[1] - angle
        speed = _speed_in_bounds(speed, room_behind, room_ahead, h)
    return BoundedRow(
        motor_row(joint, place, size), speed, -largest_impulse, largest_impulse, True
    )


def _rope(
    joint: Joint, place: dict[int, int], spots: Places, size: int
) -> tuple[list[float], float]:
    """Return the row of the speed at which a rope slackens, and its slack, px."""
    row = [0.0] * size
    length = 0.0
    ends = end(joint, 0, spots), end(joint, 1, spots)
    for number, (body, x, y, *arm) in enumerate(ends):
        if joint.kind is JointKind.PULLEY:
            x0, y0 = joint.guide[number].tolist()
        else:
            _, x0, y0, *_ = ends[1 - number]
        distance = hypot(x - x0, y - y0)
        length += distance
        if distance > 0:
            direction = (x0 - x) / distance, (y0 - y) / distance
            _add(row, place, body, direction, (arm[0], arm[1]))
    if joint.kind is JointKind.PULLEY:
        # A pulley's rope leads from each end to its wheel, and between the wheels; a
        # plain rope was counted from both ends.
        wheel_distance = joint.guide[1] - joint.guide[0]
        length += hypot(*wheel_distance.tolist())
    else:
        length /= 2
    return row, joint.length - length


def _stops(
    joint: Joint, place: dict[int, int], spots: Places, size: int
) -> list[tuple[list[float], float]]:
    """Return the rows of the speeds at which a pulley's ends leave their wheels, and px
    to the wheels.
    """
    stops = []
    for number in (0, 1):
        body, x, y, *arm = end(joint, number, spots)
        x0, y0 = joint.guide[number].tolist()
        distance = hypot(x - x0, y - y0)
        if body is None or distance <= 0:
            continue
        # The row is the speed at which the end of the rope moves away from its wheel.
        row = [0.0] * size
        direction = (x - x0) / distance, (y - y0) / distance
        _add(row, place, body, direction, (arm[0], arm[1]))
        stops.append((row, distance - WHEEL))
    return stops


def bounded_impulses(
    give: Array, goal: Array, low: Array, high: Array
) -> tuple[Array, Array]:
    """Solve for impulses (R,) within bounds, and return them with the mask of free
    ones.

    A free impulse reaches its goal; at a lower bound the speed is above its goal, at an
    upper bound below it. Principal pivoting for mixed linear complementarity (Murty
    1974).
    """
    # Each row is free, at its lower or at its upper bound. Bounds of 0 begin as bounds,
    # since most ropes and ends are not reached.
    count = len(goal)
    is_low = low == 0.0
    is_high = np.zeros(count, bool)
    impulse = np.zeros(count)
    for number in range(MOST_EXCHANGES):
        is_free = ~(is_low | is_high)
        # With the rows at bounds known, the free ones follow from a linear system.
        impulse = np.where(is_low, low, np.where(is_high, high, 0.0))
        if is_free.any():
            remaining_goal = (
                goal[is_free] - give[np.ix_(is_free, ~is_free)] @ impulse[~is_free]
            )
            impulse[is_free] = _least_squares(
                give[np.ix_(is_free, is_free)], remaining_goal
            )
        # An impulse outside its bounds is set to the bound; a bound at which the speed
        # is on the wrong side is set free.
        impulse_tolerance = LEEWAY * max(float(np.abs(impulse).max()), 1e-300)
        shortfall = goal - give @ impulse
        speed_tolerance = LEEWAY * max(float(np.abs(goal).max()), 1e-300)
        to_low = is_free & (impulse < low - impulse_tolerance)
        to_high = is_free & (impulse > high + impulse_tolerance)
        to_free = (is_low & (shortfall > speed_tolerance)) | (
            is_high & (shortfall < -speed_tolerance)
        )
        wrong_rows = np.flatnonzero(to_low | to_high | to_free)
        if not len(wrong_rows):
            break
        # Exchanges of all wrong rows at once are fast but may repeat in a cycle. One at
        # a time, the lowest first, always ends (Murty's rule).
        if number >= EXCHANGES:
            wrong_rows = wrong_rows[:1]
        for k in wrong_rows.tolist():
            is_low[k], is_high[k] = bool(to_low[k]), bool(to_high[k])
    return impulse, ~(is_low | is_high)


def _least_squares(matrix: Array, goal: Array) -> Array:
    """Solve a system; if it is singular, in the sense of least squares."""
    try:
        solution = np.linalg.solve(matrix, goal)
        if np.abs(matrix @ solution - goal).max() <= 1e-6 * np.abs(goal).max(
            initial=0.0
        ):
            return np.asarray(solution)
    except np.linalg.LinAlgError:
        pass
    return np.asarray(np.linalg.lstsq(matrix, goal, rcond=SINGULAR)[0])


class BoundedMotion(NamedTuple):
    """The effect of the joints of one group in a step."""

    velocity: Array
    work: float
    """Work of motors, g·px²/s²."""
    loss: float
    """Energy taken by friction and by reached bounds, g·px²/s²."""
    early_loss: float = 0.0
    """Part of `loss` that is already missing in the mean of the velocities before and
    after.
    """


def _doubled_energy(velocities: Array, inverse_masses: Array) -> float:
    """Return twice the kinetic energy of a group, g·px²/s²."""
    is_movable = inverse_masses > 0
    squares = velocities[is_movable] ** 2
    return float((squares / inverse_masses[is_movable]).sum())


def _catch_works(
    impulse: Array, closing: Array, opening: Array, is_caught: Flags
) -> tuple[float, float]:
    """Return the work of reached bounds, and its part before the mean velocity,
    g·px²/s².

    `closing` and `opening` (B,) are the speeds before and after the step.
    """
    # Like a contact, a reached bound does its work at the mean of the velocities
    # before and after the step.
    works = impulse * (closing + opening) / 2
    # The mean of the velocities already lacks the work that the impulse does from the
    # velocity before to the mean.
    mean = (closing + opening) / 2
    early_works = impulse * (closing + mean) / 4
    return float(works[is_caught].sum()), float(early_works[is_caught].sum())


def _impulse_limits(count: int, bounds: Sequence[BoundedRow]) -> tuple[Array, Array]:
    """Return the lowest and the highest impulses of `count` equations and of bounds."""
    low = np.array([-inf] * count + [bound.low for bound in bounds])
    high = np.array([inf] * count + [bound.high for bound in bounds])
    return low, high


def _motor_works(
    bounds: Sequence[BoundedRow], works: Sequence[float]
) -> tuple[float, float]:
    """Return the sums of the work by motors and of the work against them."""
    work = loss = 0.0
    for bound, value in zip(bounds, works, strict=True):
        if bound.is_motor:
            work += max(value, 0.0)
            loss += max(-value, 0.0)
    return work, loss


class BoundedGroup:
    """A group of bodies with bounds of some of its joints."""

    def __init__(self) -> None:
        self._steps: dict[int, int] = {}
        """Number of consecutive steps in which each bound held."""

    def constrain(
        self,
        rows: list[list[float]],
        speeds: list[float],
        bounds: list[BoundedRow],
        light: list[float],
        before: list[float],
        free_velocities: Array | None,
    ) -> BoundedMotion:
        """Return the velocities at which equations `rows` have `speeds` and all bounds
        hold.

        `light`: 1/mass and 1/moment of each velocity in `before`; `free_velocities`:
        velocities before lasting forces changed them, None outside a step.
        """
        # Equations and bounds differ only in their limits: an equation may use any
        # impulse of either sign.
        start_velocities = np.array(before)
        inverse_masses = np.array(light)
        all_rows = [*rows, *(bound.row for bound in bounds)]
        if not all_rows:
            return BoundedMotion(start_velocities, 0.0, 0.0)
        J = np.array(all_rows)
        goal_speeds = np.array([*speeds, *(bound.speed for bound in bounds)])
        goal = goal_speeds - J @ start_velocities
        count = len(rows)
        low, high = _impulse_limits(count, bounds)
        # J M⁻¹ Jᵀ: the change of each row's speed by an impulse of each row. Its
        # diagonal is slightly larger, so that redundant rows have a solution.
        response = (J * inverse_masses) @ J.T
        response.ravel()[:: len(response) + 1] *= 1 + 1e-12
        impulse, _ = bounded_impulses(response, goal, low, high)
        after = start_velocities + inverse_masses * (J.T @ impulse)
        # Work of each row: its impulse times its mean speed in the step.
        works = (impulse * (J @ (start_velocities + after)) / 2)[count:].tolist()
        work, loss = _motor_works(bounds, works)
        if free_velocities is None:
            return BoundedMotion(after, work, loss, 0.0)
        # A rope that becomes taut with a jerk takes energy away like an inelastic
        # impact; one that only holds a weight takes none. The closing speed before the
        # forces of this step tells them apart.
        closing = (J @ free_velocities)[count:]
        # A jerk closes with a speed that is large for the energy of the whole group.
        doubled_energy = _doubled_energy(free_velocities, inverse_masses)
        is_jerk = closing < -JERK * np.sqrt(np.diag(response)[count:] * doubled_energy)
        bound_impulse = impulse[count:]
        is_holding = (bound_impulse > 0) & (low[count:] == 0)
        is_caught = self._catches(is_holding, is_jerk)
        work_of_bounds, early_work = _catch_works(
            bound_impulse, closing, (J @ after)[count:], is_caught
        )
        return BoundedMotion(after, work, loss - work_of_bounds, 0.0 - early_work)

    def _catches(self, holds: Flags, is_jerk: Flags) -> Flags:
        """Return the mask (B,) of the bounds reached in a step.

        `is_jerk`: an end that passes the point of a pulley meets its bound again.
        """
        is_caught = np.zeros(len(holds), bool)
        for k in range(len(holds)):
            steps = 0
            if holds[k]:
                steps = self._steps.get(k, 0) + 1
            if steps > CATCH and is_jerk[k]:
                steps = 1
            self._steps[k] = steps
            is_caught[k] = 0 < steps <= CATCH
        return is_caught
