"""Photo and frames of scenes -> the paper's strip: the photo with red arrows, then frames with their times.

A row a scene. In a PNG every frame keeps its own pixels, unless a width is asked for; SVG and PDF hold them whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.photometry import decode, encode_u8
from physgen.report.plots.arrows import Arrows, arrows, draw, key, sample
from physgen.report.plots.look import DPI, SMALL, TEXT, Look, drawing, paper
from physgen.report.plots.units import Units, units
from physgen.scene.model import Scene
from physgen.simulate.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
U8 = NDArray[np.uint8]

WIDTH = 174.0
"""mm."""
GAP, CAPTION, KEY, NAME = 3.0, 11.0, 13.0, 12.0
"""Points: between pictures, of the line of times, of arrows' lengths, and of the scene's name at the left."""
AIR = 4.0
"""Points, between scenes."""


@dataclass(frozen=True)
class Reel:
    """One scene's row."""

    scene: Scene
    world: World
    trajectory: Trajectory
    photo: U8
    """(H, W, 3) sRGB: its first frame, without overlays."""
    lens: Array
    """(2, 3): the photo's px -> those of the first frame."""
    frames: Sequence[tuple[float, U8]]
    """s, and (H, W, 3) sRGB."""

    @property
    def pictures(self) -> list[tuple[str, U8]]:
        """All of them, with what stands above."""
        digits = 2 if all(abs(100 * t - round(100 * t)) < 1e-6 or t >= 0.1 for t, _ in self.frames) else 3
        return [("input", self.photo), *((f"{time:.{digits}f} s", rgb) for time, rgb in self.frames)]


@dataclass(frozen=True)
class Plan:
    """Where things are: px at `dpi`, whole numbers."""

    dpi: float
    columns: int
    cell: int
    """Width of a picture."""
    gap: int
    left: int
    width: int

    def points(self, count: float) -> int:
        """px of points."""
        px: float = count * self.dpi / 72
        return round(px)

    def tall(self, reel: Reel) -> int:
        """Height of a scene's pictures."""
        height, width = reel.photo.shape[:2]
        px: float = self.cell * height / width
        return max(1, round(px))


