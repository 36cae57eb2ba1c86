"""Photo files of any kind, depth and colour profile, read as upright 8-bit sRGB.

ICC profiles with a matrix or for grey, and PNG's gamma and primaries, are converted here in float, so that photos of
16 bits keep their accuracy; LittleCMS (8 bits a channel) converts by profiles with tables. Colours keep their place
relative to white (relative colorimetric); colours beyond sRGB are clipped channel by channel.
"""

from __future__ import annotations

import io
import struct
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.image_formats import EXIF_ORIENTATION, FORMATS, MOST_PIXELS, SCENE_FORMATS
from physgen.photometry import decode, encode_u8
from physgen.problems import InputError

if TYPE_CHECKING:
    from PIL import Image

U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
F64 = NDArray[np.float64]
Curve = Callable[[F64], F64]
"""Stored values 0..1 -> linear light 0..1."""
Linear = Callable[[NDArray[Any]], NDArray[np.float32]]
"""(H, W, 1, 3 or 4) stored numbers -> (H, W, 3) linear light of sRGB."""

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
INTEROPERABILITY, INDEX, ADOBE_INDEX = 0xA005, 1, "R03"
"""Where cameras declare Adobe RGB in EXIF data (CIPA DC-010)."""
BEYOND_WHITE = (16, 18)
"""Transfers of a PNG's cICP chunk: PQ and HLG (ITU-T H.273)."""
BITS, PHOTOMETRIC, SUBFILE, DNG = 258, 262, 254, 50706
"""Tags of TIFF."""
SENSOR = (32803, 34892)
"""Values of PHOTOMETRIC for undeveloped sensor data."""
FOREIGN = (
    (0, b"\x76\x2f\x31\x01", "OpenEXR"), (0, b"#?", "Radiance"), (4, b"ftyphe", "HEIC"), (4, b"ftypmif1", "HEIC"),
    (4, b"ftypavi", "AVIF"), (4, b"JXL ", "JPEG XL"), (0, b"\xff\x0a", "JPEG XL"), (0, b"8BPS", "Photoshop"),
    (0, b"FUJIFILM", "raw"), (0, b"IIR", "raw"), (8, b"CR", "raw"), (4, b"ftypcrx", "raw"), (0, b"II*\0", "TIFF"),
    (0, b"MM\0*", "TIFF"),
)  # fmt: skip
"""Formats that are not read: offset and bytes of their mark, and their name."""

D50 = (0.9642, 1.0, 0.8249)
"""XYZ of white where ICC profiles meet (ICC.1:2022, 7.2.16)."""
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
"""XYZ -> cone responses, in which one white is scaled to another (ICC.1:2022, annex E)."""
SRGB_PRIMARIES = (0.3127, 0.3290, 0.64, 0.33, 0.30, 0.60, 0.15, 0.06)
"""x, y of white, red, green and blue, in the order of PNG's cHRM (IEC 61966-2-1)."""
ADOBE_PRIMARIES = (0.3127, 0.3290, 0.64, 0.33, 0.21, 0.71, 0.15, 0.06)
ADOBE_GAMMA = 563 / 256
"""Adobe RGB (1998), 4.3."""
SRGB_GAMMA = (0.43, 0.48)
"""PNG writers store 1/2.2 = 0.45455 where they mean sRGB; values in this range are taken for it."""
TABLES = (b"A2B0", b"A2B1", b"A2B2", b"D2B0", b"D2B1", b"D2B2")
"""Tags of a profile that only a colour engine reads."""


@dataclass(frozen=True)
class Photo:
    """A photo and what is known of its file."""

    rgb: U8
    """(H, W, 3) sRGB."""
    plain: bool
    """Whether the file holds these very numbers, upright, in a format that a scene may name."""
    readable: bool = True
    """Whether its colour profile, if it has one, could be used; else the numbers were taken for sRGB."""


