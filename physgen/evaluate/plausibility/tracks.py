"""Positions of the objects of a clip over its frames, what is known of them, and their readers: clips and scenes of
physgen, CSV tables, folders of masks.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from zipfile import BadZipFile

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from physgen.files import MOST_PIXELS
from physgen.problems import InputError, Place, Problem
from physgen.scene.scene import Motion, Solid, View
from physgen.text import natural

if TYPE_CHECKING:
    from physgen.compile.world import Body, World

Array = NDArray[np.float64]
Ids = NDArray[np.integer]

FIX = "give a clip's folder, a scene file, a CSV of frame,name,x,y, or a folder of PNG masks"


@dataclass(frozen=True)
class Limits:
    """Of what is read."""

    fps: float = 30.0
    """1/s, of tracks without a rate."""
    cells: int = 5_000_000
    """Frames times bodies."""
    problems: int = 20
    """Reported of one file."""
    ids: int = 1000
    """In a mask: a picture with more values is a photo."""
    least: int = 12
    """px of area: smaller bodies have no place."""
    whole: float = 0.965
    """Of a body's usual area: it is hidden in part where less is seen."""
    exact: float = 0.02
    """px: noise of the engine's poses."""
    table: float = 0.05
    """px: least noise of measured places."""
    masks: float = 0.08
    """px: least noise of centroids of some hundred pixels."""


LIMITS = Limits()


@dataclass(frozen=True)
class Outline:
    """How a body lies about its tracked place. px."""

    core: float
    """Radius of a disc about the place that it surely covers; 0: not known."""
    reach: float
    """Distance of its farthest point from the place; 0: a point."""
    width: float = 0.0
    """Its smallest width; 0: twice its core."""
    pieces: tuple[Array, ...] = ()
    """Convex pieces, each (K, 2) about the place, turned by its angle; none for discs and where they are not known."""

    @property
    def thin(self) -> float:
        """px: its smallest width, as far as it is known."""
        return self.width or 2 * self.core

    @property
    def round(self) -> bool:
        """Whether it looks the same however it turns."""
        return not self.pieces and self.core >= 0.9 * self.reach


@dataclass(frozen=True)
class Tracks:
    """Of N bodies in T frames."""

    name: str
    times: Array
    """(T,) s, evenly spaced."""
    names: tuple[str, ...]
    places: Array
    """(T, N, 2) px, image axes: of the centre of mass or what stands for it; NaN where it is not seen."""
    angles: Array | None
    """(T, N) rad, a positive one turns +x towards +y; None: not known, nor are pieces."""
    forms: tuple[Outline, ...]
    view: View
    floor: float
    """px: noise is never taken to be less."""
    source: str
    """What was read, in words."""
    masses: Array | None = None
    """(N,) in any unit; None: not known."""
    held: frozenset[int] = frozenset()
    """Moved by a hand, joints, wind, a script or pushes, or struck with spin: only jumps and overlap are asked."""
    flat: bool = False
    """Whether gravity is known to be none, as in a scene that says so."""

    @property
    def step(self) -> float:
        """s from frame to frame."""
        return float(self.times[1] - self.times[0])

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(T, N)."""
        return np.asarray(np.isfinite(self.places).all(axis=2))

    def holding(self, names: Sequence[str]) -> Tracks:
        """With these bodies held. Raises InputError for names that are not there."""
        if unknown := set(names) - set(self.names):
            found, fix = f'"{", ".join(sorted(unknown))}"', f"it has {', '.join(self.names[:8])}"
            raise InputError.of(self.name, found, "is none of its bodies", fix)
        return replace(self, held=self.held | {self.names.index(name) for name in names})


def read(path: Path, fps: float | None = None, view: View = View.SIDE) -> Iterator[Tracks]:
    """Every clip that a path holds; `fps` and `view` of tracks that do not say it. Raises InputError."""
    ending = path.suffix.lower()
    if not path.exists():
        raise InputError.of(str(path), "", "is not there", FIX)
    if path.is_dir():
        yield from _folder(path, fps, view)
    elif ending in (".yaml", ".yml"):
        yield from_scene(path)
    elif ending == ".csv":
        yield from_csv(path, fps, view)
    else:
        raise InputError.of(str(path), f'"{ending or path.name}"', "is no kind of tracks", FIX)


def _folder(path: Path, fps: float | None, view: View) -> Iterator[Tracks]:
    from physgen.batch.clips import clip_folders

    pictures = [] if (path / "manifest.json").exists() else _pictures(path)
    if (path / "scene.yaml").is_file():
        yield from_scene(path / "scene.yaml")
    elif pictures:
        source = "centroids of masks" + ("" if fps else ", 30 frames a second assumed")
        tracks = from_maps(path.resolve().name, _maps(pictures), fps or LIMITS.fps, view)
        yield replace(tracks, source=source)
    else:
        try:
            folders = clip_folders([path])
        except InputError:
            raise InputError.of(str(path), "", "holds no clip and no tracks", FIX) from None
        yield from map(from_clip, folders)


# ---- clips and scenes of physgen ---------------------------------------------------------------------------------


def from_scene(path: Path, variant: str | None = None) -> Tracks:
    """A scene file, simulated at its video's frames."""
    from physgen import pipeline

    scene = pipeline.load(path, (), variant)
    world = pipeline.compile(scene, pipeline.percepts(scene)).world
    trajectory = pipeline.simulate(world)
    name = path.parent.name if path.name == "scene.yaml" else path.stem
    return from_world(f"{name}-{variant}" if variant else name, world, trajectory.times, trajectory.poses)


