"""Maps of a photo: a folder of pictures <-> arrays. Every map opens in a paint program; what is missing is None."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.pictures import EXIF_ORIENTATION, FORMATS, MOST_PIXELS, SCENE_FORMATS
from physgen.problems import InputError
from physgen.whole import write_kept

if TYPE_CHECKING:
    from PIL import Image

U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
F32 = NDArray[np.float32]

Keep = Callable[[Path], None]
"""Told of every file that was kept under another name."""


def silent(kept: Path) -> None:
    """Nobody is told."""


@dataclass(frozen=True)
class Percepts:
    """What is known of a photo, per pixel."""

    rgb: U8
    """(H, W, 3) sRGB."""
    labels: U16
    """(H, W), 0 = background; every object, truncated ones too."""
    coverage: F32 | None = None
    """(H, W) in 0..1: how much of the pixel objects cover, soft at their borders."""
    background: U8 | None = None
    """(H, W, 3) sRGB: objects filled, old shadows still there; equals `rgb` where coverage is 0."""
    clean: U8 | None = None
    """(H, W, 3) sRGB: the background without the objects' shadows."""
    depth: F32 | None = None
    """(H, W), larger = farther."""
    normals: F32 | None = None
    """(H, W, 3) unit, +x right, +y down, +z to the viewer."""
    albedo: F32 | None = None
    """(H, W, 3) linear."""
    shading: F32 | None = None
    """(H, W) linear."""


def read_image(path: Path) -> U8:
    """A photo as (H, W, 3) uint8 sRGB; grey, palette, alpha (over white) and 16-bit pictures are converted."""
    with _opened(path) as image:
        if image.mode in ("P", "PA"):
            raw: NDArray[np.uint8] | NDArray[np.uint16] = np.asarray(image.convert("RGBA"))[
                :, :, [2, 1, 0, 3]
            ]
        else:
            raw = _decode(path)
    if raw.dtype == np.uint16:
        raw = (raw / 257.0 + 0.5).astype(np.uint8)
    if raw.ndim == 2:
        return np.ascontiguousarray(np.repeat(raw[:, :, None], 3, axis=2))
    rgb = raw[:, :, 2::-1]
    if raw.shape[2] == 4:
        alpha = raw[:, :, 3:] / 255.0
        rgb = (rgb * alpha + 255.0 * (1 - alpha) + 0.5).astype(np.uint8)
    return np.ascontiguousarray(rgb)


def read_upright(path: Path) -> tuple[U8, bool]:
    """A photo, turned as its EXIF data says, and whether a scene can name the file: upright, PNG, JPEG or WebP."""
    from PIL import ImageOps

    with _opened(path) as image:
        if "exif" not in image.info or image.getexif().get(EXIF_ORIENTATION, 1) == 1:
            return read_image(path), image.format in SCENE_FORMATS
        return np.array(ImageOps.exif_transpose(image).convert("RGB")), False


def read_labels(path: Path) -> U16:
    """A label map: one channel of ids as it is; the distinct colours of a colour picture numbered, black = 0."""
    with _opened(path) as image:
        if image.format in ("JPEG", "MPO"):
            fix = "save it as PNG, without smoothing"
            raise InputError.of(str(path), "", "is a JPEG, whose compression changes ids", fix)
    raw = _decode(path)
    if raw.ndim == 2:
        return raw.astype(np.uint16)
    channels = raw[:, :, :3]
    if np.array_equal(channels[..., 0], channels[..., 1]) and np.array_equal(
        channels[..., 0], channels[..., 2]
    ):
        return channels[..., 0].astype(np.uint16)
    code = (channels.astype(np.uint64) * np.array([1, 2**16, 2**32], np.uint64)).sum(axis=2)
    colours, ids = np.unique(code, return_inverse=True)
    if len(colours) > 65535:
        raise InputError.of(
            str(path),
            f"{len(colours)} colours",
            "are too many for a label map",
            "give each object one colour",
        )
    ids = ids.reshape(code.shape)
    return (ids if colours[0] == 0 else ids + 1).astype(np.uint16)


def read_percepts(
    image: Path | None, assets: Path | None, maps: Mapping[str, tuple[float, float]]
) -> Percepts | None:
    """The photo with the maps found in its assets folder; None for a scene without a photo.

    `maps` tells what 0 and 65535 stand for in depth.png and shading.png.
    """
    if image is None:
        return None
    rgb = read_image(image)
    H, W = rgb.shape[:2]

    def find(name: str) -> Path | None:
        path = assets / name if assets else None
        return path if path and path.is_file() else None

    def raw(name: str) -> NDArray[np.uint8] | NDArray[np.uint16] | None:
        path = find(name)
        if path is None:
            return None
        picture = _decode(path)
        if picture.shape[:2] != (H, W):
            found = f"{picture.shape[1]} x {picture.shape[0]} px"
            raise InputError.of(
                str(path), found, f"differs from the photo's {W} x {H} px", "make it the photo's size"
            )
        return picture

    def colour(name: str) -> U8 | None:
        return None if raw(name) is None else read_image(Path(str(find(name))))

    def scalar(name: str) -> F32 | None:
        picture = raw(f"{name}.png")
        if picture is None:
            return None
        low, high = maps.get(name, (0.0, 1.0))
        grey = picture if picture.ndim == 2 else picture[:, :, 0]
        full = 65535.0 if picture.dtype == np.uint16 else 255.0
        return (low + (high - low) * (grey.astype(np.float32) / full)).astype(np.float32)

    labels = np.zeros((H, W), np.uint16)
    if raw("masks.png") is not None:
        labels = read_labels(Path(str(find("masks.png"))))
    soft = raw("coverage.png")
    coverage = None
    if soft is not None:
        grey = soft if soft.ndim == 2 else soft[:, :, 0]
        coverage = (grey.astype(np.float32) / np.float32(np.iinfo(soft.dtype).max)).astype(np.float32)
    normals = raw("normals.png")
    albedo = raw("albedo.png")
    return Percepts(
        rgb=rgb,
        labels=labels,
        coverage=coverage,
        background=colour("background.png"),
        clean=colour("clean.png"),
        depth=scalar("depth"),
        normals=None
        if normals is None
        else ((normals[:, :, 2::-1].astype(np.float32) - 128) / 127).astype(np.float32),
        albedo=None if albedo is None else (albedo[:, :, 2::-1].astype(np.float32) / np.float32(65535)),
        shading=scalar("shading"),
    )


