"""A seed in, a photo with its labels out: Mitsuba traces the paths, one kernel for all pictures.

All things' parts of one finish are one mesh with one texture (an atlas of all prints), so a scene is some twenty shapes
of always the same kinds, and Dr.Jit compiles nothing anew. Labels, normals and shadows come from rays of our own.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from studio.darkroom import denoise
from studio.optics import T, dr, mi
from studio.segmentation.homes.composition import Camera, Shot, shot
from studio.segmentation.homes.development import finish
from studio.segmentation.homes.furniture import Light
from studio.segmentation.homes.parts import FINISHES, Part
from studio.segmentation.homes.solids import Solid, corner_normals, join

DEPTH = 4  # bounces
CLEARLY = 0.5  # share of a pixel that a thing must cover
LIGHTS = 3  # always as many: one kernel for all pictures
RR = 3  # bounces after which dim paths end by chance
LEAST = 12  # px of a thing: what is smaller is no object, its pixels are unsaid
UNSAID = 65535


@dataclass(frozen=True)
class Photo:
    """A photo and what is true of it."""

    rgb: NDArray[np.uint8]
    """(H, W, 3) sRGB."""
    labels: NDArray[np.uint16]
    """(H, W): 0 nothing, 1..N things, 65535 unsaid."""
    normals: NDArray[np.float32]
    """(H, W, 3) unit, +x right, +y down, +z to the viewer; 0 where nothing was hit."""
    shadow: NDArray[np.float32]
    """(H, W) 0..1: share of the direct light that things keep from the scenery behind them."""
    truncated: list[int]
    """Labels that the photo's border cuts."""
    kinds: list[str]
    """What labels 1..N are."""


def surface(name: str, print_: dict) -> dict:
    """A finish as a Mitsuba BSDF with a texture."""
    if name == "matt":
        inner = {"type": "diffuse", "reflectance": print_}
    elif name in ("satin", "glossy"):
        alpha = 0.3 if name == "satin" else 0.06
        inner = {
            "type": "roughplastic",
            "alpha": alpha,
            "diffuse_reflectance": print_,
            "nonlinear": True,
        }
    elif name == "glass":
        return {"type": "thindielectric", "specular_transmittance": print_}
    else:
        alpha = {"steel": 0.1, "brushed": 0.3, "mirror": 0.02}[name]
        inner = {
            "type": "roughconductor",
            "material": "none",
            "alpha": alpha,
            "specular_reflectance": print_,
        }
    return {"type": "twosided", "bsdf": inner}


def bitmap(image: np.ndarray) -> dict:
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(image, np.float32)),
        "raw": True,
    }


def mesh(
    name: str, solid: Solid, bsdf: dict, part: np.ndarray, emitter: object = None
) -> object:
    """A Mitsuba mesh, its triangles' corners each a vertex."""
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(bsdf)
    if emitter is not None:
        props["emitter"] = mi.load_dict(emitter)
    count = len(solid.faces)
    shape = mi.Mesh(
        name,
        3 * count,
        count,
        has_vertex_normals=True,
        has_vertex_texcoords=True,
        props=props,
    )
    slots = mi.traverse(shape)
    slots["vertex_positions"] = solid.vertices[solid.faces].astype(np.float32).ravel()
    slots["vertex_normals"] = corner_normals(solid, part).astype(np.float32).ravel()
    slots["vertex_texcoords"] = solid.uv[solid.faces].astype(np.float32).ravel()
    slots["faces"] = np.arange(3 * count, dtype=np.uint32)
    slots.update()
    return shape


