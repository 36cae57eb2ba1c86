"""A folder of the paper's public code -> percepts, scene document and comments that mean what its author meant.

original.png, mask.png and sim.yaml are needed; inpaint.png, normal.npy, shading.npy and depth.npy are used if there.
What its numbers stand for was measured by running it: `init_acc` is a change of velocity, coefficients multiply, walls
have friction 1 and elasticity 0 unless told, balls turn as discs.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen import backends
from physgen.outline.outline import Disc, mass_properties
from physgen.perceive import words
from physgen.perceive.found import Perceived
from physgen.perceive.lifted import refilled
from physgen.perceive.membrane import seamless
from physgen.perceive.primitives import outlines_of
from physgen.perceive.roles import Intrinsics, LightGuess, Rgb, Setting, Shadows, Thing, Wall
from physgen.perceive.scene import Progress, silent
from physgen.perceive.sim_yaml import Body, Sim, read_sim
from physgen.percepts.maps import Percepts, read_labels
from physgen.percepts.photo import read_image
from physgen.photometry import decode, fit_light
from physgen.problems import InputError
from physgen.scene.model import View

F32 = NDArray[np.float32]
SPREAD = 0.06
"""Least spread of normals that tells where the light is; flat fronts of blocks do not."""
NEEDED = ("original.png", "mask.png", "sim.yaml")


def import_physgen(
    folder: Path, *, image: str = "photo.png", assets: str = "photo.assets", progress: Progress = silent
) -> Perceived:
    """The scene of one folder; `image` and `assets` are what the document calls them.

    Raises InputError with every file that is missing or wrong, and every wrong line of sim.yaml.
    """
    _complete(folder)
    progress("read", 0, 4)
    sim = read_sim(folder / "sim.yaml")
    rgb = read_image(folder / "original.png")
    labels = _labels(folder / "mask.png", rgb, sim)
    comments: dict[str, str] = {}
    progress("outline", 1, 4)
    outlines = outlines_of(labels, {i: body.circle for i, body in sim.bodies.items()})
    things = [Thing(i, outlines[i], sim.bodies[i].label) for i in sim.bodies]
    progress("inpaint", 2, 4)
    coverage = backends.make("matte")(rgb, labels)
    background = _background(folder / "inpaint.png", rgb, coverage > 0)
    progress("maps", 3, 4)
    normals, shading, depth = _maps(folder, rgb)
    albedo = None if shading is None else np.clip(decode(rgb) / np.maximum(shading, 1e-3)[:, :, None], 0, 1)
    percepts = Percepts(
        rgb=rgb, labels=labels, coverage=coverage, background=background, depth=depth, normals=normals,
        albedo=None if albedo is None else albedo.astype(np.float32), shading=shading,
    )  # fmt: skip
    called = words.names(things)
    document: dict[str, Any] = {"physgen": 1, "image": image, "assets": assets, "world": _world(sim)}
    document["objects"] = {
        called[t.id]: _object(t, sim.bodies[t.id])
        for t in sorted(things, key=lambda t: list(called).index(t.id))
    }
    document["boundaries"] = {
        f"wall-{k}": {
            "segment": [list(a), list(b)],
            "friction": sim.ground_friction,
            "elasticity": sim.ground_elasticity,
        }
        for k, (a, b) in enumerate(sim.edges, 1)
    }
    document["forces"] = [_impulse(called[t.id], t, sim) for t in things if t.id in sim.push]
    if (light := _light(normals, shading, labels)) is not None:
        document["light"], comments["light"] = light
    shadows = _shadows(percepts, things, sim)
    if (clean := shadows.clean) is not None:
        if not shadows.faint:
            clean = refilled(clean, background, coverage, backends.make("inpaint"))
        percepts = replace(percepts, clean=clean)
        said = words.source("shadows", shadows.confidence)
        document["light"] = words.light(shadows.light) | {"softness": shadows.softness, "from": said}
        comments["light"] = f"{shadows.reason} (confidence {shadows.confidence:g})"
        document["world"] |= words.view(shadows, bool(sim.gravity))
    document["render"] = {"fps": max(1, round(sim.frames / sim.duration, 3)), "frames": sim.frames}
    if sim.strength is not None:
        document["refine"] = {"strength": sim.strength}
    comments |= _comments(sim, folder, labels)
    header = f"Imported from {folder.name}/sim.yaml of the paper's public code. Run: physgen render THIS-FILE"
    return Perceived(percepts, document, comments, header, tuple(sim.warnings))


def _shadows(percepts: Percepts, things: list[Thing], sim: Sim) -> Shadows:
    """The photo's shadows, by a light near the one found from the maps."""
    walls = tuple(
        Wall(f"wall-{k}", ends, sim.ground_friction, sim.ground_elasticity, 1.0, "", "")
        for k, ends in enumerate(sim.edges, 1)
    )
    setting = Setting(View.SIDE if sim.gravity else View.TOP, 1.0, "", walls)
    matter = backends.make("physics")(percepts.rgb, things, None)
    rgb, labels, normals = percepts.rgb, percepts.labels, percepts.normals
    if normals is None:
        normals = backends.make("normals")(rgb, labels, things, setting)
    intrinsics: Intrinsics = backends.make("intrinsic")(rgb, labels, normals)
    guess: LightGuess = backends.make("light")(rgb, labels, things, normals, intrinsics)
    assert percepts.background is not None
    assert percepts.coverage is not None
    found: Shadows = backends.make("shadow")(
        percepts.background, percepts.coverage, percepts.labels, things, matter, setting, guess
    )
    return found


