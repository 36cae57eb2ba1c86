"""Ids -> palette PNG as DAVIS and YouTube-VOS have them: a pixel's index is its object's id, 0 the background.

Index 255 means that nobody knows, for DAVIS' own measures too.
"""

from __future__ import annotations

from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen.export.pictures import FAST

FIRST = (
    (0, 0, 0), (128, 0, 0), (0, 128, 0), (128, 128, 0), (0, 0, 128), (128, 0, 128), (0, 128, 128), (128, 128, 128),
    (64, 0, 0), (191, 0, 0), (64, 128, 0), (191, 128, 0), (64, 0, 128), (191, 0, 128), (64, 128, 128), (191, 128, 128),
    (0, 64, 0), (128, 64, 0), (0, 191, 0), (128, 191, 0), (0, 64, 128), (128, 64, 128),
)  # fmt: skip
"""sRGB of the first indices (Perazzi et al., CVPR 2016); those after are grey, as light as their number."""
PALETTE = (*FIRST, *((level, level, level) for level in range(len(FIRST), 256)))


def indexed(ids: NDArray[np.uint16]) -> bytes:
    """A file of (H, W) ids, none over 254."""
    picture = Image.fromarray(ids.astype(np.uint8)).convert("P")
    picture.putpalette([value for colour in PALETTE for value in colour])
    file = BytesIO()
    picture.save(file, "PNG", compress_level=FAST)
    return file.getvalue()
