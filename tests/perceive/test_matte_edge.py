"""Coverage of a drawn disc, from masks that fit it, are too large or too small."""

from __future__ import annotations

import numpy as np
import pytest

from physgen.perceive.backends.matte_edge import edge
from physgen.photometry import encode_u8

SIZE, RADIUS = 120, 30.0
Y, X = np.mgrid[:SIZE, :SIZE].astype(np.float32)
AWAY = np.hypot(X - 60, Y - 60) - RADIUS
TRUE = np.clip(0.5 - AWAY, 0, 1)


def photo(shadow: float) -> np.ndarray:
    """A dark stone on bright ice, which darkens towards it."""
    ice = 0.7 * (1 - shadow * np.exp(-np.maximum(AWAY, 0) / 3))
    grain = 1 + 0.03 * np.random.default_rng(0).standard_normal(AWAY.shape)
    return encode_u8(
        np.repeat(
            (TRUE * 0.05 + (1 - TRUE) * ice * grain)[..., None], 3, axis=2
        ).astype(np.float32)
    )


def error(shadow: float, off: float) -> float:
    """px of the border by which coverage is wrong, for a mask that is larger by `off` px."""
    coverage = edge()(photo(shadow), (off >= AWAY).astype(np.uint16))
    return float(np.abs(coverage - TRUE).sum() / (2 * np.pi * RADIUS))


def test_a_contact_shadow_is_no_part_of_the_object() -> None:
    assert error(shadow=0.6, off=0) < 0.3


@pytest.mark.parametrize("off", [-2, -1, 1, 2])
def test_a_mask_that_is_off_all_around_is_moved(off: float) -> None:
    assert error(shadow=0.0, off=off) < 0.5 * abs(off)


def test_a_corner_that_the_mask_rounds_off_is_part_of_a_bright_box() -> None:
    box = np.maximum(np.abs(X - 60), np.abs(Y - 60)) < 30
    round_box = (
        np.hypot(np.maximum(np.abs(X - 60) - 24, 0), np.maximum(np.abs(Y - 60) - 24, 0))
        < 6
    )
    picture = encode_u8(
        np.where(box[..., None], np.float32(0.7), np.float32(0.05))
        * np.ones(3, np.float32)
    )
    coverage = edge()(picture, round_box.astype(np.uint16))
    corners = box & ~round_box
    assert coverage[corners].mean() > 0.6
