"""Ropes, limits, pulleys, breaking and scripted partners of joints in whole scenes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import written

from physgen.simulate.engine import simulate
from physgen.simulate.trajectory import Trajectory

HEAD = "physgen: 1\nsize: [600, 700]\nworld: {view: side, duration: 2}\n"


def run(tmp_path: Path, text: str, duration: float = 2) -> Trajectory:
    head = HEAD.replace("duration: 2", f"duration: {duration}")
    times = np.linspace(0, duration, round(240 * duration) + 1)
    return simulate(written.world(tmp_path, head + text), times)


def imbalance(motion: Trajectory) -> float:
    """Return the largest error of the energy over the largest of its terms."""
    energy = motion.energy
    total = energy.kinetic + energy.potential + energy.dissipated - energy.work
    terms = (energy.kinetic, energy.potential, energy.dissipated, energy.work)
    return float(np.abs(total - total[0]).max() / max(map(np.ptp, terms)))


@pytest.mark.parametrize(("joint", "rest"), [("weld", 290), ("pivot", 300)])
def test_parts_of_a_broken_joint_collide(tmp_path: Path, joint: str, rest: int) -> None:
    text = f"""\
objects:
  low: {{shape: {{box: {{center: [200, 330], size: [40, 40]}}}}, mass: 100, elasticity: 0}}
  top: {{shape: {{box: {{center: [200, {rest}], size: [40, 40]}}}}, mass: 100, elasticity: 0}}
joints:
  held: {{objects: [low, top], {joint}: [200, 315], breaks: 1.5e5}}
boundaries:
  floor: {{segment: [[0, 350], [400, 350]]}}
forces:
  - {{object: top, force: [0, -3.0e5], start: 0.2, duration: 0.15}}
"""
    motion = run(tmp_path, text)
    top = motion.poses[:, motion.names.index("top"), 1]
    assert top.min() < 250
    assert top[-1] == pytest.approx(290, abs=0.1)


@pytest.mark.parametrize(("side", "mass"), [(0, 90), (0, 300), (3, 90), (-10, 90)])
def test_the_end_of_a_pulley_stops_at_its_wheel(
    tmp_path: Path, side: int, mass: int
) -> None:
    text = f"""\
objects:
  light: {{shape: {{circle: {{center: [{200 + side}, 300], radius: 10}}}}, mass: 50}}
  heavy: {{shape: {{circle: {{center: [400, 200], radius: 10}}}}, mass: {mass}}}
joints:
  over: {{objects: [light, heavy], pulley: [[{200 + side}, 300], [200, 100], [400, 100], [400, 200]]}}
"""
    motion = run(tmp_path, text)
    away = motion.poses[:, motion.names.index("light"), :2] - (200, 100)
    assert np.hypot(*away.T).min() > 3.5
    assert imbalance(motion) < 0.01


@pytest.mark.parametrize("elasticity", [0, 0.5, 1])
@pytest.mark.parametrize(
    "held",
    [
        "{circle: {center: [200, 300], radius: 15}} | rope: [[200, 300], [200, 100]]",
        "{box: {center: [160, 309], size: [140, 12]}} | pivot: [100, 309], limits: [-40, 0]",
    ],
)
def test_ropes_and_limits_hold_in_impacts(
    tmp_path: Path, held: str, elasticity: float
) -> None:
    shape, joint = held.split(" | ")
    surface = f"elasticity: {elasticity}, friction: 0"
    text = f"""\
objects:
  ball: {{shape: {{circle: {{center: [200, 200], radius: 15}}}}, mass: 60, {surface}}}
  held: {{shape: {shape}, mass: 100, {surface}}}
joints:
  hold: {{objects: [held], {joint}}}
"""
    motion = run(tmp_path, text, 0.5)
    assert np.ptp(motion.poses[:, 1], axis=0).max() < 1e-2
    speed = motion.velocities[:, 0, 1]
    assert speed.min() == pytest.approx(-elasticity * speed.max(), abs=10)
    assert imbalance(motion) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    ("joint", "turn"),
    [
        ("pivot: [200, 100]", 0),
        ("rope: [[200, 300], [200, 100]]", 0),
        ("weld: [200, 100]", 40),
    ],
)
def test_work_of_scripted_partners_counts(
    tmp_path: Path, joint: str, turn: float
) -> None:
    text = f"""\
objects:
  cart:
    shape: {{box: {{center: [200, 100], size: [40, 20]}}}}
    motion: {{path: [[0, 200, 100, 0], [0.5, 200, 100, 0], [1, 320, 100, {turn}], [1.5, 320, 60, 0], [2, 250, 100, 0]]}}
  bob: {{shape: {{circle: {{center: [200, 300], radius: 15}}}}, mass: 100}}
joints:
  arm: {{objects: [bob, cart], {joint}}}
"""
    motion = run(tmp_path, text)
    assert motion.energy.work[-1] > 1e5
    assert imbalance(motion) < 2e-3
