"""Maps of a photo in memory and as a folder of pictures that any paint program opens."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32 as F32
from physgen.arrays import U8 as U8
from physgen.arrays import U16 as U16
from physgen.arrays import Mask
from physgen.files import back_up, write_with_backup
from physgen.messages import Message
from physgen.photos import (
    open_picture,
    page_count,
    picture_size,
    read_channels,
    read_image,
)
from physgen.problems import Limit, Place

Keep = Callable[[Path], None]
"""Called with every file that was kept under another name."""


def ignore_kept_file(kept: Path) -> None:
    """Do nothing with a backup."""


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
    """(H, W, 3) sRGB: objects and their rims filled, old shadows still there.

    Elsewhere it equals `rgb`.
    """
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
        """Return the labels (H, W) without regions that `coverage` leaves out.

        Doubtful regions stay in `background`.
        """
        if self.coverage is None:
            return self.labels
        ids = self.labels.ravel()
        areas = np.bincount(ids)
        covered_areas = np.bincount(ids, self.coverage.ravel() > 0)
        is_covered = 2 * covered_areas > areas
        return np.where(is_covered[self.labels], self.labels, np.uint16(0))


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
    """Read a label map: ids of one channel as they are, or numbers for the distinct colours.

    0, black and transparent pixels are the background, unless all opaque pixels are black. Raises InputError.
    """
    painting, opaque = _read_painted(path)
    return _checked_labels(painting, opaque, path)


def read_object_masks(path: Path) -> U16:
    """Read a label map as `read_labels`, or opaque regions if the opacity shows the objects.

    Opacity shows them if the opaque part has one colour, or those of a photo. Raises InputError.
    """
    painting, opaque = _read_painted(path)
    if opaque is None or 1 < _count_colours(painting[opaque]) <= PAINTED_COLOURS:
        return _checked_labels(painting, opaque, path)
    count, regions = cv2.connectedComponents(opaque.view(np.uint8), connectivity=8)
    if count > Limit.IDS.most:
        raise Limit.IDS.error(Place(str(path)), found=f"{count:,} regions")
    return np.asarray(regions, np.uint16)


def _read_painted(path: Path) -> tuple[U8 | U16, Mask | None]:
    """Read colours or ids, black in transparent pixels, and the opaque pixels (None if all are).

    Raises InputError.
    """
    _check_painting(path)
    channels = read_channels(path)
    if channels.ndim == 2 or channels.shape[2] == 3:
        return channels, None
    alpha, colours = channels[:, :, -1], channels[:, :, :-1]
    highest_alpha = int(alpha.max())
    if highest_alpha == 0:
        raise Message.MAP_TRANSPARENT.error(str(path))
    # Masks that were drawn over a photo are translucent.
    opaque = 2 * alpha.astype(np.uint32) >= highest_alpha
    if opaque.all():
        return colours, None
    black = colours.dtype.type(0)
    return np.where(opaque[:, :, None], colours, black), opaque


def _check_painting(path: Path) -> None:
    """Refuse lossy pictures and pictures of several layers. Raises InputError."""
    with open_picture(path) as image:
        is_lossy_webp = image.format == "WEBP" and _is_lossy_webp(path)
        if image.format in LOSSY or is_lossy_webp:
            name = LOSSY.get(str(image.format), "a lossy WebP")
            raise Message.MAP_LOSSY.error(str(path), format=name)
        count = page_count(image)
        if count > 1:
            raise Message.MAP_LAYERS.error(str(path), count=count)


def _is_lossy_webp(path: Path) -> bool:
    """Return whether a WebP file has a chunk of lossy pixels."""
    with path.open("rb") as stream:
        stream.seek(12)
        while len(head := stream.read(8)) == 8:
            if head[:4] == b"VP8 ":
                return True
            length = int.from_bytes(head[4:], "little")
            stream.seek(length + length % 2, os.SEEK_CUR)
    return False


def _count_colours(pixels: U8 | U16) -> int:
    """Return the number of distinct rows of (N, 1 or 3)."""
    code = np.zeros(len(pixels), np.uint64)
    for channel in pixels.T:
        code = (code << np.uint64(16)) | channel
    return len(np.unique(code))


def _checked_labels(painting: U8 | U16, opaque: Mask | None, path: Path) -> U16:
    """Return the ids of a label map. Raises InputError if there are too many."""
    labels = _label_ids(painting, path)
    if opaque is not None and not labels.any():
        labels = opaque.astype(np.uint16)
    count = np.count_nonzero(np.bincount(labels.ravel()))
    if count > Limit.IDS.most:
        raise Limit.IDS.error(Place(str(path)), found=f"{count:,} ids")
    return labels


def _label_ids(painting: U8 | U16, path: Path) -> U16:
    """Return (H, W): the ids of one channel, or numbers for the distinct colours."""
    if painting.ndim == 2:
        return painting.astype(np.uint16)
    channels = [painting[:, :, 0]] * 3
    if painting.shape[2] > 2:
        channels = [painting[:, :, k] for k in range(3)]
    red, green, blue = channels
    if np.array_equal(red, green) and np.array_equal(red, blue):
        return red.astype(np.uint16)
    code = (red.astype(np.uint64) << 32) + (green.astype(np.uint64) << 16) + blue
    colours, ids = np.unique(code, return_inverse=True)
    if len(colours) > 65535:
        colour_text = f"{len(colours):,} colours"
        raise Message.MAP_COLOURS.error(str(path), colour_text)
    ids = ids.reshape(code.shape)
    has_background = colours[0] == 0
    if not has_background:
        ids = ids + 1
    return ids.astype(np.uint16)


def read_percepts(
    image: Path | None, assets: Path | None, maps: Mapping[str, tuple[float, float]]
) -> Percepts | None:
    """Read the photo and the maps in its assets folder; None for a scene without a photo.

    `maps` has the values of 0 and 65535 in depth.png and shading.png.
    """
    if image is None:
        return None
    rgb = read_image(image)
    height, width = rgb.shape[:2]
    return percepts_of(rgb, _MapReader(assets, (width, height)).read, maps)


PHOTO = "photo"
"""The photo's name among stored maps."""


