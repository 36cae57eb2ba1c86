"""Views -> frames/00000.png ..., as they are."""

from __future__ import annotations

from pathlib import Path

from physgen.export.motion import Moment
from physgen.export.truth import Clip


class Frames:
    """8-bit sRGB."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder = folder

    def add(self, moment: Moment) -> None:
        """One file a view."""
        (self._folder / f"{moment.view.index:05d}.png").write_bytes(moment.view.png)

    def close(self) -> None:
        """Nothing is left to be said."""
