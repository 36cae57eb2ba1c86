"""Frames as PNG, and the occlusion order of the objects in each frame, as 16-bit PNG and JSON."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from physgen.export.labels import Clip, Moment, View, Writer, write_png


class Frames(Writer):
    """`00000.png` ...: the frames, 8-bit sRGB."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder = folder

    def add(self, moment: Moment) -> None:
        """One file a frame."""
        (self._folder / f"{moment.view.index:05d}.png").write_bytes(moment.view.png)


class Order(Writer):
    """`00000.png` ...: 0 the background, 1 the farthest object, and so on.

    The order is the same in all frames: by `layer`, and by name within one, as objects are drawn. `order.json` has
    the ranks, and for each frame which object hides how many pixels of which.
    """

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._names = folder, clip.names
        layers = [item.layer for item in clip.scene.objects]
        self._order = sorted(range(len(layers)), key=lambda body: layers[body])
        self._ranks = np.zeros(len(layers) + 1, np.uint16)
        self._ranks[[body + 1 for body in self._order]] = np.arange(1, len(layers) + 1)
        self._frames: list[dict[str, object]] = []

    def add(self, moment: Moment) -> None:
        """One file a frame."""
        view = moment.view
        write_png(self._folder / f"{view.index:05d}.png", self._ranks[view.ids])
        hidden = [
            {"front": self._names[front], "behind": self._names[behind], "pixels": count}
            for front, behind, count in occlusions(view)
        ]
        self._frames.append({"frame": view.index, "hides": hidden})

    def close(self) -> None:
        """Write `order.json`."""
        ranks = {self._names[body]: rank for rank, body in enumerate(self._order, 1)}
        text = json.dumps({"ranks": ranks, "frames": self._frames}, indent=1)
        (self._folder / "order.json").write_text(text + "\n", encoding="utf-8")


def occlusions(view: View) -> list[tuple[int, int, int]]:
    """Front body, hidden body, and hidden px."""
    found = []
    for presence in view.presences:
        if presence.seen_area < presence.whole_area:
            x, y, w, h = presence.box
            counts = np.bincount(view.ids[y : y + h, x : x + w][presence.whole & ~presence.seen])
            found += [(int(i) - 1, presence.body, int(counts[i])) for i in np.flatnonzero(counts) if i]
    return sorted(found)
