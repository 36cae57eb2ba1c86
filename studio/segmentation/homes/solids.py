"""Closed triangle meshes from a few numbers: profiles, outlines and curves in metres in, `Solid` out. No Mitsuba.

A solid stands in its own frame: +x right, +y away, +z up. Every edge belongs to exactly two triangles once vertices at
the same place are taken as one (`open_edges` counts the others); triangles are wound to face outwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import mapbox_earcut
import numpy as np


@dataclass(frozen=True)
class Solid:
    """Triangles with texture coordinates."""

    vertices: np.ndarray
    """(V, 3) m."""
    uv: np.ndarray
    """(V, 2), 0..1 over the solid's print."""
    faces: np.ndarray
    """(F, 3) into vertices, counter-clockwise seen from outside."""

    def moved(
        self,
        by: object = (0, 0, 0),
        turn: np.ndarray | None = None,
        scale: object = 1.0,
    ) -> Solid:
        """Scaled (a number or (3,)), then turned by a (3, 3) rotation, then shifted by m."""
        points = self.vertices * np.asarray(scale, float)
        points = points if turn is None else points @ turn.T
        return Solid(points + np.asarray(by, float), self.uv, self.faces)

    def bent(self, law) -> Solid:
        """Every vertex taken elsewhere by `law((V, 3)) -> (V, 3)`."""
        return Solid(law(self.vertices), self.uv, self.faces)


def turn(axis: str, degrees: float) -> np.ndarray:
    """(3, 3) rotation about x, y or z, right-handed."""
    a, k = np.radians(degrees), "xyz".index(axis)
    i, j = (k + 1) % 3, (k + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = np.cos(a)
    matrix[i, j], matrix[j, i] = -np.sin(a), np.sin(a)
    return matrix


def join(solids: list[Solid]) -> Solid:
    """One mesh of several; they may touch or pass through each other."""
    starts = np.cumsum([0, *(len(s.vertices) for s in solids[:-1])])
    faces = np.concatenate(
        [s.faces + start for s, start in zip(solids, starts, strict=True)]
    )
    return Solid(
        np.concatenate([s.vertices for s in solids]),
        np.concatenate([s.uv for s in solids]),
        faces,
    )


def rounded(points: object, times: int = 2, closed: bool = False) -> np.ndarray:
    """Corners of a line (P, D) cut `times` over (Chaikin's scheme); the ends of an open line stay."""
    line = np.asarray(points, float)
    for _ in range(times):
        after = np.roll(line, -1, 0) if closed else line[1:]
        before = line if closed else line[:-1]
        cut = np.stack(
            [0.75 * before + 0.25 * after, 0.25 * before + 0.75 * after], 1
        ).reshape(-1, line.shape[1])
        line = cut if closed else np.concatenate([line[:1], cut[1:-1], line[-1:]])
    return line


def _quads(rows: int, columns: int) -> np.ndarray:
    i = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    return np.concatenate(
        [
            np.stack([i, i + 1, i + columns + 1], 1),
            np.stack([i, i + columns + 1, i + columns], 1),
        ]
    )


def lathe(profile: object, around: int = 40) -> Solid:
    """A body of revolution about z: profile (P, 2) of radius and height, from the axis round its outside back to it.

    Listed so that the outside lies on the right of its way (up along an outer wall). u once around, v along 0..1.
    """
    line = np.asarray(profile, float)
    run = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    angle = np.linspace(0, 2 * np.pi, around + 1)
    r, z = line[:, :1], np.broadcast_to(line[:, 1:], (len(line), around + 1))
    points = np.stack([r * np.cos(angle), r * np.sin(angle), z], -1)
    points[:, -1] = points[:, 0]
    uv = np.stack(
        np.broadcast_arrays(angle / (2 * np.pi), (run / run[-1])[:, None]), -1
    )
    return _clean(
        Solid(points.reshape(-1, 3), uv.reshape(-1, 2), _quads(len(line), around + 1))
    )


def _clean(solid: Solid) -> Solid:
    """Without triangles that have no area (at a lathe's poles)."""
    a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))
    size = np.max(np.ptp(solid.vertices, axis=0))
    kept = (
        np.stack(
            [np.linalg.norm(p - q, axis=1) for p, q in ((a, b), (b, c), (c, a))]
        ).min(0)
        > 1e-7 * size
    )
    return Solid(solid.vertices, solid.uv, solid.faces[kept])


