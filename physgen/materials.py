"""A label -> what such a thing is made of, weighs and measures; the table is `materials.yaml`, with its sources."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import yaml


@dataclass(frozen=True)
class Material:
    """One row of `materials:`."""

    name: str
    density: float
    """g/cm³ of the solid material."""
    friction: float
    elasticity: float
    source: str


@dataclass(frozen=True)
class Kind:
    """What a label stands for."""

    noun: str
    """The row of `nouns:` that was found, `""` for none."""
    material: Material
    """With the noun's own friction and elasticity, where it has them."""
    filled: float
    """Share of the volume that is material."""
    mass: float | None
    """g of the ordinary thing, None where there is none."""
    size: float | None
    """mm: its longest side or diameter; None where there is no ordinary size."""
    solid: str | None
    """`sphere`, `disc`, `hoop` or `plate`, if the outline is round; None: no opinion."""
    source: str


def kind(label: str) -> Kind:
    """The kind of thing that a label names; unknown words give the material `unknown`.

    >>> kind("yellow billiard ball").mass, kind("wooden block").material.name, kind("thing").noun
    (170, 'wood', '')
    """
    words = " ".join(_words(label))
    materials, nouns = _table()
    named = next(
        (m for m, row in materials.items() if any(_holds(words, word) for word in row["words"])), None
    )
    noun = max(
        ((len(word), n) for n, row in nouns.items() for word in row["words"] if _holds(words, word)),
        default=(0, ""),
        key=lambda found: found[0],
    )[1]
    row: Mapping[str, Any] = nouns.get(noun, {})
    # "wooden ball" is a ball of wood: solid, and of no ordinary weight
    other = named is not None and named != row.get("material")
    material = _material(named if named is not None else row.get("material", "unknown"))
    if not other:
        material = replace(
            material,
            friction=row.get("friction", material.friction),
            elasticity=row.get("elasticity", material.elasticity),
        )
    return Kind(
        noun=noun,
        material=material,
        filled=1.0 if other else row.get("filled", 1.0),
        mass=None if other else row.get("mass"),
        size=row.get("size"),
        solid=row.get("solid"),
        source=material.source if other or not noun else row["source"],
    )


def materials() -> Iterator[Material]:
    """Every material of the table."""
    return (_material(name) for name in _table()[0])


def _material(name: str) -> Material:
    row = _table()[0][name]
    return Material(name, row["density"], row["friction"], row["elasticity"], row["source"])


def _words(label: str) -> list[str]:
    """Lower case, without a plural s that the table does not know."""
    return re.findall(r"[a-z0-9-]+", label.lower())


def _holds(words: str, phrase: str) -> bool:
    return re.search(rf"(?<![a-z]){re.escape(phrase)}(?:s|es)?(?![a-z])", words) is not None


@cache
def _table() -> tuple[dict[str, Any], dict[str, Any]]:
    text = Path(__file__).with_name("materials.yaml").read_text(encoding="utf-8")
    table = yaml.safe_load(text)
    return table["materials"], table["nouns"]
