"""Figure of object paths over the photo, and of place, speed and angle over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, degrees
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.geometry.polygon import rotation
from physgen.render.scales import nearest_round
from physgen.report.plots.style import (
    LENGTH,
    SMALL,
    SPEED,
    Axis,
    PlotStyle,
    Units,
    add_axes,
    halo,
    new_figure,
    plot_settings,
    rgb_of,
    stroke,
    units,
)
from physgen.scene.scene import Scene
from physgen.simulate.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
U8 = NDArray[np.uint8]

WIDTH = 120.0
"""mm."""
CURVES = ("x", "y", "speed", "angle")
LEFT, RIGHT, ALONE, BELOW = 0.52, 0.46, 0.08, 0.4
"""Inches: margins, the right one with a second axis and without."""
PANEL, LINE, ENTRY = 1.3, 0.135, 0.95
"""Inches: height of a curve's panel and of a line of the legend, and width of one of its entries."""
TALLEST = 1.3
"""Height of the map by its width, at most."""
FAINT = 0.38
"""Share of the photo under the paths."""
MOVES = 2.0
"""px: an object that moves less has no path."""
COLOURED = 7
"""Paths with colours of their own where none are chosen: the longest. The others are grey."""
MARKS = 8
"""Roughly, marks of time on a path."""


@dataclass(frozen=True)
class Strokes:
    """Objects by the way they are drawn."""

    coloured: list[int]
    grey: list[int]

    @classmethod
    def of(cls, world: World, trajectory: Trajectory, objects: Sequence[str]) -> Strokes:
        """`objects` by name; else all that move, the longest paths in colours."""
        if objects:
            return cls([trajectory.names.index(name) for name in objects], [])
        if not len(trajectory.times):
            return cls([], [])
        x, y, angle = np.ptp(trajectory.poses, axis=0).T
        moved = np.hypot(x, y) + angle * [0.0 if body.radius else body.reach for body in world.bodies]
        moving = np.flatnonzero(moved > MOVES).tolist()
        steps = np.diff(trajectory.poses[..., :2], axis=0)
        length = np.hypot(steps[..., 0], steps[..., 1]).sum(axis=0)
        longest = sorted(moving, key=lambda body: -length[body])
        longest = longest if len(moving) <= COLOURED + 1 else longest[:COLOURED]
        return cls(sorted(longest), [body for body in moving if body not in longest])


