"""Prompts for a vision-language model: questions with the meaning of the paper's, pictures and answer schemas."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, sqrt
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.backends.vlm_client import Query, object_schema, plain_line
from physgen.perceive.roles import Labels, PhotoObject, Rgb
from physgen.perceive.scale import box_sides
from physgen.scene.scene import Solid

Mask = NDArray[np.bool_]
NAME_EDGES = " \"'`.,;:*"
"""Characters that are removed from the ends of names."""


@dataclass(frozen=True)
class PromptConstants:
    """Constants of names, answers and pictures."""

    name: int = 48
    """Characters of a name."""
    densest: float = 23.0
    """g/cm³: osmium, the densest element (CRC)."""
    photo: int = 1024
    """px: the longer side of a whole photo, at most."""
    closeup: tuple[int, int] = (256, 512)
    """px: the longer side of a close-up, at least and at most."""
    tile: int = 224
    """px: the side of one object on a sheet of several."""
    margin: float = 0.25
    """Around an object, as a share of its longer side."""
    surroundings: float = 0.4
    """Share of their light that an object's surroundings keep."""
    ink: tuple[int, int, int] = (255, 0, 255)
    """RGB of outlines and numbers: hardly any object is magenta."""


PROMPT = PromptConstants()

CATEGORIES_SCHEMA = object_schema(
    categories={
        "type": "array",
        "minItems": 1,
        "items": object_schema(
            noun={"type": "string", "minLength": 1, "description": "One word, singular, no hyphen"},
            movable={"type": "boolean"},
        ),
    }
)
PHYSICS_SCHEMA = object_schema(
    reason={
        "type": "string",
        "minLength": 1,
        "description": "One sentence: what it is, and where mass and size come from",
    },
    material={"type": "string", "minLength": 1, "description": "In a word or two"},
    size={"type": "number", "exclusiveMinimum": 0, "description": "Metres: its longest side"},
    solid={"type": "string", "enum": [solid.value for solid in Solid]},
    mass={"type": "number", "exclusiveMinimum": 0, "description": "Grams"},
    friction={"type": "number", "description": "Coulomb's coefficient, 0 to 1.5"},
    elasticity={"type": "number", "description": "0 to 1"},
    rolling={"type": "number", "description": "Coefficient of rolling resistance, 0 to 0.3"},
)
"""The reason comes first, so that the model reasons before it writes numbers."""

CATEGORIES_QUESTION = """\
Name every kind of object and of surface that this photo shows, so that each part of it belongs to exactly
one kind, from the most striking to the least. Leave out nothing that stands, lies or hangs in it, and
neither the table, floor, wall or sky behind. For each kind write one noun, a single word in the singular
without a hyphen; no kind twice, and none that is part of another.
State for each whether it is movable: true for separate objects with an outline of their own (a ball, a cup,
a toy car) of which every one in the photo is seen whole, nothing of it hidden and not cut off by the photo's
edge, and could be pushed or lifted. False for surfaces and stuff (grass, water, a wall), for what is fixed
in place, and for what holds the rest.
Answer with one JSON object: {"categories": [{"noun": ..., "movable": true or false}, ...]}."""

LABEL_QUESTION = """\
The first picture is a photo in which {count} outlined in magenta and numbered. The second shows each of
them close, with its number in the corner and its surroundings darkened.
Name each so that a person could guess its weight from the name: a short English noun in the singular, with
the material before it where that can be seen ("wooden block", "tennis ball", "steel can", "ceramic mug").
No numbers, no place, and no colour unless the name needs it.
Answer with one JSON object: {{"objects": [{{"number": ..., "name": ...}}, ...]}}, each of {numbers} exactly
once."""

PHYSICS_QUESTION = """\
The first picture is a photo; one object in it{label} is outlined in magenta. The second picture shows that
object close, its surroundings darkened. Judge the real object, not its picture:
- reason: in one sentence, what it is, how large and of what, and how the mass follows from that; think of
  ordinary objects of its kind, of what is hollow or filled, and of objects beside it whose size is known
- material: of its surface, in a word or two
- size: its longest side in metres, as it is in reality{hint}
- solid: sphere for a ball, hoop for a ring or tyre, disc for a coin, wheel or cylinder seen from its end,
  else plate
- mass: in grams
- friction: Coulomb's coefficient of friction on an ordinary table, 0 for none, 1.5 at most
- elasticity: the share of its speed that it keeps when it bounces off something hard, 0 for none, 1 for all
- rolling: its coefficient of rolling resistance on a hard floor: about 0.001 for polished steel, 0.01 for
  wood, 0.05 for what gives way
Every number is one exact number, without its unit. Answer with one JSON object of these keys."""


