"""World -> Trajectory on MuJoCo 4 (the wheel `mujoco-core`), in double precision.

960 steps a second of semi-implicit Euler (its default), the Newton solver (its default) to 1e-12, elliptic friction
cones, constraints as hard as it allows. MuJoCo has no coefficient of restitution: where a pair's is above 0 its
contact is a damped spring of 10 ms made to measure (`mjcf.spring`), and the run takes 15,360 steps a second; by
chance of where in a step contact begins, what comes back is off by up to 0.4 % at e = 0.8, 1 % at 0.5, 3 % at 0.3, and
things sink into each other by 3 ms of their closing speed meanwhile.

Its cones are convex: a contact that slips is pushed apart as well, so that oblique hits with friction bounce too
high, and weight under a sliding face is not shared out evenly.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.geometry.polygon import cross, rotation
from physgen.scene.scene import JointKind, Load, Motion
from physgen.simulate.trajectory import Trajectory

from .mjcf import bounces, mjcf
from .stepping import (
    Demand,
    Units,
    body_units,
    is_ball,
    lies_on_table,
    loads,
    record,
    refuse,
    script,
)

Array = NDArray[np.float64]

STEP = 1 / 960
"""s: pushes and scripted bodies are set this often."""
PARTS = 16
"""Of a step, where things bounce."""

CANNOT = {
    Demand.FIELDS: "they would be our own formula again",
    Demand.MACHINES: "they are not written for it",
    Demand.FACES: "its contacts load what slips fastest most, so spin and slide are not shared over an area",
    Demand.TABLE_JOINTS: "a pinned ball would have to hold its axis upright",
    Demand.LINES: "they are not written for it",
    Demand.SURFACES: "they are not written for it",
    Demand.NUMBERS: "they are not written for it",
    Demand.CURVES: "they are not written for it",
}


def run(world: World, times: Array, step: float = STEP) -> Trajectory:
    """Motion at `times` (T,) s; raises Unsupported for what is in `CANNOT`, ArithmeticError where MuJoCo warns."""
    refuse("MuJoCo", world, CANNOT)
    warnings: list[str] = []
    mujoco.set_mju_user_warning(
        warnings.append
    )  # else it writes a log file into the current folder
    try:
        trajectory = record(_Model(world, body_units(world), step), world, times, step)
    finally:
        mujoco.set_mju_user_warning(None)
    if warnings:
        raise ArithmeticError(f"MuJoCo: {warnings[0]}")
    return trajectory


class _Model:
    def __init__(self, world: World, units: Units, step: float) -> None:
        self._world, self._units = world, units
        self._parts = PARTS if bounces(world) else 1
        self._model = mujoco.MjModel.from_xml_string(
            mjcf(world, units, step / self._parts)
        )
        self._data = mujoco.MjData(self._model)
        self.iterations = int(self._model.opt.iterations)
        table = lies_on_table(world)
        moving = [
            k for k, body in enumerate(world.bodies) if body.motion is not Motion.STATIC
        ]
        self._balls = [
            k
            for k in moving
            if table
            and is_ball(world.bodies[k])
            and world.bodies[k].motion is Motion.DYNAMIC
        ]
        self._flat = [k for k in moving if k not in self._balls]
        joints = [
            [self._data.joint(f"{axis}{k}").id for axis in "xya"] for k in self._flat
        ]
        joints_of = np.array(joints, np.int64).reshape(-1, 3)
        self._q, self._v = (
            self._model.jnt_qposadr[joints_of],
            self._model.jnt_dofadr[joints_of],
        )
        """(F, 3): where the x, y and angle of what moves in the plane are kept."""
        self._scale = np.array([units.length, units.length, 1.0])
        self._home = np.array(
            [[*body.center, *np.zeros(6)] for body in world.bodies]
        ).reshape(-1, 8)
        for k in moving:
            self._add_velocity(
                k,
                np.array([*world.bodies[k].velocity, world.bodies[k].spin]),
                world.bodies[k].roll,
            )
        for index, joint in enumerate(world.joints):
            if joint.kind is JointKind.MOTOR:
                self._data.actuator(f"j{index}").ctrl = joint.speed
        self._state = self._read(np.zeros(len(world.bodies)))

    def state(self) -> Array:
        """As `stepping.Engine`."""
        return self._state

    def step(self, begin: float, end: float) -> None:
        """As `stepping.Engine`."""
        data = self._data
        data.xfrc_applied[:] = 0.0
        for k, body in enumerate(self._world.bodies):
            if body.motion is Motion.SCRIPTED:
                self._place(k, begin, end)
        for push, part in loads(self._world, begin, end):
            arm = rotation(self._state[push.body, 2]) @ push.point
            load = np.array(
                [*push.vector, float(cross(arm, push.vector)) + push.torque]
            )
            if push.load is Load.IMPULSE:
                body = self._world.bodies[push.body]
                self._add_velocity(
                    push.body, load / (body.mass, body.mass, body.moment), np.zeros(2)
                )
            else:
                scaled = load * part * self._scale / self._units.moment
                data.body(f"b{push.body}").xfrc_applied[[0, 1, 5]] += scaled
        mujoco.mj_step(self._model, data, self._parts)
        before = self._state
        self._state = self._read(before[:, 2])
        # a quaternion does not tell how often a ball has turned about the line of sight
        turned = (end - begin) * (before[:, 5] + self._state[:, 5]) / 2
        self._state[self._balls, 2] += turned[self._balls]

    def _read(self, angles: Array) -> Array:
        """(N, 8) as `stepping.Engine`, but for the angles of balls, which are given."""
        data, length = self._data, self._units.length
        state = self._home.copy()
        state[self._flat, :3] += data.qpos[self._q] * self._scale
        state[self._flat, 3:6] = data.qvel[self._v] * self._scale
        for k in self._balls:
            joint, turn = data.joint(f"x{k}"), np.empty(3)
            mujoco.mju_rotVecQuat(turn, joint.qvel[3:], joint.qpos[3:])
            state[k] = (
                *(joint.qpos[:2] * length),
                angles[k],
                *(joint.qvel[:2] * length),
                turn[2],
                *turn[:2],
            )
        return state

    def _place(self, k: int, begin: float, end: float) -> None:
        """Put a scripted body where it should be, with the velocity that brings it to where it will be."""
        now, then = (script(self._world.bodies[k].path, time) for time in (begin, end))
        row = self._flat.index(k)
        self._data.qpos[self._q[row]] = (now - self._home[k, :3]) / self._scale
        self._data.qvel[self._v[row]] = (then - now) / (end - begin) / self._scale

    def _add_velocity(self, k: int, change: Array, roll: Array) -> None:
        """To a body: px/s, px/s, rad/s; to a ball also rad/s about x and y."""
        change = change / self._scale
        if k in self._balls:
            joint, back, turn = self._data.joint(f"x{k}"), np.empty(4), np.empty(3)
            mujoco.mju_negQuat(back, joint.qpos[3:])
            mujoco.mju_rotVecQuat(turn, np.array([*roll, change[2]]), back)
            joint.qvel[:] += (*change[:2], 0.0, *turn)
        elif self._world.bodies[k].motion is Motion.DYNAMIC:
            self._data.qvel[self._v[self._flat.index(k)]] += change
