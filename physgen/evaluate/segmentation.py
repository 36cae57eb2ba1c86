"""Objects found on photos against true masks, matched as COCO does: counts, average precision, calibration.

T.-Y. Lin et al., "Microsoft COCO: Common Objects in Context" (2014), and `pycocotools.cocoeval`, with which tests
compare. Counts are taken over all true objects, and over whole ones: objects cut by the photo's border may then be
found or missed without effect.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen import registry
from physgen.evaluate.ground_truth import Mask, Pair, Patch, Truth, patches
from physgen.evaluate.measure import (
    PAGE,
    RESULT,
    Bar,
    Figure,
    Findings,
    Progress,
    Section,
    Table,
    check_folder,
    counted,
    number,
    photo,
    plotted,
)
from physgen.files import write_atomic
from physgen.maps import write_png
from physgen.perceive.roles import Segment, Segments
from physgen.problems import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from physgen.report.plots.style import Palette


Floats = NDArray[np.float64]
Detections = tuple[tuple[Patch, ...], Floats]
"""Masks, and confidences (N,)."""

IOU = 0.5
"""At which counts are taken."""
THRESHOLDS: tuple[float, ...] = tuple(np.linspace(0.5, 0.95, 10).tolist())
"""COCO's, of IoU."""
RECALLS = np.linspace(0.0, 1.0, 101)
"""COCO's, at which precision is read."""
DRAWN = (0.5, 0.75, 0.9)
"""Thresholds of IoU with drawn curves."""
BINS = 10
"""Of confidence."""
SCOPES = {"all": "all objects", "whole": "whole objects only"}


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
    counted: Mask
    """(N,): false for matches with an ignored true mask, which are neither right nor false."""
    overlap: Floats
    """(N,): IoU with the match; 0 without."""
    ignored: Mask
    """(M,): true masks that may be found or missed without effect."""

    @property
    def right(self) -> Mask:
        """(N,): matched and counted."""
        return self.counted & (self.match >= 0)

    @property
    def missed(self) -> list[int]:
        """True masks, not ignored ones, without a match."""
        found = set(self.match.tolist())
        return [j for j, out in enumerate(self.ignored.tolist()) if not out and j not in found]


def judge(overlap: Floats, confidence: Floats, ignored: Mask, threshold: float = IOU) -> Judged:
    """Match masks by falling confidence, each with the free true mask of largest `overlap` (N, M), `threshold` or
    more.

    A true mask that counts goes before an ignored one (M,); of equal overlaps the last wins, of equal confidences the
    first chooses, as in COCO. Every true mask is matched once.
    """
    found, true = overlap.shape
    match = np.full(found, -1, np.int64)
    counts, free = np.ones(found, np.bool_), np.ones(true, np.bool_)
    least = min(threshold, 1 - 1e-10)
    for i in np.argsort(-confidence, kind="stable").tolist():
        for group in (free & ~ignored, free & ignored):
            near = np.flatnonzero(group & (overlap[i] >= least))
            if len(near):
                best = overlap[i, near]
                j = int(near[len(near) - 1 - int(best[::-1].argmax())])
                match[i], free[j], counts[i] = j, False, not ignored[j]
                break
    achieved = np.where(match >= 0, overlap[np.arange(found), match] if true else 0.0, 0.0)
    return Judged(np.asarray(confidence, np.float64), match, counts, achieved, ignored)


def counts(photos: Sequence[Judged]) -> dict[str, Any]:
    """Pooled: `said` (found), `true`, `hit`, `precision`, `recall`, `f` (harmonic mean of the two), `iou` (mean over
    hits).

    None where a value has no meaning.
    """
    found = sum(int(one.counted.sum()) for one in photos)
    true = sum(int((~one.ignored).sum()) for one in photos)
    reached = np.concatenate([one.overlap[one.right] for one in photos]) if photos else np.zeros(0)
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
    """Rising."""
    precision: Floats

    @property
    def falling(self) -> Floats:
        """(K,): the highest precision at this recall or a larger one."""
        return np.maximum.accumulate(self.precision[::-1])[::-1]

    def points(self) -> list[dict[str, float | None]]:
        """As JSON."""
        columns = {
            "confidence": self.confidence, "recall": self.recall, "precision": self.precision, "falling": self.falling,
        }  # fmt: skip
        return [
            {name: _finite(values[k]) for name, values in columns.items()} for k in range(len(self.recall))
        ]


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
    recall = hits / true if true else np.full(len(order), np.nan)
    return Curve(confidence[order], recall, hits / np.arange(1, len(order) + 1))


