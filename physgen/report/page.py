"""The HTML report page of a clip, and the page of a failed scene. All external text is
escaped.
"""

from __future__ import annotations

import hashlib
import platform
import shlex
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from physgen import __version__
from physgen.compile.world import World, pair_table
from physgen.export.video_formats import U8
from physgen.files import resource
from physgen.report.assumptions import assumptions, is_scaled
from physgen.report.films import Film
from physgen.report.html import fit_to_side, script_json, template, webp
from physgen.report.links import document_links
from physgen.report.parameters import (
    BOUNDARY,
    METRIC_DIGITS,
    arrows,
    constraint_rows,
    differing,
    line,
    merge_equal_rows,
    outlines,
    parameter_rows,
    shared_cells,
    svg_points,
    units_of,
)
from physgen.report.perception import Comparison, Perception
from physgen.report.player import Data
from physgen.report.record import REFINING, RunRecord, versions
from physgen.scene.scene import Play, Render, Scene, View
from physgen.text import rounded, value_text

ELSEWHERE = {"failed", *REFINING}
"""Keys of `RunRecord.refine` with other places on the page."""


@dataclass(frozen=True)
class PageLimits:
    """Sizes of the page's parts."""

    photo_quality: int = 90
    """Quality of WebP."""
    photo_side: int = 16_383
    """Maximum side, px, of the WebP format."""
    most_contacts: int = 200
    """Number of rows in the table of contacts, the strongest."""


LIMITS = PageLimits()

SCRIPTS = (
    "motion",
    "clock",
    "units",
    "touch",
    "balls",
    "scene",
    "layers",
    "quantities",
    "charts",
    "select",
    "compare",
    "page",
)
"""Scripts of the player, in the order of their dependencies."""


@dataclass(frozen=True)
class PageParts:
    """Optional sections of the page."""

    player: Data | None = None
    """Result of `player_data`. Without it, or without scripts, the page has a picture
    and the video.
    """
    perception: Perception | None = None
    refinement: Comparison | None = None
    """A frame before and after refinement."""
    uncertainty: dict[str, Any] | None = None
    """Variables of `fan.html.j2`."""
    sound: dict[str, Any] | None = None
    """Variables of `sound.html.j2`."""
    home: Path | None = None
    """The folder of the page, for links to the documentation."""


def _scene_file_text(scene: Scene) -> str | None:
    """Return the text of the scene file; None if it cannot be read."""
    # Places contain the user's own file names.
    path = scene.folder / Path(scene.place("").file).name
    with suppress(OSError, ValueError):
        return path.read_text(encoding="utf-8")
    return None


def _walls(scene: Scene, world: World) -> list[dict[str, Any]]:
    """Return the boundaries that the page draws."""
    walls = []
    for wall, item in zip(world.walls, scene.boundaries, strict=True):
        row = {
            "name": wall.name,
            "chains": list(map(svg_points, wall.chains)),
            "friction": item.friction,
            "elasticity": item.elasticity,
        }
        walls.append(row)
    return walls


def _player_values(player: Data | None, world: World) -> dict[str, Any]:
    """Return the values of the page about the player and the contacts."""
    if player is None:
        return {
            "touch_count": 0,
            "impact_count": 0,
            "touches": [],
            "data": None,
            "data_camera": False,
        }
    return {
        "touch_count": len(player["touches"]),
        "impact_count": len(player["impacts"]),
        "touches": _contacts(player, world),
        "data": script_json(player),
        "data_camera": player["camera"] is not None,
    }


