"""Borders that enter a hole and found no partner -> where they go: out of the hole again, to a corner, or to a T.

A border that lies flat along the hole's is seen where one that came straight through from the other side should leave
(a table's edge behind a plank). Two that point at one place in the hole, with one colour between them, are a corner.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from physgen.perceive.borders import F64, SIDE, STRIP, End, Line, Ring, profile
from physgen.perceive.membrane import Mask

ALIKE = 25.0
"""Levels that the side of a border which is more alike may differ by from end to end."""
DOUBT = 0.75
"""Most doubt that two ends are one border's: colours that differ, turns that are no arc's, long bends."""
BEYOND = 8, 14, 20, 30, 40
"""px beyond the hole at which a border that leaves it is looked for."""
DRIFT = 0.06
"""By how much of its length a border that goes straight through may miss, since its direction is not exact."""
FAINTER = 0.5
"""Of its contrast where it enters, what a border has at least where it leaves."""
CORNER = 0.5
"""Sine of the angle between two borders, from which they make a corner."""


def through(end: End, ring: Ring, piece: Mask, drawn: Mask) -> Line | None:
    """Straight on to the other side of a hole, where the same border is seen to leave it; None where it is not."""
    points, inside = straight(end.at, end.towards, piece)
    stretch = np.flatnonzero(inside)
    x, y = np.round(points).astype(int).T
    if not len(stretch) or drawn[y, x][stretch].any():
        return None
    best, result = DOUBT, None
    for beyond in BEYOND:
        leave = points[stretch[-1]] + beyond * end.towards
        length = float(np.hypot(*(leave - end.at)))
        reach = int(max(4, DRIFT * length))
        for shift in range(-reach, reach + 1):
            at = leave + shift * np.array([-end.towards[1], end.towards[0]])
            seen = profile(ring.picture, ring.blocked, at, (at - end.at) / np.hypot(*(at - end.at)))
            doubt = _other(end, seen)
            if doubt < best:
                best, result = doubt, Line(segment(end.at, at), end.profile, seen)
        if result is not None:
            return result
    return None


def _other(end: End, seen: F64) -> float:
    """Doubt that what is `seen` across a border (2 STRIP + 1, 3) is the one that entered at `end`; inf: it is not."""
    left, right = seen[STRIP - SIDE : STRIP - 1], seen[STRIP + 2 : STRIP + SIDE + 1]
    if np.isnan(left[:, 0]).sum() > 2 or np.isnan(right[:, 0]).sum() > 2:
        return np.inf
    sides = np.nanmean(left, axis=0), np.nanmean(right, axis=0)
    off = float(np.linalg.norm(sides[0] - end.left)), float(np.linalg.norm(sides[1] - end.right))
    contrast = float(np.linalg.norm(sides[0] - sides[1]))
    both = contrast + end.contrast
    if min(off) > max(ALIKE, 0.17 * both) or contrast < FAINTER * end.contrast:
        return np.inf
    return (1.5 * min(off) + 0.5 * max(off)) / both


def corners(ends: Sequence[End], piece: Mask, drawn: Mask) -> list[tuple[End, End, F64]]:
    """Pairs of ends that point at one place in the hole, and that place, best first; each end at most once."""
    size, found = max(piece.shape), []
    for i, a in enumerate(ends):
        for j, b in enumerate(ends[:i]):
            sine = a.towards[0] * b.towards[1] - a.towards[1] * b.towards[0]
            if abs(sine) < CORNER:
                continue
            gap = b.at - a.at
            u = (gap[0] * b.towards[1] - gap[1] * b.towards[0]) / sine
            v = (gap[0] * a.towards[1] - gap[1] * a.towards[0]) / sine
            if min(u, v) <= 0 or not (_free(a, u, piece, drawn) and _free(b, v, piece, drawn)):
                continue
            near, far = unlike(a, b)
            both = a.contrast + b.contrast
            doubt = (1.5 * near + 0.5 * far) / both + (u + v) / size
            if near < max(ALIKE, 0.17 * both) and doubt < DOUBT:
                found.append((doubt, i, j, a.at + u * a.towards))
    result, taken = [], set[int]()
    for _, i, j, place in sorted(found, key=lambda one: one[:3]):
        if not taken & {i, j}:
            taken |= {i, j}
            result.append((ends[i], ends[j], place))
    return result


def ray(end: End, piece: Mask, drawn: Mask) -> F64 | None:
    """From where a border enters straight on to the first line that is drawn; None if there is none in the hole."""
    points, inside = straight(end.at, end.towards, piece)
    x, y = np.round(points).astype(int).T
    hit = np.flatnonzero(drawn[y, x] & inside)
    return points[: hit[0] + 1] if len(hit) else None


def straight(at: F64, towards: F64, piece: Mask) -> tuple[F64, Mask]:
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


def unlike(a: End, b: End) -> tuple[float, float]:
    """Differences of colour between two ends: of the side that is more alike (what lies in front), and the other."""
    one, other = float(np.linalg.norm(a.left - b.right)), float(np.linalg.norm(a.right - b.left))
    return min(one, other), max(one, other)


def segment(at: F64, to: F64) -> F64:
    """Points (n, 2) from one place to another, half a px apart."""
    return at + np.linspace(0, 1, int(2 * np.hypot(*(to - at))) + 2)[:, None] * (to - at)


def _free(end: End, length: float, piece: Mask, drawn: Mask) -> bool:
    """Whether a border can go on for `length` px: in the hole to the last, and across no line."""
    points, inside = straight(end.at, end.towards, piece)
    n = int(2 * length)
    x, y = np.round(points[: n + 1]).astype(int).T
    return n < len(points) and bool(inside[n]) and not drawn[y, x].any()
