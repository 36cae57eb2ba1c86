"""Tables of objects with true masses and orders of friction and elasticity, and files of answers about them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator

from physgen.files import write_atomic
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
_ANSWER = _object(
    {
        "name": _TEXT,
        "mass": {"anyOf": [_MASS, {"type": "null"}]},
        **{key: {"anyOf": [_COEFFICIENT, {"type": "null"}]} for key in COEFFICIENTS},
        "reason": _TEXT,
    },
    "name",
)
ANSWERS = _object({"by": _TEXT, "answers": {"type": "array", "items": _ANSWER}}, "answers")
"""JSON Schema of a file of answers."""


def _read(path: Path, schema: Mapping[str, Any]) -> Any:
    """Data of a YAML or JSON file that fits a schema. Raises InputError with everything that does not."""
    try:
        root = read(decode(path.read_bytes(), str(path)), Source(str(path), path.parent))
    except OSError as error:
        fix = "name a file as docs/properties.md describes it"
        raise InputError.of(str(path), "", f"cannot be read ({error.strerror})", fix) from None
    data = plain(root)
    problems = []
    for error in Draft202012Validator(schema).iter_errors(data):
        keys = list(error.absolute_path)
        place = _node(root, keys).place
        problems.append(Problem(place, dotted(keys), "", error.message, "see docs/properties.md"))
    if problems:
        raise InputError(problems)
    return data


def _node(node: Node, keys: list[str | int]) -> Node:
    for key in keys:
        node = children(node)[key] if isinstance(key, str) else items(node)[key]
    return node


def read_table(path: Path) -> Objects:
    """A table in YAML. Raises InputError with all problems."""
    data = _read(path, TABLE)
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


# ---- answers -----------------------------------------------------------------------------------------------------


def read_answers(path: Path, table: Objects) -> dict[str, Answer]:
    """By name, from JSON. Raises InputError for what cannot be read, is no number, or is missing."""
    problems: list[Problem] = []
    place = Place(str(path))
    found: dict[str, Answer] = {}
    names = [item.name for item in table.items]
    for row in _read(path, ANSWERS)["answers"]:
        name = row.pop("name")
        if name not in names:
            problems.append(
                Problem(place, "", quoted(name), "is no object of the table", suggestion(name, names))
            )
        if name in found:
            problems.append(Problem(place, "", quoted(name), "is answered twice", "keep one answer"))
        found[name] = Answer(**row)
    for key, needed in _needed(table):
        lack = [name for name in needed if getattr(found.get(name, Answer()), key) is None]
        if lack and not problems:
            some = ", ".join(lack[:6]) + (f" and {len(lack) - 6} more" if len(lack) > 6 else "")
            fix = "answer them all, or take them out of the table: a score over the answered ones alone would flatter"
            expected = f"is missing ({len(lack)} of {len(needed)})"
            problems.append(Problem(place, "", f"{key} of {some}", expected, fix))
    if problems:
        raise InputError(problems)
    return found


def _needed(table: Objects) -> Iterator[tuple[str, list[str]]]:
    """By number, the names of the objects that are compared."""
    yield "mass", [item.name for item in table.weighed]
    for of in COEFFICIENTS:
        ranked = {name for one in table.rankings if one.of == of for name in one.values}
        yield of, [item.name for item in table.items if item.name in ranked]


def write_answers(path: Path, answers: Mapping[str, Answer], source: str) -> None:
    """As `read_answers` takes them."""
    rows = [{"name": name, **asdict(answer)} for name, answer in answers.items()]
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"by": source, "answers": rows}, indent=1, ensure_ascii=False, allow_nan=False)
    write_atomic(path, f"{text}\n".encode())
