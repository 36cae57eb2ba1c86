"""Outlines that cross themselves, by two fast ways and by comparing every pair."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from physgen.scene import outlines
from physgen.scene.outlines import Corner, outline_problem


def every_pair(points: list[Corner]) -> tuple[int, int] | None:
    n = len(points)
    for i in range(n):
        for j in range(i + 2, n):
            if (i - j) % n == 1:
                continue
            if outlines._cross(points[i], points[(i + 1) % n], points[j], points[(j + 1) % n]):
                return (i, j)
    return None


COORDINATES = st.one_of(st.integers(0, 6), st.floats(0, 6, width=16))


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(COORDINATES, COORDINATES), min_size=3, max_size=12))
def test_both_ways_find_the_first_pair(points: list[Corner]) -> None:
    expected = every_pair(points)
    assert outlines._sweep(points) == expected
    if max(x for x, _ in points) > min(x for x, _ in points) or max(y for _, y in points) > min(
        y for _, y in points
    ):
        assert outlines._tree_search(points) == expected


def circle(corners: int, radius: float = 100) -> list[Corner]:
    turns = [2 * math.pi * k / corners for k in range(corners)]
    return [(radius * math.cos(t), radius * math.sin(t)) for t in turns]


@pytest.mark.parametrize("corners", [3, 80, 399, 401, 3000])
def test_a_circle_is_fine_until_two_corners_change_places(corners: int) -> None:
    points = circle(corners)
    assert outline_problem(points, True) is None
    assert outline_problem(points[::-1], True) is None
    if corners > 3:
        points[1], points[2] = points[2], points[1]
        problem = outline_problem(points, True)
        assert problem is not None
        assert problem[0].startswith("crosses itself: the lines from corners ")


def test_outlines_may_touch_themselves() -> None:
    """As contours of masks do, where two parts hang together by a corner."""
    pinched = [(0, 0), (4, 0), (2, 2), (4, 4), (0, 4), (2, 2)]
    assert outline_problem(pinched, True) is None


@pytest.mark.parametrize(
    "points",
    [[(0, 0), (5, 0), (9, 0)], [(1, 1), (2, 2), (3, 3)], [(2, 2)] * 4, [(0, 0), (9, 9), (0, 0), (9, 9)]],
)
def test_no_area(points: list[Corner]) -> None:
    assert outline_problem(points, True) == (
        "has no area",
        "write at least three corners that are not on one line",
    )
