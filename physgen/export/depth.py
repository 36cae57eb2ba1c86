"""Views -> depth/00000.png ...: 16 bits, larger is farther; scale.json says what 0 and 65535 stand for.

Things move across the view and not in depth, so each keeps its own. It turns with them in the picture, but that of a
ball (`solid: sphere`), which is as round from all sides.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physgen.export.layers import Layers, Part, filled, hole, parted
from physgen.export.motion import Moment
from physgen.export.pictures import png, told
from physgen.export.places import is_ball
from physgen.export.truth import Clip, View
from physgen.render.placing import Slices

F32 = NDArray[np.float32]
U16 = NDArray[np.uint16]
FULL = 65535


class Depth:
    """In the unit of the photo's own map."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._depths = folder, clip.shared(Depths)
        low, high = self._depths.range
        told(folder, {"at_0": low, "at_65535": high, "larger": "farther"})

    def add(self, moment: Moment) -> None:
        """One file a view."""
        (self._folder / f"{moment.view.index:05d}.png").write_bytes(self._depths.png(moment.view))

    def close(self) -> None:
        """Nothing is left to be said."""


class Depths:
    """The depth of views, of a clip whose photo has a depth; the picture that was asked for last is at hand."""

    def __init__(self, clip: Clip) -> None:
        assert clip.maps is not None
        assert clip.maps.depth is not None
        self.range = low, high = clip.scene.maps.get("depth", (0.0, 1.0))
        """What 0 and 65535 stand for, as in the photo's own map."""
        self._world, steps = clip.world, np.float32(FULL / (high - low))

        def finish(depth: F32) -> U16:
            return np.asarray((depth - np.float32(low)) * steps + np.float32(0.5), np.uint16)

        depth = clip.maps.depth
        ground = np.clip(filled(depth, hole(clip)), low, high)
        self._layers = Layers(clip, ground, parted(depth, clip), finish)
        self._last: tuple[View, bytes | memoryview] | None = None

    def png(self, view: View) -> bytes | memoryview:
        """(h, w) codes, as a file: two formats hold it."""
        if self._last is None or self._last[0] is not view:
            self._last = view, png(self._layers.seen(view, self._sampled))
        return self._last[1]

    def _sampled(self, body: int, part: Part, view: View, box: Slices) -> F32:
        moved = self._layers.carried if is_ball(self._world.bodies[body]) else self._layers.turned
        return moved(body, part, view, box)
