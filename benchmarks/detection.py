"""Recall and average precision of the detector of whole objects, as boxes.

    PHYSGEN_MATERIAL=/data python benchmarks/detection.py                 # shipped file
    PHYSGEN_MATERIAL=/data python benchmarks/detection.py out/trial.onnx -o trial.json

Measured photos: the 60 photos of coco/ that are not COCO train2017, photos/,
peer-scenes/, and the held-out fifth of trashnet-grabcut, fruits-nuts and class5. The
given PicoDet is measured beside it, ranked by the best score of its movable classes and
by the best of all its scores.

A movable object counts if it covers 1 % of a photo of COCO. Smaller ones are neither
missed nor wrong, nor are smaller boxes, as in COCO's own figures by area. A box that is
mostly on unjudged pixels is neither right nor wrong.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "studio/segmentation"))

from boxes import Boxes, BoxFinder, ious  # noqa: E402
from coco import material  # noqa: E402
from labelled_photos import (  # noqa: E402
    UNJUDGED,
    LabelledPhoto,
    objects_of,
    photos_of,
    scene_photos,
)

SHIPPED = ROOT / "physgen/perceive/segment/detector.onnx"
RESULT = ROOT / "benchmarks/results/detection.json"
SMALLEST = 0.01
"""Share of a photo of COCO: the smallest object that counts."""
DOUBTFUL = 0.5
"""Share of unjudged pixels from which a box is neither right nor wrong."""
OVERLAPS = (0.5, 0.75)
"""IoU from which a box is right."""
BUDGETS = (20, 50)
"""Boxes of a photo among which an object must be."""


@dataclass(frozen=True)
class Truth:
    """What one photo contains, for a measurement."""

    boxes: NDArray[np.float32]
    """(N, 4) movable objects that count, px."""
    ignored: NDArray[np.float32]
    """(M, 4) movable objects that do not count, px."""
    classes: NDArray[np.int64]
    """(N,) index of COCO's class of the objects that count, -1 if unknown."""
    labels: NDArray[np.uint8]
    smallest_area: float
    """px of the smallest box that can be wrong."""


@dataclass(frozen=True)
class Scored:
    """Boxes of one photo after matching at one IoU."""

    scores: NDArray[np.float32]
    is_right: NDArray[np.bool_]
    is_ignored: NDArray[np.bool_]
    ranks: NDArray[np.int64]
    """(objects,) place of the box that is right, a large number if there is none."""


def sets() -> dict[str, Callable[[], Iterator[LabelledPhoto]]]:
    """Return the sets that are measured."""
    return {
        "coco": lambda: photos_of("coco", training=False),
        "photos": lambda: scene_photos("photos"),
        "peers": lambda: scene_photos("peer-scenes"),
        "trashnet": lambda: photos_of("trashnet-grabcut", training=False),
        "fruits-nuts": lambda: photos_of("fruits-nuts", training=False),
        "class5": lambda: photos_of("class5", training=False),
    }


def truth_of(photo: LabelledPhoto) -> Truth:
    """Return the objects of a photo that count, and those that do not."""
    labels = photo.read_labels()
    objects = objects_of(photo, labels)
    smallest = SMALLEST * labels.size if photo.set_name == "coco" else 0.0
    is_large = objects.areas >= smallest
    counts = objects.is_movable & is_large
    ignored = objects.is_movable & ~is_large
    return Truth(
        objects.boxes[counts],
        objects.boxes[ignored],
        objects.classes[counts],
        labels,
        smallest,
    )


def unjudged_shares(
    boxes: NDArray[np.float32], labels: NDArray[np.uint8]
) -> NDArray[np.float64]:
    """Return the share of unjudged pixels in each box."""
    shares = np.zeros(len(boxes))
    for k, box in enumerate(boxes):
        left, top, right, bottom = np.round(box).astype(int)
        part = labels[top : bottom + 1, left : right + 1]
        shares[k] = (part == UNJUDGED).mean() if part.size else 1.0
    return shares


def score(found: Boxes, truth: Truth, overlap: float) -> Scored:
    """Match boxes, best first, each with the free object that it overlaps most."""
    count, missing = len(found.boxes), 10**6
    is_right = np.zeros(count, bool)
    ranks = np.full(len(truth.boxes), missing)
    shared = ious(found.boxes, truth.boxes)
    for k in range(count):
        free = np.where(ranks == missing, shared[k], 0.0)
        if len(free) and free.max() >= overlap:
            ranks[int(free.argmax())] = k
            is_right[k] = True
    is_ignored = unjudged_shares(found.boxes, truth.labels) > DOUBTFUL
    sides = found.boxes[:, 2:] - found.boxes[:, :2]
    is_ignored |= sides.prod(axis=1) < truth.smallest_area
    if len(truth.ignored):
        is_ignored |= ious(found.boxes, truth.ignored).max(axis=1) >= overlap
    return Scored(found.scores, is_right, is_ignored & ~is_right, ranks)


