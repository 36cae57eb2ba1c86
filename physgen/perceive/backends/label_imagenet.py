"""Backend label=imagenet: names by a small network where it is sure, else by shape.

The network is EfficientNet-Lite0 with its ImageNet weights. It sees a crop of each object with the background dimmed.
The probabilities of its 1,000 classes are added up by labels of the material table, and a logistic regression on its
features adds classes of household photos that ImageNet lacks. The detector's classes of COCO join them, and they alone
tell people. `studio/segmentation/names.py` writes both files; OpenCV runs the network.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Disc
from physgen.geometry.scale import box_sides
from physgen.maps import F32
from physgen.materials import is_living
from physgen.perceive.backends.label_shape import shape
from physgen.perceive.roles import Label, Labels, Mask, Name, PhotoObject, Rgb
from physgen.perceive.segment.detector import (
    DetectedBoxes,
    box_overlap,
    detect_boxes,
)
from physgen.perceive.segment.evidence import ANIMALS

LOCK = Lock()
NETWORK, HEADS = "names.onnx", "names.npz"
PERSON, DINOSAUR, TOY = "person", "dinosaur", "toy animal"
EXTINCT = 51
"""ImageNet's class of dinosaurs: what all of its photos show are models."""


@dataclass(frozen=True)
class CropConstants:
    """How an object is shown to the network."""

    side: int = 224  # px, the network's own size
    margin: float = 0.1  # of the object's longer side, around it
    dim: float = (
        0.35  # contrast of the background: surroundings help, neighbours confuse
    )
    middle: float = 127.0  # 8-bit code of the dimmed background; the input is (code - middle) / spread
    spread: float = 128.0
    least: int = 200  # px: smaller objects are named by shape
    joint: float = 0.7  # probability of network or detector from which a label is sure
    same: float = 0.5  # IoU of boxes from which the detector's is the object's
    likely: int = 3  # names that are kept beside the label
    floor: float = 0.01  # probability below which they are not
    pool_table: int = 736
    """ImageNet's class. A photo with so many round objects and this probability of the class or more is one."""
    rack: int = 3
    pool: float = 0.25
    alike: int = 2  # sure objects of a label and size that another one may follow
    unsure: float = 0.2  # its own probability of that label, at least
    support: float = 0.2  # by which they raise it
    size: float = 1.5  # ratio of their sizes, at most
    model: float = 0.15
    """Chance of a dinosaur from which an animal is a model.

    None of 227 boxes of animals and people has more than 0.04.
    """
    certain: float = 0.75  # confidence of what is round on it; of 182 photos without one none has over 0.2


CROP = CropConstants()


@dataclass(frozen=True, eq=False)
class Heads:
    """From (1280,) features to L labels, and "no label" after them."""

    labels: tuple[str, ...]
    group: (
        Any  # (1000,) label of each ImageNet class, L where the material table has none
    )
    weights: F32  # (1000, 1280) ImageNet's classifier
    bias: F32
    trust: float  # power to which ImageNet's probabilities are raised
    own: F32  # (L + 1, 1280) log odds per feature that the regression adds
    shift: F32  # (L + 1,) the same without features
    sure: float  # mean probability from which a label is written
    coco: Any  # (80,) label of each class of COCO, L where there is none

    def chances(self, features: F32) -> tuple[F32, F32]:
        """(N, 1280) features -> (N, L + 1) probabilities, and (N,) those of the likeliest labels, 0 for people.

        The latter are means with ImageNet's own: the regression knows few classes, and takes a can for a cup. What is
        found as an object and taken for a person is none: it was a plant, a bench or a tie.
        """
        plain = self._plain(features)
        learned = _softmax(
            self.trust * np.log(plain + 1e-4) + features @ self.own.T + self.shift
        )
        best = np.arange(len(features)), learned[:, :-1].argmax(1)
        objects = np.array([label != "person" for label in self.labels])[best[1]]
        return learned, np.asarray(
            objects * (learned[best] + plain[best]) / 2, np.float32
        )

    def joint_chances(
        self, features: F32, detected: F32
    ) -> tuple[F32, NDArray[np.bool_]]:
        """Return (N, L + 1): that the network or the detector (N, 80) is right.

        The second array (N,) marks those whose likeliest label is sure. People are named by
        the detector alone: the network takes plants, benches and ties for them. What the
        detector takes for an animal is a dinosaur if it is a model.
        """
        learned, sureness = self.chances(features)
        named = (learned + self._plain(features)) / 2
        if PERSON in self.labels:
            named[:, self.labels.index(PERSON)] = 0
        seen = np.zeros_like(named)
        is_model = self.is_model(features)
        if is_model.any() and DINOSAUR in self.labels:
            places = np.ix_(np.flatnonzero(is_model), np.array(ANIMALS, np.intp))
            seen[is_model, self.labels.index(DINOSAUR)] = detected[places].max(axis=1)
            detected = detected.copy()
            detected[places] = 0
        for k, label in enumerate(self.coco.tolist()):
            seen[:, label] = np.maximum(seen[:, label], detected[:, k])
        joint = np.asarray(1 - (1 - named) * (1 - seen), np.float32)
        joint[:, -1] = 0
        best = joint.argmax(axis=1)
        is_sure = (sureness >= self.sure) & (best == learned[:, :-1].argmax(axis=1))
        return joint, is_sure | (joint.max(axis=1) >= CROP.joint)

    def is_model(self, features: F32) -> NDArray[np.bool_]:
        """Return (N,) which features are those of an animal of which there are models only."""
        return np.asarray(self._classes(features)[:, EXTINCT] >= CROP.model)

    def _classes(self, features: F32) -> F32:
        """Return (N, 1000): the probabilities of ImageNet's classes."""
        return _softmax(features @ self.weights.T + self.bias)

    def _plain(self, features: F32) -> F32:
        """Return (N, L + 1): ImageNet's own probabilities."""
        plain = np.zeros((len(features), len(self.labels) + 1), np.float32)
        classes = self._classes(features)
        np.add.at(plain.T, self.group, classes.T)
        return plain


