"""Photos with true masks -> how much a segmenter finds, how much of what it says is true, how sure it may be.

Masks are matched as COCO matches them (`matching`), over all true objects and over whole ones: those that the photo's
border cuts are then neither missed when nobody says them, nor is it false to say them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen import registry
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
DRAWN = (0.5, 0.75, 0.9)
"""Thresholds of IoU whose curves are kept."""

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
    """By scope: `micro`, `macro`, `ap50`, `ap`, and `ap_by_iou` at each of COCO's thresholds."""
    labels: list[dict[str, Any]]
    """By label of the true objects, where COCO's categories tell it: how many are found, and how well."""
    curves: Mapping[str, Curve]
    """By scope, at 0.5."""
    strict: Mapping[float, Curve]
    """By threshold of IoU, of all objects."""
    reliability: Reliability
    """Of all objects."""

    def as_dict(self) -> dict[str, Any]:
        """As JSON, beside `rows`."""
        bins = self.reliability
        return {
            "iou": IOU,
            "totals": self.totals,
            "labels": self.labels,
            "curve": {scope: _points(line) for scope, line in self.curves.items()},
            "curve_by_iou": {f"{threshold:g}": _points(line) for threshold, line in self.strict.items()},
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
    segment: Segment = backend if callable(backend) else registry.make("segment", backend)
    problems = []
    for k, pair in enumerate(pairs):
        progress("read", k, len(pairs))
        try:
            pair.read()
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    rows, names = [], list[tuple[str, ...]]()
    judged = {scope: list[tuple[Judged, ...]]() for scope in SCOPES}
    for k, pair in enumerate(pairs):
        progress(pair.name, k, len(pairs))
        truth = pair.read()
        photo = judge_photo(pair.name, truth, masks_of(segment(truth.rgb)))
        rows.append(photo.as_dict())
        names.append(truth.labels)
        for scope in SCOPES:
            judged[scope].append(photo.judged[scope])
        each(photo)
    at_half = {scope: [one[0] for one in judged[scope]] for scope in SCOPES}
    totals = {scope: _totals(rows, judged[scope], scope) for scope in SCOPES}
    lines = {scope: curve(at_half[scope]) for scope in SCOPES}
    every = judged["all"]
    strict = {iou: curve([one[_at(iou)] for one in every]) for iou in DRAWN}
    return Found(rows, totals, by_label(every, names), lines, strict, reliability(at_half["all"]))


def _at(threshold: float) -> int:
    return int(np.argmin(np.abs(np.array(THRESHOLDS) - threshold)))


def by_label(judged: Sequence[tuple[Judged, ...]], names: Sequence[tuple[str, ...]]) -> list[dict[str, Any]]:
    """Of each label, the commonest first: `true`, `hit`, `recall` and `iou` at 0.5, `ar`: recall, a mean over COCO's.

    Who is falsely found has no label, so that there is no precision of one. Photos without labels are passed over.
    """
    hits: dict[str, list[NDArray[np.float64]]] = {}
    for photo, labels in zip(judged, names, strict=True):
        reached = np.zeros((len(THRESHOLDS), len(labels)))
        for t, one in enumerate(photo):
            if labels:
                reached[t, one.match[one.right]] = one.overlap[one.right]
        for k, label in enumerate(labels):
            hits.setdefault(label or "without a label", []).append(reached[:, k])
    found = []
    for label, columns in hits.items():
        reached = np.stack(columns, axis=1)
        half = reached[_at(IOU)]
        hit = int((half > 0).sum())
        found.append(
            {
                "label": label,
                "true": len(columns),
                "hit": hit,
                "recall": hit / len(columns),
                "iou": float(half[half > 0].mean()) if hit else None,
                "ar": float((reached > 0).mean()),
            }
        )
    return sorted(found, key=lambda one: (-one["true"], one["label"]))


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
        "ap_by_iou": [{"iou": round(iou, 2), "ap": value} for iou, value in zip(THRESHOLDS, ap, strict=True)],
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
