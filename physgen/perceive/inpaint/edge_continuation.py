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
from physgen.perceive.inpaint.ellipse_arcs import ellipse_arc, follow_edge
from physgen.perceive.inpaint.poisson import dilate
from physgen.perceive.roles import Mask

F64 = NDArray[np.float64]

# px: width of the strip continued on each side of an edge.
STRIP = 12
# px: width of the averaged colours on each side of an edge.
SIDE = 7
# px: distance of the detected edges from the hole.
OFFSET = 5
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
# Pairs of a pixel and a point of a line in memory at once.
CHUNK = 500_000


@dataclass(frozen=True)
class _Matching:
    """Thresholds of edges and of pairs; colours in levels of 0..255."""

    # Least contrast of an edge: length of the colour difference of its sides.
    contrast: float = 22.0
    # Least coherence of the structure tensor at an edge with a direction.
    coherence: float = 0.75
    # Least contrast of a continued unmatched edge.
    unmatched_contrast: float = 50.0
    # Least contrast of an unmatched edge across the whole hole.
    certain: float = 200.0
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
class BorderEnd:
    """The end of an edge at the border of a hole."""

    # Position along the contour.
    order: int
    # x, y.
    at: F64
    # Unit vector into the hole.
    towards: F64
    # Mean colour to the left of `towards` (y down: the side of (ty, -tx)).
    left: F64
    right: F64
    contrast: float
    # (2 STRIP + 1, 3): colours across the edge, left to right; NaN if hidden.
    profile: F64


@dataclass(frozen=True)
class BorderLine:
    """An edge in the hole."""

    # (n, 2): x, y, at most 1 px apart.
    points: F64
    # (2 STRIP + 1, 3): colours across its first point, left to right.
    first: F64
    # The same at its last point.
    last: F64


@dataclass(frozen=True)
class KnownSurroundings:
    """Colours around the hole and the structure tensor of their gradients (xx,
    xy, yy).
    """

    picture: F32
    blocked: Mask
    tensor: tuple[F32, F32, F32]

    @classmethod
    def of(cls, picture: F32, blocked: Mask) -> KnownSurroundings:
        """Return the surroundings in `picture` (H, W, 3), unknown in `blocked`
        (H, W).
        """
        blurred_picture = cv2.GaussianBlur(picture, (0, 0), 1)
        known_weights = (~dilate(blocked, 1)).astype(np.float32)[:, :, None]
        gx, gy = (
            cv2.Sobel(blurred_picture, cv2.CV_32F, *d, ksize=3) / 8 * known_weights
            for d in ((1, 0), (0, 1))
        )
        xx, xy, yy = (
            cv2.GaussianBlur((a * b).sum(2), (0, 0), 3.5)
            for a, b in ((gx, gx), (gx, gy), (gy, gy))
        )
        return cls(np.asarray(blurred_picture, np.float32), blocked, (xx, xy, yy))


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
    surroundings = KnownSurroundings.of(picture, dilate(hole, 1))
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
    surroundings = KnownSurroundings.of(picture, dilate(hole, 1))
    count, ids = cv2.connectedComponents(hole.astype(np.uint8), connectivity=8)
    for number in range(1, count):
        piece = ids == number
        for line in _arcs(
            list(border_ends(surroundings, piece)), piece, surroundings, set()
        ):
            _paint_strip(result, strips, piece, line, ARC_STRIP)
    return result, strips


