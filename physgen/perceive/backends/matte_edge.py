"""Backend matte=edge: coverage with a soft border that follows the photo's edges.

Coverage falls from 1 to 0 over two pixels and is one half on the mask's border. If
object and background differ in colour, the colour of a border pixel tells its share of
the object (Porter and Duff's compositing equation solved for alpha). Masks are usually
too large or too small along whole stretches of their border, so the mean share of a
stretch moves the border. After that, a single pixel is decided by its own colour,
unless it looks like dimmed background, which may be the object's shadow.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from physgen.geometry.shadows import blurred
from physgen.maps import F32
from physgen.perceive.roles import Labels, Mask, Matte, Rgb
from physgen.photometry import channel_sum, decode


@dataclass(frozen=True)
class _Limits:
    """Limits of the changes that the photo makes to a mask's border."""

    # px from coverage one half to coverage 0 or 1.
    reach: float = 1.0
    # px by which the mean share of a stretch may move the border ...
    shift: float = 2.75
    # ... less this part, in px, which shadows and texture can simulate.
    uncertain_width: float = 0.5
    # px by which a single pixel may then move the border. Outwards the limit is `shift`
    # if its colour differs from dimmed background ...
    single: float = 0.25
    # ... by this difference of square roots of linear light.
    light_difference: float = 0.3
    # px: standard deviation of the weights along a stretch.
    stretch: float = 32.0
    # Weight of the mask's own border beside the trust in colours, 0..1.
    doubt: float = 0.1
    # Contrast of shares about one half: a shadow beside an object rarely exceeds one
    # half.
    gain: float = 2.0
    # Difference of square roots of linear light that separates object and background.
    contrast: float = 0.08


LIMITS = _Limits()
BLUR_REACH = 4
"""Standard deviations beyond which a Gaussian blur has no visible effect."""


def edge() -> Matte:
    """Return the backend `edge`."""
    return _edge


def _edge(rgb: Rgb, labels: Labels) -> F32:
    """Return the coverage (H, W) float32 of all objects, 0..1."""
    inside = labels > 0
    if not inside.any() or inside.all():
        return inside.astype(np.float32)
    x, y, width, height = cv2.boundingRect(inside.astype(np.uint8))
    # Outside this margin the blurred shift of the border is zero.
    margin = round(BLUR_REACH * LIMITS.stretch)
    rows = slice(max(y - margin, 0), y + height + margin)
    columns = slice(max(x - margin, 0), x + width + margin)
    coverage = np.zeros(inside.shape, np.float32)
    coverage[rows, columns] = _coverage(rgb[rows, columns], inside[rows, columns])
    return coverage


def _coverage(rgb: Rgb, inside: Mask) -> F32:
    """Return the coverage (H, W), 0..1, of a mask that is not empty and not full."""
    distance = _border_distance(inside)
    share, trust, other = _coverage_by_colour(rgb, distance)
    share = np.clip((share - 0.5) * LIMITS.gain + 0.5, 0, 1)
    # A mean over a stretch first moves the whole border ...
    distance += _shift(distance, share, trust)
    coverage = _ramp(distance)
    # ... then single pixels move by their own colour, within tight limits.
    out = LIMITS.single + (LIMITS.shift - LIMITS.single) * other * (distance < 0)
    limited_share = np.clip(
        share, _ramp(distance - LIMITS.single), _ramp(distance + out)
    )
    border_band = np.abs(distance) < LIMITS.reach + out
    coverage = np.where(
        border_band, coverage + trust * (limited_share - coverage), coverage
    )
    # Rounded as coverage.png stores it, so that 0 here is 0 in the file.
    return np.asarray(np.round(coverage * 255) / 255, np.float32)


