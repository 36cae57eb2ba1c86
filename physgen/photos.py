"""Photo files of 8 or 16 bits, of any colour profile, read as upright sRGB of 8 bits.

LittleCMS converts by colour profiles, 8 bits a channel. Colours keep their place relative to white (relative
colorimetric); colours beyond sRGB are clipped. `colour_spaces` converts what is described without a profile.
"""

from __future__ import annotations

import io
import logging
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import U8 as U8
from physgen.arrays import U16
from physgen.colour_spaces import (
    CAMERA_CURVES,
    SRGB_CURVE_CODE,
    SRGB_PRIMARIES_CODE,
    UNSPECIFIED_CODE,
    ColourError,
    HighDynamicRangeError,
    coded_space,
    measured_space,
)
from physgen.files import EXIF_ORIENTATION, FORMATS, SCENE_FORMATS
from physgen.messages import Message
from physgen.phone_formats import (
    PhoneFormat,
    avif_colour_codes,
    jxl_size,
    load_reader,
    recognise,
)
from physgen.photometry import decode, encode_u8
from physgen.problems import InputError, Limit, Place
from physgen.text import quoted

if TYPE_CHECKING:
    from PIL import Image

ToSrgb = Callable[[NDArray[Any]], U8]
"""(H, W, 1, 3 or 4) stored numbers of 8 or 16 bits -> (H, W, 3) sRGB."""

logging.getLogger("PIL").addHandler(logging.NullHandler())
"""Pillow logs damages that it also raises; without a handler Python prints them."""
STDERR = 2
"""File descriptor (POSIX)."""
BAND = 512
"""Rows that are converted at a time, so that memory stays small."""
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
PLANAR, SEPARATE_PLANES = 284, 2
"""Tag of TIFF, and its value if each channel is stored by itself."""
REDUCED, OLD_SUBFILE, OLD_REDUCED = 0b101, 255, 2
"""Bits of SUBFILE for a reduced copy and a mask; the older tag, and its value for a reduced copy (TIFF 6.0)."""
THUMBNAIL_SHARE = 0.5
"""Longer side of a page of a TIFF, relative to that of the largest page, up to which it is taken for a thumbnail."""
MOST_PAGES = 1000
"""Pages of a TIFF that are compared."""
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
    """Whether its colour profile or other description of its colours, if it has one, could be used."""


def read_image(path: Path) -> U8:
    """Read a photo as (H, W, 3) uint8 sRGB, in the file's own axes; see `read_photo`."""
    return read_photo(path, upright=False).rgb


def read_photo(path: Path, upright: bool = True) -> Photo:
    """Read a photo as a viewer shows it, turned by its EXIF data if `upright`, over white where it is transparent.

    A colour profile is applied, or another description of the colours; photos without one are sRGB. 16 bits are
    rounded to 8 before a profile is applied. Raises InputError.
    """
    with open_picture(path) as image:
        numbers: NDArray[Any] | None = None
        if image.mode.startswith("I") or _bits(image, path) > 8:
            decode_picture(image, path)
            numbers = read_16_bit(image, path)
        mode, to_srgb, readable = _meaning(image, path)
        turn = orientation(image, path)
        is_8_bit = numbers is None
        is_scene_format = image.mode in PLAIN and image.format in SCENE_FORMATS
        has_alpha = image.mode in WITH_ALPHA or "transparency" in image.info
        if numbers is None:
            numbers = _stored_numbers(image, path, mode + "A" * has_alpha)
        else:
            has_alpha = numbers.shape[2] in (2, 4)
    rgb, opaque = _convert_bands(numbers, has_alpha, to_srgb)
    is_plain = is_8_bit and is_scene_format
    plain = is_plain and opaque and to_srgb is None and turn == 1
    if upright and turn in TURNS:
        rgb = np.ascontiguousarray(TURNS[turn](rgb))
    return Photo(rgb, plain, readable)


def _convert_bands(
    numbers: NDArray[Any], has_alpha: bool, to_srgb: ToSrgb | None
) -> tuple[U8, bool]:
    """Convert stored numbers as `over_white`, in bands of rows, so that memory stays small."""
    rgb = np.empty((*numbers.shape[:2], 3), np.uint8)
    opaque = True
    for top in range(0, len(rgb), BAND):
        rows = slice(top, top + BAND)
        rgb[rows], is_opaque = over_white(numbers[rows], has_alpha, to_srgb)
        opaque &= is_opaque
    return rgb, opaque


