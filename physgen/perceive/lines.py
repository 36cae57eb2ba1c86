"""A picture with a hole -> the borders that run into it, carried on through it, with flat colour between them.

Where a border enters the hole, its direction and the colours on both its sides are measured. Two that would meet by a
gentle bend, with the same colours, are one border (the least bending energy of a cubic, as in Masnou and Morel 1998,
Level lines based disocclusion). One that stays alone goes straight on until it meets another: a T.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.membrane import F32, Mask, grown

F64 = NDArray[np.float64]

OFF = 5
"""px from the hole at which borders are looked for."""
STRIP = 12
"""px to each side of a border that are carried on with it."""
SIDE = 7
"""px on each side of a border whose colours are averaged."""
CONTRAST = 22.0
"""Levels between the two sides (the length of the difference) from which there is a border."""
ALONE = 40.0
"""The same for a border that goes on alone."""
COHERENT = 0.75
"""Of the structure tensor, from which a border has a direction."""
ALIKE = 25.0
"""Levels that the side of a border which is more alike may differ by from end to end."""
BULGE = 0.1
"""Bending from which a border that only runs along the hole's is not drawn."""
AT_ONCE = 500_000
"""Pairs of a pixel and a point of a line that are held in memory."""
DOUBT = 0.75
"""Most doubt that two ends are one border's: colours that differ, turns that are no arc's, long bends."""


@dataclass(frozen=True)
class End:
    """Where a border enters a hole."""

    order: int
    """Place along the contour."""
    at: F64
    """x, y."""
    towards: F64
    """Unit vector into the hole."""
    left: F64
    """Mean colour to the left of `towards` (y down: the side of (ty, -tx))."""
    right: F64
    contrast: float
    profile: F64
    """(2 STRIP + 1, 3): colours across it, from left to right; NaN where hidden."""


@dataclass(frozen=True)
class Line:
    """A border in the hole."""

    points: F64
    """(n, 2): x, y, at most 1 px apart."""
    first: F64
    """(2 STRIP + 1, 3): colours across its first point, from left to right."""
    last: F64
    """The same at its last point."""


def carried(picture: F32, hole: Mask) -> tuple[F32, Mask]:
    """`(H, W, 3)` with strips along the borders carried on through `hole` (H, W), and where these strips are."""
    result, where = picture.copy(), np.zeros_like(hole)
    ring = _Ring.of(picture, grown(hole, 1))
    count, ids = cv2.connectedComponents(hole.astype(np.uint8), connectivity=8)
    for k in range(1, count):
        piece = ids == k
        for line in _lines(list(_ends(ring, piece)), piece):
            _strip(result, where, piece, line)
    return result, where


@dataclass(frozen=True)
class _Ring:
    """What is known around the hole: colours and the structure tensor of their gradients."""

    picture: F32
    blocked: Mask
    tensor: tuple[F32, F32, F32]

    @classmethod
    def of(cls, picture: F32, blocked: Mask) -> _Ring:
        smooth = cv2.GaussianBlur(picture, (0, 0), 1)
        known = (~grown(blocked, 1)).astype(np.float32)[:, :, None]
        gx, gy = (cv2.Sobel(smooth, cv2.CV_32F, *d, ksize=3) / 8 * known for d in ((1, 0), (0, 1)))
        xx, xy, yy = (
            cv2.GaussianBlur((a * b).sum(2), (0, 0), 3.5) for a, b in ((gx, gx), (gx, gy), (gy, gy))
        )
        return cls(np.asarray(smooth, np.float32), blocked, (xx, xy, yy))


