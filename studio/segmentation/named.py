"""Labelled objects of the photos in `PHYSGEN_MATERIAL`/coco, and how rightly they are named; no torch.

The network's own file is made by names.py.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from coco import material
from numpy.typing import NDArray
from photos import validation_ids

from physgen.perceive.backends import label_imagenet as naming
from physgen.perceive.segment.detector import DetectedBoxes, detect_boxes

ACCEPTED = {
    "cup": "cup, mug, plastic cup, metal cup, drinking glass, beer glass",
    "bottle": "bottle, beer bottle, plastic bottle, wine bottle, steel bottle, shampoo bottle, medicine bottle, "
    "soap bottle, baby bottle, perfume bottle",
    "bowl": "bowl, glass bowl",
    "sports ball": "ball, baseball, basketball, golf ball, rugby ball, soccer ball, "
    "tennis ball, volleyball",
    "truck": "truck, toy truck", "tennis racket": "racket", "knife": "knife, kitchen knife",
    "spoon": "spoon, wooden spoon, ladle", "cell phone": "phone", "mouse": "computer mouse",
    "remote": "remote control", "tv": "tv, monitor", "stop sign": "street sign", "dining table": "table, desk",
    "baseball glove": "glove", "hair drier": "hair dryer",
}  # fmt: skip
"""Labels that name a class of COCO rightly, where they differ from its name; what is learned is the first."""
KNOWN = frozenset(
    {
        "airplane", "apple", "backpack", "banana", "bear", "bed", "bench", "bicycle", "bird", "boat", "book", "bottle",
        "bowl", "broccoli", "bus", "car", "cat", "cell phone", "chair", "clock", "couch", "cow", "cup", "dining table",
        "dog", "elephant", "handbag", "horse", "hot dog", "keyboard", "laptop", "microwave", "motorcycle", "mouse",
        "orange", "oven", "parking meter", "pizza", "potted plant", "refrigerator", "remote", "sandwich", "sheep",
        "sink", "skis", "sports ball", "stop sign", "teddy bear", "tennis racket", "tie", "toaster", "toilet",
        "traffic light", "train", "truck", "tv", "umbrella", "vase", "wine glass", "zebra",
    }
)  # fmt: skip
"""Classes of COCO that ImageNet has."""
ANIMALS = frozenset(
    {
        "bird",
        "cat",
        "dog",
        "horse",
        "sheep",
        "cow",
        "elephant",
        "bear",
        "zebra",
        "giraffe",
    }
)
LARGE = 0.01
"""Share of the photo from which an object counts."""
PEOPLE = 3
"""Of the people in the photos that teach, every third does: else they are half of all."""


def labels_of(class_name: str) -> list[str]:
    """Labels that name an object of a class of COCO rightly."""
    return ACCEPTED.get(class_name, class_name).split(", ") + ["animal"] * (
        class_name in ANIMALS
    )


@dataclass(frozen=True, eq=False)
class Objects:
    """Labelled objects of photos."""

    photo: NDArray[np.int64]
    classes: NDArray[np.str_]
    """COCO's."""
    share: NDArray[np.float64]
    """Of the photo."""
    features: NDArray[np.float32]
    detected: NDArray[np.float32]
    """(N, 80) scores of the detector's classes."""

    def some(self, which: NDArray[np.bool_]) -> Objects:
        """Those of them."""
        return Objects(
            self.photo[which],
            self.classes[which],
            self.share[which],
            self.features[which],
            self.detected[which],
        )

    def right(self, labels: Sequence[str]) -> NDArray[np.bool_]:
        """(N, L + 1) whether each label names each object rightly; "no label" never does."""
        right = [
            [label in labels_of(name) for label in labels] + [False]
            for name in self.classes
        ]
        return np.array(right)


def objects(
    validation: bool,
) -> Iterator[tuple[str, str, NDArray[np.uint8], NDArray[np.bool_]]]:
    """Number of the photo, class, photo and mask of every object of one part of COCO that is not too small."""
    folder = material() / "coco"
    judges = validation_ids(material())
    for name, classes in sorted(
        json.loads((folder / "labels.json").read_text()).items()
    ):
        if (name in judges) != validation:
            continue
        rgb = cv2.imread(str(folder / f"{name}.jpg"))[..., ::-1]
        stored = cv2.imread(str(folder / f"{name}.png"), cv2.IMREAD_UNCHANGED)
        for label, class_name in classes.items():
            mask = stored == int(label)
            skipped = class_name == "person" and not validation and int(label) % PEOPLE
            if np.count_nonzero(mask) >= naming.CROP.least_area and not skipped:
                yield name, class_name, rgb, mask


@lru_cache(maxsize=1)
def _boxes_of(name: str) -> DetectedBoxes:
    """The detector's boxes of a photo of COCO."""
    path = material() / "coco" / f"{name}.jpg"
    return detect_boxes(cv2.imread(str(path))[..., ::-1])


def seen(validation: bool, cache: Path | None = None) -> Objects:
    """The objects of one part with their features, by OpenCV; those in `cache` where there are some."""
    if cache is None or not cache.is_file():
        rows = [
            (
                int(name),
                what,
                float(mask.mean()),
                naming.features(naming.crop(rgb, mask)),
                naming.detected_classes(_boxes_of(name), mask),
            )
            for name, what, rgb, mask in objects(validation)
        ]
        columns = [np.array(column) for column in zip(*rows, strict=True)]
        if cache is None:
            return Objects(*columns)
        cache.parent.mkdir(parents=True, exist_ok=True)
        np.savez(cache, *columns)
    with np.load(cache) as kept:
        return Objects(*(kept[f"arr_{k}"] for k in range(5)))


def measure(
    heads: naming.Heads, found: Objects, *, is_detected: bool = False
) -> dict[str, float]:
    """Return shares of objects of 1 % of the photo or more that are named rightly.

    First and among the first three, of the classes that ImageNet has and of all; and of
    the labels of any object that are sure, but for people's. `is_detected`: with the
    detector's classes.
    """
    if is_detected:
        joint, is_sure = heads.joint_chances(found.features, found.detected)
        return shares(joint, np.where(is_sure, 1, 0), heads, found)
    return shares(*heads.chances(found.features), heads, found)


def shares(
    chances: NDArray[np.float32],
    sureness: NDArray[Any],
    heads: naming.Heads,
    found: Objects,
) -> dict[str, float]:
    right = found.right(heads.labels)
    hit = np.take_along_axis(right, np.argsort(-chances[:, :-1], axis=1)[:, :3], axis=1)
    large = found.share >= LARGE
    known = large & np.isin(found.classes, list(KNOWN))
    sure = (sureness >= heads.least_chance) & (found.classes != "person")
    return {
        "objects": int(large.sum()), "known": int(known.sum()),
        "first": float(hit[known, 0].mean()), "three": float(hit[known].any(1).mean()),
        "first_of_all": float(hit[large, 0].mean()), "three_of_all": float(hit[large].any(1).mean()),
        "sure": int(sure.sum()), "sure_right": float(hit[sure, 0].mean()) if sure.any() else 0.0,
    }  # fmt: skip