def _stored_numbers(image: Image.Image, path: Path, mode: str) -> NDArray[Any]:
    """Return (H, W, C) of 8 bits of the page that `open_picture` has checked and selected.

    Raises InputError.
    """
    import imageio.v3 as iio

    quiet = discard_native_errors() if image.format == "TIFF" else nullcontext()
    try:
        # a file, for imageio reads some names as addresses or as archives
        with quiet, warnings.catch_warnings(), path.open("rb") as file:
            warnings.simplefilter("ignore")
            numbers = iio.imread(
                file,
                plugin="pillow",
                index=image.tell(),
                mode=mode,
                writeable_output=False,
            )
    except Exception:
        # imageio reads EXIF data, too, which may be damaged in a sound picture;
        # Pillow decides, and reports pixels that are damaged
        decode_picture(image, path)
        numbers = np.asarray(image.convert(mode))
    return numbers[:, :, None] if numbers.ndim == 2 else numbers


def over_white(
    band: NDArray[Any], has_alpha: bool = True, to_srgb: ToSrgb | None = None
) -> tuple[U8, bool]:
    """Convert stored numbers to (h, w, 3) sRGB over white, composed in linear light.

    And report whether all are opaque.
    """
    full = np.iinfo(band.dtype).max
    alpha = band[:, :, -1] if has_alpha else None
    colour = band[:, :, :-1] if has_alpha else band
    if to_srgb is None:
        rgb = np.broadcast_to(_eight_bits(colour), (*colour.shape[:2], 3))
    else:
        rgb = to_srgb(colour)
    if alpha is None or (alpha == full).all():
        return rgb, True
    share = (alpha.astype(np.float32) / np.float32(full))[:, :, None]
    return encode_u8(1 + (decode(rgb) - 1) * share), False


def _eight_bits(levels: NDArray[Any]) -> U8:
    if levels.dtype == np.uint8:
        return np.asarray(levels, np.uint8)
    byte_levels = cv2.convertScaleAbs(levels, alpha=1 / 257)
    return np.asarray(byte_levels.reshape(levels.shape), np.uint8)


def orientation(image: Image.Image, path: Path | None = None) -> int:
    """Return the orientation as EXIF counts it, 1 to 8.

    1 if it is damaged, and for formats whose readers turn the picture themselves.

    A PNG may have it behind its pixels: it is looked for there if its `path` is given.
    """
    with suppress(Exception):  # Pillow's reader raises errors of many kinds
        if path is not None and image.format == "PNG" and "exif" not in image.info:
            body = _png_chunk(path, b"eXIf", is_late=True)
            if body is not None:
                image.info["exif"] = b"Exif\0\0" + body
        if not _is_turned_by_reader(image) and "exif" in image.info:
            return int(image.getexif().get(EXIF_ORIENTATION, 1))
    return 1


def _is_turned_by_reader(image: Image.Image) -> bool:
    """Return whether the pixels are upright as they are read, whatever the EXIF data contain.

    HEIF and JPEG XL state the orientation apart from EXIF data, and their decoders apply it; a JPEG inside a JPEG XL
    file is decoded as a JPEG.
    """
    if image.format == "JXL":
        return not getattr(image, "jpeg", False)
    return image.format in ("TIFF", "HEIF")


# files


@contextmanager
def open_picture(
    path: Path, formats: tuple[str, ...] = FORMATS
) -> Iterator[Image.Image]:
    """Open a picture with Pillow; its size is checked before pixels are decoded.

    Raises InputError.
    """
    from PIL import Image, UnidentifiedImageError

    name = str(path)
    try:
        formats = _usable_formats(path, formats)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns below our own limit
            image = Image.open(path, formats=formats)
    except FileNotFoundError:
        raise Message.NO_SUCH_FILE.error(name, fix=_similar_picture(path)) from None
    except IsADirectoryError:
        raise Message.FOLDER_FOR_PICTURE.error(name) from None
    except PermissionError:
        raise Message.PICTURE_FORBIDDEN.error(name) from None
    except Image.DecompressionBombError:
        raise Limit.PIXELS.error(Place(str(path))) from None
    except UnidentifiedImageError:
        raise Message.NOT_A_PICTURE.error(name) from None
    except InputError:
        raise
    except (
        Exception
    ) as error:  # for damaged headers Pillow's readers raise errors of many kinds
        raise _damaged(path, error) from None
    with image, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about damaged metadata, as they are read
        if image.format == "TIFF":
            _select_page(image, path)
        width, height = image.size
        if width * height > Limit.PIXELS.most:
            raise Limit.PIXELS.error(Place(str(path)), found=f"{width} x {height} px")
        if (kind := _unusual(image, path)) is not None:
            raise Message.PICTURE_UNUSUAL.error(name, kind=kind)
        yield image


