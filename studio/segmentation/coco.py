"""The labelled photos of `PHYSGEN_MATERIAL`/coco as pictures: `python studio/segmentation/coco.py -o FOLDER` fills a store for training."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from coco_classes import CLASSES, MOVABLE
from numpy.typing import NDArray
from photos import validation_ids
from store import IMMOVABLE, MOST, UNSAID, Store

FIXED = frozenset(CLASSES) - MOVABLE
"""Classes that are wholes, but nothing that physgen moves."""
VIEWS = 8
"""Of each photo: the whole, squeezed, and square parts of it."""
LEAST = 0.5
"""Of the shorter side: the smallest part."""


def material() -> Path:
    """The folder that PHYSGEN_MATERIAL names."""
    if "PHYSGEN_MATERIAL" not in os.environ:
        raise SystemExit(
            "PHYSGEN_MATERIAL is not set; name the folder that contains coco/, "
            "material/ and models3d/"
        )
    return Path(os.environ["PHYSGEN_MATERIAL"])


def photos(
    validation: bool,
) -> Iterator[tuple[str, NDArray[np.uint8], NDArray[np.uint8]]]:
    """ID, photo (H, W, 3) sRGB and labels (H, W) of every photo of one part, in the store's coding: movable objects
    from 1, immovable wholes from IMMOVABLE, UNSAID."""
    folder = material() / "coco"
    names = json.loads((folder / "labels.json").read_text())
    kept = validation_ids(material())
    for name in sorted(names, key=int):
        if (name in kept) == validation:
            rgb = cv2.imread(str(folder / f"{name}.jpg"))[..., ::-1]
            stored = cv2.imread(str(folder / f"{name}.png"), cv2.IMREAD_UNCHANGED)
            yield name, rgb, coded(stored, names[name])


def coded(stored: NDArray[np.uint8], classes: dict[str, str]) -> NDArray[np.uint8]:
    """The photo's own labels in the store's coding."""
    code = np.zeros(256, np.uint8)
    code[255] = UNSAID
    free, fixed = 1, IMMOVABLE
    for label, name in classes.items():
        if name in FIXED:
            code[int(label)], fixed = min(fixed, UNSAID - 1), fixed + 1
        else:
            code[int(label)], free = min(free, MOST), free + 1
    return code[stored]


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True)
    args = parser.parse_args()
    some = list(photos(validation=False))
    store, rng = Store.at(args.output, VIEWS * len(some)), np.random.default_rng(0)
    for k, (_, rgb, labels) in enumerate(some):
        height, width = labels.shape
        for view in range(VIEWS):
            box = np.s_[:, :]
            if view:
                side = int(min(height, width) * rng.uniform(LEAST, 1))
                y, x = (
                    int(rng.integers(height - side + 1)),
                    int(rng.integers(width - side + 1)),
                )
                box = np.s_[y : y + side, x : x + side]
            store.put_maps(
                VIEWS * k + view,
                np.ascontiguousarray(rgb[box]),
                np.ascontiguousarray(labels[box]),
            )


if __name__ == "__main__":
    main()
