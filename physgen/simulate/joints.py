"""Bodies connected by joints: constraint velocities and responses to impulses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Joint, World
from physgen.scene.scene import JointKind, Motion

Array = NDArray[np.float64]


class Assemblies:
    """Groups of dynamic bodies that pins, welds and motors connect; springs yield within an impact."""

    def __init__(self, world: World) -> None:
        dynamic = [body.motion is Motion.DYNAMIC for body in world.bodies]
        self._members: dict[int, list[int]] = {}
        self._joints: dict[int, list[Joint]] = {}
        root = list(range(len(world.bodies)))

        def find(k: int) -> int:
            while root[k] != k:
                k = root[k]
            return k

        joints = [j for j in world.joints if j.kind is not JointKind.SPRING]
        for joint in joints:
            if joint.second is not None and dynamic[joint.first] and dynamic[joint.second]:
                root[find(joint.first)] = find(joint.second)
        self.busy = any(dynamic[j.first] or (j.second is not None and dynamic[j.second]) for j in joints)
        self._root: dict[int, int] = {}
        for joint in joints:
            for body in (joint.first, joint.second):
                if body is not None and dynamic[body]:
                    self._root[body] = find(body)
            held = next((b for b in (joint.first, joint.second) if b is not None and dynamic[b]), None)
            if held is not None:
                self._joints.setdefault(find(held), []).append(joint)
        for body, group in self._root.items():
            self._members.setdefault(group, []).append(body)
        for members in self._members.values():
            members.sort()

    def of(self, body: int) -> int | None:
        """The group that a body belongs to; None for one that no joint holds."""
        return self._root.get(body)

    def members(self, group: int) -> list[int]:
        """Its bodies."""
        return self._members[group]

    def held(self) -> list[int]:
        """Every body that a joint holds."""
        return sorted(self._root)

    def hold(
        self, pose: Array, velocity: Array, inverse: Array, h: float, strength: float | None
    ) -> tuple[Array, float]:
        """Velocities (N, 3) with which every joint is whole a step of h seconds later, and the work of the motors.

        pose (N, 3) now; inverse (N, 3): 1/mass, 1/mass, 1/moment, 0 for what is not dynamic. One linear system a
        group, so that chains and welds hold whatever their length and masses (SHAKE, Ryckaert and others 1977). A
        motor turns its two sides at its speed, with at most its limit times `strength`; None: what the pins allow now.
        """
        velocity, work, motors = velocity.copy(), 0.0, strength is not None
        for group, joints in sorted(self._joints.items()):
            bodies = self._members[group]
            place = {body: 3 * k for k, body in enumerate(bodies)}
            rows, wanted, limits = [], [], []
            for joint in joints:
                mine = _rows(joint, place, pose, 3 * len(bodies))
                off = _error(joint, pose)
                speed = _given(joint, place, pose, velocity)
                for k, row in enumerate(mine):
                    rows.append(row)
                    wanted.append(-(off[k] / h if motors else 0.0) - speed[k])
                    limits.append(np.inf)
                if motors and joint.kind is JointKind.MOTOR:
                    turn = np.zeros(3 * len(bodies))
                    rest = 0.0
                    for body, sign in ((joint.first, 1.0), (joint.second, -1.0)):
                        if body is not None and body in place:
                            turn[place[body] + 2] = sign
                        elif body is not None:
                            rest += sign * float(velocity[body, 2])
                    rows.append(turn)
                    wanted.append(joint.speed - rest)
                    limits.append(joint.limit * h * (strength or 0.0))
            J, light = np.array(rows), inverse[bodies].ravel()
            before = velocity[bodies].ravel()
            give = (J * light) @ J.T
            give[np.diag_indices_from(give)] *= 1 + 1e-12
            goal = np.array(wanted) - J @ before
            impulse = _solved(give, goal)
            driven = np.isfinite(limits) & (np.abs(impulse) > limits)
            if driven.any():
                fixed = np.where(driven, np.sign(impulse) * np.minimum(limits, np.abs(impulse)), 0.0)
                free = ~driven
                impulse = fixed
                impulse[free] = _solved(
                    give[np.ix_(free, free)], goal[free] - give[np.ix_(free, driven)] @ fixed[driven]
                )
            after = before + light * (J.T @ impulse)
            mean = J @ (before + after) / 2
            work += float((impulse * mean)[self._motor_rows(joints, motors)].sum())
            velocity[bodies] = after.reshape(-1, 3)
        return velocity, work

    def _motor_rows(self, joints: list[Joint], motors: bool) -> NDArray[np.bool_]:
        """Which rows of a group's system are motors'."""
        rows: list[bool] = []
        for joint in joints:
            rows += [False] * (3 if joint.kind is JointKind.WELD else 2)
            rows += [True] * (motors and joint.kind is JointKind.MOTOR)
        return np.array(rows, bool)

    def response(self, bodies: list[int], inverse: Array, pose: Array) -> Array:
        """(3n, 3n): change of the n bodies' velocities by impulses on them, while all joints hold.

        inverse (3n,): 1/mass, 1/mass, 1/moment of each; pose (N, 3). Whole groups must be among the bodies.
        """
        place = {body: 3 * k for k, body in enumerate(bodies)}
        free = np.diag(inverse)
        rows: list[Array] = []
        for group in sorted({g for body in bodies if (g := self.of(body)) is not None}):
            for joint in self._joints[group]:
                rows += _rows(joint, place, pose, 3 * len(bodies))
        if not rows:
            return free
        J = np.array(rows)
        give = J @ free
        return np.asarray(free - give.T @ np.linalg.pinv(give @ J.T) @ give)


def _solved(matrix: Array, goal: Array) -> Array:
    """The system's solution; the smallest one where joints say the same twice."""
    try:
        found = np.linalg.solve(matrix, goal)
        if np.isfinite(found).all() and np.abs(matrix @ found - goal).max(initial=0) <= 1e-6 * np.abs(
            goal
        ).max(initial=1e-300):
            return np.asarray(found)
    except np.linalg.LinAlgError:
        pass
    return np.asarray(np.linalg.lstsq(matrix, goal, rcond=1e-10)[0])


