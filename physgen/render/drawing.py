"""Anti-aliased lines, areas, text, arrows and other marks: light ink in a thin dark
casing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from math import ceil, pi

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Array
from physgen.maps import F32, U8
from physgen.photometry import decode, encode_u8

Colour = tuple[int, int, int]
"""SRGB, 0..255."""

FINE = 3
"""Sub-pixels per side: widths are exact to a third of a pixel."""
BITS = 4
"""Fractional bits of a sub-pixel in OpenCV's coordinates, so that moving marks do not
tremble.
"""
FARTHEST = 1e6
"""Largest distance of marks from the picture, px; others are not drawn."""
CASING: Colour = (18, 20, 26)
OPAQUE = 0.78
"""Opacity of the casing."""


class Layer:
    """Ink of one colour, and its casing, on a canvas of `size` (W, H) px.

    Crossing marks of one layer merge.
    """

    def __init__(self, size: tuple[int, int], casing: float) -> None:
        """Create an empty layer; `casing` px of dark around each mark."""
        self._casing, self._size = casing, size
        self._ink = np.zeros((size[1] * FINE, size[0] * FINE), np.uint8)
        self._dark = np.zeros_like(self._ink)

    def line(
        self,
        points: Array,
        width: float,
        strength: float = 1.0,
        is_polygon: bool = False,
    ) -> None:
        """Draw a chain of segments through (K, 2) px."""
        self._lines(points[None], width, 255 * strength, is_polygon)

    def segments(
        self, begins: Array, ends: Array, width: float, strengths: Array
    ) -> None:
        """Draw segments from (K, 2) px to (K, 2) px with strengths (K,) in 0..1.

        Stronger segments are on top.
        """
        chains = np.stack([begins, ends], axis=1)
        levels = np.ceil(strengths * 16) * (255 / 16)
        for level in np.unique(levels).tolist():
            self._lines(chains[levels == level], width, level, False)

    def _lines(
        self, chains: Array, width: float, level: float, is_polygon: bool
    ) -> None:
        """Draw chains (K, N, 2) px."""
        is_near = np.abs(chains).max(axis=(1, 2)) < FARTHEST
        corners = list(_to_fixed_point(chains[is_near]))
        grey = round(level)
        for mask, casing_width in ((self._dark, 2 * self._casing), (self._ink, 0.0)):
            thickness = _convert_line_width(width + casing_width)
            line_type = cv2.LINE_AA
            cv2.polylines(mask, corners, is_polygon, grey, thickness, line_type, BITS)

    def area(self, points: Array, strength: float = 1.0) -> None:
        """Draw a filled outline (K, 2) px."""
        if np.abs(points).max() >= FARTHEST:
            return
        corners = [_to_fixed_point(points)]
        level = round(255 * strength)
        kind = cv2.LINE_AA
        cv2.fillPoly(self._ink, corners, level, kind, BITS)
        cv2.fillPoly(self._dark, corners, level, kind, BITS)
        if self._casing:
            thickness = _convert_line_width(2 * self._casing)
            cv2.polylines(self._dark, corners, True, level, thickness, kind, BITS)

    def words(self, text: str, place: tuple[float, float], size: float) -> None:
        """Write text of `size` px with its middle `place` x, y px.

        The middle is that of small letters without descenders.
        """
        casing = round(1.4 * self._casing * FINE)
        ink, casing_mask, (x, y) = text_masks(text, round(size * FINE), casing)
        left = round((place[0] + 0.5) * FINE - x)
        top = round((place[1] + 0.5) * FINE - y)
        _stamp(self._dark, casing_mask, left, top)
        _stamp(self._ink, ink, left, top)

    def blend(self, rgb: U8, colour: Colour, casing: float = OPAQUE) -> None:
        """Blend the layer into a picture (H, W, 3) sRGB, in linear light.

        Pixels without ink stay as they are.
        """
        corner_and_size = self._ink_box()
        if corner_and_size is None:
            return
        (x0, y0), size = corner_and_size
        casing_coverage = _reduce(self._dark, (x0, y0), size)
        ink = _reduce(self._ink, (x0, y0), size)
        is_marked = (casing_coverage > 0) | (ink > 0)
        part = rgb[y0 : y0 + size[1], x0 : x0 + size[0]]
        light = decode(part[is_marked])
        # A dark casing below the ink keeps lines visible on any background.
        casing_share = casing_coverage[is_marked][:, None] * np.float32(casing / 255)
        light += casing_share * (_light(CASING) - light)
        ink_share = ink[is_marked][:, None] * np.float32(1 / 255)
        light += ink_share * (_light(colour) - light)
        part[is_marked] = encode_u8(light)

    def _ink_box(self) -> tuple[tuple[int, int], tuple[int, int]] | None:
        """Return the corner and the size (w, h), px, of the box with ink, if any.

        Only this box is resampled; most layers are nearly empty.
        """
        x, y, width, height = cv2.boundingRect(self._dark)
        if not width:
            return None
        x0, y0 = x // FINE, y // FINE
        x1 = -(-(x + width) // FINE)
        y1 = -(-(y + height) // FINE)
        return (x0, y0), (x1 - x0, y1 - y0)


def _reduce(mask: U8, corner: tuple[int, int], size: tuple[int, int]) -> U8:
    """Return a box of a fine mask in pixels, (h, w)."""
    (x, y), (width, height) = corner, size
    box = np.s_[y * FINE : (y + height) * FINE, x * FINE : (x + width) * FINE]
    return np.asarray(
        cv2.resize(mask[box], size, interpolation=cv2.INTER_AREA), np.uint8
    )


def _stamp(mask: U8, letters: U8, left: int, top: int) -> None:
    """Add letters (h, w) to a mask (H, W) at a place that may lie partly outside."""
    height, width = letters.shape
    x0 = max(left, 0)
    y0 = max(top, 0)
    canvas = mask[y0 : max(top + height, 0), x0 : max(left + width, 0)]
    part = letters[y0 - top :, x0 - left :][: canvas.shape[0], : canvas.shape[1]]
    np.maximum(canvas, part, out=canvas)


@lru_cache(maxsize=1024)
def text_masks(text: str, size: int, casing: int) -> tuple[U8, U8, tuple[float, float]]:
    """Return masks (h, w) of a line of text and of its casing, in sub-pixels, and their
    middle.
    """
    # Few pictures have words on them: import the fonts only then.
    from PIL import Image, ImageDraw, ImageFont

    font = ImageFont.load_default(size)
    left, _, right, _ = font.getbbox(text, anchor="ls")
    ascent = ceil(0.95 * size)
    descent = ceil(0.3 * size)
    width = ceil(right - left) + 2 * casing + 2
    height = ascent + descent + 2 * casing + 2
    start = (casing + 1 - left, casing + 1 + ascent)
    masks = []
    for stroke in (0, casing):
        picture = Image.new("L", (width, height))
        draw = ImageDraw.Draw(picture)
        draw.text(start, text, 255, font, anchor="ls", stroke_width=stroke)
        masks.append(np.asarray(picture, np.uint8))
    return masks[0], masks[1], (width / 2, casing + 1 + ascent - 0.3 * size)


def text_width(text: str, size: float) -> float:
    """Return the width of a line of text, px."""
    ink, _, _ = text_masks(text, round(size * FINE), 0)
    return float(ink.shape[1] / FINE)


def _convert_line_width(width: float) -> int:
    """Convert a width from px to sub-pixels, at least 1."""
    return max(1, round(width * FINE))


def _to_fixed_point(points: Array) -> NDArray[np.int32]:
    """Convert px to sub-pixels in OpenCV's fixed point.

    Whole numbers are centres of pixels in both.
    """
    return np.asarray(np.rint(((points + 0.5) * FINE - 0.5) * 2**BITS), np.int32)


def _light(colour: Colour) -> F32:
    """Return the linear light of a colour, (3,)."""
    return decode(np.array(colour, np.uint8))


SHAFT = 1.5
"""Width of an arrow's shaft, pens."""
HEAD = 4.6
"""Length of an arrow's head, widths of its shaft."""


