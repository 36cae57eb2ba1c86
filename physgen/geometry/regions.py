"""From a label map to regions: borders are traced once and shared by neighbours.

A border runs along pixel edges, hence a ring's area is its number of pixels. Pixels of
one label that meet only at a corner are separate, unless they separate two objects.
Every border is simplified once, so that neighbours touch without overlap. A junction of
three borders moves to the common point of the straight borders around it; those between
two objects have the most weight.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import Mask
from physgen.geometry.polygon import Array, Region, Ring, polygon_moments
from physgen.geometry.simplify import crossings, end_lines, simplify

# Directions along the pixel grid, each a quarter turn (+x towards +y) after the one
# before.
_NORTH, _EAST, _SOUTH, _WEST = range(4)
_STEP = ((-1, 0), (0, 1), (1, 0), (0, -1))
"""Row, column."""


@dataclass(frozen=True, eq=False)
class Border:
    """The border of two labels: `corners` `(n + 1, 2)` float64 px along pixel edges.

    `right` is the label on the side reached by a turn from +x towards +y (for a step
    along +x: below). A closed border repeats no corner; an open one connects two
    junctions.
    """

    corners: Array
    left: int
    right: int
    is_loop: bool

    @property
    def middles(self) -> Array:
        """Return the half-level line `(m, 2)`: the middles of pixel edges, and both
        open ends.

        It differs from the pixel border by at most 0.354 px, and turns stairs into
        slopes.
        """
        if self.is_loop:
            return (self.corners + np.roll(self.corners, -1, axis=0)) / 2
        halves = (self.corners[1:] + self.corners[:-1]) / 2
        return np.concatenate([self.corners[:1], halves, self.corners[-1:]])


@dataclass(frozen=True)
class Step:
    """A border as part of a loop: its index, and whether it is traversed backwards."""

    border: int
    backwards: bool


Loop = tuple[Step, ...]
"""A closed path around a label, which is on its right: outer rings turn +x towards +y,
holes the other way."""


@dataclass(frozen=True, eq=False)
class BorderMap:
    """All borders of a label map, and the loops of each label but the background."""

    borders: tuple[Border, ...]
    loops: dict[int, tuple[Loop, ...]]


def trace_borders(labels: NDArray[np.integer]) -> BorderMap:
    """Trace a label map `(H, W)`, 0 = background; the area beyond the photo is
    background.
    """
    padded_labels = np.pad(labels.astype(np.int64), 1)
    borders: list[Border] = []
    leaving: dict[tuple[int, int, int], Step] = {}
    for corners, directions, closed in _walks(_links(padded_labels)):
        row, column = corners[0]
        left, right = _sides(padded_labels, row, column, directions[0])
        if closed:
            corners.pop()
        else:
            # An open border can be walked from both of its ends: store how each end
            # leaves its junction, to connect the borders to loops.
            number = len(borders)
            leaving[row, column, directions[0]] = Step(number, backwards=False)
            end = (*corners[-1], directions[-1] ^ 2)
            leaving[end] = Step(number, backwards=True)
        points = np.array(corners, dtype=np.float64)[:, ::-1] - 0.5
        borders.append(Border(points, left, right, closed))
    return BorderMap(tuple(borders), _loops_by_label(borders, leaving))


def _loops_by_label(
    borders: Sequence[Border], leaving: dict[tuple[int, int, int], Step]
) -> dict[int, tuple[Loop, ...]]:
    """Return the loops of each label but the background."""
    loops = _closed_loops(borders)
    for label, loop in _open_loops(borders, leaving):
        loops.setdefault(label, []).append(loop)
    loops.pop(0, None)
    return {label: tuple(label_loops) for label, label_loops in loops.items()}


def _closed_loops(borders: Sequence[Border]) -> dict[int, list[Loop]]:
    """Return the loops of single closed borders, by label."""
    loops: dict[int, list[Loop]] = {}
    for index, border in enumerate(borders):
        if border.is_loop:
            loops.setdefault(border.right, []).append((Step(index, False),))
            loops.setdefault(border.left, []).append((Step(index, True),))
    return loops


def _open_loops(
    borders: Sequence[Border], leaving: dict[tuple[int, int, int], Step]
) -> Iterator[tuple[int, Loop]]:
    """Yield a label and a loop of open borders.

    `leaving`: the step that starts at each corner in each direction.
    """
    places = {step: key for key, step in leaving.items()}
    remaining = dict.fromkeys(leaving.values())
    # Each step belongs to exactly one loop.
    while remaining:
        first = next(iter(remaining))
        loop = [first]
        del remaining[first]
        while True:
            step = loop[-1]
            # The end of a border is the start of its reverse.
            end = places[Step(step.border, not step.backwards)]
            following = _next_step(end, leaving)
            if following == first:
                break
            loop.append(following)
            del remaining[following]
        border = borders[first.border]
        yield border.left if first.backwards else border.right, tuple(loop)


def _next_step(
    end: tuple[int, int, int], leaving: dict[tuple[int, int, int], Step]
) -> Step:
    """Return the next step after another one, with the label on the right."""
    row, column, direction = end
    for turn in (3, 2, 1):
        step = leaving.get((row, column, (direction + turn) % 4))
        if step is not None:
            return step
    raise AssertionError("a border ends at a junction")


def walk(
    loop: Loop, lines: tuple[Array, ...] | list[Array], is_loop: list[bool]
) -> Array:
    """Return the ring `(K, 2)` px of a loop.

    `lines` has the points of each border in the border's own direction.
    """
    parts = []
    for step in loop:
        line = lines[step.border]
        if step.backwards:
            line = line[::-1]
        parts.append(line if is_loop[step.border] else line[:-1])
    return np.concatenate(parts)


def _links(labels: NDArray[np.int64]) -> list[NDArray[np.int8]]:
    """Return the next edge of each edge, per direction `(H + 1, W + 1)` int8.

    -1 stands for a junction, -2 for no edge.
    """
    nw = labels[:-1, :-1]
    ne = labels[:-1, 1:]
    sw = labels[1:, :-1]
    se = labels[1:, 1:]
    # An edge separates two labels; the number of edges at a corner is its degree.
    is_edge = np.stack([nw != ne, ne != se, sw != se, nw != sw])
    degree = is_edge.sum(axis=0)
    links = [np.where(edges, -1, -2).astype(np.int8) for edges in is_edge]
    # At a corner with two edges, one continues the other.
    is_passage = degree == 2
    for d, e in permutations(range(4), 2):
        connects = is_passage & is_edge[d] & is_edge[e]
        links[d][connects] = e
    # At a crossing of two pairs of pixels, one of the pairs is connected.
    falling = (nw == se) & (degree == 4)
    rising = (ne == sw) & (degree == 4)
    is_crossing = falling & rising
    # If both pairs have equal pixels, the background is connected, and the corner
    # separates the object's pixels.
    falling = falling & ~(is_crossing & (nw != 0))
    rising = rising & ~(is_crossing & (nw == 0))
    _link_pairs(links, falling, ((_NORTH, _EAST), (_SOUTH, _WEST)))
    _link_pairs(links, rising & ~falling, ((_NORTH, _WEST), (_SOUTH, _EAST)))
    return links


def _link_pairs(
    links: list[NDArray[np.int8]],
    crossing: Mask,
    pairs: tuple[tuple[int, int], ...],
) -> None:
    """Connect pairs of directions at crossings, in place."""
    for d, e in pairs:
        links[d][crossing], links[e][crossing] = e, d


def _walks(
    links: list[NDArray[np.int8]],
) -> Iterator[tuple[list[tuple[int, int]], list[int], bool]]:
    """Yield paths along edges: corners (row, column), directions, and whether they are
    closed.

    Every edge occurs once.
    """
    table = np.stack(links, axis=-1)
    places = np.argwhere((table != -2).any(axis=-1))
    following = table[tuple(places.T)].tolist()
    next_places = dict(zip(map(tuple, places.tolist()), following, strict=True))
    visited_links: set[tuple[int, int, int]] = set()
    for start in _walk_starts(table, next_places):
        if start not in visited_links:
            yield _follow(start, next_places, visited_links)


def _walk_starts(
    table: NDArray[np.int8], next_corners: dict[tuple[int, ...], list[int]]
) -> Iterator[tuple[int, int, int]]:
    """Yield edges from junctions, then edges to the right, as of loops without
    junctions.
    """
    for row, column in np.argwhere((table == -1).any(axis=-1)).tolist():
        for direction in range(4):
            if next_corners[row, column][direction] == -1:
                yield row, column, direction
    for row, column in np.argwhere(table[:, :, _EAST] >= 0).tolist():
        yield row, column, _EAST


def _follow(
    start: tuple[int, int, int],
    next_corners: dict[tuple[int, ...], list[int]],
    known_edges: set[tuple[int, int, int]],
) -> tuple[list[tuple[int, int]], list[int], bool]:
    """Follow edges to a junction or back to the start; mark both directions as
    visited.
    """
    row, column, direction = start
    corners = [(row, column)]
    directions = []
    while True:
        known_edges.add((row, column, direction))
        directions.append(direction)
        row = row + _STEP[direction][0]
        column = column + _STEP[direction][1]
        corners.append((row, column))
        back = direction ^ 2
        known_edges.add((row, column, back))
        direction = next_corners[row, column][back]
        if direction < 0 or (row, column, direction) == start:
            return corners, directions, direction >= 0


def _sides(
    labels: NDArray[np.int64], row: int, column: int, direction: int
) -> tuple[int, int]:
    """Return the labels to the left and right of an edge from a corner."""
    nw = int(labels[row, column])
    ne = int(labels[row, column + 1])
    sw = int(labels[row + 1, column])
    se = int(labels[row + 1, column + 1])
    return ((nw, ne), (ne, se), (se, sw), (sw, nw))[direction]


TOLERANCE = 0.75
"""Distance of an outline from its mask's half-level line, px (Hausdorff distance)."""

