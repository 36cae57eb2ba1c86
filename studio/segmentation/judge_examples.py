"""Labelled pictures -> candidates with the judge's numbers and how well each fits.

    python studio/segmentation/judge_examples.py -o out/segmentation/judge --jobs 2

One file a picture, `SET/NAME.npz`; what is there is not made again, so a run that was
interrupted goes on. Pictures for training and pictures that only measure lie in folders
of their own, as photo_split.py and flat_shapes.py divide them.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from coco_classes import MOVABLE
from drawn import draw
from flat_shapes import drawings
from labelled_photos import (
    CALTECH_EXCLUDED,
    OPEN_LICENCES,
    _is_movable,
    photo_licences,
    photos_of,
    scene_photos,
)
from labelled_photos import UNJUDGED as UNKNOWN
from numpy.typing import NDArray
from photo_split import SPLIT_SETS

from physgen.maps import read_labels
from physgen.perceive.segment.candidates import find_candidates
from physgen.perceive.segment.detector import detect_boxes
from physgen.perceive.segment.edges import search_edges
from physgen.perceive.segment.evidence import gather_evidence, judge_features
from physgen.perceive.segment.focus import rim_sharpness
from physgen.perceive.segment.network import NetworkMaps, run_network
from physgen.perceive.segment.proposals import Proposal
from physgen.photos import read_image

ROOT = Path(__file__).resolve().parents[2]
UNJUDGED, IMMOVABLE = 65535, 32768
"""In a label map (H, W) uint16: unknown truth, and the first id of immovable wholes."""
MOST = {
    "trashnet-grabcut": 20,
    "caltech101-part": 32,
    "class5": 16,
}
"""Photos of a set at most: plain photos of one object tell little more in number."""
DRAWN, FIRST_SEED, DRAWN_SIDE = 30, 5_000_000, 448
"""Pictures drawn by rule, from seeds that no network has learned from, and their px."""

Labels = NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class Example:
    """One picture of a set with its truth."""

    set_name: str
    name: str
    is_training: bool
    source: Any  # what `read` needs

    def read(self) -> tuple[NDArray[np.uint8], Labels]:
        """Return the picture (H, W, 3) sRGB and its label map (H, W)."""
        return READERS[self.set_name](self.source)


def examples() -> Iterator[Example]:
    """Yield the pictures of all sets in turn, so that a part of them is mixed."""
    waiting = [iter(source) for source in _sources()]
    while waiting:
        for source in list(waiting):
            example = next(source, None)
            if example is None:
                waiting.remove(source)
            else:
                yield example


def _sources() -> list[Iterator[Example]]:
    """Return one iterator for each set and part of it."""

    sources = [_scenes("photos"), _scenes("peer-scenes"), _bundled(), _flat(), _homes()]
    for name in ("coco", *SPLIT_SETS):
        sources.append(_material(name, False))
    for name in ("coco", "coco-minis", "caltech101-part", *SPLIT_SETS):
        sources.append(_material(name, True))
    return [*sources, _drawn()]


def _material(set_name: str, is_training: bool) -> Iterator[Example]:

    is_counted = MOVABLE.__contains__

    photos = list(photos_of(set_name, training=is_training))
    if set_name == "coco" and not is_training:
        photos = [one for one in photos if any(map(is_counted, one.names.values()))]
    if set_name == "coco-minis":
        licences = photo_licences()
        photos = [one for one in photos if licences[one.name] in OPEN_LICENCES]
    most = MOST.get(set_name, len(photos))
    # equally spaced: the names of a set are ordered by class
    steps = np.linspace(0, len(photos) - 1, min(most, len(photos))).round()
    for k in steps.astype(int).tolist():
        yield Example(set_name, photos[k].name, is_training, photos[k])


def _read_material(photo: Any) -> tuple[NDArray[np.uint8], Labels]:

    stored = photo.read_labels().astype(np.uint16)
    labels = np.where(stored == UNKNOWN, np.uint16(UNJUDGED), stored)
    for label, word in photo.names.items():
        if word in CALTECH_EXCLUDED:
            labels[stored == label] = UNJUDGED
        elif not _is_movable(photo.set_name, word):
            labels[stored == label] = IMMOVABLE + label
    return np.ascontiguousarray(photo.read()[..., ::-1]), labels


def _scenes(folder: str) -> Iterator[Example]:
    for one in scene_photos(folder):
        yield Example(folder, one.name, False, (one.path, one.label_path))


def _bundled() -> Iterator[Example]:
    tuned = json.loads((ROOT / "studio/split.json").read_text())["tune"]
    for path in sorted((ROOT / "scenes").glob("*/photo.png")):
        masks = path.parent / "photo.assets/masks.png"
        is_training = path.parent.name in tuned
        yield Example("bundled", path.parent.name, is_training, (path, masks))


def _read_files(paths: tuple[Path, Path]) -> tuple[NDArray[np.uint8], Labels]:
    return read_image(paths[0]), read_labels(paths[1])


def _flat() -> Iterator[Example]:
    for one in drawings():
        picture = (one.rgb, one.labels)
        yield Example("flat", one.name, not one.is_held_out, picture)


def _homes() -> Iterator[Example]:
    folder = ROOT / "studio/segmentation/validation"
    for path in sorted(folder.glob("*.labels.png")):
        name = path.name.removesuffix(".labels.png")
        yield Example("homes", name, True, (path.with_name(f"{name}.jpg"), path))


def _drawn() -> Iterator[Example]:
    for seed in range(FIRST_SEED, FIRST_SEED + DRAWN):
        yield Example("drawn", str(seed), True, seed)


def _read_drawn(seed: int) -> tuple[NDArray[np.uint8], Labels]:

    picture = draw(seed, DRAWN_SIDE)
    labels = np.where(picture.unsaid, np.uint16(UNJUDGED), picture.labels)
    return picture.rgb, labels


READERS = {
    **dict.fromkeys(("photos", "peer-scenes", "bundled", "homes"), _read_files),
    "flat": lambda picture: picture,
    "drawn": _read_drawn,
    **dict.fromkeys(
        ("coco", "coco-minis", "caltech101-part", "trashnet-grabcut", "fruits-nuts", "class5"),
        _read_material,
    ),
}  # fmt: skip


def describe(rgb: NDArray[np.uint8], labels: Labels, seen: NetworkMaps) -> dict:
    """Return the arrays of one picture's file."""
    boxes = detect_boxes(rgb)
    found = find_candidates(rgb, seen, boxes, search_edges(rgb))
    own = found.proposals[: np.count_nonzero(found.edges == 0)]
    alone = judge_features(own, gather_evidence(rgb, seen, boxes))
    size = found.shape[::-1]
    truth = cv2.resize(labels, size, interpolation=cv2.INTER_NEAREST_EXACT)
    ids = [int(i) for i in np.unique(truth) if i not in (0, UNJUDGED)]
    overlap = np.zeros((len(found.proposals), len(ids)), np.float32)
    unjudged = np.zeros(len(found.proposals), np.float32)
    for k, one in enumerate(found.proposals):
        overlap[k], unjudged[k] = _fits(one, truth, ids)
    area = [float((truth == i).mean()) for i in ids]
    return {
        "features": found.features.astype(np.float32),
        "alone": alone.astype(np.float32),  # the same without what edges select
        "edges": found.edges,  # (n,): confidence of what edges select, else 0
        "sharpness": rim_sharpness(rgb, found.proposals, found.shape),  # (n,)
        "overlap": overlap,  # (n, objects): IoU
        "unjudged": unjudged,  # (n,): share of unknown truth
        "is_movable": np.array([i < IMMOVABLE for i in ids], bool),
        "area": np.array(area),  # (objects,): of the picture
        "shape": np.array(found.shape),
        "boxes": np.array([one.box for one in found.proposals], np.int32),
        "masks": np.packbits(np.concatenate([one.mask.ravel() for one in found.proposals] or [np.zeros(0, bool)])),
    }  # fmt: skip


