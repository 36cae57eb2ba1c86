"""Scene files -> one figure for a paper: energy, paths, contacts, or strips of frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physgen.pipeline.stages import Film, Keep, Stages, compile, load, percepts, shot, simulate
from physgen.problems import InputError
from physgen.progress import Progress, silent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from physgen.compile.world import World
    from physgen.report.plots.frames import StripRow
    from physgen.report.plots.style import PlotStyle
    from physgen.scene.scene import Scene
    from physgen.simulate.trajectory import Trajectory


KINDS = ("energy", "trajectory", "contacts", "strip")
FRAMES = 5
"""Of a strip, after the photo."""
FINER, MOST = 8, 2_000_000
"""Samples a frame, so that curves show what happens there; and samples times objects, at most."""
CLOSE = 1200
"""Samples of energy."""


@dataclass(frozen=True)
class PlotRequest:
    """What a figure is to show; a kind of figure passes over what is not its."""

    objects: Sequence[str] = ()
    """Names; empty: all."""
    curves: Sequence[str] = ()
    """Below a trajectory's paths: any of x, y, speed, angle."""
    frames: int | Sequence[int] = FRAMES
    """Of a strip: so many at even times to the last, or which, from 0."""
    columns: int | None = None
    """Pictures side by side in a strip."""
    names: bool = False
    """Whether a strip's rows have their scenes' names."""
    overrides: Sequence[str] = ()
    variant: str | None = None
    allow_outside: bool = False
    look: PlotStyle | None = field(default=None)
    """Width, dpi, dark or light, SI; see `physgen.report.plots.style.PlotStyle`."""


def plot(
    kind: str,
    paths: Sequence[str | Path],
    output: Path,
    asked: PlotRequest | None = None,
    progress: Progress = silent,
) -> Path:
    """Draws one of KINDS into `output`, a PNG, SVG or PDF by its ending, and returns it; raises InputError.

    A strip takes several scenes, a row each; the others take one.
    """
    from physgen.report.plots.style import PlotStyle, check_name, require_matplotlib, write_figure

    asked = asked or PlotRequest()
    check_name(output)
    require_matplotlib()
    look = asked.look or PlotStyle()
    if kind == "strip":
        figure, name = _strip(paths, asked, look, output.suffix.lower() == ".png", progress)
    else:
        if len(paths) != 1:
            raise InputError.of("plot", f"{len(paths)} scenes", "are not one", "only a strip takes several")
        figure, name = _curves(kind, paths[0], asked, look, progress)
    progress("draw", 0, 1)
    write_figure(figure, output, f"{name}: {kind}", look)
    return output


def _curves(
    kind: str, path: str | Path, asked: PlotRequest, look: PlotStyle, progress: Progress
) -> tuple[Figure, str]:
    """Energy, trajectory or contacts of one scene, and its name."""
    from physgen.render.contacts import find_impacts, sample_times
    from physgen.report.plots.contacts import contacts_figure
    from physgen.report.plots.energy import energy_figure
    from physgen.report.plots.paths import trajectory_figure

    scene = load(path, asked.overrides, asked.variant, asked.allow_outside)
    _known(scene, asked.objects)
    maps = percepts(scene)
    world = compile(scene, maps).world
    progress("simulate", 0, 1)
    bodies = max(len(world.bodies), 1)
    if kind == "energy":  # at ends of steps, where energies are exact
        every = max(1, ceil(world.duration * world.steps_per_second / min(CLOSE, MOST // bodies)))
        ends = np.arange(0, int(world.duration * world.steps_per_second + 1e-6) + 1, every)
        return energy_figure(
            scene, world, _at(world, ends / world.steps_per_second, progress), look
        ), scene.name
    coarse = simulate(world, progress=progress)
    seen = _at(world, sample_times(_to_the_end(coarse, world), FINER, MOST // bodies), progress)
    if kind == "trajectory":
        photo = None if maps is None else maps.rgb
        figure = trajectory_figure(
            scene, world, seen, photo, look, objects=asked.objects, curves=asked.curves
        )
        return figure, scene.name
    struck = find_impacts(world, seen, world.duration / max(len(world.times), 1) / FINER)
    return contacts_figure(scene, world, seen, struck, look, asked.objects), scene.name


def _at(world: World, times: np.ndarray, progress: Progress) -> Trajectory:
    from physgen.simulate.engine import simulate as run

    return run(world, times, progress)


def _to_the_end(trajectory: Trajectory, world: World) -> Trajectory:
    """The same with the clip's end among its times: the last frame is taken before it."""
    return replace(trajectory, times=np.append(trajectory.times, world.duration))


def _strip(
    paths: Sequence[str | Path], asked: PlotRequest, look: PlotStyle, exact: bool, progress: Progress
) -> tuple[Figure, str]:
    from physgen.report.plots.frames import strip_figure

    reels = [_reel(path, asked, progress) for path in paths]
    figure = strip_figure(reels, look, columns=asked.columns, names=asked.names, exact=exact)
    return figure, ", ".join(reel.scene.name for reel in reels)


def _reel(path: str | Path, asked: PlotRequest, progress: Progress) -> StripRow:
    """One scene's photo and frames, drawn as `render` draws them; refinement is left out."""
    from physgen.report.plots.frames import StripRow
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
    return StripRow(scene, compiled.world, trajectory, photo, lens, frames)


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


def _known(scene: Scene, names: Sequence[str]) -> None:
    """Raises InputError for names that are not those of objects."""
    there = [item.name for item in scene.objects]
    problems = []
    for name in names:
        if name not in there:
            fix = f"the scene has {', '.join(there[:12])}{', ...' * (len(there) > 12)}" if there else ""
            problems += InputError.of("--objects", f'"{name}"', "is no object of the scene", fix).problems
    if problems:
        raise InputError(problems)
