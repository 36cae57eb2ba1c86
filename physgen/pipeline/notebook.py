"""Pictures of scenes, worlds, trajectories and clip folders in the cells of a notebook."""

from __future__ import annotations

import base64
import json
import os
from dataclasses import dataclass
from html import escape
from pathlib import Path
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from physgen.compile.compile import Compiled
from physgen.compile.world import World, photo_poses
from physgen.problems import InputError
from physgen.render.drawing import arrow
from physgen.report.clips import FILMS, UNREFINED
from physgen.report.html import KINDS, fitted, jpeg, template
from physgen.report.parameters import arrows, constraint_drawing, outlines, svg_points
from physgen.scene.scene import Scene
from physgen.simulate.trajectory import Trajectory

U8 = NDArray[np.uint8]

INLINE = 8 * 2**20
"""Bytes of a video that goes into the notebook; a larger one is linked."""


@dataclass(frozen=True)
class CellLimits:
    """Sizes of what a cell shows."""

    side: int = 720
    """px: the longer side of the photo, at most."""
    most_points: int = 400
    """Of one path."""
    still: float = 2.0
    """px: an object that moves less has no path."""


LIMITS = CellLimits()

LINES = ("#0072b2", "#d55e00", "#009e73", "#b0508f", "#e69f00", "#56b4e9", "#7f7f7f")
"""After Okabe and Ito: distinct for colour-blind eyes, and legible on white and on black."""


def html(shown: object) -> str:
    """Of a scene, a compiled scene, a world or a trajectory; its problems, where a scene has become wrong."""
    match shown:
        case Scene():
            try:
                return svg(shown)
            except InputError as error:  # its files may have changed since it was loaded
                return "".join(f"<p>{escape(str(problem))}</p>" for problem in error.problems)
        case Compiled():
            return _world_svg(shown.world)
        case World():
            return _world_svg(shown)
        case Trajectory():
            return _paths_svg(shown)
    raise TypeError(f"{type(shown).__name__} has no HTML view")


def svg(scene: Scene) -> str:
    """The photo with outlines, boundaries, forces, joints and fields, as a picture of its own; raises InputError.

    The photo is left out where objects are placed elsewhere at t = 0.
    """
    from physgen.pipeline.stages import compile, percepts

    maps = percepts(scene)
    world = compile(scene, maps).world
    return _world_svg(world, scene, None if maps is None or photo_poses(world) else maps.rgb)


def show(folder: str | Path) -> Clip:
    """The clip in a folder that `render` made, to be played in the cell, with its report's link. Raises InputError."""
    path = Path(folder)
    try:
        manifest = json.loads((path / "manifest.json").read_text(encoding="utf-8"))
        files, name = manifest["files"], str(manifest["scene"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        fix = "name one that render made, such as out/dominoes"
        raise InputError.of(str(path), "", "is no folder of a clip", fix) from error
    video = next((file for file in (*FILMS, *UNREFINED) if file in files and (path / file).is_file()), None)
    return Clip(path, name, video)


@dataclass(frozen=True)
class Clip:
    """What a run has left in its folder."""

    folder: Path
    name: str
    video: str | None
    """Name of its file."""

    def _repr_html_(self) -> str:
        """A player."""
        shown = "no video"
        if self.video is not None:
            source = self._source(self.folder / self.video)
            moving = self.video.endswith(".mp4")
            shown = f'<video src="{source}" controls loop muted width="640"></video>'
            shown = shown if moving else f'<img src="{source}" alt="" width="640">'
        report = self.folder / "report.html"
        link = f' · <a href="{_link(report)}">report</a>' if report.is_file() else ""
        return f"<figure>{shown}<figcaption><b>{escape(self.name)}</b>{link}</figcaption></figure>"

    def _source(self, path: Path) -> str:
        if path.stat().st_size > INLINE:
            return _link(path)
        return f"data:{KINDS[path.suffix]};base64," + base64.b64encode(path.read_bytes()).decode("ascii")


def _link(path: Path) -> str:
    """From where the notebook runs: that is as a rule where it lies."""
    return quote(Path(os.path.relpath(path)).as_posix())


def _world_svg(world: World, scene: Scene | None = None, photo: U8 | None = None) -> str:
    """Outlines, walls, velocities and forces, over the `photo` (H, W, 3) sRGB or on white."""
    title = "The world"
    pointers: list[dict[str, str]] = []
    held: dict[str, list[dict[str, object]]] = {"lines": [], "dots": [], "arrows": []}
    labels: dict[str, str] = {}
    if scene is not None:
        labels = {item.name: item.label for item in scene.objects}
        held, title = constraint_drawing(scene, world), f"The scene {scene.name}"
    for kind, tail, tip, about in arrows(world):
        path = f"M{svg_points(arrow(tail, tip, max(world.size) / 160))}Z"
        pointers.append({"kind": kind, "path": path, "title": about})
    text: str = template("scene.svg.j2").render(
        title=title,
        size=world.size,
        photo=None if photo is None else jpeg(fitted(photo, LIMITS.side), 84),
        walls=[
            {"name": wall.name, "chains": [svg_points(chain) for chain in wall.chains]}
            for wall in world.walls
        ],
        objects=outlines(world, labels),
        held=held,
        arrows=pointers,
        unit=round(max(world.size) / 400, 3),
    )
    return text


def _paths_svg(trajectory: Trajectory) -> str:
    """The paths of the objects that move; their names are titles."""
    poses = np.asarray(trajectory.poses)
    places = poses[..., :2].reshape(-1, 2) if poses.size else np.zeros((1, 2))
    low, high = places.min(axis=0), places.max(axis=0)
    margin = 0.06 * float(max(*(high - low), 20.0))
    box = [round(float(v), 1) for v in (*(low - margin), *(high - low + 2 * margin))]
    kept = np.linspace(0, len(poses) - 1, min(len(poses), LIMITS.most_points)).round().astype(int)
    paths: list[dict[str, str]] = []
    for k, name in enumerate(trajectory.names):
        points = poses[kept, k, :2]
        if len(points) and np.ptp(points, axis=0).max() > LIMITS.still:
            colour = LINES[len(paths) % len(LINES)]
            paths.append({"name": name, "colour": colour, "points": svg_points(points)})
    text: str = template("paths.svg.j2").render(box=box, paths=paths, unit=round(max(box[2:]) / 120, 3))
    return text
