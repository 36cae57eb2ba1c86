"""Writing label files: PNG and JPEG pictures, their scales, and JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

# ----------------------------------------------------------------------
# Arrays -> PNG files, whose whole numbers come back as they are, with what those mean; and JPEG files.

FAST = 1
"""zlib's level: three times as fast as the usual 6, and files a fifth larger."""
QUALITY = 95
"""Of JPEG: what is lost of a picture is about 1 grey level."""


Codes = NDArray[np.integer[Any] | np.floating[Any]]
"""Whole numbers, of 8 or 16 bits, as OpenCV's stubs have them."""


def write_png(path: Path, picture: NDArray[np.uint8] | NDArray[np.uint16], level: int = FAST) -> None:
    """(H, W) or (H, W, 3) in the order R, G, B; 8 or 16 bits. Raises OSError."""
    path.write_bytes(png(picture, level))


def png(picture: NDArray[np.uint8] | NDArray[np.uint16], level: int = FAST) -> bytes | memoryview:
    """The same as a file's bytes. Raises OSError."""
    bgr = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    return png_of_bgr(bgr, level)


def png_of_bgr(bgr: Codes, level: int = FAST) -> bytes | memoryview:
    """The same of (H, W, 3) in OpenCV's order, B, G, R."""
    done, data = cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, level])
    if not done:
        raise OSError("a picture cannot be encoded as PNG")
    return data.data


def write_scale(folder: Path, scale: Mapping[str, object]) -> None:
    """What the numbers of a folder's pictures mean, `scale.json`. Raises OSError."""
    (folder / "scale.json").write_text(json.dumps(scale, indent=1) + "\n", encoding="utf-8")


def jpeg(rgb: NDArray[np.uint8]) -> bytes | memoryview:
    """A file of a picture (H, W, 3); colours are kept as finely as brightness, so that they end where masks do."""
    how = [cv2.IMWRITE_JPEG_QUALITY, QUALITY]
    how += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    _, data = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), how)
    return data.data


# ----------------------------------------------------------------------
# Plain data -> a file of JSON.

_SHORT = re.compile(r"\[\n\s+([^\[\]{}]*?)\n\s+\]")
"""Lists that hold no others; a string of JSON has no line breaks of its own."""


def json_text(data: Any) -> str:
    """Indented, a list of plain values on one line, a number as short as it reads back exactly; always the same.

    >>> print(json_text({"a": [1, 0.5], "b": "[\\n 1]"}))
    {
     "a": [1, 0.5],
     "b": "[\\n 1]"
    }
    """
    text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False)
    return _SHORT.sub(lambda found: "[" + re.sub(r",\n\s+", ", ", found[1]) + "]", text)


def write_json(path: Path, data: Any) -> None:
    """UTF-8."""
    path.write_text(json_text(data) + "\n", encoding="utf-8")
