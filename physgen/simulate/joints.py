"""Bodies connected by joints: constraint velocities and responses to impulses."""

from __future__ import annotations

from math import inf

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
        spots = _Spots(pose)
        for group, joints in sorted(self._joints.items()):
            bodies = self._members[group]
            place = {body: 3 * k for k, body in enumerate(bodies)}
            rows: list[list[float]] = []
            wanted: list[float] = []
            limits: list[float] = []
            for joint in joints:
                mine = _rows(joint, place, spots, 3 * len(bodies))
                off, speed = _error(joint, spots), _given(joint, place, spots, velocity)
                rows += mine
                wanted += [-(off[k] / h if motors else 0.0) - speed[k] for k in range(len(mine))]
                limits += [inf] * len(mine)
                if motors and joint.kind is JointKind.MOTOR:
                    turn = [0.0] * (3 * len(bodies))
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
            give.flat[:: len(give) + 1] *= 1 + 1e-12
            goal = np.array(wanted) - J @ before
            impulse = _solved(give, goal)
            turned = np.array([k for k, limit in enumerate(limits) if limit < inf], np.int64)
            if len(turned) and (driven := np.isfinite(limits) & (np.abs(impulse) > limits)).any():
                fixed = np.where(driven, np.sign(impulse) * np.minimum(limits, np.abs(impulse)), 0.0)
                free = ~driven
                impulse = fixed
                impulse[free] = _solved(
                    give[np.ix_(free, free)], goal[free] - give[np.ix_(free, driven)] @ fixed[driven]
                )
            after = before + light * (J.T @ impulse)
            if len(turned):
                mean = J @ (before + after) / 2
                work += float((impulse * mean)[turned].sum())
            velocity[bodies] = after.reshape(-1, 3)
        return velocity, work

    def response(self, bodies: list[int], inverse: Array, pose: Array) -> Array:
        """(3n, 3n): change of the n bodies' velocities by impulses on them, while all joints hold.

        inverse (3n,): 1/mass, 1/mass, 1/moment of each; pose (N, 3). Whole groups must be among the bodies.
        """
        place = {body: 3 * k for k, body in enumerate(bodies)}
        free = np.diag(inverse)
        groups = sorted({g for body in bodies if (g := self.of(body)) is not None})
        if not groups:
            return free
        spots, size = _Spots(pose), 3 * len(bodies)
        rows = [
            row
            for group in groups
            for joint in self._joints[group]
            for row in _rows(joint, place, spots, size)
        ]
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


class _Spots:
    """Where points of bodies are, in plain numbers: with a few joints arrays take longer."""

    def __init__(self, pose: Array) -> None:
        """pose (N, 3)."""
        self.pose: list[list[float]] = pose.tolist()
        self._cosines: list[float] = np.cos(pose[:, 2]).tolist()
        self._sines: list[float] = np.sin(pose[:, 2]).tolist()

    def arm(self, body: int, at: Array) -> tuple[float, float]:
        """px from a body's centre to the point `at` (2,) of it."""
        c, s, (x, y) = self._cosines[body], self._sines[body], at.tolist()
        return c * x - s * y, s * x + c * y


def _error(joint: Joint, spots: _Spots) -> list[float]:
    """px, px and, of a weld, rad by which a joint's two sides are apart."""
    (x, y, turn), (ax, ay) = spots.pose[joint.first], spots.arm(joint.first, joint.first_at)
    (u, v), angle = joint.second_at.tolist(), 0.0
    if joint.second is not None:
        (u, v, angle), (bx, by) = spots.pose[joint.second], spots.arm(joint.second, joint.second_at)
        u, v = u + bx, v + by
    return [x + ax - u, y + ay - v, turn - angle]


def _given(joint: Joint, place: dict[int, int], spots: _Spots, velocity: Array) -> list[float]:
    """The part of a joint's relative velocity that scripted partners bring."""
    total = [0.0, 0.0, 0.0]
    for body, at, sign in ((joint.first, joint.first_at, 1.0), (joint.second, joint.second_at, -1.0)):
        if body is not None and body not in place:
            (x, y), (vx, vy, spin) = spots.arm(body, at), velocity[body].tolist()
            total = [
                total[0] + sign * (vx - spin * y), total[1] + sign * (vy + spin * x), total[2] + sign * spin
            ]  # fmt: skip
    return total


def _rows(joint: Joint, place: dict[int, int], spots: _Spots, size: int) -> list[list[float]]:
    """Velocities that a joint keeps at nothing: of one side's pin against the other's, and of their turning."""
    rows = [[0.0] * size for _ in range(3 if joint.kind is JointKind.WELD else 2)]
    for body, at, sign in ((joint.first, joint.first_at, 1.0), (joint.second, joint.second_at, -1.0)):
        if body is None or body not in place:
            continue
        k = place[body]
        x, y = spots.arm(body, at)
        rows[0][k], rows[0][k + 2] = sign, -sign * y
        rows[1][k + 1], rows[1][k + 2] = sign, sign * x
        if len(rows) == 3:
            rows[2][k + 2] = sign
    return rows
