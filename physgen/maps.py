"""Maps of a photo in memory and as a folder of pictures that any paint program opens."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.files import back_up, write_with_backup
from physgen.photos import (
    open_picture,
    page_count,
    picture_size,
    read_channels,
    read_image,
)
from physgen.problems import InputError, Limit, Place

U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
F32 = NDArray[np.float32]

Keep = Callable[[Path], None]
"""Called with every file that was kept under another name."""


def ignore_kept_file(kept: Path) -> None:
    """Does nothing."""


@dataclass(frozen=True)
class Percepts:
    """Maps of a photo, per pixel; None where one is missing."""

    rgb: U8
    """(H, W, 3) sRGB."""
    labels: U16
    """(H, W), 0 = background; every object, truncated ones too, and regions that may be objects."""
    coverage: F32 | None = None
    """(H, W) in 0..1: the share of the pixel that objects cover, soft at their borders."""
    background: U8 | None = None
    """(H, W, 3) sRGB: objects and their rims filled, old shadows still there; elsewhere it equals `rgb`."""
    clean: U8 | None = None
    """(H, W, 3) sRGB: the background without the objects' shadows."""
    shadows: U16 | None = None
    """(H, W): the id of the object whose shadow lies there, 0 = none."""
    depth: F32 | None = None
    """(H, W), larger = farther."""
    normals: F32 | None = None
    """(H, W, 3) unit, +x right, +y down, +z to the viewer."""
    albedo: F32 | None = None
    """(H, W, 3) linear."""
    shading: F32 | None = None
    """(H, W) linear."""

    @cached_property
    def cut_out(self) -> U16:
        """(H, W): the labels without regions that `coverage` leaves out: what is doubtful stays in `background`."""
        if self.coverage is None:
            return self.labels
        areas = np.bincount(self.labels.ravel())
        covered = (
            2 * np.bincount(self.labels.ravel(), self.coverage.ravel() > 0) > areas
        )
        return np.where(covered[self.labels], self.labels, np.uint16(0))


LOSSY = {
    "JPEG": "a JPEG",
    "MPO": "a JPEG",
    "HEIF": "a HEIC",
    "AVIF": "an AVIF",
    "JXL": "a JPEG XL",
}
"""Pillow's and the usual names of formats whose compression usually changes ids."""
PAINTED_COLOURS = 256
"""Colours of a label map with transparency, at most; a cut-out of a photo has thousands."""


def read_labels(path: Path) -> U16:
    """A label map: one channel of ids as it is; the distinct colours of a colour picture numbered.

    0, black and what is transparent are the background, unless all that is opaque is black. Raises InputError.
    """
    raw, opaque = _read_painted(path)
    return _checked_labels(raw, opaque, path)


def read_object_masks(path: Path) -> U16:
    """A label map as `read_labels` reads it, or the opaque regions of a picture whose opacity shows the objects.

    Opacity shows them if the opaque part has one colour, or those of a photo. Raises InputError.
    """
    raw, opaque = _read_painted(path)
    if opaque is None or 1 < _count_colours(raw[opaque]) <= PAINTED_COLOURS:
        return _checked_labels(raw, opaque, path)
    count, regions = cv2.connectedComponents(opaque.view(np.uint8), connectivity=8)
    if count > Limit.IDS.most:
        raise Limit.IDS.error(Place(str(path)), found=f"{count:,} regions")
    return np.asarray(regions, np.uint16)


def _read_painted(path: Path) -> tuple[U8 | U16, NDArray[np.bool_] | None]:
    """Colours or ids, black where the picture is transparent; and what is opaque, None if all is. Raises InputError."""
    with open_picture(path) as image:
        if image.format in LOSSY or (image.format == "WEBP" and _is_lossy_webp(path)):
            name = LOSSY.get(str(image.format), "a lossy WebP")
            expected = f"is {name}, whose compression changes ids"
            fix = "save it as PNG, without smoothing"
            raise InputError.of(str(path), "", expected, fix)
        if (count := page_count(image)) > 1:
            expected = f"has {count} layers or frames"
            raise InputError.of(str(path), "", expected, "save it as one flat PNG")
    raw = read_channels(path)
    if raw.ndim == 2 or raw.shape[2] == 3:
        return raw, None
    alpha, colours = raw[:, :, -1], raw[:, :, :-1]
    most = int(alpha.max())
    if most == 0:
        fix = "save it with the objects opaque"
        raise InputError.of(str(path), "", "is transparent everywhere", fix)
    # half of the most: masks that were drawn over a photo are translucent
    opaque = 2 * alpha.astype(np.uint32) >= most
    if opaque.all():
        return colours, None
    return np.where(opaque[:, :, None], colours, colours.dtype.type(0)), opaque


