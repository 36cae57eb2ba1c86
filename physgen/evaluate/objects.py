"""Tables of objects with true masses, frictions and elasticities, and files of answers about them."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from math import isfinite
from pathlib import Path
from typing import Any

from physgen.files import write_atomic
from physgen.problems import InputError, Place, Problem
from physgen.registry import suggestion
from physgen.scene.document import Node, Source, children, decode, items, plain, read
from physgen.text import quoted

SHIPPED = Path(__file__).with_name("objects.yaml")
COEFFICIENTS = ("friction", "elasticity")
NUMBERS = ("mass", *COEFFICIENTS)
KEYS = ("label", "form", "size", "mass", *COEFFICIENTS, "photo", "mask")
"""Of an object; a CSV has `name` before them."""
PARTS = ("title", "source", "objects", "rankings")
"""Of a table in YAML."""
MOST_BYTES = 8 * 2**20
"""Of a file of answers."""


class Form(Enum):
    """Shape of an object without a photo, which decides the numbers of its size."""

    BALL = "ball"
    TURNED = "turned"
    BOX = "box"


SIZES = {Form.BALL: (1, "57"), Form.TURNED: (2, "250x75"), Form.BOX: (3, "210x158x60")}
"""Lengths of a form's size, and an example."""


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


class _Row:
    """One object as it is written: values with their places; collects its problems."""

    def __init__(
        self, name: str, place: Place, values: Mapping[str, tuple[Any, Place]], problems: list[Problem]
    ) -> None:
        self.name, self.place, self.values, self._problems = name, place, values, problems

    def wrong(self, key: str, found: str, expected: str, fix: str) -> None:
        """A problem at the place of a value, or of the object."""
        place = self.values[key][1] if key in self.values else self.place
        path = f"objects.{self.name}" + (f".{key}" if key in self.values else "")
        self._problems.append(Problem(place, path, found, expected, fix))

    def number(self, key: str) -> float | None:
        if key not in self.values:
            return None
        value = self.values[key][0]
        number = _positive(value, zero=key in COEFFICIENTS)
        if number is None:
            what = "grams above 0, e.g. 170" if key == "mass" else "a number of at least 0, e.g. 0.4"
            self.wrong(key, quoted(str(value)), f"is not {what.partition(',')[0]}", f"write {what}")
        return number


def _positive(value: Any, zero: bool = False) -> float | None:
    """A finite number above 0, or 0 where `zero`; None for anything else."""
    try:
        number = float(value) if not isinstance(value, bool) else -1.0
    except (TypeError, ValueError):
        return None
    return number if isfinite(number) and (number > 0 or (zero and number == 0)) else None


def read_table(path: Path) -> Objects:
    """YAML or CSV. Raises InputError with all problems."""
    try:
        text = decode(path.read_bytes(), str(path))
    except OSError as error:
        fix = "name a table of objects, YAML or CSV; docs/properties.md describes both"
        raise InputError.of(str(path), "", f"cannot be read ({error.strerror})", fix) from None
    problems: list[Problem] = []
    title, source, rankings = path.name, "", list[Ranking]()
    if path.suffix.lower() == ".csv":
        rows = list(_csv_rows(text, path, problems))
    else:
        root = read(text, Source(str(path), path.parent))
        found = children(root)
        for key, node in found.items():
            if key not in PARTS:
                fix = suggestion(key, PARTS)
                problems.append(Problem(node.key_place, key, f'"{key}"', "means nothing here", fix))
        title = str(plain(found["title"])) if "title" in found else title
        source = str(plain(found["source"])) if "source" in found else source
        rows = []
        for name, node in children(root, "objects").items():
            values = {key: (plain(child), child.place) for key, child in children(node).items()}
            rows.append(_Row(name, node.key_place, values, problems))
        rankings = list(_rankings(root, [row.name for row in rows], problems))
    objects = tuple(_item(row, path.parent) for row in rows)
    for of in COEFFICIENTS:
        column = {row.name: value for row in rows if (value := row.number(of)) is not None}
        if column:
            rankings.append(Ranking(of, "the table's own column", source, column))
    table = Objects(title, source, objects, tuple(rankings))
    if not problems and not table.weighed and not any(len(one.values) > 1 for one in rankings):
        fix = "give objects a mass in g, or two of them a friction or an elasticity"
        raise InputError.of(str(path), "", "has nothing to compare answers with", fix)
    if problems:
        raise InputError(problems)
    return table