def border_ends(known: KnownSurroundings, piece: Mask) -> Iterator[BorderEnd]:
    """Yield the edges that enter a piece of the hole, in the order of its contour."""
    picture, unknown = known.picture, known.blocked
    h, w = piece.shape
    r = OFFSET + SIDE + 2
    padded_piece = cv2.copyMakeBorder(
        piece.astype(np.uint8), r, r, r, r, cv2.BORDER_CONSTANT, value=0
    )
    # Edges are measured on a contour `OFFSET` px outside the hole, where colours are
    # pure.
    contours, _ = cv2.findContours(
        np.asarray(dilate(padded_piece > 0, OFFSET), np.uint8),
        cv2.RETR_EXTERNAL,
        cv2.CHAIN_APPROX_NONE,
    )
    path = max(contours, key=len)[:, 0, :].astype(np.float64) - r
    x, y = path.astype(int).T
    inside = (x >= 2) & (y >= 2) & (x < w - 2) & (y < h - 2)
    xc, yc = np.clip(x, 0, w - 1), np.clip(y, 0, h - 1)
    usable = inside & ~unknown[yc, xc]
    n = len(path)
    if n < 6 * SIDE or not usable.any():
        return
    # The structure tensor gives the direction and coherence of the edge.
    xx, xy, yy = (a[yc, xc].astype(np.float64) for a in known.tensor)
    # Angle of the gradient.
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    spread = np.hypot(xx - yy, 2 * xy)
    coherence = spread / np.maximum(xx + yy, 1e-6)
    # The blurred distance to the piece gives the inward normal.
    inward = cv2.GaussianBlur(padded_piece.astype(np.float32), (0, 0), OFFSET)
    nx, ny = (
        cv2.Sobel(inward, cv2.CV_32F, *d, ksize=3)[y + r, x + r]
        for d in ((1, 0), (0, 1))
    )
    tx, ty = -np.sin(angle), np.cos(angle)
    sign = np.where(tx * nx + ty * ny < 0, -1, 1)
    tx, ty = tx * sign, ty * sign
    slant = (tx * nx + ty * ny) / np.maximum(np.hypot(nx, ny), 1e-9)
    # Mean colours on both sides of the edge.
    steps = np.arange(2, SIDE + 1)
    sides = []
    ok = usable.copy()
    for turn in (1, -1):
        sx = path[:, 0, None] + turn * ty[:, None] * steps
        sy = path[:, 1, None] - turn * tx[:, None] * steps
        colours, legal = _sample_known_colours(picture, unknown, sx, sy)
        ok &= legal.sum(1) >= 3
        sides.append(
            (colours * legal[:, :, None]).sum(1) / np.maximum(legal.sum(1), 1)[:, None]
        )
    left, right = sides
    contrast = np.linalg.norm(left - right, axis=1)
    ok &= (
        (coherence > MATCHING.coherence)
        & (contrast > MATCHING.contrast)
        & (slant > 0.3)
    )
    # Keep only local maxima along the contour; of equal neighbours the first one.
    score = np.where(ok, spread, 0)
    for i in np.flatnonzero(ok):
        window = np.arange(i - 6, i + 7) % n
        if (
            score[i] == score[window].max()
            and not (score[window[:6]] == score[i]).any()
        ):
            direction = np.array([tx[i], ty[i]])
            profile = border_profile(picture, unknown, path[i], direction)
            slope = np.linalg.norm(profile[4:] - profile[:-4], axis=1)[2:-2]
            # Move the end across the edge to the steepest change of colour.
            shift = (
                0
                if np.isnan(slope).all()
                else int(np.nanargmax(slope)) - (len(slope) - 1) // 2
            )
            position = path[i] + shift * np.array([-direction[1], direction[0]])
            profile = border_profile(picture, unknown, position, direction)
            yield BorderEnd(
                int(i),
                position,
                direction,
                left[i],
                right[i],
                float(contrast[i]),
                profile,
            )


def _sample_known_colours(
    picture: F32, blocked: Mask, x: F64, y: F64
) -> tuple[F32, Mask]:
    """Return colours at the pixels nearest to x and y, and whether they are known."""
    h, w = blocked.shape
    xi, yi = np.round(x).astype(int), np.round(y).astype(int)
    legal = (xi >= 0) & (yi >= 0) & (xi < w) & (yi < h)
    xi, yi = np.clip(xi, 0, w - 1), np.clip(yi, 0, h - 1)
    return picture[yi, xi], legal & ~blocked[yi, xi]