def percepts_of(
    rgb: U8,
    read: Callable[[str], U8 | U16 | None],
    maps: Mapping[str, tuple[float, float]],
) -> Percepts:
    """Return the maps of a photo (H, W, 3); `maps` as for `read_percepts`.

    `read` returns the map of a name as it is stored, None if it is missing.
    """
    labels = read("masks")
    if labels is None:
        labels = np.zeros(rgb.shape[:2], np.uint16)
    return Percepts(
        rgb=rgb,
        labels=np.asarray(labels, np.uint16),
        coverage=_in_range(read("coverage")),
        normals=_signed(read("normals")),
        albedo=_in_range(read("albedo")),
        background=_as_colour(read("background")),
        clean=_as_colour(read("clean")),
        shadows=_as_ids(read("shadows")),
        depth=_in_range(read("depth"), *maps.get("depth", (0.0, 1.0))),
        shading=_in_range(read("shading"), *maps.get("shading", (0.0, 1.0))),
    )


@dataclass(frozen=True)
class _MapReader:
    """Reads the maps of an assets folder; None for a map that is missing."""

    assets: Path | None
    size: tuple[int, int]
    """Width and height of the photo, px."""

    def find(self, name: str) -> Path | None:
        """Return the file of a map. Raises InputError if its size is not the photo's."""
        if self.assets is None:
            return None
        path = self.assets / f"{name}.png"
        if not path.is_file():
            return None
        size = picture_size(path)
        if size != self.size:
            size_text = "{} x {} px".format(*size)
            width, height = self.size
            differs = Message.NOT_PHOTO_SIZE
            raise differs.error(str(path), size_text, width=width, height=height)
        return path

    def read(self, name: str) -> U8 | U16 | None:
        """Read a map as it is stored, integers."""
        if name in ("masks", "shadows"):
            return self.read_ids(name)
        if name in ("normals", "albedo"):
            return self.read_three(name)
        if name in ("background", "clean"):
            return self.read_colour(name)
        return self.read_grey(name)

    def read_grey(self, name: str) -> U8 | U16 | None:
        """Read one channel of 8 or 16 bits as it is stored."""
        path = self.find(name)
        if path is None:
            return None
        picture = read_channels(path)
        if picture.ndim == 3:
            picture = picture[:, :, 0]
        return picture

    def read_three(self, name: str) -> U8 | U16 | None:
        """Read three channels of 8 or 16 bits as they are stored."""
        path = self.find(name)
        if path is None:
            return None
        picture = read_channels(path)
        if picture.ndim == 2 or picture.shape[2] < 3:
            raise Message.MAP_ONE_CHANNEL.error(str(path))
        return picture[:, :, :3]

    def read_colour(self, name: str) -> U8 | None:
        """Read a picture as sRGB."""
        path = self.find(name)
        return None if path is None else read_image(path)

    def read_ids(self, name: str) -> U16 | None:
        """Read a label map."""
        path = self.find(name)
        return None if path is None else read_labels(path)


def _in_range(
    picture: U8 | U16 | None, low: float = 0.0, high: float = 1.0
) -> F32 | None:
    """Return integers of 8 or 16 bits as `low` to `high`."""
    if picture is None:
        return None
    share = _share_of_range(picture)
    if (low, high) == (0.0, 1.0):
        return share
    return (low + (high - low) * share).astype(np.float32)


def _as_colour(picture: U8 | U16 | None) -> U8 | None:
    """Return a picture as 8 bits."""
    return None if picture is None else np.asarray(picture, np.uint8)


def _as_ids(picture: U8 | U16 | None) -> U16 | None:
    """Return a picture as ids."""
    return None if picture is None else np.asarray(picture, np.uint16)


