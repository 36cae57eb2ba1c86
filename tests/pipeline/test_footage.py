"""Unrefined frames in memory: lossless."""

from __future__ import annotations

import numpy as np
import pytest

from physgen import pipeline
from physgen.pipeline.footage import Add, Footage, footage
from physgen.simulate.trajectory import Trajectory

SCENE = """\
physgen: 1
size: [40, 30]
world: {duration: 0.25}
objects:
  ball: {shape: {circle: {center: [12, 12], radius: 5}}, mass: 100}
"""
Pictures = list[tuple[np.ndarray, np.ndarray, np.ndarray]]


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Trajectory:
    path = tmp_path_factory.mktemp("scene") / "ball.yaml"
    path.write_text(SCENE)
    return pipeline.simulate(pipeline.compile(pipeline.load(path), None).world)


def pictures(kind: str, count: int = 7, size: tuple[int, int] = (30, 41)) -> Pictures:
    """A noisy photo in which a block moves; one that moves as a whole; noise."""
    rng = np.random.default_rng(5)
    wide = rng.integers(0, 256, (size[0], size[1] + count, 3), dtype=np.uint8)
    made = []
    for k in range(count):
        rgb = wide[:, : size[1]].copy()
        if kind == "camera":
            rgb = wide[:, k : k + size[1]].copy()
        elif kind == "noise":
            rgb = rng.integers(0, 256, (*size, 3), dtype=np.uint8)
        coverage, ids = np.zeros(size, np.float32), np.zeros(size, np.uint16)
        rgb[5:9, k : k + 6] = rng.integers(0, 256, (4, 6, 3))
        coverage[5:9, k : k + 6] = rng.integers(0, 256, (4, 6)) / np.float32(255)
        ids[5:9, k : k + 6] = 300 + k
        made.append((rgb, coverage, ids))
    return made


class Film:
    def __init__(self, frames: Pictures, motion: Trajectory) -> None:
        self.frames, self.motion = frames, motion

    def __call__(self, add: Add) -> Trajectory:
        for frame in self.frames:
            add(*frame)
        return self.motion

    def agrees(self, found: Footage) -> bool:
        same = len(found.rgb) == len(found.coverage) == len(found.ids) == len(self.frames)
        for k, (rgb, coverage, ids) in enumerate(self.frames):
            same &= np.array_equal(found.rgb[k], rgb) and np.array_equal(found.ids[k], ids)
            same &= np.array_equal(found.coverage[k], coverage)
        return same and found.trajectory.sample_hashes() == self.motion.sample_hashes()


@pytest.mark.parametrize("kind", ["photo", "camera", "noise"])
def test_nothing_is_lost(kind: str, motion: Trajectory) -> None:
    film = Film(pictures(kind), motion)
    found = footage(film)
    assert film.agrees(found)
    assert (found.rgb[0].dtype, found.coverage[0].dtype, found.ids[0].dtype) == ("u1", "f4", "u2")
    found.rgb[0][:] = 0  # the reader's own copy
    assert film.agrees(found)
    with pytest.raises(IndexError):
        found.rgb[len(film.frames)]
