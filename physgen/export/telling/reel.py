"""Times of the motion -> when and where the clip shows them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physgen.scene.model import Play, Point

if TYPE_CHECKING:
    from physgen.export.truth import Clip

Array = NDArray[np.float64]


class Reel:
    """Frames of a clip, forward, backward or to and fro; of what is shown twice, the first time counts."""

    def __init__(self, clip: Clip) -> None:
        self._times, self._order = clip.trajectory.times, clip.shot.order
        self._fps, self._shot = clip.fps, clip.shot
        self._backward = clip.scene.render.play is Play.BACKWARD

    def frame(self, time: float) -> int:
        """The first frame that shows what is so after a moment of the motion; played backward, what was before it."""
        last = len(self._times) - 1
        if self._backward:
            sample = max(int(np.searchsorted(self._times, time + 1e-9, side="right")) - 1, 0)
        else:
            sample = min(int(np.searchsorted(self._times, time - 1e-9)), last)
        return self._order.index(sample)

    def shown(self, time: float) -> float:
        """s from the clip's start as it plays; what comes after the last sample is not shown before the start."""
        step = float(self._times[1] - self._times[0]) if len(self._times) > 1 else 1.0
        samples = time / step
        if self._backward:
            samples = max(len(self._times) - 1 - samples, 0.0)
        return samples / self._fps

    def seen(self, at: Point, time: float) -> Point:
        """px of the photo -> px of the video at a moment."""
        x, y = (self._shot.affine(time) @ (*at, 1.0)).tolist()
        return x, y
