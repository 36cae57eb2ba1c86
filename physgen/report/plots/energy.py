"""Figure of kinetic, potential and dissipated energy over time."""

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

WIDTH, TALL = 120.0, 2.8
"""mm, and inches."""
LEFT, RIGHT, ALONE, BELOW, ABOVE, TICKS = 0.75, 0.46, 0.12, 0.56, 0.45, 0.12
"""Inches: margins, that at the right with an axis and without, and the height of ticks."""
WORKED = 1e-3
"""Of all energy: below it, no work was done."""


def energy_figure(scene: Scene, world: World, trajectory: Trajectory, look: PlotStyle) -> Figure:
    """`trajectory` has samples close enough to show what happens between frames, at ends of steps."""
    width = look.inches(WIDTH)
    with plot_settings(look):
        figure = new_figure(look, width, TALL)
        right = RIGHT if units(scene, look).beside else ALONE
        room = width - LEFT - right
        axes = add_axes(figure, LEFT, BELOW, room, TALL - BELOW - ABOVE)
        below = add_axes(figure, LEFT, BELOW - TICKS - 0.06, room, TICKS)
        layers, lines = _stack(axes, scene, world, trajectory, look)
        _touches(below, trajectory, look)
        for row, handles in enumerate((layers, lines)):
            at = (LEFT - 0.03) / width, 1 - (0.06 + 0.15 * row) / TALL
            figure.legend(
                handles=handles, loc="upper left", bbox_to_anchor=at, ncols=3, borderaxespad=0, borderpad=0
            )
        return figure


def stacked(trajectory: Trajectory) -> tuple[Array, Array]:
    """(3, T) kinetic, potential and dissipated energy, none below 0, and (T,) what should be on top of them.

    Potential energy is counted from its least. What should be on top is what there was at first, and the work since.
    """
    e = trajectory.energy
    layers = np.stack([e.kinetic, e.potential - e.potential.min(), e.dissipated])
    return layers, layers[:, 0].sum() + e.work - e.work[
        0
    ]  # an impulse at t = 0 is in the first sample, and its work


def _stack(
    axes: Axes, scene: Scene, world: World, trajectory: Trajectory, look: PlotStyle
) -> tuple[list[Any], list[Any]]:
    """Draws; returns what the legend tells of, layers and lines."""
    colours, t = look.palette, trajectory.times
    layers, top = stacked(trajectory)
    axis = units(scene, look).axis(ENERGY, float(top.max(initial=0.0)) or 1.0)
    borders = np.cumsum(layers, axis=0) / axis.size
    lower, filled, lines = np.zeros_like(t), list[Any](), list[Any]()
    names = ("kinetic", "potential", "dissipated")
    shades = (colours.blue, colours.green, colours.orange)
    for name, colour, part, upper in zip(names, shades, layers, borders, strict=True):
        if part.max(initial=0.0) > WORKED * top.max(initial=0.0):
            filled.append(
                axes.fill_between(t, lower, upper, color=colour, alpha=0.35, linewidth=0, label=name)
            )
            axes.plot(t, upper, color=colour, linewidth=0.7, gid=name)
        lower = upper
    total, most = borders[-1], float(top.max(initial=0.0)) / axis.size or 1.0
    work = trajectory.energy.work / axis.size
    worked = bool(np.abs(work).max(initial=0.0) > WORKED * most)
    if worked:
        lines += axes.plot(
            t,
            top / axis.size,
            color=colours.purple,
            linewidth=1.6,
            dashes=(3, 2),
            zorder=4,
            label="what there was + work done",
            gid="work",
        )
    # as the report has it: against what flows, a fall by a pixel at least
    weight = sum(body.mass for body in world.bodies) * float(np.hypot(*world.gravity))
    name = "sum − work" if worked else "sum"
    strays = f"{name}, constant within {_percent(trajectory.imbalance(weight))}"
    lines += axes.plot(t, total - work, color=colours.ink, linewidth=1.3, label=strays, gid="sum")
    axes.set_ylim(0, 1.06 * most)
    axes.tick_params(labelbottom=False)
    axes.locator_params(axis="y", nbins=5)
    axis.name(axes, "energy")
    axes.set_xlim(0, _end(trajectory))
    return filled, lines


def _touches(axes: Axes, trajectory: Trajectory, look: PlotStyle) -> None:
    """A tick for each time that something begins to touch."""
    begins = trajectory.contacts.touch_times[:, 0]
    begins = begins[begins > 0]
    strength = min(1.0, max(0.15, 40 / max(len(begins), 1)))
    axes.vlines(begins, 0, 1, color=look.palette.ink, linewidth=0.5, alpha=strength)
    axes.set_ylim(0, 1)
    axes.set_yticks([0.5], ["contacts begin"], fontsize=SMALL)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_xlim(0, _end(trajectory))
    axes.set_xlabel("time (s)")
    axes.locator_params(axis="x", nbins=8)


def _end(trajectory: Trajectory) -> float:
    return float(trajectory.times[-1]) if len(trajectory.times) > 1 else 1.0


def _percent(part: float) -> str:
    """Of the energy that flows.

    >>> _percent(0.0), _percent(3e-6), _percent(0.0123)
    ('0.001 %', '0.001 %', '1.3 %')
    """
    percent = max(100 * part, 0.001)
    text: Any = f"{percent:.1g}" if percent < 1 else f"{np.ceil(10 * percent) / 10:g}"
    return f"{text} %"
