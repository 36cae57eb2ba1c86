"""A photo's light at one scale, and what darkness that geometry foretells has to do with it.

What is compared is where light changes, not how much there is: slopes of the logarithm of light, at two widths, with
those of a darkness, near these alone. A far edge of the floor or a picture on the wall has slopes too, but elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Rgb
from physgen.perceive.silhouettes import joined, typical
from physgen.photometry import decode, luminance
from physgen.shadow.cast import Setting as Place
from physgen.shadow.cast import Silhouette
from physgen.shadow.darkness import darkness

F32 = NDArray[np.float32]
Shift = tuple[int, int]
"""px right and down."""

DARKEST = 2e-3
"""Linear light added before logarithms are taken."""
WIDTHS = (0.03, 0.08)
"""Of an object's size: how far slopes are smoothed."""
LEAST_SEEN = 0.1
"""Of the foretold slopes, as much must be in sight."""


@dataclass(frozen=True)
class Trace:
    """A photo's light at one scale, and what may keep some of it away."""

    scale: float
    """px of the photo in one of this picture."""
    size: tuple[int, int]
    """Width and height, px."""
    known: F32
    """(h, w) 1 where no object is near."""
    slopes: Sequence[tuple[float, F32, F32, F32]]
    """Width of smoothing, px; (h, w) how much is known within it; (h, w) slopes of the logarithm of light, x and y."""
    silhouettes: Sequence[Silhouette]
    joined: Sequence[Silhouette]
    """The same, those that stand side by side as one."""

    @cached_property
    def within(self) -> F32:
        """(h, w) `known`, a pixel less on all sides."""
        return np.asarray(cv2.erode(self.known, np.ones((3, 3), np.uint8)), np.float32)

    def likeness(self, place: Place) -> tuple[float, float]:
        """Correlation of seen slopes and those of a light's shadows, and the factor from one to the other."""
        return self.agreement(foretold(self.joined, place))

    def agreement(self, model: F32, above: float = inf) -> tuple[float, float]:
        """Correlation of seen slopes and those of a darkness (h, w), and the factor; means over the widths.

        Told by the rows `above` a row alone, px.
        """
        sums = self._sums(model, above)
        alike = [both / max((own * seen) ** 0.5, 1e-9) for both, own, seen in sums]
        factors = [both / max(own, 1e-9) for both, own, _ in sums]
        return (sum(alike) / len(sums), sum(factors) / len(sums)) if sums else (0.0, 0.0)

    def explained(self, model: F32, above: float) -> float:
        """Squares of the seen slopes that a darkness explains at its best strength, of one sign."""
        return sum(max(both, 0.0) ** 2 / max(own, 1e-9) for both, own, _ in self._sums(model, above))

    def _sums(self, model: F32, above: float) -> list[tuple[float, float, float]]:
        """Of each width: products of foretold and seen slopes, squares of either, near what is foretold.

        Nothing where hardly any of it is in sight.
        """
        rows, columns = np.flatnonzero(model.max(axis=1) > 0.02), np.flatnonzero(model.max(axis=0) > 0.02)
        if len(rows) < 2 or len(columns) < 2:
            return []
        pad = int(3 * self.slopes[-1][0]) + 4
        top, left = max(int(rows[0]) - pad, 0), max(int(columns[0]) - pad, 0)
        part = np.s_[top : int(rows[-1]) + pad + 1, left : int(columns[-1]) + pad + 1]
        model, known = np.minimum(model[part], 2.5), self.known[part]
        within = self.within[part].copy()
        told = max(int(min(above, len(self.known))) - top, 0)
        within[told:] = 0
        found = []
        for width, near, right, down in self.slopes:
            soft = cv2.GaussianBlur(model * known, (0, 0), width) / np.maximum(near[part], 0.05)
            dy, dx = np.gradient(soft)
            energy = np.asarray(dx * dx + dy * dy, np.float32)
            edges = energy > 0.01 * float((energy * within).max())
            weight = within * cv2.dilate(edges.astype(np.uint8), np.ones((9, 9), np.uint8))
            own = float((weight * energy).sum())
            if own <= LEAST_SEEN * float(energy[:told].sum()):
                return []
            both = -float((weight * (dx * right[part] + dy * down[part])).sum())
            found.append((both, own, float((weight * (right[part] ** 2 + down[part] ** 2)).sum())))
        return found


def foretold(things: Sequence[Silhouette], place: Place, shifts: Sequence[Shift] = ()) -> F32:
    """(h, w) -log of the light that things leave; `shifts`: by how much each one's shadow lies elsewhere, whole px."""
    w, h = place.size
    model = np.zeros((h, w), np.float32)
    for k, what in enumerate(things):
        if (found := darkness(what, place)) is None:
            continue
        (x0, y0, x1, y1), values = found
        dx, dy = shifts[k] if shifts else (0, 0)
        left, top = max(x0 + dx, 0), max(y0 + dy, 0)
        right, bottom = min(x1 + dx, w), min(y1 + dy, h)
        if right > left and bottom > top:
            model[top:bottom, left:right] += values[
                top - y0 - dy : bottom - y0 - dy, left - x0 - dx : right - x0 - dx
            ]
    return model


def trace(
    background: Rgb, coverage: F32, longest: int, of: Callable[[float], Sequence[Silhouette]]
) -> Trace | None:
    """The photo at a scale; `of` gives the objects' silhouettes at it. None where there are none."""
    scale = max(max(background.shape[:2]) / longest, 1.0)
    things = of(scale)
    if not things:
        return None
    h, w = (max(1, round(n / scale)) for n in background.shape[:2])
    light = np.log(luminance(decode(background)) + DARKEST)
    open_ = (cv2.dilate((coverage > 0).astype(np.uint8), np.ones((5, 5), np.uint8)) == 0).astype(np.float32)
    share = np.asarray(cv2.resize(open_, (w, h), interpolation=cv2.INTER_AREA), np.float32)
    small = np.asarray(cv2.resize(light * open_, (w, h), interpolation=cv2.INTER_AREA), np.float32)
    small = np.asarray(small / np.maximum(share, 0.05), np.float32)
    known = np.asarray(share * (share > 0.5), np.float32)
    slopes = []
    for part in WIDTHS:
        width = max(part * typical(things), 1.0)
        near = np.asarray(cv2.GaussianBlur(known, (0, 0), width), np.float32)
        down, right = np.gradient(cv2.GaussianBlur(small * known, (0, 0), width) / np.maximum(near, 0.05))
        slopes.append((width, near, np.asarray(right, np.float32), np.asarray(down, np.float32)))
    return Trace(scale, (w, h), known, slopes, things, joined(things))
