"""Photo files of 8 or 16 bits, of any colour profile, read as upright sRGB of 8 bits.

LittleCMS converts by colour profiles, 8 bits a channel. Colours keep their place relative to white (relative
colorimetric); colours beyond sRGB are clipped.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.files import EXIF_ORIENTATION, FORMATS, SCENE_FORMATS
from physgen.photometry import decode, encode_u8
from physgen.problems import InputError, Limit, Place
from physgen.text import quoted

if TYPE_CHECKING:
    from PIL import Image

U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
ToSrgb = Callable[[U8], U8]
"""(H, W, 1, 3 or 4) stored numbers -> (H, W, 3) sRGB."""

BAND = 512  # rows that are converted at a time, so that memory stays small
GREYS = ("1", "L", "LA", "La")
WITH_ALPHA = ("LA", "La", "PA", "RGBA", "RGBa")
PLAIN = ("1", "L", "LA", "P", "PA", "RGB", "RGBA")
"""Modes of Pillow's."""
TURNS: dict[int, Callable[[U8], U8]] = {
    2: lambda a: a[:, ::-1],
    3: lambda a: a[::-1, ::-1],
    4: lambda a: a[::-1],
    5: lambda a: a.swapaxes(0, 1),
    6: lambda a: a[::-1].swapaxes(0, 1),
    7: lambda a: a[::-1, ::-1].swapaxes(0, 1),
    8: lambda a: a[:, ::-1].swapaxes(0, 1),
}
"""EXIF orientation -> what makes it upright (CIPA DC-008, 4.6.4)."""
BITS, PHOTOMETRIC, SUBFILE, DNG = 258, 262, 254, 50706
"""Tags of TIFF."""
SENSOR = (32803, 34892)
"""Values of PHOTOMETRIC for undeveloped sensor data."""


@dataclass(frozen=True)
class Photo:
    """A photo and what is known of its file."""

    rgb: U8
    """(H, W, 3) sRGB."""
    plain: bool
    """Whether the file holds these very numbers, upright, in a format that a scene may name."""
    readable: bool = True
    """Whether its colour profile, if it has one, could be used; else the numbers were taken for sRGB."""


def read_image(path: Path) -> U8:
    """A photo as (H, W, 3) uint8 sRGB, in the file's own axes; see `read_photo`."""
    return read_photo(path, upright=False).rgb


def read_photo(path: Path, upright: bool = True) -> Photo:
    """A photo as a viewer shows it, turned by its EXIF data if `upright`, over white where it is transparent.

    A colour profile is applied; photos without one are sRGB. 16 bits are rounded to 8 before a profile is applied.
    Raises InputError.
    """
    with open_picture(path) as image:
        decode_picture(image, path)
        numbers = read_16_bit(image, path)
        turn = orientation(image)
        has_alpha = image.mode in WITH_ALPHA or "transparency" in image.info
        mode, to_srgb, readable = _meaning(image)
        plain = (
            numbers is None and image.mode in PLAIN and image.format in SCENE_FORMATS
        )
        if numbers is None:
            numbers = np.asarray(image.convert(mode + "A" * has_alpha))
            numbers = numbers[:, :, None] if numbers.ndim == 2 else numbers
        else:
            has_alpha = numbers.shape[2] in (2, 4)
    rgb = np.empty((*numbers.shape[:2], 3), np.uint8)
    opaque = True
    for top in range(0, len(rgb), BAND):
        rows = slice(top, top + BAND)
        rgb[rows], whole = over_white(numbers[rows], has_alpha, to_srgb)
        opaque &= whole
    plain = plain and opaque and to_srgb is None and turn == 1
    if upright and turn in TURNS:
        rgb = np.ascontiguousarray(TURNS[turn](rgb))
    return Photo(rgb, plain, readable)


def over_white(
    band: NDArray[Any], has_alpha: bool = True, to_srgb: ToSrgb | None = None
) -> tuple[U8, bool]:
    """Stored numbers -> (h, w, 3) sRGB over white, composed in linear light; and whether all are opaque."""
    full = np.iinfo(band.dtype).max
    alpha = band[:, :, -1] if has_alpha else None
    colour = _eight_bits(band[:, :, :-1] if has_alpha else band)
    shown = (
        np.broadcast_to(colour, (*colour.shape[:2], 3))
        if to_srgb is None
        else to_srgb(colour)
    )
    if alpha is None or (alpha == full).all():
        return shown, True
    share = (alpha.astype(np.float32) / np.float32(full))[:, :, None]
    return encode_u8(1 + (decode(shown) - 1) * share), False


