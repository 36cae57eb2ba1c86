"""Shade on a ground of unknown geometry is removed, and paint is not."""

from __future__ import annotations

import numpy as np

from physgen.geometry.fitting import fit_outlines
from physgen.geometry.scale import photo_object
from physgen.perceive.shadow.side_view import shade_without_light
from physgen.perceive.shadow.smooth_shade import find_smooth_shade
from physgen.photometry import decode, encode_u8

SIZE = (300, 240)
"""Width and height of the drawings, px."""


def _drawing(shade, paint=None):
    """Return a rough ground in slowly varying light, with a grey box, and its labels."""
    width, height = SIZE
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    grain = np.random.default_rng(3).normal(0, 0.08, (height, width))
    light = 0.3 * np.exp(0.2 * columns / width - 0.3 * rows / height + grain)
    labels = np.zeros((height, width), np.uint16)
    labels[90:160, 120:190] = 1
    lit = light[..., None] * np.array([0.6, 0.8, 1.0])
    ground = lit * np.exp(-shade(rows, columns))[..., None]
    if paint is not None:
        ground[paint] *= 0.4
    seen = np.where(labels[..., None] > 0, 0.2, ground)
    return encode_u8(seen.astype(np.float32)), labels, lit


def _found(rgb, labels):
    outlines = fit_outlines(labels, [1])
    objects = [photo_object(1, outlines[1], "", SIZE)]
    coverage = (labels > 0).astype(np.float32)
    return find_smooth_shade(rgb, coverage, labels, objects)


def _none(rows, columns):
    return 0.0 * rows


def _around(rows, columns):
    """Return shade that is deepest at the lower left corner of the box."""
    return 0.9 * np.exp(-(((rows - 158) / 22) ** 2) - ((columns - 135) / 45) ** 2)


def test_shade_gives_way_to_the_lit_ground():
    rgb, labels, lit = _drawing(_around)
    clean, owners = _found(rgb, labels)
    place = np.s_[164:172, 115:160]
    before = np.log(decode(rgb)[place].mean() / lit[place].mean())
    after = np.log(decode(clean)[place].mean() / lit[place].mean())
    assert before < -0.5
    assert abs(after) < 0.12
    assert (owners[place] == 1).all()


def test_shade_is_removed_beside_its_object_alone():
    rgb, labels, _ = _drawing(_around)
    clean, _ = _found(rgb, labels)
    far = np.s_[:60, :]
    assert np.array_equal(clean[far], rgb[far])
    assert np.array_equal(clean[labels > 0], rgb[labels > 0])


def test_even_ground_has_no_shade():
    rgb, labels, _ = _drawing(_none)
    assert _found(rgb, labels) is None


def test_paint_away_from_an_object_is_no_shade():
    paint = np.zeros(SIZE[::-1], bool)
    paint[185:215, 60:240] = True
    rgb, labels, _ = _drawing(_none, paint)
    assert _found(rgb, labels) is None


def test_gaps_between_boards_stay_in_shade():
    def on_boards(rows, columns):
        return _around(rows, columns) + 1.5 * (np.abs(columns - 100) < 2)

    rgb, labels, _ = _drawing(on_boards)
    clean, _ = _found(rgb, labels)
    light = decode(clean).mean(axis=2)[:, 80:121]
    # The gap ends in the shade, and goes on through it.
    for rows in (slice(155, 165), slice(200, 210)):
        boards = np.r_[light[rows, :15].ravel(), light[rows, -15:].ravel()].mean()
        assert light[rows, 19:22].mean() < 0.4 * boards


def test_an_object_of_the_side_view_loses_its_whole_shade():
    rgb, labels, lit = _drawing(_around)
    outlines = fit_outlines(labels, [1])
    objects = [photo_object(1, outlines[1], "", SIZE)]
    coverage = (labels > 0).astype(np.float32)
    clean, owners = shade_without_light(rgb, coverage, labels, objects)
    above_foot = np.s_[135:145, 95:115]
    before = np.log(decode(rgb)[above_foot].mean() / lit[above_foot].mean())
    after = np.log(decode(clean)[above_foot].mean() / lit[above_foot].mean())
    assert abs(after) < 0.4 * abs(before)
    assert (owners[above_foot] == 1).mean() > 0.8