def from_clip(folder: Path) -> Tracks:
    """A folder that `render` made: its `trajectory.npz`, with outlines and pushes where its scene is still there.

    Raises InputError where the motion cannot be read.
    """
    from physgen import pipeline
    from physgen.batch.clips import read_manifest

    manifest = read_manifest(folder)
    path, name = folder / "trajectory.npz", folder.resolve().name
    try:
        with np.load(path, allow_pickle=False) as file:
            times, names, poses = (file[key] for key in ("times", "names", "poses"))
    except (OSError, ValueError, KeyError, BadZipFile) as error:
        raise InputError.of(str(path), "", f"cannot be read: {error}", "render the clip again") from None
    names = tuple(map(str, names))
    source = Path(folder.resolve(), manifest.source or "")
    if source.is_file():
        try:
            scene = pipeline.load(source, manifest.overrides, manifest.variant, allow_outside=True)
            world = pipeline.compile(scene, pipeline.percepts(scene)).world
        except InputError:  # the scene was changed since: its motion alone is judged
            world = None
        if world is not None and tuple(body.name for body in world.bodies) == names:
            return from_world(name, world, times, poses)
    view = View(str(manifest.document.get("world", {}).get("view", "side")))
    forms, about = (
        (Outline(0.0, 0.0),) * len(names),
        "poses without outlines: the scene is missing or has changed",
    )
    return Tracks(name, times, names, poses[..., :2], poses[..., 2], forms, view, LIMITS.exact, about)


def from_world(name: str, world: World, times: Array, poses: Array) -> Tracks:
    """`poses` (T, N, 3) as a trajectory has them."""
    return Tracks(
        name,
        times,
        tuple(body.name for body in world.bodies),
        poses[..., :2].copy(),
        poses[..., 2].copy(),
        tuple(map(_outline, world.bodies)),
        world.view,
        LIMITS.exact,
        "poses of a clip of physgen",
        np.array([body.mass for body in world.bodies]),
        _held(world),
        world.view is View.SIDE and not np.any(world.gravity),
    )


def _outline(body: Body) -> Outline:
    if body.radius is not None:
        return Outline(body.radius, body.radius)
    angles = np.linspace(0.0, np.pi, 36, endpoint=False)
    shadows = np.concatenate(body.pieces) @ np.stack([np.cos(angles), np.sin(angles)])
    return Outline(0.0, body.reach, float(np.ptp(shadows, axis=0).min()), body.pieces)


def _held(world: World) -> frozenset[int]:
    held = {k for k, body in enumerate(world.bodies) if body.motion is not Motion.DYNAMIC}
    held |= {k for one in world.fields for k in one.bodies} | {push.body for push in world.pushes}
    held |= {k for joint in world.joints for k in (joint.first, joint.second) if k is not None}
    spun = {k for k, body in enumerate(world.bodies) if world.view is View.TOP and _overspun(body)}
    return frozenset(held | spun)


def _overspun(body: Body) -> bool:
    """Whether it does not roll at its start: (wx, wy) rolls at (R wy, -R wx), signs as in `Body.roll`."""
    if body.solid is not Solid.SPHERE or body.radius is None or not np.any(body.roll):
        return False
    rolling = body.radius * np.array([-body.roll[1], body.roll[0]])
    return not np.allclose(rolling, body.velocity, rtol=0, atol=1e-6 * np.abs(body.velocity).max(initial=1.0))


