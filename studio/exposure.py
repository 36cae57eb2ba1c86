"""Light through the lens: a stage in, pictures in linear light and exact maps out. One loop, the same rays for all.

Mitsuba does the light transport (`path` integrator); here are the view camera's rays, what is asked of their first hit,
and the means over a pixel. A pixel gathers what falls on its square, blurred by a lens of BLUR px.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from optics import T, dr, mi
from stage import Camera, Mesh, Part, Stage

F32 = NDArray[np.float32]
BLUR = 0.3  # px, standard deviation of the lens's own softness
BATCH = 1 << 23  # rays at a time: some 2 GB
STEP_BACK = (
    2e-4  # m: where a ray that passes through the objects starts before the background
)


@dataclass(frozen=True)
class Pose:
    """A rigid motion since t = 0: turned about `start`, which is now at `now`."""

    start: np.ndarray
    """(2,) m, (right, up) in the plane of motion."""
    now: np.ndarray
    """(2,) m."""
    turn: np.ndarray
    """(3, 3) rotation of the world."""


def motion(camera: Camera, pose: Pose) -> T:
    """The pose as a motion of the world."""
    lift = camera.plane if camera.view == "top" else 0.0
    start, now = (np.array([*p, lift]) @ camera.axes for p in (pose.start, pose.now))
    turn = np.eye(4)
    turn[:3, :3] = pose.turn
    return T().translate(list(now)) @ T(turn) @ T().translate(list(-start))


def orient(part: Mesh) -> np.ndarray:
    """Faces wound so that they look where their vertices' normals do."""
    if part.normals is None:
        return part.faces
    a, b, c = (part.vertices[part.faces[:, k]] for k in range(3))
    against = np.sum(np.cross(b - a, c - a) * part.normals[part.faces].mean(1), 1) < 0
    return np.where(against[:, None], part.faces[:, ::-1], part.faces)


class Studio:
    """A stage with its textures and scenery loaded once, to be photographed in many poses."""

    def __init__(self, stage: Stage, camera: Camera | None = None) -> None:
        self.stage, self.camera = stage, camera or stage.camera
        self._surfaces: dict[int, object] = {}
        self._keep: list[dict] = []  # an id is only good while its dictionary lives
        self._fixed = {
            name: self._load(name, part, T())
            for name, part in {**stage.scenery, **stage.lights}.items()
        }
        self.integrator = mi.load_dict(
            {"type": "path", "max_depth": stage.depth, "rr_depth": 5}
        )
        self.second = mi.load_dict(
            {
                "type": "path",
                "max_depth": stage.depth - 1,
                "rr_depth": 5,
                "hide_emitters": True,
            }
        )

    def scene(
        self, poses: dict[str, Pose] | None = None, things: bool = True
    ) -> tuple[object, np.ndarray]:
        """Mitsuba's scene, and a table: registry number of a shape -> 1.. of the thing it belongs to, 0 for scenery."""
        world: dict = {"type": "scene", **self._fixed}
        owner = {}
        for k, thing in enumerate(self.stage.things if things else [], 1):
            place = self.camera.place(thing.at, thing.degrees, thing.depth)
            if poses is not None and thing.name in poses:
                place = motion(self.camera, poses[thing.name]) @ place
            for i, part in enumerate(thing.parts):
                shape = self._load(f"{thing.name}-part-{i}", part, place)
                world[f"{thing.name}-part-{i}"] = shape
                owner[_number(shape)] = k
        lookup = np.zeros(max([0, *owner]) + 1, np.uint32)
        lookup[list(owner)] = list(owner.values())
        return mi.load_dict(world, optimize=False), lookup

    def _load(self, name: str, part: Part, place: T) -> object:
        if isinstance(part, dict):
            if part["type"] in ("envmap", "constant"):
                return mi.load_dict(part)
            local = {**part, "to_world": place @ part.get("to_world", T())}
            if "bsdf" in part:
                local["bsdf"] = self._surface(part["bsdf"])
            return mi.load_dict(local)
        props = mi.Properties()
        props["bsdf"] = self._surface(part.bsdf)
        smooth = part.normals is not None
        shape = mi.Mesh(
            name,
            len(part.vertices),
            len(part.faces),
            has_vertex_normals=smooth,
            has_vertex_texcoords=True,
            props=props,
        )
        matrix = np.array(place.matrix)
        slots = mi.traverse(shape)
        slots["vertex_positions"] = (
            (part.vertices @ matrix[:3, :3].T + matrix[:3, 3])
            .astype(np.float32)
            .ravel()
        )
        if part.normals is not None:
            slots["vertex_normals"] = (
                (part.normals @ matrix[:3, :3].T).astype(np.float32).ravel()
            )
        slots["vertex_texcoords"] = part.uv.astype(np.float32).ravel()
        slots["faces"] = orient(part).astype(np.uint32).ravel()
        slots.update()
        return shape

    def _surface(self, bsdf: dict) -> object:
        if id(bsdf) not in self._surfaces:
            self._keep.append(bsdf)
            self._surfaces[id(bsdf)] = mi.load_dict(bsdf)
        return self._surfaces[id(bsdf)]


