"""Figure of the photo with arrows of velocities and pushes, followed by frames; a row for each scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.render.drawing import arrow
from physgen.report.parameters import arrows
from physgen.report.plots.style import MM, PALETTE, RED, SMALL, TEXT, halo, new_figure, plot_settings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
U8 = NDArray[np.uint8]


@dataclass(frozen=True)
class StripLayout:
    """Sizes of a strip."""

    width: float = 174.0
    """mm."""
    gap: float = 3.0
    caption: float = 11.0
    name: float = 12.0
    """Points: between pictures, of the line of times, and of the scene's name at the left."""
    shaft: float = 1.15
    """Points: the width of an arrow's shaft."""


LAYOUT = StripLayout()


@dataclass(frozen=True)
class StripRow:
    """One scene's row."""

    name: str
    world: World
    photo: U8
    """(H, W, 3) sRGB: its first frame, without overlays."""
    lens: Array
    """(2, 3): the photo's px -> those of the first frame."""
    frames: Sequence[tuple[float, U8]]
    """s, and (H, W, 3) sRGB."""

    @property
    def pictures(self) -> list[tuple[str, U8]]:
        """All of them, with what stands above."""
        return [("input", self.photo), *((f"{time:.2f} s", rgb) for time, rgb in self.frames)]


def strip_figure(rows: Sequence[StripRow], width: float | None = None, *, names: bool = False) -> Figure:
    """`width` in mm. Frames keep their pixels, those of larger ones are resampled to the width of the smallest.

    The figure's own dpi is such that a pixel of it is one of a frame.
    """
    cell = min(row.photo.shape[1] for row in rows)
    count = max(len(row.pictures) for row in rows)
    inches = (width or LAYOUT.width) / MM
    pads = ((count - 1) * LAYOUT.gap + (LAYOUT.name if names else 0.0)) / 72
    dpi = count * cell / max(inches - pads, 0.2 * inches)
    gap, caption, left = (
        round(points * dpi / 72) for points in (LAYOUT.gap, LAYOUT.caption, LAYOUT.name if names else 0.0)
    )
    tall = [max(1, round(cell * row.photo.shape[0] / row.photo.shape[1])) for row in rows]
    wide, high = left + count * (cell + gap) - gap, sum(tall) + len(rows) * caption
    with plot_settings():
        # a hair more, so that the canvas is not a pixel less for rounding
        figure = new_figure((wide + 1e-4) / dpi, (high + 1e-4) / dpi, dpi=dpi)
        top = 0
        for row, height in zip(rows, tall, strict=True):
            top += caption
            for k, (text, rgb) in enumerate(row.pictures):
                x = left + k * (cell + gap)
                box = (x / wide, 1 - (top + height) / high, cell / wide, height / high)
                axes = figure.add_axes(box, frameon=False)
                axes.set_axis_off()
                axes.imshow(_sized(rgb, cell, height), aspect="auto", interpolation="none")
                axes.set_title(text, fontsize=SMALL, pad=2)
                if k == 0:
                    _draw_arrows(axes, row, cell / rgb.shape[1], LAYOUT.shaft * dpi / 72)
            if names:
                place = (0.4 * left / wide, 1 - (top + height / 2) / high)
                figure.text(*place, row.name, rotation=90, ha="center", va="center", fontsize=TEXT)
            top += height
        return figure


def _draw_arrows(axes: Axes, row: StripRow, zoom: float, shaft: float) -> None:
    """Velocities filled, pushes hollow; `zoom`: px of the figure by px of the frame; `shaft`: its width, px."""
    from matplotlib.patches import Polygon

    for kind, tail, tip, _ in arrows(row.world):
        at, to = ((row.lens @ [*point, 1.0] + 0.5) * zoom - 0.5 for point in (tail, tip))
        face, line = (RED, 0.0) if kind == "velocity" else (PALETTE.paper, 0.9)
        outline = arrow(at, to, shaft)
        rim = halo(line + 1.4)
        axes.add_patch(Polygon(outline, facecolor=face, edgecolor=RED, linewidth=line, path_effects=rim))


def _sized(rgb: U8, width: int, height: int) -> U8:
    """(height, width, 3); the very same where that is its size."""
    if rgb.shape[:2] == (height, width):
        return rgb
    return np.asarray(cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
