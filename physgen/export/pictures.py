"""Arrays -> PNG files that are not pictures to look at: whole numbers that must come back as they are."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

FAST = 1
"""zlib's level: three times as fast as the usual 6, and files a fifth larger."""


def save(path: Path, picture: NDArray[np.uint8] | NDArray[np.uint16], level: int = FAST) -> None:
    """(H, W) or (H, W, 3) in the order R, G, B; 8 or 16 bits. Raises OSError."""
    bgr = picture if picture.ndim == 2 else picture[:, :, ::-1]
    done, data = cv2.imencode(".png", np.ascontiguousarray(bgr), [cv2.IMWRITE_PNG_COMPRESSION, level])
    if not done:
        raise OSError(f"{path} cannot be encoded")
    path.write_bytes(data.tobytes())
