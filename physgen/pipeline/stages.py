"""The stages from a scene file to frames: one function per stage, and classes with
memory.

`Stages` keeps results in this process from one clip to the next, as long as their
inputs are the same: scenes that differ in a force, a mass or a light share the parsed
file, the photo's maps and the sprites. `Film` draws the frames of one scene.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

import physgen.render
import physgen.simulate
from physgen import registry
from physgen.compile.compile import (
    check_steps,
    compile_scene,
    compile_shapes,
    frame_times,
)
from physgen.compile.photo_warnings import maps_cover_masks
from physgen.compile.shapes import shapes_of
from physgen.compile.warnings import lint as lint_scene
from physgen.compile.world import (
    appearance,
    photo_poses,
    world_as_drawn,
    world_in_photo,
)
from physgen.files import MOST_PIXELS, Stamp, file_stamp
from physgen.geometry.scale import PLAYBACK
from physgen.maps import read_percepts
from physgen.perceive.inpaint.poisson import dilate, fill_behind
from physgen.pipeline.asset_cache import AssetCache
from physgen.pipeline.cache_keys import key, motion_key
from physgen.problems import InputError, Limit, Place, Problem
from physgen.progress import Progress, silent
from physgen.report.record import file_hash
from physgen.scene.load import OpenedScene
from physgen.scene.load import load as load_scene
from physgen.scene.scene import SPRINGS, Solid
from physgen.text import quoted

if TYPE_CHECKING:
    from physgen.compile.compile import CompiledScene
    from physgen.compile.shapes import Shapes
    from physgen.compile.world import World
    from physgen.geometry.polygon import Outline
    from physgen.maps import F32, U16, Percepts
    from physgen.render.camera import Shot
    from physgen.render.stage import Frame, Stage
    from physgen.scene.scene import Scene
    from physgen.simulate.engine import Running
    from physgen.simulate.trajectory import Trajectory
    from physgen.simulate.uncertainty import Ensemble

T = TypeVar("T")

FRONTAL_LIGHT = (0.0, 0.0, 1.0)
"""Direction of the light in a scene without a light: from the viewer."""

MOST_HASHES = 20_000
"""Number of files with a hash in memory."""


def load(
    path: str | Path,
    overrides: Sequence[str] = (),
    variant: str | None = None,
    allow_outside: bool = False,
) -> Scene:
    """Load a scene file with overlays and defaults. Raises InputError with every
    problem.
    """
    return load_scene(path, overrides, variant, allow_outside)


def percepts(scene: Scene) -> Percepts | None:
    """Read the photo and its maps; None for a scene without a photo.

    Raises InputError at the place of the scene that names the file.
    """
    try:
        return read_percepts(scene.image, scene.assets, scene.maps)
    except InputError as error:
        raise InputError(
            _named_in_scene(problem, scene) for problem in error.problems
        ) from None


def _named_in_scene(problem: Problem, scene: Scene) -> Problem:
    """Move a picture's problem to the line of the scene that names the picture or its
    folder.
    """
    if problem.place.file == str(scene.image):
        key = "image"
    else:
        key = "assets"
    # A scene without this key has no line to show.
    if key not in scene.places:
        return problem
    name = quoted(
        Path(
            os.path.relpath(problem.place.file, os.path.realpath(scene.folder))
        ).as_posix()
    )
    return replace(
        problem,
        place=scene.places[key],
        path=key,
        found=" ".join((name, problem.found)).strip(),
    )


def compile(scene: Scene, maps: Percepts | None) -> CompiledScene:
    """Compile a scene: outlines, centres, masses, moments and contact pairs."""
    compiled_scene = compile_scene(scene, None if maps is None else maps.labels)
    _check_springs(scene, compiled_scene.world)
    return ended(scene, compiled_scene)[0]


def _check_springs(scene: Scene, world: World) -> None:
    """Refuse springs too stiff for the engine. Raises InputError."""
    if not any(joint.kind in SPRINGS for joint in world.joints):
        return  # without springs, `check` need not import the engine

    with scene.located():
        physgen.simulate.engine.spring_parts(world)


PAUSE_SAMPLES = 21
"""Number of samples in the pause at the end: 30 a second, as frames."""


PARTS = (1.25, 2.5, 5.0)
"""Lengths of the video, s, after which the simulation looks for the end of the motion.