def categories_query(rgb: Rgb) -> Query:
    """Which kinds of objects and surfaces a photo shows, and which of them are movable."""

    def contradictions(answer: Any) -> list[str]:
        named = any(clean_name(one["noun"]) for one in answer["categories"])
        return [] if named else ["categories: none has a noun"]

    picture = _png(_resized(rgb, 0, PROMPT.photo))
    return Query("the photo", CATEGORIES_QUESTION, (picture,), CATEGORIES_SCHEMA, contradictions)


def label_query(rgb: Rgb, labels: Labels, group: Sequence[PhotoObject]) -> Query:
    """Names of several objects, by numbers from 1."""
    masks = {k: np.asarray(labels == item.id) for k, item in enumerate(group, 1)}
    n = len(group)
    about = "one object" if n == 1 else f"{n} objects"
    numbers = "number 1" if n == 1 else f"the numbers 1 to {n}"
    one = object_schema(
        number={"type": "integer", "enum": list(masks)},
        name={"type": "string", "minLength": 1},
    )
    schema = object_schema(objects={"type": "array", "items": one, "minItems": n, "maxItems": n})
    text = LABEL_QUESTION.format(count=f"{about} {'is' if n == 1 else 'are'}", numbers=numbers)
    return Query(about, text, (_outlined_photo(rgb, masks), _sheet(rgb, masks)), schema, _numbered_once(n))


def _numbered_once(n: int) -> Callable[[Any], list[str]]:
    def contradictions(answer: Any) -> list[str]:
        numbers = sorted(one["number"] for one in answer["objects"])
        faults = [f"objects: numbers {numbers}, not each of 1 to {n} once"]
        faults = [] if numbers == list(range(1, n + 1)) else faults
        nameless = [one["number"] for one in answer["objects"] if not clean_name(one["name"])]
        return faults + [f"objects: number {k} has no name" for k in nameless]

    return contradictions


def physics_query(rgb: Rgb, mask: Mask, item: PhotoObject, pixels_per_meter: float | None) -> Query:
    """Material, mass and size of one object."""
    name = plain_line(item.label, PROMPT.name)
    label = f', "{name}",' if name else ""
    hint = ""
    if pixels_per_meter is not None and not item.cut:
        hint = f"; by the photo's scale it is about {box_sides(item.outline)[0] / pixels_per_meter:.2g}"
    pictures = _outlined_photo(rgb, {item.id: mask}), _png(_closeup(rgb, mask, *PROMPT.closeup))
    text = PHYSICS_QUESTION.format(label=label, hint=hint)
    return Query(name or "an object", text, pictures, PHYSICS_SCHEMA, mass_contradictions)


def mass_contradictions(answer: Mapping[str, Any]) -> list[str]:
    """A fault where the mass is more than that of a cube of the densest element with the longest side."""
    size, mass = answer["size"], answer["mass"]
    if mass <= PROMPT.densest * (100 * size) ** 3:
        return []
    return [f"mass: an object whose longest side is {size:g} m cannot weigh {mass:g} g"]


def clean_name(text: str) -> str:
    """A noun as labels are written: lower case, no quotes, no article.

    >>> clean_name(' A "Tennis ball." ')
    'tennis ball'
    """
    line = plain_line(text, PROMPT.name).lower().strip(NAME_EDGES)
    for article in ("a ", "an ", "the "):
        line = line.removeprefix(article).strip(NAME_EDGES)
    return line


def median_lab(rgb: Rgb, mask: Mask) -> NDArray[np.float64]:
    """(3,) an object's median colour in CIELAB, L in 0..100."""
    inside = rgb[mask] if mask.any() else rgb.reshape(-1, 3)
    lab = cv2.cvtColor(np.median(inside, axis=0).astype(np.float32)[None, None] / 255, cv2.COLOR_RGB2LAB)
    return np.asarray(lab[0, 0], np.float64)