@dataclass(frozen=True)
class _PixelFormat:
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
    """A photo as a viewer shows it, turned by its EXIF data if `upright`, over white where it is transparent.

    A colour profile is applied, else PNG's gamma and primaries, else EXIF's mark of Adobe RGB; any other photo is sRGB.
    16 bits are rounded to 8 at the very end. Raises InputError.
    """
    with open_picture(path) as image:
        decode_picture(image, path)
        numbers = read_16_bit(image, path)
        turn = _orientation(image)
        meaning = _pixel_format(image, path, 256 if numbers is None else 65536)
        width, height = image.size if numbers is None else numbers.shape[1::-1]
        rgb = np.empty((height, width, 3), np.uint8)
        opaque = True
        for top in range(0, height, BAND):
            rows = slice(top, min(top + BAND, height))
            if numbers is None:
                band = np.asarray(image.crop((0, top, width, rows.stop)).convert(meaning.mode))
                band = band[:, :, None] if band.ndim == 2 else band
                has_alpha = meaning.mode.endswith("A")
            else:
                band = numbers[rows]
                has_alpha = band.shape[2] in (2, 4)
            rgb[rows], whole = _to_srgb(band, has_alpha, meaning.linear)
            opaque &= whole
        eight = numbers is None and image.mode in PLAIN and image.format in SCENE_FORMATS
    plain = eight and opaque and meaning.linear is None and turn == 1
    if upright and turn in TURNS:
        rgb = np.ascontiguousarray(TURNS[turn](rgb))
    return Photo(rgb, plain, meaning.readable)


def _to_srgb(band: NDArray[Any], has_alpha: bool, linear: Linear | None) -> tuple[U8, bool]:
    """Stored numbers -> (h, w, 3) sRGB over white, composed in linear light; and whether all are opaque."""
    full = np.iinfo(band.dtype).max
    alpha = band[:, :, -1] if has_alpha else None
    colour = band[:, :, :-1] if has_alpha else band
    opaque = alpha is None or bool((alpha == full).all())
    if linear is None and opaque:
        levels = colour if full == 255 else cv2.convertScaleAbs(colour, alpha=1 / 257).reshape(colour.shape)
        return np.broadcast_to(levels, (*colour.shape[:2], 3)), True
    light = (linear or SRGB.reader(full + 1))(colour)
    if alpha is not None and not opaque:
        light = 1 + (light - 1) * (alpha.astype(np.float32) / np.float32(full))[:, :, None]
    return encode_u8(light), opaque


def _pixel_format(image: Image.Image, path: Path, codes: int) -> _PixelFormat:
    """The meaning of a loaded file's numbers, 0 .. `codes` - 1. Raises InputError for light beyond white."""
    grey = image.mode in GREYS or image.mode.startswith("I")
    mode = ("L" if grey else "RGB") + "A" * (image.mode in WITH_ALPHA or "transparency" in image.info)
    if image.mode == "LAB":
        from PIL import ImageCms

        return _PixelFormat("LAB", _littlecms(ImageCms.createProfile("LAB"), "LAB"))
    space: ColourSpace | None = None
    profile = image.info.get("icc_profile")
    if profile:
        try:
            kind = icc_kind(profile)
            if kind == "CMYK" == image.mode:
                return _PixelFormat("CMYK", _littlecms(profile, "CMYK"))
            if image.mode == "CMYK" or not (kind == "RGB" or (kind == "GRAY" and grey)):
                raise ProfileError
            try:
                space = icc_space(profile)
            except ProfileError:
                return _PixelFormat(mode, _littlecms(profile, "L" if kind == "GRAY" else "RGB"))
        except ProfileError:
            return _PixelFormat(mode, None, readable=False)
    elif image.format == "PNG":
        if _png_transfer(path) in BEYOND_WHITE:
            raise too_bright(path, " PNG")
        if "srgb" not in image.info:
            space = png_space(image.info.get("gamma"), image.info.get("chromaticity"))
    elif _is_adobe_rgb(image):
        space = ColourSpace((gamma_curve(ADOBE_GAMMA),) * 3, from_d50() @ to_d50(ADOBE_PRIMARIES))
    return _PixelFormat(mode, None if space is None or space.is_srgb else space.reader(codes))


