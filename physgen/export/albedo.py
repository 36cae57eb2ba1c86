"""Views -> albedo/00000.png ...: what surfaces send back of white light, linear, 16 bits a channel, 65535 = 1."""

from __future__ import annotations

from pathlib import Path

from physgen.export.motion import Moment
from physgen.export.paint import Paint
from physgen.export.pictures import png_of_bgr, told
from physgen.export.truth import Clip


class Albedo:
    """Borders are hard: a pixel has the albedo of the one thing that its id names."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._paint = folder, clip.shared(Paint)
        told(folder, {"at_0": 0.0, "at_65535": 1.0, "light": "linear"})

    def add(self, moment: Moment) -> None:
        """One file a view."""
        (self._folder / f"{moment.view.index:05d}.png").write_bytes(png_of_bgr(self._paint.seen(moment.view)))

    def close(self) -> None:
        """Nothing is left to be said."""