def _shift(distance: F32, mixture: F32, trust: F32) -> F32:
    """Return by how many px (H, W) the border lies outside the mask's border."""
    band = LIMITS.reach + LIMITS.shift
    border_band = (np.abs(distance) < band).astype(np.float32)
    excess = blurred((mixture - _ramp(distance)) * trust * border_band, LIMITS.stretch)
    weight = blurred((trust + np.float32(LIMITS.doubt)) * border_band, LIMITS.stretch)
    # In a symmetric band of half width `band`, moving the border by d changes the mean
    # coverage by d / (2 band).
    shift = np.clip(
        2 * band * excess / np.maximum(weight, 1e-6), -LIMITS.shift, LIMITS.shift
    )
    return np.asarray(
        np.sign(shift) * np.maximum(np.abs(shift) - LIMITS.uncertain_width, 0),
        np.float32,
    )


def _ramp(distance: F32) -> F32:
    """Return the coverage at a distance from the border, px, positive inside.

    A cubic rises smoothly from 0 to 1 over 2 `LIMITS.reach`.
    """
    t = np.clip(distance / np.float32(LIMITS.reach), -1, 1)
    return np.asarray(0.5 + 0.75 * t - 0.25 * t**3, np.float32)


def _border_distance(inside: Mask) -> F32:
    """Return the distance to the mask's border (H, W) px, positive inside.

    The border runs between pixels; a slight blur rounds its staircase.
    """
    padded_mask = np.pad(inside, 8, mode="edge")
    inner_distance = cv2.distanceTransform(padded_mask.astype(np.uint8), cv2.DIST_L2, 5)
    outer_distance = cv2.distanceTransform(
        (~padded_mask).astype(np.uint8), cv2.DIST_L2, 5
    )
    signed_distance = np.where(
        padded_mask, inner_distance - 0.5, 0.5 - outer_distance
    ).astype(np.float32)
    return np.asarray(
        cv2.GaussianBlur(signed_distance, (0, 0), 0.8)[8:-8, 8:-8], np.float32
    )


def _coverage_by_colour(rgb: Rgb, distance: F32) -> tuple[F32, F32, F32]:
    """Return three maps (H, W) in 0..1: coverage by colour, trust in it, and the degree
    to which the colour differs from dimmed background.
    """
    # Square roots of linear light are roughly uniform to the eye.
    colour = np.sqrt(decode(rgb))
    # Object and background colours come from pixels far enough from the border to be
    # pure.
    front = _nearby_mean(colour, distance > LIMITS.reach + LIMITS.shift - 1)
    back = _nearby_mean(colour, distance < -(LIMITS.reach + LIMITS.shift + 0.5))
    axis = front - back
    length = np.einsum("ijk,ijk->ij", axis, axis)
    # Project each colour on the line from background to object colour.
    share = np.einsum("ijk,ijk->ij", colour - back, axis) / np.maximum(length, 1e-6)
    trust = np.clip(np.sqrt(length) / LIMITS.contrast - 0.5, 0, 1)
    has_both_sides = (channel_sum(front) > 0) & (channel_sum(back) > 0)
    smooth_share = cv2.GaussianBlur(
        np.clip(share, 0, 1).astype(np.float32), (0, 0), 0.5
    )
    # A shadow only scales the background's colour; the residual after the best scaling
    # shows a different surface.
    brightness_ratio = np.einsum("ijk,ijk->ij", colour, back) / np.maximum(
        np.einsum("ijk,ijk->ij", back, back), 1e-6
    )
    colour_difference = (
        np.square(colour - brightness_ratio[..., None] * back).sum(2)
        / LIMITS.light_difference**2
    )
    foreign_colour = np.where(
        brightness_ratio < 1, 1 - np.exp(-colour_difference), 1
    ).astype(np.float32)
    return (
        smooth_share,
        np.where(has_both_sides, trust, 0).astype(np.float32),
        foreign_colour,
    )


def _nearby_mean(colour: F32, mask: Mask) -> F32:
    """Return the mean colour of the known pixels within 6 px (H, W, 3), 0 if none is
    known.
    """
    weight = mask.astype(np.float32)
    total = cv2.GaussianBlur(colour * weight[:, :, None], (13, 13), 2.5)
    count = cv2.GaussianBlur(weight, (13, 13), 2.5)[:, :, None]
    return np.where(count > 1e-4, total / np.maximum(count, 1e-4), 0).astype(np.float32)
