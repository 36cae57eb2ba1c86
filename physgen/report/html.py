"""Jinja templates, and pictures as data URIs."""

from __future__ import annotations

import base64
import json
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import imageio.v3 as iio
import jinja2
import numpy as np
from numpy.typing import NDArray
from PIL import WebPImagePlugin  # noqa: F401 - else `save` loads all plugins

from physgen.files import resource
from physgen.text import rounded, value_text

U8 = NDArray[np.uint8]

METHOD = 2
"""Effort of WebP, 0 to 6: a third of the time of libwebp's default 4, and 3 % more
bytes.
"""


def template(name: str) -> Any:
    """Return a Jinja template of `templates/`.

    Values are escaped. A missing value is an error.
    """
    return _environment(resource("templates", name).parent).get_template(name)


@cache
def _environment(folder: Path) -> Any:
    """Return the environment of a folder's templates. Each template is
    compiled once.
    """
    loader = jinja2.FileSystemLoader(folder)
    environment = jinja2.Environment(
        loader=loader, autoescape=True, undefined=jinja2.StrictUndefined
    )
    # Pages and messages must show the same digits.
    environment.filters |= {"rounded": rounded, "value": value_text}
    return environment


def script_json(data: object) -> str:
    """Return JSON for a `<script>`, without an end tag inside."""
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    # The last two signs end lines in older scripts.
    for sign in "<>&\u2028\u2029":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text


def webp(pixels: U8, quality: int) -> str:
    """Encode (H, W, 3) sRGB, or (H, W, 4) with lossless alpha, as a data URI."""
    data = base64.b64encode(encode_webp(pixels, quality))
    return f"data:image/webp;base64,{data.decode('ascii')}"


def encode_webp(pixels: U8, quality: int) -> bytes:
    """Encode a WebP file."""
    return iio.imwrite(
        "<bytes>",
        pixels,
        plugin="pillow",
        extension=".webp",
        quality=quality,
        method=METHOD,
    )


def fit_to_side(rgb: U8, side: int) -> U8:
    """Return (h, w, 3) with a longer side of at most `side` px."""
    height, width = rgb.shape[:2]
    scale = side / max(height, width)
    if scale >= 1:
        return rgb
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)
