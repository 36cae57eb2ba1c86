"""Straight lines through holes."""

import numpy as np

from physgen.perceive.backends.inpaint_fill import fill


def test_gap_between_planks_continues_through_hole() -> None:
    noise = np.random.default_rng(0).normal(0, 3, (160, 240, 3))
    photo = np.full((160, 240, 3), 150.0) + noise
    photo[74:84] = 50 + noise[74:84]
    rgb = np.clip(photo, 0, 255).astype(np.uint8)
    hole = np.zeros((160, 240), bool)
    hole[40:120, 90:150] = True
    hidden = np.where(hole[..., None], np.uint8(255), rgb)
    filled = fill()(hidden, hole)
    assert np.abs(filled[76:82, 90:150].mean(axis=(0, 2)) - 50).max() < 15
