"""Backends ROLE=file: maps of another program, e.g. `normals=file:normals.npy`.

A map may be larger or smaller than the photo if its proportions are the same; it is
resized.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.messages import Message
from physgen.perceive import roles
from physgen.perceive.roles import BoundaryGuess, Intrinsics, Labels, PhotoObject, Rgb
from physgen.photometry import decode
from physgen.photos import discard_native_errors, read_photo
from physgen.problems import InputError
from physgen.registry import Setup

Map = NDArray[Any]
ASPECT_TOLERANCE = 0.02
"""Largest relative difference between the proportions of a map and of the photo."""


def depth(setup: Setup) -> roles.Depth:
    """Return the backend `depth=file`: depth in any unit, larger = farther."""
    path = _path(setup, "depth")
    values = _grey(path, "depth")
    return lambda rgb: _fit(values, rgb, path)


def flat() -> roles.Depth:
    """Return the backend `depth=none`: constant depth, for roles that use none."""
    return lambda rgb: np.zeros(rgb.shape[:2], np.float32)


def normals(setup: Setup) -> roles.Normals:
    """Return the backend `normals=file`: +x right, +y down, +z to the viewer.

    Vectors may have any length except 0 and are normalised.
    """
    path = _path(setup, "normals")
    raw = _raw(path, "normals")
    values = _validate_map(raw, path, "normals", "(H, W, 3)")
    if values.ndim != 3 or values.shape[2] != 3:
        raise _create_map_error(raw, path, "normals", "(H, W, 3)")
    if not _array(path) and raw.dtype.kind == "u":
        # Pictures store 0 as level 128 of 255, or as 32768 of 65535.
        zero_level = np.iinfo(raw.dtype).max // 2
        values = np.asarray((values - (zero_level + 1)) / zero_level, np.float32)

    def run(
        rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject], setting: BoundaryGuess
    ) -> NDArray[np.float32]:
        return facing(_fit(values, rgb, path))

    return run


def facing(vectors: Map) -> NDArray[np.float32]:
    """Return unit normals that face the viewer, from vectors (H, W, 3) of any length.

    Axes: +x right, +y down, +z to the viewer. A negative z becomes 0, and a vector of
    length 0 becomes (0, 0, 1).
    """
    # Squares of long vectors exceed float32.
    vectors = vectors.astype(np.float64)
    vectors[..., 2] = np.maximum(vectors[..., 2], 0)
    vectors[(np.abs(vectors) < 1e-6).all(axis=2)] = (0, 0, 1)
    return np.asarray(
        vectors / np.linalg.norm(vectors, axis=2, keepdims=True), np.float32
    )


def intrinsic(setup: Setup) -> roles.Intrinsic:
    """Return the backend `intrinsic=file`: linear shading of any scale.

    The albedo is the photo divided by the shading, which is scaled so that 99 % of the
    albedo is at most 1.
    """
    path = _path(setup, "intrinsic")
    values = _grey(path, "shading")

    def run(rgb: Rgb, labels: Labels, normals: NDArray[np.float32]) -> Intrinsics:
        shading = _clamp_shading(_fit(values, rgb, path))
        scale = max(float(np.percentile(decode(rgb).max(axis=2) / shading, 99)), 1e-6)
        return divide_shading(rgb, shading * np.float32(scale))

    return run


def divide_shading(rgb: Rgb, shading: NDArray[np.float32]) -> Intrinsics:
    """Return the albedo in 0..1 and the shading of a photo with shading (H, W).

    If the albedo would exceed 1, the shading is increased instead.
    """
    light = decode(rgb)
    final = np.maximum(_clamp_shading(shading), light.max(axis=2))
    return Intrinsics(
        np.asarray(light / final[..., None], np.float32), np.asarray(final, np.float32)
    )


def _clamp_shading(shading: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the shading, at least a hundredth of its median, as a safe divisor."""
    floor = max(float(np.percentile(shading, 50)) * 1e-2, 1e-6)
    return np.maximum(shading, np.float32(floor))


