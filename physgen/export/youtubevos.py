"""Views -> the layout of YouTube-VOS (Xu et al., ECCV 2018): JPEG pictures, masks as palette PNG, and `meta.json`."""

from __future__ import annotations

import json
from pathlib import Path

from physgen.export.motion import Moment
from physgen.export.palette import indexed
from physgen.export.truth import Clip


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