def arrow(tail: Array, tip: Array, width: float) -> Array:
    """Return the outline (7, 2) px of an arrow with its point at `tip`.

    A short arrow is a small head on a short shaft.
    """
    vector = tip - tail
    length = float(np.hypot(*vector))
    normal = np.array([-vector[1], vector[0]]) / length
    # The head shrinks with a short arrow, so that some shaft remains.
    point = head(tip, vector, min(HEAD * width, 0.62 * length))
    root = (point[0] + point[2]) / 2
    neck = root + 0.1 * (tip - root)  # barbs point back a little
    head_width = float(np.hypot(*(point[2] - point[0])))
    half_width = min(width / 2, 0.15 * head_width) * normal
    return np.array(
        [
            tail + half_width,
            neck + half_width,
            *point[::-1],
            neck - half_width,
            tail - half_width,
        ]
    )


def head(tip: Array, way: Array, length: float) -> Array:
    """Return barb, point and barb (3, 2) px of an arrow's head in the direction
    `way`.
    """
    direction = way / float(np.hypot(*way))
    half_width = 0.46 * length * np.array([-direction[1], direction[0]])
    return np.array(
        [
            tip - length * direction - half_width,
            tip,
            tip - length * direction + half_width,
        ]
    )


def dashes(ring: Array, length: float, gap: float) -> Iterator[Array]:
    """Yield the dashes (K, 2) of a closed outline (N, 2), K >= 2, of nearly equal
    length.
    """
    closed_ring = np.vstack([ring, ring[:1]])
    arc_lengths = np.concatenate(
        [[0.0], np.hypot(*np.diff(closed_ring, axis=0).T).cumsum()]
    )
    total = float(arc_lengths[-1])
    # Adjust the period, so that a whole number of dashes fits the outline.
    count = max(1, round(total / (length + gap)))
    step = total / count
    for number in range(count):
        begin = number * step
        end = begin + step * length / (length + gap)
        # A dash bends at the corners of the outline.
        corners_within = arc_lengths[(arc_lengths > begin) & (arc_lengths < end)]
        stops = np.concatenate([[begin], corners_within, [end]])
        columns = [
            np.interp(stops, arc_lengths, closed_ring[:, axis]) for axis in (0, 1)
        ]
        yield np.stack(columns, axis=1)


