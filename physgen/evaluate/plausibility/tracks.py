"""Tracks of the objects of a clip over its frames, and their readers: clips and scenes
of physgen, and CSV tables.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from physgen import pipeline
from physgen.batch.clips import clip_folders, read_manifest
from physgen.messages import Message
from physgen.problems import InputError, Place
from physgen.scene.scene import Motion, Solid, View
from physgen.simulate.ramps import has_ramp
from physgen.text import listed, natural, quoted

if TYPE_CHECKING:
    from physgen.batch.clips import Manifest
    from physgen.compile.world import Body, World

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Limits:
    """Limits of the input."""

    fps: float = 30.0
    """Default frame rate of tracks, 1/s."""
    cells: int = 5_000_000
    """Maximum number of frames times bodies of a table."""
    pose_noise: float = 0.02
    """Minimum noise of the engine's poses, px."""
    table_noise: float = 0.05
    """Minimum noise of measured places, px."""


LIMITS = Limits()
WIDTH_DIRECTIONS = 36
"""Number of directions for the width of an outline."""


@dataclass(frozen=True)
class Outline:
    """The form of a body about its tracked place, px."""

    reach: float
    """Distance of its farthest point from the place; 0 for a point."""
    width: float
    """Its smallest width."""
    pieces: tuple[Array, ...] = ()
    """Convex pieces, each (K, 2) about the place, turned by its angle; empty for discs
    and points.
    """

    @property
    def is_round(self) -> bool:
        """Return whether the outline looks the same at every angle."""
        return not self.pieces


def disc(radius: float) -> Outline:
    """Return the outline of a disc, or of a point for a radius of 0."""
    return Outline(radius, 2 * radius)


@dataclass(frozen=True)
class Tracks:
    """Tracks of N bodies in T frames."""

    name: str
    times: Array
    """(T,) s, evenly spaced."""
    names: tuple[str, ...]
    places: Array
    """(T, N, 2) px, image axes: centre of mass, or a point in its place; NaN for an
    invisible body.
    """
    angles: Array | None
    """(T, N) rad, a positive one turns +x towards +y; None without known angles and
    pieces.
    """
    forms: tuple[Outline, ...]
    view: View
    noise_floor: float
    """Minimum noise, px."""
    source: str
    """The kind of the file, in words."""
    masses: Array | None = None
    """(N,) in any unit; None if unknown."""
    guided_bodies: frozenset[int] = frozenset()
    """Bodies under a hand, joints, wind, a script or pushes, or with an initial spin:
    only questions about jumps and overlap apply.
    """
    is_weightless: bool = False
    """True for a scene without gravity."""
    passing_pairs: frozenset[tuple[int, int]] = frozenset()
    """Pairs of bodies that pass through each other, the smaller index first: their
    collision groups differ.
    """
    bumped_bodies: frozenset[int] = frozenset()
    """Bodies with contacts of an elasticity above 1, which adds energy."""

    @property
    def step(self) -> float:
        """Return the time from frame to frame, s."""
        return float(self.times[1] - self.times[0])

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Return whether each body is visible in each frame, (T, N)."""
        return np.asarray(np.isfinite(self.places).all(axis=2))

    def hold(self, names: Sequence[str]) -> Tracks:
        """Return the tracks with these bodies guided. Raise InputError for
        unknown names.
        """
        if unknown_names := set(names) - set(self.names):
            raise Message.UNKNOWN_BODIES.error(
                self.name,
                f'"{", ".join(sorted(unknown_names))}"',
                names=listed(self.names[:MAX_LISTED_BODIES]),
            )
        bodies = {self.names.index(name) for name in names}
        return replace(self, guided_bodies=self.guided_bodies | bodies)


def read(
    path: Path, fps: float | None = None, view: View = View.SIDE
) -> Iterator[Tracks]:
    """Yield the tracks of every clip in a path. `fps` and `view` belong to tables.
    Raise InputError.
    """
    # A folder with a scene file stands for this scene; any other folder contains clips.
    ending = path.suffix.lower()
    if path.is_dir():
        scene = path / "scene.yaml"
    else:
        scene = path
    if path.is_dir() and not scene.is_file():
        yield from map(from_clip, clip_folders([path]))
    elif ending == ".csv" and path.is_file():
        yield from_csv(path, fps, view)
    elif scene.is_file() and scene.suffix.lower() in (".yaml", ".yml"):
        yield from_scene(scene)
    else:
        if not path.exists():
            raise Message.NO_SUCH_PATH.error(str(path))
        raise Message.NOT_TRACKS.error(str(path))


# ---- clips and scenes of physgen


def from_scene(path: Path, variant: str | None = None) -> Tracks:
    """Return the tracks of a scene file from a simulation at its video's frames."""
    scene = pipeline.load(path, (), variant)
    world = pipeline.compile(scene, pipeline.percepts(scene)).world
    trajectory = pipeline.simulate(world)
    if path.name == "scene.yaml":
        name = path.parent.name
    else:
        name = path.stem
    if variant:
        name = f"{name}-{variant}"
    return from_world(name, world, trajectory.times, trajectory.poses)


