"""The stages from a scene file to frames: one function per stage, top-down, and the same with memory.

`Stages` keeps results in this process from one clip to the next, for as long as their inputs are the same: scenes that
differ in a force, a mass or a light share the parsed file, the photo's maps and the sprites. `Film` draws the frames of
one scene.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from physgen.files import MOST_PIXELS, Stamp, file_stamp
from physgen.problems import InputError, Limit, Place, Problem
from physgen.progress import Progress, silent
from physgen.text import quoted

if TYPE_CHECKING:
    from physgen.compile.compile import Compiled
    from physgen.compile.shapes import Shapes
    from physgen.compile.world import World
    from physgen.maps import F32, U16, Percepts
    from physgen.pipeline.asset_cache import AssetCache
    from physgen.render.camera import Shot
    from physgen.render.grain import Delivery
    from physgen.render.squash import Squashes
    from physgen.render.stage import Frame, Stage
    from physgen.render.striker import StruckScene
    from physgen.report.record import RunRecord
    from physgen.scene.load import Opened
    from physgen.scene.scene import Scene
    from physgen.simulate.engine import Running
    from physgen.simulate.trajectory import Trajectory
    from physgen.simulate.uncertainty import Ensemble

T = TypeVar("T")

MOST_HASHES = 20_000
"""Files whose hashes are remembered."""


def load(
    path: str | Path,
    overrides: Sequence[str] = (),
    variant: str | None = None,
    allow_outside: bool = False,
) -> Scene:
    """Scene file -> Scene, overlays applied and defaults filled in. Raises InputError with every problem."""
    from physgen.scene.load import load as load_scene

    return load_scene(path, overrides, variant, allow_outside)


def percepts(scene: Scene) -> Percepts | None:
    """The photo and its maps; None for a scene without a photo. Raises InputError at the place that names them."""
    from physgen.maps import read_percepts

    try:
        return read_percepts(scene.image, scene.assets, scene.maps)
    except InputError as error:
        raise InputError(
            _named_in_scene(problem, scene) for problem in error.problems
        ) from None


def _named_in_scene(problem: Problem, scene: Scene) -> Problem:
    """A problem of a picture, at the line of the scene that names the picture or its folder."""
    key = "image" if problem.place.file == str(scene.image) else "assets"
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


def compile(scene: Scene, maps: Percepts | None) -> Compiled:
    """Outlines, centres, masses, moments and pairs, resolved."""
    from physgen.compile.compile import compile_scene

    compiled = compile_scene(scene, None if maps is None else maps.labels)
    _check_springs(scene, compiled.world)
    return ended(scene, compiled)[0]


def _check_springs(scene: Scene, world: World) -> None:
    """Refuse springs that are too stiff for the engine. Raises InputError."""
    from physgen.scene.scene import SPRINGS

    if not any(joint.kind in SPRINGS for joint in world.joints):
        return  # `check` stays quick without the engine
    from physgen.simulate.engine import spring_parts

    with scene.located():
        spring_parts(world)


PAUSE_SAMPLES = 21
"""Times in the pause at the end at which motion is looked for: a frame of 30 a second."""


def ended(scene: Scene, compiled: Compiled) -> tuple[Compiled, Running | None]:
    """The same with `duration: auto` resolved: 0.7 s of video after the last motion that shows, and after forces,
    views and waypoints that begin later, 2.5 s at least. And the run that found it.
    """
    if not scene.world.until_rest:
        return compiled, None
    from physgen.compile.compile import frame_times
    from physgen.geometry.scale import PLAYBACK
    from physgen.scene.scene import Solid
    from physgen.simulate.engine import Running

    slow = 1.0 if scene.render.frames is not None else scene.render.slow
    world, pause, most = (
        compiled.world,
        PLAYBACK.pause / slow,
        scene.world.duration / slow,
    )
    reach = np.array([body.reach for body in world.bodies] or [0.0])
    ends = [
        body.solid is not Solid.SPHERE or body.rolling > 0 for body in world.bodies
    ]  # other spins go on for ever
    begins = [force.start for force in scene.forces] + [
        sight.time for sight in scene.render.camera
    ]
    latest = max(
        begins + [point.time for item in scene.objects for point in item.path],
        default=0.0,
    )
    with scene.located():
        run = Running(
            replace(world, duration=most), np.arange(0.0, most, pause / PAUSE_SAMPLES)
        )
    for length in (
        *(part / slow for part in (1.25, 2.5, 5.0) if part / slow < most),
        most,
    ):
        with scene.located():
            run.on(length)
        times = run.times[run.times < length]
        poses = run.trajectory().poses[: len(times)]
        off = np.abs(poses - poses[-1:]) * np.array([1.0, 1.0, 0.0])
        off[..., 2] = (
            np.abs(poses[..., 2] - poses[-1:, :, 2]) * reach * np.array(ends or [False])
        )
        out = (poses[..., :2] < -reach[:, None]) | (
            poses[..., :2] > reach[:, None] + world.size
        )
        moving = (off.max(axis=2, initial=0) > 1) & ~out.any(axis=2)
        last = max(float(times[moving.any(axis=1)].max(initial=0.0)), latest)
        if last <= length - 2 * pause:
            break
    end = min(max(last + pause, PLAYBACK.shortest / slow), most)
    return replace(
        compiled, world=replace(world, duration=end, times=frame_times(scene, end))
    ), run


def resolved(scene: Scene, compiled: Compiled) -> dict[str, Any]:
    """The scene's data with defaults, and the duration that `auto` comes to."""
    fixed = {"duration": compiled.world.duration} if scene.world.until_rest else {}
    return {**scene.document, "world": {**scene.document["world"], **fixed}}


