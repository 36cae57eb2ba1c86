"""Water, still air, magnets, profiles and fingers: against other ways to compute, and mistakes in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
import written
import yaml

from physgen.problems import InputError
from physgen.scene.scaling import scale_scene
from physgen.simulate.engine import simulate
from physgen.simulate.forces import Pool, mean_factor

SCENE = """\
physgen: 1
size: [400, 300]
world: {view: side, duration: 0.6, gravity: [0, 980]}
objects:
  wedge: {shape: {polygon: [[80, 80], [160, 95], [120, 150], [100, 110]]}, mass: 900}
  ball: {shape: {circle: {center: [250, 95], radius: 30}}, mass: 1000}
  north: {shape: {circle: {center: [330, 40], radius: 8}}, gravity_scale: 0}
  south: {shape: {circle: {center: [380, 60], radius: 8}}, gravity_scale: 0}
joints:
  finger: {objects: [wedge], finger: [[0, 85, 85], [0.3, 120, 60]], stiffness: 3.0e+4, damping: 500}
fields:
  pool: {water: [100, 100, 180, 150], density: 1, linear: 0.5, drag: 0.001}
  breath: {air: still, drag: 0.001, linear: 0.1, objects: [ball]}
  pull: {magnet: [north, south], pull: 1.0e+9, soften: 2}
forces:
  - {object: ball, force: [4.0e+5, 0], start: 0.1, duration: 0.4, profile: {PROFILE}}
"""
PROFILES = (
    "ramp: 0.3",
    "sine: 7",
    "pulse: [0.03, 0.05]",
    "table: [[0, 1], [0.1, -1], [0.3, 2]]",
)


@pytest.mark.parametrize("profile", PROFILES)
def test_energy_is_balanced_and_factors_are_means(tmp_path: Path, profile: str) -> None:
    text = SCENE.replace("PROFILE", profile)
    world = written.world(tmp_path, text)
    energy = simulate(world, np.linspace(0, 0.6, 30)).energy
    total = energy.kinetic + energy.potential + energy.dissipated - energy.work
    assert np.ptp(total) < 5e-3 * energy.kinetic.max()
    (push,) = world.pushes
    parts = [mean_factor(push, t, t + 1e-3) for t in np.arange(0.1, 0.5, 1e-3)]
    assert np.mean(parts) * 0.4 == pytest.approx(mean_factor(push, 0, 1), abs=1e-9)


def test_displaced_areas_are_those_of_shapely(tmp_path: Path) -> None:
    world = written.world(tmp_path, SCENE.replace("PROFILE", "ramp: 1"))
    pool = Pool(next(f for f in world.fields if f.name == "pool"), world.bodies)
    water = shapely.box(100, 100, 280, 250)
    pose = np.array([[*body.center, 0.0] for body in world.bodies])
    for body, area, middle in pool.immersions(pose):
        rings = world.bodies[body].rings[0] + world.bodies[body].center
        wet = shapely.Polygon(rings).intersection(water)
        assert area == pytest.approx(wet.area, rel=5e-3)
        assert middle == pytest.approx([wet.centroid.x, wet.centroid.y], abs=0.1)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        ("fields.pull.magnet=[north, north]", "names an object twice"),
        ("fields.pull.magnet=[north, sout]", 'did you mean "south"'),
        ("fields.pool.density=null", "water needs it"),
        ("joints.finger.objects=[wedge, ball]", "are two, but a finger pulls one"),
        ("joints.finger.finger=[[0, 1, 2], [0, 3, 4]]", "is not after 0"),
        ("fields.breath.density=1", "it, and this is a"),
    ],
)
def test_mistakes_in_media_are_named(tmp_path: Path, edit: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        written.world(tmp_path, SCENE.replace("PROFILE", "ramp: 1"), edit)


@pytest.mark.slow
def test_a_scene_at_twice_the_size_moves_alike(tmp_path: Path) -> None:
    """Units of the schema decide how each number grows."""
    plain = yaml.safe_load(SCENE.replace("{PROFILE}", "{ramp: 0.3}"))
    for item in plain["objects"].values():
        item.setdefault("mass", 100)
    plain["joints"]["cord"] = {
        "objects": ["north"],
        "rope": [[330, 40], [300, 10]],
        "length": 60,
    }
    runs = []
    for data in (plain, scale_scene(plain, 2.0)):
        data["size"] = [800, 600]
        world = written.world(tmp_path, yaml.safe_dump(data))
        runs.append(simulate(world, np.linspace(0, 0.6, 7)).poses)
    grown = 2 * (runs[0][:, :, :2] + 0.5) - 0.5
    np.testing.assert_allclose(runs[1][:, :, :2], grown, atol=0.02)
