"""Figure of kinetic, potential and dissipated energy over time, stacked.

If energy were lost or created, the top of the stack would leave the line of the initial energy plus the work done.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.report.plots.style import ENERGY, SMALL, PlotStyle, add_axes, new_figure, plot_settings, units
from physgen.scene.scene import Scene
from physgen.simulate.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

WIDTH, HEIGHT = 120.0, 2.8
"""mm, and inches."""
LEFT, RIGHT, ALONE, BELOW, ABOVE, TICKS = 0.75, 0.46, 0.12, 0.56, 0.45, 0.12
"""Inches: margins, the right one with a second axis and without, and the height of ticks."""
VISIBLE = 1e-3
"""Of all energy: smaller layers and work are not drawn."""


def energy_figure(scene: Scene, world: World, trajectory: Trajectory, look: PlotStyle) -> Figure:
    """`trajectory` has many samples, at ends of engine steps."""
    width = look.inches(WIDTH)
    end = float(trajectory.times[-1]) if len(trajectory.times) > 1 else 1.0
    with plot_settings(look):
        figure = new_figure(look, width, HEIGHT)
        room = width - LEFT - (RIGHT if units(scene, look).beside else ALONE)
        axes = add_axes(figure, LEFT, BELOW, room, HEIGHT - BELOW - ABOVE)
        below = add_axes(figure, LEFT, BELOW - TICKS - 0.06, room, TICKS)
        rows = _stack(axes, scene, world, trajectory, look)
        _contact_ticks(below, trajectory, look)
        for one in (axes, below):
            one.set_xlim(0, end)
        for row, handles in enumerate(rows):
            at = (LEFT - 0.03) / width, 1 - (0.06 + 0.15 * row) / HEIGHT
            figure.legend(
                handles=handles, loc="upper left", bbox_to_anchor=at, ncols=3, borderaxespad=0, borderpad=0
            )
        return figure


def stacked(trajectory: Trajectory) -> tuple[Array, Array]:
    """(3, T) kinetic, potential (from its minimum) and dissipated energy, and (T,) the expected sum of them.

    That is the initial energy plus the work since; an impulse at t = 0 is in the first sample, with its work.
    """
    e = trajectory.energy
    layers = np.stack([e.kinetic, e.potential - e.potential.min(), e.dissipated])
    return layers, layers[:, 0].sum() + e.work - e.work[0]


def _stack(
    axes: Axes, scene: Scene, world: World, trajectory: Trajectory, look: PlotStyle
) -> tuple[list[Any], list[Any]]:
    """Handles of the legend: layers, and lines."""
    colours, t = look.palette, trajectory.times
    layers, expected = stacked(trajectory)
    most = float(expected.max(initial=0.0)) or 1.0
    axis = units(scene, look).axis(ENERGY, most)
    borders = np.cumsum(layers, axis=0) / axis.size
    lower, filled, lines = np.zeros_like(t), list[Any](), list[Any]()
    names = {"kinetic": colours.blue, "potential": colours.green, "dissipated": colours.orange}
    for (name, colour), layer, upper in zip(names.items(), layers, borders, strict=True):
        if layer.max(initial=0.0) > VISIBLE * most:
            shade = axes.fill_between(t, lower, upper, color=colour, alpha=0.35, linewidth=0, label=name)
            filled.append(shade)
            axes.plot(t, upper, color=colour, linewidth=0.7, gid=name)
        lower = upper
    work = trajectory.energy.work / axis.size
    worked = bool(np.abs(work).max(initial=0.0) > VISIBLE * most / axis.size)
    if worked:
        lines += axes.plot(
            t,
            expected / axis.size,
            color=colours.purple,
            linewidth=1.6,
            dashes=(3, 2),
            zorder=4,
            label="initial energy + work done",
            gid="work",
        )
    # as on the report page: relative to the energy that flows, at least that of a fall by a pixel
    weight = sum(body.mass for body in world.bodies) * float(np.hypot(*world.gravity))
    name = "sum − work" if worked else "sum"
    label = f"{name}, constant within {_percent(trajectory.imbalance(weight))}"
    lines += axes.plot(t, borders[-1] - work, color=colours.ink, linewidth=1.3, label=label, gid="sum")
    axes.set_ylim(0, 1.06 * most / axis.size)
    axes.tick_params(labelbottom=False)
    axes.locator_params(axis="y", nbins=5)
    axis.name(axes, "energy")
    return filled, lines


def _contact_ticks(axes: Axes, trajectory: Trajectory, look: PlotStyle) -> None:
    """A tick at the beginning of each contact."""
    begins = trajectory.contacts.touch_times[:, 0]
    begins = begins[begins > 0]
    alpha = min(1.0, max(0.15, 40 / max(len(begins), 1)))
    axes.vlines(begins, 0, 1, color=look.palette.ink, linewidth=0.5, alpha=alpha)
    axes.set_ylim(0, 1)
    axes.set_yticks([0.5], ["contacts begin"], fontsize=SMALL)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel("time (s)")
    axes.locator_params(axis="x", nbins=8)


def _percent(part: float) -> str:
    """Of the energy that flows.

    >>> _percent(0.0), _percent(3e-6), _percent(0.0123)
    ('0.001 %', '0.001 %', '1.3 %')
    """
    percent = max(100 * part, 0.001)
    return f"{percent:.1g} %" if percent < 1 else f"{np.ceil(10 * percent) / 10:g} %"
