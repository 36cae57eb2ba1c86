"""Figure of contacts as bars over time, with impacts as circles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.render.contacts import Impact
from physgen.render.scales import largest_round
from physgen.report.plots.style import IMPULSE, SMALL, PlotStyle, new_figure, plot_settings, units
from physgen.scene.scene import Scene
from physgen.simulate.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Array = NDArray[np.float64]

WIDTH = 150.0
"""mm."""
ROW = 0.145
"""Inches of a pair's row."""
MOST_PAIRS = 24
"""Rows of pairs; of more, things have theirs."""
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
    blows: list[Impact]
    impulse: float
    """g·px/s, of all blows."""


@dataclass(frozen=True)
class Line:
    """What is drawn at one height."""

    label: str
    name: str
    """Of its bars, for programs."""
    times: Array
    """(K, 2) s."""
    wall: bool
    """A boundary has part in it."""


def contact_rows(trajectory: Trajectory, blows: Sequence[Impact], objects: Sequence[str] = ()) -> list[Row]:
    """By who touches first; of `objects` alone, where any are named."""
    contacts, end = trajectory.contacts, float(trajectory.times[-1]) if len(trajectory.times) else 0.0
    wanted = {contacts.surfaces.index(name) for name in objects}
    struck: dict[tuple[int, int], list[Impact]] = {}
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
    blows: Sequence[Impact],
    look: PlotStyle,
    objects: Sequence[str] = (),
) -> Figure:
    """`trajectory` and `blows` as `render.touches` finds them."""
    found = contact_rows(trajectory, blows, objects)
    names, N = trajectory.contacts.surfaces, len(world.bodies)
    crowded = len(found) > MOST_PAIRS
    if crowded:
        lines, heights = _things(found, names, N)
        struck = [
            (blow, [heights[k] for k in row.pair if k in heights]) for row in found for blow in row.blows
        ]
    else:
        lines = [_pair(row, names, N) for row in found]
        struck = [(blow, [k]) for k, row in enumerate(found) for blow in row.blows]
    shown = {k for row in found for k in row.pair}
    left_out = len(shown) - len(lines) if crowded else 0
    end = float(trajectory.times[-1]) if len(trajectory.times) > 1 else 1.0
    colours = look.palette
    with plot_settings(look):
        figure = new_figure(look, look.inches(WIDTH), 0.82 + ROW * max(len(lines), 2))
        figure.set_layout_engine("constrained", w_pad=0.05, h_pad=0.05)
        axes = figure.add_subplot()
        axes.patch.set_gid("area")
        for k, line in enumerate(lines):
            axes.broken_barh(
                [(begin, max(stop - begin, BRIEF * end)) for begin, stop in line.times.tolist()],
                (k - 0.3, 0.6),
                color=look.pale(colours.soft if line.wall else colours.blue),
                linewidth=0,
                gid=f"touch-{line.name}",
            )
        strongest = max((blow.impulse for blow, _ in struck), default=0.0)
        for blow, at in struck:
            if len(at) == 2:
                axes.vlines(
                    blow.time, min(at), max(at), color=colours.orange, linewidth=0.5, alpha=0.7, zorder=2
                )
        largest: dict[tuple[float, int], tuple[float, int, float]] = {}
        for blow, at in sorted(struck, key=lambda pair: pair[0].impulse):
            for k in at:  # of blows that one thing gets at once from several, the largest
                largest[round(blow.time, 6), k] = (blow.time, k, blow.impulse)
        if largest:
            t, k, impulse = np.array(sorted(largest.values(), key=lambda p: -p[2])).T
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
        axes.set_ylim(len(lines) - 0.4 if lines else 1, -0.6)
        axes.set_yticks(range(len(lines)), [line.label for line in lines], fontsize=SMALL - 0.3)
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        axes.set_axisbelow(True)
        axes.hlines(np.arange(len(lines)), 0, end, color=colours.faint, linewidth=0.4, zorder=0)
        axes.set_xlim(0, end)
        axes.locator_params(axis="x", nbins=8)
        axes.set_xlabel("time (s)" + (f"; {left_out} more with weaker blows" if left_out else ""))
        bars = ("touches something", "boundary") if crowded else ("two objects touch", "object and boundary")
        _key(
            figure,
            scene,
            look,
            strongest,
            dict(zip(bars, (False, True), strict=True)),
            {x.wall for x in lines},
        )
        if not lines:
            axes.text(0.5, 0.5, "nothing touches", transform=axes.transAxes, ha="center", va="center")
        figure.draw_without_rendering()
        return figure


def _pair(row: Row, names: Sequence[str], count: int) -> Line:
    first, second = (names[k] for k in row.pair)
    return Line(f"{first} – {second}", f"{first}-{second}", row.times, max(row.pair) >= count)


def _things(found: Sequence[Row], names: Sequence[str], count: int) -> tuple[list[Line], dict[int, int]]:
    """A line for each thing that touches any, by when it first does, boundaries last; and surface -> height."""
    times: dict[int, list[Array]] = {}
    impulse: dict[int, float] = {}
    for row in found:
        for k in row.pair:
            times.setdefault(k, []).append(row.times)
            impulse[k] = impulse.get(k, 0.0) + row.impulse
    strong = sorted(times, key=lambda k: -impulse[k])[:MOST_ROWS]
    moment = {k: min(float(spans[:, 0].min()) for spans in times[k]) for k in strong}
    order = sorted(strong, key=lambda k: (k >= count, moment[k], k))
    lines = [Line(names[k], names[k], np.concatenate(times[k]), k >= count) for k in order]
    return lines, {k: height for height, k in enumerate(order)}


def _key(
    figure: Figure, scene: Scene, look: PlotStyle, strongest: float, bars: dict[str, bool], walls: set[bool]
) -> None:
    """What bars and circles mean."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    colours, of = look.palette, units(scene, look)
    handles: list[Any] = [
        Patch(color=look.pale(colour), linewidth=0, label=name)
        for (name, wall), colour in zip(bars.items(), (colours.blue, colours.soft), strict=True)
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
