"""Label map -> a region for each label; neighbours share one line where they meet, so they touch without overlap.

Every border between two labels is simplified once. Where three meet, the junction moves to where the straight borders
around it agree, the one between two objects first: blocks rest on flat faces.
"""

from __future__ import annotations

import cv2
import numpy as np

from physgen.geometry import Array, polygon_moments
from physgen.outline.borders import Border, BorderMap, Labels, trace_borders, walk
from physgen.outline.outline import Region, Ring
from physgen.outline.simplify import crossings, end_lines, simplify

TOLERANCE = 0.75
"""px that an outline may stand off its mask's half-level line (Hausdorff distance)."""

CONTACT_TOLERANCE = 1.0
"""px, the same for the border between two objects, so that contacts are straight."""

_JUNCTION_REACH = 0.5
"""px that a junction may move."""

_TINY = 30
"""px²: the borders of a smaller object between others stay as they are, lest nothing is left of it."""


def fit_regions(labels: Labels) -> dict[int, Region]:
    """Regions of all labels but 0 in a map `(H, W)`."""
    rows, columns = np.flatnonzero(labels.any(axis=1)), np.flatnonzero(labels.any(axis=0))
    if not len(rows):
        return {}
    part = labels[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    offset = np.array([columns[0], rows[0]], dtype=np.float64)
    traced = trace_borders(part)
    counts = np.bincount(part.ravel())
    tiny = {label for label in traced.loops if counts[label] < _TINY}
    lines = _untangle(traced, _settle_junctions(traced.borders, tiny), tiny)
    closed = [border.closed for border in traced.borders]
    found = {}
    for label, loops in sorted(traced.loops.items()):
        rings = [distinct(walk(loop, lines, closed)) + offset for loop in loops]
        found[label] = Region(tuple(_nest([ring for ring in rings if len(ring) >= 3])))
    return found


def close_gaps(labels: Labels) -> Labels:
    """Objects up to 2 px apart meet: background between two of them, along a row or a column, is shared out."""
    closed = labels.copy()
    for view in (closed, closed.T):
        padded = np.pad(view, 2)
        far, before, after, beyond = (padded[2:-2, k : k + view.shape[1]] for k in (0, 1, 3, 4))
        free = view == 0
        one = free & (before != 0) & (after != 0) & (before != after)
        first = free & (before != 0) & (after == 0) & (beyond != 0) & (before != beyond)
        second = free & (after != 0) & (before == 0) & (far != 0) & (far != after)
        view[...] = np.where(one | first, before, np.where(second, after, view))
    return closed


def distinct(ring: Array) -> Array:
    """Without corners that repeat the one before."""
    kept: Array = ring[np.abs(ring - np.roll(ring, 1, axis=0)).max(axis=1) > 1e-9]
    return kept


def _tolerance(border: Border) -> float:
    return CONTACT_TOLERANCE if border.left and border.right else TOLERANCE


def _settle_junctions(borders: tuple[Border, ...], tiny: set[int]) -> list[Array]:
    """The half-level lines, with their open ends moved to where the straight borders at each junction agree."""
    lines = [border.middles for border in borders]
    meeting: dict[tuple[float, float], list[tuple[int, int]]] = {}
    for index, border in enumerate(borders):
        if not border.closed:
            for end in (0, -1):
                meeting.setdefault((lines[index][end][0], lines[index][end][1]), []).append((index, end))
    fitted = {
        index: end_lines(lines[index], _tolerance(borders[index]))
        for index in {index for ends in meeting.values() for index, _ in ends}
    }
    for place, ends in meeting.items():
        if any({borders[index].left, borders[index].right} & tiny for index, _ in ends):
            continue
        junction = np.array(place)
        normal = 0.5 * np.eye(2)
        target = 0.5 * junction
        for index, end in ends:
            point, direction, count = fitted[index][end]
            if count < 4:
                continue
            weight = min(count, 20) * (4.0 if borders[index].left and borders[index].right else 1.0)
            across = weight * (np.eye(2) - np.outer(direction, direction))
            normal = normal + across
            target = target + across @ point
        move = np.linalg.solve(normal, target) - junction
        length = float(np.hypot(*move))
        moved = junction + move * min(1.0, _JUNCTION_REACH / max(length, 1e-12))
        for index, end in ends:
            lines[index] = lines[index].copy()
            lines[index][end] = moved
    return lines


def _untangle(traced: BorderMap, middles: list[Array], tiny: set[int]) -> list[Array]:
    """Simplify each border; where two of them then cross, simplify those less."""
    borders = traced.borders
    tolerance = [_tolerance(border) for border in borders]
    lines = [
        m if not b.closed and {b.left, b.right} & tiny else simplify(m, t, b.closed)
        for m, t, b in zip(middles, tolerance, borders, strict=True)
    ]
    whole = [_there_and_back(line, b) for line, b in zip(lines, borders, strict=True)]
    for attempt in range(6):
        crossed = np.unique(crossings(whole))
        if not len(crossed):
            break
        for k in crossed.tolist():
            border = borders[k]
            tolerance[k] /= 2
            lines[k] = simplify(middles[k], tolerance[k], border.closed) if attempt < 3 else middles[k]
            if attempt >= 4:
                lines[k] = border.middles
            whole[k] = _there_and_back(lines[k], border)
    return lines


def _there_and_back(line: Array, border: Border) -> Array:
    """An open line as a closed one without an edge from its end to its start."""
    return line if border.closed else np.concatenate([line, line[-2:0:-1]])


def _nest(loops: list[Array]) -> list[Ring]:
    """Put each hole (a loop that turns the other way) into the smallest piece around it."""
    areas = [polygon_moments(loop).area for loop in loops]
    outers = sorted((k for k, area in enumerate(areas) if area > 0), key=lambda k: areas[k])
    holes: dict[int, list[Array]] = {k: [] for k in outers}
    for k, area in enumerate(areas):
        if area < 0:
            x, y = (loops[k][0] + loops[k][1]) / 2
            around = (o for o in outers if areas[o] > -area and inside(loops[o], x, y))
            home = next(around, None)
            if home is not None:
                holes[home].append(loops[k])
    return [Ring(loops[k], tuple(holes[k])) for k in sorted(outers, key=lambda k: -areas[k])]


def inside(ring: Array, x: float, y: float) -> bool:
    """Is a point within a ring `(K, 2)` or on it?"""
    return cv2.pointPolygonTest(ring.astype(np.float32)[:, None], (float(x), float(y)), False) >= 0
