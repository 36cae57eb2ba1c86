"""Shade of a floor along new contacts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physgen import pipeline
from physgen.arrays import U8
from physgen.render.stage import Stage
from physgen.simulate.trajectory import Trajectory


@pytest.fixture(scope="module")
def pyramid(bundled: Path) -> tuple[Stage, Trajectory]:
    """Return the stage of the pyramid, and its trajectory: a block falls on the table."""
    stages = pipeline.Stages()
    path = bundled / "pyramid" / "scene.yaml"
    scene = stages.load(path, [], None, False)
    maps = stages.maps(scene)
    compiled = stages.compile(scene, maps)
    trajectory = stages.simulate(compiled.world)
    ends = trajectory.times[[0, -1]]
    return stages.stage(scene, compiled, maps), trajectory.resample(ends)


def _frames(stage: Stage, trajectory: Trajectory) -> list[U8]:
    """Return the first and the last frame."""
    return [frame.rgb for frame in pipeline.render(stage, trajectory, 1)]


def test_a_block_that_lands_darkens_the_table(
    pyramid: tuple[Stage, Trajectory],
) -> None:
    stage, trajectory = pyramid
    with_shade = _frames(stage, trajectory)
    without = _frames(replace(stage, contact_depth=0.0), trajectory)
    assert np.array_equal(with_shade[0], without[0])
    change = without[1].astype(int).max(axis=2) - with_shade[1].max(axis=2)
    rows, columns = np.nonzero(change > 8)
    assert len(rows) > 50
    floor = 432
    below = rows > floor
    # It is below the block that fell to the right of the others, and narrow.
    assert columns[below].min() > 400
    assert rows.max() < floor + 12
