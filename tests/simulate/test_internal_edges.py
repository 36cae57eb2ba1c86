"""What slides over seams, kinks and edges of a surface that continues keeps its speed, whatever its steps are."""

from __future__ import annotations

from dataclasses import replace
from math import cos, exp, log, radians, sin

import numpy as np
import pytest
from worlds import ball, box, world

from physgen.compile.world import Wall, surface
from physgen.scene.scene import Combine, Motion
from physgen.simulate.engine import simulate
from physgen.simulate.internal_edges import internal_edges

EDGE = 200.0
TOP = 100.0
CASES = ("edge", "static blocks", "loose blocks", "rail from above")
SMOOTH = {"mu": 0.0, "e": 0.5}


def wall(*points, name="table"):
    return Wall(name, (np.array(points, float),), surface(0.5, 0.4, Combine.GEOMETRIC))


def triangle(name, x, foot, width, height, apex, v):
    """A triangle of the height over a foot on the surface."""
    corners = np.array([[-width / 2, 0], [width / 2, 0], [apex * width, -height]])
    middle = corners.mean(axis=0)
    body = box(name, x + middle[0], foot + middle[1], width, height, v=(v, 0), **SMOOTH)
    piece = corners - middle
    return type(body)(**{**vars(body), "pieces": (piece,), "rings": (piece,)})


def sliding_world(seed: int, case: str):
    """A world in which `slider` slides to the right over seams or an edge, and its speed, px/s."""
    random = np.random.default_rng([seed, CASES.index(case)])
    speed = round(exp(random.uniform(0, log(600))), 2)
    if random.random() < 0.5:
        speed = float(random.integers(1, 601))
    gap = min(random.uniform(0.1, 25), speed / 2)
    if random.random() < 0.6:  # its front is exactly at the edge after a step
        gap = max(1, round(gap * 960 / speed)) * speed / 960
    width, height = random.choice([20.0, 40.0]), random.choice([10.0, 30.0])
    x = EDGE - gap - width / 2
    match random.choice(["box", "triangle", "ball"]):
        case "box":
            slider = box(
                "slider", x, TOP - height / 2, width, height, v=(speed, 0), **SMOOTH
            )
        case "triangle":
            apex = random.uniform(-0.4, 0.4)
            slider = triangle("slider", x, TOP, width, height, apex, speed)
        case _:
            slider = ball(
                "slider", EDGE - gap, TOP - width / 2, width / 2, v=(speed, 0), **SMOOTH
            )
    bodies, walls, more = [slider], [], {}
    angle = radians(random.choice([5, 10, 20, 45, 70, 90, 120]))
    if case in ("edge", "rail from above"):
        end = EDGE + 200 * cos(angle), TOP + 200 * sin(angle)
        points = [(-300, TOP), (EDGE, TOP), end]
        walls = [wall(*points)]
        if random.random() < 0.5:
            walls = [wall(*points[:2]), wall(*points[1:], name="slope")]
    if case == "rail from above":
        more = {"gravity": (0.0, 0.0), "press": 980.0}
    if case.endswith("blocks"):
        is_static = case == "static blocks"
        how = {"motion": Motion.STATIC} if is_static else {"mass": 5000.0, "mu": 0.9}
        lengths = [400.0, 30.0, 30.0, 30.0, 60.0]
        left = EDGE - 400
        for k, length in enumerate(lengths):
            bodies.append(
                box(f"block {k}", left + length / 2, TOP + 20, length, 40, **how)
            )
            left += length
        walls = [] if is_static else [wall((-400, TOP + 40), (900, TOP + 40))]
    duration = min((gap + 0.45 * width) / speed, 3.0)
    rules = {"duration": duration, "rate": 960.0, **more}
    return world(*bodies, walls=walls, **rules), speed


def speed_loss(seed: int, case: str) -> float:
    """Return the speed lost over what may be lost: 0.1 %, or 0.2 px/s as overlaps of 0.005 px tilt what lies."""
    scene, speed = sliding_world(seed, case)
    slowest = float(simulate(scene).velocities[:, 0, 0].min())
    return (speed - slowest) / max(1e-3 * speed, 0.2)


@pytest.mark.parametrize("case", CASES)
def test_sliding_over_seams_keeps_speed(case):
    assert max(speed_loss(seed, case) for seed in range(6)) < 1


@pytest.mark.parametrize("case", ["static blocks", "loose blocks"])
def test_shared_edges_do_not_change_motion(case):
    """A run after others of the same world gives the bytes of the first one."""
    scene, _ = sliding_world(0, case)
    slider = replace(scene.bodies[0], velocity=np.array([40.0, 0.0]))
    other = replace(scene, bodies=(slider, *scene.bodies[1:]))
    internal_edges.cache_clear()
    first = simulate(scene)
    assert simulate(other).poses.tobytes() != first.poses.tobytes()
    again = simulate(scene)
    assert internal_edges.cache_info().hits == 2
    assert again.poses.tobytes() == first.poses.tobytes()
    assert again.contacts.impulses.tobytes() == first.contacts.impulses.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_sliding_over_many_seams_keeps_speed(case):
    losses = {seed: speed_loss(seed, case) for seed in range(200)}
    assert {seed: loss for seed, loss in losses.items() if loss >= 1} == {}


@pytest.mark.parametrize(
    ("seed", "case"), [(31, "static blocks"), (79, "loose blocks")]
)
def test_ball_above_corner_keeps_its_speed(seed, case):
    """Its centre is in line with the side of the next block at the end of a step."""
    assert speed_loss(seed, case) < 1


@pytest.mark.parametrize("side", [-1, 1])
def test_ball_bounces_off_corner_below_its_centre(side):
    block = box("block", 300 + side * 50, 300, 100, 40, motion=Motion.STATIC)
    falling = ball("ball", 300, 255, 20, e=0.8)
    end = simulate(world(falling, block, duration=0.15, rate=960))
    assert abs(end.velocities[:, 0, 0]).max() < 1
    assert end.velocities[:, 0, 1].min() < -50


@pytest.mark.parametrize("x", range(100, 120, 3))
def test_box_leaves_table_at_its_speed(x):
    slider = box("slider", x, 90, 40, 20, v=(60, 0), **SMOOTH)
    table = wall((0, 100), (200, 100), (200, 290))
    end = simulate(world(slider, walls=[table], duration=2.0))
    speeds = end.velocities[:, 0, 0]
    assert speeds.min() > 59.9
    assert end.poses[-1, 0, 0] > 200


def test_box_hits_wall_that_rises_from_table():
    """A corner that slides on the floor into a wall of the same line is stopped."""
    slider = box("slider", 100, 90, 40, 20, v=(60, 0), mu=0.0, e=0.0)
    table = wall((0, 100), (200, 100), (200, 50))
    end = simulate(world(slider, walls=[table], duration=2.0))
    assert end.poses[-1, 0, 0] == pytest.approx(180, abs=0.1)
    assert abs(end.velocities[-1, 0, 0]) < 0.1


def test_box_hits_step_of_one_pixel():
    """A block that stands 1 px higher than its neighbour stops what slides."""
    slider = box("slider", 100, 90, 40, 20, v=(60, 0), mu=0.0, e=0.0)
    low = box("low", 100, 120, 200, 40, motion=Motion.STATIC)
    high = box("high", 300, 119, 200, 40, motion=Motion.STATIC)
    end = simulate(world(slider, low, high, duration=2.0))
    assert end.poses[-1, 0, 0] < 185
