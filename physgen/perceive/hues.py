"""Linear light -> kinds of surface by their hue, so that like is compared with like."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]

DARKEST = 2e-3
"""Linear light added before a logarithm or a ratio: black has neither."""
HUES = 6
"""Kinds of surface that are told apart."""


def hues(linear: F32, plain: F32, most: int) -> list[F32]:
    """(h, w) 0..1 a kind of surface: which pixels of `linear` (h, w, 3) belong to it.

    Kinds are learned where `plain` (h, w) is not 0, from `most` pixels there, about.
    """
    grey = linear.sum(axis=2) + 3 * DARKEST
    hue = cv2.GaussianBlur(np.dstack([(linear[..., c] + DARKEST) / grey for c in (0, 2)]), (0, 0), 2)
    sample = np.ascontiguousarray(hue[plain > 0][:: max(1, int(plain.sum()) // most)], np.float32)
    if len(sample) < HUES:
        return [np.ones(plain.shape, np.float32)]
    cv2.setRNGSeed(1)
    _, names, centers = cv2.kmeans(
        sample, HUES, np.zeros((len(sample), 1), np.int32), (3, 20, 1e-3), 1, cv2.KMEANS_PP_CENTERS
    )
    width = max(0.03, 2 * float(np.abs(sample - centers[names.ravel()]).mean()))
    return [np.exp(-((hue - c) ** 2).sum(-1) / (2 * width * width)).astype(np.float32) for c in centers]
