"""Material table: density, friction, elasticity, rolling, gloss and ordinary size of what a label names."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import pi
from pathlib import Path
from typing import Any

import yaml

COVERS = {
    "ball": 1.0,
    "turned": 0.85,
    "disc": 1.0,
    "hoop": 0.75,
    "slab": 0.9,
    "lump": 1.0,
}
"""Share of its bounding form that an outline covers, where the row gives none."""
COLOURS = frozenset(
    [
        "orange",
        "lime",
        "lemon",
        "peach",
        "plum",
        "rose",
        "cherry",
        "apricot",
        "mushroom",
        "chocolate",
        "eggplant",
        "chestnut",
    ]
)
"""Words that name an object at the end of a label, and a colour before another word."""
OWN = ("friction", "elasticity", "rolling", "gloss")
"""Properties of the material that a noun may override."""
METAL = 6.0
"""g/cm³ from which a noun's material is a heavy metal, so that `silver` names the metal and not the colour."""
ALIKE = 1.12
"""Ratio of densities up to which two materials count as one for the mass."""
GROWN = frozenset(["fruit", "vegetable", "eggshell", "bread", "cheese", "flesh"])
"""Materials of food, of which there are copies in plastic."""
LIVING = frozenset(["person", "animal"])
"""Nouns of people and animals."""
VEHICLES = frozenset(["toy car", "die-cast car", "skateboard"])
"""Nouns of what drives forwards on wheels."""
TAIL = re.compile(r"\b(?:of|with|on|in|from|for|at|under|beside|made)\b|[,;:(/]")
"""Words and marks after which a label only describes the noun before them."""
PLACES = frozenset(
    [
        "left",
        "right",
        "middle",
        "top",
        "bottom",
        "front",
        "back",
        "one",
        "two",
        "three",
        "a",
        "b",
        "c",
    ]
)
"""Words that distinguish objects with the same name."""


@dataclass(frozen=True)
class Material:
    """One row of `materials:`; the keys are explained there."""

    name: str
    density: float
    """g/cm³ of the solid material."""
    friction: float
    elasticity: float
    rolling: float
    gloss: float
    """0..1: mirrored at 60°, against polished black glass (ISO 2813 gloss units / 100)."""
    walls: float
    """Wall thickness of hollow objects relative to ceramic."""
    source: str
    """Of the density."""
    surface: str
    """Source of friction, elasticity and rolling; `estimate` where there is none."""
    young: float = 5.0
    """GPa: Young's modulus."""
    poisson: float = 0.3
    """Poisson's ratio."""
    loss: float = 0.04
    """Loss factor of vibrations: a mode of f Hz decays by exp(-pi f loss t)."""
    stiffness: str = ""
    """Source of young, poisson and loss."""


@dataclass(frozen=True)
class Kind:
    """The kind of object that a label names."""

    noun: str
    """The row of `nouns:` that was found, `""` for none."""
    material: Material
    """With the noun's own friction, elasticity, rolling and gloss, where given."""
    form: str
    """`ball`, `turned`, `disc`, `hoop`, `slab`, `lump`; `""`: no opinion."""
    filled: float
    """Share of the volume that is material."""
    holds: float
    """g/cm³ of the content, over the whole volume."""
    size: tuple[float, ...]
    """mm, typical dimensions in the order of the form; empty where unknown."""
    spread: float
    """Relative standard deviation of the size."""
    mass: float | None
    """g, typical; None where unknown."""
    wall: float | None
    """mm, wall of a hollow ball whose filled share depends on its size."""
    core: tuple[float, float] | None
    """Diameter in mm below which a ball is solid, and its filled share then."""
    share: float
    """Share of its bounding form (box, cylinder, ellipsoid) that a typical object fills."""
    source: str

    @property
    def solid(self) -> str | None:
        """Return the solid behind a round outline: `sphere`, `disc` or `hoop`.

        None if the form is unknown.
        """
        round_outline = {"ball": "sphere", "lump": "sphere", "hoop": "hoop", "": None}
        return round_outline.get(self.form, "disc")

    @property
    def box(self) -> tuple[float, float, float] | None:
        """Return the sides of the bounding box of a typical object, mm.

        None if the size is unknown.
        """
        if not self.size:
            return None
        if self.form == "ball":
            return (self.size[0],) * 3
        if self.form == "turned":
            return self.size[0], self.size[1], self.size[1]
        if self.form in ("disc", "hoop"):
            return self.size[0], self.size[0], self.size[-1]
        return self.size[0], self.size[1], self.size[2]

    def hollowed(self, diameter: float) -> Kind:
        """Return the kind with the filled share of a ball of `diameter` mm; other forms unchanged.

        >>> round(kind("plastic ball").hollowed(70).filled, 3), kind("steel ball").hollowed(70).filled
        (0.083, 1.0)
        >>> [round(kind("leather ball").hollowed(diameter).filled, 2) for diameter in (70, 200)]
        [0.73, 0.14]
        """
        if self.core is not None and diameter < self.core[0]:
            return replace(self, filled=self.core[1])
        if self.wall is None:
            return self
        return replace(self, filled=1 - max(1 - 2 * self.wall / diameter, 0) ** 3)

    @property
    def density(self) -> float:
        """Return the density over the whole volume, g/cm³: walls, gaps and content."""
        return self.filled * self.material.density + self.holds