Most clips are much shorter than the limit.
"""
VISIBLE_MOTION = 1.0
"""Displacement, px, of any point of a body above which its motion is visible."""


def ended(
    scene: Scene, compiled_scene: CompiledScene
) -> tuple[CompiledScene, Running | None]:
    """Resolve `duration: auto`, and return the run that found the duration.

    The video ends 0.7 s after the last visible motion, and after all forces, views and
    waypoints that begin later; it takes at least 2.5 s.
    """
    if not scene.world.until_rest:
        return compiled_scene, None

    if scene.render.frames is not None:
        slow_motion = 1.0
    else:
        slow_motion = scene.render.slow
    world = compiled_scene.world
    pause = PLAYBACK.pause / slow_motion
    maximum = scene.world.duration / slow_motion
    latest_start = _latest_start(scene)
    sample_times = np.arange(0.0, maximum, pause / PAUSE_SAMPLES)
    with scene.located():
        running = physgen.simulate.engine.Running(
            replace(world, duration=maximum), sample_times
        )
    limits = []
    for part in PARTS:
        if part / slow_motion < maximum:
            limits.append(part / slow_motion)
    # Simulate in parts of growing length, and stop as soon as all objects rest for two
    # pauses.
    for limit in (*limits, maximum):
        with scene.located():
            running.advance(limit)
        last_motion = max(_last_visible_motion(world, running, limit), latest_start)
        if last_motion <= limit - 2 * pause:
            break
    shortest = PLAYBACK.shortest / slow_motion
    duration = min(max(last_motion + pause, shortest), maximum)
    times = frame_times(scene, duration)
    world = replace(world, duration=duration, times=times)
    return replace(compiled_scene, world=world), running


def _latest_start(scene: Scene) -> float:
    """Return the time, s, of the last force, view or waypoint that begins."""
    start_times = [force.start for force in scene.forces]
    start_times += [view.time for view in scene.render.camera]
    for item in scene.objects:
        start_times += [point.time for point in item.path]
    return max(start_times, default=0.0)


def _last_visible_motion(world: World, running: Running, limit: float) -> float:
    """Return the time, s, of the last motion before `limit` that the video shows."""
    times = running.times[running.times < limit]
    poses = running.trajectory().poses[: len(times)]
    reach = np.array([body.reach for body in world.bodies] or [0.0])
    # A sphere without rolling resistance spins for ever: its rotation does not count.
    has_visible_spin = []
    for body in world.bodies:
        has_visible_spin.append(body.solid is not Solid.SPHERE or body.rolling > 0)
    # Displacements from the last sample, px; a rotation moves the farthest point of
    # a body.
    displacements = np.abs(poses - poses[-1:])
    displacements[..., 2] *= reach * np.array(has_visible_spin or [False])
    # Motion outside the picture is invisible.
    is_outside = (poses[..., :2] < -reach[:, None]) | (
        poses[..., :2] > reach[:, None] + world.size
    )
    is_moving = displacements.max(axis=2, initial=0) > VISIBLE_MOTION
    is_visible = is_moving & ~is_outside.any(axis=2)
    return float(times[is_visible.any(axis=1)].max(initial=0.0))


def resolved(scene: Scene, compiled_scene: CompiledScene) -> dict[str, Any]:
    """Return the scene's data with defaults and with the resolved duration."""
    if scene.world.until_rest:
        resolved_values = {"duration": compiled_scene.world.duration}
    else:
        resolved_values = {}
    return {**scene.document, "world": {**scene.document["world"], **resolved_values}}


def lint(
    scene: Scene, compiled_scene: CompiledScene, maps: Percepts | None = None
) -> list[Problem]:
    """Return warnings about permitted but unlikely values of a scene and of its
    maps.
    """
    return lint_scene(scene, compiled_scene, maps)


