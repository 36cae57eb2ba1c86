"""Convex pieces of regions, and the overlap of two outlines.

Regions are triangulated by ear cutting, and the triangles are merged across their
longest edges (Hertel and Mehlhorn 1983).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial
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
"""Area of a piece, px², below which it is left out, since an engine cannot use it."""


@dataclass(frozen=True)
class PieceTuning:
    """Limits of convex pieces."""

    seam: float = 0.5
    """Largest gap between two pieces of one object by an artefact, px."""
    flush: float = 0.02
    """Largest tolerated depth of corners within the hull of merged pieces, px."""
    max_pieces: int = 200
    """Number of pieces of a body above which seams stay: all pairs would be
    compared.
    """
    cache_size: int = 1000
    """Number of regions in the cache."""
    straight_area: float = 1e-9
    """Area of a corner's triangle, px², below which the corner is straight."""
    rounding: float = 1e-9
    """Smallest area of an overlap beyond rounding errors, px²."""
    corners: int = 64
    """Number of corners of a quarter of a circle as a polygon."""


PIECES = PieceTuning()


@lru_cache(PIECES.cache_size)
def convex_pieces(outline: Region) -> tuple[Array, ...]:
    """Return the convex pieces `(K, 2)` float64 px of a region, without slivers.

    Each turns +x towards +y. Their number is at most four times the minimum (Hertel and
    Mehlhorn), and usually near the minimum. Pieces of different rings with a tiny gap
    that are convex together are merged, since objects would be stopped by the seam. The
    cached arrays are read-only.
    """
    numbered_pieces = []
    for number, ring in enumerate(outline.rings):
        numbered_pieces += [(number, piece) for piece in _ring_pieces(ring)]
    pieces = tuple(piece for _, piece in _join(numbered_pieces))
    for piece in pieces:
        piece.flags.writeable = False
    return pieces


def _join(pieces: list[tuple[int, Array]]) -> list[tuple[int, Array]]:
    """Replace neighbours of different rings by their hull, if the hull only adds the
    seam.
    """
    # All pairs are compared, so that the work grows with the cube of the pieces.
    if len({ring for ring, _ in pieces}) < 2 or len(pieces) > PIECES.max_pieces:
        return pieces
    while True:
        joint = _first_joint(pieces)
        if joint is None:
            return pieces
        i, j, hull = joint
        # A number of its own: the hull may join further pieces of both rings.
        pieces = [*pieces[:i], (-1 - i, hull), *pieces[i + 1 : j], *pieces[j + 1 :]]


def _first_joint(pieces: list[tuple[int, Array]]) -> tuple[int, int, Array] | None:
    """Return the first two pieces of different rings that can be merged, and their
    hull.
    """
    for i, j in combinations(range(len(pieces)), 2):
        (ring, piece), (other_ring, other_piece) = pieces[i], pieces[j]
        if ring == other_ring:
            continue
        hull = _as_one(piece, other_piece)
        if hull is not None:
            return i, j, hull
    return None


def _as_one(a: Array, b: Array) -> Array | None:
    """Return the hull of two convex polygons that are convex together except for a
    seam.
    """
    # Most pairs are far apart, which their boxes show without a hull.
    is_left_or_above = (a.min(axis=0) > b.max(axis=0) + PIECES.seam).any()
    if is_left_or_above or (b.min(axis=0) > a.max(axis=0) + PIECES.seam).any():
        return None
    # Both polygons are one if no corner lies deep inside their hull: each must be on
    # it.
    points = np.concatenate([a, b])
    hull = _hull(points)
    edges = np.roll(hull, -1, axis=0) - hull
    depth = cross(edges[:, None], points[None] - hull[:, None])
    depth = depth / np.hypot(*edges.T)[:, None]
    if (depth.min(axis=0) > PIECES.flush).any():
        return None
    # The exact distance takes longest and comes last.
    gap = shapely.Polygon(a).distance(shapely.Polygon(b))
    if gap > PIECES.seam:
        return None
    # The seam itself may add the area of a narrow strip, but no more.
    common_size = np.minimum(np.ptp(a, axis=0), np.ptp(b, axis=0))
    longest = float(np.hypot(*common_size))
    added_area = _area(hull) - _area(a) - _area(b)
    if added_area <= (gap + PIECES.flush) * longest:
        return hull
    return None


def _hull(points: Array) -> Array:
    """Return the convex hull `(K, 2)` of points, turning +x towards +y, from its
    leftmost corner on.
    """
    shape = shapely.convex_hull(shapely.multipoints(points))
    corners: Array = shapely.get_coordinates(shape)[-2::-1]
    first = int(np.lexsort((corners[:, 1], corners[:, 0]))[0])
    return np.roll(corners, -first, axis=0)