def lint(
    scene: Scene, compiled: Compiled, maps: Percepts | None = None
) -> list[Problem]:
    """What is allowed and probably not meant; with the photo's `maps`, of them too."""
    from physgen.compile.warnings import lint as lint_scene

    return lint_scene(scene, compiled, maps)


def simulate(
    world: World, rate: float | None = None, progress: Progress = silent
) -> Trajectory:
    """Motion at the video's frame times, or from t = 0 to the end at `rate` samples a second."""
    from physgen.simulate.engine import simulate as run

    if rate is None:
        return run(world, progress=progress)
    count = int(world.duration * rate + 1e-9) + 1
    if count * max(len(world.bodies), 1) > Limit.POSES.most:
        raise Limit.POSES.error(
            Place("--rate"), found=f"{count:,} samples of {len(world.bodies)} objects"
        )
    return run(world, np.arange(count) / rate, progress)


def fan(
    scene: Scene,
    compiled: Compiled,
    count: int,
    seed: int = 0,
    variant: str | None = None,
    progress: Progress = silent,
) -> Ensemble:
    """The scene simulated `count` times, uncertain values drawn anew each time; see docs/rendering.md.

    `variant` is the one that was applied to the scene: the values that it sets are certain.
    """
    from physgen.simulate.uncertainty import simulate_ensemble as draw

    with scene.located():
        return draw(scene, compiled, count, seed, variant, progress)


def stage(scene: Scene, compiled: Compiled, maps: Percepts | None) -> Stage:
    """The filled background and the objects cut out of the photo, or flat shapes on a plain background.

    Flat shapes are drawn as large as `render` shows them at most. Depends on nothing that only shows in motion.
    """
    from physgen.compile.world import photo_poses, world_as_drawn, world_in_photo
    from physgen.render.camera import canvas_scale
    from physgen.render.frames import single_threaded
    from physgen.render.sprites import cut_sprites
    from physgen.render.stage import Stage
    from physgen.render.staging import (
        enlarged_world,
        flat_background,
        flat_sprites,
        lit_stage,
    )

    begin = photo_poses(compiled.world)
    world = world_in_photo(compiled.world)
    layers = [item.layer for item in scene.objects]
    order = {k: layers[k] for k in sorted(range(len(layers)), key=layers.__getitem__)}
    fine = scene.render.supersample
    if maps is None:
        large = canvas_scale(scene)
        world, outlines = enlarged_world(world, compiled.outlines, large)
        sprites = flat_sprites(world, outlines, list(order), large)
        return Stage(
            flat_background(world, large), sprites, supersample=fine, scale=large
        )
    coverage, background = filled(maps, compiled.labels, compiled.scenery)
    doubtful = [one["mask"] for one in scene.document.get("doubtful", {}).values()]
    maps, coverage, background = _put_back(
        maps, doubtful, coverage, background, compiled.labels
    )
    absent = (
        (maps.cut_out > 0)
        & (compiled.labels == 0)
        & ~compiled.scenery
        & ~np.isin(maps.labels, doubtful)
    )
    with single_threaded():
        shapes = compiled.shapes.drawn
        world = world_as_drawn(world, shapes)
        toward = (0.0, 0.0, 1.0) if scene.light is None else scene.light.direction
        sprites = cut_sprites(
            maps.rgb,
            compiled.labels,
            absent,
            coverage,
            background,
            order,
            shapes,
            toward,
        )
        made = lit_stage(scene, world, sprites, maps, background, coverage, absent)
    return replace(made, supersample=fine, starts=begin)


