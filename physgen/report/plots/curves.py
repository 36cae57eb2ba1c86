"""Figures of a motion over time: energy, contacts, and paths with curves below them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.geometry.polygon import rotation
from physgen.render.contacts import Impact
from physgen.render.scales import largest_round, nearest_round
from physgen.report.plots.style import (
    DPI,
    ENERGY,
    IMPULSE,
    LENGTH,
    MM,
    PALETTE,
    SMALL,
    SPEED,
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
Pair = tuple[int, int]
CURVES = ("x", "y", "speed", "angle")


@dataclass(frozen=True)
class CurveStyle:
    """Sizes and limits of the figures."""

    width: float = 120.0
    """mm."""
    height: float = 2.8
    """Inches: of the chart of energy."""
    visible: float = 1e-3
    """Of all energy: smaller layers and work are not drawn."""
    row: float = 0.145
    """Inches of a pair's row in the chart of contacts."""
    most_rows: int = 48
    """Pairs that have a row, those with the largest impulse."""
    largest: float = 90.0
    """Square points: the strongest impact's circle."""
    shortest: float = 0.004
    """Of the clip: bars of contacts are at least so long."""
    panel: float = 1.3
    """Inches: height of a curve's panel."""
    faint: float = 0.38
    """Share of the photo under the paths."""
    moves: float = 2.0
    """px: an object that moves less has no path."""
    coloured: int = 7
    """Paths with colours of their own where none are chosen: the longest. The others are grey."""
    marks: int = 8
    """Roughly, marks of time on a path."""


STYLE = CurveStyle()


def energy_figure(
    scene: Scene, world: World, trajectory: Trajectory, width: float | None = None, dpi: float = DPI
) -> Figure:
    """Kinetic, potential and dissipated energy over time, stacked; `width` in mm.

    If energy were lost or created, the top of the stack would leave the line of the initial energy plus the work done.
    `trajectory` has many samples, at ends of engine steps.
    """
    with plot_settings():
        figure = new_figure((width or STYLE.width) / MM, STYLE.height, dpi=dpi, layout="constrained")
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


def contacts_figure(
    scene: Scene,
    world: World,
    trajectory: Trajectory,
    impacts: Sequence[Impact],
    objects: Sequence[str] = (),
    width: float | None = None,
    dpi: float = DPI,
) -> Figure:
    """Contacts as bars over time, a row for each pair, with impacts as circles whose area is the impulse.

    `trajectory` and `impacts` as `render.contacts` finds them; `width` in mm.
    """
    surfaces = trajectory.contacts.surfaces
    end = float(trajectory.times[-1]) if len(trajectory.times) else 0.0
    rows = _rows(trajectory, impacts, end, {surfaces.index(name) for name in objects})
    shown = sorted((impact for impact in impacts if impact.pair in rows), key=lambda impact: -impact.impulse)
    strongest, order, end = (shown[0].impulse if shown else 0.0), list(rows), end or 1.0
    with plot_settings():
        height = 0.82 + STYLE.row * max(len(rows), 2)
        figure = new_figure((width or STYLE.width) / MM, height, dpi=dpi, layout="constrained")
        axes = named_area(figure.add_subplot())
        for k, (pair, times) in enumerate(rows.items()):
            wall = max(pair) >= len(world.bodies)
            axes.broken_barh(
                [(begin, max(stop - begin, STYLE.shortest * end)) for begin, stop in times],
                (k - 0.3, 0.6),
                color=PALETTE.soft if wall else PALETTE.blue,
                alpha=0.45,
                linewidth=0,
                gid="touch-" + "-".join(surfaces[surface] for surface in pair),
            )
        if strongest:
            shown_in = unit(scene, IMPULSE)
            value = largest_round(strongest / shown_in.size) * shown_in.size
            axes.scatter(
                [impact.time for impact in shown],
                [order.index(impact.pair) for impact in shown],
                s=[STYLE.largest * impact.impulse / strongest for impact in shown],
                color=PALETTE.orange,
                linewidths=0.5,
                edgecolors=PALETTE.paper,
                zorder=3,
                clip_on=False,
            )
            label = f"impact of {shown_in.text(value)}; blue: objects, grey: boundaries"
            size = STYLE.largest * value / strongest
            axes.scatter([], [], s=size, color=PALETTE.orange, linewidths=0, label=label)
            figure.legend(loc="outside upper left")
        labels = [" – ".join(surfaces[surface] for surface in pair) for pair in rows]
        axes.set_yticks(range(len(rows)), labels, fontsize=SMALL)
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        axes.hlines(np.arange(len(rows)), 0, end, color=PALETTE.faint, linewidth=0.4, zorder=0)
        axes.set(xlim=(0, end), ylim=(max(len(rows), 1) - 0.4, -0.6), xlabel="time (s)")
        figure.draw_without_rendering()
        return figure


