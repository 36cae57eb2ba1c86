from __future__ import annotations

import numpy as np
import pytest
from drawings import blob_labels, dense

from physgen.geometry.polygon import polygon_moments
from physgen.geometry.regions import trace_borders, walk
from physgen.geometry.simplify import crossings, distances_to_line, simplify


def rings(traced, label, lines):
    return [
        walk(loop, lines, [b.is_loop for b in traced.borders])
        for loop in traced.loops.get(label, ())
    ]


@pytest.mark.parametrize("seed", range(30))
def test_area_is_the_count_of_pixels(seed):
    labels = blob_labels(seed, count=1 + seed % 4, smooth=0.6 + seed % 3)
    traced = trace_borders(labels)
    lines = [border.corners for border in traced.borders]
    for label in range(1, labels.max() + 1):
        found = rings(traced, label, lines)
        assert sum(polygon_moments(ring).area for ring in found) == pytest.approx(
            (labels == label).sum()
        )


def test_a_corner_parts_pixels_of_one_object():
    labels = np.eye(2, dtype=int)
    assert len(trace_borders(labels).loops[1]) == 2


def test_neighbours_share_one_border():
    labels = np.repeat([[1, 2]], 3, axis=0)
    between = [b for b in trace_borders(labels).borders if {b.left, b.right} == {1, 2}]
    assert len(between) == 1
    assert set(between[0].corners[:, 0]) == {0.5}


def test_outer_turns_x_towards_y_and_holes_the_other_way():
    labels = np.ones((5, 5), dtype=int)
    labels[2, 2] = 0
    traced = trace_borders(labels)
    areas = sorted(
        polygon_moments(r).area
        for r in rings(traced, 1, [b.corners for b in traced.borders])
    )
    assert areas == [-1.0, 25.0]


def test_empty_map():
    assert trace_borders(np.zeros((4, 4), dtype=int)).borders == ()


@pytest.mark.parametrize("seed", range(20))
def test_simplified_by_at_most_half_a_pixel(seed):
    traced = trace_borders(blob_labels(seed, smooth=0.8 + (seed % 5) * 0.8))
    for border in traced.borders:
        middles = border.middles
        found = simplify(middles, 0.5, is_loop=True)
        assert (
            distances_to_line(dense(middles, 0.25), found, is_loop=True).max()
            <= 0.5 + 1e-6
        )
        assert (
            distances_to_line(dense(found, 0.25), middles, is_loop=True).max()
            <= 0.5 + 1e-6
        )
        assert (
            abs(polygon_moments(found).area / polygon_moments(middles).area - 1) <= 0.03
        )
        assert len(crossings([found])) == 0


@pytest.mark.parametrize("seed", range(5))
def test_open_lines_keep_their_ends(seed):
    traced = trace_borders(blob_labels(seed, count=3))
    for border in traced.borders:
        if not border.is_loop:
            found = simplify(border.middles, 0.5, is_loop=False)
            assert found[[0, -1]].tolist() == border.middles[[0, -1]].tolist()


def test_crossings_sees_a_bow_tie():
    bow = np.array([[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0]])
    assert crossings([bow]).tolist() == [[0, 0]]
    assert len(crossings([bow[[0, 2, 1, 3]]])) == 0
