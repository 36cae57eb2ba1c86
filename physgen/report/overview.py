"""The overview of a perceived photo: objects, doubtful regions, supports and pushes,
with their names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from physgen.geometry.polygon import Array
from physgen.maps import U8, U16, png_bytes
from physgen.render.drawing import (
    CASING,
    Colour,
    Layer,
    dashes,
    straight_arrow,
    text_width,
)
from physgen.report.perception import (
    DOUBTFUL,
    SUPPORT,
    colour,
    doubt_text,
    mask_rings,
)
from physgen.text import counted

LONGEST, SHORTEST = 1600, 960
"""Maximum and minimum longer side of an overview, px: names stay readable on a small
photo.
"""
DIM = 0.72
"""Share of the photo's codes, so that lines and names stand out."""
PEN = 1 / 420
"""Width of a line over the picture's longer side."""
LETTER = 1 / 52
"""Size of a letter over the picture's longer side."""
SMALLEST_LETTER = 17.0
"""Minimum size of a letter, px, for easy reading at full size."""
COLOURS = 8
"""Number of colours of objects. More are hard to distinguish, and each needs its own
canvas.
"""
DASH, GAP = 7.0, 5.0
"""Lengths of a dash and a gap, in widths of the line."""
PUSH: Colour = (40, 225, 165)
"""Colour of velocities, as in the editor."""
PUSH_TIME = 0.35
"""Time of the motion along an arrow, s: most arrows are as long as their object."""
PUSH_LENGTHS = (0.07, 0.28)
"""Shortest and longest arrow over the picture's longer side."""
ROW = 1.9
"""Height of the text row below the picture, in letters."""
TAG_ROOM = 0.35
"""Margin around a name, in letters."""


@dataclass(frozen=True)
class _Region:
    """An object or a doubtful region on the picture."""

    text: str
    rings: Sequence[Array]
    """Closed outlines (K, 2), px of the picture."""
    box: tuple[float, float, float, float]
    """Left, top, right, bottom, px of the picture."""

    @property
    def center(self) -> Array:
        """Return the centre, px of the picture."""
        left, top, right, bottom = self.box
        return np.array([(left + right) / 2, (top + bottom) / 2])


Velocities = Mapping[str, Sequence[float]]
"""Start velocities x and y, px/s, by the name of the object."""


def overview_png(
    rgb: U8, labels: U16, document: Mapping[str, Any], velocities: Velocities
) -> bytes:
    """Return the overview as a PNG file; see `draw_overview`."""
    return png_bytes(draw_overview(rgb, labels, document, velocities))


def draw_overview(
    rgb: U8, labels: U16, document: Mapping[str, Any], velocities: Velocities
) -> U8:
    """Draw the objects of a scene `document` over the photo (H, W, 3) sRGB.

    `labels` (H, W) has the ids of objects and of doubtful regions. The longer side of
    the picture is SHORTEST to LONGEST px, with the text row below the photo.
    """
    height, width = labels.shape
    longer = max(width, height)
    scale = float(np.clip(1.0, SHORTEST / longer, LONGEST / longer))
    letter = max(SMALLEST_LETTER, LETTER * scale * longer)
    row = round(ROW * letter)
    # The text row counts towards the height of the picture.
    scale = min(scale, (LONGEST - row) / height)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    if scale < 1:
        style = cv2.INTER_AREA
    else:
        style = cv2.INTER_CUBIC
    # The photo is dimmed, so that outlines and names stand out on any background.
    small = cv2.resize(rgb, size, interpolation=style).astype(np.float32)
    picture = np.asarray(DIM * small + 0.5, np.uint8)
    pen = max(1.6, PEN * max(size))
    objects = _regions(labels, document.get("objects", {}), scale)
    doubtful = _regions(labels, document.get("doubtful", {}), scale)
    # The order is from the background to names, which nothing may cover.
    _draw_supports(picture, document.get("boundaries", {}), scale, pen)
    _draw_doubtful(picture, doubtful, pen)
    _draw_objects(picture, objects, pen)
    _draw_pushes(picture, objects, velocities, scale, pen)
    _write_names(picture, [*objects.values(), *doubtful.values()], letter)
    return _with_row(picture, _caption(document, velocities), letter, row)


