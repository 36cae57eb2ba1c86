"""Level floors of a world, and the floors on which the photo's shadows fall."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from physgen.arrays import U16
from physgen.compile.world import World
from physgen.geometry.polygon import Array
from physgen.render.occlusion import (
    SUNK,
    ground_below,
)


@dataclass(frozen=True)
class FloorTuning:
    """Slopes and gaps of level floors."""

    slope: float = 0.25
    """Slope above which a boundary is not a floor: its shadows are elsewhere."""
    gap: float = 9.0
    """Gap between two boundaries of one floor, px."""


FLOOR = FloorTuning()


def floors(world: World) -> list[Array]:
    """Return (8,) px for each nearly level segment of a wall.

    The values are both ends of the segment, the columns of both ends of its level
    floor, and 1 or 0 for an upright wall at either end.
    """
    segments = []
    for wall in world.walls:
        for chain in wall.chains:
            segments += list(map(np.concatenate, pairwise(chain)))
    level_segments, upright_segments = [], []
    for segment in segments:
        run, rise = np.abs(segment[2:] - segment[:2])
        if run > 1 and rise < FLOOR.slope * run:
            level_segments.append(segment)
        if run < FLOOR.slope * rise:
            upright_segments.append(segment)
    # Adjoining level segments form one floor, which ends at a wall or at an edge.
    grounds = []
    for segment in level_segments:
        left, right = _level_span(segment, level_segments)
        top = min(segment[1::2])
        walls = [_has_wall_at(x, top, upright_segments) for x in (left, right)]
        grounds.append(np.array([*segment, left, right, *walls]))
    return grounds


def _level_span(segment: Array, level: Sequence[Array]) -> tuple[float, float]:
    """Return the columns of both ends of a floor: of a segment and its level
    continuations.
    """
    spans = []
    for other in level:
        gaps = np.abs(np.subtract.outer(other[1::2], segment[1::2]))
        if gaps.min() < FLOOR.gap:
            spans.append((min(other[::2]), max(other[::2])))
    spans.sort()
    left, right = sorted(segment[::2])
    # Forwards and backwards, so that the span grows on both sides.
    for start, end in (*spans, *reversed(spans)):
        if start <= right + FLOOR.gap and end >= left - FLOOR.gap:
            left = min(left, start)
            right = max(right, end)
    return left, right


def _has_wall_at(x: float, floor: float, upright: Sequence[Array]) -> bool:
    """Check whether an upright segment stands at column `x` of a floor in this row."""
    for segment in upright:
        top, foot = sorted((segment[:2], segment[2:]), key=lambda end: end[1])
        is_near = abs(foot[0] - x) < FLOOR.gap
        if is_near and top[1] < floor < foot[1] + FLOOR.gap:
            return True
    return False


def shadows_pass_below(ground: Array, labels: U16, shadows: U16) -> bool:
    """Check whether the photo's shadows pass by a floor.

    Shadows of objects on it are then below it, on a wall behind. A floor that leads
    back to the wall would have received them; such a floor is a line that perception
    laid under floating objects, or a thin ledge. `ground` (4,) px; `labels` and
    `shadows` (H, W) by id.
    """
    count_below, count_standing = 0, 0
    for id_ in np.unique(shadows[shadows > 0]):
        rows, columns = np.nonzero(labels == id_)
        if not len(rows):
            continue
        bottom = float(rows.max())
        # Only objects that stand on a floor tell whether shadows fall on it or pass
        # below.
        floor = ground_below([ground], float(columns.mean()), bottom - SUNK)
        if floor is None or floor[0] - bottom >= 2 * SUNK:
            continue
        count_standing += 1
        shadow_row = np.median(np.nonzero(shadows == id_)[0])
        count_below += bool(shadow_row > floor[0] + SUNK)
    return 2 * count_below > count_standing