def average_precision(photos: Sequence[Judged]) -> float | None:
    """COCO's AP at the threshold at which the photos were judged; None where nothing is true."""
    if not any((~one.ignored).any() for one in photos):
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

    def as_dict(self) -> dict[str, Any]:
        bins = [
            {
                "from": round(float(self.edges[k]), 9),
                "to": round(float(self.edges[k + 1]), 9),
                "count": int(self.count[k]),
                "confidence": _finite(self.confidence[k]),
                "right": _finite(self.right[k]),
            }
            for k in range(len(self.count))
        ]
        return {"error": self.error, "bins": bins}


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


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


# ---- the measure -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Photo:
    """One photo's masks and their matches."""

    name: str
    truth: Truth
    found: Detections
    judged: Mapping[str, tuple[Judged, ...]]
    """By scope, at each of COCO's thresholds."""

    def as_dict(self) -> dict[str, Any]:
        """A row: counts at 0.5 over all objects; over whole ones under `whole`."""
        every, whole = (counts([self.judged[scope][0]]) for scope in SCOPES)
        cut = sum(patch.cut_by(self.truth.size) for patch in self.truth.masks)
        return {"photo": self.name, **every, "cut": cut, "whole": whole}


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
    """By label of the true objects, where COCO's categories name it."""
    curves: Mapping[str, Curve]
    """By scope, at 0.5."""
    strict: Mapping[float, Curve]
    """By threshold of IoU, of all objects."""
    reliability: Reliability
    """Of all objects."""

    def as_dict(self) -> dict[str, Any]:
        """As JSON, beside `rows`."""
        return {
            "iou": IOU,
            "totals": self.totals,
            "labels": self.labels,
            "curve": {scope: line.points() for scope, line in self.curves.items()},
            "curve_by_iou": {f"{threshold:g}": line.points() for threshold, line in self.strict.items()},
            "reliability": self.reliability.as_dict(),
        }


def evaluate(
    pairs: Sequence[Pair],
    backend: str | Segment | None = None,
    each: Callable[[Photo], None] = lambda photo: None,
    progress: Progress = lambda *_: None,
) -> Found:
    """Segment every photo by a backend, its name or the default, and judge; `each` is called with every photo.

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
        found = judge_photo(pair.name, truth, masks_of(segment(truth.rgb)))
        rows.append(found.as_dict())
        names.append(truth.labels)
        for scope in SCOPES:
            judged[scope].append(found.judged[scope])
        each(found)
    at_half = {scope: [one[0] for one in judged[scope]] for scope in SCOPES}
    every = judged["all"]
    return Found(
        rows,
        {scope: _totals(rows, judged[scope], scope) for scope in SCOPES},
        by_label(every, names),
        {scope: curve(at_half[scope]) for scope in SCOPES},
        {iou: curve([one[_at(iou)] for one in every]) for iou in DRAWN},
        reliability(at_half["all"]),
    )


def _at(threshold: float) -> int:
    return int(np.argmin(np.abs(np.array(THRESHOLDS) - threshold)))


def by_label(judged: Sequence[tuple[Judged, ...]], names: Sequence[tuple[str, ...]]) -> list[dict[str, Any]]:
    """Of each true label, the commonest first: `true`, `hit`, `recall` and `iou` at 0.5, `ar`: mean recall over
    COCO's IoUs.

    False detections have no label, so that there is no precision. Photos without labels are left out.
    """
    hits: dict[str, list[Floats]] = {}
    for found, labels in zip(judged, names, strict=True):
        reached = np.zeros((len(THRESHOLDS), len(labels)))
        for t, one in enumerate(found):
            if labels:
                reached[t, one.match[one.right]] = one.overlap[one.right]
        for k, label in enumerate(labels):
            hits.setdefault(label or "without a label", []).append(reached[:, k])
    rows = []
    for label, columns in hits.items():
        reached = np.stack(columns, axis=1)
        half = reached[_at(IOU)]
        hit = int((half > 0).sum())
        row = {"label": label, "true": len(columns), "hit": hit, "recall": hit / len(columns)}
        rows.append(
            {**row, "iou": float(half[half > 0].mean()) if hit else None, "ar": float((reached > 0).mean())}
        )
    return sorted(rows, key=lambda one: (-one["true"], one["label"]))


def _totals(
    rows: Sequence[Mapping[str, Any]], judged: Sequence[tuple[Judged, ...]], scope: str
) -> dict[str, Any]:
    """Objects pooled, means over photos, and average precision at 0.5 and over COCO's thresholds."""
    own = [row if scope == "all" else row["whole"] for row in rows]
    values = {key: [row[key] for row in own if row[key] is not None] for key in SHARES}
    ap = [average_precision([one[t] for one in judged]) for t in range(len(THRESHOLDS))]
    known = [value for value in ap if value is not None]
    return {
        "micro": counts([one[0] for one in judged]),
        "macro": {key: float(np.mean(some)) if some else None for key, some in values.items()},
        "ap50": ap[0],
        "ap": float(np.mean(known)) if known else None,
        "ap_by_iou": [{"iou": round(iou, 2), "ap": value} for iou, value in zip(THRESHOLDS, ap, strict=True)],
    }