def _rows(
    trajectory: Trajectory, impacts: Sequence[Impact], end: float, objects: set[int]
) -> dict[Pair, list[tuple[float, float]]]:
    """Begin and end, s, of the touches of the pairs with the largest impulses, in the order of the first touches."""
    contacts, found = trajectory.contacts, dict[Pair, list[tuple[float, float]]]()
    for (first, second), (begin, stop) in zip(
        contacts.touch_pairs.tolist(), contacts.touch_times.tolist(), strict=True
    ):
        if begin <= end and (not objects or objects & {first, second}):
            found.setdefault((first, second), []).append((begin, min(stop, end)))
    impulse = dict.fromkeys(found, 0.0)
    for impact in impacts:
        if impact.pair in impulse:
            impulse[impact.pair] += impact.impulse
    strongest = sorted(found, key=lambda pair: -impulse[pair])[: STYLE.most_rows]
    return {pair: found[pair] for pair in sorted(strongest, key=lambda pair: (found[pair][0][0], pair))}


def trajectory_figure(
    scene: Scene,
    world: World,
    trajectory: Trajectory,
    photo: U8 | None,
    *,
    objects: Sequence[str] = (),
    curves: Sequence[str] = (),
    size: tuple[float | None, float] = (None, DPI),
) -> Figure:
    """Paths of objects, and their place, speed or angle over time below.

    `objects` by name; `curves` of CURVES; `photo` (H, W, 3) sRGB lies faintly below the paths; `size`: the width in mm
    and px an inch.
    """
    lines = _lines(world, trajectory, objects)
    across = (size[0] or STYLE.width) / MM
    high = 0.85 * across * min(world.size[1] / world.size[0], 1.4)
    with plot_settings():
        rows = 1 + len(curves)
        total = high + STYLE.panel * len(curves) + 0.5
        figure = new_figure(across, total, dpi=size[1], layout="constrained")
        axes = figure.subplots(rows, 1, squeeze=False, height_ratios=[high, *[STYLE.panel] * len(curves)])
        every = _map(named_area(axes[0, 0]), unit(scene, LENGTH), world, trajectory, photo, lines)
        for panel, curve in zip(axes[1:, 0], curves, strict=True):
            _curve(panel, curve, scene, trajectory, lines)
        if lines:
            handles, labels = axes[0, 0].get_legend_handles_labels()
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


def _curve(axes: Axes, curve: str, scene: Scene, trajectory: Trajectory, lines: Lines) -> None:
    poses, velocities = trajectory.poses, trajectory.velocities
    if curve == "speed":
        values, shown = np.hypot(velocities[..., 0], velocities[..., 1]), unit(scene, SPEED)
    elif curve == "angle":
        values, shown = poses[..., 2] - poses[:1, :, 2], Unit("°", 1 / degrees(1), si=False)
    else:
        values, shown = poses[..., CURVES.index(curve)], unit(scene, LENGTH)
    for body, how in lines:
        name = f"{curve}-{trajectory.names[body]}"
        axes.plot(trajectory.times, values[:, body] / shown.size, gid=name, **how)
    if curve == "y":
        axes.invert_yaxis()  # as in the photo, +y is down
    axes.locator_params(axis="y", nbins=4)
    axes.set(
        xlim=(0, (float(trajectory.times[-1]) if len(trajectory.times) else 0.0) or 1.0), xlabel="time (s)"
    )
    shown.label(axes.yaxis, curve)
