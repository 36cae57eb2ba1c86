"""Import of a scene folder of the paper's public code. original.png, mask.png and
sim.yaml are required; inpaint.png, normal.npy, shading.npy and depth.npy are optional.

The meaning of the numbers was measured by running that code: `init_acc` is a change of
velocity, coefficients of two surfaces multiply, walls have friction 1 and elasticity 0
by default, and balls have the moment of inertia of discs.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jsonschema import Draft202012Validator, ValidationError
from numpy.typing import NDArray

from physgen import registry
from physgen.files import resource
from physgen.geometry.circles import fit_circle
from physgen.geometry.fitting import fit_outlines, long_border, without_specks
from physgen.geometry.polygon import Disc, Outline, mass_properties
from physgen.geometry.regions import fit_regions
from physgen.maps import F32, Percepts, read_labels
from physgen.messages import Message, did_you_mean
from physgen.perceive.document import MOTION_BLUR, provenance
from physgen.perceive.inpaint.poisson import fill_behind, seamless
from physgen.perceive.naming import object_names
from physgen.perceive.roles import (
    BoundaryGuess,
    Intrinsics,
    LightGuess,
    PerceivedScene,
    PhotoObject,
    Rgb,
    Shadows,
    Wall,
)
from physgen.perceive.shadow.refills import refill_background
from physgen.perceive.shape_entries import light_entry, shape_entry, view_entry
from physgen.photometry import decode as linear_light
from physgen.photometry import fit_light
from physgen.photos import read_image
from physgen.problems import InputError, Place, Problem, Severity
from physgen.progress import Progress, silent
from physgen.scene.document import Node, Source, children, decode, read, to_plain_data
from physgen.scene.scene import View
from physgen.scene.schema import Schema, expand
from physgen.text import dotted, nearest, shown

Vector = tuple[float, float]
NEEDED = ("original.png", "mask.png", "sim.yaml")
STEP = 1 / 60
"""s: time step of that code's simulation."""
POLYGON_ORIGIN = (0, 0)
"""px: place of a polygon's body in that code, at which `init_acc` acts."""
LEAST_SPREAD = 0.06
"""Least spread of normals that determine a light; the flat fronts of blocks do not."""


@cache
def _schema() -> Schema:
    """Return the schema of sim.yaml with that code's defaults."""
    return expand(
        json.loads(
            resource("schemas", "physgen-sim.schema.json").read_text(encoding="utf-8")
        )
    )


@dataclass(frozen=True)
class Body:
    """One entry of `obj_info`."""

    label: str
    # "circle", or "polygon" for the polygon of its mask.
    primitive: str
    # g, for circles.
    mass: float
    # g/px², for polygons.
    density: float
    friction: float
    elasticity: float
    place: Place
    # px/s.
    velocity: Vector | None
    # `init_acc`, a change of velocity, px/s.
    push: Vector | None

    @property
    def circle(self) -> bool:
        """Return whether the body is a circle."""
        return self.primitive == "circle"


@dataclass(frozen=True)
class Sim:
    """The content of sim.yaml, with that code's defaults."""

    # px/s² down; 0 if seen from above.
    gravity: float
    # Steps of 1/60 s.
    num_steps: float
    animation_frames: float
    ground_friction: float
    ground_elasticity: float
    denoise_strength: float | None
    # Bodies by id in mask.png.
    bodies: dict[int, Body]
    # px.
    edges: list[tuple[Vector, Vector]]
    warnings: tuple[Problem, ...]

    @property
    def duration(self) -> float:
        """Return the duration, s."""
        return int(self.num_steps) * STEP

    @property
    def frames(self) -> int:
        """Return the number of frames of the video."""
        return int(self.animation_frames)


