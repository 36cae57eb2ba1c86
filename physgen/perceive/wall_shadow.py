"""Photo from the side -> where on a wall behind them the objects' shadows lie: all of them moved alike.

One distant light moves every shadow on an upright wall by the same way; seen in perspective, farther off, the whole is
a little smaller. That way and size are looked for at which the outlines go with slopes of the photo's light.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.silhouettes import typical
from physgen.perceive.trace import Trace
from physgen.shadow.cast import Silhouette

F32 = NDArray[np.float32]

SIZES = (1.0, 0.94, 0.88, 0.82)
"""How large the objects are when drawn as far back as the wall."""
FARTHEST = 5.0
"""Of an object's size: how far from it its shadow is looked for."""
IN_SIGHT = 0.5
"""Share of all outlines that must lie in the photo, and free."""
STEEPEST = 97
"""Percentile of the photo's slopes: steeper ones are edges of things, and count as this."""


@dataclass(frozen=True)
class Cast:
    """The objects' shadows on a wall, in px of the photo."""

    shift: tuple[float, float]
    """From an object to its shadow, in the middle of the photo."""
    size: float
    """Of shadow to object, about the middle of the photo."""
    likeness: float
    """Correlation of slopes along the outlines."""
    factor: float
    """-log of the light that is left."""
    soft: float = 0.0
    """px, standard deviation of the shadows' edges."""

    def convincing(self, things: int) -> bool:
        """One round thing finds a round patch almost anywhere; several must find theirs all at once."""
        return self.likeness >= float(0.5 + 0.35 / max(things, 1) ** 0.5)


def thrown(what: Silhouette, cast: Cast, scale: float, size: tuple[int, int]) -> F32:
    """(h, w) coverage of the wall by its shadow, on a picture of `size` (w, h), 1 / scale of the photo's."""
    middle = (size[0] - 1) / 2, (size[1] - 1) / 2
    matrix = np.zeros((2, 3))
    for k in (0, 1):
        matrix[k, k] = cast.size
        matrix[k, 2] = cast.size * (what.corner[k] - middle[k]) + middle[k] + cast.shift[k] / scale
    return np.asarray(cv2.warpAffine(what.coverage, matrix, size, flags=cv2.INTER_LINEAR), np.float32)


def shaded(trace: Trace, cast: Cast) -> F32:
    """(h, w) coverage of the wall by all shadows, on the trace's picture."""
    total = np.zeros(trace.known.shape, np.float32)
    for what in trace.silhouettes:
        np.maximum(total, thrown(what, cast, trace.scale, trace.size), out=total)
    soft = cast.soft / trace.scale
    return total if soft < 0.3 else np.asarray(cv2.GaussianBlur(total, (0, 0), soft), np.float32)


def refined(trace: Trace, cast: Cast) -> Cast:
    """Smaller steps from a cast, and the softness of its edges, on a finer picture."""

    def rated(one: Cast) -> Cast:
        likeness, factor = trace.agreement(shaded(trace, one))
        return replace(one, likeness=likeness, factor=factor)

    best = rated(replace(cast, soft=trace.slopes[0][0] * trace.scale))
    for step in (4.0, 2.0, 1.0):
        (dx, dy), by = best.shift, 0.01 * step
        tries = [
            replace(best, shift=(dx + a * step, dy + b * step)) for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))
        ]
        tries += [replace(best, size=best.size + by), replace(best, size=best.size - by)]
        tries += [replace(best, soft=best.soft * 1.5), replace(best, soft=best.soft / 1.5)]
        for _ in range(2):
            best = max([best, *(rated(one) for one in tries)], key=lambda one: one.likeness)
            (dx, dy) = best.shift
            tries = [
                replace(best, shift=(dx + a * step, dy + b * step))
                for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))
            ]
            tries += [replace(best, soft=best.soft * 1.5), replace(best, soft=best.soft / 1.5)]
    return best


def on_wall(trace: Trace) -> Cast | None:
    """The best way to move the objects onto their shadows; None where no way keeps enough of them in sight."""
    width, near, right, down = trace.slopes[-1]
    within = cv2.erode(trace.known, np.ones((3, 3), np.uint8)) * (near > 0.3)
    steep = np.hypot(right, down)
    free = steep[within > 0]
    if not free.size:
        return None
    cut = np.minimum(1, np.percentile(free, STEEPEST) / np.maximum(steep, 1e-6))
    right, down = within * right * cut, within * down * cut
    shape = (cv2.getOptimalDFTSize(2 * trace.size[1]), cv2.getOptimalDFTSize(2 * trace.size[0]))
    spectra = [np.fft.rfft2(part, shape) for part in (right, down, right * right + down * down, within)]
    rows, columns = (np.fft.fftfreq(n, 1 / n)[:, None] for n in shape)
    reach = FARTHEST * typical(trace.silhouettes)
    allowed = (np.abs(columns.T) < reach) & (rows > -0.12 * reach) & (rows < reach)
    best: Cast | None = None
    for size in SIZES:
        outline = np.zeros(trace.known.shape, np.float32)
        for what in trace.silhouettes:
            still = Cast((0.0, 0.0), size, 0.0, 0.0)
            np.maximum(outline, thrown(what, still, 1.0, trace.size), out=outline)
        dy, dx = np.gradient(cv2.GaussianBlur(outline, (0, 0), width))
        energy = dx * dx + dy * dy
        edges = (energy > 0.02 * energy.max()).astype(np.float32)
        band = np.asarray(cv2.dilate(edges, np.ones((5, 5), np.uint8)), np.float32)

        def moved(k: int, by: F32) -> NDArray[np.float64]:
            return np.fft.irfft2(spectra[k] * np.conj(np.fft.rfft2(by, shape)), shape)

        both = -(moved(0, dx) + moved(1, dy))
        own, seen = np.maximum(moved(3, energy), 1e-9), np.maximum(moved(2, band), 1e-9)
        likeness = np.where(allowed & (own > IN_SIGHT * energy.sum()), both / np.sqrt(own * seen), -1.0)
        row, column = np.unravel_index(int(likeness.argmax()), likeness.shape)
        if likeness[row, column] > (best.likeness if best else 0.0):
            shift = float(columns[column, 0]) * trace.scale, float(rows[row, 0]) * trace.scale
            best = Cast(
                shift, size, float(likeness[row, column]), float(both[row, column] / own[row, column])
            )
    return best
