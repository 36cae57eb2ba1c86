"""Masks as palette PNG in the layouts of DAVIS 2017 and YouTube-VOS, beside JPEG pictures."""

from __future__ import annotations

import json
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen.export.labels import PNG_LEVEL, Clip, Moment, Writer

FIRST_COLOURS = (
    (0, 0, 0), (128, 0, 0), (0, 128, 0), (128, 128, 0), (0, 0, 128), (128, 0, 128), (0, 128, 128), (128, 128, 128),
    (64, 0, 0), (191, 0, 0), (64, 128, 0), (191, 128, 0), (64, 0, 128), (191, 0, 128), (64, 128, 128), (191, 128, 128),
    (0, 64, 0), (128, 64, 0), (0, 191, 0), (128, 191, 0), (0, 64, 128), (128, 64, 128),
)  # fmt: skip
"""sRGB of the first indices (Perazzi et al., CVPR 2016); later ones are grey, with their number as level."""
PALETTE = (*FIRST_COLOURS, *((level, level, level) for level in range(len(FIRST_COLOURS), 256)))
FULL_SIZE = "Full-Resolution"
"""DAVIS' name for the folder of pictures in their own size."""


def palette_png(ids: NDArray[np.uint16]) -> bytes:
    """A file of (H, W) ids up to 254, 0 the background; 255 means unknown for DAVIS' own measures."""
    picture = Image.fromarray(ids.astype(np.uint8)).convert("P")
    picture.putpalette([value for colour in PALETTE for value in colour])
    file = BytesIO()
    picture.save(file, "PNG", compress_level=PNG_LEVEL)
    return file.getvalue()


class MaskFolders(Writer):
    """`JPEGImages/` and `Annotations/` with a subfolder for the clip."""

    def __init__(self, folder: Path, clip: Clip, size: str = "") -> None:
        self._folder, self._clip = folder, clip
        self._images, self._masks = (
            folder / name / size / clip.name for name in ("JPEGImages", "Annotations")
        )
        for made in (self._images, self._masks):
            made.mkdir(parents=True)

    def add(self, moment: Moment) -> None:
        """Two files a frame."""
        view = moment.view
        (self._images / f"{view.index:05d}.jpg").write_bytes(view.jpeg)
        (self._masks / f"{view.index:05d}.png").write_bytes(palette_png(view.ids))


class Davis(MaskFolders):
    """DAVIS 2017 (Pont-Tuset et al., 2017); both lists of `ImageSets/2017/` name the clip."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        super().__init__(folder, clip, FULL_SIZE)

    def close(self) -> None:
        """Tools read either list."""
        lists = self._folder / "ImageSets" / "2017"
        lists.mkdir(parents=True)
        for split in ("train", "val"):
            (lists / f"{split}.txt").write_text(f"{self._clip.name}\n", encoding="utf-8")


class YoutubeVos(MaskFolders):
    """YouTube-VOS (Xu et al., ECCV 2018); `meta.json` has the label of each visible object, and its frames."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        super().__init__(folder, clip)
        self._frames: dict[int, list[str]] = {}

    def add(self, moment: Moment) -> None:
        """Also notes which objects are visible."""
        super().add(moment)
        for presence in moment.view.presences:
            if presence.seen_area:
                self._frames.setdefault(presence.body, []).append(f"{moment.view.index:05d}")

    def close(self) -> None:
        """Objects that are never visible are not listed."""
        objects = {
            str(body + 1): {"category": self._clip.labels[body], "frames": frames}
            for body, frames in sorted(self._frames.items())
        }
        text = json.dumps({"videos": {self._clip.name: {"objects": objects}}}, indent=1, ensure_ascii=False)
        (self._folder / "meta.json").write_text(text + "\n", encoding="utf-8")
