"""Photo and masks -> the pictures that a model is shown: objects outlined, cut out with a margin, numbered; PNG."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Rgb

Mask = NDArray[np.bool_]
WHOLE = 1024
"""px: the longer side of a whole photo, at most."""
CLOSE = (256, 512)
"""px: the longer side of a close-up, at least and at most."""
TILE = 224
"""px: the side of one object on a sheet of many."""
MARGIN = 0.25
"""Of an object's longer side, around it."""
DIM = 0.4
"""How much of their light the surroundings keep."""
INK = (255, 0, 255)
"""RGB of outlines and numbers: hardly any object has that colour."""


def whole(rgb: Rgb) -> bytes:
    """The photo as it is."""
    return _png(_sized(rgb, 0, WHOLE))


def marked(rgb: Rgb, masks: Mapping[int, Mask]) -> bytes:
    """The photo with each object outlined and its number, the key, on it."""
    picture = _sized(rgb, 0, WHOLE).copy()
    for number, mask in masks.items():
        fitted = _fitted(mask, picture)
        _outlined(picture, fitted)
        if len(masks) > 1:
            _numbered(picture, number, _inmost(fitted))
    return _png(picture)


def close(rgb: Rgb, mask: Mask) -> bytes:
    """One object with a margin, outlined, its surroundings darkened."""
    return _png(_close(rgb, mask, *CLOSE))


def sheet(rgb: Rgb, masks: Mapping[int, Mask]) -> bytes:
    """Close-ups of several objects side by side, each with its number in the corner."""
    across = ceil(sqrt(len(masks)))
    canvas = np.full((ceil(len(masks) / across) * TILE, across * TILE, 3), 255, np.uint8)
    for k, (number, mask) in enumerate(masks.items()):
        picture = _close(rgb, mask, TILE, TILE)
        y, x = k // across * TILE, k % across * TILE
        tall, wide = picture.shape[:2]
        canvas[y : y + tall, x : x + wide] = picture
        _numbered(canvas, number, (x + 18, y + 18))
    return _png(canvas)


def colour(rgb: Rgb, mask: Mask) -> NDArray[np.float64]:
    """(3,) the object's middle colour in CIELAB, L in 0..100."""
    inside = rgb[mask] if mask.any() else rgb.reshape(-1, 3)
    lab = cv2.cvtColor(np.median(inside, axis=0).astype(np.float32)[None, None] / 255, cv2.COLOR_RGB2LAB)
    return np.asarray(lab[0, 0], np.float64)


def _close(rgb: Rgb, mask: Mask, least: int, most: int) -> Rgb:
    rows, columns = (np.flatnonzero(mask.any(axis)) for axis in (1, 0))
    if not len(rows):  # nothing of it lies in the photo
        return _sized(rgb, least, most)
    (y0, y1), (x0, x1) = ((int(line[0]), int(line[-1]) + 1) for line in (rows, columns))
    margin = max(ceil(MARGIN * max(y1 - y0, x1 - x0)), 8)
    y0, x0 = max(y0 - margin, 0), max(x0 - margin, 0)
    part, inside = rgb[y0 : y1 + margin, x0 : x1 + margin], mask[y0 : y1 + margin, x0 : x1 + margin]
    picture = _sized(np.ascontiguousarray(part), least, most).copy()
    fitted = _fitted(inside, picture)
    picture[~fitted] = (picture[~fitted] * DIM).astype(np.uint8)
    _outlined(picture, fitted)
    return picture


def _sized(rgb: Rgb, least: int, most: int) -> Rgb:
    """A picture whose longer side is from `least` to `most` px."""
    tall, wide = rgb.shape[:2]
    factor = min(max(1.0, least / max(tall, wide)), most / max(tall, wide))
    if factor == 1:
        return rgb
    size = max(round(wide * factor), 1), max(round(tall * factor), 1)
    how = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(rgb, size, interpolation=how), np.uint8)


def _fitted(mask: Mask, picture: Rgb) -> Mask:
    tall, wide = picture.shape[:2]
    if mask.shape == (tall, wide):
        return mask
    return np.asarray(cv2.resize(mask.astype(np.float32), (wide, tall)) >= 0.5)


def _outlined(picture: Rgb, mask: Mask) -> None:
    """Around it and not on it, so that nothing of it is hidden."""
    wide = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    picture[wide & ~mask] = INK


def _inmost(mask: Mask) -> tuple[int, int]:
    """x, y of the pixel that lies deepest in the mask."""
    deep = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)
    y, x = np.unravel_index(int(deep.argmax()), deep.shape)
    return int(x) - 1, int(y) - 1


def _numbered(picture: Rgb, number: int, at: tuple[int, int]) -> None:
    text, font, size = str(number), cv2.FONT_HERSHEY_SIMPLEX, 0.6
    (wide, tall), _ = cv2.getTextSize(text, font, size, 2)
    corner = at[0] - wide // 2, at[1] + tall // 2
    far = corner[0] + wide + 2, corner[1] + 3
    cv2.rectangle(picture, (corner[0] - 3, corner[1] - tall - 3), far, (255, 255, 255), -1)
    cv2.putText(picture, text, corner, font, size, INK, 2, cv2.LINE_AA)


def _png(rgb: Rgb) -> bytes:
    return cv2.imencode(".png", rgb[..., ::-1])[1].tobytes()
