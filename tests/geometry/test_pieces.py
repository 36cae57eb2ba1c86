from __future__ import annotations

import cv2
import numpy as np
import pytest
from drawings import L_SHAPE, U_SHAPE, blob_labels, box, circle

from physgen.geometry.convex import SLIVER, convex_pieces
from physgen.geometry.polygon import (
    Region,
    Ring,
    cross,
    mass_properties,
    polygon_moments,
)
from physgen.geometry.regions import fit_regions


def check(region):
    pieces = convex_pieces(region)
    moments = [polygon_moments(piece) for piece in pieces]
    whole = mass_properties(region)
    assert sum(m.area for m in moments) == pytest.approx(whole.area, rel=1e-9)
    for piece in pieces:
        side = np.roll(piece, -1, axis=0) - piece
        assert (cross(side, np.roll(side, -1, axis=0)) >= -1e-8).all()
        assert polygon_moments(piece).area >= SLIVER
    return pieces


def within(ring, point):
    outer = cv2.pointPolygonTest(ring.outer.astype(np.float32), point, True)
    holes = [
        -cv2.pointPolygonTest(hole.astype(np.float32), point, True)
        for hole in ring.holes
    ]
    return min([outer, *holes])


def test_a_convex_ring_stays_whole():
    (piece,) = check(Region((Ring(circle(10.0, 40)),)))
    assert len(piece) == 40


def test_few_pieces():
    assert len(check(Region((Ring(L_SHAPE),)))) == 2
    assert len(check(Region((Ring(U_SHAPE),)))) == 3
    assert len(check(Region((Ring(box(0, 0, 9, 9), (box(3, 3, 6, 6),)),)))) <= 6


@pytest.mark.parametrize("seed", range(12))
def test_pieces_cover_just_the_inside(seed):
    region = fit_regions(blob_labels(seed, smooth=2.0))[1]
    pieces = check(region)
    rng = np.random.default_rng(seed)
    for point in rng.uniform(-2, 50, (150, 2)):
        x, y = (float(v) for v in point)
        depth = max(within(ring, (x, y)) for ring in region.rings)
        if abs(depth) > 1e-3:
            inside = [
                cv2.pointPolygonTest(p.astype(np.float32), (x, y), True) for p in pieces
            ]
            assert (max(inside) > -1e-3) == (depth > 0)
            assert sum(d > 1e-3 for d in inside) <= 1


def test_two_thousand_corners():
    angles = np.arange(2000) * 2 * np.pi / 2000
    radius = (
        200 + 30 * np.sin(7 * angles) + 0.3 * np.random.default_rng(0).normal(size=2000)
    )
    check(
        Region((Ring((radius * np.stack([np.cos(angles), np.sin(angles)])).T + 300),))
    )


def test_touching_itself_is_tolerated():
    # two squares that meet in a corner, in one ring
    ring = np.array(
        [[0, 0], [2, 0], [2, 2], [4, 2], [4, 4], [2, 4], [2, 2], [0, 2]], dtype=float
    )
    pieces = convex_pieces(Region((Ring(ring),)))
    assert sum(polygon_moments(p).area for p in pieces) == pytest.approx(8.0)
    # a hole that touches the border
    hole = np.array([[0, 2], [1, 1], [2, 2], [1, 3]], dtype=float)
    pieces = convex_pieces(Region((Ring(box(0, 0, 4, 4), (hole,)),)))
    assert sum(polygon_moments(p).area for p in pieces) == pytest.approx(14.0)


def test_slivers_and_straight_corners_go():
    ring = np.array(
        [[0, 0], [1, 0], [2, 0], [4, 0], [4, 4], [4, 4], [0, 4]], dtype=float
    )
    (piece,) = check(Region((Ring(ring),)))
    assert len(piece) == 4
    assert convex_pieces(Region((Ring(box(0, 0, 1, 1e-4)),))) == ()


@pytest.mark.parametrize("gap", [0.0, 1e-6, 0.3, 0.5])
def test_pieces_of_a_cut_slab_are_one_again(gap):
    left, right = box(0, 0, 50, 20), box(50 + gap, 0, 90, 20)
    (piece,) = convex_pieces(Region((Ring(left), Ring(right))))
    assert polygon_moments(piece).area == pytest.approx((90) * 20, rel=1e-9)


def test_pieces_that_are_apart_or_not_convex_together_stay_apart():
    a = box(0, 0, 50, 20)
    for b in (box(51, 0, 90, 20), box(50, 0, 90, 30), box(20, 20, 30, 60)):
        assert len(convex_pieces(Region((Ring(a), Ring(b))))) == 2