def from_clip(folder: Path) -> Tracks:
    """Return the tracks of a clip: its `trajectory.npz`, with outlines and pushes if
    its scene is unchanged.

    Raise InputError for an unreadable motion.
    """
    manifest = read_manifest(folder)
    times, names, poses = _read_motion(folder / "trajectory.npz")
    name = folder.resolve().name
    world = _world_of_clip(folder, manifest)
    # A scene edited after the render may have other objects than the trajectory.
    if world is not None and tuple(body.name for body in world.bodies) == names:
        return from_world(name, world, times, poses)
    document = json.loads((folder / "manifest.json").read_text())["document"]
    return Tracks(
        name=name,
        times=times,
        names=names,
        places=poses[..., :2],
        angles=poses[..., 2],
        forms=(disc(0.0),) * len(names),
        view=View(str(document.get("world", {}).get("view", "side"))),
        noise_floor=LIMITS.pose_noise,
        source="poses without outlines: the scene is missing or has changed",
    )


def _read_motion(path: Path) -> tuple[Array, tuple[str, ...], Array]:
    """Return times (T,) s, names and poses (T, N, 3) of a trajectory. Raise
    InputError.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            times, names, poses = (file[key] for key in ("times", "names", "poses"))
    except (OSError, ValueError, KeyError, BadZipFile) as error:
        raise Message.TRAJECTORY_UNREADABLE.error(str(path), reason=error) from None
    return times, tuple(map(str, names)), poses


def _world_of_clip(folder: Path, manifest: Manifest) -> World | None:
    """Return the world of a clip's scene, or None for a missing or faulty scene."""
    source = Path(folder.resolve(), manifest.source or "")
    if not source.is_file():
        return None
    try:
        scene = pipeline.load(
            source, manifest.overrides, manifest.variant, allow_outside=True
        )
        return pipeline.compile(scene, pipeline.percepts(scene)).world
    except InputError:
        # The scene has changed: judge only its motion.
        return None


def from_world(name: str, world: World, times: Array, poses: Array) -> Tracks:
    """Return the tracks of a world's bodies; `poses` (T, N, 3) are those of a
    trajectory.
    """
    return Tracks(
        name=name,
        times=times,
        names=tuple(body.name for body in world.bodies),
        places=poses[..., :2].copy(),
        angles=poses[..., 2].copy(),
        forms=tuple(map(_outline, world.bodies)),
        view=world.view,
        noise_floor=LIMITS.pose_noise,
        source="poses of a clip of physgen",
        masses=np.array([body.mass for body in world.bodies]),
        guided_bodies=_guided_bodies(world),
        # From above, gravity presses bodies on the table and never moves them.
        is_weightless=world.view is View.SIDE and not np.any(world.gravity),
        passing_pairs=_passing_pairs(world),
        bumped_bodies=_bumped_bodies(world),
    )


def _passing_pairs(world: World) -> frozenset[tuple[int, int]]:
    """Return the pairs that pass through each other, from collision groups or one-way
    surfaces.
    """
    found = []
    for pair in combinations(range(len(world.bodies)), 2):
        one, other = (world.bodies[k].passage for k in pair)
        # Both sides must allow a contact.
        meets = one.group & other.collides_with and other.group & one.collides_with
        if not meets or one.one_way or other.one_way:
            found.append(pair)
    return frozenset(found)


def _bumped_bodies(world: World) -> frozenset[int]:
    """Return the bodies with a pair elasticity above 1."""
    factors = [surface.elasticity for _, surface in world.surfaces]
    found = set()
    for k in range(len(world.bodies)):
        # A pair's elasticity is the product of both factors.
        others = factors[:k] + factors[k + 1 :]
        if factors[k] * max(others, default=0.0) > 1:
            found.add(k)
    return frozenset(found)


def _outline(body: Body) -> Outline:
    if body.radius is not None:
        return disc(body.radius)
    angles = np.linspace(0.0, np.pi, WIDTH_DIRECTIONS, endpoint=False)
    directions = np.stack([np.cos(angles), np.sin(angles)])
    # The width is the smallest extent over all directions.
    projections = np.concatenate(body.pieces) @ directions
    width = float(np.ptp(projections, axis=0).min())
    return Outline(body.reach, width, body.pieces)


def _guided_bodies(world: World) -> frozenset[int]:
    """Return the bodies under more than gravity and contacts."""
    bodies: set[int] = set()
    for k, body in enumerate(world.bodies):
        # A push, a field or a joint also moves a body by more than gravity.
        is_scripted = body.motion is not Motion.DYNAMIC
        is_scripted |= body.damping > 0 or body.gravity_scale != 1
        is_scripted |= has_ramp(body)
        has_extra_spin = world.view is View.TOP and _has_extra_spin(body)
        if is_scripted or has_extra_spin:
            bodies.add(k)
    for field in world.fields:
        bodies.update(field.bodies)
    for push in world.pushes:
        bodies.add(push.body)
    for joint in world.joints:
        bodies.update(k for k in (joint.first, joint.second) if k is not None)
    return frozenset(bodies)


