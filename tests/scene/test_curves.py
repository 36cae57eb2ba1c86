"""Arcs and Bézier curves of boundaries as chords."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
import written
from pytest import approx

from physgen.problems import InputError
from physgen.scene.construction import SAG, arc_points, bezier_points

SCENE = """\
physgen: 1
size: [400, 300]
objects:
  puck: {shape: {circle: {center: [200, 250], radius: 10}}}
boundaries:
  curve: {LINE}
"""


def test_arc_chords_lie_within_the_sag() -> None:
    points = np.array(
        arc_points({"center": [50, 60], "radius": 80, "from": 10, "to": 200})
    )
    middles = (points[1:] + points[:-1]) / 2
    assert np.hypot(*(points - (50, 60)).T) == approx(80)
    assert np.hypot(*(middles - (50, 60)).T).min() > 80 - SAG * 1.001
    ends = np.degrees(np.arctan2(points[[0, -1], 1] - 60, points[[0, -1], 0] - 50))
    assert ends == approx([10, -160])


def test_bezier_chords_lie_within_the_sag() -> None:
    corners = np.array(
        [[0, 0], [100, 0], [120, 80], [200, 90], [240, 95], [250, 10], [300, 20]]
    )
    line = shapely.LineString(bezier_points(corners.tolist()))
    t = np.linspace(0, 1, 500)[:, None]
    for a, b, c, d in (corners[:4], corners[3:]):
        # de Casteljau's construction
        ab, bc, cd = a + t * (b - a), b + t * (c - b), c + t * (d - c)
        abc, bcd = ab + t * (bc - ab), bc + t * (cd - bc)
        exact = shapely.points(abc + t * (bcd - abc))
        assert shapely.distance(line, exact).max() < SAG * 1.001


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("bezier: [[0, 0], [1, 0], [2, 0], [3, 0], [4, 0]]", "has 5 points"),
        ("arc: {center: [9, 9], radius: 5, from: 30, to: 30}", "has no length"),
        ("arc: {center: [9, 9], radius: 5, to: 400}", "goes round more than once"),
        (
            "arc: {center: [9, 9], radius: 5}, segment: [[0, 0], [1, 1]]",
            "write only one",
        ),
    ],
)
def test_mistakes_in_curves_are_named(tmp_path: Path, line: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        written.world(tmp_path, SCENE.replace("LINE", line))