def inpaint(setup: Setup) -> roles.Inpaint:
    """Return the backend `inpaint=file`: a picture that replaces the hole's pixels."""
    path = _path(setup, "inpaint")
    picture = read_photo(path).rgb

    def run(rgb: Rgb, hole: NDArray[np.bool_]) -> Rgb:
        return np.where(hole[..., None], _fit(picture, rgb, path), rgb).astype(np.uint8)

    return run


def _path(setup: Setup, role: str) -> Path:
    path = Path(setup.weights).expanduser()
    if not setup.weights:
        raise Message.MAP_FILE_MISSING.error("--backend", f'"{role}=file"', role=role)
    if not path.is_file():
        raise Message.MAP_FILE_LOST.error("--backend", f'"{role}=file:{path}"')
    return path


def _array(path: Path) -> bool:
    """Return whether a file is an array rather than a picture, by its name."""
    return path.suffix.lower() == ".npy"


def _raw(path: Path, quantity: str) -> Map:
    """Return the stored numbers: of an array any shape, of a picture (H, W) or (H, W,
    3).
    """
    try:
        if _array(path):
            return np.asarray(np.load(path, allow_pickle=False))
        content = np.fromfile(path, np.uint8)
        with discard_native_errors():
            read = None
            if content.size:
                read = cv2.imdecode(content, cv2.IMREAD_UNCHANGED)
    except (OSError, ValueError, EOFError, cv2.error):
        read = None
    if read is None:
        kind, form = (
            ("array of numbers", "with numpy.save")
            if _array(path)
            else ("picture", "as PNG or .npy")
        )
        raise Message.MAP_FILE_UNREADABLE.error(
            str(path), kind=kind, content=quantity, form=form
        )
    if read.ndim == 3:
        return read[..., [2, 1, 0]]
    return read


def _create_map_error(raw: Map, path: Path, quantity: str, shape: str) -> InputError:
    return Message.NOT_A_MAP.error(
        str(path), f"{raw.shape} {raw.dtype}", shape=shape, content=quantity
    )


def _validate_map(
    raw: Map, path: Path, quantity: str, shape: str
) -> NDArray[np.float32]:
    """Return finite real numbers as float32, or raise InputError."""
    if not raw.size or raw.dtype.kind not in "iuf":
        raise _create_map_error(raw, path, quantity, shape)
    with np.errstate(over="ignore"):
        values = raw.astype(np.float32)
    if not np.isfinite(values).all():
        raise _create_map_error(raw, path, quantity, shape)
    return values


def _grey(path: Path, quantity: str) -> NDArray[np.float32]:
    """Return one number per pixel (H, W).

    Integers of pictures are scaled to 0..1; numbers of arrays stay as they are.
    """
    raw = _raw(path, quantity)
    values = np.squeeze(_validate_map(raw, path, quantity, "(H, W)"))
    if values.ndim == 3:
        values = values.mean(axis=2, dtype=np.float64).astype(np.float32)
    if values.ndim != 2:
        raise _create_map_error(raw, path, quantity, "(H, W)")
    is_integer_picture = not _array(path) and raw.dtype.kind in "iu"
    return values / np.float32(np.iinfo(raw.dtype).max if is_integer_picture else 1)


def _fit(values: Map, rgb: Rgb, path: Path) -> Map:
    """Return a map in the photo's size; raise InputError if the proportions differ."""
    height, width = rgb.shape[:2]
    map_height, map_width = values.shape[:2]
    if (map_height, map_width) == (height, width):
        return values
    if abs(map_width * height / (map_height * width) - 1) > ASPECT_TOLERANCE:
        raise Message.PROPORTIONS_DIFFER.error(
            str(path), f"{map_width} x {map_height} px", width=width, height=height
        )
    if map_width > width:
        interpolation = cv2.INTER_AREA
    else:
        interpolation = cv2.INTER_LINEAR
    return np.asarray(cv2.resize(values, (width, height), interpolation=interpolation))