def _share_of_range(picture: U8 | U16) -> F32:
    """Return integers of 8 or 16 bits as 0..1."""
    highest = np.float32(np.iinfo(picture.dtype).max)
    return picture.astype(np.float32) / highest


def _signed(picture: U8 | U16 | None) -> F32 | None:
    """Return integers of 8 or 16 bits, whose middle is 0, as -1..1."""
    if picture is None:
        return None
    middle = (np.iinfo(picture.dtype).max + 1) // 2
    return (picture.astype(np.float32) - np.float32(middle)) / np.float32(middle - 1)


def write_assets(
    percepts: Percepts, folder: Path, keep: Keep = ignore_kept_file
) -> dict[str, tuple[float, float]]:
    """Write the maps into `folder`, which is created; return the values of 0 and 65535 in depth and shading, by map.

    An existing map that differs, or that is missing this time, is kept as `NAME~`, and `keep` called with it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    pictures, ranges = stored_pictures(percepts)
    _write_pictures(pictures, folder, keep)
    return ranges


def stored_pictures(
    percepts: Percepts,
) -> tuple[dict[str, U8 | U16 | None], dict[str, tuple[float, float]]]:
    """Return maps as they are stored, and the values of 0 and 65535 in depth and shading."""
    pictures: dict[str, U8 | U16 | None] = {
        "masks": percepts.labels,
        "background": percepts.background,
        "clean": percepts.clean,
        "shadows": percepts.shadows,
        "coverage": None,
    }
    if percepts.coverage is not None:
        pictures["coverage"] = (percepts.coverage * 255 + 0.5).astype(np.uint8)
    ranges: dict[str, tuple[float, float]] = {}
    for name, values in (("depth", percepts.depth), ("shading", percepts.shading)):
        pictures[name] = None
        if values is not None:
            pictures[name], ranges[name] = _stretched(values)
    pictures["normals"] = pictures["albedo"] = None
    if percepts.normals is not None:
        levels = np.clip(percepts.normals * 127 + 128.5, 0, 255)
        pictures["normals"] = levels.astype(np.uint8)
    if percepts.albedo is not None:
        levels = np.clip(percepts.albedo, 0, 1) * 65535 + 0.5
        pictures["albedo"] = levels.astype(np.uint16)
    return pictures, ranges


def _stretched(values: F32) -> tuple[U16, tuple[float, float]]:
    """Return values as 16 bits, and the values of 0 and 65535."""
    low, high = float(values.min()), float(values.max())
    if high <= low:
        high = low + 1.0
    levels = (values - low) / (high - low) * 65535 + 0.5
    return levels.astype(np.uint16), (low, high)


def _write_pictures(
    pictures: Mapping[str, U8 | U16 | None], folder: Path, keep: Keep
) -> None:
    """Write pictures as PNG by name, and back up the files of missing ones."""
    names = [name for name, picture in pictures.items() if picture is not None]
    existing = [picture for picture in pictures.values() if picture is not None]
    # OpenCV encodes without Python's lock, so two threads are faster than one.
    with ThreadPoolExecutor(2) as pool:
        files = dict(zip(names, pool.map(_encode_map, existing), strict=True))
    for name in pictures:
        path = folder / f"{name}.png"
        if name in files:
            write_with_backup(path, files[name], keep)
        else:
            back_up(path, keep)


def write_png(path: Path, picture: U8 | U16, keep: Keep = ignore_kept_file) -> None:
    """Write (H, W) or (H, W, 3) RGB, 8 or 16 bits, atomically.

    An existing file that differs is kept as `NAME~`.
    """
    write_with_backup(path, png_bytes(picture), keep)


def _encode_map(picture: U8 | U16) -> bytes:
    """Encode a map: runs alone are as small as matches, in less time."""
    return png_bytes(picture, strategy=cv2.IMWRITE_PNG_STRATEGY_RLE)


PNG_LEVEL = 1
"""Of zlib: three times as fast as the usual 6, and files a fifth larger."""


def png_bytes(
    picture: U8 | U16, level: int = PNG_LEVEL, strategy: int | None = None
) -> bytes:
    """Encode (H, W) or (H, W, 3) RGB, 8 or 16 bits, as a PNG file.

    `strategy` is one of OpenCV's, its default if it is None.
    """
    channels: NDArray[Any] = picture
    if picture.ndim == 3:
        channels = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    options = [cv2.IMWRITE_PNG_COMPRESSION, level]
    if strategy is not None:
        options += [cv2.IMWRITE_PNG_STRATEGY, strategy]
    is_encoded, data = cv2.imencode(".png", np.ascontiguousarray(channels), options)
    if not is_encoded:
        kind = f"a picture of shape {picture.shape} and type {picture.dtype}"
        raise ValueError(f"{kind} cannot be a PNG")
    return data.tobytes()
