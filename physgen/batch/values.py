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

_BRACKETS = {"[": "]", "{": "}", "(": ")"}
_QUOTED = {"'": re.compile(r"'(?:[^']|'')*'"), '"': re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)}


class ValueTextError(ValueError):
    """Text that is no value; `expected` and `fix` become those of a Problem."""

    def __init__(self, expected: str, fix: str) -> None:
        super().__init__(expected)
        self.expected, self.fix = expected, fix


@dataclass(frozen=True)
class Value:
    """One value of a key."""

    text: str
    """YAML, as `--set` takes it."""
    data: Any
    """The parsed value: None, bool, int, float, str, list or dict."""


def split(text: str) -> list[str]:
    """Parts between commas that are outside brackets and quotes. Raises ValueTextError for unmatched ones.

    >>> split("1, [2, 3],'a,b'")
    ['1', '[2, 3]', "'a,b'"]
    """
    return [text[begin:end].strip() for begin, end in _part_ranges(text)]


def _part_ranges(text: str) -> Iterator[tuple[int, int]]:
    open_brackets: list[str] = []
    begin, before, end_of_quotes = 0, "", 0
    for at, character in enumerate(text):
        if at < end_of_quotes:
            continue
        if character in "'\"" and before in ("", ",", ":", *_BRACKETS):  # within a word it is an apostrophe
            quotes = _QUOTED[character].match(text, at)
            if not quotes:
                raise _unmatched(character)
            end_of_quotes = quotes.end()
        elif character in _BRACKETS:
            open_brackets.append(character)
        elif character in "]})":
            if not open_brackets or _BRACKETS[open_brackets.pop()] != character:
                raise _unmatched(character)
        elif character == "," and not open_brackets:
            yield begin, at
            begin, before = at + 1, ""
            continue
        before = before if character.isspace() else character
    if open_brackets:
        raise _unmatched(open_brackets[-1])
    yield begin, len(text)


def _unmatched(character: str) -> ValueTextError:
    fix = "close it, or put text that holds it in quotes within quotes"
    return ValueTextError(f"has a {character} without its partner", fix)


def parse_yaml(text: str) -> Value:
    """Raises InputError with messages that name no place."""
    return Value(text, plain(read(text, Source("", Path()), counted=False)))


def parse_number(text: str) -> int | float | None:
    """A number written in YAML; None for any other text.

    >>> [parse_number(text) for text in ("-3", "1e6", "0x10", "yes", "[1]", "")]
    [-3, 1000000.0, 16, None, None, None]
    """
    try:
        data = parse_yaml(text).data
    except InputError:
        return None
    return data if isinstance(data, int | float) and not isinstance(data, bool) else None


def number_value(data: int | float) -> Value:
    """A number with its shortest exact text."""
    return Value(number(data), data)


def kind_of(values: Iterable[Any]) -> Kind:
    """The narrowest kind of column for all values; None fits every kind."""
    known = [value for value in values if value is not None]
    types = {type(value) for value in known}
    if not types or not types <= {int, float, bool} or (bool in types and len(types) > 1):
        return Kind.TEXT
    if any(isinstance(value, int) and abs(value) >= 2**63 for value in known):  # beyond an int64 column
        return Kind.TEXT
    return Kind.TRUTH if types == {bool} else Kind.WHOLE if types == {int} else Kind.NUMBER


def cell(value: Value, kind: Kind) -> Cell:
    """A value as a column of that kind stores it; lists and mappings become YAML text."""
    data = value.data
    if data is None:
        return None
    if kind is Kind.TEXT:
        return data if isinstance(data, str) else value.text
    return float(data) if kind is Kind.NUMBER else data
