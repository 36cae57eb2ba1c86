"""A table of objects, YAML or CSV -> what is asked of each and what is true; every fault with its line."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from math import isfinite
from pathlib import Path
from typing import Any

from physgen.problems import InputError, Place, Problem
from physgen.registry import suggestion
from physgen.scene.document import Node, Source, children, decode, items, plain, read
from physgen.text import quoted

SHIPPED = Path(__file__).with_name("objects.yaml")
COEFFICIENTS = ("friction", "elasticity")
KEYS = ("label", "form", "size", "mass", *COEFFICIENTS, "photo", "mask")
"""Of an object; a CSV has `name` before them."""


class Form(Enum):
    """What an object looks like where there is no photo of it."""

    BALL = "ball"
    TURNED = "turned"
    BOX = "box"


SIDES = {Form.BALL: 1, Form.TURNED: 2, Form.BOX: 3}
"""Numbers that a form's size has."""


@dataclass(frozen=True)
class Item:
    """One object."""

    name: str
    label: str
    """What whoever is asked is told that it is."""
    form: Form = Form.BOX
    size: tuple[float, ...] = ()
    """mm: diameter of a ball; height and diameter of what is turned; three sides of a box. Empty: not known."""
    mass: float | None = None
    """g, as it truly is; None: nobody knows."""
    photo: Path | None = None
    mask: Path | None = None
    """A label map of the photo's size; all that is not 0 is the object."""


@dataclass(frozen=True)
class Ranking:
    """What was compared in one way."""

    of: str
    """`friction`, `elasticity`."""
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
        """Those whose mass is known."""
        return tuple(item for item in self.items if item.mass is not None)


@dataclass(frozen=True)
class _Row:
    """One object as it is written: values with their places."""

    name: str
    place: Place
    values: Mapping[str, tuple[Any, Place]]


def read_table(path: Path) -> Objects:
    """Raises InputError with everything that is wrong."""
    try:
        text = decode(path.read_bytes(), str(path))
    except OSError as error:
        fix = "name a table of objects, YAML or CSV; docs/properties.md tells of both"
        raise InputError.of(str(path), "", f"cannot be read ({error.strerror})", fix) from None
    problems: list[Problem] = []
    title, source, rankings = path.name, "", list[Ranking]()
    if path.suffix.lower() == ".csv":
        rows = list(_csv(text, path, problems))
    else:
        root = read(text, Source(str(path), path.parent))
        for key, node in children(root).items():
            if key not in ("title", "source", "objects", "rankings"):
                fix = suggestion(key, ("title", "source", "objects", "rankings"))
                problems.append(Problem(node.key_place, key, f'"{key}"', "means nothing here", fix))
        title = str(plain(children(root).get("title", Node(title, Source(title, path.parent)))))
        source = str(plain(children(root).get("source", Node("", Source("", path.parent)))))
        rows = [_yaml(name, node) for name, node in children(root, "objects").items()]
        rankings = list(_rankings(root, {row.name for row in rows}, problems))
    found = [_item(row, path.parent, problems) for row in rows]
    for of in COEFFICIENTS:
        values = {row.name: value for row in rows if (value := _number(row, of, problems)) is not None}
        if values:
            rankings.append(Ranking(of, "the table's own column", source, values))
    table = Objects(title, source, tuple(found), tuple(rankings))
    if not problems and not table.weighed and not any(len(one.values) > 1 for one in rankings):
        fix = "give objects a mass in g, or two of them a friction or an elasticity"
        problems += InputError.of(str(path), "", "has nothing to compare answers with", fix).problems
    if problems:
        raise InputError(problems)
    return table


def _csv(text: str, path: Path, problems: list[Problem]) -> Iterator[_Row]:
    reader = csv.DictReader(io.StringIO(text))
    heads = [head.strip() for head in reader.fieldnames or ()]
    reader.fieldnames = heads
    if "name" not in heads:
        fix = f"begin with a line of heads: name,{','.join(KEYS)}"
        problems += InputError.of(str(path), "", "has no column name", fix).problems
        return
    for head in heads:
        if head not in ("name", *KEYS):
            fix = suggestion(head, ("name", *KEYS))
            problems.append(Problem(Place(str(path), 1, 1), "", f'"{head}"', "is no column", fix))
    seen: set[str] = set()
    for cells in reader:
        place = Place(str(path), reader.line_num, 1)
        name = (cells.get("name") or "").strip()
        if not name or name in seen:
            expected = "is the name of two objects" if name else "has no name"
            problems.append(
                Problem(place, "", quoted(name) if name else "", expected, "name each object once")
            )
            continue
        seen.add(name)
        if cells.get(None):
            more = ", ".join(quoted(cell) for cell in cells[None])
            fix = f"give each column a head, of name,{','.join(KEYS)}"
            problems.append(Problem(place, f"objects.{name}", more, "stands in no column", fix))
        values = {key: (cells.get(key) or "").strip() for key in KEYS if key in heads}
        yield _Row(name, place, {key: (text, place) for key, text in values.items() if text})


