"""Pixels or a file's bytes -> what a page can carry: small pictures as WebP, PNG or JPEG, and data URIs."""

from __future__ import annotations

import base64
import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

U8 = NDArray[np.uint8]

METHOD = 2
"""Of WebP, 0 to 6: a third of the time of libwebp's usual 4, and 3 % more bytes."""
KINDS = {
    ".mp4": "video/mp4",
    ".webp": "image/webp",
    ".gif": "image/gif",
    ".png": "image/png",
    ".jpg": "image/jpeg",
}


def webp(pixels: U8, quality: int) -> str:
    """(H, W, 3) sRGB, or (H, W, 4) with how much they cover, as a data URI; coverage is kept exactly."""
    return data_uri(_bytes(pixels, "WEBP", quality=quality, method=METHOD), ".webp")


def smaller(pixels: U8, quality: int) -> str:
    """The same as WebP or PNG, whichever is smaller: few colours stay as they are."""
    exact = data_uri(_bytes(pixels, "PNG"), ".png")
    return min(webp(pixels, quality), exact, key=len)


def jpeg(pixels: U8, quality: int) -> str:
    """(H, W, 3) sRGB as a data URI."""
    return data_uri(_bytes(pixels, "JPEG", quality=quality), ".jpg")


def data_uri(data: bytes, ending: str) -> str:
    """A file by its ending, one of KINDS."""
    return f"data:{KINDS[ending]};base64,{base64.b64encode(data).decode('ascii')}"


def _bytes(pixels: U8, kind: str, **how: int) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, kind, **how)
    return buffer.getvalue()
