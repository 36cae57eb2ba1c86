"""A table of objects -> what the backend of physics answers, about a photo of each or its bare silhouette."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.properties.answers import Answer
from physgen.evaluate.properties.table import Form, Item, Objects
from physgen.geometry import raster
from physgen.geometry.polygon import Disc, Outline, Region, Ring
from physgen.maps import read_labels
from physgen.materials import kind
from physgen.perceive.perceive import fit_objects
from physgen.perceive.roles import Matter, PhotoObject, Physics, Rgb
from physgen.perceive.scale import MIN_SCALE_CONFIDENCE, box_sides, photo_scale
from physgen.perceive.segment.prompts import from_masks
from physgen.photos import read_photo
from physgen.problems import InputError
from physgen.registry import Backends

Progress = Callable[[str, int, int], None]
CANVAS = 512
"""px: a silhouette's picture."""
LONGEST = 256
"""px: the silhouette's longest side."""
PAPER, INK = 235, 110
"""Grey levels."""


def ask(table: Objects, crew: Backends, sized: bool, progress: Progress) -> dict[str, Answer]:
    """By name. `sized`: each object's size is told, as by a photo whose scale is known; else its name alone.

    Raises InputError where a photo cannot be read, or the backend cannot answer.
    """

    def use(physics: Physics) -> dict[str, Answer]:
        found = {}
        for k, item in enumerate(table.items):
            progress(f"physics of {item.name}", k, len(table.items))
            found[item.name] = answer(_asked(item, physics, sized))
        return found

    answers: dict[str, Answer] = crew.run("physics", use)
    return answers


def answer(matter: Matter) -> Answer:
    """What counts of it."""
    return Answer(matter.mass, matter.friction, matter.elasticity, matter.reason)


def told_scale(things: Sequence[PhotoObject]) -> float | None:
    """px/m as `perceive` gets it, from things of known size among them; None where nothing tells."""
    found = photo_scale(things, {thing.id: kind(thing.label) for thing in things})
    return found.pixels_per_meter if found is not None and found.confidence >= MIN_SCALE_CONFIDENCE else None


def _asked(item: Item, physics: Physics, sized: bool) -> Matter:
    rgb, outline = _photo(item) if item.photo is not None else silhouette(item)
    thing = PhotoObject(1, outline, item.label)
    known = box_sides(outline)[0] / (max(item.size) / 1000) if item.size else None
    return physics(rgb, [thing], known if sized and known else told_scale([thing]))[1]


def _photo(item: Item) -> tuple[Rgb, Outline]:
    assert item.photo is not None
    assert item.mask is not None
    rgb = read_photo(item.photo).rgb
    labels = read_labels(item.mask)
    if labels.shape != rgb.shape[:2]:
        found = f"{labels.shape[1]} x {labels.shape[0]} px"
        expected = f"differs from the {rgb.shape[1]} x {rgb.shape[0]} px of {item.photo.name}"
        raise InputError.of(str(item.mask), found, expected, "make it the photo's size")
    things, _ = fit_objects(rgb, from_masks((labels > 0).astype(np.uint16)))
    return rgb, things[0].outline


def silhouette(item: Item) -> tuple[Rgb, Outline]:
    """A grey shape on paper: a ball's disc, else the rectangle that its two longest sides make.

    What is turned stands upright. A real outline has a waist, a handle or a hole: this one is at least as large.
    """
    size = item.size or {Form.BALL: (1.0,), Form.TURNED: (2.0, 1.0), Form.BOX: (1.0, 1.0, 1.0)}[item.form]
    middle = np.array([CANVAS / 2, CANVAS / 2])
    per_mm = LONGEST / max(size)
    outline: Outline
    if item.form is Form.BALL:
        outline = Disc(middle, size[0] / 2 * per_mm)
    else:
        tall, wide = size if item.form is Form.TURNED else sorted(size)[-2:]
        corners = np.array([[-wide, -tall], [wide, -tall], [wide, tall], [-wide, tall]]) / 2
        outline = Region((Ring(middle + corners * per_mm),))
    covered = raster.coverage(outline, (CANVAS, CANVAS))[..., None]
    rgb: NDArray[np.uint8] = np.rint(PAPER + (INK - PAPER) * covered).astype(np.uint8)
    return np.repeat(rgb, 3, axis=2), outline