def circle(center: Sequence[float] | Array, radius: float) -> Array:
    """Return the corners (K, 2) px of a circle, dense enough to hide the chords."""
    count = min(max(16, ceil(pi * np.sqrt(max(radius, 1.0) * 10))), 720)
    return _on_circle(center, radius, np.arange(count) * (2 * pi / count))


def _on_circle(center: Sequence[float] | Array, radius: float, angles: Array) -> Array:
    """Return points (K, 2) px on a circle."""
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.asarray(center + radius * directions, np.float64)


def arc(center: Array, radius: float, sweep: float) -> Array:
    """Return the points (K, 2) px of an arc with its middle at the top.

    A positive `sweep`, rad, leads from +x towards +y.
    """
    count = max(3, ceil(24 * abs(sweep)))
    angles = -pi / 2 + np.linspace(-sweep / 2, sweep / 2, count)
    return _on_circle(center, radius, angles)


def straight_arrow(
    layer: Layer,
    tail: Array,
    tip: Array,
    pen: float,
    strength: float = 1.0,
    *,
    has_impact: bool = False,
) -> None:
    """Draw an arrow from a dot; an impulse, which is no lasting force, from a ring."""
    if has_impact:
        layer.line(circle(tail, 2.6 * pen), pen, strength, is_polygon=True)
    length = float(np.hypot(*(tip - tail)))
    layer.area(circle(tail, min(1.1 * pen, 0.15 * length)), strength)
    layer.area(arrow(tail, tip, SHAFT * pen), strength)


def curved_arrow(layer: Layer, path: Array, pen: float, strength: float = 1.0) -> None:
    """Draw an arrow along a path (K, 2) px, K >= 3, with its point at the
    path's end.
    """
    steps = np.hypot(*np.diff(path, axis=0).T)
    length = min(HEAD * SHAFT * pen, 0.62 * float(steps.sum()))
    # The head points along its own chord of the path, and the shaft ends within it.
    remaining_lengths = np.cumsum(steps[::-1])[::-1]
    root = int(np.flatnonzero(remaining_lengths >= 0.8 * length)[-1])
    layer.line(path[: root + 1], SHAFT * pen, strength)
    layer.area(head(path[-1], path[-1] - path[root], length), strength)


def ring(
    layer: Layer, center: Array, radius: float, pen: float, strength: float = 1.0
) -> None:
    """Draw a ring with a dot in its middle, the mark of an impact."""
    layer.line(circle(center, radius), 0.8 * pen, strength, is_polygon=True)
    layer.area(circle(center, min(1.5 * pen, radius / 2)), strength)
