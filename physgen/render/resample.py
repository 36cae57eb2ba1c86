"""A picture -> the same picture seen larger, smaller or shifted by any fraction of a pixel.

Lanczos with three lobes, in linear light, widened where pixels are gathered, so that nothing finer than the new pixels
is left to shimmer. Its overshoot would draw a dark line along every bright edge: each value is held between the least
and the greatest of the pixels under the kernel's middle lobe. Weights are exact (Pillow's), where OpenCV's warps know
no finer step than 1/32 px and a slow pan would tremble.
"""

from __future__ import annotations

from math import ceil, floor

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen.photometry import decode, encode_u8

U8 = NDArray[np.uint8]
Array = NDArray[np.float64]
Index = NDArray[np.int64]
Slices = tuple[slice, slice]
Size = tuple[int, int]
"""Width and height, px."""

LOBES = 3
"""Of the kernel, on each side."""
NOTHING = 1e-6
"""px that no picture shows."""


def resampled(rgb: U8, matrix: Array, size: Size) -> U8:
    """(h, w, 3) sRGB of `size` (w, h). `matrix` (2, 3) scales and shifts: px of `rgb` -> px of the result.

    What is seen lies in `rgb`. A shift by whole pixels alone returns them as they are.
    """
    scale = float(matrix[0, 0])
    x0, y0, x1, y1 = _seen(rgb, matrix, size)
    left, top = round(x0), round(y0)
    if scale == 1.0 and max(abs(x0 - left), abs(y0 - top)) < NOTHING:
        return np.ascontiguousarray(rgb[top : top + size[1], left : left + size[0]])
    reach = ceil(LOBES * max(1.0, 1.0 / scale)) + 1  # no kernel looks farther than this beyond what is seen
    left, top = max(floor(x0) - reach, 0), max(floor(y0) - reach, 0)
    rgb = rgb[top : ceil(y1) + reach, left : ceil(x1) + reach]
    matrix = np.column_stack([matrix[:, :2], matrix @ [left, top, 1.0]])
    x0, y0, x1, y1 = _seen(rgb, matrix, size)
    light = decode(np.arange(256, dtype=np.uint8))
    wide, rows, columns = _lobes(rgb, matrix, size)
    planes = []
    for codes in cv2.split(rgb):
        plane = Image.fromarray(cv2.LUT(codes, light))
        fine = np.asarray(plane.resize(size, Image.Resampling.LANCZOS, box=(x0, y0, x1, y1)))
        low, high = (
            morph(codes, wide, anchor=(0, 0)).take(columns, 1).take(rows, 0)
            for morph in (cv2.erode, cv2.dilate)
        )
        planes.append(cv2.min(cv2.max(encode_u8(fine), low), high))  # sRGB keeps the order of light
    return np.asarray(cv2.merge(planes), np.uint8)


def nearest(ids: NDArray[np.uint16], matrix: Array, size: Size) -> NDArray[np.uint16]:
    """(h, w) of `size` (w, h): the nearest value to each pixel."""
    rows, columns = sources(matrix, (ids.shape[1], ids.shape[0]), size)
    return np.asarray(ids.take(columns, 1).take(rows, 0))


def nearest_in(
    box: Slices, mask: NDArray[np.bool_], rows: Index, columns: Index
) -> tuple[Slices, NDArray[np.bool_]]:
    """`nearest` of a picture that is True in a `box` alone, by its `sources`: the box and mask of the result."""
    parts, picked = [], []
    for at, own in ((rows, box[0]), (columns, box[1])):
        first, last = np.searchsorted(at, (own.start, own.stop)).tolist()
        parts.append(slice(first, last))
        picked.append(at[first:last] - own.start)
    return (parts[0], parts[1]), np.asarray(mask.take(picked[1], 1).take(picked[0], 0))


def sources(matrix: Array, shown: Size, size: Size) -> tuple[Index, Index]:
    """(h,) rows and (w,) columns of a picture of the size `shown` that are nearest to those of the result."""
    at = (np.floor(_sources(matrix, axis, size[axis]) + 0.5).astype(np.int64) for axis in (1, 0))
    rows, columns = (np.clip(part, 0, side - 1) for part, side in zip(at, shown[::-1], strict=True))
    return rows, columns


def _seen(rgb: U8, matrix: Array, size: Size) -> tuple[float, float, float, float]:
    """The borders x0, y0, x1, y1 of what is seen, as Pillow counts px: from the corner of the first pixel."""
    scale = float(matrix[0, 0])
    edges = []
    for axis, side in ((0, rgb.shape[1]), (1, rgb.shape[0])):
        low = (-0.5 - float(matrix[axis, 2])) / scale + 0.5
        edges.append((max(low, 0.0), min(low + size[axis] / scale, float(side))))
    (x0, x1), (y0, y1) = edges
    return x0, y0, x1, y1


def _sources(matrix: Array, axis: int, count: int) -> Array:
    """Where the result's columns (axis 0) or rows (axis 1) come from, px."""
    return np.asarray((np.arange(count) - matrix[axis, 2]) / matrix[0, 0])


def _lobes(rgb: U8, matrix: Array, size: Size) -> tuple[U8, Index, Index]:
    """The pixels of `rgb` within the kernel's middle lobe: a square of ones, and its first row and column by pixel."""
    reach = max(1.0, 1.0 / float(matrix[0, 0]))
    wide = ceil(2 * reach - NOTHING)
    first = []
    for axis, side in ((0, rgb.shape[1]), (1, rgb.shape[0])):
        beyond = np.floor(_sources(matrix, axis, size[axis]) - reach + NOTHING)
        first.append(np.clip(beyond.astype(np.int64) + 1, 0, side - 1))
    return np.ones((wide, wide), np.uint8), first[1], first[0]