def _ring_pieces(ring: Ring) -> list[Array]:
    """Return the convex pieces of a ring, px."""
    borders = []
    for points in (ring.outer, *ring.holes):
        corners = _without_straight_corners(points)
        if len(corners) >= 3:
            borders.append(corners)
    if not borders:
        return []
    # Ear cutting takes all borders in one array, with the end of each.
    points = np.concatenate(borders)
    ends = np.cumsum(list(map(len, borders))).astype(np.uint32)
    # Relative to the middle, since ear cutting compares products of coordinates.
    local = np.ascontiguousarray(points - points.mean(axis=0))
    indices = mapbox_earcut.triangulate_float64(local, ends)
    triangles = indices.reshape(-1, 3).astype(np.int64)
    pieces = []
    for face in _merge(local, _orient(local, triangles)):
        piece = _without_straight_corners(points[face])
        if _area(piece) >= SLIVER:
            pieces.append(piece)
    return pieces


def _area(points: Array) -> float:
    """Return the area of a polygon, px²; 0 for less than three corners."""
    if len(points) >= 3:
        return polygon_moments(points).area
    return 0.0


def _without_straight_corners(points: Array) -> Array:
    """Remove repeated points and straight corners."""
    while len(points) >= 3:
        before = np.roll(points, 1, axis=0)
        after = np.roll(points, -1, axis=0)
        is_flat_corner = (
            np.abs(cross(points - before, after - points)) <= PIECES.straight_area
        )
        if not is_flat_corner.any():
            break
        # Not two neighbours at once: without one, the other may be a true corner.
        drop = is_flat_corner & ~np.roll(is_flat_corner, 1)
        if not drop.any():
            drop[int(np.argmax(is_flat_corner))] = True
        points = points[~drop]
    return points


def _orient(points: Array, triangles: NDArray[np.int64]) -> list[list[int]]:
    """Return the faces of triangles that turn +x towards +y, without degenerate
    ones.
    """
    a, b, c = (points[triangles[:, k]] for k in range(3))
    turn = cross(b - a, c - a)
    faces = np.where((turn < 0)[:, None], triangles[:, ::-1], triangles)
    counterclockwise: list[list[int]] = faces[turn != 0].tolist()
    return counterclockwise


def _squared_length(xy: list[list[float]], edge: tuple[int, int]) -> float:
    """Return the squared length of an edge between two points of `xy`, px²."""
    (ax, ay), (bx, by) = xy[edge[0]], xy[edge[1]]
    return (ax - bx) ** 2 + (ay - by) ** 2


def _is_convex(xy: list[list[float]], before: int, corner: int, after: int) -> bool:
    """Return whether the corner between two points of `xy` is convex."""
    (ax, ay), (bx, by), (cx, cy) = xy[before], xy[corner], xy[after]
    turn = (bx - ax) * (cy - by) - (by - ay) * (cx - bx)
    return turn >= -PIECES.straight_area


def _merge(points: Array, faces: list[list[int]]) -> list[list[int]]:
    """Remove inner edges, the longest first, if both faces together are convex."""
    # Numbers of Python are faster than elements of arrays in this loop.
    xy = points.tolist()
    # Each directed edge belongs to one face; an inner edge occurs in both directions.
    edges: dict[tuple[int, int], int] = {}
    for index, face in enumerate(faces):
        for k, corner in enumerate(face):
            edges[corner, face[(k + 1) % len(face)]] = index
    inner = []
    for start, end in edges:
        if start < end and (end, start) in edges:
            inner.append((start, end))

    length = partial(_squared_length, xy)
    # Long edges first: the pieces become compact rather than slender.
    for start, end in sorted(inner, key=length, reverse=True):
        left = edges[start, end]
        right = edges[end, start]
        if left == right:
            continue
        face = _rotate(faces[left], end)  # end ... start
        other = _rotate(faces[right], start)  # start ... end
        # Faces that share more than the edge would enclose a hole.
        if len(set(face) & set(other)) > 2:
            continue
        # The union is convex if both ends of the removed edge are.
        is_convex = _is_convex(xy, face[-2], start, other[1])
        if is_convex and _is_convex(xy, other[-2], end, face[1]):
            faces[left] = face + other[1:-1]
            faces[right] = []
            for k, corner in enumerate(other[:-1]):
                edges[corner, other[k + 1]] = left
            del edges[start, end], edges[end, start]
    return [face for face in faces if face]


def _rotate(face: list[int], first: int) -> list[int]:
    """Return the same face with `first` as its first corner."""
    place = face.index(first)
    return face[place:] + face[:place]


def outline_shape(outline: Outline) -> shapely.Geometry:
    """Return the outline as shapely's polygons; a circle as one of many corners."""
    if isinstance(outline, Disc):
        center = shapely.Point(outline.center)
        return center.buffer(outline.radius, quad_segs=PIECES.corners)
    shapes = [shapely.Polygon(ring.outer, ring.holes) for ring in outline.rings]
    return shapely.union_all([shape.buffer(0) for shape in shapes])


def overlap_depth(a: Outline, b: Outline) -> float:
    """Return the depth of the overlap of two outlines, px; 0 if they only touch.

    It is the diameter of the largest circle in their common area. For circles, and for
    sides longer than the overlap, this is the penetration depth.
    """
    depths = [0.0]
    common = outline_shape(a).intersection(outline_shape(b))
    for part in shapely.get_parts(common):
        if part.area > PIECES.rounding:
            depths.append(2 * shapely.maximum_inscribed_circle(part).length)
    return max(depths)
