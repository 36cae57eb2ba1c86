"""Pictures of wheels turn on the picture of their vehicle."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physgen.compile.compile import compile_scene
from physgen.pipeline.stages import stage
from physgen.render.frames import render_frames
from physgen.render.wheel_sprites import wheel_from_photo
from physgen.scene.load import load
from physgen.simulate.engine import simulate

SIDE, AXLE, RADIUS = 120, (60.0, 62.0), 40.0
BODY = np.array([0.6, 0.2, 0.05])


def car_part(turn: float, shade: bool = True) -> np.ndarray:
    """A wheel with five spokes under a body that covers its top, linear light."""
    rows, columns = np.mgrid[:SIDE, :SIDE]
    x, y = columns - AXLE[0], rows - AXLE[1]
    away, angle = np.hypot(x, y), np.arctan2(y, x) - turn
    spokes = 0.5 + 0.5 * np.cos(5 * angle)
    rim = np.clip((28 - away) / 2, 0, 1)
    bright = 0.03 + 0.4 * rim * spokes
    light = np.repeat(bright[..., None], 3, axis=2)
    light[away > RADIUS] = BODY
    light[rows < AXLE[1] - 30] = BODY
    return light.astype(np.float32)


@pytest.fixture
def wheel():
    """The wheel as it is cut out of the picture."""
    whole = np.ones((SIDE, SIDE), np.float32)
    return wheel_from_photo(car_part(0.0), whole, 0, AXLE, RADIUS)


def test_an_unturned_wheel_is_as_the_photo_shows_it(wheel):
    light = car_part(0.0)
    wheel.draw(light, np.ones((SIDE, SIDE), np.float32), np.eye(2, 3), 0.0)
    rows, columns = np.mgrid[:SIDE, :SIDE]
    away = np.hypot(columns - AXLE[0], rows - AXLE[1])
    hub = (away > 3) & (away < 24)  # the spokes meet in a point
    assert np.abs(light - car_part(0.0))[hub].max() < 0.1
    assert np.abs(light - car_part(0.0)).mean() < 0.003


@pytest.mark.parametrize("turn", [0.4, 1.0, -2.2])
def test_a_turned_wheel_shows_turned_spokes(wheel, turn: float):
    light = car_part(0.0)
    wheel.draw(light, np.ones((SIDE, SIDE), np.float32), np.eye(2, 3), turn)
    rows, columns = np.mgrid[:SIDE, :SIDE]
    away = np.hypot(columns - AXLE[0], rows - AXLE[1])
    hub = (away > 3) & (away < 24)  # the spokes meet in a point
    assert np.abs(light - car_part(turn))[hub].mean() < 0.03
    assert np.abs(light - car_part(0.0))[hub].mean() > 0.08


def test_the_body_over_a_wheel_stays(wheel):
    """No paint of the body turns with the wheel, and the arch does not move."""
    light = car_part(0.0)
    wheel.draw(light, np.ones((SIDE, SIDE), np.float32), np.eye(2, 3), np.pi)
    rows, columns = np.mgrid[:SIDE, :SIDE]
    away = np.hypot(columns - AXLE[0], rows - AXLE[1])
    arch = (rows < AXLE[1] - 32) & (away < RADIUS - 2)
    below = (rows > AXLE[1] + 30) & (away < RADIUS - 2)
    assert np.abs(light[arch] - BODY).max() < 0.1
    assert light[below][:, 0].max() < 0.2


@pytest.mark.parametrize("turns", [True, False])
def test_a_drawn_car_turns_its_wheels(tmp_path: Path, turns: bool):
    """Wheels with `turns: false` carry the car, and look as at rest."""
    text = """\
physgen: 1
size: [400, 200]
world: {pixels_per_meter: 1000, duration: 0.2}
objects:
  car:
    shape: {polygon: [[60, 60], [200, 60], [200, 160], [60, 160]]}
    rolling: 0.02
    velocity: [300, 0]
    wheels: [{center: [90, 160], radius: 20}, {center: [170, 160], radius: 20}]
boundaries:
  floor: {segment: [[-100, 180], [900, 180]]}
render: {fps: 10, motion_blur: 0}
"""
    file = tmp_path / "scene.yaml"
    if not turns:
        text = text.replace("radius: 20}", "radius: 20, turns: false}")
    file.write_text(text)
    scene = load(file)
    compiled = compile_scene(scene, None)
    motion = simulate(compiled.world)
    first, second = render_frames(stage(scene, compiled, None), motion)
    assert motion.wheel_turns[-1, 0] == pytest.approx(1.5, abs=0.1)
    shift = round(motion.poses[-1, 0, 0] - motion.poses[0, 0, 0])
    before = first.rgb[145:159, 80:100].astype(int)
    after = second.rgb[145:159, 80 + shift : 100 + shift].astype(int)
    assert bool(np.abs(before - after).max() > 40) is turns
    assert set(np.unique(second.ids)) == {0, 1}