def _csv_rows(text: str, path: Path, problems: list[Problem]) -> Iterator[_Row]:
    reader = csv.DictReader(io.StringIO(text))
    heads = [head.strip() for head in reader.fieldnames or ()]
    reader.fieldnames = heads
    if "name" not in heads:
        fix = f"begin with a line of heads: name,{','.join(KEYS)}"
        raise InputError.of(str(path), "", "has no column name", fix)
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
            found = quoted(name) if name else ""
            problems.append(Problem(place, "", found, expected, "name each object once"))
            continue
        seen.add(name)
        if cells.get(None):
            more = ", ".join(quoted(cell) for cell in cells[None])
            fix = f"give each column a head, of name,{','.join(KEYS)}"
            problems.append(Problem(place, f"objects.{name}", more, "stands in no column", fix))
        values = {key: (cells.get(key) or "").strip() for key in KEYS if key in heads}
        yield _Row(name, place, {key: (value, place) for key, value in values.items() if value}, problems)


def _item(row: _Row, folder: Path) -> Item:
    for key in row.values:
        if key not in KEYS:
            row.wrong(key, f'"{key}"', "means nothing here", suggestion(key, KEYS))
    form, size = _form(row)
    files = {key: folder / str(row.values[key][0]) for key in ("photo", "mask") if key in row.values}
    for key, file in files.items():
        if not file.is_file():
            name = quoted(str(row.values[key][0]))
            row.wrong(key, name, "is not there", "name a file, from the table's folder")
    if len(files) == 1:
        has, lacks = ("photo", "mask") if "photo" in files else ("mask", "photo")
        fix = "a photo needs a label map of the object, in its size"
        row.wrong("", f"a {has}", f"stands without a {lacks}", fix)
    label = (
        str(row.values["label"][0]) if "label" in row.values else row.name.replace("-", " ").replace("_", " ")
    )
    return Item(row.name, label, form, size, row.number("mass"), files.get("photo"), files.get("mask"))


def _form(row: _Row) -> tuple[Form, tuple[float, ...]]:
    name = str(row.values["form"][0]) if "form" in row.values else "box"
    known = [form.value for form in Form]
    if name not in known:
        row.wrong("form", quoted(name), "is no form", suggestion(name, known))
        return Form.BOX, ()
    form = Form(name)
    if "size" not in row.values:
        return form, ()
    value = row.values["size"][0]
    parts = value if isinstance(value, list) else str(value).lower().replace("x", " ").split()
    size = tuple(number for part in parts if (number := _positive(part)) is not None)
    count, example = SIZES[form]
    if len(size) != count or len(parts) != count:
        expected = f"is not {count} lengths in mm, as a {form.value} has"
        row.wrong("size", quoted(str(value)), expected, f"write e.g. {example}")
        return form, ()
    return form, size


def _rankings(root: Node, names: list[str], problems: list[Problem]) -> Iterator[Ranking]:
    def wrong(place: Place, path: str, found: str, expected: str, fix: str) -> None:
        problems.append(Problem(place, f"rankings.{path}", found, expected, fix))

    for of, node in children(root, "rankings").items():
        if of not in COEFFICIENTS:
            wrong(node.key_place, of, f'"{of}"', "is not asked", suggestion(of, COEFFICIENTS))
            continue
        for one in items(node):
            values = {}
            for name, child in children(one, "values").items():
                number = _positive(plain(child), zero=True)
                if name not in names:
                    wrong(child.key_place, of, f'"{name}"', "is no object", suggestion(name, sorted(names)))
                elif number is None:
                    found = quoted(str(plain(child)))
                    wrong(child.place, f"{of}.{name}", found, "is no number", "write e.g. 0.4")
                else:
                    values[name] = number
            if len(children(one, "values")) < 2:
                wrong(one.place, of, "", "compares nothing", "give values of two objects or more")
            texts = {key: str(plain(child)) for key, child in children(one).items() if key != "values"}
            yield Ranking(of, texts.get("about", ""), texts.get("source", ""), values)


# ---- answers -----------------------------------------------------------------------------------------------------