def hollow(outer: object, wall: float, floor: float) -> np.ndarray:
    """The profile of a vessel from its outer wall (P, 2), bottom to rim: inside `wall` m thinner, its floor `floor` m up."""
    line = np.asarray(outer, float)
    inner = line[::-1].copy()
    inner[:, 0] = np.maximum(inner[:, 0] - wall, 0.0005)
    inner = inner[inner[:, 1] > line[0, 1] + floor + 1e-4]
    rim = np.array([[line[-1, 0] - wall / 2, line[-1, 1] + wall * 0.35]])
    bottom = [
        [
            np.interp(floor + line[0, 1], line[:, 1], line[:, 0]) - wall,
            floor + line[0, 1],
        ]
    ]
    return np.concatenate(
        [[[0, line[0, 1]]], line, rim, inner, bottom, [[0, floor + line[0, 1]]]]
    )


def sweep(
    path: object,
    radius: object,
    flat: object = 1.0,
    around: int = 12,
    up: object = None,
) -> Solid:
    """A tube along `path` (P, 3) with rounded ends; `radius` and its ratio `flat` across may change along it ((P,)).

    `up` (3,) says where the thin side (`radius x flat`) looks; u around, v along.
    """
    line = np.asarray(path, float)
    radius = np.broadcast_to(np.asarray(radius, float), len(line))
    flat = np.broadcast_to(np.asarray(flat, float), len(line))
    along = np.gradient(line, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    hint = np.asarray(up if up is not None else _across(along), float)
    normals = []
    for (
        direction
    ) in along:  # the frame is carried along: each takes the last one's side
        side = hint - (hint @ direction) * direction
        if np.linalg.norm(side) < 1e-3:
            side = np.eye(3)[np.argmin(np.abs(direction))]
            side = side - (side @ direction) * direction
        hint = side / np.linalg.norm(side)
        normals.append(hint)
    side = np.array(normals)
    other = np.cross(along, side)
    cap = np.array([0.0, 0.5, 0.87])
    bulge = radius[0] * flat[0], radius[-1] * flat[-1]
    rows, scale = (
        [line[0] - along[0] * bulge[0] * (1 - c) for c in cap],
        [np.sqrt(1 - (1 - c) ** 2) for c in cap],
    )
    index = [0] * 3 + list(range(len(line))) + [len(line) - 1] * 3
    rows += [*line, *(line[-1] + along[-1] * bulge[1] * (1 - c) for c in cap[::-1])]
    scale += [1.0] * len(line) + scale[::-1]
    scale = np.array(scale) * (np.array(scale) > 1e-6)
    angle = np.linspace(0, 2 * np.pi, around + 1)
    angle[-1] = 0
    size = (radius[index] * scale)[:, None, None]
    wide = other[index][:, None] * np.cos(angle)[None, :, None]
    thin = (
        side[index][:, None] * np.sin(angle)[None, :, None] * flat[index][:, None, None]
    )
    points = np.array(rows)[:, None] + size * (wide + thin)
    points[:, -1] = points[:, 0]
    v = np.linspace(0, 1, len(rows))
    uv = np.stack(
        np.broadcast_arrays(np.linspace(0, 1, around + 1)[None], v[:, None]), -1
    )
    faces = _quads(len(rows), around + 1)
    return outward(_clean(Solid(points.reshape(-1, 3), uv.reshape(-1, 2), faces)))


def _across(along: np.ndarray) -> np.ndarray:
    return np.eye(3)[np.argmin(np.abs(along).max(0))]


def extrude(
    outline: object, thickness: float, edge: float = 0.0, top: object = None
) -> Solid:
    """A flat outline (K, 2) in x and y made `thickness` m thick from z = 0 up, edges bevelled by `edge` m.

    The outline is simple and may be concave. `top` (K, 2) is another outline for the upper face. uv: its box 0..1.
    """
    points = np.asarray(outline, float)
    other = points if top is None else np.asarray(top, float)
    x, y = points.T
    if np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) < 0:
        points, other = points[::-1], other[::-1]
    count = len(points)
    while (
        edge > 1e-5
        and min(len(_cap(_inset(ring, edge))) for ring in (points, other)) < count - 2
    ):
        edge /= 2  # a bevel too wide for the outline crosses itself
    rings = [(points, 0.0), (other, thickness)]
    if edge > 0:
        rings = [
            (_inset(points, edge), 0.0),
            (points, edge),
            (other, thickness - edge),
            (_inset(other, edge), thickness),
        ]
    vertices = np.concatenate(
        [np.column_stack([ring, np.full(count, z)]) for ring, z in rings]
    )
    i = np.arange(count)
    j = (i + 1) % count
    faces = []
    for k in range(len(rings) - 1):
        low, high = k * count, (k + 1) * count
        faces += [
            np.stack([low + i, low + j, high + j], 1),
            np.stack([low + i, high + j, high + i], 1),
        ]
    for ring, first, upwards in (
        (rings[0][0], 0, False),
        (rings[-1][0], (len(rings) - 1) * count, True),
    ):
        cap = _cap(ring)
        faces.append((cap if upwards else cap[:, ::-1]) + first)
    low, span = points.min(0), np.maximum(np.ptp(points, axis=0), 1e-9)
    uv = np.clip((vertices[:, :2] - low) / span, 0, 1)
    return Solid(vertices, uv, np.concatenate(faces))