def report_page(
    scene: Scene,
    world: World,
    record: RunRecord,
    first: U8,
    film: Film | None,
    scene_text: str,
    parts: PageParts,
) -> str:
    """Return the HTML. `first` is frame 0 (H, W, 3) sRGB; the page draws outlines,
    boundaries and forces over it.

    `scene_text` is the scene file with all defaults.
    """
    width, height = scene.size
    page: str = template("report.html.j2").render(
        title=scene.title or scene.name,
        size=(width, height),
        video_size=scene.video_size,
        frames=len(record.frames or record.unrefined_frames),
        hold=record.video.get("hold", 0),
        fps=scene.render.fps,
        duration=world.duration,
        film=film,
        refined=_refinement(record.refine),
        photo=webp(fit_to_side(first, LIMITS.photo_side), LIMITS.photo_quality),
        view_box=f"-0.5 -0.5 {width} {height}",
        walls=_walls(scene, world),
        objects=outlines(world, {item.name: item.label for item in scene.objects}),
        assumptions=assumptions(scene, world),
        source=quote(record.source),
        documents=document_links(parts.home) if parts.home is not None else [],
        columns=units_of(scene),
        **_parameters(scene, world, record.variant),
        edits=record.overrides,
        played=_describe_playback(scene.render),
        count=len(world.times),
        **_player_values(parts.player, world),
        script=_script(),
        arrows=[line(*arrow) for arrow in arrows(world)],
        holds=constraint_rows(scene),
        warnings=[str(warning["text"]) for warning in record.warnings],
        world=_world_facts(scene, world),
        engine=_engine(record),
        combine=world.combine.value,
        pairs=pair_table(world),
        perception=parts.perception,
        retouched=parts.refinement,
        fan=parts.uncertainty,
        sound=parts.sound,
        provenance=provenance(record, scene_text, _scene_file_text(scene)),
        version=__version__,
    )
    return page


def _parameters(scene: Scene, world: World, variant: str | None) -> dict[str, Any]:
    """Return the common parameters of all objects, and rows of differences. Boundaries
    have their own rows.
    """
    rows = parameter_rows(scene, world, variant)
    # Values common to all objects are shown once, and the rows show the differences.
    shared = shared_cells(rows)
    rows = merge_equal_rows(differing(rows, shared))
    return {
        "shared": shared,
        "parameters": [row for row in rows if row.kind != BOUNDARY],
        "boundaries": [row for row in rows if row.kind == BOUNDARY],
    }


@cache
def _script() -> str:
    parts = []
    for name in SCRIPTS:
        parts.append(
            resource("templates", "player", f"{name}.js").read_text(encoding="utf-8")
        )
    return '(() => {\n"use strict";\n' + "\n".join(parts) + "})();"


def _contacts(player: Data, world: World) -> list[dict[str, Any]]:
    """Return rows of the table of contacts, by time."""
    names = [name for name, _ in world.surfaces]
    # g·px/s to N·s; without a scale there are no newtons.
    newton = player["scale"] and 1000 * player["scale"]
    strongest = sorted(player["touches"], key=lambda touch: -touch[4])[
        : LIMITS.most_contacts
    ]
    return [
        {
            "begin": begin,
            "pair": (names[first], names[second]),
            "lasts": None if end is None else f"{end - begin:.3f} s",
            "impulse": f"{rounded(impulses / newton, METRIC_DIGITS)} N·s"
            if newton
            else f"{rounded(impulses)} g·px/s",
        }
        for first, second, begin, end, impulses in sorted(
            strongest, key=lambda touch: (touch[2], touch[:2])
        )
    ]


def _engine(record: RunRecord) -> list[str]:
    """Return sentences about the accuracy of the simulation."""
    effort = record.effort
    if not effort:
        return []
    lines = [
        f"{effort['steps']:,} steps, up to {effort['iterations']} sweeps of the contact solver each; impacts are "
        "resolved one after the other."
    ]
    if effort["divided"]:
        lines.append(
            f"{effort['divided']:,} steps were divided, into up to {effort['most_parts']} parts, so that fast objects "
            "do not pass through others and stiff springs oscillate correctly."
        )
    lines.append(
        f"Contacts that close more slowly than {rounded(effort['still'])} px/s do not bounce."
    )
    lines.append(
        f"Energy balance error: {rounded(100 * record.imbalance, 2)} % of the energy that flows."
    )
    return lines