def trajectory_figure(
    scene: Scene,
    world: World,
    trajectory: Trajectory,
    photo: U8 | None,
    look: PlotStyle,
    *,
    objects: Sequence[str] = (),
    curves: Sequence[str] = (),
) -> Figure:
    """`objects` by name; `curves` of CURVES; `photo` (H, W, 3) sRGB lies faintly below the paths."""
    strokes = Strokes.of(world, trajectory, objects)
    of, width = units(scene, look), look.inches(WIDTH)
    right = RIGHT if of.beside else ALONE
    above = RIGHT - 0.1 if of.beside else ALONE
    wide, tall = world.size
    room = width - LEFT - right
    high = min(room * tall / wide, TALLEST * room)
    rows, entries = ceil(len(curves) / 2), len(strokes.coloured) + bool(strokes.grey)
    columns = max(1, min(entries, int((width - LEFT) / ENTRY)))
    legend = LINE * ceil(entries / columns) + 0.1 if strokes.coloured else 0.0
    with plot_settings(look):
        total = above + high + BELOW + rows * PANEL + legend
        figure = new_figure(look, width, total)
        across = high * wide / tall
        axes = add_axes(figure, LEFT + (room - across) / 2, total - above - high, across, high)
        every = _map(axes, world, trajectory, photo, strokes, of, look)
        if strokes.coloured:
            handles, labels = axes.get_legend_handles_labels()
            figure.legend(
                [one for k in range(columns) for one in handles[k::columns]],  # read along lines, not columns
                [one for k in range(columns) for one in labels[k::columns]],
                loc="upper left",
                bbox_to_anchor=((LEFT - 0.03) / width, (rows * PANEL + legend) / total),
                ncols=columns,
                borderaxespad=0,
                borderpad=0,
            )
            corner = (width - right) / width, (rows * PANEL + legend + 0.1) / total
            figure.text(*corner, f"a dot every {every:g} s", ha="right", va="baseline", fontsize=SMALL)
        half = (width - 2 * (LEFT + right)) / 2 if len(curves) > 1 else room
        for k, curve in enumerate(curves):
            at = LEFT + (k % 2) * (half + LEFT + right), (rows - 1 - k // 2) * PANEL + BELOW
            panel = add_axes(figure, *at, half, PANEL - BELOW - 0.12)
            _curve(panel, curve, trajectory, strokes, of, look, float(max(world.size)))
        return figure


def _map(
    axes: Axes,
    world: World,
    trajectory: Trajectory,
    photo: U8 | None,
    strokes: Strokes,
    of: Units,
    look: PlotStyle,
) -> float:
    """Paths, and the final outlines; returns the time between two marks, s."""
    colours, (wide, tall) = look.palette, world.size
    axis = of.axis(LENGTH, float(max(world.size)))
    unit = axis.size
    if photo is not None:
        paper = np.array(rgb_of(colours.paper), np.float32)
        axes.imshow(
            np.rint(paper + FAINT * (photo - paper)).astype(np.uint8),
            extent=(-0.5 / unit, (wide - 0.5) / unit, (tall - 0.5) / unit, -0.5 / unit),
            interpolation="none" if wide > 600 else "auto",
            zorder=0,
        )
    for wall in world.walls:
        for chain in wall.chains:
            axes.plot(*(chain / unit).T, color=colours.soft, linewidth=0.8, zorder=1)
    duration = float(trajectory.times[-1]) if len(trajectory.times) else 0.0
    every = nearest_round(duration / MARKS) if duration > 0 else 1.0
    marks = np.arange(0, duration + 1e-9, every)
    rim = halo(2.2, colours.paper, 0.75)
    for k, body in enumerate(strokes.coloured):
        colour, dashes = stroke(k, colours)
        path, name = trajectory.poses[:, body, :2] / unit, trajectory.names[body]
        axes.plot(
            *path.T,
            color=colour,
            linestyle=dashes,
            label=name,
            path_effects=rim,
            zorder=3,
            gid=f"path-{name}",
        )
        at = np.stack([np.interp(marks, trajectory.times, column) for column in path.T])
        axes.scatter(at[0], at[1], s=6, color=colour, edgecolors=colours.paper, linewidths=0.35, zorder=4)
        _outline(
            axes, world, trajectory, body, unit, color=colour, linewidth=0.6, path_effects=rim, zorder=2.7
        )
    thin: dict[str, Any] = {"color": colours.soft, "alpha": 0.7}
    for n, body in enumerate(strokes.grey):
        path, name = trajectory.poses[:, body, :2] / unit, trajectory.names[body]
        label = f"{len(strokes.grey)} others" if n == 0 else None
        axes.plot(*path.T, linewidth=0.5, label=label, zorder=2.5, gid=f"path-{name}", **thin)
        _outline(axes, world, trajectory, body, unit, linewidth=0.4, zorder=2, **thin)
    axes.set_xlim(-0.5 / unit, (wide - 0.5) / unit)
    axes.set_ylim((tall - 0.5) / unit, -0.5 / unit)
    axes.set_aspect("equal")
    axes.locator_params(nbins=6)
    for side in ("top", "right"):
        axes.spines[side].set_visible(True)
    axis.name(axes, "x", "x")
    axis.name(axes, "y")
    return every


def _outline(axes: Axes, world: World, trajectory: Trajectory, body: int, unit: float, **how: Any) -> None:
    """At the end of the motion."""
    x, y, angle = trajectory.poses[-1, body]
    for ring in world.bodies[body].rings:
        closed = np.concatenate([ring, ring[:1]]) @ rotation(float(angle)).T + (x, y)
        axes.plot(*(closed / unit).T, **how)


def _curve(
    axes: Axes, curve: str, trajectory: Trajectory, strokes: Strokes, of: Units, look: PlotStyle, size: float
) -> None:
    poses, velocities = trajectory.poses, trajectory.velocities
    if curve == "speed":
        values = np.hypot(velocities[..., 0], velocities[..., 1])
        axis = of.axis(SPEED, float(values.max(initial=0.0)))
    elif curve == "angle":
        values, axis = poses[..., 2] - poses[:1, :, 2], Axis("°", 1 / degrees(1), None)
    else:
        values, axis = poses[..., CURVES.index(curve)], of.axis(LENGTH, size)
    lines = [(body, look.palette.soft, "-", 0.45) for body in strokes.grey]
    lines += [(body, *stroke(k, look.palette), 0.9) for k, body in enumerate(strokes.coloured)]
    for body, colour, dashes, width in lines:
        axes.plot(
            trajectory.times,
            values[:, body] / axis.size,
            color=colour,
            linestyle=dashes,
            linewidth=width,
            gid=f"{curve}-{trajectory.names[body]}",
        )
    if curve == "y":
        axes.invert_yaxis()  # as in the photo, +y is down
    axes.locator_params(axis="y", nbins=4)
    axes.locator_params(axis="x", nbins=5)
    axes.set_xlim(0, float(trajectory.times[-1]) or 1.0)
    axes.set_xlabel("time (s)")
    axis.name(axes, curve)
