"""Scene files -> one figure for a paper: energy, paths, or strips of frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physgen.pipeline.stages import Film, Keep, Stages, compile, load, percepts, shot, simulate
from physgen.problems import InputError
from physgen.progress import Progress, silent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from physgen.report.figures import StripRow
    from physgen.scene.scene import Scene

FINER, MOST = 8, 2_000_000
"""Samples a frame, so that curves show what happens there; and samples times objects, at most."""
CLOSE = 1200
"""Samples of energy."""


@dataclass(frozen=True)
class PlotRequest:
    """What a figure is to show; a kind of figure passes over what is not its."""

    objects: Sequence[str] = ()
    """Names; empty: all."""
    frames: int | Sequence[int] = 5
    """Of a strip, after the photo: so many at even times to the last, or which, from 0."""
    overrides: Sequence[str] = ()
    variant: str | None = None
    allow_outside: bool = False
    width: float | None = None
    """mm; None: as suits the kind of figure."""


def plot(
    kind: str,
    paths: Sequence[str | Path],
    output: Path,
    asked: PlotRequest | None = None,
    progress: Progress = silent,
) -> Path:
    """Draws `energy`, `trajectory` or `strip` into `output`, a PNG, SVG or PDF by its ending.

    A strip takes several scenes, a row each; the others take one. Returns `output`; raises InputError.
    """
    from physgen.report.plot_style import check_name, require_matplotlib, write_figure

    asked = asked or PlotRequest()
    check_name(output)
    require_matplotlib()
    if kind == "strip":
        from physgen.report.figures import strip_figure

        rows = [_strip_row(path, asked, progress) for path in paths]
        figure, name = strip_figure(rows, asked.width), ", ".join(row.name for row in rows)
    else:
        scene = load(paths[0], asked.overrides, asked.variant, asked.allow_outside)
        figure, name = _curves(kind, scene, asked, progress), scene.name
    progress("draw", 0, 1)
    write_figure(figure, output, f"{name}: {kind}")
    return output


def _curves(kind: str, scene: Scene, asked: PlotRequest, progress: Progress) -> Figure:
    """Energy or trajectory of one scene."""
    from physgen.render.contacts import sample_times
    from physgen.report.figures import energy_figure, trajectory_figure
    from physgen.simulate.engine import simulate as run

    there = [item.name for item in scene.objects]
    for name in asked.objects:
        if name not in there:
            fix = f"the scene has {', '.join(there)}"
            raise InputError.of("--objects", f'"{name}"', "is no object of the scene", fix)
    maps = percepts(scene)
    world = compile(scene, maps).world
    progress("simulate", 0, 1)
    bodies = max(len(world.bodies), 1)
    if kind == "energy":  # at ends of steps, where energies are exact
        every = max(1, ceil(world.duration * world.steps_per_second / min(CLOSE, MOST // bodies)))
        ends = np.arange(0, int(world.duration * world.steps_per_second + 1e-6) + 1, every)
        seen = run(world, ends / world.steps_per_second, progress)
        return energy_figure(scene, world, seen, asked.width)
    coarse = simulate(world, progress=progress)
    to_the_end = replace(coarse, times=np.append(coarse.times, world.duration))  # the last frame is before it
    seen = run(world, sample_times(to_the_end, FINER, MOST // bodies), progress)
    photo = None if maps is None else maps.rgb
    return trajectory_figure(scene, world, seen, photo, asked.objects, asked.width)


def _strip_row(path: str | Path, asked: PlotRequest, progress: Progress) -> StripRow:
    """One scene's photo and frames, drawn as `render` draws them; refinement is left out."""
    from physgen.report.figures import StripRow
    from physgen.report.record import RunRecord

    scene = load(path, asked.overrides, asked.variant, asked.allow_outside)
    stages = Stages(Keep.NOTHING)
    maps = stages.maps(scene)
    compiled = stages.compile(scene, maps)
    progress("simulate", 0, 1)
    trajectory = stages.simulate(compiled.world, progress)
    order = chosen(asked.frames, len(trajectory.times))
    film = Film(scene, compiled, maps, RunRecord(scene=scene.name, command=[]), stages)
    photo = next(film.frames(trajectory, (0,))).rgb
    frames = []
    for k, frame in enumerate(film.annotated(film.frames(trajectory, order), trajectory)):
        progress("render", k + 1, len(order))
        frames.append((frame.time, frame.rgb.copy()))
    lens = shot(scene, trajectory).affine(0.0)
    return StripRow(scene.name, compiled.world, photo, lens, frames)


def chosen(frames: int | Sequence[int], count: int) -> list[int]:
    """Which of `count` frames: so many at even times to the last, or those named. Raises InputError.

    >>> chosen(4, 41), chosen((0, 3, 6), 10)
    ([10, 20, 30, 40], [0, 3, 6])
    """
    if isinstance(frames, int):
        even = np.linspace(0, count - 1, frames + 1)[1:].round().astype(int)
        return list(dict.fromkeys(even.tolist()))
    beyond = [frame for frame in frames if not 0 <= frame < count]
    if beyond:
        found = f'"{beyond[0]}"'
        raise InputError.of("--frames", found, f"is not among {count} frames", f"count from 0 to {count - 1}")
    return list(frames)