def import_physgen(
    folder: Path,
    *,
    image: str = "photo.png",
    assets: str = "photo.assets",
    progress: Progress = silent,
) -> PerceivedScene:
    """Return the scene of a folder; `image` and `assets` are names in the document.

    Raises InputError with every missing or invalid file and every invalid line of
    sim.yaml.
    """
    _check_folder(folder)
    progress("read", 0, 4)
    sim = read_sim(folder / "sim.yaml")
    rgb = read_image(folder / "original.png")
    labels = _read_labels(folder / "mask.png", rgb, sim)
    progress("outline", 1, 4)
    outlines = outlines_by_kind(
        labels, {i: body.circle for i, body in sim.bodies.items()}
    )
    objects = []
    for i, body in sim.bodies.items():
        objects.append(PhotoObject(i, outlines[i], body.label))
    progress("inpaint", 2, 4)
    coverage = registry.make("matte")(rgb, labels)
    background = _read_background(folder / "inpaint.png", rgb, coverage > 0)
    progress("maps", 3, 4)
    normals, shading, depth = _read_maps(folder, rgb)
    percepts = Percepts(
        rgb=rgb,
        labels=labels,
        coverage=coverage,
        background=background,
        depth=depth,
        normals=normals,
        albedo=_divide_shading(rgb, shading),
        shading=shading,
    )
    document = _document(sim, objects, image, assets)
    light = _fitted_light(normals, shading, labels)
    if light is not None:
        document["light"] = light
    percepts = _add_shadows(document, percepts, objects, sim)
    _add_video(document, sim)
    return PerceivedScene(percepts, document, _comments(sim, folder), sim.warnings)


def _divide_shading(rgb: Rgb, shading: F32 | None) -> F32 | None:
    """Return the albedo (H, W, 3), or None without shading."""
    if shading is None:
        return None
    albedo = linear_light(rgb) / np.maximum(shading, 1e-3)[:, :, None]
    return np.clip(albedo, 0, 1).astype(np.float32)


def _add_shadows(
    document: dict[str, Any],
    percepts: Percepts,
    objects: list[PhotoObject],
    sim: Sim,
) -> Percepts:
    """Add the light of the photo's shadows to a document.

    Returns the percepts with the background without shadows.
    """
    shadows = _find_shadows(percepts, objects, sim)
    clean_background = shadows.clean_background
    if clean_background is None:
        return percepts
    background = percepts.background
    coverage = percepts.coverage
    assert background is not None
    assert coverage is not None
    if not shadows.is_faint_shadow:
        clean_background = refill_background(
            clean_background,
            background,
            coverage,
            registry.make("inpaint"),
            percepts.labels if sim.gravity else None,
        )
    document["light"] = light_entry(shadows.light) | {
        "softness": shadows.softness,
        "from": provenance("shadows", shadows.confidence),
    }
    document["world"] |= view_entry(shadows, bool(sim.gravity))
    return replace(percepts, clean=clean_background)


def _add_video(document: dict[str, Any], sim: Sim) -> None:
    """Add the settings of the video and of its refinement to a document."""
    document["render"] = {
        "fps": max(1, round(sim.frames / sim.duration, 3)),
        "frames": sim.frames,
        "motion_blur": MOTION_BLUR,
    }
    if sim.denoise_strength is not None:
        document["refine"] = {"strength": sim.denoise_strength}


def outlines_by_kind(
    labels: NDArray[np.uint16], circle: Mapping[int, bool]
) -> dict[int, Outline]:
    """Return outlines by id of `labels` (H, W): circles if `circle` is true, else
    polygons.

    Neighbours are fitted together if their kind is the one that the fit would choose.
    """
    outlines: dict[int, Outline] = dict(fit_outlines(labels, list(circle)))
    for i, is_circle in circle.items():
        if isinstance(outlines[i], Disc) != is_circle:
            mask = without_specks(labels == i)
            as_circle = None
            if is_circle:
                as_circle = fit_circle(mask, long_border(mask))[0]
            outlines[i] = as_circle or fit_regions(mask.astype(np.int64))[1]
    return outlines


def _document(
    sim: Sim, objects: list[PhotoObject], image: str, assets: str
) -> dict[str, Any]:
    """Return the document: world, objects, boundaries and forces."""
    names = object_names(objects)
    order = list(names)
    entries = {
        names[item.id]: _object_entry(item, sim.bodies[item.id])
        for item in sorted(objects, key=lambda item: order.index(item.id))
    }
    forces = []
    for item in objects:
        body = sim.bodies[item.id]
        if body.push is not None:
            forces.append(_force_entry(item, body, body.push, names[item.id]))
    surface = {"friction": sim.ground_friction, "elasticity": sim.ground_elasticity}
    walls = {}
    for k, (a, b) in enumerate(sim.edges, 1):
        walls[f"wall-{k}"] = {"segment": [list(a), list(b)], **surface}
    return {
        "physgen": 1,
        "image": image,
        "assets": assets,
        "world": _world_entry(sim),
        "objects": entries,
        "boundaries": walls,
        "forces": forces,
    }


