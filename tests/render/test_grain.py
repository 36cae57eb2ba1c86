"""Noise of photos: measured, removed and added; hold; a camera in a hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from physgen import pipeline
from physgen.pipeline.clip import RenderOptions
from physgen.pipeline.film import Film
from physgen.pipeline.stages import Maps, Stages
from physgen.render.camera import HAND, shot_of
from physgen.render.grain import GRAIN, GrainField, measure_grain, remove_noise
from physgen.report.record import RunRecord
from physgen.scene.scene import Noise
from physgen.videos import video_frames

SIDE = 320


def _plain() -> np.ndarray:
    """Return a picture with slow changes of brightness and one edge, float."""
    rows, columns = np.mgrid[:SIDE, :SIDE]
    picture = 70 + 100 * columns / SIDE + 10 * np.sin(rows / 40)
    picture[SIDE // 2 :, SIDE // 2 :] -= 40
    return np.repeat(picture[..., None], 3, axis=2)


def _noisy(deviation: float, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).standard_normal((SIDE, SIDE, 3))
    return np.clip(np.rint(_plain() + deviation * noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("deviation", [1.0, 2.0, 4.0])
def test_measured_noise_equals_added_noise(deviation: float) -> None:
    grain = measure_grain(_noisy(deviation))
    assert grain is not None
    assert grain.deviation[80:150] == pytest.approx(deviation, rel=0.12)
    assert np.abs(grain.channels - np.eye(3)).max() < 0.1
    assert grain.neighbours < 0.15


def test_rounding_is_not_noise() -> None:
    assert measure_grain(_noisy(0.0)) is None


def test_denoising_removes_noise_and_keeps_edges() -> None:
    picture = _noisy(2.0)
    grain = measure_grain(picture)
    assert grain is not None
    error = remove_noise(picture, grain) - _plain()
    assert error[8:-8, 8:-8].std() < 0.6 * 2.0
    beside = error[SIDE // 2 + 20 : -20, SIDE // 2 - 2 : SIDE // 2 + 2]
    assert np.abs(beside.mean(axis=0)).max() < 2


def test_fresh_noise_has_the_measured_statistics() -> None:
    grain = measure_grain(_noisy(3.0))
    assert grain is not None
    field = GrainField(grain)
    grey = np.full((SIDE, SIDE, 3), 120, np.uint8)
    first, second = field.add(grey, 1), field.add(grey, 2)
    assert (first == field.add(grey, 1)).all()
    assert first.std() == pytest.approx(grain.deviation[120].mean(), rel=0.05)
    pair = np.corrcoef(first[..., 1].ravel(), second[..., 1].ravel())[0, 1]
    assert abs(pair) < 0.05


def test_noise_covers_pictures_larger_than_the_field() -> None:
    grain = measure_grain(_noisy(3.0))
    assert grain is not None
    wide = np.full((40, GRAIN.tile + 90, 3), 120, np.uint8)
    assert GrainField(grain).add(wide, 0)[:, -80:].std() > 2


SCENE = """physgen: 1
image: photo.png
objects:
  block: {mask: {polygon: [[40, 40], [90, 40], [90, 90], [40, 90]]}, velocity: [200, 0]}
world: {gravity: [0, 0], duration: 0.2}
render: {grain: match, hold: 4}
"""


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    Image.fromarray(_noisy(3.0)[:160]).save(tmp_path / "photo.png")
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    return path


def _film(path: Path, *overrides: str) -> tuple[Film, Stages, Maps]:
    stages = Stages()
    scene = stages.load(path, list(overrides), None, False)
    maps = stages.maps(scene)
    compiled = stages.compile(scene, maps)
    record = RunRecord(scene="", command=[])
    return Film(scene, compiled, maps, record, stages), stages, maps


def test_delivery_holds_the_photo_with_living_noise(scene_file: Path) -> None:
    film, stages, maps = _film(scene_file)
    trajectory = stages.simulate(film.compiled.world)
    assert film.deliver() == {"hold": 4, "grain": "match"}
    frames = [f.rgb for f in film.deliver_frames(film.frames(trajectory), trajectory)]
    assert len(frames) == film.count(trajectory) == len(trajectory.times) + 4
    assert maps.percepts is not None
    assert (frames[0] == maps.percepts.rgb).all()
    still = np.stack([frame[100:] for frame in frames[1:5]]).astype(float)
    assert 2 < still.std(axis=0).mean() < 4  # four draws of a deviation of 3
    # The block moves only after the hold.
    block = np.stack([frame[40:90, 40:90].mean() for frame in frames[:6]])
    assert np.abs(np.diff(block[:5])).max() < 0.5


def test_frames_without_delivery_are_free_of_grain(scene_file: Path) -> None:
    film, stages, _ = _film(scene_file)
    trajectory = stages.simulate(film.compiled.world)
    frames = [f.rgb for f in film.deliver_frames(film.frames(trajectory), trajectory)]
    assert len(frames) == len(trajectory.times)
    assert (frames[1][110:] == frames[2][110:]).all()


def test_exported_clips_have_no_hold(scene_file: Path, tmp_path: Path) -> None:
    options = RenderOptions(export=("coco",))
    folder = pipeline.render_scene(scene_file, tmp_path / "out", options)
    frames = list(video_frames(folder / "video.mp4"))
    assert len(frames) == 6


def test_hand_drifts_within_the_photo(scene_file: Path) -> None:
    film, stages, _ = _film(
        scene_file, "render.camera={handheld: 0.4}", "world.duration=6"
    )
    assert film.scene.render.grain is Noise.MATCH
    trajectory = stages.simulate(film.compiled.world)
    shot = shot_of(film.scene, trajectory)
    assert shot.opens_on_photo
    width, height = shot.photo
    middle = np.array([(width - 1) / 2, (height - 1) / 2, 1])
    drift = []
    for time in trajectory.times[trajectory.times > HAND.rise].tolist():
        matrix = shot.affine(time)
        drift.append(matrix @ middle - middle[:2])
        corners = matrix @ np.array([[0, 0, 1], [width - 1, height - 1, 1]]).T
        assert (corners[:, 0] <= 0.01).all()
        assert (corners[:, 1] >= [width - 1.01, height - 1.01]).all()
    assert 0.25 < np.std(drift) < 0.6
    assert np.abs(drift).max() < 1.2
