"""Judged photos -> counts, precision over recall, COCO's average precision, and how far confidences can be
believed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.matching import Judged

Floats = NDArray[np.float64]

THRESHOLDS: tuple[float, ...] = tuple(np.linspace(0.5, 0.95, 10).tolist())
"""COCO's, of IoU."""
RECALLS = np.linspace(0.0, 1.0, 101)
"""COCO's, at which precision is read."""
BINS = 10
"""Of confidence, equally wide."""


@dataclass(frozen=True, eq=False)
class Curve:
    """Precision and recall as ever more doubtful masks are taken in; (K,) each, one entry a counted mask."""

    confidence: Floats
    """Falling: the least that is still taken."""
    recall: Floats
    """Rising."""
    precision: Floats
    """As it is, not yet made to fall."""


@dataclass(frozen=True, eq=False)
class Reliability:
    """Said confidence against the share that is right, in bins of equal width; (B,) each."""

    edges: Floats
    """(B + 1,) in 0..1; a bin holds its upper edge, the first one 0 as well."""
    count: NDArray[np.int64]
    confidence: Floats
    """Mean of a bin; NaN where it is empty."""
    right: Floats
    """Share of a bin that is right; NaN where it is empty."""

    @property
    def error(self) -> float | None:
        """Expected calibration error: mean distance of the two, weighed by counts (Naeini et al. 2015)."""
        total = int(self.count.sum())
        if not total:
            return None
        off = np.where(self.count > 0, np.abs(self.right - self.confidence), 0.0)
        return float((self.count * off).sum() / total)


def counts(photos: Sequence[Judged]) -> dict[str, Any]:
    """Pooled: `said`, `true`, `hit`, `precision`, `recall`, `f`, `iou`; None for what nothing is said or true of.

    `f` is the harmonic mean of precision and recall, `iou` the mean over hits.
    """
    said = sum(int(one.counted.sum()) for one in photos)
    true = sum(int((~one.ignored).sum()) for one in photos)
    reached = np.concatenate([one.overlap[one.right] for one in photos]) if photos else np.zeros(0)
    hit = len(reached)
    return {
        "said": said,
        "true": true,
        "hit": hit,
        "precision": hit / said if said else None,
        "recall": hit / true if true else None,
        "f": 2 * hit / (said + true) if said + true else None,
        "iou": float(reached.mean()) if hit else None,
    }


def curve(photos: Sequence[Judged]) -> Curve:
    """Of all photos together; of equal confidences, those of earlier photos come first."""
    true = sum(int((~one.ignored).sum()) for one in photos)
    parts = []
    for one in photos:
        order = np.argsort(-one.confidence, kind="stable")
        order = order[one.counted[order]]
        parts.append(np.stack([one.confidence[order], one.right[order]]))
    confidence, right = np.concatenate(parts, axis=1) if parts else np.zeros((2, 0))
    order = np.argsort(-confidence, kind="stable")
    hits = np.cumsum(right[order])
    taken = np.arange(1, len(order) + 1)
    recall = hits / true if true else np.full(len(order), np.nan)
    return Curve(confidence[order], recall, hits / taken)


def falling(precision: Floats) -> Floats:
    """(K,): the most that is reached at this recall or a larger one."""
    return np.maximum.accumulate(precision[::-1])[::-1]


def precisions(line: Curve) -> Floats:
    """(101,): the falling precision at COCO's recalls; 0 beyond the largest recall."""
    at = np.searchsorted(line.recall, RECALLS, side="left")
    best = np.append(falling(line.precision), 0.0)
    return np.asarray(best[at], np.float64)


def average_precision(photos: Sequence[Judged]) -> float | None:
    """AP at the threshold that the photos were judged at; None where nothing is true."""
    if not any((~one.ignored).any() for one in photos):
        return None
    return float(precisions(curve(photos)).mean())


def reliability(photos: Sequence[Judged]) -> Reliability:
    """Of all photos together."""
    confidence = np.concatenate([one.confidence[one.counted] for one in photos] or [np.zeros(0)])
    right = np.concatenate([one.right[one.counted].astype(np.float64) for one in photos] or [np.zeros(0)])
    edges = np.linspace(0, 1, BINS + 1)
    place = np.clip(np.searchsorted(edges, confidence, side="left") - 1, 0, BINS - 1)
    count = np.bincount(place, minlength=BINS)
    with np.errstate(invalid="ignore"):
        means = [np.bincount(place, values, BINS) / count for values in (confidence, right)]
    return Reliability(edges, count, means[0], means[1])
