"""Darkening where objects come to touch."""

from __future__ import annotations

import numpy as np
import pytest

from physgen.render.contact_shade import SHADE, ContactShade
from physgen.render.sprites import Sprite

DEPTH = 0.2


def _sprite(body: int, left: int) -> Sprite:
    coverage = np.ones((40, 30), np.float32)
    light = np.ones((40, 30, 3), np.float32)
    return Sprite(body, (left, 10), light, coverage)


def _factors(gap: int, start_gap: int = 60) -> dict[int, np.ndarray]:
    sprites = [_sprite(0, 10), _sprite(1, 40 + start_gap)]
    left = 40 + gap
    boxes = np.s_[10:50, 10:40], np.s_[10:50, left : left + 30]
    parts = {k: (boxes[k], sprites[k].coverage) for k in (0, 1)}
    return ContactShade(sprites, DEPTH).factors(parts)


def test_a_new_contact_darkens_both_sides_alike() -> None:
    factors = _factors(0)
    first, second = factors[0][20], factors[1][20]
    assert first == pytest.approx(second[::-1], abs=1e-5)
    assert 1 - DEPTH < first[-1] < 1 - 0.7 * DEPTH
    assert np.all(np.diff(first) <= 1e-6)
    # It ends 3 to 6 px from the neighbour.
    assert first[-4] < 0.99
    assert first[-8] > 0.999


def test_darkening_grows_as_objects_approach() -> None:
    darkest = []
    for gap in (12, 6, 4, 2, 0):
        factors = _factors(gap)
        darkest.append(float(factors[0].min()) if factors else 1.0)
    assert darkest[0] == 1
    assert darkest == sorted(darkest, reverse=True)
    assert np.abs(np.diff(darkest)).max() < 0.6 * DEPTH


def test_contacts_of_the_photo_have_their_own_shade() -> None:
    assert not _factors(0, start_gap=0)


def test_an_object_before_another_is_no_contact() -> None:
    assert not _factors(-10)
    assert SHADE.overlap < 10 / 30
