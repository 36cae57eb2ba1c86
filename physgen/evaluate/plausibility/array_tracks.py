"""Tracks from clips and scenes of physgen, and from folders of mask pictures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from physgen.evaluate.plausibility.request import FPS, Request, title
from physgen.evaluate.plausibility.tracks import Array, Known, Outline, Tracks
from physgen.image_formats import MOST_PIXELS
from physgen.problems import InputError
from physgen.scene.scene import Motion, Solid, View
from physgen.text import natural

if TYPE_CHECKING:
    from physgen.compile.world import Body, World


EXACT = 0.02
"""px: what the engine's steps may shake."""


def from_scene(path: Path, overrides: tuple[str, ...] = (), variant: str | None = None) -> Tracks:
    """A scene file, simulated at its video's frames."""
    from physgen import pipeline

    scene = pipeline.load(path, overrides, variant)
    world = pipeline.compile(scene, pipeline.percepts(scene)).world
    trajectory = pipeline.simulate(world)
    name = path.parent.name if path.name == "scene.yaml" else path.stem
    return from_world(f"{name}-{variant}" if variant else name, world, trajectory.times, trajectory.poses)


def from_clip(folder: Path) -> Tracks:
    """A folder that `render` made: its `trajectory.npz`, with outlines and pushes from its scene, where that is still.

    Raises InputError where the motion cannot be read.
    """
    from physgen import pipeline
    from physgen.batch.clips import read_manifest

    manifest = read_manifest(folder)
    view = View(str(manifest.document.get("world", {}).get("view", "side")))
    bare = from_trajectory(folder / "trajectory.npz", view)
    name = folder.resolve().name
    try:
        path = Path(folder.resolve(), manifest.source or "")
        if not manifest.source or not path.is_file():
            raise InputError.of(str(path), "", "is not there", "")
        scene = pipeline.load(path, manifest.overrides, manifest.variant, allow_outside=True)
        world = pipeline.compile(scene, pipeline.percepts(scene)).world
    except InputError:
        return replace(bare, name=name)
    if tuple(body.name for body in world.bodies) != bare.names:
        return replace(bare, name=name)
    return from_world(name, world, bare.times, np.concatenate([bare.places, bare.angles[..., None]], axis=2))


def from_world(name: str, world: World, times: Array, poses: Array) -> Tracks:
    """`poses` (T, N, 3) as a trajectory has them."""
    return Tracks(
        name,
        times,
        tuple(body.name for body in world.bodies),
        poses[..., :2].copy(),
        poses[..., 2].copy(),
        tuple(map(form_of, world.bodies)),
        np.array([body.mass for body in world.bodies]),
        True,
        world.view,
        EXACT,
        "poses of a clip of physgen",
        given_by(world),
        world.view is View.SIDE and not np.any(world.gravity),
    )


def form_of(body: Body) -> Outline:
    """Of a body of a world."""
    if body.radius is not None:
        return Outline(body.radius, body.radius, float(np.sqrt(body.moment / body.mass)))
    core = min((_inscribed(piece) for piece in body.pieces if _holds_origin(piece)), default=0.0)
    return Outline(
        core, body.reach, float(np.sqrt(body.moment / body.mass)), _width(body.pieces), body.pieces
    )


def given_by(world: World) -> Known:
    """What acts from outside, as the scene says."""
    held, joined = set(), set()
    for joint in world.joints:
        held |= {joint.first} | ({joint.second} if joint.second is not None else set())
        if joint.second is not None:
            joined.add((min(joint.first, joint.second), max(joint.first, joint.second)))
    scripted = {k for k, body in enumerate(world.bodies) if body.motion is not Motion.DYNAMIC}
    pushed = [(p.body, p.start, p.end if np.isfinite(p.end) else world.duration) for p in world.pushes]
    spun = {k for k, body in enumerate(world.bodies) if world.view is View.TOP and np.any(_overspin(body))}
    return Known(
        frozenset(held | scripted),
        frozenset(k for field in world.fields for k in field.bodies),
        tuple(pushed),
        frozenset(joined),
        tuple(chain for wall in world.walls for chain in wall.chains),
        frozenset(spun),
    )


