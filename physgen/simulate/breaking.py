"""Breaking joints: their forces follow from the momentum balance of the bodies.

The part of a body's momentum beyond contacts and lasting forces comes from
its joints.
"""

from __future__ import annotations

from collections import deque
from math import hypot, isfinite

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Joint, World
from physgen.geometry.polygon import cross
from physgen.scene.scene import SPRINGS, Motion
from physgen.simulate.collisions import Impacts
from physgen.simulate.contacts import Order, touching
from physgen.simulate.joints import Assemblies

Array = NDArray[np.float64]

WINDOW = 1 / 240
"""Time over which the force in a joint is averaged, s: rigid bodies stop at once, and
the impulse of a blow becomes a force only over a time.
"""


class Breakages:
    """The unbroken joints of a world with a limit of force."""

    def __init__(self, world: World) -> None:
        self._intact_joints = [
            joint for joint in world.joints if isfinite(joint.breaks)
        ]
        bodies = world.bodies
        weights = [[body.mass, body.mass, body.moment] for body in bodies]
        is_dynamic = [body.motion is Motion.DYNAMIC for body in bodies]
        self._weight = np.where(np.array(is_dynamic)[:, None], weights, 0.0)
        self._gravity = np.append(world.gravity, 0.0)
        self._histories: dict[str, deque[tuple[float, float]]] = {
            joint.name: deque() for joint in self._intact_joints
        }
        """Duration, s, and impulse, g·px/s, of the last steps by the name of a
        joint.
        """

    @property
    def busy(self) -> bool:
        """Check whether any joint may break."""
        return bool(self._intact_joints)

    def joint_impulses(
        self,
        change: Array,
        pose: Array,
        h: float,
        load: Array | None,
        contacts: tuple[Order, bytes],
        impacts: list[Impacts],
    ) -> Array:
        """Return the impulses (N, 3) of joints in a step of h seconds.

        `change` (N, 3) of the velocities, `pose` (N, 3), `load` (N, 3) of lasting
        forces.
        """
        # Start with the total change of momentum, and subtract all known causes.
        impulse = self._weight * (change - h * self._gravity)
        if load is not None:
            impulse -= np.where(self._weight > 0, load * h, 0.0)
        count = len(pose)
        order, numbers = contacts
        if numbers:
            touch = touching(order.words, order.sort(numbers))
            # The sum of the impulses of a contact acts between its two points.
            points = (touch.on_first + touch.on_second) / 2
            last_point = np.where(touch.count == 1, 0, 1)
            centres = (points[:, 0] + points[np.arange(len(points)), last_point]) / 2
            for bodies, sign in ((touch.first, 1.0), (touch.second, -1.0)):
                is_body = bodies < count
                arms = centres[is_body] - pose[bodies[is_body], :2]
                impulses = sign * touch.impulse[is_body]
                impulses_and_moments = np.column_stack(
                    [impulses, cross(arms, impulses)]
                )
                np.subtract.at(impulse, bodies[is_body], impulses_and_moments)
        # The place of an impact is not known here: its angular momentum is left in.
        for impact in impacts:
            for bodies, sign in ((impact.first, 1.0), (impact.second, -1.0)):
                is_body = bodies < count
                np.subtract.at(
                    impulse[:, :2], bodies[is_body], sign * impact.impulse[is_body]
                )
        return np.where(self._weight > 0, impulse, 0.0)

    def review(
        self,
        assemblies: Assemblies,
        pose: Array,
        impulse: Array,
        h: float,
        is_blow: bool,
    ) -> list[Joint]:
        """Return the joints that break in a step of h seconds.

        `impulse` (N, 3) of the joints in the step; `is_blow`: impacts occurred, and the
        angular impulses are unknown.
        """
        reactions = assemblies.reactions(pose, impulse, is_blow)
        broken_joints = []
        for joint in self._intact_joints:
            if joint.kind in SPRINGS:
                # Hooke's law gives the force of a spring directly. The forces of other
                # joints follow from the change of momentum of their bodies.
                size = h * joint.stiffness * abs(_length(joint, pose) - joint.length)
            else:
                size = reactions.get(joint.name, 0.0)
            history = self._histories[joint.name]
            history.append((h, size))
            # Keep just as many steps as fill the window.
            while len(history) > 1 and sum(
                duration for duration, _ in history
            ) - history[0][0] >= (WINDOW * (1 - 1e-6)):
                history.popleft()
            # The mean force over a window decides: a single step of an impact has a
            # force without meaning, as it depends on the length of the step.
            duration = max(WINDOW, sum(duration for duration, _ in history))
            if (
                sum(step_impulse for _, step_impulse in history) / duration
                > joint.breaks
            ):
                broken_joints.append(joint)
        self._intact_joints = [
            joint for joint in self._intact_joints if joint not in broken_joints
        ]
        return broken_joints


def _length(spring: Joint, pose: Array) -> float:
    """Return the distance between a spring's ends, px."""
    ends = []
    for body, at in (
        (spring.first, spring.first_at),
        (spring.second, spring.second_at),
    ):
        if body is None:
            ends.append(at)
            continue
        # The ends are fixed to their bodies and turn with them.
        c = np.cos(pose[body, 2])
        s = np.sin(pose[body, 2])
        ends.append(pose[body, :2] + [c * at[0] - s * at[1], s * at[0] + c * at[1]])
    x, y = (ends[0] - ends[1]).tolist()
    return hypot(x, y)