def _number(shape: object) -> int:
    return int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0])


def _rays(
    camera: Camera, pixels: object, sampler: object, sharp: bool = False
) -> object:
    """One ray for each pixel number; `sharp` goes through the middle of the lens."""
    width, height = camera.size
    offset = sampler.next_2d() - 0.5
    if not sharp:
        offset += mi.warp.square_to_std_normal(sampler.next_2d()) * BLUR
    right = (
        mi.Float(pixels % width) + offset.x - (width - 1) / 2
    ) / camera.ppm + camera.centre[0]
    up = (
        (height - 1) / 2 - mi.Float(pixels // width) - offset.y
    ) / camera.ppm + camera.centre[1]
    axes = camera.axes

    def world(a: object, b: object, c: object) -> object:
        return mi.Point3f(
            *(
                a * float(axes[0, k]) + b * float(axes[1, k]) + c * float(axes[2, k])
                for k in range(3)
            )
        )

    target = world(right, up, mi.Float(camera.plane))
    eye = mi.Point3f(*map(float, camera.eye))
    if not sharp:
        lens = (
            mi.warp.square_to_uniform_disk_concentric(sampler.next_2d())
            * camera.aperture
        )
        eye = eye + mi.Vector3f(world(lens.x, lens.y, mi.Float(0)))
    return mi.RayDifferential3f(eye, dr.normalize(target - eye))


def _batches(
    pixels: np.ndarray, spp: int, seed: int
) -> Iterator[tuple[object, object, int]]:
    """Pixel number of every ray, a sampler for them, rays a pixel."""
    most = max(1, BATCH // max(len(pixels), 1))
    parts = -(-spp // most)
    seeds = np.random.default_rng(seed).integers(
        2**31, size=parts
    )  # seeds in a row would leave streaks (measured)
    for k in range(parts):
        count = spp * (k + 1) // parts - spp * k // parts
        sampler = mi.load_dict({"type": "independent", "sample_count": count})
        sampler.set_samples_per_wavefront(count)
        sampler.seed(int(seeds[k]), len(pixels) * count)
        yield dr.repeat(mi.UInt32(pixels.astype(np.uint32)), count), sampler, count


def _mean(
    pixels: np.ndarray, spp: int, seed: int, measure: Callable[[object, object], list]
) -> list[F32]:
    """The mean over a pixel's rays of every number that `measure(pixel numbers, sampler)` lists."""
    total: list[NDArray[np.float64]] = []
    for numbers, sampler, count in _batches(pixels, spp, seed):
        values = [mi.Float(value) for value in measure(numbers, sampler)]
        dr.eval(*values)  # all in one pass: each sum alone would trace every path again
        sums = [dr.block_sum(value, count) for value in values]
        dr.eval(*sums)
        arrays = [np.array(s, dtype=np.float64) for s in sums]
        total = [a + b for a, b in zip(total, arrays, strict=True)] if total else arrays
    return [(t / spp).astype(np.float32) for t in total]


def _finite(colour: object) -> object:
    return dr.select(dr.all(dr.isfinite(colour)), colour, 0)


@dataclass(frozen=True)
class Picture:
    """Linear light and what guides a denoiser."""

    light: F32
    """(H, W, 3)."""
    albedo: F32
    """(H, W, 3) through the lens, 1 for what has none of its own (metal, glass, the sky)."""
    normals: F32
    """(H, W, 3) world axes, through the lens."""


def picture(
    studio: Studio,
    scene: object,
    spp: int,
    seed: int = 0,
    only: np.ndarray | None = None,
    behind: object = None,
) -> Picture:
    """The light of `scene` at every pixel, or at those `only` (H, W) bool (the rest is 0).

    With `behind` (the scene without objects), rays pass through the objects and see the background in the light
    that the objects leave it.
    """
    camera, integrator = studio.camera, studio.integrator
    width, height = camera.size
    pixels = np.arange(width * height) if only is None else np.flatnonzero(only)

    def measure(numbers: object, sampler: object) -> list:
        ray = _rays(camera, numbers, sampler)
        hit = (behind or scene).ray_intersect(ray)
        bsdf = hit.bsdf(ray)
        albedo = dr.select(hit.is_valid(), bsdf.eval_diffuse_reflectance(hit), 0)
        bare = dr.max(albedo) < 1e-3
        albedo = dr.select(bare, 1, albedo)
        normal = dr.select(hit.is_valid(), hit.sh_frame.n, 0)
        if behind is not None:
            back = mi.Point3f(
                dr.select(hit.is_valid(), hit.p - ray.d * STEP_BACK, ray.o)
            )
            ray = mi.RayDifferential3f(back, ray.d)
        light, _, _ = integrator.sample(scene, sampler, ray)
        light = _finite(light)
        return [*light, *albedo, *normal]

    found = np.zeros((9, width * height), np.float32)
    if len(pixels):
        found[:, pixels] = _mean(pixels, spp, seed, measure)
    maps = found.reshape(9, height, width).transpose(1, 2, 0)
    return Picture(maps[..., :3], maps[..., 3:6], maps[..., 6:])


@dataclass(frozen=True)
class Maps:
    """What is truly there, per pixel."""

    labels: NDArray[np.uint16]
    """(H, W) the thing that covers most of the pixel, 0 = background."""
    first: F32
    """(H, W) how much of the pixel that thing covers; 0 for the background."""
    second: NDArray[np.uint16]
    """(H, W) the thing that covers the second most, 0 = none."""
    coverage: F32
    """(H, W) how much of the pixel all things cover."""
    depth: F32
    """(H, W) m along the line of sight from the plane of motion, larger = farther; of `labels`' thing."""
    normals: F32
    """(H, W, 3) unit, +x right, +y down, +z to the viewer."""
    albedo: F32
    """(H, W, 3) linear diffuse reflectance; 0 for bare metal and glass."""


def maps(studio: Studio, scene: object, lookup: np.ndarray, rays: int = 64) -> Maps:
    """Coverage through the lens; depth, normals, albedo of what covers most of a pixel, through the lens's middle."""
    camera = studio.camera
    width, height = camera.size
    pixels, count = np.arange(width * height), len(studio.stage.things)
    table = mi.UInt32(lookup)

    def owner(hit: object) -> object:
        number = dr.reinterpret_array(mi.UInt32, hit.shape)
        known = hit.is_valid() & (number < len(lookup))
        return dr.select(
            known, dr.gather(mi.UInt32, table, dr.select(known, number, 0)), 0
        )

    def cover(numbers: object, sampler: object) -> list:
        who = owner(scene.ray_intersect_preliminary(_rays(camera, numbers, sampler)))
        return [dr.select(who == k + 1, 1.0, 0.0) for k in range(count)]

    shares = np.array(_mean(pixels, rays, 1, cover)).reshape(count, height, width)
    everything = shares.sum(0)
    order = np.argsort(np.concatenate([1 - everything[None], shares]), 0, kind="stable")
    labels = order[-1].astype(np.uint16)
    first = np.where(
        labels > 0,
        np.take_along_axis(shares, np.maximum(labels.astype(int) - 1, 0)[None], 0)[0],
        0,
    )
    ranked = np.argsort(shares, 0, kind="stable")
    top = ranked[-1]
    other = np.where(labels > 0, ranked[-2] if count > 1 else top, top)
    share = np.take_along_axis(shares, other[None], 0)[0]
    second = np.where(
        (share > 0) & ((labels == 0) | (other + 1 != labels)), other + 1, 0
    ).astype(np.uint16)
    wanted = mi.UInt32(labels.ravel().astype(np.uint32))
    axes = camera.axes

    def geometry(numbers: object, sampler: object) -> list:
        ray = _rays(camera, numbers, sampler, sharp=True)
        hit = scene.ray_intersect(ray)
        right = dr.gather(mi.UInt32, wanted, numbers) == owner(hit)
        good = right & hit.is_valid()
        away = (mi.Vector3f(*map(float, studio.camera.eye)) - hit.p) @ mi.Vector3f(
            *map(float, axes[2])
        )
        normal = dr.select(
            dr.dot(hit.sh_frame.n, ray.d) > 0, -hit.sh_frame.n, hit.sh_frame.n
        )
        albedo = _diffuse(hit, ray, sampler)
        weight = dr.select(good, 1.0, 0.0)
        numbers_ = [weight, away - camera.distance, *normal, *albedo]
        return [weight, *(dr.select(good, v, 0) for v in numbers_[1:])]

    weight, depth, *rest = _mean(pixels, 16, 2, geometry)
    kept = np.maximum(weight, 1e-6)
    depth = _fill(
        (depth / kept).reshape(height, width), (weight > 0).reshape(height, width)
    )
    values = [
        _fill((v / kept).reshape(height, width), (weight > 0).reshape(height, width))
        for v in rest
    ]
    world = np.stack(values[:3], -1)
    image = world @ axes.T * [1, -1, 1]
    image /= np.maximum(np.linalg.norm(image, axis=-1, keepdims=True), 1e-6)
    return Maps(
        labels,
        first,
        second,
        everything,
        depth,
        image.astype(np.float32),
        np.stack(values[3:], -1),
    )


def _diffuse(hit: object, ray: object, sampler: object) -> object:
    """What comes back diffusely, of white light from everywhere: the pigment as seen through its coat; one sample.

    The BSDF's own diffuse part alone, over cosine-weighted directions; nothing for bare metal and glass.
    """
    only = mi.BSDFContext()
    only.type_mask = int(mi.BSDFFlags.DiffuseReflection)
    local = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
    hit.wi = dr.select(mi.Frame3f.cos_theta(hit.wi) < 0, -hit.wi, hit.wi)
    value = hit.bsdf(ray).eval(only, hit, local)
    return dr.select(
        hit.is_valid(), _finite(value * dr.pi / mi.Frame3f.cos_theta(local)), 0
    )


def _fill(values: F32, known: np.ndarray) -> F32:
    """Pixels that the lens's middle does not see as their coverage says take the nearest known value."""
    import cv2

    if known.all():
        return values
    _, nearest = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    at = np.zeros(nearest.max() + 1, int)
    at[nearest[known]] = np.flatnonzero(known)
    return values.ravel()[at[nearest]]


def shading(studio: Studio, scene: object, spp: int) -> F32:
    """(H, W, 3): the light that a white matt surface would send to the camera from where the picture's surfaces are.

    Found apart from the picture: lights by sampling them, the rest by rays over the hemisphere.
    """
    camera = studio.camera
    width, height = camera.size

    def measure(numbers: object, sampler: object) -> list:
        ray = _rays(camera, numbers, sampler)
        hit = scene.ray_intersect(ray)
        hit.sh_frame = mi.Frame3f(
            dr.select(
                dr.dot(hit.sh_frame.n, ray.d) > 0, -hit.sh_frame.n, hit.sh_frame.n
            )
        )
        return [*irradiance(studio, scene, hit, sampler)]

    found = _mean(np.arange(width * height), spp, 3, measure)
    return np.stack([f.reshape(height, width) for f in found], -1)


def irradiance(studio: Studio, scene: object, hit: object, sampler: object) -> object:
    """Irradiance over pi at surface points: direct light by emitter sampling, the rest by cosine-weighted rays."""
    toward, weight = scene.sample_emitter_direction(
        hit, sampler.next_2d(), True, hit.is_valid()
    )
    direct = weight * dr.maximum(dr.dot(toward.d, hit.sh_frame.n), 0) * dr.inv_pi
    local = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
    onward = mi.RayDifferential3f(hit.spawn_ray(hit.sh_frame.to_world(local)))
    indirect, seen, _ = studio.second.sample(
        scene, sampler, onward, None, hit.is_valid()
    )
    return dr.select(
        hit.is_valid(), _finite(direct) + _finite(dr.select(seen, indirect, 0)), 0
    )