def _fits(one: Proposal, truth: Labels, ids: list[int]) -> tuple[list[float], float]:
    """Return the IoU with each true object, and the share of unjudged pixels."""
    left, top, right, bottom = one.box
    inside = truth[top:bottom, left:right][one.mask]
    judged = np.count_nonzero(inside != UNJUDGED)
    fits = []
    for i in ids:
        shared = np.count_nonzero(inside == i)
        union = judged + np.count_nonzero(truth == i) - shared
        fits.append(shared / max(union, 1))
    return fits, 1 - judged / max(len(inside), 1)


def _maps_of(rgb: NDArray[np.uint8], path: Path) -> NetworkMaps:
    """Return the network's maps of a photo; they are kept in a file of half precision."""
    if path.exists():
        with np.load(path) as stored:
            parts = {name: stored[name].astype(np.float32) for name in stored.files}
        return NetworkMaps(**parts)
    seen = run_network(rgb)
    parts = {name: value.astype(np.float16) for name, value in vars(seen).items()}
    _save(path, parts)
    return seen


def _save(path: Path, parts: dict[str, Any]) -> None:
    """Write a file of arrays; it is there whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(".part")
    with unfinished.open("wb") as file:
        np.savez(file, **parts)
    unfinished.replace(path)


def _make(work: tuple[Example, Path, Path, bool]) -> str:
    """Write one picture's file, or its maps alone."""
    example, path, maps, is_maps_only = work
    cv2.setNumThreads(1)
    rgb, labels = example.read()
    seen = _maps_of(rgb, maps)
    if not is_maps_only:
        _save(path, describe(rgb, labels, seen))
    return f"{example.set_name}/{example.name}"


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--maps", type=Path, default=ROOT / "out/segmentation/maps")
    parser.add_argument(
        "--training-only", action="store_true", help="leave out what only measures"
    )
    parser.add_argument(
        "--maps-only",
        action="store_true",
        help="make what the detector does not change",
    )
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args()
    # a process with threads of OpenCV cannot be forked: its children would wait for ever
    cv2.setNumThreads(1)
    work = []
    for one in examples():
        part = "training" if one.is_training else "held-out"
        name = f"{one.set_name}/{one.name}.npz"
        path = args.output / part / name
        maps = args.maps / name
        if args.training_only and not one.is_training:
            continue
        if not (maps if args.maps_only else path).exists():
            work.append((one, path, maps, args.maps_only))
    with multiprocessing.Pool(args.jobs) as pool:
        for count, name in enumerate(pool.imap_unordered(_make, work), 1):
            if count % 20 == 0:
                print(f"{count} of {len(work)}: {name}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
