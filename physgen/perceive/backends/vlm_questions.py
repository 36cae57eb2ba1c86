"""Questions to a vision-language model: their texts, pictures and schemas."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.scale import box_sides
from physgen.perceive.roles import PhotoObject, Rgb
from physgen.scene.scene import Solid

Mask = NDArray[np.bool_]
Schema = Mapping[str, Any]


@dataclass(frozen=True)
class Constants:
    """Constants of requests, answers and pictures."""

    # Largest number of answers to one question until one is usable.
    attempts: int = 3
    # Repetitions of a request if the server fails, is busy or does not answer.
    retries: int = 2
    # Concurrent requests.
    parallel: int = 4
    # Characters of an answer; the rest is ignored.
    answer: int = 50_000
    # Brackets at which JSON decoding is tried.
    starts: int = 200
    # Largest number of categories per photo.
    categories: int = 48
    # Largest ratio of lengths of two objects with a common question.
    similar_size: float = 1.15
    # Largest CIELAB distance between two objects of one colour.
    similar_colour: float = 20.0
    # Confidence of a label.
    label_confidence: float = 0.8
    # Confidence of an estimated mass: its logarithm has a standard deviation of 0.6.
    mass_confidence: float = 0.49
    # Relative difference in length below which similar objects count as equal.
    same_length: float = 0.05
    # Largest length of a label in characters.
    name: int = 48
    densest: float = 23.0  # g/cm³: osmium, the densest element (CRC)
    # px: largest longer side of a whole photo.
    photo: int = 1024
    # px: least and largest longer side of a close-up.
    closeup: tuple[int, int] = (
        256,
        512,
    )
    # Margin around an object as a share of its longer side.
    margin: float = 0.25
    # Brightness factor of an object's surroundings.
    surroundings: float = 0.4
    # RGB of outlines: magenta, because hardly any object has this colour.
    ink: tuple[int, int, int] = (
        255,
        0,
        255,
    )


VLM = Constants()


def object_schema(**properties: Schema) -> dict[str, Any]:
    """Return the schema of an object that requires these properties and allows no
    others.
    """
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


TEXT: Schema = {"type": "string", "minLength": 1}
CATEGORIES_SCHEMA = object_schema(
    categories={
        "type": "array",
        "minItems": 1,
        "items": object_schema(noun=TEXT, movable={"type": "boolean"}),
    }
)
LABEL_SCHEMA = object_schema(name=TEXT)
PHYSICS_SCHEMA = object_schema(
    reason=TEXT,
    material=TEXT,
    size={"type": "number", "minimum": 1e-3, "maximum": 50},
    solid={"type": "string", "enum": [solid.value for solid in Solid]},
    mass={"type": "number", "minimum": 1e-3, "maximum": 1e7},
    friction={"type": "number", "minimum": 0, "maximum": 1.5},
    elasticity={"type": "number", "minimum": 0, "maximum": 1},
    rolling={"type": "number", "minimum": 0, "maximum": 0.3},
)
"""Ranges reach from a grain to a lorry, in m and g; rubber on dry asphalt has the
highest friction.

The reason comes first, so that the model reasons before it writes numbers.
"""

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
The first picture is a photo; one object in it is outlined in magenta. The second picture shows that object
close, its surroundings darkened.
Name it so that a person could guess its weight from the name: a short English noun in the singular, with
the material before it where that can be seen ("wooden block", "tennis ball", "steel can", "ceramic mug").
No numbers, no place, and no colour unless the name needs it.
Answer with one JSON object: {"name": ...}."""

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


@dataclass(frozen=True)
class Query:
    """A question about pictures."""

    # One to three words for messages, e.g. `ball`.
    subject: str
    text: str
    pictures: tuple[bytes, ...]  # PNG
    schema: Schema  # of the answer
    contradictions: Callable[[Any], list[str]] = lambda answer: []
    """Return the faults of an answer that satisfies the schema."""


def categories_query(rgb: Rgb) -> Query:
    """Return the question for the objects of a photo."""
    picture = _png(_resize_picture(rgb, 0, VLM.photo))
    return Query(
        "the photo", CATEGORIES_QUESTION, (picture,), CATEGORIES_SCHEMA, _nameless
    )


def label_query(rgb: Rgb, mask: Mask) -> Query:
    """Return the question for the label of one object."""
    pictures = _outlined_photo(rgb, mask), _closeup(rgb, mask)
    return Query("an object", LABEL_QUESTION, pictures, LABEL_SCHEMA, _nameless)


def _nameless(answer: Mapping[str, Any]) -> list[str]:
    """Return a fault if the answer contains no usable name."""
    if "name" in answer:
        names = [answer["name"]]
    else:
        names = [entry["noun"] for entry in answer["categories"]]
    if any(map(clean_name, names)):
        return []
    return ["there is no name in it"]


