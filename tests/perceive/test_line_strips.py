"""Straight lines through holes, compared with the true picture."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from physgen.perceive.backends.inpaint_fill import fill
from physgen.perceive.inpaint.certain_lines import certain_lines
from physgen.perceive.inpaint.line_strips import paint_lines

Rgb = NDArray[np.uint8]
Mask = NDArray[np.bool_]

HEIGHT, WIDTH = 160, 240
Y, X = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
HOLE = np.hypot((X - 120) / 32, (Y - 80) / 50) < 1
"""The outline of an object."""
OBJECT = np.array([30, 90, 200], np.uint8)
GRAIN = 3.0
"""Levels: standard deviation of the noise of a photo."""


def photo(colours: NDArray[np.float64]) -> Rgb:
    """Return grey levels (H, W) as a photo with soft edges and grain."""
    soft = cv2.GaussianBlur(colours.astype(np.float32), (0, 0), 0.8)
    grain = np.random.default_rng(0).normal(0, GRAIN, (HEIGHT, WIDTH, 3))
    return np.clip(soft[..., None] + grain, 0, 255).astype(np.uint8)


def planks(slope: float) -> tuple[Rgb, Mask]:
    """Return two planks of a table and the surroundings of their dark gap."""
    away = Y - 78 - slope * (X - 120)
    grain = 6 * np.sin(away / 2.5)
    upper, lower = 165 + grain, 140 + grain
    colours = np.where(away < 0, upper, lower)
    return photo(np.where(np.abs(away) < 3.5, 45, colours)), np.abs(away) < 8


def table_edge(slope: float) -> tuple[Rgb, Mask]:
    """Return a wall, a table's top and the front of the top, thinner farther away."""
    away = Y - 70 - slope * (X - 120)
    thickness = 14 - 0.02 * X
    colours = np.where(away < 0, 190 - 0.1 * X, 60)
    colours = np.where((away >= 0) & (away < thickness), 120, colours)
    return photo(colours), (away > -4) & (away < thickness + 4)


def error(filled: NDArray[np.generic], truth: Rgb, where: Mask) -> float:
    """Return the RMS difference in levels of a fill from the true picture."""
    difference = filled.astype(np.float64) - truth
    return float(np.sqrt((difference[where & HOLE] ** 2).mean()))


def painted_error(truth: Rgb, where: Mask) -> tuple[float, float]:
    """Return the errors of a fill of one colour with and without its lines."""
    colours = truth.astype(np.float32)
    plain = np.where(HOLE[..., None], colours[~HOLE].mean(axis=0), colours)
    lines = certain_lines(colours, HOLE)
    painted = paint_lines(plain, colours, HOLE, lines, 1.0)
    return error(painted, truth, where), error(plain, truth, where)


@pytest.mark.parametrize("slope", [-0.07, 0.04, 0.09])
def test_gap_between_planks_continues_as_in_truth(slope: float) -> None:
    painted, plain = painted_error(*planks(slope))
    assert plain > 40
    assert painted < 14


@pytest.mark.parametrize("slope", [-0.12, 0.08])
def test_table_edge_in_perspective_continues_as_in_truth(slope: float) -> None:
    painted, plain = painted_error(*table_edge(slope))
    assert plain > 30
    assert painted < 8


def test_fill_continues_gap_more_exactly_than_copies() -> None:
    """Copies of patches alone have an error of 10 levels."""
    truth, where = planks(0.09)
    hidden = np.where(HOLE[..., None], OBJECT, truth)
    assert error(fill()(hidden, HOLE), truth, where) < 8.8


def test_crossing_line_ends_at_both_sides_of_hole() -> None:
    truth, _ = table_edge(0.08)
    lines = certain_lines(truth.astype(np.float32), HOLE)
    assert lines
    for line in lines:
        ends = np.stack([line.start, line.end])
        assert ends[:, 0].min() < 120 - 25
        assert ends[:, 0].max() > 120 + 25


def test_line_beside_hole_is_not_a_line_through_it() -> None:
    truth = photo(np.where(Y < 26, 190, 60))
    assert certain_lines(truth.astype(np.float32), HOLE) == []


@pytest.mark.parametrize("size", [1.0, 3.0, 6.0])
def test_texture_contains_no_lines(size: float) -> None:
    noise = np.random.default_rng(1).normal(0, 1, (HEIGHT, WIDTH))
    spots = cv2.GaussianBlur(noise, (0, 0), size)
    truth = photo(120 + 50 * spots / spots.std())
    assert certain_lines(truth.astype(np.float32), HOLE) == []


def test_different_edges_at_both_sides_are_not_joined() -> None:
    away = np.where(X < 120, 80 - Y, Y - 80)
    truth = photo(np.where(away < 0, 190, 60))
    assert certain_lines(truth.astype(np.float32), HOLE) == []


def bench() -> tuple[Rgb, NDArray[np.float64]]:
    """Return a wall behind a bench with a round left end, and rows below the edge."""
    away = Y - 80 - 0.003 * np.maximum(90 - X, 0) ** 2
    return photo(np.where(away < 0, 190, 60)), away


def test_round_end_joins_straight_edge_of_same_surfaces() -> None:
    truth, _ = bench()
    (line,) = certain_lines(truth.astype(np.float32), HOLE)
    assert np.abs([line.start[1] - 80, line.end[1] - 80]).max() < 4
    assert abs(line.end[0] - line.start[0]) > 50


def test_pieces_of_wrong_side_beside_line_are_filled() -> None:
    """Copies continued the bench too high: its part above the line shows the wall."""
    truth, away = bench()
    colours = truth.astype(np.float32)
    wrong = colours.copy()
    wrong[(away > -22) & (away < 0) & HOLE & (X < 120)] = 60
    lines = certain_lines(colours, HOLE)
    painted = paint_lines(wrong, colours, HOLE, lines, 1.0)
    above = (away < -5) & (away > -30)
    assert error(wrong, truth, above) > 50
    assert error(painted, truth, above) < 10
    assert error(painted, truth, away > 5) < 10


@pytest.mark.parametrize("width", [10, 12, 16])
@pytest.mark.parametrize("levels", [(60, 190), (190, 60)])
def test_bar_through_hole_stays(width: int, levels: tuple[int, int]) -> None:
    """Beyond a bar, the ground has the colours of its other side, and is right."""
    away = Y - 75
    truth = photo(np.where((away > 0) & (away < width), *levels))
    colours = truth.astype(np.float32)
    lines = certain_lines(colours, HOLE)
    assert lines
    painted = paint_lines(colours.copy(), colours, HOLE, lines, 1.0)
    assert error(painted, truth, np.abs(away) < 40) < 5


def test_wrong_piece_apart_from_line_and_specks_stay() -> None:
    truth, away = bench()
    colours = truth.astype(np.float32)
    filled = colours.copy()
    piece = (away > -23) & (away < -19) & (X > 100) & (X < 118)
    specks = (away > -12) & (away < -9) & (np.abs(X - 130) < 3)
    filled[(piece | specks) & HOLE] = 60
    lines = certain_lines(colours, HOLE)
    painted = paint_lines(filled, colours, HOLE, lines, 1.0)
    assert (painted[piece & HOLE] < 80).all()


@pytest.mark.parametrize("levels", [(120, 60), (190, 120)])
def test_round_end_of_other_surfaces_is_not_joined(levels: tuple[int, int]) -> None:
    _, away = bench()
    colours = np.where(away < 0, 190, 60)
    colours = np.where(X < 120, colours, np.where(Y < 80, *levels))
    assert certain_lines(photo(colours).astype(np.float32), HOLE) == []
