"""Vehicles on wheels, beside closed forms of a body that rolls to a stop."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from physgen.compile.compile import compile_scene
from physgen.scene.construction import EARTH
from physgen.scene.load import load
from physgen.simulate.engine import simulate
from physgen.simulate.trajectory import read_trajectory
from physgen.simulate.wheels import WHEEL_MASS, world_on_wheels

CAR = """\
physgen: 1
size: [800, 300]
world: {{pixels_per_meter: 1000, duration: {duration}}}
objects:
  car:
    label: toy car
    shape: {{polygon: [[100, 200], [140, 150], [220, 150], [260, 200], [260, 240],
      [100, 240]]}}
    mass: 200
    friction: 0.8
    rolling: {rolling}
    velocity: [{speed}, 0]
    wheels: [{{center: [130, 240], radius: 20}}, {{center: [230, 240], radius: 20}}]
    facing: right
boundaries:
  floor: {{segment: [[-2000, 260], [3000, 260]], friction: 0.8}}
"""


def drive(folder: Path, rolling=0.02, speed=400.0, duration=1.0):
    """Return the world of a car and its motion, 41 samples."""
    file = folder / "scene.yaml"
    file.write_text(CAR.format(rolling=rolling, speed=speed, duration=duration))
    world = compile_scene(load(file), None).world
    return world, simulate(world, np.linspace(0, duration, 41))


@pytest.mark.parametrize("rolling", [0.01, 0.02, 0.05])
def test_rolling_resistance_decelerates_a_vehicle(tmp_path: Path, rolling: float):
    """By c g, but for the inertia of two discs of 2 % of the mass: 1 / 1.02."""
    world, motion = drive(tmp_path, rolling, duration=0.5)
    speed = motion.velocities[:, 0, 0]
    slope = -np.polyfit(motion.times, speed, 1)[0]
    expected = rolling * EARTH * world.pixels_per_meter
    assert slope == pytest.approx(expected / (1 + WHEEL_MASS), rel=0.01)
    assert slope == pytest.approx(expected, rel=0.03)


def test_wheels_turn_without_slip(tmp_path: Path):
    """Their angle is the distance over the radius."""
    _, motion = drive(tmp_path)
    distance = motion.poses[:, 0, 0] - motion.poses[0, 0, 0]
    assert motion.wheel_turns.shape == (41, 2)
    for wheel in motion.wheel_turns.T:
        assert wheel == pytest.approx(distance / 20, abs=1e-3)


def test_a_vehicle_stops_and_stays(tmp_path: Path):
    """It stops after v^2 / (2 c g), where its wheels hold it."""
    world, motion = drive(tmp_path, rolling=0.05, speed=300.0, duration=1.2)
    pull = 0.05 * EARTH * world.pixels_per_meter / (1 + WHEEL_MASS)
    way = motion.poses[-1, 0, 0] - motion.poses[0, 0, 0]
    assert way == pytest.approx(300.0**2 / (2 * pull), rel=0.02)
    assert np.abs(motion.velocities[-4:, 0]).max() < 0.5


def test_a_vehicle_on_wheels_is_one_object(tmp_path: Path):
    """Names, poses, touches and impulses are the vehicle's; energy is kept."""
    _, motion = drive(tmp_path)
    assert motion.names == ("car",)
    assert motion.poses.shape == (41, 1, 3)
    assert motion.contacts.surfaces == ("car", "floor")
    assert motion.contacts.touch_pairs.tolist() == [[0, 1]]
    rows = motion.contacts.impulse_rows
    assert len(np.unique(rows, axis=0)) == len(rows)
    assert motion.imbalance() < 0.01


def test_wheels_are_a_part_of_the_vehicles_mass(tmp_path: Path):
    """The weight on the floor is that of the vehicle."""
    world, motion = drive(tmp_path)
    assert world.bodies[0].mass == 200
    expanded = world_on_wheels(world)
    assert sum(body.mass for body in expanded.bodies) == pytest.approx(200)
    step = motion.times[1] - motion.times[0]
    weight = 200 * EARTH * world.pixels_per_meter * step
    assert np.abs(motion.contacts.impulses[5:, 1]) == pytest.approx(weight, rel=0.02)


def test_a_trajectory_file_holds_wheel_turns(tmp_path: Path):
    """Files without wheels have no such array."""
    _, motion = drive(tmp_path)
    motion.save(tmp_path / "trajectory.npz")
    stored = read_trajectory(io.BytesIO((tmp_path / "trajectory.npz").read_bytes()))
    assert np.array_equal(stored.wheel_turns, motion.wheel_turns)


def test_the_body_of_a_vehicle_hangs_above_the_road(tmp_path: Path):
    """A mask that reaches down to the road, shadow and all, does not scrape."""
    file = tmp_path / "scene.yaml"
    text = CAR.format(rolling=0.02, speed=400.0, duration=0.5)
    file.write_text(
        text.replace("[260, 240],", "[260, 259],").replace("[100, 240]", "[100, 259]")
    )
    world = compile_scene(load(file), None).world
    lowest = max(float(piece[:, 1].max()) for piece in world.bodies[0].pieces)
    assert lowest + world.bodies[0].center[1] < 260 - 0.3 * 20
    motion = simulate(world, np.linspace(0, 0.5, 11))
    assert motion.velocities[-1, 0, 0] == pytest.approx(400 - 96, abs=5)
