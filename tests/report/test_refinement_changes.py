"""What refinement changed, where it is known: figures to the last digit."""

from __future__ import annotations

import numpy as np
from pytest import approx

from physgen.report.refinement import NEAR, RefinementChanges

W, H = 300, 170
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


def test_known_changes_give_known_figures() -> None:
    near = NEAR * np.hypot(W, H)
    places = away()
    refined = grey(100)
    refined[places == 0] += 10
    refined[(places > 0) & (places <= near)] -= 20
    refined[places > near] += 3
    changes = RefinementChanges()
    for _ in range(2):
        changes.add(grey(100), refined, square())
    found = changes.figures()
    assert (found["objects"], found["near"], found["elsewhere"]) == (10, 20, 3)
    assert found["all"] == found["first"] == approx(np.abs(refined.astype(int) - 100).mean(), abs=1e-4)
    assert found["near_px"] == approx(near, abs=1e-4)