# ---- tables ------------------------------------------------------------------------------------------------------

RANGES = {"frame": (0.0, 1e6), "x": (-1e6, 1e6), "y": (-1e6, 1e6), "radius": (1e-3, 1e6)}
"""Columns beside `name`, with what they may hold: frames, px."""
NEEDED = ("frame", "x", "y")


def from_csv(path: Path, fps: float | None, view: View) -> Tracks:
    """Raises InputError for columns that are missing and cells that are no numbers, with their lines."""
    lines = _lines(path)
    problems: list[Problem] = []
    rows = [_row(path, number, line, problems) for number, line in enumerate(lines, 2)]
    if problems:
        raise InputError(problems[: LIMITS.problems])
    owners = [line.get("name") or "body" for line in lines]
    names = sorted(set(owners), key=natural)
    frames = _frames(path, np.array([row["frame"] for row in rows]), len(names))
    shape = max(frames) + 1, len(names)
    places = np.full((*shape, 2), np.nan)
    radii: list[list[float]] = [[] for _ in names]
    for frame, owner, row in zip(frames, owners, rows, strict=True):
        k = names.index(owner)
        if isfinite(places[frame, k, 0]):
            fix = "give each body a name of its own"
            raise InputError.of(str(path), f'"{owner}"', f"is twice in frame {frame}", fix)
        places[frame, k] = row["x"], row["y"]
        if "radius" in row:
            radii[k].append(row["radius"])
    forms = tuple(_disc(np.array(own or [0.0])) for own in radii)
    source = "a table" + ("" if fps else ", 30 frames a second assumed")
    times = np.arange(len(places), dtype=np.float64) / (fps or LIMITS.fps)
    return Tracks(path.stem, times, tuple(names), places, None, forms, view, LIMITS.table, source)