def detected_classes(boxes: DetectedBoxes, mask: Mask) -> F32:
    """Return (80,): the class scores of the box that fits an object best, by its fit."""
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    own = np.array([[x, y, x + width, y + height]], np.float64)
    if not boxes:
        return np.zeros(boxes.scores.shape[1] - 2, np.float32)
    fit = box_overlap(own, boxes.corners)[0]
    best = int((fit * (0.5 + boxes.scores.max(axis=1))).argmax())
    share = fit[best] if fit[best] >= CROP.same else 0.0
    return np.asarray(share * boxes.scores[best, 2:], np.float32)


def imagenet() -> Label:
    """The backend `imagenet`."""
    return _imagenet


def _imagenet(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject]
) -> Mapping[int, Name]:
    names = {
        i: replace(name, source="shape")
        for i, name in shape()(rgb, labels, objects).items()
    }
    large = [
        item.id for item in objects if np.count_nonzero(labels == item.id) >= CROP.least
    ]
    pool = _pool(rgb, [item.id for item in objects if isinstance(item.outline, Disc)])
    if not large:
        return names | pool
    head = heads()
    boxes = detect_boxes(rgb)
    joint, is_sure = head.joint_chances(
        np.stack([features(crop(rgb, labels == i)) for i in large]),
        np.stack([detected_classes(boxes, labels == i) for i in large]),
    )
    for i, chances, is_named in zip(large, joint, is_sure, strict=True):
        best = np.argsort(-chances[:-1])[: CROP.likely + 1]
        likely = [
            (head.labels[k], round(float(chances[k]), 2))
            for k in best
            if chances[k] >= CROP.floor
        ]
        if is_named:
            label, chance = likely[0]
            names[i] = Name(label, chance, tuple(likely[1:]), "imagenet")
        else:
            names[i] = replace(names[i], likely=tuple(likely[: CROP.likely]))
    by_id = {item.id: item for item in objects}
    return name_toys(name_like_others(names, by_id), by_id) | pool


def name_like_others(
    names: Mapping[int, Name], objects: Mapping[int, PhotoObject]
) -> dict[int, Name]:
    """Return the names, unsure ones after sure ones of objects as large.

    One of six apples on a table, less sure than the others, is an apple, too.
    """
    sure: dict[str, list[int]] = {}
    for i, name in names.items():
        if name.source == "imagenet":
            sure.setdefault(name.label, []).append(i)
    result = dict(names)
    for i, name in names.items():
        if name.source == "imagenet" or not name.likely:
            continue
        label, chance = name.likely[0]
        alike = [
            other
            for other in sure.get(label, ())
            if _is_as_large(objects[i], objects[other])
        ]
        if len(alike) >= CROP.alike and chance >= CROP.unsure:
            confidence = round(min(0.95, chance + CROP.support), 2)
            result[i] = Name(label, confidence, name.likely[1:], "imagenet")
    return result