def _world_entry(sim: Sim) -> dict[str, Any]:
    """Return the entry `world`."""
    world: dict[str, Any] = {
        "view": "side" if sim.gravity else "top",
        "pixels_per_meter": 100,
        "gravity": [0, sim.gravity],
    }
    if not sim.gravity:
        world["table"] = {"friction": 0}
    return world | {"combine": "multiply", "duration": round(sim.duration, 9)}


def _object_entry(item: PhotoObject, body: Body) -> dict[str, Any]:
    """Return the entry of an object."""
    entry = {
        "label": item.label,
        "mask": item.id,
        "shape": shape_entry(item.outline),
    }
    if isinstance(item.outline, Disc):
        entry |= {"solid": "disc", "mass": body.mass}
    else:
        entry["density"] = body.density
    entry |= {"friction": body.friction, "elasticity": body.elasticity}
    if body.velocity is not None:
        entry["velocity"] = list(body.velocity)
    return entry


def _force_entry(
    item: PhotoObject, body: Body, push: Vector, name: str
) -> dict[str, Any]:
    """Return the impulse of a push.

    `init_acc` is added to the velocity at t = 0, so that it becomes an impulse.
    """
    mass = body.mass
    if not isinstance(item.outline, Disc):
        mass = body.density * mass_properties(item.outline).area
    impulse = [float(f"{mass * v:.6g}") for v in push]
    force: dict[str, Any] = {"object": name, "impulse": impulse}
    if not isinstance(item.outline, Disc):
        force["at"] = list(POLYGON_ORIGIN)
    return force


def _comments(sim: Sim, folder: Path) -> dict[str, str]:
    comments = {
        "world.combine": "the paper's code multiplies the coefficients of two surfaces",
        "objects": "balls turn as discs, as they did there; solid: sphere is truer",
    }
    if not sim.gravity:
        comments["world.view"] = (
            "gravity 0: seen from above, on a table without friction"
        )
    if sim.edges and sim.ground_elasticity:
        comments["boundaries"] = "their coefficients are multiplied by the objects'"
    elif sim.edges:
        comments["boundaries"] = (
            "elasticity 0: nothing bounces off them, as there; 0.8 is a cushion"
        )
    if any(body.push for body in sim.bodies.values()):
        comments["forces"] = (
            "init_acc, added to the velocity at t = 0, times mass; it acts at the"
            " origin of a body, of polygons the picture's corner, which turns them"
        )
    if not (folder / "inpaint.png").is_file():
        comments["assets"] = "inpaint.png was missing; the background was filled here"
    comments["physgen"] = (
        f"imported from {folder.name}/sim.yaml of the paper's public code"
    )
    return comments


def _find_shadows(percepts: Percepts, objects: list[PhotoObject], sim: Sim) -> Shadows:
    """Return the photo's shadows, starting from the light that explains the maps."""
    surface = sim.ground_friction, sim.ground_elasticity
    walls = tuple(
        Wall(f"wall-{k}", ends, *surface, 1.0, "", "")
        for k, ends in enumerate(sim.edges, 1)
    )
    boundary = BoundaryGuess(View.SIDE if sim.gravity else View.TOP, 1.0, "", walls)
    rgb = percepts.rgb
    labels = percepts.labels
    normals = percepts.normals
    matter = registry.make("physics")(rgb, objects, None)
    if normals is None:
        normals = registry.make("normals")(rgb, labels, objects, boundary)
    intrinsics: Intrinsics = registry.make("intrinsic")(rgb, labels, normals)
    guess: LightGuess = registry.make("light")(
        rgb, labels, objects, normals, intrinsics
    )
    shadows: Shadows = registry.make("shadow")(
        percepts.background, percepts.coverage, labels, objects, matter, boundary, guess
    )
    return shadows