def _overspin(body: Body) -> Array:
    """px/s by which its start differs from rolling: (wx, wy) rolls at (R wy, -R wx), signs as in `Body.roll`."""
    if body.solid is not Solid.SPHERE or body.radius is None or not np.any(body.roll):
        return np.zeros(2)
    rolling = body.radius * np.array([-body.roll[1], body.roll[0]])
    return np.asarray(
        np.where(np.abs(rolling - body.velocity) > 1e-6 * np.abs(body.velocity).max(initial=1.0), 1.0, 0.0)
    )


def _width(pieces: tuple[Array, ...]) -> float:
    """px: the least of all shadows that the whole casts; hollows count as filled."""
    angles = np.linspace(0.0, np.pi, 36, endpoint=False)
    shadows = np.concatenate(pieces) @ np.stack([np.cos(angles), np.sin(angles)])
    return float(np.ptp(shadows, axis=0).min())


def _holds_origin(piece: Array) -> bool:
    following = np.roll(piece, -1, axis=0)
    turns = piece[:, 0] * following[:, 1] - piece[:, 1] * following[:, 0]
    return bool((turns >= 0).all() or (turns <= 0).all())


def _inscribed(piece: Array) -> float:
    along = np.roll(piece, -1, axis=0) - piece
    length = np.hypot(*along.T)
    keep = length > 1e-9
    return float((np.abs(piece[:, 0] * along[:, 1] - piece[:, 1] * along[:, 0])[keep] / length[keep]).min())


def from_trajectory(path: Path, view: View) -> Tracks:
    """Poses of `trajectory.npz` without outlines. Raises InputError where the file cannot be read."""
    try:
        with np.load(path, allow_pickle=False) as file:
            times, names, poses = (file[key] for key in ("times", "names", "poses"))
    except (OSError, ValueError, KeyError, BadZipFile) as error:
        raise InputError.of(str(path), "", f"cannot be read: {error}", "render the clip again") from None
    names = tuple(map(str, names))
    return Tracks(
        title(path), np.asarray(times, np.float64), names, poses[..., :2].copy(), poses[..., 2].copy(),
        (Outline(0.0, 0.0),) * len(names), np.ones(len(names)), False, view, EXACT,
        "poses without outlines: the scene is missing", flat=False,
    )  # fmt: skip


Ids = NDArray[np.integer]
Pixels = NDArray[np.intp]
WHOLE = 0.965
"""Of a body's usual area: it is hidden in part where less is seen."""
SHAKE = 0.08
"""px: what centroids of some hundred pixels shake, at least."""
LEAST = 12
"""px of area: smaller bodies have no place."""


@dataclass
class Silhouettes:
    """What is kept of the maps as they go by."""

    size: tuple[int, int] = (0, 0)
    count: int = 0
    areas: dict[int, dict[int, float]] = field(default_factory=dict)
    """id -> frame -> px."""
    places: dict[int, dict[int, tuple[float, float]]] = field(default_factory=dict)
    cut: dict[int, set[int]] = field(default_factory=dict)
    """id -> frames in which it reaches the border."""
    cores: dict[int, list[float]] = field(default_factory=dict)
    reaches: dict[int, list[float]] = field(default_factory=dict)


def gathered(maps: Iterable[Ids]) -> Silhouettes:
    """One map after the other; 0 is the background."""
    found = Silhouettes()
    for frame, ids in enumerate(maps):
        height, width = ids.shape
        found.size, found.count = (width, height), frame + 1
        ys, xs = np.nonzero(ids)
        owners = ids[ys, xs]
        if not len(owners):
            continue
        order = np.argsort(owners, kind="stable")
        names, starts = np.unique(owners[order], return_index=True)
        for one, some in zip(names.tolist(), np.split(order, starts[1:]), strict=True):
            _add(found, frame, one, ys[some], xs[some])
    return found


def _add(found: Silhouettes, frame: int, one: int, ys: Pixels, xs: Pixels) -> None:
    disc = _disc(ys, xs)
    if disc is None:
        return
    place, core, reach, area = disc
    found.areas.setdefault(one, {})[frame] = area
    found.places.setdefault(one, {})[frame] = place
    width, height = found.size
    if xs.min() == 0 or ys.min() == 0 or xs.max() == width - 1 or ys.max() == height - 1:
        found.cut.setdefault(one, set()).add(frame)
        return
    found.cores.setdefault(one, []).append(core)
    found.reaches.setdefault(one, []).append(reach)


