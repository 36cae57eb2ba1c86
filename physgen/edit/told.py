"""Scene, world and problems -> what the panels of the page show, as plain data."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from physgen.compile.assemble import Compiled
from physgen.outline.outline import Disc
from physgen.problems import Problem
from physgen.scene.model import MaskId, Scene, Solid

Data = dict[str, Any]

SECTIONS = ("world", "objects", "boundaries", "forces", "joints", "fields", "light", "render", "refine")
_STEP = re.compile(r"([^.\[\]]+)|\[(\d+)\]")


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


def steps(path: str) -> list[str | int]:
    """A dotted path's parts.

    >>> steps("forces[0].at[1]")
    ['forces', 0, 'at', 1]
    """
    return [int(index) if index else name for name, index in _STEP.findall(path)]


def meant(path: str, objects: Sequence[str], document: Mapping[str, Any]) -> str | None:
    """The object that a path is about: its own, or the one that a force or joint acts on; one of `objects`, if any."""
    parts = steps(path)
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
        edited = steps(str(parts[2])) if "." in str(parts[2]) else parts[2:]
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
