"""Figure of contacts as bars over time, with impacts as circles whose area is the impulse."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from physgen.compile.world import World
from physgen.render.contacts import Impact
from physgen.render.scales import largest_round
from physgen.report.plots.style import IMPULSE, SMALL, PlotStyle, new_figure, plot_settings, units
from physgen.scene.scene import Scene
from physgen.simulate.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH = 150.0
"""mm."""
ROW = 0.145
"""Inches of a pair's row."""
MOST_ROWS = 48
"""Pairs that have a row, those with the largest impulse."""
LARGEST = 90.0
"""Square points: the strongest impact's circle."""
SHORTEST = 0.004
"""Of the clip: bars are at least so long."""

Pair = tuple[int, int]


def contacts_figure(
    scene: Scene,
    world: World,
    trajectory: Trajectory,
    impacts: Sequence[Impact],
    look: PlotStyle,
    objects: Sequence[str] = (),
) -> Figure:
    """A row for each pair that touches; `trajectory` and `impacts` as `render.contacts` finds them."""
    surfaces, end = (
        trajectory.contacts.surfaces,
        float(trajectory.times[-1]) if len(trajectory.times) else 0.0,
    )
    rows = _rows(trajectory, impacts, end, {surfaces.index(name) for name in objects})
    shown = [impact for impact in impacts if impact.pair in rows]
    missing = len(_touches(trajectory, end)) - len(rows) if not objects else 0
    strongest = max((impact.impulse for impact in shown), default=0.0)
    colours, end = look.palette, end or 1.0
    with plot_settings(look):
        figure = new_figure(look, look.inches(WIDTH), 0.82 + ROW * max(len(rows), 2))
        figure.set_layout_engine("constrained", w_pad=0.05, h_pad=0.05)
        axes = figure.add_subplot()
        axes.patch.set_gid("area")
        for k, (pair, times) in enumerate(rows.items()):
            wall = max(pair) >= len(world.bodies)
            axes.broken_barh(
                [(begin, max(stop - begin, SHORTEST * end)) for begin, stop in times],
                (k - 0.3, 0.6),
                color=look.pale(colours.soft if wall else colours.blue),
                linewidth=0,
                gid="touch-" + "-".join(surfaces[surface] for surface in pair),
            )
        if strongest:
            order = list(rows)
            ranked = sorted(shown, key=lambda impact: -impact.impulse)
            axes.scatter(
                [impact.time for impact in ranked],
                [order.index(impact.pair) for impact in ranked],
                s=[LARGEST * impact.impulse / strongest for impact in ranked],
                color=colours.orange,
                linewidths=0.5,
                edgecolors=colours.paper,
                zorder=3,
                clip_on=False,
                gid="impacts",
            )
        axes.set_ylim(len(rows) - 0.4 if rows else 1, -0.6)
        labels = [" – ".join(surfaces[surface] for surface in pair) for pair in rows]
        axes.set_yticks(range(len(rows)), labels, fontsize=SMALL - 0.3)
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        axes.set_axisbelow(True)
        axes.hlines(np.arange(len(rows)), 0, end, color=colours.faint, linewidth=0.4, zorder=0)
        axes.set_xlim(0, end)
        axes.locator_params(axis="x", nbins=8)
        axes.set_xlabel("time (s)" + (f"; {missing} more pairs with weaker impacts" if missing > 0 else ""))
        walls = {max(pair) >= len(world.bodies) for pair in rows}
        handles = _key(scene, look, strongest, walls)
        if handles:
            figure.legend(handles=handles, loc="outside upper left", ncols=4, borderaxespad=0.2)
        if not rows:
            axes.text(0.5, 0.5, "nothing touches", transform=axes.transAxes, ha="center", va="center")
        figure.draw_without_rendering()
        return figure


def _touches(trajectory: Trajectory, end: float) -> dict[Pair, list[tuple[float, float]]]:
    """Begin and end of each touch within the clip, s, by pair."""
    contacts, found = trajectory.contacts, dict[Pair, list[tuple[float, float]]]()
    for (first, second), (begin, stop) in zip(
        contacts.touch_pairs.tolist(), contacts.touch_times.tolist(), strict=True
    ):
        if begin <= end:
            found.setdefault((first, second), []).append((begin, min(stop, end)))
    return found


def _rows(
    trajectory: Trajectory, impacts: Sequence[Impact], end: float, objects: set[int]
) -> dict[Pair, list[tuple[float, float]]]:
    """Touches of the pairs with the largest impulses, in the order in which they first touch."""
    found = {pair: t for pair, t in _touches(trajectory, end).items() if not objects or objects & set(pair)}
    impulse = dict.fromkeys(found, 0.0)
    for impact in impacts:
        if impact.pair in impulse:
            impulse[impact.pair] += impact.impulse
    strongest = sorted(found, key=lambda pair: -impulse[pair])[:MOST_ROWS]
    return {pair: found[pair] for pair in sorted(strongest, key=lambda pair: (found[pair][0][0], pair))}


def _key(scene: Scene, look: PlotStyle, strongest: float, walls: set[bool]) -> list[Any]:
    """Legend of bars and circles."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    colours, of = look.palette, units(scene, look)
    bars = ((False, "two objects touch", colours.blue), (True, "object and boundary", colours.soft))
    handles: list[Any] = [
        Patch(color=look.pale(colour), linewidth=0, label=name)
        for wall, name, colour in bars
        if wall in walls
    ]
    per = 1.0 if of.meter is None else IMPULSE.per(of.meter)
    for part in (1.0, 0.1):
        if strongest > 0:
            value = largest_round(part * strongest / per) * per
            label = f"impact of {of.text(IMPULSE, value, strongest / 10)}"
            circle = Line2D(
                [], [], linestyle="", marker="o", color=colours.orange, markeredgewidth=0, label=label
            )
            circle.set_markersize((LARGEST * value / strongest) ** 0.5)
            handles.append(circle)
    return handles
