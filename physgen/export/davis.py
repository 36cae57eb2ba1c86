"""Masks as palette PNG in the layouts of DAVIS 2017 and YouTube-VOS."""

from __future__ import annotations

import json
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen.export.files import FAST
from physgen.export.labels import Clip, Moment

# ----------------------------------------------------------------------
# Ids -> palette PNG as DAVIS and YouTube-VOS have them: a pixel's index is its object's id, 0 the background.
#
# Index 255 means that nobody knows, for DAVIS' own measures too.

FIRST = (
    (0, 0, 0), (128, 0, 0), (0, 128, 0), (128, 128, 0), (0, 0, 128), (128, 0, 128), (0, 128, 128), (128, 128, 128),
    (64, 0, 0), (191, 0, 0), (64, 128, 0), (191, 128, 0), (64, 0, 128), (191, 0, 128), (64, 128, 128), (191, 128, 128),
    (0, 64, 0), (128, 64, 0), (0, 191, 0), (128, 191, 0), (0, 64, 128), (128, 64, 128),
)  # fmt: skip
"""sRGB of the first indices (Perazzi et al., CVPR 2016); those after are grey, as light as their number."""
PALETTE = (*FIRST, *((level, level, level) for level in range(len(FIRST), 256)))


def indexed(ids: NDArray[np.uint16]) -> bytes:
    """A file of (H, W) ids, none over 254."""
    picture = Image.fromarray(ids.astype(np.uint8)).convert("P")
    picture.putpalette([value for colour in PALETTE for value in colour])
    file = BytesIO()
    picture.save(file, "PNG", compress_level=FAST)
    return file.getvalue()


# ----------------------------------------------------------------------
# Views -> the layout of DAVIS 2017 (Pont-Tuset et al., 2017): JPEG pictures, and masks as palette PNG.

SIZE = "Full-Resolution"
"""As DAVIS calls the folder of pictures in their own size."""


class Davis:
    """`JPEGImages/` and `Annotations/` of the clip, which every list of `ImageSets/2017/` names."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._images = folder / "JPEGImages" / SIZE / clip.name
        self._masks = folder / "Annotations" / SIZE / clip.name
        self._lists, self._name = folder / "ImageSets" / "2017", clip.name
        for made in (self._images, self._masks, self._lists):
            made.mkdir(parents=True)

    def add(self, moment: Moment) -> None:
        """Two files a view."""
        view = moment.view
        (self._images / f"{view.index:05d}.jpg").write_bytes(view.jpeg)
        (self._masks / f"{view.index:05d}.png").write_bytes(indexed(view.ids))

    def close(self) -> None:
        """Tools ask for either list."""
        for split in ("train", "val"):
            (self._lists / f"{split}.txt").write_text(f"{self._name}\n", encoding="utf-8")


# ----------------------------------------------------------------------
# Views -> the layout of YouTube-VOS (Xu et al., ECCV 2018): JPEG pictures, masks as palette PNG, and
# `meta.json`.


class YoutubeVos:
    """`meta.json` says of each object what it is, and in which frames it is seen."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._clip = folder, clip
        self._images, self._masks = folder / "JPEGImages" / clip.name, folder / "Annotations" / clip.name
        for made in (self._images, self._masks):
            made.mkdir(parents=True)
        self._frames: dict[int, list[str]] = {}

    def add(self, moment: Moment) -> None:
        """Two files a view."""
        view, name = moment.view, f"{moment.view.index:05d}"
        (self._images / f"{name}.jpg").write_bytes(view.jpeg)
        (self._masks / f"{name}.png").write_bytes(indexed(view.ids))
        for thing in view.presences:
            if thing.seen_area:
                self._frames.setdefault(thing.body, []).append(name)

    def close(self) -> None:
        """Objects that are never seen are not named."""
        objects = {
            str(body + 1): {"category": self._clip.labels[body], "frames": frames}
            for body, frames in sorted(self._frames.items())
        }
        told = json.dumps({"videos": {self._clip.name: {"objects": objects}}}, indent=1, ensure_ascii=False)
        (self._folder / "meta.json").write_text(told + "\n", encoding="utf-8")
