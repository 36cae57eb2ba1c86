"""Second engines on simple worlds: against closed forms, each with the error that is its own, and against ours."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest
from physics.engines import ENGINES as TABLE
from physics.engines import Unsupported, make
from worlds import GRAVITY, ball, box, floor, pin, push, world

from physgen.compile.world import Field, Wall, World, surface
from physgen.scene.scene import Combine, FieldKind, JointKind, Load, Motion, Solid
from physgen.simulate.engine import simulate
from physgen.simulate.trajectory import Trajectory

pytestmark = pytest.mark.slow

RIVALS = tuple(
    name for name in TABLE if name != "box2d" or sys.version_info < (3, 14)
)  # has no wheel from there on
ENGINES = ("ours", *RIVALS)
FREE = {"gravity": (0.0, 0.0)}
TILT = np.radians(15)


def run(engine: str, scene: World, rate: float = 60.0) -> Trajectory:
    """At samples that fall on every engine's steps."""
    times = np.arange(round(scene.duration * rate) + 1) / rate
    return simulate(scene, times) if engine == "ours" else make(engine)(scene, times)


@dataclass(frozen=True)
class Check:
    scene: World
    measured: Callable[[Trajectory], float]
    exact: float
    bars: Mapping[str, float]
    """Engine -> largest relative error."""


def period(t: Trajectory) -> float:
    """s between two passages through x = 0 in one direction."""
    x = t.poses[:, 0, 0]
    up = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    passed = t.times[up] - x[up] * (t.times[up + 1] - t.times[up]) / (x[up + 1] - x[up])
    return float(passed[1] - passed[0])


def last(quantity: str, body: int, axis: int) -> Callable[[Trajectory], float]:
    return lambda t: float(getattr(t, quantity)[-1, body, axis])


def down_the_slope(t: Trajectory) -> float:
    return float(
        (t.poses[-1, 0, :2] - t.poses[0, 0, :2]) @ [np.cos(TILT), np.sin(TILT)]
    )


def on_the_slope(k: float) -> World:
    start = np.array([0.0, 400.0]) + 20 * np.array([np.sin(TILT), -np.cos(TILT)])
    return world(ball("a", *start, k=k, mu=1, e=0), walls=[floor(tilt=TILT, mu=1, e=0)])


def bars(ours: float, plain: float, box2d: float, mujoco: float) -> Mapping[str, float]:
    return {"ours": ours, "plain": plain, "box2d": box2d, "mujoco": mujoco}


SWING = {"joints": [pin(at=(0, -100))], "duration": 5.0}
NUDGE = [push(Load.IMPULSE, (100 * 10.0, 0))]
SPRUNG = [
    pin(kind=JointKind.SPRING, length=100.0, stiffness=100 * 10.0**2, to=(-100, 0))
]
PATH = [(0, 0, 0, 0), (0.5, 100, 0, 0), (2, 100, 0, 0)]

# A rival's bar is a little above what it does: 1/60, 1/240 and 1/960 s of free fall are late by dt/t, springs lag
# likewise, Box2D lifts things by its skin, MuJoCo's contacts are soft.
CHECKS = {
    "free fall": Check(world(ball("a", 0, 0)), last("poses", 0, 1), GRAVITY / 2, bars(1e-4, 0.017, 0.0043, 0.0011)),
    "sliding block": Check(
        world(box("a", 0, 380, v=(300, 0), e=0), walls=[floor(e=0)], duration=2),
        last("poses", 0, 0), 300**2 / (2 * 0.5 * GRAVITY), bars(3e-3, 0.03, 0.008, 0.003),
    ),
    "disc rolling down": Check(
        on_the_slope(1 / 2), down_the_slope, GRAVITY * np.sin(TILT) / 3, bars(3e-3, 0.018, 0.005, 0.002),
    ),
    "sliding to rolling": Check(
        world(ball("a", 0, 380, v=(300, 0), mu=0.3, e=0), walls=[floor(mu=0.3, e=0)], duration=1.5),
        last("velocities", 0, 0), 200.0, bars(3e-3, 1e-6, 0.002, 0.001),
    ),
    "elastic head-on": Check(
        world(ball("a", 0, 0, v=(200, 0), e=1, mu=0), ball("b", 100, 0, mass=300, e=1, mu=0), **FREE),
        last("velocities", 1, 0), 100.0, bars(1e-3, 1e-9, 1e-5, 0.002),
    ),
    "pendulum": Check(
        world(ball("a", 0, 100), pushes=NUDGE, **SWING), period,
        2 * np.pi * np.sqrt((200 + 100**2) / (GRAVITY * 100)), bars(2e-3, 3e-3, 1e-3, 1e-3),
    ),
    "spring": Check(
        world(ball("a", 50, 0), joints=SPRUNG, duration=2, **FREE),
        period, 2 * np.pi / 10, bars(2e-3, 0.02, 1e-3, 1e-3),
    ),
    "motor": Check(
        world(ball("a", 0, 0), ball("b", 60, 0), **FREE,
              joints=[pin(0, 1, (30, 0), (-30, 0), JointKind.MOTOR, speed=3.0)]),
        lambda t: float(t.velocities[-1, 0, 2] - t.velocities[-1, 1, 2]), 3.0, bars(1e-3, 1e-3, 1e-3, 1e-3),
    ),
    "weld": Check(
        world(box("a", 0, 0), box("b", 40, 0), pushes=[push(Load.IMPULSE, (0, 2e4))], **FREE,
              joints=[pin(0, 1, (20, 0), (-20, 0), JointKind.WELD)]),
        last("velocities", 1, 2), -20 * 2e4 / (2 * (100 * 3200 / 12 + 100 * 20**2)), bars(2e-3, 2e-3, 0.012, 1e-3),
    ),
    "scripted body pushes": Check(
        world(box("pusher", 0, 0, motion=Motion.SCRIPTED, path=PATH, e=0), ball("a", 60, 0, e=0, mu=0), **FREE),
        last("velocities", 1, 0), 200.0, bars(3e-3, 1e-3, 1e-3, 0.012),
    ),
    "force for a while": Check(
        world(ball("a", 0, 0), pushes=[push(Load.FORCE, (1e5, 0), start=0.1003, end=0.3141)], **FREE),
        last("velocities", 0, 0), 1e5 * 0.2138 / 100, bars(1e-6, 1e-6, 1e-5, 1e-6),
    ),
    "impulse off the centre": Check(
        world(box("a", 0, 0), pushes=[push(Load.IMPULSE, (0, 2e4), at=(10, 0))], **FREE),
        last("velocities", 0, 2), 10 * 2e4 / (100 * 3200 / 12), bars(1e-6, 1e-6, 1e-5, 1e-6),
    ),
}  # fmt: skip


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("check", CHECKS.values(), ids=CHECKS)
def test_closed_forms(check: Check, engine: str) -> None:
    t = run(engine, check.scene)
    assert check.measured(t) == pytest.approx(check.exact, rel=check.bars[engine])


