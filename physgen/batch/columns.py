"""Values that somebody wrote -> the kind of column that holds them, and their cells."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from physgen.batch.values import Value
from physgen.tables import Cell, Column, Kind

__all__ = ["Cell", "Column", "Kind", "cell", "kind_of"]


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
