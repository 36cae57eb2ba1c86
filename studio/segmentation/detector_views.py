"""Views of labelled photos that the detector learns from: scaled, mirrored, coloured.

A view is a square picture with boxes of whole objects and the weight that each place
has as an example of background.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from detector_drawings import flat_drawing
from drawn import draw
from labelled_photos import (
    UNJUDGED,
    LabelledPhoto,
    Objects,
    objects_of,
    photo_licences,
    photos_of,
)
from numpy.typing import NDArray

MOVABLE, IMMOVABLE, IGNORED = 0, 1, 2
"""Roles of a box; nothing is learned at an ignored one."""
SET_SHARES = {
    "coco": 0.26,
    "coco-minis": 0.3,
    "caltech101-part": 0.13,
    "trashnet-grabcut": 0.07,
    "fruits-nuts": 0.05,
    "class5": 0.03,
    "drawn": 0.09,
    "flat": 0.07,
}
"""Share of the views that each set gives. Photos with many objects count most."""
BACKGROUND_WEIGHTS = {"coco-minis": 0.3, "caltech101-part": 0.3}
"""Weight of unlabelled places in sets whose photos show unlabelled things too."""
DRAWN_PICTURES = 300
"""Pictures of the studio's drawings; each takes 0.5 s to draw."""
FIRST_SEED = 1000
"""Seed of the first drawing, as in `gather.py`."""
WEIGHT_STEP = 4
"""Side of the squares in which a photo's weights are stored, px."""
WHOLE_SHARE = 0.3
"""Views that show the whole photo at the top left, as when the detector is used."""
MOSAIC_SHARE = 0.3
"""Views of four photos."""
SCALES = (0.35, 2.8)
"""Smallest and largest enlargement against the whole photo."""
TILE_SCALES = (0.6, 1.8)
"""The same in a mosaic, against a photo that fills its tile."""
LEAST_VISIBLE = 0.5
"""Visible share of a box from which an object counts as whole."""
SMALLEST = 9.0
"""Shorter side of a box, px of the view, below which it is ignored."""
ON_OBJECT = 0.6
"""Share of enlarged views that are centred on an object."""


@dataclass(frozen=True)
class Example:
    """A photo to learn from, in memory."""

    jpeg: bytes
    boxes: NDArray[np.float32]
    """(N, 4) px of the photo."""
    roles: NDArray[np.int64]
    """(N,)"""
    classes: NDArray[np.int64]
    """(N,) of COCO, -1 if unknown."""
    weights: NDArray[np.float32]
    """(H / WEIGHT_STEP, W / WEIGHT_STEP) as an example of background."""
    has_classes: bool
    """Whether every object of COCO's classes is labelled."""

    def read(self) -> NDArray[np.uint8]:
        """Return the photo (H, W, 3) in BGR."""
        data = np.frombuffer(self.jpeg, np.uint8)
        return cv2.imdecode(data, cv2.IMREAD_COLOR)


@dataclass(frozen=True)
class View:
    """A square picture to learn from."""

    bgr: NDArray[np.uint8]
    boxes: NDArray[np.float32]
    roles: NDArray[np.int64]
    classes: NDArray[np.int64]
    weights: NDArray[np.float32]
    """(side / WEIGHT_STEP, side / WEIGHT_STEP)"""
    class_weights: NDArray[np.float32]
    """The same, for the scores of classes; 0 where objects have no class label."""


def example_of(photo: LabelledPhoto) -> Example:
    """Return a labelled photo as an example."""
    labels = photo.read_labels()
    objects = objects_of(photo, labels)
    return _example(
        photo.path.read_bytes(), objects, labels, photo.set_name, is_coco(photo)
    )


def is_coco(photo: LabelledPhoto) -> bool:
    """Return whether all objects of COCO's classes are labelled in a photo."""
    return photo.set_name.startswith("coco")


def _example(
    jpeg: bytes,
    objects: Objects,
    labels: NDArray[np.uint8],
    set_name: str,
    has_classes: bool,
) -> Example:
    background = BACKGROUND_WEIGHTS.get(set_name, 1.0)
    weights = np.full(labels.shape, background, np.float32)
    for left, top, right, bottom in objects.boxes.astype(int):
        # Parts of labelled objects, and gaps between them, are certainly not wholes.
        weights[top:bottom, left:right] = 1.0
    weights[labels == UNJUDGED] = 0.0
    small = cv2.resize(
        weights, None, fx=1 / WEIGHT_STEP, fy=1 / WEIGHT_STEP,
        interpolation=cv2.INTER_AREA,
    )  # fmt: skip
    roles = np.where(objects.is_movable, MOVABLE, IMMOVABLE)
    return Example(jpeg, objects.boxes, roles, objects.classes, small, has_classes)


