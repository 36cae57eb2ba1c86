"""A photo's file -> sRGB of 8 bits, upright: whatever its kind, depth and colour profile."""

from __future__ import annotations

import io
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.percepts.colour import SRGB, ProfileError, Space, adobe_rgb, icc_kind, icc_space, png_space
from physgen.percepts.pixels import deep, load, opened, too_bright
from physgen.photometry import decode, encode_u8
from physgen.pictures import EXIF_ORIENTATION, SCENE_FORMATS

if TYPE_CHECKING:
    from PIL import Image

U8 = NDArray[np.uint8]
Linear = Callable[[NDArray[Any]], NDArray[np.float32]]
"""(H, W, 1, 3 or 4) stored numbers -> (H, W, 3) linear light of sRGB."""

BAND = 512
"""Rows that are converted at a time, so that little is held between the file and the result."""
GREYS = ("1", "L", "LA", "La")
OPACITY = ("LA", "La", "PA", "RGBA", "RGBa")
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
INTEROPERABILITY, INDEX, ADOBE_INDEX = 0xA005, 1, "R03"
"""Where cameras say in EXIF data that their numbers are Adobe RGB (CIPA DC-010)."""
BEYOND_WHITE = (16, 18)
"""Transfers of a PNG's cICP chunk: PQ and HLG (ITU-T H.273)."""


@dataclass(frozen=True)
class Photo:
    """A photo as everything behind this floor sees it."""

    rgb: U8
    """(H, W, 3) sRGB."""
    plain: bool
    """Whether the file holds these very numbers, upright, in a format that a scene may name."""
    readable: bool = True
    """Whether its colour profile, if it has one, could be used; else the numbers were taken for sRGB."""


@dataclass(frozen=True)
class _Meaning:
    """How to read a file's numbers."""

    mode: str
    """Pillow's mode to bring 8-bit pixels to; opacity, where there is any, is the last channel."""
    linear: Linear | None
    """None: they are sRGB."""
    readable: bool = True


def read_image(path: Path) -> U8:
    """A photo as (H, W, 3) uint8 sRGB, in the file's own axes; see `read_photo`."""
    return read_photo(path, upright=False).rgb


def read_photo(path: Path, upright: bool = True) -> Photo:
    """A photo as a viewer shows it, turned as its EXIF data says if `upright`, over white where light passes through.

    A colour profile is applied, else PNG's gamma and primaries, else EXIF's word for Adobe RGB; a photo that says
    nothing is sRGB. 16 bits are rounded to 8 at the very end. Raises InputError.
    """
    with opened(path) as image:
        load(image, path)
        numbers = deep(image, path)
        turn = _orientation(image)
        meaning = _meaning(image, path, 256 if numbers is None else 65536)
        width, height = image.size if numbers is None else numbers.shape[1::-1]
        rgb = np.empty((height, width, 3), np.uint8)
        opaque = True
        for top in range(0, height, BAND):
            rows = slice(top, min(top + BAND, height))
            if numbers is None:
                band = np.asarray(image.crop((0, top, width, rows.stop)).convert(meaning.mode))
                band = band[:, :, None] if band.ndim == 2 else band
                clear = meaning.mode.endswith("A")
            else:
                band = numbers[rows]
                clear = band.shape[2] in (2, 4)
            rgb[rows], whole = _shown(band, clear, meaning.linear)
            opaque &= whole
        eight = numbers is None and image.mode in PLAIN and image.format in SCENE_FORMATS
    plain = eight and opaque and meaning.linear is None and turn == 1
    if upright and turn in TURNS:
        rgb = np.ascontiguousarray(TURNS[turn](rgb))
    return Photo(rgb, plain, meaning.readable)


def _shown(band: NDArray[Any], clear: bool, linear: Linear | None) -> tuple[U8, bool]:
    """Stored numbers -> (h, w, 3) sRGB over white, laid on it in linear light; and whether all are opaque."""
    full = np.iinfo(band.dtype).max
    alpha = band[:, :, -1] if clear else None
    colour = band[:, :, :-1] if clear else band
    opaque = alpha is None or bool((alpha == full).all())
    if linear is None and opaque:
        levels = colour if full == 255 else cv2.convertScaleAbs(colour, alpha=1 / 257).reshape(colour.shape)
        return np.broadcast_to(levels, (*colour.shape[:2], 3)), True
    light = (linear or SRGB.reader(full + 1))(colour)
    if alpha is not None and not opaque:
        light = 1 + (light - 1) * (alpha.astype(np.float32) / np.float32(full))[:, :, None]
    return encode_u8(light), opaque