CONTACT_TOLERANCE = 1.0
"""The same for the border of two objects, px, such that contacts are straight."""

_JUNCTION_REACH = 0.5
"""Maximum displacement of a junction, px."""

_TINY = 30
"""Area of an object, px², below which its borders are not simplified, so that it does
not vanish.
"""


def fit_regions(
    labels: NDArray[np.int64], coarseness: float = 1.0
) -> dict[int, Region]:
    """Fit regions to all labels but 0 in a map `(H, W)`.

    `coarseness` multiplies the tolerances of the outlines.
    """
    rows = np.flatnonzero(labels.any(axis=1))
    columns = np.flatnonzero(labels.any(axis=0))
    if not len(rows):
        return {}
    # To save time for small objects, trace only the box around all labels.
    row_span = slice(rows[0], rows[-1] + 1)
    column_span = slice(columns[0], columns[-1] + 1)
    part = labels[row_span, column_span]
    offset = np.array([columns[0], rows[0]], dtype=np.float64)
    borders = trace_borders(part)
    tiny = _tiny_labels(part, borders)
    # Junctions first: their places decide the ends of lines, which are simplified next.
    settled_lines = _settle_junctions(borders.borders, tiny, coarseness)
    lines = _untangle(borders, settled_lines, tiny, coarseness)
    regions = {}
    for label, loops in sorted(borders.loops.items()):
        rings = _rings(borders, loops, lines, offset)
        regions[label] = Region(tuple(_nest(rings)))
    return regions


