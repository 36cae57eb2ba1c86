"""Objects found on photos against true masks, matched as COCO does: counts, average precision, calibration.

T.-Y. Lin et al., "Microsoft COCO: Common Objects in Context" (2014), and `pycocotools.cocoeval`, with which tests
compare.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physgen import registry
from physgen.evaluate.ground_truth import Mask, Pair, Patch, Truth, patches
from physgen.evaluate.measure import (
    Bar,
    Figure,
    Findings,
    Progress,
    Section,
    Table,
    counted,
    number,
    plotted,
)
from physgen.perceive.roles import Segment, Segments
from physgen.problems import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from physgen.report.plots.style import Palette


Floats = NDArray[np.float64]
Detections = tuple[tuple[Patch, ...], Floats]
"""Masks, and confidences (N,)."""

THRESHOLDS: tuple[float, ...] = tuple(np.linspace(0.5, 0.95, 10).tolist())
"""COCO's, of IoU; counts are taken at the first."""
RECALLS = np.linspace(0.0, 1.0, 101)
"""COCO's, at which precision is read."""
BINS = 10
"""Of confidence."""


# ---- matching ----------------------------------------------------------------------------------------------------


def overlaps(found: Sequence[Patch], true: Sequence[Patch]) -> Floats:
    """(N, M): intersection over union of each found with each true mask; 0 where both are empty."""
    result = np.zeros((len(found), len(true)))
    areas, true_areas = [one.area for one in found], [one.area for one in true]
    for i, one in enumerate(found):
        for j, other in enumerate(true):
            if common := one.shared(other):
                result[i, j] = common / (areas[i] + true_areas[j] - common)
    return result


@dataclass(frozen=True, eq=False)
class Judged:
    """Matches of one photo's N found and M true masks at one threshold of overlap."""

    confidence: Floats
    """(N,)."""
    match: NDArray[np.int64]
    """(N,): the true mask of each; -1 for none."""
    overlap: Floats
    """(N,): IoU with the match; 0 without."""
    true: int
    """M."""

    @property
    def right(self) -> Mask:
        """(N,): whether it has a match."""
        return self.match >= 0

    @property
    def missed(self) -> list[int]:
        """True masks without a match."""
        return sorted(set(range(self.true)) - set(self.match.tolist()))


def judge(overlap: Floats, confidence: Floats, threshold: float = THRESHOLDS[0]) -> Judged:
    """Match masks by falling confidence, each with the free true mask of largest `overlap` (N, M), `threshold` or
    more.

    Of equal overlaps the last wins, of equal confidences the first chooses, as in COCO. Every true mask is matched
    once.
    """
    found, true = overlap.shape
    match, free = np.full(found, -1, np.int64), np.ones(true, np.bool_)
    least = min(threshold, 1 - 1e-10)
    for i in np.argsort(-confidence, kind="stable").tolist():
        near = np.flatnonzero(free & (overlap[i] >= least))
        if len(near):
            best = overlap[i, near]
            match[i] = near[len(near) - 1 - int(best[::-1].argmax())]
            free[match[i]] = False
    achieved = np.where(match >= 0, overlap[np.arange(found), match] if true else 0.0, 0.0)
    return Judged(np.asarray(confidence, np.float64), match, achieved, true)


def counts(photos: Sequence[Judged]) -> dict[str, Any]:
    """Pooled: `said` (found), `true`, `hit`, `precision`, `recall`, `f` (harmonic mean of the two), `iou` (mean over
    hits).

    None where a value has no meaning.
    """
    found, true = sum(len(one.match) for one in photos), sum(one.true for one in photos)
    reached = np.concatenate([one.overlap[one.right] for one in photos] or [np.zeros(0)])
    hit = len(reached)
    return {
        "said": found,
        "true": true,
        "hit": hit,
        "precision": hit / found if found else None,
        "recall": hit / true if true else None,
        "f": 2 * hit / (found + true) if found + true else None,
        "iou": float(reached.mean()) if hit else None,
    }


@dataclass(frozen=True, eq=False)
class Curve:
    """Precision and recall as masks of ever lower confidence are taken in; (K,) each."""

    confidence: Floats
    """Falling."""
    recall: Floats
    """Rising; NaN where nothing is true."""
    precision: Floats

    @property
    def falling(self) -> Floats:
        """(K,): the highest precision at this recall or a larger one."""
        return np.maximum.accumulate(self.precision[::-1])[::-1]


def curve(photos: Sequence[Judged]) -> Curve:
    """Of all photos together; of equal confidences, those of earlier photos come first."""
    confidence = np.concatenate([one.confidence for one in photos] or [np.zeros(0)])
    right = np.concatenate([one.right for one in photos] or [np.zeros(0, np.bool_)])
    order = np.argsort(-confidence, kind="stable")
    hits = np.cumsum(right[order])
    true = sum(one.true for one in photos) or np.nan
    return Curve(confidence[order], hits / true, hits / np.arange(1, len(order) + 1))


