"""Data of the editor's page: problems, values and open questions of a scene."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import cv2
import numpy as np

from physgen.compile.compile import CompiledScene
from physgen.maps import Percepts
from physgen.problems import Problem
from physgen.report.perception import (
    doubt_text,
    doubtful_regions,
    written_suitability,
)
from physgen.scene.files import RECORD, read_record
from physgen.scene.provenance import Provenance, source
from physgen.scene.scene import Scene, Solid

Data = dict[str, Any]

_OBJECT = re.compile(r"(?:^|\.)objects\.([\w-]+)")
SECTIONS = (
    "title",
    "world",
    "objects",
    "boundaries",
    "forces",
    "joints",
    "fields",
    "light",
    "render",
    "refine",
)


def problem_data(problem: Problem, file: str) -> Data:
    """Return a problem for the page.

    `line` is that of the text in the editor, null for a problem in another file.
    `object` is the object with the problem in its entry, if any.
    """
    object_match = _OBJECT.search(problem.path)
    is_in_editor = problem.place.file == file and problem.place.line > 0
    variant_path = ""
    if problem.variant:
        variant_path = f"variant {problem.variant}: {problem.path}"
    parts = (variant_path, problem.found, problem.expected)
    return problem.as_dict() | {
        "file": None if is_in_editor else problem.place.file,
        "line": problem.place.line if is_in_editor else None,
        "column": problem.place.column if is_in_editor else None,
        "message": " ".join(part for part in parts if part),
        "object": object_match[1] if object_match else None,
    }


def scene_data(scene: Scene) -> Data:
    """Return the content of the file with defaults, in units of the file: px, s, g,
    degrees.
    """
    data: Data = {name: scene.document.get(name) for name in SECTIONS}
    data["size"] = list(scene.size)
    if scene.image is None:
        data["image"] = None
    else:
        data["image"] = PurePath(scene.image).name
    data["written"] = sorted(scene.places)
    return data


RING_TOLERANCE = 0.75
"""Tolerance of the outline of a doubtful region, px, so that the page gets few
points.
"""


def doubtful_data(scene: Scene, percepts: Percepts | None) -> list[Data]:
    """Return the doubtful regions with their outlines, px of the photo."""
    if percepts is None:
        return []
    rows: list[Data] = []
    for region in doubtful_regions(percepts.labels, scene.document):
        rings = []
        for ring in region.rings:
            points = ring.astype(np.float32)[:, None]
            # The page needs outlines at the accuracy of its display only.
            simple = cv2.approxPolyDP(points, RING_TOLERANCE, True)
            rings.append(simple[:, 0].tolist())
        text = doubt_text(region.name, region.confidence)
        rows.append({"name": region.name, "text": text, "rings": rings})
    return rows


def perceived_data(scene: Scene) -> Data | None:
    """Return the verdict on the photo and the summary of perception, if it
    wrote them.
    """
    if scene.assets is not None:
        record = read_record(scene.assets / RECORD)
    else:
        record = {}
    verdict = written_suitability(scene.assets)
    summary = record.get("summary")
    if not verdict:
        return None
    if isinstance(summary, list):
        lines = list(map(str, summary))
    else:
        lines = []
    return {"verdict": verdict, "summary": lines}


def derived_data(scene: Scene, compiled_scene: CompiledScene) -> Data:
    """Return the values that follow from the scene: centres, masses and moments of the
    engine.
    """
    world = compiled_scene.world
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
    """Return the list of open questions for the page.

    A row has `kind`, `object`, `path`, `line`, `text`, `fix` and `ops`; `ops` None:
    only the user can decide. Errors come first, then guesses by confidence, then lints.
    """
    errors = []
    lints = []
    for problem in problems:
        if problem["severity"] == "error":
            errors.append(_row("error", problem, problem["message"], problem["fix"]))
        else:
            lints.append(_row("lint", problem, problem["message"], problem["fix"]))
    if scene is not None:
        guesses = list(_list_uncertain_guesses(scene))
    else:
        guesses = []
    guesses.sort(key=lambda guess: guess[0])
    rows = errors + [row for _, row in guesses] + lints
    return rows[:MAX_ROWS]


def doubtful_rows(scene: Scene, doubtful: Sequence[Data]) -> list[Data]:
    """Return a row of `todo` for each possible object."""
    rows = []
    for region in doubtful:
        path = f"doubtful.{region['name']}"
        position = {"object": None, "path": path, "line": _line(scene, path)}
        text = f"{region['text']} may be an object, too"
        fix = "to have it, click on it with Mask, Point"
        rows.append(_row("doubt", position, text, fix))
    return rows


def _row(
    kind: str,
    position: Mapping[str, Any],
    text: str,
    fix: str,
    ops: Sequence[Data] | None = None,
) -> Data:
    """Return a row of `todo`."""
    place = {key: position.get(key) for key in ("object", "path", "line")}
    return {"kind": kind, **place, "text": text, "fix": fix, "ops": ops}


@dataclass(frozen=True)
class _Entry:
    """An entry of the scene with values of perception."""

    path: tuple[str, ...]
    sources: Mapping[str, str]
    """Sources by key in the entry; "" for the entry itself."""
    object_name: str | None = None

    @property
    def dotted_path(self) -> str:
        """Return the path with dots."""
        return ".".join(self.path)

    def value_path(self, key: str) -> str:
        """Return the path of a value with dots."""
        if key:
            return f"{self.dotted_path}.{key}"
        return self.dotted_path


def _list_uncertain_guesses(scene: Scene) -> Iterator[tuple[float, Data]]:
    """Yield the unconfirmed guesses about objects, boundaries and the light, with
    confidence.
    """
    entries = []
    for item in scene.objects:
        path = ("objects", item.name)
        entries.append(_Entry(path, item.provenance, item.name))
    document = scene.document.get("boundaries") or {}
    for wall in scene.boundaries:
        guess = document.get(wall.name, {}).get("from")
        if isinstance(guess, str):
            entries.append(_Entry(("boundaries", wall.name), {"": guess}))
    if scene.light is not None and scene.light.provenance:
        entries.append(_Entry(("light",), {"": scene.light.provenance}))
    provenance = Provenance(scene, None)
    for entry in entries:
        guesses = _uncertain_guesses(entry, provenance)
        if guesses:
            # The least certain value decides the place of the row among all rows.
            yield guesses[0][0], _guess_row(scene, entry, guesses)


_Guess = tuple[float, str, str]
"""Confidence, key in the entry, and text of an uncertain value."""


def _uncertain_guesses(entry: _Entry, provenance: Provenance) -> list[_Guess]:
    """Return the uncertain guesses of an entry, the least certain first."""
    guesses: list[_Guess] = []
    for key, guess in entry.sources.items():
        confidence = source(guess).confidence
        if confidence is None or confidence >= SURE:
            continue
        from_path = f"{entry.dotted_path}.from"
        value = provenance.of(entry.value_path(key), guess, text_path=from_path)
        if value.kind == "guess":
            subject = key or entry.path[-1]
            text = f"{subject} ({guess.rpartition(' ')[0]}, {confidence:.0%})"
            guesses.append((confidence, key, text))
    return sorted(guesses)


def _guess_row(scene: Scene, entry: _Entry, guesses: Sequence[_Guess]) -> Data:
    """Return the row of an entry with uncertain guesses."""
    path = entry.value_path(guesses[0][1])
    position = {
        "object": entry.object_name,
        "path": path,
        "line": _line(scene, path) or _line(scene, entry.dotted_path),
    }
    uncertain_keys = {key for _, key, _ in guesses}
    other_sources = {
        key: text for key, text in entry.sources.items() if key not in uncertain_keys
    }
    from_path = f"{entry.dotted_path}.from"
    is_recorded = entry.object_name is not None and from_path not in scene.places
    ops: list[Data] = [{"unset": [*entry.path, "from"]}]
    # The record of perception also names the source: an empty `from` in the file
    # overrides the record.
    if other_sources or is_recorded:
        ops = [{"set": [*entry.path, "from"], "value": other_sources}]
    text = "; ".join(text for _, _, text in guesses)
    return _row("doubt", position, text, "correct as it is", ops)


def _line(scene: Scene, path: str) -> int | None:
    """Return the line of a path in the scene's own file; None for other places."""
    place = scene.places.get(path)
    if place is None or not place.line or place.file != scene.place("").file:
        return None
    return place.line