def _tiny_labels(labels: NDArray[np.int64], borders: BorderMap) -> set[int]:
    """Return the labels of a few pixels."""
    areas = np.bincount(labels.ravel())
    return {label for label in borders.loops if areas[label] < _TINY}


def _rings(
    borders: BorderMap, loops: Sequence[Loop], lines: list[Array], offset: Array
) -> list[Array]:
    """Return the rings `(K, 2)` px of a label's loops, moved by `offset`; rings without
    area are lost.
    """
    closed = [border.is_loop for border in borders.borders]
    rings = []
    for loop in loops:
        ring = distinct(walk(loop, lines, closed)) + offset
        if len(ring) >= 3:
            rings.append(ring)
    return rings


def close_gaps(labels: NDArray[np.int64]) -> NDArray[np.int64]:
    """Join objects up to 2 px apart: background pixels between them are divided."""
    # Labels of one or two bytes are compared several times as fast.
    closed_labels = labels.astype(np.min_scalar_type(labels.max(initial=0)))
    # Gaps are closed along rows, then along columns.
    for view in (closed_labels, closed_labels.T):
        padded_view = np.pad(view, 2)
        width = view.shape[1]
        inner_rows = padded_view[2:-2]
        # The pixels 2 and 1 before, and 1 and 2 after each pixel.
        two_before = inner_rows[:, :width]
        before = inner_rows[:, 1 : 1 + width]
        after = inner_rows[:, 3 : 3 + width]
        two_after = inner_rows[:, 4 : 4 + width]
        free = view == 0
        gap_pixels = free & (before != 0) & (after != 0) & (before != after)
        is_first = free & (before != 0) & (after == 0)
        is_first &= (two_after != 0) & (before != two_after)
        is_second = free & (after != 0) & (before == 0)
        is_second &= (two_before != 0) & (two_before != after)
        closed_view = np.where(is_second, after, view)
        view[...] = np.where(gap_pixels | is_first, before, closed_view)
    return closed_labels.astype(np.int64)


def distinct(ring: Array) -> Array:
    """Remove corners equal to the one before."""
    steps = np.abs(ring - np.roll(ring, 1, axis=0))
    corners: Array = ring[steps.max(axis=1) > 1e-9]
    return corners


def _tolerance(border: Border) -> float:
    """Return the tolerance of a border, px."""
    if border.left and border.right:
        return CONTACT_TOLERANCE
    return TOLERANCE


