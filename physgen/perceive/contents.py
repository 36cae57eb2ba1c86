"""Contents of bowls and plates that a camera sees from above at an angle.

Fruit in a bowl lies within the bowl's convex outline and fills its bays. If the bowl is
pushed, the fruit moves with it: both are one object.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.shapes import fill_polygon
from physgen.perceive.roles import Detections, Doubt, Labels, Mask


@dataclass(frozen=True)
class ContentLimits:
    """Limits of contents, chosen on bowls of fruit and on fruit beside each other."""

    solid: float = 0.85
    """Share of its convex outline from which an object has no room for contents."""
    inside: float = 0.5
    """Share of contents within that outline, at least."""
    height: float = 0.05
    """Of that outline's height, between the lower ends of both, at least."""
    touch: int = 5
    """px between contents and what holds them."""
    gap: float = 0.05
    """Of the outline's height: half the width of gaps behind which holes are closed."""
    slit: float = 0.015
    """The same of slits that are closed, too."""


CONTENT = ContentLimits()


def attach_contents(detections: Detections) -> Detections:
    """Return the detections with contents as parts of what holds them.

    The largest container comes first. Holes and narrow gaps in the union are closed;
    doubtful regions within it are parts of it, too.
    """
    ids = []
    for i in np.unique(detections.labels):
        if i > 0:
            ids.append(int(i))
    sizes = {i: int(np.count_nonzero(detections.labels == i)) for i in ids}
    for i in sorted(ids, key=lambda one: sizes[one], reverse=True):
        container = _Container.from_labels(detections.labels, i)
        if container is not None:
            detections = _with_contents(detections, container)
    return detections


@dataclass(frozen=True, eq=False)
class _Container:
    """An object with bays, and its convex outline."""

    id: int
    mask: Mask
    """(H, W)."""
    hull: Mask
    """(H, W)."""
    low: int
    """Its lowest row."""
    height: int
    """px of its outline."""

    @staticmethod
    def from_labels(labels: Labels, i: int) -> _Container | None:
        """Return an object as a container; None if it has no room for contents."""
        own = labels == i
        if not own.any():
            return None
        points = cv2.findNonZero(own.view(np.uint8))
        hull = np.zeros(labels.shape, np.uint8)
        cv2.fillConvexPoly(hull, cv2.convexHull(points), 1)
        if np.count_nonzero(own) > CONTENT.solid * np.count_nonzero(hull):
            return None
        rows = np.flatnonzero(own.any(axis=1))
        low = int(rows[-1])
        height = int(rows[-1] - rows[0]) + 1
        return _Container(i, own, hull > 0, low, height)

    def holds(self, other: Mask) -> bool:
        """Return whether a mask (H, W) lies within the outline, not in front of it."""
        area = np.count_nonzero(other)
        if not area:
            return False
        share = np.count_nonzero(other & self.hull) / area
        low = int(np.flatnonzero(other.any(axis=1))[-1])
        return bool(
            share >= CONTENT.inside and low < self.low - CONTENT.height * self.height
        )


def _with_contents(detections: Detections, container: _Container) -> Detections:
    """Return the detections with what a container holds as parts of it."""
    labels = detections.labels
    near = cv2.dilate(
        container.mask.view(np.uint8),
        np.ones((2 * CONTENT.touch + 1, 2 * CONTENT.touch + 1), np.uint8),
    )
    touching = np.setdiff1d(np.unique(labels[near > 0]), (0, container.id))
    members = []
    for i in touching:
        if container.holds(labels == i):
            members.append(int(i))
    if not members:
        return detections
    whole = container.mask | np.isin(labels, members)
    kept: list[Doubt] = []
    for doubt in detections.doubtful:
        region = fill_polygon(tuple(doubt.polygon), (labels.shape[1], labels.shape[0]))
        if container.holds(np.asarray(region)):
            whole |= region & (labels == 0)
        else:
            kept.append(doubt)
    joined = np.where(np.isin(labels, members), container.id, labels)
    joined[_close_slits(whole, container.height) & (joined == 0)] = container.id
    confidence = dict(detections.confidence)
    parts = [container.id, *members]
    confidence[container.id] = max(confidence.get(i, 0.0) for i in parts)
    return replace(
        detections,
        labels=joined.astype(np.uint16),
        confidence=confidence,
        doubtful=kept,
        names={i: name for i, name in detections.names.items() if i not in members},
    )


def _close_slits(mask: Mask, height: int) -> Mask:
    """Return a mask (H, W) without slits, and without the holes behind narrow gaps.

    Wider bays that are open to the outside stay as they are.
    """
    reach = max(1, round(CONTENT.gap * height)) + 1
    padded = np.pad(mask.astype(np.uint8), reach)
    closed = _close_gaps(padded, CONTENT.gap * height)
    outlines, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = np.zeros_like(closed)
    cv2.drawContours(filled, list(outlines), -1, 1, cv2.FILLED)
    added = ((filled > 0) & (padded == 0)).astype(np.uint8)
    _, pieces = cv2.connectedComponents(added, connectivity=4)
    outside = cv2.dilate((filled == 0).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    is_open = np.zeros(int(pieces.max()) + 1, bool)
    is_open[np.unique(pieces[outside])] = True
    holes = (added > 0) & ~is_open[pieces]
    full = _close_gaps((holes | (padded > 0)).astype(np.uint8), CONTENT.slit * height)
    return np.asarray(full[reach:-reach, reach:-reach] > 0)


def _close_gaps(mask: NDArray[np.uint8], width: float) -> NDArray[np.uint8]:
    """Return a mask (H, W) whose gaps up to twice this width, px, are closed."""
    radius = max(1, round(width))
    size = (2 * radius + 1, 2 * radius + 1)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, size)
    return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, kernel), np.uint8)
