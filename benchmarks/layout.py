"""Markdown as the generated pages of docs/ have it."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """Lines of a table; columns of numbers alone are set to the right."""
    body = [[str(cell).replace("|", "\\|") for cell in row] for row in rows]
    right = [all(_numeric(row[k]) for row in body) for k in range(len(heads))]
    rule = ["---:" if one else "---" for one in right]
    return ["| " + " | ".join(line) + " |" for line in (list(heads), rule, *body)]


def prose(*parts: str) -> list[str]:
    """Lines of a paragraph."""
    return textwrap.wrap(" ".join(parts), 118)


def number(value: float) -> str:
    """As people write it.

    >>> [number(v) for v in (0.0974, 13.039, 20.265, 686.2, 27250.0)]
    ['0.097', '13', '20', '686', '27,250']
    """
    return f"{value:,.0f}" if abs(value) >= 10 else f"{value:.2g}"


def _numeric(cell: str) -> bool:
    try:
        float(cell.rstrip(" %").replace(",", "") or "0")
    except ValueError:
        return cell == "-"
    return True