def _meaning(image: Image.Image, path: Path, codes: int) -> _Meaning:
    """What a loaded file's numbers, 0 .. `codes` - 1, mean. Raises InputError for light beyond white."""
    grey = image.mode in GREYS or image.mode.startswith("I")
    clear = image.mode in OPACITY or "transparency" in image.info
    mode = ("L" if grey else "RGB") + "A" * clear
    if image.mode == "LAB":
        from PIL import ImageCms

        return _Meaning("LAB", _engine(ImageCms.createProfile("LAB"), "LAB"))
    space: Space | None = None
    profile = image.info.get("icc_profile")
    if profile:
        try:
            kind = icc_kind(profile)
            if kind == "CMYK" == image.mode:
                return _Meaning("CMYK", _engine(profile, "CMYK"))
            if image.mode == "CMYK" or not (kind == "RGB" or (kind == "GRAY" and grey)):
                raise ProfileError
            try:
                space = icc_space(profile)
            except ProfileError:
                return _Meaning(mode, _engine(profile, "L" if kind == "GRAY" else "RGB"))
        except ProfileError:
            return _Meaning(mode, None, readable=False)
    elif image.format == "PNG":
        if _transfer(path) in BEYOND_WHITE:
            raise too_bright(path, " PNG")
        if "srgb" not in image.info:
            space = png_space(image.info.get("gamma"), image.info.get("chromaticity"))
    elif _says_adobe(image):
        space = adobe_rgb()
    return _Meaning(mode, None if space is None or space.is_srgb else space.reader(codes))


def _engine(profile: Any, mode: str) -> Linear:
    """LittleCMS, for profiles of tables: 8 bits a channel, relative colorimetric with black point compensation.

    `profile` is the file's bytes or one of Pillow's. Raises ProfileError.
    """
    from PIL import Image, ImageCms

    try:
        given = ImageCms.ImageCmsProfile(io.BytesIO(profile) if isinstance(profile, bytes) else profile)
        intent, flags = ImageCms.Intent.RELATIVE_COLORIMETRIC, ImageCms.Flags.BLACKPOINTCOMPENSATION
        srgb = ImageCms.createProfile("sRGB")
        transform = ImageCms.buildTransform(given, srgb, mode, "RGB", intent, flags)
    except (ImageCms.PyCMSError, OSError, ImportError) as error:  # some builds of Pillow lack LittleCMS
        raise ProfileError from error

    def linear(colour: NDArray[Any]) -> NDArray[np.float32]:
        levels = cv2.convertScaleAbs(colour, alpha=1 / 257) if colour.dtype == np.uint16 else colour
        levels = levels.reshape(colour.shape)
        if mode == "RGB" and colour.shape[2] == 1:
            levels = np.repeat(levels, 3, axis=2)
        picture = Image.frombytes(mode, colour.shape[1::-1], levels.tobytes())
        changed = ImageCms.applyTransform(picture, transform)
        assert changed is not None  # it is where nothing is changed in place
        return decode(np.asarray(changed))

    return linear


def _transfer(path: Path) -> int | None:
    """The transfer that a PNG's cICP chunk names, which Pillow passes over."""
    with path.open("rb") as stream:
        stream.seek(8)
        while len(head := stream.read(8)) == 8 and head[4:] != b"IDAT":
            length = int.from_bytes(head[:4], "big")
            if head[4:] == b"cICP" and length == 4:
                return stream.read(4)[1]
            stream.seek(length + 4, 1)
    return None


def _orientation(image: Image.Image) -> int:
    """Of a loaded picture, as EXIF counts, 1 to 8; 1 where that is damaged, and for TIFF, which both readers turn.

    A PNG may say it behind its pixels.
    """
    with suppress(Exception):  # Pillow's reader raises errors of many kinds
        if image.format != "TIFF" and "exif" in image.info:
            return int(image.getexif().get(EXIF_ORIENTATION, 1))
    return 1


def _says_adobe(image: Image.Image) -> bool:
    with suppress(Exception):
        if "exif" in image.info:
            said = image.getexif().get_ifd(INTEROPERABILITY).get(INDEX, "")
            return str(said).strip("\0 ") == ADOBE_INDEX
    return False
