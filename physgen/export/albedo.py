"""Views -> albedo/00000.png ...: what surfaces send back of white light, linear, 16 bits a channel, 65535 = 1.

It turns with things, and with balls on a table in space. Behind things it is the filled background (`clean.png`, or
`background.png`), times what the albedo beside is to the background there, spread as a soap film: its pattern goes on.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physgen.export.layers import Layers, filled, hole, parted
from physgen.export.motion import Moment
from physgen.export.pictures import save, told
from physgen.export.truth import Clip, View
from physgen.photometry import decode

F32 = NDArray[np.float32]
U16 = NDArray[np.uint16]
FULL = 65535
DARK = 2e-3
"""Linear light below which nobody tells what it is a share of."""
MOST = 8.0
"""Times the background's light that albedo may be: shadows are about as deep."""


class Albedo:
    """Of the frame as it is seen, soft borders left out."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._paint = folder, Paint(clip)
        told(folder, {"at_0": 0.0, "at_65535": 1.0, "light": "linear"})

    def add(self, moment: Moment) -> None:
        """One file a view."""
        save(self._folder / f"{moment.view.index:05d}.png", self._paint.seen(moment.view))

    def close(self) -> None:
        """Nothing is left to be said."""


class Paint:
    """The albedo of views."""

    def __init__(self, clip: Clip) -> None:
        assert clip.maps is not None
        assert clip.maps.albedo is not None
        albedo, behind = clip.maps.albedo, clip.maps.clean
        behind = clip.maps.background if behind is None else behind
        where = hole(clip)
        if behind is None:
            ground = filled(albedo, where)
        else:
            light = decode(behind) + np.float32(DARK)
            share = np.minimum((albedo + np.float32(DARK)) / light, np.float32(MOST))
            ground = np.where(where[..., None], filled(share, where) * light - np.float32(DARK), albedo)
        self._layers = Layers(clip, np.clip(ground, 0, 1), parted(albedo, clip), coded)

    def seen(self, view: View) -> U16:
        """(h, w, 3), 65535 = 1."""
        return self._layers.seen(view, self._layers.rolled)


def coded(albedo: F32) -> U16:
    """0..1 -> 16 bits."""
    return np.asarray(albedo * np.float32(FULL) + np.float32(0.5), np.uint16)
