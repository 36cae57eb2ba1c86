"""Drawings of flat shapes on plain ground, as researchers draw puzzles of physics."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

SIDES = (256, 512)
"""Smallest and largest side of a drawing, px."""
MOST_SHAPES = 8
RADII = (0.03, 0.16)
"""Half the size of a shape, share of the longer side."""
LEAST_CONTRAST = 60
"""Sum of the differences of three channels between a shape and the ground."""
NOISE = 12.0
"""Largest standard deviation of noise, of 255."""
TRIES = 30
"""Places tried for a shape before it is left out."""


def flat_drawing(seed: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return a drawing (H, W, 3) in BGR and its label map (H, W)."""
    rng = np.random.default_rng(seed)
    height, width = (int(side) for side in rng.integers(*SIDES, 2))
    ground = _ground_colour(rng)
    bgr = np.full((height, width, 3), ground, np.uint8)
    if rng.random() < 0.4:
        level = int(rng.uniform(0.6, 0.95) * height)
        bgr[level:] = _ground_colour(rng)
    labels = np.zeros((height, width), np.uint8)
    for label in range(1, int(rng.integers(1, MOST_SHAPES + 1)) + 1):
        _add_shape(bgr, labels, label, rng)
    if rng.random() < 0.4:
        noise = rng.normal(0, rng.uniform(2, NOISE), bgr.shape)
        bgr = (bgr + noise).clip(0, 255).astype(np.uint8)
    return bgr, labels


def _ground_colour(rng: np.random.Generator) -> NDArray[np.uint8]:
    kind = rng.random()
    if kind < 0.4:
        return np.full(3, rng.integers(225, 256), np.uint8)
    if kind < 0.5:
        return np.full(3, rng.integers(0, 40), np.uint8)
    return rng.integers(0, 256, 3).astype(np.uint8)


def _add_shape(
    bgr: NDArray[np.uint8],
    labels: NDArray[np.uint8],
    label: int,
    rng: np.random.Generator,
) -> None:
    """Draw one shape where no other shape is."""
    height, width = labels.shape
    for _ in range(TRIES):
        radius = rng.uniform(*RADII) * max(height, width)
        centre = rng.uniform(0, 1, 2) * (width, height)
        mask = np.zeros((height, width), np.uint8)
        cv2.fillPoly(mask, [_outline(centre, radius, rng)], 1, shift=3)
        if mask.sum() >= 60 and not labels[mask > 0].any():
            break
    else:
        return
    under = bgr[mask > 0].mean(axis=0)
    colour = rng.integers(0, 256, 3)
    while np.abs(colour - under).sum() < LEAST_CONTRAST:
        colour = rng.integers(0, 256, 3)
    bgr[mask > 0] = colour
    labels[mask > 0] = label
    if rng.random() < 0.25:
        # Two tones: the lower half in another colour, or an outline.
        lower = (mask > 0) & (np.arange(height)[:, None] > centre[1])
        bgr[lower] = rng.integers(0, 256, 3)
    elif rng.random() < 0.3:
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(bgr, contours, -1, (0, 0, 0), int(rng.integers(1, 4)))


def _outline(
    centre: NDArray[np.float64], radius: float, rng: np.random.Generator
) -> NDArray[np.int32]:
    """Return a circle, an ellipse, a box, a triangle or another polygon, 1/8 px."""
    kind = rng.choice(["circle", "ellipse", "box", "triangle", "polygon"])
    corners = {"box": 4, "triangle": 3, "polygon": int(rng.integers(5, 9))}
    count = corners.get(str(kind), 64)
    angles = np.arange(count) * 2 * np.pi / count + np.pi / 4
    points = np.stack([np.cos(angles), np.sin(angles)], axis=1) * radius
    if kind in ("ellipse", "box"):
        points[:, 1] *= rng.uniform(0.25, 1)
    turn = rng.uniform(0, 2 * np.pi) if rng.random() < 0.6 else 0.0
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    points = points @ rotation.T + centre
    return np.round(points * 8).astype(np.int32)