def _usable_formats(path: Path, formats: tuple[str, ...]) -> tuple[str, ...]:
    """Return the formats that Pillow may try on a file. Raises InputError, OSError."""
    kind = recognise(path)
    if kind is None or kind.value not in formats:
        phone_formats = [phone_format.value for phone_format in PhoneFormat]
        return tuple(name for name in formats if name not in phone_formats)
    load_reader(kind, path)
    if kind is PhoneFormat.JPEG_XL:
        size = jxl_size(path)
        if size is not None and size[0] * size[1] > Limit.PIXELS.most:
            size_text = f"{size[0]} x {size[1]} px"
            raise Limit.PIXELS.error(Place(str(path)), found=size_text)
    return (kind.value,)


def _select_page(image: Image.Image, path: Path) -> None:
    """Select the first page of a TIFF that is not a thumbnail. Raises InputError."""
    try:
        if getattr(image, "n_frames", 1) > 1:
            pages = _full_pages(image)
            image.seek(pages[0] if pages else 0)
    except Exception as error:
        raise _damaged(path, error) from None


def _full_pages(image: Image.Image) -> list[int]:
    """Return the numbers of a TIFF's pages that are no smaller copies of another page."""
    sides: dict[int, int] = {}
    for page in range(min(getattr(image, "n_frames", 1), MOST_PAGES)):
        image.seek(page)
        if not _is_reduced(image):
            sides[page] = max(image.size)
    shortest_side = THUMBNAIL_SHARE * max(sides.values(), default=0)
    return [page for page, side in sides.items() if side > shortest_side]


def _is_reduced(image: Image.Image) -> bool:
    """Return whether a page of a TIFF is marked as a smaller copy of another, or as a mask."""
    tags = getattr(image, "tag_v2", {})
    is_old_copy = tags.get(OLD_SUBFILE) == OLD_REDUCED
    return bool(tags.get(SUBFILE, 0) & REDUCED) or is_old_copy


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
    """Decode the pixels. Raises InputError, one line, for a damaged picture."""
    # libtiff itself writes about a damaged file to stderr
    quiet = discard_native_errors() if image.format == "TIFF" else nullcontext()
    try:
        with quiet, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            image.load()
    except Exception as error:
        raise _damaged(path, error) from None


@contextmanager
def discard_native_errors() -> Iterator[None]:
    """Drop the output of this process's C libraries to stderr."""
    try:
        stderr = os.dup(STDERR)
    except OSError:  # it is closed
        yield
        return
    if sys.stderr is not None:
        sys.stderr.flush()
    with open(os.devnull, "wb") as sink:
        os.dup2(sink.fileno(), STDERR)
    try:
        yield
    finally:
        os.dup2(stderr, STDERR)
        os.close(stderr)


def picture_size(path: Path) -> tuple[int, int]:
    """Read width and height, px, from the file's header. Raises InputError."""
    with open_picture(path) as image:
        return image.size


def read_channels(path: Path) -> U8 | U16:
    """Read (H, W) or (H, W, 2 to 4), 8 or 16 bits: grey or red, green, blue, then the opacity if there is one.

    Of a palette without transparency, the indices. Raises InputError.
    """
    with open_picture(path) as image:
        decode_picture(image, path)
        deep_channels = read_16_bit(image, path)
        if deep_channels is not None:
            return (
                deep_channels[:, :, 0] if deep_channels.shape[2] == 1 else deep_channels
            )
        has_alpha = image.mode in WITH_ALPHA or "transparency" in image.info
        if image.mode == "P" and not has_alpha:
            return np.asarray(image)
        mode = "L" if image.mode in GREYS else "RGB"
        return np.asarray(image.convert(mode + "A" if has_alpha else mode))


def page_count(image: Image.Image) -> int:
    """Count the pictures in a file, without the smaller copies in a TIFF."""
    count = int(getattr(image, "n_frames", 1))
    if image.format != "TIFF" or count == 1:
        return count
    page = image.tell()
    pages = _full_pages(image)
    image.seek(page)
    return len(pages)


