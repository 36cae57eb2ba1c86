"""Objects that `perceive` writes under `objects:` -> precision, recall and calibration.

Doubtful regions do not count. No photo is one that the networks or the judge learned
from; `studio/segmentation/photo_split.py` holds the split.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from itertools import islice, pairwise
from pathlib import Path
from time import process_time
from unittest.mock import patch

import cv2
import numpy as np
from numpy.typing import NDArray
from segments import ROOT, rounded

from physgen import registry
from physgen.evaluate.segmentation import (
    Pair,
    Photo,
    PhotoMatches,
    as_photo,
    calibration_error,
    counts,
    match,
)
from physgen.perceive.backends import segment_learned
from physgen.perceive.backends.segment_learned import Rules, choose_objects
from physgen.perceive.photo_objects import fit_objects
from physgen.perceive.roles import Detections, PromptedMask, Rgb, Segments
from physgen.perceive.segment import edges
from physgen.perceive.segment.candidates import Candidates, find_candidates
from physgen.perceive.segment.detector import DetectedBoxes
from physgen.perceive.segment.evidence import BOX_FEATURES, FEATURES
from physgen.perceive.segment.judge import (
    JudgedCandidates,
    judge_photo,
    shipped_judge,
)
from physgen.perceive.segment.network import mask_in_box, run_network

sys.path.append(str(ROOT / "studio/segmentation"))

LEAST_AREA = 0.01
"""Of the photo: the smallest object of COCO that counts."""
UNJUDGED = 65535
"""Id in a label map where truth is unknown."""
HELD_OUT_SETS = ("fruits-nuts", "class5", "trashnet-grabcut")
MOST_PHOTOS = 60
"""Of a held-out part: plain photos of one object each tell no more in greater number."""
REAL_SETS = ("coco", "photos", "peers", *HELD_OUT_SETS)
"""Their confidences are counted together."""
CONFIDENCES = (0.4, 0.55, 0.7, 0.85, 1.0)
"""Borders of the bins of the reliability table."""
RESULT = "objects.json"
WITHOUT_RULES = {
    "the rule of wholes": Rules(wholes=False),
    "the rule of gaps": Rules(gaps=False),
    "the rule of people's parts": Rules(living=False),
    "the rule of focus": Rules(focus=False),
}
"""Rules of the choice with one of them taken away, by its name in the table."""

Labels = NDArray[np.uint16]


def photo_sets(folder: Path) -> dict[str, list[Pair]]:
    """Return the photos of each set that is there; label maps are written to `folder`.

    `coco`, `photos` and the held-out fifths need PHYSGEN_MATERIAL, `peers` need
    PHYSGEN_PEER_SCENES.
    """
    split = json.loads((ROOT / "studio/split.json").read_text())
    sets = {half: [_bundled(name) for name in split[half]] for half in ("tune", "test")}
    sets["drawings"] = list(_drawings(folder))
    if peers := os.environ.get("PHYSGEN_PEER_SCENES"):
        sets["peers"] = list(_folders(Path(peers)))
    if "PHYSGEN_MATERIAL" in os.environ:
        material = Path(os.environ["PHYSGEN_MATERIAL"])
        sets["photos"] = list(_folders(material / "photos"))
        sets["coco"] = list(_labelled("coco", folder))
        for name in HELD_OUT_SETS:
            sets[name] = list(islice(_labelled(name, folder), MOST_PHOTOS))
    return sets


def _bundled(name: str) -> Pair:
    """Return a photo of the studio that the project ships."""
    folder = ROOT / "scenes" / name
    return Pair(folder / "photo.png", folder / "photo.assets/masks.png", name=name)


def _folders(folder: Path) -> Iterator[Pair]:
    """Yield the photos that lie beside their masks, each in a folder of its own."""
    for photo in sorted(folder.glob("*/original.png")):
        name = photo.parent.name
        yield Pair(photo, photo.with_name("mask.png"), name=name)


def _drawings(folder: Path) -> Iterator[Pair]:
    """Yield the held-out drawings of flat shapes, written to `folder`."""
    from flat_shapes import drawings  # type: ignore[import-not-found]

    for one in drawings():
        if one.is_held_out:
            yield _written(folder, one.name, one.rgb, one.labels)


def _labelled(set_name: str, folder: Path) -> Iterator[Pair]:
    """Yield the held-out photos of a set in which an object counts.

    People, animals and furniture are background: to find one is wrong.
    """
    from labelled_photos import UNJUDGED as UNKNOWN
    from labelled_photos import _is_movable as is_movable
    from labelled_photos import photos_of

    least = LEAST_AREA if set_name == "coco" else 0.0
    for one in photos_of(set_name, training=False):
        stored = one.read_labels()
        labels = np.where(stored == UNKNOWN, UNJUDGED, 0).astype(np.uint16)
        for label, word in one.names.items():
            if is_movable(set_name, word):
                mask = stored == label
                is_small = np.count_nonzero(mask) < least * stored.size
                labels[mask] = UNJUDGED if is_small else label
        if ((labels > 0) & (labels < UNJUDGED)).any():
            yield _written(
                folder, f"{set_name}-{one.name}", one.read()[..., ::-1], labels
            )


def _written(folder: Path, name: str, rgb: Rgb, labels: Labels) -> Pair:
    """Write a photo and its label map."""
    photo, truth = folder / f"{name}.png", folder / f"{name}.labels.png"
    cv2.imwrite(str(photo), rgb[..., ::-1])
    cv2.imwrite(str(truth), labels)
    return Pair(photo, truth, name=name)


def scene_objects(rgb: Rgb, segments: Segments) -> Segments:
    """Return the segments that `perceive` would write under `objects:`."""
    confidence = dict(enumerate(segments.confidence.tolist(), 1))
    found = Detections(segments.labels, "learned", confidence, {})
    kept = [item.id for item in fit_objects(rgb, found)[0]]
    labels = np.where(np.isin(segments.labels, kept), segments.labels, 0)
    return Segments(labels.astype(np.uint16), segments.confidence)


def objects(folder: Path) -> list[dict]:
    """Return a row for each photo and each set (`photo` is ""), and reliability rows.

    Rows of sets that are not there stay as they were.
    """
    rows: list[dict] = []
    without: list[dict] = []
    real: list[PhotoMatches] = []
    sets = photo_sets(folder)
    for name, some in sets.items():
        photos, ablated, cpu = _measure(some)
        judged = match(photos).photos
        without += _rows_without(name, ablated)
        rows += [
            {"set": name, "photo": photo.name, **counts([one])}
            for photo, one in zip(photos, judged, strict=True)
        ]
        error = calibration_error(judged)
        total = {"photos": len(some), **counts(judged), "error": error, "cpu": cpu}
        rows.append({"set": name, "photo": "", **total})
        if name in REAL_SETS:
            real += judged
    if absent := [name for name in REAL_SETS if name not in sets]:
        return rounded(rows + _former_rows({*absent, "reliability"}) + without)
    return rounded(rows + _reliability(real) + without)


def _measure(pairs: list[Pair]) -> tuple[list[Photo], dict[str, list[Photo]], float]:
    """Return photos with their objects, the same without parts, and CPU s a photo."""
    find = registry.make("segment", "learned")
    photos: list[Photo] = []
    ablated: dict[str, list[Photo]] = {}
    cpu = 0.0
    for pair in pairs:
        truth = pair.read()
        before = process_time()
        segments = find(truth.rgb)
        cpu += (process_time() - before) / len(pairs)
        shown = scene_objects(truth.rgb, segments)
        photos.append(as_photo(pair.name, truth, shown))
        for part, other in segments_without(truth.rgb):
            shown = scene_objects(truth.rgb, other)
            ablated.setdefault(part, []).append(as_photo(pair.name, truth, shown))
    return photos, ablated, cpu


def _rows_without(set_name: str, ablated: dict[str, list[Photo]]) -> list[dict]:
    """Return a row for each part taken away."""
    rows = []
    for part, photos in ablated.items():
        total = counts(match(photos).photos)
        rows.append({"set": set_name, "photo": "", "without": part, **total})
    return rows


def segments_without(rgb: Rgb) -> Iterator[tuple[str, Segments]]:
    """Yield the objects of a photo with one part taken away, and the part's name.

    What does not change comes from the last call of the segmenter. The judge is the
    same: it has not learned without the part.
    """

    @cache
    def cut_out(corners: tuple[float, ...]) -> PromptedMask:
        return mask_in_box(rgb, corners)

    def cut_out_again(_: Rgb, corners: Sequence[float]) -> PromptedMask:
        return cut_out(tuple(corners))

    judged = judge_photo(rgb)
    with patch.object(segment_learned, "mask_in_box", cut_out_again):
        for part, rules in WITHOUT_RULES.items():
            yield part, choose_objects(rgb, judged, rules)
        for part, other in _judged_without(rgb, judged):
            yield part, choose_objects(rgb, other)


def _judged_without(
    rgb: Rgb, judged: JudgedCandidates
) -> Iterator[tuple[str, JudgedCandidates]]:
    """Yield the judged candidates of a photo with one of their sources taken away."""
    seen, boxes = run_network(rgb), judged.boxes
    features = judged.candidates.features.copy()
    features[:, FEATURES.index(BOX_FEATURES[0]) :] = 0
    yield (
        "the judge's numbers of boxes",
        _judge(replace(judged.candidates, features=features), boxes),
    )
    without_edges = find_candidates(rgb, seen, boxes)
    yield "candidates of edges and circles", _judge(without_edges, boxes)
    with patch.object(edges, "discs", return_value=[]):
        without_circles = find_candidates(rgb, seen, boxes, edges.search_edges(rgb))
    yield "circles", _judge(without_circles, boxes)
    none = DetectedBoxes(boxes.corners[:0], boxes.scores[:0])
    without_boxes = find_candidates(rgb, seen, none, edges.search_edges(rgb))
    yield "the detector", _judge(without_boxes, none)


def _judge(found: Candidates, boxes: DetectedBoxes) -> JudgedCandidates:
    """Return candidates with the fit that the shipped judge expects."""
    fit = shipped_judge().expected_fit(found.proposals, found.features)
    return JudgedCandidates(found, fit, boxes)


def _former_rows(sets: set[str]) -> list[dict]:
    """Return the rows of some sets from the last run."""
    text = (ROOT / "benchmarks/results" / RESULT).read_text()
    return [row for row in json.loads(text)["rows"] if row["set"] in sets]


def _reliability(judged: list[PhotoMatches]) -> list[dict]:
    """Return the share of objects that are right, by the confidence stated."""
    stated = np.concatenate([one.confidence for one in judged] or [np.zeros(0)])
    right = np.concatenate([one.is_match for one in judged] or [np.zeros(0, bool)])
    rows = []
    for low, high in pairwise(CONFIDENCES):
        inside = (stated >= low) & ((stated < high) | (high == CONFIDENCES[-1]))
        row = {"set": "reliability", "photo": None, "from": low, "to": high}
        row["found"] = int(inside.sum())
        if row["found"]:
            row["stated"] = float(stated[inside].mean())
            row["right"] = float(right[inside].mean())
        rows.append(row)
    error = calibration_error(judged)
    rows.append({"set": "reliability", "photo": "", "error": error})
    return rows
