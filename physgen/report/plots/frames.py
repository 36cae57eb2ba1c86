"""Figure of the photo with arrows of velocity and force, followed by frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.photometry import decode, encode_u8
from physgen.render.drawing import HEAD, arc, arrow, head
from physgen.render.scales import SWEEP, Scales, largest_round, scales
from physgen.report.plots.style import (
    DPI,
    FORCE,
    HALO,
    IMPULSE,
    RED,
    SMALL,
    SPEED,
    TEXT,
    TORQUE,
    PlotStyle,
    Quantity,
    Units,
    halo,
    new_figure,
    plot_settings,
    units,
)
from physgen.scene.scene import Load, Motion, Overlay, Scene
from physgen.simulate.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Array = NDArray[np.float64]

SHAFT, RIM = 1.15, 0.7
"""Points: the width of a shaft, and of the white around it."""
SHORT = 2.0
"""Points: shorter arrows are not drawn."""
SAMPLE = 0.11
"""Of the picture's longer side: how long an arrow of the key is at most."""


@dataclass(frozen=True)
class Arrow:
    """One, px of the photo."""

    tail: Array
    """(2,)."""
    way: Array
    """(2,): from its tail to its point; of a torque, (sweep in rad, radius)."""
    load: Load | None
    """None: a velocity."""


@dataclass(frozen=True)
class Arrows:
    """All of one picture, and the lengths they are drawn with."""

    found: tuple[Arrow, ...]
    scales: Scales


def arrows(world: World, trajectory: Trajectory) -> Arrows:
    """Of what moves, and of what is pushed, at t = 0."""
    now = tuple(push for push in world.pushes if push.start <= 1e-9)
    moving = [body for body in world.bodies if body.motion is not Motion.STATIC]
    # velocities of the scene: the effect of an impulse is shown by the impulse's arrow
    speeds = np.array([_velocity(body, trajectory) for body in moving]).reshape(1, -1, 2)
    start = replace(
        trajectory,
        poses=np.array([[*body.center, 0.0] for body in moving]).reshape(1, -1, 3),
        velocities=np.concatenate([speeds, np.zeros((1, len(moving), 1))], axis=2),
    )
    size = scales(replace(world, pushes=now), start, (Overlay.VELOCITY, Overlay.FORCES), ())
    found = [
        Arrow(body.center, size.velocity * speed, None)
        for body, speed in zip(moving, speeds[0], strict=True)
        if speed.any()
    ]
    per = {Load.FORCE: size.force, Load.IMPULSE: size.impulse}
    for push in now:
        body = world.bodies[push.body]
        if body.motion is not Motion.DYNAMIC:
            continue
        if push.load is Load.TORQUE:
            way = np.array([size.torque * push.torque, min(1.25 * body.reach, 0.2 * max(world.size))])
            found.append(Arrow(body.center, way, push.load))
        else:
            found.append(Arrow(body.center + push.at, per[push.load] * push.vector, push.load))
    return Arrows(tuple(found), size)


def _velocity(body: Body, trajectory: Trajectory) -> Array:
    """(2,) px/s: that of a script, or the scene's own."""
    if body.motion is Motion.SCRIPTED and len(trajectory.times):
        return np.asarray(trajectory.velocities[0, trajectory.names.index(body.name), :2])
    return body.velocity


def draw_arrows(axes: Axes, of: Arrows, lens: Array, point: float, photo: float) -> None:
    """On axes whose units are px of a frame; `lens` (2, 3) takes the photo's px there, `point` px are a point.

    `photo` px of the frame are a px of the photo seen whole: the measure of arrows.
    """
    for one in of.found:
        tail = lens[:, :2] @ one.tail + lens[:, 2]
        if one.load is Load.TORQUE:
            sweep, radius = one.way.tolist()
            if abs(sweep) * radius * photo > SHORT * point:
                _curved(axes, arc(tail, radius * photo, sweep), point)
        elif np.hypot(*one.way) * photo > SHORT * point:
            tip = tail + one.way * photo
            _patch(axes, arrow(tail, tip, SHAFT * point), one.load is not None, point)


def arrow_key(of: Arrows, units: Units, side: float) -> list[tuple[float, bool, str]]:
    """For each kind there: px of the photo of a sample, whether it is hollow, and what it stands for."""
    there = {one.load for one in of.found}
    rows: Sequence[tuple[Load | None, str, float, Quantity, float]] = (
        (None, "velocity", of.scales.velocity, SPEED, SAMPLE * side),
        (Load.FORCE, "force", of.scales.force, FORCE, SAMPLE * side),
        (Load.IMPULSE, "impulse", of.scales.impulse, IMPULSE, SAMPLE * side),
        (Load.TORQUE, "torque", of.scales.torque, TORQUE, SWEEP),
    )
    entries = []
    for load, name, size, quantity, most in rows:
        if load not in there or size <= 0:
            continue
        per = 1.0 if units.meter is None else quantity.per(units.meter)
        value = largest_round(most / (size * per)) * per
        length = value * size if load is not Load.TORQUE else 0.0
        entries.append((length, load is not None, f"{name} {units.text(quantity, value)}"))
    return entries


def draw_key_arrow(axes: Axes, at: tuple[float, float], length: float, hollow: bool, point: float) -> None:
    """An arrow of the key, on axes in px of a frame."""
    tail = np.array(at)
    _patch(axes, arrow(tail, tail + np.array([length, 0.0]), SHAFT * point), hollow, point)


