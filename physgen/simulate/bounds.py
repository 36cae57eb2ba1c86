"""Joints that hold one way or up to a force: ropes, rails with ends, limits of angles, drives, friction in pins."""

from __future__ import annotations

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
"""Joints whose turning has limits and friction."""
TAUT = 1e-6
"""px or rad: a bound that is nearer holds at once."""
TAUT_IN_IMPACT = 0.05
"""px: a bound that is nearer takes part in impacts; between two steps a rope's way is straight, not round."""
MET_IN_STEP = 8.0
"""px: a bound that is farther cannot be met within a step."""
ANGLE_NEAR = 0.02
"""rad per px."""
CATCH = 2
"""Steps in a row in which a bound takes energy: it is met within the first and reached at the end of the second."""
JERK = 0.1
"""Of a group's speed, in terms of energy: a bound that closes faster is met anew."""
EXCHANGES = 8
"""Changes of all bounds at a time, before they change one by one: that always ends (Murty 1974)."""
MOST_EXCHANGES = 200
WHEEL = 4.0
"""px: radius of a pulley's wheels, at which ends stop; nearer, they would turn around the point within a step."""
LEEWAY = 1e-9
"""Of the largest impulse or speed: a bound is met within it."""
SINGULAR = 1e-10
"""Of the largest singular value; see joints.py."""


class Places(Protocol):
    """Where points of bodies are."""

    def find(self, body: int, at: Array) -> tuple[list[float], float, float]:
        """Return the pose of a body, and px from its centre to the point `at` (2,) of it."""


class Bound(NamedTuple):
    """A speed, in terms of velocities of a group, that an impulse between `low` and `high` keeps from falling short."""

    row: list[float]
    speed: float
    """Least speed; of what has no direction, the wanted one."""
    low: float
    high: float
    is_driven: bool = False
    """Whether a motor's work counts."""


def has_bounds(joint: Joint) -> bool:
    """Return whether a joint has more than equations."""
    if joint.kind in (JointKind.ROPE, JointKind.PULLEY, JointKind.SLIDER):
        return True
    return joint.limits is not None or joint.friction > 0


def end(
    joint: Joint, number: int, spots: Places
) -> tuple[int | None, float, float, float, float]:
    """Return a joint's body on one side (0, 1), the place of its point, px, and its arm from the body's centre."""
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
    return 0.0 if body is None else spots.find(body, np.zeros(2))[0][2]


def _add(
    row: list[float],
    place: dict[int, int],
    body: int | None,
    way: Vector,
    arm: Vector,
) -> None:
    """Add the speed along `way` of a body's point at `arm`."""
    if body is None or body not in place:
        return
    k = place[body]
    row[k] += way[0]
    row[k + 1] += way[1]
    row[k + 2] += arm[0] * way[1] - arm[1] * way[0]


def _turning(
    joint: Joint, place: dict[int, int], size: int, part: float
) -> list[float]:
    """Return the turning of the first side less `part` times that of the second."""
    row = [0.0] * size
    for body, sign in ((joint.first, 1.0), (joint.second, -part)):
        if body is not None and body in place:
            row[place[body] + 2] += sign
    return row


def motor_row(joint: Joint, place: dict[int, int], size: int) -> list[float]:
    """Return the turning of the first side against the second."""
    return _turning(joint, place, size, 1.0)


def _rail(
    joint: Joint, place: dict[int, int], spots: Places, size: int
) -> tuple[list[float], list[float], float, float, float]:
    """Return the speeds along and across a rail, px from its first point along and across, and its length."""
    body, x, y, *arm = end(joint, 0, spots)
    other, x0, y0, *_ = end(joint, 1, spots)
    ux, uy = joint.guide[0].tolist()
    arm2 = (0.0, 0.0)
    if other is not None:
        pose, ux, uy = spots.find(other, joint.guide[0])
        arm2 = x - pose[0], y - pose[1]
    length = hypot(ux, uy)
    ux, uy = ux / length, uy / length
    along, across = [0.0] * size, [0.0] * size
    for row, (wx, wy) in ((along, (ux, uy)), (across, (-uy, ux))):
        _add(row, place, body, (wx, wy), (arm[0], arm[1]))
        _add(row, place, other, (-wx, -wy), arm2)
    dx, dy = x - x0, y - y0
    return along, across, dx * ux + dy * uy, dy * ux - dx * uy, length


def guide_rows(
    joint: Joint, place: dict[int, int], spots: Places, size: int
) -> tuple[list[list[float]], list[float]]:
    """Return speeds that a slider or a gear keeps at nothing, and px or rad by which its sides are apart."""
    first = _angle(joint.first, spots)
    second = _angle(joint.second, spots)
    match joint.kind:
        case JointKind.SLIDER:
            _, across, _, gap, _ = _rail(joint, place, spots, size)
            turning = _turning(joint, place, size, 1.0)
            return [across, turning], [gap, first - second]
        case JointKind.GEAR:
            turning = _turning(joint, place, size, joint.ratio)
            return [turning], [first - joint.ratio * second]
        case _:
            return [], []


