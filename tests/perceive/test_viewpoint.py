"""The view that a photo's background tells: in any format, and the same in a mirror."""

from __future__ import annotations

import numpy as np
import pytest

from physgen.perceive.support.viewpoint import guess_view
from physgen.scene.scene import View


def row_of_boxes(height: int, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ten boxes that stand on a floor before a wall, and normals that say so."""
    rgb = np.full((height, width, 3), (90, 120, 160), np.uint8)
    floor = 7 * height // 10
    rgb[floor:] = (150, 100, 60)
    labels = np.zeros((height, width), np.uint16)
    for k in range(10):
        x = (2 * k + 1) * width // 21
        labels[height // 3 : floor + 1, x : x + max(1, width // 30)] = k + 1
    rgb[labels > 0] = (200, 60, 50)
    normals = np.zeros((height, width, 3), np.float32)
    normals[:floor, :, 2] = 1
    normals[floor:, :, 1] = -1
    return rgb, labels, normals


@pytest.mark.parametrize(
    "size",
    [(20, 3000), (3000, 20), (8, 400), (400, 8), (192, 256)],
    ids=lambda size: f"{size[1]}x{size[0]}",
)
def test_photos_of_any_format_have_a_view(size):
    rgb, labels, normals = row_of_boxes(*size)
    view, sure, reason = guess_view(rgb, labels, normals, 0, 10)
    assert view is View.SIDE
    assert 0.5 <= sure <= 0.98
    assert reason


def test_a_background_hardly_seen_tells_nothing_wrong():
    rgb, labels, normals = row_of_boxes(20, 3000)
    small = normals[
        ::3, ::12
    ]  # 7 rows: things and what is next to them cover nearly all
    _, sure, _ = guess_view(rgb, labels, np.ascontiguousarray(small), 0, 10)
    assert 0.5 <= sure <= 0.98
    for rows in (1, 2, 3):
        _, sure, _ = guess_view(rgb, labels, normals[:rows], 0, 10)
        assert 0.5 <= sure <= 0.98
