"""What a table has columns for: a name, a kind and a unit each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any

from physgen.batch.values import Value

Cell = str | int | float | bool | None
"""None is an empty cell."""


class Kind(Enum):
    """Of the values of a column."""

    TEXT = "text"
    WHOLE = "whole"
    NUMBER = "number"
    TRUTH = "truth"


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str
    kind: Kind = Kind.NUMBER
    unit: str = ""


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
