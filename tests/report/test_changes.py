"""What refinement changed, where it is known: figures to the last digit, colours at their places, words on the page."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from pytest import approx

from physgen.report.refinement import (
    COLUMNS,
    COOL,
    GAP,
    LINE,
    NARROWEST,
    NEAR,
    PALE,
    PAPER,
    WARM,
    WIDEST,
    RefinementChanges,
    _left,
    full_scale,
    panel,
)

W, H = panel((16000, 9000))
"""px: a panel's own size, so that nothing is made smaller."""
X0, Y0 = 100, 60
"""px: corner of the object, which is 20 px a side."""


def grey(code: int, size: tuple[int, int] = (W, H)) -> np.ndarray:
    return np.full((size[1], size[0], 3), code, np.uint8)


def square(size: tuple[int, int] = (W, H)) -> np.ndarray:
    coverage = np.zeros((size[1], size[0]), np.float32)
    coverage[Y0 : Y0 + 20, X0 : X0 + 20] = 1
    return coverage


def away() -> np.ndarray:
    """(H, W) px from the square's nearest pixel, by hand."""
    y, x = np.mgrid[:H, :W]
    dx = np.maximum(np.maximum(X0 - x, x - (X0 + 19)), 0)
    dy = np.maximum(np.maximum(Y0 - y, y - (Y0 + 19)), 0)
    return np.hypot(dx, dy)


def panels(page: np.ndarray, columns: int) -> list[list[np.ndarray]]:
    """Guidance, refined and change of each column."""
    top, found = LINE + GAP // 2, []
    for k in range(columns):
        x = _left() + k * (W + GAP)
        found.append([page[top + j * (H + GAP) :, x:][:H, :W] for j in range(3)])
    return found


def test_known_changes_give_known_figures() -> None:
    near = NEAR * np.hypot(W, H)
    places = away()
    refined = grey(100)
    refined[places == 0] += 10
    refined[(places > 0) & (places <= near)] -= 20
    refined[places > near] += 3
    changes = RefinementChanges(2, 10.0)
    for _ in range(2):
        changes.add(grey(100), refined, square())
    found = changes.figures()
    assert (found["objects"], found["near"], found["elsewhere"]) == (10, 20, 3)
    assert found["all"] == found["first"] == approx(np.abs(refined.astype(int) - 100).mean(), abs=1e-4)
    assert found["near_px"] == approx(near, abs=1e-4)
    assert (found["jump_guidance"], found["jump_refined"], found["jump_of_change"]) == (0, 0, 0)
    assert found["flicker"] is None


def test_half_a_pixel_counts_half() -> None:
    coverage = 0.25 * square()  # nowhere half: nothing is near it
    refined = grey(100)
    refined[coverage > 0] = 140
    changes = RefinementChanges(1, 10.0)
    changes.add(grey(100), refined, coverage)
    found = changes.figures()
    assert (found["objects"], found["near"]) == (40, None)
    assert found["elsewhere"] == approx(0.75 * 400 * 40 / (W * H - 100), abs=1e-4)
    nothing = RefinementChanges(1, 10.0)
    nothing.add(grey(100), refined, np.zeros((H, W), np.float32))
    assert nothing.figures()["objects"] is None


def test_another_colour_of_the_same_brightness_is_a_change() -> None:
    refined = grey(100)
    refined[..., 0], refined[..., 1], refined[..., 2] = 130, 92, 95
    changes = RefinementChanges(1, 10.0)
    changes.add(grey(100), refined, square())
    assert changes.figures()["all"] == approx((30 + 8 + 5) / 3, abs=1e-4)


def test_jumps_are_those_of_neighbours() -> None:
    changes = RefinementChanges(4, 8.0)
    for before, after in ((100, 100), (104, 104), (105, 113), (105, 112)):
        changes.add(grey(before), grey(after), square())
    found = changes.figures()
    assert (found["jump_guidance"], found["jump_refined"], found["flicker"]) == (4, 9, 2.25)
    assert (found["jump_of_change"], found["jump_at"]) == (8, 2 / 8)
    assert found["first"] == 0


def test_colours_say_how_much_and_where() -> None:
    refined = grey(100)
    refined[10:30, 10:40] = 120  # brighter by 20
    refined[10:30, 60:90] = 80
    refined[40:60, 10:40] = 110  # half as much
    refined[Y0 + 4 : Y0 + 16, X0 + 4 : X0 + 16] = 104  # on the object, inside its outline
    changes = RefinementChanges(1, 10.0)
    changes.add(grey(100), refined, square())
    [(guidance, after, change)] = panels(changes.picture(), 1)
    assert (guidance == 100).all()
    assert np.array_equal(after, refined)
    pale = round(PALE[0] + (PALE[1] - PALE[0]) * 100 / 255)
    assert (change[12:28, 12:38] == WARM).all()
    assert (change[12:28, 62:88] == COOL).all()
    for box, share in ((np.s_[42:58, 12:38], 0.5), (np.s_[Y0 + 5 : Y0 + 15, X0 + 5 : X0 + 15], 0.2)):
        assert np.abs(change[box] - (pale + share * (np.array(WARM) - pale))).max() <= 1
    assert (change[100:, :80] == pale).all()
    # the outline is dark, and hardly wider than a pixel
    across = change[Y0 + 10, X0 - 6 : X0 + 4].mean(axis=1)
    assert across.min() < pale - 50
    assert (across < pale - 12).sum() <= 2
    assert np.flatnonzero(across == across.min())[0] in (5, 6)


