"""Region -> convex pieces: ear-cut triangles, flipped towards Delaunay, merged by Hertel and Mehlhorn (1983)."""

from __future__ import annotations

import mapbox_earcut
import numpy as np
from numpy.typing import NDArray

from physgen.geometry import Array, cross, polygon_moments
from physgen.outline.outline import Region, Ring

SLIVER = 1e-3
"""px²: smaller pieces are left out; an engine makes nothing of them."""

_FLAT = 1e-9
"""px²: a corner this flat is straight."""


def convex_pieces(outline: Region) -> tuple[Array, ...]:
    """Convex polygons `(K, 2)` float64 px that make up the region, each turning +x towards +y, slivers left out.

    At most four times as many as the fewest possible (Hertel and Mehlhorn); usually near the fewest.
    """
    return tuple(piece for ring in outline.rings for piece in _ring_pieces(ring))


def _ring_pieces(ring: Ring) -> list[Array]:
    borders = [_without_straight_corners(points) for points in (ring.outer, *ring.holes)]
    borders = [points for points in borders if len(points) >= 3]
    if not borders:
        return []
    points = np.concatenate(borders)
    ends = np.cumsum([len(border) for border in borders]).astype(np.uint32)
    # about the middle: ear cutting compares products of coordinates
    local = np.ascontiguousarray(points - points.mean(axis=0))
    triangles = mapbox_earcut.triangulate_float64(local, ends).reshape(-1, 3).astype(np.int64)
    faces = _merge(local, _oriented(local, triangles))
    pieces = [points[face] for face in faces]
    return [piece for piece in map(_without_straight_corners, pieces) if _area(piece) >= SLIVER]


def _area(points: Array) -> float:
    return polygon_moments(points).area if len(points) >= 3 else 0.0


def _without_straight_corners(points: Array) -> Array:
    """Drop repeated points and corners within a straight line."""
    while len(points) >= 3:
        before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
        straight = np.abs(cross(points - before, after - points)) <= _FLAT
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
    inner = [edge for edge in edges if edge[0] < edge[1] and (edge[1], edge[0]) in edges]

    def length(edge: tuple[int, int]) -> float:
        (ax, ay), (bx, by) = xy[edge[0]], xy[edge[1]]
        return float((ax - bx) ** 2 + (ay - by) ** 2)

    def turns_in(before: int, here: int, after: int) -> bool:
        (ax, ay), (bx, by), (cx, cy) = xy[before], xy[here], xy[after]
        return bool((bx - ax) * (cy - by) - (by - ay) * (cx - bx) >= -_FLAT)

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
