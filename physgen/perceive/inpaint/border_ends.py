"""Ends of edges at the border of a hole: their places, directions and colours."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.inpaint.poisson import dilate
from physgen.perceive.roles import Mask
from physgen.photometry import channel_sum

F64 = NDArray[np.float64]

# px: width of the strip continued on each side of an edge.
STRIP = 12
# px: width of the averaged colours on each side of an edge.
SIDE = 7
# px: distance of the detected edges from the hole.
OFFSET = 5
# Least cosine of the angle between an edge and the way into the hole.
LEAST_SLANT = 0.3
# Least number of known pixels on each side of an edge.
LEAST_SAMPLES = 3
# Points of the contour on each side of an edge, among which it is the strongest.
PEAK_REACH = 6
# Least contrast of an edge, levels: length of the colour difference of its sides.
CONTRAST = 22.0
# Least coherence of the structure tensor at an edge with a direction.
COHERENCE = 0.75


@dataclass(frozen=True)
class BorderEnd:
    """The end of an edge at the border of a hole."""

    # Position along the contour.
    order: int
    # x, y.
    place: F64
    # Unit vector into the hole.
    direction: F64
    # Mean colour to the left of `direction` (y down: the side of (ty, -tx)).
    left: F64
    right: F64
    contrast: float
    # (2 STRIP + 1, 3): colours across the edge, left to right; NaN if hidden.
    profile: F64


@dataclass(frozen=True)
class KnownSurroundings:
    """Colours around the hole and the structure tensor of their gradients (xx,
    xy, yy).
    """

    picture: F32
    blocked_mask: Mask
    tensor: tuple[F32, F32, F32]

    @classmethod
    def measure(cls, picture: F32, blocked: Mask) -> KnownSurroundings:
        """Return the surroundings in `picture` (H, W, 3), unknown in `blocked`
        (H, W).
        """
        blurred_picture = cv2.GaussianBlur(picture, (0, 0), 1)
        known_weights = (~dilate(blocked, 1)).astype(np.float32)[:, :, None]
        gx, gy = (
            cv2.Sobel(blurred_picture, cv2.CV_32F, *d, ksize=3) / 8 * known_weights
            for d in ((1, 0), (0, 1))
        )
        xx, xy, yy = (
            np.asarray(cv2.GaussianBlur(channel_sum(a * b), (0, 0), 3.5), np.float32)
            for a, b in ((gx, gx), (gx, gy), (gy, gy))
        )
        return cls(np.asarray(blurred_picture, np.float32), blocked, (xx, xy, yy))


@dataclass(frozen=True)
class _Contour:
    """The contour of a piece of the hole, `OFFSET` px outside, where colours are
    pure.
    """

    # (n, 2): x, y.
    path: F64
    # (2, n): rows and columns of its pixels, moved into the photo.
    pixels: NDArray[np.int64]
    # (n,): places in the photo and outside the hole.
    usable_places: Mask
    # (2, n): x, y of vectors into the hole.
    normals: F32


@dataclass(frozen=True)
class _Crossings:
    """The edges that cross a contour, one per point; not all are visible."""

    # (2, n): x, y of unit vectors along the edges into the hole.
    directions: F64
    # (n, 3): mean colours to their left and right.
    left: F64
    right: F64
    contrasts: F64
    # (n,): strength of visible edges; 0 without one.
    scores: F64


def border_ends(known: KnownSurroundings, piece: Mask) -> Iterator[BorderEnd]:
    """Yield the edges that enter a piece of the hole, in the order of its contour."""
    contour = _trace_contour(known, piece)
    if len(contour.path) < 6 * SIDE or not contour.usable_places.any():
        return
    crossings = _measure_crossings(known, contour)
    for index in _find_peaks(crossings.scores):
        direction = crossings.directions[:, index].copy()
        position = _move_to_steepest(known, contour.path[index], direction)
        yield BorderEnd(
            index,
            position,
            direction,
            crossings.left[index],
            crossings.right[index],
            float(crossings.contrasts[index]),
            border_profile(known.picture, known.blocked_mask, position, direction),
        )


def _trace_contour(known: KnownSurroundings, piece: Mask) -> _Contour:
    """Return the longest contour around a piece of the hole."""
    h, w = piece.shape
    r = OFFSET + SIDE + 2
    padded_piece = cv2.copyMakeBorder(
        piece.astype(np.uint8), r, r, r, r, cv2.BORDER_CONSTANT, value=0
    )
    contours, _ = cv2.findContours(
        np.asarray(dilate(padded_piece > 0, OFFSET), np.uint8),
        cv2.RETR_EXTERNAL,
        cv2.CHAIN_APPROX_NONE,
    )
    path = max(contours, key=len)[:, 0, :].astype(np.float64) - r
    x, y = path.astype(int).T
    inside = (x >= 2) & (y >= 2) & (x < w - 2) & (y < h - 2)
    pixels = np.stack([np.clip(y, 0, h - 1), np.clip(x, 0, w - 1)])
    usable_places = inside & ~known.blocked_mask[pixels[0], pixels[1]]
    # The blurred distance to the piece gives the inward normal.
    inward = cv2.GaussianBlur(padded_piece.astype(np.float32), (0, 0), OFFSET)
    normals = [
        cv2.Sobel(inward, cv2.CV_32F, *d, ksize=3)[y + r, x + r]
        for d in ((1, 0), (0, 1))
    ]
    return _Contour(path, pixels, usable_places, np.stack(normals))


def _measure_crossings(known: KnownSurroundings, contour: _Contour) -> _Crossings:
    """Return the direction, colours and strength of the edge at each point."""
    directions, spread, coherence = _edge_directions(known, contour)
    nx, ny = contour.normals
    slant = (directions[0] * nx + directions[1] * ny) / np.maximum(
        np.hypot(nx, ny), 1e-9
    )
    left, has_left = _mean_side(known, contour.path, directions, 1)
    right, has_right = _mean_side(known, contour.path, directions, -1)
    contrasts = np.linalg.norm(left - right, axis=1)
    is_visible = contour.usable_places & has_left & has_right
    is_visible &= coherence > COHERENCE
    is_visible &= (contrasts > CONTRAST) & (slant > LEAST_SLANT)
    scores = np.where(is_visible, spread, 0)
    return _Crossings(directions, left, right, contrasts, scores)


def _edge_directions(
    known: KnownSurroundings, contour: _Contour
) -> tuple[F64, F64, F64]:
    """Return unit vectors (2, n) along the edges into the hole, their strengths and
    coherences (n,), by the structure tensor.
    """
    rows, columns = contour.pixels
    xx, xy, yy = (a[rows, columns].astype(np.float64) for a in known.tensor)
    # Angle of the gradient.
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    spread = np.hypot(xx - yy, 2 * xy)
    coherence = spread / np.maximum(xx + yy, 1e-6)
    nx, ny = contour.normals
    tx, ty = -np.sin(angle), np.cos(angle)
    sign = np.where(tx * nx + ty * ny < 0, -1, 1)
    return np.stack([tx * sign, ty * sign]), spread, coherence


def _mean_side(
    known: KnownSurroundings, path: F64, directions: F64, turn: int
) -> tuple[F64, Mask]:
    """Return mean colours (n, 3) on one side of edges, and where enough are known.

    `turn` is 1 for the left side and -1 for the right one.
    """
    steps = np.arange(2, SIDE + 1)
    x = path[:, 0, None] + turn * directions[1][:, None] * steps
    y = path[:, 1, None] - turn * directions[0][:, None] * steps
    colours, legal = _sample_known_colours(known.picture, known.blocked_mask, x, y)
    sums = (colours * legal[:, :, None]).sum(1)
    means = sums / np.maximum(legal.sum(1), 1)[:, None]
    return means, legal.sum(1) >= LEAST_SAMPLES


def _find_peaks(scores: F64) -> Iterator[int]:
    """Yield local maxima along a closed contour; of equal neighbours the first one."""
    for index in np.flatnonzero(scores).tolist():
        window = np.arange(index - PEAK_REACH, index + PEAK_REACH + 1) % len(scores)
        is_peak = scores[index] == scores[window].max()
        if is_peak and not (scores[window[:PEAK_REACH]] == scores[index]).any():
            yield index


def _move_to_steepest(known: KnownSurroundings, place: F64, direction: F64) -> F64:
    """Return `place` moved across its edge to the steepest change of colour."""
    profile = border_profile(known.picture, known.blocked_mask, place, direction)
    slope = np.linalg.norm(profile[4:] - profile[:-4], axis=1)[2:-2]
    if np.isnan(slope).all():
        shift = 0
    else:
        shift = int(np.nanargmax(slope)) - (len(slope) - 1) // 2
    return np.asarray(place + shift * np.array([-direction[1], direction[0]]))


def _sample_known_colours(
    picture: F32, blocked: Mask, x: F64, y: F64
) -> tuple[F32, Mask]:
    """Return colours at the pixels nearest to x and y, and whether they are known."""
    h, w = blocked.shape
    xi, yi = np.round(x).astype(int), np.round(y).astype(int)
    legal = (xi >= 0) & (yi >= 0) & (xi < w) & (yi < h)
    xi, yi = np.clip(xi, 0, w - 1), np.clip(yi, 0, h - 1)
    return picture[yi, xi], legal & ~blocked[yi, xi]


def border_profile(picture: F32, blocked: Mask, place: F64, direction: F64) -> F64:
    """Return colours (2 STRIP + 1, 3) across an edge from left to right; NaN if hidden.

    Colours are averaged along the last px of the edge.
    """
    offsets = np.arange(-STRIP, STRIP + 1)[:, None]
    back = np.arange(0, 4)[None, :]
    x = place[0] - direction[0] * back - direction[1] * offsets
    y = place[1] - direction[1] * back + direction[0] * offsets
    colours, legal = _sample_known_colours(picture, blocked, x, y)
    weight = legal.sum(1)[:, None]
    mean = (colours * legal[:, :, None]).sum(1) / np.maximum(weight, 1)
    return np.where(weight > 0, mean, np.nan)
