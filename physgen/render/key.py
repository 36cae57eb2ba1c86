"""The key of a clip's overlays: a sample of each scale with its round number, where the clip leaves room."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.render.ink import Layer, breadth
from physgen.render.marks import arc, curved_arrow, plate, ring, straight_arrow
from physgen.render.scales import COLOURS, Entry
from physgen.render.sheet import Sheet
from physgen.scene.model import Load, Overlay
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]
U8 = NDArray[np.uint8]

OPAQUE = 0.74
WORDS = (255, 255, 255)
ROW = 1.6
"""Letters from line to line."""
PAD, SIDE, GAP = 0.4, 0.9, 0.8
"""Letters of room above and below, at the sides, and between samples and words."""
LARGEST = 0.85
"""Of a picture's side: a key that is longer is left out."""
ARC = 1.1
"""Letters: the radius of a torque's sample."""
CORNERS = ((0, 0), (1, 0), (0, 1), (1, 1))
"""0 left and top, 1 right and bottom; the first of several that are as good."""


def emptiest_corner(
    world: World, seen: Trajectory, sheet: Sheet, entries: Sequence[Entry]
) -> tuple[int, int]:
    """The corner where the key hides fewest objects, over the whole clip; `sheet` is the photo's own."""
    reach = np.array([body.reach for body in world.bodies])[:, None]

    def hides(corner: tuple[int, int]) -> int:
        x0, y0, x1, y1 = _box(sheet, entries, corner)
        nearest = np.clip(seen.poses[..., :2], (x0, y0), (x1, y1))
        hidden = (np.abs(seen.poses[..., :2] - nearest) < reach).all(axis=-1)
        return int(hidden.sum())

    return min(CORNERS, key=hides)


def write_key(rgb: U8, sheet: Sheet, entries: Sequence[Entry], corner: tuple[int, int]) -> None:
    """Draw the key into a picture (H, W, 3) sRGB."""
    letter = sheet.letter
    samples = [_wide(entry, sheet) for entry in entries]
    column = max(samples)
    x0, y0, x1, y1 = _box(sheet, entries, corner)
    wide, tall = x1 - x0, y1 - y0
    if wide > LARGEST * sheet.size[0] or tall > LARGEST * sheet.size[1]:
        return  # on a small picture the motion matters more
    plate(rgb, (x0, y0, x1, y1), 0.5 * letter, OPAQUE)
    words = Layer(sheet.size, 0.0)
    y = y0 + PAD * letter
    for entry, wide in zip(entries, samples, strict=True):
        tall = _tall(entry, sheet)
        layer = Layer(sheet.size, 0.0)
        _sample(layer, sheet, entry, np.array([x0 + SIDE * letter + (column - wide) / 2, y + tall / 2]), wide)
        layer.onto(rgb, COLOURS[entry.kind])
        text = x1 - SIDE * letter - _text(sheet, entries) + breadth(entry.text, letter) / 2
        words.words(entry.text, (text, y + tall / 2), letter)
        y += tall
    words.onto(rgb, WORDS)


def _box(
    sheet: Sheet, entries: Sequence[Entry], corner: tuple[int, int]
) -> tuple[float, float, float, float]:
    """x0, y0, x1, y1 px of the key's plate."""
    letter = sheet.letter
    column = max(_wide(entry, sheet) for entry in entries)
    width = (2 * SIDE + GAP) * letter + column + _text(sheet, entries)
    height = 2 * PAD * letter + sum(_tall(entry, sheet) for entry in entries)
    margin = 0.9 * letter
    x0 = sheet.size[0] - margin - width if corner[0] else margin
    y0 = sheet.size[1] - margin - height if corner[1] else margin
    return x0, y0, x0 + width, y0 + height


def _text(sheet: Sheet, entries: Sequence[Entry]) -> float:
    """px that the longest line of words takes."""
    return max(breadth(entry.text, sheet.letter) for entry in entries)


def _tall(entry: Entry, sheet: Sheet) -> float:
    """px that a line takes."""
    if entry.kind is Overlay.CONTACTS:
        return max(ROW * sheet.letter, 2.6 * entry.size * sheet.unit)
    return ROW * sheet.letter * (1.25 if entry.load is Load.TORQUE else 1.0)


def _wide(entry: Entry, sheet: Sheet) -> float:
    """px that a sample takes."""
    if entry.load is Load.TORQUE:
        return 2 * ARC * sheet.letter
    return entry.size * sheet.unit * (2 if entry.kind is Overlay.CONTACTS else 1)


def _sample(layer: Layer, sheet: Sheet, entry: Entry, at: Array, wide: float) -> None:
    """A sample that begins at `at` x px and has its middle at y px."""
    middle = at + np.array([wide / 2, 0.0])
    if entry.kind is Overlay.CONTACTS:
        ring(layer, middle, entry.size * sheet.unit, sheet.pen)
    elif entry.load is Load.TORQUE:
        curved_arrow(layer, arc(middle, ARC * sheet.letter, entry.size), sheet.pen)
    else:
        straight_arrow(layer, at, at + np.array([wide, 0.0]), sheet.pen, struck=entry.load is Load.IMPULSE)
