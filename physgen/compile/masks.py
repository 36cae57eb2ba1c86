"""Scene + the photo's labels -> one label map whose id k + 1 is the scene's k-th object; masks of boundaries."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.outline.outline import Outline
from physgen.outline.raster import coverage_box
from physgen.problems import InputError, Problem
from physgen.scene.model import Boundary, Mask, MaskId, MaskPolygon, MaskRle, Object, Points, Scene

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
        mask = pixels(item.mask, scene.size, labels)
        if mask is not None:
            out[mask] = k + 1
            if not mask.any():
                problems.append(covers_nothing(scene, f"objects.{item.name}", item))
        elif outline is None:
            problems.append(unreadable(scene, f"objects.{item.name}", item))
        elif outline is not None:
            box, (x0, y0) = coverage_box(outline, (0, 0, width, height))
            out[y0 : y0 + box.shape[0], x0 : x0 + box.shape[1]][box >= 0.5] = k + 1
    shown = np.bincount(out.ravel(), minlength=len(scene.objects) + 1)
    if not problems:
        hidden = (k for k, outline in enumerate(written) if outline is None and not shown[k + 1])
        problems = [_hidden(scene, scene.objects[k]) for k in hidden]
    if problems:
        raise InputError(problems)
    return out


def pixels(mask: Mask | None, size: tuple[int, int], labels: U16 | None) -> NDArray[np.bool_] | None:
    """(H, W): what a mask covers; None where there is none, or an id without a map to be found in."""
    match mask:
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


def covers_nothing(scene: Scene, path: str, item: Object | Boundary) -> Problem:
    """The mask of the thing at `path` has no pixel."""
    path = f"{path}.mask"
    found = str(item.mask.id) if isinstance(item.mask, MaskId) else "it"
    fix = "write an id that masks.png holds, or an outline inside the photo"
    return Problem(scene.place(path), path, found, "covers no pixel", fix)


def unreadable(scene: Scene, path: str, item: Object | Boundary) -> Problem:
    """The mask of the thing at `path` is an id, and the scene has no photo."""
    path = f"{path}.mask"
    found = str(item.mask.id) if isinstance(item.mask, MaskId) else "it"
    expected = "is an id, and masks.png is read beside a photo only"
    return Problem(scene.place(path), path, found, expected, "write image: photo.png, or an outline")


def _hidden(scene: Scene, item: Object) -> Problem:
    path = f"objects.{item.name}.mask"
    fix = "write its shape, or give it a layer in front of theirs"
    return Problem(scene.place(path), path, item.name, "is hidden behind the masks of others", fix)
