"""Background in the light of the things that have not moved: what a frame shows where nothing has come."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physgen.photometry import decode
from physgen.render.encoding import encoded
from physgen.render.lit import shaded
from physgen.render.placing import Slices
from physgen.render.stage import Stage, Stand
from physgen.render.tiles import union

F32 = NDArray[np.float32]


class Left:
    """What is left when things have gone; kept from frame to frame, as most things that move go on moving.

    It tells nothing of the frames that came before: the same things gone leave the same to the last bit.
    """

    def __init__(self, stage: Stage, keep: bool) -> None:
        """With `keep` it stays the photo's background whatever moves."""
        self.keep = keep
        self._lit = stage.lit
        self._gone: set[int] = set()
        self.dark: F32 | None = None if stage.lit is None else stage.lit.total.copy()
        """(H, W): -log of the light that is left."""
        self.light: F32 = decode(stage.background) if stage.lit is None else stage.lit.behind()
        """(H, W, 3) linear."""
        self.codes = encoded(self.light)
        """(H, W, 3) sRGB."""

    def by(self, stands: Sequence[Stand]) -> list[Slices]:
        """Go on to things as they stand now; returns where anything changed."""
        lit, dark = self._lit, self.dark
        if self.keep or lit is None or dark is None:
            return []
        shadows = {s.k: lit.casts[s.k].whole for s in stands if s.start != s.pose}
        gone = {k for k, whole in shadows.items() if whole is not None}
        if gone == self._gone:
            return []
        boxes = [whole[0] for k in gone ^ self._gone if (whole := lit.casts[k].whole) is not None]
        self._gone = gone
        changed = union([np.s_[y0:y1, x0:x1] for x0, y0, x1, y1 in boxes], (dark.shape[1], dark.shape[0]))
        for box in changed:
            dark[box] = lit.total[box]
        for k in sorted(gone):
            if (whole := lit.casts[k].whole) is not None:
                for box in changed:
                    _take(dark, box, *whole)
        for box in changed:
            self.light[box] = shaded(lit.plate[box], dark[box], lit.tint)
            self.codes[box] = encoded(self.light[box])
        return changed


def _take(dark: F32, box: Slices, at: tuple[int, int, int, int], what: F32) -> None:
    """Take the part of `what` that lies in the box, of a picture whose box is `at`, from `dark` (H, W)."""
    x0, y0 = max(box[1].start, at[0]), max(box[0].start, at[1])
    x1, y1 = min(box[1].stop, at[2]), min(box[0].stop, at[3])
    if x0 < x1 and y0 < y1:
        dark[y0:y1, x0:x1] -= what[y0 - at[1] : y1 - at[1], x0 - at[0] : x1 - at[0]]