def simulate(
    world: World, rate: float | None = None, progress: Progress = silent
) -> Trajectory:
    """Simulate at the video's frame times, or at `rate` samples a second from t = 0.

    Raises InputError for too many samples.
    """
    if rate is None:
        return physgen.simulate.engine.simulate(world, progress=progress)
    # Rounding must not lose the last sample.
    count = int(world.duration * rate + 1e-9) + 1
    if count * max(len(world.bodies), 1) > Limit.POSES.most:
        raise Limit.POSES.error(
            Place("--rate"), found=f"{count:,} samples of {len(world.bodies)} objects"
        )
    return physgen.simulate.engine.simulate(world, np.arange(count) / rate, progress)


def fan(
    scene: Scene,
    compiled_scene: CompiledScene,
    count: int,
    seed: int = 0,
    variant: str | None = None,
    progress: Progress = silent,
) -> Ensemble:
    """Simulate the scene `count` times with random uncertain values; see
    docs/rendering.md.

    The values of `variant`, which was applied to the scene, are certain.
    """
    with scene.located():
        return physgen.simulate.uncertainty.simulate_ensemble(
            scene, compiled_scene, count, seed, variant, progress
        )


def _layer_order(scene: Scene) -> dict[int, int]:
    """Return the layers of the objects by number, from the back to the front."""
    layers = [item.layer for item in scene.objects]
    order = sorted(range(len(layers)), key=layers.__getitem__)
    return {number: layers[number] for number in order}


def stage(scene: Scene, compiled_scene: CompiledScene, maps: Percepts | None) -> Stage:
    """Prepare the filled background and the sprites from the photo.

    A scene without a photo gets flat shapes on a plain background, at the largest scale
    of its camera. The result does not depend on the motion.
    """
    world = world_in_photo(compiled_scene.world)
    if maps is None:
        return _flat_stage(scene, world, compiled_scene.outlines)
    labels, scenery = compiled_scene.labels, compiled_scene.scenery
    # The background behind objects, and the soft borders of objects.
    coverage, background = filled(maps, labels, scenery)
    # Perception cut out doubtful regions like objects, but in this scene they belong to
    # the background.
    regions = scene.document.get("doubtful", {}).values()
    doubtful = [region["mask"] for region in regions]
    maps, coverage, background = _put_back(maps, doubtful, coverage, background, labels)
    is_absent = (maps.cut_out > 0) & (labels == 0) & ~scenery
    is_absent &= ~np.isin(maps.labels, doubtful)
    # Threads of OpenCV cost a third more CPU time, and the encoder uses the other core.
    with physgen.render.frames.single_threaded():
        shapes = compiled_scene.shapes.drawn
        world = world_as_drawn(world, shapes)
        sprites = physgen.render.sprites.cut_sprites(
            maps.rgb,
            labels,
            is_absent,
            coverage,
            background,
            _layer_order(scene),
            shapes,
            FRONTAL_LIGHT if scene.light is None else scene.light.direction,
        )
        photo_stage = physgen.render.staging.lit_stage(
            scene, world, sprites, maps, background, coverage, is_absent, labels
        )
    start_poses = photo_poses(compiled_scene.world)
    return replace(
        photo_stage, supersample=scene.render.supersample, starts=start_poses
    )


def _flat_stage(scene: Scene, world: World, outlines: Sequence[Outline]) -> Stage:
    """Draw flat shapes on a plain background, at the largest scale of the camera."""
    order = list(_layer_order(scene))
    scale = physgen.render.camera.canvas_scale(scene)
    drawing = physgen.render.flat_drawing.flat_stage(world, outlines, order, scale)
    return replace(drawing, supersample=scene.render.supersample)


