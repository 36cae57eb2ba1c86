"""Circles and ellipses, partly visible, continued through a hole.

The visible edge is followed outwards from both of its ends. If one ellipse passes
through both parts in their directions, its arc between the ends is the hidden part: a
painted ring stays a ring.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.roles import Mask

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class _Tuning:
    """Sizes in px of the photo."""

    # Step along the edge.
    step: float = 1.5
    # Search range on both sides of the expected position.
    search: float = 2.0
    # Distance from the edge to the compared colours.
    colour_distance: float = 2.0
    # Share of an end's contrast below which the edge ends.
    fade: float = 0.4
    # Largest number of steps from one end.
    steps: int = 60
    # Least number of visible steps on each side.
    fewest: int = 16
    # rad: least turn of each visible side; a straight one determines no ellipse.
    bend: float = 0.25
    # Largest ratio of the hidden to the visible turn.
    hidden_ratio: float = 2.5
    # rad from a straight line: for a flatter arc a cubic is as good.
    turn: float = 0.25
    # Largest RMS distance of the visible edge from the ellipse.
    error: float = 0.7
    # rad: largest angle between the ellipse and the direction at an end.
    tangent: float = 0.35
    # Least semi-axis: a smaller one is a corner rather than a ring.
    smallest: float = 8.0
    # Largest semi-axis over the distance of both ends.
    largest: float = 3.0
    # Least share of the arc in the hole.
    inside: float = 0.4
    # Distance between points of the arc.
    spacing: float = 0.5


TUNING = _Tuning()


def follow_edge(picture: F32, blocked: Mask, start: F64, away: F64) -> F64:
    """Return points (n, 2) x, y of the edge that leaves `start` in the direction
    `away`.

    `picture` (H, W, 3) is unknown in `blocked` (H, W).
    """
    place, direction = start.copy(), away.copy()
    first = _contrast(picture, blocked, place[None], direction)[0]
    strength = float(np.linalg.norm(first))
    points = [place.copy()]
    shifts = np.arange(-TUNING.search, TUNING.search + 0.25, 0.5)
    for _ in range(TUNING.steps):
        normal = np.array([-direction[1], direction[0]])
        ahead = place + TUNING.step * direction
        options = ahead + shifts[:, None] * normal
        contrast = _contrast(picture, blocked, options, direction) @ first
        # A small penalty keeps the path straight on flat maxima.
        contrast -= 0.02 * np.abs(shifts) * strength**2
        best = int(np.argmax(contrast))
        if not contrast[best] > TUNING.fade * strength**2:
            break
        place = options[best]
        points.append(place.copy())
        # The direction follows the last few steps, so that a single pixel cannot turn
        # it.
        chord = place - points[max(0, len(points) - 6)]
        direction = chord / max(float(np.hypot(*chord)), 1e-9)
    return np.array(points)


def _contrast(picture: F32, blocked: Mask, places: F64, direction: F64) -> F64:
    """Return colours (n, 3) on one side of `places` minus those on the other side.

    Hidden colours give -1e9.
    """
    normal = np.array([-direction[1], direction[0]])
    height, width = blocked.shape
    sides = []
    for sign in (1, -1):
        x, y = (
            np.round(places + sign * TUNING.colour_distance * normal).astype(np.int64).T
        )
        legal = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
        legal &= ~blocked[y, x]
        sides.append(
            np.where(legal[:, None], picture[y, x].astype(np.float64), -np.inf)
        )
    with np.errstate(invalid="ignore"):
        gap = sides[0] - sides[1]
    return np.where(np.isfinite(gap).all(axis=1, keepdims=True), gap, -1e9)


def ellipse_arc(
    edges: tuple[F64, F64], directions: tuple[F64, F64], piece: Mask
) -> F64 | None:
    """Return points (n, 2) from the first end to the second along an ellipse, or None.

    `edges` are visible points (n, 2) from each end outwards; `directions` are unit
    vectors into the hole `piece` (H, W).
    """
    if min(len(edge) for edge in edges) < TUNING.fewest:
        return None
    bends = [_turning(edge) for edge in edges]
    if min(bends) < TUNING.bend:
        return None
    points = np.concatenate(edges)
    ellipse = _Ellipse.fit(points)
    start, end = edges[0][0], edges[1][0]
    chord = float(np.hypot(*(end - start)))
    if ellipse is None or max(ellipse.axes) > TUNING.largest * chord:
        return None
    if ellipse.error(points) > TUNING.error:
        return None
    arc = ellipse.arc(start, end, directions[0])
    if not (_is_inside(arc, piece) and _is_tangent(arc, directions)):
        return None
    return arc if _turning(arc) < TUNING.hidden_ratio * sum(bends) else None


def _is_inside(arc: F64, piece: Mask) -> bool:
    """Return whether an arc (n, 2) lies in a `piece` (H, W) of the hole."""
    x, y = np.round(arc).astype(np.int64).T
    height, width = piece.shape
    legal = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    inner = piece[y[legal], x[legal]].sum()
    # Both ends are a few pixels outside the hole.
    outside = 2 * TUNING.fewest / TUNING.spacing
    return bool(inner >= TUNING.inside * (len(arc) - outside))


def _is_tangent(arc: F64, directions: tuple[F64, F64]) -> bool:
    """Return whether a bent arc (n, 2) continues both `directions` into the hole."""
    leaves, arrives = arc[2] - arc[0], arc[-1] - arc[-3]
    turns = _angle(leaves, directions[0]), _angle(arrives, -directions[1])
    return max(turns) <= TUNING.tangent and _angle(leaves, arrives) >= TUNING.turn


def _turning(points: F64) -> float:
    """Return the total turn of a curve (n, 2), rad, without its finest
    irregularities.
    """
    chords = np.diff(points[:: max(1, len(points) // 4)], axis=0)
    angles = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0]))
    return abs(float(angles[-1] - angles[0]))


def _angle(one: F64, other: F64) -> float:
    """Return the angle between two vectors, rad, 0 to pi."""
    cross = one[0] * other[1] - one[1] * other[0]
    return abs(float(np.arctan2(cross, one @ other)))


@dataclass(frozen=True)
class _Ellipse:
    """An ellipse: centre, semi-axes in px, and the angle of the first axis in rad."""

    centre: F64
    axes: F64
    angle: float

    @classmethod
    def fit(cls, points: F64) -> _Ellipse | None:
        """Return the least-squares ellipse through (n, 2), or None if it is
        degenerate.
        """
        (x, y), sizes, degrees = cv2.fitEllipseDirect(points.astype(np.float32))
        axes = np.array(sizes) / 2
        if not np.isfinite([x, y, *sizes]).all() or axes.min() < TUNING.smallest:
            return None
        return cls(np.array([x, y]), axes, float(np.deg2rad(degrees)))

    def _unit(self, points: F64) -> F64:
        """Return points (n, 2) in the frame in which the ellipse is the unit circle."""
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        x, y = (points - self.centre).T
        rotated_points = np.stack(
            [cosine * x + sine * y, cosine * y - sine * x], axis=1
        )
        return np.asarray(rotated_points / self.axes)

    def error(self, points: F64) -> float:
        """Return the RMS distance of points from the ellipse, px, to first order."""
        unit = self._unit(points)
        value = (unit**2).sum(axis=1) - 1
        slope = 2 * np.hypot(*(unit / self.axes).T)
        return float(np.sqrt(np.mean((value / np.maximum(slope, 1e-9)) ** 2)))

    def arc(self, start: F64, end: F64, direction: F64) -> F64:
        """Return points (n, 2) from near `start` to near `end`, leaving in
        `direction`.
        """
        first, last = (
            float(np.arctan2(*self._unit(p[None])[0][::-1])) for p in (start, end)
        )
        ahead = self._points(np.array([first, first + 0.01]))
        sign = 1 if (ahead[1] - ahead[0]) @ direction > 0 else -1
        sweep = (sign * (last - first)) % (2 * np.pi)
        length = sweep * float(self.axes.max())
        count = int(length / TUNING.spacing) + 4
        return self._points(first + sign * sweep * np.linspace(0, 1, count))

    def _points(self, angles: F64) -> F64:
        x, y = self.axes[0] * np.cos(angles), self.axes[1] * np.sin(angles)
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        rotated_points = np.stack(
            [cosine * x - sine * y, sine * x + cosine * y], axis=1
        )
        return np.asarray(self.centre + rotated_points)