def bounds_of(
    joint: Joint,
    place: dict[int, int],
    spots: Places,
    size: int,
    h: float,
    strength: float | None,
    near: float = TAUT,
) -> list[Bound]:
    """Return the bounds of a joint in a step of h seconds; motors have `strength` times their limit.

    strength None: those that hold at once, being nearer than `near`, px; of angles,
    that many rad times ANGLE_NEAR.
    """
    rows: list[tuple[list[float], float]] = []
    found: list[Bound] = []
    if joint.kind is JointKind.SLIDER:
        along, _, way, _, length = _rail(joint, place, spots, size)
        rows = [(along, way), ([-v for v in along], length - way)]
        if joint.drive is not None and strength is not None:
            most = joint.force * h * strength
            speed = _speed_in_bounds(joint.drive, way, length - way, h)
            found.append(Bound(along, speed, -most, most, True))
    elif joint.kind in (JointKind.ROPE, JointKind.PULLEY):
        rows = [_rope(joint, place, spots, size)]
        if joint.kind is JointKind.PULLEY:
            rows += _stops(joint, place, spots, size)
    elif joint.kind in UNIFORM:
        turning = _turning(joint, place, size, 1.0)
        angle = _angle(joint.first, spots) - _angle(joint.second, spots)
        if joint.limits is not None:
            least, most = joint.limits
            rows = [(turning, angle - least), ([-v for v in turning], most - angle)]
        if joint.friction > 0 and strength is not None:
            most = joint.friction * h * strength
            found.append(Bound(turning, 0.0, -most, most, True))
    unit = ANGLE_NEAR if joint.kind in UNIFORM else 1.0
    for row, room in rows:
        if strength is not None:
            found.append(Bound(row, -room / h, 0.0, inf))
        elif room <= max(TAUT, near * unit):
            found.append(Bound(row, 0.0, 0.0, inf))
    return found


def _speed_in_bounds(speed: float, behind: float, ahead: float, h: float) -> float:
    """Return the speed of a drive that stops at an end, and does not work against it.

    behind, ahead: px or rad to the ends.
    """
    return min(max(speed, -behind / h), ahead / h)


def motor_bound(
    joint: Joint,
    place: dict[int, int],
    spots: Places,
    size: int,
    h: float,
    strength: float,
) -> Bound:
    """Return the bound of a motor in a step of h seconds, with `strength` times its limit."""
    speed, most = joint.speed, joint.limit * h * strength
    if joint.limits is not None:
        angle = _angle(joint.first, spots) - _angle(joint.second, spots)
        behind, ahead = angle - joint.limits[0], joint.limits[1] - angle
        speed = _speed_in_bounds(speed, behind, ahead, h)
    return Bound(motor_row(joint, place, size), speed, -most, most, True)


def _rope(
    joint: Joint, place: dict[int, int], spots: Places, size: int
) -> tuple[list[float], float]:
    """Return the speed at which a rope gets slack, and px of slack."""
    row, length = [0.0] * size, 0.0
    ends = end(joint, 0, spots), end(joint, 1, spots)
    for number, (body, x, y, *arm) in enumerate(ends):
        if joint.kind is JointKind.PULLEY:
            x0, y0 = joint.guide[number].tolist()
        else:
            _, x0, y0, *_ = ends[1 - number]
        apart = hypot(x - x0, y - y0)
        length += apart
        if apart > 0:
            way = (x0 - x) / apart, (y0 - y) / apart
            _add(row, place, body, way, (arm[0], arm[1]))
    if joint.kind is JointKind.PULLEY:
        between = joint.guide[1] - joint.guide[0]
        length += hypot(*between.tolist())
    else:
        length /= 2
    return row, joint.length - length


def _stops(
    joint: Joint, place: dict[int, int], spots: Places, size: int
) -> list[tuple[list[float], float]]:
    """Return the speeds at which the ends of a pulley leave their points, and px to where the wheels stop them."""
    found = []
    for number in (0, 1):
        body, x, y, *arm = end(joint, number, spots)
        x0, y0 = joint.guide[number].tolist()
        apart = hypot(x - x0, y - y0)
        if body is None or apart <= 0:
            continue
        row = [0.0] * size
        way = (x - x0) / apart, (y - y0) / apart
        _add(row, place, body, way, (arm[0], arm[1]))
        found.append((row, apart - WHEEL))
    return found


