"""Backend label=imagenet: labels by a small network if it is confident, else by shape.

The network is EfficientNet-Lite0 with its ImageNet weights, applied to a crop of each
object with a dimmed background. The probabilities of its 1,000 classes are summed by
labels of the material table. A logistic regression on its features adds classes of
household photos that are missing in ImageNet. The detector's COCO classes are combined
with both, and only the detector decides on people. `studio/segmentation/names.py`
writes both files; OpenCV runs the network.
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
"""ImageNet's class of dinosaurs: all of its photos show models."""


@dataclass(frozen=True)
class CropConstants:
    """Constants of the crop, the labels and the special cases."""

    # px: side of the network's input.
    side: int = 224
    # Margin around an object as a share of its longer side.
    margin: float = 0.1
    # Contrast factor of the background: surroundings help the network, but neighbours
    # confuse it.
    background_contrast: float = 0.35
    # 8-bit level of the dimmed background; the network's input is (level - middle) /
    # spread.
    middle: float = 127.0
    spread: float = 128.0
    # px: objects with fewer pixels are labelled by shape.
    least_area: int = 200
    # Least joint probability of network and detector for a confident label.
    joint: float = 0.7
    # Least IoU of an object's box and the detector's box of the same object.
    least_overlap: float = 0.5
    # Number of alternative labels beside the label.
    alternatives: int = 3
    # Least probability of an alternative label.
    floor: float = 0.01
    pool_table: int = 736
    """ImageNet's class of pool tables.

    A photo shows a pool table if it contains `rack` discs and the class has a
    probability of at least `pool`.
    """
    rack: int = 3
    pool: float = 0.25
    # Number of confident objects of one label and size that support another object.
    supporters: int = 2
    # Least probability of the label for the supported object.
    least_chance: float = 0.2
    # Increase of its probability by the support.
    support: float = 0.2
    # Largest ratio of sizes of two objects of one kind.
    size: float = 1.5
    model: float = 0.15
    """Least probability of the dinosaur class for an animal model.

    None of 227 boxes of animals and people exceeds 0.04.
    """
    # Confidence of a billiard ball on a pool table; in 182 photos without a table the
    # class never exceeds 0.2.
    ball_confidence: float = 0.75


CROP = CropConstants()


@dataclass(frozen=True, eq=False)
class Heads:
    """The classifiers that turn features (1280,) into L labels and a last class "no
    label".
    """

    labels: tuple[str, ...]
    # (1000,) label index of each ImageNet class, L if the material table has none.
    group: Any
    # (1000, 1280) ImageNet's classifier.
    weights: F32
    bias: F32
    # Exponent of ImageNet's probabilities.
    trust: float
    # (L + 1, 1280) log odds per feature, added by the regression.
    regression: F32
    # (L + 1,) log odds without features.
    shift: F32
    # Least mean probability of a written label.
    least_chance: float
    # (80,) label index of each COCO class, L if there is none.
    coco: Any

    def chances(self, features: F32) -> tuple[F32, F32]:
        """Return label probabilities (N, L + 1) of features (N, 1280), and a certainty
        (N,).

        The certainty is the mean of the regression's and ImageNet's probability of the
        likeliest label, since the regression knows few classes and takes a can for a
        cup. It is 0 for people: objects classified as people were plants, benches or
        ties.
        """
        imagenet_chances = self._sum_class_probabilities(features)
        chances = _softmax(
            self.trust * np.log(imagenet_chances + 1e-4)
            + features @ self.regression.T
            + self.shift
        )
        best = np.arange(len(features)), chances[:, :-1].argmax(1)
        objects = np.array([label != "person" for label in self.labels])[best[1]]
        return chances, np.asarray(
            objects * (chances[best] + imagenet_chances[best]) / 2, np.float32
        )

    def joint_chances(
        self, features: F32, class_scores: F32
    ) -> tuple[F32, NDArray[np.bool_]]:
        """Return the probabilities (N, L + 1) that network or detector is right about a
        label.

        The second array (N,) marks confident labels. Only the detector labels people,
        because the network takes plants, benches and ties for people. An animal of the
        detector becomes a dinosaur if it looks like a model. `class_scores` is (N, 80).
        """
        regression_chances, sureness = self.chances(features)
        network_chances = (
            regression_chances + self._sum_class_probabilities(features)
        ) / 2
        if PERSON in self.labels:
            network_chances[:, self.labels.index(PERSON)] = 0
        detector_chances = np.zeros_like(network_chances)
        is_model = self.is_model(features)
        # The detector knows no dinosaurs: its scores for animals go to the label
        # dinosaur.
        if is_model.any() and DINOSAUR in self.labels:
            places = np.ix_(np.flatnonzero(is_model), np.array(ANIMALS, np.intp))
            detector_chances[is_model, self.labels.index(DINOSAUR)] = class_scores[
                places
            ].max(axis=1)
            class_scores = class_scores.copy()
            class_scores[places] = 0
        for k, label in enumerate(self.coco.tolist()):
            detector_chances[:, label] = np.maximum(
                detector_chances[:, label], class_scores[:, k]
            )
        # Network and detector are assumed to err independently: 1 - (1 - p)(1 - q).
        joint = np.asarray(
            1 - (1 - network_chances) * (1 - detector_chances), np.float32
        )
        joint[:, -1] = 0
        best = joint.argmax(axis=1)
        is_confident = (sureness >= self.least_chance) & (
            best == regression_chances[:, :-1].argmax(axis=1)
        )
        return joint, is_confident | (joint.max(axis=1) >= CROP.joint)

    def is_model(self, features: F32) -> NDArray[np.bool_]:
        """Return (N,) whether features show an animal that exists only as a model."""
        return np.asarray(self._classes(features)[:, EXTINCT] >= CROP.model)

    def _classes(self, features: F32) -> F32:
        """Return the probabilities (N, 1000) of ImageNet's classes."""
        return _softmax(features @ self.weights.T + self.bias)

    def _sum_class_probabilities(self, features: F32) -> F32:
        """Return ImageNet's own label probabilities (N, L + 1)."""
        chances = np.zeros((len(features), len(self.labels) + 1), np.float32)
        classes = self._classes(features)
        np.add.at(chances.T, self.group, classes.T)
        return chances


