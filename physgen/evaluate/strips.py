"""Frames of a truth video in rows, to be looked at: the paper's compositing, ours, and the truth."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from physgen.evaluate.fidelity import Truth, ways

U8 = NDArray[np.uint8]

COLUMNS = 4
"""Frames of a strip, evenly apart, the last one among them."""
SHOWN = ("paper, relit", "ours")
GAP = 4
"""px between pictures."""
LETTER = 18
"""px."""


def strip(truth: Truth) -> U8:
    """(H, W, 3) sRGB: a row each of the paper's way, ours, and the truth, at the same moments."""
    count = len(truth.film["times_s"])
    chosen = [round((k + 1) * count / COLUMNS) - 1 for k in range(min(COLUMNS, count))]
    draw = ways(truth)
    rows = [(name, _picked(draw[name](), chosen)) for name in SHOWN]
    rows.append(("truth", _picked((rgb for rgb, _ in truth.frames()), chosen)))
    height, width = rows[0][1][0].shape[:2]
    sheet = Image.new(
        "RGB",
        (len(chosen) * (width + GAP) - GAP, len(rows) * (height + GAP) - GAP),
        (255, 255, 255),
    )
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(LETTER)
    for j, (name, pictures) in enumerate(rows):
        for k, picture in enumerate(pictures):
            x, y = k * (width + GAP), j * (height + GAP)
            sheet.paste(Image.fromarray(picture), (x, y))
            said = f"{name}, {truth.film['times_s'][chosen[k]]:.2f} s"
            pen.text((x + 8, y + 6), said, (255, 255, 255), font, stroke_width=2, stroke_fill=(30, 30, 30))
    return np.asarray(sheet)


def _picked(frames: Iterator[U8], chosen: list[int]) -> list[U8]:
    return [frame for k, frame in enumerate(frames) if k in chosen]
