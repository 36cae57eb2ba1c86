"""Columns of what refinement changed -> the page's strip: small pictures in rows, with words in the page's letters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from physgen.report.encoded import webp
from physgen.report.perception import Comparison
from physgen.report.strip import COOL, PALE, WARM, Column, changed, full

QUALITY = 84
"""Of WebP: outlines are fine."""


@dataclass(frozen=True)
class Row:
    """Pictures of one kind, one a moment."""

    name: str
    about: str
    """Behind the moment, for those who do not see them."""
    pictures: tuple[str, ...]
    """Data URIs."""


@dataclass(frozen=True)
class Retouched:
    """What a page shows of a refinement."""

    compared: Comparison
    """A frame before and after."""
    times: tuple[float, ...]
    """s of playing."""
    size: tuple[int, int]
    """Width and height of each picture, px."""
    rows: tuple[Row, ...]
    levels: int
    """Grey levels that full colour stands for; 0: nothing changed."""
    colours: tuple[str, str, str]
    """CSS: darker, unchanged, brighter."""


def retouched(compared: Comparison, columns: Sequence[Column]) -> Retouched:
    """`columns` as `report.changes.Changes` made them, at least one."""
    levels = full(columns)
    height, width = columns[0].change.shape
    kinds = (
        ("as drawn", "as it was drawn", [one.guidance for one in columns]),
        ("refined", "refined", [one.refined for one in columns]),
        ("change", "what changed", [changed(one, levels) for one in columns]),
    )
    return Retouched(
        compared,
        tuple(one.time for one in columns),
        (width, height),
        tuple(
            Row(name, about, tuple(webp(picture, QUALITY) for picture in pictures))
            for name, about, pictures in kinds
        ),
        levels,
        tuple(f"rgb({r} {g} {b})" for r, g, b in (COOL, (sum(PALE) // 2,) * 3, WARM)),  # type: ignore[arg-type]
    )