def detected_classes(boxes: DetectedBoxes, mask: Mask) -> F32:
    """Return the class scores (80,) of the box with the best fit, scaled by the fit."""
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    object_box = np.array([[x, y, x + width, y + height]], np.float64)
    if not boxes:
        return np.zeros(boxes.scores.shape[1] - 2, np.float32)
    fit = box_overlap(object_box, boxes.corners)[0]
    best = int((fit * (0.5 + boxes.scores.max(axis=1))).argmax())
    if fit[best] >= CROP.least_overlap:
        share = fit[best]
    else:
        share = 0.0
    return np.asarray(share * boxes.scores[best, 2:], np.float32)


def imagenet() -> Label:
    """Return the backend `imagenet`."""
    return _imagenet


def _imagenet(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject]
) -> Mapping[int, Name]:
    names = {}
    for i, name in shape()(rgb, labels, objects).items():
        names[i] = replace(name, source="shape")
    large_ids = []
    for item in objects:
        if np.count_nonzero(labels == item.id) >= CROP.least_area:
            large_ids.append(item.id)
    discs = []
    for item in objects:
        if isinstance(item.outline, Disc):
            discs.append(item.id)
    billiard_balls = _pool(rgb, discs)
    if not large_ids:
        return names | billiard_balls
    _name_large_objects(names, rgb, labels, large_ids)
    by_id = {item.id: item for item in objects}
    return name_toys(name_like_others(names, by_id), by_id) | billiard_balls


def _name_large_objects(
    names: dict[int, Name], rgb: Rgb, labels: Labels, ids: Sequence[int]
) -> None:
    """Replace the labels of objects by those of the classifiers, in place.

    Objects without a confident label get only alternatives.
    """
    head = heads()
    boxes = detect_boxes(rgb)
    joint, confident = head.joint_chances(
        np.stack([features(crop(rgb, labels == i)) for i in ids]),
        np.stack([detected_classes(boxes, labels == i) for i in ids]),
    )
    for i, chances, has_label in zip(ids, joint, confident, strict=True):
        best = np.argsort(-chances[:-1])[: CROP.alternatives + 1]
        candidates = []
        for k in best:
            if chances[k] >= CROP.floor:
                candidates.append((head.labels[k], round(float(chances[k]), 2)))
        if has_label:
            label, chance = candidates[0]
            names[i] = Name(label, chance, tuple(candidates[1:]), "imagenet")
        else:
            alternatives = tuple(candidates[: CROP.alternatives])
            names[i] = replace(names[i], alternatives=alternatives)


def name_like_others(
    names: Mapping[int, Name], objects: Mapping[int, PhotoObject]
) -> dict[int, Name]:
    """Return the labels, with doubtful ones adopted from confident objects of the same
    size.

    For example, one of six apples on a table becomes an apple although its own
    probability is lower.
    """
    confident_ids: dict[str, list[int]] = {}
    for i, name in names.items():
        if name.source == "imagenet":
            confident_ids.setdefault(name.label, []).append(i)
    result = dict(names)
    for i, name in names.items():
        if name.source == "imagenet" or not name.alternatives:
            continue
        label, chance = name.alternatives[0]
        supporters = []
        for other in confident_ids.get(label, ()):
            if _is_as_large(objects[i], objects[other]):
                supporters.append(other)
        if len(supporters) >= CROP.supporters and chance >= CROP.least_chance:
            confidence = round(min(0.95, chance + CROP.support), 2)
            result[i] = Name(label, confidence, name.alternatives[1:], "imagenet")
    return result


