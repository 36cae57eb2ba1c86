"""Section of the background by the plane of motion, from depth.

A photo shows, in every direction, the nearest surface. Where that is nearer than the plane in which objects move, the
plane is hidden behind matter and taken to be solid there; where it is farther, the plane is free. The border between
the two is the section of all that stands still: a floor's, a wall's, a table's, a cushion's.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import F32, Labels, Mask, PhotoObject, Scenery
from physgen.perceive.support.ground_contact import Foot, Line
from physgen.problems import InputError

BLEEDS = 4  # px at 512 by which an object's depth runs over its outline in the output of models
SLACK = 0.02  # of the photo's depth, by which a surface may lie behind the objects' plane and still be in it
SOFT = 1.5  # px: standard deviation of the blur that smooths a border
NEAR = 1.0  # of the foreground's depth, by which a surface may lie before all objects and still be among them
# least depth of the foreground, of the photo's: where its objects stand; for its shelves
THIN, DEEP = (0.05, 0.2)
LEAST_FACING = 0.85  # cosine from which a surface faces the viewer


@dataclass(frozen=True)
class Section:
    """Solid matter in the plane of motion; depths are 0 at the photo's nearest point, 1 at its farthest."""

    depth: F32
    """(H, W): the background's, interpolated across objects from side to side."""
    solid: Mask
    """(H, W)."""
    known: Mask
    """(H, W): False where objects, or the bleeding of their depth, hide it."""
    plane: float
    """Depth of the plane."""
    nearest: float
    """Depth before which nothing is among the objects."""


def normalised_depth(depth: F32 | None) -> F32:
    """Depth from 0, the photo's nearest, to 1, its farthest, without specks. Raises InputError where there is none."""
    if depth is None or not np.isfinite(depth).all() or np.ptp(depth) <= 1e-6 * np.abs(depth).max():
        found = "no depth" if depth is None else "depth that is the same everywhere, or not finite"
        expected = "is nothing that boundary=depth-normals can work on"
        raise InputError.of("--backend", found, expected, "add --backend depth=depth-anything")
    low, high = np.percentile(depth[::3, ::3], (0.5, 99.5))
    if high - low <= 1e-6 * max(abs(low), abs(high)):
        low, high = depth.min(), depth.max()
    return np.asarray(cv2.medianBlur(((depth - low) / (high - low)).astype(np.float32), 5), np.float32)


def hidden_by_objects(labels: Labels) -> Mask:
    """(H, W): objects, and as far as their depth bleeds."""
    reach = 2 * max(2, round(BLEEDS * max(labels.shape) / 512)) + 1
    return np.asarray(cv2.dilate((labels > 0).astype(np.uint8), np.ones((reach, reach), np.uint8)) > 0)


def fill_depth_behind(depth: F32, away: Mask) -> F32:
    """The depth with `away` (H, W) interpolated from side to side."""
    result = depth.copy()
    columns = np.arange(depth.shape[1])
    for row in np.flatnonzero(away.any(1)):
        seen = ~away[row]
        if seen.any():
            result[row, ~seen] = np.interp(columns[~seen], columns[seen], depth[row, seen])
    return result