def border_profile(picture: F32, blocked: Mask, at: F64, towards: F64) -> F64:
    """Return colours (2 STRIP + 1, 3) across an edge from left to right; NaN if hidden.

    Colours are averaged along the last px of the edge.
    """
    offsets = np.arange(-STRIP, STRIP + 1)[:, None]
    back = np.arange(0, 4)[None, :]
    x = at[0] - towards[0] * back - towards[1] * offsets
    y = at[1] - towards[1] * back + towards[0] * offsets
    colours, legal = _sample_known_colours(picture, blocked, x, y)
    weight = legal.sum(1)[:, None]
    mean = (colours * legal[:, :, None]).sum(1) / np.maximum(weight, 1)
    return np.where(weight > 0, mean, np.nan)


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
        meetings = [
            (end, path)
            for end in free_ends
            if (path := straight_to_line(end, piece, line_mask)) is not None
        ]
        free_ends = [
            end for end in free_ends if all(end is not other for other, _ in meetings)
        ]
        for end, path in meetings:
            _draw(line_mask, path)
            yield BorderLine(path, end.profile, end.profile)
        for a, b, place in (
            [] if last or meetings else corner_pairs(free_ends, piece, line_mask)
        ):
            free_ends = [end for end in free_ends if end is not a and end is not b]
            corner_path = np.concatenate(
                [line_points(a.at, place), line_points(place, b.at)[1:]]
            )
            _draw(line_mask, corner_path)
            yield BorderLine(corner_path, a.profile, b.profile[::-1])
    for end in sorted(
        (one for one in free_ends if one.contrast > MATCHING.certain),
        key=lambda one: -one.contrast,
    ):
        path, inside = straight_path(end.at, end.towards, piece)
        path = path[: np.flatnonzero(np.append(True, inside))[-1]]
        x, y = np.round(path).astype(int).T
        if len(path) and not line_mask[y, x].any():
            _draw(line_mask, path)
            yield BorderLine(path, end.profile, end.profile)


def _arcs(
    ends: list[BorderEnd], piece: Mask, known: KnownSurroundings, joined: set[int]
) -> Iterator[BorderLine]:
    """Yield arcs of ellipses between ends of one edge; add these ends to `joined`."""
    number = {id(end): index for index, end in enumerate(ends)}
    strong_ends = [end for end in ends if end.contrast > ARC_CONTRAST]
    # A painted ring has two edges, of which only the stronger one is detected.
    twins = [_twin(end, known) for end in strong_ends]
    all_ends = strong_ends + [twin for twin in twins if twin is not None]
    edges = [
        follow_edge(known.picture, known.blocked, end.at, -end.towards)
        for end in all_ends
    ]
    used_indices: set[int] = set()
    for second, b in enumerate(all_ends):
        for first, a in enumerate(all_ends[:second]):
            if {first, second} & used_indices or not _may_be_one(a, b):
                continue
            sides = edges[first], edges[second]
            points = ellipse_arc(sides, (a.towards, b.towards), piece)
            if points is not None:
                used_indices |= {first, second}
                joined |= {number[id(end)] for end in (a, b) if id(end) in number}
                yield BorderLine(points, a.profile, b.profile[::-1])


def _may_be_one(a: BorderEnd, b: BorderEnd) -> bool:
    """Return whether the colours of two ends allow that they belong to one edge."""
    least_difference, largest_difference = colour_differences(a, b)
    contrasts = a.contrast + b.contrast
    doubt = (1.5 * least_difference + 0.5 * largest_difference) / contrasts
    return (
        MATCHING.similar_sides(least_difference, contrasts)
        and doubt < MATCHING.max_doubt
    )


def _twin(end: BorderEnd, known: KnownSurroundings) -> BorderEnd | None:
    """Return the other edge of a painted line with the edge `end`, or None if it is
    wide.
    """
    profile = border_profile(known.picture, known.blocked, end.at, end.towards)
    gap = profile[TWIN:] - profile[:-TWIN]
    middle = len(gap) // 2
    # The other edge has the opposite change of colour.
    similarity = gap @ gap[middle] / max(float(gap[middle] @ gap[middle]), 1.0)
    similarity = np.nan_to_num(similarity)
    step = int(np.argmin(similarity)) - middle
    if similarity.min() > -TWIN_CONTRAST or abs(step) < 2:
        return None
    normal = np.array([-end.towards[1], end.towards[0]])
    place = end.at + step * normal
    twin_profile = border_profile(known.picture, known.blocked, place, end.towards)
    return BorderEnd(
        end.order,
        place,
        end.towards,
        np.nan_to_num(twin_profile[STRIP - TWIN]),
        np.nan_to_num(twin_profile[STRIP + TWIN]),
        end.contrast,
        twin_profile,
    )