def drawn_example(seed: int) -> Example:
    """Return a drawn picture as an example."""
    picture = draw(seed)
    labels = np.minimum(picture.labels, UNJUDGED - 1).astype(np.uint8)
    labels[picture.unsaid] = UNJUDGED
    return _picture_example(picture.rgb[..., ::-1], labels, "drawn")


def flat_example(seed: int) -> Example:
    """Return a drawing of flat shapes as an example."""
    bgr, labels = flat_drawing(seed)
    return _picture_example(bgr, labels, "flat")


def _picture_example(
    bgr: NDArray[np.uint8], labels: NDArray[np.uint8], set_name: str
) -> Example:
    """Return a picture whose objects are all movable as an example."""
    photo = LabelledPhoto(set_name, "", Path(), Path(), {})
    _, jpeg = cv2.imencode(".png", np.ascontiguousarray(bgr))
    return _example(jpeg.tobytes(), objects_of(photo, labels), labels, set_name, False)


def load_sets(
    folder: Path, licences: frozenset[int] | None
) -> dict[str, list[Example]]:
    """Return the examples of every set; parsed masks are kept in `folder`.

    `licences` are the photo licences of coco-minis that are used, None for all.
    """
    allowed = photo_licences()
    sets: dict[str, list[Example]] = {}
    for name in SET_SHARES:
        suffix = "-all" if name == "coco-minis" and licences is None else ""
        path = folder / f"{name}{suffix}-examples.pickle"
        if path.exists():
            # Written by this function below, in the training's own folder.
            sets[name] = pickle.loads(path.read_bytes())
            continue
        print(f"reading {name}", flush=True)
        if name == "drawn":
            examples = [drawn_example(FIRST_SEED + k) for k in range(DRAWN_PICTURES)]
        elif name == "flat":
            examples = [flat_example(FIRST_SEED + k) for k in range(DRAWN_PICTURES)]
        else:
            photos = photos_of(name, training=True)
            if name == "coco-minis" and licences is not None:
                photos = (p for p in photos if allowed[p.name] in licences)
            examples = [example_of(photo) for photo in photos]
        sets[name] = [one for one in examples if len(one.boxes)]
        temporary = path.with_suffix(".tmp")
        temporary.write_bytes(pickle.dumps(sets[name]))
        temporary.replace(path)
    return sets


def view(examples: Callable[[], Example], side: int, rng: np.random.Generator) -> View:
    """Return a random view; `examples` draws a photo each time it is called."""
    if rng.random() < MOSAIC_SHARE:
        shown = _mosaic(examples, side, rng)
    else:
        shown = _single(examples(), side, rng)
    if rng.random() < 0.5:
        shown = _mirrored(shown, side)
    return _coloured(shown, rng)


def _single(example: Example, side: int, rng: np.random.Generator) -> View:
    if rng.random() < WHOLE_SHARE:
        bgr = example.read()
        return placed(bgr, example, (side, side), side / max(bgr.shape[:2]), (0, 0))
    return _scaled(example, (side, side), SCALES, rng)


def _scaled(
    example: Example,
    size: tuple[int, int],
    scales: tuple[float, float],
    rng: np.random.Generator,
) -> View:
    """Return a photo at a random scale and place on a canvas of `size` (W, H)."""
    bgr = example.read()
    extent = np.array(bgr.shape[1::-1], np.float64)
    fit = float((np.array(size) / extent).min())
    scale = fit * float(np.exp(rng.uniform(*np.log(scales))))
    free = np.array(size) - extent * scale
    offset = rng.uniform(np.minimum(free, 0), np.maximum(free, 0))
    if scale > fit and rng.random() < ON_OBJECT:
        box = example.boxes[rng.integers(len(example.boxes))]
        centre = (box[:2] + box[2:]) / 2 * scale
        wished = np.array(size) * rng.uniform(0.3, 0.7, 2) - centre
        offset = np.clip(wished, np.minimum(free, 0), np.maximum(free, 0))
    colour = rng.integers(0, 256, 3) if rng.random() < 0.5 else np.zeros(3)
    return placed(bgr, example, size, scale, offset, tuple(map(int, colour)))


