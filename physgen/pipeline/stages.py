"""Scene file -> Scene -> World -> Trajectory -> Frames: one call a stage, top-down."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physgen.pipeline.packs import scene_file
from physgen.pipeline.watch import Progress, silent
from physgen.problems import InputError, Problem

if TYPE_CHECKING:
    from physgen.compile.compile import Compiled
    from physgen.compile.world import World
    from physgen.maps import Percepts
    from physgen.render.camera import Shot
    from physgen.render.stage import Frame, Stage
    from physgen.scene.scene import Scene
    from physgen.simulate.chaos import Chaos
    from physgen.simulate.recorder import StepLog
    from physgen.simulate.trajectory import Trajectory
    from physgen.simulate.uncertainty import Ensemble


MOST_POSES = 20_000_000
"""Samples times objects of one trajectory: about 2 GB."""


def load(
    path: str | Path, overrides: Sequence[str] = (), variant: str | None = None, allow_outside: bool = False
) -> Scene:
    """Scene file or pack -> Scene, overlays applied and defaults filled in. Raises InputError with every problem."""
    from physgen.scene.load import load as load_scene

    return load_scene(scene_file(path), overrides, variant, allow_outside)


def percepts(scene: Scene) -> Percepts | None:
    """The photo and its maps; None for a scene without a photo."""
    from physgen.maps import read_percepts

    return read_percepts(scene.image, scene.assets, scene.maps)


def compile(scene: Scene, maps: Percepts | None) -> Compiled:
    """Outlines, centres, masses, moments and pairs, resolved."""
    from physgen.compile.compile import compile_scene

    return compile_scene(scene, None if maps is None else maps.labels)


def lint(scene: Scene, compiled: Compiled, maps: Percepts | None = None) -> list[Problem]:
    """What is allowed and probably not meant; with the photo's `maps`, of them too."""
    from physgen.compile.warnings import lint as lint_scene

    return lint_scene(scene, compiled, maps)


def simulate(
    world: World, rate: float | None = None, progress: Progress = silent, tape: StepLog | None = None
) -> Trajectory:
    """Motion at the video's frame times, or from t = 0 to the end at `rate` samples a second.

    A `tape` keeps the engine's steps, to be sampled at other times without running again.
    """
    from physgen.simulate.engine import simulate as run

    if rate is None:
        return run(world, progress=progress, tape=tape)
    count = int(world.duration * rate + 1e-9) + 1
    if count * max(len(world.bodies), 1) > MOST_POSES:
        found = f"{count:,} samples of {len(world.bodies)} objects"
        raise InputError.of(
            "--rate", found, "are too many to hold", f"keep samples x objects below {MOST_POSES:,}"
        )
    return run(world, np.arange(count) / rate, progress, tape=tape)


def chaos(world: World, progress: Progress = silent) -> Chaos:
    """How long the motion can be foretold: the world run again a hair apart, with half the step, other sweeps."""
    from physgen.simulate.chaos import chaos as compare

    return compare(world, progress)


def fan(
    scene: Scene,
    compiled: Compiled,
    count: int,
    seed: int = 0,
    variant: str | None = None,
    progress: Progress = silent,
) -> Ensemble:
    """The scene simulated `count` times, each with other numbers from what `from` is unsure of; see docs/fan.md.

    `variant` is the one that was applied to the scene: what it sets is certain.
    """
    from physgen.simulate.uncertainty import simulate_ensemble as draw

    return draw(scene, compiled, count, seed, variant, progress)


def stage(scene: Scene, compiled: Compiled, maps: Percepts | None) -> Stage:
    """What is drawn: the filled background and the objects cut out of the photo, or flat shapes on paper.

    Flat shapes are drawn as large as `render` shows them at most. Nothing that can only be seen in motion counts.
    """
    from physgen.compile.appearance import appearance, photo_poses
    from physgen.render.camera import canvas_scale
    from physgen.render.frames import single_threaded
    from physgen.render.sprites import cut_sprites
    from physgen.render.stage import Stage
    from physgen.render.staging import enlarged_world, flat_background, flat_sprites, lit_stage

    begin = photo_poses(compiled.world)
    scene, world = appearance(scene, compiled.world)
    order = sorted(range(len(scene.objects)), key=lambda k: scene.objects[k].layer)
    fine = scene.render.supersample
    if maps is None:
        large = canvas_scale(scene)
        world, outlines = enlarged_world(world, compiled.outlines, large)
        sprites = flat_sprites(world, outlines, order, large)
        return Stage(flat_background(world, large), sprites, supersample=fine, scale=large)
    coverage, background = filled(maps, compiled.labels, compiled.scenery)
    absent = (maps.labels > 0) & (compiled.labels == 0) & ~compiled.scenery
    with single_threaded():
        sprites = cut_sprites(maps.rgb, compiled.labels, absent, coverage, background, order)
        made = lit_stage(scene, world, sprites, maps, background, coverage, absent)
    return replace(made, supersample=fine, starts=begin)


def filled(
    maps: Percepts, labels: NDArray[np.uint16], scenery: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Coverage and background as stored; made now where the assets lack them or know less than the scene's masks.

    They are also made now where the assets took a boundary, whose pixels are `scenery`, for an object.
    """
    from physgen.compile.warnings import maps_cover_masks

    known = maps_cover_masks(maps, labels, scenery)
    if known and maps.coverage is not None and maps.background is not None:
        return maps.coverage, maps.background
    from physgen import registry

    union = np.where(labels > 0, labels, np.where(scenery, np.uint16(0), maps.labels))
    coverage = maps.coverage
    if coverage is None or not known:
        coverage = registry.make("matte")(maps.rgb, union)
    return coverage, registry.make("inpaint")(maps.rgb, coverage > 0)


def shot(scene: Scene, trajectory: Trajectory) -> Shot:
    """How the scene's clip is filmed and played; `trajectory` has one sample a frame."""
    from physgen.render.camera import shot_of as take

    return take(scene, trajectory)


def render(
    drawn: Stage,
    trajectory: Trajectory,
    parts: int = 1,
    through: Shot | None = None,
    device: str = "cpu",
) -> Iterator[Frame]:
    """Frames, one at a time; each the mean of `parts` samples, in linear light.

    `through` is a shot: without one, all of the canvas is seen and played forward. On a `device` other than the
    processor (`cuda`, `cuda:1`) torch draws them, the same within 1 grey level.
    """
    from physgen.render.camera import filmed, mean_exposures

    if device == "cpu":
        from physgen.render.frames import render_frames
    else:
        from physgen.render.torch_frames import render_frames_torch

        render_frames = partial(render_frames_torch, device=device)
    if through is None:
        return render_frames(drawn, trajectory, parts=parts)
    samples = through.samples(parts)
    if parts > 1 and through.moves:  # while the shutter is open, too: what the camera follows stays sharp
        return mean_exposures(filmed(render_frames(drawn, trajectory, samples), through, drawn.scale), parts)
    return filmed(render_frames(drawn, trajectory, samples, parts), through, drawn.scale)


def drawn_by(device: str) -> str:
    """What draws frames on `device`, for the manifest. Raises InputError where it, or torch, is not there."""
    if device == "cpu":
        return device
    try:
        from physgen.render.torch_frames import title
    except ModuleNotFoundError as error:
        found, fix = f"needs {error.name}, which is not installed", 'pip install "physgen[models]"'
        raise InputError.of("--device", f'"{device}"', found, fix) from error
    return title(device)
