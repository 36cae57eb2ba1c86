"""A picture file -> its own numbers, in the file's axes and colours; files that are no such picture are refused."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.pictures import FORMATS, MOST_PIXELS
from physgen.problems import InputError

if TYPE_CHECKING:
    from PIL import Image

U16 = NDArray[np.uint16]
Raw = NDArray[np.uint8] | NDArray[np.uint16]

BITS, WHITE_IS_ZERO, SUBFILE, DNG = 258, 262, 254, 50706
"""Tags of TIFF."""
SENSOR = (32803, 34892)
"""Values of that second tag for what a sensor saw and nobody developed."""
ELSEWHERE = (
    (0, b"\x76\x2f\x31\x01", "OpenEXR"),
    (0, b"#?", "Radiance"),
    (4, b"ftyphe", "HEIC"),
    (4, b"ftypmif1", "HEIC"),
    (4, b"ftypavi", "AVIF"),
    (4, b"JXL ", "JPEG XL"),
    (0, b"\xff\x0a", "JPEG XL"),
    (0, b"8BPS", "Photoshop"),
    (0, b"FUJIFILM", "raw"),
    (0, b"IIR", "raw"),
    (8, b"CR", "raw"),
    (4, b"ftypcrx", "raw"),
    (0, b"II*\0", "TIFF"),
    (0, b"MM\0*", "TIFF"),
)
"""What people have and physgen does not read: where, the bytes there, and what it is."""


def refused(path: Path, found: str, expected: str, fix: str) -> InputError:
    """One problem with a picture file."""
    return InputError.of(str(path), found, expected, fix)


def too_bright(path: Path, kind: str) -> InputError:
    """Of light beyond white: which part of it a photo would show is not for us to choose."""
    fix = "tone-map it, and save it as an 8- or 16-bit PNG"
    return refused(path, "", f"is a{kind} picture of light beyond white", fix)


@contextmanager
def opened(path: Path) -> Iterator[Image.Image]:
    """Pillow's view of a picture, its size checked before pixels are decoded. Raises InputError."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns below our own limit
            image = Image.open(path, formats=FORMATS)
    except FileNotFoundError:
        raise refused(path, "", "no such file", "check the path") from None
    except IsADirectoryError:
        raise refused(path, "", "is a folder", "name a picture in it") from None
    except PermissionError:
        raise refused(path, "", "may not be read", "change its permissions") from None
    except Image.DecompressionBombError:
        raise refused(path, "", "is over 100 megapixels", "make the picture smaller") from None
    except Exception as error:  # for damaged headers Pillow's readers raise errors of many kinds
        raise _unreadable(path, error) from None
    with image:
        width, height = image.size
        if width * height > MOST_PIXELS:
            found = f"{width} x {height} px"
            raise refused(path, found, "is over 100 megapixels", "make the picture smaller")
        _check_kind(image, path)
        yield image


def load(image: Image.Image, path: Path) -> None:
    """Decode it; a damaged picture is told of here, in one line. Raises InputError."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            image.load()
    except Exception as error:
        raise _unreadable(path, error) from None


def size(path: Path) -> tuple[int, int]:
    """Width and height, px, by the file's header. Raises InputError."""
    with opened(path) as image:
        return image.size


def channels(path: Path) -> Raw:
    """(H, W) or (H, W, 2 to 4), 8 or 16 bits, colours in the order red, green, blue; of a palette, its indices.

    Raises InputError.
    """
    with opened(path) as image:
        load(image, path)
        raw = deep(image, path)
        if raw is not None:
            return raw[:, :, 0] if raw.shape[2] == 1 else raw
        known = ("L", "LA", "P", "RGB", "RGBA")
        return np.asarray(
            image if image.mode in known else image.convert("L" if image.mode == "1" else "RGB")
        )


