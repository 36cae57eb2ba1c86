"""The scene, its problems and its to-do list as plain data for the panels of the page."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from physgen.compile.compile import Compiled
from physgen.compile.shapes import fill_polygon
from physgen.geometry.polygon import Disc
from physgen.problems import InputError, Problem
from physgen.scene.document import Source, plain, read
from physgen.scene.overlay import parse_key
from physgen.scene.provenance import Provenance, source
from physgen.scene.scene import MaskId, Scene, Solid

Data = dict[str, Any]

SECTIONS = ("world", "objects", "boundaries", "forces", "joints", "fields", "light", "render", "refine")


def problem_data(
    problem: Problem, file: str, objects: Sequence[str] = (), document: Mapping[str, Any] | None = None
) -> Data:
    """A problem for the page: `line` is that of the text in the editor, null where it stands elsewhere.

    `object` is the one that is meant, of `objects`; null where it is none or many.
    """
    here = problem.place.file == file and problem.place.line > 0
    return {
        "severity": problem.severity.value,
        "file": None if here else problem.place.file,
        "line": problem.place.line if here else None,
        "column": problem.place.column if here else None,
        "path": problem.path,
        "found": problem.found,
        "expected": problem.expected,
        "fix": problem.fix,
        "message": " ".join(part for part in (problem.found, problem.expected) if part),
        "object": meant(problem.path, objects, document or {}),
    }


def meant(path: str, objects: Sequence[str], document: Mapping[str, Any]) -> str | None:
    """The object that a path is about: its own, or the one that a force or joint acts on; one of `objects`, if any."""
    parts = parse_key(path) or ()
    if len(parts) < 2:
        return None
    section, which = parts[:2]
    name: Any = None
    if section == "objects":
        name = which
    elif section == "forces" and isinstance(which, int):
        name = _within(document, "forces", which, "object")
    elif section == "joints":
        name = _within(document, "joints", which, "objects", 0)
    elif section == "variants" and len(parts) > 3:
        edited = (parse_key(str(parts[2])) or ()) if "." in str(parts[2]) else parts[2:]
        name = edited[1] if len(edited) > 1 and edited[0] == "objects" else None
    return name if name in objects or (not objects and isinstance(name, str)) else None


def _within(value: Any, *path: str | int) -> Any:
    """What stands at a path of data that may be anything; None where nothing does."""
    for key in path:
        named = isinstance(value, Mapping) and key in value
        if not named and not (isinstance(value, list) and isinstance(key, int) and key < len(value)):
            return None
        value = value[key]
    return value


def scene_data(scene: Scene) -> Data:
    """What the file means, with defaults, as a file would have it: px, s, g, degrees."""
    found: Data = {name: scene.document.get(name) for name in SECTIONS}
    found["size"] = list(scene.size)
    found["image"] = None if scene.image is None else PurePath(scene.image).name
    found["written"] = sorted(scene.places)
    return found


def derived_data(scene: Scene, compiled: Compiled) -> Data:
    """What follows from it: centres, masses, moments and outlines, as the engine has them."""
    world = compiled.world
    meter = world.pixels_per_meter
    objects: dict[str, Data] = {}
    for k, (item, body) in enumerate(zip(scene.objects, world.bodies, strict=True)):
        outline = compiled.outlines[k]
        rings = [] if isinstance(outline, Disc) else [_points(ring.outer) for ring in outline.rings]
        ring = max(rings, key=len, default=None) or _points(body.rings[0] + body.center)
        objects[item.name] = {
            "centre": body.center.tolist(),
            "mass": body.mass,
            "moment": body.moment,
            "radius": body.radius,
            "ring": ring,
            "rings": rings or [ring],
            "reach": body.reach,
            "solid": body.solid.value,
            "ball": body.solid is Solid.SPHERE and body.radius is not None,
            "mask": item.mask.id if isinstance(item.mask, MaskId) else None,
            "masked": item.mask is not None,
            "id": k + 1,
            "mass_kg": body.mass / 1000,
            "speed_si": float(np.hypot(*body.velocity)) / meter,
            "velocity_si": (body.velocity / meter).tolist(),
            "moment_si": body.moment / 1000 / meter**2,
        }
    return {
        "objects": objects,
        "pixels_per_meter": meter,
        "scaled": "world.pixels_per_meter" in scene.places,
        "view": world.view.value,
        "gravity_si": (world.gravity / meter).tolist(),
        "boundaries": {wall.name: [_points(chain) for chain in wall.chains] for wall in world.walls},
        "duration": world.duration,
    }


def _points(values: Any) -> list[list[float]]:
    return [[round(x, 3), round(y, 3)] for x, y in values.tolist()]


SURE = 0.6
"""Confidence from which the user is not asked."""
COVERED = 0.5
"""Share of a possible object that others cover, from which it counts as added."""
MAX_ROWS = 300
_MAYBE = re.compile(r"^ *# ?(?P<name>maybe-\d+): (?P<value>\{.*\})\s*$")
_FASTER = re.compile(r"write world\.steps_per_second: (\d+)")


def todo(text: str, scene: Scene | None, compiled: Compiled | None, problems: Sequence[Data]) -> list[Data]:
    """Rows as the page shows them: `kind`, `object`, `path`, `line`, `text`, `fix`, `ops`, `mask`.

    `mask` is a correction of masks in place of `ops`; where both are None the user decides.
    """
    rows = [_row("error", p, p["message"], p["fix"]) for p in problems if p["severity"] == "error"]
    if scene is not None and compiled is not None:
        rows += [row for _, row in sorted(_unsure(scene), key=lambda doubt: doubt[0])]
        rows += [row for _, row in sorted(_maybe(text, scene, compiled), key=lambda doubt: -doubt[0])]
    odd = (p for p in problems if p["severity"] != "error")
    rows += [_row("lint", p, p["message"], p["fix"], _settles(p, scene)) for p in odd]
    return rows[:MAX_ROWS]


def _row(
    kind: str,
    at: Mapping[str, Any],
    text: str,
    fix: str,
    ops: list[Data] | None = None,
    mask: Data | None = None,
) -> Data:
    place = {key: at.get(key) for key in ("object", "path", "line")}
    return {"kind": kind, **place, "text": text, "fix": fix, "ops": ops, "mask": mask}


def _unsure(scene: Scene) -> Iterator[tuple[float, Data]]:
    """Guesses about objects and boundaries that no user has confirmed, with their confidence."""
    provenance = Provenance(scene, None)
    for item in scene.objects:
        yield from _of_one(scene, provenance, ("objects", item.name), item.provenance, item.name)
    document = scene.document.get("boundaries") or {}
    for wall in scene.boundaries:
        guess = document.get(wall.name, {}).get("from")
        if isinstance(guess, str):
            yield from _of_one(scene, provenance, ("boundaries", wall.name), {"": guess}, None)
    if scene.light is not None and scene.light.provenance:
        yield from _of_one(scene, provenance, ("light",), {"": scene.light.provenance}, None)


def _of_one(
    scene: Scene, provenance: Provenance, path: Sequence[str], sources: Mapping[str, str], name: str | None
) -> Iterator[tuple[float, Data]]:
    where = ".".join(path)
    found: list[tuple[float, str, str]] = []
    for key, guess in sources.items():
        sure = source(guess).sure
        value = f"{where}.{key}" if key else where
        place = f"{where}.from"
        if sure is None or sure >= SURE or provenance.of(value, guess, written_at=place).kind != "guess":
            continue
        found.append((sure, key, f"{guess.rpartition(' ')[0]}, {sure:.0%}"))
    found.sort()
    subject = path[-1] if name is None else ""
    for of_mask in (True, False):
        group = [one for one in found if (one[1] == "mask") is of_mask]
        if not group:
            continue
        what = "; ".join(f"{key or subject} ({guess})" for _, key, guess in group)
        first = group[0][1]
        value = f"{where}.{first}" if first else where
        at = {"object": name, "path": value, "line": _line(scene, value) or _line(scene, where)}
        ops: list[Data] = [{"unset": [*path, "from", key] if key else [*path, "from"]} for _, key, _ in group]
        if len(group) == len(sources):
            ops = [{"unset": [*path, "from"]}]
        yield group[0][0], _row("doubt", at, what, "it is right as it is", ops)


def _maybe(text: str, scene: Scene, compiled: Compiled) -> Iterator[tuple[float, Data]]:
    """Objects that perception wrote as comments, which the user may add."""
    names = {item.name for item in scene.objects}
    for number, line in enumerate(text.split("\n"), 1):
        match = _MAYBE.match(line)
        if match is None or match["name"] in names:
            continue
        try:
            value = plain(read(match["value"], Source("", scene.folder), counted=False))
            points = [(float(x), float(y)) for x, y in value["mask"]["polygon"]]
            guess = str(value.get("from", {}).get("mask", ""))
        except (InputError, KeyError, TypeError, ValueError):
            continue  # the user's own comment
        there = fill_polygon(tuple(points), scene.size)
        if not there.any() or np.count_nonzero(compiled.labels[there]) > COVERED * np.count_nonzero(there):
            continue
        sure = source(guess).sure
        at = {"object": None, "path": f"objects.{match['name']}", "line": number}
        words = f"perhaps an object, too ({sure:.0%} sure)" if sure is not None else "perhaps an object, too"
        mask = {"kind": "polygon", "polygon": [list(point) for point in points], "object": None}
        yield (sure if sure is not None else SURE), _row("doubt", at, words, "add it", None, mask)


def _settles(problem: Data, scene: Scene | None) -> list[Data] | None:
    """Operations that do what a lint's fix says, where that is plain."""
    path, fix = list(parse_key(problem["path"]) or ()), problem["fix"]
    if scene is None or not path:
        return None
    written = problem["path"] in scene.places
    if fix.endswith("motion: static") and path[0] == "objects":
        return [{"set": [*path[:2], "motion"], "value": "static"}]
    if fix.startswith("take it out") and written:
        return [{"unset": path}]
    if fix.startswith("write shape: auto") and path[0] == "objects":
        return [{"set": [*path[:2], "shape"], "value": "auto"}]
    if (faster := _FASTER.search(fix)) is not None:
        return [{"set": ["world", "steps_per_second"], "value": int(faster[1])}]
    return None


def _line(scene: Scene, path: str) -> int | None:
    place = scene.places.get(path)
    return place.line if place is not None and place.line and place.file == scene.place("").file else None
