"""Label map to regions: borders between labels are traced once and shared by neighbours.

A border runs along pixel edges, so a ring's area is its count of pixels. Pixels of one label that meet at a corner only
are separate, unless they part two objects. Every border is simplified once, so neighbours touch without overlap. Where
three borders meet, the junction moves to where the straight borders around it agree, those between two objects first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Array, Region, Ring, polygon_moments
from physgen.geometry.simplify import crossings, end_lines, simplify

Labels = NDArray[np.int64]

# directions along the pixel grid, each one a quarter turn (+x towards +y) after the last
_NORTH, _EAST, _SOUTH, _WEST = range(4)
_STEP = ((-1, 0), (0, 1), (1, 0), (0, -1))
"""Row, column."""


@dataclass(frozen=True, eq=False)
class Border:
    """Where two labels meet: `corners` `(n + 1, 2)` float64 px, one pixel edge after another.

    Going along it, `right` is the label on the side that +x turned towards +y shows (for a step along +x: below).
    A closed border repeats no corner; an open one runs from a junction of three or four labels to another.
    """

    corners: Array
    left: int
    right: int
    closed: bool

    @property
    def middles(self) -> Array:
        """The half-level line `(m, 2)`: the middles of the pixel edges, with both ends of an open border.

        It stands off the pixel border by at most 0.354 px and turns stairs into slopes.
        """
        if self.closed:
            return (self.corners + np.roll(self.corners, -1, axis=0)) / 2
        halves = (self.corners[1:] + self.corners[:-1]) / 2
        return np.concatenate([self.corners[:1], halves, self.corners[-1:]])


@dataclass(frozen=True)
class Step:
    """A border on a label's way round: its index, and whether it is walked against its own direction."""

    border: int
    backwards: bool


Loop = tuple[Step, ...]
"""A label's way round one ring; the label lies on its right, so outer rings turn +x towards +y, holes the other way."""


@dataclass(frozen=True, eq=False)
class BorderMap:
    """All borders of a label map, and the loops of each label but the background."""

    borders: tuple[Border, ...]
    loops: dict[int, tuple[Loop, ...]]


def trace_borders(labels: NDArray[np.integer]) -> BorderMap:
    """Trace a label map `(H, W)`, 0 = background, what lies beyond the photo included."""
    padded = np.zeros((labels.shape[0] + 2, labels.shape[1] + 2), dtype=np.int64)
    padded[1:-1, 1:-1] = labels
    links = _links(padded)
    borders: list[Border] = []
    leaving: dict[tuple[int, int, int], Step] = {}
    for corners, directions, closed in _walks(links):
        row, column = corners[0]
        left, right = _sides(padded, row, column, directions[0])
        points = (
            np.array(corners if not closed else corners[:-1], dtype=np.float64)[:, ::-1]
            - 0.5
        )
        if not closed:
            leaving[row, column, directions[0]] = Step(len(borders), backwards=False)
            leaving[(*corners[-1], directions[-1] ^ 2)] = Step(
                len(borders), backwards=True
            )
        borders.append(Border(points, left, right, closed))
    firsts = {step: key for key, step in leaving.items()}

    loops: dict[int, list[Loop]] = {}
    for index, border in enumerate(borders):
        if border.closed:
            for label, backwards in ((border.right, False), (border.left, True)):
                loops.setdefault(label, []).append((Step(index, backwards),))
    waiting = dict.fromkeys(leaving.values())
    while waiting:
        first = next(iter(waiting))
        loop = [first]
        step = first
        while True:
            del waiting[step]
            # the end of this border is where its reverse leaves; turn towards the label on the right
            row, column, direction = firsts[Step(step.border, not step.backwards)]
            for turn in (3, 2, 1):
                following = leaving.get((row, column, (direction + turn) % 4))
                if following is not None:
                    break
            assert following is not None
            if following == first:
                break
            step = following
            loop.append(step)
        border = borders[first.border]
        loops.setdefault(border.left if first.backwards else border.right, []).append(
            tuple(loop)
        )
    loops.pop(0, None)
    return BorderMap(
        tuple(borders), {label: tuple(found) for label, found in loops.items()}
    )


def walk(
    loop: Loop, lines: tuple[Array, ...] | list[Array], closed: list[bool]
) -> Array:
    """The ring `(K, 2)` px of a loop, given one line of points for each border (in the border's own direction)."""
    parts = []
    for step in loop:
        line = lines[step.border]
        if step.backwards:
            line = line[::-1]
        parts.append(line if closed[step.border] else line[:-1])
    return np.concatenate(parts)


