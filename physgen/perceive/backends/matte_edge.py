"""Backend matte=edge: coverage with a soft border that follows the photo's edges.

Coverage falls from 1 to 0 over two pixels, one half on the mask's border. With contrast, a pixel's colour between the
object's and the background's is its share of the object (Porter and Duff's compositing equation solved for alpha). A
mask that is too large or too small is so for some way along its border: the mean there of these shares moves the
border. Beyond it, a single pixel belongs to the object as its colour says, unless it is dimmed background: that may be
the object's shadow.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from physgen.geometry.shadows import blurred
from physgen.maps import F32
from physgen.perceive.roles import Labels, Mask, Matte, Rgb
from physgen.photometry import decode


@dataclass(frozen=True)
class _Limits:
    """How far the photo moves a border."""

    reach: float = 1.0  # px from one half to 0 or 1
    shift: float = 2.75  # px by which the photo may move the border along some way ...
    unsure: float = 0.5  # ... less those by which shadows and texture pretend to
    single: float = 0.25  # px by which single pixels may then move it; by `shift` outwards, if their colour ...
    dimmed: float = 0.3  # ... differs from dimmed background's, by so much of square roots of linear light
    along: float = 32.0  # px, standard deviation: the way
    doubt: float = 0.1  # trust in the mask's border, beside the colours' 0..1
    gain: float = (
        2.0  # of shares about one half: shadows beside an object reach that seldom
    )
    # difference of square roots of linear light from which colours separate object and background
    contrast: float = 0.08


LIMITS = _Limits()
BLUR_REACH = 4
"""Standard deviations beyond which a blur does not reach visibly."""


def edge() -> Matte:
    """The backend `edge`."""
    return _edge


def _edge(rgb: Rgb, labels: Labels) -> F32:
    inside = labels > 0
    if not inside.any() or inside.all():
        return inside.astype(np.float32)
    x, y, width, height = cv2.boundingRect(inside.astype(np.uint8))
    margin = round(BLUR_REACH * LIMITS.along)
    rows = slice(max(y - margin, 0), y + height + margin)
    columns = slice(max(x - margin, 0), x + width + margin)
    coverage = np.zeros(inside.shape, np.float32)
    coverage[rows, columns] = _coverage(rgb[rows, columns], inside[rows, columns])
    return coverage


def _coverage(rgb: Rgb, inside: Mask) -> F32:
    """(H, W) 0..1 of a photo in which something is `inside` (H, W), and something not."""
    distance = _border_distance(inside)
    mixed, trust, other = _coverage_by_colour(rgb, distance)
    mixed = np.clip((mixed - 0.5) * LIMITS.gain + 0.5, 0, 1)
    distance += _shift(distance, mixed, trust)
    coverage = _ramp(distance)
    out = LIMITS.single + (LIMITS.shift - LIMITS.single) * other * (distance < 0)
    moved = np.clip(mixed, _ramp(distance - LIMITS.single), _ramp(distance + out))
    near = np.abs(distance) < LIMITS.reach + out
    coverage = np.where(near, coverage + trust * (moved - coverage), coverage)
    return np.asarray(
        np.round(coverage * 255) / 255, np.float32
    )  # as stored: 0 here is 0 in coverage.png


def _shift(distance: F32, mixed: F32, trust: F32) -> F32:
    """(H, W) px by which the border lies farther out than the mask says."""
    band = LIMITS.reach + LIMITS.shift
    near = (np.abs(distance) < band).astype(np.float32)
    excess = blurred((mixed - _ramp(distance)) * trust * near, LIMITS.along)
    weight = blurred((trust + np.float32(LIMITS.doubt)) * near, LIMITS.along)
    shift = np.clip(
        2 * band * excess / np.maximum(weight, 1e-6), -LIMITS.shift, LIMITS.shift
    )
    return np.asarray(
        np.sign(shift) * np.maximum(np.abs(shift) - LIMITS.unsure, 0), np.float32
    )


def _ramp(distance: F32) -> F32:
    """Distance to the border, px, positive inside -> coverage: smooth from 0 to 1 over 2 LIMITS.reach."""
    t = np.clip(distance / np.float32(LIMITS.reach), -1, 1)
    return np.asarray(0.5 + 0.75 * t - 0.25 * t**3, np.float32)


def _border_distance(inside: Mask) -> F32:
    """px to the border between the pixels, positive inside, with rounded corners."""
    padded = np.pad(inside, 8, mode="edge")
    within = cv2.distanceTransform(padded.astype(np.uint8), cv2.DIST_L2, 5)
    without = cv2.distanceTransform((~padded).astype(np.uint8), cv2.DIST_L2, 5)
    signed = np.where(padded, within - 0.5, 0.5 - without).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(signed, (0, 0), 0.8)[8:-8, 8:-8], np.float32)


def _coverage_by_colour(rgb: Rgb, distance: F32) -> tuple[F32, F32, F32]:
    """Coverage `(H, W)` by colour, its trust, 0..1, and 0..1 how unlike dimmed background the colour is."""
    colour = np.sqrt(decode(rgb))
    front = _nearby_mean(colour, distance > LIMITS.reach + LIMITS.shift - 1)
    back = _nearby_mean(colour, distance < -(LIMITS.reach + LIMITS.shift + 0.5))
    axis = front - back
    length = np.einsum("ijk,ijk->ij", axis, axis)
    share = np.einsum("ijk,ijk->ij", colour - back, axis) / np.maximum(length, 1e-6)
    trust = np.clip(np.sqrt(length) / LIMITS.contrast - 0.5, 0, 1)
    known = (front.sum(2) > 0) & (back.sum(2) > 0)
    smooth = cv2.GaussianBlur(np.clip(share, 0, 1).astype(np.float32), (0, 0), 0.5)
    dim = np.einsum("ijk,ijk->ij", colour, back) / np.maximum(
        np.einsum("ijk,ijk->ij", back, back), 1e-6
    )
    off = np.square(colour - dim[..., None] * back).sum(2) / LIMITS.dimmed**2
    other = np.where(dim < 1, 1 - np.exp(-off), 1).astype(np.float32)
    return smooth, np.where(known, trust, 0).astype(np.float32), other


def _nearby_mean(colour: F32, known: Mask) -> F32:
    """The mean colour of the known pixels nearby; 0 where there are none within 6 px."""
    weight = known.astype(np.float32)
    total = cv2.GaussianBlur(colour * weight[:, :, None], (13, 13), 2.5)
    count = cv2.GaussianBlur(weight, (13, 13), 2.5)[:, :, None]
    return np.where(count > 1e-4, total / np.maximum(count, 1e-4), 0).astype(np.float32)