# ---- report ------------------------------------------------------------------------------------------------------

BARS = {"precision": "precision", "recall": "recall", "iou": "mean IoU"}
"""What a bar may be set for, of all objects of all photos."""
COUNTS, SHARES = ("true", "said", "hit"), ("precision", "recall", "f", "iou")
HEADS = ("photo", "true", "found", "hit", "precision", "recall", "F", "IoU")
WHOLE = ("whole: true", "found", "hit", "precision", "recall", "F")
CURVES = "Precision over recall"
PAPER = "The paper: precision 0.93 and recall 0.82 at the same IoU, on 10 photos of its own with 118 objects."


def findings(found: Found, bars: Mapping[str, float]) -> Findings:
    """`bars`: the least that precision, recall or mean IoU of all objects together must be."""
    micro = found.totals["all"]["micro"]
    met = tuple(
        Bar(f"{BARS[name]} of all together", _share(micro[name]), f"{bar:g}", (micro[name] or 0.0) >= bar)
        for name, bar in bars.items()
    )
    sections = [Section("Photo by photo", (), (_photo_table(found),))]
    if found.labels:
        rows = tuple(
            (
                one["label"],
                str(one["true"]),
                str(one["hit"]),
                *(_share(one[key]) for key in ("recall", "iou", "ar")),
            )
            for one in found.labels
        )
        note = (
            "Labels are those of the truth; false detections have none, so that there is no precision. AR: recall, its "
            "mean over IoU 0.50, 0.55 .. 0.95."
        )
        sections.append(
            Section(
                "By label", (), (Table(("label", "true", "hit", "recall", "IoU", "AR"), rows, note=note),)
            )
        )
    heads = ("average precision at IoU", *(f"{iou:.2f}" for iou in THRESHOLDS))
    lines = tuple(
        (name, *(_share(one["ap"]) for one in found.totals[scope]["ap_by_iou"]))
        for scope, name in SCOPES.items()
    )
    sections.append(Section(CURVES, (), (Table(heads, lines),)))
    sentences = (
        f"On {counted(len(found.rows), 'photo')}, {micro['hit']} of {micro['true']} objects are found (recall "
        f"{_share(micro['recall'])}), and {micro['hit']} of {micro['said']} detections are right (precision "
        f"{_share(micro['precision'])}), at an IoU of {IOU:g} or more; mean IoU {_share(micro['iou'])}.",
        *(
            f"AP50 {_share(found.totals[scope]['ap50'])}, AP50:95 {_share(found.totals[scope]['ap'])}: {name}."
            for scope, name in SCOPES.items()
        ),
        f"Expected calibration error {_share(found.reliability.error)}: confidence against the share right.",
        PAPER,
    )
    return Findings(
        "segmentation", "Are objects found?", sentences, tuple(sections), found.rows, met, found.as_dict()
    )


def _share(value: float | None) -> str:
    return number(value, ".3f")