def kind(label: str) -> Kind:
    """Return the kind of object that a label names; unknown words give the material `unknown`.

    >>> kind("yellow billiard balls").mass, kind("wooden block").material.name, kind("object").noun
    (170, 'wood', '')
    >>> kind("tin of tomatoes").noun, kind("steel ball").filled, kind("cork ball").material.name
    ('tin', 1.0, 'cork')
    """
    text = label.lower()[:LONGEST_LABEL]
    head = _words(TAIL.split(text, maxsplit=1)[0])
    while len(head) > 1 and (head[-1] in PLACES or head[-1].isdigit()):
        head.pop()
    words = _words(text)
    span, noun = _noun(words, len(head))
    is_whole = bool(noun) and PART.search(text) is None
    if not noun:
        # In "a slice of melon", the material is melon and the size unknown.
        span, noun = _noun(words, len(words))
    row: Mapping[str, Any] = _table()[1].get(noun, {})
    material = _material_named(words, span, len(head), row)
    result = _row(noun, row, material)
    if not is_whole:
        result = replace(result, mass=None, size=())
    if result.holds and EMPTY.search(text):
        result = replace(result, holds=0.0, mass=None)
    is_container = row.get("hollow") and "holds" not in row
    if is_container and FULL.search(text):
        result = replace(result, holds=FULL_CONTENT, mass=None)
    return result


LONGEST_LABEL = 400
"""Characters of a label that are read."""
PART = re.compile(r"\b(?:half|slice|piece|broken)\b")
"""Words for a part of an object, whose size is unknown."""
EMPTY = re.compile(r"\bempty\b")
FULL = re.compile(
    r"\b(?:full|filled)\b|\b(?:cup|mug|glass|bowl|jug|bucket|saucepan) of\b"
)
"""Words for a container with a content."""
FULL_CONTENT = 0.6
"""g/cm³ of the content of a full container: water with air above it, over the whole volume."""


PAINTED_BALLS = ("billiard ball", "snooker ball")
"""Nouns of balls that wear one or two flat paints, all around alike."""


def is_billiard_ball(label: str) -> bool:
    """Return whether a label names a ball of billiards.

    >>> is_billiard_ball("yellow pool ball"), is_billiard_ball("apple")
    (True, False)
    """
    return kind(label).noun in PAINTED_BALLS


OPEN_VESSELS = frozenset(
    [
        "mug",
        "cup",
        "espresso cup",
        "paper cup",
        "plastic cup",
        "drinking glass",
        "bowl",
        "jug",
        "milk jug",
        "sugar bowl",
        "vase",
        "pot",
        "jar",
        "bucket",
        "basket",
        "flower pot",
    ]
)
"""Nouns of upright vessels with an opening at their top."""
SHALLOW_VESSELS = frozenset(["saucer", "plate"])
"""Nouns of vessels whose inside is as bright as their outside."""
CLOSED = re.compile(
    r"\b(?:closed|sealed|corked|covered|lidded|inverted|overturned|upturned)\b"
    r"|\bupside[ -]down\b|\bwith (?:a |an |its |the |\w+ )?(?:lid|cover|cap|cork)\b"
    r"|\b(?:cup|mug|glass|bowl|jug|vase|pot|jar|bucket|basket)s? of\b"
)
"""Words for a vessel that is closed, full or the wrong way up."""


