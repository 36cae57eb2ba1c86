"""Photos with instance masks as boxes of whole objects, to train and measure with.

`PHYSGEN_MATERIAL` names the folder that contains coco/, photos/, peer-scenes/ and
material/ with the other sets.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from coco import material
from coco_classes import CLASSES, MOVABLE
from numpy.typing import NDArray
from photo_split import is_training

UNJUDGED = 255
"""Label of pixels whose truth is unknown."""
BAND = 3
"""Half the width of the unjudged band around objects of trashnet-grabcut, px."""
OPEN_LICENCES = frozenset({4, 5, 7})
"""Photo licences of COCO that allow changes and commercial use: BY, BY-SA, none."""
CALTECH_CLASSES = {
    "airplanes": "airplane",
    "car_side": "car",
    "cellphone": "cell phone",
    "elephant": "elephant",
    "panda": "bear",
}
"""Classes of Caltech-101 that are classes of COCO."""
CALTECH_MOVABLE = frozenset(
    {
        "airplanes", "anchor", "barrel", "binocular", "bonsai", "camera", "car_side",
        "cellphone",
    }
)  # fmt: skip
"""Things of Caltech-101; the others are animals, and a fan fixed to a ceiling."""
CALTECH_EXCLUDED = frozenset({"brain", "brontosaurus"})
"""Classes of drawings that are neither things nor animals of a photo."""


@dataclass(frozen=True)
class Objects:
    """The labelled objects of one photo."""

    boxes: NDArray[np.float32]
    """(N, 4) left, top, right, bottom, px."""
    is_movable: NDArray[np.bool_]
    """(N,)"""
    classes: NDArray[np.int64]
    """(N,) index of COCO's class, -1 if unknown."""
    areas: NDArray[np.int64]
    """(N,) px of the mask."""


@dataclass(frozen=True)
class LabelledPhoto:
    """One photo with its label map."""

    set_name: str
    name: str
    path: Path
    label_path: Path
    names: dict[int, str]
    """Class name of each label."""

    def read(self) -> NDArray[np.uint8]:
        """Return the photo (H, W, 3) in BGR."""
        return cv2.imread(str(self.path), cv2.IMREAD_COLOR)

    def read_labels(self) -> NDArray[np.uint8]:
        """Return the label map (H, W)."""
        return cv2.imread(str(self.label_path), cv2.IMREAD_UNCHANGED)


def photos_of(set_name: str, training: bool) -> Iterator[LabelledPhoto]:
    """Yield the photos of a set that are for training, or those that are not."""
    folder = material() / "material" / set_name
    images, masks = folder / "images", folder / "masks"
    if set_name == "coco":
        folder = images = masks = material() / "coco"
    stored = json.loads((folder / "labels.json").read_text())
    names = stored.get("labels", stored)
    for name in sorted(names):
        if is_training(set_name, name) != training:
            continue
        labels = {int(label): word for label, word in names[name].items()}
        yield LabelledPhoto(
            set_name, name, images / f"{name}.jpg", masks / f"{name}.png", labels
        )


def photo_licences() -> dict[str, int]:
    """Return the licence id of every photo of coco-minis."""
    path = material() / "material" / "coco-minis" / "photo_licence_ids.json"
    return json.loads(path.read_text())


def scene_photos(folder_name: str) -> Iterator[LabelledPhoto]:
    """Yield the photos of photos/ or peer-scenes/, all of whose objects are movable."""
    for path in sorted((material() / folder_name).glob("*/original.png")):
        name = path.parent.name
        yield LabelledPhoto(folder_name, name, path, path.with_name("mask.png"), {})


def objects_of(photo: LabelledPhoto, labels: NDArray[np.uint8]) -> Objects:
    """Return the boxes and roles of the objects of a label map."""
    boxes, is_movable, classes, areas = [], [], [], []
    for label in np.unique(labels):
        if label in (0, UNJUDGED):
            continue
        name = photo.names.get(int(label), "")
        if photo.set_name == "caltech101-part" and name in CALTECH_EXCLUDED:
            continue
        mask = labels == label
        margin = BAND if photo.set_name == "trashnet-grabcut" else 0
        boxes.append(box_of(mask, margin))
        areas.append(int(mask.sum()))
        is_movable.append(_is_movable(photo.set_name, name))
        classes.append(_class_index(photo.set_name, name))
    return Objects(
        np.array(boxes, np.float32).reshape(-1, 4),
        np.array(is_movable, bool),
        np.array(classes, np.int64),
        np.array(areas, np.int64),
    )


def box_of(mask: NDArray[np.bool_], margin: int = 0) -> tuple[int, int, int, int]:
    """Return left, top, right, bottom of a mask, px, grown by a margin."""
    height, width = mask.shape
    columns = np.flatnonzero(mask.any(axis=0))
    rows = np.flatnonzero(mask.any(axis=1))
    left, right = int(columns[0]) - margin, int(columns[-1]) + 1 + margin
    top, bottom = int(rows[0]) - margin, int(rows[-1]) + 1 + margin
    return max(left, 0), max(top, 0), min(right, width), min(bottom, height)


def _is_movable(set_name: str, name: str) -> bool:
    if set_name in ("coco", "coco-minis"):
        return name in MOVABLE
    if set_name == "caltech101-part":
        return name in CALTECH_MOVABLE
    return True


def _class_index(set_name: str, name: str) -> int:
    if set_name == "caltech101-part":
        name = CALTECH_CLASSES.get(name, name)
    return CLASSES.index(name) if name in CLASSES else -1