def _photo_table(found: Found) -> Table:
    totals = found.totals
    together, means = ({**totals["all"][kind], "whole": totals["whole"][kind]} for kind in ("micro", "macro"))

    def cells(row: Mapping[str, Any], name: str) -> tuple[str, ...]:
        whole = row["whole"]
        return (
            name,
            *(str(row.get(key, "")) for key in COUNTS),
            *(_share(row[key]) for key in SHARES),
            *(str(whole.get(key, "")) for key in COUNTS),
            *(_share(whole[key]) for key in SHARES[:3]),
        )

    rows = [*(cells(row, row["photo"]) for row in found.rows), cells(together, "all together")]
    cut = sum(row["cut"] for row in found.rows)
    them = f"the {cut} objects" if cut > 1 else "the object"
    note = f"Whole: without {them} that a photo's border cuts off, which may be found or not." if cut else ""
    return Table((*HEADS, *WHOLE), (*rows, cells(means, "mean of photos")), note=note)


PLOTS = {
    "precision-recall.svg": "Precision over recall at an IoU of 0.5: as it is (thin), and as AP reads it (bold).",
    "precision-recall-by-iou.svg": "The same of all objects at three IoUs: how well outlines must fit.",
    "reliability.svg": "Share that is right over confidence; on the diagonal, confidences can be believed.",
}
ON_PAGE = 24
"""Photos on the page; the folder has all."""


class Folder:
    """Writes marked photos and plots into a folder, made at once; files of an earlier run are replaced."""

    def __init__(self, folder: Path, pairs: Sequence[Pair] = ()) -> None:
        """Raises InputError where one of the measured `pairs` would be overwritten."""
        check_folder(folder, plots=True)
        self._photos, self._folder, self._pictures = folder / "photos", folder, list[Figure]()
        ours = {(self._photos / f"{pair.name}.png").resolve() for pair in pairs}
        ours |= {(folder / name).resolve() for name in (*PLOTS, PAGE, RESULT)}
        fix = "name another folder with -o"
        for path in (path for pair in pairs for path in (pair.photo, pair.truth)):
            if path.resolve() in ours:
                raise InputError.of("-o", f'"{path}"', "would be written over by the marked photos", fix)
        if self._photos.exists() and any(self._photos.iterdir()) and not (folder / RESULT).exists():
            raise InputError.of("-o", f'"{self._photos}"', "holds files that are not of an earlier run", fix)
        self._photos.mkdir(parents=True, exist_ok=True)

    def photo(self, found: Photo) -> None:
        """`photos/NAME.png`: outlines of what is found, missed and false, with confidences."""
        path = self._photos / f"{found.name}.png"
        path.unlink(missing_ok=True)
        picture = marked(found)
        write_png(path, picture)
        if len(self._pictures) < ON_PAGE:
            row = found.as_dict()
            about = f"{found.name}: {row['hit']} of {row['true']} found, {row['said'] - row['hit']} false."
            self._pictures.append(photo(picture, about))

    def illustrated(self, findings: Findings, found: Found) -> Findings:
        """With plots, which are written as files too, and the marked photos."""
        figures = list(plots(found))
        for name, figure in zip(PLOTS, figures, strict=True):
            assert isinstance(figure.picture, str)
            write_atomic(self._folder / name, figure.picture.encode())
        shown = findings.with_parts({CURVES: figures}, first=False)
        sections = (*shown.sections, Section("The photos", (), tuple(self._pictures)))
        return Findings(
            shown.measure, shown.title, shown.sentences, sections, shown.rows, shown.bars, shown.more
        )


def plots(found: Found) -> Iterator[Figure]:
    """The figures of `PLOTS`."""
    known = {one["iou"]: one["ap"] for one in found.totals["all"]["ap_by_iou"]}
    by_scope = {name: (found.curves[scope], found.totals[scope]["ap50"]) for scope, name in SCOPES.items()}
    by_iou = {f"IoU {iou:.2f}": (found.strict[iou], known[iou]) for iou in DRAWN}
    first, second, third = PLOTS.values()
    for lines, about in ((by_scope, first), (by_iou, second)):

        def precision(axes: Axes, palette: Palette, lines: dict[str, Any] = lines) -> None:
            for (name, (line, ap)), colour in zip(lines.items(), palette.lines, strict=False):
                axes.plot(line.recall, line.precision, color=colour, linewidth=0.5, alpha=0.6)
                label = f"{name}: AP {_share(ap)}"
                axes.step(line.recall, line.falling, color=colour, linewidth=1.4, where="pre", label=label)
            axes.set(xlabel="recall", ylabel="precision", xlim=(0, 1), ylim=(0, 1.02))
            axes.legend(loc="lower left")

        yield plotted(precision, about, 100, 90)
    bins = found.reliability

    def diagram(axes: Axes, palette: Palette) -> None:
        middles = (bins.edges[1:] + bins.edges[:-1]) / 2
        axes.bar(middles, np.nan_to_num(bins.right), 0.9 / BINS, color=palette.blue, alpha=0.4)
        axes.plot(bins.confidence, bins.right, "o", color=palette.orange, markersize=3)
        axes.plot([0, 1], [0, 1], color=palette.soft, linestyle="--", linewidth=0.7)
        for x, count in zip(middles, bins.count.tolist(), strict=True):
            axes.text(x, 1.03, f"{count:,}", ha="center", fontsize=5.5)
        label = f"confidence; expected calibration error {_share(bins.error)}"
        axes.set(xlabel=label, ylabel="share that is right", xlim=(0, 1), ylim=(0, 1.1))

    yield plotted(diagram, third, 100, 90)


