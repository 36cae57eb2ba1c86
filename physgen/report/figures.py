"""World and trajectory -> figures for papers, by matplotlib: energy, paths, and strips of frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physgen.compile.world import World
from physgen.geometry.polygon import Array, rotation
from physgen.maps import U8
from physgen.render.drawing import arrow
from physgen.render.scales import nearest_round
from physgen.report.parameters import arrows
from physgen.report.plot_style import DPI, MM, PALETTE, RED, SMALL, new_figure, plot_settings, stroke
from physgen.scene.scene import Scene
from physgen.simulate.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class FigureStyle:
    """Sizes and limits of the figures."""

    width: float = 120.0
    strip_width: float = 174.0
    """mm, where none is asked for."""
    height: float = 2.8
    """Inches: of the chart of energy."""
    faint: float = 0.38
    """Share of the photo under the paths."""
    moves: float = 2.0
    """px: an object whose path is shorter has none."""
    coloured: int = 7
    """Paths with colours of their own where none are chosen: the longest. The others are grey."""
    marks: int = 8
    """Roughly, marks of time on a path."""
    gap: float = 3.0
    caption: float = 11.0
    """Points: between pictures of a strip, and of the line of times."""
    shaft: float = 1.15
    """Points: the width of an arrow's shaft."""


STYLE = FigureStyle()


def units(scene: Scene) -> tuple[tuple[str, float], tuple[str, float]]:
    """Of lengths and energies, with their size in scene units: SI where the scene states its scale."""
    if "world.pixels_per_meter" not in scene.places:
        return ("px", 1.0), ("g·px²/s²", 1.0)
    per = scene.world.pixels_per_meter
    return ("m", per), ("J", 1000 * per**2)


def energy_figure(scene: Scene, world: World, trajectory: Trajectory, width: float | None = None) -> Figure:
    """Kinetic, potential and dissipated energy over time, stacked; `width` in mm.

    If energy were lost or created, the black line, which is their sum less the work done, would not be level.
    `trajectory` has many samples, at ends of engine steps.
    """
    name, size = units(scene)[1]
    times, work = trajectory.times, trajectory.energy.work / size
    layers, expected = (values / size for values in stacked(trajectory))
    borders = np.cumsum(layers, axis=0)
    colours = (PALETTE.blue, PALETTE.green, PALETTE.orange)
    with plot_settings():
        figure = new_figure((width or STYLE.width) / MM, STYLE.height, dpi=DPI, layout="constrained")
        axes = figure.subplots()
        axes.patch.set_gid("area")
        axes.stackplot(
            times, layers, colors=colours, alpha=0.35, labels=("kinetic", "potential", "dissipated")
        )
        for k, kind in enumerate(("kinetic", "potential", "dissipated")):
            axes.plot(times, borders[k], color=colours[k], linewidth=0.7, gid=kind)
        if work.any():
            label = "initial energy + work done"
            axes.plot(times, expected, "--", color=PALETTE.purple, linewidth=1.6, label=label)
        # as on the report page: relative to the energy that flows, at least that of a fall by a pixel
        weight = sum(body.mass for body in world.bodies) * float(np.hypot(*world.gravity))
        label = f"sum − work; energy balance error {max(100 * trajectory.imbalance(weight), 0.001):.1g} %"
        axes.plot(times, borders[-1] - work, color=PALETTE.ink, linewidth=1.3, label=label, gid="sum")
        begins = trajectory.contacts.touch_times[:, 0]
        begins = begins[begins > 0]
        axes.plot(
            begins, np.zeros_like(begins), "|", color=PALETTE.ink, label="contact begins", clip_on=False
        )
        axes.set(xlabel="time (s)", ylabel=f"energy ({name})")
        axes.set_ylim(0, 1.06 * (float(expected.max(initial=0.0)) or 1.0))
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