def _pairs(
    ends: list[BorderEnd], piece: Mask, drawn: Mask, joined: set[int]
) -> Iterator[BorderLine]:
    """Yield curves between ends of one edge; add to `drawn` and `joined`."""
    pairs = []
    bends: dict[tuple[int, int], float] = {}
    for i, a in enumerate(ends):
        for j in range(i):
            b = ends[j]
            chord = b.at - a.at
            alpha, beta = _turn(chord, a.towards), _turn(chord, -b.towards)
            bend = bends[i, j] = alpha * alpha + alpha * beta + beta * beta
            least_difference, largest_difference = colour_differences(a, b)
            contrasts = a.contrast + b.contrast
            length = float(np.hypot(*chord))
            doubt = (
                (1.5 * least_difference + 0.5 * largest_difference) / contrasts
                + 2 * abs(alpha + beta)
                + bend * length / 67
            )
            if (
                length > 2 * OFFSET
                and MATCHING.similar_sides(least_difference, contrasts)
                and doubt < MATCHING.max_doubt
            ):
                pairs.append((doubt + 7 * bend, i, j))
    depth = cv2.distanceTransform(np.pad(piece, 1).astype(np.uint8), cv2.DIST_L2, 5)[
        1:-1, 1:-1
    ]
    chords: list[tuple[int, int]] = []
    # Best pairs first; curves of one piece do not cross.
    for _, i, j in sorted(pairs):
        if (
            i in joined
            or j in joined
            or any((p < i < q) != (p < j < q) for p, q in chords)
        ):
            continue
        line = BorderLine(
            _cubic(ends[i], ends[j]), ends[i].profile, ends[j].profile[::-1]
        )
        y, x = (
            np.clip(np.round(c).astype(int), 0, n - 1)
            for c, n in zip(line.points.T[::-1], piece.shape, strict=True)
        )
        joined |= {i, j}
        chords.append((min(i, j), max(i, j)))
        # Points are half a px apart.
        shallow = depth[y, x].max() < 1 + 0.05 * len(line.points)
        if shallow and bends[i, j] > MATCHING.bulge:
            continue
        _draw(drawn, line.points)
        yield line


def corner_pairs(
    ends: Sequence[BorderEnd], piece: Mask, drawn: Mask
) -> list[tuple[BorderEnd, BorderEnd, F64]]:
    """Return pairs of ends that point at one place in the hole, and that place, best
    first.

    Each end occurs at most once.
    """
    size, candidates = max(piece.shape), []
    for i, a in enumerate(ends):
        for j, b in enumerate(ends[:i]):
            sine = a.towards[0] * b.towards[1] - a.towards[1] * b.towards[0]
            if abs(sine) < MATCHING.corner_sine:
                continue
            gap = b.at - a.at
            # Solve a + u a' = b + v b' for the crossing of both directions.
            u = (gap[0] * b.towards[1] - gap[1] * b.towards[0]) / sine
            v = (gap[0] * a.towards[1] - gap[1] * a.towards[0]) / sine
            if min(u, v) <= 0 or not (
                _is_free(a, u, piece, drawn) and _is_free(b, v, piece, drawn)
            ):
                continue
            least_difference, largest_difference = colour_differences(a, b)
            contrasts = a.contrast + b.contrast
            doubt = (1.5 * least_difference + 0.5 * largest_difference) / contrasts + (
                u + v
            ) / size
            if (
                MATCHING.similar_sides(least_difference, contrasts)
                and doubt < MATCHING.max_doubt
            ):
                candidates.append((doubt, i, j, a.at + u * a.towards))
    result, used_indices = [], set[int]()
    for _, i, j, place in sorted(candidates, key=lambda one: one[:3]):
        if not used_indices & {i, j}:
            used_indices |= {i, j}
            result.append((ends[i], ends[j], place))
    return result


