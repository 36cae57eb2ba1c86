"""Photograph nine ivory dominoes standing on a walnut table, from the side with a long lens; with exact truth.

World axes: metres, +x right, +y away from the camera, +z up; the table top is z = 0. The dominoes show their narrow
side; the lens is focused on it, so the wall and the ends of the table are soft.
"""

from pathlib import Path

import cv2
import numpy as np
from darkroom import T, environment, flags, mesh, photograph, texture
from textures import ivory, plaster, srgb, wood

SIZE = 960, 540
PIXELS_PER_METER = 3125.0  # at the dominoes' front face
BOX = np.array([0.0075, 0.024, 0.048])  # a European domino standing on end: across, depth, height
EDGE = 0.0009  # radius of the rounded edges
COUNT, SPACING, FIRST = 9, 0.0232, -0.1000
PITCH = np.radians(4.6)  # how far the camera looks down
DISTANCE = 4.0  # from the lens to the front faces
AIM = 0.0425  # height on the front faces' plane that the middle of the photo shows
WINDOW = np.array([-1.50, -0.80, 0.85])


def rounded_box() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (V, 3) m, normals (V, 3), faces (F, 3) of a box about the origin whose edges are rounded by EDGE."""
    inner = BOX / 2 - EDGE
    arc = EDGE * np.tan(np.linspace(0, np.pi / 4, 6))
    vertices, normals, faces = [], [], []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        across, up = (np.concatenate([-inner[k] - arc[::-1], inner[k] + arc]) for k in (u, v))
        for side in (1, -1):
            grid = np.zeros((len(up), len(across), 3))
            grid[..., axis], grid[..., u], grid[..., v] = side * BOX[axis] / 2, across[None], up[:, None]
            core = np.clip(grid, -inner, inner)
            normal = (grid - core) / np.linalg.norm(grid - core, axis=-1, keepdims=True)
            first, columns = sum(map(len, vertices)), len(across)
            i = first + (np.arange(len(up) - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
            quads = np.stack([i, i + 1, i + columns + 1, i + columns], 1)[:, ::side]
            faces += [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
            vertices.append((core + EDGE * normal).reshape(-1, 3))
            normals.append(normal.reshape(-1, 3))
    return np.concatenate(vertices), np.concatenate(normals), np.concatenate(faces)


def stand(index: int) -> tuple[np.ndarray, np.ndarray]:
    """(3, 3) turn and (3,) centre of a domino: set up by hand, so a little off the line and a little turned."""
    rng = np.random.default_rng(40 + index)
    yaw = np.radians(rng.normal(0, 0.35))
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    return turn, np.array([FIRST + index * SPACING + rng.normal(0, 0.00025), 0, BOX[2] / 2])


def domino(index: int) -> dict:
    """Ivory, each from another piece of bone."""
    rng = np.random.default_rng(70 + index)
    vertices, normals, faces = rounded_box()
    turn, centre = stand(index)
    uv = np.stack([(vertices[:, 0] + vertices[:, 1]) / 0.05 + 0.5, vertices[:, 2] / 0.05 + 0.5], 1)
    colour = srgb(*(np.array([238, 230, 208]) + rng.normal(0, 3) + rng.normal(0, [0, 0.4, 2.5])))
    bone = {
        "type": "roughplastic",
        "alpha": 0.09,
        "int_ior": 1.54,
        "nonlinear": True,
        "diffuse_reflectance": texture(ivory(512, 512, colour, seed=index)),
    }
    return mesh(vertices @ turn.T + centre, normals @ turn.T, uv, faces, bone)


def room() -> np.ndarray:
    """(128, 256, 3) the rest of the room: a pale ceiling, darker below, what the window sends back."""
    height = np.linspace(1, -1, 128)[:, None, None]
    return (0.26 + 0.16 * height) * np.array([0.98, 0.95, 0.92]) * np.ones((1, 256, 1))


def furniture() -> dict:
    """The table, the wall behind it, the window at the left."""
    board = wood(2048, 3072, srgb(74, 44, 27), srgb(164, 110, 70), seed=5, rings=24, figure=0.02)
    top = {
        "type": "roughplastic",
        "alpha": 0.32,
        "int_ior": 1.4,
        "nonlinear": True,
        "diffuse_reflectance": texture(board, repeat=(3, 1)),
    }
    paint = {"type": "diffuse", "reflectance": texture(plaster(512, 1024, srgb(112, 130, 138), seed=8))}
    aim = T().look_at(origin=list(WINDOW), target=[0, 0, 0.03], up=[0, 0, 1])
    flag = (
        T().translate([-0.62, 0.36, 0.50]).rotate([0, 1, 0], 25).rotate([1, 0, 0], 90).scale([0.25, 0.3, 1])
    )  # keeps window light off part of the wall
    return {
        "table": {
            "type": "cube",
            "to_world": T().translate([0, -0.20, -0.015]).scale([0.9, 0.52, 0.015]),
            "bsdf": top,
        },
        "wall": {
            "type": "rectangle",
            "to_world": T().translate([0, 0.85, 0.2]).rotate([1, 0, 0], 90).scale([2.0, 1.0, 1]),
            "bsdf": paint,
        },
        "flag": {
            "type": "rectangle",
            "to_world": flag,
            "bsdf": {
                "type": "twosided",
                "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.1}},
            },
        },
        "window": {
            "type": "rectangle",
            "to_world": aim @ T().scale([0.36, 0.46, 1]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [29.0, 26.2, 22.4]}},
        },
        "room": environment(room()),
    }


def main() -> None:
    args = flags(__doc__, Path(__file__).parent.parent / "scenes/dominoes/photo.png", 256)
    width, height = (round(side * args.scale) for side in SIZE)
    ppm = PIXELS_PER_METER * width / SIZE[0]
    forward, up = np.array([0, np.cos(PITCH), -np.sin(PITCH)]), np.array([0, np.sin(PITCH), np.cos(PITCH)])
    focus = np.array([0, -BOX[1] / 2, AIM])
    eye = focus - DISTANCE * forward

    def pixel(points: np.ndarray) -> np.ndarray:
        """(..., 3) m -> (..., 2) px."""
        ray = points - eye
        scale = ppm * DISTANCE / (ray @ forward)
        return np.stack([ray[..., 0] * scale + (width - 1) / 2, (height - 1) / 2 - ray @ up * scale], -1)

    def rounded(points: np.ndarray) -> list:
        return np.round(points.astype(float), 3).tolist()

    camera = {
        "type": "thinlens",
        "to_world": T().look_at(origin=list(eye), target=list(focus), up=[0, 0, 1]),
        "near_clip": 0.1,
        "far_clip": 20.0,
    }
    camera |= {
        "fov": float(np.degrees(2 * np.arctan(width / 2 / (ppm * DISTANCE)))),
        "fov_axis": "x",
        "focus_distance": DISTANCE,
        "aperture_radius": 0.024,
    }
    camera["film"] = {
        "type": "hdrfilm",
        "width": width,
        "height": height,
        "rfilter": {"type": "gaussian", "stddev": 0.45},
    }
    world = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 7, "rr_depth": 5},
        "camera": camera,
        **furniture(),
    }
    objects = {f"domino-{k + 1}": domino(k) for k in range(COUNT)}

    entries, shape = [], rounded_box()[0]
    for k, name in enumerate(objects):
        turn, centre = stand(k)
        outline = cv2.convexHull(pixel(shape @ turn.T + centre).astype(np.float32))
        corners = np.array([[-1, -1, 1], [1, -1, 1], [1, -1, -1], [-1, -1, -1]]) * BOX / 2
        entries.append(
            {
                "name": name,
                "polygon": rounded(cv2.approxPolyDP(outline, 0.15, True)[:, 0]),
                "front": rounded(pixel(corners @ turn.T + centre)),
            }
        )
    towards = (WINDOW - [0, 0, 0.024]) / np.linalg.norm(WINDOW - [0, 0, 0.024])
    truth = {
        "view": "side",
        "pixels_per_meter": ppm,
        "camera": f"pinhole of an ideal lens, {DISTANCE} m from the front faces, "
        f"looking down {np.degrees(PITCH):.1f} degrees; scale is at the front faces",
        "floor": round(float(pixel(np.array([0, -BOX[1] / 2, 0]))[1]), 3),
        "floor_behind": round(float(pixel(np.array([0, BOX[1] / 2, 0]))[1]), 3),
        "table_back_edge": round(float(pixel(np.array([0, 0.32, 0]))[1]), 3),
        "light": {
            "direction": [round(float(v), 4) for v in (towards[0], -towards @ up, -towards @ forward)],
            "from": "the row's middle to the window",
        },
        "objects": entries,
    }
    photograph(world, objects, truth, out=args.out, spp=args.spp, exposure=1.3)


if __name__ == "__main__":
    main()
