"""Continuation of edges through a hole, with flat colour between them.

The direction of an edge and the colours on both of its sides are measured at the hole's
border. Two ends with the same colours that a gentle bend can connect are one edge
(least bending energy of a cubic, as in Masnou and Morel 1998, Level lines based
disocclusion). An unmatched edge continues straight to a corner with another one, or to
the first line in its way. An unmatched edge with high contrast, e.g. a shelf's end in
front of a white wall, crosses the hole.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.inpaint.border_ends import (
    OFFSET,
    STRIP,
    BorderEnd,
    KnownSurroundings,
    border_ends,
    border_profile,
)
from physgen.perceive.inpaint.ellipse_arcs import ellipse_arc, follow_edge
from physgen.perceive.inpaint.poisson import dilate
from physgen.perceive.roles import Mask

F64 = NDArray[np.float64]

# px by which the photo is extended, so that edges can enter a hole at its border.
PAD = 12
# px on each side of an arc; pixels farther away are copied instead.
ARC_STRIP = 6
# Levels between both sides: fainter edges may be texture.
ARC_CONTRAST = 45.0
# px: distance of the compared colours across the edges of a painted line.
TWIN = 4
# Least contrast of a line's other edge, reversed, as a share of the first one's.
TWIN_CONTRAST = 0.5
# px: length of a bent edge that costs as much doubt as its bending energy.
BEND_PATH = 67
# Weight of the bending energy in the order of pairs.
BEND_WEIGHT = 7
# Pairs of a pixel and a point of a line in memory at once.
CHUNK = 500_000


@dataclass(frozen=True)
class _Matching:
    """Thresholds of edges and of pairs; colours in levels of 0..255."""

    # Least contrast of a continued unmatched edge.
    unmatched_contrast: float = 50.0
    # Least contrast of an unmatched edge across the whole hole.
    certain_contrast: float = 200.0
    # Largest difference between both ends on the more similar side of an edge.
    similar: float = 25.0
    # Largest doubt that two ends belong to one edge: colours, turns without an arc,
    # long bends.
    max_doubt: float = 0.75
    # Least bending energy of an omitted edge along the hole's border.
    bulge: float = 0.1
    # Least sine of the angle between two edges of a corner.
    corner_sine: float = 0.5

    def similar_sides(self, near: float, contrasts: float) -> bool:
        """Return whether the more similar sides of two ends may show one surface.

        `near` is their difference; `contrasts` is the sum of both ends' contrasts.
        """
        return near < max(self.similar, 0.17 * contrasts)


MATCHING = _Matching()


@dataclass(frozen=True)
class BorderLine:
    """An edge in the hole."""

    # (n, 2): x, y, at most 1 px apart.
    points: F64
    # (2 STRIP + 1, 3): colours across its first point, left to right.
    first: F64
    # The same at its last point.
    last: F64


FEWEST_POINTS = 2
"""Least number of points of a line with a direction."""


def continue_edges(picture: F32, hole: Mask) -> tuple[F32, Mask]:
    """Return the picture with edges continued through `hole` (H, W), and their strips
    (H, W).
    """
    height, width = hole.shape
    edges = (PAD,) * 4
    picture = np.asarray(
        cv2.copyMakeBorder(picture, *edges, cv2.BORDER_REPLICATE), np.float32
    )
    hole = cv2.copyMakeBorder(hole.astype(np.uint8), *edges, cv2.BORDER_REPLICATE) > 0
    result, strips = picture.copy(), np.zeros_like(hole)
    surroundings = KnownSurroundings.measure(picture, dilate(hole, 1))
    count, ids = cv2.connectedComponents(hole.astype(np.uint8), connectivity=8)
    for k in range(1, count):
        piece = ids == k
        for line in _lines(list(border_ends(surroundings, piece)), piece, surroundings):
            _paint_strip(result, strips, piece, line)
    inner = slice(PAD, PAD + height), slice(PAD, PAD + width)
    return result[inner], strips[inner]


def continue_arcs(picture: F32, hole: Mask) -> tuple[F32, Mask]:
    """Return the picture with circles and ellipses continued through `hole`, and their
    strips.

    Strips are `ARC_STRIP` px wide on both sides of the edges.
    """
    result, strips = picture.copy(), np.zeros_like(hole)
    surroundings = KnownSurroundings.measure(picture, dilate(hole, 1))
    count, ids = cv2.connectedComponents(hole.astype(np.uint8), connectivity=8)
    for number in range(1, count):
        piece = ids == number
        for line in _arcs(
            list(border_ends(surroundings, piece)), piece, surroundings, set()
        ):
            _paint_strip(result, strips, piece, line, ARC_STRIP)
    return result, strips


def _lines(
    ends: list[BorderEnd], piece: Mask, known: KnownSurroundings
) -> Iterator[BorderLine]:
    """Yield arcs, then joined pairs, best first, then unmatched ends."""
    line_mask = np.zeros(piece.shape, bool)
    used_ends: set[int] = set()
    for line in _arcs(ends, piece, known, used_ends):
        _draw(line_mask, line.points)
        yield line
    yield from _pairs(ends, piece, line_mask, used_ends)
    free_ends = [
        e
        for k, e in enumerate(ends)
        if k not in used_ends and e.contrast > MATCHING.unmatched_contrast
    ]
    # The end of an edge at a T-junction comes second; remaining ends may form a corner.
    for last in (False, False, True):
        meetings = _meeting_lines(free_ends, piece, line_mask)
        yield from meetings
        if not (last or meetings):
            yield from _corner_lines(free_ends, piece, line_mask)
    yield from _crossing_lines(free_ends, piece, line_mask)


def _meeting_lines(
    free_ends: list[BorderEnd], piece: Mask, drawn: Mask
) -> list[BorderLine]:
    """Return straight lines from ends to drawn lines; draw them and take their ends."""
    paths = [straight_to_line(end, piece, drawn) for end in free_ends]
    lines = [
        BorderLine(path, end.profile, end.profile)
        for end, path in zip(free_ends, paths, strict=True)
        if path is not None
    ]
    free_ends[:] = [
        end for end, path in zip(free_ends, paths, strict=True) if path is None
    ]
    for line in lines:
        _draw(drawn, line.points)
    return lines


def _corner_lines(
    free_ends: list[BorderEnd], piece: Mask, drawn: Mask
) -> Iterator[BorderLine]:
    """Yield corners of two ends; draw them and take their ends."""
    for a, b, place in corner_pairs(free_ends, piece, drawn):
        free_ends[:] = [end for end in free_ends if end is not a and end is not b]
        path = np.concatenate(
            [line_points(a.place, place), line_points(place, b.place)[1:]]
        )
        _draw(drawn, path)
        yield BorderLine(path, a.profile, b.profile[::-1])


def _crossing_lines(
    ends: Sequence[BorderEnd], piece: Mask, drawn: Mask
) -> Iterator[BorderLine]:
    """Yield straight lines across the hole from ends with high contrast; draw them."""
    strong_ends = [end for end in ends if end.contrast > MATCHING.certain_contrast]
    for end in sorted(strong_ends, key=lambda one: -one.contrast):
        path, inside = straight_path(end.place, end.direction, piece)
        path = path[: np.flatnonzero(np.append(True, inside))[-1]]
        x, y = np.round(path).astype(int).T
        if len(path) and not drawn[y, x].any():
            _draw(drawn, path)
            yield BorderLine(path, end.profile, end.profile)


def _arcs(
    ends: list[BorderEnd], piece: Mask, known: KnownSurroundings, joined: set[int]
) -> Iterator[BorderLine]:
    """Yield arcs of ellipses between ends of one edge; add these ends to `joined`."""
    number = {id(end): index for index, end in enumerate(ends)}
    all_ends = _add_twins([end for end in ends if end.contrast > ARC_CONTRAST], known)
    edges = [
        follow_edge(known.picture, known.blocked_mask, end.place, -end.direction)
        for end in all_ends
    ]
    used_indices: set[int] = set()
    for second, b in enumerate(all_ends):
        for first, a in enumerate(all_ends[:second]):
            if {first, second} & used_indices or not _may_be_one(a, b):
                continue
            sides = edges[first], edges[second]
            points = ellipse_arc(sides, (a.direction, b.direction), piece)
            if points is not None:
                used_indices |= {first, second}
                joined |= {number[id(end)] for end in (a, b) if id(end) in number}
                yield BorderLine(points, a.profile, b.profile[::-1])


def _add_twins(ends: list[BorderEnd], known: KnownSurroundings) -> list[BorderEnd]:
    """Return ends and their twins.

    A painted ring has two edges, of which only the stronger one is detected.
    """
    twins = [_twin(end, known) for end in ends]
    return ends + [twin for twin in twins if twin is not None]


def _may_be_one(a: BorderEnd, b: BorderEnd) -> bool:
    """Return whether the colours of two ends allow that they belong to one edge."""
    return _has_similar_side(a, b) and _colour_doubt(a, b) < MATCHING.max_doubt


def _twin(end: BorderEnd, known: KnownSurroundings) -> BorderEnd | None:
    """Return the other edge of a painted line with the edge `end`, or None if it is
    wide.
    """
    profile = border_profile(
        known.picture, known.blocked_mask, end.place, end.direction
    )
    gap = profile[TWIN:] - profile[:-TWIN]
    middle = len(gap) // 2
    # The other edge has the opposite change of colour.
    similarity = gap @ gap[middle] / max(float(gap[middle] @ gap[middle]), 1.0)
    similarity = np.nan_to_num(similarity)
    step = int(np.argmin(similarity)) - middle
    if similarity.min() > -TWIN_CONTRAST or abs(step) < 2:
        return None
    normal = np.array([-end.direction[1], end.direction[0]])
    place = end.place + step * normal
    twin_profile = border_profile(
        known.picture, known.blocked_mask, place, end.direction
    )
    return BorderEnd(
        end.order,
        place,
        end.direction,
        np.nan_to_num(twin_profile[STRIP - TWIN]),
        np.nan_to_num(twin_profile[STRIP + TWIN]),
        end.contrast,
        twin_profile,
    )


@dataclass(frozen=True, order=True)
class _Pair:
    """Two ends that may belong to one edge, in the order of doubt."""

    rank: float
    first: int
    second: int
    # Bending energy of their curve, rad^2.
    bend: float


def _pairs(
    ends: list[BorderEnd], piece: Mask, drawn: Mask, joined: set[int]
) -> Iterator[BorderLine]:
    """Yield curves between ends of one edge; add to `drawn` and `joined`."""
    padded_piece = np.pad(piece, 1).astype(np.uint8)
    padded_depth = cv2.distanceTransform(padded_piece, cv2.DIST_L2, 5)
    depth = np.asarray(padded_depth[1:-1, 1:-1], np.float32)
    chords: list[tuple[int, int]] = []
    # Best pairs first; curves of one piece do not cross.
    for pair in sorted(_possible_pairs(ends)):
        i, j = pair.first, pair.second
        if {i, j} & joined or any((p < i < q) != (p < j < q) for p, q in chords):
            continue
        line = BorderLine(
            _cubic(ends[i], ends[j]), ends[i].profile, ends[j].profile[::-1]
        )
        joined |= {i, j}
        chords.append((min(i, j), max(i, j)))
        if pair.bend > MATCHING.bulge and _is_shallow(line, depth):
            continue
        _draw(drawn, line.points)
        yield line


def _possible_pairs(ends: list[BorderEnd]) -> Iterator[_Pair]:
    """Yield pairs of ends that a gentle bend can connect."""
    for i, a in enumerate(ends):
        for j, b in enumerate(ends[:i]):
            chord = b.place - a.place
            alpha, beta = _turn(chord, a.direction), _turn(chord, -b.direction)
            bend = alpha * alpha + alpha * beta + beta * beta
            length = float(np.hypot(*chord))
            doubt = (
                _colour_doubt(a, b) + 2 * abs(alpha + beta) + bend * length / BEND_PATH
            )
            is_possible = length > 2 * OFFSET and doubt < MATCHING.max_doubt
            if is_possible and _has_similar_side(a, b):
                yield _Pair(doubt + BEND_WEIGHT * bend, i, j, bend)


def _is_shallow(line: BorderLine, depth: F32) -> bool:
    """Return whether a line stays near the border of a hole with this depth (H, W)."""
    y, x = (
        np.clip(np.round(c).astype(int), 0, n - 1)
        for c, n in zip(line.points.T[::-1], depth.shape, strict=True)
    )
    # Points are half a px apart.
    return bool(depth[y, x].max() < 1 + 0.05 * len(line.points))


def _colour_doubt(a: BorderEnd, b: BorderEnd) -> float:
    """Return the doubt that the colours of two ends belong to one edge."""
    least_difference, largest_difference = colour_differences(a, b)
    contrasts = a.contrast + b.contrast
    return (1.5 * least_difference + 0.5 * largest_difference) / contrasts


def _has_similar_side(a: BorderEnd, b: BorderEnd) -> bool:
    """Return whether one side of two ends may show one surface."""
    least_difference, _ = colour_differences(a, b)
    return MATCHING.similar_sides(least_difference, a.contrast + b.contrast)


def corner_pairs(
    ends: Sequence[BorderEnd], piece: Mask, drawn: Mask
) -> list[tuple[BorderEnd, BorderEnd, F64]]:
    """Return pairs of ends that point at one place in the hole, and that place, best
    first.

    Each end occurs at most once.
    """
    candidates = []
    for i, a in enumerate(ends):
        for j, b in enumerate(ends[:i]):
            lengths = _crossing_lengths(a, b)
            if lengths is None or min(lengths) <= 0 or not _has_similar_side(a, b):
                continue
            u, v = lengths
            doubt = _colour_doubt(a, b) + (u + v) / max(piece.shape)
            is_free = _is_free(a, u, piece, drawn) and _is_free(b, v, piece, drawn)
            if is_free and doubt < MATCHING.max_doubt:
                candidates.append((doubt, i, j, a.place + u * a.direction))
    result, used_indices = [], set[int]()
    for _, i, j, place in sorted(candidates, key=lambda one: one[:3]):
        if not used_indices & {i, j}:
            used_indices |= {i, j}
            result.append((ends[i], ends[j], place))
    return result


def _crossing_lengths(a: BorderEnd, b: BorderEnd) -> tuple[float, float] | None:
    """Return the px from two ends to the crossing of their directions; None if they
    are nearly parallel.
    """
    sine = a.direction[0] * b.direction[1] - a.direction[1] * b.direction[0]
    if abs(sine) < MATCHING.corner_sine:
        return None
    gap = b.place - a.place
    # Solve a + u a' = b + v b' for the crossing of both directions.
    u = (gap[0] * b.direction[1] - gap[1] * b.direction[0]) / sine
    v = (gap[0] * a.direction[1] - gap[1] * a.direction[0]) / sine
    return u, v


def straight_to_line(end: BorderEnd, piece: Mask, drawn: Mask) -> F64 | None:
    """Return the straight path from an end to the first drawn line, or None."""
    points, inside = straight_path(end.place, end.direction, piece)
    x, y = np.round(points).astype(int).T
    hit = np.flatnonzero(drawn[y, x] & inside)
    return points[: hit[0] + 1] if len(hit) else None


def straight_path(place: F64, direction: F64, piece: Mask) -> tuple[F64, Mask]:
    """Return points half a px apart up to the photo's border, and whether they are in
    the hole.

    Only the first stretch in the hole counts.
    """
    h, w = piece.shape
    points = place + 0.5 * np.arange(2 * (h + w))[:, None] * direction
    x, y = np.round(points).astype(int).T
    points = points[
        : int(np.argmax(np.append((x < 0) | (y < 0) | (x >= w) | (y >= h), True)))
    ]
    x, y = np.round(points).astype(int).T
    inside = piece[y, x]
    first = int(np.argmax(inside)) if inside.any() else 0
    inside[first:] &= np.cumsum(~inside[first:]) == 0
    return points, inside


def colour_differences(a: BorderEnd, b: BorderEnd) -> tuple[float, float]:
    """Return the colour differences of two ends: of the more similar side, and of the
    other.

    The more similar side is the surface in front.
    """
    left_difference, right_difference = (
        float(np.linalg.norm(a.left - b.right)),
        float(np.linalg.norm(a.right - b.left)),
    )
    return min(left_difference, right_difference), max(
        left_difference, right_difference
    )


def line_points(start: F64, end: F64) -> F64:
    """Return points (n, 2) from one place to another, half a px apart."""
    count = int(2 * np.hypot(*(end - start))) + 2
    return start + np.linspace(0, 1, count)[:, None] * (end - start)


def _is_free(end: BorderEnd, length: float, piece: Mask, drawn: Mask) -> bool:
    """Return whether an edge can continue for `length` px inside the hole without a
    crossing.
    """
    points, inside = straight_path(end.place, end.direction, piece)
    n = int(2 * length)
    x, y = np.round(points[: n + 1]).astype(int).T
    return n < len(points) and bool(inside[n]) and not drawn[y, x].any()


def _turn(a: F64, b: F64) -> float:
    """Return the angle from a to b, rad."""
    return float(np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b))


def _cubic(a: BorderEnd, b: BorderEnd) -> F64:
    """Return the cubic that leaves `a` in its direction and arrives at `b` against its
    own.
    """
    length = float(np.hypot(*(b.place - a.place)))
    alpha = abs(_turn(b.place - a.place, a.direction)) + abs(
        _turn(b.place - a.place, -b.direction)
    )
    # With this length of the handles the curve is nearly a circle's arc.
    handle = length / 3 * (1 + alpha * alpha / 24)
    t = np.linspace(0, 1, int(2 * length) + 2)[:, None]
    p, q = a.place + handle * a.direction, b.place + handle * b.direction
    return (
        (1 - t) ** 3 * a.place
        + 3 * (1 - t) ** 2 * t * p
        + 3 * (1 - t) * t**2 * q
        + t**3 * b.place
    )


def _draw(mask: Mask, points: F64) -> None:
    """Draw a line of 3 px into a mask, in place."""
    x, y = np.round(points).astype(int).T
    keep = (x >= 1) & (y >= 1) & (x < mask.shape[1] - 1) & (y < mask.shape[0] - 1)
    for d in (-1, 0, 1):
        mask[y[keep] + d, x[keep]] = mask[y[keep], x[keep] + d] = True


def _paint_strip(
    result: F32, where: Mask, piece: Mask, line: BorderLine, width: int = STRIP
) -> None:
    """Paint the colours across the ends of a line along it, within a piece of the hole.

    `width` is the number of px on both sides of the line. A line of one point has no
    direction, and continues nothing.
    """
    if len(line.points) < FEWEST_POINTS:
        return
    x0, y0 = np.maximum(np.floor(line.points.min(0)).astype(int) - STRIP, 0)
    x1, y1 = np.ceil(line.points.max(0)).astype(int) + STRIP + 1
    y, x = np.nonzero(piece[y0:y1, x0:x1] & ~where[y0:y1, x0:x1])
    pixels = np.stack([x + x0, y + y0], 1)
    nearest, distance = _nearest_points(pixels, line.points)
    colour = _strip_colours(pixels, nearest, line)
    keep = (distance <= width) & ~np.isnan(colour).any(1)
    columns, rows = pixels[keep].T
    result[rows, columns] = colour[keep]
    where[rows, columns] = True


def _nearest_points(
    pixels: NDArray[np.int64], points: F64
) -> tuple[NDArray[np.int64], F64]:
    """Return the index of the point nearest to each pixel (n, 2), and its distance."""
    nearest, squared_distance = np.zeros(len(pixels), np.int64), np.zeros(len(pixels))
    # Chunks limit the memory of the distances of all pixels and all points.
    step = max(CHUNK // len(points), 1)
    for k in range(0, len(pixels), step):
        part = slice(k, k + step)
        # Work in place: these tables are the largest of the fill.
        gap = pixels[part, :1] - points[:, 0]
        gap *= gap
        y_gap = pixels[part, 1:] - points[:, 1]
        y_gap *= y_gap
        gap += y_gap
        columns = gap.argmin(1)
        nearest[part] = columns
        squared_distance[part] = gap[np.arange(len(columns)), columns]
    return nearest, np.sqrt(squared_distance)


def _strip_colours(
    pixels: NDArray[np.int64], nearest: NDArray[np.int64], line: BorderLine
) -> F64:
    """Return colours (n, 3) of pixels (n, 2) beside a line; NaN where unknown.

    `nearest` (n,) is the line's point nearest to each pixel.
    """
    first = np.where(np.isnan(line.first), line.last, line.first)
    last = np.where(np.isnan(line.last), line.first, line.last)
    tangents = np.gradient(line.points, axis=0)[nearest]
    tangents /= np.hypot(tangents[:, 0], tangents[:, 1])[:, None]
    offsets = pixels - line.points[nearest]
    side = tangents[:, 0] * offsets[:, 1] - tangents[:, 1] * offsets[:, 0]
    share_along = (nearest / max(1, len(line.points) - 1))[:, None]
    place = np.clip(side + STRIP, 0, 2 * STRIP - 1e-6)
    low = place.astype(int)
    share = (place - low)[:, None]
    # Interpolate across the line, then along it from one end's colours to the other's.
    start, end = ((1 - share) * p[low] + share * p[low + 1] for p in (first, last))
    return np.asarray((1 - share_along) * start + share_along * end)
