"""Bodies connected by joints: constraint velocities and responses to impulses."""

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
    """The root of the tree that holds `k`; its branch is shortened on the way."""
    while root[k] != k:
        root[k] = root[root[k]]
        k = root[k]
    return k


SINGULAR = 1e-10
"""Of the largest singular value: smaller ones count as 0, where joints say the same twice."""
JOLT = 0.002
"""Part of a group's kinetic energy that the closing of gaps may have; a turn by 0.06 rad in a step has 0.001."""
SOFTNESS = 1e-3
"""Part of its own response by which a joint yields while gaps are closed without speed."""


class HeldMotion(NamedTuple):
    """What joints do to N bodies in a step."""

    velocity: Array  # (N, 3): px/s, px/s, rad/s
    work: float  # g·px²/s² of motors
    lost: float
    """g·px²/s² that joints took which contradict each other."""
    shift: Array  # (N, 3): px, px, rad by which gaps are closed at once
    early: float
    """Part of `lost` that the mean of the velocities before and after lacks already."""
    led: float
    """Part of `lost` in groups that scripted bodies lead: these bodies did that work."""


class Assemblies:
    """Groups of dynamic bodies that pins, welds and motors connect; springs yield within an impact."""

    def __init__(self, world: World) -> None:
        dynamic = [body.motion is Motion.DYNAMIC for body in world.bodies]
        self.members: dict[int, list[int]] = {}
        """Bodies of each group."""
        self._joints: dict[int, list[Joint]] = {}
        root = {k: k for k in range(len(world.bodies))}
        joints = [j for j in world.joints if j.kind not in SPRINGS]
        for joint in joints:
            if (
                joint.second is not None
                and dynamic[joint.first]
                and dynamic[joint.second]
            ):
                root[find(root, joint.first)] = find(root, joint.second)
        self.busy = any(
            dynamic[j.first] or (j.second is not None and dynamic[j.second])
            for j in joints
        )
        self._root: dict[int, int] = {}
        for joint in joints:
            for body in (joint.first, joint.second):
                if body is not None and dynamic[body]:
                    self._root[body] = find(root, body)
            held = next(
                (
                    b
                    for b in (joint.first, joint.second)
                    if b is not None and dynamic[b]
                ),
                None,
            )
            if held is not None:
                self._joints.setdefault(find(root, held), []).append(joint)
        for body, group in self._root.items():
            self.members.setdefault(group, []).append(body)
        for members in self.members.values():
            members.sort()
        self.bodies = sorted(self._root)
        """Every body that a joint holds."""
        # what is not dynamic has a place in the system, too, and does not yield
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
            light = [
                1 / m if dynamic[b] else 0.0
                for b, own in zip(bodies, weights, strict=True)
                for m in own
            ]
            self._held.append((joints, bodies, light))
        self._scripted = {
            body
            for _, bodies, _ in self._held
            for body in bodies
            if world.bodies[body].motion is Motion.SCRIPTED
        }
        self.has_scripts = bool(self._scripted)
        """Whether joints hold a dynamic body on a scripted one."""
        self._jolt = float(np.hypot(*world.gravity))
        """px/s² of gravity: slower gaps close at any speed."""
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

    def of(self, body: int) -> int | None:
        """The group that a body belongs to; None for one that no joint holds."""
        return self._root.get(body)

    def rows_held(self, order: Order) -> list[int]:
        """Return rows of contacts, as they are listed, of bodies that joints hold."""
        if order.rows_held is None:
            held = np.isin(order.listed[:, :2], self.bodies).any(axis=1)
            order.rows_held = np.flatnonzero(held).tolist()
        return order.rows_held

    def allowed(self, pose: Array, velocity: Array) -> Array:
        """Return the velocities (N, 3) that the joints allow at a pose (N, 3): those given, after joints' impulses."""
        return self.hold(pose, velocity, 1.0, None).velocity

    def hold(
        self,
        pose: Array,
        velocity: Array,
        h: float,
        strength: float | None,
        within: Array | None = None,
    ) -> HeldMotion:
        """Return velocities (N, 3) with which every joint is whole a step of h seconds later, and the work of motors.

        pose (N, 3) now; within (N, 3): velocities before this step's forces. One linear system a
        group, so that chains and welds hold whatever their length and masses
        (SHAKE, Ryckaert and others 1977). A motor turns its two sides at its speed, with at most its limit times
        `strength`; None: what the pins allow now.
        """
        work, motors, spots = 0.0, strength is not None, _Spots(pose, self._all)
        lost = early = led = 0.0
        shift = np.zeros(pose.shape)
        speeds = dict(
            zip(self._all, velocity.take(self._all, axis=0).tolist(), strict=True)
        )
        for number, (joints, bodies, light) in enumerate(self._held):
            place = self._places[number]
            if number in self._bounded:
                before_all = [speed for body in bodies for speed in speeds[body]]
                bounded = self._hold_bounded(
                    number, place, spots, before_all, h, strength, within
                )
                work, lost = work + bounded.work, lost + bounded.lost
                early += bounded.early
                if not self._scripted.isdisjoint(bodies):
                    led += bounded.lost
                speeds.update(
                    zip(bodies, bounded.velocity.reshape(-1, 3).tolist(), strict=True)
                )
                continue
            rows: list[list[float]] = []
            wanted: list[float] = []
            limits: list[float] = []
            gaps: list[float] = []
            for joint in joints:
                mine, off = _rows(joint, place, spots, 3 * len(bodies))
                rows += mine
                wanted += [-one / h if motors else 0.0 for one in off]
                limits += [inf] * len(mine)
                gaps += off
                if motors and joint.kind is JointKind.MOTOR:
                    turn = [0.0] * (3 * len(bodies))
                    for body, sign in ((joint.first, 1.0), (joint.second, -1.0)):
                        if body is not None:
                            turn[place[body] + 2] = sign
                    rows.append(turn)
                    wanted.append(joint.speed)
                    limits.append(joint.limit * h * (strength or 0.0))
            now = [speed for body in bodies for speed in speeds[body]]
            if (
                len(rows) <= 8
                and min(limits) == inf
                and (change := _few_changes(rows, light, now, wanted))
                and not (motors and is_jolt(light, now, change, self._jolt * h))
            ):
                for k, body in enumerate(bodies):
                    speeds[body] = list(
                        map(add, speeds[body], change[3 * k : 3 * k + 3])
                    )
                continue
            J, before = np.array(rows), np.array(now)
            give = (J * light) @ J.T
            give.ravel()[:: len(give) + 1] *= 1 + 1e-12
            goal = np.array(wanted) - J @ before
            impulse = _solved(give, goal)
            turned = [k for k, limit in enumerate(limits) if limit < inf]
            if (
                turned
                and (driven := np.isfinite(limits) & (np.abs(impulse) > limits)).any()
            ):
                fixed = np.where(
                    driven, np.sign(impulse) * np.minimum(limits, np.abs(impulse)), 0.0
                )
                free = ~driven
                impulse = fixed
                impulse[free] = _solved(
                    give[np.ix_(free, free)],
                    goal[free] - give[np.ix_(free, driven)] @ fixed[driven],
                )
            after = before + light * (J.T @ impulse)
            change = (after - before).tolist()
            is_driven = len(gaps) < len(rows)
            if motors and not is_driven and is_jolt(light, now, change, self._jolt * h):
                # near a pose in which joints contradict each other, a gap would be closed at a
                # speed that the motion never had: close it without any
                still = before - light * (J.T @ _solved(give, J @ before))
                if is_jolt(light, still, (after - still).tolist(), self._jolt * h):
                    square = np.diag(give) * SOFTNESS
                    mend = np.linalg.solve(give + np.diag(square), np.array(gaps))
                    moved = np.array(light) * (J.T @ mend)
                    shift[bodies] -= moved.reshape(-1, 3)
                    lost += _energy(light, before) - _energy(light, still)
                    after = still
            if turned:
                mean = (J * (np.array(light) > 0)) @ (before + after) / 2
                work += float((impulse * mean)[turned].sum())
            speeds.update(zip(bodies, after.reshape(-1, 3).tolist(), strict=True))
        velocity = velocity.copy()
        velocity[self._all] = list(speeds.values())
        return HeldMotion(velocity, work, lost, shift, early, led)

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
        """Return what `hold` does to a group of whose joints some have bounds."""
        joints, bodies, light = self._held[number]
        size = len(before)
        rows: list[list[float]] = []
        speeds: list[float] = []
        bounds: list[Bound] = []
        for joint in joints:
            of_joint, off = _rows(joint, place, spots, size)
            rows += of_joint
            speeds += [-gap / h if strength is not None else 0.0 for gap in off]
            bounds += bounds_of(joint, place, spots, size, h, strength)
            if strength is not None and joint.kind is JointKind.MOTOR:
                bounds.append(motor_bound(joint, place, spots, size, h, strength))
        begun = None if within is None else within[bodies].ravel()
        group = self._bounded[number]
        return group.hold(rows, speeds, bounds, light, before, begun)

    def scripted_work(
        self, pose: Array, impulse: Array, velocities: Array, is_linear: bool
    ) -> Array:
        """Return what scripted partners of joints did in a step (K,), g·px²/s², at some velocities (K, N, 3).

        impulse (N, 3) of all joints on bodies; is_linear: angular impulses are not known.
        """
        spots, work = _Spots(pose, self._all), np.zeros(len(velocities))
        for joints, bodies, light in self._held:
            scripted = {b for b in bodies if b in self._scripted}
            if not scripted:
                continue
            place = {body: 3 * k for k, body in enumerate(bodies)}
            rows: list[list[float]] = []
            by_script: list[bool] = []
            for joint in joints:
                mine, _ = _rows(joint, place, spots, 3 * len(bodies))
                bounds = bounds_of(
                    joint, place, spots, 3 * len(bodies), inf, None, MET_IN_STEP
                )
                mine += [bound.row for bound in bounds]
                rows += mine
                is_led = not scripted.isdisjoint((joint.first, joint.second))
                by_script += [is_led] * len(mine)
            if not rows:
                continue
            J, weight = np.array(rows), np.sqrt(np.array(light))
            known = weight * np.tile([1.0, 1.0, float(not is_linear)], len(bodies))
            goal = known * impulse[bodies].ravel()
            given = np.linalg.lstsq((J * known).T, goal, rcond=SINGULAR)[0]
            of_group = velocities[:, bodies].reshape(len(velocities), -1)
            speeds = of_group @ (J * (weight > 0)).T
            work += (given * speeds)[:, by_script].sum(axis=1)
        return work

    def taut_rows(self, bodies: list[int], pose: Array) -> Array:
        """Return speeds (B, 3n) of n bodies that ropes and limits keep from falling below 0 at a pose (N, 3).

        Whole groups must be among the bodies.
        """
        size = 3 * len(bodies)
        found: list[list[float]] = []
        if self._bounded:
            spots, place = (
                _Spots(pose, self._all),
                {b: 3 * k for k, b in enumerate(bodies)},
            )
            for number in self._bounded:
                joints, members, _ = self._held[number]
                if not place.keys() & set(members):
                    continue
                for joint in joints:
                    bounds = bounds_of(
                        joint, place, spots, size, inf, None, TAUT_IN_IMPACT
                    )
                    found += [bound.row for bound in bounds]
        return np.array(found).reshape(-1, size)

    def reactions(
        self, pose: Array, impulse: Array, is_linear: bool
    ) -> dict[str, float]:
        """Return the size of the impulse in each joint, g·px/s, given the impulses (N, 3) of all joints on bodies.

        is_linear: angular impulses are not known.
        """
        spots, found = _Spots(pose, self._all), dict[str, float]()
        for joints, bodies, light in self._held:
            place = {body: 3 * k for k, body in enumerate(bodies)}
            rows: list[list[float]] = []
            owners: list[str] = []
            for joint in joints:
                mine, _ = _rows(joint, place, spots, 3 * len(bodies))
                bounds = bounds_of(joint, place, spots, 3 * len(bodies), inf, None)
                pulls = [bound.row for bound in bounds] if joint.kind in GUIDES else []
                rows += [*mine, *pulls]
                count = min(len(mine), 1 if joint.kind in GUIDES else 2)
                owners += [joint.name] * count + [""] * (len(mine) - count)
                owners += [joint.name] * len(pulls)
            if not rows:
                continue
            weight = np.sqrt(np.array(light))
            if is_linear:
                weight[2::3] = 0.0
            goal = weight * impulse[bodies].ravel()
            given = np.linalg.lstsq((np.array(rows) * weight).T, goal, rcond=SINGULAR)[
                0
            ]
            for owner, size in zip(owners, given.tolist(), strict=True):
                found[owner] = hypot(found.get(owner, 0.0), size)
        return found

    def response(self, bodies: list[int], inverse: Array, *poses: Array) -> Array:
        """(3n, 3n): change of the n bodies' velocities by impulses on them, while all joints hold.

        inverse (3n,): 1/mass, 1/mass, 1/moment of each; poses (N, 3) at each of which
        joints hold. Whole groups must be among the bodies.
        """
        place = {body: 3 * k for k, body in enumerate(bodies)}
        free = np.diag(inverse)
        groups = sorted({g for body in bodies if (g := self.of(body)) is not None})
        if not groups:
            return free
        size = 3 * len(bodies)
        rows = [
            row
            for spots in (_Spots(pose, self._all) for pose in poses)
            for group in groups
            for joint in self._joints[group]
            for row in _rows(joint, place, spots, size)[0]
        ]
        if not rows:
            return free  # ropes alone
        J = np.array(rows)
        give = J @ free
        return np.asarray(
            free - give.T @ np.linalg.pinv(give @ J.T, rcond=SINGULAR) @ give
        )


