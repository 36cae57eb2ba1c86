"""World and trajectory -> who touches whom and when, as bars over time, with blows as circles.

A circle's area tells its impulse, as that of a ring does in the overlays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.render.scales import largest_round
from physgen.render.touches import Blow
from physgen.report.plots.look import SMALL, Look, drawing, paper
from physgen.report.plots.units import IMPULSE, units
from physgen.scene.model import Scene
from physgen.simulate.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

WIDTH = 150.0
"""mm."""
ROW = 0.145
"""Inches of a pair's row."""
MOST_ROWS = 48
LARGEST = 90.0
"""Square points: the strongest blow's circle."""
BRIEF = 0.004
"""Of the clip: no bar is shorter."""


@dataclass(frozen=True)
class Row:
    """Two surfaces that touch."""

    pair: tuple[int, int]
    times: Array
    """(K, 2) s: begin and end of each touch, within the clip."""
    blows: list[Blow]
    impulse: float
    """g·px/s, of all blows."""


def rows(trajectory: Trajectory, blows: Sequence[Blow], objects: Sequence[str] = ()) -> list[Row]:
    """By who touches first; of `objects` alone, where any are named."""
    contacts, end = trajectory.contacts, float(trajectory.times[-1]) if len(trajectory.times) else 0.0
    wanted = {contacts.surfaces.index(name) for name in objects}
    struck: dict[tuple[int, int], list[Blow]] = {}
    for blow in blows:
        struck.setdefault(blow.pair, []).append(blow)
    touching: dict[tuple[int, int], list[tuple[float, float]]] = {}
    for (first, second), (begin, stop) in zip(
        contacts.touch_pairs.tolist(), contacts.touch_times.tolist(), strict=True
    ):
        if begin <= end and (not wanted or {first, second} & wanted):
            touching.setdefault((first, second), []).append((begin, min(stop, end)))
    found = [
        Row(pair, np.array(times), struck.get(pair, []), sum(blow.impulse for blow in struck.get(pair, [])))
        for pair, times in touching.items()
    ]
    return sorted(found, key=lambda row: (row.times[0, 0], row.pair))


def contacts_figure(
    scene: Scene,
    world: World,
    trajectory: Trajectory,
    blows: Sequence[Blow],
    look: Look,
    objects: Sequence[str] = (),
) -> Figure:
    """`trajectory` and `blows` as `render.touches` finds them."""
    found = rows(trajectory, blows, objects)
    left_out = 0
    if len(found) > MOST_ROWS:  # the strongest of them, in the order of time as before
        least = sorted((row.impulse for row in found), reverse=True)[MOST_ROWS - 1]
        strong = [row for row in found if row.impulse >= least][:MOST_ROWS]
        left_out, found = len(found) - len(strong), strong
    names, N = trajectory.contacts.surfaces, len(world.bodies)
    end = float(trajectory.times[-1]) if len(trajectory.times) > 1 else 1.0
    colours = look.palette
    with drawing(look):
        figure = paper(look, look.inches(WIDTH), 0.82 + ROW * max(len(found), 2))
        figure.set_layout_engine("constrained", w_pad=0.05, h_pad=0.05)
        axes = figure.add_subplot()
        axes.patch.set_gid("area")
        for k, row in enumerate(found):
            wall = max(row.pair) >= N
            spans = [(begin, max(stop - begin, BRIEF * end)) for begin, stop in row.times.tolist()]
            axes.broken_barh(
                spans,
                (k - 0.3, 0.6),
                color=look.pale(colours.soft if wall else colours.blue),
                linewidth=0,
                gid=f"touch-{names[row.pair[0]]}-{names[row.pair[1]]}",
            )
        strongest = max((blow.impulse for row in found for blow in row.blows), default=0.0)
        points = [(blow.time, k, blow.impulse) for k, row in enumerate(found) for blow in row.blows]
        if points:
            t, k, impulse = np.array(sorted(points, key=lambda p: -p[2])).T
            axes.scatter(
                t,
                k,
                s=LARGEST * impulse / strongest,
                color=colours.orange,
                linewidths=0.5,
                edgecolors=colours.paper,
                zorder=3,
                clip_on=False,
                gid="blows",
            )
        axes.set_ylim(len(found) - 0.4 if found else 1, -0.6)
        labels = [f"{names[row.pair[0]]} – {names[row.pair[1]]}" for row in found]
        axes.set_yticks(range(len(found)), labels, fontsize=SMALL - 0.3)
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        axes.set_axisbelow(True)
        axes.hlines(np.arange(len(found)), 0, end, color=colours.faint, linewidth=0.4, zorder=0)
        axes.set_xlim(0, end)
        axes.locator_params(axis="x", nbins=8)
        axes.set_xlabel("time (s)" + (f"; {left_out} more pairs with weaker blows" if left_out else ""))
        _key(figure, scene, look, strongest, {max(row.pair) >= N for row in found})
        if not found:
            axes.text(0.5, 0.5, "nothing touches", transform=axes.transAxes, ha="center", va="center")
        figure.draw_without_rendering()
        return figure


def _key(figure: Figure, scene: Scene, look: Look, strongest: float, walls: set[bool]) -> None:
    """What bars and circles mean."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    colours, of = look.palette, units(scene, look)
    handles: list[Any] = [
        Patch(color=look.pale(colour), linewidth=0, label=name)
        for name, colour, wall in (
            ("two objects touch", colours.blue, False),
            ("object and boundary", colours.soft, True),
        )
        if wall in walls
    ]
    per = 1.0 if of.meter is None else IMPULSE.per(of.meter)
    for part in (1.0, 0.1):
        if strongest > 0:
            value = largest_round(part * strongest / per) * per
            size = (LARGEST * value / strongest) ** 0.5
            handles.append(
                Line2D(
                    [],
                    [],
                    linestyle="",
                    marker="o",
                    markersize=size,
                    color=colours.orange,
                    markeredgewidth=0,
                    label=f"blow of {of.said(IMPULSE, value, strongest / 10)}",
                )
            )
    if handles:
        figure.legend(handles=handles, loc="outside upper left", ncols=4, borderaxespad=0.2)
