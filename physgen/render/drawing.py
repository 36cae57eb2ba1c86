"""Anti-aliased lines, areas, text, arrows and other marks on a picture: light ink in a thin dark casing.

Marks are drawn four times as fine, each in a box of its own, and averaged: places and widths are kept to a sixteenth of
a pixel, so that nothing trembles as it moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import ceil, floor, pi

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from physgen.photometry import decode, encode_u8

Array = NDArray[np.float64]
F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]
Colour = tuple[int, int, int]
"""sRGB."""

FINE = 4
"""Sub-pixels a side."""
BITS = 4
"""Of a sub-pixel, that OpenCV keeps of a place."""
BOX = 160
"""px a side of the boxes into which long lines are cut: what is drawn fine is large."""
LEVELS = 16
"""Of fading."""
CASING: Colour = (18, 20, 26)
OPAQUE = 0.78
"""Of the casing."""


class Layer:
    """Ink of one colour, and its casing, on a canvas of `size` (W, H) px. What crosses in a layer merges."""

    def __init__(self, size: tuple[int, int], casing: float) -> None:
        """`casing` px of dark around each mark."""
        self._casing = casing
        self._width, self._height = size
        self._ink = np.zeros((self._height, self._width), np.uint8)
        self._dark = np.zeros((self._height, self._width), np.uint8)
        self._touched = self._width, self._height, 0, 0

    def line(self, points: Array, width: float, strength: float = 1.0, closed: bool = False) -> None:
        """A chain of segments through (K, 2) px."""
        ends = np.concatenate([points, points[:1]]) if closed else points
        self.segments(ends[:-1], ends[1:], width, np.full(len(ends) - 1, strength))

    def segments(self, begins: Array, ends: Array, width: float, strengths: Array) -> None:
        """(K, 2) px to (K, 2) px, each of a strength (K,) in 0..1; stronger ones lie on top."""
        margin = width + self._casing + 1
        low, high = np.full(2, -margin), np.array([self._width, self._height]) - 1 + margin
        begins, ends, within = clip_segments(begins, ends, low, high)
        if within.any():
            levels = np.ceil(strengths[within] * LEVELS).astype(np.int64)
            self._split(begins[within], ends[within], width, levels, margin)

    def _split(
        self, begins: Array, ends: Array, width: float, levels: NDArray[np.int64], margin: float
    ) -> None:
        """Halves until the boxes are small."""
        both = np.concatenate([begins, ends])
        spread = np.ptp(both, axis=0)
        if spread.max() > BOX and len(begins) > 1:
            half = len(begins) // 2
            for part in (slice(None, half), slice(half, None)):
                self._split(begins[part], ends[part], width, levels[part], margin)
            return
        chains = np.stack([begins, ends], axis=1)
        for mask, more in ((self._dark, 2 * self._casing), (self._ink, 0.0)):
            fine, box = self._fine(both, margin)
            for level in np.unique(levels).tolist():
                placed = list(_fixed(chains[levels == level], box))
                value = round(level * 255 / LEVELS)
                cv2.polylines(fine, placed, False, value, _thick(width + more), cv2.LINE_AA, BITS)
            self._lay(mask, fine, box)

    def area(self, points: Array, strength: float = 1.0) -> None:
        """A filled outline (K, 2) px, small against the canvas."""
        margin = self._casing + 1
        if (points.max(axis=0) < -margin).any() or (points.min(axis=0) - margin > self._far()).any():
            return
        if np.abs(points).max() > 1e5:
            return
        value = round(255 * strength)
        for mask, more in ((self._dark, 2 * self._casing), (self._ink, 0.0)):
            fine, box = self._fine(points, margin)
            placed = _fixed(points, box)
            cv2.fillPoly(fine, [placed], value, cv2.LINE_AA, BITS)
            if more:
                cv2.polylines(fine, [placed], True, value, _thick(more), cv2.LINE_AA, BITS)
            self._lay(mask, fine, box)

    def words(self, text: str, at: tuple[float, float], size: float) -> None:
        """Text of `size` px whose middle is `at` x, y px; the middle of its small letters, not of its tails."""
        ink, dark, (x, y) = text_masks(text, round(size * FINE), round(1.4 * self._casing * FINE))
        left, top = round((at[0] + 0.5) * FINE - x), round((at[1] + 0.5) * FINE - y)
        x0, y0 = left // FINE, top // FINE
        around = (
            (top - y0 * FINE, -(top + ink.shape[0]) % FINE),
            (left - x0 * FINE, -(left + ink.shape[1]) % FINE),
        )
        for mask, letters in ((self._dark, dark), (self._ink, ink)):
            fine = np.pad(letters, around)
            box = (x0, y0, x0 + fine.shape[1] // FINE, y0 + fine.shape[0] // FINE)
            self._lay(mask, fine, box)

    def onto(self, rgb: U8, colour: Colour, casing: float = OPAQUE) -> None:
        """Blend into a picture (H, W, 3) sRGB, in linear light; pixels without ink stay as they are."""
        x0, y0, x1, y1 = self._touched
        if x0 >= x1:
            return
        dark, ink = (np.ascontiguousarray(mask[y0:y1, x0:x1]).ravel() for mask in (self._dark, self._ink))
        there = np.flatnonzero(dark | ink)
        part = np.ascontiguousarray(rgb[y0:y1, x0:x1]).reshape(-1, 3)
        light = decode(part[there])
        light += dark[there, None] * np.float32(casing / 255) * (_light(CASING) - light)
        light += ink[there, None] * np.float32(1 / 255) * (_light(colour) - light)
        part[there] = encode_u8(light)
        rgb[y0:y1, x0:x1] = part.reshape(y1 - y0, x1 - x0, 3)

    def _far(self) -> Array:
        return np.array([self._width, self._height], np.float64)

    def _fine(self, points: Array, margin: float) -> tuple[U8, tuple[int, int, int, int]]:
        """An empty fine mask for a box x0, y0, x1, y1 around the points."""
        (x0, y0), (x1, y1) = points.min(axis=0) - margin, points.max(axis=0) + margin
        box = floor(x0), floor(y0), ceil(x1) + 1, ceil(y1) + 1
        return np.zeros(((box[3] - box[1]) * FINE, (box[2] - box[0]) * FINE), np.uint8), box

    def _lay(self, mask: U8, fine: U8, box: tuple[int, int, int, int]) -> None:
        """The averages of a fine mask, where there is more of them than there was, and as far as they are in sight."""
        x0, y0, x1, y1 = box
        left, top = max(x0, 0), max(y0, 0)
        right, bottom = min(x1, self._width), min(y1, self._height)
        if left >= right or top >= bottom:
            return
        x, y, far_x, far_y = self._touched
        self._touched = min(x, left), min(y, top), max(far_x, right), max(far_y, bottom)
        part = cv2.resize(fine, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA)
        there = mask[top:bottom, left:right]
        np.maximum(there, part[top - y0 : bottom - y0, left - x0 : right - x0], out=there)


def clip_segments(
    begins: Array, ends: Array, low: Array, high: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Segments (K, 2) to (K, 2) as far as they lie in a box, and which do (Liang and Barsky 1984)."""
    way = ends - begins
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (low - begins) / way, (high - begins) / way
    level = way == 0
    inside = (begins >= low) & (begins <= high)
    enter = np.where(level, np.where(inside, -np.inf, np.inf), np.minimum(first, second))
    leave = np.where(level, np.where(inside, np.inf, -np.inf), np.maximum(first, second))
    start, stop = np.maximum(enter.max(axis=1), 0.0), np.minimum(leave.min(axis=1), 1.0)
    within = start <= stop
    start, stop = (np.where(within, part, 0.0)[:, None] for part in (start, stop))
    return begins + start * way, begins + stop * way, within


