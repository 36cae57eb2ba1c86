"""Bodies as meshes: sizes in metres in, `Mesh` in the body's own frame out. Axes: +x right, +y away, +z up."""

import mapbox_earcut
import numpy as np
from optics import T
from stage import Mesh

# --- boxes -----------------------------------------------------------------------------------------------------------


def rounded_box(
    size: tuple[float, float, float],
    bsdf: dict,
    edge: float = 0.001,
    texel: float = 0.1,
    shift: tuple[float, float] = (0, 0),
    grain: str = "x",
) -> Mesh:
    """A box about the origin with rounded edges; `texel` m of surface is one repeat of the texture, cut at `shift`.

    Each face is mapped with the texture's u along `grain` (x, y or z; a face across the grain takes the next axis).
    """
    half = np.array(size) / 2
    inner = half - edge
    arc = edge * np.tan(np.linspace(0, np.pi / 4, 5))
    vertices, normals, uvs, faces = [], [], [], []
    prefer = ["xyz".index(grain), *(k for k in (0, 2, 1) if k != "xyz".index(grain))]
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        across, up = (
            np.concatenate([-inner[k] - arc[::-1], inner[k] + arc]) for k in (u, v)
        )
        along = [k for k in prefer if k != axis]
        for side in (1, -1):
            grid = np.zeros((len(up), len(across), 3))
            grid[..., axis], grid[..., u], grid[..., v] = (
                side * half[axis],
                across[None],
                up[:, None],
            )
            core = np.clip(grid, -inner, inner)
            normal = (grid - core) / np.linalg.norm(grid - core, axis=-1, keepdims=True)
            first, columns = sum(map(len, vertices)), len(across)
            i = (
                first
                + (
                    np.arange(len(up) - 1)[:, None] * columns + np.arange(columns - 1)
                ).ravel()
            )
            quads = np.stack([i, i + 1, i + columns + 1, i + columns], 1)[:, ::side]
            faces += [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
            spot = (core + edge * normal).reshape(-1, 3)
            vertices.append(spot)
            normals.append(normal.reshape(-1, 3))
            face_shift = np.add(shift, [0.37 * axis, 0.21 * axis + 0.13 * side])
            uvs.append(spot[:, along] / texel + face_shift)
    return Mesh(
        np.concatenate(vertices),
        np.concatenate(normals),
        np.concatenate(uvs),
        np.concatenate(faces),
        bsdf,
    )


# --- bodies of revolution --------------------------------------------------------------------------------------------


def lathe(
    profile: object, bsdf: dict, axis: str = "z", around: int = 96, smooth: float = 40.0
) -> Mesh:
    """A body of revolution: profile (P, 2) of radius and height along `axis`, its outside on the right as it is listed
    (from the bottom to the top for the outer side). Corners sharper than `smooth` degrees stay sharp.

    Texture: u once around, v along the profile's length from 0 to 1.
    """
    points = np.asarray(profile, float)
    step = np.diff(points, axis=0)
    length = np.concatenate([[0], np.cumsum(np.hypot(*step.T))])
    outward = (
        np.stack([step[:, 1], -step[:, 0]], 1)
        / np.maximum(np.hypot(*step.T), 1e-12)[:, None]
    )
    rows, turns = [], []  # a sharp corner gets two rings of vertices
    for k in range(len(step)):
        for end in (k, k + 1):
            beside = outward[
                k - 1
                if end == k and k
                else min(k + 1, len(step) - 1)
                if end == k + 1
                else k
            ]
            soft = outward[k] @ beside > np.cos(np.radians(smooth))
            normal = outward[k] + beside if soft else outward[k]
            rows.append((*points[end], length[end] / length[-1]))
            turns.append(normal / np.linalg.norm(normal))
    rows_, turns_ = np.array(rows), np.array(turns)
    angle = np.linspace(0, 2 * np.pi, around + 1)
    circle = np.stack([np.cos(angle), np.sin(angle)], -1)
    vertices = np.concatenate(
        [
            rows_[:, None, :1] * circle[None],
            np.broadcast_to(rows_[:, None, 1:2], (len(rows_), around + 1, 1)),
        ],
        -1,
    )
    normals = np.concatenate(
        [
            turns_[:, None, :1] * circle[None],
            np.broadcast_to(turns_[:, None, 1:2], (len(rows_), around + 1, 1)),
        ],
        -1,
    )
    uv = np.stack(
        np.broadcast_arrays(np.linspace(0, 1, around + 1)[None], rows_[:, 2:]),
        -1,
    )
    i = (
        np.arange(0, len(rows_), 2)[:, None] * (around + 1) + np.arange(around)
    ).ravel()
    j = i + around + 1
    faces = np.concatenate([np.stack([i, i + 1, j + 1], 1), np.stack([i, j + 1, j], 1)])
    turn = {
        "z": np.eye(3),
        "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
        "x": np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    }[axis]
    return Mesh(
        vertices.reshape(-1, 3) @ turn.T,
        normals.reshape(-1, 3) @ turn.T,
        uv.reshape(-1, 2).copy(),
        faces,
        bsdf,
    )


def ring(
    radius: float, tube: float, bsdf: dict, axis: str = "y", around: int = 96
) -> Mesh:
    """A torus: `radius` to the middle of the tube."""
    angle = np.linspace(-np.pi, np.pi, 33)
    return lathe(
        np.stack([radius + tube * np.cos(angle), tube * np.sin(angle)], 1),
        bsdf,
        axis,
        around,
        90,
    )


# --- extrusions ------------------------------------------------------------------------------------------------------


def extrude(
    outline: object,
    depth: float,
    bsdf: dict,
    edge: float = 0.001,
    texel: float = 0.1,
    shift: tuple[float, float] = (0, 0),
    smooth: float = 35.0,
) -> Mesh:
    """A flat outline (K, 2) of (x, up), given a thickness of `depth` along y about y = 0, its edges bevelled round.

    The outline is simple, may be concave; corners sharper than `smooth` degrees stay sharp. The bevel lies inside.
    """
    points = np.asarray(outline, float)
    area = np.sum(
        points[:, 0] * np.roll(points[:, 1], -1)
        - np.roll(points[:, 0], -1) * points[:, 1]
    )
    if area < 0:
        points = points[::-1]
    along = np.roll(points, -1, 0) - points
    length = np.hypot(*along.T)
    out = (
        np.stack([along[:, 1], -along[:, 0]], 1) / length[:, None]
    )  # of the edge that leaves each point
    before = np.roll(out, 1, 0)
    mitre = (out + before) / np.maximum(1 + np.sum(out * before, 1), 0.15)[:, None]
    soft = np.sum(out * before, 1) > np.cos(np.radians(smooth))
    bend = np.linspace(0, np.pi / 2, 5)
    steps = [
        (edge * (1 - np.sin(a)), -depth / 2 + edge * (1 - np.cos(a)), a) for a in bend
    ]  # front face to side
    steps += [(i, -y, np.pi - a) for i, y, a in reversed(steps)]
    vertices, normals, uvs, faces, count = [], [], [], [], 0
    run = np.concatenate([[0], np.cumsum(length)])
    for k in range(len(points)):
        a, b = k, (k + 1) % len(points)
        normal_a = out[k] + before[k] if soft[k] else out[k]
        normal_b = out[k] + out[b] if soft[b] else out[k]
        for inset, y, lean in steps:
            for point, normal, s in ((a, normal_a, run[k]), (b, normal_b, run[k + 1])):
                flat = points[point] - inset * mitre[point]
                n = normal / np.linalg.norm(normal) * np.sin(lean)
                vertices.append([flat[0], y, flat[1]])
                normals.append([n[0], -np.cos(lean), n[1]])
                uvs.append([s / texel + shift[0], y / texel + shift[1]])
        i = count + 2 * np.arange(len(steps) - 1)
        faces += [np.stack([i, i + 1, i + 3], 1), np.stack([i, i + 3, i + 2], 1)]
        count += 2 * len(steps)
    inner = points - edge * mitre
    caps = mapbox_earcut.triangulate_float64(
        inner, np.array([len(inner)], np.uint32)
    ).reshape(-1, 3)
    for side in (-1, 1):
        vertices += [[a, side * depth / 2, b] for a, b in inner]
        normals += [[0, side, 0]] * len(inner)
        uvs += [[a / texel + shift[0], b / texel + shift[1]] for a, b in inner]
        faces.append(_turned(caps, inner, side) + count)
        count += len(inner)
    return Mesh(
        np.array(vertices),
        np.array(normals),
        np.array(uvs),
        np.concatenate(faces),
        bsdf,
    )


def _turned(caps: np.ndarray, points: np.ndarray, side: int) -> np.ndarray:
    """Triangles wound so that they face along y on `side`."""
    a, b, c = (points[caps[:, k]] for k in range(3))
    cross = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (
        c[:, 0] - a[:, 0]
    )
    flip = (cross > 0) == (
        side > 0
    )  # x, z seen from the front (-y) turns the other way from behind
    return np.where(flip[:, None], caps[:, ::-1], caps)


# --- simple ones -----------------------------------------------------------------------------------------------------


def sphere(
    radius: float,
    bsdf: dict,
    turn: T | None = None,
    at: tuple[float, float, float] = (0, 0, 0),
) -> dict:
    """`turn` (a rotation) sets how its texture lies."""
    return {
        "type": "sphere",
        "to_world": T().translate(list(at)) @ (turn or T()) @ T().scale(radius),
        "bsdf": bsdf,
    }


def floor(
    width: float, depth: float, bsdf: dict, at: tuple[float, float, float] = (0, 0, 0)
) -> dict:
    """A horizontal rectangle about `at`, facing up."""
    return {
        "type": "rectangle",
        "to_world": T().translate(list(at)).scale([width / 2, depth / 2, 1]),
        "bsdf": bsdf,
    }


def wall(
    width: float, height: float, bsdf: dict, at: tuple[float, float, float] = (0, 0, 0)
) -> dict:
    """An upright rectangle about `at`, facing the side view's camera."""
    turn = (
        T().translate(list(at)).rotate([1, 0, 0], 90).scale([width / 2, height / 2, 1])
    )
    return {"type": "rectangle", "to_world": turn, "bsdf": bsdf}


def rod(start: object, end: object, radius: float, bsdf: dict) -> dict:
    """A round bar or a thread."""
    return {
        "type": "cylinder",
        "p0": list(map(float, start)),
        "p1": list(map(float, end)),
        "radius": radius,
        "bsdf": {"type": "twosided", "bsdf": bsdf},
    }


def moved(part: Mesh | dict, to_world: T) -> Mesh | dict:
    """The same part, its frame taken to another by `to_world`: a rigid motion, or a scale the same all round."""
    if isinstance(part, dict):
        return {**part, "to_world": to_world @ part.get("to_world", T())}
    matrix = np.array(to_world.matrix)
    normals = None
    if part.normals is not None:
        normals = part.normals @ matrix[:3, :3].T
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(
        part.vertices @ matrix[:3, :3].T + matrix[:3, 3],
        normals,
        part.uv,
        part.faces,
        part.bsdf,
    )
