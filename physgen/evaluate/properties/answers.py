"""What somebody says of objects, by name: from a file (JSON or CSV), and to one."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path
from typing import Any

from physgen.evaluate.properties.table import COEFFICIENTS, Objects
from physgen.files import write_atomic
from physgen.problems import InputError, Place, Problem
from physgen.registry import suggestion
from physgen.text import quoted

NUMBERS = ("mass", *COEFFICIENTS)
MOST_BYTES = 8 * 2**20


@dataclass(frozen=True)
class Answer:
    """Of one object; None: nothing is said."""

    mass: float | None = None
    """g."""
    friction: float | None = None
    elasticity: float | None = None
    reason: str = ""


def needed(table: Objects) -> dict[str, set[str]]:
    """What must be said of whom: mass, friction, elasticity -> names."""
    return {"mass": {item.name for item in table.weighed}} | {
        of: {name for one in table.rankings if one.of == of for name in one.values} for of in COEFFICIENTS
    }


def read_answers(path: Path, table: Objects) -> dict[str, Answer]:
    """By name; raises InputError with what cannot be read, is no number, or is missing."""
    problems: list[Problem] = []
    found: dict[str, Answer] = {}
    names = [item.name for item in table.items]
    for name, said, place in _rows(path):
        if name not in names:
            problems.append(
                Problem(place, "", quoted(name), "is no object of the table", suggestion(name, names))
            )
            continue
        if name in found:
            problems.append(Problem(place, "", quoted(name), "is answered twice", "keep one answer"))
        numbers = {key: _number(said.get(key), key, name, place, problems) for key in NUMBERS}
        found[name] = Answer(**numbers, reason=str(said.get("reason") or ""))
    for key, whom in needed(table).items():
        lack = [name for name in names if name in whom and getattr(found.get(name, Answer()), key) is None]
        if lack and not problems:
            some = ", ".join(lack[:6]) + (f" and {len(lack) - 6} more" if len(lack) > 6 else "")
            fix = "answer them all, or take them out of the table: a score over the answered ones alone would flatter"
            lacks = Problem(
                Place(str(path)), "", f"{key} of {some}", f"is missing ({len(lack)} of {len(whom)})", fix
            )
            problems.append(lacks)
    if problems:
        raise InputError(problems)
    return found


def write_answers(path: Path, answers: Mapping[str, Answer], who: str) -> None:
    """As `read_answers` takes them, whole or not at all."""
    rows = [{"name": name, **asdict(answer)} for name, answer in answers.items()]
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"by": who, "answers": rows}, indent=1, ensure_ascii=False, allow_nan=False)
    write_atomic(path, f"{text}\n".encode())


def _rows(path: Path) -> Iterator[tuple[str, Mapping[str, Any], Place]]:
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
    for name, said in _listed(_json(text, path), path):
        yield name, said, Place(str(path))


def _json(text: str, path: Path) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        fix = 'write {"answers": [{"name": "apple", "mass": 182, "friction": 0.4, "elasticity": 0.3}]}, or a CSV'
        raise InputError.of(str(path), "", f"is not JSON: {error}", fix) from None


def _listed(data: Any, path: Path) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """`{"answers": [...]}`, a list of answers, or answers by name."""
    rows = data.get("answers", data) if isinstance(data, Mapping) else data
    pairs: Sequence[tuple[Any, Any]]
    if isinstance(rows, Mapping):
        pairs = list(rows.items())
    elif isinstance(rows, list):
        pairs = [(one.get("name") if isinstance(one, Mapping) else None, one) for one in rows]
    else:
        pairs = [(None, None)]
    for name, said in pairs:
        if not isinstance(name, str) or not isinstance(said, Mapping):
            fix = 'write [{"name": "apple", "mass": 182, "friction": 0.4, "elasticity": 0.3}, ...]'
            raise InputError.of(str(path), quoted(json.dumps(said)), "is no answer", fix)
        yield name, said


def _number(said: Any, key: str, name: str, place: Place, problems: list[Problem]) -> float | None:
    if said is None or (isinstance(said, str) and not said.strip()):
        return None
    try:
        number = float(said) if not isinstance(said, bool) else float("nan")
    except (TypeError, ValueError):
        number = float("nan")
    if not isfinite(number) or number < 0 or (key == "mass" and number == 0):
        what = "grams above 0" if key == "mass" else "a number of at least 0"
        problems.append(Problem(place, f"{name}.{key}", quoted(str(said)), f"is not {what}", f"write {what}"))
        return None
    return number