def average_precision(photos: list[Scored]) -> float:
    """Return the area below precision over recall, precision made monotonous."""
    objects = sum(len(photo.ranks) for photo in photos)
    scores = np.concatenate([p.scores[~p.is_ignored] for p in photos])
    is_right = np.concatenate([p.is_right[~p.is_ignored] for p in photos])
    is_right = is_right[np.argsort(-scores, kind="stable")]
    precision = is_right.cumsum() / np.arange(1, len(is_right) + 1)
    highest = np.maximum.accumulate(precision[::-1])[::-1]
    return float(highest[is_right].sum() / max(objects, 1))


def class_accuracy(
    found: list[Boxes], photos: list[tuple[NDArray[np.uint8], Truth]]
) -> float | None:
    """Return the share of objects whose best right box has the right class, or None if
    no class is known."""
    is_named: list[bool] = []
    for boxes, (_, truth) in zip(found, photos, strict=True):
        shared = ious(truth.boxes, boxes.boxes) >= OVERLAPS[0]
        for k in np.flatnonzero((truth.classes >= 0) & shared.any(axis=1)):
            best = int(shared[k].argmax())
            is_named.append(boxes.classes[best].argmax() == truth.classes[k])
    return round(float(np.mean(is_named)), 3) if is_named else None


def measure(finder: BoxFinder, photos: list[tuple[NDArray[np.uint8], Truth]]) -> dict:
    """Return recall and average precision on the photos of one set."""
    found = [finder.find(bgr) for bgr, _ in photos]
    row: dict[str, float] = {}
    for overlap in OVERLAPS:
        scored = [
            score(boxes, truth, overlap)
            for boxes, (_, truth) in zip(found, photos, strict=True)
        ]
        ranks = np.concatenate([one.ranks for one in scored])
        for budget in BUDGETS:
            recall = float((ranks < budget).mean())
            row[f"recall_{budget}_{overlap:g}"] = round(recall, 3)
        row[f"ap_{overlap:g}"] = round(average_precision(scored), 3)
    accuracy = class_accuracy(found, photos)
    if accuracy is not None:
        row["class_accuracy"] = accuracy
    return row


def load() -> dict[str, list[tuple[NDArray[np.uint8], Truth]]]:
    """Return all photos that are measured, with what they contain."""
    loaded = {}
    for name, photos in sets().items():
        loaded[name] = [(photo.read(), truth_of(photo)) for photo in photos()]
    return loaded


def table(finders: dict[str, BoxFinder]) -> dict:
    """Return the rows of every detector on every set."""
    loaded = load()
    result: dict[str, dict] = {"objects": {}, "detectors": {}}
    for set_name, photos in loaded.items():
        result["objects"][set_name] = sum(len(truth.boxes) for _, truth in photos)
    for name, finder in finders.items():
        rows = {}
        for set_name, photos in loaded.items():
            rows[set_name] = measure(finder, photos)
        result["detectors"][name] = rows
    return result


def print_table(result: dict) -> None:
    """Print one line for each detector and set."""
    for name, rows in result["detectors"].items():
        for set_name, row in rows.items():
            figures = "  ".join(f"{key} {value:.3f}" for key, value in row.items())
            print(f"{name:18} {set_name:12} {figures}")


def main() -> None:
    """Measure and write the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("detector", type=Path, nargs="*", help="our file, or several")
    parser.add_argument("-o", "--output", type=Path, default=RESULT)
    parser.add_argument("--only-ours", action="store_true")
    args = parser.parse_args()
    finders = {}
    if not args.only_ours:
        given = material() / "material/networks/picodet_s_416_coco.onnx"
        finders["given, movable"] = BoxFinder(given, "movable")
        finders["given, any"] = BoxFinder(given, "any")
    paths = args.detector or [path for path in (SHIPPED,) if path.exists()]
    for path in paths:
        finders["ours" if path == SHIPPED else path.stem] = BoxFinder(path, "movable")
    result = table(finders)
    args.output.write_text(json.dumps(result, indent=1) + "\n")
    print_table(result)


if __name__ == "__main__":
    main()