def _littlecms(profile: Any, mode: str) -> Linear:
    """LittleCMS: 8 bits a channel, relative colorimetric with black point compensation.

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
        assert changed is not None  # it is None only where the picture is changed in place
        return decode(np.asarray(changed))

    return linear


def _png_transfer(path: Path) -> int | None:
    """The transfer of a PNG's cICP chunk, which Pillow does not read."""
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

    A PNG may have it behind its pixels.
    """
    with suppress(Exception):  # Pillow's reader raises errors of many kinds
        if image.format != "TIFF" and "exif" in image.info:
            return int(image.getexif().get(EXIF_ORIENTATION, 1))
    return 1


def _is_adobe_rgb(image: Image.Image) -> bool:
    with suppress(Exception):
        if "exif" in image.info:
            index = image.getexif().get_ifd(INTEROPERABILITY).get(INDEX, "")
            return str(index).strip("\0 ") == ADOBE_INDEX
    return False


# files


def picture_problem(path: Path, found: str, expected: str, fix: str) -> InputError:
    """One problem with a picture file."""
    return InputError.of(str(path), found, expected, fix)


def too_bright(path: Path, kind: str) -> InputError:
    """The problem of light beyond white: the user must choose the part of it that a photo shows."""
    fix = "tone-map it, and save it as an 8- or 16-bit PNG"
    return picture_problem(path, "", f"is a{kind} picture of light beyond white", fix)


@contextmanager
def open_picture(path: Path) -> Iterator[Image.Image]:
    """Pillow's view of a picture, its size checked before pixels are decoded. Raises InputError."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns below our own limit
            image = Image.open(path, formats=FORMATS)
    except FileNotFoundError:
        raise picture_problem(path, "", "no such file", "check the path") from None
    except IsADirectoryError:
        raise picture_problem(path, "", "is a folder", "name a picture in it") from None
    except PermissionError:
        raise picture_problem(path, "", "may not be read", "change its permissions") from None
    except Image.DecompressionBombError:
        raise picture_problem(path, "", "is over 100 megapixels", "make the picture smaller") from None
    except Exception as error:  # for damaged headers Pillow's readers raise errors of many kinds
        raise _unreadable(path, error) from None
    with image:
        width, height = image.size
        if width * height > MOST_PIXELS:
            found = f"{width} x {height} px"
            raise picture_problem(path, found, "is over 100 megapixels", "make the picture smaller")
        _check_kind(image, path)
        yield image


def decode_picture(image: Image.Image, path: Path) -> None:
    """Decodes the pixels. Raises InputError, one line, for a damaged picture."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            image.load()
    except Exception as error:
        raise _unreadable(path, error) from None


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
        grey = np.clip(np.asarray(image), 0, 65535).astype(np.uint16)
        if image.format == "TIFF" and _tags(image).get(PHOTOMETRIC) == 0:  # white is 0
            grey = 65535 - grey
        raw = grey[:, :, None]
    elif _bits(image, path) == 16 and image.mode in ("LA", "RGB", "RGBA"):
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
        raw = cv2.cvtColor(data, cv2.COLOR_BGRA2RGBA if data.shape[2] == 4 else cv2.COLOR_BGR2RGB, data)
    else:
        return None
    key = image.info.get("transparency")
    if key is not None and raw.shape[2] in (1, 3):  # one colour is transparent
        opaque = np.where((raw == np.atleast_1d(key)).all(axis=2), 0, 65535).astype(np.uint16)
        raw = np.concatenate([raw, opaque[:, :, None]], axis=2)
    return np.asarray(raw, np.uint16)


def _tags(image: Image.Image) -> Any:
    return getattr(image, "tag_v2", {})


def _bits(image: Image.Image, path: Path) -> int:
    """Of a channel, by the file's header: Pillow's modes do not have them."""
    if image.format == "TIFF":
        return int(max(_tags(image).get(BITS, (1,))))
    return _head(path)[24] if image.format == "PNG" else 8


def _head(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(32)


def _check_kind(image: Image.Image, path: Path) -> None:
    """Raises InputError for pictures that Pillow opens and that are no photos of 8 or 16 bits."""
    if image.mode == "F":
        raise too_bright(path, f" {image.format} float")
    if image.format != "TIFF":
        return
    tags = _tags(image)
    undeveloped = DNG in tags or tags.get(PHOTOMETRIC) in SENSOR or _foreign(path) == "raw"
    if undeveloped or tags.get(SUBFILE, 0) & 1:  # Pillow would show a thumbnail of it
        raise _not_read(path, "raw")
    bits = _bits(image, path)
    if bits > 8 and bits != 16:
        fix = "save it as an 8- or 16-bit PNG"
        raise picture_problem(path, f"{bits} bits a channel", "are not 8 or 16", fix)


def _foreign(path: Path) -> str | None:
    """The file's format by its first bytes, among those that are not read."""
    head = _head(path)
    return next((name for at, mark, name in FOREIGN if head[at : at + len(mark)] == mark), None)