def _disc(ys: Pixels, xs: Pixels) -> tuple[tuple[float, float], float, float, float] | None:
    if len(xs) < LEAST:
        return None
    x0, y0 = int(xs.min()), int(ys.min())
    part = np.zeros((int(ys.max()) - y0 + 3, int(xs.max()) - x0 + 3), np.uint8)
    part[ys - y0 + 1, xs - x0 + 1] = 1
    x, y = float(xs.mean()), float(ys.mean())
    inside = cv2.distanceTransform(part, cv2.DIST_L2, 5)
    core = max(float(inside[round(y) - y0 + 1, round(x) - x0 + 1]) - 0.5, 0.0)
    return (x, y), core, float(np.hypot(xs - x, ys - y).max()) + 0.5, float(len(xs))


def tracked(found: Silhouettes) -> tuple[list[int], Array, tuple[Outline, ...], Array]:
    """Ids, places (T, N, 2) with NaN where a body is not wholly seen, forms, and areas (N,) px²."""
    ids = sorted(found.areas)
    places = np.full((found.count, len(ids), 2), np.nan)
    forms, areas = [], []
    for k, one in enumerate(ids):
        usual = float(np.quantile(list(found.areas[one].values()), 0.8))
        for frame, area in found.areas[one].items():
            if area >= WHOLE * usual and frame not in found.cut.get(one, ()):
                places[frame, k] = found.places[one][frame]
        cores, reaches = found.cores.get(one, [0.0]), found.reaches.get(one, [0.0])
        core, reach = float(np.quantile(cores, 0.8)), float(np.quantile(reaches, 0.8))
        round_ = core > 0.85 * reach
        radius = float(np.sqrt(usual / np.pi))
        forms.append(Outline(radius, radius, 0.7 * radius) if round_ else Outline(core, reach, 0.6 * reach))
        areas.append(usual)
    return ids, places, tuple(forms), np.array(areas)


MOST_IDS = 1000
"""In a picture: more are no ids, but a photo."""
COLOURS = 65536
"""Numbers from here on are colours, red first: black is the background."""


def pictures_in(folder: Path) -> list[Path]:
    """By name, in their natural order; `ids-*.png` alone where there are such."""
    found = [path for path in folder.iterdir() if path.suffix.lower() == ".png" and path.is_file()]
    own = [path for path in found if path.name.startswith("ids-")]
    return sorted(own or found, key=lambda path: natural(path.name))


def from_pictures(folder: Path, asked: Request) -> Tracks:
    """Raises InputError for different sizes, and pictures that are no maps."""
    paths = pictures_in(folder)
    ids, places, forms, areas = tracked(gathered(_maps(paths)))
    if not ids:
        raise InputError.of(str(folder), "", "has no tracks: all is background", "give bodies ids above 0")
    assumed = "" if asked.fps else ", 30 frames a second assumed"
    return Tracks(
        folder.resolve().name, np.arange(len(places)) / (asked.fps or FPS), tuple(map(_name, ids)), places,
        np.full(places.shape[:2], np.nan), forms, areas, False, asked.view, SHAKE, f"centroids of masks{assumed}",
        flat=False,
    )  # fmt: skip


def _maps(paths: list[Path]) -> Iterator[Ids]:
    size = None
    for path in paths:
        ids = _read(path)
        if size is not None and ids.shape != size:
            found = f"{ids.shape[1]} x {ids.shape[0]} px"
            raise InputError.of(
                str(path), found, f"is not the size of {paths[0].name}", "give frames of one size"
            )
        size = ids.shape
        values = len(np.unique(ids))
        if values > MOST_IDS:
            fix = "give maps with a number or colour a body"
            raise InputError.of(str(path), f"{values:,} values", "are no ids: it is a photo", fix)
        yield ids


def _name(one: int) -> str:
    return f"id {one}" if one < COLOURS else f"#{one:06x}"


def _read(path: Path) -> Ids:
    try:
        with Image.open(path, formats=("PNG",)) as picture:
            if picture.width * picture.height > MOST_PIXELS:
                raise InputError.of(
                    str(path), f"{picture.width} x {picture.height} px", "are too many", "make it smaller"
                )
            if picture.mode in ("RGB", "RGBA"):
                rgb = np.asarray(picture.convert("RGB"), np.int64)
                return np.asarray((rgb[..., 0] << 16) + (rgb[..., 1] << 8) + rgb[..., 2])
            return np.asarray(picture).astype(np.int64)
    except (OSError, UnidentifiedImageError, SyntaxError) as error:
        raise InputError.of(str(path), "", f"cannot be read: {error}", "save it as PNG") from None
