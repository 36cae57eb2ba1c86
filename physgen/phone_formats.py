"""HEIC, AVIF and JPEG XL: which library reads a file, and what Pillow does not report of it."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from enum import Enum
from pathlib import Path

from physgen.files import install
from physgen.messages import Message

SIGNATURE = 16
"""Bytes at the start of a file by which its format is recognised."""
HEADER = 2**20
"""Bytes in which a file describes its size and colours; these come before the pixels."""
HEVC_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx")
AVIF_BRANDS = (b"avif", b"avis")
OPEN_BRANDS = (b"mif1", b"msf1")
"""Brands of a container whose compatible brands state the codec."""
JXL_CODESTREAM = b"\xff\x0a"
JXL_CONTAINER = b"\0\0\0\x0cJXL \r\n\x87\n"
JXL_RATIOS = {
    1: (1, 1),
    2: (12, 10),
    3: (4, 3),
    4: (3, 2),
    5: (16, 9),
    6: (5, 4),
    7: (2, 1),
}
"""Code of a ratio -> width and height (ISO/IEC 18181-1, table of SizeHeader)."""
JXL_SIDE_BITS = (9, 13, 18, 30)
"""Bits of a side's length, by the two bits before it."""


class PhoneFormat(Enum):
    """A format of phones; the value is Pillow's name for it."""

    HEIC = "HEIF"
    AVIF = "AVIF"
    JPEG_XL = "JXL"


PACKAGES = {
    PhoneFormat.HEIC: ("HEIC", "pillow-heif"),
    PhoneFormat.JPEG_XL: ("JPEG XL", "pillow-jxl-plugin"),
}
"""Usual name, and package that reads it, of a format that Pillow itself does not read."""


def recognise(path: Path) -> PhoneFormat | None:
    """Return the format of a file by its first bytes; None for other formats. Raises OSError."""
    if not path.is_file():
        return None
    with path.open("rb") as stream:
        head = stream.read(SIGNATURE)
        if head[4:8] != b"ftyp":
            is_jxl = head.startswith((JXL_CODESTREAM, JXL_CONTAINER))
            return PhoneFormat.JPEG_XL if is_jxl else None
        size = int.from_bytes(head[:4], "big")
        compatible = stream.read(max(min(size, HEADER) - SIGNATURE, 0))
    brand = head[8:12]
    if brand in HEVC_BRANDS:
        return PhoneFormat.HEIC
    if brand in AVIF_BRANDS:
        return PhoneFormat.AVIF
    if brand not in OPEN_BRANDS:
        return None
    others = [compatible[k : k + 4] for k in range(0, len(compatible), 4)]
    if any(other in HEVC_BRANDS for other in others):
        return PhoneFormat.HEIC
    return PhoneFormat.AVIF if any(other in AVIF_BRANDS for other in others) else None


def load_reader(kind: PhoneFormat, path: Path) -> None:
    """Make Pillow able to read a format. Raises InputError if the library for it is missing."""
    if kind is PhoneFormat.AVIF:
        from PIL import features

        if not features.check("avif"):
            raise Message.AVIF_UNREADABLE.error(str(path))
        return
    try:
        if kind is PhoneFormat.HEIC:
            from pillow_heif import register_heif_opener

            register_heif_opener()
        else:
            import pillow_jxl  # noqa: F401  registers its format with Pillow
    except ImportError:
        name, package = PACKAGES[kind]
        raise Message.PHONE_FORMAT_UNREADABLE.error(
            str(path), package=package, format=name, install=install("phone")
        ) from None


# ISO media files


def media_boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield kinds and contents of consecutive boxes (ISO/IEC 14496-12, section 4.2)."""
    start = 0
    while start + 8 <= len(data):
        size, header = int.from_bytes(data[start : start + 4], "big"), 8
        if size == 1:
            size, header = int.from_bytes(data[start + 8 : start + 16], "big"), 16
        end = start + size if size else len(data)
        if end < start + header:
            return
        yield data[start + 4 : start + 8], data[start + header : end]
        start = end


def first_box(data: bytes, kind: bytes) -> bytes | None:
    """Return the content of the first box of a kind; None if there is none."""
    return next((content for name, content in media_boxes(data) if name == kind), None)


def avif_colour_codes(path: Path) -> tuple[int, int] | None:
    """Return the code points of an AVIF file's primaries and curve (ITU-T H.273).

    None if it has none.
    """
    data = _header(path)
    for kind, skipped in ((b"meta", 4), (b"iprp", 0), (b"ipco", 0)):
        content = first_box(data, kind)
        if content is None:
            return None
        data = content[skipped:]
    for kind, body in media_boxes(data):
        if kind == b"colr" and body[:4] == b"nclx" and len(body) >= 8:
            primaries, transfer = struct.unpack(">HH", body[4:8])
            return primaries, transfer
    return None


def _header(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(HEADER)


# JPEG XL


def jxl_size(path: Path) -> tuple[int, int] | None:
    """Return width and height of a JPEG XL file, px; None if its header is damaged.

    Its reader decodes all pixels as it opens a file, so the size has to be known before.
    """
    stream = _header(path)
    if stream.startswith(JXL_CONTAINER):
        stream = _jxl_codestream(stream)
    if not stream.startswith(JXL_CODESTREAM) or len(stream) < SIGNATURE:
        return None
    bits = _BitReader(stream[2:SIGNATURE])
    is_small = bits.read(1) == 1
    height = _jxl_side(bits, is_small)
    ratio = bits.read(3)
    if ratio == 0:
        return _jxl_side(bits, is_small), height
    across, down = JXL_RATIOS[ratio]
    return height * across // down, height


def _jxl_codestream(data: bytes) -> bytes:
    """Return the codestream of a container, or its first part."""
    for kind, body in media_boxes(data):
        if kind == b"jxlc":
            return body
        if kind == b"jxlp":
            return body[4:]
    return b""


def _jxl_side(bits: _BitReader, is_small: bool) -> int:
    if is_small:
        return 8 * (bits.read(5) + 1)
    return bits.read(JXL_SIDE_BITS[bits.read(2)]) + 1


class _BitReader:
    """Reads numbers from bytes, the least significant bit first."""

    def __init__(self, data: bytes) -> None:
        self._value = int.from_bytes(data, "little")

    def read(self, count: int) -> int:
        number = self._value & ((1 << count) - 1)
        self._value >>= count
        return number
