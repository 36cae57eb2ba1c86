"""World and trajectory -> figures for papers, by matplotlib: energy, paths, and strips of frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.geometry.polygon import rotation
from physgen.render.drawing import arrow
from physgen.render.scales import nearest_round
from physgen.report.parameters import arrows
from physgen.report.plot_style import (
    DPI,
    ENERGY,
    LENGTH,
    MM,
    PALETTE,
    RED,
    SMALL,
    Unit,
    halo,
    named_area,
    new_figure,
    plot_settings,
    stroke,
    unit,
)
from physgen.scene.scene import Scene
from physgen.simulate.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
U8 = NDArray[np.uint8]


@dataclass(frozen=True)
class CurveStyle:
    """Sizes and limits of the figures."""

    width: float = 120.0
    """mm."""
    height: float = 2.8
    """Inches: of the chart of energy."""
    visible: float = 1e-3
    """Of all energy: smaller layers and work are not drawn."""
    faint: float = 0.38
    """Share of the photo under the paths."""
    moves: float = 2.0
    """px: an object that moves less has no path."""
    coloured: int = 7
    """Paths with colours of their own where none are chosen: the longest. The others are grey."""
    marks: int = 8
    """Roughly, marks of time on a path."""


STYLE = CurveStyle()


def energy_figure(scene: Scene, world: World, trajectory: Trajectory, width: float | None = None) -> Figure:
    """Kinetic, potential and dissipated energy over time, stacked; `width` in mm.

    If energy were lost or created, the top of the stack would leave the line of the initial energy plus the work done.
    `trajectory` has many samples, at ends of engine steps.
    """
    with plot_settings():
        figure = new_figure((width or STYLE.width) / MM, STYLE.height, dpi=DPI, layout="constrained")
        axes, below = figure.subplots(2, 1, sharex=True, height_ratios=(14, 1))
        _stack(named_area(axes), unit(scene, ENERGY), world, trajectory)
        begins = trajectory.contacts.touch_times[:, 0]
        begins = begins[begins > 0]
        alpha = min(1.0, max(0.15, 40 / max(len(begins), 1)))
        below.vlines(begins, 0, 1, color=PALETTE.ink, linewidth=0.5, alpha=alpha)
        below.set(ylim=(0, 1), xlabel="time (s)")
        below.set_yticks([0.5], ["contacts begin"], fontsize=SMALL)
        below.tick_params(axis="y", length=0)
        below.spines["left"].set_visible(False)
        below.set_xlim(0, float(trajectory.times[-1]) if len(trajectory.times) > 1 else 1.0)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=3)
        figure.draw_without_rendering()
        return figure


def stacked(trajectory: Trajectory) -> tuple[Array, Array]:
    """(3, T) kinetic, potential (from its minimum) and dissipated energy, and (T,) the expected sum of them.

    That is the initial energy plus the work since; an impulse at t = 0 is in the first sample, with its work.
    """
    e = trajectory.energy
    layers = np.stack([e.kinetic, e.potential - e.potential.min(), e.dissipated])
    return layers, layers[:, 0].sum() + e.work - e.work[0]


def _stack(axes: Axes, shown: Unit, world: World, trajectory: Trajectory) -> None:
    times = trajectory.times
    layers, expected = (values / shown.size for values in stacked(trajectory))
    most = float(expected.max(initial=0.0)) or 1.0
    borders = np.cumsum(layers, axis=0)
    lower = np.zeros_like(times)
    names = {"kinetic": PALETTE.blue, "potential": PALETTE.green, "dissipated": PALETTE.orange}
    for (name, colour), layer, upper in zip(names.items(), layers, borders, strict=True):
        if layer.max(initial=0.0) > STYLE.visible * most:
            axes.fill_between(times, lower, upper, color=colour, alpha=0.35, linewidth=0, label=name)
            axes.plot(times, upper, color=colour, linewidth=0.7, gid=name)
        lower = upper
    work = trajectory.energy.work / shown.size
    worked = bool(np.abs(work).max(initial=0.0) > STYLE.visible * most)
    if worked:
        label = "initial energy + work done"
        axes.plot(times, expected, color=PALETTE.purple, linewidth=1.6, dashes=(3, 2), zorder=4, label=label)
    # as on the report page: relative to the energy that flows, at least that of a fall by a pixel
    weight = sum(body.mass for body in world.bodies) * float(np.hypot(*world.gravity))
    percent = max(100 * trajectory.imbalance(weight), 0.001)
    label = f"{'sum − work' if worked else 'sum'}, constant within {percent:.1g} %"
    axes.plot(times, borders[-1] - work, color=PALETTE.ink, linewidth=1.3, label=label, gid="sum")
    axes.set_ylim(0, 1.06 * most)
    axes.tick_params(labelbottom=False)
    axes.locator_params(axis="y", nbins=5)
    shown.label(axes.yaxis, "energy")


def trajectory_figure(
    scene: Scene,
    world: World,
    trajectory: Trajectory,
    photo: U8 | None,
    objects: Sequence[str] = (),
    width: float | None = None,
) -> Figure:
    """Paths of objects, named ones or all; `photo` (H, W, 3) sRGB lies faintly below them; `width` in mm."""
    lines = _lines(world, trajectory, objects)
    across = (width or STYLE.width) / MM
    high = 0.85 * across * min(world.size[1] / world.size[0], 1.4)
    with plot_settings():
        figure = new_figure(across, high + 0.5, dpi=DPI, layout="constrained")
        axes = named_area(figure.subplots())
        every = _map(axes, unit(scene, LENGTH), world, trajectory, photo, lines)
        if lines:
            handles, labels = axes.get_legend_handles_labels()
            title = f"a dot every {every:g} s"
            figure.legend(
                handles, labels, loc="outside lower center", ncols=4, title=title, title_fontsize=SMALL
            )
        figure.draw_without_rendering()
        return figure


Lines = Sequence[tuple[int, dict[str, Any]]]
"""Objects that have a path, and how their lines are drawn."""


def _lines(world: World, trajectory: Trajectory, objects: Sequence[str]) -> Lines:
    """`objects` by name; else all that move, the longest paths in colours."""
    if not len(trajectory.times):
        return []
    x, y, angle = np.ptp(trajectory.poses, axis=0).T
    moved = np.hypot(x, y) + angle * [0.0 if body.radius else body.reach for body in world.bodies]
    moving = np.flatnonzero(moved > STYLE.moves).tolist()
    steps = np.diff(trajectory.poses[..., :2], axis=0)
    length = np.hypot(steps[..., 0], steps[..., 1]).sum(axis=0)
    if objects:
        moving = coloured = [trajectory.names.index(name) for name in objects]
    else:
        longest = sorted(moving, key=lambda body: -length[body])
        coloured = sorted(longest if len(moving) <= STYLE.coloured + 1 else longest[: STYLE.coloured])
    found: list[tuple[int, dict[str, Any]]] = []
    rim = halo(2.2)
    for body in moving:
        if body in coloured:
            colour, dashes = stroke(coloured.index(body))
            found.append((body, {"color": colour, "linestyle": dashes, "zorder": 3, "path_effects": rim}))
        else:
            found.append((body, {"color": PALETTE.soft, "linewidth": 0.5, "zorder": 2.5}))
    return found


def _map(
    axes: Axes, shown: Unit, world: World, trajectory: Trajectory, photo: U8 | None, lines: Lines
) -> float:
    """Paths, and the final outlines; returns the time between two marks, s."""
    size, (wide, tall) = shown.size, world.size
    extent = (-0.5 / size, (wide - 0.5) / size, (tall - 0.5) / size, -0.5 / size)
    if photo is not None:
        axes.imshow(photo, extent=extent, alpha=STYLE.faint, zorder=0)
    for wall in world.walls:
        for chain in wall.chains:
            axes.plot(*(chain / size).T, color=PALETTE.soft, linewidth=0.8, zorder=1)
    duration = float(trajectory.times[-1]) if len(trajectory.times) else 0.0
    every = nearest_round(duration / STYLE.marks) if duration > 0 else 1.0
    marks = np.arange(0, duration + 1e-9, every)
    for body, how in lines:
        path, name = trajectory.poses[:, body, :2] / size, trajectory.names[body]
        coloured = how["zorder"] == 3
        axes.plot(*path.T, label=name if coloured else None, gid=f"path-{name}", **how)
        x, y, angle = trajectory.poses[-1, body]
        for ring in world.bodies[body].rings:
            closed = np.concatenate([ring, ring[:1]]) @ rotation(float(angle)).T + (x, y)
            axes.plot(*(closed / size).T, color=how["color"], linewidth=0.6, zorder=2)
        if coloured:
            x, y = (np.interp(marks, trajectory.times, column) for column in path.T)
            axes.scatter(x, y, s=6, color=how["color"], edgecolors=PALETTE.paper, linewidths=0.35, zorder=4)
    axes.set(xlim=extent[:2], ylim=extent[2:], aspect="equal")
    axes.locator_params(nbins=6)
    shown.label(axes.xaxis, "x")
    shown.label(axes.yaxis, "y")
    return every


# ---- strips ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class StripLayout:
    """Sizes of a strip."""

    width: float = 174.0
    """mm."""
    gap: float = 3.0
    caption: float = 11.0
    """Points: between pictures, and of the line of times."""
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


def strip_figure(rows: Sequence[StripRow], width: float | None = None) -> Figure:
    """`width` in mm. Frames keep their pixels, those of larger ones are resampled to the width of the smallest.

    The figure's own dpi is such that a pixel of it is one of a frame.
    """
    cell = min(row.photo.shape[1] for row in rows)
    count = max(len(row.pictures) for row in rows)
    inches = (width or LAYOUT.width) / MM
    dpi = count * cell / max(inches - (count - 1) * LAYOUT.gap / 72, 0.2 * inches)
    gap, caption = (round(points * dpi / 72) for points in (LAYOUT.gap, LAYOUT.caption))
    tall = [max(1, round(cell * row.photo.shape[0] / row.photo.shape[1])) for row in rows]
    wide, high = count * (cell + gap) - gap, sum(tall) + len(rows) * caption
    with plot_settings():
        # a hair more, so that the canvas is not a pixel less for rounding
        figure = new_figure((wide + 1e-4) / dpi, (high + 1e-4) / dpi, dpi=dpi)
        top = 0
        for row, height in zip(rows, tall, strict=True):
            top += caption
            for k, (text, rgb) in enumerate(row.pictures):
                box = (k * (cell + gap) / wide, 1 - (top + height) / high, cell / wide, height / high)
                axes = figure.add_axes(box, frameon=False)
                axes.set_axis_off()
                axes.imshow(_sized(rgb, cell, height), aspect="auto", interpolation="none")
                axes.set_title(text, fontsize=SMALL, pad=2)
                if k == 0:
                    _draw_arrows(axes, row, cell / rgb.shape[1], LAYOUT.shaft * dpi / 72)
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
