"""Scene and trajectory -> the clip's frames as they are filmed, and what is drawn over them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

from physgen.pipeline.stages import render, shot
from physgen.pipeline.warm import Maps, Warm
from physgen.pipeline.watch import Progress
from physgen.problems import Warn

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from physgen.compile.compile import Compiled
    from physgen.render.camera import Shot
    from physgen.render.stage import Frame, Stage
    from physgen.report.record import RunRecord
    from physgen.scene.scene import Scene
    from physgen.simulate.recorder import StepLog
    from physgen.simulate.trajectory import Trajectory


class Filming:
    """A scene about to be filmed; what is drawn is cut out when first asked for, and the maps are let go."""

    def __init__(
        self, scene: Scene, compiled: Compiled, maps: Maps, device: str, record: RunRecord, warm: Warm
    ) -> None:
        self.scene, self.compiled, self.device, self.warm = scene, compiled, device, warm
        self._maps: Maps | None = maps
        self._record = record
        self._fine: tuple[Trajectory, Trajectory, int] | None = None
        """Of a trajectory: the samples that its frames are exposed at, and how many a frame has."""
        self._tape: StepLog | None = None

    def simulated(self, progress: Progress, cached: bool, warn: Warn) -> Trajectory:
        """The motion, a sample a frame; where it is not at hand but run, its steps are kept."""
        from physgen.simulate.recorder import StepLog

        self._tape = StepLog()
        with self._record.stage("simulate"):
            return self.warm.simulate(self.compiled.world, progress, cached, warn, self._tape)

    def sampled(self, times: NDArray[np.float64]) -> Trajectory:
        """The same motion at other times, s: the engine's steps do not depend on its samples."""
        from physgen.simulate.engine import simulate
        from physgen.simulate.recorder import StepLog

        found = None if self._tape is None else self._tape.read(times)
        if found is None:
            self._tape = StepLog()
            found = simulate(self.compiled.world, times, tape=self._tape)
        return found

    @cached_property
    def stage(self) -> Stage:
        """What is drawn."""
        with self._record.stage("cut out"):
            assert self._maps is not None
            made = self.warm.stage(self.scene, self.compiled, self._maps)
        self._maps = None
        return made

    def shot(self, trajectory: Trajectory) -> Shot:
        """How the clip is filmed and played; `trajectory` has one sample a frame."""
        return shot(self.scene, trajectory)

    def frames(
        self, trajectory: Trajectory, order: Sequence[int] | None = None, matte: bool = False
    ) -> Iterator[Frame]:
        """Frames in the order in which the clip is played, or that of samples; or how things cover them, as light."""
        take = self.shot(trajectory)
        if order is not None:
            take = replace(take, order=tuple(order))
        fine, parts = self.exposed(trajectory)
        drawn = self.stage
        if matte:
            from physgen.render.staging import matte_stage as covering

            drawn = covering(drawn)
        return render(drawn, fine, parts, take, self.device)

    def exposed(self, trajectory: Trajectory) -> tuple[Trajectory, int]:
        """Samples enough for open shutters, and how many a frame has."""
        if self._fine is None or self._fine[0] is not trajectory:
            from physgen.render.camera import exposure_times

            moments, parts = exposure_times(trajectory, self.compiled.world, self.scene.render.motion_blur)
            fine = trajectory
            if parts > 1:
                with self._record.stage("expose"):
                    fine = self.sampled(moments)
            self._fine = trajectory, fine, parts
        return self._fine[1:]

    def annotated(self, frames: Iterator[Frame], trajectory: Trajectory) -> Iterator[Frame]:
        """Frames with the scene's overlays."""
        if not self.scene.render.overlay:
            return frames
        from physgen.render.overlay import annotate_frames

        take = self.shot(trajectory)
        return annotate_frames(
            frames,
            self.compiled.world,
            trajectory,
            self.scene.render.overlay,
            lambda frame: take.affine(frame.time),
        )
