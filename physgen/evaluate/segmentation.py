"""Compare detections on photos with true masks, with COCO's matching: counts, average
precision, calibration.

T.-Y. Lin et al., "Microsoft COCO: Common Objects in Context" (2014); pycocotools
matches and counts. Truth comes from label maps beside photos, or from assets of
`perceive`.
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
from physgen.messages import Message
from physgen.perceive.roles import Segment, Segments
from physgen.photos import read_photo
from physgen.problems import Place, Problem, collect
from physgen.text import counted

missing_package: str | None = None
"""Name of a package of the extra `labels` that is not installed."""
try:
    from pycocotools import mask as coco
    from pycocotools.coco import COCO
    from pycocotools.cocoeval import COCOeval
except ModuleNotFoundError as error:
    missing_package = error.name

Mask = NDArray[np.bool_]
Floats = NDArray[np.float64]
Runs = Mapping[str, Any]
"""A mask as COCO's compressed run lengths."""

THRESHOLDS: tuple[float, ...] = tuple(np.linspace(0.5, 0.95, 10).tolist())
"""COCO's thresholds of IoU. Counts use the first."""
BINS = 10
"""Number of bins of confidence."""


# ---- truth

ENDINGS = (".png", ".jpg", ".jpeg", ".webp")
"""Suffixes of photos."""
LABELS = ".labels.png"
"""End of a label map's name beside its photo."""
ASSETS = "photo.assets/masks.png"
"""The label map of a folder with one `photo.*`."""
UNKNOWN_ID = 65535
"""Id of pixels with unknown truth in a 16-bit label map."""
PAIR_FIX = f"put NAME{LABELS} beside each NAME.png, or {ASSETS} beside each photo.png in folders"


def require_pycocotools() -> None:
    """Raise InputError if pycocotools is not installed."""
    if missing_package is not None:
        raise Message.PACKAGES_MISSING.error(
            "evaluate segmentation",
            packages=missing_package,
            verb="is",
            install=install("labels"),
        )


def runs(mask: Mask) -> Runs:
    """Return the run lengths of a mask (H, W)."""
    # COCO's run lengths go down the columns.
    return dict(coco.encode(np.asfortranarray(mask, np.uint8)))


@dataclass(frozen=True)
class Truth:
    """A photo and the true masks."""

    rgb: NDArray[np.uint8]
    """(H, W, 3) sRGB, upright."""
    masks: tuple[Runs, ...]
    unknown_region: Runs
    """Pixels with unknown truth."""


@dataclass(frozen=True)
class Pair:
    """A photo's file and its label map."""

    photo: Path
    truth: Path
    name: str = ""
    """Unique in the folder, and valid as a file name."""

    def read(self) -> Truth:
        """Return photo and masks. Raise InputError for an unreadable file, or for
        different sizes.
        """
        rgb = read_photo(self.photo).rgb
        labels = read_labels(self.truth)
        if labels.shape != rgb.shape[:2]:
            height, width = rgb.shape[:2]
            raise Message.NOT_PHOTO_SIZE.error(
                str(self.truth),
                f"{labels.shape[1]} x {labels.shape[0]} px",
                width=width,
                height=height,
            )
        masks = []
        for object_id in np.unique(labels).tolist():
            if object_id not in (0, UNKNOWN_ID):
                masks.append(runs(labels == object_id))
        return Truth(rgb, tuple(masks), runs(labels == UNKNOWN_ID))

    @property
    def is_alone(self) -> bool:
        """Return whether the photo has a folder of its own."""
        return self.truth == self.photo.parent / ASSETS


def pairs(folder: Path) -> tuple[list[Pair], list[Problem]]:
    """Return pairs by name, with warnings about photos and label maps without a
    partner.

    Raise InputError if there are no pairs.
    """
    if not folder.exists():
        raise Message.NO_SUCH_PATH.error(str(folder))
    if not folder.is_dir():
        raise Message.PHOTOS_NOT_FOLDER.error(str(folder))
    paths = []
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not _is_hidden(path, folder):
            paths.append(path)
    photo_pairs, warnings = _find_pairs(paths)
    if not photo_pairs:
        raise Message.NO_LABELLED_PHOTO.error(str(folder), fix=PAIR_FIX)
    # A label map that belongs to no photo is probably a wrong name.
    photos_by_map = _photos_by_map(photo_pairs)
    for path in paths:
        if path.name.endswith(LABELS) and path not in photos_by_map:
            warnings.append(Message.LABELS_WITHOUT_PHOTO.warning(Place(str(path))))
    named_pairs = [replace(pair, name=_pair_name(pair, folder)) for pair in photo_pairs]
    return sorted(named_pairs, key=lambda pair: pair.name), warnings


