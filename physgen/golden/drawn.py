"""The frames that are kept, and the frames now -> which differ, how many of their pixels, how far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physgen.golden.asking import Pixels
from physgen.golden.taking import Still

U8 = NDArray[np.uint8]

SLACK = 1e-9


@dataclass(frozen=True)
class Compared:
    """A frame that is kept, and the same frame now."""

    then: Still
    now: Still
    levels: U8 | None
    """(h, w) grey levels: the most by which a channel of a pixel differs; None: the two are not of one size."""
    share: float
    """Of the pixels that differ by more levels than are allowed."""
    mean: float
    """Grey levels."""
    bad: bool

    @property
    def worst(self) -> int:
        """Grey levels: the most that any pixel differs by."""
        return 255 if self.levels is None else int(self.levels.max())


@dataclass(frozen=True)
class Drawn:
    """How frames compare."""

    allowed: Pixels
    frames: tuple[Compared, ...]
    """Those that are in both."""
    kept: tuple[int, ...]
    """Which frames were kept."""
    asked: tuple[int, ...]
    """Which are, now."""

    @property
    def first(self) -> Compared | None:
        """The first bad one."""
        return next((frame for frame in self.frames if frame.bad), None)

    @property
    def agrees(self) -> bool:
        """Whether nothing differs by more than is allowed."""
        return self.first is None and self.kept == self.asked

    @property
    def worst(self) -> int:
        """Grey levels."""
        return max((frame.worst for frame in self.frames), default=0)


def drawn(then: Sequence[Still], now: Sequence[Still], allowed: Pixels) -> Drawn:
    """Compare frames by their number."""
    frames = {still.index: still for still in now}
    return Drawn(
        allowed,
        tuple(_compared(still, frames[still.index], allowed) for still in then if still.index in frames),
        tuple(still.index for still in then),
        tuple(frames),
    )


def _compared(then: Still, now: Still, allowed: Pixels) -> Compared:
    if then.rgb.shape != now.rgb.shape:
        return Compared(then, now, None, 1.0, 255.0, bad=True)
    apart = np.abs(now.rgb.astype(np.int16) - then.rgb).astype(np.uint8)
    levels = apart.max(axis=-1)
    share, mean = float((levels > allowed.levels).mean()), float(apart.mean())
    bad = share > allowed.share + SLACK or mean > allowed.mean + SLACK
    return Compared(then, now, levels, share, mean, bad)