def _put_back(
    maps: Percepts,
    doubtful: Sequence[object],
    coverage: F32,
    background: NDArray[np.uint8],
    labels: U16,
) -> tuple[Percepts, F32, NDArray[np.uint8]]:
    """Put the photo back at doubtful regions, which perception cut out as objects.

    Returns maps, coverage and background; `doubtful` are ids in masks.png.
    """
    if not doubtful:
        return maps, coverage, background
    flat_labels = maps.labels.ravel()
    # A region counts as cut out if the stored coverage contains most of its pixels.
    # The first sum is the coverage of each id, the second its number of pixels.
    cut_out_ids = np.flatnonzero(
        np.bincount(flat_labels, coverage.ravel()) > 0.75 * np.bincount(flat_labels)
    )
    restored_pixels = dilate(
        np.isin(maps.labels, [i for i in cut_out_ids if i in doubtful]), 10
    ) & ~dilate(labels > 0, 3)
    if not restored_pixels.any():
        return maps, coverage, background
    restored_channels = restored_pixels[..., None]
    clean_photo = None
    if maps.clean is not None:
        clean_photo = np.where(restored_channels, maps.rgb, maps.clean)
    coverage = np.where(restored_pixels, np.float32(0), coverage)
    background = np.where(restored_channels, maps.rgb, background)
    return replace(maps, clean=clean_photo), coverage, background