def _is_lossy_webp(path: Path) -> bool:
    """Whether a WebP file has a chunk of lossy pixels."""
    with path.open("rb") as stream:
        stream.seek(12)
        while len(head := stream.read(8)) == 8:
            if head[:4] == b"VP8 ":
                return True
            length = int.from_bytes(head[4:], "little")
            stream.seek(length + length % 2, os.SEEK_CUR)
    return False


def _count_colours(pixels: U8 | U16) -> int:
    """Number of distinct rows of (N, 1 or 3)."""
    code = np.zeros(len(pixels), np.uint64)
    for channel in pixels.T:
        code = (code << np.uint64(16)) | channel
    return len(np.unique(code))


def _checked_labels(raw: U8 | U16, opaque: NDArray[np.bool_] | None, path: Path) -> U16:
    """The ids of a label map, not too many. Raises InputError."""
    labels = _label_ids(raw, path)
    if opaque is not None and not labels.any():
        labels = opaque.astype(np.uint16)
    count = np.count_nonzero(np.bincount(labels.ravel()))
    if count > Limit.IDS.most:
        raise Limit.IDS.error(Place(str(path)), found=f"{count:,} ids")
    return labels


def _label_ids(raw: U8 | U16, path: Path) -> U16:
    """(H, W): the ids of one channel, or the distinct colours numbered."""
    if raw.ndim == 2:
        return raw.astype(np.uint16)
    red, green, blue = (raw[:, :, k if raw.shape[2] > 2 else 0] for k in range(3))
    if np.array_equal(red, green) and np.array_equal(red, blue):
        return red.astype(np.uint16)
    code = (red.astype(np.uint64) << 32) + (green.astype(np.uint64) << 16) + blue
    colours, ids = np.unique(code, return_inverse=True)
    if len(colours) > 65535:
        found, fix = f"{len(colours)} colours", "give each object one colour"
        raise InputError.of(str(path), found, "are too many for a label map", fix)
    ids = ids.reshape(code.shape)
    return (ids if colours[0] == 0 else ids + 1).astype(np.uint16)


def read_percepts(
    image: Path | None, assets: Path | None, maps: Mapping[str, tuple[float, float]]
) -> Percepts | None:
    """The photo with the maps found in its assets folder; None for a scene without a photo.

    `maps` has the values of 0 and 65535 in depth.png and shading.png.
    """
    if image is None:
        return None
    rgb = read_image(image)
    H, W = rgb.shape[:2]

    def find(name: str) -> Path | None:
        path = assets / f"{name}.png" if assets else None
        if path is None or not path.is_file():
            return None
        if picture_size(path) != (W, H):
            found = "{} x {} px".format(*picture_size(path))
            expected = f"differs from the photo's {W} x {H} px"
            raise InputError.of(str(path), found, expected, "make it the photo's size")
        return path

    def grey(name: str, low: float = 0.0, high: float = 1.0) -> F32 | None:
        if (path := find(name)) is None:
            return None
        picture = read_channels(path)
        picture = picture if picture.ndim == 2 else picture[:, :, 0]
        share = picture.astype(np.float32) / np.float32(np.iinfo(picture.dtype).max)
        return (low + (high - low) * share).astype(np.float32)

    def three(name: str) -> U8 | U16 | None:
        if (path := find(name)) is None:
            return None
        picture = read_channels(path)
        if picture.ndim == 2 or picture.shape[2] < 3:
            expected = "has one channel where three are meant"
            raise InputError.of(str(path), "", expected, "save it in colour")
        return picture[:, :, :3]

    def colour(name: str) -> U8 | None:
        return None if (path := find(name)) is None else read_image(path)

    def ids(name: str) -> U16 | None:
        return None if (path := find(name)) is None else read_labels(path)

    labels = ids("masks")
    coverage = grey("coverage")
    normals, albedo = three("normals"), three("albedo")
    return Percepts(
        rgb=rgb,
        labels=np.zeros((H, W), np.uint16) if labels is None else labels,
        coverage=coverage,
        background=colour("background"),
        clean=colour("clean"),
        shadows=ids("shadows"),
        depth=grey("depth", *maps.get("depth", (0.0, 1.0))),
        normals=None if normals is None else _signed(normals),
        albedo=None
        if albedo is None
        else albedo.astype(np.float32) / np.float32(np.iinfo(albedo.dtype).max),
        shading=grey("shading", *maps.get("shading", (0.0, 1.0))),
    )


