"""Occlusion order of the objects in each frame, as 16-bit PNG and JSON."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from physgen.export.files import write_png
from physgen.export.labels import Clip, Moment, View


class Order:
    """A clip has one order; what hides what changes."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._names = folder, clip.names
        layers = [thing.layer for thing in clip.scene.objects]
        self._order = sorted(range(len(layers)), key=lambda body: layers[body])
        self._ranks = np.zeros(len(layers) + 1, np.uint16)
        self._ranks[[body + 1 for body in self._order]] = np.arange(1, len(layers) + 1)
        self._frames: list[dict[str, object]] = []

    def add(self, moment: Moment) -> None:
        """One file a view."""
        view = moment.view
        write_png(self._folder / f"{view.index:05d}.png", self._ranks[view.ids])
        hidden = [
            {"front": self._names[front], "behind": self._names[behind], "pixels": count}
            for front, behind, count in hiding(view)
        ]
        self._frames.append({"frame": view.index, "hides": hidden})

    def close(self) -> None:
        """What all views have in common, and what each has of its own."""
        ranks = {self._names[body]: rank for rank, body in enumerate(self._order, 1)}
        text = json.dumps({"ranks": ranks, "frames": self._frames}, indent=1)
        (self._folder / "order.json").write_text(text + "\n", encoding="utf-8")


def hiding(view: View) -> list[tuple[int, int, int]]:
    """Who is seen where whom would be, and on how many px."""
    found = []
    for thing in view.presences:
        if thing.seen_area < thing.whole_area:
            x, y, w, h = thing.box
            counts = np.bincount(view.ids[y : y + h, x : x + w][thing.whole & ~thing.seen])
            found += [(int(i) - 1, thing.body, int(counts[i])) for i in np.flatnonzero(counts) if i]
    return sorted(found)