def _find_pairs(paths: Sequence[Path]) -> tuple[list[Pair], list[Problem]]:
    """Return the photos with a label map, and a warning for each other photo."""
    photo_pairs = list[Pair]()
    warnings = list[Problem]()
    for path in paths:
        if path.suffix.lower() not in ENDINGS or path.name.endswith(LABELS):
            continue
        truth = path.with_name(path.stem + LABELS)
        # A scene folder has its label map among the assets.
        if not truth.is_file() and path.stem == "photo":
            truth = path.parent / ASSETS
        if truth.is_file():
            photo_pairs.append(Pair(path, truth))
        else:
            warning = Message.PHOTO_WITHOUT_LABELS.warning(
                Place(str(path)), fix=PAIR_FIX
            )
            warnings.append(warning)
    return photo_pairs, warnings


def _photos_by_map(photo_pairs: Sequence[Pair]) -> dict[Path, Path]:
    """Return the photo of each label map. Raise InputError for a map of two photos."""
    photos: dict[Path, Path] = {}
    for pair in photo_pairs:
        photo = photos.setdefault(pair.truth, pair.photo)
        if photo != pair.photo:
            names = f"{photo.name} and {pair.photo.name}"
            raise Message.LABELS_OF_TWO_PHOTOS.error(str(pair.truth), names)
    return photos


def _is_hidden(path: Path, folder: Path) -> bool:
    """Return whether a file is in a hidden folder, or among the maps of a scene."""
    parts = path.relative_to(folder).parts
    return any(part.startswith(".") or part.endswith(".assets") for part in parts)


def _pair_name(pair: Pair, folder: Path) -> str:
    """Return a photo's path in the folder, or the name of its own folder with one
    photo, as a valid file name.
    """
    path = pair.photo.relative_to(folder)
    parts = path.with_suffix("").parts
    # The name `photo` says nothing if each photo has a folder: use the folder's name.
    if pair.is_alone:
        parts = path.parent.parts or (folder.resolve().name,)
    name = re.sub(r"[^\w.-]+", "-", "-".join(parts))
    return name.strip(".-") or "photo"


# ---- matching


@dataclass(frozen=True, eq=False)
class Photo:
    """One photo's true masks, and detections with their confidences (N,)."""

    name: str
    size: tuple[int, int]
    """Width and height, px."""
    true_masks: Sequence[Runs]
    unknown_regions: Sequence[Runs]
    """Regions for neither side: a detection mostly in one is left out."""
    detections: Sequence[Runs]
    confidence: Floats


@dataclass(frozen=True, eq=False)
class PhotoMatches:
    """Matches of one photo at the first threshold, without detections in regions of
    unknown truth.
    """

    confidence: Floats
    """(N,)."""
    overlap: Floats
    """(N,): IoU with the match; 0 without a match."""
    true_count: int
    """Number of true masks."""

    @property
    def is_match(self) -> Mask:
        """Return whether each detection has a match, (N,)."""
        return self.overlap > 0


@dataclass(frozen=True, eq=False)
class Matches:
    """Matches of all photos."""

    photos: tuple[PhotoMatches, ...]
    precision: Floats
    """(thresholds, 101): highest precision at COCO's recalls 0, 0.01 .. 1 or larger
    ones; -1 without true masks.
    """

    @property
    def average_precision(self) -> list[float | None]:
        """Return COCO's AP at each threshold, or None without true masks."""
        return [None if line[0] < 0 else float(line.mean()) for line in self.precision]


Annotation = dict[str, Any]
"""A mask in the form of pycocotools."""


def match(photos: Sequence[Photo]) -> Matches:
    """Match masks in the order of falling confidence. Each gets the free true mask with
    the largest overlap above the threshold.
    """
    true_masks = list[Annotation]()
    detections = list[Annotation]()
    for k, photo in enumerate(photos):
        true_masks += [_annotation(k, mask) for mask in photo.true_masks]
        # COCO ignores detections that are mostly within a crowd region.
        true_masks += [_annotation(k, mask, 1) for mask in photo.unknown_regions]
        scores = photo.confidence.tolist()
        for mask, score in zip(photo.detections, scores, strict=True):
            detections.append({**_annotation(k, mask), "score": score})
    # COCO's own code decides, so that figures can be compared with published ones.
    judge = _run_coco(photos, true_masks, detections)
    photo_matches = []
    for photo, result in zip(photos, judge.evalImgs, strict=True):
        photo_matches.append(_photo_matches(photo, result, true_masks, detections))
    # Axes: threshold, recall, class, area, maximum of detections; the last three have
    # one entry.
    precision = np.asarray(judge.eval["precision"][:, :, 0, 0, 0])
    return Matches(tuple(photo_matches), precision)