def read_16_bit(image: Image.Image, path: Path) -> U16 | None:
    """Read a loaded picture of 16 bits as (H, W, 1 to 4), opacity last; None for a picture of 8 bits.

    Pillow cuts colours of 16 bits to 8, so OpenCV reads those.
    """
    if image.mode.startswith("I"):
        return np.asarray(np.clip(np.asarray(image), 0, 65535)[:, :, None], np.uint16)
    if _bits(image, path) != 16 or image.mode not in ("LA", "RGB", "RGBA"):
        return None
    flags = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        with discard_native_errors():
            data = _decode_page(path, image.tell(), flags)
    except cv2.error:
        return None
    if data is None or data.dtype != np.uint16 or data.ndim != 3:
        return None
    order = cv2.COLOR_BGRA2RGBA if data.shape[2] == 4 else cv2.COLOR_BGR2RGB
    return np.asarray(cv2.cvtColor(data, order, data), np.uint16)


def _decode_page(path: Path, page: int, flags: int) -> NDArray[Any] | None:
    """Read a page with OpenCV; None for a file that it does not read."""
    file_bytes = np.frombuffer(path.read_bytes(), np.uint8)
    if page == 0:
        return cv2.imdecode(file_bytes, flags)
    _, pages = cv2.imdecodemulti(file_bytes, flags, range=(page, page + 1))
    return pages[0] if pages else None


def _bits(image: Image.Image, path: Path) -> int:
    """Return the bits of a channel by the file's header: Pillow's modes do not state them."""
    if image.format == "TIFF":
        return int(max(getattr(image, "tag_v2", {}).get(BITS, (1,))))
    if image.format != "PNG":
        return 8
    with path.open("rb") as stream:
        return stream.read(32)[24]


def _unusual(image: Image.Image, path: Path) -> str | None:
    """Name the kind of a picture that Pillow opens and that is no photo of 8 or 16 bits.

    None for a photo.
    """
    if image.mode in ("F", "LAB"):
        return f"a {image.format} of an unusual kind"
    if image.format != "TIFF":
        return None
    tags = getattr(image, "tag_v2", {})
    if (
        tags.get(SUBFILE, 0) & 1 or DNG in tags or tags.get(PHOTOMETRIC) in SENSOR
    ):  # Pillow would show a thumbnail
        return "a camera's raw file"
    bits = _bits(image, path)
    # Pillow and OpenCV mix such planes up
    has_deep_planes = bits == 16 and tags.get(PLANAR) == SEPARATE_PLANES
    is_odd = 8 < bits != 16 or (has_deep_planes and image.mode[0] != "I")
    return "a TIFF of an unusual kind" if is_odd else None


def _damaged(path: Path, error: Exception) -> InputError:
    reason = (str(error) or type(error).__name__).splitlines()[0][:120]
    return Message.PICTURE_DAMAGED.error(str(path), reason=reason)


# colour


def _meaning(image: Image.Image, path: Path) -> tuple[str, ToSrgb | None, bool]:
    """Return how to read a loaded file's numbers.

    Pillow's mode without alpha; the conversion of its colours, None for sRGB; whether the description of the colours
    could be used. Raises InputError for a high dynamic range.
    """
    is_grey = image.mode in GREYS or image.mode.startswith("I")
    mode = "L" if is_grey else "RGB"
    is_readable = True
    for describe in (_by_cicp, _by_profile, _by_nclx, _by_srgb_chunk, _by_gamma):
        try:
            to_srgb = describe(image, path)
        except HighDynamicRangeError:
            raise Message.PICTURE_HIGH_RANGE.error(str(path)) from None
        except ColourError:
            is_readable = False
            continue
        if to_srgb is None:
            continue
        if describe is _by_profile and image.mode == "CMYK":
            return "CMYK", to_srgb, is_readable
        if _is_srgb(to_srgb, is_grey):
            to_srgb = None
        return mode, to_srgb, is_readable
    return mode, None, is_readable


def _by_cicp(image: Image.Image, path: Path) -> ToSrgb | None:
    """Read the colours by the chunk cICP of a PNG, which goes before any other description.

    Raises ColourError.
    """
    if image.format != "PNG":
        return None
    body = _png_chunk(path, b"cICP")
    if body is None:
        return None
    if len(body) != 4 or body[2] != 0:  # a matrix is not allowed in PNG
        raise ColourError
    if UNSPECIFIED_CODE in (body[0], body[1]):
        return None  # the other chunks describe the colours
    return coded_space(body[0], body[1], is_full_range=body[3] == 1).to_srgb


