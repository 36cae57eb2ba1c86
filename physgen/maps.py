"""Maps of a photo in memory and as a folder of pictures that any paint program opens."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.files import back_up, write_with_backup
from physgen.photos import open_picture, picture_size, read_channels, read_image
from physgen.problems import InputError

# ----------------------------------------------------------------------
# Maps of a photo: a folder of pictures <-> arrays. Every map opens in a paint program; what is missing is
# None.

U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
F32 = NDArray[np.float32]

Keep = Callable[[Path], None]
"""Told of every file that was kept under another name."""


def ignore_kept_file(kept: Path) -> None:
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


def read_labels(path: Path) -> U16:
    """A label map: one channel of ids as it is; the distinct colours of a colour picture numbered, black = 0."""
    with open_picture(path) as image:
        if image.format in ("JPEG", "MPO"):
            fix = "save it as PNG, without smoothing"
            raise InputError.of(str(path), "", "is a JPEG, whose compression changes ids", fix)
    raw = read_channels(path)
    if raw.ndim == 2:
        return raw.astype(np.uint16)
    red, green, blue = (raw[:, :, k if raw.shape[2] > 2 else 0] for k in range(3))
    if np.array_equal(red, green) and np.array_equal(red, blue):
        return red.astype(np.uint16)
    code = (red.astype(np.uint64) << 32) + (green.astype(np.uint64) << 16) + blue
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

    def fitting(name: str) -> Path | None:
        path = find(name)
        if path is not None and picture_size(path) != (W, H):
            found = "{} x {} px".format(*picture_size(path))
            raise InputError.of(
                str(path), found, f"differs from the photo's {W} x {H} px", "make it the photo's size"
            )
        return path

    def raw(name: str) -> NDArray[np.uint8] | NDArray[np.uint16] | None:
        path = fitting(name)
        return None if path is None else read_channels(path)

    def vectors(name: str) -> NDArray[np.uint8] | NDArray[np.uint16] | None:
        picture = raw(name)
        if picture is not None and (picture.ndim == 2 or picture.shape[2] < 3):
            raise InputError.of(
                str(find(name)), "", "has one channel where three are meant", "save it in colour"
            )
        return None if picture is None else picture[:, :, :3]

    def colour(name: str) -> U8 | None:
        path = fitting(name)
        return None if path is None else read_image(path)

    def scalar(name: str) -> F32 | None:
        picture = raw(f"{name}.png")
        if picture is None:
            return None
        low, high = maps.get(name, (0.0, 1.0))
        grey = picture if picture.ndim == 2 else picture[:, :, 0]
        full = 65535.0 if picture.dtype == np.uint16 else 255.0
        return (low + (high - low) * (grey.astype(np.float32) / full)).astype(np.float32)

    masks = fitting("masks.png")
    labels = np.zeros((H, W), np.uint16) if masks is None else read_labels(masks)
    soft = raw("coverage.png")
    coverage = None
    if soft is not None:
        grey = soft if soft.ndim == 2 else soft[:, :, 0]
        coverage = (grey.astype(np.float32) / np.float32(np.iinfo(soft.dtype).max)).astype(np.float32)
    normals, albedo = vectors("normals.png"), vectors("albedo.png")
    return Percepts(
        rgb=rgb,
        labels=labels,
        coverage=coverage,
        background=colour("background.png"),
        clean=colour("clean.png"),
        shadows=None if (cast := fitting("shadows.png")) is None else read_labels(cast),
        depth=scalar("depth"),
        normals=None if normals is None else _signed(normals),
        albedo=None if albedo is None else albedo.astype(np.float32) / np.float32(np.iinfo(albedo.dtype).max),
        shading=scalar("shading"),
    )


def _signed(picture: NDArray[np.uint8] | NDArray[np.uint16]) -> F32:
    """Integers of 8 or 16 bits, whose middle is 0, as -1..1."""
    middle = (np.iinfo(picture.dtype).max + 1) // 2
    return (picture.astype(np.float32) - np.float32(middle)) / np.float32(middle - 1)


def write_assets(
    percepts: Percepts, folder: Path, keep: Keep = ignore_kept_file
) -> dict[str, tuple[float, float]]:
    """Write the maps into `folder` (created); returns what 0 and 65535 stand for in the 16-bit ones, by map.

    A map that is there already and differs, or that nobody has made this time, is kept as `NAME~`, and `keep` told.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("coverage", "background", "clean", "shadows", "depth", "normals", "albedo", "shading"):
        if getattr(percepts, name) is None:
            back_up(folder / f"{name}.png", keep)
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
    if percepts.shadows is not None:
        write_png(folder / "shadows.png", percepts.shadows, keep)
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


def write_png(path: Path, picture: U8 | U16, keep: Keep = ignore_kept_file) -> None:
    """(H, W) or (H, W, 3) RGB, 8 or 16 bits; whole or not at all, a differing file that is there is kept as `NAME~`."""
    bgr = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    done, data = cv2.imencode(".png", np.ascontiguousarray(bgr), [cv2.IMWRITE_PNG_COMPRESSION, 6])
    if not done:
        raise ValueError(
            f"{path.name}: a picture of shape {picture.shape} and type {picture.dtype} cannot be a PNG"
        )
    write_with_backup(path, data.tobytes(), keep)
