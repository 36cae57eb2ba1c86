from __future__ import annotations

import numpy as np
import pytest
from drawings import L_SHAPE, box

from physgen.geometry.convex import overlap_depth
from physgen.geometry.polygon import Disc, Region, Ring, rotation


def disc(x, y, radius):
    return Disc(np.array([x, y], dtype=float), radius)


def region(points):
    return Region((Ring(points),))


@pytest.mark.parametrize("gap", [-0.7, 0.0, 0.3])
@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_known_depths(gap, angle):
    turn = rotation(angle).T
    depth = pytest.approx(max(-gap, 0.0), abs=0.002)
    direction = np.array([1.0, 0.0]) @ turn
    assert overlap_depth(disc(0, 0, 2), disc(*(5 + gap) * direction, 3)) == depth
    left = region(box(-4, -2, 0, 2) @ turn)
    assert overlap_depth(left, region(box(gap, -1, 3, 1) @ turn)) == depth
    assert overlap_depth(left, disc(*(1.5 + gap) * direction, 1.5)) == depth
    assert overlap_depth(disc(*(1.5 + gap) * direction, 1.5), left) == depth


def test_a_disc_in_the_notch_of_an_l_touches_nothing():
    assert overlap_depth(region(L_SHAPE), disc(2.0, 2.0, 1.0)) == pytest.approx(
        0, abs=0.001
    )
    assert overlap_depth(region(L_SHAPE), disc(2.0, 2.0, 1.2)) == pytest.approx(
        0.2, abs=0.002
    )


def test_a_disc_through_a_hole():
    frame = Region((Ring(box(0, 0, 9, 9), (box(3, 3, 6, 6),)),))
    assert overlap_depth(frame, disc(4.5, 4.5, 1.5)) == 0.0
    assert overlap_depth(frame, disc(4.5, 4.5, 1.75)) == pytest.approx(0.25, abs=0.002)
