"""Circles and ellipses, visible in part, continued through a hole.

The visible edge is followed outwards from both its ends. If one ellipse passes through both parts and has their
directions, its arc between the ends is the hidden part: a painted ring stays a ring.
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

    step: float = 1.5  # along the edge
    search: float = 2.0  # to both sides of the expected place
    across: float = 2.0  # from the edge to the colours that are compared
    fade: float = 0.4  # share of an end's contrast below which the edge has ended
    steps: int = 60  # at most followed from one end
    fewest: int = 16  # steps that must be visible on each side
    bend: float = 0.25  # rad by which each visible side must turn: a straight one tells no ellipse
    hidden: float = 2.5  # hidden turn over the visible one, at most
    turn: float = 0.25  # rad from a straight line: a flatter arc is a cubic as well
    error: float = 0.7  # root mean square distance of the visible edge from the ellipse
    tangent: float = 0.35  # rad between the ellipse and the direction at an end
    smallest: float = 8.0  # semi-axis: less is no ring, but a corner
    largest: float = 3.0  # semi-axis over the distance of both ends
    inside: float = 0.4  # share of the arc that lies in the hole
    spacing: float = 0.5  # between points of the arc


TUNING = _Tuning()


def follow_edge(picture: F32, blocked: Mask, start: F64, away: F64) -> F64:
    """(n, 2) x, y of the edge that leaves `start` in the direction `away`.

    `picture` (H, W, 3) is unknown where `blocked` (H, W).
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
        contrast -= 0.02 * np.abs(shifts) * strength**2
        best = int(np.argmax(contrast))
        if not contrast[best] > TUNING.fade * strength**2:
            break
        place = options[best]
        points.append(place.copy())
        # the direction of the last few steps, so that one pixel does not turn it
        chord = place - points[max(0, len(points) - 6)]
        direction = chord / max(float(np.hypot(*chord)), 1e-9)
    return np.array(points)


def _contrast(picture: F32, blocked: Mask, places: F64, direction: F64) -> F64:
    """(n, 3): colours on one side of `places` less those on the other; NaN if hidden."""
    normal = np.array([-direction[1], direction[0]])
    height, width = blocked.shape
    sides = []
    for sign in (1, -1):
        x, y = np.round(places + sign * TUNING.across * normal).astype(np.int64).T
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
    """(n, 2) points from the first end to the second along one ellipse; None if none.

    `edges`: visible points (n, 2) from each end outwards; `directions`: unit vectors
    into the hole `piece` (H, W).
    """
    if min(len(edge) for edge in edges) < TUNING.fewest:
        return None
    points = np.concatenate(edges)
    bends = [_turning(edge) for edge in edges]
    if min(bends) < TUNING.bend:
        return None
    ellipse = _Ellipse.fitted(points)
    start, end = edges[0][0], edges[1][0]
    chord = float(np.hypot(*(end - start)))
    if ellipse is None or max(ellipse.axes) > TUNING.largest * chord:
        return None
    if ellipse.error(points) > TUNING.error:
        return None
    arc = ellipse.arc(start, end, directions[0])
    x, y = np.round(arc).astype(np.int64).T
    height, width = piece.shape
    legal = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    inner = piece[y[legal], x[legal]].sum()
    # both ends are a few pixels outside of the hole
    outside = 2 * TUNING.fewest / TUNING.spacing
    if inner < TUNING.inside * (len(arc) - outside):
        return None
    leaves, arrives = arc[2] - arc[0], arc[-1] - arc[-3]
    turns = (_angle(leaves, directions[0]), _angle(arrives, -directions[1]))
    if max(turns) > TUNING.tangent or _angle(leaves, arrives) < TUNING.turn:
        return None
    hidden = _turning(arc)
    return arc if hidden < TUNING.hidden * sum(bends) else None


def _turning(points: F64) -> float:
    """Angle by which a curve (n, 2) turns in all, rad, without its finest wiggles."""
    chords = np.diff(points[:: max(1, len(points) // 4)], axis=0)
    angles = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0]))
    return abs(float(angles[-1] - angles[0]))


def _angle(one: F64, other: F64) -> float:
    """Angle between two vectors, rad, 0 to pi."""
    cross = one[0] * other[1] - one[1] * other[0]
    return abs(float(np.arctan2(cross, one @ other)))


@dataclass(frozen=True)
class _Ellipse:
    """An ellipse: centre, semi-axes in px, and the angle of the first axis in rad."""

    centre: F64
    axes: F64
    angle: float

    @classmethod
    def fitted(cls, points: F64) -> _Ellipse | None:
        """Return the ellipse of least squares through (n, 2); None if it is degenerate."""
        (x, y), sizes, degrees = cv2.fitEllipseDirect(points.astype(np.float32))
        axes = np.array(sizes) / 2
        if not np.isfinite([x, y, *sizes]).all() or axes.min() < TUNING.smallest:
            return None
        return cls(np.array([x, y]), axes, float(np.deg2rad(degrees)))

    def _unit(self, points: F64) -> F64:
        """Points (n, 2) in the frame where the ellipse is the unit circle."""
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        x, y = (points - self.centre).T
        turned = np.stack([cosine * x + sine * y, cosine * y - sine * x], axis=1)
        return np.asarray(turned / self.axes)

    def error(self, points: F64) -> float:
        """Root mean square distance of points from the ellipse, px, to first order."""
        unit = self._unit(points)
        value = (unit**2).sum(axis=1) - 1
        slope = 2 * np.hypot(*(unit / self.axes).T)
        return float(np.sqrt(np.mean((value / np.maximum(slope, 1e-9)) ** 2)))

    def arc(self, start: F64, end: F64, direction: F64) -> F64:
        """(n, 2) points from near `start` to near `end`, leaving in `direction`."""
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
        turned = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
        return np.asarray(self.centre + turned)
