"""The result of `segmentation` as JSON has it -> a table for the terminal, or a page in Markdown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from physgen.evaluate.segmentation import BARS, SCOPES

Record = Mapping[str, Any]

SHARES = ("precision", "recall", "f", "iou")
HEADS = ("photo", "true", "said", "hit", "precision", "recall", "F", "IoU")
WHOLE = ("| whole", "said", "hit", "precision", "recall", "F")


def share(value: float | None) -> str:
    """A share as a reader wants it; nothing where it has no meaning.

    >>> share(0.83333), share(None)
    ('0.833', '-')
    """
    return "-" if value is None else f"{value:.3f}"


def _cells(row: Record, name: str) -> list[str]:
    """Of all objects, then of whole ones."""
    whole = row["whole"]
    return [
        name,
        *(str(row.get(key, "")) for key in ("true", "said", "hit")),
        *(share(row[key]) for key in SHARES),
        *(str(whole.get(key, "")) for key in ("true", "said", "hit")),
        *(share(whole[key]) for key in SHARES[:3]),
    ]


def _rows(result: Record) -> list[list[str]]:
    totals = result["totals"]
    below = [{**totals["all"][kind], "whole": totals["whole"][kind]} for kind in ("micro", "macro")]
    return [
        *(_cells(row, row["photo"]) for row in result["rows"]),
        _cells(below[0], "all together"),
        _cells(below[1], "mean of photos"),
    ]


def _sentences(result: Record) -> list[str]:
    told = []
    for scope, words in zip(SCOPES, ("all objects", "whole objects only"), strict=True):
        found = result["totals"][scope]
        told.append(f"AP50 {share(found['ap50'])}, AP50:95 {share(found['ap'])}: {words}")
    error = result["reliability"]["error"]
    told.append(f"expected calibration error {share(error)}: confidence as said against the share right")
    for bar in result["bars"]:
        state = "met" if bar["passed"] else "MISSED"
        told.append(
            f"{BARS[bar['name']]} {share(bar['found'])} of all together, the bar is {bar['bar']:g}: {state}"
        )
    return told


def text(result: Record) -> str:
    """Aligned columns, a line a photo, totals below."""
    lines = [[*HEADS, *WHOLE], *_rows(result)]
    for line in lines[1:]:
        line[8] = f"| {line[8]}"
    wide = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    shown = [
        "  ".join([line[0].ljust(wide[0]), *(c.rjust(w) for c, w in zip(line[1:], wide[1:], strict=True))])
        for line in lines
    ]
    return "\n".join([*shown, "", *_sentences(result)]) + "\n"


def markdown(result: Record) -> str:
    """A table, and the totals as a list."""
    head = [*HEADS, "whole", *WHOLE[1:]]
    lines = [head, ["---"] + ["---:"] * (len(head) - 1), *_rows(result)]
    shown = ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines]
    return "\n".join([*shown, "", *(f"- {sentence}" for sentence in _sentences(result))]) + "\n"