def above_below(depth: F32, labels: Labels, objects: Sequence[PhotoObject], away: Mask) -> float:
    """Mean, -1..1, by which the background above objects is farther than below them, relative to how they stand out."""
    differences = []
    for rows, columns in _pixels(labels, objects):
        y0, y1, across = rows.min(), rows.max() + 1, slice(columns.min(), columns.max() + 1)
        reach = max(6, (y1 - y0) // 3)
        parts = [
            depth[a:b, across][~away[a:b, across]] for a, b in ((max(0, y0 - reach), y0), (y1, y1 + reach))
        ]
        if min(map(len, parts)) < 10:
            continue
        above, below = (float(np.median(part)) for part in parts)
        out = max(above, below) - float(np.median(depth[rows, columns]))
        differences.append(np.clip((above - below) / max(out, 0.05), -1, 1))
    return float(np.mean(differences)) if differences else 0.0


def _pixels(labels: Labels, objects: Sequence[PhotoObject]) -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
    """Rows and columns of each object that is seen."""
    for item in objects:
        rows, columns = np.nonzero(labels == item.id)
        if len(rows):
            yield rows, columns


def side_section(
    depth: F32,
    labels: Labels,
    objects: Sequence[PhotoObject],
    groups: Sequence[tuple[Line, list[Foot]]],
    scenery: Scenery | None,
) -> Section:
    """The section in a side view: the objects' plane is as far as what they stand on, where they stand."""
    away = hidden_by_objects(labels)
    full = fill_depth_behind(depth, away)
    own = [np.percentile(depth[part], (10, 75)) for part in _pixels(labels, objects)]
    nearest, farthest = min(float(o[0]) for o in own), max(float(o[1]) for o in own)
    stands = [d for line, group in groups if (d := _depth_beside(full, away, line, group)) is not None]
    # what is seen under an object in the air is no floor
    around = max(farthest - nearest, THIN)
    stands = [d for d in stands if nearest - around <= d <= farthest + around]
    plane = max(stands) if stands else farthest
    before = NEAR * max(farthest - nearest, DEEP)
    return _section(full, away, plane, SLACK, nearest - before, scenery)


def _depth_beside(depth: F32, away: Mask, line: Line, group: Sequence[Foot]) -> float | None:
    """Median depth beside objects, where they stand."""
    height, width = depth.shape
    x0, x1 = min(f.left[0] for f in group), max(f.right[0] for f in group)
    margin = 0.5 * max(float(np.ptp(f.hull[:, 0])) for f in group) + 2 * BLEEDS
    columns = np.arange(max(0, int(x0 - margin)), min(width, int(x1 + margin) + 1))
    rows = np.round(line.slope * columns + line.height).astype(int)
    inside = (rows >= 0) & (rows < height)
    columns, rows = columns[inside], rows[inside]
    seen = ~away[rows, columns]
    return float(np.median(depth[rows[seen], columns[seen]])) if seen.sum() >= 5 else None


def top_section(
    depth: F32, normals: F32, labels: Labels, objects: Sequence[PhotoObject], scenery: Scenery | None
) -> Section:
    """The section in a top view, half as high above the table as objects are: cushions and rims, not the table."""
    away = hidden_by_objects(labels)
    flat = depth - _table_depth(depth, normals, away)
    full = fill_depth_behind(flat, away)
    heights = [float(np.median(flat[part])) for part in _pixels(labels, objects)]
    top = min(float(np.median(heights)), -SLACK)
    return _section(full, away, 0.5 * top, 0.0, top * (1.5 + NEAR), scenery)


def _table_depth(depth: F32, normals: F32, away: Mask) -> F32:
    """(H, W): depth of the plane that most of the background lies in."""
    height, width = depth.shape
    y, x = np.mgrid[0:height:4, 0:width:4]
    some = np.stack([np.ones(x.size), x.ravel() / width, y.ravel() / height], 1)
    values, level = depth[::4, ::4].ravel().astype(np.float64), (normals[::4, ::4, 2] > LEAST_FACING).ravel()
    use = ~away[::4, ::4].ravel() & level
    use = use if use.sum() >= 30 else ~away[::4, ::4].ravel()
    plane = np.array([np.median(values[use]) if use.any() else 0.0, 0.0, 0.0])
    for _ in range(6):
        off = np.abs(values - some @ plane)
        near = use & (off <= max(2.5 * float(np.median(off[use])) if use.any() else 0.0, 1e-3))
        if near.sum() < 30:
            break
        plane = np.linalg.lstsq(some[near], values[near], rcond=None)[0]
    y, x = np.mgrid[0:height, 0:width]
    return np.asarray(plane[0] + plane[1] * x / width + plane[2] * y / height, np.float32)


def _section(
    full: F32, away: Mask, plane: float, slack: float, nearest: float, scenery: Scenery | None
) -> Section:
    limit = plane + slack  # flat objects stand in the plane, too
    solid = (full < limit).astype(np.float32)
    if scenery is not None:  # the paper's choice: scenery within the foreground's range of depth
        ids = np.where(away, 0, scenery.labels)
        for i in np.unique(ids[ids > 0]).tolist():
            low, high = np.percentile(full[ids == i], (5, 95))
            if low > limit or high < nearest:
                solid[scenery.labels == i] = 0.0
    smooth = cv2.GaussianBlur(solid, (0, 0), SOFT) > 0.5
    return Section(full, smooth, ~away, plane, nearest)
