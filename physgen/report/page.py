"""The HTML report page of a clip, and the page of a scene that failed."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen import __version__
from physgen.compile.world import World, pair_table
from physgen.files import resource
from physgen.problems import Problem
from physgen.report.films import Film
from physgen.report.html import highlight_lines, jpeg, script_json, template
from physgen.report.parameters import COLUMNS, constraint_drawing, constraint_rows, edits, parameter_rows
from physgen.report.perception import Perception
from physgen.report.player import Data
from physgen.report.provenance import provenance
from physgen.report.record import RunRecord, versions
from physgen.report.refinement import RefinementStrip, refinement
from physgen.report.uncertainty import UncertaintySection, dimmed_photo
from physgen.scene.scene import Load, Play, Render, Scene, View

Array = NDArray[np.float64]
U8 = NDArray[np.uint8]

LONGEST_ARROW = 0.14
"""Of the canvas's diagonal."""
PHOTO = 90
"""Quality of its JPEG."""
MOST_LINES = 5000
"""Of a scene file that gets numbers."""
MOST_TOUCHES = 200
"""Rows of the table of contacts."""


def report_page(
    scene: Scene,
    world: World,
    record: RunRecord,
    first: U8,
    film: Film | None,
    scene_text: str,
    player: Data | None = None,
    seen: Perception | None = None,
    retouched: RefinementStrip | None = None,
    fan: UncertaintySection | None = None,
) -> str:
    """The HTML page. `first` is frame 0 `(H, W, 3)` sRGB, shown with outlines, boundaries and forces drawn on it.

    `player` is what `player_data` gives; without it, or without scripts, the page has that picture and the video.
    `seen` is what was perceived of the photo, `retouched` what refinement changed, `fan` what is told of draws.
    """
    width, height = scene.size
    page: str = template("report.html.j2").render(
        title=scene.name,
        size=(width, height),
        video_size=scene.video_size,
        frames=len(record.frames or record.unrefined),
        fps=scene.render.fps,
        duration=world.duration,
        film=film,
        refined=refinement(record.refine),
        photo=jpeg(first, PHOTO),
        view_box=f"-0.5 -0.5 {width} {height}",
        walls=_walls(scene, world),
        objects=[
            {
                "name": item.name,
                "label": item.label,
                "motion": item.motion.value,
                "path": " ".join(f"M{_points(ring + body.center)}Z" for ring in body.rings),
            }
            for item, body in zip(scene.objects, world.bodies, strict=True)
        ],
        columns=COLUMNS,
        parameters=parameter_rows(scene, world, record.variant),
        edits=edits(scene, record.overrides, record.variant),
        played=_played(scene.render),
        count=len(world.times),
        touch_count=0 if player is None else len(player["touches"]),
        touches=[] if player is None else _touches(player, world),
        data=None if player is None else script_json(player),
        script=_script(),
        arrows=_arrows(world),
        held=constraint_drawing(scene, world),
        holds=constraint_rows(scene),
        warnings=[str(warning["text"]) for warning in record.warnings],
        world=_world_facts(scene, world),
        engine=_engine(record),
        chaos=_chaos(record),
        combine=world.combine.value,
        pairs=pair_table(world),
        perception=seen,
        retouched=retouched,
        fan=fan,
        dimmed=None if fan is None else dimmed_photo(first),
        provenance=provenance(record, scene_text, _file(scene)),
        version=__version__,
    )
    return page


def failed_page(
    name: str, problems: Sequence[Problem], command: Sequence[str], scene_text: str, path: str = ""
) -> str:
    """The page of a scene that gave no clip: what is wrong with it, and its text as far as it could be read.

    `path` is the scene's file: lines of it that are at fault are marked.
    """
    mine = [p.place for p in problems if p.place.line and (not path or Path(p.place.file) == Path(path))]
    page: str = template("failed.html.j2").render(
        title=name,
        path=path,
        problems=[
            {
                "place": str(p.place._replace(file=Path(p.place.file).name))
                if p.place.line
                else str(p.place),
                "whole": str(p.place),
                "line": p.place.line if p.place in mine else 0,
                "path": p.path,
                "what": " ".join(filter(None, (p.found, p.expected))),
                "fix": p.fix,
            }
            for p in problems
        ],
        command=shlex.join(command),
        scene_text=scene_text,
        lines=highlight_lines(scene_text) if scene_text.count("\n") <= MOST_LINES else [],
        wrong={place.line for place in mine},
        versions=versions(),
    )
    return page


def _file(scene: Scene) -> str | None:
    """The scene's file as it was written; None where it cannot be read."""
    try:
        return scene.file_of(scene.place("")).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return None


PARTS = ("motion", "clock", "units", "touch", "balls", "scene", "layers", "quantities", "charts", "page")
"""Of the player's script, in the order in which they build on each other."""


@cache
def _script() -> str:
    parts = [resource("templates", "player", f"{part}.js").read_text(encoding="utf-8") for part in PARTS]
    return '(() => {\n"use strict";\n' + "\n".join(parts) + "})();"


def _points(points: Array) -> str:
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in points)