@pytest.mark.parametrize("e", [1.0, 0.7, 0.4])
@pytest.mark.parametrize("engine", RIVALS)
def test_bounce_gives_back_the_pairs_part(engine: str, e: float) -> None:
    """Unequal surfaces: Box2D by itself would take the larger elasticity."""
    wall = Wall(
        "wall",
        (np.array([[200.0, -100.0], [200.0, 100.0]]),),
        surface(0.0, e**2, Combine.GEOMETRIC),
    )
    scene = world(ball("a", 0, 0, v=(300, 0), e=1, mu=0), walls=[wall], **FREE)
    assert run(engine, scene).velocities[-1, 0, 0] == pytest.approx(
        -300 * e, rel=0.02 if engine == "mujoco" else 1e-3
    )


@pytest.mark.parametrize("engine", RIVALS)
def test_shapes_of_every_kind_rest_on_the_floor(engine: str) -> None:
    triangle = np.array([[-20.0, 10.0], [20.0, 10.0], [0.0, -20.0]])
    angles = np.arange(40) * np.pi / 20
    many = 20 * np.stack(
        [np.cos(angles), np.sin(angles)], axis=1
    )  # more corners than Box2D takes in one piece
    cup = [
        np.array([[x, -40.0], [x + 20, -40.0], [x + 20, 40.0], [x, 40.0]])
        for x in (-60.0, 40.0)
    ]
    cup.append(np.array([[-40.0, 20.0], [40.0, 20.0], [40.0, 40.0], [-40.0, 40.0]]))
    bodies = [
        replace(box("triangle", 0, 389, e=0), pieces=(triangle,)),
        replace(box("many", 100, 379.9, e=0), pieces=(many,)),
        replace(box("cup", 300, 360, motion=Motion.STATIC, e=0), pieces=tuple(cup)),
        ball("in the cup", 300, 300, e=0),
    ]
    t = run(engine, world(*bodies, walls=[floor(e=0)], duration=1.5))
    assert t.poses[-1, :, 1] == pytest.approx([390, 380, 360, 360], abs=0.4)
    assert t.poses[-1, [0, 2, 3], 0] == pytest.approx([0, 300, 300], abs=0.1)


def test_mujoco_rolls_balls_over_a_table() -> None:
    keys = {"k": 0.4, "solid": Solid.SPHERE, "mu": 0.25, "v": (200, 0)}
    scene = world(
        ball("a", 0, 0, roll=(0, -20), **keys), press=GRAVITY, table=0.25, **FREE
    )
    t = make("mujoco")(scene, scene.times)
    assert t.velocities[-1, 0, 0] == pytest.approx(
        (5 * 200 + 2 * 20 * 20) / 7, rel=1e-3
    )
    assert t.rolls[-1, 0] == pytest.approx([0, -t.velocities[-1, 0, 0] / 20], abs=0.01)
    slowed = replace(
        scene,
        bodies=(replace(scene.bodies[0], rolling=0.05, roll=np.array([0.0, -10.0])),),
        duration=6.0,
    )
    t = make("mujoco")(slowed, np.arange(7.0))
    assert t.poses[-1, 0, 0] == pytest.approx(
        200**2 * 1.4 / (2 * 0.05 * GRAVITY), rel=0.03
    )  # one cone holds both


@pytest.mark.parametrize("engine", RIVALS)
def test_what_an_engine_cannot_say_is_refused(engine: str) -> None:
    def refused(scene: World, word: str) -> None:
        with pytest.raises(Unsupported, match=word):
            make(engine)(scene, scene.times)

    wind = Field("wind", FieldKind.WIND, (0,), np.zeros(2), 1.0, 0.0, 0.0)
    refused(world(ball("a", 0, 0), fields=[wind]), "force fields")
    refused(world(ball("a", 0, 0), press=GRAVITY, table=0.3), "table")
    if engine != "mujoco":
        refused(world(ball("a", 0, 0, rolling=0.1)), "rolling resistance")
    make(engine)(
        world(ball("a", 0, 0), press=GRAVITY, table=0.0), np.zeros(1)
    )  # it does not rub
