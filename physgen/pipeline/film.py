"""The frames of a clip: simulation and drawing side by side, held frames and noise."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import replace
from functools import cached_property
from threading import Thread
from typing import TYPE_CHECKING, Any

from physgen.files import MOST_PIXELS
from physgen.geometry.polygon import Pose
from physgen.progress import Progress
from physgen.render.camera import blur_first_frame, exposure_times
from physgen.render.grain import Delivery
from physgen.render.mattes import matte_stage
from physgen.render.overlay import annotate_frames
from physgen.render.squash import find_squashes
from physgen.render.striker import with_strikers
from physgen.report.record import RunRecord, StageTime
from physgen.scene.scene import Striker

if TYPE_CHECKING:
    from physgen.compile.compile import CompiledScene
    from physgen.render.camera import Shot
    from physgen.render.squash import Squashes
    from physgen.render.stage import Frame, Stage
    from physgen.render.striker import StruckScene
    from physgen.scene.scene import Scene
    from physgen.simulate.trajectory import Trajectory
from physgen.pipeline.stages import Maps, Stages, T, render, shot


class SideThreads:
    """Threads beside the main thread; the thread that waits for a result counts the
    wall time.

    With the maps of a large photo, all work is done in sequence to save memory.
    """

    def __init__(self, record: RunRecord, size: tuple[int, int]) -> None:
        """Create a set of threads for a photo of this size, px."""
        self._record = record
        self._large = size[0] * size[1] > MOST_PIXELS
        self._threads: list[Thread] = []

    def start(self, stage: str, work: Callable[[], T]) -> Callable[[], T]:
        """Start `work` in a thread, and return a function that waits for its result.

        Its CPU time counts for a stage.
        """
        future: Future[T] = Future()
        if self._large:
            with self._record.stage(stage, time.thread_time):
                future.set_result(work())
            return future.result

        def run() -> None:
            try:
                result = work()
            except BaseException as error:
                # The thread that waits for the result raises the error.
                future.set_exception(error)
                return
            self._record.stages.setdefault(stage, StageTime()).cpu += time.thread_time()
            future.set_result(result)

        # A daemon thread does not delay the end of the process after a second Ctrl-C.
        self._threads.append(Thread(target=run, name=stage, daemon=True))
        self._threads[-1].start()
        return future.result

    def join(self) -> None:
        """Wait for all threads; their results are not needed any more."""
        for thread in self._threads:
            thread.join()


class Film:
    """Draws the frames of one scene.

    The sprites are cut out at first use, and the maps are released then.
    """

    def __init__(
        self,
        scene: Scene,
        compiled_scene: CompiledScene,
        maps: Maps,
        record: RunRecord,
        stages: Stages,
    ) -> None:
        self.scene = scene
        self.compiled = compiled_scene
        self.keeps_layers = False
        """Whether frames keep their layers, for labels."""
        self._delivery: Delivery | None = None
        self._maps: Maps | None = maps
        self._record = record
        self._stages = stages
        self._fine: tuple[Trajectory, Trajectory, int] | None = None
        """A trajectory, its samples for exposures, and their number per frame."""

    def simulate_motion(self, progress: Progress) -> Trajectory:
        """Simulate the motion, one sample per frame."""
        stage = self._record.stage("simulate", time.thread_time)
        with stage, self.scene.located():
            return self._stages.simulate(self.compiled.world, progress)

    @cached_property
    def stage(self) -> Stage:
        """Prepare the sprites and the background."""
        with self._record.stage("cut out", time.thread_time):
            assert self._maps is not None
            maps = self._clean_maps(self._maps)
            prepared_stage = self._stages.stage(self.scene, self.compiled, maps)
        # The maps of a large photo fill the memory, and are not needed any more.
        self._maps = None
        return prepared_stage

    def _clean_maps(self, maps: Maps) -> Maps:
        """Return the maps without the photo's noise, if each frame gets noise of its
        own.
        """
        photo = maps.percepts
        if self._delivery is None or photo is None or self._delivery.grain is None:
            return maps
        clean_percepts = self._delivery.remove_noise(photo)
        return replace(maps, percepts=clean_percepts, has_noise=False)

    def deliver(self) -> dict[str, Any]:
        """Prepare the hold and the noise of the scene's video; return them for the
        manifest.

        Must be called before the first frame is drawn.
        """
        photo = None
        if self._maps is not None:
            photo = self._maps.percepts
        rgb = None
        if photo is not None:
            rgb = photo.rgb
        self._delivery = Delivery.from_scene(self.scene.render, rgb)
        return self._delivery.as_dict()

    def count(self, trajectory: Trajectory) -> int:
        """Count the video's frames."""
        return len(self.shot(trajectory).order) + self.hold

    @property
    def hold(self) -> int:
        """Return the number of frames of the photo before the motion."""
        if self._delivery is None:
            return 0
        return self._delivery.hold

    def deliver_frames(
        self, frames: Iterator[Frame], trajectory: Trajectory
    ) -> Iterator[Frame]:
        """Yield the video's frames: with hold, noise and overlays."""
        if self._delivery is not None:
            frames = self._delivery.deliver_frames(frames, self.shot(trajectory))
        return self.draw_overlays(frames, trajectory)

    def shot(self, trajectory: Trajectory) -> Shot:
        """Return the camera and the playing order; `trajectory` has one sample per
        frame.
        """
        return shot(self.scene, trajectory)

    def frames(
        self,
        trajectory: Trajectory,
        order: Sequence[int] | None = None,
        matte: bool = False,
    ) -> Iterator[Frame]:
        """Yield frames in playing order, or of the samples in `order`.

        As a `matte`, a frame shows the coverage of objects as light.
        """
        camera_shot = self.shot(trajectory)
        if order is not None:
            camera_shot = replace(camera_shot, order=tuple(order))
        # Several samples a frame give motion blur; their last one is the time of the
        # frame.
        exposure_samples, parts = self.sample_exposures(trajectory)
        settings = self.scene.render
        stage = replace(
            self.stage,
            keeps_layers=self.keeps_layers,
            squashes=self._squashes(trajectory),
        )
        if self._delivery is not None and settings.first_blur:
            exposure_samples = blur_first_frame(
                exposure_samples, self.compiled.world, parts, settings.motion_blur
            )
            # The first sample is not the photo's any more.
            photo_poses = [Pose(*pose) for pose in trajectory.poses[0].tolist()]
            stage = replace(stage, starts=stage.starts or photo_poses)
        # A hand or a finger is drawn in the whole clip only, and neither in mattes nor
        # in single frames.
        if order is None and not matte:
            struck = self._add_strikers(stage, (exposure_samples, parts), camera_shot)
            if struck is not None:
                return render(struck.stage, struck.trajectory, parts, struck.shot)
        return render(
            matte_stage(stage) if matte else stage, exposure_samples, parts, camera_shot
        )

    def _add_strikers(
        self, stage: Stage, exposure: tuple[Trajectory, int], shot: Shot
    ) -> StruckScene | None:
        """Return the scene with what comes in and pushes; None if nothing does."""
        delivery = self._delivery
        if delivery is None or delivery.enter is Striker.NONE:
            return None
        world = self.compiled.world
        hold = delivery.hold
        struck = with_strikers(stage, world, delivery.enter, exposure, shot, hold)
        delivery.draws_hold = struck is not None
        return struck

    def _squashes(self, trajectory: Trajectory) -> Squashes | None:
        """Return the soft bodies that impacts flatten, in a delivered video that asks for it."""
        if self._delivery is None or not self._delivery.squash:
            return None

        labels = [item.label for item in self.scene.objects]
        return find_squashes(self.compiled.world, labels, trajectory)

    def sample_exposures(self, trajectory: Trajectory) -> tuple[Trajectory, int]:
        """Return the samples for motion blur, and their number per frame."""
        # Frames may be read more than once: keep the samples of the last motion.
        if self._fine is None or self._fine[0] is not trajectory:
            moments, parts = exposure_times(
                trajectory, self.compiled.world, self.scene.render.motion_blur
            )
            exposure_samples = trajectory
            if parts > 1:
                with self._record.stage("expose", time.thread_time):
                    exposure_samples = trajectory.resample(moments)
            self._fine = trajectory, exposure_samples, parts
        return self._fine[1:]

    def draw_overlays(
        self, frames: Iterator[Frame], trajectory: Trajectory
    ) -> Iterator[Frame]:
        """Yield frames with the scene's overlays."""
        kinds = self.scene.render.overlay
        if not kinds:
            return frames

        camera_shot = self.shot(trajectory)
        return annotate_frames(
            frames,
            self.compiled.world,
            trajectory,
            kinds,
            lambda frame: camera_shot.affine(frame.time),
        )