@lru_cache(maxsize=1024)
def text_masks(text: str, size: int, casing: int) -> tuple[U8, U8, tuple[float, float]]:
    """Masks (h, w) of a line of text and of its casing, in sub-pixels, and where in them its middle is."""
    font = ImageFont.load_default(size)
    left, _, right, _ = font.getbbox(text, anchor="ls")
    up, down = ceil(0.95 * size), ceil(0.3 * size)
    width, height = ceil(right - left) + 2 * casing + 2, up + down + 2 * casing + 2
    masks = []
    for stroke in (0, casing):
        picture = Image.new("L", (width, height))
        draw = ImageDraw.Draw(picture)
        draw.text((casing + 1 - left, casing + 1 + up), text, 255, font, anchor="ls", stroke_width=stroke)
        masks.append(np.asarray(picture, np.uint8))
    return masks[0], masks[1], (width / 2, casing + 1 + up - 0.3 * size)


def text_width(text: str, size: float) -> float:
    """px that a line of text takes."""
    ink, _, _ = text_masks(text, round(size * FINE), 0)
    return float(ink.shape[1] / FINE)


def _thick(width: float) -> int:
    return max(1, round(width * FINE))


def _fixed(points: Array, box: tuple[int, int, int, int]) -> NDArray[np.int32]:
    """px -> sub-pixels of a box in OpenCV's fixed point; whole numbers are centres of pixels in both."""
    fine = (points - np.array(box[:2]) + 0.5) * FINE - 0.5
    return np.asarray(np.rint(fine * 2**BITS), np.int32)