def _energy(light: Sequence[float], speeds: Sequence[float] | Array) -> float:
    """Return the kinetic energy of what is not held, g·px²/s²; light: 1/mass and 1/moment, 0 if it does not yield."""
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
    """Return whether a change of velocities has more energy than belongs to the motion.

    least: px/s that any group may get.
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
    """Changes of velocities by which few rows have the speeds that are wanted, by Cholesky's method in plain numbers;
    empty where joints say nearly the same twice."""
    lower: list[list[float]] = []
    y: list[float] = []
    for row, goal in zip(rows, wanted, strict=True):
        heavy, line = list(map(mul, row, light)), list[float]()
        for other, known in zip(rows, lower, strict=False):
            line.append(
                (sum(map(mul, heavy, other)) - sum(map(mul, line, known))) / known[-1]
            )
        size = sum(map(mul, heavy, row))
        left = size - sum(map(mul, line, line))
        if left <= 1e-9 * size:
            return []
        y.append(
            (goal - sum(map(mul, row, before)) - sum(map(mul, line, y))) / sqrt(left)
        )
        lower.append([*line, sqrt(left)])
    for k in reversed(range(len(y))):
        above = 0.0
        for i in range(k + 1, len(y)):
            above += lower[i][k] * y[i]
        y[k] = (y[k] - above) / lower[k][k]
    columns = zip(light, zip(*rows, strict=True), strict=True)
    return [m * sum(map(mul, y, column)) if m else 0.0 for m, column in columns]


def _solved(matrix: Array, goal: Array) -> Array:
    """The system's solution; the smallest one where joints say the same twice."""
    try:
        found = np.linalg.solve(matrix, goal)
        most = 1e-6 * max(map(abs, goal.tolist()), default=0.0)
        if all(abs(left) <= most for left in (matrix @ found - goal).tolist()):
            return np.asarray(found)
    except np.linalg.LinAlgError:
        pass
    return np.asarray(np.linalg.lstsq(matrix, goal, rcond=SINGULAR)[0])


