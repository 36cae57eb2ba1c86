"""Objects with their own centre of mass and moment, solid boundaries, and paths that begin again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import written
from pytest import approx

from physgen.problems import InputError

SCENE = """\
physgen: 1
size: [400, 300]
world: {duration: 2}
objects:
  disc: {shape: {circle: {center: [100, 100], radius: 20}}, mass: 50, center_of_mass: [100, 108]}
  box: {shape: {box: {center: [200, 100], size: [40, 20]}}, mass: 10, center_of_mass: [206, 100], place: [300, 150, 90]}
  cart:
    shape: {box: {center: [50, 200], size: [20, 10]}}
    motion: {path: [[0, 50, 200], [0.4, 80, 200], [0.5, 50, 200, 90]], loop: true}
boundaries:
  hill: {shape: {circle: {center: [200, 300], radius: 60}}}
  step: {shape: {polygon: [[300, 250], [350, 250], [350, 300], [320, 260], [300, 300]]}}
"""


def test_moments_follow_the_parallel_axis_theorem(tmp_path: Path) -> None:
    box, cart, disc = written.world(tmp_path, SCENE).bodies
    assert disc.center == approx([100, 108])
    assert disc.moment == approx(50 * (20**2 / 2 + 8**2))
    assert disc.disc is not None
    assert disc.disc[0] == approx([0, -8])
    assert box.center == approx([300, 150])
    assert box.moment == approx(10 * ((40**2 + 20**2) / 12 + 6**2))
    # turned by 90 degrees, its middle is 6 px above the centre of mass
    assert np.mean(box.rings[0], axis=0) == approx([0, -6], abs=1e-9)
    assert cart.path[-1, 0] >= 2
    assert cart.path[np.searchsorted(cart.path[:, 0], 0.9 - 1e-9), 1:] == approx(
        [80, 200, np.pi / 2]
    )


def test_solid_boundaries_have_pieces(tmp_path: Path) -> None:
    hill, step = written.world(tmp_path, SCENE).walls
    assert hill.disc is not None
    assert hill.disc[1] == 60
    assert len(step.pieces) > 1
    assert (hill.chains[0][0] == hill.chains[0][-1]).all()


def test_a_loop_ends_where_it_began(tmp_path: Path) -> None:
    edit = "objects.cart.motion.path=[[0, 50, 200], [0.4, 80, 200]]"
    with pytest.raises(InputError, match="does not end where it began"):
        written.world(tmp_path, SCENE, edit)
