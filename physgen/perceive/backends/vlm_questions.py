"""What a vision-language model is asked, in words of our own with the meaning of the paper's; its answers' schemas."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from physgen.perceive.backends import vlm_pictures as pictures
from physgen.perceive.backends.vlm_answers import Query, plain, record
from physgen.perceive.backends.vlm_matter import SCHEMA, impossible
from physgen.perceive.extent import sides
from physgen.perceive.roles import Labels, Rgb, Thing

MOST = 48
"""Characters of a name."""
EDGES = " \"'`.,;:*"
"""What names are rid of at their ends."""

CATEGORIES = record(
    categories={
        "type": "array",
        "minItems": 1,
        "items": record(
            noun={"type": "string", "minLength": 1, "description": "One word, singular, no hyphen"},
            movable={"type": "boolean"},
        ),
    }
)
WHAT = """\
Name every kind of thing and of surface that this photo shows, so that each part of it belongs to exactly
one kind, from the most striking to the least. Leave out nothing that stands, lies or hangs in it, and
neither the table, floor, wall or sky behind. For each kind write one noun, a single word in the singular
without a hyphen; no kind twice, and none that is part of another.
Say for each whether it is movable: true for separate things with an outline of their own (a ball, a cup, a
toy car) of which every one in the photo is seen whole, nothing of it hidden and not cut off by the photo's
edge, and could be pushed or lifted. False for surfaces and stuff (grass, water, a wall), for what is fixed
in place, and for what holds the rest.
Answer with one JSON object: {"categories": [{"noun": ..., "movable": true or false}, ...]}."""

WHO = """\
The first picture is a photo in which {count} outlined in magenta and numbered. The second shows each of
them close, with its number in the corner and its surroundings darkened.
Name each as one would tell it to somebody who has to guess its weight: a short English noun in the
singular, with the material before it where that can be seen ("wooden block", "tennis ball", "steel can",
"ceramic mug"). No numbers, no place, and no colour unless the name needs it.
Answer with one JSON object: {{"objects": [{{"number": ..., "name": ...}}, ...]}}, each of {numbers} exactly
once."""

HOW = """\
The first picture is a photo; one object in it{label} is outlined in magenta. The second picture shows that
object close, its surroundings darkened. Judge the real object, not its picture:
- reason: in one sentence, what it is, how large and of what, and how the mass follows from that; think of
  ordinary things of its kind, of what is hollow or filled, and of things beside it whose size is known
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


def what(rgb: Rgb) -> Query:
    """Which kinds of things and of surfaces a photo shows, and which of them are movable."""
    return Query("the photo", WHAT, (pictures.whole(rgb),), CATEGORIES, _named)


def _named(answer: Any) -> list[str]:
    """A list of marks and spaces names nothing."""
    return [] if any(name(one["noun"]) for one in answer["categories"]) else ["categories: none has a noun"]


def who(rgb: Rgb, labels: Labels, group: Sequence[Thing]) -> Query:
    """What several objects are called, by numbers from 1."""
    masks = {k: np.asarray(labels == thing.id) for k, thing in enumerate(group, 1)}
    n = len(group)
    count = "one object is" if n == 1 else f"{n} objects are"
    numbers = "number 1" if n == 1 else f"the numbers 1 to {n}"
    one = record(
        number={"type": "integer", "enum": list(masks)},
        name={"type": "string", "minLength": 1},
    )
    schema = record(objects={"type": "array", "items": one, "minItems": n, "maxItems": n})
    shown = pictures.marked(rgb, masks), pictures.sheet(rgb, masks)
    about = "one object" if n == 1 else f"{n} objects"
    return Query(about, WHO.format(count=count, numbers=numbers), shown, schema, _each(n))


def _each(n: int) -> Callable[[Any], list[str]]:
    def odd(answer: Any) -> list[str]:
        said = sorted(one["number"] for one in answer["objects"])
        nameless = [one["number"] for one in answer["objects"] if not name(one["name"])]
        return (
            [f"objects: numbers {said}, not each of 1 to {n} once"] if said != list(range(1, n + 1)) else []
        ) + [f"objects: number {k} has no name" for k in nameless]

    return odd


def how(rgb: Rgb, mask: pictures.Mask, thing: Thing, pixels_per_meter: float | None) -> Query:
    """What one object is made of, weighs and measures."""
    label = f', "{plain(thing.label, MOST)}",' if thing.label else ""
    hint = ""
    if pixels_per_meter is not None and not thing.cut:
        hint = f"; by the photo's scale it is about {sides(thing.outline)[0] / pixels_per_meter:.2g}"
    shown = pictures.marked(rgb, {thing.id: mask}), pictures.close(rgb, mask)
    about = plain(thing.label, MOST) or "an object"
    return Query(about, HOW.format(label=label, hint=hint), shown, SCHEMA, impossible)


def name(text: str) -> str:
    """A noun as labels are written: lower case, no quotes, no article.

    >>> name(' A "Tennis ball." ')
    'tennis ball'
    """
    line = plain(text, MOST).lower().strip(EDGES)
    for article in ("a ", "an ", "the "):
        line = line.removeprefix(article).strip(EDGES)
    return line
