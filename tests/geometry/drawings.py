"""Masks and outlines that the tests draw, with exact ground truth, and measures of fitted shapes."""

from __future__ import annotations

import cv2
import numpy as np

from physgen.geometry.polygon import rotation


def grid(size):
    rows, columns = np.mgrid[:size, :size]
    return np.stack([columns, rows], axis=-1).astype(float)


def disc_mask(size, center, radius):
    return np.hypot(*np.moveaxis(grid(size) - center, -1, 0)) < radius


def box_mask(size, center, half, angle=0.0):
    local = (grid(size) - center) @ rotation(angle)
    return (np.abs(local) < half).all(axis=-1)


def blob_labels(seed, size=48, count=1, smooth=3.0):
    """A random map of `count` labels and background, ragged, with holes and several pieces a label."""
    noise = np.random.default_rng(seed).normal(size=(count + 1, size, size))
    smoothed = np.stack([cv2.GaussianBlur(plane, (0, 0), smooth) for plane in noise])
    return np.argmax(smoothed, axis=0).astype(np.int64)


def dense(ring, step=0.1):
    """Points `(n, 2)` at most `step` px apart along a closed line."""
    ends = np.roll(ring, -1, axis=0)
    parts = []
    for a, b in zip(ring, ends, strict=True):
        count = max(int(np.ceil(np.hypot(*(b - a)) / step)), 1)
        parts.append(a + (b - a) * (np.arange(count) / count)[:, None])
    return np.concatenate(parts)


def iou(covered, mask):
    return float(np.minimum(covered, mask).sum() / np.maximum(covered, mask).sum())


def box(x0, y0, x1, y1):
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=float)


def circle(radius, count=20000):
    angles = np.arange(count) * 2 * np.pi / count
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


L_SHAPE = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 5], [0, 5]], dtype=float)
U_SHAPE = np.array(
    [[0, 0], [6, 0], [6, 4], [5, 4], [5, 1], [1, 1], [1, 4], [0, 4]], dtype=float
)
