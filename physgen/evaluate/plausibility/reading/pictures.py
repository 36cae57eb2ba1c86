"""A folder of PNG maps, one a frame, a colour or number an id -> tracks: centroids of masks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError

from physgen.evaluate.plausibility.reading.asked import FPS, Asked
from physgen.evaluate.plausibility.reading.masks import SHAKE, Ids, gathered, tracked
from physgen.evaluate.plausibility.tracks import Tracks
from physgen.image_formats import MOST_PIXELS
from physgen.problems import InputError
from physgen.text import natural

MOST_IDS = 1000
"""In a picture: more are no ids, but a photo."""
COLOURS = 65536
"""Numbers from here on are colours, red first: black is the background."""


def pictures_in(folder: Path) -> list[Path]:
    """By name, in their natural order; `ids-*.png` alone where there are such."""
    found = [path for path in folder.iterdir() if path.suffix.lower() == ".png" and path.is_file()]
    own = [path for path in found if path.name.startswith("ids-")]
    return sorted(own or found, key=lambda path: natural(path.name))


def from_pictures(folder: Path, asked: Asked) -> Tracks:
    """Raises InputError for different sizes, and pictures that are no maps."""
    paths = pictures_in(folder)
    ids, places, forms, areas = tracked(gathered(_maps(paths)))
    if not ids:
        raise InputError.of(str(folder), "", "has no tracks: all is background", "give things ids above 0")
    said = "" if asked.fps else ", 30 frames a second assumed"
    return Tracks(
        folder.resolve().name, np.arange(len(places)) / (asked.fps or FPS), tuple(map(_name, ids)), places,
        np.full(places.shape[:2], np.nan), forms, areas, False, asked.view, SHAKE, f"centroids of masks{said}",
        flat=False,
    )  # fmt: skip


def _maps(paths: list[Path]) -> Iterator[Ids]:
    size = None
    for path in paths:
        ids = _read(path)
        if size is not None and ids.shape != size:
            found = f"{ids.shape[1]} x {ids.shape[0]} px"
            raise InputError.of(
                str(path), found, f"is not the size of {paths[0].name}", "give frames of one size"
            )
        size = ids.shape
        values = len(np.unique(ids))
        if values > MOST_IDS:
            fix = "give maps with a number or colour a thing"
            raise InputError.of(str(path), f"{values:,} values", "are no ids: it is a photo", fix)
        yield ids


def _name(one: int) -> str:
    return f"id {one}" if one < COLOURS else f"#{one:06x}"


def _read(path: Path) -> Ids:
    try:
        with Image.open(path, formats=("PNG",)) as picture:
            if picture.width * picture.height > MOST_PIXELS:
                raise InputError.of(
                    str(path), f"{picture.width} x {picture.height} px", "are too many", "make it smaller"
                )
            if picture.mode in ("RGB", "RGBA"):
                rgb = np.asarray(picture.convert("RGB"), np.int64)
                return np.asarray((rgb[..., 0] << 16) + (rgb[..., 1] << 8) + rgb[..., 2])
            return np.asarray(picture).astype(np.int64)
    except (OSError, UnidentifiedImageError, SyntaxError) as error:
        raise InputError.of(str(path), "", f"cannot be read: {error}", "save it as PNG") from None
