from __future__ import annotations

import numpy as np
import pytest
from drawings import L_SHAPE, box

from physgen.geometry.polygon import Disc, Region, Ring, mass_properties
from physgen.geometry.raster import coverage, coverage_box


def test_shares_of_pixels():
    covered = coverage(Region((Ring(box(0.0, 0.25, 1.0, 0.75)),)), (2, 2))
    assert covered == pytest.approx(np.array([[0.125, 0.125], [0.125, 0.125]]))


@pytest.mark.parametrize(
    "outline",
    [
        Disc(np.array([10.3, 7.2]), 5.1),
        Region((Ring(L_SHAPE + 2.3, (box(2.4, 2.5, 2.9, 3),)),)),
    ],
)
def test_sum_is_the_area_and_centre_the_centre(outline):
    box_, (x0, y0) = coverage_box(outline)
    m = mass_properties(outline)
    assert box_.sum(dtype=float) == pytest.approx(m.area, rel=1e-6)
    if isinstance(outline, Disc):
        weights = box_.astype(float)
        x = (weights.sum(axis=0) @ (np.arange(box_.shape[1]) + x0)) / weights.sum()
        y = (weights.sum(axis=1) @ (np.arange(box_.shape[0]) + y0)) / weights.sum()
        assert [x, y] == pytest.approx(m.center, abs=1e-3)


def test_canvas_cuts_what_lies_outside():
    disc = Disc(np.array([-0.5, 2.0]), 3.0)
    assert coverage(disc, (10, 12)).sum(dtype=float) == pytest.approx(
        np.pi * 9 / 2
        - 3**2 / 2 * (2 * np.arccos(2.5 / 3) - np.sin(2 * np.arccos(2.5 / 3))) / 2,
        rel=1e-4,
    )
    assert coverage(Disc(np.array([-50.0, 2.0]), 3.0), (10, 12)).sum() == 0


def test_neighbours_fill_the_pixel_between_them():
    left, right = Region((Ring(box(0, 0, 3.3, 4)),)), Region((Ring(box(3.3, 0, 6, 4)),))
    both = coverage(left, (8, 6)) + coverage(right, (8, 6))
    assert both[2, 1:6] == pytest.approx(np.ones(5))


@pytest.mark.parametrize("seed", range(5))
def test_a_window_shows_a_part_of_the_whole(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for outline in (
        Disc(rng.uniform(-10, 60, 2), float(rng.uniform(5, 60))),
        Region((Ring(rng.uniform(-40, 90, (3, 2))),)),
    ):
        whole, (x0, y0) = coverage_box(outline)
        part, (u0, v0) = coverage_box(outline, (0, 0, 50, 40))
        full = np.zeros((400, 400))
        full[
            y0 + 150 : y0 + 150 + whole.shape[0], x0 + 150 : x0 + 150 + whole.shape[1]
        ] = whole
        seen = np.zeros((40, 50))
        seen[v0 : v0 + part.shape[0], u0 : u0 + part.shape[1]] = part
        assert np.abs(seen - full[150:190, 150:200]).max() < 1e-5


def test_a_huge_outline_costs_what_is_seen_of_it() -> None:
    seen = coverage(Disc(np.array([20.0, 1e6 + 10]), 1e6), (40, 30))
    assert seen.shape == (30, 40)
    assert (seen[:9] == 0).all()
    assert (seen[12:] == 1).all()