def _signed(picture: U8 | U16) -> F32:
    """Integers of 8 or 16 bits, whose middle is 0, as -1..1."""
    middle = (np.iinfo(picture.dtype).max + 1) // 2
    return (picture.astype(np.float32) - np.float32(middle)) / np.float32(middle - 1)


def write_assets(
    percepts: Percepts, folder: Path, keep: Keep = ignore_kept_file
) -> dict[str, tuple[float, float]]:
    """Writes the maps into `folder` (created); returns the values of 0 and 65535 in depth and shading, by map.

    An existing map that differs, or that is missing this time, is kept as `NAME~`, and `keep` called with it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    ranges: dict[str, tuple[float, float]] = {}
    pictures: dict[str, U8 | U16 | None] = {
        "masks": percepts.labels,
        "background": percepts.background,
        "clean": percepts.clean,
        "shadows": percepts.shadows,
        "coverage": None
        if percepts.coverage is None
        else (percepts.coverage * 255 + 0.5).astype(np.uint8),
    }
    for name in ("depth", "shading"):
        values: F32 | None = getattr(percepts, name)
        pictures[name] = None
        if values is not None:
            low, high = float(values.min()), float(values.max())
            ranges[name] = low, high = low, high if high > low else low + 1.0
            pictures[name] = ((values - low) / (high - low) * 65535 + 0.5).astype(
                np.uint16
            )
    normals, albedo = percepts.normals, percepts.albedo
    pictures["normals"] = (
        None
        if normals is None
        else np.clip(normals * 127 + 128.5, 0, 255).astype(np.uint8)
    )
    pictures["albedo"] = (
        None
        if albedo is None
        else (np.clip(albedo, 0, 1) * 65535 + 0.5).astype(np.uint16)
    )
    drawn = {name: picture for name, picture in pictures.items() if picture is not None}
    with ThreadPoolExecutor(2) as pool:  # OpenCV encodes beside Python
        files = dict(zip(drawn, pool.map(png_bytes, drawn.values()), strict=True))
    for name in pictures:
        if name in files:
            write_with_backup(folder / f"{name}.png", files[name], keep)
        else:
            back_up(folder / f"{name}.png", keep)
    return ranges


def write_png(path: Path, picture: U8 | U16, keep: Keep = ignore_kept_file) -> None:
    """Writes (H, W) or (H, W, 3) RGB, 8 or 16 bits, atomically; an existing file that differs is kept as `NAME~`."""
    write_with_backup(path, png_bytes(picture), keep)


PNG_LEVEL = 1
"""Of zlib: three times as fast as the usual 6, and files a fifth larger."""


def png_bytes(picture: U8 | U16, level: int = PNG_LEVEL) -> bytes:
    """A file of (H, W) or (H, W, 3) RGB, 8 or 16 bits."""
    bgr = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    done, data = cv2.imencode(
        ".png", np.ascontiguousarray(bgr), [cv2.IMWRITE_PNG_COMPRESSION, level]
    )
    if not done:
        kind = f"a picture of shape {picture.shape} and type {picture.dtype}"
        raise ValueError(f"{kind} cannot be a PNG")
    return data.tobytes()
