"""The size of photos: the smallest photo, and photos with fewer pixels."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from physgen.messages import Message
from physgen.perceive.roles import (
    Detections,
    Rgb,
)
from physgen.photometry import decode, encode_u8

# px; the shadow search computes slopes at a coarse scale.
SMALLEST_SIDE = 8

# px, by default: more than most screens show, and perception still takes seconds.
LONGEST_SIDE = 1600


def check_size(rgb: Rgb, file: str = "the photo") -> None:
    """Raise InputError if a photo is too small."""
    if min(rgb.shape[:2]) < SMALLEST_SIDE:
        found_size = f"{rgb.shape[1]} x {rgb.shape[0]} px"
        raise Message.PHOTO_TOO_SMALL.error(file, found_size, least=SMALLEST_SIDE)


def shrink_photo(rgb: Rgb, side: int) -> Rgb:
    """Return the photo (H, W, 3) with a longer side of at most `side` px.

    Areas are averaged in linear light, as in a camera with fewer pixels.
    """
    height, width = rgb.shape[:2]
    scale = side / max(height, width)
    if scale >= 1:
        return rgb
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    light = (
        decode(np.arange(256, dtype=np.uint8)) * np.float32(65535) + np.float32(0.5)
    ).astype(np.uint16)
    small = np.empty((size[1], size[0], 3), np.uint8)
    # Channels are reduced one by one, since linear light takes twice the memory of the
    # photo.
    for c in range(3):
        mean = cv2.resize(
            cv2.LUT(cv2.extractChannel(rgb, c), light),
            size,
            interpolation=cv2.INTER_AREA,
        )
        small[:, :, c] = encode_u8(mean.astype(np.float32) / np.float32(65535))
    return small


def shrink_detections(
    detections: Detections, full: tuple[int, int], rgb: Rgb
) -> Detections:
    """Return detections of a photo of `full` width and height, px, for the smaller
    `rgb`.

    Detections of another size stay as they are.
    """
    size = (rgb.shape[1], rgb.shape[0])
    if size == full or detections.labels.shape != full[::-1]:
        return detections
    labels = cv2.resize(detections.labels, size, interpolation=cv2.INTER_NEAREST_EXACT)
    return replace(detections, labels=np.asarray(labels, np.uint16))
