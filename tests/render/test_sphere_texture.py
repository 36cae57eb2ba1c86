"""The far side of spheres: their own texture, without a seam or a mirror line."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen.photometry import DistantLight
from physgen.render.ball import ball_from_photo
from physgen.render.sphere_texture import continue_skin, part_highlights
from physgen.scene.scene import View

SIDE, RADIUS = 121, 50.0
CENTER = (60.0, 60.0)
SUN = DistantLight((-0.3, -0.4, 0.866), 0.8, 0.3)


def apple_skin() -> np.ndarray:
    """Red on the left, yellow on the right, with pores."""
    _, columns = np.mgrid[:SIDE, :SIDE]
    share = 1 / (1 + np.exp(-(columns - CENTER[0]) / 12))[..., None]
    colour = (1 - share) * np.array([0.6, 0.08, 0.05]) + share * np.array(
        [0.7, 0.5, 0.1]
    )
    grain = cv2.GaussianBlur(
        np.random.default_rng(1).normal(0, 1, (SIDE, SIDE)).astype(np.float32),
        (0, 0),
        1.2,
    )
    return (colour * np.exp(0.5 * grain)[..., None]).astype(np.float32)


def test_both_sides_meet_at_the_rim():
    near, far = continue_skin(apple_skin(), CENTER, RADIUS)
    turns = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    x = (CENTER[0] + RADIUS * np.cos(turns)).astype(np.float32)[None]
    y = (CENTER[1] + RADIUS * np.sin(turns)).astype(np.float32)[None]
    rim = [cv2.remap(side, x, y, cv2.INTER_LINEAR)[0] for side in (near, far)]
    assert np.abs(rim[0] - rim[1]).max() < 0.04


def test_the_visible_skin_stays():
    skin = apple_skin()
    near, _ = continue_skin(skin, CENTER, RADIUS)
    assert near[60, 60] == pytest.approx(skin[60, 60], rel=0.01)


def test_the_far_side_is_no_mirror_image():
    """Neither of the near side nor of its antipodes, but as rough as that."""
    near, far = continue_skin(apple_skin(), CENTER, RADIUS)
    rows, columns = np.mgrid[:SIDE, :SIDE]
    inside = np.hypot(rows - 60, columns - 60) < 35
    fine = [
        np.log(side + 0.03) - cv2.GaussianBlur(np.log(side + 0.03), (0, 0), 4)
        for side in (near, far)
    ]
    own = fine[1][inside].ravel()
    assert own.std() == pytest.approx(fine[0][inside].std(), rel=0.35)
    for other in (fine[0], fine[0][::-1, ::-1], fine[0][:, ::-1], fine[0][::-1]):
        assert abs(np.corrcoef(own, other[inside].ravel())[0, 1]) < 0.3


def test_the_far_side_continues_colours_at_the_rim():
    """Red goes on behind red, yellow behind yellow; antipodes would exchange them."""
    _, far = continue_skin(apple_skin(), CENTER, RADIUS)
    left, right = far[55:66, 14:20].mean((0, 1)), far[55:66, 102:108].mean((0, 1))
    assert left[1] < 0.2 < 0.35 < right[1]


def test_white_highlights_leave_the_skin():
    skin = apple_skin()
    lit = skin.copy()
    lit[40:44, 40:60] += 0.8
    inside = np.ones(skin.shape[:2], bool)
    plain = part_highlights(lit, inside, RADIUS)
    assert plain[41:43, 44:56].mean() < 1.3 * skin[41:43, 44:56].mean()
    assert np.allclose(plain[80:], lit[80:], atol=1e-6)


@pytest.mark.parametrize("is_painted", [True, False])
def test_only_billiard_balls_have_patterns(is_painted: bool):
    """An apple with a pale half is two-coloured, too."""
    rows, _ = np.mgrid[:SIDE, :SIDE]
    pale = (rows < 55)[..., None]
    colour = np.where(pale, [0.7, 0.65, 0.5], [0.5, 0.04, 0.04]).astype(np.float32)
    ball = ball_from_photo(
        colour, (0, 0), CENTER, RADIUS, SUN, View.TOP, has_paints=is_painted
    )
    assert (ball.pattern is not None) is is_painted
    assert ball.has_continued_texture is not is_painted


def test_a_stripe_to_the_rim_is_no_highlight():
    skin = apple_skin()
    rows, columns = np.mgrid[:SIDE, :SIDE]
    distance = np.hypot(columns - CENTER[0], rows - CENTER[1])
    inside = distance < RADIUS
    striped = skin.copy()
    striped[58:62] += 0.8
    assert np.array_equal(part_highlights(striped, inside, RADIUS), striped)


@pytest.mark.parametrize("view", list(View))
def test_highlights_of_fruit_stay_in_both_views(view: View):
    colour = apple_skin()
    colour[40:44, 40:60] += 0.8
    ball = ball_from_photo(colour, (0, 0), CENTER, RADIUS, SUN, view, has_paints=False)
    assert ball.gloss[41:43, 44:56].mean() > 0.4
    assert ball.skin[41:43, 44:56].mean() < 1.3 * ball.skin[46:48, 44:56].mean()