def atlas(parts: list[Part]) -> tuple[np.ndarray, list[Solid]]:
    """All prints on one sheet, and the solids with their uv in it; prints are told apart by identity."""
    unique = {id(p.print): p.print for p in parts}
    cells, x, y, row, width = {}, 0, 0, 0, 768
    for key, image in sorted(unique.items(), key=lambda item: -item[1].shape[0]):
        h, w = image.shape[:2]
        if x + w > width:
            x, y, row = 0, y + row, 0
        cells[key] = (x, y)
        x, row = x + w, max(row, h)
    sheet = np.zeros((y + row, width, 3), np.float32)
    for key, (left, top) in cells.items():
        image = unique[key]
        sheet[top : top + image.shape[0], left : left + image.shape[1]] = image
    solids = []
    for p in parts:
        (left, top), (h, w) = cells[id(p.print)], p.print.shape[:2]
        uv = np.clip(p.solid.uv, 0, 1) * [w - 1, h - 1] + [left + 0.5, top + 0.5]
        solids.append(
            Solid(p.solid.vertices, uv / [width, sheet.shape[0]], p.solid.faces)
        )
    return sheet, solids


def emitter(light: Light) -> dict:
    aim = T().look_at(
        origin=list(map(float, light.at)),
        target=list(map(float, light.target)),
        up=[0.01, 0.02, 1],
    )
    return {
        "type": "rectangle",
        "to_world": aim @ T().scale([light.size[0] / 2, light.size[1] / 2, 1]),
        "emitter": {
            "type": "area",
            "radiance": {
                "type": "rgb",
                "value": np.asarray(light.radiance, float).tolist(),
            },
        },
    }


def unbuilt(light: object) -> object:
    """The same light, its numbers read by the kernel, not built into it."""
    slots = mi.traverse(light)
    for key in slots.keys():  # noqa: SIM118
        if key.endswith(("value", "to_world")):
            value = slots[key]
            dr.make_opaque(value)
            slots[key] = value
    slots.update()
    return light


class Scene:
    """A shot in Mitsuba: with its things, and (`empty`) without."""

    def __init__(self, taken: Shot) -> None:
        fixed: dict = {"type": "scene"}
        spare = Part(
            Solid(
                np.array([[0, 0, -50.0], [1, 0, -50], [0, 1, -50]]),
                np.zeros((3, 2)),
                np.array([[0, 1, 2]]),
            ),
            "matt",
            np.ones((2, 2, 3), np.float32),
        )
        scenery = [
            *taken.room.scenery,
            *[spare] * (-len(taken.room.scenery) % 12),
        ]  # few counts of shapes, few kernels
        for k, part in enumerate(scenery):
            number = np.zeros(len(part.solid.faces), int)
            fixed[f"set-{k}"] = mesh(
                f"set-{k}", part.solid, surface(part.finish, bitmap(part.print)), number
            )
        spare_lights = [
            Light((0, 0, -60 - k), (0, 0, -70), (1, 1), np.full(3, 1e-3))
            for k in range(LIGHTS)
        ]
        for k, light in enumerate([*taken.room.lights, *spare_lights][:LIGHTS]):
            fixed[f"light-{k}"] = unbuilt(mi.load_dict(emitter(light)))
        glow = {
            "type": "constant",
            "radiance": {"type": "rgb", "value": taken.room.ambient.tolist()},
        }
        fixed["ambient"] = unbuilt(mi.load_dict(glow))
        world, owners = dict(fixed), {}
        for name in FINISHES:
            pairs = [
                (k, p)
                for k, thing in enumerate(taken.placed, 1)
                for p in thing.parts
                if p.finish == name
            ]
            pairs = pairs or [
                (0, spare)
            ]  # every kind of surface in every scene: one kernel for all
            sheet, solids = atlas([p for _, p in pairs])
            sizes = [len(s.faces) for s in solids]
            shape = mesh(
                name,
                join(solids),
                surface(name, bitmap(sheet)),
                np.repeat(np.arange(len(pairs)), sizes),
            )
            world[f"things-{name}"] = shape
            owners[number_of(shape)] = np.repeat([k for k, _ in pairs], sizes)
        self.full = mi.load_dict(world, optimize=False)
        self.empty = mi.load_dict(fixed, optimize=False)
        start = np.zeros(max(owners) + 1, np.int64)
        table, self.known = [np.zeros(1)], np.zeros(max(owners) + 1, bool)
        for shape_number, owner in owners.items():
            start[shape_number], self.known[shape_number] = sum(map(len, table)), True
            table.append(owner)
        self.start, self.table = start, np.concatenate(table).astype(np.int64)

    def owner(self, shape: np.ndarray, triangle: np.ndarray) -> np.ndarray:
        """(N,) 1.. of the thing that a ray hit, 0 for the room; by registry number and triangle."""
        ours = shape < len(self.known)
        ours &= self.known[np.where(ours, shape, 0)]
        return np.where(
            ours,
            self.table[
                np.where(ours, self.start[np.where(ours, shape, 0)] + triangle, 0)
            ],
            0,
        )


