"""Another program's maps -> the roles that they fill: `normals=file:normals.npy` and so on.

A map may be larger or smaller than the photo, of the same proportions: it is made to fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.backends import Setup
from physgen.perceive import roles
from physgen.perceive.roles import Intrinsics, Labels, Rgb, Segments, Setting, Thing
from physgen.percepts.maps import read_labels
from physgen.percepts.photo import read_photo
from physgen.photometry import decode
from physgen.problems import InputError

Map = NDArray[Any]
ASKEW = 0.02
"""Share by which a map's proportions may differ from the photo's."""


def segment(setup: Setup) -> roles.Segment:
    """The backend `segment=file`: a label map, sure of all that it shows."""
    path = _path(setup, "segment")
    labels = _numbers(path, "a label map") if path.suffix == ".npy" else read_labels(path)
    if labels.ndim != 2 or not np.issubdtype(labels.dtype, np.integer):
        found = f"{labels.shape} {labels.dtype}"
        raise InputError.of(str(path), found, "is no label map", "save (H, W) whole numbers, 0 = background")

    def run(rgb: Rgb) -> Segments:
        fitted = _fit(labels, rgb, path, cv2.INTER_NEAREST_EXACT)
        ids = [int(i) for i in np.unique(fitted) if i]
        found = np.zeros(rgb.shape[:2], np.uint16)
        for k, i in enumerate(ids, 1):
            found[fitted == i] = k
        return Segments(found, np.ones(len(ids)))

    return run


def depth(setup: Setup) -> roles.Depth:
    """The backend `depth=file`: larger = farther, in any unit."""
    path = _path(setup, "depth")
    values = _grey(path, "depth")
    return lambda rgb: _fit(values, rgb, path)


def normals(setup: Setup) -> roles.Normals:
    """The backend `normals=file`: +x right, +y down, +z to the viewer; of any length but 0, made unit."""
    path = _path(setup, "normals")
    if path.suffix == ".npy":
        values: NDArray[Any] = _numbers(path, "normals").astype(np.float32)
    else:
        values = (_picture(path, "normals").astype(np.float32) - 128) / 127
    if values.ndim != 3 or values.shape[2] != 3:
        raise InputError.of(str(path), f"{values.shape}", "is no map of normals", "save (H, W, 3)")

    def run(rgb: Rgb, labels: Labels, things: Sequence[Thing], setting: Setting) -> NDArray[np.float32]:
        return facing(_fit(values, rgb, path))

    return run


def facing(vectors: Map) -> NDArray[np.float32]:
    """(H, W, 3), +x right, +y down, +z to the viewer, of any length -> unit normals of what is seen: none turn away."""
    vectors = vectors.copy()
    vectors[..., 2] = np.maximum(vectors[..., 2], 0)
    vectors[(np.abs(vectors) < 1e-6).all(axis=2)] = (0, 0, 1)
    return np.asarray(vectors / np.linalg.norm(vectors, axis=2, keepdims=True), np.float32)


def intrinsic(setup: Setup) -> roles.Intrinsic:
    """The backend `intrinsic=file`: linear shading; albedo is the photo divided by it."""
    path = _path(setup, "intrinsic")
    values = _grey(path, "shading")

    def run(rgb: Rgb, labels: Labels, normals: NDArray[np.float32]) -> Intrinsics:
        return parted(rgb, _fit(values, rgb, path))

    return run


def parted(rgb: Rgb, shading: NDArray[np.float32]) -> Intrinsics:
    """A photo and its shading, of any scale -> albedo, in 0..1, times shading.

    The shading is scaled so that hardly any albedo would be over 1; what still is becomes light.
    """
    light = decode(rgb)
    brightest = light.max(axis=2)
    floor = max(float(np.percentile(shading, 50)) * 1e-2, 1e-6)
    raised = np.maximum(np.nan_to_num(shading), floor)
    scale = max(float(np.percentile(brightest / raised, 99)), 1e-6)
    final = np.maximum(raised * scale, brightest)
    return Intrinsics(np.asarray(light / final[..., None], np.float32), np.asarray(final, np.float32))


def matte(setup: Setup) -> roles.Matte:
    """The backend `matte=file`: how much of each pixel objects cover; 8 bits of it."""
    path = _path(setup, "matte")
    values = _grey(path, "coverage")

    def run(rgb: Rgb, labels: Labels) -> NDArray[np.float32]:
        fitted: NDArray[Any] = np.clip(_fit(values, rgb, path), 0, 1)
        inside = (labels > 0).astype(np.uint8)
        fitted[cv2.distanceTransform(inside, cv2.DIST_L2, 5) > 4] = 1
        fitted[cv2.distanceTransform(1 - inside, cv2.DIST_L2, 5) >= 5] = 0
        return np.asarray(np.rint(fitted * 255) / 255, np.float32)

    return run


def inpaint(setup: Setup) -> roles.Inpaint:
    """The backend `inpaint=file`: what is behind, as a picture; only the hole is taken from it."""
    path = _path(setup, "inpaint")
    picture = read_photo(path).rgb

    def run(rgb: Rgb, hole: NDArray[np.bool_]) -> Rgb:
        return np.where(hole[..., None], _fit(picture, rgb, path), rgb).astype(np.uint8)

    return run


def _path(setup: Setup, role: str) -> Path:
    path = Path(setup.weights).expanduser()
    if not setup.weights:
        raise InputError.of("--backend", f'"{role}=file"', "names no file", f"write {role}=file:PATH")
    if not path.is_file():
        raise InputError.of(
            "--backend", f'"{role}=file:{path}"', "is not there", "name a file, .npy or a picture"
        )
    return path


def _numbers(path: Path, what: str) -> Map:
    try:
        return np.asarray(np.load(path, allow_pickle=False))
    except (OSError, ValueError) as error:
        raise InputError.of(
            str(path), "", f"is no array of numbers ({error})", f"save {what} with numpy.save"
        ) from None


def _picture(path: Path, what: str) -> Map:
    read = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
    if read is None:
        raise InputError.of(str(path), "", "is no picture", f"save {what} as .npy or PNG")
    return read[..., [2, 1, 0]] if read.ndim == 3 else read


def _grey(path: Path, what: str) -> NDArray[np.float32]:
    """One number a pixel; integers of pictures become 0..1, numbers of arrays stay."""
    raw = _numbers(path, what) if path.suffix == ".npy" else _picture(path, what)
    number = np.issubdtype(raw.dtype, np.number)
    values = np.squeeze(raw).mean(axis=2) if number and np.squeeze(raw).ndim == 3 else np.squeeze(raw)
    if values.ndim != 2 or not number or not np.isfinite(values).all():
        raise InputError.of(
            str(path), f"{raw.shape} {raw.dtype}", f"is no map of {what}", "save (H, W) finite numbers"
        )
    whole = path.suffix != ".npy" and np.issubdtype(raw.dtype, np.integer)
    return np.asarray(values / (np.iinfo(raw.dtype).max if whole else 1), np.float32)


def _fit(values: Map, rgb: Rgb, path: Path, how: int | None = None) -> Map:
    """A map in the photo's size."""
    height, width = rgb.shape[:2]
    tall, wide = values.shape[:2]
    if (tall, wide) == (height, width):
        return values
    if abs(wide * height / (tall * width) - 1) > ASKEW:
        found = f"{wide} x {tall} px"
        raise InputError.of(
            str(path),
            found,
            f"has other proportions than the photo's {width} x {height} px",
            "save it in the photo's size",
        )
    if how is None:
        how = cv2.INTER_AREA if wide > width else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(values, (width, height), interpolation=how))
