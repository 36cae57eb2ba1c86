"""Features of pictures without a model, to compare clips within this project: no published FID is made of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from physgen.evaluate.fid import F32, F64
from physgen.videos import U8

BANK_SIDE = 128
"""px of the pictures that the bank looks at."""
SIZES = (1.0, 2.0, 4.0, 8.0)
"""px: standard deviations of Gaussians."""
TURNS = np.pi * np.arange(4) / 4
"""rad: across edges."""
COLOURS, EDGES = 4, 3
"""Fields along a side."""
WHITE = 10.0
LUMA = np.array([0.299, 0.587, 0.114], np.float32)
"""Of R'G'B' (ITU-R BT.601)."""


class Bank:
    """Colours and edges of four sizes in fields of the picture.

    192 numbers: mean colour in 4 x 4 fields, and the mean strength of edges in four directions and of four sizes in
    3 x 3 fields. Edges are derivatives of a Gaussian times its size (Lindeberg, Feature Detection with Automatic Scale
    Selection, IJCV 30, 1998), which makes sizes alike. All of it is on 128 x 128 px, in tenths of the way from black to
    white.
    """

    name = "bank"

    def __call__(self, pictures: U8) -> F64:
        """(N, H, W, 3) sRGB -> (N, 192)."""
        return np.stack([_features(picture) for picture in pictures])

    def note(self) -> Mapping[str, Any]:
        """Its version and size."""
        return {
            "name": "bank 1",
            "features": 3 * COLOURS**2 + len(SIZES) * len(TURNS) * EDGES**2,
        }


def _features(picture: U8) -> F64:
    way = cv2.INTER_AREA if min(picture.shape[:2]) >= BANK_SIDE else cv2.INTER_LINEAR
    rgb = cv2.resize(picture, (BANK_SIDE, BANK_SIDE), interpolation=way).astype(
        np.float32
    ) * np.float32(WHITE / 255)
    grey = rgb @ LUMA
    parts = [_fields(rgb, COLOURS)]
    for size in SIZES:
        soft = cv2.GaussianBlur(grey, (0, 0), size, borderType=cv2.BORDER_REFLECT_101)
        across = cv2.Sobel(soft, cv2.CV_32F, 1, 0, ksize=3, scale=size / 8)
        down = cv2.Sobel(soft, cv2.CV_32F, 0, 1, ksize=3, scale=size / 8)
        edges = [np.abs(np.cos(turn) * across + np.sin(turn) * down) for turn in TURNS]
        parts.append(_fields(np.stack(edges, axis=2).astype(np.float32), EDGES))
    return np.concatenate(parts).astype(np.float64)


def _fields(maps: F32, count: int) -> F32:
    """Means of (H, W, C) in `count` x `count` fields, (count² C,)."""
    return np.asarray(
        cv2.resize(maps, (count, count), interpolation=cv2.INTER_AREA), np.float32
    ).ravel()