SMALLEST, LARGEST = 960, 1920
"""px: limits of the longer side of a marked photo."""
COLOURS = {"found": (86, 190, 255), "missed": (250, 226, 70), "false": (255, 96, 70)}
"""sRGB, after Okabe and Ito's palette."""
WHITE, PAPER_COLOUR = (255, 255, 255), (24, 26, 32)


def marked(found: Photo) -> NDArray[np.uint8]:
    """(H, W, 3) sRGB: the photo, larger where it is small, with outlines and confidences, and a key above."""
    rgb = found.truth.rgb
    longer = max(rgb.shape[:2])
    zoom = float(np.clip(longer, SMALLEST, LARGEST)) / longer
    method = cv2.INTER_CUBIC if zoom > 1 else cv2.INTER_AREA
    picture = np.array(cv2.resize(rgb, None, fx=zoom, fy=zoom, interpolation=method), np.uint8)
    thick = max(1, round(max(picture.shape[:2]) / 420))
    judged, (masks, confidence) = found.judged["all"][0], found.found
    right = judged.right.tolist()
    groups = {
        "found": [mask for mask, hit in zip(masks, right, strict=True) if hit],
        "missed": [found.truth.masks[j] for j in judged.missed],
        "false": [mask for mask, hit in zip(masks, right, strict=True) if not hit],
    }
    for name, some in groups.items():
        for patch in some:
            large = cv2.resize(np.pad(patch.mask, 1).astype(np.float32), None, fx=zoom, fy=zoom)
            rings, _ = cv2.findContours(
                (large > 0.5).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE,
                offset=(round((patch.x - 1) * zoom), round((patch.y - 1) * zoom)),
            )  # fmt: skip
            cv2.drawContours(picture, rings, -1, COLOURS[name], thick, cv2.LINE_AA)
    for patch, value in zip(masks, confidence.tolist(), strict=True):
        if patch.mask.any():
            depth = cv2.distanceTransform(np.pad(patch.mask, 1).astype(np.uint8), cv2.DIST_L2, 5)
            row, column = np.unravel_index(int(depth.argmax()), depth.shape)
            _write(
                picture, f"{value:.2f}", ((patch.x + int(column)) * zoom, (patch.y + int(row)) * zoom), WHITE
            )
    strip = np.full((48, picture.shape[1], 3), PAPER_COLOUR, np.uint8)
    words = [(f"{name} {len(some)}", COLOURS[name]) for name, some in groups.items()]
    for k, (text, colour) in enumerate([*words, ("numbers: confidence", WHITE)]):
        _write(strip, text, ((2 * k + 1) * picture.shape[1] / 8, 24), colour)
    return np.concatenate([strip, picture])


def _write(
    picture: NDArray[np.uint8], text: str, middle: tuple[float, float], colour: tuple[int, ...]
) -> None:
    font, size = cv2.FONT_HERSHEY_SIMPLEX, max(picture.shape[1], 640) / 1600
    (wide, high), _ = cv2.getTextSize(text, font, size, 1)
    at = round(middle[0] - wide / 2), round(middle[1] + high / 2)
    cv2.putText(picture, text, at, font, size, PAPER_COLOUR, 3, cv2.LINE_AA)
    cv2.putText(picture, text, at, font, size, colour, 1, cv2.LINE_AA)