def _put_back(
    maps: Percepts,
    doubtful: Sequence[object],
    coverage: F32,
    background: NDArray[np.uint8],
    labels: U16,
) -> tuple[Percepts, F32, NDArray[np.uint8]]:
    """Maps, coverage and background with the photo where `doubtful` ids were cut out as objects: they are none."""
    from physgen.perceive.inpaint.poisson import dilate

    if not doubtful:
        return maps, coverage, background
    flat = maps.labels.ravel()
    whole = np.flatnonzero(
        np.bincount(flat, coverage.ravel()) > 0.75 * np.bincount(flat)
    )
    there = dilate(
        np.isin(maps.labels, [i for i in whole if i in doubtful]), 10
    ) & ~dilate(labels > 0, 3)
    if not there.any():
        return maps, coverage, background
    shown = there[..., None]
    clean = None if maps.clean is None else np.where(shown, maps.rgb, maps.clean)
    coverage, background = (
        np.where(there, np.float32(0), coverage),
        np.where(shown, maps.rgb, background),
    )
    return replace(maps, clean=clean), coverage, background


def filled(
    maps: Percepts, labels: NDArray[np.uint16], scenery: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Coverage and background: stored, or computed where they are missing or made for other masks.

    `scenery` are the pixels of boundaries, which the stored maps may have taken for objects.
    """
    from physgen.compile.warnings import maps_cover_masks

    known = maps_cover_masks(maps, labels, scenery)
    if known and maps.coverage is not None and maps.background is not None:
        return maps.coverage, maps.background
    from physgen import registry
    from physgen.perceive.inpaint.poisson import fill_behind

    union = np.where(labels > 0, labels, np.where(scenery, np.uint16(0), maps.cut_out))
    coverage = maps.coverage
    if coverage is None or not known:
        coverage = registry.make("matte")(maps.rgb, union)
    return coverage, fill_behind(maps.rgb, coverage > 0, registry.make("inpaint"))


def shot(scene: Scene, trajectory: Trajectory) -> Shot:
    """How the scene's clip is filmed and played; `trajectory` has one sample a frame."""
    from physgen.render.camera import shot_of as take

    return take(scene, trajectory)


def render(
    drawn: Stage, trajectory: Trajectory, parts: int = 1, through: Shot | None = None
) -> Iterator[Frame]:
    """Frames, one at a time; each an exposure of `parts` samples: what moves is smeared, in linear light.

    `through` is a shot: without one, all of the canvas is seen and played forward. Where its camera moves, an exposure
    is the mean of four views, if `parts` is divisible by that, else of as many as it has samples.
    """
    from physgen.render.camera import FEWEST, filmed, mean_exposures, ways_seen
    from physgen.render.frames import render_frames

    if through is None:
        return render_frames(drawn, trajectory, parts=parts)
    samples = through.samples(parts)
    if (
        parts > 1 and through.moves
    ):  # while the shutter is open, too: what the camera follows stays sharp
        few = 1 if parts % FEWEST else parts // FEWEST
        ways = ways_seen(trajectory, through, few)
        frames = render_frames(drawn, trajectory, samples, few, ways)
        return mean_exposures(filmed(frames, through, drawn.scale), parts // few)
    return filmed(
        render_frames(drawn, trajectory, samples, parts), through, drawn.scale
    )


class Keep(Enum):
    """Which results `Stages` keeps."""

    RESULTS = "results"
    """The last few of each stage."""
    EDITING = "editing"
    """The same, and the maps of one photo of any size, now and before an edit."""
    NOTHING = "nothing"
    """None, for a single clip: memory is free for drawing."""


class Recent(Generic[T]):
    """The last few results, by key; the oldest is released before a new one is made."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: dict[object, T] = {}

    def forget(self, key: object) -> None:
        """Drop a result."""
        self._kept.pop(key, None)

    def get(self, key: object) -> T | None:
        """A result made before, or None."""
        if key in self._kept:
            self._kept[key] = self._kept.pop(key)
        return self._kept.get(key)

    def of(self, key: object, make: Callable[[], T]) -> T:
        """A result made before, or now."""
        if key in self._kept:
            found = self._kept[key] = self._kept.pop(key)
            return found
        while len(self._kept) >= max(self._most, 1):
            del self._kept[next(iter(self._kept))]
        made = make()
        if self._most:
            self._kept[key] = made
        return made


@dataclass(frozen=True)
class Maps:
    """A photo with its maps, the key of their files, and the time stamps of the files before they were read."""

    percepts: Percepts | None
    """None for a scene without a photo."""
    key: str
    stamps: tuple[tuple[Path, Stamp], ...] = ()
    has_noise: bool = True
    """Whether the maps have the photo's own noise."""

    @property
    def is_large(self) -> bool:
        """Return whether the photo is too large to stay in memory."""
        maps = self.percepts
        return maps is not None and maps.labels.size > MOST_PIXELS


class Stages:
    """The stages above, each run only where its result is not known."""

    def __init__(
        self, keep: Keep = Keep.RESULTS, *, reads_assets_cache: bool = False
    ) -> None:
        """`reads_assets_cache`: results may come from the cache in the assets folder."""
        self._reads_cache = reads_assets_cache
        self._cached: set[Path] = set()
        """Assets folders to whose cache this process added a stage."""
        few = 0 if keep is Keep.NOTHING else 4
        self._editing = keep is Keep.EDITING
        self._opened: Recent[Opened] = Recent(few)
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
        """See `load`."""
        from physgen.scene.load import Opened

        name = str(path)
        read = (os.getcwd(), name, allow_outside)
        opened = self._opened.of(read, lambda: Opened(name, allow_outside))
        if opened.stale():
            self._opened.forget(read)
            opened = self._opened.of(read, lambda: Opened(name, allow_outside))
        return opened.scene(overrides, variant)

    def maps(self, scene: Scene) -> Maps:
        """See `percepts`."""
        from physgen.pipeline.cache_keys import key

        files = [] if scene.image is None else [scene.image]
        if scene.image is not None and scene.assets is not None:
            files += sorted(scene.assets.glob("*.png"))
        stamps = tuple((file, file_stamp(file)) for file in files)
        read = key(
            "percepts",
            [(str(file), *stamp) for file, stamp in stamps],
            dict(scene.maps),
        )
        width, height = scene.size
        if width * height > MOST_PIXELS and not self._editing:
            return Maps(percepts(scene), read, stamps)
        return self._maps.of(
            read, lambda: Maps(self._percepts(scene, files), read, stamps)
        )

    def _percepts(self, scene: Scene, files: Sequence[Path]) -> Percepts | None:
        """Return the photo and its maps, from the cache in its assets folder if it has them."""
        cache = self._assets_cache(scene)
        cached = None
        if cache is not None:
            cached = cache.load_percepts(files, self.hash, scene.maps)
        return percepts(scene) if cached is None else cached

    def _assets_cache(self, scene: Scene) -> AssetCache | None:
        """Return the cache in a scene's assets folder, if it has one that may be read."""
        if not self._reads_cache:
            return None
        from physgen.pipeline.asset_cache import AssetCache

        cache = AssetCache(scene.assets)
        return cache if cache.exists else None

    def compile(self, scene: Scene, maps: Maps) -> Compiled:
        """See `compile`."""
        from physgen.compile.compile import check_steps, compile_shapes
        from physgen.compile.shapes import shapes_of
        from physgen.pipeline.cache_keys import key, motion_key

        check_steps(scene)
        labels = None if maps.percepts is None else maps.percepts.labels
        objects = [(item.mask, item.shape, item.layer) for item in scene.objects]
        masks = [item.mask for item in scene.boundaries]
        read = key("shapes", maps.key, scene.size, objects, masks)
        shapes = self._shapes.of(read, lambda: shapes_of(scene, labels))
        compiled, run = ended(scene, compile_shapes(scene, shapes))
        if run is not None:
            world = compiled.world
            self._motions.of(motion_key(world), lambda: run.sampled(world.times))
        return compiled

    def stage(self, scene: Scene, compiled: Compiled, maps: Maps) -> Stage:
        """See `stage`."""
        from physgen.compile.world import appearance, photo_poses
        from physgen.pipeline.cache_keys import key

        drawn = compiled.outlines if maps.percepts is None else ()
        seen = appearance(scene, compiled.world)
        labels = [item.label for item in scene.objects]
        doubtful = scene.document.get("doubtful", {})
        depends = (
            *(dict(scene.maps), labels, doubtful, *seen),
            *(compiled.labels, compiled.scenery, drawn),
            maps.has_noise,
        )
        read = key("stage", maps.key, *depends)
        made = self._stages.of(
            read, lambda: self._stage(scene, compiled, maps, depends)
        )
        return replace(
            made, starts=photo_poses(compiled.world)
        )  # objects may have been moved since

    def _stage(
        self, scene: Scene, compiled: Compiled, maps: Maps, depends: Sequence[Any]
    ) -> Stage:
        """Return a stage, from the cache in the assets folder if it has it.

        `depends` is what it depends on beside the photo and the maps.
        """
        cache = None if maps.is_large else self._assets_cache(scene)
        if cache is None or scene.assets is None:
            return stage(scene, compiled, maps.percepts)
        files = [file for file, _ in maps.stamps]
        try:
            entry = cache.entry("stage", files, self.hash, *depends)
        except OSError:
            return stage(scene, compiled, maps.percepts)
        cached = cache.load_stage(entry)
        if cached is not None:
            return cached
        made = stage(scene, compiled, maps.percepts)
        is_current = all(file_stamp(file) == stamp for file, stamp in maps.stamps)
        if is_current and scene.assets not in self._cached:
            self._cached.add(scene.assets)
            cache.save(entry, made)
        return made

    def simulate(self, world: World, progress: Progress = silent) -> Trajectory:
        """See `simulate`."""
        from physgen.pipeline.cache_keys import motion_key

        return self._motions.of(
            motion_key(world), lambda: simulate(world, progress=progress)
        )

    def hash(self, file: Path) -> str:
        """SHA-256 of a file, computed once while the file does not change. Raises OSError."""
        from physgen.report.record import file_hash

        stamp = file_stamp(file)
        known = self._hashes.get(file)
        if known is None or known[0] != stamp:
            if len(self._hashes) >= MOST_HASHES:
                self._hashes.clear()
            known = self._hashes[file] = stamp, file_hash(file)
        return known[1]


class Aside:
    """Threads that work while the run goes on; whoever waits for one counts the wall time.

    With the maps of a large photo nothing is done at once with anything else, for memory.
    """

    def __init__(self, record: RunRecord, size: tuple[int, int]) -> None:
        """`size` of the photo, px."""
        self._record, self._large = record, size[0] * size[1] > MOST_PIXELS
        self._threads: list[Thread] = []

    def start(self, stage: str, work: Callable[[], T]) -> Callable[[], T]:
        """Does `work` in a thread, whose CPU time counts to a stage; a function that waits for the result."""
        from physgen.report.record import StageTime

        done: Future[T] = Future()
        if self._large:
            with self._record.stage(stage, time.thread_time):
                done.set_result(work())
            return done.result

        def run() -> None:
            try:
                found = work()
            except BaseException as error:
                done.set_exception(error)
                return
            self._record.stages.setdefault(stage, StageTime()).cpu += time.thread_time()
            done.set_result(found)

        self._threads.append(
            Thread(target=run, name=stage, daemon=True)
        )  # a second Ctrl-C waits for none
        self._threads[-1].start()
        return done.result

    def join(self) -> None:
        """Wait for all, whose results nobody needs any more."""
        for thread in self._threads:
            thread.join()


class Film:
    """Draws the frames of one scene; sprites are cut out when first needed, and the maps are then released."""

    def __init__(
        self,
        scene: Scene,
        compiled: Compiled,
        maps: Maps,
        record: RunRecord,
        stages: Stages,
    ) -> None:
        self.scene, self.compiled = scene, compiled
        self.keeps_layers = False
        """Whether frames can be taken apart."""
        self._delivery: Delivery | None = None
        self._maps: Maps | None = maps
        self._record, self._stages = record, stages
        self._fine: tuple[Trajectory, Trajectory, int] | None = None
        """Of a trajectory: the samples at which its frames are exposed, and how many a frame has."""

    def simulated(self, progress: Progress) -> Trajectory:
        """The motion, a sample a frame."""
        stage = self._record.stage("simulate", time.thread_time)
        with stage, self.scene.located():
            return self._stages.simulate(self.compiled.world, progress)

    @cached_property
    def stage(self) -> Stage:
        """The sprites and the background."""
        with self._record.stage("cut out", time.thread_time):
            assert self._maps is not None
            maps = self._clean_maps(self._maps)
            made = self._stages.stage(self.scene, self.compiled, maps)
        self._maps = None
        return made

    def _clean_maps(self, maps: Maps) -> Maps:
        """Return the maps without the photo's noise if frames get noise of their own."""
        photo = maps.percepts
        if self._delivery is None or photo is None or self._delivery.grain is None:
            return maps
        clean = self._delivery.remove_noise(photo)
        return replace(maps, percepts=clean, has_noise=False)

    def deliver(self) -> dict[str, Any]:
        """Let the video have hold and noise as the scene asks, for the manifest.

        Call it before a frame is drawn.
        """
        from physgen.render.grain import Delivery

        photo = None if self._maps is None else self._maps.percepts
        rgb = None if photo is None else photo.rgb
        self._delivery = Delivery.of(self.scene.render, rgb)
        return self._delivery.as_dict()

    def count(self, trajectory: Trajectory) -> int:
        """Return the number of the video's frames."""
        return len(self.shot(trajectory).order) + self.hold

    @property
    def hold(self) -> int:
        """Frames of the photo before the motion."""
        return 0 if self._delivery is None else self._delivery.hold

    def deliver_frames(
        self, frames: Iterator[Frame], trajectory: Trajectory
    ) -> Iterator[Frame]:
        """Yield the video's frames: with hold, noise and overlays."""
        if self._delivery is not None:
            frames = self._delivery.deliver_frames(frames, self.shot(trajectory))
        return self.annotated(frames, trajectory)

    def shot(self, trajectory: Trajectory) -> Shot:
        """Camera and playing order; `trajectory` has one sample a frame."""
        return shot(self.scene, trajectory)

    def frames(
        self,
        trajectory: Trajectory,
        order: Sequence[int] | None = None,
        matte: bool = False,
    ) -> Iterator[Frame]:
        """Frames in playing order, or of the samples in `order`; as a `matte`, the coverage of objects as light."""
        from physgen.render.staging import matte_stage

        through = self.shot(trajectory)
        if order is not None:
            through = replace(through, order=tuple(order))
        fine, parts = self.exposed(trajectory)
        stage = replace(
            self.stage,
            keeps_layers=self.keeps_layers,
            squashes=self._squashes(trajectory),
        )
        if order is None and not matte:
            struck = self._struck(stage, (fine, parts), through)
            if struck is not None:
                return render(struck.stage, struck.trajectory, parts, struck.shot)
        return render(matte_stage(stage) if matte else stage, fine, parts, through)

    def _struck(
        self, stage: Stage, exposed: tuple[Trajectory, int], through: Shot
    ) -> StruckScene | None:
        """Return the scene with what comes in and pushes; None if nothing does."""
        from physgen.render.striker import with_strikers
        from physgen.scene.scene import Striker

        delivery = self._delivery
        if delivery is None or delivery.enter is Striker.NONE:
            return None
        world, hold = self.compiled.world, delivery.hold
        struck = with_strikers(stage, world, delivery.enter, exposed, through, hold)
        delivery.draws_hold = struck is not None
        return struck

    def _squashes(self, trajectory: Trajectory) -> Squashes | None:
        """Return the soft bodies that impacts flatten, in a delivered video that asks for it."""
        if self._delivery is None or not self._delivery.squash:
            return None
        from physgen.render.squash import find_squashes

        labels = [item.label for item in self.scene.objects]
        return find_squashes(self.compiled.world, labels, trajectory)

    def exposed(self, trajectory: Trajectory) -> tuple[Trajectory, int]:
        """Samples for motion blur, and how many a frame has."""
        from physgen.render.camera import exposure_times

        if self._fine is None or self._fine[0] is not trajectory:
            moments, parts = exposure_times(
                trajectory, self.compiled.world, self.scene.render.motion_blur
            )
            fine = trajectory
            if parts > 1:
                with self._record.stage("expose", time.thread_time):
                    fine = trajectory.sampled(moments)
            self._fine = trajectory, fine, parts
        return self._fine[1:]

    def annotated(
        self, frames: Iterator[Frame], trajectory: Trajectory
    ) -> Iterator[Frame]:
        """Frames with the scene's overlays."""
        kinds = self.scene.render.overlay
        if not kinds:
            return frames
        from physgen.render.overlay import annotate_frames

        through = self.shot(trajectory)
        return annotate_frames(
            frames,
            self.compiled.world,
            trajectory,
            kinds,
            lambda frame: through.affine(frame.time),
        )