def _ends(ring: _Ring, piece: Mask) -> Iterator[End]:
    """The borders that enter a piece of the hole, in the order of its contour."""
    picture, blocked = ring.picture, ring.blocked
    h, w = piece.shape
    r = OFF + SIDE + 2
    wide = cv2.copyMakeBorder(piece.astype(np.uint8), r, r, r, r, cv2.BORDER_CONSTANT, value=0)
    contours, _ = cv2.findContours(
        np.asarray(grown(wide > 0, OFF), np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    path = max(contours, key=len)[:, 0, :].astype(np.float64) - r
    x, y = path.astype(int).T
    inside = (x >= 2) & (y >= 2) & (x < w - 2) & (y < h - 2)
    xc, yc = np.clip(x, 0, w - 1), np.clip(y, 0, h - 1)
    usable = inside & ~blocked[yc, xc]
    n = len(path)
    if n < 6 * SIDE or not usable.any():
        return
    xx, xy, yy = (a[yc, xc].astype(np.float64) for a in ring.tensor)
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)  # of the gradient
    spread = np.hypot(xx - yy, 2 * xy)
    coherence = spread / np.maximum(xx + yy, 1e-6)
    # inward normal from the distance to the piece
    inward = cv2.GaussianBlur(wide.astype(np.float32), (0, 0), OFF)
    nx, ny = (cv2.Sobel(inward, cv2.CV_32F, *d, ksize=3)[y + r, x + r] for d in ((1, 0), (0, 1)))
    tx, ty = -np.sin(angle), np.cos(angle)
    sign = np.where(tx * nx + ty * ny < 0, -1, 1)
    tx, ty = tx * sign, ty * sign
    slant = (tx * nx + ty * ny) / np.maximum(np.hypot(nx, ny), 1e-9)
    # colours to both sides, across the border
    steps = np.arange(2, SIDE + 1)
    sides = []
    ok = usable.copy()
    for turn in (1, -1):
        sx = np.round(path[:, 0, None] + turn * ty[:, None] * steps).astype(int)
        sy = np.round(path[:, 1, None] - turn * tx[:, None] * steps).astype(int)
        legal = (sx >= 0) & (sy >= 0) & (sx < w) & (sy < h)
        sx, sy = np.clip(sx, 0, w - 1), np.clip(sy, 0, h - 1)
        legal &= ~blocked[sy, sx]
        ok &= legal.sum(1) >= 3
        sides.append((picture[sy, sx] * legal[:, :, None]).sum(1) / np.maximum(legal.sum(1), 1)[:, None])
    left, right = sides
    contrast = np.linalg.norm(left - right, axis=1)
    ok &= (coherence > COHERENT) & (contrast > CONTRAST) & (slant > 0.3)
    score = np.where(ok, spread, 0)
    for i in np.flatnonzero(ok):
        around = np.arange(i - 6, i + 7) % n
        if score[i] == score[around].max() and not (score[around[:6]] == score[i]).any():
            towards = np.array([tx[i], ty[i]])
            profile = _profile(picture, blocked, path[i], towards)
            slope = np.linalg.norm(profile[4:] - profile[:-4], axis=1)[2:-2]
            shift = 0 if np.isnan(slope).all() else int(np.nanargmax(slope)) - (len(slope) - 1) // 2
            at = path[i] + shift * np.array([-towards[1], towards[0]])
            profile = _profile(picture, blocked, at, towards)
            yield End(int(i), at, towards, left[i], right[i], float(contrast[i]), profile)


def _profile(picture: F32, blocked: Mask, at: F64, towards: F64) -> F64:
    """Colours (2 STRIP + 1, 3) across a border from left to right, averaged along its last px; NaN if hidden."""
    h, w = blocked.shape
    across = np.arange(-STRIP, STRIP + 1)[:, None]
    back = np.arange(0, 4)[None, :]
    x = at[0] - towards[0] * back - towards[1] * across
    y = at[1] - towards[1] * back + towards[0] * across
    xi, yi = np.round(x).astype(int), np.round(y).astype(int)
    legal = (xi >= 0) & (yi >= 0) & (xi < w) & (yi < h)
    xi, yi = np.clip(xi, 0, w - 1), np.clip(yi, 0, h - 1)
    legal &= ~blocked[yi, xi]
    weight = legal.sum(1)[:, None]
    mean = (picture[yi, xi] * legal[:, :, None]).sum(1) / np.maximum(weight, 1)
    return np.where(weight > 0, mean, np.nan)


def _lines(ends: list[End], piece: Mask) -> Iterator[Line]:
    """Ends joined two by two, best first; then those that stay alone, straight on to a T."""
    pairs = []
    bends: dict[tuple[int, int], float] = {}
    for i, a in enumerate(ends):
        for j in range(i):
            b = ends[j]
            chord = b.at - a.at
            alpha, beta = _turn(chord, a.towards), _turn(chord, -b.towards)
            bend = bends[i, j] = alpha * alpha + alpha * beta + beta * beta
            near, far = _unlike(a, b)
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
    for _ in range(2):  # one that ends at another's T comes second
        met = [(end, ray) for end in alone if (ray := _ray(end, piece, drawn)) is not None]
        alone = [end for end in alone if all(end is not other for other, _ in met)]
        for end, ray in met:
            _draw(drawn, ray)
            yield Line(ray, end.profile, end.profile)


def _straight(at: F64, towards: F64, piece: Mask) -> tuple[F64, Mask]:
    """Points half a px apart up to the photo's border, and which are in the hole's first stretch."""
    h, w = piece.shape
    points = at + 0.5 * np.arange(2 * (h + w))[:, None] * towards
    x, y = np.round(points).astype(int).T
    points = points[: int(np.argmax(np.append((x < 0) | (y < 0) | (x >= w) | (y >= h), True)))]
    x, y = np.round(points).astype(int).T
    inside = piece[y, x]
    first = int(np.argmax(inside)) if inside.any() else 0
    inside[first:] &= np.cumsum(~inside[first:]) == 0
    return points, inside


def _ray(end: End, piece: Mask, drawn: Mask) -> F64 | None:
    """From where a border enters straight on to the first line that is drawn; None if there is none in the hole."""
    points, inside = _straight(end.at, end.towards, piece)
    x, y = np.round(points).astype(int).T
    hit = np.flatnonzero(drawn[y, x] & inside)
    return points[: hit[0] + 1] if len(hit) else None


def _unlike(a: End, b: End) -> tuple[float, float]:
    """Differences of colour between two ends: of the side that is more alike (what lies in front), and the other."""
    one, other = float(np.linalg.norm(a.left - b.right)), float(np.linalg.norm(a.right - b.left))
    return min(one, other), max(one, other)


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
