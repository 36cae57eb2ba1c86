"""Colour steps that removed objects leave in the clean background, with true masks.

    python benchmarks/colour_steps.py            # photos/ and the peers' scenes
    python benchmarks/colour_steps.py kitchen    # some of them

The index of an object is the step of colour across its old outline over the step
across a line `FAR` px outside of it. Each step is the distance between the mean
colours of two bands of `BAND` px, averaged over `SECTORS` sectors around the object.
A background without any trace of the object has about 1.

Photos are folders NAME of `$PHYSGEN_MATERIAL/photos` (original.png and mask.png)
and of `$PHYSGEN_PEER_SCENES`.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import read_labels
from physgen.perceive.perceive import perceive
from physgen.perceive.segment.prompts import from_masks
from physgen.photos import read_image

Mask = NDArray[np.bool_]
Levels = NDArray[np.float32]

SECTORS = 36
BAND = 5.0
"""px: width of the bands on both sides of a line."""
FAR = 15.0
"""px from an outline to the line that it is compared with."""
FEWEST = 12
"""px of every band that a sector must have."""
FEWEST_SECTORS = 6
"""Sectors that an object must have to be measured."""
ALLOWED_STEP = 1.15
"""Index from which a step is seen."""
FLOOR = 1.0
"""Levels added to both steps: nobody sees a smaller one."""


def labelled_photos(names: list[str]) -> Iterator[tuple[str, str, Path, Path]]:
    """Yield set, name, picture and label map of each photo; all if no name is given."""
    folders = []
    if peers := os.environ.get("PHYSGEN_PEER_SCENES"):
        folders.append(("peers", Path(peers)))
    if material := os.environ.get("PHYSGEN_MATERIAL"):
        folders.append(("photos", Path(material) / "photos"))
    for group, folder in folders:
        for picture in sorted(folder.glob("*/original.png")):
            mask = picture.with_name("mask.png")
            name = picture.parent.name
            if mask.exists() and (not names or name in names):
                yield group, name, picture, mask


def measure_steps(names: list[str] | None = None) -> list[dict]:
    """Measure the colour steps of every object of the labelled photos, a row each."""
    rows = []
    for group, name, picture, mask in labelled_photos(names or []):
        rgb, labels = read_image(picture), read_labels(mask)
        percepts = perceive(rgb, from_masks(labels)).percepts
        has_clean = percepts.clean is not None
        background = percepts.clean if has_clean else percepts.background
        if background is None:
            continue
        for label in np.unique(labels[labels > 0]):
            steps = colour_steps(background, labels, int(label))
            if steps is None:
                continue
            old, beside = steps
            index = (old + FLOOR) / (beside + FLOOR)
            row = {"set": group, "photo": name, "object": int(label)}
            row |= {"step": round(old, 2), "beside": round(beside, 2)}
            row["index"] = round(index, 2)
            rows.append(row)
            print(json.dumps(row), file=sys.stderr, flush=True)
    return rows


def colour_steps(
    background: NDArray[np.uint8], labels: NDArray[np.uint16], label: int
) -> tuple[float, float] | None:
    """Return the steps across the outline of an object and `FAR` px outside, levels.

    Sectors count that have all four bands in the picture and no other object in them.
    """
    mask = labels == label
    distance = _signed_distance(mask)
    is_clear = (labels == 0) | mask
    rows, columns = np.indices(mask.shape)
    centre = np.argwhere(mask).mean(axis=0)
    angles = np.arctan2(rows - centre[0], columns - centre[1])
    sectors = ((angles + np.pi) / (2 * np.pi) * SECTORS).astype(int) % SECTORS
    picture = background.astype(np.float32)
    edges = (-BAND, 0.0, FAR - BAND, FAR)
    bands = [_band(distance, edge, is_clear) for edge in edges]
    old, beside = [], []
    for sector in range(SECTORS):
        is_sector = sectors == sector
        places = [is_sector & band for band in bands]
        if min(np.count_nonzero(place) for place in places) < FEWEST:
            continue
        inner, outer, near, far = (picture[place].mean(axis=0) for place in places)
        old.append(float(np.linalg.norm(inner - outer)))
        beside.append(float(np.linalg.norm(near - far)))
    if len(old) < FEWEST_SECTORS:
        return None
    return float(np.mean(old)), float(np.mean(beside))


def summarise_steps(rows: list[dict]) -> dict[str, float]:
    """Return the index of each set: all its old steps over all steps beside them."""
    indices = {}
    for group in sorted({row["set"] for row in rows}):
        steps = [(row["step"], row["beside"]) for row in rows if row["set"] == group]
        old, beside = np.mean(steps, axis=0) + FLOOR
        indices[group] = round(float(old / beside), 2)
    return indices


def _signed_distance(mask: Mask) -> Levels:
    """Return px from the outline of `mask`, below 0 inside."""
    inside = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)
    outside = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
    return (outside - inside).astype(np.float32)


def _band(distance: Levels, edge: float, is_clear: Mask) -> Mask:
    """Return the clear places from `edge` px outside the outline, `BAND` px wide."""
    return (distance > edge) & (distance <= edge + BAND) & is_clear


if __name__ == "__main__":
    measured = measure_steps(sys.argv[1:])
    print(json.dumps(summarise_steps(measured)))
