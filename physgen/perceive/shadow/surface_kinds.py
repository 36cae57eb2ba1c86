"""Means over surfaces of the same kind nearby, and blurs of two widths."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.roles import Mask
from physgen.perceive.shadow.silhouettes import DARKEST
from physgen.photometry import channel_sum

Reaches = Sequence[tuple[float, float, float]]
"""px, horizontal and vertical, over which similar surfaces are averaged, and their
weights.
"""
# Number of surface kinds.
HUES = 6


def hue_weights(linear: F32, plain: F32 | Mask, most: int) -> list[F32]:
    """Return one weight map (h, w), 0..1, per kind of surface in `linear` (h, w, 3), by
    hue.

    Kinds are learnt from about `most` pixels with `plain` (h, w) above 0.
    """
    grey = channel_sum(linear) + 3 * DARKEST
    hue = cv2.GaussianBlur(
        np.dstack([(linear[..., c] + DARKEST) / grey for c in (0, 2)]), (0, 0), 2
    )
    sample = np.ascontiguousarray(
        hue[plain > 0][:: max(1, int(plain.sum()) // most)], np.float32
    )
    if len(sample) < HUES:
        return [np.ones(plain.shape, np.float32)]
    cv2.setRNGSeed(1)
    start = np.zeros((len(sample), 1), np.int32)
    _, names, centers = cv2.kmeans(
        sample, HUES, start, (3, 20, 1e-3), 1, cv2.KMEANS_PP_CENTERS
    )
    width = max(0.03, 2 * float(np.abs(sample - centers[names.ravel()]).mean()))
    return [
        np.exp(-channel_sum((hue - c) ** 2) / (2 * width * width)).astype(np.float32)
        for c in centers
    ]


def blur_wide(picture: F32, across: float, down: float) -> F32:
    """Return a Gaussian blur of two widths, px; wide blurs use a coarser grid."""
    h, w = picture.shape
    right = max(1, min(int(across / 3), w // 8))
    lower = max(1, min(int(down / 3), h // 8))
    small = picture
    if right > 1 or lower > 1:
        size = (-(-w // right), -(-h // lower))
        small = np.asarray(
            cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.float32
        )
    x = max(across / right, 0.3)
    y = max(down / lower, 0.3)
    blurred_picture = cv2.GaussianBlur(
        small, (0, 0), sigmaX=x, sigmaY=y, borderType=cv2.BORDER_REFLECT
    )
    if blurred_picture.shape != picture.shape:
        blurred_picture = cv2.resize(
            blurred_picture, (w, h), interpolation=cv2.INTER_LINEAR
        )
    return np.asarray(blurred_picture, np.float32)


def mean_of_kind(
    values: F32,
    plain: F32,
    kinds: Sequence[F32],
    reaches: Reaches,
    *,
    tiny: float,
    prior: tuple[float, float] = (0.0, 1e-9),
    blur: Callable[[F32, float, float], F32] = blur_wide,
) -> F32:
    """Return the mean (h, w) of `values` on `plain` surfaces of each pixel's kind
    nearby.

    `tiny` is the weight of a pixel's own value if no such surface is near; `prior` is
    the same, with a weight, for pixels of no kind.
    """
    if prior[0]:
        result = np.float32(prior[0]) * values
    else:
        result = np.zeros(values.shape, np.float32)
    total = np.full(values.shape, prior[1], np.float32)
    for kind in kinds:
        sums = tiny * values
        weights = np.full(values.shape, tiny, np.float32)
        weight = plain * kind
        for width, down, gain in reaches:
            sums = sums + gain * blur(values * weight, width, down)
            weights = weights + gain * blur(weight, width, down)
        result = result + kind * sums / weights
        total = total + kind
    return np.asarray(result / total, np.float32)


def local_mean(values: F32, weight: F32, across: float, down: float) -> F32:
    """Return the local mean of known values; `values` are 0 at unknown pixels."""
    weights = blur_wide(weight, across, max(down, 0.7))
    return np.asarray(
        blur_wide(values, across, max(down, 0.7)) / np.maximum(weights, 1e-3),
        np.float32,
    )
