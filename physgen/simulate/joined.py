"""Bodies that joints hold together -> how a blow on one of them moves them all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Joint, World
from physgen.scene.model import JointKind, Motion

Array = NDArray[np.float64]


class Assemblies:
    """Groups of dynamic bodies that pins, welds and motors connect; springs yield within a blow."""

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
