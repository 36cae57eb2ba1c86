"""Problems, values and the motion of a scene's text, computed in parts during
editing.
"""

from __future__ import annotations

import os
import time
from base64 import b64encode
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from threading import RLock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.compile import CompiledScene
from physgen.compile.world import World, appearance
from physgen.edit.page_data import (
    derived_data,
    doubtful_data,
    doubtful_rows,
    perceived_data,
    problem_data,
    scene_data,
    todo,
)
from physgen.maps import Percepts
from physgen.pipeline.cache_keys import key, motion_key
from physgen.pipeline.stages import Keep, Recent, Stages, lint
from physgen.problems import InputError, Problem, as_warnings
from physgen.report.player import figure, fixed_data, touches
from physgen.scene.load import OpenedScene
from physgen.scene.scene import Scene
from physgen.simulate.engine import Running
from physgen.simulate.trajectory import Trajectory

Data = dict[str, Any]

Array = NDArray[np.float64]

SUBSAMPLES = 4
"""Samples per frame, so that a bounce between two frames is visible."""
MAX_SUBSAMPLED = 100_000
"""Samples times objects up to which each frame has `SUBSAMPLES` samples."""
MAX_PART = 200_000
"""Samples times objects of one part of a motion: about 15 MB of JSON."""
FIRST = 0.045
MORE = 0.08
"""Time for simulation, s, of a look, and of each later part of a motion."""
SLICE = 0.03
"""Time, s, for which a simulation to the end blocks other threads."""
MAX_MOTIONS = 6
"""Number of motions in memory: those of the tabs, and those before and after an
undo.
"""
ENERGY = ("kinetic", "potential", "dissipated", "work")
COLUMNS = ("x", "y", "a", "vx", "vy", "w")


