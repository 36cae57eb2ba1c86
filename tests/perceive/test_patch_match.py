from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from physgen import registry
from physgen.perceive.inpaint.patch_match import thin_out

MIB = 2**20


@pytest.mark.slow
@pytest.mark.parametrize(("height", "width"), [(20, 3000), (90, 1600), (1600, 90)])
def test_long_photos_take_little_memory(height: int, width: int) -> None:
    """A ramp with a stripe along it and grain: the fill is like what was there."""
    y, x = np.mgrid[:height, :width]
    along, across, long = (x, y, height) if width > height else (y, x, width)
    grain = np.random.default_rng(0).normal(0, 3, (height, width, 1))
    truth = (
        80 + 60 * along[..., None] / max(height, width) + 40 * (across < long // 3)[..., None] * [1, 0.5, 0]
    )
    photo = np.clip(truth + grain, 0, 255).astype(np.uint8)
    hole = (abs(along - 700) < 40) & (across > long // 4) & (across < 3 * long // 4)
    photo[hole] = 0
    inpaint = registry.make("inpaint")
    tracemalloc.start()
    filled = inpaint(photo, hole)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 300 * MIB
    assert np.array_equal(filled[~hole], photo[~hole])
    assert abs(filled[hole] - truth[hole]).mean() < 12


def test_fewer_places_are_spread_evenly() -> None:
    places = np.argwhere(np.ones((60, 200), bool))
    some = thin_out(places, 1000)
    assert 990 <= len(some) <= 1010
    count, _, _ = np.histogram2d(some[:, 0], some[:, 1], [3, 10])
    assert count.min() > 0.6 * count.mean()
    assert np.array_equal(thin_out(places, 12000), places)
