"""Photo + rough masks -> labels whose outlines lie on the photo's edges: the best closed path in a band."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.proposals.gradient import Gradient, colour_gradient, lab
from physgen.perceive.proposals.proposal import Mask, outline
from physgen.perceive.proposals.score import normals

BAND = 0.08
"""How far an outline may move, in square roots of its area; but a px and a half of the rough mask at least."""
BEND = 0.2
"""What one step sideways costs the path, against an edge support of 0..1."""
ROUND = 0.025
"""An outline whose distances from its circle spread less than this part of the radius is that circle."""

SIDE = 16_384
"""px; the outline of an object that is longer stays rough, as OpenCV samples no longer images."""

Points = NDArray[np.float64]
"""(n, 2): x, y px along a closed outline."""


def tighten(rgb: NDArray[np.uint8], masks: Sequence[Mask], band: float = BAND) -> NDArray[np.uint16]:
    """(H, W) uint16: k + 1 where mask k (h, w), of a smaller or equal size than the photo (H, W, 3), ends up.
    `band` is how far outlines may move, see `BAND`. Every label is one connected region; of two that contend for
    a pixel the later mask gets it."""
    labels = np.zeros(rgb.shape[:2], np.uint16)
    boxes: list[tuple[slice, slice]] = []
    for k, mask in enumerate(masks):
        scale = rgb.shape[1] / mask.shape[1], rgb.shape[0] / mask.shape[0]
        reach = max(1.5, band * float(np.sqrt(mask.sum()))) * max(scale)
        points, normal = _outline_at(mask, np.array(scale))
        low = np.maximum(np.floor(points.min(0) - reach - 6), 0).astype(int)
        high = np.ceil(points.max(0) + reach + 7).astype(int)
        if max(high - low) < SIDE:
            gradient = colour_gradient(lab(rgb[low[1] : high[1], low[0] : high[0]]))
            points = points + _path(gradient, points - low, normal, reach)[:, None] * normal
        rim = _rounded(points)
        left, top = (max(0, int(v) - 2) for v in rim.min(0))
        box = np.s_[top : max(top, int(rim[:, 1].max()) + 3), left : max(left, int(rim[:, 0].max()) + 3)]
        filled = np.zeros(labels[box].shape, np.uint8)
        if filled.size:
            cv2.fillPoly(filled, [np.rint(16 * (rim - (left, top))).astype(np.int32)], 1, shift=4)
            labels[box][filled > 0] = k + 1
        boxes.append(box)
    return _connected(labels, boxes)


def _outline_at(mask: Mask, scale: Points) -> tuple[Points, Points]:
    """The outline of a mask on a photo `scale` times as large, a point a px, and its outward normals."""
    contour = outline(mask)
    normal = normals(contour)
    # From pixel centres out to the pixels' edge, where scaling is exact, and back to centres.
    points = (contour + 0.5 + 0.5 * normal) * scale - 0.5 - 0.5 * normal
    count = int(np.clip(len(contour) * scale.max(), 16, 1500))
    at, knots = np.linspace(0, len(contour), count, endpoint=False), np.arange(len(contour) + 1)
    rows = np.vstack([np.hstack([points, normal]), np.hstack([points[:1], normal[:1]])])
    even = np.stack([np.interp(at, knots, column) for column in rows.T], 1)
    return _smooth(even[:, :2], 1.5), even[:, 2:] / np.linalg.norm(even[:, 2:], axis=1, keepdims=True)


def _path(gradient: Gradient, points: Points, normal: Points, band: float) -> NDArray[np.float64]:
    """(n,) px: how far each point moves along its normal so that the outline runs along edges and bends little;
    Viterbi's algorithm, twice round so that the ends meet."""
    steps = np.linspace(-band, band, 2 * int(np.clip(2 * band, 4, 16)) + 1)
    edge = points[:, None] + (steps[:, None] + 0.5) * normal[:, None]  # half a px outside the last pixel
    angle = np.arctan2(normal[:, 1], normal[:, 0])[:, None]
    strength = gradient.across(edge[..., 0], edge[..., 1], angle)
    crest = strength.max(1, keepdims=True)
    peaked = (
        gradient.support(crest) * strength / np.maximum(crest, 1e-6)
    )  # support alone is flat about strong edges
    value = np.tile(peaked * (1 - 0.2 * (steps / band) ** 2), (2, 1))
    total, came = np.zeros(len(steps)), np.zeros(value.shape, np.int64)
    ways = np.full((3, len(steps)), -np.inf)
    for i, here in enumerate(value):
        ways[0, 1:], ways[1], ways[2, :-1] = total[:-1] - BEND, total, total[1:] - BEND
        came[i] = ways.argmax(0)
        total = ways.max(0) + here
    at, path = int(total.argmax()), np.zeros(len(value), np.int64)
    for i in reversed(range(len(value))):
        path[i] = at
        at += came[i, at] - 1
    half = len(points) // 2
    return _smooth(steps[np.roll(path[half : half + len(points)], half)], 1.5)


def _smooth(values: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """Closed sequences (n,) or (n, k), blurred along n."""
    ends = 4 * int(np.ceil(sigma))
    closed = np.pad(values.reshape(len(values), -1), ((ends, ends), (0, 0)), mode="wrap")
    blurred = cv2.GaussianBlur(closed, (1, 2 * ends + 1), sigmaX=0.1, sigmaY=sigma)
    return blurred[ends:-ends].reshape(values.shape).astype(np.float64)


def _rounded(points: Points) -> Points:
    """The circle through an outline where it is one, else the outline."""
    weight = np.ones(len(points))
    for _ in range(4):  # least squares on x² + y² = 2 a x + 2 b y + c, outliers weighed down
        centre = points.mean(0)
        rows = np.column_stack([2 * (points - centre), np.ones(len(points))])
        right = ((points - centre) ** 2).sum(1)
        a, b, c = np.linalg.lstsq(rows * weight[:, None], right * weight, rcond=None)[0]
        radius = float(np.sqrt(max(c + a * a + b * b, 1e-9)))
        off = np.hypot(*(points - centre - [a, b]).T) - radius
        weight = 1 / (1 + (off / (0.01 * radius + 0.3)) ** 2)
    if np.sqrt(np.mean(off**2)) > ROUND * radius + 0.3:
        return points
    turn = np.linspace(0, 2 * np.pi, len(points), endpoint=False)
    rim: Points = centre + [a, b] + radius * np.stack([np.cos(turn), np.sin(turn)], 1)
    return rim


def _connected(labels: NDArray[np.uint16], boxes: Sequence[tuple[slice, slice]]) -> NDArray[np.uint16]:
    """Labels 1.. in their boxes, of each its largest connected part."""
    kept = np.zeros_like(labels)
    for k, box in enumerate(boxes, 1):
        here = (labels[box] == k).astype(np.uint8)
        if not here.any():
            continue
        _, parts, stats, _ = cv2.connectedComponentsWithStats(here, connectivity=4)
        kept[box][parts == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())] = k
    return kept
