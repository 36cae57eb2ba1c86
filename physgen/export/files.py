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

PNG_LEVEL = 1
"""Of zlib: three times as fast as the usual 6, and files a fifth larger."""
JPEG_QUALITY = 95
"""Errors of about 1 grey level."""
SHORT_LIST = re.compile(r"\[\n\s+([^\[\]{}]*?)\n\s+\]")
"""A JSON list without lists in it; strings of JSON have no line breaks of their own."""

Codes = NDArray[np.integer[Any] | np.floating[Any]]
"""8- or 16-bit integers, as OpenCV's stubs have them."""


def write_png(path: Path, picture: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """(H, W) or (H, W, 3) in the order R, G, B; 8 or 16 bits. Raises OSError."""
    path.write_bytes(png(picture))


def png(picture: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes | memoryview:
    """The bytes of the file. Raises OSError."""
    return png_of_bgr(picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))


def png_of_bgr(bgr: Codes) -> bytes | memoryview:
    """The same of (H, W, 3) in OpenCV's order, B, G, R."""
    done, data = cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, PNG_LEVEL])
    if not done:
        raise OSError("a picture cannot be encoded as PNG")
    return data.data


def jpeg(rgb: NDArray[np.uint8]) -> bytes | memoryview:
    """A file of a picture (H, W, 3); colour has full resolution, so that it ends where masks do."""
    options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    options += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    _, data = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), options)
    return data.data


def write_scale(folder: Path, scale: Mapping[str, object]) -> None:
    """`scale.json`: the meaning of the integers in a folder's pictures. Raises OSError."""
    (folder / "scale.json").write_text(json.dumps(scale, indent=1) + "\n", encoding="utf-8")


def json_text(data: Any) -> str:
    """Indented, a list of plain values on one line; numbers as short as they read back exactly.

    >>> print(json_text({"a": [1, 0.5], "b": "[\\n 1]"}))
    {
     "a": [1, 0.5],
     "b": "[\\n 1]"
    }
    """
    text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False)
    return SHORT_LIST.sub(lambda found: "[" + re.sub(r",\n\s+", ", ", found[1]) + "]", text)


def write_json(path: Path, data: Any) -> None:
    """UTF-8."""
    path.write_text(json_text(data) + "\n", encoding="utf-8")