class MotionStream:
    """The motion of one world, simulated in parts as the page asks for them.

    Numbers are little-endian float64 in base64; at the frames they equal those of
    `physgen simulate`. No step is simulated twice.
    """

    def __init__(self, key: str, scene: Scene, world: World) -> None:
        self.key = key
        self.scene = scene
        self.world = world
        body_count = max(len(world.bodies), 1)
        frames = world.times
        subsamples = 1
        if len(frames) * SUBSAMPLES * body_count <= MAX_SUBSAMPLED:
            subsamples = SUBSAMPLES
        # The page draws contacts and bounces between the frames, as long as the numbers
        # fit.
        times = frames
        if subsamples > 1 and len(frames) > 1:
            subframe_times = frames[:-1, None] + np.diff(frames)[:, None] * (
                np.arange(subsamples) / subsamples
            )
            # The frames are added again: sums of steps may miss them by rounding.
            times = np.unique(np.concatenate([subframe_times.ravel(), frames]))
        self._frames = np.searchsorted(times, frames)
        self._running = Running(world, times, max_bytes=0)
        self.problems: list[Problem] = []
        """Reasons for an early end of the motion."""

    @property
    def total(self) -> int:
        return len(self._running.times)

    @property
    def is_complete(self) -> bool:
        return bool(self.problems) or self._running.sample_count >= self.total

    def trajectory(self) -> Trajectory:
        """Return the motion; samples without simulation so far are zeros."""
        return self._running.trajectory()

    def part(self, start: int, deadline: float) -> Data:
        """Return the samples from `start` on, at least one.

        Simulates until `deadline`, a time of `time.perf_counter`.
        """
        start = max(0, min(start, self.total))
        self.simulate(start + 1, deadline)
        run = self._running
        N = max(len(self.world.bodies), 1)
        # A part has a limit of numbers, so that heaps get fewer samples at a time.
        end = max(start, min(run.sample_count, start + max(1, MAX_PART // N)))
        trajectory = run.trajectory()
        data: Data = {
            "key": self.key,
            "id": self.key,
            "from": start,
            "upto": end,
            "total": self.total,
            "done": self.is_complete and end == run.sample_count,
            "problems": [],
        }
        has_turns = trajectory.turns.shape[1] > 0
        data["bodies"] = [
            {
                "name": body.name,
                **{
                    name: pack(trajectory.poses[start:end, k, c])
                    for c, name in enumerate(COLUMNS[:3])
                },
                **{
                    name: pack(trajectory.velocities[start:end, k, c])
                    for c, name in enumerate(COLUMNS[3:])
                },
                "q": list(map(pack, trajectory.turns[start:end, k].T))
                if has_turns
                else None,
            }
            for k, body in enumerate(self.world.bodies)
        ]
        # Contacts and energies refer to the whole motion, so that the last part carries
        # them.
        data["contacts"] = data["energy"] = None
        if data["done"] and not self.problems:
            energy = trajectory.energy
            data["energy"] = {name: pack(getattr(energy, name)) for name in ENERGY}
            data["contacts"] = {
                "surfaces": list(trajectory.contacts.surfaces),
                "touches": touches(trajectory),
            }
        if start == 0:
            self._begin(data)
        return data

    def simulate(self, count: int, deadline: float) -> None:
        """Simulate until the deadline, and until at least `count` samples are taken."""
        run = self._running
        if self.is_complete:
            return
        try:
            while not self.is_complete:
                run.advance(run.end, should_stop=partial(_check_deadline, deadline))
                if run.sample_count >= min(count, self.total) and _check_deadline(
                    deadline
                ):
                    break
                # The deadline has passed without the required samples: simulate 10 ms
                # at a time.
                deadline = max(deadline, time.perf_counter() + 0.01)
        except InputError as error:
            self.problems = error.problems

    def _begin(self, data: Data) -> None:
        """Add the data of the first part: everything constant in time."""
        scene = self.scene
        world = self.world
        for k, body in enumerate(world.bodies):
            data["bodies"][k] |= figure(scene, k, body)
        data |= fixed_data(scene, world) | {
            "times": pack(self._running.times),
            "frames": self._frames.tolist(),
            "camera": None,
        }


def _check_deadline(deadline: float) -> bool:
    """Check whether a deadline has passed."""
    return time.perf_counter() > deadline


def pack(values: Array) -> str:
    """Encode values as little-endian float64 in base64.

    >>> pack(np.array([1.0]))
    'AAAAAAAA8D8='
    """
    return b64encode(np.ascontiguousarray(values, "<f8").tobytes()).decode("ascii")


@dataclass(frozen=True)
class Look:
    """A state of the text for the page; a wrong text has only `problems` and `todo`."""

    problems: tuple[Data, ...] = ()  # errors, then lints
    scene: Data | None = None
    derived_data: Data | None = None
    motion: Data | None = None  # the first part of the motion; see `MotionStream`
    picture: str | None = None  # key of the picture
    todo: tuple[Data, ...] = ()
    doubtful: tuple[Data, ...] = ()  # regions that may be objects
    perception: Data | None = None  # the verdict and the summary of perception


@dataclass(frozen=True)
class LiveScene:
    """A compiled scene without its maps, so that many texts of a large photo fit in
    memory.
    """

    scene: Scene
    compiled_scene: CompiledScene
    key: str  # key of the photo and its maps
    picture: str  # key of the picture
    read: Callable[[Scene], Percepts | None]
    lints: list[tuple[Problem, ...]] = field(
        default_factory=list
    )  # empty until they are computed

    @property
    def percepts(self) -> Percepts | None:
        """Return the photo and its maps, None for a scene without a photo."""
        return self.read(self.scene)


class Live:
    """One scene file during editing: problems, values and motion of its text.

    Results that an edit does not change are reused: the photo and its maps, outlines,
    and motions. The methods are thread-safe: one runs at a time.
    """

    def __init__(self, path: Path, allow_outside: bool = False) -> None:
        self.path = path
        self.allow_outside = allow_outside
        self._lock = RLock()
        self._warm = Stages(Keep.EDITING)
        self._opened: Recent[OpenedScene] = Recent(6)
        self._known: Recent[LiveScene] = Recent(8)
        self._motions: Recent[MotionStream] = Recent(MAX_MOTIONS)
        self._sights: Recent[LiveScene] = Recent(4)

    def look(
        self, text: str, variant: str | None = None, *, motion_only: bool = False
    ) -> Look:
        """Return the data of the page for a text.

        `motion_only`: only the motion and its problems, while the user drags an object.
        """
        with self._lock:
            start_time = time.perf_counter()
            try:
                opened = self._open(text)
                compiled_scene = self._mean(opened, variant)
            except InputError as error:
                rows = tuple(map(self._row, error.problems))
                return Look(rows, todo=tuple(todo(None, rows)))
            stream, motion = self._motion(compiled_scene, start_time)
            if motion_only:
                return Look(
                    tuple(self._row(p, compiled_scene.scene) for p in stream.problems),
                    motion=motion,
                )
            # Lints take long and depend on the text alone: compute them once per text.
            if not compiled_scene.lints:
                compiled_scene.lints.append(
                    tuple(
                        lint(
                            compiled_scene.scene,
                            compiled_scene.compiled_scene,
                            compiled_scene.percepts,
                        )
                    )
                )
            variant_warnings = as_warnings(opened.variant_problems)
            problems = (*stream.problems, *variant_warnings, *compiled_scene.lints[0])
            rows = tuple(
                self._row(problem, compiled_scene.scene) for problem in problems
            )
            doubtful = doubtful_data(compiled_scene.scene, compiled_scene.percepts)
            return Look(
                rows,
                scene_data(compiled_scene.scene),
                derived_data(compiled_scene.scene, compiled_scene.compiled_scene),
                motion,
                compiled_scene.picture,
                (
                    *todo(compiled_scene.scene, rows),
                    *doubtful_rows(compiled_scene.scene, doubtful),
                ),
                tuple(doubtful),
                perceived_data(compiled_scene.scene),
            )

    def next_part(self, key: str, start: int) -> Data | None:
        """Return the next part of a motion, from a sample on; None if its stream was
        dropped.
        """
        with self._lock:
            stream = self._motions.get(key)
            if stream is None:
                return None
            part = stream.part(start, time.perf_counter() + MORE)
            part["problems"] = list(map(self._row, stream.problems))
            return part

    def full_motion(self, key: str) -> tuple[Trajectory, World] | None:
        """Simulate a motion to its end, and return it with its world.

        None if its stream was dropped or cannot be simulated.
        """
        while True:
            with self._lock:
                stream = self._motions.get(key)
                if stream is None or stream.problems:
                    return None
                if stream.is_complete:
                    return stream.trajectory(), stream.world
                stream.simulate(0, time.perf_counter() + SLICE)
            # Let waiting threads take the lock between two slices.
            time.sleep(0)

    def sight(self, key: str) -> LiveScene | None:
        """Return the scene of a picture's key."""
        with self._lock:
            return self._sights.get(key)

    def state(self, text: str, variant: str | None = None) -> LiveScene:
        """Compile the scene of a text with its maps. Raises InputError."""
        with self._lock:
            return self._mean(self._open(text), variant)

    def document(self, text: str) -> Data:
        """Return the text as plain data, with `extends` and without defaults. Raises
        InputError.
        """
        with self._lock:
            return self._open(text).document()

    def _open(self, text: str) -> OpenedScene:
        """Read a text, or return the scene file that was read for the same text."""

        def read() -> OpenedScene:
            return OpenedScene(self.path, self.allow_outside, text=text)

        opened = self._opened.of(text, read)
        # Another program changed a file that the scene extends.
        if opened.stale():
            self._opened.forget(text)
            opened = self._opened.of(text, read)
        return opened

    def _mean(self, opened_scene: OpenedScene, variant: str | None) -> LiveScene:
        """Compile the scene of a text. Raises InputError."""
        scene = opened_scene.scene((), variant)
        maps = self._warm.maps(scene)
        cache_key = (opened_scene, variant, maps.key)

        def make() -> LiveScene:
            compiled = self._warm.compile(scene, maps)
            masks = (
                [item.mask for item in scene.objects],
                [item.mask for item in scene.boundaries],
            )
            # The label map follows from outlines, masks and maps. Hashing these is much
            # faster than hashing the label map of a large photo.
            if maps.percepts is None:
                outlines = compiled.outlines
            else:
                outlines = ()
            picture = key(
                "picture", maps.key, *appearance(scene, compiled.world), outlines, masks
            )
            compiled_scene = LiveScene(
                scene, compiled, maps.key, picture, self._percepts
            )
            self._sights.of(picture, lambda: compiled_scene)
            return compiled_scene

        return self._known.of(cache_key, make)

    def _percepts(self, scene: Scene) -> Percepts | None:
        """Read the maps of a scene from the cache of stages."""
        with self._lock:
            return self._warm.maps(scene).percepts

    def _motion(
        self, live_scene: LiveScene, begin_time: float
    ) -> tuple[MotionStream, Data]:
        """Return the stream of a scene's motion and its first part."""
        world = live_scene.compiled_scene.world
        stream_key = motion_key(world)
        stream = self._motions.of(
            stream_key, lambda: MotionStream(stream_key, live_scene.scene, world)
        )
        # Scenes with equal motion may differ in labels or the frame rate.
        stream.scene = live_scene.scene
        # Reading and compiling use up most of the time of a slow look: simulate at
        # least a third.
        part = stream.part(0, max(begin_time + FIRST, time.perf_counter() + FIRST / 3))
        part["problems"] = [
            self._row(problem, live_scene.scene) for problem in stream.problems
        ]
        return stream, part

    def _row(self, problem: Problem, scene: Scene | None = None) -> Data:
        """Return a problem for the page, with its line."""
        # A problem of the simulation has a path but no line.
        if scene is not None and not problem.place.line and problem.path:
            problem = replace(problem, place=scene.place(problem.path))
        return problem_data(problem, os.fspath(self.path))
