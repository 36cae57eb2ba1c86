"""Photos with true masks -> how much a segmenter finds, how much of what it says is true, how sure it may be.

Masks are matched as COCO matches them (`matching`), over all true objects and over whole ones: those that the photo's
border cuts are then neither missed when nobody says them, nor is it false to say them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from physgen import backends
from physgen.evaluate.curves import (
    THRESHOLDS,
    Curve,
    Reliability,
    average_precision,
    counts,
    curve,
    falling,
    reliability,
)
from physgen.evaluate.matching import Floats, Judged, Patch, judge, overlaps, patches
from physgen.evaluate.photos import Pair, Truth
from physgen.perceive.roles import Segment, Segments
from physgen.problems import InputError

IOU = 0.5
"""At which counts are taken."""
SCOPES = ("all", "whole")
"""Of true objects: all, or those that the photo's border does not cut."""
BARS = {"precision": "precision", "recall": "recall", "iou": "mean IoU"}
"""What a bar may be set for, of all objects of all photos."""

Said = tuple[tuple[Patch, ...], Floats]
"""Masks, and confidences (N,)."""
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Photo:
    """One photo's masks, and what became of them."""

    name: str
    truth: Truth
    said: Said
    judged: Mapping[str, tuple[Judged, ...]]
    """By scope, at each of COCO's thresholds."""

    def as_dict(self) -> dict[str, Any]:
        """A row: counts at 0.5, over all objects; those over whole ones under `whole`."""
        every, whole = (counts([self.judged[scope][0]]) for scope in SCOPES)
        cut = sum(patch.cut_by(self.truth.size) for patch in self.truth.masks)
        return {"photo": self.name, **every, "cut": cut, "whole": whole}


def masks_of(segments: Segments) -> Said:
    """A segmenter's label map as masks; ids without pixels said nothing."""
    found = patches(segments.labels)
    ids = [i for i in found if i <= len(segments.confidence)]
    return tuple(found[i] for i in ids), np.array([segments.confidence[i - 1] for i in ids], np.float64)


def judge_photo(name: str, truth: Truth, said: Said) -> Photo:
    """Masks against truth. Where nobody judges, pixels count for neither; what lies there mostly is left out."""
    masks, confidence = said
    if truth.unjudged.any():
        nobody = truth.unjudged.copy()
        for true in truth.masks:  # what crowds share with a true object is that object's
            true.part(nobody)[true.mask] = False
        known = [one.mask & ~one.part(nobody) for one in masks]
        kept = [
            k for k, part in enumerate(known) if 2 * np.count_nonzero(part) > np.count_nonzero(masks[k].mask)
        ]
        masks = tuple(Patch.of(known[k], masks[k].x, masks[k].y) for k in kept)
        confidence = confidence[kept]
    overlap = overlaps(masks, truth.masks)
    cut = np.array([one.cut_by(truth.size) for one in truth.masks], np.bool_)
    judged = {
        scope: tuple(judge(overlap, confidence, ignored, threshold) for threshold in THRESHOLDS)
        for scope, ignored in zip(SCOPES, (np.zeros(len(cut), np.bool_), cut), strict=True)
    }
    return Photo(name, truth, (masks, confidence), judged)


@dataclass(frozen=True, eq=False)
class Found:
    """Over all photos."""

    rows: list[dict[str, Any]]
    totals: Mapping[str, dict[str, Any]]
    """By scope: `micro`, `macro`, `ap50`, `ap`."""
    curves: Mapping[str, Curve]
    """By scope."""
    reliability: Reliability
    """Of all objects."""

    def as_dict(self, bars: Mapping[str, float]) -> dict[str, Any]:
        """As JSON; `passed` is whether every bar is met, and true without any."""
        micro = self.totals["all"]["micro"]
        told = [
            {"name": key, "bar": bar, "found": micro[key], "passed": (micro[key] or 0.0) >= bar}
            for key, bar in bars.items()
        ]
        bins = self.reliability
        return {
            "iou": IOU,
            "rows": self.rows,
            "totals": self.totals,
            "curve": {scope: _points(line) for scope, line in self.curves.items()},
            "reliability": {
                "error": bins.error,
                "bins": [
                    {
                        "from": round(float(bins.edges[k]), 9),
                        "to": round(float(bins.edges[k + 1]), 9),
                        "count": int(bins.count[k]),
                        "confidence": _number(bins.confidence[k]),
                        "right": _number(bins.right[k]),
                    }
                    for k in range(len(bins.count))
                ],
            },
            "bars": told,
            "passed": all(one["passed"] for one in told),
        }


def evaluate(
    pairs: Sequence[Pair],
    backend: str | Segment | None = None,
    each: Callable[[Photo], None] = lambda photo: None,
    progress: Progress = lambda *_: None,
) -> Found:
    """Segment every photo by a backend, its name or the default, and judge; `each` is told of one after the other.

    Raises InputError with every photo and map that cannot be read or does not fit, before anything is segmented.
    """
    segment: Segment = backend if callable(backend) else backends.make("segment", backend)
    problems = []
    for k, pair in enumerate(pairs):
        progress("read", k, len(pairs))
        try:
            pair.read()
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    rows, judged = [], {scope: list[tuple[Judged, ...]]() for scope in SCOPES}
    for k, pair in enumerate(pairs):
        progress(pair.name, k, len(pairs))
        truth = pair.read()
        photo = judge_photo(pair.name, truth, masks_of(segment(truth.rgb)))
        rows.append(photo.as_dict())
        for scope in SCOPES:
            judged[scope].append(photo.judged[scope])
        each(photo)
    at_half = {scope: [one[0] for one in judged[scope]] for scope in SCOPES}
    totals = {scope: _totals(rows, judged[scope], scope) for scope in SCOPES}
    lines = {scope: curve(at_half[scope]) for scope in SCOPES}
    return Found(rows, totals, lines, reliability(at_half["all"]))


def _totals(
    rows: Sequence[Mapping[str, Any]], judged: Sequence[tuple[Judged, ...]], scope: str
) -> dict[str, Any]:
    """Objects pooled, means over photos, and average precision at 0.5 and over COCO's thresholds."""
    own = [row if scope == "all" else row["whole"] for row in rows]
    values = {
        key: [row[key] for row in own if row[key] is not None] for key in ("precision", "recall", "f", "iou")
    }
    ap = [average_precision([one[t] for one in judged]) for t in range(len(THRESHOLDS))]
    known = [value for value in ap if value is not None]
    return {
        "micro": counts([one[0] for one in judged]),
        "macro": {key: float(np.mean(some)) if some else None for key, some in values.items()},
        "ap50": ap[0],
        "ap": float(np.mean(known)) if known else None,
    }


def _points(line: Curve) -> list[dict[str, Any]]:
    fall = falling(line.precision)
    return [
        {
            "confidence": _number(line.confidence[k]),
            "recall": _number(line.recall[k]),
            "precision": _number(line.precision[k]),
            "falling": _number(fall[k]),
        }
        for k in range(len(line.recall))
    ]


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