def _complete(folder: Path) -> None:
    if not folder.is_dir():
        raise InputError.of(str(folder), "", "is not a folder", f"name one with {', '.join(NEEDED)}")
    problems = []
    for name in NEEDED:
        if not (folder / name).is_file():
            problems += InputError.of(
                str(folder / name), "", "no such file", f"the folder needs {', '.join(NEEDED)}"
            ).problems
    if problems:
        raise InputError(problems)


def _labels(path: Path, rgb: Rgb, sim: Sim) -> NDArray[np.uint16]:
    """The mask with the ids of sim.yaml's objects alone; what is not among them belongs to the background."""
    labels = read_labels(path)
    _same_size(path, labels.shape[:2], rgb)
    problems = []
    for i, body in sim.bodies.items():
        if not (labels == i).any():
            problems.append(
                body.problem(
                    f"obj_info.{i}", str(i), "has no pixel in mask.png", "remove it, or paint its mask"
                )
            )
    if problems:
        raise InputError(problems)
    return np.where(np.isin(labels, list(sim.bodies)), labels, 0).astype(np.uint16)


def _same_size(path: Path, size: tuple[int, ...], rgb: Rgb) -> None:
    if tuple(size[:2]) != rgb.shape[:2]:
        found, photo = (f"{s[1]} x {s[0]} px" for s in (size, rgb.shape))
        raise InputError.of(str(path), found, f"differs from original.png's {photo}", "make them one size")


def _background(path: Path, rgb: Rgb, hole: NDArray[np.bool_]) -> Rgb:
    if not path.is_file():
        return np.asarray(backends.make("inpaint")(rgb, hole))
    other = read_image(path)
    _same_size(path, other.shape, rgb)
    return seamless(other, rgb, hole)


def _maps(folder: Path, rgb: Rgb) -> tuple[F32 | None, F32 | None, F32 | None]:
    """Normals, shading and depth in our axes and senses, None for those that are not there."""
    normals = _array(folder / "normal.npy", rgb, 3)
    if normals is not None:
        normals = normals * np.array(
            [-1, -1, 1], np.float32
        )  # x there points left, y up (measured on balls and floors)
        normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-6)
    depth = _array(folder / "depth.npy", rgb, 0)
    return normals, _array(folder / "shading.npy", rgb, 0), depth


