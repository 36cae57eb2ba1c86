"""Frames as PNG, and masks as palette PNG in the layout of DAVIS 2017, beside JPEG
pictures.
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen.export.labels import Clip, Moment, Writer, write_png
from physgen.maps import PNG_LEVEL

FIRST_COLOURS = (
    (0, 0, 0),
    (128, 0, 0),
    (0, 128, 0),
    (128, 128, 0),
    (0, 0, 128),
    (128, 0, 128),
    (0, 128, 128),
    (128, 128, 128),
    (64, 0, 0),
    (191, 0, 0),
    (64, 128, 0),
    (191, 128, 0),
    (64, 0, 128),
    (191, 0, 128),
    (64, 128, 128),
    (191, 128, 128),
    (0, 64, 0),
    (128, 64, 0),
    (0, 191, 0),
    (128, 191, 0),
    (0, 64, 128),
    (128, 64, 128),
)
"""sRGB of the first indices (Perazzi et al., CVPR 2016). Later colours are grey, with
the index as level.
"""
PALETTE = (
    *FIRST_COLOURS,
    *((level, level, level) for level in range(len(FIRST_COLOURS), 256)),
)
FULL_SIZE = "Full-Resolution"
"""DAVIS' folder name for pictures in their own size."""


def palette_png(ids: NDArray[np.uint16]) -> bytes:
    """Return a PNG file of ids (H, W) up to 254, 0 = background; 255 means unknown in
    DAVIS' own measures.
    """
    # DAVIS' tools read the index, and people the colour.
    picture = Image.fromarray(ids.astype(np.uint8)).convert("P")
    picture.putpalette([value for colour in PALETTE for value in colour])
    file = BytesIO()
    picture.save(file, "PNG", compress_level=PNG_LEVEL)
    return file.getvalue()


class Frames(Writer):
    """Writes the frames as `00000.png` ..., 8-bit sRGB."""

    def add(self, moment: Moment) -> None:
        """Write one file per frame."""
        write_png(self._folder / f"{moment.view.index:05d}.png", moment.view.rgb)


class Davis(Writer):
    """Writes DAVIS 2017 (Pont-Tuset et al., 2017): pictures, masks, and lists with this
    clip.
    """

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._images = folder / "JPEGImages" / FULL_SIZE / clip.name
        self._masks = folder / "Annotations" / FULL_SIZE / clip.name
        lists = folder / "ImageSets" / "2017"
        for path in (self._images, self._masks, lists):
            path.mkdir(parents=True)
        # Tools read either list.
        for split in ("train", "val"):
            (lists / f"{split}.txt").write_text(f"{clip.name}\n", encoding="utf-8")

    def add(self, moment: Moment) -> None:
        """Write two files per frame."""
        view = moment.view
        (self._images / f"{view.index:05d}.jpg").write_bytes(view.jpeg)
        (self._masks / f"{view.index:05d}.png").write_bytes(palette_png(view.ids))
