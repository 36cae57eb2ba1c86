"""HTML for scenes, worlds, trajectories and clip folders in the cells of a notebook."""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import Any
from urllib.parse import quote

from physgen.compile.compile import Compiled
from physgen.compile.world import World
from physgen.problems import InputError
from physgen.report.clips import FILMS, UNREFINED
from physgen.report.drawing import paths_svg, scene_svg, world_svg
from physgen.report.html import template
from physgen.scene.scene import Scene, View
from physgen.simulate.trajectory import Trajectory

INLINE = 8 * 2**20
"""Bytes of a video that goes into the notebook; a larger one is linked."""
Facts = list[tuple[str, str]]


def html(shown: object) -> str:
    """Of a scene, a compiled scene, a world or a trajectory; its problems, where a scene has become wrong."""
    match shown:
        case Scene():
            return _scene(shown)
        case Compiled():
            return _world(shown.world)
        case World():
            return _world(shown)
        case Trajectory():
            return _trajectory(shown)
    raise TypeError(f"{type(shown).__name__} has no HTML view")


def svg(scene: Scene) -> str:
    """The photo with outlines, boundaries, forces, joints and fields, as a picture of its own; raises InputError."""
    from physgen.pipeline.stages import compile, percepts

    maps = percepts(scene)
    world = compile(scene, maps).world
    return scene_svg(scene, world, None if maps is None else maps.rgb)


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
    return Clip(path, name, video, manifest)


@dataclass(frozen=True)
class Clip:
    """What a run has left in its folder."""

    folder: Path
    name: str
    video: str | None
    """Name of its file."""
    manifest: Mapping[str, Any]

    def _repr_html_(self) -> str:
        """A player."""
        size = self.manifest.get("video", {}).get("size") or [0, 0]
        frames = len(self.manifest.get("frames") or self.manifest.get("unrefined", ()))
        facts = [f"{size[0]} × {size[1]} px", f"{frames} frame{'s' * (frames != 1)}"]
        facts += (
            [f"{len(warnings)} warning{'s' * (len(warnings) != 1)}"] if (warnings := self._warnings()) else []
        )
        return _rendered(
            "clip",
            name=self.name,
            size=size,
            source=None if self.video is None else self._source(self.folder / self.video),
            moving=str(self.video).endswith(".mp4"),
            report=_link(self.folder / "report.html") if (self.folder / "report.html").is_file() else None,
            facts=facts,
        )

    def _warnings(self) -> list[Any]:
        return list(self.manifest.get("warnings", ()))

    def _source(self, path: Path) -> str:
        if path.stat().st_size > INLINE:
            return _link(path)
        kind = {".mp4": "video/mp4", ".webp": "image/webp", ".gif": "image/gif", ".png": "image/png"}[
            path.suffix
        ]
        return f"data:{kind};base64," + base64.b64encode(path.read_bytes()).decode("ascii")


def _link(path: Path) -> str:
    """From where the notebook runs: that is as a rule where it lies."""
    return quote(Path(os.path.relpath(path)).as_posix())


def _scene(scene: Scene) -> str:
    try:
        picture, problems = svg(scene), []
    except InputError as error:  # its files may have changed since it was loaded
        picture, problems = "", [str(problem) for problem in error.problems]
    width, height = scene.size
    facts = [
        ("objects", str(len(scene.objects))),
        ("boundaries", str(len(scene.boundaries))),
        ("canvas", f"{width} × {height} px"),
        ("view", "from above" if scene.world.view is View.TOP else "from the side"),
        ("duration", f"{scene.world.duration:g} s"),
    ]
    if scene.variants:
        facts.append(("variants", ", ".join(scene.variants)))
    return _rendered(
        "scene", name=scene.name, picture=picture, facts=facts, problems=problems, wide=_wide(scene.size)
    )


def _world(world: World) -> str:
    gravity = hypot(*world.gravity.tolist())
    facts = [
        ("bodies", str(len(world.bodies))),
        ("walls", str(len(world.walls))),
        ("gravity", f"{gravity:g} px/s²"),
        ("engine", f"{world.steps_per_second:g} steps/s"),
        ("duration", f"{world.duration:g} s"),
    ]
    return _rendered(
        "scene", name="world", picture=world_svg(world), facts=facts, problems=[], wide=_wide(world.size)
    )


def _trajectory(trajectory: Trajectory) -> str:
    times, touches = trajectory.times, len(trajectory.contacts.touch_pairs)
    facts = [
        ("duration", f"{float(times[-1]):.4g} s" if len(times) else "0 s"),
        ("samples", f"{len(times):,}"),
        ("objects", f"{len(trajectory.names):,}"),
        ("contacts", f"{touches:,}"),
        ("engine", f"{trajectory.effort.steps:,} steps"),
        ("energy", f"balances to {100 * trajectory.imbalance():.2g} % of what flows"),
    ]
    picture, names = paths_svg(trajectory)
    return _rendered("trajectory", picture=picture, facts=facts, names=names)


def _wide(size: tuple[int, int]) -> int:
    """px of a picture in a cell: no taller than a screen."""
    return round(min(640, 480 * size[0] / size[1]))


def _rendered(kind: str, **data: Any) -> str:
    page: str = template("notebook.html.j2").render(kind=kind, **data)
    return page