def placed(
    bgr: NDArray[np.uint8],
    example: Example,
    size: tuple[int, int],
    scale: float,
    offset: Sequence[float],
    colour: tuple[int, ...] = (0, 0, 0),
) -> View:
    """Return a photo scaled and moved by `offset` px on a canvas of `size` (W, H)."""
    # The position of a pixel's centre is moved, so that boxes and pixels agree.
    shift = np.array(offset) + (scale - 1) / 2
    if scale < 0.6:
        # Averages before sampling, which would otherwise alias.
        kernel = round(1 / scale) // 2 * 2 + 1
        bgr = cv2.blur(bgr, (kernel, kernel))
    matrix = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    canvas = cv2.warpAffine(
        bgr, matrix, size, flags=cv2.INTER_LINEAR, borderValue=colour
    )
    coarse = (size[0] // WEIGHT_STEP, size[1] // WEIGHT_STEP)
    matrix[:, 2] = np.array(offset) / WEIGHT_STEP + (scale - 1) / 2
    weights = cv2.warpAffine(
        example.weights, matrix, coarse, flags=cv2.INTER_LINEAR, borderValue=1
    )
    boxes = example.boxes * np.float32(scale) + np.tile(offset, 2).astype(np.float32)
    clipped = boxes.clip(0, np.tile(size, 2).astype(np.float32))
    areas = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)
    sides = clipped[:, 2:] - clipped[:, :2]
    visible = sides.prod(axis=1) / np.maximum(areas, 1e-6)
    is_ignored = (visible < LEAST_VISIBLE) | (sides.min(axis=1) < SMALLEST)
    roles = np.where(is_ignored, IGNORED, example.roles)
    shown = (sides > 1).all(axis=1)
    class_weights = weights if example.has_classes else np.zeros_like(weights)
    return View(
        canvas, clipped[shown], roles[shown], example.classes[shown], weights,
        class_weights,
    )  # fmt: skip


def _mosaic(
    examples: Callable[[], Example], side: int, rng: np.random.Generator
) -> View:
    """Return a view of four photos in tiles around a random corner."""
    step = 8 * WEIGHT_STEP
    x, y = (int(rng.uniform(0.35, 0.65) * side) // step * step for _ in range(2))
    bgr = np.zeros((side, side, 3), np.uint8)
    coarse = side // WEIGHT_STEP
    weights = np.ones((coarse, coarse), np.float32)
    class_weights = np.ones((coarse, coarse), np.float32)
    boxes, roles, classes = [], [], []
    for left, top, right, bottom in (
        (0, 0, x, y), (x, 0, side, y), (0, y, x, side), (x, y, side, side),
    ):  # fmt: skip
        tile = _scaled(examples(), (right - left, bottom - top), TILE_SCALES, rng)
        bgr[top:bottom, left:right] = tile.bgr
        part = np.s_[
            top // WEIGHT_STEP : bottom // WEIGHT_STEP,
            left // WEIGHT_STEP : right // WEIGHT_STEP,
        ]
        weights[part] = tile.weights
        class_weights[part] = tile.class_weights
        boxes.append(tile.boxes + np.array([left, top, left, top], np.float32))
        roles.append(tile.roles)
        classes.append(tile.classes)
    return View(
        bgr, np.concatenate(boxes), np.concatenate(roles), np.concatenate(classes),
        weights, class_weights,
    )  # fmt: skip


def _mirrored(shown: View, side: int) -> View:
    boxes = shown.boxes.copy()
    boxes[:, [0, 2]] = side - shown.boxes[:, [2, 0]]
    return View(
        np.ascontiguousarray(shown.bgr[:, ::-1]), boxes, shown.roles, shown.classes,
        shown.weights[:, ::-1], shown.class_weights[:, ::-1],
    )  # fmt: skip


def _coloured(shown: View, rng: np.random.Generator) -> View:
    """Change brightness, contrast, saturation and hue."""
    hsv = cv2.cvtColor(shown.bgr, cv2.COLOR_BGR2HSV).astype(np.float32)
    hsv[..., 0] = (hsv[..., 0] + rng.uniform(-8, 8)) % 180
    hsv[..., 1] = (hsv[..., 1] * rng.uniform(0.6, 1.4)).clip(0, 255)
    bgr = cv2.cvtColor(hsv.astype(np.uint8), cv2.COLOR_HSV2BGR).astype(np.float32)
    bgr = (bgr - 128) * rng.uniform(0.7, 1.25) + 128 + rng.uniform(-25, 25)
    bgr = bgr.clip(0, 255).astype(np.uint8)
    return View(
        bgr, shown.boxes, shown.roles, shown.classes, shown.weights,
        shown.class_weights,
    )  # fmt: skip
