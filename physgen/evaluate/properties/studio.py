"""Photos with true physics, the studio's -> what the backend of physics says of every kind of thing on them.

Things are cut out by the true masks and called by the true labels: the judge of physics is judged, and not who finds
or names. Their masses, frictions and elasticities were set by whoever made the scenes, not measured.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from physgen.evaluate.properties.answers import NUMBERS, Answer
from physgen.evaluate.properties.asked import answer, told_scale
from physgen.evaluate.properties.scores import NONE, Masses, Order, masses, order
from physgen.maps import read_labels
from physgen.materials import kind as kind_of
from physgen.perceive.perceive import fit_objects
from physgen.perceive.roles import Physics
from physgen.perceive.segment.prompts import from_masks
from physgen.photos import read_photo
from physgen.problems import InputError
from physgen.registry import Backends

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Kind:
    """Things of one scene that are of one sort, and alike in all that is true of them."""

    scene: str
    label: str
    """Of the first."""
    count: int
    true: Answer
    scaled: Answer
    """Medians of what is said of them where the photo's true scale is told."""
    found: Answer
    """The same where it is not: things of known size tell it, or nothing does."""

    @property
    def name(self) -> str:
        """Of a scene and a label, unlike every other's of a scene."""
        return f"{self.label}, {self.true.mass:g} g"


def ask_photos(truth: Path, crew: Backends, progress: Progress) -> list[Kind]:
    """Every kind of thing below `truth` whose mass is known. Raises InputError where there are none."""
    files = sorted(truth.glob("*/truth.json"))
    if not files:
        fix = "name the folder of the studio's truth, studio/truth in physgen's repository"
        raise InputError.of("--truth", f'"{truth}"', "holds no truth.json", fix)

    def use(physics: Physics) -> list[Kind]:
        kinds: list[Kind] = []
        for k, file in enumerate(files):
            progress(f"physics of {file.parent.name}", k, len(files))
            kinds += _photo(file, physics)
        return kinds

    found: list[Kind] = crew.run("physics", use)
    return found


def _photo(file: Path, physics: Physics) -> list[Kind]:
    folder = file.resolve().parents[3] / "scenes" / file.parent.name
    try:
        told = json.loads(file.read_text(encoding="utf-8"))
        true = {
            one["id"]: (one["label"], Answer(one["mass_g"], one["friction"], one["elasticity"]))
            for one in told["objects"]
        }
        per_meter = float(told["pixels_per_meter"])
    except (ValueError, KeyError, TypeError) as error:
        fix = "make it again: make studio"
        raise InputError.of(str(file), "", f"is no truth of the studio ({error!r})", fix) from None
    rgb = read_photo(folder / "photo.png").rgb
    cut, _ = fit_objects(rgb, from_masks(read_labels(folder / "photo.assets" / "masks.png")))
    things = [replace(thing, label=true[thing.id][0]) for thing in cut if thing.id in true]
    scaled = physics(rgb, things, per_meter)
    found = physics(rgb, things, told_scale(things))
    alike: dict[Any, list[int]] = {}
    for thing in things:
        if true[thing.id][1].mass:
            label, facts = true[thing.id]
            alike.setdefault((kind_of(label).noun or label, facts), []).append(thing.id)
    return [
        Kind(
            file.parent.name,
            true[ids[0]][0],
            len(ids),
            facts,
            _middle([answer(scaled[i]) for i in ids]),
            _middle([answer(found[i]) for i in ids]),
        )
        for (_, facts), ids in alike.items()
    ]


def _middle(answers: Sequence[Answer]) -> Answer:
    numbers = {key: float(np.median([getattr(one, key) for one in answers])) for key in NUMBERS}
    return Answer(**numbers, reason=answers[0].reason)


def weighed(kinds: Sequence[Kind], way: str) -> Masses | None:
    """`way` is `scaled` or `found`; each kind counts once."""
    return masses([(kind.true.mass or 0, getattr(kind, way).mass) for kind in kinds])


def ordered(kinds: Sequence[Kind], of: str) -> Order:
    """Pairs within each scene: what lies side by side on one photo."""
    total = NONE
    for scene in dict.fromkeys(kind.scene for kind in kinds):
        here = [kind for kind in kinds if kind.scene == scene]
        names = [f"{scene}: {kind.name}" for kind in here]
        total += order(
            {name: getattr(kind.true, of) for name, kind in zip(names, here, strict=True)},
            {name: getattr(kind.scaled, of) for name, kind in zip(names, here, strict=True)},
        )
    return total
