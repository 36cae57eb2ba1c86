"""Objects found on photos against true masks, matched as COCO does: counts, average precision, calibration.

T.-Y. Lin et al., "Microsoft COCO: Common Objects in Context" (2014); pycocotools matches and counts. Truth is read from
label maps beside photos, or in assets as `perceive` writes them.
"""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen import registry
from physgen.evaluate.measure import Findings, Progress, Section, Table, number
from physgen.files import install
from physgen.maps import read_labels
from physgen.perceive.roles import Segment, Segments
from physgen.photos import read_photo
from physgen.problems import InputError, Place, Problem, Severity, collect
from physgen.text import counted

Mask = NDArray[np.bool_]
Floats = NDArray[np.float64]
Runs = Mapping[str, Any]
"""A mask as COCO's compressed run lengths."""

THRESHOLDS: tuple[float, ...] = tuple(np.linspace(0.5, 0.95, 10).tolist())
"""COCO's, of IoU; counts are taken at the first."""
BINS = 10
"""Of confidence."""


# ---- truth -------------------------------------------------------------------------------------------------------

ENDINGS = (".png", ".jpg", ".jpeg", ".webp")
"""Of photos."""
LABELS = ".labels.png"
"""Ends the name of a label map beside its photo."""
ASSETS = "photo.assets/masks.png"
"""The label map of a folder that holds one `photo.*`."""
UNJUDGED = 65535
"""Id in a 16-bit label map where truth is unknown."""
HOW = f"put NAME{LABELS} beside each NAME.png, or {ASSETS} beside each photo.png in folders"


def require_pycocotools() -> None:
    """Raises InputError where it is not installed."""
    try:
        import pycocotools.cocoeval  # noqa: F401
    except ModuleNotFoundError as error:
        found, fix = f"needs {error.name}, which is not installed", install("labels")
        raise InputError.of("evaluate segmentation", "", found, fix) from None


def runs(mask: Mask) -> Runs:
    """Of a mask (H, W)."""
    from pycocotools import mask as coco

    return dict(coco.encode(np.asfortranarray(mask, np.uint8)))


@dataclass(frozen=True)
class Truth:
    """A photo and the true masks."""

    rgb: NDArray[np.uint8]  # (H, W, 3) sRGB, upright
    masks: tuple[Runs, ...]
    unjudged: Runs  # where truth is unknown


@dataclass(frozen=True)
class Pair:
    """A photo's file and its label map."""

    photo: Path
    truth: Path
    name: str = ""
    """Unique in the folder, and fit for a file."""

    def read(self) -> Truth:
        """Raises InputError where one of the files cannot be read, or their sizes differ."""
        rgb, labels = read_photo(self.photo).rgb, read_labels(self.truth)
        if labels.shape != rgb.shape[:2]:
            found = f"{labels.shape[1]} x {labels.shape[0]} px"
            expected = f"differs from the {rgb.shape[1]} x {rgb.shape[0]} px of {self.photo.name}"
            raise InputError.of(
                str(self.truth), found, expected, "make it the photo's size"
            )
        ids = [i for i in np.unique(labels).tolist() if i not in (0, UNJUDGED)]
        return Truth(
            rgb, tuple(runs(labels == i) for i in ids), runs(labels == UNJUDGED)
        )


def pairs(folder: Path) -> tuple[list[Pair], list[Problem]]:
    """By name, with warnings of photos and label maps without a partner. Raises InputError where there is no pair."""
    if not folder.exists():
        raise InputError.of(str(folder), "", "no such folder", "check the path")
    if not folder.is_dir():
        raise InputError.of(
            str(folder), "", "is not a folder", "name the folder that holds the photos"
        )
    found, warnings = list[Pair](), list[Problem]()
    files = [
        path
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not _hidden(path, folder)
    ]
    photos = [
        path
        for path in files
        if path.suffix.lower() in ENDINGS and not path.name.endswith(LABELS)
    ]
    for path in photos:
        beside, assets = path.with_name(path.stem + LABELS), path.parent / ASSETS
        truth = beside if beside.is_file() else assets if path.stem == "photo" else None
        if truth is not None and truth.is_file():
            found.append(Pair(path, truth))
        else:
            expected = "is left out: it has no label map"
            warnings.append(
                Problem(Place(str(path)), "", "", expected, HOW, Severity.WARNING)
            )
    if not found:
        raise InputError.of(str(folder), "", "holds no photo with a label map", HOW)
    matched: dict[Path, Path] = {}
    for one in found:
        other = matched.setdefault(one.truth, one.photo)
        if other != one.photo:
            names = f"{other.name} and {one.photo.name}"
            raise InputError.of(
                str(one.truth), names, "could both be its photo", "keep one of them"
            )
    for path in files:
        if path.name.endswith(LABELS) and path not in matched:
            place = Place(str(path))
            warnings.append(
                Problem(
                    place, "", "", "has no photo", "name both alike", Severity.WARNING
                )
            )
    return _named(found, folder), warnings


def _hidden(path: Path, folder: Path) -> bool:
    """Whether it lies in a hidden folder, or among the maps of a scene."""
    parts = path.relative_to(folder).parts
    return any(part.startswith(".") or part.endswith(".assets") for part in parts)


