"""The result of `segmentation` -> sentences, tables and bars; `shown` adds its pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from physgen.evaluate.curves import THRESHOLDS
from physgen.evaluate.findings import Bar, Findings, Section, Table
from physgen.evaluate.segmentation import IOU, SCOPES, Found

Record = Mapping[str, Any]

BARS = {"precision": "precision", "recall": "recall", "iou": "mean IoU"}
"""What a bar may be set for, of all objects of all photos."""
NAMES = {"all": "all objects", "whole": "whole objects only"}
SHARES = ("precision", "recall", "f", "iou")
HEADS = ("photo", "true", "said", "hit", "precision", "recall", "F", "IoU")
WHOLE = ("whole: true", "said", "hit", "precision", "recall", "F")
LABELS, CURVES = "By label", "Precision over recall"
"""Titles of sections."""
PAPER = "The paper: precision 0.93 and recall 0.82 at the same IoU, on 10 photos of its own with 118 objects."


def findings(found: Found, bars: Mapping[str, float]) -> Findings:
    """`bars`: the least that precision, recall or mean IoU of all objects together must be."""
    micro = found.totals["all"]["micro"]
    told = tuple(
        Bar(f"{BARS[name]} of all together", share(micro[name]), f"{bar:g}", (micro[name] or 0.0) >= bar)
        for name, bar in bars.items()
    )
    sections = [
        Section("Photo by photo", (), (Table((*HEADS, *WHOLE), tuple(_rows(found)), note=_note(found)),))
    ]
    if found.labels:
        sections.append(Section(LABELS, (), (_labels(found.labels),)))
    sections.append(Section(CURVES, (), (_precisions(found.totals),)))
    return Findings(
        "segmentation",
        "Are objects found?",
        tuple(_sentences(found, micro)),
        tuple(sections),
        found.rows,
        told,
        found.as_dict(),
    )


def share(value: float | None) -> str:
    """A share as a reader wants it; a dash where it has no meaning.

    >>> share(0.83333), share(None)
    ('0.833', '-')
    """
    return "-" if value is None else f"{value:.3f}"


def _sentences(found: Found, micro: Record) -> list[str]:
    count = f"{len(found.rows)} photo{'s' * (len(found.rows) != 1)}"
    told = [
        f"On {count}, {micro['hit']} of {micro['true']} objects are found (recall {share(micro['recall'])}), and "
        f"{micro['hit']} of {micro['said']} that are said are right (precision {share(micro['precision'])}), at an IoU "
        f"of {IOU:g} or more; mean IoU {share(micro['iou'])}."
    ]
    for scope in SCOPES:
        total = found.totals[scope]
        told.append(f"AP50 {share(total['ap50'])}, AP50:95 {share(total['ap'])}: {NAMES[scope]}.")
    error = share(found.reliability.error)
    return [*told, f"Expected calibration error {error}: confidence as said against the share right.", PAPER]


def _rows(found: Found) -> list[tuple[str, ...]]:
    totals = found.totals
    below = [{**totals["all"][kind], "whole": totals["whole"][kind]} for kind in ("micro", "macro")]
    return [
        *(_cells(row, row["photo"]) for row in found.rows),
        _cells(below[0], "all together"),
        _cells(below[1], "mean of photos"),
    ]


def _cells(row: Record, name: str) -> tuple[str, ...]:
    """Of all objects, then of whole ones."""
    whole = row["whole"]
    return (
        name,
        *(str(row.get(key, "")) for key in ("true", "said", "hit")),
        *(share(row[key]) for key in SHARES),
        *(str(whole.get(key, "")) for key in ("true", "said", "hit")),
        *(share(whole[key]) for key in SHARES[:3]),
    )


def _note(found: Found) -> str:
    cut = sum(row["cut"] for row in found.rows)
    them = f"the {cut} objects" if cut > 1 else "the object"
    return f"Whole: without {them} that a photo's border cuts off, which may be said or not." if cut else ""


def _labels(labels: Sequence[Record]) -> Table:
    rows = tuple(
        (
            one["label"],
            str(one["true"]),
            str(one["hit"]),
            share(one["recall"]),
            share(one["iou"]),
            share(one["ar"]),
        )
        for one in labels
    )
    note = (
        "Labels are those of the truth; what is falsely found has none, so that there is no precision. AR: recall, "
        "its mean over IoU 0.50, 0.55 .. 0.95."
    )
    return Table(("label", "true", "hit", "recall", "IoU", "AR"), rows, note=note)


def _precisions(totals: Mapping[str, Record]) -> Table:
    heads = ("average precision at IoU", *(f"{iou:.2f}" for iou in THRESHOLDS))
    rows = tuple(
        (NAMES[scope], *(share(one["ap"]) for one in totals[scope]["ap_by_iou"])) for scope in SCOPES
    )
    return Table(heads, rows)
