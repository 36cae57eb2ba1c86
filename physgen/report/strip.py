"""A few frames before and after refinement -> one picture: columns in time; guidance, refined, and what changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.photometry import decode, encode_u8
from physgen.render.ink import Colour, Layer, breadth

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]
Size = tuple[int, int]
"""Width and height, px."""
Piece = str | U8
"""Of the key: words, or a picture (h, w, 3) sRGB."""

COLUMNS = 6
WIDEST = 1600
"""px of the strip."""
TALLEST = 300
"""px of a panel."""
NARROWEST = 440, 72
"""px of a strip and of a column: words need room beside the smallest frames."""
GAP, LETTER, LINE = 8, 18, 30
"""px between panels, of words, and of a line of them."""
ROWS = ("guidance", "refined", "change")
PAPER: Colour = (255, 255, 255)
WORDS: Colour = (32, 34, 40)
WARM: Colour = (178, 24, 43)
COOL: Colour = (33, 102, 172)
PALE = 176, 236
"""Grey levels that black and white have beneath the colours of change."""
LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)
"""ITU-R BT.709, of sRGB codes."""
BORDER = 0.5
"""Of a pixel, that an object covers on its outline."""
LINES: Colour = (58, 62, 72)
ROBUST = 99.8
"""Percentile of one panel's changes that full colour stands for at least: a few odd pixels do not pale the rest."""
STEPS = (1, 2, 5, 10, 20, 50, 100, 255)
"""Grey levels that full colour may stand for."""
BAR = 150
"""px: length of the scale."""
FINE, PEN = 4, 3
"""Sub-pixels a side where outlines are drawn, and how many a line is wide."""


@dataclass(frozen=True)
class Column:
    """One moment, as large as a panel."""

    time: float
    """s of playing."""
    guidance: U8
    """(h, w, 3) sRGB."""
    refined: U8
    """(h, w, 3) sRGB."""
    change: F32
    """(h, w) grey levels of luma (ITU-R BT.709) by which the refined is brighter."""
    outlines: F32
    """(h, w) 0..1: how much of each pixel the line takes along which objects cover half."""


def panel(size: Size) -> Size:
    """Width and height of a panel for frames of this size.

    >>> panel((1920, 1080)), panel((1080, 1920))
    ((243, 137), (169, 300))
    """
    widest = (WIDEST - _left() - COLUMNS * GAP) // COLUMNS
    scale = min(widest / size[0], TALLEST / size[1])
    width, height = (max(1, round(side * scale)) for side in size)
    return width, height


def column(time: float, guidance: U8, refined: U8, change: F32, coverage: F32) -> Column:
    """Made small, in linear light: (H, W, 3) sRGB twice, (H, W) grey levels and (H, W) coverage 0..1."""
    size = panel((guidance.shape[1], guidance.shape[0]))
    small = [_sized(picture, size) for picture in (decode(guidance), decode(refined), change)]
    return Column(time, encode_u8(small[0]), encode_u8(small[1]), small[2], _outlines(coverage, size))


def full(columns: Sequence[Column]) -> int:
    """Grey levels that full colour stands for.

    Nothing that is larger than a few pixels is beyond it; 0 where nothing changed.
    """
    if not any(one.change.any() for one in columns):
        return 0
    most = max(float(np.percentile(np.abs(one.change), ROBUST)) for one in columns)
    return next((step for step in STEPS if most < step + 0.5), STEPS[-1])


