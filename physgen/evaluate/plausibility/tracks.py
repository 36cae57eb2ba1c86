"""Positions of the objects of a clip over its frames, what is known of them, and their readers: clips and scenes of
physgen, and CSV tables.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from physgen.problems import InputError, Place, Problem
from physgen.scene.scene import Motion, Solid, View
from physgen.text import natural

if TYPE_CHECKING:
    from physgen.compile.world import Body, World

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Limits:
    """Of what is read."""

    fps: float = 30.0
    """1/s, of tracks without a rate."""
    cells: int = 5_000_000
    """Frames times bodies of a table."""
    exact: float = 0.02
    """px: least noise of the engine's poses."""
    table: float = 0.05
    """px: least noise of measured places."""


LIMITS = Limits()


@dataclass(frozen=True)
class Outline:
    """How a body lies about its tracked place. px."""

    reach: float
    """Distance of its farthest point from the place; 0: a point."""
    thin: float
    """Its smallest width."""
    pieces: tuple[Array, ...] = ()
    """Convex pieces, each (K, 2) about the place, turned by its angle; none for discs and points."""

    @property
    def round(self) -> bool:
        """Whether it looks the same however it turns."""
        return not self.pieces


def disc(radius: float) -> Outline:
    """Of 0: a point."""
    return Outline(radius, 2 * radius)


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
            found, fix = (
                f'"{", ".join(sorted(unknown))}"',
                f"it has {', '.join(self.names[:8])}",
            )
            raise InputError.of(self.name, found, "is none of its bodies", fix)
        return replace(
            self, held=self.held | {self.names.index(name) for name in names}
        )


def read(
    path: Path, fps: float | None = None, view: View = View.SIDE
) -> Iterator[Tracks]:
    """Every clip that a path holds; `fps` and `view` of tables. Raises InputError."""
    from physgen.batch.clips import clip_folders

    ending = path.suffix.lower()
    scene = path / "scene.yaml" if path.is_dir() else path
    if path.is_dir() and not scene.is_file():
        yield from map(from_clip, clip_folders([path]))
    elif ending == ".csv" and path.is_file():
        yield from_csv(path, fps, view)
    elif scene.is_file() and scene.suffix.lower() in (".yaml", ".yml"):
        yield from_scene(scene)
    else:
        expected = "is no kind of tracks" if path.exists() else "is not there"
        fix = "give a clip's folder, a scene file, or a CSV of frame,name,x,y"
        raise InputError.of(str(path), "", expected, fix)


# ---- clips and scenes of physgen ---------------------------------------------------------------------------------


def from_scene(path: Path, variant: str | None = None) -> Tracks:
    """A scene file, simulated at its video's frames."""
    from physgen import pipeline

    scene = pipeline.load(path, (), variant)
    world = pipeline.compile(scene, pipeline.percepts(scene)).world
    trajectory = pipeline.simulate(world)
    name = path.parent.name if path.name == "scene.yaml" else path.stem
    return from_world(
        f"{name}-{variant}" if variant else name,
        world,
        trajectory.times,
        trajectory.poses,
    )


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
        raise InputError.of(
            str(path), "", f"cannot be read: {error}", "render the clip again"
        ) from None
    names = tuple(map(str, names))
    source = Path(folder.resolve(), manifest.source or "")
    if source.is_file():
        try:
            scene = pipeline.load(
                source, manifest.overrides, manifest.variant, allow_outside=True
            )
            world = pipeline.compile(scene, pipeline.percepts(scene)).world
        except InputError:  # the scene was changed since: its motion alone is judged
            world = None
        if world is not None and tuple(body.name for body in world.bodies) == names:
            return from_world(name, world, times, poses)
    document = json.loads((folder / "manifest.json").read_text())["document"]
    view = View(str(document.get("world", {}).get("view", "side")))
    about = "poses without outlines: the scene is missing or has changed"
    forms = (disc(0.0),) * len(names)
    return Tracks(
        name,
        times,
        names,
        poses[..., :2],
        poses[..., 2],
        forms,
        view,
        LIMITS.exact,
        about,
    )


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
        return disc(body.radius)
    angles = np.linspace(0.0, np.pi, 36, endpoint=False)
    shadows = np.concatenate(body.pieces) @ np.stack([np.cos(angles), np.sin(angles)])
    return Outline(body.reach, float(np.ptp(shadows, axis=0).min()), body.pieces)


