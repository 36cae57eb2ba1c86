"""Convex pieces of regions, and the overlap of two outlines.

Regions are cut into ear-cut triangles, which are merged across their longest edges (Hertel and Mehlhorn 1983).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import mapbox_earcut
import numpy as np
import shapely
from numpy.typing import NDArray

from physgen.geometry.polygon import (
    Array,
    Disc,
    Outline,
    Region,
    Ring,
    cross,
    polygon_moments,
)

SLIVER = 1e-3
"""px²: smaller pieces are left out; an engine makes nothing of them."""


@dataclass(frozen=True)
class PieceTuning:
    """Limits of convex pieces."""

    seam: float = 0.5
    """px between two pieces of one object that is meant to be whole there."""
    flush: float = 0.02
    """px by which corners may lie within the hull of pieces that become one."""
    many: int = 200
    """Pieces of a body above which seams stay as they are: every two are looked at."""
    remembered: int = 1000
    """Regions."""
    flat: float = 1e-9
    """px²: a corner this flat is straight."""
    rounding: float = 1e-9
    """px²: a smaller overlap is none."""
    corners: int = 64
    """Of a quarter of a circle as a polygon."""


PIECES = PieceTuning()


@lru_cache(PIECES.remembered)
def convex_pieces(outline: Region) -> tuple[Array, ...]:
    """Convex polygons `(K, 2)` float64 px that make up the region, each turning +x towards +y, slivers left out.

    At most four times as many as the fewest possible (Hertel and Mehlhorn); usually near the fewest. Pieces of
    different rings that lie within a hair of each other and are convex together become one: nothing trips over a seam.
    Those of the last regions are remembered, and read-only.
    """
    pieces = [
        (k, piece)
        for k, ring in enumerate(outline.rings)
        for piece in _ring_pieces(ring)
    ]
    found = tuple(piece for _, piece in _joined(pieces))
    for piece in found:
        piece.flags.writeable = False
    return found


def _joined(pieces: list[tuple[int, Array]]) -> list[tuple[int, Array]]:
    """Hulls instead of neighbours of different rings, wherever the hull adds no more than the seam between them."""
    done = len({ring for ring, _ in pieces}) < 2 or len(pieces) > PIECES.many
    while not done:
        done = True
        for i, j in combinations(range(len(pieces)), 2):
            (one, a), (other, b) = pieces[i], pieces[j]
            hull = _as_one(a, b) if one != other else None
            if hull is not None:
                pieces = [
                    *pieces[:i],
                    (-1 - i, hull),
                    *pieces[i + 1 : j],
                    *pieces[j + 1 :],
                ]
                done = False
                break
    return pieces


def _as_one(a: Array, b: Array) -> Array | None:
    """Convex hull of two convex polygons that are a seam apart and, but for it, convex together."""
    if (a.min(axis=0) > b.max(axis=0) + PIECES.seam).any() or (
        b.min(axis=0) > a.max(axis=0) + PIECES.seam
    ).any():
        return None
    points = np.concatenate([a, b])
    whole: Array = shapely.get_coordinates(
        shapely.convex_hull(shapely.multipoints(points))
    )[-2::-1]
    whole = np.roll(whole, -int(np.lexsort((whole[:, 1], whole[:, 0]))[0]), axis=0)
    start, along = whole, np.roll(whole, -1, axis=0) - whole
    inside = (
        cross(along[:, None], points[None] - start[:, None])
        / np.hypot(*along.T)[:, None]
    )
    gap = shapely.Polygon(a).distance(shapely.Polygon(b))
    longest = float(np.hypot(*np.minimum(np.ptp(a, axis=0), np.ptp(b, axis=0))))
    added = _area(whole) - _area(a) - _area(b)
    if (
        (inside.min(axis=0) > PIECES.flush).any()
        or gap > PIECES.seam
        or added > (gap + PIECES.flush) * longest
    ):
        return None
    return whole


def _ring_pieces(ring: Ring) -> list[Array]:
    borders = [
        _without_straight_corners(points) for points in (ring.outer, *ring.holes)
    ]
    borders = [points for points in borders if len(points) >= 3]
    if not borders:
        return []
    points = np.concatenate(borders)
    ends = np.cumsum([len(border) for border in borders]).astype(np.uint32)
    # about the middle: ear cutting compares products of coordinates
    local = np.ascontiguousarray(points - points.mean(axis=0))
    triangles = (
        mapbox_earcut.triangulate_float64(local, ends).reshape(-1, 3).astype(np.int64)
    )
    faces = _merge(local, _oriented(local, triangles))
    pieces = [points[face] for face in faces]
    return [
        piece
        for piece in map(_without_straight_corners, pieces)
        if _area(piece) >= SLIVER
    ]


def _area(points: Array) -> float:
    return polygon_moments(points).area if len(points) >= 3 else 0.0


def _without_straight_corners(points: Array) -> Array:
    """Drop repeated points and corners within a straight line."""
    while len(points) >= 3:
        before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
        straight = np.abs(cross(points - before, after - points)) <= PIECES.flat
        if not straight.any():
            break
        # not two neighbours at once: dropping one may make the other a corner
        drop = straight & ~np.roll(straight, 1)
        if not drop.any():
            drop[int(np.argmax(straight))] = True
        points = points[~drop]
    return points


def _oriented(points: Array, triangles: NDArray[np.int64]) -> list[list[int]]:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    turn = cross(b - a, c - a)
    faces = np.where((turn < 0)[:, None], triangles[:, ::-1], triangles)
    found: list[list[int]] = faces[turn != 0].tolist()
    return found


def _merge(points: Array, faces: list[list[int]]) -> list[list[int]]:
    """Remove inner edges, longest first, wherever the two faces together are convex."""
    xy = points.tolist()
    edges: dict[tuple[int, int], int] = {}
    for index, face in enumerate(faces):
        for k, here in enumerate(face):
            edges[here, face[(k + 1) % len(face)]] = index
    inner = [
        edge for edge in edges if edge[0] < edge[1] and (edge[1], edge[0]) in edges
    ]

    def length(edge: tuple[int, int]) -> float:
        (ax, ay), (bx, by) = xy[edge[0]], xy[edge[1]]
        return float((ax - bx) ** 2 + (ay - by) ** 2)

    def turns_in(before: int, here: int, after: int) -> bool:
        (ax, ay), (bx, by), (cx, cy) = xy[before], xy[here], xy[after]
        return bool((bx - ax) * (cy - by) - (by - ay) * (cx - bx) >= -PIECES.flat)

    for edge in sorted(inner, key=length, reverse=True):
        one, other = edges[edge], edges[edge[1], edge[0]]
        if one == other:
            continue
        start, end = edge
        face, back = faces[one], faces[other]
        i, j = face.index(end), back.index(start)
        face = face[i:] + face[:i]  # end ... start
        back = back[j:] + back[:j]  # start ... end
        if len(set(face) & set(back)) > 2:
            continue
        if turns_in(face[-2], start, back[1]) and turns_in(back[-2], end, face[1]):
            faces[one] = face + back[1:-1]
            faces[other] = []
            for k, here in enumerate(back[:-1]):
                edges[here, back[k + 1]] = one
            del edges[edge], edges[edge[1], edge[0]]
    return [face for face in faces if face]


def outline_shape(outline: Outline) -> shapely.Geometry:
    """The outline as shapely's polygons; a circle as one of many corners."""
    if isinstance(outline, Disc):
        return shapely.Point(outline.center).buffer(
            outline.radius, quad_segs=PIECES.corners
        )
    return shapely.union_all(
        [shapely.Polygon(ring.outer, ring.holes).buffer(0) for ring in outline.rings]
    )


def overlap_depth(a: Outline, b: Outline) -> float:
    """Overlap px of two outlines: the diameter of the largest circle in what they share; 0 where they only touch.

    Of circles, and of sides that are longer than they overlap, it is the penetration depth.
    """
    shared = shapely.get_parts(outline_shape(a).intersection(outline_shape(b)))
    circles = [
        shapely.maximum_inscribed_circle(part)
        for part in shared
        if part.area > PIECES.rounding
    ]
    return 2 * max((circle.length for circle in circles), default=0.0)
