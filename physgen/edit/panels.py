"""The scene, its problems and its to-do list as plain data for the panels of the page."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePath
from typing import Any

from physgen.compile.compile import Compiled
from physgen.problems import Problem
from physgen.scene.provenance import Provenance, source
from physgen.scene.scene import Scene, Solid

Data = dict[str, Any]

_OBJECT = re.compile(r"(?:^|\.)objects\.([\w-]+)")
SECTIONS = ("world", "objects", "boundaries", "forces", "joints", "fields", "light", "render", "refine")


def problem_data(problem: Problem, file: str) -> Data:
    """A problem for the page: `line` is that of the text in the editor, null where it stands elsewhere.

    `object` is the one in whose entry it stands, if any.
    """
    inside = _OBJECT.search(problem.path)
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
        "object": inside[1] if inside else None,
    }


def scene_data(scene: Scene) -> Data:
    """What the file means, with defaults, as a file would have it: px, s, g, degrees."""
    found: Data = {name: scene.document.get(name) for name in SECTIONS}
    found["size"] = list(scene.size)
    found["image"] = None if scene.image is None else PurePath(scene.image).name
    found["written"] = sorted(scene.places)
    return found


def derived_data(scene: Scene, compiled: Compiled) -> Data:
    """What follows from it: centres, masses and moments, as the engine has them."""
    world = compiled.world
    objects: dict[str, Data] = {}
    for item, body in zip(scene.objects, world.bodies, strict=True):
        objects[item.name] = {
            "centre": body.center.tolist(),
            "mass": body.mass,
            "moment": body.moment,
            "radius": body.radius,
            "reach": body.reach,
            "ball": body.solid is Solid.SPHERE and body.radius is not None,
            "masked": item.mask is not None,
        }
    return {
        "objects": objects,
        "pixels_per_meter": world.pixels_per_meter,
        "scaled": "world.pixels_per_meter" in scene.places,
    }


SURE = 0.6
"""Confidence from which the user is not asked."""
MAX_ROWS = 300


def todo(scene: Scene | None, problems: Sequence[Data]) -> list[Data]:
    """Rows as the page shows them: `kind`, `object`, `path`, `line`, `text`, `fix`, `ops`; None: the user decides."""
    rows = [_row("error", p, p["message"], p["fix"]) for p in problems if p["severity"] == "error"]
    if scene is not None:
        rows += [row for _, row in sorted(_unsure(scene), key=lambda doubt: doubt[0])]
    odd = (p for p in problems if p["severity"] != "error")
    rows += [_row("lint", p, p["message"], p["fix"]) for p in odd]
    return rows[:MAX_ROWS]


def _row(kind: str, at: Mapping[str, Any], text: str, fix: str, ops: Sequence[Data] | None = None) -> Data:
    place = {key: at.get(key) for key in ("object", "path", "line")}
    return {"kind": kind, **place, "text": text, "fix": fix, "ops": ops}


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
        if sure is None or sure >= SURE:
            continue
        if provenance.of(value, guess, written_at=f"{where}.from").kind == "guess":
            found.append((sure, key, f"{key or path[-1]} ({guess.rpartition(' ')[0]}, {sure:.0%})"))
    found.sort()
    if found:
        least, first, _ = found[0]
        value = f"{where}.{first}" if first else where
        at = {"object": name, "path": value, "line": _line(scene, value) or _line(scene, where)}
        keys = [[]] if len(found) == len(sources) else [[key] for _, key, _ in found]
        ops: list[Data] = [{"unset": [*path, "from", *key]} for key in keys]
        yield least, _row("doubt", at, "; ".join(what for *_, what in found), "it is right as it is", ops)


def _line(scene: Scene, path: str) -> int | None:
    place = scene.places.get(path)
    return place.line if place is not None and place.line and place.file == scene.place("").file else None