def _fitted_light(
    normals: F32 | None, shading: F32 | None, labels: NDArray[np.uint16]
) -> dict[str, Any] | None:
    """Return the light that explains the shading of the objects, or None.

    None means that the maps do not determine it.
    """
    if normals is None or shading is None:
        return None
    inside = labels > 0
    step = max(1, int(inside.sum()) // 20000)
    fit = fit_light(shading[inside][::step], normals[inside][::step])
    if fit is None or fit.light.intensity < 1e-3 or fit.spread < LEAST_SPREAD:
        return None
    return light_entry(fit.light)


def _check_folder(folder: Path) -> None:
    """Raise InputError with all missing files of a folder."""
    file_names = ", ".join(NEEDED)
    if not folder.is_dir():
        raise Message.IMPORT_NOT_FOLDER.error(str(folder), needed=file_names)
    absent_files = []
    for name in NEEDED:
        if not (folder / name).is_file():
            absent_files.append(folder / name)
    if absent_files:
        raise InputError(
            [
                Message.IMPORT_FILE_MISSING.problem(Place(str(path)), needed=file_names)
                for path in absent_files
            ]
        )


def _check_size(path: Path, size: tuple[int, ...], rgb: Rgb) -> None:
    """Raise InputError if a picture has another size than the photo."""
    if tuple(size[:2]) != rgb.shape[:2]:
        file_size = f"{size[1]} x {size[0]} px"
        photo = f"{rgb.shape[1]} x {rgb.shape[0]} px"
        raise Message.IMPORT_SIZE.error(str(path), file_size, size=photo)


def _read_labels(path: Path, rgb: Rgb, sim: Sim) -> NDArray[np.uint16]:
    """Return the mask with the ids of sim.yaml's objects; other ids become
    background.
    """
    labels = read_labels(path)
    _check_size(path, labels.shape[:2], rgb)
    problems = []
    for i, body in sim.bodies.items():
        if not (labels == i).any():
            problems.append(
                Message.NOT_IN_MASK.problem(body.place, f"obj_info.{i}", str(i))
            )
    if problems:
        raise InputError(problems)
    return np.where(np.isin(labels, list(sim.bodies)), labels, 0).astype(np.uint16)


def _read_background(path: Path, rgb: Rgb, hole: NDArray[np.bool_]) -> Rgb:
    """Return the folder's background with seamless borders, or a fill if there is
    none.
    """
    if not path.is_file():
        return fill_behind(rgb, hole, registry.make("inpaint"))
    other = read_image(path)
    _check_size(path, other.shape, rgb)
    return seamless(other, rgb, hole)


def _read_maps(folder: Path, rgb: Rgb) -> tuple[F32 | None, F32 | None, F32 | None]:
    """Return normals, shading and depth in physgen's axes, None for missing files."""
    normals = _read_array(folder / "normal.npy", rgb.shape)
    # In that code x points left and y up (measured on balls and floors).
    if normals is not None:
        normals = normals * np.array([-1, -1, 1], np.float32)
        normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-6)
    shading = _read_array(folder / "shading.npy", rgb.shape[:2])
    depth = _read_array(folder / "depth.npy", rgb.shape[:2])
    return normals, shading, depth


def _read_array(path: Path, shape: tuple[int, ...]) -> F32 | None:
    """Return an array of the given shape as float32, or None if the file is missing."""
    if not path.is_file():
        return None
    try:
        array = np.load(path, allow_pickle=False, mmap_mode="r")
    except (OSError, ValueError, EOFError) as error:
        if str(error):
            reason = str(error).splitlines()[0][:80]
        else:
            reason = "broken"
        raise Message.ARRAY_UNREADABLE.error(str(path), reason=reason) from None
    if (
        not isinstance(array, np.ndarray)
        or array.dtype.kind not in "fiu"
        or array.shape != shape
    ):
        size = " x ".join(map(str, getattr(array, "shape", ())))
        photo_size = " x ".join(map(str, shape))
        raise Message.ARRAY_WRONG.error(str(path), size or "it", wanted=photo_size)
    values = np.array(array, np.float32)
    if not np.isfinite(values).all():
        raise Message.ARRAY_NOT_FINITE.error(str(path), "NaN or infinity")
    return values