def test_few_odd_pixels_do_not_pale_the_rest() -> None:
    def levels(refined: np.ndarray) -> int:
        changes = RefinementChanges(1, 10.0)
        changes.add(grey(100), refined, square())
        return full_scale(changes._columns)

    refined = grey(100)
    assert levels(refined) == 0
    refined[3, 5] = 255
    assert levels(refined) == 1
    refined[20:60, 20:60] = 103
    assert levels(refined) == 5
    refined[20:60, 20:60] = 0
    assert levels(refined) == 100


def test_where_nothing_changed_there_is_no_colour() -> None:
    changes = RefinementChanges(3, 10.0)
    for code in (10, 100, 250):
        changes.add(grey(code), grey(code), np.zeros((H, W), np.float32))
    page = changes.picture()
    for code, (guidance, refined, change) in zip((10, 100, 250), panels(page, 3), strict=True):
        assert (guidance == code).all()
        assert (refined == code).all()
        assert (change == change[0, 0, 0]).all()
    assert changes.figures()["all"] == 0


@pytest.mark.parametrize(("count", "shown"), [(1, [0]), (4, [0, 1, 2, 3]), (11, [0, 2, 4, 6, 8, 10])])
def test_columns_run_from_the_first_to_the_last(count: int, shown: list[int]) -> None:
    changes = RefinementChanges(count, 10.0)
    for k in range(count):
        changes.add(grey(20 * k), grey(20 * k + 5), square())
    page = changes.picture()
    assert [int(one[0][0, 0, 0]) for one in panels(page, len(shown))] == [20 * k for k in shown]
    assert page.shape[1] == max(_left() + len(shown) * (W + GAP), NARROWEST[0])


@pytest.mark.parametrize("count", [1, 2, 9])
@pytest.mark.parametrize(
    "size",
    [(64, 36), (36, 64), (300, 300), (960, 540), (540, 960), (1920, 1080), (2000, 30), (30, 2000), (1, 1)],
)
def test_a_strip_of_any_size_has_room_for_its_words(size: tuple[int, int], count: int) -> None:
    changes = RefinementChanges(count, 0.01)  # times as long as they come
    rng = np.random.default_rng(0)
    for _ in range(count):
        coverage = (rng.random(size[::-1]) > 0.5).astype(np.float32)
        changes.add(grey(100, size), rng.integers(0, 255, (size[1], size[0], 3), np.uint8), coverage)
    page = changes.picture()
    assert page.shape[1] <= WIDEST
    assert page.shape[0] <= 3 * (300 + GAP) + 5 * LINE
    for edge in (page[:2], page[-2:], page[:, :2], page[:, -2:]):
        assert (edge == PAPER).all()
    width, height = panel(size)
    assert max(height - 300, _left() + COLUMNS * (width + GAP) - WIDEST) <= 0
    assert width / height == approx(size[0] / size[1], rel=0.6 / min(width, height))
    key = page[-3 * LINE - GAP :]
    assert (np.ptp(key.astype(int), axis=2) > 100).any(), "the scale"
    assert (key.mean(axis=2) < 90).any(), "its words"


def test_a_large_picture_is_made_smaller_in_linear_light() -> None:
    board = np.zeros((1088, 1936, 3), np.uint8)
    board[::2], board[:, ::2] = 255, 255  # three of four white
    changes = RefinementChanges(1, 10.0)
    changes.add(board, board, np.zeros(board.shape[:2], np.float32))
    [(guidance, _, _)] = panels(changes.picture(), 1)
    assert guidance.mean() == approx(225, abs=1)  # 0.75 of the light


def test_only_what_is_shown_is_kept() -> None:
    changes = RefinementChanges(100, 25.0)
    for _ in range(100):
        changes.add(grey(1), grey(2), square())
    assert len(changes._columns) == COLUMNS


def test_outlines_are_where_objects_cover_half_a_pixel() -> None:
    coverage = np.zeros((H, W), np.float32)
    cv2.circle(coverage, (120, 68), 40, 1.0, -1)
    coverage = cv2.GaussianBlur(coverage, (0, 0), 3)
    coverage[:, 200:] = 1  # and something that leaves the frame
    changes = RefinementChanges(1, 10.0)
    changes.add(grey(100), grey(100), coverage)
    [(_, _, change)] = panels(changes.picture(), 1)
    y, x = np.nonzero(change[:, :190].mean(axis=2) < 150)
    assert np.abs(np.hypot(x - 120, y - 68) - 40.3).max() < 1.5
    assert len(x) > 2 * np.pi * 40 * 0.8
    assert (change[[0, -1], 205:].mean(axis=2) > 150).all(), "no line along the frame's border"
    assert (change[:, 197:202].mean(axis=2).min(axis=1) < 150).all()