def planned(reels: Sequence[Reel], look: Look, columns: int | None, names: bool, exact: bool) -> Plan:
    """`exact`: where no one has said how many pixels there are, frames keep theirs, those of the smallest at least."""
    count = min(columns or 10**6, max(len(reel.pictures) for reel in reels))
    inches, own = look.inches(WIDTH), min(reel.photo.shape[1] for reel in reels)
    pads = ((count - 1) * GAP + (NAME if names else 0.0)) / 72
    if exact and look.dpi is None and look.pixels is None:
        dpi = count * own / max(inches - pads, 0.2 * inches)
        gap, left = round(GAP * dpi / 72), round(NAME * dpi / 72) if names else 0
        return Plan(dpi, count, own, gap, left, left + count * own + (count - 1) * gap)
    dpi = look.dpi or (look.pixels / inches if look.pixels else DPI)
    gap, left = round(GAP * dpi / 72), round(NAME * dpi / 72) if names else 0
    width = look.pixels or round(inches * dpi)
    cell = max(1, (width - left - (count - 1) * gap) // count)
    return Plan(dpi, count, cell, gap, left, width)


def strip_figure(
    reels: Sequence[Reel], look: Look, *, columns: int | None = None, names: bool = False, exact: bool = True
) -> Figure:
    """`columns` pictures side by side, all of a scene's unless given; `exact` for a PNG, whose pixels count."""
    plan = planned(reels, look, columns, names, exact)
    shared = len({tuple(caption for caption, _ in reel.pictures) for reel in reels}) == 1
    found = [arrows(reel.world, reel.trajectory) for reel in reels]
    with drawing(look):
        rows = [
            _row(reel, of, plan, k == 0 or not shared)
            for k, (reel, of) in enumerate(zip(reels, found, strict=True))
        ]
        total = sum(rows) + (len(rows) - 1) * plan.points(AIR)
        # a hair more, so that the canvas is not a pixel less for rounding
        figure = paper(look, (plan.width + 1e-4) / plan.dpi, (total + 1e-4) / plan.dpi, plan.dpi)
        top = 0
        for k, (reel, of, high) in enumerate(zip(reels, found, rows, strict=True)):
            _place(figure, reel, of, plan, (top, total), k == 0 or not shared, look, exact)
            if names:
                middle = 1 - (top + high / 2) / total
                figure.text(
                    plan.points(NAME - 3) / 2 / plan.width, middle, reel.scene.name, rotation=90,
                    ha="center", va="center", fontsize=TEXT,
                )  # fmt: skip
            top += high + plan.points(AIR)
        return figure


def _row(reel: Reel, of: Arrows, plan: Plan, timed: bool) -> int:
    """px: the height of a scene's row."""
    lines = ceil(len(reel.pictures) / plan.columns)
    captions = lines if lines > 1 else int(timed)
    below = plan.points(KEY) if of.found else 0
    return lines * plan.tall(reel) + captions * plan.points(CAPTION) + (lines - 1) * plan.gap + below


def _place(
    figure: Figure,
    reel: Reel,
    of: Arrows,
    plan: Plan,
    at: tuple[int, int],
    timed: bool,
    look: Look,
    exact: bool,
) -> None:
    """A row's pictures; `at`: px from the top, of px in all."""
    top, total = at
    tall = plan.tall(reel)
    captioned = timed or len(reel.pictures) > plan.columns
    y = top
    for k, (caption, rgb) in enumerate(reel.pictures):
        column = k % plan.columns
        if k and not column:
            y += tall + plan.gap
        if captioned and not column:
            y += plan.points(CAPTION)
        x = plan.left + column * (plan.cell + plan.gap)
        if captioned:
            middle = (x + plan.cell / 2) / plan.width, 1 - (y - plan.points(3)) / total
            figure.text(*middle, caption, ha="center", va="baseline", fontsize=SMALL)
        shown = _sized(rgb, (plan.cell, tall)) if exact else rgb
        height, width = shown.shape[:2]
        box = (x / plan.width, 1 - (y + tall) / total, plan.cell / plan.width, tall / total)
        axes = figure.add_axes(box, frameon=False)
        axes.set_axis_off()
        extent = (-0.5, width - 0.5, height - 0.5, -0.5)
        axes.imshow(shown, extent=extent, aspect="auto", interpolation="none")
        if k == 0:
            zoom = width / rgb.shape[1]
            lens = np.column_stack([reel.lens[:, :2] * zoom, (reel.lens[:, 2] + 0.5) * zoom - 0.5])
            photo = max(width, height) / max(reel.world.size)
            draw(axes, of, lens, plan.dpi / 72 * width / plan.cell, photo)
    if of.found:
        _key(figure, of, units(reel.scene, look), plan, (y + tall, total), reel)


def _key(figure: Figure, of: Arrows, said: Units, plan: Plan, at: tuple[int, int], reel: Reel) -> None:
    """Below a row: how long arrows are."""
    top, total = at
    room = plan.width - plan.left
    high = plan.points(KEY)
    axes = figure.add_axes(
        (plan.left / plan.width, 1 - (top + high) / total, room / plan.width, high / total)
    )
    axes.set_axis_off()
    axes.set_xlim(0, room)
    axes.set_ylim(high, 0)
    point, x = plan.dpi / 72, 2 * plan.dpi / 72
    photo = max(plan.cell, plan.tall(reel)) / max(reel.world.size)
    for length, hollow, text in key(of, said, float(max(reel.world.size))):
        if length:
            sample(axes, (x, 0.55 * high), length * photo, hollow, point)
            x += length * photo + 3 * point
        words = axes.text(x, 0.55 * high, text, ha="left", va="center_baseline", fontsize=SMALL)
        x += words.get_window_extent().width / figure.dpi * 72 * point + 10 * point


def _sized(rgb: U8, size: tuple[int, int]) -> U8:
    """(h, w, 3) of `size` (w, h), in linear light; the very same where that is its own."""
    if (rgb.shape[1], rgb.shape[0]) == size:
        return rgb
    how = cv2.INTER_AREA if size[0] < rgb.shape[1] else cv2.INTER_CUBIC
    return encode_u8(np.clip(cv2.resize(decode(rgb), size, interpolation=how), 0, 1))