def _png_chunk(path: Path, kind: bytes, *, is_late: bool = False) -> bytes | None:
    """Return the content of the first chunk of a kind; None if there is none.

    The search ends at the pixels, unless the chunk may be late.
    """
    with path.open("rb") as stream:
        stream.seek(8)
        while len(head := stream.read(8)) == 8:
            length, name = int.from_bytes(head[:4], "big"), head[4:]
            if name == kind:
                return stream.read(length)
            if name == b"IDAT" and not is_late:
                break
            stream.seek(length + 4, os.SEEK_CUR)
    return None


def _by_profile(image: Image.Image, path: Path) -> ToSrgb | None:
    """Read the colours by an ICC profile. Raises ColourError."""
    profile = image.info.get("icc_profile")
    if not profile:
        return None
    is_grey = image.mode in GREYS or image.mode.startswith("I")
    kind = profile[16:20].decode("latin-1").strip()
    if image.mode == "CMYK":
        if kind != "CMYK":
            raise ColourError
        return _by_littlecms(profile, "CMYK")
    if kind not in ("RGB", "GRAY") or (kind == "GRAY" and not is_grey):
        raise ColourError
    return _by_littlecms(profile, "L" if kind == "GRAY" else "RGB")


def _by_nclx(image: Image.Image, path: Path) -> ToSrgb | None:
    """Read the colours by the code points of a HEIF or AVIF file. Raises ColourError."""
    codes = None
    if image.format == "AVIF":
        codes = avif_colour_codes(path)
    elif profile := image.info.get("nclx_profile"):
        codes = profile["color_primaries"], profile["transfer_characteristics"]
    if codes is None:
        return None
    primaries, transfer = (int(code) for code in codes)
    # encoders of video name a camera's curve; browsers show such pictures as sRGB
    if transfer in (UNSPECIFIED_CODE, *CAMERA_CURVES):
        transfer = SRGB_CURVE_CODE
    if primaries == UNSPECIFIED_CODE:
        primaries = SRGB_PRIMARIES_CODE
    return coded_space(primaries, transfer).to_srgb


def _by_srgb_chunk(image: Image.Image, path: Path) -> ToSrgb | None:
    """Return the colours of a PNG with the chunk sRGB, which goes before gAMA and cHRM."""
    return _keep_srgb if "srgb" in image.info else None


def _keep_srgb(levels: NDArray[Any]) -> U8:
    return np.repeat(_eight_bits(levels), 3 // levels.shape[2], axis=2)


def _by_gamma(image: Image.Image, path: Path) -> ToSrgb | None:
    """Read the colours by the chunks gAMA and cHRM of a PNG. Raises ColourError."""
    gamma = image.info.get("gamma")
    chromaticities = image.info.get("chromaticity")
    if image.format != "PNG" or not (gamma or chromaticities):
        return None
    return measured_space(gamma, chromaticities).to_srgb


def _is_srgb(to_srgb: ToSrgb, is_grey: bool) -> bool:
    """Return whether no colour moves by more than one level."""
    step = np.arange(0, 256, 15).astype(np.uint8)
    colours = np.stack(np.meshgrid(step, step, step), -1).reshape(-1, 1, 3)
    if is_grey:
        colours = step[:, None, None]
    return bool(np.abs(to_srgb(colours).astype(int) - colours).max() <= 1)


def _by_littlecms(profile: bytes, mode: str) -> ToSrgb:
    """Convert with LittleCMS: 8 bits a channel, relative colorimetric, black point compensation.

    Raises ColourError.
    """
    from PIL import Image, ImageCms

    try:
        profile_object = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        intent = ImageCms.Intent.RELATIVE_COLORIMETRIC
        flags = ImageCms.Flags.BLACKPOINTCOMPENSATION
        if mode == "L":  # optimised, dark greys would be off by up to 10 levels
            flags |= ImageCms.Flags.NOOPTIMIZE
        srgb = ImageCms.createProfile("sRGB")
        transform = ImageCms.buildTransform(
            profile_object, srgb, mode, "RGB", intent, flags
        )
    except (
        ImageCms.PyCMSError,
        OSError,
        ImportError,
    ) as error:  # some builds of Pillow lack LittleCMS
        raise ColourError from error

    def to_srgb(numbers: NDArray[Any]) -> U8:
        levels = _eight_bits(numbers)
        if mode == "RGB" and levels.shape[2] == 1:
            levels = np.repeat(levels, 3, axis=2)
        picture = Image.frombytes(mode, levels.shape[1::-1], levels.tobytes())
        srgb_picture = ImageCms.applyTransform(picture, transform)
        assert (
            srgb_picture is not None
        )  # it is None only where the picture is changed in place
        return np.asarray(srgb_picture)

    return to_srgb