def _annotation(image: int, mask: Runs, is_crowd: int = 0) -> Annotation:
    return {"image_id": image, "iscrowd": is_crowd, "segmentation": mask}


def _run_coco(
    photos: Sequence[Photo],
    true_masks: list[Annotation],
    detections: list[Annotation],
) -> Any:
    """Return COCO's evaluation object with its results."""
    # pycocotools prints its progress.
    with contextlib.redirect_stdout(io.StringIO()):
        truth = _dataset(photos, true_masks)
        answers = _dataset(photos, detections)
        judge = COCOeval(truth, answers, "segm")
        judge.params.iouThrs = np.array(THRESHOLDS)
        # COCO limits a photo to 100 detections; here none is dropped.
        judge.params.maxDets = [max(len(detections), 1)]
        judge.params.areaRng, judge.params.areaRngLbl = [[0, 1e10]], ["all"]
        judge.evaluate()
        judge.accumulate()
    return judge


def _photo_matches(
    photo: Photo,
    result: Mapping[str, Any] | None,
    true_masks: Sequence[Annotation],
    detections: Sequence[Annotation],
) -> PhotoMatches:
    """Return the matches in COCO's result of one photo."""
    # The photo has neither true masks nor detections.
    if result is None:
        return PhotoMatches(np.zeros(0), np.zeros(0), 0)
    # Detections within regions of unknown truth are neither right nor wrong.
    is_counted = ~np.asarray(result["dtIgnore"][0], np.bool_)
    ids = np.array(result["dtIds"])[is_counted]
    match_ids = np.asarray(result["dtMatches"][0])[is_counted].astype(int)
    overlaps = []
    for detection_id, match_id in zip(ids.tolist(), match_ids.tolist(), strict=True):
        # A match id of 0 means no match.
        overlap = 0.0
        if match_id:
            detection = detections[detection_id - 1]["segmentation"]
            true_mask = true_masks[match_id - 1]["segmentation"]
            overlap = float(coco.iou([detection], [true_mask], [0])[0, 0])
        overlaps.append(overlap)
    confidence = np.array(result["dtScores"])[is_counted]
    return PhotoMatches(confidence, np.array(overlaps), len(photo.true_masks))


def _dataset(photos: Sequence[Photo], annotations: list[Annotation]) -> Any:
    """Return annotations in the form of pycocotools. Ids count from 1."""
    for k, annotation in enumerate(annotations, 1):
        area = float(coco.area(annotation["segmentation"]))
        annotation.update({"id": k, "category_id": 1, "area": area})
    images = []
    for k, photo in enumerate(photos):
        width, height = photo.size
        images.append({"id": k, "width": width, "height": height})
    dataset = COCO()
    dataset.dataset = {
        "images": images,
        "annotations": annotations,
        "categories": [{"id": 1, "name": "object"}],
    }
    dataset.createIndex()
    return dataset


def counts(photos: Sequence[PhotoMatches]) -> dict[str, Any]:
    """Return pooled figures, or None for an undefined one.

    They are `said` (detections), `true`, `hit`, `precision`, `recall`, `f` (harmonic
    mean of the two) and `iou` (mean over hits).
    """
    detections = sum(len(photo.confidence) for photo in photos)
    true_masks = sum(photo.true_count for photo in photos)
    overlaps = [photo.overlap[photo.is_match] for photo in photos]
    # NumPy cannot join an empty list.
    hit_overlaps = np.concatenate(overlaps or [np.zeros(0)])
    hits = len(hit_overlaps)
    total = detections + true_masks
    return {
        "said": detections,
        "true": true_masks,
        "hit": hits,
        "precision": hits / detections if detections else None,
        "recall": hits / true_masks if true_masks else None,
        "f": 2 * hits / total if total else None,
        "iou": float(hit_overlaps.mean()) if hits else None,
    }


def calibration_error(photos: Sequence[PhotoMatches]) -> float | None:
    """Return the mean distance of confidence from the right share, in bins of equal
    width (Naeini et al. 2015).

    A bin contains its upper edge; the first one also contains 0. Return None without a
    detection.
    """
    confidences = [photo.confidence for photo in photos]
    confidence = np.concatenate(confidences or [np.zeros(0)])
    if not len(confidence):
        return None
    is_match = np.concatenate([photo.is_match for photo in photos])
    bins = np.clip(np.ceil(confidence * BINS) - 1, 0, BINS - 1).astype(int)
    # The difference of sums in a bin is its share right minus its mean confidence,
    # times its count.
    bin_errors = np.abs(np.bincount(bins, is_match - confidence, BINS))
    return float(bin_errors.sum() / len(confidence))


# ---- the measure


