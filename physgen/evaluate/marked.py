"""A judged photo -> a picture to look at: what is found, missed and falsely said, each with its confidence."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.matching import Patch
from physgen.evaluate.segmentation import Photo
from physgen.geometry.regions import trace_borders, walk
from physgen.render.drawing import Layer, text_width

U8 = NDArray[np.uint8]
Floats = NDArray[np.float64]

LEAST, MOST = 960, 1920
"""px: the longer side of a picture."""
FOUND, MISSED, FALSE = (86, 190, 255), (250, 226, 70), (255, 96, 70)
"""sRGB, after Okabe and Ito's palette."""
WORDS = (255, 255, 255)
PAPER = (24, 26, 32)
"""sRGB of the strip that holds the key."""
PEN, LETTER = 1 / 420, 1 / 52
"""Of the picture's longer side."""


def marked(photo: Photo) -> U8:
    """(H, W, 3) sRGB: the photo, larger where it is small, with outlines over it and the key above."""
    rgb = photo.truth.rgb
    longer = max(rgb.shape[:2])
    scale = max(LEAST / longer, 1.0) if longer < LEAST else min(MOST / longer, 1.0)
    size = max(1, round(rgb.shape[1] * scale)), max(1, round(rgb.shape[0] * scale))
    method = cv2.INTER_CUBIC if scale > 1 else cv2.INTER_AREA
    picture = np.asarray(cv2.resize(rgb, size, interpolation=method) if scale != 1 else rgb.copy(), np.uint8)
    zoom = size[0] / rgb.shape[1], size[1] / rgb.shape[0]
    pen, letter = max(1.3, PEN * max(size)), max(10.0, LETTER * max(size))
    judged, (masks, confidence) = photo.judged["all"][0], photo.said
    right = [k for k, hit in enumerate(judged.right.tolist()) if hit]
    false = [k for k, hit in enumerate(judged.right.tolist()) if not hit]
    missed = [photo.truth.masks[j] for j in judged.missed]
    for patches, colour in (
        ([masks[k] for k in right], FOUND),
        (missed, MISSED),
        ([masks[k] for k in false], FALSE),
    ):
        layer = Layer(size, 0.75 * pen)
        for patch in patches:
            for ring in rings(patch):
                layer.line((ring + 0.5) * zoom - 0.5, pen, closed=True)
        layer.onto(picture, colour)
    words = Layer(size, 0.75 * pen)
    for k, patch in enumerate(masks):
        text = f"{confidence[k]:.2f}"
        room = patch.mask.shape[1] * zoom[0] / text_width(text, letter)
        middle = (inmost(patch) + 0.5) * zoom - 0.5
        words.words(text, (float(middle[0]), float(middle[1])), letter * min(1.0, max(room, 0.6)))
    words.onto(picture, WORDS)
    key = (
        (f"found {len(right)}", FOUND),
        (f"missed {len(missed)}", MISSED),
        (f"false {len(false)}", FALSE),
        ("numbers: confidence", WORDS),
    )
    return np.concatenate([_strip(size[0], letter, key), picture])


def rings(patch: Patch) -> list[Floats]:
    """Its outlines (K, 2) px of the photo, holes too: within a pixel of the pixels' border, without its stairs."""
    if not patch.mask.any():
        return []
    found = trace_borders(patch.mask.astype(np.uint8))
    lines = tuple(border.middles for border in found.borders)
    closed = [border.closed for border in found.borders]
    corner = np.array([patch.x, patch.y], np.float64)
    return [_calm(walk(loop, lines, closed)) + corner for loop in found.loops.get(1, ())]


def _calm(ring: Floats) -> Floats:
    """(K, 2), each point drawn to its neighbours, three times: for the eye only."""
    for _ in range(3):
        ring = (np.roll(ring, 1, axis=0) + 2 * ring + np.roll(ring, -1, axis=0)) / 4
    return ring


def inmost(patch: Patch) -> Floats:
    """(2,) px of the photo: the pixel of a mask farthest from its outline."""
    if not patch.mask.any():
        return np.array([patch.x, patch.y], np.float64)
    depth = cv2.distanceTransform(np.pad(patch.mask, 1).astype(np.uint8), cv2.DIST_L2, 5)
    row, column = np.unravel_index(int(depth.argmax()), depth.shape)
    return np.array([patch.x + int(column) - 1, patch.y + int(row) - 1], np.float64)


def _strip(width: int, letter: float, key: tuple[tuple[str, tuple[int, int, int]], ...]) -> U8:
    """(h, W, 3): words of the key beside each other, smaller where the picture is narrow."""
    gap = 1.5
    whole = sum(text_width(text, letter) for text, _ in key) + gap * letter * (len(key) + 1)
    letter *= min(1.0, width / whole)
    tall = max(2, round(2 * letter))
    strip = np.full((tall, width, 3), PAPER, np.uint8)
    x = gap * letter
    for text, colour in key:
        layer = Layer((width, tall), 0.0)
        wide = text_width(text, letter)
        layer.words(text, (x + wide / 2, tall / 2), letter)
        layer.onto(strip, colour)
        x += wide + gap * letter
    return strip
