"""Boxes and points drawn for every true object -> how well `perceive --box` and `--point` cut the objects out.

With PHYSGEN_MATERIAL, a part of coco-minis is measured too: photos whose licence forbids
changes or commercial use, so that the head that cuts out learned from none of them.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from segments import LEAST as LEAST_SHARE
from segments import ROOT, UNJUDGED
from segments import photos as sets

from physgen.maps import read_labels
from physgen.perceive.segment.prompts import segment_box, segment_point
from physgen.photos import read_image
from physgen.problems import InputError

SLACK = 0.1
"""Of the box's size: how far each side is moved outwards, or by chance out or in."""
DRAWS = 2
BAR = 0.85
LEAST = 64
"""px: smaller objects are not asked for."""


EVERY = 4
"""One in so many photos of coco-minis is measured, in the order of their names."""
MOST = 4
"""Objects of such a photo, at most."""


def photos(folder: Path) -> Iterator[tuple[str, str, np.ndarray, np.ndarray]]:
    """Name, set, rgb (H, W, 3), labels (H, W) of all photos but the rendered homes; of COCO's, objects that count."""
    if "PHYSGEN_MATERIAL" in os.environ:
        yield from islice(_closed_photos(), 0, None, EVERY)
    for name, some in sets(folder).items():
        for pair in some if name != "homes" else ():
            labels = read_labels(pair.truth)
            labels[labels == UNJUDGED] = 0
            yield pair.name, name, read_image(pair.photo), labels


def _closed_photos() -> Iterator[tuple[str, str, np.ndarray, np.ndarray]]:
    """Yield the photos of coco-minis that no licence allows to learn from."""
    sys.path.append(str(ROOT / "studio/segmentation"))
    from labelled_photos import (  # type: ignore[import-not-found]
        OPEN_LICENCES,
        _is_movable,
        photo_licences,
        photos_of,
    )

    licences = photo_licences()
    for one in photos_of("coco-minis", training=True):
        if licences[one.name] in OPEN_LICENCES:
            continue
        stored = one.read_labels()
        ids = [i for i, word in one.names.items() if _is_movable("coco-minis", word)]
        labels = np.zeros(stored.shape, np.uint16)
        for i in ids[:MOST]:
            if np.count_nonzero(stored == i) >= LEAST_SHARE * stored.size:
                labels[stored == i] = i
        yield (
            one.name,
            "coco-minis",
            np.ascontiguousarray(one.read()[..., ::-1]),
            labels,
        )


def asked(
    labels: np.ndarray, seed: int
) -> Iterator[tuple[np.ndarray, dict[str, list[tuple[float, ...]]]]]:
    """The mask of each object, and by kind the boxes (x, y, w, h px) and the point that stand for it."""
    rng = np.random.default_rng(seed)
    for i in np.unique(labels[labels > 0]).tolist():
        mask = labels == i
        moves = rng.uniform(-SLACK, SLACK, (DRAWS, 4))
        if mask.sum() < LEAST:
            continue
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        left, top, right, bottom = columns[0], rows[0], columns[-1] + 1, rows[-1] + 1
        width, height = right - left, bottom - top

        def box(
            a: float, b: float, c: float, d: float, at=(left, top, width, height)
        ) -> tuple[float, ...]:
            x, y, w, h = at
            return x - a * w, y - b * h, w * (1 + a + c), h * (1 + b + d)

        inside = cv2.distanceTransform(
            np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5
        )[1:-1, 1:-1]
        row, column = np.unravel_index(int(inside.argmax()), inside.shape)
        yield (
            mask,
            {
                "box": [box(*[SLACK] * 4)],
                "jitter": [box(*move) for move in moves.tolist()],
                "point": [(float(column), float(row))],
            },
        )


def overlap(found: np.ndarray | None, mask: np.ndarray) -> float:
    return 0.0 if found is None else float((found & mask).sum() / (found | mask).sum())


def measure(name: str, half: str, rgb: np.ndarray, labels: np.ndarray) -> dict:
    """Mean and least IoU, and the share that reaches the bar, by kind; wall ms a box."""
    from physgen import registry

    segments = registry.make("segment")(rgb)
    ways: dict[str, Callable] = {
        "box": lambda box: segment_box(rgb, box),
        "jitter": lambda box: segment_box(rgb, box),
        "point": lambda point: segment_point(rgb, point, segments),
    }
    found: dict[str, list[float]] = {kind: [] for kind in ways}
    took = []
    for mask, prompts in asked(labels, seed=0):
        for kind, places in prompts.items():
            for place in places:
                before = time.perf_counter()
                try:
                    cut = ways[kind](place).mask
                except InputError:
                    cut = None
                if kind == "box":
                    took.append(time.perf_counter() - before)
                found[kind].append(overlap(cut, mask))
    if not found["box"]:
        return {}
    row = {"photo": name, "half": half, "objects": len(found["box"])}
    for kind, values in found.items():
        row |= {
            kind: round(float(np.mean(values)), 3),
            f"{kind}_least": round(min(values), 3),
            f"{kind}_good": round(float(np.mean(np.array(values) >= BAR)), 3),
        }
    return row | {"ms": round(1000 * float(np.median(took)))}


def prompts(folder: Path) -> list[dict]:
    return [row for photo in photos(folder) if (row := measure(*photo))]