SIM_START = "`obj_info:` and one entry per object"
"""The first key of the file, as written in messages."""
LONGEST_LABEL = 200
"""Characters of a label; longer labels are cut."""


def read_sim(path: Path) -> Sim:
    """Read sim.yaml, or raise InputError with every invalid line."""
    source = Source(str(path), path.parent)
    root = read(decode(path.read_bytes(), str(path)), source, start=SIM_START)
    data = to_plain_data(root)
    properties = _schema()["properties"]
    object_properties = properties["obj_info"]["additionalProperties"]["properties"]
    problems = _find_problems(root, data, properties, object_properties)
    errors = []
    for problem in problems:
        if problem.severity is Severity.ERROR:
            errors.append(problem)
    if errors:
        raise InputError(errors)
    edges = [((a[0], a[1]), (b[0], b[1])) for a, b in data.get("edge_list") or []]
    return Sim(
        **_settings(data, properties),
        bodies=_read_bodies(root, data, object_properties),
        edges=edges,
        warnings=tuple(problems),
    )


def _read_bodies(
    root: Node, data: Any, object_properties: Mapping[str, Schema]
) -> dict[int, Body]:
    """Return the objects of sim.yaml by id."""
    velocities = data.get("init_velocity") or {}
    pushes = data.get("init_acc") or {}
    bodies = {}
    for key, node in children(root, "obj_info").items():
        settings = _settings(data["obj_info"][key], object_properties)
        settings["label"] = str(settings["label"])[:LONGEST_LABEL]
        bodies[int(key)] = Body(
            **settings,
            place=node.key_place,
            velocity=velocities.get(key),
            push=pushes.get(key),
        )
    return bodies


def _find_problems(
    root: Node,
    data: Any,
    properties: Mapping[str, Schema],
    object_properties: Mapping[str, Schema],
) -> list[Problem]:
    """Return the violations of the schema, unknown keys and unknown objects."""
    problems = []
    for error in Draft202012Validator(_schema()).iter_errors(data):
        problems.append(_fault(root, error))
    problems += _unknown_keys(root, properties, "")
    nodes = children(root, "obj_info")
    for key, node in nodes.items():
        problems += _unknown_keys(node, object_properties, f"obj_info.{key}")
    for key in ("init_velocity", "init_acc"):
        for name, node in children(root, key).items():
            if name not in nodes:
                problems.append(
                    Message.NOT_IN_OBJ_INFO.problem(
                        node.place, f"{key}.{name}", name, names=", ".join(nodes)
                    )
                )
    return problems


def _settings(
    entry: Mapping[str, Any], properties: Mapping[str, Schema]
) -> dict[str, Any]:
    """Return the value of each key with a default; null means the default."""
    defaults = {}
    for key, part in properties.items():
        if "default" in part:
            defaults[key] = part["default"]
    return {
        key: default if entry.get(key) is None else entry[key]
        for key, default in defaults.items()
    }


def _fault(root: Node, error: ValidationError) -> Problem:
    """Return the problem of a violation of the schema, with its line."""
    node: Any = root
    for key in error.absolute_path:
        node = node.value[key]
    expected_value = str(error.schema.get("description", "a number"))  # type: ignore[union-attr]
    actual_value = shown(error.instance if error.validator == "pattern" else node.value)
    message = Message.SIM_VALUE_WRONG
    if error.validator == "required":
        message = Message.SIM_VALUE_MISSING
    path = dotted(tuple(error.absolute_path))
    return message.problem(node.place, path, actual_value, wanted=expected_value)


def _unknown_keys(
    node: Node, properties: Mapping[str, Any], path: str
) -> Iterator[Problem]:
    """Yield an error for a misspelt key and a warning for an unknown one."""
    for key, child in children(node).items():
        if key not in properties:
            similar_key = nearest(key, properties)
            if path:
                key_path = f"{path}.{key}"
            else:
                key_path = key
            place = child.key_place
            quoted_key = f'"{key}"'
            unknown = Message.UNKNOWN_SIM_KEY
            if similar_key is None:
                yield unknown.warning(place, key_path, quoted_key, fix="it is ignored")
            else:
                yield unknown.problem(
                    place, key_path, quoted_key, fix=did_you_mean(similar_key)
                )
