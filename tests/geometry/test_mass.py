"""Closed forms of any mechanics text."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from drawings import L_SHAPE, box, circle
from hypothesis import given
from hypothesis import strategies as st

from physgen.geometry.polygon import Region, Ring, mass_properties, rotation


def region(outer, *holes):
    return Region((Ring(outer, tuple(holes)),))


def test_rectangle():
    m = mass_properties(region(box(1, 2, 4, 7)))
    assert (m.area, m.second) == pytest.approx((15.0, 15.0 * (9 + 25) / 12))
    assert m.center == pytest.approx([2.5, 4.5])


def test_annulus():
    m = mass_properties(region(circle(5.0), circle(3.0)))
    assert m.area == pytest.approx(pi * (25 - 9), rel=1e-6)
    assert m.second == pytest.approx(pi * (5**4 - 3**4) / 2, rel=1e-6)


def test_l_is_two_boxes():
    m = mass_properties(region(L_SHAPE))
    assert m.area == pytest.approx(8.0)
    assert m.center == pytest.approx([(4 * 2 + 4 * 0.5) / 8, (4 * 0.5 + 4 * 3) / 8])
    parts = mass_properties(Region((Ring(box(0, 0, 4, 1)), Ring(box(0, 1, 1, 5)))))
    assert (parts.area, parts.second) == pytest.approx((m.area, m.second))
    assert parts.center == pytest.approx(m.center)


def test_hole_turns_either_way():
    one = mass_properties(region(box(0, 0, 6, 6), box(1, 1, 3, 3)))
    other = mass_properties(region(box(0, 0, 6, 6)[::-1], box(1, 1, 3, 3)[::-1]))
    assert (one.area, one.second) == pytest.approx((other.area, other.second))
    assert one.area == pytest.approx(32.0)


def test_parallel_axis_for_two_pieces():
    m = mass_properties(Region((Ring(box(-11, -1, -9, 1)), Ring(box(9, -1, 11, 1)))))
    assert m.center == pytest.approx([0.0, 0.0])
    assert m.second == pytest.approx(2 * (4 * 8 / 12 + 4 * 10**2))


def test_no_area_is_an_error():
    with pytest.raises(ValueError, match="no area"):
        mass_properties(region(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])))


@given(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(-7, 7), st.booleans())
def test_moving_turning_and_mirroring_change_the_centre_only(x, y, angle, mirrored):
    flip = np.diag([-1.0 if mirrored else 1.0, 1.0])

    def move(points):
        return points @ flip @ rotation(angle).T + (x, y)

    hole = box(0.2, 0.2, 0.6, 0.9)
    still, moved = (
        mass_properties(region(L_SHAPE, hole)),
        mass_properties(region(move(L_SHAPE), move(hole))),
    )
    assert (moved.area, moved.second) == pytest.approx(
        (still.area, still.second), rel=1e-7
    )
    assert moved.center == pytest.approx(move(still.center), abs=1e-7)
