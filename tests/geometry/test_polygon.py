from __future__ import annotations

import numpy as np
import pytest

from physgen.geometry.polygon import cross, polygon_moments, rotation

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])


def test_positive_angle_turns_x_towards_y():
    assert rotation(0.3) @ [1.0, 0.0] == pytest.approx([np.cos(0.3), np.sin(0.3)])
    assert cross(np.array([1.0, 0.0]), rotation(0.3) @ [1.0, 0.0]) > 0


def test_moments_sign_follows_the_turn():
    forth, back = polygon_moments(SQUARE), polygon_moments(SQUARE[::-1])
    assert (forth.area, back.area) == (4.0, -4.0)
    assert forth.second == pytest.approx(2.0**4 / 6)
    assert back.second == pytest.approx(-forth.second)


def test_moments_of_a_flat_polygon_are_zero():
    assert polygon_moments(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])).area == 0.0