def is_open_vessel(label: str) -> bool:
    """Return whether a label names a vessel that is open without its lid.

    >>> is_open_vessel("sugar bowl"), is_open_vessel("tin of tomatoes")
    (True, False)
    >>> is_open_vessel("jar with a lid"), is_open_vessel("upside-down cup")
    (False, False)
    """
    is_closed = CLOSED.search(label.lower()[:LONGEST_LABEL]) is not None
    return not is_closed and kind(label).noun in OPEN_VESSELS


def is_shallow_vessel(label: str) -> bool:
    """Return whether a label names a vessel whose whole inside is lit.

    >>> is_shallow_vessel("saucer"), is_shallow_vessel("cup")
    (True, False)
    """
    is_closed = CLOSED.search(label.lower()[:LONGEST_LABEL]) is not None
    return not is_closed and kind(label).noun in SHALLOW_VESSELS


MIRROR = 0.6
"""Gloss from which a bare metal mirrors its surroundings."""
METAL_NOUNS = frozenset(["", "ball", "steel ball", "ball bearing"])
"""Nouns of objects that are of bare metal if their label names a metal."""
DULL = re.compile(
    r"\b(?:painted|lacquered|enamell?ed|coated|anodi[sz]ed|brushed|matte?|rust(?:y|ed)"
    r"|dull|patterned|striped)\b"
)
"""Words for metal that is no mirror."""


def is_polished_metal(label: str) -> bool:
    """Return whether a label names an object of polished, bare metal.

    >>> is_polished_metal("brass ball"), is_polished_metal("iron ball"), is_polished_metal("marble")
    (True, False, False)
    >>> is_polished_metal("painted metal ball"), is_polished_metal("steel football")
    (False, False)
    """
    metal_kind = kind(label)
    is_dull = DULL.search(label.lower()[:LONGEST_LABEL]) is not None
    material = metal_kind.material
    is_mirror = material.density > METAL and material.gloss >= MIRROR
    return is_mirror and metal_kind.noun in METAL_NOUNS and not is_dull


BOOKS = frozenset(["book", "notebook"])
"""Nouns of objects with pages between two covers."""


def is_book(label: str) -> bool:
    """Return whether a label names a book.

    >>> is_book("old dictionary"), is_book("toaster")
    (True, False)
    """
    return kind(label).noun in BOOKS


def drawn_kinds(label: str) -> tuple[bool, ...]:
    """Return all properties of a label that decide how its object is drawn."""
    properties = (is_billiard_ball, is_open_vessel, is_polished_metal, is_book)
    return tuple(has_property(label) for has_property in properties)


def is_living(label: str) -> bool:
    """Return whether a label names a person or an animal, not a toy or a picture of one.

    >>> is_living("dog"), is_living("old man"), is_living("toy dog"), is_living("teddy bear")
    (True, True, False, False)
    """
    result = kind(label)
    return result.noun in LIVING and result.material.name == "flesh"


def is_vehicle(label: str) -> bool:
    """Return whether a label names something that drives on wheels.

    >>> is_vehicle("red car"), is_vehicle("skateboard"), is_vehicle("carton")
    (True, True, False)
    """
    return kind(label).noun in VEHICLES


def materials() -> Iterator[Material]:
    """Return every material of the table."""
    return (_material(name) for name in _table()[0])


def nouns() -> Iterator[tuple[Kind, Sequence[str]]]:
    """Yield every noun of the table, with its words."""
    for noun, row in _table()[1].items():
        yield _row(noun, row, None), row["words"]