def _links(padded: Labels) -> list[NDArray[np.int8]]:
    """For each direction `(H + 1, W + 1)` int8: the edge that goes on from this one; -1 a junction, -2 no edge."""
    nw, ne, sw, se = padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]
    there = np.stack([nw != ne, ne != se, sw != se, nw != sw])
    degree = there.sum(axis=0)
    links = [np.where(there[d], -1, -2).astype(np.int8) for d in range(4)]
    for d in range(4):
        for e in range(4):
            if d != e:
                links[d][(degree == 2) & there[d] & there[e]] = e
    falling, rising = (nw == se) & (degree == 4), (ne == sw) & (degree == 4)
    both = falling & rising
    # of two crossing pairs the background joins, so that corners part an object's pixels
    falling, rising = falling & ~(both & (nw != 0)), rising & ~(both & (nw == 0))
    for pairs, where in (
        (((_NORTH, _EAST), (_SOUTH, _WEST)), falling),
        (((_NORTH, _WEST), (_SOUTH, _EAST)), rising & ~falling),
    ):
        for d, e in pairs:
            links[d][where], links[e][where] = e, d
    return links


def _walks(
    links: list[NDArray[np.int8]],
) -> Iterator[tuple[list[tuple[int, int]], list[int], bool]]:
    """Follow the edges: corners (row, column), the directions between them, closed or not; every edge once."""
    table = np.stack(links, axis=-1)
    places = np.argwhere((table != -2).any(axis=-1))
    onward = dict(
        zip(map(tuple, places.tolist()), table[tuple(places.T)].tolist(), strict=True)
    )
    seen: set[tuple[int, int, int]] = set()
    junctions = np.argwhere((table == -1).any(axis=-1)).tolist()
    # loops without junctions start at an edge to the right
    others = np.argwhere(table[:, :, _EAST] >= 0).tolist()
    starts = [
        (r, c, d) for r, c in junctions for d in range(4) if onward[r, c][d] == -1
    ]
    for start in (*starts, *((r, c, _EAST) for r, c in others)):
        if start in seen:
            continue
        row, column, direction = start
        corners, directions = [(row, column)], []
        while True:
            seen.add((row, column, direction))
            directions.append(direction)
            row, column = row + _STEP[direction][0], column + _STEP[direction][1]
            corners.append((row, column))
            back = direction ^ 2
            seen.add((row, column, back))
            direction = onward[row, column][back]
            if direction < 0 or (row, column, direction) == start:
                break
        yield corners, directions, direction >= 0


def _sides(padded: Labels, row: int, column: int, direction: int) -> tuple[int, int]:
    """Labels to the left and right of the edge that leaves a corner."""
    nw, ne = int(padded[row, column]), int(padded[row, column + 1])
    sw, se = int(padded[row + 1, column]), int(padded[row + 1, column + 1])
    return ((nw, ne), (ne, se), (se, sw), (sw, nw))[direction]


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
    rows, columns = (
        np.flatnonzero(labels.any(axis=1)),
        np.flatnonzero(labels.any(axis=0)),
    )
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
        far, before, after, beyond = (
            padded[2:-2, k : k + view.shape[1]] for k in (0, 1, 3, 4)
        )
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
                meeting.setdefault(
                    (lines[index][end][0], lines[index][end][1]), []
                ).append((index, end))
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
            weight = min(count, 20) * (
                4.0 if borders[index].left and borders[index].right else 1.0
            )
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
            lines[k] = (
                simplify(middles[k], tolerance[k], border.closed)
                if attempt < 3
                else middles[k]
            )
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
    outers = sorted(
        (k for k, area in enumerate(areas) if area > 0), key=lambda k: areas[k]
    )
    holes: dict[int, list[Array]] = {k: [] for k in outers}
    for k, area in enumerate(areas):
        if area < 0:
            x, y = (loops[k][0] + loops[k][1]) / 2
            around = (o for o in outers if areas[o] > -area and inside(loops[o], x, y))
            home = next(around, None)
            if home is not None:
                holes[home].append(loops[k])
    return [
        Ring(loops[k], tuple(holes[k])) for k in sorted(outers, key=lambda k: -areas[k])
    ]


def inside(ring: Array, x: float, y: float) -> bool:
    """Is a point within a ring `(K, 2)` or on it?"""
    return (
        cv2.pointPolygonTest(
            ring.astype(np.float32)[:, None], (float(x), float(y)), False
        )
        >= 0
    )