def _held(world: World) -> frozenset[int]:
    held = {
        k for k, body in enumerate(world.bodies) if body.motion is not Motion.DYNAMIC
    }
    held |= {k for one in world.fields for k in one.bodies} | {
        push.body for push in world.pushes
    }
    held |= {
        k
        for joint in world.joints
        for k in (joint.first, joint.second)
        if k is not None
    }
    spun = {
        k
        for k, body in enumerate(world.bodies)
        if world.view is View.TOP and _overspun(body)
    }
    return frozenset(held | spun)


def _overspun(body: Body) -> bool:
    """Whether it does not roll at its start: (wx, wy) rolls at (R wy, -R wx), signs as in `Body.roll`."""
    if body.solid is not Solid.SPHERE or body.radius is None or not np.any(body.roll):
        return False
    rolling = body.radius * np.array([-body.roll[1], body.roll[0]])
    return not np.allclose(
        rolling,
        body.velocity,
        rtol=0,
        atol=1e-6 * np.abs(body.velocity).max(initial=1.0),
    )


# ---- tables ------------------------------------------------------------------------------------------------------

RANGES = {
    "frame": (0.0, 1e6),
    "x": (-1e6, 1e6),
    "y": (-1e6, 1e6),
    "radius": (1e-3, 1e6),
}
"""Columns beside `name`, with what they may hold: frames, px."""


def from_csv(path: Path, fps: float | None, view: View) -> Tracks:
    """Raises InputError for columns that are missing and cells that are no numbers, with their lines."""
    lines = _lines(path)
    rows = [_row(path, number, line) for number, line in enumerate(lines, 2)]
    owners = [line.get("name") or "body" for line in lines]
    names = sorted(set(owners), key=natural)
    first = min(row["frame"] for row in rows)
    count = int(max(row["frame"] for row in rows) - first) + 1
    if count == 1 or count * len(names) > LIMITS.cells:
        found, expected = (
            f"{count:,} frames of {len(names):,} bodies",
            "are no motion, or too many",
        )
        raise InputError.of(
            str(path),
            found,
            expected,
            f"give 2 frames or more, up to {LIMITS.cells:,} cells",
        )
    places = np.full((count, len(names), 2), np.nan)
    radii: list[list[float]] = [[] for _ in names]
    for owner, row in zip(owners, rows, strict=True):
        frame, k = int(row["frame"] - first), names.index(owner)
        if np.isfinite(places[frame, k, 0]):
            fix = "give each body a name of its own"
            raise InputError.of(
                str(path), f'"{owner}"', f"is twice in frame {row['frame']:g}", fix
            )
        places[frame, k] = row["x"], row["y"]
        radii[k] += [row["radius"]] if "radius" in row else []
    forms = tuple(disc(float(np.median(own or [0.0]))) for own in radii)
    source = "a table" + ("" if fps else f", {LIMITS.fps:g} frames a second assumed")
    times = np.arange(count, dtype=np.float64) / (fps or LIMITS.fps)
    return Tracks(
        path.stem, times, tuple(names), places, None, forms, view, LIMITS.table, source
    )


def _lines(path: Path) -> list[dict[str, str]]:
    """By column. Raises InputError for a file that is no table of tracks."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            heads = reader.fieldnames = [
                head.strip().lower() for head in reader.fieldnames or ()
            ]
            lines = list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        fix = "save it as UTF-8 with commas"
        raise InputError.of(
            str(path), "", f"cannot be read as CSV: {error}", fix
        ) from None
    if missing := [column for column in ("frame", "x", "y") if column not in heads]:
        found, fix = f'columns "{", ".join(heads)}"', "begin with frame,name,x,y,radius"
        raise InputError.of(str(path), found, f"lack {', '.join(missing)}", fix)
    if not lines:
        raise InputError.of(
            str(path), "", "has no tracks", "write a line a frame and body"
        )
    return lines


def _row(path: Path, number: int, line: dict[str, str]) -> dict[str, float]:
    """Numbers by column; a radius may be missing. Raises InputError for what is no number, or no whole frame."""
    found = {}
    for column, (low, high) in RANGES.items():
        cell = (line.get(column) or "").strip()
        if not cell and column == "radius":
            continue
        try:
            found[column] = float(cell)
        except ValueError:
            found[column] = np.nan
        whole = column != "frame" or found[column] % 1 == 0
        if not (low <= found[column] <= high and whole):
            kind = "whole number" if column == "frame" else "number"
            expected = f"is no {kind} from {low:g} to {high:g}"
            place = Place(str(path), number, 1)
            raise InputError(
                [
                    Problem(
                        place,
                        column,
                        f'"{cell[:40]}"',
                        expected,
                        "write px, and count frames",
                    )
                ]
            )
    return found