def _regions(
    labels: U16, entries: Mapping[str, Any], scale: float
) -> dict[str, _Region]:
    """Return the regions with an id in the label map, by name."""
    boxes = _boxes(labels)
    regions = {}
    for name, entry in entries.items():
        id_ = entry.get("mask")
        if not isinstance(id_, int) or id_ not in boxes:
            continue
        left, top, right, bottom = boxes[id_]
        # Trace each mask within its own box only, as photos have many small objects.
        outline = mask_rings(labels[top:bottom, left:right] == id_)
        # Scale about the picture's corner, half a pixel before the first centre.
        offset = np.array([left, top]) + 0.5
        rings = [(ring + offset) * scale - 0.5 for ring in outline]
        corners = (left * scale, top * scale, right * scale, bottom * scale)
        text = doubt_text(name, entry.get("confidence"))
        regions[name] = _Region(text, rings, corners)
    return regions


def _boxes(labels: U16) -> dict[int, tuple[int, int, int, int]]:
    """Return left, top, right and bottom px of every id; right and bottom are
    exclusive.
    """
    # One pass over all labelled pixels finds the boxes of all ids; a pass for each id
    # would take longer.
    rows, columns = np.nonzero(labels)
    ids = labels[rows, columns]
    count = int(labels.max(initial=0)) + 1
    low = np.full((2, count), max(labels.shape), np.int64)
    high = np.full((2, count), -1, np.int64)
    for axis, places in enumerate((columns, rows)):
        np.minimum.at(low[axis], ids, places)
        np.maximum.at(high[axis], ids, places)
    boxes = {}
    for id_ in np.flatnonzero(high[0] >= 0).tolist():
        (left, top), (right, bottom) = low[:, id_].tolist(), high[:, id_].tolist()
        boxes[id_] = left, top, right + 1, bottom + 1
    return boxes


def _size(picture: U8) -> tuple[int, int]:
    return picture.shape[1], picture.shape[0]


def _draw_supports(
    picture: U8, boundaries: Mapping[str, Any], scale: float, pen: float
) -> None:
    """Draw boundaries, without the photo's lower border: every scene has it."""
    layer = Layer(_size(picture), 0.6 * pen)
    for name, entry in boundaries.items():
        points = entry.get("segment") or entry.get("polyline")
        if name == "bottom" or not points:
            continue
        layer.line((np.array(points, np.float64) + 0.5) * scale - 0.5, 1.3 * pen)
    layer.blend(picture, SUPPORT)


def _draw_doubtful(picture: U8, regions: Mapping[str, _Region], pen: float) -> None:
    layer = Layer(_size(picture), 0.6 * pen)
    for region in regions.values():
        for ring in region.rings:
            for dash in dashes(ring, DASH * pen, GAP * pen):
                layer.line(dash, pen)
    layer.blend(picture, DOUBTFUL)


def _draw_objects(picture: U8, regions: Mapping[str, _Region], pen: float) -> None:
    # One canvas per colour: a canvas per object would be slow.
    for number in range(COLOURS):
        layer = Layer(_size(picture), 0.6 * pen)
        for region in list(regions.values())[number::COLOURS]:
            for ring in region.rings:
                layer.line(ring, 1.3 * pen, is_polygon=True)
        layer.blend(picture, colour(number + 1))


def _draw_pushes(
    picture: U8,
    regions: Mapping[str, _Region],
    velocities: Velocities,
    scale: float,
    pen: float,
) -> None:
    """Draw the start velocity of each moving object from its centre."""
    longer = max(_size(picture))
    layer = Layer(_size(picture), pen)
    for name, region in regions.items():
        way = PUSH_TIME * scale * np.array(velocities.get(name, (0, 0)), np.float64)
        length = float(np.hypot(*way))
        if not length:
            continue
        min_length, max_length = (share * longer for share in PUSH_LENGTHS)
        # Slow pushes stay visible, and fast ones stay inside the picture.
        way *= float(np.clip(length, min_length, max_length)) / length
        tail = region.center
        straight_arrow(layer, tail, tail + way, 2.2 * pen)
    layer.blend(picture, PUSH)


