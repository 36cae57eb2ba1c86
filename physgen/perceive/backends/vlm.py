"""Categories, labels and matter by a vision-language model: a server's, or one of transformers on this machine.

The two questions of the paper (appendix, "Segmentation" and "Physical properties reasoning") in words of our own, with
more asked for: material, solid, rolling and true size, which gives the photo its scale.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from physgen.backends import Setup
from physgen.outline import raster
from physgen.perceive.backends import vlm_pictures as pictures
from physgen.perceive.backends.vlm_asking import Asker
from physgen.perceive.backends.vlm_matter import matter
from physgen.perceive.backends.vlm_questions import how, name, what, who
from physgen.perceive.extent import sides
from physgen.perceive.roles import Category, Labels, Matter, Name, Rgb, Thing

TOGETHER = 8
"""Objects that are named in one question."""
ALIKE = 1.15
"""How much longer one of two may be that are asked about once."""
HUE = 20.0
"""CIELAB distance up to which two are of one colour."""
NAMED = 0.8
"""How sure a name is that was said once."""
MOST = 48
"""Categories."""


class _Asks:
    """What the three roles have in common."""

    role = ""

    def __init__(self, setup: Setup) -> None:
        """Raises InputError where no model is named."""
        self._asker = Asker(self.role, setup)

    def note(self) -> Mapping[str, Any]:
        """Requests, tokens, seconds and cost of the last photo, for the record."""
        return self._asker.note()

    def close(self) -> None:
        """The model is let go."""
        self._asker.close()


class Categories(_Asks):
    """Names what a photo shows, and what of it could be moved."""

    role = "categories"

    def __call__(self, rgb: Rgb) -> Sequence[Category]:
        """Each noun once; of several samples, what at least half of them say. Raises InputError."""
        (samples,) = self._asker.ask([what(rgb)])
        found = [_nouns(sample) for sample in samples]
        seen = Counter(noun for one in found for noun in one)
        enough = [noun for noun in dict.fromkeys(seen) if 2 * seen[noun] >= len(found)]
        votes = {noun: [one[noun] for one in found if noun in one] for noun in enough}
        return [Category(noun, 2 * sum(said) > len(said)) for noun, said in votes.items()][:MOST]


class Label(_Asks):
    """Names objects, up to eight with one question."""

    role = "label"

    def __call__(self, rgb: Rgb, labels: Labels, things: Sequence[Thing]) -> Mapping[int, Name]:
        """A name for every thing, by id; of several samples, what most say. Raises InputError."""
        groups = [list(things[k : k + TOGETHER]) for k in range(0, len(things), TOGETHER)]
        asked = self._asker.ask([who(rgb, labels, group) for group in groups])
        result: dict[int, Name] = {}
        for group, samples in zip(groups, asked, strict=True):
            for k, thing in enumerate(group, 1):
                names = Counter(_numbers(sample)[k] for sample in samples)
                name, votes = names.most_common(1)[0]
                result[thing.id] = Name(
                    name, NAMED if len(samples) == 1 else round(0.95 * votes / len(samples), 2)
                )
        return result


class Physics(_Asks):
    """Judges mass, friction, elasticity, rolling, material and size; those that are alike with one question."""

    role = "physics"

    def __call__(
        self, rgb: Rgb, things: Sequence[Thing], pixels_per_meter: float | None
    ) -> Mapping[int, Matter]:
        """Matter of every thing, by id. Raises InputError."""
        size = rgb.shape[1], rgb.shape[0]
        masks = {thing.id: raster.coverage(thing.outline, size) >= 0.5 for thing in things}
        groups = alike(rgb, things, masks)
        asked = [next((t for t in group if not t.cut), group[0]) for group in groups]
        queries = [how(rgb, masks[thing.id], thing, pixels_per_meter) for thing in asked]
        model = self._asker.settings.model
        result: dict[int, Matter] = {}
        for group, one, samples in zip(groups, asked, self._asker.ask(queries), strict=True):
            result |= matter(samples, group, one, model)
        return result


def categories(setup: Setup) -> Categories:
    """The backend `categories=vlm`. Raises InputError where no model is named."""
    return Categories(setup)


def label(setup: Setup) -> Label:
    """The backend `label=vlm`. Raises InputError where no model is named."""
    return Label(setup)


def physics(setup: Setup) -> Physics:
    """The backend `physics=vlm`. Raises InputError where no model is named."""
    return Physics(setup)


def alike(rgb: Rgb, things: Sequence[Thing], masks: Mapping[int, pictures.Mask]) -> list[list[Thing]]:
    """Things of one label and size; of one colour, too, where the label is one word: `ball` may be steel or rubber."""
    groups: list[list[Thing]] = []
    lengths = {thing.id: sides(thing.outline) for thing in things}
    colours = {thing.id: pictures.colour(rgb, masks[thing.id]) for thing in things}

    def same(a: Thing, b: Thing) -> bool:
        near = all(1 / ALIKE <= x / y <= ALIKE for x, y in zip(lengths[a.id], lengths[b.id], strict=True))
        told = " " in a.label.strip() or float(np.linalg.norm(colours[a.id] - colours[b.id])) <= HUE
        return bool(a.label) and a.label == b.label and a.cut == b.cut and near and told

    for thing in things:
        group = next((group for group in groups if same(group[0], thing)), None)
        if group is None:
            groups.append([thing])
        else:
            group.append(thing)
    return groups


def _nouns(answer: Any) -> dict[str, bool]:
    """Noun -> movable; what is said twice is movable where it is so each time."""
    found: dict[str, bool] = {}
    for one in answer["categories"]:
        if noun := name(one["noun"]):
            found[noun] = one["movable"] and found.get(noun, True)
    return found


def _numbers(answer: Any) -> dict[int, str]:
    return {one["number"]: name(one["name"]) for one in answer["objects"]}