def _not_read(path: Path, kind: str) -> InputError:
    expected, fix = (
        f"is {'an' if kind[0] in 'AEIO' else 'a'} {kind} file, which is not read",
        "save it as PNG or JPEG",
    )
    if kind == "raw":
        expected, fix = "is a camera's raw file", "develop it, and save it as PNG or JPEG"
    elif kind == "TIFF":
        expected = "is a TIFF of an unusual kind, or damaged"
        fix = "save it as PNG, or as TIFF of 8 or 16 bits a channel"
    return picture_problem(path, "", expected, fix)


def _unreadable(path: Path, error: Exception) -> InputError:
    from PIL import UnidentifiedImageError

    reason = f" ({(str(error) or type(error).__name__).splitlines()[0][:120]})"
    if isinstance(error, UnidentifiedImageError):
        kind = _foreign(path)
        if kind in ("OpenEXR", "Radiance"):
            return too_bright(path, f"{'n' * (kind == 'OpenEXR')} {kind}")
        if kind is not None:
            return _not_read(path, kind)
        reason = ""
    return picture_problem(path, "", f"is not a picture that can be read{reason}", "save it as PNG or JPEG")


# colour


class ProfileError(Exception):
    """A profile that is damaged, or of tables, or not for these pixels."""


@dataclass(frozen=True, eq=False)
class ColourSpace:
    """A grey or RGB space: curves to linear light, then a matrix."""

    curves: tuple[Curve, ...]
    """One for grey, three for RGB."""
    matrix: F64 | None = None
    """(3, 3) linear light of the space -> linear light of sRGB; None: the same primaries."""

    @cached_property
    def is_srgb(self) -> bool:
        """Whether no colour of 8 bits moves by more than one level."""
        step = np.arange(0, 256, 15, dtype=np.uint8)
        if len(self.curves) == 1:
            colours = step[:, None, None]
        else:
            colours = np.stack(np.meshgrid(step, step, step), axis=-1).reshape(-1, 1, 3)
        moved = encode_u8(self.reader(256)(colours)).astype(int) - colours
        return bool(np.abs(moved).max() <= 1)

    def reader(self, codes: int) -> Linear:
        """A function of pixels (H, W, 1 or 3) of 0 .. codes - 1 -> (H, W, 3) linear light of sRGB.

        Grey pixels may be in an RGB space.
        """
        with np.errstate(all="ignore"):  # a damaged profile has any values
            bent = [np.nan_to_num(curve(np.arange(codes) / (codes - 1)), posinf=1.0) for curve in self.curves]
        tables = [np.clip(light, 0.0, 1.0).astype(np.float32) for light in bent]

        def linear(pixels: NDArray[Any]) -> NDArray[np.float32]:
            light = np.empty((*pixels.shape[:2], 3), np.float32)
            for c in range(3):
                light[:, :, c] = tables[c % len(tables)][pixels[:, :, c % pixels.shape[2]]]
            return light if self.matrix is None else np.asarray(cv2.transform(light, self.matrix), np.float32)

        return linear


SRGB = ColourSpace((lambda v: decode(v).astype(np.float64),))


def gamma_curve(gamma: float) -> Curve:
    """A pure power."""
    return lambda v: np.asarray(v**gamma)


def to_d50(primaries: Sequence[float]) -> F64:
    """(3, 3): linear RGB of `primaries` (x, y of white, red, green, blue) -> XYZ, white brought to D50."""
    xy = np.array(primaries, float).reshape(4, 2)
    white, red, green, blue = (np.array([x / y, 1.0, (1 - x - y) / y]) for x, y in xy)
    matrix = np.stack([red, green, blue], axis=1)
    matrix = matrix * np.linalg.solve(matrix, white)
    cones = np.diag((BRADFORD @ np.array(D50)) / (BRADFORD @ white))
    return np.asarray(np.linalg.solve(BRADFORD, cones @ BRADFORD @ matrix))


