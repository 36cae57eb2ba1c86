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
COLOURS = frozenset([
    "orange", "lime", "lemon", "peach", "plum", "rose", "cherry", "apricot", "mushroom", "chocolate", "eggplant",
    "chestnut",
])  # fmt: skip
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
PLACES = frozenset([
    "left", "right", "middle", "top", "bottom", "front", "back", "one", "two", "three", "a", "b", "c",
])  # fmt: skip
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
        """The solid behind a round outline: `sphere`, `disc` or `hoop`; None where the form is unknown."""
        round_outline = {"ball": "sphere", "lump": "sphere", "hoop": "hoop", "": None}
        return round_outline.get(self.form, "disc")

    @property
    def box(self) -> tuple[float, float, float] | None:
        """mm, sides of the bounding box of a typical object; None where the size is unknown."""
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
        """The kind with the filled share of a ball of `diameter` mm; other forms unchanged.

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
        """g/cm³ over the whole volume: walls, gaps and content."""
        return self.filled * self.material.density + self.holds


def kind(label: str) -> Kind:
    """The kind of object that a label names; unknown words give the material `unknown`.

    >>> kind("yellow billiard balls").mass, kind("wooden block").material.name, kind("object").noun
    (170, 'wood', '')
    >>> kind("tin of tomatoes").noun, kind("steel ball").filled, kind("cork ball").material.name
    ('tin', 1.0, 'cork')
    """
    text = label.lower()[:400]
    head = _words(TAIL.split(text, maxsplit=1)[0])
    while len(head) > 1 and (head[-1] in PLACES or head[-1].isdigit()):
        head.pop()
    words = _words(text)
    span, noun = _noun(words, len(head))
    whole = bool(noun)
    if not noun:  # "a slice of melon": the material is melon, the size unknown
        span, noun = _noun(words, len(words))
    row: Mapping[str, Any] = _table()[1].get(noun, {})
    named = _material_named(words, span, len(head), row)
    found = _row(noun, row, named)
    if not whole or re.search(r"\b(?:half|slice|piece|broken)\b", text):
        found = replace(found, mass=None, size=())
    if re.search(r"\bempty\b", text) and found.holds:
        found = replace(found, holds=0.0, mass=None)
    if (
        row.get("hollow")
        and "holds" not in row
        and re.search(
            r"\b(?:full|filled)\b|\b(?:cup|mug|glass|bowl|jug|bucket|saucepan) of\b",
            text,
        )
    ):
        found = replace(found, holds=0.6, mass=None)
    return found


PAINTED_BALLS = ("billiard ball", "snooker ball")
"""Nouns of balls that wear one or two flat paints, all around alike."""


def is_billiard_ball(label: str) -> bool:
    """Return whether a label names a ball of billiards.

    >>> is_billiard_ball("yellow pool ball"), is_billiard_ball("apple")
    (True, False)
    """
    return kind(label).noun in PAINTED_BALLS


def is_living(label: str) -> bool:
    """Return whether a label names a person or an animal, not a toy or a picture of one.

    >>> is_living("dog"), is_living("old man"), is_living("toy dog"), is_living("teddy bear")
    (True, True, False, False)
    """
    what = kind(label)
    return what.noun in LIVING and what.material.name == "flesh"


def is_vehicle(label: str) -> bool:
    """Return whether a label names something that drives on wheels.

    >>> is_vehicle("red car"), is_vehicle("skateboard"), is_vehicle("carton")
    (True, True, False)
    """
    return kind(label).noun in VEHICLES


def materials() -> Iterator[Material]:
    """Every material of the table."""
    return (_material(name) for name in _table()[0])


def nouns() -> Iterator[tuple[Kind, Sequence[str]]]:
    """Every noun of the table, with the words that mean it."""
    return ((_row(noun, row, None), row["words"]) for noun, row in _table()[1].items())


def _row(noun: str, row: Mapping[str, Any], named: str | None) -> Kind:
    """The kind that a row describes, made of the material `named`; None: the row's own material."""
    own = _material(row.get("material", "unknown"))
    material = own if named is None else _material(named)
    ratio = material.density / own.density
    other = named is not None and (not noun or not 1 / ALIKE < ratio < ALIKE)
    if not other:
        overrides = {key: row[key] for key in OWN if key in row}
        material = replace(
            material, **overrides, surface=_surface(noun, material.surface, row)
        )
    form, size, mass, holds = (
        row.get("form", ""),
        tuple(row.get("size", ())),
        row.get("mass"),
        row.get("holds", 0.0),
    )
    share = float(row.get("share", COVERS.get(form, 1.0)))
    filled = row.get("filled", 1.0)
    plain = Kind(
        noun,
        material,
        form,
        filled,
        holds,
        size,
        row.get("spread", 0.3),
        mass,
        None,
        None,
        share,
        "",
    )
    if mass is not None and plain.box is not None and "filled" not in row:
        # walls and gaps follow from the typical mass
        filled = (
            max(mass / (_volume(plain) / 1000) - holds, 0.0001 * own.density)
            / own.density
        )
    if other and (row.get("solid_of") or form == "ball"):
        filled, holds = 1.0, 0.0
    elif other and row.get("hollow"):
        filled = min(filled * material.walls / own.walls, 1.0)
    elif not other and mass is not None:
        filled /= ratio
    source = row["source"] if noun and not other else material.source
    if other:
        wall = _table()[0][material.name].get("copies") if own.name in GROWN else None
        return replace(
            plain, filled=filled, holds=holds, mass=None, wall=wall, source=source
        )
    core = tuple(row["core"]) if "core" in row else None
    return replace(
        plain,
        filled=filled,
        holds=holds,
        wall=row.get("wall"),
        core=core,
        source=source,
    )