def _settle_junctions(
    borders: tuple[Border, ...], tiny: set[int], coarseness: float
) -> list[Array]:
    """Return the half-level lines, with open ends moved to their junctions' best
    places.
    """
    lines = [border.middles for border in borders]
    junctions: dict[tuple[float, float], list[tuple[int, int]]] = {}
    runs = {}
    # Collect the open ends that meet at each junction.
    for index, border in enumerate(borders):
        if border.is_loop:
            continue
        runs[index] = end_lines(lines[index], coarseness * _tolerance(border))
        for end in (0, -1):
            x, y = lines[index][end]
            junctions.setdefault((x, y), []).append((index, end))
    for place, ends in junctions.items():
        labels = {borders[index].left for index, _ in ends}
        labels |= {borders[index].right for index, _ in ends}
        # Regions of a few pixels have no straight borders to fit.
        if labels & tiny:
            continue
        straight_ends = [(borders[index], runs[index][end]) for index, end in ends]
        new_place = _moved_junction(np.array(place), straight_ends)
        for index, end in ends:
            lines[index] = lines[index].copy()
            lines[index][end] = new_place
    return lines


def _moved_junction(
    junction: Array, straight_ends: Sequence[tuple[Border, tuple[Array, Array, int]]]
) -> Array:
    """Return the point (2,) px near a junction that is closest to its straight borders.

    `straight_ends`: a border with point, direction and number of points of its straight
    end.
    """
    normal = 0.5 * np.eye(2)
    target = 0.5 * junction
    for border, (point, direction, count) in straight_ends:
        if count < 4:
            continue
        # Borders between two objects have the most weight, so that contacts are
        # straight.
        importance = 1.0
        if border.left and border.right:
            importance = 4.0
        weight = min(count, 20) * importance
        normal_weight = weight * (np.eye(2) - np.outer(direction, direction))
        normal = normal + normal_weight
        target = target + normal_weight @ point
    # The old place has a small weight, so that parallel borders do not move it
    # far.
    move = np.linalg.solve(normal, target) - junction
    length = float(np.hypot(*move))
    return junction + move * min(1.0, _JUNCTION_REACH / max(length, 1e-12))


def _untangle(
    border_map: BorderMap, middles: list[Array], tiny: set[int], coarseness: float
) -> list[Array]:
    """Simplify each border; if two of them then cross, simplify these less."""
    borders = border_map.borders
    tolerance = [coarseness * _tolerance(border) for border in borders]
    lines = []
    for k, border in enumerate(borders):
        line = middles[k]
        if border.is_loop or not {border.left, border.right} & tiny:
            line = simplify(line, tolerance[k], border.is_loop)
        lines.append(line)
    # Neighbours share borders, so that only crossings make regions overlap.
    rings = [_there_and_back(line, b) for line, b in zip(lines, borders, strict=True)]
    for attempt in range(6):
        crossing_rings = np.unique(crossings(rings))
        if not len(crossing_rings):
            break
        for k in crossing_rings.tolist():
            border = borders[k]
            tolerance[k] /= 2
            # After several attempts the line is not simplified, and finally its
            # junctions are not moved.
            if attempt < 3:
                lines[k] = simplify(middles[k], tolerance[k], border.is_loop)
            elif attempt < 4:
                lines[k] = middles[k]
            else:
                lines[k] = border.middles
            rings[k] = _there_and_back(lines[k], border)
    return lines


def _there_and_back(line: Array, border: Border) -> Array:
    """Return an open line as a closed one, there and back."""
    if border.is_loop:
        return line
    return np.concatenate([line, line[-2:0:-1]])


def _nest(loops: list[Array]) -> list[Ring]:
    """Assign each hole (a loop that turns the other way) to the smallest piece around
    it.
    """
    areas = [polygon_moments(loop).area for loop in loops]
    outers = []
    for k, area in enumerate(areas):
        if area > 0:
            outers.append(k)
    # The smallest piece around a hole is found first.
    outers.sort(key=lambda k: areas[k])
    holes: dict[int, list[Array]] = {k: [] for k in outers}
    for k, area in enumerate(areas):
        if area >= 0:
            continue
        x, y = (loops[k][0] + loops[k][1]) / 2
        for outer in outers:
            if areas[outer] > -area and inside(loops[outer], x, y):
                holes[outer].append(loops[k])
                break
    largest_first = sorted(outers, key=lambda k: -areas[k])
    return [Ring(loops[k], tuple(holes[k])) for k in largest_first]


def inside(ring: Array, x: float, y: float) -> bool:
    """Check whether a point is within a ring `(K, 2)` or on it."""
    contour = ring.astype(np.float32)[:, None]
    return cv2.pointPolygonTest(contour, (float(x), float(y)), False) >= 0