def average_precision(photos: Sequence[Judged]) -> float | None:
    """COCO's AP at the threshold at which the photos were judged; None where nothing is true."""
    if not any(one.true for one in photos):
        return None
    line = curve(photos)
    best = np.append(line.falling, 0.0)  # 0 beyond the largest recall
    return float(best[np.searchsorted(line.recall, RECALLS, side="left")].mean())


@dataclass(frozen=True, eq=False)
class Reliability:
    """Confidence against the share that is right, in bins of equal width; (B,) each."""

    edges: Floats
    """(B + 1,) in 0..1; a bin holds its upper edge, the first one 0 as well."""
    count: NDArray[np.int64]
    confidence: Floats
    """Mean of a bin; NaN where it is empty."""
    right: Floats
    """Share of a bin; NaN where it is empty."""

    @property
    def error(self) -> float | None:
        """Expected calibration error: mean distance of the two, weighted by counts (Naeini et al. 2015)."""
        total = int(self.count.sum())
        if not total:
            return None
        off = np.where(self.count > 0, np.abs(self.right - self.confidence), 0.0)
        return float((self.count * off).sum() / total)

    def bins(self) -> list[dict[str, Any]]:
        """As JSON."""
        return [
            {
                "from": float(self.edges[k]),
                "to": float(self.edges[k + 1]),
                "count": int(self.count[k]),
                "confidence": float(self.confidence[k]) if self.count[k] else None,
                "right": float(self.right[k]) if self.count[k] else None,
            }
            for k in range(BINS)
        ]


def reliability(photos: Sequence[Judged]) -> Reliability:
    """Of all photos together."""
    confidence = np.concatenate([one.confidence for one in photos] or [np.zeros(0)])
    right = np.concatenate([one.right.astype(np.float64) for one in photos] or [np.zeros(0)])
    edges = np.linspace(0, 1, BINS + 1)
    place = np.clip(np.searchsorted(edges, confidence, side="left") - 1, 0, BINS - 1)
    count = np.bincount(place, minlength=BINS)
    with np.errstate(invalid="ignore"):
        means = [np.bincount(place, values, BINS) / count for values in (confidence, right)]
    return Reliability(edges, count, means[0], means[1])


# ---- the measure -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Photo:
    """One photo's masks and their matches."""

    name: str
    truth: Truth
    found: Detections
    judged: tuple[Judged, ...]
    """At each of COCO's thresholds."""

    def as_dict(self) -> dict[str, Any]:
        """A row: counts at 0.5."""
        return {"photo": self.name, **counts([self.judged[0]])}


def masks_of(segments: Segments) -> Detections:
    """A segmenter's label map as masks; ids without pixels are left out."""
    found = patches(segments.labels)
    ids = [i for i in found if i <= len(segments.confidence)]
    return tuple(found[i] for i in ids), np.array([segments.confidence[i - 1] for i in ids], np.float64)


def judge_photo(name: str, truth: Truth, found: Detections) -> Photo:
    """Masks against truth. Unjudged pixels count for neither; masks that lie mostly there are left out."""
    masks, confidence = found
    if truth.unjudged.any():
        unjudged = truth.unjudged.copy()
        for true in truth.masks:  # what crowds share with a true object is that object's
            true.part(unjudged)[true.mask] = False
        known = [one.mask & ~one.part(unjudged) for one in masks]
        kept = [k for k, part in enumerate(known) if 2 * np.count_nonzero(part) > masks[k].area]
        masks = tuple(Patch.of(known[k], masks[k].x, masks[k].y) for k in kept)
        confidence = confidence[kept]
    overlap = overlaps(masks, truth.masks)
    judged = tuple(judge(overlap, confidence, threshold) for threshold in THRESHOLDS)
    return Photo(name, truth, (masks, confidence), judged)


@dataclass(frozen=True, eq=False)
class Found:
    """Over all photos."""

    rows: list[dict[str, Any]]
    """One a photo."""
    total: Mapping[str, Any]
    """Counts at 0.5 of all objects together; average precision `ap50`, `ap`, and `ap_by_iou` at COCO's thresholds."""
    curve: Curve
    """At 0.5."""
    reliability: Reliability

    def as_dict(self) -> dict[str, Any]:
        """As JSON, beside `rows`."""
        reliability = {"error": self.reliability.error, "bins": self.reliability.bins()}
        return {"iou": THRESHOLDS[0], "total": self.total, "reliability": reliability}