def _row(noun: str, row: Mapping[str, Any], name: str | None) -> Kind:
    """Return the kind of a row, made of the material `name`; None: the row's own material."""
    own_material = _material(row.get("material", "unknown"))
    material = own_material if name is None else _material(name)
    ratio = material.density / own_material.density
    is_alike = bool(noun) and 1 / ALIKE < ratio < ALIKE
    if name is None or is_alike:
        return _kind_of_row(noun, row, material, ratio)
    typical = _typical_kind(noun, row, material)
    full_mass, holds = _typical_filled(typical, row, own_material), typical.holds
    if row.get("solid_of") or typical.form == "ball":
        full_mass, holds = 1.0, 0.0
    elif row.get("hollow"):
        full_mass = min(full_mass * material.walls / own_material.walls, 1.0)
    wall = None
    if own_material.name in GROWN:
        wall = _table()[0][material.name].get("copies")
    return replace(
        typical,
        filled=full_mass,
        holds=holds,
        mass=None,
        wall=wall,
        source=material.source,
    )


def _kind_of_row(
    noun: str, row: Mapping[str, Any], material: Material, ratio: float
) -> Kind:
    """Return the kind of a row whose material, or one of about the same density, it has.

    `ratio`: density relative to that of the row's own material.
    """
    own_material = _material(row.get("material", "unknown"))
    overrides = {key: row[key] for key in OWN if key in row}
    surface = _surface(noun, material.surface, row)
    material = replace(material, **overrides, surface=surface)
    typical = _typical_kind(noun, row, material)
    full_mass = _typical_filled(typical, row, own_material)
    if typical.mass is not None:
        full_mass /= ratio
    core = tuple(row["core"]) if "core" in row else None
    source = row["source"] if noun else material.source
    return replace(
        typical, filled=full_mass, wall=row.get("wall"), core=core, source=source
    )


def _typical_kind(noun: str, row: Mapping[str, Any], material: Material) -> Kind:
    """Return the kind with the row's form, size, mass and content."""
    form = row.get("form", "")
    return Kind(
        noun,
        material,
        form=form,
        filled=row.get("filled", 1.0),
        holds=row.get("holds", 0.0),
        size=tuple(row.get("size", ())),
        spread=row.get("spread", 0.3),
        mass=row.get("mass"),
        wall=None,
        core=None,
        share=float(row.get("share", COVERS.get(form, 1.0))),
        source="",
    )


def _typical_filled(
    typical: Kind, row: Mapping[str, Any], own_material: Material
) -> float:
    """Return the filled share of a typical object."""
    if typical.mass is None or typical.box is None or "filled" in row:
        return typical.filled
    # Walls and gaps follow from the typical mass.
    density = typical.mass / (_volume(typical) / 1000) - typical.holds
    return max(density, 0.0001 * own_material.density) / own_material.density


def _surface(noun: str, general: str, row: Mapping[str, Any]) -> str:
    """Return the source of a material's surface values, and of those that the noun overrides."""
    keys = [key for key in OWN if key in row and key != "gloss"]
    if not keys:
        return general
    own_source = f"{', '.join(keys)} of {noun}: estimate"
    if "surface" in row:
        own_source = f"elasticity of {noun}: {row['surface']}"
    parts = [
        part for part in general.split("; ") if not part.startswith((*keys, "estimate"))
    ]
    return "; ".join([*parts, own_source])


def _volume(typical: Kind) -> float:
    """Return the volume of the typical object, mm³."""
    assert typical.box is not None
    a, b, c = typical.box
    fill_factor = {"ball": pi / 6, "lump": pi / 6, "slab": 1.0}.get(
        typical.form, pi / 4
    )
    return a * b * c * fill_factor * typical.share


def _noun(words: Sequence[str], head: int) -> tuple[tuple[int, int], str]:
    """Return span and row of the noun in the first `head` words: the last one, and of those the longest."""
    best_rank, result = (-1, -1, -1), ((0, 0), "")
    for start in range(head):
        last_end = min(start + LONGEST_NOUN, len(words))
        for end in range(start + 1, last_end + 1):
            for phrase in _variants(words[start:end]):
                noun = _phrases()[1].get(phrase)
                if noun is None:
                    continue
                is_attribute = phrase in COLOURS or phrase in _phrases()[0]
                if is_attribute and end < head:
                    continue  # It names an object only at the end: a cork, but a cork ball.
                rank = (min(end, head), end - start, len(phrase))
                if rank > best_rank:
                    best_rank, result = rank, ((start, end), noun)
    return result


