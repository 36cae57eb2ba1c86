"""Impacts on bodies that joints hold: nothing falls through, comes apart or gains energy."""

from __future__ import annotations

import os
from math import exp, log

import numpy as np
import pytest
from worlds import ball, box, pin, world

from physgen.compile.world import Wall, surface
from physgen.scene.scene import Combine, JointKind
from physgen.simulate.engine import simulate

BRIDGE = 300.0
"""px: height of the planks' middle."""
DRAWS = int(os.environ.get("PHYSGEN_TEST_DRAWS", "40"))
"""Random bridges and rooms; a simulation of each takes seconds."""


def bridge(
    count, ratio, drop, *, length=100.0, x=290.0, height=10.0, radius=20.0, e=0.0
):
    """Planks of 50 g in a line, pinned to each other and at both ends, and a ball above them."""
    left = 200.0
    planks = [
        box(
            f"plank {k}",
            left + length * (k + 0.5),
            BRIDGE,
            length,
            height,
            mass=50.0,
            e=e,
        )
        for k in range(count)
    ]
    top = BRIDGE - height / 2 - radius - drop
    planks.append(ball("ball", x, top, radius, mass=50 * ratio, e=e))
    half = length / 2
    pins = [pin(k, k + 1, (half, 0), (-half, 0)) for k in range(count - 1)]
    pins.append(pin(0, None, (-half, 0), (left, BRIDGE)))
    pins.append(pin(count - 1, None, (half, 0), (left + count * length, BRIDGE)))
    return world(*planks, joints=pins, duration=2.0, rate=240)


def random_bridge(seed: int):
    """1 to 12 planks, a ball 1 to 1,000 times as heavy as one of them, and the px that it falls."""
    random = np.random.default_rng(seed)
    count = int(random.integers(1, 13))
    length = random.uniform(400, 500) / count
    radius, drop = random.uniform(15, 30), random.uniform(5, 120)
    return bridge(
        count,
        exp(random.uniform(0, log(1000))),
        drop,
        length=length,
        x=random.uniform(230, 170 + length * count),
        height=random.uniform(6, 14),
        radius=radius,
        e=random.choice([0, 0.3, 0.8]),
    ), drop


def pin_gap(scene, motion) -> float:
    """Return the px by which the two sides of any pin were apart."""
    widest = 0.0
    for joint in scene.joints:
        ends = []
        for body, at in (
            (joint.first, joint.first_at),
            (joint.second, joint.second_at),
        ):
            if body is None:
                ends.append(np.tile(at, (len(motion.times), 1)))
                continue
            c, s = np.cos(motion.poses[:, body, 2]), np.sin(motion.poses[:, body, 2])
            arm = np.stack([c * at[0] - s * at[1], s * at[0] + c * at[1]], axis=1)
            ends.append(motion.poses[:, body, :2] + arm)
        widest = max(widest, float(np.hypot(*(ends[0] - ends[1]).T).max()))
    return widest


def bridge_faults(scene, drop: float) -> list[str]:
    """Return what is wrong with the motion of a bridge."""
    motion = simulate(scene)
    heavy = scene.bodies[-1]
    total = motion.energy.kinetic + motion.energy.potential
    x, y = motion.poses[:, -1, 0], motion.poses[:, -1, 1]
    right = scene.joints[-1].second_at[0]
    faults = []
    if total.max() - total[0] > 1e-2 * heavy.mass * 980 * drop:
        faults.append("gains energy")
    if y[(x > 200) & (x < right)].max() > BRIDGE:
        faults.append("falls through")
    if pin_gap(scene, motion) > 0.1:
        faults.append("comes apart")
    return faults


def test_heavy_ball_rests_on_two_pinned_planks():
    scene = bridge(2, 100.0, 46.0)
    motion = simulate(scene)
    assert bridge_faults(scene, 46.0) == []
    assert motion.poses[60:, -1, 1].max() < 276  # 275 without any sag
    assert np.hypot(*motion.velocities[-1, -1, :2]) < 0.5


@pytest.mark.slow
def test_ball_falls_on_bridges():
    faults = {seed: bridge_faults(*random_bridge(seed)) for seed in (0, 1, 2, 68)}
    assert {seed: found for seed, found in faults.items() if found} == {}


@pytest.mark.slow
@pytest.mark.parametrize("first", range(4))
def test_ball_falls_on_many_bridges(first):
    seeds = range(first, DRAWS, 4)
    faults = {seed: bridge_faults(*random_bridge(seed)) for seed in seeds}
    assert {seed: found for seed, found in faults.items() if found} == {}


def energy_drift(seed: int, kind: JointKind, duration: float) -> float:
    """Return the part of its energy that a jointed pair gains or loses in an elastic room."""
    random = np.random.default_rng(seed)
    sizes = random.uniform((30, 8), (70, 20), (2, 2))
    masses = random.uniform(20, 200, 2)
    smooth = {"mu": 0.0, "e": 1.0}
    seam = 150 + sizes[0, 0] / 2
    velocity = random.uniform(-150, 150, 2)
    bodies = [
        box(
            "a",
            150,
            150,
            *sizes[0],
            mass=masses[0],
            v=velocity,
            spin=random.uniform(-4, 4),
            **smooth,
        ),
        box(
            "b",
            seam + sizes[1, 0] / 2,
            150,
            *sizes[1],
            mass=masses[1],
            v=-velocity,
            **smooth,
        ),
    ]
    ends = (sizes[0, 0] / 2, 0), (-sizes[1, 0] / 2, 0)
    corners = [[10, 10], [390, 10], [390, 290], [10, 290], [10, 10]]
    room = Wall(
        "room", (np.array(corners, float),), surface(0.0, 1.0, Combine.GEOMETRIC)
    )
    joints = [pin(0, 1, *ends, kind=kind)]
    rules = {"gravity": (0.0, 0.0), "duration": duration, "rate": 10}
    kinetic = simulate(
        world(*bodies, walls=[room], joints=joints, **rules)
    ).energy.kinetic
    return float(np.abs(kinetic / kinetic[0] - 1).max())


@pytest.mark.parametrize("kind", [JointKind.PIVOT, JointKind.WELD])
def test_jointed_pair_keeps_energy_in_elastic_room(kind):
    assert energy_drift(0, kind, 6.0) < 0.005


@pytest.mark.slow
@pytest.mark.parametrize("first", range(2))
@pytest.mark.parametrize("kind", [JointKind.PIVOT, JointKind.WELD])
def test_jointed_pairs_keep_energy_in_elastic_rooms(kind, first):
    seeds = range(first, DRAWS, 2)
    drifts = {seed: energy_drift(seed, kind, 6.0) for seed in seeds}
    assert {seed: drift for seed, drift in drifts.items() if drift >= 0.005} == {}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 103))
@pytest.mark.parametrize("kind", [JointKind.PIVOT, JointKind.WELD])
def test_jointed_pair_keeps_energy_for_a_minute(kind, seed):
    assert energy_drift(seed, kind, 60.0) < 0.005