def _eight_bits(levels: NDArray[Any]) -> U8:
    if levels.dtype == np.uint8:
        return np.asarray(levels, np.uint8)
    return np.asarray(
        cv2.convertScaleAbs(levels, alpha=1 / 257).reshape(levels.shape), np.uint8
    )


def orientation(image: Image.Image) -> int:
    """As EXIF counts, 1 to 8; 1 where that is damaged, and for TIFF, which both readers turn.

    A PNG may have it behind its pixels: where these are not loaded, it is not looked for.
    """
    with suppress(Exception):  # Pillow's reader raises errors of many kinds
        if image.format != "TIFF" and "exif" in image.info:
            return int(image.getexif().get(EXIF_ORIENTATION, 1))
    return 1


# files


@contextmanager
def open_picture(
    path: Path, formats: tuple[str, ...] = FORMATS
) -> Iterator[Image.Image]:
    """Pillow's view of a picture, its size checked before pixels are decoded. Raises InputError."""
    from PIL import Image, UnidentifiedImageError

    def problem(expected: str, fix: str) -> InputError:
        return InputError.of(str(path), "", expected, fix)

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns below our own limit
            image = Image.open(path, formats=formats)
    except FileNotFoundError:
        raise problem("no such file", _similar_picture(path)) from None
    except IsADirectoryError:
        raise problem("is a folder", "name a picture in it") from None
    except PermissionError:
        raise problem("may not be read", "change its permissions") from None
    except Image.DecompressionBombError:
        raise Limit.PIXELS.error(Place(str(path))) from None
    except UnidentifiedImageError:
        raise problem(
            "is not a picture that can be read", "save it as PNG or JPEG"
        ) from None
    except (
        Exception
    ) as error:  # for damaged headers Pillow's readers raise errors of many kinds
        raise _damaged(path, error) from None
    with image:
        width, height = image.size
        if width * height > Limit.PIXELS.most:
            raise Limit.PIXELS.error(Place(str(path)), found=f"{width} x {height} px")
        if (kind := _unusual(image, path)) is not None:
            raise problem(
                f"is {kind}, which is not read", "save it as PNG of 8 or 16 bits"
            )
        yield image


PICTURES = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp", ".gif", ".ppm")
"""Suffixes of the pictures among which a misspelt name is looked for."""


def _similar_picture(path: Path) -> str:
    """Return the fix if there is no such picture: the nearest name beside it."""
    names = [
        file.name
        for file in sorted(path.parent.glob("*"))
        if file.suffix.lower() in PICTURES
    ]
    close = get_close_matches(path.name, names, 1)
    if not close:
        return "check the path"
    return f"did you mean {quoted(str(path.with_name(close[0])))}?"


def decode_picture(image: Image.Image, path: Path) -> None:
    """Decodes the pixels. Raises InputError, one line, for a damaged picture."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            image.load()
    except Exception as error:
        raise _damaged(path, error) from None


def picture_size(path: Path) -> tuple[int, int]:
    """Width and height, px, by the file's header. Raises InputError."""
    with open_picture(path) as image:
        return image.size


def read_channels(path: Path) -> U8 | U16:
    """(H, W) or (H, W, 2 to 4), 8 or 16 bits, colours in the order red, green, blue; of a palette, its indices.

    Raises InputError.
    """
    with open_picture(path) as image:
        decode_picture(image, path)
        raw = read_16_bit(image, path)
        if raw is not None:
            return raw[:, :, 0] if raw.shape[2] == 1 else raw
        if image.mode in ("L", "LA", "P", "RGB", "RGBA"):
            return np.asarray(image)
        return np.asarray(image.convert("L" if image.mode == "1" else "RGB"))


def read_16_bit(image: Image.Image, path: Path) -> U16 | None:
    """(H, W, 1 to 4), a loaded picture of 16 bits, with opacity last where it has any; None for one of 8 bits.

    Pillow cuts colours of 16 bits to 8, so OpenCV reads those.
    """
    if image.mode.startswith("I"):
        return np.asarray(np.clip(np.asarray(image), 0, 65535)[:, :, None], np.uint16)
    if _bits(image, path) != 16 or image.mode not in ("LA", "RGB", "RGBA"):
        return None
    log = getattr(cv2.utils, "logging", cv2)  # OpenCV 5, and 4: it must not print
    level = log.getLogLevel()
    log.setLogLevel(0)
    try:
        flags = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
        data = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), flags)
    except cv2.error:
        return None
    finally:
        log.setLogLevel(level)
    if data is None or data.dtype != np.uint16 or data.ndim != 3:
        return None
    order = cv2.COLOR_BGRA2RGBA if data.shape[2] == 4 else cv2.COLOR_BGR2RGB
    return np.asarray(cv2.cvtColor(data, order, data), np.uint16)


