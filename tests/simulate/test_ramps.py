"""Pushes that take a while."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from physics.engines.stepping import Demand, demands
from worlds import ball, world

from physgen import pipeline
from physgen.evaluate.plausibility.tracks import from_scene
from physgen.simulate.engine import simulate
from physgen.simulate.trajectory import Trajectory

SCENE = """\
physgen: 1
size: [600, 240]
world: {{view: {view}, pixels_per_meter: 400, table: {{friction: 0.5}}, ramp: {ramp}}}
objects:
  a: {{shape: {shape}, mass: 500, friction: 0.5, rolling: 0, velocity: [300, 0]}}
{more}
boundaries: {{floor: {{segment: [[-900, 200], [1500, 200]], friction: 0.5}}}}
render: {{fps: 60}}
"""
BALL = "{circle: {center: [100, 180], radius: 20}}, solid: sphere"
BOX = "{box: {center: [100, 180], size: [60, 40]}}"
END = 6
"""Frame in which 0.1 s end."""


def _motion(
    tmp_path: Path, view: str, shape: str, ramp: str = "0.1 s", more: str = ""
) -> Trajectory:
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE.format(view=view, shape=shape, ramp=ramp, more=more))
    return simulate(pipeline.compile(pipeline.load(path), None).world)


@pytest.mark.parametrize("view", ["side", "top"])
@pytest.mark.parametrize("shape", [BALL, BOX])
def test_ramp_ends_at_the_velocity(tmp_path: Path, view: str, shape: str) -> None:
    motion = _motion(tmp_path, view, shape)
    speeds = motion.velocities[: END + 1, 0, 0]
    assert speeds[0] == 0
    assert np.all(np.diff(speeds) > 0)
    assert speeds[END // 2] == pytest.approx(150, rel=0.01)
    assert speeds[END] == pytest.approx(300, rel=0.002)


@pytest.mark.parametrize("view", ["side", "top"])
@pytest.mark.parametrize("shape", [BALL, BOX])
def test_motion_after_a_ramp_is_as_without(
    tmp_path: Path, view: str, shape: str
) -> None:
    ramped = _motion(tmp_path, view, shape)
    abrupt = _motion(tmp_path, view, shape, "0")
    later = ramped.velocities[END:, 0, 0]
    assert later == pytest.approx(abrupt.velocities[:-END, 0, 0], abs=6)


@pytest.mark.parametrize("view", ["side", "top"])
def test_energy_of_a_ramp_is_work(tmp_path: Path, view: str) -> None:
    energy = _motion(tmp_path, view, BALL).energy
    balance = energy.kinetic + energy.potential + energy.dissipated - energy.work
    assert np.ptp(balance) < 0.004 * energy.kinetic.max()


def test_objects_at_rest_are_not_held(tmp_path: Path) -> None:
    other = "  b: {shape: {circle: {center: [141, 180], radius: 20}}, mass: 500}"
    motion = _motion(tmp_path, "side", BALL, more=other)
    assert motion.velocities[END, 1, 0] > 100


def test_heavy_neighbours_stop_the_hand(tmp_path: Path) -> None:
    other = "  b: {shape: {circle: {center: [141, 180], radius: 20}}, mass: 1.0e9}"
    motion = _motion(tmp_path, "side", BALL, more=other)
    assert abs(motion.velocities[END, 0, 0]) < 30


def test_ramped_objects_are_guided(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    for ramp, guided in (("0.1 s", {0}), ("0", set())):
        text = SCENE.format(view="side", shape=BOX, ramp=ramp, more="")
        path.write_text(text)
        assert from_scene(path).guided_bodies == guided


def test_engines_without_ramps_refuse_them() -> None:
    def demanded(ramp: float) -> frozenset[Demand]:
        body = ball("a", 0, 0, v=(300.0, 0.0), ramp=ramp)
        return demands(world(body))

    assert Demand.NUMBERS in demanded(0.1)
    assert Demand.NUMBERS not in demanded(0.0)