def write_assets(percepts: Percepts, folder: Path, keep: Keep = silent) -> dict[str, tuple[float, float]]:
    """Write the maps into `folder` (created); returns what 0 and 65535 stand for in the 16-bit ones, by map.

    A map that is there already and differs, perhaps painted by hand, is kept as `NAME~`, and `keep` told of it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    ranges: dict[str, tuple[float, float]] = {}

    def scalar(name: str, values: F32 | None) -> None:
        if values is None:
            return
        low, high = float(values.min()), float(values.max())
        high = high if high > low else low + 1.0
        ranges[name] = (low, high)
        write_png(
            folder / f"{name}.png", ((values - low) / (high - low) * 65535 + 0.5).astype(np.uint16), keep
        )

    write_png(folder / "masks.png", percepts.labels, keep)
    if percepts.coverage is not None:
        write_png(folder / "coverage.png", (percepts.coverage * 255 + 0.5).astype(np.uint8), keep)
    for name, picture in (("background", percepts.background), ("clean", percepts.clean)):
        if picture is not None:
            write_png(folder / f"{name}.png", picture, keep)
    scalar("depth", percepts.depth)
    scalar("shading", percepts.shading)
    if percepts.normals is not None:
        write_png(
            folder / "normals.png", np.clip(percepts.normals * 127 + 128.5, 0, 255).astype(np.uint8), keep
        )
    if percepts.albedo is not None:
        write_png(
            folder / "albedo.png", (np.clip(percepts.albedo, 0, 1) * 65535 + 0.5).astype(np.uint16), keep
        )
    return ranges


def write_png(path: Path, picture: U8 | U16, keep: Keep = silent) -> None:
    """(H, W) or (H, W, 3) RGB, 8 or 16 bits; whole or not at all, a differing file that is there is kept as `NAME~`."""
    bgr = picture if picture.ndim == 2 else picture[:, :, ::-1]
    done, data = cv2.imencode(".png", np.ascontiguousarray(bgr), [cv2.IMWRITE_PNG_COMPRESSION, 6])
    if not done:
        raise ValueError(
            f"{path.name}: a picture of shape {picture.shape} and type {picture.dtype} cannot be a PNG"
        )
    write_kept(path, data.tobytes(), keep)


def _decode(path: Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The picture's own channels (BGR order for colour), 8 or 16 bits; the header is read before the pixels."""
    with _opened(path) as image:
        if image.mode == "P":  # ids of a palette picture are its indices, which OpenCV turns into colours
            return np.asarray(image).astype(np.uint8)
        image.load()  # a damaged picture is told of here, in one line; OpenCV's readers print
        data = np.frombuffer(path.read_bytes(), np.uint8)
        flags = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
        picture = None if image.mode == "CMYK" else cv2.imdecode(data, flags)
        if picture is None:
            picture = np.asarray(image.convert("RGB"))[:, :, ::-1]
    if picture.dtype not in (np.uint8, np.uint16):
        found = f"{picture.dtype} pixels"
        raise InputError.of(str(path), found, "are not 8 or 16 bits", "save it as an 8-bit PNG")
    return picture  # type: ignore[return-value]


@contextmanager
def _opened(path: Path) -> Iterator[Image.Image]:
    """Pillow's view of a picture, its size checked before pixels are decoded; trouble on the way becomes InputError."""
    from PIL import Image

    try:
        with warnings.catch_warnings(), Image.open(path, formats=FORMATS) as image:
            warnings.simplefilter("ignore")  # Pillow warns below our own limit
            width, height = image.size
            if width * height > MOST_PIXELS:
                found = f"{width} x {height} px"
                raise InputError.of(str(path), found, "is over 100 megapixels", "make the picture smaller")
            yield image
    except FileNotFoundError:
        raise InputError.of(str(path), "", "no such file", "check the path") from None
    except IsADirectoryError:
        raise InputError.of(str(path), "", "is a folder", "name a picture in it") from None
    except (OSError, SyntaxError, ValueError, cv2.error, Image.DecompressionBombError) as error:
        if isinstance(error, Image.DecompressionBombError):
            raise InputError.of(str(path), "", "is over 100 megapixels", "make the picture smaller") from None
        reason = (str(error) or type(error).__name__).splitlines()[0][:120]
        expected = f"is not a picture that can be read ({reason})"
        raise InputError.of(str(path), "", expected, "save it as PNG or JPEG") from None
