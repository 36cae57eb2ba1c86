"""One frame of a clip, as every reader gives it; what lets light pass is laid on white."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from physgen.photometry import decode, encode_u8

U8 = NDArray[np.uint8]


class Shown(NamedTuple):
    """A frame, upright."""

    rgb: U8
    """(H, W, 3) sRGB."""
    seconds: float | None
    """How long it is shown; None: the file does not say."""
    place: str
    """What it is called in messages: its file, or the video's with its number from 0."""


def over_white(rgba: U8) -> U8:
    """(H, W, 4) sRGB -> (H, W, 3), blended in linear light."""
    rgb = np.ascontiguousarray(rgba[..., :3])
    if (rgba[..., 3] == 255).all():
        return rgb
    alpha = rgba[..., 3:].astype(np.float32) / np.float32(255)
    return encode_u8(1 + (decode(rgb) - 1) * alpha)
