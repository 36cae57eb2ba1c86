"""Figure of object paths over the photo, and of place, speed and angle over time."""

from __future__ import annotations

from collections.abc import Sequence
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
    new_figure,
    plot_settings,
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
"""Inches: margins, that at the right with an axis and without."""
PANEL, LINE, ENTRY = 1.3, 0.135, 0.95
"""Inches: height of a curve's panel, of a line of the legend, and the width of one of its entries."""
MOST_TALL = 1.3
"""Of the room's width: how tall the map is at most."""
FAINT = 0.38
"""Of the photo, that is left under the paths."""
MOVES = 2.0
"""px: what moves less is no path."""
LOUD = 7
"""Paths in colours of their own where nobody has chosen: those that go farthest. The others stand back."""
MARKS = 8
"""About so many marks of time on a path."""


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
    """`objects` by name, else those that move; `curves` of CURVES; `photo` (H, W, 3) sRGB lies faintly below."""
    shown = chosen_objects(world, trajectory, objects)
    back = [] if objects else background_objects(trajectory, shown)
    shown = [body for body in shown if body not in back]
    of, width = units(scene, look), look.inches(WIDTH)
    right = RIGHT if of.beside else ALONE
    above = RIGHT - 0.1 if of.beside else ALONE
    wide, tall = world.size
    room = width - LEFT - right
    high = min(room * tall / wide, MOST_TALL * room)
    rows, entries = ceil(len(curves) / 2), len(shown) + bool(back)
    columns = max(1, min(entries, int((width - LEFT) / ENTRY)))
    legend = LINE * ceil(entries / columns) + 0.1 if shown else 0.0
    with plot_settings(look):
        total = above + high + BELOW + rows * PANEL + legend
        figure = new_figure(look, width, total)
        shrunk = high * wide / tall  # where a tall photo would take a page
        axes = add_axes(figure, LEFT + (room - shrunk) / 2, total - above - high, shrunk, high)
        every = _map(axes, world, trajectory, photo, shown, back, of, look)
        if shown:
            handles, labels = axes.get_legend_handles_labels()
            if back:  # those that stand back come last here, too
                handles, labels = handles[1:] + handles[:1], labels[1:] + labels[:1]
            figure.legend(
                _across(handles, columns),
                _across(labels, columns),
                loc="upper left",
                bbox_to_anchor=((LEFT - 0.03) / width, (rows * PANEL + legend) / total),
                ncols=columns,
                borderaxespad=0,
                borderpad=0,
            )
            beside = (width - right) / width, (rows * PANEL + legend + 0.1) / total
            figure.text(*beside, f"a dot every {every:g} s", ha="right", va="baseline", fontsize=SMALL)
        half = (width - 2 * (LEFT + right)) / 2 if len(curves) > 1 else room
        for k, curve in enumerate(curves):
            at = LEFT + (k % 2) * (half + LEFT + right), (rows - 1 - k // 2) * PANEL + BELOW
            panel = add_axes(figure, *at, half, PANEL - BELOW - 0.12)
            _curve(panel, curve, world, trajectory, shown, back, of, look)
        return figure


def _across(entries: Sequence[Any], columns: int) -> list[Any]:
    """For a legend that goes down its columns: the order in which it reads along lines."""
    return [entry for k in range(columns) for entry in entries[k::columns]]


def chosen_objects(world: World, trajectory: Trajectory, objects: Sequence[str]) -> list[int]:
    """Indices of objects, by name; else of all that move or turn. The caller has looked whether the names are there."""
    if objects:
        return [trajectory.names.index(name) for name in objects]
    if not len(trajectory.times):
        return []
    x, y, angle = np.ptp(trajectory.poses, axis=0).T
    way = np.hypot(x, y) + angle * [0.0 if body.radius else body.reach for body in world.bodies]
    return np.flatnonzero(way > MOVES).tolist()


def background_objects(trajectory: Trajectory, shown: Sequence[int]) -> list[int]:
    """Of those shown, all but the LOUD that go farthest; none where that leaves but one."""
    if len(shown) <= LOUD + 1:
        return []
    steps = np.diff(trajectory.poses[:, list(shown), :2], axis=0)
    way = np.hypot(steps[..., 0], steps[..., 1]).sum(axis=0)
    far = {shown[k] for k in np.argsort(-way, kind="stable")[:LOUD].tolist()}
    return [body for body in shown if body not in far]


def _map(
    axes: Axes,
    world: World,
    trajectory: Trajectory,
    photo: U8 | None,
    shown: Sequence[int],
    back: Sequence[int],
    of: Units,
    look: PlotStyle,
) -> float:
    """Paths, and the shapes at the end; returns how many s lie between two marks."""
    colours, (wide, tall) = look.palette, world.size
    axis = of.axis(LENGTH, float(max(world.size)))
    unit = axis.size
    if photo is not None:
        axes.imshow(
            _faded(photo, look),
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
    halo = _halo(look)
    for n, body in enumerate(back):
        path = trajectory.poses[:, body, :2] / unit
        label = f"{len(back)} others" if n == 0 else None
        axes.plot(
            *path.T,
            color=colours.soft,
            linewidth=0.5,
            alpha=0.7,
            label=label,
            zorder=2.5,
            gid=_named("path", trajectory, body),
        )
        _end(axes, world, trajectory, body, unit, color=colours.soft, linewidth=0.4, alpha=0.7, zorder=2)
    for k, body in enumerate(shown):
        colour, dashes = stroke(k, colours)
        path = trajectory.poses[:, body, :2] / unit
        axes.plot(
            *path.T,
            color=colour,
            linestyle=dashes,
            label=trajectory.names[body],
            path_effects=halo,
            zorder=3,
            gid=_named("path", trajectory, body),
        )
        at = np.stack([np.interp(marks, trajectory.times, column) for column in path.T])
        axes.scatter(at[0], at[1], s=6, color=colour, edgecolors=colours.paper, linewidths=0.35, zorder=4)
        _end(axes, world, trajectory, body, unit, color=colour, linewidth=0.6, path_effects=halo, zorder=2.7)
    axes.set_xlim(-0.5 / unit, (wide - 0.5) / unit)
    axes.set_ylim((tall - 0.5) / unit, -0.5 / unit)
    axes.set_aspect("equal")
    axes.locator_params(nbins=6)
    for side in ("top", "right"):
        axes.spines[side].set_visible(True)
    axis.name(axes, "x", "x")
    axis.name(axes, "y")
    return every


def _named(what: str, trajectory: Trajectory, body: int) -> str:
    return f"{what}-{trajectory.names[body]}"


def _end(axes: Axes, world: World, trajectory: Trajectory, body: int, unit: float, **how: Any) -> None:
    """Its shape where it ends."""
    x, y, angle = trajectory.poses[-1, body]
    for ring in world.bodies[body].rings:
        closed = np.concatenate([ring, ring[:1]]) @ rotation(float(angle)).T + (x, y)
        axes.plot(*(closed / unit).T, **how)


def _curve(
    axes: Axes,
    curve: str,
    world: World,
    trajectory: Trajectory,
    shown: Sequence[int],
    back: Sequence[int],
    of: Units,
    look: PlotStyle,
) -> None:
    values, axis, name = _values(curve, world, trajectory, of)
    strokes = [(body, look.palette.soft, "-", 0.45) for body in back]
    strokes += [(body, *stroke(k, look.palette), 0.9) for k, body in enumerate(shown)]
    for body, colour, dashes, width in strokes:
        axes.plot(
            trajectory.times,
            values[:, body] / axis.size,
            color=colour,
            linestyle=dashes,
            linewidth=width,
            gid=_named(curve, trajectory, body),
        )
    if curve == "y":
        axes.invert_yaxis()  # as in the photo, +y is down
    axes.locator_params(axis="y", nbins=4)
    axes.locator_params(axis="x", nbins=5)
    axes.set_xlim(0, float(trajectory.times[-1]) or 1.0)
    axes.set_xlabel("time (s)")
    axis.name(axes, name)


def _values(curve: str, world: World, trajectory: Trajectory, of: Units) -> tuple[Array, Axis, str]:
    """(T, N) of one of CURVES, its axis and its name."""
    poses, velocities = trajectory.poses, trajectory.velocities
    if curve == "speed":
        speed = np.hypot(velocities[..., 0], velocities[..., 1])
        return speed, of.axis(SPEED, float(speed.max(initial=0.0))), "speed"
    if curve == "angle":
        return poses[..., 2] - poses[:1, :, 2], Axis("°", 1 / degrees(1), None), "angle"
    place = poses[..., CURVES.index(curve)]
    return place, of.axis(LENGTH, float(max(world.size))), curve


def _faded(photo: U8, look: PlotStyle) -> U8:
    """(H, W, 3): towards the paper."""
    paper_rgb = np.array([int(look.palette.paper[k : k + 2], 16) for k in (1, 3, 5)], np.float32)
    return np.asarray(np.rint(paper_rgb + FAINT * (photo - paper_rgb)), np.uint8)


def _halo(look: PlotStyle) -> list[Any]:
    """A rim in the colour of the paper, so that paths stand out from the photo."""
    from matplotlib import patheffects

    return [
        patheffects.Stroke(linewidth=2.2, foreground=look.palette.paper, alpha=0.75),
        patheffects.Normal(),
    ]
