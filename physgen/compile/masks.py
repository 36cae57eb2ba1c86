"""Scene + the photo's labels -> one label map whose id k + 1 is the scene's k-th object."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.outline.outline import Outline
from physgen.outline.raster import coverage_box
from physgen.problems import InputError, Problem
from physgen.scene.model import MaskId, MaskPolygon, MaskRle, Object, Points, Scene

U16 = NDArray[np.uint16]


def object_labels(scene: Scene, labels: U16 | None, written: list[Outline | None]) -> U16:
    """(H, W) ids by object: from masks.png, an outline, run lengths or, with none of these, the written shape.

    `written` holds the outline of every explicit shape, None where it is fitted. Nearer layers win shared pixels.
    """
    width, height = scene.size
    out = np.zeros((height, width), np.uint16)
    problems = []
    for k in sorted(range(len(scene.objects)), key=lambda k: scene.objects[k].layer):
        item, outline = scene.objects[k], written[k]
        mask = _mask(item, scene.size, labels)
        if mask is not None:
            out[mask] = k + 1
            if not mask.any():
                problems.append(_missing(scene, item))
        elif outline is not None:
            box, (x0, y0) = coverage_box(outline, (0, 0, width, height))
            out[y0 : y0 + box.shape[0], x0 : x0 + box.shape[1]][box >= 0.5] = k + 1
    if problems:
        raise InputError(problems)
    return out


def _mask(item: Object, size: tuple[int, int], labels: U16 | None) -> NDArray[np.bool_] | None:
    match item.mask:
        case MaskId(id=identity):
            return None if labels is None else np.asarray(labels == identity)
        case MaskPolygon(points=points):
            return fill(points, size)
        case MaskRle(size=(height, width), counts=counts):
            flat = np.repeat(np.arange(len(counts)) % 2 == 1, counts)
            return np.ascontiguousarray(flat.reshape(width, height).T)
        case _:
            return None


def fill(points: Points, size: tuple[int, int]) -> NDArray[np.bool_]:
    """(H, W): pixels whose centre lies inside, by the even-odd rule."""
    canvas = np.zeros((size[1], size[0]), np.uint8)
    fixed = np.rint(np.asarray(points) * 16).astype(np.int32)
    cv2.fillPoly(canvas, [fixed], 1, lineType=cv2.LINE_8, shift=4)
    return canvas > 0


def _missing(scene: Scene, item: Object) -> Problem:
    path = f"objects.{item.name}.mask"
    found = str(item.mask.id) if isinstance(item.mask, MaskId) else "it"
    fix = "write an id that masks.png holds, or an outline inside the photo"
    return Problem(scene.place(path), path, found, "covers no pixel", fix)
