from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from physgen import registry

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