def _cap(ring: np.ndarray) -> np.ndarray:
    """(F, 3) triangles of an outline (K, 2), counter-clockwise."""
    # a trace of bulge: points on a straight edge would be left out, and the edge open
    away = ring - ring.mean(0)
    far = np.hypot(*away.T)[:, None]
    bulged = ring + 1e-5 * away / np.maximum(far, 1e-12) * (
        far.max() - far**2 / far.max()
    )
    cap = mapbox_earcut.triangulate_float64(
        bulged, np.array([len(ring)], np.uint32)
    ).reshape(-1, 3)
    a, b, c = (bulged[cap[:, k]] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (
        c[:, 0] - a[:, 0]
    )
    return np.where((area > 0)[:, None], cap, cap[:, ::-1]).astype(int)


def _inset(points: np.ndarray, by: float) -> np.ndarray:
    along = np.roll(points, -1, 0) - points
    out = (
        np.stack([along[:, 1], -along[:, 0]], 1)
        / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    )
    before = np.roll(out, 1, 0)
    return (
        points
        - by * (out + before) / np.maximum(1 + np.sum(out * before, 1), 0.4)[:, None]
    )


def box(size: object, edge: float = 0.0015) -> Solid:
    """A box standing on z = 0 in the middle of its frame, edges rounded by `edge` m.

    uv is a net of 3 x 2 cells: the upper row front (-y), right (+x), top; the lower back, left, bottom.
    """
    size = np.asarray(size, float)
    half = size / 2
    edge = min(edge, 0.45 * half.min())
    vertices, uvs, faces, count = [], [], [], 0
    sides = [
        (1, -1, 0, 0),
        (0, 1, 1, 0),
        (2, 1, 2, 0),
        (1, 1, 0, 1),
        (0, -1, 1, 1),
        (2, -1, 2, 1),
    ]
    for axis, side, column, row in sides:
        i, j = [(1, 2), (0, 2), (0, 1)][axis]
        steps = [
            np.array(
                [
                    -half[k],
                    -half[k] + 0.45 * edge,
                    -half[k] + edge,
                    half[k] - edge,
                    half[k] - 0.45 * edge,
                    half[k],
                ]
            )
            for k in (i, j)
        ]
        a, b = np.meshgrid(*steps)
        grid = np.zeros((*a.shape, 3))
        grid[..., i], grid[..., j], grid[..., axis] = a, b, side * half[axis]
        core = np.clip(grid, -(half - edge), half - edge)
        away = grid - core
        grid = (
            core
            + away
            / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-12)
            * edge
        )
        u = a / size[i] + 0.5
        v = b / size[j] + 0.5
        if (axis, side) in ((1, 1), (0, -1)):
            u = 1 - u
        vertices.append(grid.reshape(-1, 3))
        cell = 0.02 + 0.96 * np.stack([u, 1 - v], -1)
        uvs.append(((cell + [column, row]) / [3, 2]).reshape(-1, 2))
        quads = _quads(6, 6)
        mirrored = (axis == 1) == (side > 0)
        faces.append((quads[:, ::-1] if mirrored else quads) + count)
        count += 36
    solid = Solid(
        np.concatenate(vertices) + [0, 0, half[2]],
        np.concatenate(uvs),
        np.concatenate(faces),
    )
    return solid


