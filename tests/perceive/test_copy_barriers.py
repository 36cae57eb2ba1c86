"""Objects that are not copied into holes, and grain as strong as around the hole."""

import numpy as np
import pytest

from physgen.perceive.inpaint.band_grain import match_grain
from physgen.perceive.inpaint.shift_map import shift_map_fill
from physgen.perceive.segment import copy_barriers


@pytest.fixture
def hole() -> np.ndarray:
    """Return the mask (H, W) of a rectangular hole."""
    mask = np.zeros((120, 160), bool)
    mask[50:80, 60:100] = True
    return mask


def noisy_ground(strength: float) -> np.ndarray:
    """Return a grey photo (H, W, 3) with grey noise of `strength` levels."""
    noise = np.random.default_rng(3).normal(0, strength, (120, 160))
    grey = np.clip(120 + noise, 0, 255).astype(np.float32)
    return np.repeat(grey[..., None], 3, axis=2)


@pytest.mark.parametrize("strength", [3.0, 8.0])
def test_grain_reaches_strength_of_surroundings(strength: float, hole: np.ndarray):
    photo = noisy_ground(strength)
    smooth = np.where(hole[..., None], np.float32(120), photo)
    filled = match_grain(smooth, photo, hole)
    inner = np.s_[56:74, 66:94]
    # Squares above a limit do not count, so some strength is missing.
    assert 0.55 * strength < filled[inner][..., 0].std() < 1.1 * strength
    assert np.array_equal(filled[~hole], photo[~hole])


def test_grain_of_even_ground_adds_nothing(hole: np.ndarray):
    photo = np.full((120, 160, 3), 90, np.float32)
    assert np.array_equal(match_grain(photo, photo, hole), photo)


def test_white_ground_gets_no_grain(hole: np.ndarray):
    photo = noisy_ground(6.0)
    white = np.where(hole[..., None], np.float32(255), photo)
    assert (match_grain(white, photo, hole)[hole] == 255).all()


def test_barriers_are_not_copied(hole: np.ndarray):
    photo = noisy_ground(8.0)
    object_mask = np.zeros((120, 160), bool)
    object_mask[20:95, 104:150] = True
    photo[object_mask] = (250, 40, 40)
    guide = np.where(hole[..., None], np.float32((200, 90, 90)), photo)
    result = shift_map_fill(photo, hole, guide, object_mask)
    redness = result[hole][:, 0] - result[hole][:, 1]
    assert (redness > 150).mean() < 0.02


@pytest.mark.parametrize(("side", "is_barrier"), [("above", True), ("around", False)])
def test_object_around_hole_is_its_ground(
    monkeypatch, side: str, is_barrier: bool, hole: np.ndarray
):
    thing = np.zeros((120, 160), bool)
    if side == "above":
        thing[20:49, 60:80] = True
    else:
        thing[20:110, 30:140] = True
    monkeypatch.setattr(copy_barriers, "_visible_objects", lambda rgb: [thing])
    rgb = np.zeros((120, 160, 3), np.uint8)
    barriers = copy_barriers.find_copy_barriers(rgb, hole)
    assert np.array_equal(
        barriers, thing & ~hole if is_barrier else np.zeros_like(hole)
    )