class _Spots:
    """Where points of bodies are, in plain numbers: with a few joints arrays take longer."""

    def __init__(self, pose: Array, bodies: list[int]) -> None:
        """pose (N, 3)."""
        pose = pose.take(bodies, axis=0)
        angle = pose[:, 2]
        turns = zip(
            pose.tolist(), np.cos(angle).tolist(), np.sin(angle).tolist(), strict=True
        )
        self._of = dict(zip(bodies, turns, strict=True))

    def find(self, body: int, at: Array) -> tuple[list[float], float, float]:
        """Pose of a body, and px from its centre to the point `at` (2,) of it."""
        (pose, c, s), (x, y) = self._of[body], at.tolist()
        return pose, c * x - s * y, s * x + c * y


GUIDES = (JointKind.SLIDER, JointKind.ROPE, JointKind.PULLEY, JointKind.GEAR)
"""Joints without a pin."""


def _rows(
    joint: Joint, place: dict[int, int], spots: _Spots, size: int
) -> tuple[list[list[float]], list[float]]:
    """Velocities that a joint keeps at nothing, of one side's pin against the other's, and of their turning; and the
    px, px and, of a weld, rad by which its two sides are apart."""
    if joint.kind in GUIDES:
        return guide_rows(joint, place, spots, size)
    rows = [[0.0] * size for _ in range(3 if joint.kind is JointKind.WELD else 2)]
    off = [0.0, 0.0, 0.0]
    for body, at, sign in (
        (joint.first, joint.first_at, 1.0),
        (joint.second, joint.second_at, -1.0),
    ):
        if body is None:
            x, y = at.tolist()
            off[0] -= x
            off[1] -= y
            continue
        if body not in place:
            continue
        k, ((px, py, angle), x, y) = place[body], spots.find(body, at)
        off[0] += sign * (px + x)
        off[1] += sign * (py + y)
        off[2] += sign * angle
        rows[0][k], rows[0][k + 2] = sign, -sign * y
        rows[1][k + 1], rows[1][k + 2] = sign, sign * x
        if len(rows) == 3:
            rows[2][k + 2] = sign
    return rows, off[: len(rows)]