def from_d50() -> F64:
    """(3, 3): XYZ with white at D50 -> linear light of sRGB."""
    return np.asarray(np.linalg.inv(to_d50(SRGB_PRIMARIES)))


def png_space(gamma: float | None, primaries: Sequence[float] | None) -> ColourSpace | None:
    """The space of a PNG by its gAMA (the exponent of its values) and cHRM chunks; None without gAMA."""
    if gamma is None or not 0.05 <= gamma <= 5:
        return None
    curve = SRGB.curves[0] if SRGB_GAMMA[0] < gamma < SRGB_GAMMA[1] else gamma_curve(1 / gamma)
    if primaries is None or np.allclose(primaries, SRGB_PRIMARIES, atol=0.005):
        return ColourSpace((curve,) * 3)
    try:
        matrix = from_d50() @ to_d50(primaries)
    except (ZeroDivisionError, np.linalg.LinAlgError):
        return ColourSpace((curve,) * 3)
    return ColourSpace((curve,) * 3, matrix if np.isfinite(matrix).all() else None)


def icc_kind(profile: bytes) -> str:
    """The colours of a profile, `RGB`, `GRAY`, `CMYK`, ...; raises ProfileError for data that are no profile."""
    if len(profile) < 132 or profile[36:40] != b"acsp":
        raise ProfileError
    return profile[16:20].decode("latin-1").strip()


def icc_space(profile: bytes) -> ColourSpace:
    """The space of a matrix profile, or of one for grey. Raises ProfileError for others (ICC.1:2022, 8.3 and 8.4)."""
    kind, connects = icc_kind(profile), profile[20:24]
    try:
        (count,) = struct.unpack_from(">I", profile, 128)
        rows = [struct.unpack_from(">4sII", profile, 132 + 12 * k) for k in range(min(count, 200))]
        tags: Mapping[bytes, bytes] = {name: profile[at : at + size] for name, at, size in rows}
        if any(name in tags for name in TABLES):
            raise ProfileError
        if kind == "GRAY":
            curve = _icc_curve(tags[b"kTRC"])
            return ColourSpace((curve if connects == b"XYZ " else _from_lightness(curve),))
        if kind != "RGB" or connects != b"XYZ ":
            raise ProfileError
        columns = [struct.unpack_from(">3i", tags[name], 8) for name in (b"rXYZ", b"gXYZ", b"bXYZ")]
        curves = tuple(_icc_curve(tags[name]) for name in (b"rTRC", b"gTRC", b"bTRC"))
    except (KeyError, struct.error, ValueError) as error:
        raise ProfileError from error
    return ColourSpace(curves, from_d50() @ (np.array(columns).T / 65536))


def _icc_curve(tag: bytes) -> Curve:
    """`curveType`: a power or a table; `parametricCurveType`: a power with a straight foot (10.6 and 10.18)."""
    kind, count = struct.unpack_from(">4s4xI", tag)
    if kind == b"curv":
        if count == 0:
            return gamma_curve(1.0)
        if count == 1:
            return gamma_curve(struct.unpack_from(">H", tag, 12)[0] / 256)
        table = np.array(struct.unpack_from(f">{count}H", tag, 12)) / 65535
        return lambda v: np.interp(v, np.linspace(0, 1, count), table)
    shape = count >> 16
    if kind != b"para" or shape > 4:
        raise ProfileError
    given = [value / 65536 for value in struct.unpack_from(f">{(1, 3, 4, 5, 7)[shape]}i", tag, 12)]
    g, a, b, c, d, e, f = given + [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0][len(given) :]
    if shape in (1, 2):  # (a v + b)^g + c from -b/a on, c before
        d, e, f, c = (-b / a if a else 0.0), c, c, 0.0

    def parametric(v: F64) -> F64:
        bent = np.maximum(a * v + b, 0.0) ** g + e
        return np.asarray(np.clip(np.where(v >= d, bent, c * v + f), 0.0, 1.0))

    return parametric


def _from_lightness(curve: Curve) -> Curve:
    """A curve to CIE lightness, 0..1 for L* = 0..100 -> one to linear light (ISO 11664-4)."""

    def light(v: F64) -> F64:
        f = (100 * curve(v) + 16) / 116
        return np.asarray(np.where(f > 6 / 29, f**3, 3 * (6 / 29) ** 2 * (f - 4 / 29)))

    return light