def straight_to_line(end: BorderEnd, piece: Mask, drawn: Mask) -> F64 | None:
    """Return the straight path from an end to the first drawn line, or None."""
    points, inside = straight_path(end.at, end.towards, piece)
    x, y = np.round(points).astype(int).T
    hit = np.flatnonzero(drawn[y, x] & inside)
    return points[: hit[0] + 1] if len(hit) else None


def straight_path(at: F64, towards: F64, piece: Mask) -> tuple[F64, Mask]:
    """Return points half a px apart up to the photo's border, and whether they are in
    the hole.

    Only the first stretch in the hole counts.
    """
    h, w = piece.shape
    points = at + 0.5 * np.arange(2 * (h + w))[:, None] * towards
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


def line_points(at: F64, to: F64) -> F64:
    """Return points (n, 2) from one place to another, half a px apart."""
    return at + np.linspace(0, 1, int(2 * np.hypot(*(to - at))) + 2)[:, None] * (
        to - at
    )


def _is_free(end: BorderEnd, length: float, piece: Mask, drawn: Mask) -> bool:
    """Return whether an edge can continue for `length` px inside the hole without a
    crossing.
    """
    points, inside = straight_path(end.at, end.towards, piece)
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
    length = float(np.hypot(*(b.at - a.at)))
    alpha = abs(_turn(b.at - a.at, a.towards)) + abs(_turn(b.at - a.at, -b.towards))
    # With this length of the handles the curve is nearly a circle's arc.
    handle = length / 3 * (1 + alpha * alpha / 24)
    t = np.linspace(0, 1, int(2 * length) + 2)[:, None]
    p, q = a.at + handle * a.towards, b.at + handle * b.towards
    return (
        (1 - t) ** 3 * a.at
        + 3 * (1 - t) ** 2 * t * p
        + 3 * (1 - t) * t**2 * q
        + t**3 * b.at
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

    `width` is the number of px on both sides of the line.
    """
    first = np.where(np.isnan(line.first), line.last, line.first)
    last = np.where(np.isnan(line.last), line.first, line.last)
    x0, y0 = np.maximum(np.floor(line.points.min(0)).astype(int) - STRIP, 0)
    x1, y1 = np.ceil(line.points.max(0)).astype(int) + STRIP + 1
    y, x = np.nonzero(piece[y0:y1, x0:x1] & ~where[y0:y1, x0:x1])
    nearest, squared_distance = np.zeros(len(x), np.int64), np.zeros(len(x))
    # Chunks limit the memory of the distances of all pixels and all points.
    step = max(CHUNK // len(line.points), 1)
    for k in range(0, len(x), step):
        part = slice(k, k + step)
        gap = (x[part, None] + x0 - line.points[:, 0]) ** 2 + (
            y[part, None] + y0 - line.points[:, 1]
        ) ** 2
        nearest[part], squared_distance[part] = gap.argmin(1), gap.min(1)
    tangents = np.gradient(line.points, axis=0)[nearest]
    tangents /= np.hypot(tangents[:, 0], tangents[:, 1])[:, None]
    offsets = np.stack([x + x0, y + y0], 1) - line.points[nearest]
    side = tangents[:, 0] * offsets[:, 1] - tangents[:, 1] * offsets[:, 0]
    share_along = (nearest / max(1, len(line.points) - 1))[:, None]
    place = np.clip(side + STRIP, 0, 2 * STRIP - 1e-6)
    low = place.astype(int)
    share = (place - low)[:, None]
    # Interpolate across the line, then along it from one end's colours to the other's.
    start, end = ((1 - share) * p[low] + share * p[low + 1] for p in (first, last))
    colour = (1 - share_along) * start + share_along * end
    keep = (np.sqrt(squared_distance) <= width) & ~np.isnan(colour).any(1)
    result[y[keep] + y0, x[keep] + x0] = colour[keep]
    where[y[keep] + y0, x[keep] + x0] = True
