from __future__ import annotations

import numpy as np

from physgen import registry
from physgen.perceive.shadow.shadow_removal import refill_background

rng = np.random.default_rng(0)
y, x = np.mgrid[:120, :200]
FLOOR = np.clip(
    np.where((y < 60)[..., None], [150, 120, 90], [200, 180, 160]) + rng.normal(0, 3, (120, 200, 1)), 0, 255
)
FLOOR = FLOOR.astype(np.uint8)
LEFT, RIGHT = np.hypot(x - 50, y - 70) < 14, np.hypot(x - 150, y - 70) < 14
SHADOW = (np.hypot((x - 172) / 2, y - 84) < 6) & ~RIGHT


def never(*_: object) -> None:
    raise AssertionError("nothing is to be filled")


def test_where_nothing_was_lifted_the_first_fill_stays() -> None:
    inpaint = registry.make("inpaint")
    coverage = LEFT.astype(np.float32)
    photo = np.where(LEFT[..., None], np.uint8(20), FLOOR)
    background = inpaint(photo, LEFT)
    assert np.array_equal(refill_background(background, background, coverage, never), background)  # type: ignore[arg-type]


def test_only_the_fill_near_a_lifted_shadow_changes() -> None:
    """Two balls, one with a shadow: behind the other nothing changes, and behind this one no shadow is left."""
    inpaint = registry.make("inpaint")
    both = LEFT | RIGHT
    coverage = both.astype(np.float32)
    dark = np.where(SHADOW[..., None], FLOOR // 3, FLOOR)
    background = inpaint(np.where(both[..., None], np.uint8(20), dark), both)
    lifted = np.where(SHADOW[..., None], FLOOR, background)
    clean = refill_background(lifted, background, coverage, inpaint)
    assert np.array_equal(clean[LEFT], background[LEFT])
    before, after = (abs(p[RIGHT].astype(float) - FLOOR[RIGHT]).mean() for p in (background, clean))
    assert after <= before
    assert after < 8
