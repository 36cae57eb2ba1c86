"""Tables of objects with true masses and orders of friction and elasticity, and answers about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator

from physgen.problems import InputError, Place, Problem
from physgen.registry import suggestion
from physgen.scene.document import Node, Source, children, decode, items, plain, read
from physgen.text import dotted, quoted

SHIPPED = Path(__file__).with_name("objects.yaml")
COEFFICIENTS = ("friction", "elasticity")
NUMBERS = ("mass", *COEFFICIENTS)


class Form(Enum):
    """Shape of an object without a photo, which decides the numbers of its size."""

    BALL = "ball"
    TURNED = "turned"
    BOX = "box"


LENGTHS = {Form.BALL: 1, Form.TURNED: 2, Form.BOX: 3}
"""Numbers of a form's size."""


@dataclass(frozen=True)
class Item:
    """One object."""

    name: str
    label: str
    """What it is called when a backend is asked."""
    form: Form = Form.BOX
    size: tuple[float, ...] = ()
    """mm: diameter of a ball; height and diameter of a turned object; three sides of a box. Empty: not known."""
    mass: float | None = None
    """g, true."""
    photo: Path | None = None
    mask: Path | None = None
    """A label map of the photo's size; all that is not 0 is the object."""


@dataclass(frozen=True)
class Ranking:
    """Coefficients that were measured in one way."""

    of: str
    """`friction` or `elasticity`."""
    about: str
    source: str
    values: Mapping[str, float]
    """By the objects' names."""


@dataclass(frozen=True)
class Objects:
    """A table."""

    title: str
    source: str
    items: tuple[Item, ...]
    rankings: tuple[Ranking, ...]

    @property
    def weighed(self) -> tuple[Item, ...]:
        """Those with a known mass."""
        return tuple(item for item in self.items if item.mass is not None)


@dataclass(frozen=True)
class Answer:
    """Of one object; None: no answer."""

    mass: float | None = None
    """g."""
    friction: float | None = None
    elasticity: float | None = None
    reason: str = ""


def _object(properties: Mapping[str, Any], *required: str) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": False,
    }


_TEXT, _COEFFICIENT = {"type": "string"}, {"type": "number", "minimum": 0}
_MASS = {"type": "number", "exclusiveMinimum": 0}
_RANKING = _object(
    {
        "about": _TEXT,
        "source": _TEXT,
        "values": {"type": "object", "minProperties": 2, "additionalProperties": _COEFFICIENT},
    },
    "values",
)
_ITEM = _object(
    {
        "label": _TEXT,
        "form": {"enum": [form.value for form in Form]},
        "size": {"type": "array", "items": _MASS},
        "mass": _MASS,
        "photo": _TEXT,
        "mask": _TEXT,
    }
)
TABLE = _object(
    {
        "title": _TEXT,
        "source": _TEXT,
        "objects": {"type": "object", "additionalProperties": _ITEM},
        "rankings": _object({of: {"type": "array", "items": _RANKING} for of in COEFFICIENTS}),
    },
    "objects",
)
"""JSON Schema of a table."""


def read_table(path: Path) -> Objects:
    """A table in YAML. Raises InputError with all problems."""
    try:
        root = read(decode(path.read_bytes(), str(path)), Source(str(path), path.parent))
    except OSError as error:
        fix = "name a table as docs/properties.md describes it"
        raise InputError.of(str(path), "", f"cannot be read ({error.strerror})", fix) from None
    data = plain(root)
    problems = []
    for wrong in Draft202012Validator(TABLE).iter_errors(data):
        keys = tuple(wrong.absolute_path)
        place = _node(root, keys).place
        problems.append(Problem(place, dotted(keys), "", wrong.message, "see docs/properties.md"))
    if problems:
        raise InputError(problems)
    return _table(data, path)


def _node(node: Node, keys: tuple[str | int, ...]) -> Node:
    for key in keys:
        node = children(node)[key] if isinstance(key, str) else items(node)[key]
    return node


def _table(data: Mapping[str, Any], path: Path) -> Objects:
    problems: list[Problem] = []
    objects = tuple(_item(name, row, path, problems) for name, row in data["objects"].items())
    rankings = []
    for of, several in data.get("rankings", {}).items():
        for one in several:
            for name in one["values"]:
                if name not in data["objects"]:
                    fix = suggestion(name, sorted(data["objects"]))
                    problems.append(
                        Problem(Place(str(path)), f"rankings.{of}", quoted(name), "is no object", fix)
                    )
            rankings.append(Ranking(of, one.get("about", ""), one.get("source", ""), one["values"]))
    table = Objects(data.get("title", path.name), data.get("source", ""), objects, tuple(rankings))
    if not table.weighed and not rankings:
        fix = "give objects a mass in g, or write a ranking"
        problems.append(Problem(Place(str(path)), "", "", "has nothing to compare answers with", fix))
    if problems:
        raise InputError(problems)
    return table


def _item(name: str, row: Mapping[str, Any], path: Path, problems: list[Problem]) -> Item:
    def wrong(found: str, expected: str, fix: str) -> None:
        problems.append(Problem(Place(str(path)), f"objects.{name}", found, expected, fix))

    form, size = Form(row.get("form", "box")), tuple(row.get("size", ()))
    if size and len(size) != LENGTHS[form]:
        wrong(
            str(list(size)), f"is not {LENGTHS[form]} lengths in mm, as a {form.value} has", "write them all"
        )
    photo, mask = (path.parent / row[key] if key in row else None for key in ("photo", "mask"))
    if (photo is None) != (mask is None):
        wrong("", "has a photo or a mask alone", "a photo needs a label map of the object, in its size")
    for file in (photo, mask):
        if file is not None and not file.is_file():
            wrong(quoted(file.name), "is not there", "name a file, from the table's folder")
    label = row.get("label", name.replace("-", " ").replace("_", " "))
    return Item(name, label, form, size, row.get("mass"), photo, mask)
