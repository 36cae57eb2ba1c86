"""Section of the background by the plane of motion, from depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Labels, PhotoObject, Scenery
from physgen.perceive.support.ground_contact import Foot, Line
from physgen.problems import InputError

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

BLEEDS = 4
"""px at 512 by which an object's depth runs over its outline in what models say."""
SLACK = 0.02
"""Of the photo's depth, by which something may lie behind the things' plane and still be in it."""
SOFT = 1.5
"""px: standard deviation of the blur that takes the raggedness from a border."""
NEAR = 1.0
"""Of the foreground's depth, by which something may lie before all things and still be among them."""
THIN, DEEP = 0.05, 0.2
"""Of the photo's depth, that the foreground has at least: where its things stand, and where its shelves reach to."""
LEAST_FACING = 0.85
"""Cosine from which a surface faces the viewer."""


@dataclass(frozen=True)
class Section:
    """What is solid in the plane of motion."""

    depth: F32
    """(H, W): the background's, 0 the nearest and 1 the farthest of the photo; across things from side to side."""
    solid: Mask
    """(H, W)."""
    known: Mask
    """(H, W): False where things, or what their depth bleeds into, hide it."""
    plane: float
    """Depth of the plane."""
    limit: float
    """Depth up to which it is solid: a little more, since flat things stand in the plane, too."""
    nearest: float
    """Depth before which nothing is among the things."""


def normalised_depth(depth: F32 | None) -> F32:
    """Depth from 0, the photo's nearest, to 1, its farthest, without specks. Raises InputError where there is none."""
    if depth is None or not np.isfinite(depth).all() or np.ptp(depth) <= 1e-6 * np.abs(depth).max():
        found = "no depth" if depth is None else "depth that is the same everywhere, or not finite"
        raise InputError.of(
            "--backend", found, "is nothing that boundary=depth-normals can work on",
            "add --backend depth=depth-anything"
        )  # fmt: skip
    low, high = np.percentile(depth[::3, ::3], (0.5, 99.5))
    if high - low <= 1e-6 * max(abs(low), abs(high)):
        low, high = depth.min(), depth.max()
    return np.asarray(cv2.medianBlur(((depth - low) / (high - low)).astype(np.float32), 5), np.float32)


def hidden_by_objects(labels: Labels) -> Mask:
    """(H, W): things, and as far as their depth bleeds."""
    reach = 2 * max(2, round(BLEEDS * max(labels.shape) / 512)) + 1
    return np.asarray(cv2.dilate((labels > 0).astype(np.uint8), np.ones((reach, reach), np.uint8)) > 0)


def fill_depth_behind(depth: F32, away: Mask) -> F32:
    """The depth with `away` (H, W) taken out and filled from side to side."""
    result = depth.copy()
    columns = np.arange(depth.shape[1])
    for row in np.flatnonzero(away.any(1)):
        seen = ~away[row]
        if seen.any():
            result[row, ~seen] = np.interp(columns[~seen], columns[seen], depth[row, seen])
    return result


def above_below(depth: F32, labels: Labels, things: Sequence[PhotoObject], away: Mask) -> float:
    """-1..1, mean: by how much what is seen above things is farther than below them, against how they stand out."""
    told = []
    for x0, y0, x1, y1, own in _boxes(labels, things):
        reach = max(6, (y1 - y0) // 3)
        parts = [
            depth[a:b, x0:x1][~away[a:b, x0:x1]] for a, b in ((max(0, y0 - reach), y0), (y1, y1 + reach))
        ]
        if min(map(len, parts)) < 10:
            continue
        above, below = (float(np.median(part)) for part in parts)
        out = max(above, below) - float(np.median(depth[own]))
        told.append(np.clip((above - below) / max(out, 0.05), -1, 1))
    return float(np.mean(told)) if told else 0.0


def _boxes(
    labels: Labels, things: Sequence[PhotoObject]
) -> list[tuple[int, int, int, int, tuple[NDArray[Any], ...]]]:
    result: list[tuple[int, int, int, int, tuple[NDArray[Any], ...]]] = []
    for thing in things:
        rows, columns = np.nonzero(labels == thing.id)
        if len(rows):
            result.append(
                (
                    int(columns.min()),
                    int(rows.min()),
                    int(columns.max()) + 1,
                    int(rows.max()) + 1,
                    (rows, columns),
                )
            )
    return result


def side_section(
    depth: F32,
    labels: Labels,
    things: Sequence[PhotoObject],
    groups: Sequence[tuple[Line, list[Foot]]],
    scenery: Scenery | None,
) -> Section:
    """The section where things stand upright: their plane is as far as what they stand on, where they stand."""
    away = hidden_by_objects(labels)
    full = fill_depth_behind(depth, away)
    own = [np.percentile(depth[part], (10, 75)) for *_, part in _boxes(labels, things)]
    nearest, farthest = min(float(o[0]) for o in own), max(float(o[1]) for o in own)
    stands = [d for line, group in groups if (d := _at(full, away, line, group)) is not None]
    # what is seen under something in the air is no floor
    around = max(farthest - nearest, THIN)
    stands = [d for d in stands if nearest - around <= d <= farthest + around]
    plane = max(stands) if stands else farthest
    before = NEAR * max(farthest - nearest, DEEP)
    return _section(full, away, plane, SLACK, nearest - before, scenery)


def _at(depth: F32, away: Mask, line: Line, group: Sequence[Foot]) -> float | None:
    """Depth of what is beside things, where they stand."""
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
    depth: F32, normals: F32, labels: Labels, things: Sequence[PhotoObject], scenery: Scenery | None
) -> Section:
    """The section half as high above the table as things are: cushions and rims, not the table."""
    away = hidden_by_objects(labels)
    flat = depth - _table(depth, normals, away)
    full = fill_depth_behind(flat, away)
    heights = [float(np.median(flat[part])) for *_, part in _boxes(labels, things)]
    top = min(float(np.median(heights)), -SLACK)
    return _section(full, away, 0.5 * top, 0.0, top * (1.5 + NEAR), scenery)


def _table(depth: F32, normals: F32, away: Mask) -> F32:
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
    limit = plane + slack
    solid = (full < limit).astype(np.float32)
    if (
        scenery is not None
    ):  # the paper's choice: what reaches as far back as the foreground and as far forward
        ids = np.where(away, 0, scenery.labels)
        for i in np.unique(ids[ids > 0]).tolist():
            low, high = np.percentile(full[ids == i], (5, 95))
            if low > limit or high < nearest:
                solid[scenery.labels == i] = 0.0
    smooth = cv2.GaussianBlur(solid, (0, 0), SOFT) > 0.5
    return Section(full, smooth, ~away, plane, limit, nearest)