def _array(path: Path, rgb: Rgb, channels: int) -> F32 | None:
    if not path.is_file():
        return None
    expected = (*rgb.shape[:2], channels) if channels else rgb.shape[:2]
    try:
        array = np.load(path, allow_pickle=False, mmap_mode="r")
    except (OSError, ValueError, EOFError) as error:
        reason = str(error).splitlines()[0][:80] if str(error) else "broken"
        raise InputError.of(
            str(path), "", f"is not an array that can be read ({reason})", "save it with numpy.save"
        ) from None
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu" or array.shape != expected:
        shape = " x ".join(map(str, getattr(array, "shape", ())))
        wanted = " x ".join(map(str, expected))
        raise InputError.of(
            str(path), shape or "it", f"is not an array of {wanted} numbers", "save it at the photo's size"
        )
    values = np.array(array, np.float32)
    if not np.isfinite(values).all():
        raise InputError.of(str(path), "NaN or infinity", "is among its numbers", "fill them in")
    return values


def _world(sim: Sim) -> dict[str, Any]:
    world: dict[str, Any] = {
        "view": "side" if sim.gravity else "top",
        "pixels_per_meter": 100,
        "gravity": [0, sim.gravity],
    }
    if not sim.gravity:
        world["table"] = {"friction": 0}
    return world | {"combine": "multiply", "duration": round(sim.duration, 9)}


def _object(thing: Thing, body: Body) -> dict[str, Any]:
    one: dict[str, Any] = {"label": body.label, "mask": thing.id, "shape": words.shape(thing.outline)}
    if isinstance(thing.outline, Disc):
        one |= {"solid": "disc", "mass": body.mass}
    else:
        one["density"] = body.density
    one |= {"friction": body.friction, "elasticity": body.elasticity}
    if body.velocity is not None:
        one["velocity"] = list(body.velocity)
    return one


def _impulse(name: str, thing: Thing, sim: Sim) -> dict[str, Any]:
    """`init_acc`, a change of velocity in px/s, as the impulse that makes it: g px/s."""
    body = sim.bodies[thing.id]
    mass = (
        body.mass if isinstance(thing.outline, Disc) else body.density * mass_properties(thing.outline).area
    )
    return {"object": name, "impulse": [float(f"{mass * v:.6g}") for v in sim.push[thing.id]]}


def _light(
    normals: F32 | None, shading: F32 | None, labels: NDArray[np.uint16]
) -> tuple[dict[str, Any], str] | None:
    if normals is None or shading is None:
        return None
    seen = labels > 0
    step = max(1, int(seen.sum()) // 20000)
    fit = fit_light(shading[seen][::step], normals[seen][::step])
    if fit is None or fit.light.intensity < 1e-3 or fit.spread < SPREAD:
        return None
    said = f"fitted to shading.npy over normal.npy on the objects; explains {fit.explained:.0%} of it"
    return words.light(fit.light), said


def _comments(sim: Sim, folder: Path, labels: NDArray[np.uint16]) -> dict[str, str]:
    comments = {
        "world.combine": "the paper's code multiplies the coefficients of two surfaces",
        "world.duration": f"{sim.steps} steps of 1/60 s",
        "objects": "balls turn as discs, as they did there; solid: sphere is truer",
        "render.fps": f"{sim.frames} frames played in real time",
    }
    if not sim.gravity:
        comments["world.view"] = "gravity 0: seen from above, on a table without friction"
    if sim.edges:
        comments["boundaries"] = (
            "their coefficients are multiplied by the objects'"
            if sim.ground_elasticity
            else "elasticity 0 times anything is 0: nothing bounces off them, as there; write 0.8 for cushions"
        )
    if sim.push:
        comments["forces"] = (
            "init_acc was added to the velocity at t = 0; as an impulse it is mass x that, in g px/s"
        )
    if not (folder / "inpaint.png").is_file():
        comments["assets"] = "inpaint.png was missing; the background was filled here"
    return comments