def bounded_impulses(
    give: Array, goal: Array, low: Array, high: Array
) -> tuple[Array, Array]:
    """Return impulses (R,) within their bounds, and which of them are free.

    Those that are free reach their goals; one at its lower bound has more than its
    goal, one at its upper bound less.
    """
    count = len(goal)
    is_low, is_high = low == 0.0, np.zeros(count, bool)
    impulse = np.zeros(count)
    for number in range(MOST_EXCHANGES):
        free = ~(is_low | is_high)
        impulse = np.where(is_low, low, np.where(is_high, high, 0.0))
        if free.any():
            rest = goal[free] - give[np.ix_(free, ~free)] @ impulse[~free]
            impulse[free] = _least_squares(give[np.ix_(free, free)], rest)
        slack = LEEWAY * max(float(np.abs(impulse).max()), 1e-300)
        short = goal - give @ impulse
        near = LEEWAY * max(float(np.abs(goal).max()), 1e-300)
        to_low = free & (impulse < low - slack)
        to_high = free & (impulse > high + slack)
        to_free = (is_low & (short > near)) | (is_high & (short < -near))
        wrong = np.flatnonzero(to_low | to_high | to_free)
        if not len(wrong):
            break
        if number >= EXCHANGES:
            wrong = wrong[:1]
        for k in wrong.tolist():
            is_low[k], is_high[k] = bool(to_low[k]), bool(to_high[k])
    return impulse, ~(is_low | is_high)


def _least_squares(matrix: Array, goal: Array) -> Array:
    try:
        found = np.linalg.solve(matrix, goal)
        if np.abs(matrix @ found - goal).max() <= 1e-6 * np.abs(goal).max(initial=0.0):
            return np.asarray(found)
    except np.linalg.LinAlgError:
        pass
    return np.asarray(np.linalg.lstsq(matrix, goal, rcond=SINGULAR)[0])


class BoundedMotion(NamedTuple):
    """What the joints of one group do in a step."""

    velocity: Array
    work: float
    """g·px²/s² of motors."""
    lost: float
    """g·px²/s² taken by friction and by bounds that are met."""
    early: float = 0.0
    """Part of it that the mean of the velocities before and after lacks already."""


class BoundedGroup:
    """A group of bodies of whose joints some have bounds."""

    def __init__(self) -> None:
        self._steps: dict[int, int] = {}
        """Bound -> steps in a row in which it held."""

    def hold(
        self,
        rows: list[list[float]],
        speeds: list[float],
        bounds: list[Bound],
        light: list[float],
        before: list[float],
        within: Array | None,
    ) -> BoundedMotion:
        """Return the velocities with which equations `rows` have `speeds` and bounds hold.

        light: 1/mass and 1/moment of each velocity in `before`; within: velocities
        before lasting forces changed them, None if it is no step.
        """
        begun, weight = np.array(before), np.array(light)
        every = [*rows, *(bound.row for bound in bounds)]
        if not every:
            return BoundedMotion(begun, 0.0, 0.0)
        J = np.array(every)
        goal = np.array([*speeds, *(bound.speed for bound in bounds)]) - J @ begun
        count = len(rows)
        low = np.array([-inf] * count + [bound.low for bound in bounds])
        high = np.array([inf] * count + [bound.high for bound in bounds])
        give = (J * weight) @ J.T
        give.ravel()[:: len(give) + 1] *= 1 + 1e-12
        impulse, _ = bounded_impulses(give, goal, low, high)
        after = begun + weight * (J.T @ impulse)
        done = (impulse * (J @ (begun + after)) / 2)[count:].tolist()
        driven = [k for k, bound in enumerate(bounds) if bound.is_driven]
        work = sum(max(done[k], 0.0) for k in driven)
        lost = sum(max(-done[k], 0.0) for k in driven)
        early = 0.0
        if within is not None:
            closing = (J @ within)[count:]
            # as contacts, a bound that is met does its work at the mean of the step's two velocities
            met = impulse[count:] * (closing + (J @ after)[count:]) / 2
            moves = weight > 0
            size = float((within[moves] ** 2 / weight[moves]).sum())
            is_jerk = closing < -JERK * np.sqrt(np.diag(give)[count:] * size)
            holds = (impulse[count:] > 0) & (low[count:] == 0)
            counts = self._catches(holds, is_jerk)
            lost -= float(met[counts].sum())
            # the energy of the mean is less by half the impulse's work, from the
            # velocity before to the mean
            mean = (closing + (J @ after)[count:]) / 2
            halfway = impulse[count:] * (closing + mean) / 4
            early -= float(halfway[counts].sum())
        return BoundedMotion(after, work, lost, early)

    def _catches(self, holds: Flags, is_jerk: Flags) -> Flags:
        """Return which of the bounds (B,) are met in a step.

        is_jerk: an end that passes the point of a pulley meets its bound again.
        """
        is_caught = np.zeros(len(holds), bool)
        for k in range(len(holds)):
            steps = self._steps.get(k, 0) + 1 if holds[k] else 0
            if steps > CATCH and is_jerk[k]:
                steps = 1
            self._steps[k] = steps
            is_caught[k] = 0 < steps <= CATCH
        return is_caught