def physics_query(
    rgb: Rgb, mask: Mask, item: PhotoObject, pixels_per_meter: float | None
) -> Query:
    """Return the question for material, mass and size of one object."""
    name = plain_line(item.label, VLM.name)
    label = ""
    if name:
        label = f', "{name}",'
    hint = ""
    if pixels_per_meter is not None and not item.cut:
        hint = f"; by the photo's scale it is about {box_sides(item.outline)[0] / pixels_per_meter:.2g}"
    pictures = _outlined_photo(rgb, mask), _closeup(rgb, mask)
    text = PHYSICS_QUESTION.format(label=label, hint=hint)
    return Query(
        name or "an object", text, pictures, PHYSICS_SCHEMA, mass_contradictions
    )


def mass_contradictions(answer: Mapping[str, Any]) -> list[str]:
    """Return a fault if the mass exceeds that of a cube of osmium with the longest
    side.
    """
    size = answer["size"]
    mass = answer["mass"]
    if mass <= VLM.densest * (100 * size) ** 3:
        return []
    return [f"mass: an object whose longest side is {size:g} m cannot weigh {mass:g} g"]


def clean_name(text: str) -> str:
    """Return a noun in the form of labels: lower case, without quotes and article.

    >>> clean_name(' A "Tennis ball." ')
    'tennis ball'
    """
    ends = " \"'`.,;:*"
    line = plain_line(text, VLM.name).lower().strip(ends)
    for article in ("a ", "an ", "the "):
        line = line.removeprefix(article).strip(ends)
    return line


def median_lab(rgb: Rgb, mask: Mask) -> NDArray[np.float64]:
    """Return the median colour (3,) of an object in CIELAB, L in 0..100."""
    if mask.any():
        inside = rgb[mask]
    else:
        inside = rgb.reshape(-1, 3)
    lab = cv2.cvtColor(
        np.median(inside, axis=0).astype(np.float32)[None, None] / 255,
        cv2.COLOR_RGB2LAB,
    )
    return np.asarray(lab[0, 0], np.float64)


def _outlined_photo(rgb: Rgb, mask: Mask) -> bytes:
    """Return the photo with one object outlined, as PNG."""
    picture = _resize_picture(rgb, 0, VLM.photo).copy()
    _draw_outline(picture, _resize_mask(mask, picture))
    return _png(picture)


def _closeup(rgb: Rgb, mask: Mask) -> bytes:
    """Return an outlined object with darkened surroundings, as PNG."""
    rows = np.flatnonzero(mask.any(1))
    columns = np.flatnonzero(mask.any(0))
    if not len(rows):  # the object lies outside the photo
        # The object lies outside the photo.
        return _png(_resize_picture(rgb, *VLM.closeup))
    (y0, y1), (x0, x1) = ((int(line[0]), int(line[-1]) + 1) for line in (rows, columns))
    margin = max(ceil(VLM.margin * max(y1 - y0, x1 - x0)), 8)
    y0 = max(y0 - margin, 0)
    x0 = max(x0 - margin, 0)
    part = rgb[y0 : y1 + margin, x0 : x1 + margin]
    inside = mask[y0 : y1 + margin, x0 : x1 + margin]
    picture = _resize_picture(np.ascontiguousarray(part), *VLM.closeup).copy()
    fitted_mask = _resize_mask(inside, picture)
    picture[~fitted_mask] = (picture[~fitted_mask] * VLM.surroundings).astype(np.uint8)
    _draw_outline(picture, fitted_mask)
    return _png(picture)


def _resize_picture(rgb: Rgb, least_side: int, largest_side: int) -> Rgb:
    """Return a picture with a longer side from `least_side` to `largest_side` px."""
    height, width = rgb.shape[:2]
    factor = min(
        max(1.0, least_side / max(height, width)), largest_side / max(height, width)
    )
    if factor == 1:
        return rgb
    size = max(round(width * factor), 1), max(round(height * factor), 1)
    if factor < 1:
        method = cv2.INTER_AREA
    else:
        method = cv2.INTER_CUBIC
    return np.asarray(cv2.resize(rgb, size, interpolation=method), np.uint8)


def _resize_mask(mask: Mask, picture: Rgb) -> Mask:
    """Return a mask in the picture's size."""
    height, width = picture.shape[:2]
    if mask.shape == (height, width):
        return mask
    return np.asarray(cv2.resize(mask.astype(np.float32), (width, height)) >= 0.5)


def _draw_outline(picture: Rgb, mask: Mask) -> None:
    """Draw an outline around the mask, outside it so that the object stays visible."""
    dilated_mask = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    picture[dilated_mask & ~mask] = VLM.ink


def _png(rgb: Rgb) -> bytes:
    return cv2.imencode(".png", rgb[..., ::-1])[1].tobytes()


def plain_line(text: str, length: int = 300) -> str:
    """Return the printable characters of a text on one line, cut at a word.

    >>> plain_line("a  red\\n# ball\\x1b[0m")
    'a red # ball[0m'
    """
    line = " ".join("".join(c for c in text if c.isprintable() or c.isspace()).split())
    if len(line) <= length:
        return line
    return f"{line[:length].rpartition(' ')[0] or line[:length]} ..."