def trajectory_figure(
    scene: Scene,
    world: World,
    trajectory: Trajectory,
    photo: U8 | None,
    objects: Sequence[str] = (),
    width: float | None = None,
) -> Figure:
    """Paths of objects and their final outlines, named ones or all; `photo` (H, W, 3) sRGB lies faintly below them.

    `width` in mm.
    """
    (unit, size), across = units(scene)[0], (width or STYLE.width) / MM
    wide, tall = world.size
    extent = (-0.5 / size, (wide - 0.5) / size, (tall - 0.5) / size, -0.5 / size)
    duration = float(trajectory.times[-1]) if len(trajectory.times) else 0.0
    every = nearest_round(duration / STYLE.marks) if duration > 0 else 1.0
    marks = np.arange(0, duration + 1e-9, every)
    with plot_settings():
        figure = new_figure(
            across, 0.85 * across * min(tall / wide, 1.4) + 0.5, dpi=DPI, layout="constrained"
        )
        axes = figure.subplots()
        axes.patch.set_gid("area")
        if photo is not None:
            axes.imshow(photo, extent=extent, alpha=STYLE.faint, zorder=0)
        for wall in world.walls:
            for chain in wall.chains:
                axes.plot(*(chain / size).T, color=PALETTE.soft, linewidth=0.8, zorder=1)
        for body, line in _lines(trajectory, objects):
            path, name = trajectory.poses[:, body, :2] / size, trajectory.names[body]
            axes.plot(*path.T, gid=f"path-{name}", zorder=3, **line)
            x, y = (np.interp(marks, trajectory.times, column) for column in path.T)
            axes.plot(x, y, "o", color=line["color"], markersize=2, zorder=4)
            x, y, angle = trajectory.poses[-1, body]
            for ring in world.bodies[body].rings:
                closed = np.concatenate([ring, ring[:1]]) @ rotation(float(angle)).T + (x, y)
                axes.plot(*(closed / size).T, color=line["color"], linewidth=0.6, zorder=2)
        axes.set(xlim=extent[:2], ylim=extent[2:], aspect="equal", xlabel=f"x ({unit})", ylabel=f"y ({unit})")
        handles, labels = axes.get_legend_handles_labels()
        if labels:
            title = f"a dot every {every:g} s"
            figure.legend(
                handles, labels, loc="outside lower center", ncols=4, title=title, title_fontsize=SMALL
            )
        figure.draw_without_rendering()
        return figure


def _lines(trajectory: Trajectory, objects: Sequence[str]) -> list[tuple[int, dict[str, Any]]]:
    """Objects that have a path, `objects` by name or else all that move, and how their lines are drawn."""
    steps = np.diff(trajectory.poses[..., :2], axis=0)
    length = np.hypot(steps[..., 0], steps[..., 1]).sum(axis=0)
    if objects:
        moving = coloured = [trajectory.names.index(name) for name in objects]
    else:
        moving = np.flatnonzero(length > STYLE.moves).tolist()
        coloured = sorted(sorted(moving, key=lambda body: -length[body])[: STYLE.coloured])
    found: list[tuple[int, dict[str, Any]]] = []
    for body in moving:
        line: dict[str, Any] = {"color": PALETTE.soft, "linewidth": 0.5}
        if body in coloured:
            colour, dashes = stroke(coloured.index(body))
            line = {"color": colour, "linestyle": dashes, "label": trajectory.names[body]}
        found.append((body, line))
    return found


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


def strip_figure(rows: Sequence[StripRow], width: float | None = None) -> Figure:
    """`width` in mm. The figure's own dpi is such that a pixel of it is one of the first scene's frames."""
    cell, count = rows[0].photo.shape[1], 1 + max(len(row.frames) for row in rows)
    inches = (width or STYLE.strip_width) / MM
    dpi = count * cell / max(inches - (count - 1) * STYLE.gap / 72, 0.2 * inches)
    gap, caption = (round(points * dpi / 72) for points in (STYLE.gap, STYLE.caption))
    tall = [max(1, round(cell * row.photo.shape[0] / row.photo.shape[1])) for row in rows]
    wide, high = count * (cell + gap) - gap, sum(tall) + len(rows) * caption
    with plot_settings():
        # a hair more, so that the canvas is not a pixel less for rounding
        figure = new_figure((wide + 1e-4) / dpi, (high + 1e-4) / dpi, dpi=dpi)
        top = 0
        for row, height in zip(rows, tall, strict=True):
            top += caption
            pictures = [("input", row.photo), *((f"{time:.2f} s", rgb) for time, rgb in row.frames)]
            for k, (text, rgb) in enumerate(pictures):
                box = (k * (cell + gap) / wide, 1 - (top + height) / high, cell / wide, height / high)
                axes = figure.add_axes(box, frameon=False)
                axes.set_axis_off()
                axes.imshow(rgb, aspect="auto", interpolation="none")
                axes.set_title(text, fontsize=SMALL, pad=2)
                if k == 0:
                    for patch in _arrows(row, STYLE.shaft * dpi / 72 * rgb.shape[1] / cell):
                        axes.add_patch(patch)
            top += height
        return figure


def _arrows(row: StripRow, shaft: float) -> list[Any]:
    """Patches: velocities filled, pushes hollow; `shaft`: px of the frame."""
    from matplotlib.patches import Polygon

    found = []
    for kind, tail, tip, _ in arrows(row.world):
        outline = arrow(row.lens @ [*tail, 1.0], row.lens @ [*tip, 1.0], shaft)
        face, line = (RED, 0.0) if kind == "velocity" else (PALETTE.paper, 0.9)
        found.append(Polygon(outline, facecolor=face, edgecolor=RED, linewidth=line))
    return found
