"""Categories, labels and physical properties from a vision-language model behind a server.

The two questions of the paper (appendix, "Segmentation" and "Physical properties reasoning") in other words, and for
more answers: material, solid, rolling and true size, which gives the photo its scale.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp, log, sqrt
from typing import Any

import numpy as np

from physgen.geometry import raster
from physgen.geometry.polygon import Disc
from physgen.perceive.backends.vlm_client import Client, plain_line, read_settings
from physgen.perceive.backends.vlm_prompts import (
    Mask,
    categories_query,
    clean_name,
    label_query,
    median_lab,
    physics_query,
)
from physgen.perceive.roles import Category, Labels, Matter, Name, PhotoObject, Rgb
from physgen.perceive.scale import box_sides
from physgen.registry import Setup
from physgen.scene.scene import Solid


@dataclass(frozen=True)
class AnswerConstants:
    """Constants of what is asked together and of what is made of answers."""

    objects: int = 8
    """Objects that are named in one question."""
    categories: int = 48
    """At most, of a photo."""
    similar_size: float = 1.15
    """Ratio of lengths up to which two objects share one question."""
    similar_colour: float = 20.0
    """CIELAB distance up to which two objects have one colour."""
    name: float = 0.8
    """Confidence of a name from a single answer."""
    mass_spread: float = 0.6
    """Standard deviation of the logarithm of a mass judged by eye: the prior of one sample."""
    mass: float = 0.9
    """Highest confidence of a mass, at perfect agreement: answers may agree and still be wrong."""
    same_length: float = 0.05
    """Relative difference in length up to which two similar objects count as equal: masks are no more exact."""


ANSWERS = AnswerConstants()
RANGES: Mapping[str, tuple[float, float, str]] = {
    "mass": (1e-3, 1e7, "g"),
    "size": (1e-3, 50.0, "m"),
    "friction": (0.0, 1.5, ""),
    "elasticity": (0.0, 1.0, ""),
    "rolling": (0.0, 0.3, ""),
}
"""Accepted values, with units: from a grain to a lorry; rubber on dry asphalt has the most friction."""


class _Role:
    """Common parts of the three roles."""

    role = ""

    def __init__(self, setup: Setup) -> None:
        """Raises InputError where no model is named."""
        self._client = Client(read_settings(self.role, setup))

    def note(self) -> Mapping[str, Any]:
        """Requests, tokens, seconds and cost of the last photo, for the record."""
        return self._client.note()

    def close(self) -> None:
        """Close the connections."""
        self._client.close()


class Categories(_Role):
    """The backend `categories=vlm`: the kinds of objects and surfaces in a photo."""

    role = "categories"

    def __call__(self, rgb: Rgb) -> Sequence[Category]:
        """Each noun once; of several samples, the nouns in at least half of them. Raises InputError."""
        (samples,) = self._client.ask([categories_query(rgb)])
        found = [_nouns(sample) for sample in samples]
        count = Counter(noun for one in found for noun in one)
        frequent = [noun for noun in dict.fromkeys(count) if 2 * count[noun] >= len(found)]
        votes = {noun: [one[noun] for one in found if noun in one] for noun in frequent}
        categories = [Category(noun, 2 * sum(movable) > len(movable)) for noun, movable in votes.items()]
        return categories[: ANSWERS.categories]


class Label(_Role):
    """The backend `label=vlm`: names of objects, up to eight with one question."""

    role = "label"

    def __call__(self, rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject]) -> Mapping[int, Name]:
        """A name for every object, by id; the most frequent of several samples. Raises InputError."""
        size = ANSWERS.objects
        groups = [list(objects[k : k + size]) for k in range(0, len(objects), size)]
        answers = self._client.ask([label_query(rgb, labels, group) for group in groups])
        result: dict[int, Name] = {}
        for group, samples in zip(groups, answers, strict=True):
            names = [{one["number"]: clean_name(one["name"]) for one in s["objects"]} for s in samples]
            for k, item in enumerate(group, 1):
                name, votes = Counter(one[k] for one in names).most_common(1)[0]
                share = ANSWERS.name if len(samples) == 1 else round(0.95 * votes / len(samples), 2)
                result[item.id] = Name(name, share)
        return result


class Physics(_Role):
    """The backend `physics=vlm`: mass, friction, elasticity, rolling, material and size."""

    role = "physics"

    def __call__(
        self, rgb: Rgb, objects: Sequence[PhotoObject], pixels_per_meter: float | None
    ) -> Mapping[int, Matter]:
        """Matter of every object, by id; similar objects share one question. Raises InputError."""
        size = rgb.shape[1], rgb.shape[0]
        masks = {item.id: raster.coverage(item.outline, size) >= 0.5 for item in objects}
        groups = similar_groups(rgb, objects, masks)
        examples = [next((t for t in group if not t.cut), group[0]) for group in groups]
        queries = [physics_query(rgb, masks[item.id], item, pixels_per_meter) for item in examples]
        result: dict[int, Matter] = {}
        for group, example, samples in zip(groups, examples, self._client.ask(queries), strict=True):
            result |= merged_matter(samples, group, example, self._client.settings.model)
        return result


categories, label, physics = Categories, Label, Physics
"""The factories named in the registry."""


def similar_groups(
    rgb: Rgb, objects: Sequence[PhotoObject], masks: Mapping[int, Mask]
) -> list[list[PhotoObject]]:
    """Objects grouped by label and size, and by colour where the label is one word: a `ball` may be steel or rubber."""
    groups: list[list[PhotoObject]] = []
    lengths = {item.id: box_sides(item.outline) for item in objects}
    colours = {item.id: median_lab(rgb, masks[item.id]) for item in objects}

    def similar(a: PhotoObject, b: PhotoObject) -> bool:
        pairs = zip(lengths[a.id], lengths[b.id], strict=True)
        sized = all(1 / ANSWERS.similar_size <= x / y <= ANSWERS.similar_size for x, y in pairs)
        distance = float(np.linalg.norm(colours[a.id] - colours[b.id]))
        same_material = " " in a.label.strip() or distance <= ANSWERS.similar_colour
        return bool(a.label) and a.label == b.label and a.cut == b.cut and sized and same_material

    for item in objects:
        group = next((group for group in groups if similar(group[0], item)), None)
        if group is None:
            groups.append([item])
        else:
            group.append(item)
    return groups


def merged_matter(
    answers: Sequence[Mapping[str, Any]], objects: Sequence[PhotoObject], example: PhotoObject, model: str
) -> Mapping[int, Matter]:
    """Matter of each of the similar `objects`, by id, from the medians of `answers` about `example`, one of them.

    Mass is scaled by the cube of the length where an object is larger or smaller than the example.
    """
    clamped = [_clamped(answer) for answer in answers]
    value = {name: _median([one[name] for one, _ in clamped], name) for name in RANGES}
    masses = [one["mass"] for one, _ in clamped]
    nearest = min(range(len(answers)), key=lambda k: abs(log(masses[k] / value["mass"])))
    answer, notes = answers[nearest], clamped[nearest][1]
    reason = [plain_line(answer["reason"], 240).rstrip(".")]
    if len(answers) > 1:
        reason.append(f"the median of {len(answers)} answers from {min(masses):.3g} to {max(masses):.3g} g")
    if len(objects) > 1:
        reason.append(f"asked once for {len(objects)} alike")
    reason += [note for name, note in notes.items() if name in ("mass", "size")]
    material = plain_line(answer["material"], 60)
    surface = [f"{material}, as {plain_line(model, 60)} judges"]
    surface += [note for name, note in notes.items() if name not in ("mass", "size")]
    result = {}
    for item in objects:
        ratio = box_sides(item.outline)[0] / box_sides(example.outline)[0]
        ratio = ratio if abs(ratio - 1) > ANSWERS.same_length else 1.0
        result[item.id] = Matter(
            mass=float(f"{value['mass'] * ratio**3:.3g}"),
            friction=round(value["friction"], 3),
            elasticity=round(value["elasticity"], 3),
            rolling=float(f"{value['rolling']:.2g}"),
            # only circles have another moment than that of their area
            solid=Solid(answer["solid"]) if isinstance(item.outline, Disc) else Solid.PLATE,
            confidence=mass_confidence(masses),
            reason="; ".join(reason),
            surface="; ".join(surface),
            size=float(f"{value['size'] * ratio:.3g}"),
            material=material,
        )
    return result


def mass_confidence(masses: Sequence[float]) -> float:
    """0..1 from the scatter of samples of a mass.

    >>> mass_confidence([170]), mass_confidence([170, 170, 170]), mass_confidence([100, 170, 300])
    (0.49, 0.64, 0.51)
    """
    logs = np.log(masses)
    scatter = float(((logs - logs.mean()) ** 2).sum())
    return round(ANSWERS.mass * exp(-sqrt((scatter + ANSWERS.mass_spread**2) / len(logs))), 2)


def _nouns(answer: Any) -> dict[str, bool]:
    """Noun -> movable; a repeated noun is movable if it is so each time."""
    found: dict[str, bool] = {}
    for one in answer["categories"]:
        if noun := clean_name(one["noun"]):
            found[noun] = one["movable"] and found.get(noun, True)
    return found


def _clamped(answer: Mapping[str, Any]) -> tuple[dict[str, float], dict[str, str]]:
    """The numbers within their ranges, and a note for each that was outside."""
    numbers, notes = {}, {}
    for name, (least, most, unit) in RANGES.items():
        value = float(answer[name])
        numbers[name] = min(max(value, least), most)
        if numbers[name] != value:
            unit = f" {unit}" if unit else ""
            notes[name] = (
                f"{name} {value:g}{unit} was answered and is out of range: {numbers[name]:g}{unit} taken"
            )
    return numbers, notes


def _median(values: Sequence[float], name: str) -> float:
    """The median; of masses and sizes the geometric one."""
    if name in ("mass", "size"):
        return float(np.exp(np.median(np.log(values))))
    return float(np.median(values))