def number_of(shape: object) -> int:
    return int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0])


def rays(camera: Camera, side: int) -> object:
    """side x side sharp rays on a grid in every pixel; those of one pixel follow each other."""
    width, height = camera.size
    n = dr.arange(mi.UInt32, width * height * side * side)
    pixel, sub, wide = (
        n // (side * side),
        n % (side * side),
        dr.opaque(mi.UInt32, width),
    )
    x = mi.Float(pixel % wide) + (mi.Float(sub % side) + 0.5) / side
    y = mi.Float(pixel // wide) + (mi.Float(sub // side) + 0.5) / side
    return towards(camera, x, y, mi.Point3f(*opaque(camera.eye)))


def opaque(values: object) -> list:
    """Numbers that the kernel reads instead of having them built in: it stays the same for every camera."""
    return [dr.opaque(mi.Float, float(v)) for v in np.asarray(values).ravel()]


def towards(camera: Camera, x: object, y: object, start: object) -> object:
    """Rays from points on the lens to where those of pixels (x, y) through its middle are in focus."""
    width, height = camera.size
    far = np.linalg.norm(camera.target - camera.eye)
    right, down = camera.axes[:2] * far * np.array(camera.slopes)[:, None]
    middle, right, down = (
        opaque(v)
        for v in (camera.target - right - down, right * 2 / width, down * 2 / height)
    )
    focus = [middle[k] + x * right[k] + y * down[k] for k in range(3)]
    return mi.RayDifferential3f(start, dr.normalize(mi.Point3f(*focus) - start))


def trace(
    scene: Scene, camera: Camera, samples: int, depth: int, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Light, albedo, world normals, each (H, W, 3), the means of `samples` rays a pixel through the lens."""
    width, height = camera.size
    integrator = mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": RR})
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(dr.opaque(mi.UInt32, seed), width * height * samples)
    n = dr.arange(mi.UInt32, width * height * samples) // samples
    offset = sampler.next_2d()
    lens = mi.warp.square_to_uniform_disk_concentric(sampler.next_2d())
    eye, right, down = (
        opaque(v) for v in (camera.eye, *(camera.axes[:2] * camera.aperture))
    )
    start = mi.Point3f(
        *(eye[k] + lens.x * right[k] + lens.y * down[k] for k in range(3))
    )
    wide = dr.opaque(mi.UInt32, width)
    ray = towards(
        camera, mi.Float(n % wide) + offset.x, mi.Float(n // wide) + offset.y, start
    )
    hit = scene.full.ray_intersect(ray)
    albedo = dr.select(hit.is_valid(), hit.bsdf(ray).eval_diffuse_reflectance(hit), 0)
    albedo = dr.select(dr.max(albedo) < 1e-3, 1, albedo)  # metal and glass have none
    normal = dr.select(hit.is_valid(), hit.sh_frame.n, 0)
    light, _, _ = integrator.sample(scene.full, sampler, ray)
    values = [mi.Float(v) for v in (*light, *albedo, *normal)]
    dr.eval(*values)
    found = np.stack(
        [np.nan_to_num(np.array(v)).reshape(height, width, samples) for v in values]
    )
    top = (
        20 * np.percentile(found[:3].mean((0, 3)), 95) + 1e-3
    )  # a path that finds a lamp by chance leaves no spark
    found[:3] = np.minimum(found[:3], top)
    return tuple(
        np.moveaxis(found.mean(-1).reshape(3, 3, height, width), 1, -1).astype(
            np.float32
        )
    )  # type: ignore[return-value]


def truth(
    scene: Scene, camera: Camera, side: int, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Labels (H, W) and normals (H, W, 3) in the camera's frame."""
    width, height = camera.size
    hit = scene.full.ray_intersect(rays(camera, side))
    number = dr.reinterpret_array(mi.UInt32, hit.shape)
    values = [number, hit.prim_index, hit.is_valid(), *hit.sh_frame.n]
    dr.eval(*values)
    shape, triangle, valid, *normal = (np.array(v) for v in values)
    owner = np.where(
        valid, scene.owner(shape.astype(np.int64), triangle.astype(np.int64)), 0
    )
    owner = owner.reshape(height * width, side * side)
    share = np.stack([(owner == k).mean(1) for k in range(count + 1)], 1)
    labels = share.argmax(1)
    labels[(share.max(1) < CLEARLY) & (share[:, 0] < CLEARLY)] = UNSAID
    world = np.stack(normal, -1).astype(float) @ camera.axes.T * [1, 1, -1]
    world = np.where(valid[:, None] & np.isfinite(world), world, 0)
    world *= np.where(world[:, 2:] < 0, -1, 1)
    world = world.reshape(height * width, side * side, 3)
    mine = (owner == np.where(labels == UNSAID, owner[:, 0], labels)[:, None])[
        ..., None
    ]
    mean = (world * mine).sum(1)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-6)
    return labels.reshape(height, width).astype(np.uint16), mean.reshape(
        height, width, 3
    ).astype(np.float32)


def shadows(scene: Scene, camera: Camera, side: int) -> np.ndarray:
    """(H, W) share of the lamps' and windows' direct light that things keep from the empty room's surfaces."""
    width, height = camera.size
    hit = scene.empty.ray_intersect(rays(camera, side))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(dr.opaque(mi.UInt32, 1), width * height * side * side)
    toward, weight = scene.empty.sample_emitter_direction(
        hit, sampler.next_2d(), True, hit.is_valid()
    )
    facing = dr.maximum(dr.abs(dr.dot(toward.d, hit.sh_frame.n)), 0)
    light = dr.select(hit.is_valid(), dr.mean(weight) * facing, 0)
    light = dr.select(dr.isfinite(light), light, 0)
    kept = dr.select(
        scene.full.ray_test(hit.spawn_ray_to(toward.p)) & (light > 0), light, 0
    )
    dr.eval(light, kept)
    light, kept = (
        np.array(v).reshape(height, width, -1).mean(-1) for v in (light, kept)
    )
    soft = [cv2.GaussianBlur(v.astype(np.float32), (0, 0), 1.2) for v in (kept, light)]
    return np.clip(soft[0] / np.maximum(soft[1], 1e-6), 0, 1)


def photograph(seed: int, size: int = 256, samples: int = 16) -> Photo:
    """One picture; the longer side is `size` px, `samples` rays a pixel before the denoiser."""
    taken = shot(seed, size)
    scene, camera = Scene(taken), taken.camera
    side = 3
    light, albedo, guide = trace(scene, camera, samples, DEPTH, seed)
    rgb = finish(denoise(light, albedo, guide), np.random.default_rng([seed, 5]))
    labels, normals = truth(scene, camera, side, len(taken.placed))
    labels, kinds = tidy(labels, [p.kind for p in taken.placed])
    edge = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    cut = sorted({int(k) for k in np.unique(edge)} - {0, UNSAID})
    return Photo(rgb, labels, normals, shadows(scene, camera, side), cut, kinds)


def tidy(labels: np.ndarray, kinds: list[str]) -> tuple[NDArray[np.uint16], list[str]]:
    """Labels counted from 1 without gaps; of things with fewer than LEAST px the pixels are unsaid."""
    table, kept = np.zeros(UNSAID + 1, np.uint16), []
    table[UNSAID] = UNSAID
    for k, pixels in zip(*np.unique(labels, return_counts=True), strict=True):
        if k in (0, UNSAID):
            continue
        table[k] = UNSAID
        if pixels >= LEAST:
            kept.append(kinds[k - 1])
            table[k] = len(kept)
    return table[labels], kept