def filled(
    maps: Percepts, labels: NDArray[np.uint16], scenery: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return coverage and background: stored, or computed if missing or from other
    masks.

    `scenery` are the pixels of boundaries, which stored maps may contain as objects.
    """
    has_same_masks = maps_cover_masks(maps, labels, scenery)
    if has_same_masks and maps.coverage is not None and maps.background is not None:
        return maps.coverage, maps.background

    # Objects of the photo that the scene leaves out are also removed from the
    # background.
    union = np.where(labels > 0, labels, np.where(scenery, np.uint16(0), maps.cut_out))
    coverage = maps.coverage
    if coverage is None or not has_same_masks:
        coverage = registry.make("matte")(maps.rgb, union)
    return coverage, fill_behind(maps.rgb, coverage > 0, registry.make("inpaint"))


def shot(scene: Scene, trajectory: Trajectory) -> Shot:
    """Return the camera and the playing order of the scene's clip.

    `trajectory` has one sample per frame.
    """
    return physgen.render.camera.shot_of(scene, trajectory)


def render(
    stage: Stage, trajectory: Trajectory, parts: int = 1, shot: Shot | None = None
) -> Iterator[Frame]:
    """Yield frames, one at a time, each exposed over `parts` samples in linear light.

    Without the shot `shot`, the whole canvas is shown and played forwards. If its
    camera moves, an exposure is the mean of four views, if `parts` is divisible by
    four, else of one view per sample.
    """
    if shot is None:
        return physgen.render.frames.render_frames(stage, trajectory, parts=parts)
    samples = shot.samples(parts)
    # The camera also moves while the shutter is open: an object that it follows stays
    # sharp, and the background is blurred.
    if parts > 1 and shot.moves:
        if parts % physgen.render.camera.FEWEST:
            samples_per_view = 1
        else:
            samples_per_view = parts // physgen.render.camera.FEWEST
        poses_in_view = physgen.render.camera.ways_seen(
            trajectory, shot, samples_per_view
        )
        frames = physgen.render.frames.render_frames(
            stage, trajectory, samples, samples_per_view, poses_in_view
        )
        return physgen.render.camera.mean_exposures(
            physgen.render.camera.film_frames(frames, shot, stage.scale),
            parts // samples_per_view,
        )
    return physgen.render.camera.film_frames(
        physgen.render.frames.render_frames(stage, trajectory, samples, parts),
        shot,
        stage.scale,
    )


class Keep(Enum):
    """The results that `Stages` keeps."""

    RESULTS = "results"
    """The latest results of each stage."""
    EDITING = "editing"
    """The same, and the maps of one photo of any size before and after an edit."""
    NOTHING = "nothing"
    """No results, for a single clip: memory is free for drawing."""


class Recent(Generic[T]):
    """The latest results by key; the oldest is released before a new one is
    computed.
    """

    def __init__(self, limit: int) -> None:
        self._most = limit
        self._kept: dict[object, T] = {}

    def forget(self, key: object) -> None:
        """Remove a result."""
        self._kept.pop(key, None)

    def get(self, key: object) -> T | None:
        """Return an earlier result, or None."""
        if key in self._kept:
            self._kept[key] = self._kept.pop(key)
        return self._kept.get(key)

    def of(self, key: object, make: Callable[[], T]) -> T:
        """Return an earlier result, or compute it."""
        if key in self._kept:
            result = self._kept[key] = self._kept.pop(key)
            return result
        # Release before computing: results can be as large as the memory permits.
        while len(self._kept) >= max(self._most, 1):
            del self._kept[next(iter(self._kept))]
        new_result = make()
        if self._most:
            self._kept[key] = new_result
        return new_result


@dataclass(frozen=True)
class Maps:
    """A photo with its maps, the key of their files, and time stamps from before the
    reading.
    """

    percepts: Percepts | None
    """The maps; None for a scene without a photo."""
    key: str
    stamps: tuple[tuple[Path, Stamp], ...] = ()
    has_noise: bool = True
    """Whether the maps contain the photo's own noise."""

    @property
    def is_large(self) -> bool:
        """Check whether the photo is too large to stay in memory."""
        maps = self.percepts
        return maps is not None and maps.labels.size > MOST_PIXELS


class Stages:
    """The stages above; each runs only for new inputs."""

    def __init__(
        self, keep: Keep = Keep.RESULTS, *, reads_assets_cache: bool = False
    ) -> None:
        """Create stages without results.

        `reads_assets_cache`: results may come from the cache in the assets folder.
        """
        self._reads_cache = reads_assets_cache
        self._cached: set[Path] = set()
        """Assets folders with a stage written by this process."""
        if keep is Keep.NOTHING:
            few = 0
        else:
            few = 4
        self._editing = keep is Keep.EDITING
        # Maps and stages take the most memory; opened files and shapes are small.
        self._opened: Recent[OpenedScene] = Recent(few)
        self._maps: Recent[Maps] = Recent(2 if self._editing else min(few, 1))
        self._shapes: Recent[Shapes] = Recent(few)
        self._stages: Recent[Stage] = Recent(min(few, 1))
        self._motions: Recent[Trajectory] = Recent(1)  # with the steps of its run
        self._hashes: dict[Path, tuple[Stamp, str]] = {}

    def load(
        self,
        path: str | Path,
        overrides: Sequence[str],
        variant: str | None,
        allow_outside: bool,
    ) -> Scene:
        """Load a scene like `load`, from a parsed and unchanged file."""
        name = str(path)
        cache_key = (os.getcwd(), name, allow_outside)
        scene_file = self._opened.of(
            cache_key, lambda: OpenedScene(name, allow_outside)
        )
        # The file may have changed on disk since it was opened: read it again once.
        if scene_file.stale():
            self._opened.forget(cache_key)
            scene_file = self._opened.of(
                cache_key, lambda: OpenedScene(name, allow_outside)
            )
        return scene_file.scene(overrides, variant)

    def maps(self, scene: Scene) -> Maps:
        """Read the maps of a scene like `percepts`, with the key of their files."""
        if scene.image is None:
            files = []
        else:
            files = [scene.image]
        if scene.image is not None and scene.assets is not None:
            files += sorted(scene.assets.glob("*.png"))
        stamps = tuple((file, file_stamp(file)) for file in files)
        cache_key = key(
            "percepts",
            [(str(file), *stamp) for file, stamp in stamps],
            dict(scene.maps),
        )
        width, height = scene.size
        # The maps of a large photo would fill the memory: they are not kept.
        if width * height > MOST_PIXELS and not self._editing:
            return Maps(percepts(scene), cache_key, stamps)
        return self._maps.of(
            cache_key, lambda: Maps(self._percepts(scene, files), cache_key, stamps)
        )

    def _percepts(self, scene: Scene, files: Sequence[Path]) -> Percepts | None:
        """Read the photo and its maps, from the cache in its assets folder if
        possible.
        """
        cache = self._assets_cache(scene)
        cached_maps = None
        if cache is not None:
            cached_maps = cache.load_percepts(files, self.hash, scene.maps)
        if cached_maps is None:
            return percepts(scene)
        return cached_maps

    def _assets_cache(self, scene: Scene) -> AssetCache | None:
        """Return the cache in a scene's assets folder, if it exists and may be read."""
        if not self._reads_cache:
            return None

        cache = AssetCache(scene.assets)
        if cache.exists:
            return cache
        return None

    def compile(self, scene: Scene, maps: Maps) -> CompiledScene:
        """Compile a scene like `compile`, with known outlines if its masks have not
        changed.
        """
        check_steps(scene)
        labels = None
        if maps.percepts is not None:
            labels = maps.percepts.labels
        objects = [(item.mask, item.shape, item.layer) for item in scene.objects]
        masks = [item.mask for item in scene.boundaries]
        cache_key = key("shapes", maps.key, scene.size, objects, masks)
        shapes = self._shapes.of(cache_key, lambda: shapes_of(scene, labels))
        compiled_scene, run = ended(scene, compile_shapes(scene, shapes))
        # The run that found the duration has simulated the motion already.
        if run is not None:
            world = compiled_scene.world
            self._motions.of(motion_key(world), lambda: run.resample(world.times))
        return compiled_scene

    def stage(self, scene: Scene, compiled_scene: CompiledScene, maps: Maps) -> Stage:
        """Prepare the stage of a scene like `stage`, or return a known one."""
        if maps.percepts is None:
            drawn_outlines = compiled_scene.outlines
        else:
            drawn_outlines = ()
        visible_properties = appearance(scene, compiled_scene.world)
        labels = [item.label for item in scene.objects]
        doubtful = scene.document.get("doubtful", {})
        inputs = (
            *(dict(scene.maps), labels, doubtful, *visible_properties),
            *(compiled_scene.labels, compiled_scene.scenery, drawn_outlines),
            maps.has_noise,
        )
        cache_key = key("stage", maps.key, *inputs)
        known_stage = self._stages.of(
            cache_key, lambda: self._stage(scene, compiled_scene, maps, inputs)
        )
        # The poses at the start of the motion do not change the sprites.
        return replace(known_stage, starts=photo_poses(compiled_scene.world))

    def _stage(
        self,
        scene: Scene,
        compiled_scene: CompiledScene,
        maps: Maps,
        depends: Sequence[Any],
    ) -> Stage:
        """Prepare a stage, or load it from the cache in the assets folder.

        `depends` are all inputs except the photo and the maps.
        """
        cache = None if maps.is_large else self._assets_cache(scene)
        if cache is None or scene.assets is None:
            return stage(scene, compiled_scene, maps.percepts)
        files = [file for file, _ in maps.stamps]
        try:
            entry = cache.entry("stage", files, self.hash, *depends)
        except OSError:
            return stage(scene, compiled_scene, maps.percepts)
        cached_stage = cache.load_stage(entry)
        if cached_stage is not None:
            return cached_stage
        new_stage = stage(scene, compiled_scene, maps.percepts)
        # A file that changed while the stage was prepared would make the entry wrong.
        # Each process writes one stage per folder, so that variants do not replace each
        # other's all the time.
        is_current = all(file_stamp(file) == stamp for file, stamp in maps.stamps)
        if is_current and scene.assets not in self._cached:
            self._cached.add(scene.assets)
            cache.save(entry, new_stage)
        return new_stage

    def simulate(self, world: World, progress: Progress = silent) -> Trajectory:
        """Simulate like `simulate` at frame times, or return a known motion."""
        return self._motions.of(
            motion_key(world), lambda: simulate(world, progress=progress)
        )

    def hash(self, file: Path) -> str:
        """Return the SHA-256 of a file, computed again only after a change. Raises
        OSError.
        """
        stamp = file_stamp(file)
        entry = self._hashes.get(file)
        if entry is None or entry[0] != stamp:
            if len(self._hashes) >= MOST_HASHES:
                self._hashes.clear()
            entry = self._hashes[file] = stamp, file_hash(file)
        return entry[1]
