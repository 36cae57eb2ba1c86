"""A scene, its text and its problems -> what a person should look at: errors, then what is doubtful, then what is odd.

Each row says what is the matter, at which object and line, and, where that is plain, the operations that settle it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from physgen.compile.assemble import Compiled
from physgen.compile.masks import fill
from physgen.edit.told import steps
from physgen.problems import InputError
from physgen.scene.document import read
from physgen.scene.model import Scene
from physgen.scene.node import Source, plain
from physgen.scene.said import Said, source

Data = dict[str, Any]

SURE = 0.6
"""From which on nobody is asked."""
COVERED = 0.5
"""Share of something doubtful that objects cover by now: then it is taken in already."""
MOST = 300
"""Rows."""
_MAYBE = re.compile(r"^ *# ?(?P<name>maybe-\d+): (?P<value>\{.*\})\s*$")
_FASTER = re.compile(r"write world\.steps_per_second: (\d+)")


def todo(text: str, scene: Scene | None, compiled: Compiled | None, problems: Sequence[Data]) -> list[Data]:
    """Rows as the page shows them: `kind`, `object`, `path`, `line`, `text`, `fix`, `ops`, `mask`.

    `mask` is a correction of masks in place of `ops`; where both are None a person decides what to do.
    """
    rows = [_row("error", p, p["message"], p["fix"]) for p in problems if p["severity"] == "error"]
    if scene is not None and compiled is not None:
        rows += [row for _, row in sorted(_unsure(scene), key=lambda doubt: doubt[0])]
        rows += [row for _, row in sorted(_maybe(text, scene, compiled), key=lambda doubt: -doubt[0])]
    odd = (p for p in problems if p["severity"] != "error")
    rows += [_row("lint", p, p["message"], p["fix"], _settles(p, scene)) for p in odd]
    return rows[:MOST]


def _row(
    kind: str,
    at: Mapping[str, Any],
    text: str,
    fix: str,
    ops: list[Data] | None = None,
    mask: Data | None = None,
) -> Data:
    return {
        "kind": kind,
        "object": at.get("object"),
        "path": at.get("path"),
        "line": at.get("line"),
        "text": text,
        "fix": fix,
        "ops": ops,
        "mask": mask,
    }


def _unsure(scene: Scene) -> Iterator[tuple[float, Data]]:
    """Guesses of single things that nobody has set since, by how sure they are."""
    said = Said(scene, None)
    for item in scene.objects:
        yield from _of_one(scene, said, ("objects", item.name), item.provenance, item.name)
    document = scene.document.get("boundaries") or {}
    for wall in scene.boundaries:
        told = document.get(wall.name, {}).get("from")
        if isinstance(told, str):
            yield from _of_one(scene, said, ("boundaries", wall.name), {"": told}, None)
    if scene.light is not None and scene.light.provenance:
        yield from _of_one(scene, said, ("light",), {"": scene.light.provenance}, None)


def _of_one(
    scene: Scene, said: Said, path: Sequence[str], told: Mapping[str, str], name: str | None
) -> Iterator[tuple[float, Data]]:
    where = ".".join(path)
    found: list[tuple[float, str, str]] = []
    for key, who in told.items():
        sure = source(who).sure
        value = f"{where}.{key}" if key else where
        if sure is None or sure >= SURE or said.of(value, who, told=f"{where}.from").kind != "guess":
            continue
        found.append((sure, key, f"{who.rpartition(' ')[0]}, {sure:.0%}"))
    if not found:
        return
    found.sort()
    masks = [one for one in found if one[1] == "mask"]
    for group in (masks, [one for one in found if one[1] != "mask"]):
        if not group:
            continue
        subject = path[-1] if name is None else ""
        what = "; ".join(f"{key or subject} ({who})" for _, key, who in group)
        first = group[0][1]
        value = f"{where}.{first}" if first else where
        at = {"object": name, "path": value, "line": _line(scene, value) or _line(scene, where)}
        ops: list[Data] = [{"unset": [*path, "from", key] if key else [*path, "from"]} for _, key, _ in group]
        if len(group) == len(told):
            ops = [{"unset": [*path, "from"]}]
        yield group[0][0], _row("doubt", at, what, "it is right as it is", ops)


def _maybe(text: str, scene: Scene, compiled: Compiled) -> Iterator[tuple[float, Data]]:
    """What perception left as a comment, for a person to switch on."""
    names = {item.name for item in scene.objects}
    for number, line in enumerate(text.split("\n"), 1):
        match = _MAYBE.match(line)
        if match is None or match["name"] in names:
            continue
        try:
            value = plain(read(match["value"], Source("", scene.folder), counted=False))
            points = [(float(x), float(y)) for x, y in value["mask"]["polygon"]]
            who = str(value.get("from", {}).get("mask", ""))
        except (InputError, KeyError, TypeError, ValueError):
            continue  # a person's own remark
        there = fill(tuple(points), scene.size)
        if not there.any() or np.count_nonzero(compiled.labels[there]) > COVERED * np.count_nonzero(there):
            continue
        sure = source(who).sure
        at = {"object": None, "path": f"objects.{match['name']}", "line": number}
        told = f"perhaps an object, too ({sure:.0%} sure)" if sure is not None else "perhaps an object, too"
        mask = {"kind": "polygon", "polygon": [list(point) for point in points], "object": None}
        yield (sure if sure is not None else SURE), _row("doubt", at, told, "add it", None, mask)


def _settles(problem: Data, scene: Scene | None) -> list[Data] | None:
    """Operations that do what a lint's fix says, where it says one thing."""
    path, fix = steps(problem["path"]), problem["fix"]
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