def evaluate(
    pairs: Sequence[Pair],
    backend: str | Segment | None = None,
    progress: Progress = lambda *_: None,
) -> Found:
    """Segment every photo by a backend, its name or the default, and judge.

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
    rows, judged = [], list[tuple[Judged, ...]]()
    for k, pair in enumerate(pairs):
        progress(pair.name, k, len(pairs))
        truth = pair.read()
        found = judge_photo(pair.name, truth, masks_of(segment(truth.rgb)))
        rows.append(found.as_dict())
        judged.append(found.judged)
    by_iou = [[one[t] for one in judged] for t in range(len(THRESHOLDS))]
    ap = [average_precision(photos) for photos in by_iou]
    known = [value for value in ap if value is not None]
    total = {
        **counts(by_iou[0]),
        "ap50": ap[0],
        "ap": float(np.mean(known)) if known else None,
        "ap_by_iou": [{"iou": round(iou, 2), "ap": value} for iou, value in zip(THRESHOLDS, ap, strict=True)],
    }
    return Found(rows, total, curve(by_iou[0]), reliability(by_iou[0]))


# ---- report ------------------------------------------------------------------------------------------------------

BARS = {"precision": "precision", "recall": "recall", "iou": "mean IoU"}
"""What a bar may be set for, of all objects of all photos."""
HEADS = ("photo", "true", "found", "hit", "precision", "recall", "F", "IoU")
CURVES, CALIBRATION = "Precision over recall", "Calibration"
PAPER = "The paper: precision 0.93 and recall 0.82 at the same IoU, on 10 photos of its own with 118 objects."


def findings(found: Found, bars: Mapping[str, float]) -> Findings:
    """`bars`: the least that precision, recall or mean IoU of all objects together must be."""
    total, bins = found.total, found.reliability.bins()
    met = tuple(
        Bar(f"{BARS[name]} of all together", _share(total[name]), f"{bar:g}", (total[name] or 0.0) >= bar)
        for name, bar in bars.items()
    )
    rows = tuple(_cells(row) for row in (*found.rows, {"photo": "all together", **total}))
    heads = ("average precision at IoU", *(f"{iou:.2f}" for iou in THRESHOLDS))
    by_iou = ("all objects", *(_share(one["ap"]) for one in total["ap_by_iou"]))
    calibration = tuple(
        (
            f"{one['from']:.1f} to {one['to']:.1f}",
            str(one["count"]),
            _share(one["confidence"]),
            _share(one["right"]),
        )
        for one in bins
    )
    sections = (
        Section("Photo by photo", (), (Table(HEADS, rows),)),
        Section(CURVES, (), (Table(heads, (by_iou,)),)),
        Section(CALIBRATION, (), (Table(("confidence", "found", "mean", "share right"), calibration),)),
    )
    sentences = (
        f"On {counted(len(found.rows), 'photo')}, {total['hit']} of {total['true']} objects are found (recall "
        f"{_share(total['recall'])}), and {total['hit']} of {total['said']} detections are right (precision "
        f"{_share(total['precision'])}), at an IoU of {THRESHOLDS[0]:g} or more; mean IoU {_share(total['iou'])}.",
        f"AP50 {_share(total['ap50'])}, AP50:95 {_share(total['ap'])}.",
        f"Expected calibration error {_share(found.reliability.error)}: confidence against the share right.",
        PAPER,
    )
    title = "Are objects found?"
    return Findings("segmentation", title, sentences, sections, found.rows, met, found.as_dict())


def _share(value: float | None) -> str:
    return number(value, ".3f")


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    numbers = (str(row[key]) for key in ("true", "said", "hit"))
    return (row["photo"], *numbers, *(_share(row[key]) for key in ("precision", "recall", "f", "iou")))


def illustrated(report: Findings, found: Found) -> Findings:
    """With plots of precision over recall, and of calibration."""
    figures = zip((CURVES, CALIBRATION), plots(found), strict=True)
    return report.with_parts({title: (figure,) for title, figure in figures}, first=False)


def plots(found: Found) -> Iterator[Figure]:
    """Of precision over recall, and of calibration."""
    line, bins = found.curve, found.reliability

    def precision(axes: Axes, palette: Palette) -> None:
        axes.plot(line.recall, line.precision, color=palette.blue, linewidth=0.5, alpha=0.6)
        axes.step(line.recall, line.falling, color=palette.blue, linewidth=1.4, where="pre")
        axes.set(xlabel="recall", ylabel="precision", xlim=(0, 1), ylim=(0, 1.02))

    yield plotted(
        precision, "Precision over recall at an IoU of 0.5: as it is (thin), as AP reads it (bold).", 100, 90
    )

    def diagram(axes: Axes, palette: Palette) -> None:
        middles = (bins.edges[1:] + bins.edges[:-1]) / 2
        axes.bar(middles, np.nan_to_num(bins.right), 0.9 / BINS, color=palette.blue, alpha=0.4)
        axes.plot(bins.confidence, bins.right, "o", color=palette.orange, markersize=3)
        axes.plot([0, 1], [0, 1], color=palette.soft, linestyle="--", linewidth=0.7)
        axes.set(xlabel="confidence", ylabel="share that is right", xlim=(0, 1), ylim=(0, 1.1))

    yield plotted(
        diagram, "Share that is right over confidence; on the diagonal, confidences can be believed.", 100, 90
    )