def _named(found: list[Pair], folder: Path) -> list[Pair]:
    """The pairs by name: a photo's path in the folder, or its own folder's where that holds one photo."""
    named = []
    for pair in found:
        way = pair.photo.relative_to(folder)
        alone = pair.truth == pair.photo.parent / ASSETS
        parts = (
            way.parent.parts or (folder.resolve().name,)
            if alone
            else way.with_suffix("").parts
        )
        named.append(
            replace(
                pair,
                name=re.sub(r"[^\w.-]+", "-", "-".join(parts)).strip(".-") or "photo",
            )
        )
    return sorted(named, key=lambda pair: pair.name)


# ---- matching ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Photo:
    """One photo's true masks, and found ones with their confidences (N,)."""

    name: str
    size: tuple[int, int]  # width and height, px
    true: Sequence[Runs]
    unjudged: Sequence[
        Runs
    ]  # regions that count for neither side: what is found mostly there is left out
    found: Sequence[Runs]
    confidence: Floats


@dataclass(frozen=True, eq=False)
class Judged:
    """Matches of one photo at the first threshold, without what is found where truth is unknown."""

    confidence: Floats  # (N,)
    overlap: Floats  # (N,): IoU with the match; 0 without
    true: int  # number of true masks

    @property
    def right(self) -> Mask:
        """(N,): whether it has a match."""
        return self.overlap > 0


@dataclass(frozen=True, eq=False)
class Matched:
    """All photos."""

    photos: tuple[Judged, ...]
    precision: Floats
    """(thresholds, 101): the highest precision at COCO's recalls 0, 0.01 .. 1 or larger ones; -1: nothing is true."""

    @property
    def average_precision(self) -> list[float | None]:
        """COCO's AP at each threshold; None where nothing is true."""
        return [None if line[0] < 0 else float(line.mean()) for line in self.precision]


def match(photos: Sequence[Photo]) -> Matched:
    """Masks by falling confidence, each with the free true mask of largest overlap, a threshold or more."""
    from pycocotools import mask as coco
    from pycocotools.cocoeval import COCOeval

    true, found = list[dict[str, Any]](), list[dict[str, Any]]()
    for k, photo in enumerate(photos):
        for crowd, some in ((0, photo.true), (1, photo.unjudged)):
            true += [
                {"image_id": k, "iscrowd": crowd, "segmentation": one} for one in some
            ]
        for one, sure in zip(photo.found, photo.confidence.tolist(), strict=True):
            found.append(
                {"image_id": k, "iscrowd": 0, "segmentation": one, "score": sure}
            )
    with contextlib.redirect_stdout(io.StringIO()):
        judge = COCOeval(_dataset(photos, true), _dataset(photos, found), "segm")
        judge.params.iouThrs = np.array(THRESHOLDS)
        judge.params.maxDets = [max(len(found), 1)]
        judge.params.areaRng, judge.params.areaRngLbl = [[0, 1e10]], ["all"]
        judge.evaluate()
        judge.accumulate()
    judged = []
    for photo, one in zip(photos, judge.evalImgs, strict=True):
        if one is None:  # neither true nor found
            judged.append(Judged(np.zeros(0), np.zeros(0), 0))
            continue
        kept = ~np.asarray(one["dtIgnore"][0], np.bool_)
        ids, matches = (
            np.array(one["dtIds"])[kept],
            np.asarray(one["dtMatches"][0])[kept].astype(int),
        )
        overlap = [
            float(
                coco.iou(
                    [found[i - 1]["segmentation"]], [true[j - 1]["segmentation"]], [0]
                )[0, 0]
            )
            if j
            else 0.0
            for i, j in zip(ids.tolist(), matches.tolist(), strict=True)
        ]
        judged.append(
            Judged(np.array(one["dtScores"])[kept], np.array(overlap), len(photo.true))
        )
    return Matched(tuple(judged), np.asarray(judge.eval["precision"][:, :, 0, 0, 0]))


def _dataset(photos: Sequence[Photo], annotations: list[dict[str, Any]]) -> Any:
    """As pycocotools holds it; ids count from 1."""
    from pycocotools import mask as coco
    from pycocotools.coco import COCO

    for k, one in enumerate(annotations, 1):
        one |= {
            "id": k,
            "category_id": 1,
            "area": float(coco.area(one["segmentation"])),
        }
    images = [
        {"id": k, "width": photo.size[0], "height": photo.size[1]}
        for k, photo in enumerate(photos)
    ]
    dataset = COCO()
    dataset.dataset = {
        "images": images,
        "annotations": annotations,
        "categories": [{"id": 1, "name": "object"}],
    }
    dataset.createIndex()
    return dataset


def counts(photos: Sequence[Judged]) -> dict[str, Any]:
    """Pooled: `said` (found), `true`, `hit`, `precision`, `recall`, `f` (harmonic mean of the two), `iou` (mean over
    hits).

    None where a value has no meaning.
    """
    found, true = (
        sum(len(one.confidence) for one in photos),
        sum(one.true for one in photos),
    )
    reached = np.concatenate(
        [one.overlap[one.right] for one in photos] or [np.zeros(0)]
    )
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


