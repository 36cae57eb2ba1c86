"""Blocks that rock on their corners in whole scenes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import written

from physgen.simulate.engine import simulate
from physgen.simulate.trajectory import Trajectory

SCENE = """\
physgen: 1
size: [400, 300]
world: {{view: side, duration: 3}}
objects:
  block:
    shape: {{box: {{center: [200, 205], size: [30, 80], angle: {tilt}}}}}
    mass: 100
    friction: 1
    elasticity: 0
    {rocking}
boundaries:
  floor: {{segment: [[0, 250], [400, 250]], friction: 1}}
"""


def run(tmp_path: Path, rocking: str, tilt: float = 12) -> Trajectory:
    text = SCENE.format(rocking=rocking, tilt=tilt)
    return simulate(written.world(tmp_path, text), np.linspace(0, 3, 181))


def swings(motion: Trajectory) -> np.ndarray:
    """Return the largest tilt of each swing, rad."""
    tilt = motion.poses[:, 0, 2] - motion.poses[-1, 0, 2]
    ends = np.flatnonzero(np.diff(np.sign(tilt))) + 1
    return np.array([np.abs(part).max() for part in np.split(tilt, ends)[:-1]])


def test_rocking_settles_a_block_in_a_damped_wobble(tmp_path: Path) -> None:
    found = swings(run(tmp_path, "rocking: 0.05"))
    wide = found[found > 0.002]
    assert len(wide) >= 5
    assert (np.diff(wide) < 0).all()
    last = run(tmp_path, "rocking: 0.05").velocities[-1, 0]
    assert np.abs(last).max() < 1e-3


def test_rocking_brakes_either_side_alike(tmp_path: Path) -> None:
    left, right = (run(tmp_path, "rocking: 0.05", tilt) for tilt in (-12, 12))
    assert left.poses[:, 0, 2] == pytest.approx(-right.poses[:, 0, 2], abs=1e-7)


def test_a_block_without_rocking_swings_longer(tmp_path: Path) -> None:
    late = slice(110, 130)
    free, braked = (
        np.abs(run(tmp_path, text).velocities[late, 0, 2]).max()
        for text in ("", "rocking: 0.2")
    )
    assert free > 0.1 > 1e-3 > braked
