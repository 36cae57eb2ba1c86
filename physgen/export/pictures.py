"""Arrays -> PNG files that are not pictures to look at, whose whole numbers must come back; and what those mean."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

FAST = 1
"""zlib's level: three times as fast as the usual 6, and files a fifth larger."""


def save(path: Path, picture: NDArray[np.uint8] | NDArray[np.uint16], level: int = FAST) -> None:
    """(H, W) or (H, W, 3) in the order R, G, B; 8 or 16 bits. Raises OSError."""
    bgr = np.asarray(picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    done, data = cv2.imencode(".png", np.ascontiguousarray(bgr), [cv2.IMWRITE_PNG_COMPRESSION, level])
    if not done:
        raise OSError(f"{path} cannot be encoded")
    path.write_bytes(data.data)


def told(folder: Path, scale: Mapping[str, object]) -> None:
    """What the numbers of a folder's pictures mean, `scale.json`. Raises OSError."""
    (folder / "scale.json").write_text(json.dumps(scale, indent=1) + "\n", encoding="utf-8")
