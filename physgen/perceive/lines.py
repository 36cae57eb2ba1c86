"""A picture with a hole -> the borders that run into it, carried on through it, with flat colour between them.

Where a border enters the hole, its direction and the colours on both its sides are measured. Two that would meet by a
gentle bend, with the same colours, are one border (the least bending energy of a cubic, as in Masnou and Morel 1998,
Level lines based disocclusion). One that stays alone goes straight on (`alone`).
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from physgen.perceive.alone import ALIKE, DOUBT, corners, ray, segment, through, unlike
from physgen.perceive.borders import F64, OFF, STRIP, End, Line, Ring, ends
from physgen.perceive.membrane import F32, Mask, grown

ALONE = 40.0
"""The same for a border that goes on alone."""
PAD = 12
"""px by which the photo is held to go on beyond its border, so that what enters a hole close to it is seen."""
BULGE = 0.1
"""Bending from which a border that only runs along the hole's is not drawn."""
AT_ONCE = 500_000
"""Pairs of a pixel and a point of a line that are held in memory."""


def carried(picture: F32, hole: Mask) -> tuple[F32, Mask]:
    """`(H, W, 3)` with strips along the borders carried on through `hole` (H, W), and where these strips are."""
    height, width = hole.shape
    edges = (PAD,) * 4
    picture = np.asarray(cv2.copyMakeBorder(picture, *edges, cv2.BORDER_REPLICATE), np.float32)
    hole = cv2.copyMakeBorder(hole.astype(np.uint8), *edges, cv2.BORDER_REPLICATE) > 0
    result, where = picture.copy(), np.zeros_like(hole)
    ring = Ring.of(picture, grown(hole, 1))
    count, ids = cv2.connectedComponents(hole.astype(np.uint8), connectivity=8)
    for k in range(1, count):
        piece = ids == k
        for line in _lines(list(ends(ring, piece)), piece, ring):
            _strip(result, where, piece, line)
    inner = slice(PAD, PAD + height), slice(PAD, PAD + width)
    return result[inner], where[inner]


