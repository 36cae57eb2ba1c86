"""Views -> the layout of DAVIS 2017 (Pont-Tuset et al., 2017): JPEG pictures, and masks as palette PNG."""

from __future__ import annotations

from pathlib import Path

from physgen.export.motion import Moment
from physgen.export.palette import indexed
from physgen.export.truth import Clip

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
