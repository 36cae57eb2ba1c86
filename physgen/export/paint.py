"""Clip -> the albedo of its views: it turns with things, and with balls on a table in space.

Behind things it is the filled background (`clean.png`, or `background.png`), times what the albedo beside is to the
background there, spread as a soap film: its pattern goes on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physgen.export.layers import Layers, filled, hole, parted
from physgen.export.truth import Clip, View
from physgen.percepts.maps import Percepts
from physgen.photometry import decode

F32 = NDArray[np.float32]
U16 = NDArray[np.uint16]
Mask = NDArray[np.bool_]
FULL = 65535
DARK = 2e-3
"""Linear light below which nobody tells what it is a share of."""
MOST = 8.0
"""Times the background's light that albedo may be: shadows are about as deep."""


class Paint:
    """Of a clip whose photo has an albedo; what was asked last is at hand."""

    def __init__(self, clip: Clip) -> None:
        assert clip.maps is not None
        assert clip.maps.albedo is not None
        albedo = clip.maps.albedo
        ground, parts = _ground(clip.maps, albedo, hole(clip)), parted(albedo[..., ::-1], clip)
        self._layers = Layers(clip, np.ascontiguousarray(ground[..., ::-1]), parts, coded)
        self._last: tuple[View, U16] | None = None

    def seen(self, view: View) -> U16:
        """(h, w, 3), 65535 = 1, in OpenCV's order, B, G, R: what files are made of."""
        if self._last is None or self._last[0] is not view:
            self._last = view, self._layers.seen(view, self._layers.rolled)
        return self._last[1]


def _ground(maps: Percepts, albedo: F32, where: Mask) -> F32:
    """(H, W, 3) with what is behind things."""
    behind = maps.background if maps.clean is None else maps.clean
    if behind is None:
        return np.clip(filled(albedo, where), 0, 1)
    light = decode(behind) + np.float32(DARK)
    share = np.minimum((albedo + np.float32(DARK)) / light, np.float32(MOST))
    there = filled(share, where) * light - np.float32(DARK)
    return np.clip(np.where(where[..., None], there, albedo), 0, 1)


def coded(albedo: F32) -> U16:
    """0..1 -> 16 bits."""
    return np.asarray(albedo * np.float32(FULL) + np.float32(0.5), np.uint16)