def _has_extra_spin(body: Body) -> bool:
    """Return whether a ball slips at its start: (wx, wy) rolls at (R wy, -R
    wx), signs as in `Body.roll`.
    """
    if body.solid is not Solid.SPHERE or body.radius is None or not np.any(body.roll):
        return False
    # Rolling without slip, the velocity follows from the roll.
    roll_velocity = body.radius * np.array([-body.roll[1], body.roll[0]])
    tolerance = 1e-6 * np.abs(body.velocity).max(initial=1.0)
    return not np.allclose(roll_velocity, body.velocity, rtol=0, atol=tolerance)


# ---- tables

RANGES = {
    "frame": (0.0, 1e6),
    "x": (-1e6, 1e6),
    "y": (-1e6, 1e6),
    "radius": (1e-3, 1e6),
}
"""Columns beside `name`, with their lowest and highest values: frames, px."""
REQUIRED_COLUMNS = ("frame", "x", "y")
MAX_LISTED_BODIES = 8
"""Maximum number of bodies in a message."""


def from_csv(path: Path, fps: float | None, view: View) -> Tracks:
    """Return the tracks of a table.

    Raise InputError for missing columns and for cells without numbers, with their
    lines.
    """
    lines = _read_lines(path)
    rows = [_parse_row(path, number, line) for number, line in enumerate(lines, 2)]
    owners = [line.get("name") or "body" for line in lines]
    names = tuple(sorted(set(owners), key=natural))
    # Frames may begin at any number and may have gaps.
    frames = [row["frame"] for row in rows]
    first_frame = min(frames)
    count = int(max(frames) - first_frame) + 1
    if count == 1 or count * len(names) > LIMITS.cells:
        raise Message.TRACKS_SIZE.error(
            str(path),
            f"{count:,} frames of {len(names):,} bodies",
            most=LIMITS.cells,
        )
    # A body may be missing in some frames: its places stay unknown there.
    places = np.full((count, len(names), 2), np.nan)
    radii: dict[str, list[float]] = {name: [] for name in names}
    for owner, row in zip(owners, rows, strict=True):
        cell = int(row["frame"] - first_frame), names.index(owner)
        if np.isfinite(places[cell][0]):
            raise Message.BODY_TWICE_IN_FRAME.error(
                str(path), f'"{owner}"', frame=row["frame"]
            )
        places[cell] = row["x"], row["y"]
        if "radius" in row:
            radii[owner].append(row["radius"])
    return Tracks(
        name=path.stem,
        times=np.arange(count, dtype=np.float64) / (fps or LIMITS.fps),
        names=names,
        places=places,
        angles=None,
        forms=tuple(map(_disc_of, radii.values())),
        view=view,
        noise_floor=LIMITS.table_noise,
        source=_table_source(fps),
    )


def _table_source(fps: float | None) -> str:
    """Return the source of tracks in words, with an assumed frame rate."""
    if fps:
        return "a table"
    return f"a table, {LIMITS.fps:g} frames a second assumed"


def _disc_of(radii: Sequence[float]) -> Outline:
    """Return a disc of the median radius, or a point without a known radius."""
    return disc(float(np.median(radii or [0.0])))


def _read_lines(path: Path) -> list[dict[str, str]]:
    """Return the lines of a table by column. Raise InputError for another
    kind of file.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            columns = [head.strip().lower() for head in reader.fieldnames or ()]
            reader.fieldnames = columns
            lines = list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise Message.CSV_UNREADABLE.error(str(path), reason=error) from None
    missing_columns = []
    for name in REQUIRED_COLUMNS:
        if name not in columns:
            missing_columns.append(name)
    if missing_columns:
        raise Message.CSV_COLUMNS_MISSING.error(
            str(path),
            f'columns "{", ".join(columns)}"',
            names=listed(missing_columns),
        )
    if not lines:
        raise Message.NO_TRACKS.error(str(path))
    return lines


def _parse_row(path: Path, number: int, line: dict[str, str]) -> dict[str, float]:
    """Return the numbers of a line by column; a radius may be missing. Raise
    InputError for a wrong number.
    """
    values = {}
    for column, (low, high) in RANGES.items():
        cell = (line.get(column) or "").strip()
        if not cell and column == "radius":
            continue
        value = _parse_number(cell)
        is_whole = column != "frame" or value % 1 == 0
        if not low <= value <= high or not is_whole:
            kind = "number"
            if column == "frame":
                kind = "whole number"
            raise Message.NOT_TRACK_NUMBER.error_at(
                Place(str(path), number, 1),
                column,
                quoted(cell),
                kind=kind,
                low=low,
                high=high,
            )
        values[column] = value
    return values


def _parse_number(cell: str) -> float:
    """Return a number, NaN for other text."""
    try:
        return float(cell)
    except ValueError:
        return np.nan