def _yaml(name: str, node: Node) -> _Row:
    return _Row(
        name, node.key_place, {key: (plain(child), child.place) for key, child in children(node).items()}
    )


def _item(row: _Row, folder: Path, problems: list[Problem]) -> Item:
    for key, (_, place) in row.values.items():
        if key not in KEYS:
            where = f"objects.{row.name}.{key}"
            problems.append(Problem(place, where, f'"{key}"', "means nothing here", suggestion(key, KEYS)))
    form, size = _form(row, problems)
    files = {}
    for key in ("photo", "mask"):
        if key in row.values:
            said, place = row.values[key]
            files[key] = folder / str(said)
            if not files[key].is_file():
                fix = "name a file, from the table's folder"
                problems.append(
                    Problem(place, f"objects.{row.name}.{key}", quoted(str(said)), "is not there", fix)
                )
    if len(files) == 1:
        (has,) = files
        lacks = "mask" if has == "photo" else "photo"
        fix = "a photo needs a label map of the object, in its size"
        problems.append(
            Problem(row.place, f"objects.{row.name}", f"a {has}", f"stands without a {lacks}", fix)
        )
    label = (
        str(row.values["label"][0]) if "label" in row.values else row.name.replace("-", " ").replace("_", " ")
    )
    return Item(
        row.name, label, form, size, _number(row, "mass", problems), files.get("photo"), files.get("mask")
    )


def _form(row: _Row, problems: list[Problem]) -> tuple[Form, tuple[float, ...]]:
    said, place = row.values.get("form", ("box", row.place))
    where = f"objects.{row.name}"
    if said not in [form.value for form in Form]:
        fix = suggestion(str(said), [form.value for form in Form])
        problems.append(Problem(place, f"{where}.form", quoted(str(said)), "is no form", fix))
        return Form.BOX, ()
    form = Form(said)
    if "size" not in row.values:
        return form, ()
    told, place = row.values["size"]
    parts: Sequence[Any] = told if isinstance(told, list) else str(told).lower().replace("x", " ").split()
    size = tuple(number for part in parts if (number := _positive(part)) is not None)
    if len(size) != SIDES[form] or len(parts) != SIDES[form]:
        example = {Form.BALL: "57", Form.TURNED: "250x75", Form.BOX: "210x158x60"}[form]
        expected = f"is not {SIDES[form]} lengths in mm, as a {form.value} has"
        problems.append(Problem(place, f"{where}.size", quoted(str(told)), expected, f"write e.g. {example}"))
        return form, ()
    return form, size


def _number(row: _Row, key: str, problems: list[Problem]) -> float | None:
    if key not in row.values:
        return None
    said, place = row.values[key]
    number = _positive(said, least=key in COEFFICIENTS)
    if number is None:
        what = "grams above 0, e.g. 170" if key == "mass" else "a number of at least 0, e.g. 0.4"
        expected = f"is not {what.partition(',')[0]}"
        problems.append(
            Problem(place, f"objects.{row.name}.{key}", quoted(str(said)), expected, f"write {what}")
        )
    return number


def _positive(said: Any, least: bool = False) -> float | None:
    """A finite number above 0, or, where `least`, of at least 0; None where it is none."""
    try:
        number = float(said) if not isinstance(said, bool) else -1.0
    except (TypeError, ValueError):
        return None
    return number if isfinite(number) and (number > 0 or (least and number == 0)) else None


def _rankings(root: Node, names: set[str], problems: list[Problem]) -> Iterator[Ranking]:
    for of, node in children(root, "rankings").items():
        if of not in COEFFICIENTS:
            problems.append(
                Problem(
                    node.key_place, f"rankings.{of}", f'"{of}"', "is not asked", suggestion(of, COEFFICIENTS)
                )
            )
            continue
        for one in items(node):
            values = {}
            for name, child in children(one, "values").items():
                number = _positive(plain(child), least=True)
                if name not in names:
                    fix = suggestion(name, sorted(names))
                    problems.append(
                        Problem(child.key_place, f"rankings.{of}", f'"{name}"', "is no object", fix)
                    )
                elif number is None:
                    found = quoted(str(plain(child)))
                    problems.append(
                        Problem(child.place, f"rankings.{of}.{name}", found, "is no number", "write e.g. 0.4")
                    )
                else:
                    values[name] = number
            said = {key: str(plain(child)) for key, child in children(one).items() if key != "values"}
            if len(children(one, "values")) < 2:
                fix = "give values of two objects or more"
                problems.append(Problem(one.place, f"rankings.{of}", "", "compares nothing", fix))
            yield Ranking(of, said.get("about", ""), said.get("source", ""), values)