def as_photo(name: str, truth: Truth, segments: Segments) -> Photo:
    """Return a segmenter's label map beside the truth, without ids without pixels."""
    labels = segments.labels
    masks, confidence = [], []
    for object_id in np.unique(labels).tolist():
        if 0 < object_id <= len(segments.confidence):
            masks.append(runs(labels == object_id))
            confidence.append(segments.confidence[object_id - 1])
    return Photo(
        name=name,
        size=(labels.shape[1], labels.shape[0]),
        true_masks=truth.masks,
        unknown_regions=(truth.unknown_region,),
        detections=masks,
        confidence=np.array(confidence, np.float64),
    )


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores over all photos."""

    rows: list[dict[str, Any]]
    """One per photo."""
    total: Mapping[str, Any]
    """Counts at 0.5 of all objects together; average precision `ap50`, `ap`, and `ap_by_iou` at COCO's thresholds;
    `error` of confidences."""

    def as_dict(self) -> dict[str, Any]:
        """Return the scores for JSON, beside `rows`."""
        return {"iou": THRESHOLDS[0], "total": self.total}


def evaluate(
    pairs: Sequence[Pair],
    backend: str | Segment | None = None,
    progress: Progress = lambda *_: None,
) -> Scores:
    """Segment every photo with a backend, and judge; the name is optional.

    Raise InputError with every unreadable or unfitting photo and map, before any
    segmentation.
    """
    require_pycocotools()
    segment: Segment
    if callable(backend):
        segment = backend
    else:
        segment = registry.make("segment", backend)

    def check(k: int, pair: Pair) -> None:
        progress("read", k, len(pairs))
        pair.read()

    collect(partial(check, k, pair) for k, pair in enumerate(pairs))
    # Photos are read again one at a time: a large set does not fit into memory.
    photos = []
    for k, pair in enumerate(pairs):
        progress(pair.name, k, len(pairs))
        truth = pair.read()
        photos.append(as_photo(pair.name, truth, segment(truth.rgb)))
    matches = match(photos)
    rows = []
    for photo, photo_matches in zip(photos, matches.photos, strict=True):
        rows.append({"photo": photo.name, **counts([photo_matches])})
    total = {
        **counts(matches.photos),
        **_precisions(matches.average_precision),
        "error": calibration_error(matches.photos),
    }
    return Scores(rows, total)


def _precisions(values: Sequence[float | None]) -> dict[str, Any]:
    """Return the average precisions at each IoU, their mean, and that at IoU 0.5."""
    known_values = []
    for value in values:
        if value is not None:
            known_values.append(value)
    mean = None
    if known_values:
        mean = float(np.mean(known_values))
    by_iou = []
    for iou, value in zip(THRESHOLDS, values, strict=True):
        by_iou.append({"iou": round(iou, 2), "ap": value})
    return {"ap50": values[0], "ap": mean, "ap_by_iou": by_iou}


# ---- report

HEADS = ("photo", "true", "found", "hit", "precision", "recall", "F", "IoU")
PAPER = "The paper: precision 0.93 and recall 0.82 at the same IoU, on 10 photos of its own with 118 objects."


def findings(scores: Scores) -> Findings:
    """Return the scores photo by photo, and of all objects together."""
    total = scores.total
    total_row = {"photo": "all together", **total}
    rows = tuple(map(_cells, (*scores.rows, total_row)))
    heads = ("average precision at IoU", *(f"{iou:.2f}" for iou in THRESHOLDS))
    precisions = (_share(row["ap"]) for row in total["ap_by_iou"])
    iou_table = Table(heads, (("all objects", *precisions),))
    return Findings(
        measure="segmentation",
        title="Are objects found?",
        sentences=(
            f"On {counted(len(scores.rows), 'photo')}, {total['hit']} of {total['true']} objects are found (recall "
            f"{_share(total['recall'])}), and {total['hit']} of {total['said']} detections are right (precision "
            f"{_share(total['precision'])}), at an IoU of {THRESHOLDS[0]:g} or more; mean IoU {_share(total['iou'])}.",
            f"AP50 {_share(total['ap50'])}, AP50:95 {_share(total['ap'])}.",
            f"Expected calibration error {_share(total['error'])}: confidence against the share right.",
            PAPER,
        ),
        sections=(
            Section("Photo by photo", (), (Table(HEADS, rows),)),
            Section("By IoU", (), (iou_table,)),
        ),
        rows=scores.rows,
        extra=scores.as_dict(),
    )


def _share(value: float | None) -> str:
    return number(value, ".3f")


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    numbers = [str(row[key]) for key in ("true", "said", "hit")]
    shares = [_share(row[key]) for key in ("precision", "recall", "f", "iou")]
    return (row["photo"], *numbers, *shares)