Box = tuple[float, float, float, float]


def _write_names(picture: U8, regions: Sequence[_Region], letter: float) -> None:
    """Write each name on a dark tag near its region, without covering other names."""
    room = TAG_ROOM * letter
    tags, words = Layer(_size(picture), 0.0), Layer(_size(picture), 0.0)
    places: list[Box] = []
    for region in regions:
        width = text_width(region.text, letter) + 2 * room
        high = letter + 2 * room
        # Tags are placed one after the other: each one avoids those before it.
        box = _place(region, (width, high), _size(picture), places)
        places.append(box)
        left, top, right, bottom = box
        corners = [[left, top], [right, top], [right, bottom], [left, bottom]]
        tags.area(np.array(corners))
        words.words(region.text, ((left + right) / 2, (top + bottom) / 2), letter)
    tags.blend(picture, CASING)
    words.blend(picture, (255, 255, 255))


def _place(
    region: _Region,
    size: tuple[float, float],
    picture: tuple[int, int],
    occupied_boxes: Sequence[Box],
) -> Box:
    """Return the box of a tag: above, below, inside or beside its region.

    Choose the first position without overlap, or the position with the smallest
    overlap.
    """
    (width, high), (left, top, right, bottom) = size, region.box
    x, y = region.center
    # In order of preference: a tag above its object hides the least of the picture.
    centers = (
        (x, top - high / 2),
        (x, bottom + high / 2),
        (x, y),
        (left - width / 2, y),
        (right + width / 2, y),
        (x, top + high / 2),
        (x, bottom - high / 2),
        (left + width / 2, top - high / 2),
        (right - width / 2, bottom + high / 2),
    )
    best: tuple[float, Box] | None = None
    for a, b in centers:
        # The whole tag must be inside the picture.
        a = min(max(a, width / 2), picture[0] - width / 2)
        b = min(max(b, high / 2), picture[1] - high / 2)
        box = a - width / 2, b - high / 2, a + width / 2, b + high / 2
        overlap = sum(_overlap(box, other) for other in occupied_boxes)
        if best is None or overlap < best[0]:
            best = overlap, box
    assert best is not None
    return best[1]


def _overlap(first: Box, second: Box) -> float:
    """Return the common area of two boxes, px²."""
    width = min(first[2], second[2]) - max(first[0], second[0])
    high = min(first[3], second[3]) - max(first[1], second[1])
    return max(width, 0.0) * max(high, 0.0)


def _caption(document: Mapping[str, Any], velocities: Velocities) -> str:
    """Return the line of text below the photo."""
    parts = [counted(len(document.get("objects", {})), "object")]
    if doubtful := len(document.get("doubtful", {})):
        parts.append(f"{doubtful} perhaps (dashed)")
    names = []
    for name in document.get("boundaries", {}):
        if name != "bottom":
            names.append(name)
    if names:
        parts.append(f"{counted(len(names), 'support')} (yellow)")
    view = document.get("world", {}).get("view")
    if view in _VIEWS:
        parts.append(f"seen from {_VIEWS[view]}")
    pushes = []
    for name, velocity in velocities.items():
        if any(velocity):
            pushes.append(name)
    parts.append(f"pushed: {', '.join(pushes)}" if pushes else "nothing is pushed")
    return " · ".join(parts)


_VIEWS = {"side": "the side", "top": "above"}


def _with_row(picture: U8, text: str, letter: float, row: int) -> U8:
    """Return the picture with a line of text below it. Letters shrink for a
    long line.
    """
    width = picture.shape[1]
    band = np.full((row, width, 3), CASING, np.uint8)
    room = 0.96 * width / text_width(text, letter)
    layer = Layer((width, row), 0.0)
    layer.words(text, (width / 2, row / 2), letter * min(1.0, room))
    layer.blend(band, (235, 238, 242))
    return np.vstack([picture, band])