def _surface(noun: str, general: str, row: Mapping[str, Any]) -> str:
    """The source of a material's surface values, with those that the noun overrides."""
    own = [key for key in OWN if key in row and key != "gloss"]
    if not own:
        return general
    rest = [
        part for part in general.split("; ") if not part.startswith((*own, "estimate"))
    ]
    ours = (
        f"elasticity of {noun}: {row['surface']}"
        if "surface" in row
        else f"{', '.join(own)} of {noun}: estimate"
    )
    return "; ".join([*rest, ours])


def _volume(what: Kind) -> float:
    """mm³ of the typical object."""
    assert what.box is not None
    a, b, c = what.box
    rounded = {"ball": pi / 6, "lump": pi / 6, "slab": 1.0}.get(what.form, pi / 4)
    return a * b * c * rounded * what.share


def _noun(words: Sequence[str], head: int) -> tuple[tuple[int, int], str]:
    """Span and row of the noun in the first `head` words: the last one, and of those the longest."""
    best, result = (-1, -1, -1), ((0, 0), "")
    for i in range(head):
        for j in range(i + 1, min(i + 5, len(words)) + 1):
            for phrase in _variants(words[i:j]):
                noun = _phrases()[1].get(phrase)
                if noun is None or (
                    j < head and (phrase in COLOURS or phrase in _phrases()[0])
                ):
                    continue  # a word that names an object only at the end: a cork, but a cork ball
                key = (min(j, head), j - i, len(phrase))
                if key > best:
                    best, result = key, ((i, j), noun)
    return result


def _material_named(
    words: Sequence[str], span: tuple[int, int], head: int, row: Mapping[str, Any]
) -> str | None:
    """The material that a label names: the last before its noun, else after it unless that is the content."""
    table, metal = (
        _table()[0],
        _material(row.get("material", "unknown")).density > METAL,
    )
    of = not row.get("hollow") and not row.get("holds")
    for i in range(span[0], span[1] - 1):
        for j in range(i + 1, span[1]):
            inside = _phrases()[0].get(" ".join(words[i:j]))
            if (
                inside == row["material"]
            ):  # "rubber ball", unless it is a foam rubber ball
                before = _phrases()[0].get(" ".join(words[max(i - 1, 0) : j]))
                return before if before != inside else None
    spans = (
        [(0, span[0]), (span[1], len(words) if of else head)]
        if row
        else [(0, len(words))]
    )
    for start, end in spans:
        best, result = (-1, -1), None
        for i in range(start, end):
            for j in range(i + 1, min(i + 3, end) + 1):
                for phrase in _variants(words[i:j]):
                    name = _phrases()[0].get(phrase)
                    if (
                        name
                        and (not row or metal or not table[name].get("tint"))
                        and (j, j - i) > best
                    ):
                        best, result = (j, j - i), name
        if result is not None:
            return result
    return None


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
    )
    return Material(name, **{key: row[key] for key in keys})


def _words(text: str) -> list[str]:
    return re.findall(r"[a-z0-9]+", text)


def _variants(words: Sequence[str]) -> Iterator[str]:
    """A phrase as it stands, and with its last word in the singular.

    >>> sorted(_variants(["kitchen", "knives"]))
    ['kitchen knif', 'kitchen knife', 'kitchen kniv', 'kitchen knive', 'kitchen knives']
    """
    yield (phrase := " ".join(words))
    for plural, singular in (
        ("ies", "y"),
        ("ves", "f"),
        ("ves", "fe"),
        ("es", ""),
        ("s", ""),
    ):
        if phrase.endswith(plural) and len(words[-1]) > len(plural) + 1:
            yield phrase[: -len(plural)] + singular


@cache
def _phrases() -> tuple[dict[str, str], dict[str, str]]:
    """Phrase -> row of `materials:`, and of `nouns:`; a phrase of two words also written as one."""
    both: tuple[dict[str, str], dict[str, str]] = ({}, {})
    for found, rows in zip(both, _table(), strict=True):
        for name, row in rows.items():
            for phrase in row["words"]:
                words = _words(phrase)
                if len(words) == 2:
                    found.setdefault("".join(words), name)
                found[" ".join(words)] = name
    return both


@cache
def _table() -> tuple[dict[str, Any], dict[str, Any]]:
    text = Path(__file__).with_name("materials.yaml").read_text(encoding="utf-8")
    table = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    return table["materials"], table["nouns"]
