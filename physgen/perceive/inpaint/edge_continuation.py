"""Continuation of edges through a hole, with flat colour between them.

Where an edge enters the hole, its direction and the colours on both its sides are measured. Two that would meet by a
gentle bend, with the same colours, are one edge (the least bending energy of a cubic, as in Masnou and Morel 1998,
Level lines based disocclusion). An unmatched edge goes straight on to a corner with another one, or to the first line
that it meets; one of high contrast, as a shelf's end before a white wall, goes through the hole.
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

STRIP = 12  # px to each side of an edge that are carried on with it
SIDE = 7  # px on each side of an edge whose colours are averaged
OFFSET = 5  # px from the hole at which edges are looked for
PAD = 12  # px by which the photo is extended, so that an edge which enters a hole close to the border is seen
ARC_STRIP = 6  # px to each side of an arc, which is certain: the rest is copied
ARC_CONTRAST = 45.0  # levels between both sides: fainter edges may be texture
TWIN = 4  # px across the edges of a painted line over which colours are compared
TWIN_CONTRAST = 0.5  # of one edge's contrast that the other has at least, reversed
CHUNK = 500_000  # pairs of a pixel and a point of a line that are held in memory


@dataclass(frozen=True)
class _Matching:
    """Thresholds of edges and of pairs; colours in levels of 0..255."""

    contrast: float = 22.0  # between the two sides (length of the difference) from which there is an edge
    coherence: float = (
        0.75  # of the structure tensor, from which an edge has a direction
    )
    unmatched_contrast: float = (
        50.0  # the contrast from which an unmatched edge goes on
    )
    certain: float = (
        200.0  # the contrast from which it goes on to the hole's other side
    )
    similar: float = (
        25.0  # by which the more similar side of an edge may differ from end to end
    )
    max_doubt: float = 0.75  # that two ends belong to one edge: colours, turns that are no arc's, long bends
    bulge: float = 0.1  # bending from which an edge that only runs along the hole's border is not drawn
    corner_sine: float = (
        0.5  # of the angle between two edges from which they make a corner
    )

    def similar_sides(self, near: float, contrasts: float) -> bool:
        """Whether the more similar side, off by `near`, may be the same; `contrasts` of both ends together."""
        return near < max(self.similar, 0.17 * contrasts)


MATCHING = _Matching()


@dataclass(frozen=True)
class BorderEnd:
    """Where an edge enters a hole."""

    order: int  # Place along the contour
    at: F64  # x, y
    towards: F64  # Unit vector into the hole
    left: F64  # Mean colour to the left of `towards` (y down: the side of (ty, -tx))
    right: F64
    contrast: float
    profile: (
        F64  # (2 STRIP + 1, 3): colours across it, from left to right; NaN where hidden
    )


@dataclass(frozen=True)
class BorderLine:
    """An edge in the hole."""

    points: F64  # (n, 2): x, y, at most 1 px apart
    first: F64  # (2 STRIP + 1, 3): colours across its first point, from left to right
    last: F64  # The same at its last point


@dataclass(frozen=True)
class KnownSurroundings:
    """Colours around the hole and the structure tensor of their gradients (xx, xy, yy)."""

    picture: F32
    blocked: Mask
    tensor: tuple[F32, F32, F32]

    @classmethod
    def of(cls, picture: F32, blocked: Mask) -> KnownSurroundings:
        """Of `picture` (H, W, 3), unknown where `blocked` (H, W)."""
        smooth = cv2.GaussianBlur(picture, (0, 0), 1)
        known = (~dilate(blocked, 1)).astype(np.float32)[:, :, None]
        gx, gy = (
            cv2.Sobel(smooth, cv2.CV_32F, *d, ksize=3) / 8 * known
            for d in ((1, 0), (0, 1))
        )
        xx, xy, yy = (
            cv2.GaussianBlur((a * b).sum(2), (0, 0), 3.5)
            for a, b in ((gx, gx), (gx, gy), (gy, gy))
        )
        return cls(np.asarray(smooth, np.float32), blocked, (xx, xy, yy))


def continue_edges(picture: F32, hole: Mask) -> tuple[F32, Mask]:
    """`(H, W, 3)` with strips along the edges continued through `hole` (H, W), and where these strips are."""
    height, width = hole.shape
    edges = (PAD,) * 4
    picture = np.asarray(
        cv2.copyMakeBorder(picture, *edges, cv2.BORDER_REPLICATE), np.float32
    )
    hole = cv2.copyMakeBorder(hole.astype(np.uint8), *edges, cv2.BORDER_REPLICATE) > 0
    result, where = picture.copy(), np.zeros_like(hole)
    known = KnownSurroundings.of(picture, dilate(hole, 1))
    count, ids = cv2.connectedComponents(hole.astype(np.uint8), connectivity=8)
    for k in range(1, count):
        piece = ids == k
        for line in _lines(list(border_ends(known, piece)), piece, known):
            _paint_strip(result, where, piece, line)
    inner = slice(PAD, PAD + height), slice(PAD, PAD + width)
    return result[inner], where[inner]


def continue_arcs(picture: F32, hole: Mask) -> tuple[F32, Mask]:
    """`(H, W, 3)` with circles and ellipses continued through `hole` (H, W), and where.

    Strips are `ARC_STRIP` px wide on both sides of the edges.
    """
    result, where = picture.copy(), np.zeros_like(hole)
    known = KnownSurroundings.of(picture, dilate(hole, 1))
    count, ids = cv2.connectedComponents(hole.astype(np.uint8), connectivity=8)
    for number in range(1, count):
        piece = ids == number
        for line in _arcs(list(border_ends(known, piece)), piece, known, set()):
            _paint_strip(result, where, piece, line, ARC_STRIP)
    return result, where


def border_ends(known: KnownSurroundings, piece: Mask) -> Iterator[BorderEnd]:
    """The edges that enter a piece of the hole, in the order of its contour."""
    picture, blocked = known.picture, known.blocked
    h, w = piece.shape
    r = OFFSET + SIDE + 2
    wide = cv2.copyMakeBorder(
        piece.astype(np.uint8), r, r, r, r, cv2.BORDER_CONSTANT, value=0
    )
    contours, _ = cv2.findContours(
        np.asarray(dilate(wide > 0, OFFSET), np.uint8),
        cv2.RETR_EXTERNAL,
        cv2.CHAIN_APPROX_NONE,
    )
    path = max(contours, key=len)[:, 0, :].astype(np.float64) - r
    x, y = path.astype(int).T
    inside = (x >= 2) & (y >= 2) & (x < w - 2) & (y < h - 2)
    xc, yc = np.clip(x, 0, w - 1), np.clip(y, 0, h - 1)
    usable = inside & ~blocked[yc, xc]
    n = len(path)
    if n < 6 * SIDE or not usable.any():
        return
    xx, xy, yy = (a[yc, xc].astype(np.float64) for a in known.tensor)
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)  # of the gradient
    spread = np.hypot(xx - yy, 2 * xy)
    coherence = spread / np.maximum(xx + yy, 1e-6)
    # inward normal from the distance to the piece
    inward = cv2.GaussianBlur(wide.astype(np.float32), (0, 0), OFFSET)
    nx, ny = (
        cv2.Sobel(inward, cv2.CV_32F, *d, ksize=3)[y + r, x + r]
        for d in ((1, 0), (0, 1))
    )
    tx, ty = -np.sin(angle), np.cos(angle)
    sign = np.where(tx * nx + ty * ny < 0, -1, 1)
    tx, ty = tx * sign, ty * sign
    slant = (tx * nx + ty * ny) / np.maximum(np.hypot(nx, ny), 1e-9)
    steps = np.arange(2, SIDE + 1)
    sides = []
    ok = usable.copy()
    for turn in (1, -1):
        sx = path[:, 0, None] + turn * ty[:, None] * steps
        sy = path[:, 1, None] - turn * tx[:, None] * steps
        colours, legal = _sampled(picture, blocked, sx, sy)
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
    score = np.where(ok, spread, 0)
    for i in np.flatnonzero(ok):
        around = np.arange(i - 6, i + 7) % n
        if (
            score[i] == score[around].max()
            and not (score[around[:6]] == score[i]).any()
        ):
            towards = np.array([tx[i], ty[i]])
            across = border_profile(picture, blocked, path[i], towards)
            slope = np.linalg.norm(across[4:] - across[:-4], axis=1)[2:-2]
            shift = (
                0
                if np.isnan(slope).all()
                else int(np.nanargmax(slope)) - (len(slope) - 1) // 2
            )
            at = path[i] + shift * np.array([-towards[1], towards[0]])
            across = border_profile(picture, blocked, at, towards)
            yield BorderEnd(
                int(i), at, towards, left[i], right[i], float(contrast[i]), across
            )


def _sampled(picture: F32, blocked: Mask, x: F64, y: F64) -> tuple[F32, Mask]:
    """Colours at the pixels nearest to x and y, and which of them are known."""
    h, w = blocked.shape
    xi, yi = np.round(x).astype(int), np.round(y).astype(int)
    legal = (xi >= 0) & (yi >= 0) & (xi < w) & (yi < h)
    xi, yi = np.clip(xi, 0, w - 1), np.clip(yi, 0, h - 1)
    return picture[yi, xi], legal & ~blocked[yi, xi]


def border_profile(picture: F32, blocked: Mask, at: F64, towards: F64) -> F64:
    """Colours (2 STRIP + 1, 3) across an edge from left to right, averaged along its last px; NaN if hidden."""
    across = np.arange(-STRIP, STRIP + 1)[:, None]
    back = np.arange(0, 4)[None, :]
    x = at[0] - towards[0] * back - towards[1] * across
    y = at[1] - towards[1] * back + towards[0] * across
    colours, legal = _sampled(picture, blocked, x, y)
    weight = legal.sum(1)[:, None]
    mean = (colours * legal[:, :, None]).sum(1) / np.maximum(weight, 1)
    return np.where(weight > 0, mean, np.nan)


def _lines(
    ends: list[BorderEnd], piece: Mask, known: KnownSurroundings
) -> Iterator[BorderLine]:
    """Arcs, then ends joined in pairs, best first; then the unmatched ones."""
    drawn = np.zeros(piece.shape, bool)
    joined: set[int] = set()
    for line in _arcs(ends, piece, known, joined):
        _draw(drawn, line.points)
        yield line
    yield from _pairs(ends, piece, drawn, joined)
    alone = [
        e
        for k, e in enumerate(ends)
        if k not in joined and e.contrast > MATCHING.unmatched_contrast
    ]
    # an edge that ends at another's T comes second; what is left may be a corner
    for last in (False, False, True):
        met = [
            (end, path)
            for end in alone
            if (path := straight_to_line(end, piece, drawn)) is not None
        ]
        alone = [end for end in alone if all(end is not other for other, _ in met)]
        for end, path in met:
            _draw(drawn, path)
            yield BorderLine(path, end.profile, end.profile)
        for a, b, place in [] if last or met else corner_pairs(alone, piece, drawn):
            alone = [end for end in alone if end is not a and end is not b]
            bent = np.concatenate(
                [line_points(a.at, place), line_points(place, b.at)[1:]]
            )
            _draw(drawn, bent)
            yield BorderLine(bent, a.profile, b.profile[::-1])
    for end in sorted(
        (one for one in alone if one.contrast > MATCHING.certain),
        key=lambda one: -one.contrast,
    ):
        path, inside = straight_path(end.at, end.towards, piece)
        path = path[: np.flatnonzero(np.append(True, inside))[-1]]
        x, y = np.round(path).astype(int).T
        if len(path) and not drawn[y, x].any():
            _draw(drawn, path)
            yield BorderLine(path, end.profile, end.profile)


def _arcs(
    ends: list[BorderEnd], piece: Mask, known: KnownSurroundings, joined: set[int]
) -> Iterator[BorderLine]:
    """Arcs of ellipses between ends that are of one edge; adds these to `joined`."""
    number = {id(end): index for index, end in enumerate(ends)}
    strong = [end for end in ends if end.contrast > ARC_CONTRAST]
    twins = [_twin(end, known) for end in strong]
    every = strong + [twin for twin in twins if twin is not None]
    edges = [
        follow_edge(known.picture, known.blocked, end.at, -end.towards) for end in every
    ]
    used: set[int] = set()
    for second, b in enumerate(every):
        for first, a in enumerate(every[:second]):
            if {first, second} & used or not _may_be_one(a, b):
                continue
            sides = edges[first], edges[second]
            points = ellipse_arc(sides, (a.towards, b.towards), piece)
            if points is not None:
                used |= {first, second}
                joined |= {number[id(end)] for end in (a, b) if id(end) in number}
                yield BorderLine(points, a.profile, b.profile[::-1])


def _may_be_one(a: BorderEnd, b: BorderEnd) -> bool:
    """Whether the colours on both sides of two ends allow that they are one edge."""
    near, far = colour_differences(a, b)
    both = a.contrast + b.contrast
    doubt = (1.5 * near + 0.5 * far) / both
    return MATCHING.similar_sides(near, both) and doubt < MATCHING.max_doubt


def _twin(end: BorderEnd, known: KnownSurroundings) -> BorderEnd | None:
    """The other edge of a painted line whose one edge is `end`; None if it is wide."""
    profile = border_profile(known.picture, known.blocked, end.at, end.towards)
    gap = profile[TWIN:] - profile[:-TWIN]
    middle = len(gap) // 2
    along = gap @ gap[middle] / max(float(gap[middle] @ gap[middle]), 1.0)
    along = np.nan_to_num(along)
    step = int(np.argmin(along)) - middle
    if along.min() > -TWIN_CONTRAST or abs(step) < 2:
        return None
    normal = np.array([-end.towards[1], end.towards[0]])
    place = end.at + step * normal
    across = border_profile(known.picture, known.blocked, place, end.towards)
    return BorderEnd(
        end.order,
        place,
        end.towards,
        np.nan_to_num(across[STRIP - TWIN]),
        np.nan_to_num(across[STRIP + TWIN]),
        end.contrast,
        across,
    )


def _pairs(
    ends: list[BorderEnd], piece: Mask, drawn: Mask, joined: set[int]
) -> Iterator[BorderLine]:
    """Curves between ends that belong to one edge; adds to `drawn` and `joined`."""
    pairs = []
    bends: dict[tuple[int, int], float] = {}
    for i, a in enumerate(ends):
        for j in range(i):
            b = ends[j]
            chord = b.at - a.at
            alpha, beta = _turn(chord, a.towards), _turn(chord, -b.towards)
            bend = bends[i, j] = alpha * alpha + alpha * beta + beta * beta
            near, far = colour_differences(a, b)
            both = a.contrast + b.contrast
            length = float(np.hypot(*chord))
            doubt = (
                (1.5 * near + 0.5 * far) / both
                + 2 * abs(alpha + beta)
                + bend * length / 67
            )
            if (
                length > 2 * OFFSET
                and MATCHING.similar_sides(near, both)
                and doubt < MATCHING.max_doubt
            ):
                pairs.append((doubt + 7 * bend, i, j))
    depth = cv2.distanceTransform(np.pad(piece, 1).astype(np.uint8), cv2.DIST_L2, 5)[
        1:-1, 1:-1
    ]
    chords: list[tuple[int, int]] = []
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
        shallow = depth[y, x].max() < 1 + 0.05 * len(line.points)  # half a px apart
        if shallow and bends[i, j] > MATCHING.bulge:
            continue
        _draw(drawn, line.points)
        yield line


def corner_pairs(
    ends: Sequence[BorderEnd], piece: Mask, drawn: Mask
) -> list[tuple[BorderEnd, BorderEnd, F64]]:
    """Pairs of ends that point at one place in the hole, and that place, best first; each end at most once."""
    size, found = max(piece.shape), []
    for i, a in enumerate(ends):
        for j, b in enumerate(ends[:i]):
            sine = a.towards[0] * b.towards[1] - a.towards[1] * b.towards[0]
            if abs(sine) < MATCHING.corner_sine:
                continue
            gap = b.at - a.at
            u = (gap[0] * b.towards[1] - gap[1] * b.towards[0]) / sine
            v = (gap[0] * a.towards[1] - gap[1] * a.towards[0]) / sine
            if min(u, v) <= 0 or not (
                _is_free(a, u, piece, drawn) and _is_free(b, v, piece, drawn)
            ):
                continue
            near, far = colour_differences(a, b)
            both = a.contrast + b.contrast
            doubt = (1.5 * near + 0.5 * far) / both + (u + v) / size
            if MATCHING.similar_sides(near, both) and doubt < MATCHING.max_doubt:
                found.append((doubt, i, j, a.at + u * a.towards))
    result, taken = [], set[int]()
    for _, i, j, place in sorted(found, key=lambda one: one[:3]):
        if not taken & {i, j}:
            taken |= {i, j}
            result.append((ends[i], ends[j], place))
    return result


def straight_to_line(end: BorderEnd, piece: Mask, drawn: Mask) -> F64 | None:
    """From where an edge enters straight on to the first line that is drawn; None if there is none in the hole."""
    points, inside = straight_path(end.at, end.towards, piece)
    x, y = np.round(points).astype(int).T
    hit = np.flatnonzero(drawn[y, x] & inside)
    return points[: hit[0] + 1] if len(hit) else None


def straight_path(at: F64, towards: F64, piece: Mask) -> tuple[F64, Mask]:
    """Points half a px apart up to the photo's border, and which are in the hole's first stretch."""
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
    """Differences of colour between two ends: of the more similar side (the surface in front), and of the other."""
    one, other = (
        float(np.linalg.norm(a.left - b.right)),
        float(np.linalg.norm(a.right - b.left)),
    )
    return min(one, other), max(one, other)


def line_points(at: F64, to: F64) -> F64:
    """Points (n, 2) from one place to another, half a px apart."""
    return at + np.linspace(0, 1, int(2 * np.hypot(*(to - at))) + 2)[:, None] * (
        to - at
    )


def _is_free(end: BorderEnd, length: float, piece: Mask, drawn: Mask) -> bool:
    """Whether an edge can go on for `length` px: in the hole to the last, and across no line."""
    points, inside = straight_path(end.at, end.towards, piece)
    n = int(2 * length)
    x, y = np.round(points[: n + 1]).astype(int).T
    return n < len(points) and bool(inside[n]) and not drawn[y, x].any()


def _turn(a: F64, b: F64) -> float:
    """Angle from a to b, rad."""
    return float(np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b))


def _cubic(a: BorderEnd, b: BorderEnd) -> F64:
    """The curve that leaves `a` along its direction and arrives in `b` against its own."""
    length = float(np.hypot(*(b.at - a.at)))
    alpha = abs(_turn(b.at - a.at, a.towards)) + abs(_turn(b.at - a.at, -b.towards))
    handle = length / 3 * (1 + alpha * alpha / 24)  # about a circle's
    t = np.linspace(0, 1, int(2 * length) + 2)[:, None]
    p, q = a.at + handle * a.towards, b.at + handle * b.towards
    return (
        (1 - t) ** 3 * a.at
        + 3 * (1 - t) ** 2 * t * p
        + 3 * (1 - t) * t**2 * q
        + t**3 * b.at
    )


def _draw(mask: Mask, points: F64) -> None:
    """Draws a line 3 px wide."""
    x, y = np.round(points).astype(int).T
    keep = (x >= 1) & (y >= 1) & (x < mask.shape[1] - 1) & (y < mask.shape[0] - 1)
    for d in (-1, 0, 1):
        mask[y[keep] + d, x[keep]] = mask[y[keep], x[keep] + d] = True


def _paint_strip(
    result: F32, where: Mask, piece: Mask, line: BorderLine, width: int = STRIP
) -> None:
    """Paints the colours across the ends of a line along it, within a piece of the hole.

    `width`: px on both sides of the line.
    """
    first = np.where(np.isnan(line.first), line.last, line.first)
    last = np.where(np.isnan(line.last), line.first, line.last)
    x0, y0 = np.maximum(np.floor(line.points.min(0)).astype(int) - STRIP, 0)
    x1, y1 = np.ceil(line.points.max(0)).astype(int) + STRIP + 1
    y, x = np.nonzero(piece[y0:y1, x0:x1] & ~where[y0:y1, x0:x1])
    near, away = np.zeros(len(x), np.int64), np.zeros(len(x))
    step = max(CHUNK // len(line.points), 1)
    for k in range(0, len(x), step):
        part = slice(k, k + step)
        gap = (x[part, None] + x0 - line.points[:, 0]) ** 2 + (
            y[part, None] + y0 - line.points[:, 1]
        ) ** 2
        near[part], away[part] = gap.argmin(1), gap.min(1)
    along = np.gradient(line.points, axis=0)[near]
    along /= np.hypot(along[:, 0], along[:, 1])[:, None]
    off = np.stack([x + x0, y + y0], 1) - line.points[near]
    side = along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0]
    share_along = (near / max(1, len(line.points) - 1))[:, None]
    place = np.clip(side + STRIP, 0, 2 * STRIP - 1e-6)
    low = place.astype(int)
    share = (place - low)[:, None]
    start, end = ((1 - share) * p[low] + share * p[low + 1] for p in (first, last))
    colour = (1 - share_along) * start + share_along * end
    keep = (np.sqrt(away) <= width) & ~np.isnan(colour).any(1)
    result[y[keep] + y0, x[keep] + x0] = colour[keep]
    where[y[keep] + y0, x[keep] + x0] = True
