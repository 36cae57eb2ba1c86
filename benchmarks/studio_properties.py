"""What a backend of physics answers about objects on the studio's photos, whose true values are set by their makers.

Objects are cut out by the true masks and named by the true labels.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from physgen.evaluate.measure import Findings, Progress, Table
from physgen.evaluate.properties import (
    COEFFICIENTS,
    MASS,
    NUMBERS,
    ORDER,
    Answer,
    Order,
    mass_cells,
    masses,
    order,
    scale_by_labels,
)
from physgen.maps import read_labels
from physgen.materials import kind as kind_of
from physgen.perceive.photo_objects import fit_objects
from physgen.perceive.roles import Matter, Physics
from physgen.perceive.segment.prompts import from_masks
from physgen.photos import read_photo
from physgen.problems import InputError
from physgen.registry import Backends


@dataclass(frozen=True)
class Kind:
    """Objects of one scene of the studio that are alike in label and true physics."""

    scene: str
    label: str
    count: int
    true: Answer
    scaled: Answer
    """Medians of the answers where the photo's true scale is given."""
    found: Answer
    """The same where it is not: objects of known size give it, or nothing does."""


def ask_photos(truth: Path, backends: Backends, progress: Progress) -> list[Kind]:
    """Every kind of object on the photos below `truth` with known physics, cut out by the true masks.

    Raises InputError where there are none.
    """
    files = sorted(truth.glob("*/truth.json"))
    if not files:
        fix = "name the folder of the studio's truth, studio/truth in physgen's repository"
        raise InputError.of("--truth", f'"{truth}"', "holds no truth.json", fix)

    def use(physics: Physics) -> list[Kind]:
        kinds: list[Kind] = []
        for k, file in enumerate(files):
            progress(f"physics of {file.parent.name}", k, len(files))
            kinds += _kinds_of(file, physics)
        return kinds

    found: list[Kind] = backends.run("physics", use)
    return found


def _kinds_of(file: Path, physics: Physics) -> list[Kind]:
    folder = file.resolve().parents[3] / "scenes" / file.parent.name
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
        true = {
            one["id"]: (
                one["label"],
                Answer(one["mass_g"], one["friction"], one["elasticity"]),
            )
            for one in record["objects"]
        }
        per_meter = float(record["pixels_per_meter"])
    except (ValueError, KeyError, TypeError) as error:
        fix = "make it again: make studio"
        raise InputError.of(
            str(file), "", f"is no truth of the studio ({error!r})", fix
        ) from None
    rgb = read_photo(folder / "photo.png").rgb
    cut, _ = fit_objects(
        rgb, from_masks(read_labels(folder / "photo.assets" / "masks.png"))
    )
    objects = [replace(one, label=true[one.id][0]) for one in cut if one.id in true]
    scaled, found = (
        physics(rgb, objects, per_meter),
        physics(rgb, objects, scale_by_labels(objects)),
    )
    alike: dict[Any, list[int]] = {}
    for one in objects:
        label, facts = true[one.id]
        if facts.mass:
            alike.setdefault((kind_of(label).noun or label, facts), []).append(one.id)

    def median(answers: Sequence[Matter]) -> Answer:
        numbers = {
            key: float(np.median([getattr(one, key) for one in answers]))
            for key in NUMBERS
        }
        return Answer(**numbers, reason=answers[0].reason)

    return [
        Kind(
            file.parent.name, true[ids[0]][0], len(ids), facts,
            median([scaled[i] for i in ids]), median([found[i] for i in ids]),
        )
        for (_, facts), ids in alike.items()
    ]  # fmt: skip


def with_studio(findings: Findings, kinds: Sequence[Kind]) -> Findings:
    """With rows, lines of its tables and data of the studio's photos."""
    rows = list(findings.rows)
    lines: dict[str, list[tuple[str, ...]]] = {MASS: [], ORDER: []}
    for way, scale in (("scaled", "given"), ("found", "found")):
        score = masses(
            [(one.true.mass or 0.0, getattr(one, way).mass) for one in kinds]
        )
        assert score is not None
        name = f"studio's photos, scale {scale}"
        rows.append({"kind": "set", "set": name, **score.as_dict()})
        lines[MASS].append(mass_cells(name, score))
    for of in COEFFICIENTS:
        found = _ordered(kinds, of)
        pairs = {"pairs": found.count, "right": found.right, "tied": found.ties}
        wrong = [list(pair) for pair in found.wrong_pairs]
        rows.append(
            {
                "kind": of,
                "set": "studio's photos",
                "source": "",
                **pairs,
                "not_in_order": wrong,
            }
        )
        shares = f"{found.right} of {found.count}", str(found.ties)
        lines[ORDER].append((of, "studio's photos, within each", *shares, ""))
    sections = tuple(
        replace(
            one,
            tables=tuple(
                _longer(table, lines.get(one.title, [])) for table in one.tables
            ),
        )
        for one in findings.sections
    )
    more = {**findings.extra, "studio": [_kind_row(one) for one in kinds]}
    sentence = "On the studio's photos the true masks and labels are given; whoever made the scenes set what is true."
    return replace(
        findings,
        rows=rows,
        sections=sections,
        extra=more,
        sentences=(*findings.sentences, sentence),
    )


def _longer(table: Table, lines: Sequence[tuple[str, ...]]) -> Table:
    """With more lines above the paper's."""
    return replace(table, rows=(*table.rows[:-1], *lines, *table.rows[-1:]))


def _ordered(kinds: Sequence[Kind], of: str) -> Order:
    """Pairs within each scene."""
    total = Order()
    for scene in dict.fromkeys(one.scene for one in kinds):
        here = {
            f"{scene}: {one.label}, {one.true.mass:g} g": one
            for one in kinds
            if one.scene == scene
        }
        total += order(
            {name: getattr(one.true, of) for name, one in here.items()},
            {name: getattr(one.scaled, of) for name, one in here.items()},
        )
    return total


def _kind_row(one: Kind) -> dict[str, Any]:
    return {
        "scene": one.scene,
        "label": one.label,
        "count": one.count,
        **{f"true_{key}": getattr(one.true, key) for key in NUMBERS},
        **{f"told_{key}": getattr(one.scaled, key) for key in NUMBERS},
        "found_mass": one.found.mass,
    }