def ball(radius: object, around: int = 32, rings: int = 17) -> Solid:
    """An ellipsoid about the origin; `radius` m, one or (3,)."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, rings)
    profile = np.stack([np.cos(angle), np.sin(angle)], 1)
    profile[[0, -1], 0] = 0
    return lathe(profile, around).moved(
        scale=np.broadcast_to(np.asarray(radius, float), 3)
    )


def outward(solid: Solid) -> Solid:
    """The same with its triangles facing outwards (volume positive)."""
    return (
        solid
        if volume(solid) >= 0
        else Solid(solid.vertices, solid.uv, solid.faces[:, ::-1])
    )


def volume(solid: Solid) -> float:
    """m³, by the divergence theorem."""
    a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6)


def open_edges(solid: Solid) -> int:
    """How many edges do not belong to as many triangles one way as the other, places 10 µm apart taken as one."""
    grid = np.round(solid.vertices * 1e6 / 10).astype(np.int64)
    _, weld = np.unique(grid, axis=0, return_inverse=True)
    faces = weld.reshape(-1)[solid.faces]
    ways: dict[tuple[int, int], int] = {}
    for a, b in np.concatenate(
        [faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]
    ).tolist():
        if a != b:
            ways[min(a, b), max(a, b)] = ways.get((min(a, b), max(a, b)), 0) + (
                1 if a < b else -1
            )
    return sum(count != 0 for count in ways.values())


def corner_normals(solid: Solid, part: np.ndarray, smooth: float = 42.0) -> np.ndarray:
    """(F, 3, 3) unit normals at every triangle's corners: the mean of neighbours within `smooth` degrees.

    `part` (F,) keeps triangles of different parts from smoothing each other.
    """
    a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    unit = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-20)
    key = np.round(solid.vertices[solid.faces].reshape(-1, 3) * 1e5).astype(np.int64)
    key = (
        (key[:, 0] * 2654435761)
        ^ (key[:, 1] * 40503007)
        ^ (key[:, 2] * 97531)
        ^ (np.repeat(part, 3) << 40)
    )
    _, weld, size = np.unique(key, return_inverse=True, return_counts=True)
    order = np.argsort(weld, kind="stable")
    start = np.concatenate([[0], np.cumsum(size)[:-1]])
    count = size[weld]
    total = np.zeros((len(weld), 3))
    for k in range(
        int(min(size.max(), 48))
    ):  # the k-th neighbour of every corner that has one
        has = np.flatnonzero(count > k)
        face = order[start[weld[has]] + k] // 3
        near = np.einsum("ij,ij->i", unit[face], unit[has // 3]) > np.cos(
            np.radians(smooth)
        )
        total[has] += np.where(near[:, None], cross[face], 0)
    total += 1e-3 * np.repeat(cross, 3, axis=0)
    normals = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-20)
    return normals.reshape(-1, 3, 3)