def strip(columns: Sequence[Column]) -> U8:
    """(H, W, 3) sRGB; W is at most WIDEST."""
    levels = full(columns)
    height, width = columns[0].change.shape
    cell, tall = max(width, NARROWEST[1]), max(height, LINE)
    wide = max(_left() + len(columns) * (cell + GAP), NARROWEST[0])
    key = _flowed(_key(levels), wide - 2 * GAP)
    top, below = LINE + GAP // 2, LINE + GAP // 2 + len(ROWS) * (tall + GAP)
    page = np.empty((below + len(key) * LINE + GAP, wide, 3), np.uint8)
    page[:] = PAPER
    words = Layer((wide, page.shape[0]), 0.0)
    for j, name in enumerate(ROWS):
        words.words(name, (GAP + breadth(name, LETTER) / 2, top + j * (tall + GAP) + tall / 2), LETTER)
    for k, one in enumerate(columns):
        x = _left() + k * (cell + GAP)
        words.words(f"{one.time:.2f} s", (x + cell / 2, top - LINE / 2), LETTER)
        for j, picture in enumerate((one.guidance, one.refined, changed(one, levels))):
            y, left = top + j * (tall + GAP) + (tall - height) // 2, x + (cell - width) // 2
            page[y : y + height, left : left + width] = picture
    for j, line in enumerate(key):
        x, y = GAP, below + j * LINE
        for part in line:
            for piece in part:
                if isinstance(piece, str):
                    words.words(piece, (x + breadth(piece, LETTER) / 2, y + LINE / 2), LETTER)
                else:
                    bar = page[y + (LINE - len(piece)) // 2 :, x:]
                    bar[: len(piece), : piece.shape[1]] = piece
                x += _wide(piece) + GAP
            x += GAP
    words.onto(page, WORDS)
    return page


def changed(one: Column, levels: int) -> U8:
    """(h, w, 3) sRGB: the guidance in pale grey, warm where it is brighter now and cool where darker, with outlines."""
    grey = one.guidance @ LUMA
    picture = coloured(PALE[0] + (PALE[1] - PALE[0]) * grey / 255, one.change, levels)
    mixed = picture + one.outlines[..., None] * (np.array(LINES, np.float32) - picture)
    return np.asarray(np.rint(mixed), np.uint8)


def coloured(grey: NDArray[np.floating], change: NDArray[np.floating], levels: int) -> U8:
    """(h, w, 3) sRGB of grey (h, w) 0..255 beneath; `change` (h, w) grey levels of either sign."""
    share = np.minimum(np.abs(change) / max(levels, 1), 1)[..., None]
    colour = np.where(change[..., None] > 0, np.array(WARM, np.float32), np.array(COOL, np.float32))
    mixed = grey[..., None] * (1 - share) + colour * share
    return np.asarray(np.rint(mixed), np.uint8)


def _key(levels: int) -> list[list[Piece]]:
    """What the colours and lines mean, in parts that are not broken."""
    lines: list[Piece] = ["lines: objects' outlines"]
    if not levels:
        return [["no change at all"], lines]
    ramp = np.linspace(-levels, levels, BAR, dtype=np.float32)[None].repeat(LINE // 2, axis=0)
    bar = coloured(np.full_like(ramp, sum(PALE) / 2), ramp, levels)
    scale: list[Piece] = [f"darker by {levels}", bar, f"brighter by {levels}"]
    stronger = f", drawn {255 / levels:.3g} times as strong" if levels < 255 else ""
    return [scale, [f"grey levels of 255{stronger}"], lines]


def _flowed(parts: Sequence[Sequence[Piece]], room: float) -> list[list[Sequence[Piece]]]:
    """Lines of parts."""
    lines: list[list[Sequence[Piece]]] = [[]]
    taken = 0.0
    for part in parts:
        width = sum(_wide(piece) + GAP for piece in part) + GAP
        if lines[-1] and taken + width > room:
            lines.append([])
            taken = 0.0
        lines[-1].append(part)
        taken += width
    return lines


def _wide(piece: Piece) -> int:
    """px."""
    return ceil(breadth(piece, LETTER)) if isinstance(piece, str) else piece.shape[1]


def _left() -> int:
    """px from the border to the first panel."""
    return ceil(max(breadth(name, LETTER) for name in ROWS)) + 2 * GAP


def _sized(picture: F32, size: Size) -> F32:
    """Means of pixels where it becomes smaller; straight between pixels where larger, so that no sign is invented."""
    how = cv2.INTER_AREA if size[0] < picture.shape[1] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(picture, size, interpolation=how), np.float32)


def _outlines(coverage: F32, size: Size) -> F32:
    """See `Column.outlines`. Beyond the frame things go on: no line runs along its border."""
    fine = _sized(coverage, (size[0] * FINE, size[1] * FINE))
    covered = (fine >= BORDER).astype(np.uint8)
    wider = cv2.dilate(covered, np.ones((3, 3), np.uint8))
    narrower = cv2.erode(covered, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * PEN - 1, 2 * PEN - 1)))
    return _sized((wider - narrower).astype(np.float32), size)