def _patch(axes: Axes, outline: Array, hollow: bool, point: float) -> None:
    from matplotlib.patches import Polygon

    fill, edge = (HALO, RED) if hollow else (RED, "none")
    thin = 0.9 if hollow else 0.0
    axes.add_patch(
        Polygon(outline, closed=True, facecolor=fill, edgecolor=edge, linewidth=thin, joinstyle="miter",
                path_effects=halo(thin + 2 * RIM, HALO), zorder=5)
    )  # fmt: skip


def _curved(axes: Axes, path: Array, point: float) -> None:
    """A torque's: hollow, too, since it pushes."""
    length = HEAD * SHAFT * point
    left = np.cumsum(np.hypot(*np.diff(path, axis=0).T)[::-1])[::-1]
    root = int(np.flatnonzero(left >= min(0.8 * length, 0.6 * left[0]))[-1])
    axes.plot(
        *path[: root + 1].T, color=RED, linewidth=SHAFT, path_effects=halo(SHAFT + 2 * RIM, HALO), zorder=5
    )
    _patch(axes, head(path[-1], path[-1] - path[root], min(length, 0.62 * float(left[0]))), True, point)


U8 = NDArray[np.uint8]

WIDTH = 174.0
"""mm."""
GAP, CAPTION, KEY, NAME = 3.0, 11.0, 13.0, 12.0
"""Points: between pictures, of the line of times, of arrows' lengths, and of the scene's name at the left."""
AIR = 4.0
"""Points, between scenes."""


@dataclass(frozen=True)
class StripRow:
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
class StripLayout:
    """Positions and sizes in whole px at `dpi`."""

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

    def tall(self, reel: StripRow) -> int:
        """Height of a scene's pictures."""
        height, width = reel.photo.shape[:2]
        px: float = self.cell * height / width
        return max(1, round(px))


def strip_layout(
    reels: Sequence[StripRow], look: PlotStyle, columns: int | None, names: bool, exact: bool
) -> StripLayout:
    """`exact`: without a requested width, frames keep their pixels, at least those of the smallest."""
    count = min(columns or 10**6, max(len(reel.pictures) for reel in reels))
    inches, own = look.inches(WIDTH), min(reel.photo.shape[1] for reel in reels)
    pads = ((count - 1) * GAP + (NAME if names else 0.0)) / 72
    if exact and look.dpi is None and look.pixels is None:
        dpi = count * own / max(inches - pads, 0.2 * inches)
        gap, left = round(GAP * dpi / 72), round(NAME * dpi / 72) if names else 0
        return StripLayout(dpi, count, own, gap, left, left + count * own + (count - 1) * gap)
    dpi = look.dpi or (look.pixels / inches if look.pixels else DPI)
    gap, left = round(GAP * dpi / 72), round(NAME * dpi / 72) if names else 0
    width = look.pixels or round(inches * dpi)
    cell = max(1, (width - left - (count - 1) * gap) // count)
    return StripLayout(dpi, count, cell, gap, left, width)


def strip_figure(
    reels: Sequence[StripRow],
    look: PlotStyle,
    *,
    columns: int | None = None,
    names: bool = False,
    exact: bool = True,
) -> Figure:
    """`columns` pictures side by side, all of a scene's unless given; `exact` for a PNG, whose pixels count."""
    plan = strip_layout(reels, look, columns, names, exact)
    shared = len({tuple(caption for caption, _ in reel.pictures) for reel in reels}) == 1
    found = [arrows(reel.world, reel.trajectory) for reel in reels]
    with plot_settings(look):
        rows = [
            _row(reel, of, plan, k == 0 or not shared)
            for k, (reel, of) in enumerate(zip(reels, found, strict=True))
        ]
        total = sum(rows) + (len(rows) - 1) * plan.points(AIR)
        # a hair more, so that the canvas is not a pixel less for rounding
        figure = new_figure(look, (plan.width + 1e-4) / plan.dpi, (total + 1e-4) / plan.dpi, plan.dpi)
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


def _row(reel: StripRow, of: Arrows, plan: StripLayout, timed: bool) -> int:
    """px: the height of a scene's row."""
    lines = ceil(len(reel.pictures) / plan.columns)
    captions = lines if lines > 1 else int(timed)
    below = plan.points(KEY) if of.found else 0
    return lines * plan.tall(reel) + captions * plan.points(CAPTION) + (lines - 1) * plan.gap + below


def _place(
    figure: Figure,
    reel: StripRow,
    of: Arrows,
    plan: StripLayout,
    at: tuple[int, int],
    timed: bool,
    look: PlotStyle,
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
            draw_arrows(axes, of, lens, plan.dpi / 72 * width / plan.cell, photo)
    if of.found:
        _key(figure, of, units(reel.scene, look), plan, (y + tall, total), reel)


def _key(
    figure: Figure, of: Arrows, units_of: Units, plan: StripLayout, at: tuple[int, int], reel: StripRow
) -> None:
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
    for length, hollow, text in arrow_key(of, units_of, float(max(reel.world.size))):
        if length:
            draw_key_arrow(axes, (x, 0.55 * high), length * photo, hollow, point)
            x += length * photo + 3 * point
        words = axes.text(x, 0.55 * high, text, ha="left", va="center_baseline", fontsize=SMALL)
        x += words.get_window_extent().width / figure.dpi * 72 * point + 10 * point


def _sized(rgb: U8, size: tuple[int, int]) -> U8:
    """(h, w, 3) of `size` (w, h), in linear light; the very same where that is its own."""
    if (rgb.shape[1], rgb.shape[0]) == size:
        return rgb
    how = cv2.INTER_AREA if size[0] < rgb.shape[1] else cv2.INTER_CUBIC
    return encode_u8(np.clip(cv2.resize(decode(rgb), size, interpolation=how), 0, 1))
