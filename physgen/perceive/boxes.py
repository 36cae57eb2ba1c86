"""Outlines that are rectangles but for the raggedness of their masks -> true rectangles, where contact allows it."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from physgen.geometry import Array, polygon_moments
from physgen.outline.outline import Disc, Outline, Region, Ring, bounds
from physgen.outline.overlap import overlap_depth
from physgen.perceive.equilibrium import contacts
from physgen.perceive.roles import Thing

COVERED = 0.97
"""Intersection over union of outline and rectangle, from which one stands for the other."""
RAGGED = 1.5
"""px about a side within which the border is that side's."""
UPRIGHT = 0.5
"""degrees off upright within which a box is upright."""
ROUND = 3.0
"""px, and 12 % of the shorter side at most, by which a corner is rounded off or a side bulges."""
SUNK = 0.05
"""px that a box may overlap a neighbour."""


def boxed(things: Sequence[Thing]) -> dict[int, Outline]:
    """Rectangles of four corners, by id, for what is one and touches no other thing.

    What touches others shares its borders with them: a box would leave gaps or overlap.
    """
    outlines = [thing.outline for thing in things]
    touching = {k for contact in contacts(outlines, []) for k in (contact.thing, contact.other)}
    result: dict[int, Outline] = {}
    boxes = np.array([bounds(outline) for outline in outlines]).reshape(-1, 4)
    for k, thing in enumerate(things):
        box = None if k in touching or thing.cut else rectangle(thing.outline)
        if box is not None:
            x0, y0, x1, y1 = bounds(box)
            apart = (boxes[:, :2] > (x1, y1)).any(axis=1) | (boxes[:, 2:] < (x0, y0)).any(axis=1)
            near = [outlines[i] for i in np.flatnonzero(~apart).tolist() if i != k]
            if all(overlap_depth(box, other) <= SUNK for other in near):
                result[thing.id] = box
    return result


def rectangle(outline: Outline) -> Region | None:
    """The rectangle that an outline is, of its area and with its lowest corner's height; None where it is none."""
    if isinstance(outline, Disc) or len(outline.rings) != 1 or outline.rings[0].holes:
        return None
    points = outline.rings[0].outer
    (_, size, degrees) = cv2.minAreaRect(points.astype(np.float32))
    off = (degrees + 45) % 90 - 45
    angle = 0.0 if abs(off) <= UPRIGHT else np.radians(off)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    own = points @ turn.T
    low, high = _sides(own)
    if angle == 0.0:
        high[1] = bounds(outline)[3]
    width, height = high - low
    if min(width, height) <= 2 * RAGGED:
        return None
    away = np.minimum(np.abs(own - low), np.abs(own - high)).min(axis=1)
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    sharp = np.hypot(*(corners[:, None] - _dense(own)[None]).transpose(2, 0, 1)).min(axis=1)
    if max(away.max(), sharp.max()) > min(ROUND, 0.12 * min(size)):
        return None
    inside = np.clip(own, low, high)
    shared, area = abs(polygon_moments(inside).area), abs(polygon_moments(own).area)
    if shared / (area + width * height - shared) < COVERED:
        return None
    return Region((Ring(corners @ turn),))


def _sides(own: Array) -> tuple[Array, Array]:
    """`(2,)` each: where the sides lie in the rectangle's own axes, by the mean of the border along each."""
    dense = _dense(own)
    low, high = dense.min(axis=0), dense.max(axis=0)
    for axis in (0, 1):
        first, last = low[axis], high[axis]
        other = dense[:, 1 - axis]
        within = (other > np.min(other) + 2 * RAGGED) & (other < np.max(other) - 2 * RAGGED)
        ends = dense[:, axis] < first + 2 * RAGGED, dense[:, axis] > last - 2 * RAGGED
        sides = [dense[within & end, axis] for end in ends]
        if all(map(len, sides)):
            low[axis], high[axis] = (float(side.mean()) for side in sides)
    return low, high


def _dense(points: Array) -> Array:
    """The border of a ring, a point every half px or so."""
    after = np.roll(points, -1, axis=0)
    parts = []
    for a, b in zip(points, after, strict=True):
        count = max(2, int(2 * np.hypot(*(b - a))))
        parts.append(a + (b - a) * np.linspace(0, 1, count)[:, None])
    return np.concatenate(parts)
