"""Colour gradient of a photo: edge strength, edge direction and noise level."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]

SCALES = (0.7, 1.5)
"""Standard deviations of both blurs, px: for sharp and for soft edges."""


@dataclass(frozen=True, eq=False)
class Gradient:
    """The colour gradient of a photo, in CIELAB units per px."""

    # (H, W), never negative.
    strength: NDArray[np.float32]
    # (H, W) rad: direction of the largest change of colour, modulo pi.
    angle: NDArray[np.float32]
    tensor: NDArray[np.float32]
    """(H, W, 3): strength times 1, cos 2 angle, sin 2 angle; unlike the angle, it can
    be interpolated.
    """
    # (H, W): edges thinned to their crest, well above the noise.
    ridge: NDArray[np.bool_]
    # Median strength: that of grain and smooth shading.
    noise: float

    def measure_across(
        self, x: Floats, y: Floats, normal: Floats
    ) -> NDArray[np.float32]:
        """Return the strength of edges with the normal `normal` (rad) at points x, y, 0
        outside.

        x and y have any shape; `normal` is broadcast.
        """
        total, cosine, sine = np.moveaxis(
            sample(self.tensor, x, y, border=cv2.BORDER_CONSTANT), -1, 0
        )
        strength: NDArray[np.float32] = (
            total + cosine * np.cos(2 * normal) + sine * np.sin(2 * normal)
        ) / 2
        return strength

    def support(self, strength: Floats) -> Floats:
        """Return the significance 0..1 of an edge of this strength over the noise."""
        return strength / (strength + 3 * self.noise + 1)


def sample(
    image: NDArray[np.float32], x: Floats, y: Floats, border: int = cv2.BORDER_REPLICATE
) -> NDArray[np.float32]:
    """Return bilinear values of an image (H, W[, C]) at points x, y.

    x and y have one shape S; the result has the shape S + (C,).
    """
    # cv2.remap accepts at most 32,767 rows and columns: fold the points.
    rows = 4096
    columns = x.reshape(-1).size // rows + 1
    points = np.zeros((2, rows * columns), np.float32)
    points[0, : x.size], points[1, : x.size] = x.ravel(), y.ravel()
    grid = points.reshape(2, rows, columns)
    values = cv2.remap(
        image, grid[0], grid[1], cv2.INTER_LINEAR, borderMode=border, borderValue=0
    )
    return (
        values.reshape(rows * columns, -1)[: x.size]
        .reshape(x.shape + image.shape[2:])
        .astype(np.float32)
    )


def smoothed_lab(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return CIELAB (H, W, 3) of an sRGB photo with smoothed grain and preserved
    edges.
    """
    filter_result = cv2.bilateralFilter(np.ascontiguousarray(rgb), 5, 18, 2)
    return cv2.cvtColor(
        filter_result.astype(np.float32) / 255, cv2.COLOR_RGB2LAB
    ).astype(np.float32)


def colour_gradient(colour: NDArray[np.float32]) -> Gradient:
    """Return Di Zenzo's gradient of a CIELAB image (H, W, 3).

    See "A note on the gradient of a multi-image", 1986. The stronger of two scales
    counts, so that a step and a soft edge of the same contrast are equal.
    """
    strength = np.full(colour.shape[:2], -1, np.float32)
    angle = np.zeros(colour.shape[:2], np.float32)
    for sigma in SCALES:
        scale_strength, scale_angle = _measure_gradient(colour, sigma)
        angle = np.where(scale_strength > strength, scale_angle, angle)
        strength = np.maximum(scale_strength, strength)
    noise = max(0.25, float(np.median(strength)))
    y, x = np.indices(strength.shape, np.float32)
    forward = sample(strength, x + np.cos(angle), y + np.sin(angle))
    backward = sample(strength, x - np.cos(angle), y - np.sin(angle))
    # Keep only maxima along the gradient's direction.
    ridge = (strength >= forward) & (strength > backward) & (strength > 2 * noise)
    tensor = np.stack(
        [strength, strength * np.cos(2 * angle), strength * np.sin(2 * angle)], -1
    )
    return Gradient(strength, angle, tensor, ridge, noise)


def _measure_gradient(
    colour: NDArray[np.float32], sigma: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return strength and angle (H, W) of the gradient at one scale, px."""
    blurred_colour = cv2.GaussianBlur(colour, (0, 0), sigma)
    dx = cv2.Sobel(blurred_colour, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    dy = cv2.Sobel(blurred_colour, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
    xx = (dx * dx).sum(2)
    xy = (dx * dy).sum(2)
    yy = (dy * dy).sum(2)
    largest = (xx + yy + np.sqrt((xx - yy) ** 2 + 4 * xy * xy)) / 2
    return np.sqrt(largest * sigma), 0.5 * np.arctan2(2 * xy, xx - yy)