LONGEST_NOUN = 5
"""Words of a noun of the table, at most."""
LONGEST_MATERIAL = 3
"""Words of a material of the table, at most."""


def _material_named(
    words: Sequence[str], span: tuple[int, int], head: int, row: Mapping[str, Any]
) -> str | None:
    """Return the material that a label names: the last before its noun, else after it unless that is the content."""
    if not row:
        return _last_material(words, 0, len(words), has_tints=True)
    for start in range(span[0], span[1] - 1):
        for end in range(start + 1, span[1]):
            if _phrases()[0].get(" ".join(words[start:end])) == row["material"]:
                # The noun names its material, as "rubber ball" does, unless it is a foam rubber ball.
                phrase = " ".join(words[max(start - 1, 0) : end])
                compound = _phrases()[0].get(phrase)
                return compound if compound != row["material"] else None
    is_metal = _material(row.get("material", "unknown")).density > METAL
    is_container = row.get("hollow") or row.get("holds")
    last_end = head if is_container else len(words)
    material = _last_material(words, 0, span[0], has_tints=is_metal)
    if material is None:
        material = _last_material(words, span[1], last_end, has_tints=is_metal)
    return material


def _last_material(
    words: Sequence[str], first: int, last: int, has_tints: bool
) -> str | None:
    """Return the last material that `words[first:last]` name, of those the longest.

    `has_tints`: words that are also colours, such as silver, name the material.
    """
    best_rank, result = (-1, -1), None
    for start in range(first, last):
        for end in range(start + 1, min(start + LONGEST_MATERIAL, last) + 1):
            for phrase in _variants(words[start:end]):
                name = _phrases()[0].get(phrase)
                if not name or (_table()[0][name].get("tint") and not has_tints):
                    continue
                if (end, end - start) > best_rank:
                    best_rank, result = (end, end - start), name
    return result


def _material(name: str) -> Material:
    row = _table()[0][name]
    keys = (
        "density",
        "friction",
        "elasticity",
        "rolling",
        "gloss",
        "walls",
        "source",
        "surface",
        "young",
        "poisson",
        "loss",
        "stiffness",
    )
    return Material(name, **{key: row[key] for key in keys})


def _words(text: str) -> list[str]:
    return re.findall(r"[a-z0-9]+", text)


def _variants(words: Sequence[str]) -> Iterator[str]:
    """Yield a phrase as written, and with its last word in the singular.

    >>> sorted(_variants(["kitchen", "knives"]))
    ['kitchen knif', 'kitchen knife', 'kitchen kniv', 'kitchen knive', 'kitchen knives']
    """
    phrase = " ".join(words)
    yield phrase
    for plural, singular in PLURALS:
        if phrase.endswith(plural) and len(words[-1]) > len(plural) + 1:
            yield phrase[: -len(plural)] + singular


PLURALS = (("ies", "y"), ("ves", "f"), ("ves", "fe"), ("es", ""), ("s", ""))
"""Endings of plurals and of their singulars."""


@cache
def _phrases() -> tuple[dict[str, str], dict[str, str]]:
    """Return the rows of `materials:` and of `nouns:` by phrase.

    A phrase of two words also as one.
    """
    materials, nouns = _table()
    return _rows_by_phrase(materials), _rows_by_phrase(nouns)


def _rows_by_phrase(rows: Mapping[str, Any]) -> dict[str, str]:
    names: dict[str, str] = {}
    for name, row in rows.items():
        for phrase in row["words"]:
            words = _words(phrase)
            if len(words) == 2:
                names.setdefault("".join(words), name)
            names[" ".join(words)] = name
    return names


@cache
def _table() -> tuple[dict[str, Any], dict[str, Any]]:
    text = Path(__file__).with_name("materials.yaml").read_text(encoding="utf-8")
    table = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    return table["materials"], table["nouns"]
