"""Borders that are hidden almost everywhere along their length go on behind things."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from physgen import registry
from physgen.perceive.inpaint.edge_continuation import continue_edges

SIZE = 160
EDGE = 90
"""y of the table's edge."""


def table(noise: float = 2.0) -> NDArray[np.uint8]:
    y, _ = np.mgrid[:SIZE, :SIZE]
    colours = np.where((y < EDGE)[..., None], [90, 110, 90], [200, 190, 170])
    grain = np.random.default_rng(0).normal(0, noise, (SIZE, SIZE, 1))
    return np.clip(colours + grain, 0, 255).astype(np.uint8)


def off(
    truth: NDArray[np.uint8], hole: NDArray[np.bool_], object_: tuple[int, int, int]
) -> float:
    """Levels, on average, between the truth and the fill behind an object of one colour."""
    filled = registry.make("inpaint")(
        np.where(hole[..., None], np.array(object_, np.uint8), truth), hole
    )
    return float(abs(filled[hole].astype(float) - truth[hole]).mean())


@pytest.mark.parametrize("slope", [-0.2, 0.2])
def test_an_edge_goes_on_behind_a_plank_that_lies_nearly_along_it(slope: float) -> None:
    """The edge leaves the hole so flat that it is hardly seen beside it."""
    truth = table()
    y, x = np.mgrid[:SIZE, :SIZE]
    hole = (abs(y - EDGE - slope * (x - 34)) < 12) & (x > 22) & (x < 135)
    assert off(truth, hole, (120, 60, 30)) < 4


def test_an_edge_seen_at_the_photos_borders_alone_goes_on_between() -> None:
    truth = table()
    y, x = np.mgrid[:SIZE, :SIZE]
    hole = (abs(x - SIZE / 2) < SIZE / 2 - 10) & (
        abs(y - EDGE) < 20 + 8 * np.sin(x / 9)
    )
    assert off(truth, hole, (30, 60, 120)) < 6


def test_a_hidden_corner_of_a_box_is_a_corner() -> None:
    truth = np.full((SIZE, SIZE, 3), [90, 110, 90], np.uint8)
    truth[40:100, 80:] = [200, 190, 170]
    y, x = np.mgrid[:SIZE, :SIZE]
    hole = np.hypot(x - 80, y - 100) < 42
    assert off(truth, hole, (120, 60, 30)) < 3


def test_the_end_of_a_shelf_before_a_white_wall_goes_on_behind_what_stands_there() -> (
    None
):
    """It is seen above the ball alone: below is the board on which that lies."""
    truth = np.full((SIZE, SIZE, 3), 240, np.uint8)
    truth[10:130, 70:] = 25
    truth[130:136, 40:] = 15
    y, x = np.mgrid[:SIZE, :SIZE]
    hole = np.hypot(x - 72, y - 107) < 24
    assert off(truth, hole, (180, 30, 30)) < 12


def test_marks_at_both_sides_of_a_hole_are_no_line() -> None:
    truth = np.full((SIZE, SIZE, 3), [170, 160, 150], np.uint8)
    y, x = np.mgrid[:SIZE, :SIZE]
    hole = (abs(x - 80) < 30) & (abs(y - 80) < 30)
    truth[78:82, 46:50] = truth[78:82, 111:115] = 30
    truth = np.clip(
        truth + np.random.default_rng(3).normal(0, 6, (SIZE, SIZE, 1)), 0, 255
    ).astype(np.uint8)
    photo = truth.copy()
    photo[hole] = [30, 60, 120]
    filled = registry.make("inpaint")(photo, hole).astype(float)
    assert filled[78:82, 60:100].mean() > 150


def test_the_edge_of_a_shadow_that_fades_does_not_go_on_through_the_hole() -> None:
    """It is seen above the ball alone, with a third of the contrast of a shelf's end."""
    y, x = np.mgrid[:SIZE, :SIZE]
    truth = (
        np.full((SIZE, SIZE, 3), 230.0)
        - (60 * np.clip((125 - y) / 40, 0, 1) * (x >= 70))[..., None]
    )
    filled = registry.make("inpaint")(
        truth.astype(np.uint8), np.hypot(x - 72, y - 107) < 24
    ).astype(float)
    assert abs(filled[114:128, 60:66].mean() - filled[114:128, 78:84].mean()) < 15


def test_an_edge_that_enters_the_hole_for_one_pixel() -> None:
    """Its line has one point, and no direction: the last of these drawings has one."""
    rng = np.random.default_rng(1)
    for _ in range(108):
        picture, hole = draw_polygons(rng)
    filled, _ = continue_edges(picture, hole)
    assert np.isfinite(filled).all()


def draw_polygons(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return a picture (60, 60, 3) of polygons and the mask of a hole in it."""
    picture = np.full((60, 60, 3), 60, np.float32)
    for _ in range(rng.integers(2, 8)):
        corners = rng.integers(0, 60, (rng.integers(3, 6), 2)).astype(np.int32)
        cv2.fillPoly(picture, [corners], rng.integers(0, 255, 3).tolist())
    hole = np.zeros((60, 60), np.uint8)
    corners = rng.integers(8, 52, (rng.integers(3, 9), 2)).astype(np.int32)
    cv2.fillPoly(hole, [corners], 1)
    return picture, hole > 0