def _lines(path: Path) -> list[dict[str, str]]:
    """By column. Raises InputError for a file that is no table of tracks."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            heads = reader.fieldnames = [head.strip().lower() for head in reader.fieldnames or ()]
            lines = list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        fix = "save it as UTF-8 with commas"
        raise InputError.of(str(path), "", f"cannot be read as CSV: {error}", fix) from None
    missing = [column for column in NEEDED if column not in heads]
    if missing:
        found, fix = f'columns "{", ".join(heads)}"', "begin with frame,name,x,y,radius"
        raise InputError.of(str(path), found, f"lack {', '.join(missing)}", fix)
    if not lines:
        raise InputError.of(str(path), "", "has no tracks", "write a line a frame and body")
    return lines


def _row(path: Path, number: int, line: dict[str, str], problems: list[Problem]) -> dict[str, float]:
    """Numbers by column, without empty cells of columns that may be empty; problems are added."""
    found = {}
    for column, (low, high) in RANGES.items():
        cell = (line.get(column) or "").strip()
        if cell or column in NEEDED:
            try:
                found[column] = float(cell)
            except ValueError:
                found[column] = np.nan
            if not low <= found[column] <= high:
                expected = f"is no number from {low:g} to {high:g}"
                problems.append(
                    Problem(Place(str(path), number, 1), column, f'"{cell[:40]}"', expected, "write s, px")
                )
    return found


def _frames(path: Path, numbers: Array, bodies: int) -> list[int]:
    """From 0 on. Raises InputError for numbers that are not whole, no motion, and too many frames."""
    frames = numbers - numbers.min()
    last = int(frames.max())
    if (frames % 1 != 0).any():
        raise InputError.of(str(path), "its frames", "are not whole numbers", "count frames, and give --fps")
    if last == 0:
        raise InputError.of(str(path), "1 frame", "is no motion", "give a row a frame and body")
    if last * bodies > LIMITS.cells:
        found = f"{last:,.0f} frames of {bodies:,} bodies"
        fix = f"keep frames x bodies below {LIMITS.cells:,}"
        raise InputError.of(str(path), found, "are too many", fix)
    return [int(frame) for frame in frames]


def _disc(radii: Array) -> Outline:
    """Of the radii (n,) px of a disc in its frames."""
    core, reach = np.quantile(radii, [0.2, 0.8]).tolist()
    return Outline(core, reach)


# ---- masks -------------------------------------------------------------------------------------------------------


class Silhouette(NamedTuple):
    """One body in one frame. px."""

    frame: int
    place: tuple[float, float]
    area: float
    core: float
    reach: float
    cut: bool
    """Whether it reaches the border of the picture."""


def from_maps(name: str, maps: Iterable[Ids], fps: float, view: View) -> Tracks:
    """Centroids of the ids of each map (H, W), 0 being the background, where a body is wholly seen.

    Raises InputError where all is background.
    """
    found: dict[int, list[Silhouette]] = {}
    count = 0
    for ids in maps:
        for one in np.unique(ids[ids > 0]).tolist():
            shape = _silhouette(count, ids == one)
            if shape is not None:
                found.setdefault(one, []).append(shape)
        count += 1
    if not found:
        raise InputError.of(name, "", "has no tracks: all is background", "give bodies ids above 0")
    places = np.full((count, len(found), 2), np.nan)
    forms = []
    for k, (_, shapes) in enumerate(sorted(found.items())):
        usual = float(np.quantile([shape.area for shape in shapes], 0.8))
        for shape in shapes:
            if shape.area >= LIMITS.whole * usual and not shape.cut:
                places[shape.frame, k] = shape.place
        uncut = [shape for shape in shapes if not shape.cut] or [shapes[0]._replace(core=0.0, reach=0.0)]
        core, reach = (
            float(np.quantile([getattr(s, side) for s in uncut], 0.8)) for side in ("core", "reach")
        )
        radius = float(np.sqrt(usual / np.pi))
        disc = core > 0.85 * reach
        forms.append(Outline(radius, radius) if disc else Outline(core, reach))
    names = tuple(f"id {one}" if one < 2**16 else f"#{one:06x}" for one in sorted(found))
    times = np.arange(count) / fps
    return Tracks(name, times, names, places, None, tuple(forms), view, LIMITS.masks, "masks")


def _silhouette(frame: int, mask: NDArray[np.bool_]) -> Silhouette | None:
    """None where too little is seen."""
    ys, xs = np.nonzero(mask)
    if len(xs) < LIMITS.least:
        return None
    x0, y0 = int(xs.min()), int(ys.min())
    x, y = float(xs.mean()), float(ys.mean())
    part = np.pad(mask[y0 : ys.max() + 1, x0 : xs.max() + 1], 1).astype(np.uint8)
    inside = cv2.distanceTransform(part, cv2.DIST_L2, 5)
    core = max(float(inside[round(y) - y0 + 1, round(x) - x0 + 1]) - 0.5, 0.0)
    reach = float(np.hypot(xs - x, ys - y).max()) + 0.5
    high, wide = mask.shape
    cut = x0 == 0 or y0 == 0 or xs.max() == wide - 1 or ys.max() == high - 1
    return Silhouette(frame, (x, y), float(len(xs)), core, reach, bool(cut))


def _pictures(folder: Path) -> list[Path]:
    """PNG files in the natural order of their names; `ids-*.png` alone where there are such."""
    found = [path for path in folder.iterdir() if path.suffix.lower() == ".png" and path.is_file()]
    own = [path for path in found if path.name.startswith("ids-")]
    return sorted(own or found, key=lambda path: natural(path.name))


def _maps(paths: list[Path]) -> Iterator[Ids]:
    """Raises InputError for different sizes, and pictures that are no maps."""
    size = None
    for path in paths:
        ids = _ids(path)
        if size is not None and ids.shape != size:
            found, fix = f"{ids.shape[1]} x {ids.shape[0]} px", "give frames of one size"
            raise InputError.of(str(path), found, f"is not the size of {paths[0].name}", fix)
        size = ids.shape
        values = len(np.unique(ids))
        if values > LIMITS.ids:
            fix = "give maps with a number or colour a body"
            raise InputError.of(str(path), f"{values:,} values", "are no ids: it is a photo", fix)
        yield ids


def _ids(path: Path) -> Ids:
    """(H, W): grey values, or colours as one number, red first; black is the background."""
    try:
        with Image.open(path, formats=("PNG",)) as picture:
            if picture.width * picture.height > MOST_PIXELS:
                found = f"{picture.width} x {picture.height} px"
                raise InputError.of(str(path), found, "are too many", "make it smaller")
            if picture.mode in ("RGB", "RGBA"):
                return np.asarray(np.asarray(picture.convert("RGB"), np.int64) @ (1 << 16, 1 << 8, 1))
            return np.asarray(picture).astype(np.int64)
    except (OSError, UnidentifiedImageError, SyntaxError) as error:
        raise InputError.of(str(path), "", f"cannot be read: {error}", "save it as PNG") from None