def _light(colour: Colour) -> F32:
    return decode(np.array(colour, np.uint8))


SHAFT = 1.5
"""Pens: the width of an arrow's shaft."""
HEAD = 4.6
"""Widths of its shaft that an arrow's head is long."""


def arrow(tail: Array, tip: Array, width: float) -> Array:
    """(7, 2) px: the outline of an arrow whose point is at `tip`; a short one is a small head on a short shaft."""
    way = tip - tail
    length = float(np.hypot(*way))
    across = np.array([-way[1], way[0]]) / length
    point = head(tip, way, min(HEAD * width, 0.62 * length))
    root = (point[0] + point[2]) / 2
    neck = root + 0.1 * (tip - root)  # barbs point back a little
    half = min(width / 2, 0.15 * float(np.hypot(*(point[2] - point[0])))) * across
    return np.array([tail + half, neck + half, *point[::-1], neck - half, tail - half])


def head(tip: Array, way: Array, length: float) -> Array:
    """(3, 2) px: barb, point and barb of an arrow's head that looks along `way`."""
    along = way / float(np.hypot(*way))
    across = 0.46 * length * np.array([-along[1], along[0]])
    return np.array([tip - length * along - across, tip, tip - length * along + across])


def circle(center: Sequence[float] | Array, radius: float) -> Array:
    """(K, 2) px of a circle, close enough that no chord shows."""
    count = min(max(16, ceil(pi * np.sqrt(max(radius, 1.0) * 10))), 720)
    angles = np.arange(count) * (2 * pi / count)
    return np.asarray(center + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1), np.float64)


def arc(center: Array, radius: float, sweep: float) -> Array:
    """(K, 2) px of an arc with its middle at the top, that sweeps rad from +x towards +y where positive."""
    angles = -pi / 2 + np.linspace(-sweep / 2, sweep / 2, max(3, ceil(24 * abs(sweep))))
    return np.asarray(center + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1), np.float64)


def straight_arrow(
    layer: Layer, tail: Array, tip: Array, pen: float, strength: float = 1.0, *, struck: bool = False
) -> None:
    """An arrow from a dot; from a ring where something was struck: an impulse, no lasting force."""
    if struck:
        layer.line(circle(tail, 2.6 * pen), pen, strength, closed=True)
    layer.area(circle(tail, min(1.1 * pen, 0.15 * float(np.hypot(*(tip - tail))))), strength)
    layer.area(arrow(tail, tip, SHAFT * pen), strength)


def curved_arrow(layer: Layer, path: Array, pen: float, strength: float = 1.0) -> None:
    """An arrow along a path (K, 2) px, K >= 3; its point is at the path's end."""
    steps = np.hypot(*np.diff(path, axis=0).T)
    length = min(HEAD * SHAFT * pen, 0.62 * float(steps.sum()))
    # the head looks along its own chord of the path, and the shaft ends within it
    left = np.cumsum(steps[::-1])[::-1]
    root = int(np.flatnonzero(left >= 0.8 * length)[-1])
    layer.line(path[: root + 1], SHAFT * pen, strength)
    layer.area(head(path[-1], path[-1] - path[root], length), strength)


def ring(layer: Layer, center: Array, radius: float, pen: float, strength: float = 1.0) -> None:
    """A ring with a dot in its middle: an impact."""
    layer.line(circle(center, radius), 0.8 * pen, strength, closed=True)
    layer.area(circle(center, min(1.5 * pen, radius / 2)), strength)


def plate(rgb: U8, box: tuple[float, float, float, float], radius: float, opaque: float) -> None:
    """Darken a box x0, y0, x1, y1 px with round corners in a picture (H, W, 3), for words to stand on."""
    layer = Layer((rgb.shape[1], rgb.shape[0]), 0.0)
    x0, y0, x1, y1 = box
    turns = np.linspace(0, 2 * pi, 33)
    rounds = radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    right, left, low, high = x1 - radius, x0 + radius, y1 - radius, y0 + radius
    middles = ((right, low), (left, low), (left, high), (right, high))
    layer.area(
        np.concatenate([rounds[8 * k : 8 * k + 9] + middle for k, middle in enumerate(middles)]), opaque
    )
    layer.onto(rgb, CASING)