def calibration_error(photos: Sequence[Judged]) -> float | None:
    """Mean distance of confidence from the share that is right, in bins of equal width (Naeini et al. 2015).

    A bin holds its upper edge, the first one 0 as well. None where nothing is found.
    """
    confidence = np.concatenate([one.confidence for one in photos] or [np.zeros(0)])
    if not len(confidence):
        return None
    right = np.concatenate([one.right for one in photos])
    bins = np.clip(np.ceil(confidence * BINS) - 1, 0, BINS - 1).astype(int)
    return float(
        np.abs(np.bincount(bins, right - confidence, BINS)).sum() / len(confidence)
    )


# ---- the measure -------------------------------------------------------------------------------------------------


def as_photo(name: str, truth: Truth, segments: Segments) -> Photo:
    """A segmenter's label map beside the truth; ids without pixels are left out."""
    labels = segments.labels
    ids = [i for i in np.unique(labels).tolist() if 0 < i <= len(segments.confidence)]
    confidence = np.array([segments.confidence[i - 1] for i in ids], np.float64)
    size = labels.shape[1], labels.shape[0]
    return Photo(
        name,
        size,
        truth.masks,
        (truth.unjudged,),
        [runs(labels == i) for i in ids],
        confidence,
    )


@dataclass(frozen=True, eq=False)
class Found:
    """Over all photos."""

    rows: list[dict[str, Any]]  # one a photo
    total: Mapping[str, Any]
    """Counts at 0.5 of all objects together; average precision `ap50`, `ap`, and `ap_by_iou` at COCO's thresholds;
    `error` of confidences."""

    def as_dict(self) -> dict[str, Any]:
        """As JSON, beside `rows`."""
        return {"iou": THRESHOLDS[0], "total": self.total}


def evaluate(
    pairs: Sequence[Pair],
    backend: str | Segment | None = None,
    progress: Progress = lambda *_: None,
) -> Found:
    """Segment every photo by a backend, its name or the default, and judge.

    Raises InputError with every photo and map that cannot be read or does not fit, before anything is segmented.
    """
    require_pycocotools()
    segment: Segment = (
        backend if callable(backend) else registry.make("segment", backend)
    )

    def check(k: int, pair: Pair) -> None:
        progress("read", k, len(pairs))
        pair.read()

    collect(partial(check, k, pair) for k, pair in enumerate(pairs))
    photos = []
    for k, pair in enumerate(pairs):
        progress(pair.name, k, len(pairs))
        truth = pair.read()
        photos.append(as_photo(pair.name, truth, segment(truth.rgb)))
    matched = match(photos)
    rows = [
        {"photo": photo.name, **counts([one])}
        for photo, one in zip(photos, matched.photos, strict=True)
    ]
    ap = matched.average_precision
    known = [value for value in ap if value is not None]
    total = {
        **counts(matched.photos),
        "ap50": ap[0],
        "ap": float(np.mean(known)) if known else None,
        "ap_by_iou": [
            {"iou": round(iou, 2), "ap": value}
            for iou, value in zip(THRESHOLDS, ap, strict=True)
        ],
        "error": calibration_error(matched.photos),
    }
    return Found(rows, total)


# ---- report ------------------------------------------------------------------------------------------------------

HEADS = ("photo", "true", "found", "hit", "precision", "recall", "F", "IoU")
PAPER = "The paper: precision 0.93 and recall 0.82 at the same IoU, on 10 photos of its own with 118 objects."


def findings(found: Found) -> Findings:
    total = found.total
    rows = tuple(
        _cells(row) for row in (*found.rows, {"photo": "all together", **total})
    )
    heads = ("average precision at IoU", *(f"{iou:.2f}" for iou in THRESHOLDS))
    by_iou = ("all objects", *(_share(one["ap"]) for one in total["ap_by_iou"]))
    sections = (
        Section("Photo by photo", (), (Table(HEADS, rows),)),
        Section("By IoU", (), (Table(heads, (by_iou,)),)),
    )
    sentences = (
        f"On {counted(len(found.rows), 'photo')}, {total['hit']} of {total['true']} objects are found (recall "
        f"{_share(total['recall'])}), and {total['hit']} of {total['said']} detections are right (precision "
        f"{_share(total['precision'])}), at an IoU of {THRESHOLDS[0]:g} or more; mean IoU {_share(total['iou'])}.",
        f"AP50 {_share(total['ap50'])}, AP50:95 {_share(total['ap'])}.",
        f"Expected calibration error {_share(total['error'])}: confidence against the share right.",
        PAPER,
    )
    title = "Are objects found?"
    return Findings(
        "segmentation", title, sentences, sections, found.rows, more=found.as_dict()
    )


def _share(value: float | None) -> str:
    return number(value, ".3f")


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    numbers = (str(row[key]) for key in ("true", "said", "hit"))
    return (
        row["photo"],
        *numbers,
        *(_share(row[key]) for key in ("precision", "recall", "f", "iou")),
    )
