"""Soft objects are flat for two frames after an impact."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physgen import pipeline
from physgen.pipeline.film import Film
from physgen.pipeline.stages import Keep, Stages
from physgen.render.camera import exposure_times
from physgen.render.squash import SQUASH, find_squashes
from physgen.report.record import RunRecord
from physgen.simulate.engine import simulate

SCENE = """\
physgen: 1
size: [200, 240]
world: {{pixels_per_meter: 200, duration: 0.7}}
objects:
  ball:
    label: {label}
    shape: {{circle: {{center: [100, 60], radius: 30}}}}
    solid: sphere
    mass: {mass}
    elasticity: 0.8
boundaries: {{floor: {{segment: [[0, 190], [200, 190]], elasticity: 0.8}}}}
render: {{squash: {squash}}}
"""
DROP = 0.5
"""m between ball and floor."""


def _film(
    tmp_path: Path, label: str = "rubber ball", squash: bool = True, mass: int = 1000
) -> Film:
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE.format(label=label, squash=str(squash).lower(), mass=mass))
    stages = Stages(Keep.NOTHING)
    scene = pipeline.load(path)
    maps = stages.maps(scene)
    record = RunRecord(scene="", command=[])
    return Film(scene, stages.compile(scene, maps), maps, record, stages)


def _squashes(film: Film) -> dict[int, float]:
    labels = [item.label for item in film.scene.objects]
    motion = simulate(film.compiled.world)
    found = find_squashes(film.compiled.world, labels, motion)
    times = enumerate(motion.times.tolist())
    frames = {frame: found.find(time) for frame, time in times}
    return {frame: bodies[0].share for frame, bodies in frames.items() if bodies}


def test_squash_follows_hertz(tmp_path: Path) -> None:
    shares = _squashes(_film(tmp_path))
    landing = (2 * DROP / 9.81) ** 0.5
    first = int(np.ceil(landing * 30))
    assert list(shares) == [first, first + 1]
    # rubber: 0.004 GPa; the bounce gives back 80 % of 3.13 m/s
    speed, modulus = 0.9 * (2 * 9.81 * DROP) ** 0.5, 4e6 / (1 - 0.49**2)
    depth = (15 * 1.0 * speed**2 / (16 * modulus * 0.15**0.5)) ** 0.4
    assert shares[first] == pytest.approx(depth / 0.3, rel=0.05)
    assert shares[first + 1] == pytest.approx(shares[first] / 2, rel=0.01)


@pytest.mark.parametrize("label", ["steel ball", "wooden ball"])
def test_hard_objects_stay_round(tmp_path: Path, label: str) -> None:
    assert not _squashes(_film(tmp_path, label))


SPIKE = """\
physgen: 1
size: [400, 240]
world: {pixels_per_meter: 1400, duration: 0.5}
objects:
  toy:
    label: toy
    shape:
      polygons:
        - outline: [[50, 100], [150, 100], [150, 101], [170, 101], [150, 102],
                    [150, 190], [50, 190]]
    velocity: [1 m/s, 0]
    friction: 0
boundaries:
  floor: {segment: [[0, 190], [400, 190]]}
  stop: {segment: [[250, 0], [250, 240]], elasticity: 0.5}
render: {squash: true}
"""


def test_thin_parts_do_not_soften_objects(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(SPIKE)
    stages = Stages(Keep.NOTHING)
    scene = pipeline.load(path)
    world = stages.compile(scene, stages.maps(scene)).world
    assert world.bodies[0].size < 2
    motion = simulate(world)
    # The toy of hard plastic meets the stop and bounces.
    assert motion.velocities[:, 0, 0].min() < 0
    assert not any(map(find_squashes(world, ["toy"], motion).find, motion.times))


def _extents(film: Film, frame: int) -> tuple[int, int, int]:
    """Return width, height and lowest row of the ball."""
    trajectory = film.simulate_motion(lambda *_: None)
    frames = list(film.deliver_frames(film.frames(trajectory), trajectory))
    paper = frames[0].rgb[0, 0].astype(int)
    is_ball = np.abs(frames[frame].rgb[:189].astype(int) - paper).sum(axis=2) > 150
    rows, columns = np.nonzero(is_ball)
    return int(np.ptp(columns)) + 1, int(np.ptp(rows)) + 1, int(rows.max())


def test_flat_balls_are_lower_and_wider(tmp_path: Path) -> None:
    film, plain = _film(tmp_path), _film(tmp_path, squash=False)
    assert film.deliver() == {"squash": True}
    assert plain.deliver() == {}
    frame, share = next(iter(_squashes(film).items()))
    width, height, bottom = _extents(film, frame)
    round_width, round_height, round_bottom = _extents(plain, frame)
    assert round_height - height == pytest.approx(60 * share, abs=1.5)
    assert width - round_width == pytest.approx(30 * share, abs=1.5)
    # It is flattened towards the floor.
    assert abs(bottom - round_bottom) <= 1


def test_labelled_clips_do_not_show_squash(tmp_path: Path) -> None:
    film, plain = _film(tmp_path), _film(tmp_path, squash=False)
    frame = next(iter(_squashes(film)))
    assert _extents(film, frame) == _extents(plain, frame)


def test_squash_has_a_limit(tmp_path: Path) -> None:
    film = _film(tmp_path, "foam ball", mass=4000)
    assert max(_squashes(film).values()) == SQUASH.largest_share


def test_exposures_of_fast_objects_have_many_samples(tmp_path: Path) -> None:
    world = _film(tmp_path).compiled.world
    motion = simulate(world)
    for share in (0.1, 0.3, 0.5, 0.7, 1.0):
        speed = float(np.abs(motion.velocities[..., 1]).max())
        distance = speed * share / 30
        parts = exposure_times(motion, world, share)[1]
        assert parts >= 16 or distance / parts <= 3
