"""Outlines that cross themselves, compared with every pair of lines in exact numbers."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from physgen.scene.shape_rules import Corner, outline_fault


def properly_cross(a: Corner, b: Corner, c: Corner, d: Corner) -> bool:
    """Both ends of each segment lie on different sides of the other, in exact numbers."""

    def side(p: Corner, q: Corner, r: Corner) -> Fraction:
        (px, py), (qx, qy), (rx, ry) = (map(Fraction, point) for point in (p, q, r))
        return (qx - px) * (ry - py) - (qy - py) * (rx - px)

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0


def every_pair(points: list[Corner]) -> tuple[int, int] | None:
    n = len(points)
    for i in range(n):
        for j in range(i + 2, n):
            if (i - j) % n != 1 and properly_cross(
                points[i], points[(i + 1) % n], points[j], points[(j + 1) % n]
            ):
                return (i, j)
    return None


COORDINATES = st.one_of(st.integers(0, 6), st.floats(0, 6, width=16))


@settings(max_examples=100)
@given(st.lists(st.tuples(COORDINATES, COORDINATES), min_size=3, max_size=12))
def test_the_first_pair_of_lines_that_cross_is_found(points: list[Corner]) -> None:
    (left, right), (top, bottom) = ((min(c), max(c)) for c in zip(*points, strict=True))
    if left < right and top < bottom:
        expected = every_pair(points)
        fault = outline_fault(points, True)
        found = "" if fault is None else fault.expected
        if expected is None:
            assert not found.startswith("crosses")
        else:
            assert (
                found
                == f"crosses itself: the lines from corners {expected[0]} and {expected[1]}"
            )


def circle(corners: int, radius: float = 100) -> list[Corner]:
    turns = [2 * math.pi * k / corners for k in range(corners)]
    return [(radius * math.cos(t), radius * math.sin(t)) for t in turns]


@pytest.mark.parametrize("corners", [3, 50, 3000])
def test_a_circle_is_fine_until_two_corners_change_places(corners: int) -> None:
    points = circle(corners)
    assert outline_fault(points, True) is None
    assert outline_fault(points[::-1], True) is None
    if corners > 3:
        points[1], points[2] = points[2], points[1]
        fault = outline_fault(points, True)
        assert fault is not None
        assert fault.code == "outline-crosses"


def test_outlines_may_touch_themselves() -> None:
    """As contours of masks do, where two parts hang together by a corner."""
    pinched = [(0, 0), (4, 0), (2, 2), (4, 4), (0, 4), (2, 2)]
    assert outline_fault(pinched, True) is None


@pytest.mark.parametrize(
    "points",
    [
        [(0, 0), (5, 0), (9, 0)],
        [(1, 1), (2, 2), (3, 3)],
        [(2, 2)] * 4,
        [(0, 0), (9, 9), (0, 0), (9, 9)],
    ],
)
def test_no_area(points: list[Corner]) -> None:
    fault = outline_fault(points, True)
    assert fault is not None
    assert fault.code == "outline-flat"