def read_answers(path: Path, table: Objects) -> dict[str, Answer]:
    """By name, from JSON or CSV. Raises InputError for what cannot be read, is no number, or is missing."""
    problems: list[Problem] = []
    found: dict[str, Answer] = {}
    names = [item.name for item in table.items]
    for name, values, place in _answer_rows(path):
        if name not in names:
            fix = suggestion(name, names)
            problems.append(Problem(place, "", quoted(name), "is no object of the table", fix))
            continue
        if name in found:
            problems.append(Problem(place, "", quoted(name), "is answered twice", "keep one answer"))

        def wrong(key: str, value: str, what: str, name: str = name, place: Place = place) -> None:
            problems.append(Problem(place, f"{name}.{key}", value, f"is not {what}", f"write {what}"))

        numbers = {key: _answered(values.get(key), key, wrong) for key in NUMBERS}
        found[name] = Answer(**numbers, reason=str(values.get("reason") or ""))
    needed = {"mass": {item.name for item in table.weighed}}
    for of in COEFFICIENTS:
        needed[of] = {name for one in table.rankings if one.of == of for name in one.values}
    for key, names_needed in needed.items():
        lack = [
            name for name in names if name in names_needed and getattr(found.get(name, Answer()), key) is None
        ]
        if lack and not problems:
            some = ", ".join(lack[:6]) + (f" and {len(lack) - 6} more" if len(lack) > 6 else "")
            fix = "answer them all, or take them out of the table: a score over the answered ones alone would flatter"
            expected = f"is missing ({len(lack)} of {len(names_needed)})"
            problems.append(Problem(Place(str(path)), "", f"{key} of {some}", expected, fix))
    if problems:
        raise InputError(problems)
    return found


def write_answers(path: Path, answers: Mapping[str, Answer], source: str) -> None:
    """As `read_answers` takes them."""
    rows = [{"name": name, **asdict(answer)} for name, answer in answers.items()]
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"by": source, "answers": rows}, indent=1, ensure_ascii=False, allow_nan=False)
    write_atomic(path, f"{text}\n".encode())


def _answer_rows(path: Path) -> Iterator[tuple[str, Mapping[str, Any], Place]]:
    try:
        data = path.read_bytes()[: MOST_BYTES + 1]
        if len(data) > MOST_BYTES:
            raise InputError.of(str(path), "", "is larger than 8 MiB", "name a file of answers")
        text = data.decode("utf-8-sig")
    except OSError as error:
        fix = "name a file of answers, JSON or CSV: name, mass, friction, elasticity"
        raise InputError.of(str(path), "", f"cannot be read ({error.strerror})", fix) from None
    except UnicodeDecodeError:
        raise InputError.of(str(path), "", "is not UTF-8 text", "save it as UTF-8") from None
    if path.suffix.lower() == ".csv":
        reader = csv.DictReader(io.StringIO(text))
        reader.fieldnames = [head.strip() for head in reader.fieldnames or ()]
        if "name" not in reader.fieldnames:
            fix = f"begin with a line of heads: name,{','.join(NUMBERS)}"
            raise InputError.of(str(path), "", "has no column name", fix)
        for cells in reader:
            yield (cells["name"] or "").strip(), cells, Place(str(path), reader.line_num, 1)
        return
    example = '[{"name": "apple", "mass": 182, "friction": 0.4, "elasticity": 0.3}]'
    try:
        record = json.loads(text)
    except (ValueError, RecursionError) as error:
        fix = f'write {{"answers": {example}}}, or a CSV'
        raise InputError.of(str(path), "", f"is not JSON: {error}", fix) from None
    rows = record.get("answers", record) if isinstance(record, Mapping) else record
    if isinstance(rows, Mapping):
        pairs = list(rows.items())
    else:
        rows = rows if isinstance(rows, list) else [None]
        pairs = [(one.get("name") if isinstance(one, Mapping) else None, one) for one in rows]
    for name, values in pairs:
        if not isinstance(name, str) or not isinstance(values, Mapping):
            raise InputError.of(str(path), quoted(json.dumps(values)), "is no answer", f"write {example}")
        yield name, values, Place(str(path))


def _answered(value: Any, key: str, wrong: Callable[[str, str, str], None]) -> float | None:
    if value is None or (isinstance(value, str) and not value.strip()):
        return None
    number = _positive(value, zero=key in COEFFICIENTS)
    if number is None:
        wrong(key, quoted(str(value)), "grams above 0" if key == "mass" else "a number of at least 0")
    return number
