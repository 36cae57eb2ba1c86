"""Motors at their pins: the work they do, from the impulse that the engine tells and its sign from angular momentum."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.scene.model import JointKind, Motion
from physgen.simulate.chipmunk import Touching

Array = NDArray[np.float64]


class Motors:
    """The motors of a world."""

    def __init__(self, world: World) -> None:
        dynamic = [b.motion is Motion.DYNAMIC for b in world.bodies]
        self._world = world
        self._motors = []
        for number, joint in enumerate(j for j in world.joints if j.kind is JointKind.MOTOR):
            sides = [(joint.first, joint.second, joint.first_at, 1.0)]
            if joint.second is not None:
                sides.append((joint.second, joint.first, joint.second_at, -1.0))
            turned = next((side for side in sides if dynamic[side[0]]), None)
            if turned:
                self._motors.append((number, *turned))
        self.busy = bool(self._motors)

    def work(
        self,
        impulses: list[float],
        touch: Touching,
        pose: Array,
        before: Array,
        after: Array,
        load: Array,
        h: float,
    ) -> float:
        """g·px²/s² in the last step; impulses: sizes by motor, g·px²/s; the rest (N, 3), load without gravity."""
        total = 0.0
        for number, body, other, at, _ in self._motors:
            model = self._world.bodies[body]
            angle = pose[body, 2]
            c, s = np.cos(angle), np.sin(angle)
            arm = -np.array([c * at[0] - s * at[1], s * at[0] + c * at[1]])  # from the pin to the centre
            change = after[body] - before[body]
            push = model.mass * (change[:2] - self._world.gravity * h) - load[body, :2] * h
            turn = model.moment * change[2] - load[body, 2] * h + arm[0] * push[1] - arm[1] * push[0]
            pin = pose[body, :2] - arm
            for things, sign in ((touch.first, 1.0), (touch.second, -1.0)):
                on = things == body
                if on.any():
                    points = (touch.on_first[on] + touch.on_second[on]) / 2
                    where = np.where((touch.count[on] > 1)[:, None], points.mean(axis=1), points[:, 0]) - pin
                    given = sign * touch.impulse[on]
                    turn -= float((where[:, 0] * given[:, 1] - where[:, 1] * given[:, 0]).sum())
            mean = (before + after) / 2
            against = mean[other, 2] if other is not None else 0.0
            total += float(np.sign(turn)) * impulses[number] * float(mean[body, 2] - against)
        return total