def _world_facts(scene: Scene, world: World) -> list[tuple[str, str, str]]:
    """Return name, value and second value of each fact. The second value is in px, or
    in metres for a scene without a scale.
    """
    scale, (width, high) = world.pixels_per_meter, world.size
    gravity = float(np.hypot(*world.gravity))
    gravity_pair = (
        f"{rounded(gravity / scale)} m/s²",
        f"{value_text(world.gravity)} px/s²",
    )
    in_meters = [rounded(side / scale, METRIC_DIGITS) for side in world.size]
    canvas_pair = f"{' × '.join(in_meters)} m", f"{width} × {high} px"
    # Without a scale, metres are only a convention: px come first.
    if not is_scaled(scene):
        gravity_pair, canvas_pair = gravity_pair[::-1], canvas_pair[::-1]
    facts = [
        ("view", world.view.value, ""),
        ("canvas", *canvas_pair),
        ("scale", f"{rounded(scale, 4)} px/m", ""),
        ("gravity", *gravity_pair),
        ("duration", f"{value_text(world.duration)} s", ""),
        (
            "video",
            f"{scene.video_size[0]} × {scene.video_size[1]} px",
            _describe_playback(scene.render),
        ),
        ("engine", f"{value_text(world.steps_per_second)} steps/s", ""),
        ("coefficients", world.combine.value, ""),
    ]
    if world.view is View.TOP:
        facts.append(("table friction", value_text(scene.world.table_friction), ""))
    return facts


def _describe_playback(render: Render) -> str:
    """Return the differences of the clip from the motion and the whole photo, in words.

    Return "" without differences.
    """
    parts = [
        _speed(render.slow),
        render.play.value if render.play is not Play.FORWARD else "",
        "through a camera" if render.camera else "",
    ]
    return ", ".join(filter(None, parts))


def _speed(slow: float) -> str:
    """Return the speed of a clip in words; `slow` is the factor of slow motion."""
    if slow == 1:
        return ""
    if slow == 2:
        return "at half speed"
    return f"slowed down {value_text(slow)}x"


def provenance(
    record: RunRecord, resolved_text: str, written_text: str | None = None
) -> dict[str, Any]:
    """Return all facts for reproducing a run, for `provenance.html.j2`.

    `resolved_text` is the scene with all defaults, `written_text` the file itself, if readable.
    `frames` is one hash of all frames: equal clips have equal hashes.
    """
    if written_text is None:
        texts = []
    else:
        texts = [_source_text("Scene file", written_text)]
    separator = ","
    if texts:
        separator = ""
    texts.append(
        _source_text(
            f"Scene file{separator} with every default filled in", resolved_text
        )
    )
    facts = [("platform", f"{platform.system()}, {platform.machine()}")]
    # The seed of the refinement has no meaning without one.
    seeds = {}
    for name, seed in record.seeds.items():
        if record.refine or name != "refine":
            seeds[name] = seed
    facts += [(f"seed of {name}", str(seed)) for name, seed in seeds.items()]
    facts += [] if record.variant is None else [("variant", record.variant)]
    digest = hashlib.sha256("\n".join(record.frames).encode()).hexdigest()
    return {
        "command": shlex.join(record.clip_command or record.command),
        "run": shlex.join(record.command)
        if record.clip_command not in ([], record.command)
        else "",
        "texts": texts,
        "facts": facts,
        "edits": record.overrides,
        "versions": versions(record.refine),
        "hashes": list(record.inputs.items()),
        "frames": digest if record.frames else "",
    }


def _source_text(title: str, text: str) -> dict[str, Any]:
    """Return a text for a block with a copy button."""
    return {
        "title": title,
        "text": text,
        "lines": text.count("\n") + (not text.endswith("\n")),
    }


def _refinement(note: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Return `RunRecord.refine` for the page: `failed`, the lines of a message, and
    `facts`, names and values of the settings.
    """
    if note is None:
        return None
    rows = []
    for name, value in note.items():
        if name not in ELSEWHERE:
            rows.append((name.replace("_", " "), value_text(value)))
    return {
        "failed": str(note.get("failed", "")).splitlines(),
        "facts": [(name, value) for name, value in rows if value],
    }