def _bits(image: Image.Image, path: Path) -> int:
    """Of a channel, by the file's header: Pillow's modes do not have them."""
    if image.format == "TIFF":
        return int(max(getattr(image, "tag_v2", {}).get(BITS, (1,))))
    if image.format != "PNG":
        return 8
    with path.open("rb") as stream:
        return stream.read(32)[24]


def _unusual(image: Image.Image, path: Path) -> str | None:
    """What a picture is that Pillow opens and that is no photo of 8 or 16 bits."""
    if image.mode in ("F", "LAB"):
        return f"a {image.format} of an unusual kind"
    if image.format != "TIFF":
        return None
    tags = getattr(image, "tag_v2", {})
    if (
        tags.get(SUBFILE, 0) & 1 or DNG in tags or tags.get(PHOTOMETRIC) in SENSOR
    ):  # Pillow would show a thumbnail
        return "a camera's raw file"
    return "a TIFF of an unusual kind" if 8 < _bits(image, path) != 16 else None


def _damaged(path: Path, error: Exception) -> InputError:
    reason = (str(error) or type(error).__name__).splitlines()[0][:120]
    expected = f"is not a picture that can be read ({reason})"
    return InputError.of(str(path), "", expected, "save it as PNG or JPEG")


# colour


class ProfileError(Exception):
    """A profile that is damaged, or not for these pixels."""


def _meaning(image: Image.Image) -> tuple[str, ToSrgb | None, bool]:
    """How to read a loaded file's numbers: Pillow's mode without alpha, their colours, and whether the colour profile
    could be used; None for sRGB.
    """
    grey = image.mode in GREYS or image.mode.startswith("I")
    mode = "L" if grey else "RGB"
    profile = image.info.get("icc_profile")
    if not profile:
        return mode, None, True
    try:
        kind = profile[16:20].decode("latin-1").strip()
        if image.mode == "CMYK":
            if kind != "CMYK":
                raise ProfileError
            return "CMYK", _by_littlecms(profile, "CMYK"), True
        if kind not in ("RGB", "GRAY") or (kind == "GRAY" and not grey):
            raise ProfileError
        to_srgb = _by_littlecms(profile, "L" if kind == "GRAY" else "RGB")
        return mode, None if _is_srgb(to_srgb, kind) else to_srgb, True
    except ProfileError:
        return mode, None, False


def _is_srgb(to_srgb: ToSrgb, kind: str) -> bool:
    """Whether no colour moves by more than one level."""
    step = np.arange(0, 256, 15).astype(np.uint8)
    colours = np.stack(np.meshgrid(step, step, step), -1).reshape(-1, 1, 3)
    if kind == "GRAY":
        colours = step[:, None, None]
    return bool(np.abs(to_srgb(colours).astype(int) - colours).max() <= 1)


def _by_littlecms(profile: bytes, mode: str) -> ToSrgb:
    """LittleCMS: 8 bits a channel, relative colorimetric with black point compensation. Raises ProfileError."""
    from PIL import Image, ImageCms

    try:
        given = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        intent = ImageCms.Intent.RELATIVE_COLORIMETRIC
        flags = ImageCms.Flags.BLACKPOINTCOMPENSATION
        if mode == "L":  # optimised, dark greys would be off by up to 10 levels
            flags |= ImageCms.Flags.NOOPTIMIZE
        srgb = ImageCms.createProfile("sRGB")
        transform = ImageCms.buildTransform(given, srgb, mode, "RGB", intent, flags)
    except (
        ImageCms.PyCMSError,
        OSError,
        ImportError,
    ) as error:  # some builds of Pillow lack LittleCMS
        raise ProfileError from error

    def to_srgb(levels: U8) -> U8:
        if mode == "RGB" and levels.shape[2] == 1:
            levels = np.repeat(levels, 3, axis=2)
        picture = Image.frombytes(mode, levels.shape[1::-1], levels.tobytes())
        changed = ImageCms.applyTransform(picture, transform)
        assert (
            changed is not None
        )  # it is None only where the picture is changed in place
        return np.asarray(changed)

    return to_srgb