def name_toys(
    names: Mapping[int, Name], objects: Mapping[int, PhotoObject]
) -> dict[int, Name]:
    """Return the names, animals as large as a dinosaur beside them as toys."""
    models = [objects[i] for i, name in names.items() if name.label == DINOSAUR]
    result = dict(names)
    for i, name in names.items():
        has_model = any(_is_as_large(objects[i], model) for model in models)
        if has_model and name.label != PERSON and is_living(name.label):
            result[i] = replace(name, label=TOY)
    return result


def _is_as_large(one: PhotoObject, other: PhotoObject) -> bool:
    """Return whether the longer sides of two objects differ little."""
    small, large = sorted((box_sides(one.outline)[0], box_sides(other.outline)[0]))
    return large <= CROP.size * small


def _pool(rgb: Rgb, round_ones: Sequence[int]) -> dict[int, Name]:
    """What is round on a pool table: the photo as a whole tells, a ball alone could be any."""
    if len(round_ones) < CROP.rack:
        return {}
    head = heads()
    whole = cv2.resize(
        rgb, (CROP.side, CROP.side), interpolation=cv2.INTER_AREA
    ).astype(np.float32)
    chances = _softmax(features(whole)[None] @ head.weights.T + head.bias)[0]
    name = Name("billiard ball", CROP.certain, (), "imagenet")
    return (
        dict.fromkeys(round_ones, name) if chances[CROP.pool_table] >= CROP.pool else {}
    )


def crop(rgb: Rgb, mask: Mask) -> F32:
    """(side, side, 3) 8-bit codes: the object in the middle, upright and undistorted, its background dimmed."""
    x, y, w, h = cv2.boundingRect(mask.astype(np.uint8))
    whole = max(w, h) * (1 + 2 * CROP.margin)
    left, top = max(int(x + w / 2 - whole / 2), 0), max(int(y + h / 2 - whole / 2), 0)
    part = np.s_[
        top : int(y + h / 2 + whole / 2) + 2, left : int(x + w / 2 + whole / 2) + 2
    ]
    inside = mask[part].astype(np.float32)
    scale = CROP.side / whole
    soft = np.maximum(cv2.GaussianBlur(inside, (0, 0), max(1.0, 1 / scale)), inside)[
        ..., None
    ]
    middle = np.float32(CROP.middle)
    shown = middle + (rgb[part] - middle) * (CROP.dim + (1 - CROP.dim) * soft)
    size = max(round(shown.shape[1] * scale), 1), max(round(shown.shape[0] * scale), 1)
    small = cv2.resize(
        shown, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    )
    centre = (x + w / 2 - left) * scale, (y + h / 2 - top) * scale
    move = np.array(
        [[1, 0, CROP.side / 2 - centre[0]], [0, 1, CROP.side / 2 - centre[1]]]
    )
    square = cv2.warpAffine(
        small, move, (CROP.side, CROP.side), borderValue=(CROP.middle,) * 3
    )
    return np.asarray(square, np.float32)


def features(shown: F32) -> F32:
    """(1280,) of a crop (side, side, 3)."""
    blob = ((shown - np.float32(CROP.middle)) / np.float32(CROP.spread)).transpose(
        2, 0, 1
    )[None]
    network = _network()
    with LOCK:  # a net holds state between the calls
        network.setInput(np.ascontiguousarray(blob))
        return np.array(network.forward()[0], np.float32)


@cache
def heads() -> Heads:
    """The shipped heads; weights are stored in 8 bits, with a scale for each row."""
    with np.load(Path(__file__).with_name(HEADS)) as stored:
        label = tuple(map(str, stored["labels"]))
        own = np.zeros((len(label) + 1, stored["own"].shape[1]), np.float32)
        own[stored["own_rows"]] = stored["own"] * stored["own_scale"][:, None]
        weights = stored["weights"] * stored["scale"][:, None]
        return Heads(
            label, stored["group"], weights, stored["bias"], float(stored["trust"]), own, stored["shift"],
            float(stored["sure"]), stored["coco"],
        )  # fmt: skip


def _softmax(logits: NDArray[Any]) -> F32:
    """(N, K) -> (N, K) probabilities."""
    powers = np.exp(logits - logits.max(1, keepdims=True))
    return np.asarray(powers / powers.sum(1, keepdims=True), np.float32)


@cache
def _network() -> cv2.dnn.Net:
    return cv2.dnn.readNetFromONNX(str(Path(__file__).with_name(NETWORK)))