def _outlined_photo(rgb: Rgb, masks: Mapping[int, Mask]) -> bytes:
    """The photo with each object outlined, and numbered with its key where there are several."""
    picture = _resized(rgb, 0, PROMPT.photo).copy()
    for number, mask in masks.items():
        fitted = _fitted(mask, picture)
        _draw_outline(picture, fitted)
        if len(masks) > 1:
            _draw_number(picture, number, _deepest(fitted))
    return _png(picture)


def _sheet(rgb: Rgb, masks: Mapping[int, Mask]) -> bytes:
    """Close-ups of several objects side by side, each with its number in the corner."""
    across = ceil(sqrt(len(masks)))
    canvas = np.full((ceil(len(masks) / across) * PROMPT.tile, across * PROMPT.tile, 3), 255, np.uint8)
    for k, (number, mask) in enumerate(masks.items()):
        picture = _closeup(rgb, mask, PROMPT.tile, PROMPT.tile)
        y, x = k // across * PROMPT.tile, k % across * PROMPT.tile
        tall, wide = picture.shape[:2]
        canvas[y : y + tall, x : x + wide] = picture
        _draw_number(canvas, number, (x + 18, y + 18))
    return _png(canvas)


def _closeup(rgb: Rgb, mask: Mask, least: int, most: int) -> Rgb:
    """One object with a margin, outlined, its surroundings darkened."""
    rows, columns = (np.flatnonzero(mask.any(axis)) for axis in (1, 0))
    if not len(rows):  # the object lies outside the photo
        return _resized(rgb, least, most)
    (y0, y1), (x0, x1) = ((int(line[0]), int(line[-1]) + 1) for line in (rows, columns))
    margin = max(ceil(PROMPT.margin * max(y1 - y0, x1 - x0)), 8)
    y0, x0 = max(y0 - margin, 0), max(x0 - margin, 0)
    part, inside = rgb[y0 : y1 + margin, x0 : x1 + margin], mask[y0 : y1 + margin, x0 : x1 + margin]
    picture = _resized(np.ascontiguousarray(part), least, most).copy()
    fitted = _fitted(inside, picture)
    picture[~fitted] = (picture[~fitted] * PROMPT.surroundings).astype(np.uint8)
    _draw_outline(picture, fitted)
    return picture


def _resized(rgb: Rgb, least: int, most: int) -> Rgb:
    """A picture whose longer side is from `least` to `most` px."""
    tall, wide = rgb.shape[:2]
    factor = min(max(1.0, least / max(tall, wide)), most / max(tall, wide))
    if factor == 1:
        return rgb
    size = max(round(wide * factor), 1), max(round(tall * factor), 1)
    method = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(rgb, size, interpolation=method), np.uint8)


def _fitted(mask: Mask, picture: Rgb) -> Mask:
    """A mask in the picture's size."""
    tall, wide = picture.shape[:2]
    if mask.shape == (tall, wide):
        return mask
    return np.asarray(cv2.resize(mask.astype(np.float32), (wide, tall)) >= 0.5)


def _draw_outline(picture: Rgb, mask: Mask) -> None:
    """An outline around the mask, outside of it so that the object is not covered."""
    wide = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    picture[wide & ~mask] = PROMPT.ink


def _deepest(mask: Mask) -> tuple[int, int]:
    """x, y of the pixel farthest from the mask's border."""
    depth = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)
    y, x = np.unravel_index(int(depth.argmax()), depth.shape)
    return int(x) - 1, int(y) - 1


def _draw_number(picture: Rgb, number: int, center: tuple[int, int]) -> None:
    text, font, size = str(number), cv2.FONT_HERSHEY_SIMPLEX, 0.6
    (wide, tall), _ = cv2.getTextSize(text, font, size, 2)
    corner = center[0] - wide // 2, center[1] + tall // 2
    far = corner[0] + wide + 2, corner[1] + 3
    cv2.rectangle(picture, (corner[0] - 3, corner[1] - tall - 3), far, (255, 255, 255), -1)
    cv2.putText(picture, text, corner, font, size, PROMPT.ink, 2, cv2.LINE_AA)


def _png(rgb: Rgb) -> bytes:
    return cv2.imencode(".png", rgb[..., ::-1])[1].tobytes()
