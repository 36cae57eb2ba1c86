"""Values of a sweep's arguments: split at commas, read as YAML, and stored in typed table columns."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physgen.problems import InputError
from physgen.scene.document import Source, plain, read
from physgen.tables import Cell, Kind
from physgen.text import number

# ----------------------------------------------------------------------
# Text of one argument -> its values: split at commas that stand in no bracket and no quotes, each read as
# YAML.

_OPEN = {"[": "]", "{": "}", "(": ")"}
_QUOTED = {"'": re.compile(r"'(?:[^']|'')*'"), '"': re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)}


class WrongError(ValueError):
    """Values that are none; `expected` and `fix` say why, in the words of a Problem."""

    def __init__(self, expected: str, fix: str) -> None:
        super().__init__(expected)
        self.expected, self.fix = expected, fix


class SplitError(ValueError):
    """Brackets or quotes that do not match; `mark` is the one that is left alone."""

    def __init__(self, mark: str) -> None:
        super().__init__(mark)
        self.mark = mark


@dataclass(frozen=True)
class Value:
    """One value of a key."""

    text: str
    """YAML, as `--set` takes it."""
    data: Any
    """What it says: None, bool, int, float, str, list or dict."""


def split(text: str) -> list[str]:
    """Raises SplitError.

    >>> split("1, [2, 3],'a,b'")
    ['1', '[2, 3]', "'a,b'"]
    """
    return [text[begin:end].strip() for begin, end in _pieces(text)]


def _pieces(text: str) -> Iterator[tuple[int, int]]:
    waiting: list[str] = []
    begin, before, end_of_quotes = 0, "", 0
    for at, mark in enumerate(text):
        if at < end_of_quotes:
            continue
        if mark in "'\"" and before in ("", ",", ":", *_OPEN):  # within a word it is an apostrophe
            quotes = _QUOTED[mark].match(text, at)
            if not quotes:
                raise SplitError(mark)
            end_of_quotes = quotes.end()
        elif mark in _OPEN:
            waiting.append(mark)
        elif mark in "]})":
            if not waiting or _OPEN[waiting.pop()] != mark:
                raise SplitError(mark)
        elif mark == "," and not waiting:
            yield begin, at
            begin = at + 1
            before = ""
            continue
        before = before if mark.isspace() else mark
    if waiting:
        raise SplitError(waiting[-1])
    yield begin, len(text)


def yaml(text: str) -> Value:
    """Raises InputError, with messages that name no place, where it is none."""
    return Value(text, plain(read(text, Source("", Path()), counted=False)))


def numeric(text: str) -> int | float | None:
    """A number written as YAML does; None for anything else.

    >>> [numeric(text) for text in ("-3", "1e6", "0x10", "yes", "[1]", "")]
    [-3, 1000000.0, 16, None, None, None]
    """
    try:
        data = yaml(text).data
    except InputError:
        return None
    return data if isinstance(data, int | float) and not isinstance(data, bool) else None


def of(data: int | float) -> Value:
    """A number, with the shortest text that says exactly it."""
    return Value(number(data), data)


# ----------------------------------------------------------------------
# Values that somebody wrote -> the kind of column that holds them, and their cells.


def kind_of(values: Iterable[Any]) -> Kind:
    """The narrowest kind that holds all; None fits into any."""
    known = [value for value in values if value is not None]
    seen = {type(value) for value in known}
    if not seen or not seen <= {int, float, bool} or (bool in seen and len(seen) > 1):
        return Kind.TEXT
    if any(
        isinstance(value, int) and abs(value) >= 2**63 for value in known
    ):  # no column of whole numbers is so wide
        return Kind.TEXT
    return Kind.TRUTH if seen == {bool} else Kind.WHOLE if seen == {int} else Kind.NUMBER


def cell(value: Value, kind: Kind) -> Cell:
    """A parameter's value as its column holds it: lists and mappings as YAML."""
    data = value.data
    if data is None:
        return None
    if kind is Kind.TEXT:
        return data if isinstance(data, str) else value.text
    return float(data) if kind is Kind.NUMBER else data