def name_toys(
    names: Mapping[int, Name], objects: Mapping[int, PhotoObject]
) -> dict[int, Name]:
    """Return the labels, with animals as large as a neighbouring dinosaur labelled as
    toys.
    """
    models = []
    for i, name in names.items():
        if name.label == DINOSAUR:
            models.append(objects[i])
    result = dict(names)
    for i, name in names.items():
        has_model = any(_is_as_large(objects[i], model) for model in models)
        if has_model and name.label != PERSON and is_living(name.label):
            result[i] = replace(name, label=TOY)
    return result


def _is_as_large(first: PhotoObject, second: PhotoObject) -> bool:
    """Return whether the longer sides of two objects differ little."""
    small, large = sorted((box_sides(first.outline)[0], box_sides(second.outline)[0]))
    return large <= CROP.size * small


def _pool(rgb: Rgb, disc_ids: Sequence[int]) -> dict[int, Name]:
    """Return the label billiard ball for all discs if the photo shows a pool table.

    The whole photo decides, because a single ball could be any ball.
    """
    if len(disc_ids) < CROP.rack:
        return {}
    head = heads()
    small_photo = cv2.resize(
        rgb, (CROP.side, CROP.side), interpolation=cv2.INTER_AREA
    ).astype(np.float32)
    chances = _softmax(features(small_photo)[None] @ head.weights.T + head.bias)[0]
    name = Name("billiard ball", CROP.ball_confidence, (), "imagenet")
    if chances[CROP.pool_table] >= CROP.pool:
        return dict.fromkeys(disc_ids, name)
    return {}


def crop(rgb: Rgb, mask: Mask) -> F32:
    """Return an object's crop (side, side, 3), 8-bit levels, with a dimmed background.

    The object is centred, upright and undistorted.
    """
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    middle_x = x + width / 2
    middle_y = y + height / 2
    span = max(width, height) * (1 + 2 * CROP.margin)
    left = max(int(middle_x - span / 2), 0)
    top = max(int(middle_y - span / 2), 0)
    part = np.s_[
        top : int(middle_y + span / 2) + 2, left : int(middle_x + span / 2) + 2
    ]
    scale = CROP.side / span
    picture = _dim_background(rgb[part], mask[part], max(1.0, 1 / scale))
    size = (
        max(round(picture.shape[1] * scale), 1),
        max(round(picture.shape[0] * scale), 1),
    )
    if scale < 1:
        interpolation = cv2.INTER_AREA
    else:
        interpolation = cv2.INTER_LINEAR
    small = cv2.resize(picture, size, interpolation=interpolation)
    return _center(small, (middle_x - left) * scale, (middle_y - top) * scale)


def _center(picture: NDArray[Any], x: float, y: float) -> F32:
    """Return a square crop (side, side, 3) whose centre is the point (x, y) px."""
    right = CROP.side / 2 - x
    down = CROP.side / 2 - y
    shift = np.array([[1, 0, right], [0, 1, down]])
    square = cv2.warpAffine(
        picture, shift, (CROP.side, CROP.side), borderValue=(CROP.middle,) * 3
    )
    return np.asarray(square, np.float32)


def _dim_background(rgb: Rgb, mask: Mask, blur: float) -> F32:
    """Return a photo, 8-bit levels, with less contrast outside a mask.

    The mask is blurred by `blur` px, one pixel of the crop, so that its edge is no cue.
    """
    inside = mask.astype(np.float32)
    weight = np.maximum(cv2.GaussianBlur(inside, (0, 0), blur), inside)[..., None]
    middle = np.float32(CROP.middle)
    return np.asarray(
        middle
        + (rgb - middle)
        * (CROP.background_contrast + (1 - CROP.background_contrast) * weight)
    )


def features(picture: F32) -> F32:
    """Return the features (1280,) of a crop (side, side, 3)."""
    blob = ((picture - np.float32(CROP.middle)) / np.float32(CROP.spread)).transpose(
        2, 0, 1
    )[None]
    network = _network()
    # An OpenCV network holds state between the two calls.
    with LOCK:
        network.setInput(np.ascontiguousarray(blob))
        return np.array(network.forward()[0], np.float32)


@cache
def heads() -> Heads:
    """Return the bundled classifiers.

    Weights are stored with 8 bits and one scale per row.
    """
    with np.load(Path(__file__).with_name(HEADS)) as arrays:
        label = tuple(map(str, arrays["labels"]))
        regression = np.zeros((len(label) + 1, arrays["own"].shape[1]), np.float32)
        regression[arrays["own_rows"]] = arrays["own"] * arrays["own_scale"][:, None]
        weights = arrays["weights"] * arrays["scale"][:, None]
        return Heads(
            label, arrays["group"], weights, arrays["bias"], float(arrays["trust"]), regression, arrays["shift"],
            float(arrays["sure"]), arrays["coco"],
        )  # fmt: skip


def _softmax(logits: NDArray[Any]) -> F32:
    """Return probabilities (N, K) of logits (N, K)."""
    powers = np.exp(logits - logits.max(1, keepdims=True))
    return np.asarray(powers / powers.sum(1, keepdims=True), np.float32)


@cache
def _network() -> cv2.dnn.Net:
    return cv2.dnn.readNetFromONNX(str(Path(__file__).with_name(NETWORK)))
