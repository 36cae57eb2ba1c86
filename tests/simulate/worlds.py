"""Small worlds for the simulator's tests, built by hand."""

from __future__ import annotations

import numpy as np

from physgen.compile.world import Body, Joint, Push, Wall, World, surface
from physgen.scene.scene import Combine, JointKind, Motion, Solid, View

GRAVITY = 980.0


def body(name, x, y, mass, surface, v=(0.0, 0.0), roll=(0.0, 0.0), path=(), **more):
    usual = {"spin": 0.0, "motion": Motion.DYNAMIC, "rolling": 0.0}
    return Body(
        name=name,
        center=np.array([x, y], float),
        mass=mass,
        surface=surface,
        roll=np.array(roll, float),
        velocity=np.array(v, float),
        path=np.array(path, float).reshape(-1, 4),
        **(usual | more),
    )


def ball(
    name, x, y, r=20.0, mass=100.0, e=0.8, mu=0.5, k=0.5, solid=Solid.DISC, **more
):
    rough = surface(mu, e, Combine.GEOMETRIC)
    shape = {"radius": r, "pieces": (), "rings": (), "patch": r}
    return body(
        name, x, y, mass, rough, moment=k * mass * r * r, solid=solid, **shape, **more
    )


def box(name, x, y, w=40.0, h=40.0, mass=100.0, e=0.4, mu=0.5, **more):
    rough = surface(mu, e, Combine.GEOMETRIC)
    piece = np.array([[-w, -h], [w, -h], [w, h], [-w, h]]) / 2
    shape = {
        "radius": None,
        "pieces": (piece,),
        "rings": (piece,),
        "patch": 0.57 * min(w, h),
    }
    return body(
        name,
        x,
        y,
        mass,
        rough,
        moment=mass * (w * w + h * h) / 12,
        solid=Solid.PLATE,
        **shape,
        **more,
    )


def floor(y=400.0, e=0.8, mu=0.5, tilt=0.0):
    ends = np.array(
        [[-5000.0, y - 5000 * np.tan(tilt)], [5000.0, y + 5000 * np.tan(tilt)]]
    )
    return Wall("floor", (ends,), surface(mu, e, Combine.GEOMETRIC))


def world(
    *bodies,
    walls=(),
    pushes=(),
    gravity=(0.0, GRAVITY),
    duration=1.0,
    rate=30.0,
    steps=960.0,
    joints=(),
    fields=(),
    press=0.0,
    table=0.0,
):
    return World(
        size=(512, 512),
        view=View.SIDE,
        gravity=np.array(gravity, float),
        pixels_per_meter=100.0,
        press=press,
        table=surface(table, 0.0, Combine.GEOMETRIC),
        combine=Combine.GEOMETRIC,
        duration=duration,
        steps_per_second=steps,
        times=np.arange(int(duration * rate) + 1) / rate,
        bodies=tuple(bodies),
        walls=tuple(walls),
        pushes=tuple(pushes),
        joints=tuple(joints),
        fields=tuple(fields),
    )


def pin(
    first=0, second=None, at=(0.0, 0.0), to=(0.0, 0.0), kind=JointKind.PIVOT, **how
):
    usual = {
        "length": 0.0,
        "stiffness": 0.0,
        "damping": 0.0,
        "speed": 0.0,
        "limit": np.inf,
        "collide": False,
    }
    return Joint(
        "joint",
        kind,
        first,
        second,
        np.array(at, float),
        np.array(to, float),
        **(usual | how),
    )


def push(
    load, vector=(0.0, 0.0), torque=0.0, at=(0.0, 0.0), start=0.0, end=np.inf, body=0
):
    return Push(
        body, load, np.array(vector, float), torque, np.array(at, float), start, end
    )
