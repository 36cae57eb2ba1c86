"""Categories, labels and physical properties from a vision-language model behind a server.

The two questions of the paper (appendix, "Segmentation" and "Physical properties reasoning") in other words, and for
more answers: material, solid, rolling and true size, which gives the photo its scale.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, exp, log, sqrt
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry import raster
from physgen.geometry.polygon import Disc
from physgen.perceive.backends.vlm_client import Client, Query, object_schema, plain_line, read_settings
from physgen.perceive.roles import Category, Labels, Matter, Name, PhotoObject, Rgb
from physgen.perceive.scale import box_sides
from physgen.registry import Setup
from physgen.scene.scene import Solid

Mask = NDArray[np.bool_]


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


# --- questions and pictures ---

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