def _walls(scene: Scene, world: World) -> list[dict[str, Any]]:
    return [
        {
            "name": wall.name,
            "chains": [_points(chain) for chain in wall.chains],
            "friction": b.friction,
            "elasticity": b.elasticity,
        }
        for wall, b in zip(world.walls, scene.boundaries, strict=True)
    ]


def _arrows(world: World) -> list[dict[str, Any]]:
    """Velocities and forces, each kind to a scale of its own."""
    diagonal = float(np.hypot(*world.size))
    found: dict[str, list[tuple[Array, Array, str]]] = {"velocity": [], "force": []}
    for body in world.bodies:
        if body.velocity.any():
            title = f"{body.name}: {body.velocity[0]:g}, {body.velocity[1]:g} px/s"
            found["velocity"].append((body.center, body.velocity, title))
    for push in world.pushes:
        if push.load is Load.TORQUE:
            continue
        body = world.bodies[push.body]
        unit = "g·px/s" if push.load is Load.IMPULSE else "g·px/s²"
        title = f"{push.load.value} on {body.name}: {push.vector[0]:g}, {push.vector[1]:g} {unit} from {push.start:g} s"
        found["force"].append((body.center + push.at, push.vector, title))
    arrows = []
    for kind, rows in found.items():
        largest = max((float(np.hypot(*vector)) for _, vector, _ in rows), default=0.0)
        for start, vector, title in rows:
            if largest > 0:
                end = start + vector / largest * LONGEST_ARROW * diagonal
                x1, y1, x2, y2 = (round(float(v), 1) for v in (*start, *end))
                arrows.append({"kind": kind, "x1": x1, "y1": y1, "x2": x2, "y2": y2, "title": title})
    return arrows


def _touches(player: Data, world: World) -> list[dict[str, Any]]:
    """Rows of the table of contacts, the strongest where there are too many, by time."""
    names = [name for name, _ in world.surfaces]
    newton = player["scale"] and 1000 * player["scale"]
    strongest = sorted(player["touches"], key=lambda touch: -touch[4])[:MOST_TOUCHES]
    return [
        {
            "begin": begin,
            "pair": (names[first], names[second]),
            "lasts": None if end is None else f"{end - begin:.3f} s",
            "impulse": f"{given / newton:.3g} N·s" if newton else f"{given:.3g} g·px/s",
        }
        for first, second, begin, end, given in sorted(strongest, key=lambda touch: (touch[2], touch[:2]))
    ]


def _engine(record: RunRecord) -> list[str]:
    """What the engine did to be exact, in sentences."""
    effort = record.effort
    if not effort:
        return []
    said = [
        f"{effort['steps']:,} steps, up to {effort['iterations']} sweeps of the contact solver each; "
        f"{effort['impacts']:,} blows, one after the other."
    ]
    if effort["divided"]:
        said.append(
            f"{effort['divided']:,} steps were divided, into up to {effort['most_parts']} parts, so that nothing fast "
            "passes through anything and stiff springs swing truly."
        )
    said.append(f"Contacts that close more slowly than {effort['still']:.3g} px/s do not bounce.")
    said.append(f"The books of energy close to {100 * record.imbalance:.2g} % of what flows.")
    return said


def _chaos(record: RunRecord) -> dict[str, Any] | None:
    """The chaos report as rows of a table; None where it was not asked for."""
    if record.chaos is None:
        return None
    rows = [
        {
            "name": name,
            "parted": "stays" if found["parted_s"] is None else f"{found['parted_s']:.3f} s",
            "runs": [f"{run['distance_px']:.2g}" for run in found["runs"]],
        }
        for name, found in record.chaos["objects"].items()
    ]
    return {"verdict": record.chaos["verdict"], "runs": record.chaos["runs"], "rows": rows}


def _world_facts(scene: Scene, world: World) -> list[tuple[str, str, str]]:
    scale = world.pixels_per_meter
    gravity = float(np.hypot(*world.gravity))
    facts = [
        ("view", world.view.value, ""),
        ("scale", f"{scale:g} px/m", ""),
        ("gravity", f"{world.gravity[0]:g}, {world.gravity[1]:g} px/s²", f"{gravity / scale:.3g} m/s²"),
        (
            "canvas",
            f"{world.size[0]} × {world.size[1]} px",
            f"{world.size[0] / scale:.3g} × {world.size[1] / scale:.3g} m",
        ),
        ("duration", f"{world.duration:g} s", ""),
        ("video", f"{scene.video_size[0]} × {scene.video_size[1]} px", _played(scene.render)),
        ("engine", f"{world.steps_per_second:g} steps/s", ""),
        ("coefficients", world.combine.value, ""),
    ]
    if world.view is View.TOP:
        facts.append(("table friction", f"{scene.world.table_friction:g}", ""))
    return facts


def _played(render: Render) -> str:
    """How the clip differs from the motion as it is, and from all of the photo; nothing where it does not."""
    told = [
        f"{render.slow:g} times slower" if render.slow != 1 else "",
        render.play.value if render.play is not Play.FORWARD else "",
        "through a camera" if render.camera else "",
    ]
    return ", ".join(part for part in told if part)
