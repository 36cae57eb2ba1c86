"""Reduced photos and maps for stages whose results need no full resolution."""

from __future__ import annotations

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.roles import Labels, Mask, Rgb

WORKING_SIDE = 640
"""px: longer side of the reduced photo."""


def working_size(shape: tuple[int, ...]) -> tuple[int, int] | None:
    """Return width and height of the reduced photo; None if the photo is small."""
    height, width = shape[:2]
    scale = max(height, width) / WORKING_SIDE
    if scale <= 1:
        return None
    return max(1, round(width / scale)), max(1, round(height / scale))


def reduce_photo_maps(
    rgb: Rgb, labels: Labels, normals: F32
) -> tuple[Rgb, Labels, F32]:
    """Return a photo (H, W, 3), its labels (H, W) and normals (H, W, 3), reduced."""
    size = working_size(labels.shape)
    if size is None:
        return rgb, labels, normals
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    ids = cv2.resize(labels, size, interpolation=cv2.INTER_NEAREST_EXACT)
    means = cv2.resize(normals, size, interpolation=cv2.INTER_AREA)
    lengths = np.linalg.norm(means, axis=2, keepdims=True)
    return (
        np.asarray(small, np.uint8),
        np.asarray(ids, np.uint16),
        np.asarray(means / np.maximum(lengths, 1e-6), np.float32),
    )


def reduce_known(picture: F32, hole: Mask) -> tuple[F32, Mask] | None:
    """Return the mean of the known pixels of a picture (H, W, C), and the unknown
    pixels.

    Returns None if the picture is small.
    """
    size = working_size(hole.shape)
    if size is None:
        return None
    weights = (~hole).astype(np.float32)
    share = cv2.resize(weights, size, interpolation=cv2.INTER_AREA)
    # Average only known pixels: divide the sum by the known share.
    sums = cv2.resize(picture * weights[..., None], size, interpolation=cv2.INTER_AREA)
    sums = sums.reshape(*share.shape, -1)
    means = sums / np.maximum(share, 1e-6)[..., None]
    return np.asarray(means, np.float32), np.asarray(share < 1e-3)


def enlarge(picture: F32, shape: tuple[int, ...]) -> F32:
    """Return a reduced picture (h, w, C) at the size of `shape` (H, W)."""
    large = cv2.resize(picture, shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(large.reshape(shape[0], shape[1], -1), np.float32)