def deep(image: Image.Image, path: Path) -> U16 | None:
    """(H, W, 1 to 4), a loaded picture of 16 bits, with opacity last where it says so; None for one of 8 bits.

    Pillow cuts colours of 16 bits to 8, so OpenCV reads those.
    """
    if image.mode.startswith("I"):
        grey = np.clip(np.asarray(image), 0, 65535).astype(np.uint16)
        if image.format == "TIFF" and _tags(image).get(WHITE_IS_ZERO) == 0:
            grey = 65535 - grey
        raw = grey[:, :, None]
    elif _bits(image, path) == 16 and image.mode in ("LA", "RGB", "RGBA"):
        said = getattr(
            cv2.utils, "logging", cv2
        )  # where OpenCV 5, and where 4, is told not to print of oddities
        level = said.getLogLevel()
        said.setLogLevel(0)
        try:
            flags = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
            data = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), flags)
        except cv2.error:
            return None
        finally:
            said.setLogLevel(level)
        if data is None or data.dtype != np.uint16 or data.ndim != 3:
            return None
        raw = cv2.cvtColor(data, cv2.COLOR_BGRA2RGBA if data.shape[2] == 4 else cv2.COLOR_BGR2RGB, data)
    else:
        return None
    key = image.info.get("transparency")
    if key is not None and raw.shape[2] in (1, 3):  # one colour stands for nothing
        opaque = np.where((raw == np.atleast_1d(key)).all(axis=2), 0, 65535).astype(np.uint16)
        raw = np.concatenate([raw, opaque[:, :, None]], axis=2)
    return np.asarray(raw, np.uint16)


def _tags(image: Image.Image) -> Any:
    return getattr(image, "tag_v2", {})


def _bits(image: Image.Image, path: Path) -> int:
    """Of a channel, by the file's header: Pillow's modes do not tell."""
    if image.format == "TIFF":
        return int(max(_tags(image).get(BITS, (1,))))
    return _head(path)[24] if image.format == "PNG" else 8


def _head(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(32)


def _check_kind(image: Image.Image, path: Path) -> None:
    """Raises InputError for what Pillow opens and is no photo of 8 or 16 bits."""
    if image.mode == "F":
        raise too_bright(path, f" {image.format} float")
    if image.format != "TIFF":
        return
    tags = _tags(image)
    if DNG in tags or tags.get(SUBFILE, 0) & 1 or tags.get(WHITE_IS_ZERO) in SENSOR or _named(path) == "raw":
        raise refused(path, "", *_told("raw"))  # what Pillow would show of it is a thumbnail
    bits = _bits(image, path)
    if bits > 8 and bits != 16:
        raise refused(path, f"{bits} bits a channel", "are not 8 or 16", "save it as an 8- or 16-bit PNG")


def _named(path: Path) -> str | None:
    """What a file is, by its first bytes, among those that are not read."""
    head = _head(path)
    return next((name for at, mark, name in ELSEWHERE if head[at : at + len(mark)] == mark), None)


def _told(kind: str) -> tuple[str, str]:
    if kind == "raw":
        return "is a camera's raw file", "develop it, and save it as PNG or JPEG"
    if kind == "TIFF":
        return (
            "is a TIFF of an unusual kind, or damaged",
            "save it as PNG, or as TIFF of 8 or 16 bits a channel",
        )
    return f"is {'an' if kind[0] in 'AEIO' else 'a'} {kind} file, which is not read", "save it as PNG or JPEG"


def _unreadable(path: Path, error: Exception) -> InputError:
    from PIL import UnidentifiedImageError

    if isinstance(error, UnidentifiedImageError):
        kind = _named(path)
        if kind in ("OpenEXR", "Radiance"):
            return too_bright(path, f"{'n' * (kind == 'OpenEXR')} {kind}")
        if kind is not None:
            return refused(path, "", *_told(kind))
        return refused(path, "", "is not a picture that can be read", "save it as PNG or JPEG")
    reason = (str(error) or type(error).__name__).splitlines()[0][:120]
    return refused(path, "", f"is not a picture that can be read ({reason})", "save it as PNG or JPEG")