def _arm(at: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * at[0] - s * at[1], s * at[0] + c * at[1]])


def _error(joint: Joint, pose: Array) -> list[float]:
    """px, px and, of a weld, rad by which a joint's two sides are apart."""
    one = pose[joint.first, :2] + _arm(joint.first_at, pose[joint.first, 2])
    two, angle = joint.second_at, 0.0
    if joint.second is not None:
        two = pose[joint.second, :2] + _arm(joint.second_at, pose[joint.second, 2])
        angle = float(pose[joint.second, 2])
    return [*(one - two).tolist(), float(pose[joint.first, 2]) - angle]


def _given(joint: Joint, place: dict[int, int], pose: Array, velocity: Array) -> list[float]:
    """The part of a joint's relative velocity that scripted partners bring."""
    total = np.zeros(3)
    for body, at, sign in ((joint.first, joint.first_at, 1.0), (joint.second, joint.second_at, -1.0)):
        if body is not None and body not in place:
            arm, (vx, vy, spin) = _arm(at, pose[body, 2]), velocity[body]
            total += sign * np.array([vx - spin * arm[1], vy + spin * arm[0], spin])
    return total.tolist()


def _rows(joint: Joint, place: dict[int, int], pose: Array, size: int) -> list[Array]:
    """Velocities that a joint keeps at nothing: of one side's pin against the other's, and of their turning."""
    rows = [np.zeros(size) for _ in range(3 if joint.kind is JointKind.WELD else 2)]
    for body, at, sign in ((joint.first, joint.first_at, 1.0), (joint.second, joint.second_at, -1.0)):
        if body is None or body not in place:
            continue
        k = place[body]
        c, s = np.cos(pose[body, 2]), np.sin(pose[body, 2])
        rows[0][k], rows[0][k + 2] = sign, -sign * (s * at[0] + c * at[1])
        rows[1][k + 1], rows[1][k + 2] = sign, sign * (c * at[0] - s * at[1])
        if len(rows) == 3:
            rows[2][k + 2] = sign
    return rows
