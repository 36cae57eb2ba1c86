"""What was perceived -> one picture: the photo, shapes and supports, surfaces, light, shadows, background."""

from __future__ import annotations

import colorsys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.found import Perceived
from physgen.percepts.maps import Keep, silent, write_png
from physgen.photometry import DistantLight, encode_u8, sphere_normals
from physgen.problems import InputError
from physgen.render.ink import Colour, Layer

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

COLUMNS = 4
WIDTH = 480
"""px of one panel, at most and at least about."""
GAP, CAPTION = 10, 30
"""px between panels, and of the line of words above each."""
PAPER: Colour = (246, 245, 242)
WORDS: Colour = (32, 34, 40)
SUPPORT: Colour = (255, 196, 0)


def sheet(perceived: Perceived) -> U8:
    """(H, W, 3) sRGB: eight panels with captions, four in a row."""
    panels = list(_panels(perceived))
    height, width = panels[0][1].shape[:2]
    rows = -(-len(panels) // COLUMNS)
    page = np.empty((rows * (height + CAPTION + GAP) + GAP, COLUMNS * (width + GAP) + GAP, 3), np.uint8)
    page[:] = PAPER
    words = Layer((page.shape[1], page.shape[0]), 0.0)
    for k, (caption, picture) in enumerate(panels):
        y, x = GAP + k // COLUMNS * (height + CAPTION + GAP), GAP + k % COLUMNS * (width + GAP)
        page[y + CAPTION : y + CAPTION + height, x : x + width] = picture
        words.words(caption, (x + width / 2, y + CAPTION / 2), 15)
    words.onto(page, WORDS, 0.0)
    return page


def check_sheet(path: Path | None, photo: Path) -> None:
    """Raises InputError where a sheet cannot go, before anything is done."""
    if path is None:
        return
    if path.suffix.lower() != ".png":
        raise InputError.of("--sheet", f'"{path}"', "is no PNG", "let its name end in .png")
    if path.exists() and (path.is_dir() or (photo.exists() and path.samefile(photo))):
        what = "is a folder" if path.is_dir() else "is the photo itself"
        raise InputError.of("--sheet", f'"{path}"', what, "name another file")
    above = next(part for part in (path.parent, *path.parent.parents) if part.exists())
    if not above.is_dir():
        raise InputError.of(
            "--sheet", f'"{path}"', f'lies below "{above}", which is no folder', "name another file"
        )


def write_sheet(path: Path, perceived: Perceived, keep: Keep = silent) -> None:
    """The sheet as a PNG; folders are created, a file in the way that differs is kept as `NAME~`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_png(path, sheet(perceived), keep)


def _panels(perceived: Perceived) -> Sequence[tuple[str, U8]]:
    maps, document = perceived.percepts, perceived.document
    height, width = maps.labels.shape
    scale = WIDTH / width
    size = WIDTH, max(1, round(height * scale))

    def shown(picture: U8) -> U8:
        how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        return np.asarray(cv2.resize(picture, size, interpolation=how), np.uint8)

    world, objects = document["world"], document["objects"]
    panels = [
        (f"photo, {width} x {height} px", shown(maps.rgb)),
        (
            f"{len(objects)} shapes, seen from the {world['view']}, and what holds them",
            _shapes(document, shown(maps.rgb), scale),
        ),
    ]
    if maps.normals is not None:
        panels.append(("normals", shown(_u8(127.5 + 127.5 * maps.normals))))
    if maps.albedo is not None:
        panels.append(("albedo", shown(encode_u8(maps.albedo))))
    if maps.shading is not None:
        most = max(float(np.percentile(maps.shading, 99.5)), 1e-6)
        grey = encode_u8(np.clip(maps.shading / most, 0, 1))
        panels.append(("shading", shown(np.repeat(grey[..., None], 3, 2))))
    if "light" in document:
        panels.append(_lit(document["light"], size))
    if maps.shadows is not None:
        panels.append(("whose shadow lies where", shown(owned(maps.rgb, maps.shadows))))
    clean = maps.background if maps.clean is None else maps.clean
    if clean is not None:
        what = "without the objects" if maps.clean is None else "without the objects and their shadows"
        panels.append((what, shown(clean)))
    return panels


def _u8(values: NDArray[Any]) -> U8:
    return np.clip(values + 0.5, 0, 255).astype(np.uint8)


def colour(number: int) -> Colour:
    """A colour for an id, far from those of its neighbours."""
    r, g, b = colorsys.hsv_to_rgb(number * 0.381966 % 1.0, 0.75, 1.0)
    return round(255 * r), round(255 * g), round(255 * b)


def _shapes(document: Mapping[str, Any], picture: U8, scale: float) -> U8:
    """Outlines in each object's colour, names where there is room, supports in yellow."""
    size = picture.shape[1], picture.shape[0]
    dim = _u8(0.75 * picture)
    letter, names = 11.0, Layer(size, 0.8)
    for one in document["boundaries"].values():
        points = np.array(one.get("segment") or one["polyline"], float)
        layer = Layer(size, 0.8)
        layer.line((points + 0.5) * scale - 0.5, 2.2)
        layer.onto(dim, SUPPORT)
    for name, one in document["objects"].items():
        layer = Layer(size, 0.6)
        corners = [(part + 0.5) * scale - 0.5 for part in _rings(one["shape"])]
        for part in corners:
            layer.line(part, 1.4, closed=True)
        low, high = np.min([part.min(0) for part in corners], 0), np.max([part.max(0) for part in corners], 0)
        if min(high - low) > 14:
            x, y = ((low + high) / 2).tolist()
            names.words(name if high[0] - low[0] > 7 * len(name) else str(one["mask"]), (x, y), letter)
        layer.onto(dim, colour(one["mask"]) if isinstance(one["mask"], int) else WORDS)
    names.onto(dim, (255, 255, 255))
    return dim


def _rings(shape: Mapping[str, Any]) -> list[NDArray[np.float64]]:
    """(K, 2) px each: the closed borders of a scene's `shape`."""
    if "circle" in shape:
        turn = np.linspace(0, 2 * np.pi, 72, endpoint=False)
        ring = np.stack([np.cos(turn), np.sin(turn)], 1)
        return [np.asarray(shape["circle"]["center"] + shape["circle"]["radius"] * ring)]
    if "box" in shape:
        box = shape["box"]
        angle = np.radians(box.get("angle", 0.0))
        x, y = np.array(box["size"]) / 2
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        return [np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) @ turn + box["center"]]
    if "polygon" in shape:
        return [np.array(shape["polygon"], float)]
    rings = []
    for piece in shape["polygons"]:
        rings += [np.array(ring, float) for ring in (piece["outline"], *piece.get("holes", ()))]
    return rings


def _lit(said: Mapping[str, Any], size: tuple[int, int]) -> tuple[str, U8]:
    """A white ball in the light, on a grey card."""
    x, y, z = said["direction"]
    light = DistantLight((x, y, z), said["intensity"], said["ambient"])
    width, height = size
    radius = 0.36 * min(size)
    normals, inside = sphere_normals(height, width, ((width - 1) / 2, (height - 1) / 2), radius)
    most = light.ambient + light.intensity
    shades = np.where(inside, 0.9 * light.shade(normals) / max(most, 1e-6), 0.18).astype(np.float32)
    card = np.repeat(encode_u8(shades)[..., None], 3, 2)
    share = light.ambient / max(most, 1e-6)
    return f"light from ({x:g}, {y:g}, {z:g}), {share:.0%} of it from all around", card


def owned(rgb: U8, owners: NDArray[np.uint16]) -> U8:
    """The photo in grey, shadows in the colours of the objects that throw them."""
    grey = cv2.cvtColor(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB).astype(np.float32)
    result = 0.8 * grey
    for i in np.unique(owners[owners > 0]).tolist():
        own = owners == i
        result[own] = 0.45 * grey[own] + 0.55 * np.array(colour(i), np.float32)
    return _u8(result)
