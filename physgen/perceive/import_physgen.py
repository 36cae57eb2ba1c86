"""Import of a scene folder of the paper's public code: photo, mask, sim.yaml and optional maps."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen import registry
from physgen.geometry.circles import fit_circle
from physgen.geometry.fitting import fit_outlines, long_border, without_specks
from physgen.geometry.polygon import Disc, Outline, mass_properties
from physgen.geometry.regions import fit_regions
from physgen.maps import Percepts, read_labels
from physgen.perceive import document as words
from physgen.perceive.inpaint.poisson import seamless
from physgen.perceive.perceive import Progress, no_progress
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
from physgen.perceive.shadow.shadow_removal import refill_background
from physgen.photometry import decode as decode_of_photometry
from physgen.photometry import fit_light
from physgen.photos import read_image
from physgen.problems import InputError, Place, Problem, Severity
from physgen.scene.document import Node, Source, decode, read
from physgen.scene.scene import View
from physgen.text import shown

# ----------------------------------------------------------------------
# Label map -> outlines whose kind, circle or polygon, somebody has already chosen.


def outlines_by_kind(labels: NDArray[np.uint16], circle: Mapping[int, bool]) -> dict[int, Outline]:
    """Outline by id of `labels` (H, W): a circle where `circle` says so, else polygons, however round.

    Neighbours are fitted together as far as their kind is the one that the fit would choose.
    """
    found: dict[int, Outline] = dict(fit_outlines(labels, list(circle)))
    for i, wanted in circle.items():
        if isinstance(found[i], Disc) != wanted:
            mask = without_specks(labels == i)
            found[i] = (
                fit_circle(mask, long_border(mask))[0] if wanted else fit_regions(mask.astype(np.int64))[1]
            )
    return found


# ----------------------------------------------------------------------
# sim.yaml of the paper's public code -> its settings with their defaults, or every wrong line of it.

KEYS = (
    "cat", "animation_frames", "size", "num_steps", "display", "save_snapshot", "gravity", "init_velocity", "init_acc",
    "ground_friction", "ground_elasticity", "edge_list", "obj_info", "denoise_strength", "seed",
    "snapshot_dir", "prompt",
)  # fmt: skip
"""What its configuration knows; others are passed over there, and warned of here."""
OBJECT_KEYS = ("label", "mass", "density", "friction", "elasticity", "primitive")
STEP = 1 / 60
"""s."""

Vector = tuple[float, float]


@dataclass(frozen=True)
class Body:
    """One entry of `obj_info`."""

    label: str
    circle: bool
    """Its primitive: a circle, else the polygon of its mask."""
    mass: float
    """g; counts for circles."""
    density: float
    """g/px²; counts for polygons."""
    friction: float
    elasticity: float
    place: Place
    velocity: Vector | None = None
    """px/s."""

    def problem(self, path: str, found: str, expected: str, fix: str) -> Problem:
        """Something wrong with this entry."""
        return Problem(self.place, path, found, expected, fix)


@dataclass(frozen=True)
class Sim:
    """The file, with what its code takes for what is missing."""

    gravity: float
    """px/s² down; 0 seen from above."""
    steps: int
    """of 1/60 s."""
    frames: int
    bodies: dict[int, Body]
    """By id in mask.png."""
    push: dict[int, Vector]
    """`init_acc`, by id: a change of velocity, px/s."""
    edges: list[tuple[Vector, Vector]]
    """px."""
    ground_friction: float
    ground_elasticity: float
    strength: float | None
    """of the diffusion step."""
    warnings: list[Problem] = field(default_factory=list)

    @property
    def duration(self) -> float:
        """s."""
        return self.steps * STEP


def read_sim(path: Path) -> Sim:
    """Raises InputError with every wrong line."""
    root = read(decode(path.read_bytes(), str(path)), Source(str(path), path.parent))
    return _Reader(root).sim()


class _Reader:
    """Collects problems while it reads."""

    def __init__(self, root: Node) -> None:
        self.root = root
        self.problems: list[Problem] = []

    def sim(self) -> Sim:
        top = self._mapping(self.root, "")
        self._unknown(top, KEYS, "")
        bodies = self._bodies(top)
        velocity = self._vectors(top, "init_velocity", bodies)
        bodies = {i: _moving(body, velocity.get(i)) for i, body in bodies.items()}
        sim = Sim(
            gravity=self._number(top, "gravity", "", 980.0, lambda v: v >= 0, "0 or more, in px/s² down"),
            steps=int(
                self._number(
                    top, "num_steps", "", 120, lambda v: 1 <= v <= 216000, "a count of steps from 1 to 216000"
                )
            ),
            frames=int(
                self._number(
                    top, "animation_frames", "", 16, lambda v: 1 <= v <= 100000, "a count of frames from 1"
                )
            ),
            bodies=bodies,
            push=self._vectors(top, "init_acc", bodies),
            edges=self._edges(top),
            ground_friction=self._number(
                top, "ground_friction", "", 1.0, lambda v: 0 <= v <= 10, "from 0 to 10"
            ),
            ground_elasticity=self._number(
                top, "ground_elasticity", "", 0.0, lambda v: 0 <= v <= 1, "from 0 to 1"
            ),
            strength=self._number(top, "denoise_strength", "", None, lambda v: 0 <= v <= 1, "from 0 to 1"),
        )
        errors = [p for p in self.problems if p.severity is Severity.ERROR]
        if errors:
            raise InputError(errors)
        sim.warnings.extend(self.problems)
        return sim

    def _bodies(self, top: dict[str, Node]) -> dict[int, Body]:
        node = top.get("obj_info")
        entries = self._mapping(node, "obj_info") if node is not None else {}
        if not entries:
            at = node or self.root
            self._add(at, "obj_info", "", "names no object", "write `obj_info:` with an id of mask.png each")
        return {
            int(key): self._body(value, f"obj_info.{key}")
            for key, value in entries.items()
            if self._id(key, value)
        }

    def _body(self, node: Node, path: str) -> Body:
        entry = self._mapping(node, path)
        self._unknown(entry, OBJECT_KEYS, path)
        primitive = entry["primitive"].value if "primitive" in entry else "polygon"
        if primitive not in ("circle", "polygon"):
            self._add(
                entry["primitive"],
                f"{path}.primitive",
                shown(primitive),
                "is not a primitive",
                "write circle or polygon",
            )
        label = entry["label"].value if "label" in entry else "object"
        weight: Callable[[float], bool] = lambda v: 0 < v <= 1e12  # noqa: E731
        circle = primitive == "circle"
        mass = self._number(entry, "mass", path, None, weight, "more than 0, in g")
        density = self._number(entry, "density", path, None, weight, "more than 0, in g/px²")
        if (mass if circle else density) is None:
            wanted, unit = ("mass", "g") if circle else ("density", "g/px²")
            self._add(
                node, f"{path}.{wanted}", "", f"missing, and a {primitive} needs it", f"write it in {unit}"
            )
        return Body(
            label=str(label if label is not None else "object")[:200],
            circle=circle,
            mass=mass if mass is not None else 1.0,
            density=density if density is not None else 1.0,
            friction=self._number(entry, "friction", path, 0.5, lambda v: 0 <= v <= 10, "from 0 to 10"),
            elasticity=self._number(entry, "elasticity", path, 0.5, lambda v: 0 <= v <= 1, "from 0 to 1"),
            place=node.key_place,
        )

    def _vectors(self, top: dict[str, Node], key: str, bodies: dict[int, Body]) -> dict[int, Vector]:
        node = top.get(key)
        if node is None or node.value is None:
            return {}
        result: dict[int, Vector] = {}
        for name, value in self._mapping(node, key).items():
            path = f"{key}.{name}"
            if not self._id(name, value):
                continue
            if int(name) not in bodies:
                self._add(
                    value,
                    path,
                    name,
                    "is not among obj_info",
                    f"it has {', '.join(map(str, bodies)) or 'none'}",
                )
                continue
            vector = self._vector(value, path)
            if vector is not None:
                result[int(name)] = vector
        return result

    def _edges(self, top: dict[str, Node]) -> list[tuple[Vector, Vector]]:
        node = top.get("edge_list")
        if node is None or node.value is None:
            return []
        if not isinstance(node.value, list):
            self._add(
                node,
                "edge_list",
                shown(node.value),
                "is not a list of segments",
                "write [[[x, y], [x, y]], ...]",
            )
            return []
        edges = []
        for k, item in enumerate(node.value):
            path = f"edge_list[{k}]"
            ends = item.value if isinstance(item.value, list) else []
            if len(ends) != 2:
                self._add(
                    item, path, shown(item.value), "is not a segment of two points", "write [[x, y], [x, y]]"
                )
                continue
            a, b = (self._vector(end, path) for end in ends)
            if a is not None and b is not None:
                edges.append((a, b))
        return edges

    def _vector(self, node: Node, path: str) -> Vector | None:
        numbers: list[Any] = [child.value for child in node.value] if isinstance(node.value, list) else []
        if len(numbers) == 2 and all(_finite(n) and abs(n) <= 1e9 for n in numbers):
            return numbers[0], numbers[1]
        self._add(node, path, shown(node.value), "is not two numbers", "write [x, y]")
        return None

    def _number(
        self,
        entry: dict[str, Node],
        key: str,
        above: str,
        default: Any,
        fits: Callable[[float], bool],
        wanted: str,
    ) -> Any:
        node = entry.get(key)
        if node is None or node.value is None:
            return default
        value: Any = node.value
        path = f"{above}.{key}" if above else key
        if not _finite(value):
            self._add(node, path, shown(value), "is not a number", f"write {wanted}")
            return default if default is not None else 1.0
        if not fits(value):
            self._add(node, path, shown(value), "is out of range", f"write {wanted}")
        return value

    def _mapping(self, node: Node, path: str) -> dict[str, Node]:
        if isinstance(node.value, dict):
            return node.value
        if node.value is not None:
            self._add(node, path, shown(node.value), "is not a mapping", "write `key: value`, one a line")
        return {}

    def _id(self, key: str, node: Node) -> bool:
        if key.isascii() and key.isdigit() and 1 <= int(key) <= 65535:
            return True
        self._add(node, key, f'"{key}"', "is not an id of mask.png", "write a number from 1 to 65535")
        return False

    def _unknown(self, entry: dict[str, Node], known: tuple[str, ...], path: str) -> None:
        for key, node in entry.items():
            if key in known:
                continue
            near = difflib.get_close_matches(key, known, 1, 0.75)
            severity = Severity.ERROR if near else Severity.WARNING
            fix = f"did you mean {near[0]}?" if near else "it is passed over"
            where = f"{path}.{key}" if path else key
            self.problems.append(
                Problem(node.key_place, where, f'"{key}"', "is not a key of sim.yaml", fix, severity)
            )

    def _add(self, node: Node, path: str, found: str, expected: str, fix: str) -> None:
        self.problems.append(Problem(node.place, path, found, expected, fix))


def _moving(body: Body, velocity: Vector | None) -> Body:
    return Body(**{**body.__dict__, "velocity": velocity})


def _finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


# ----------------------------------------------------------------------
# A folder of the paper's public code -> percepts, scene document and comments that mean what its author
# meant.
#
# original.png, mask.png and sim.yaml are needed; inpaint.png, normal.npy, shading.npy and depth.npy are used
# if there.
# What its numbers stand for was measured by running it: `init_acc` is a change of velocity, coefficients
# multiply, walls
# have friction 1 and elasticity 0 unless told, balls turn as discs.

F32 = NDArray[np.float32]
SPREAD = 0.06
"""Least spread of normals that tells where the light is; flat fronts of blocks do not."""
NEEDED = ("original.png", "mask.png", "sim.yaml")


def import_physgen(
    folder: Path, *, image: str = "photo.png", assets: str = "photo.assets", progress: Progress = no_progress
) -> PerceivedScene:
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
    outlines = outlines_by_kind(labels, {i: body.circle for i, body in sim.bodies.items()})
    things = [PhotoObject(i, outlines[i], sim.bodies[i].label) for i in sim.bodies]
    progress("inpaint", 2, 4)
    coverage = registry.make("matte")(rgb, labels)
    background = _background(folder / "inpaint.png", rgb, coverage > 0)
    progress("maps", 3, 4)
    normals, shading, depth = _maps(folder, rgb)
    albedo = (
        None
        if shading is None
        else np.clip(decode_of_photometry(rgb) / np.maximum(shading, 1e-3)[:, :, None], 0, 1)
    )
    percepts = Percepts(
        rgb=rgb, labels=labels, coverage=coverage, background=background, depth=depth, normals=normals,
        albedo=None if albedo is None else albedo.astype(np.float32), shading=shading,
    )  # fmt: skip
    called = words.object_names(things)
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
            clean = refill_background(clean, background, coverage, registry.make("inpaint"))
        percepts = replace(percepts, clean=clean)
        said = words.provenance("shadows", shadows.confidence)
        document["light"] = words.light_entry(shadows.light) | {"softness": shadows.softness, "from": said}
        comments["light"] = f"{shadows.reason} (confidence {shadows.confidence:g})"
        document["world"] |= words.view_entry(shadows, bool(sim.gravity))
    document["render"] = {"fps": max(1, round(sim.frames / sim.duration, 3)), "frames": sim.frames}
    if sim.strength is not None:
        document["refine"] = {"strength": sim.strength}
    comments |= _comments(sim, folder, labels)
    header = f"Imported from {folder.name}/sim.yaml of the paper's public code. Run: physgen render THIS-FILE"
    return PerceivedScene(percepts, document, comments, header, tuple(sim.warnings))


def _shadows(percepts: Percepts, things: list[PhotoObject], sim: Sim) -> Shadows:
    """The photo's shadows, by a light near the one found from the maps."""
    walls = tuple(
        Wall(f"wall-{k}", ends, sim.ground_friction, sim.ground_elasticity, 1.0, "", "")
        for k, ends in enumerate(sim.edges, 1)
    )
    setting = BoundaryGuess(View.SIDE if sim.gravity else View.TOP, 1.0, "", walls)
    matter = registry.make("physics")(percepts.rgb, things, None)
    rgb, labels, normals = percepts.rgb, percepts.labels, percepts.normals
    if normals is None:
        normals = registry.make("normals")(rgb, labels, things, setting)
    intrinsics: Intrinsics = registry.make("intrinsic")(rgb, labels, normals)
    guess: LightGuess = registry.make("light")(rgb, labels, things, normals, intrinsics)
    assert percepts.background is not None
    assert percepts.coverage is not None
    found: Shadows = registry.make("shadow")(
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
        return np.asarray(registry.make("inpaint")(rgb, hole))
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


def _object(thing: PhotoObject, body: Body) -> dict[str, Any]:
    one: dict[str, Any] = {"label": body.label, "mask": thing.id, "shape": words.shape_entry(thing.outline)}
    if isinstance(thing.outline, Disc):
        one |= {"solid": "disc", "mass": body.mass}
    else:
        one["density"] = body.density
    one |= {"friction": body.friction, "elasticity": body.elasticity}
    if body.velocity is not None:
        one["velocity"] = list(body.velocity)
    return one


def _impulse(name: str, thing: PhotoObject, sim: Sim) -> dict[str, Any]:
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
    return words.light_entry(fit.light), said


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
