"""Shade and fruit that move with their objects without an edge of their own."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from physgen.compile.world import Body
from physgen.geometry.polygon import Pose
from physgen.geometry.shadows import ShadowSetting, Silhouette
from physgen.photometry import DistantLight, decode
from physgen.render.ball_parts import is_lump
from physgen.render.contact_shades import add_contact_shades
from physgen.render.shadow_decomposition import (
    BEYOND,
    EDGE,
    LitBackground,
    _claimed_darkness,
    _Difference,
    _share_beyond_floor,
    decompose_shadows,
)
from physgen.render.sprites import Sprite

BOXES = [(0, 0, 60, 100), (0, 0, 100, 60), (40, 0, 100, 100), (0, 40, 100, 100)]
"""x0, y0, x1, y1 px of shade at the left, top, right and bottom of a photo."""


SIDE = 100


def _shade_around(box) -> np.ndarray:
    """Return shade of 0.2 in a box of a photo, with a photo's width on each side."""
    rest = np.full((SIDE, SIDE), 0.2, np.float32)
    claim = np.ones((box[3] - box[1], box[2] - box[0]), np.float32)
    difference = _Difference(rest, np.zeros_like(rest))
    (left, top, right, bottom), own = _claimed_darkness(
        difference, (box, claim), np.ones_like(rest), None
    )
    canvas = np.zeros((3 * SIDE, 3 * SIDE), np.float32)
    canvas[top + SIDE : bottom + SIDE, left + SIDE : right + SIDE] = own
    return canvas


@pytest.mark.parametrize("turn", range(4))
def test_shade_at_the_border_fades_beyond_the_photo(turn: int) -> None:
    """Moved into the picture it shows no edge: no step is larger than the fade's."""
    turned = np.rot90(_shade_around(BOXES[turn]), turn)  # it reaches the left border
    row = turned[SIDE + SIDE // 2]
    assert np.abs(np.diff(row[: SIDE + 50])).max() <= 0.2 / (BEYOND * SIDE) + 1e-6
    assert row[SIDE : SIDE + 50 - EDGE].min() > 0.15
    assert row[0] == 0


@pytest.mark.parametrize(("direct", "is_kept"), [(0.06, True), (0.8, False)])
def test_shade_in_soft_light_shows_how_far_a_floor_reaches(direct, is_kept) -> None:
    """The tilt of the floor is a guess then, and its far end is unknown."""
    light = DistantLight((0.0, -0.6, 0.8), direct, 1.14)
    setting = ShadowSetting(light, 40.0, False, 0.1, np.inf, (SIDE, SIDE))
    figure = np.ones((40, 20), np.float32)
    start = Silhouette(figure, (40, 50), (50.0, 70.0), None, 20.0, 90.0)
    shade = (10, 60, 40, 90), np.full((30, 30), 0.3, np.float32)
    shares = _share_beyond_floor(start, shade, setting)
    # The guessed floor ends in row 80.
    assert (shares is not None) == is_kept
    if shares is not None:
        assert shares[:19].min() == 1
        assert shares[21:].max() == 0


def test_neighbours_leave_no_shade_that_the_photo_lacks() -> None:
    """Between two objects no claim is the largest, and predictions end there, too."""
    light = DistantLight((0.0, -0.6, 0.8), 0.06, 1.14)
    setting = ShadowSetting(light, 40.0, False, 0.8, np.inf, (2 * SIDE, SIDE))
    coverage = np.zeros((SIDE, 2 * SIDE), np.float32)
    starts = []
    for left in (40, 110):
        figure = np.ones((40, 50), np.float32)
        coverage[30:70, left : left + 50] = figure
        middle = left + 24.5, 49.5
        starts.append(Silhouette(figure, (left, 30), middle, None, 50.0, 69.5))
    ground = np.full((SIDE, 2 * SIDE, 3), 120, np.uint8)
    lit, _ = decompose_shadows(
        ground, ground, coverage, starts, [False, False], setting
    )
    is_open = coverage[75:] == 0
    difference = np.abs(lit.photo_background() - decode(ground))[75:]
    assert difference[is_open].max() < 0.02


def _shaded_block() -> tuple[LitBackground, Silhouette]:
    """Return a shaded floor beside the left border, and a block on it that may rock."""
    light = DistantLight((0.0, -0.6, 0.8), 0.06, 1.14)
    setting = ShadowSetting(light, 40.0, False, 0.8, np.inf, (2 * SIDE, SIDE))
    figure = np.ones((40, 40), np.float32)
    coverage = np.zeros((SIDE, 2 * SIDE), np.float32)
    coverage[30:70, 12:52] = figure
    start = Silhouette(figure, (12, 30), (31.5, 49.5), None, 40.0, 69.5)
    clean = np.full((SIDE, 2 * SIDE, 3), 150, np.uint8)
    shaded = clean.copy()
    shaded[50:90, :60] = 110
    lit, _ = decompose_shadows(shaded, clean, coverage, [start], [False], setting)
    sprite = cast(Sprite, SimpleNamespace(foot_halo=None))
    return add_contact_shades(lit, [sprite]), start


def test_shade_of_a_rocking_object_has_no_edge_of_the_photo() -> None:
    """The object moves in from the left border, and brings no upright line along."""
    lit, start = _shaded_block()
    shift = 24
    figure = replace(start, corner=(12 + shift, 30), center=(31.5 + shift, 49.5))
    pose, moved_pose = Pose(31.5, 49.5, 0.0), Pose(31.5 + shift, 49.5, 0.06)
    darkness = np.zeros((SIDE, 2 * SIDE), np.float32)
    for (x0, y0, x1, y1), part in lit.move_shadow(0, figure, pose, moved_pose):
        darkness[y0:y1, x0:x1] += part
    row = darkness[52]
    assert row.max() > 0.1
    steps = np.abs(np.diff(row[shift - 8 : shift + 8]))
    assert steps.max() < 0.25 * row.max()


def _sprite(mask) -> Sprite:
    coverage = mask.astype(np.float32)
    light = np.repeat(coverage[..., None], 3, axis=2)
    return Sprite(body=0, corner=(0, 0), light=light, coverage=coverage)


def test_a_lump_leaves_its_circle_and_a_thread_does_not_make_one() -> None:
    rows, columns = np.indices((160, 160))
    x, y = columns - 80, rows - 80
    ball = np.hypot(x, y) <= 40
    thread = ball | ((np.abs(x) <= 4) & (y < 0))
    lump = np.hypot(x / 50, y / 42) <= 1
    body = cast(Body, SimpleNamespace(radius=40.0, center=np.array([80.0, 80.0])))
    assert not is_lump(_sprite(ball), body)
    assert not is_lump(_sprite(thread), body)
    assert is_lump(_sprite(lump), body)
    block = cast(Body, SimpleNamespace(radius=None, center=body.center))
    assert not is_lump(_sprite(lump), block)
