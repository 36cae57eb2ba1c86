"""Colour gradient of a photo: edge strength, edge direction and noise level."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]

SCALES = (0.7, 1.5)
"""Standard deviations of the two smoothings, px: crisp and soft edges."""


@dataclass(frozen=True, eq=False)
class Gradient:
    """The colour gradient of a photo, in CIELAB units per px."""

    strength: NDArray[np.float32]  # (H, W), never negative
    angle: NDArray[
        np.float32
    ]  # (H, W) rad, the direction in which colour changes fastest, modulo pi
    tensor: NDArray[np.float32]
    """(H, W, 3): strength times 1, cos 2 angle, sin 2 angle; unlike the angle, it may be interpolated."""
    ridge: NDArray[
        np.bool_
    ]  # (H, W): edges thinned to their crest, well above the noise
    noise: float  # The strength that grain and smooth shading alone reach: half of the photo is below it

    def across(self, x: Floats, y: Floats, normal: Floats) -> NDArray[np.float32]:
        """Strength at points x, y (any shape) of edges facing along `normal` (rad, broadcasts); 0 outside."""
        one, cos, sin = np.moveaxis(
            sample(self.tensor, x, y, border=cv2.BORDER_CONSTANT), -1, 0
        )
        strength: NDArray[np.float32] = (
            one + cos * np.cos(2 * normal) + sin * np.sin(2 * normal)
        ) / 2
        return strength

    def support(self, strength: Floats) -> Floats:
        """0..1: how far an edge of this strength stands out of the noise."""
        return strength / (strength + 3 * self.noise + 1)


def sample(
    image: NDArray[np.float32], x: Floats, y: Floats, border: int = cv2.BORDER_REPLICATE
) -> NDArray[np.float32]:
    """Bilinear values of an image (H, W[, C]) at points x, y of any one shape S: S + (C,)."""
    rows = 4096  # cv2.remap takes at most 32,767 rows and columns
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
    """CIELAB (H, W, 3) of an sRGB photo, grain smoothed but edges kept."""
    calm = cv2.bilateralFilter(np.ascontiguousarray(rgb), 5, 18, 2)
    return cv2.cvtColor(calm.astype(np.float32) / 255, cv2.COLOR_RGB2LAB).astype(
        np.float32
    )


def colour_gradient(colour: NDArray[np.float32]) -> Gradient:
    """Di Zenzo's gradient of a CIELAB image (H, W, 3) ("A note on the gradient of a multi-image", 1986),
    the stronger of two scales; a step and a soft edge of the same contrast come out alike."""
    strength = np.full(colour.shape[:2], -1, np.float32)
    angle = np.zeros(colour.shape[:2], np.float32)
    for sigma in SCALES:
        soft = cv2.GaussianBlur(colour, (0, 0), sigma)
        dx = cv2.Sobel(soft, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
        dy = cv2.Sobel(soft, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
        xx, xy, yy = (dx * dx).sum(2), (dx * dy).sum(2), (dy * dy).sum(2)
        largest = (xx + yy + np.sqrt((xx - yy) ** 2 + 4 * xy * xy)) / 2
        here = np.sqrt(largest * sigma)
        angle = np.where(here > strength, 0.5 * np.arctan2(2 * xy, xx - yy), angle)
        strength = np.maximum(here, strength)
    noise = max(0.25, float(np.median(strength)))
    y, x = np.indices(strength.shape, np.float32)
    ahead = sample(strength, x + np.cos(angle), y + np.sin(angle))
    behind = sample(strength, x - np.cos(angle), y - np.sin(angle))
    ridge = (strength >= ahead) & (strength > behind) & (strength > 2 * noise)
    tensor = np.stack(
        [strength, strength * np.cos(2 * angle), strength * np.sin(2 * angle)], -1
    )
    return Gradient(strength, angle, tensor, ridge, noise)