def _lines(ends: list[End], piece: Mask, ring: Ring) -> Iterator[Line]:
    """Ends joined two by two, best first; then those that stay alone, straight on to a T."""
    pairs = []
    bends: dict[tuple[int, int], float] = {}
    for i, a in enumerate(ends):
        for j in range(i):
            b = ends[j]
            chord = b.at - a.at
            alpha, beta = _turn(chord, a.towards), _turn(chord, -b.towards)
            bend = bends[i, j] = alpha * alpha + alpha * beta + beta * beta
            near, far = unlike(a, b)
            both = a.contrast + b.contrast
            length = float(np.hypot(*chord))
            doubt = (1.5 * near + 0.5 * far) / both + 2 * abs(alpha + beta) + bend * length / 67
            if length > 2 * OFF and near < max(ALIKE, 0.17 * both) and doubt < DOUBT:
                pairs.append((doubt + 7 * bend, i, j))
    depth = cv2.distanceTransform(np.pad(piece, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    joined: set[int] = set()
    chords: list[tuple[int, int]] = []
    drawn = np.zeros(piece.shape, bool)
    for _, i, j in sorted(pairs):
        if i in joined or j in joined or any((p < i < q) != (p < j < q) for p, q in chords):
            continue
        line = Line(_cubic(ends[i], ends[j]), ends[i].profile, ends[j].profile[::-1])
        y, x = (
            np.clip(np.round(c).astype(int), 0, n - 1)
            for c, n in zip(line.points.T[::-1], piece.shape, strict=True)
        )
        joined |= {i, j}
        chords.append((min(i, j), max(i, j)))
        shallow = depth[y, x].max() < 1 + 0.05 * len(line.points)  # half a px apart
        if shallow and bends[i, j] > BULGE:
            continue
        _draw(drawn, line.points)
        yield line
    alone = [e for k, e in enumerate(ends) if k not in joined and e.contrast > ALONE]
    for end in sorted(alone, key=lambda end: -end.contrast):
        if (passing := through(end, ring, piece, drawn)) is not None:
            alone = [other for other in alone if other is not end]
            _draw(drawn, passing.points)
            yield passing
    for last in (
        False,
        False,
        True,
    ):  # one that ends at another's T comes second, and what is left may be a corner
        met = [(end, path) for end in alone if (path := ray(end, piece, drawn)) is not None]
        alone = [end for end in alone if all(end is not other for other, _ in met)]
        for end, path in met:
            _draw(drawn, path)
            yield Line(path, end.profile, end.profile)
        for a, b, place in [] if last or met else corners(alone, piece, drawn):
            alone = [end for end in alone if end is not a and end is not b]
            bent = np.concatenate([segment(a.at, place), segment(place, b.at)[1:]])
            _draw(drawn, bent)
            yield Line(bent, a.profile, b.profile[::-1])


def _turn(a: F64, b: F64) -> float:
    """Angle from a to b, rad."""
    return float(np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b))


def _cubic(a: End, b: End) -> F64:
    """The curve that leaves `a` along its direction and arrives in `b` against its own."""
    length = float(np.hypot(*(b.at - a.at)))
    alpha = abs(_turn(b.at - a.at, a.towards)) + abs(_turn(b.at - a.at, -b.towards))
    handle = length / 3 * (1 + alpha * alpha / 24)  # about a circle's
    t = np.linspace(0, 1, int(2 * length) + 2)[:, None]
    p, q = a.at + handle * a.towards, b.at + handle * b.towards
    return (1 - t) ** 3 * a.at + 3 * (1 - t) ** 2 * t * p + 3 * (1 - t) * t**2 * q + t**3 * b.at


def _draw(mask: Mask, points: F64) -> None:
    """A line 3 px wide."""
    x, y = np.round(points).astype(int).T
    keep = (x >= 1) & (y >= 1) & (x < mask.shape[1] - 1) & (y < mask.shape[0] - 1)
    for d in (-1, 0, 1):
        mask[y[keep] + d, x[keep]] = mask[y[keep], x[keep] + d] = True


def _strip(result: F32, where: Mask, piece: Mask, line: Line) -> None:
    """Paints the colours across the ends of a line along it, within a piece of the hole."""
    first = np.where(np.isnan(line.first), line.last, line.first)
    last = np.where(np.isnan(line.last), line.first, line.last)
    x0, y0 = np.maximum(np.floor(line.points.min(0)).astype(int) - STRIP, 0)
    x1, y1 = np.ceil(line.points.max(0)).astype(int) + STRIP + 1
    inside = piece[y0:y1, x0:x1] & ~where[y0:y1, x0:x1]
    y, x = np.nonzero(inside)
    near, away = np.zeros(len(x), np.int64), np.zeros(len(x))
    step = max(AT_ONCE // len(line.points), 1)
    for k in range(0, len(x), step):
        part = slice(k, k + step)
        gap = (x[part, None] + x0 - line.points[:, 0]) ** 2 + (y[part, None] + y0 - line.points[:, 1]) ** 2
        near[part], away[part] = gap.argmin(1), gap.min(1)
    along = np.gradient(line.points, axis=0)[near]
    along /= np.hypot(along[:, 0], along[:, 1])[:, None]
    off = np.stack([x + x0, y + y0], 1) - line.points[near]
    side = along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0]
    keep = np.sqrt(away) <= STRIP
    along_it = (near / max(1, len(line.points) - 1))[:, None]
    place = np.clip(side + STRIP, 0, 2 * STRIP - 1e-6)
    low = place.astype(int)
    share = (place - low)[:, None]
    start, end = ((1 - share) * p[low] + share * p[low + 1] for p in (first, last))
    colour = (1 - along_it) * start + along_it * end
    keep &= ~np.isnan(colour).any(1)
    result[y[keep] + y0, x[keep] + x0] = colour[keep]
    where[y[keep] + y0, x[keep] + x0] = True
