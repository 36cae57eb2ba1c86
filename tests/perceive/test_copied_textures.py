"""Textures of copies in a hole: a copy goes on as coarse as what is beside it."""

import numpy as np
import pytest

from physgen.perceive.inpaint.odd_pieces import replace_odd_pieces
from physgen.perceive.inpaint.offset_labels import OffsetLabels, ReducedPhoto

HOLE = np.zeros((14, 24), bool)
HOLE[4:9, 3:8] = True


def grey_photo(*, coarse: float = 5.0) -> ReducedPhoto:
    """Return a grey photo of texture 2 with a place as coarse as `coarse`."""
    picture = np.full((*HOLE.shape, 3), 128, np.float32)
    texture = np.full((*HOLE.shape, 4), 2, np.float32)
    texture[3:10, 10:16] = coarse
    even = np.zeros(HOLE.shape, np.float32)
    return ReducedPhoto(picture, picture, HOLE, HOLE, even, even, texture)


def test_copies_continue_the_texture_beside_the_hole():
    """Both places have the same colour, and the coarse one is nearer."""
    offsets = np.array([(0, 8), (0, 14)])
    labels = OffsetLabels(grey_photo(), offsets).solve()
    assert (labels[HOLE] == 1).all()
    labels = OffsetLabels(grey_photo(coarse=2.0), offsets).solve()
    assert (labels[HOLE] == 0).all()


@pytest.mark.parametrize(("coarse", "replaced"), [(5.0, True), (2.2, False)])
def test_coarse_copy_among_fine_ones_is_replaced(coarse: float, replaced: bool):
    labels = np.where(HOLE, 0, -1)
    result = replace_odd_pieces(labels, np.array([(0, 8)]), grey_photo(coarse=coarse))
    assert np.array_equal(result, np.where(HOLE, 1 if replaced else 0, -1))


def test_narrow_copy_may_be_an_edge():
    line = HOLE.copy()
    line[:, 5:] = False
    labels = np.where(line, 0, -1)
    offsets = np.array([(0, 8)])
    assert np.array_equal(replace_odd_pieces(labels, offsets, grey_photo()), labels)


def test_coarse_copy_beside_a_coarse_place_stays():
    photo = grey_photo()
    photo.texture[3:10, :3] = 5
    labels = np.where(HOLE, 0, -1)
    offsets = np.array([(0, 8)])
    assert np.array_equal(replace_odd_pieces(labels, offsets, photo), labels)
