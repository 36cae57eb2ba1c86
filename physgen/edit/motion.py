"""A world -> its motion as the page reads it, in parts: what is simulated by now, and more whenever the page asks.

Numbers are float64 as the engine has them, little-endian, base64: at the frames, those of `physgen simulate`. No step
is taken twice, and none that nobody asks for.
"""

from __future__ import annotations

import time
from base64 import b64decode, b64encode
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.problems import InputError, Problem
from physgen.report.player import fields, figure, joints, pushes, touches, walls
from physgen.scene.model import Scene, View
from physgen.simulate.engine import Running
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]
Data = dict[str, Any]

FINER = 4
"""Samples a frame: what bounces within one is seen to."""
FEW = 100_000
"""Samples times objects up to which there are so many."""
MOST = 200_000
"""Samples times objects of one part: about 15 MB of JSON."""
COLUMNS = ("x", "y", "a", "vx", "vy", "w")


class Film:
    """The motion of one world, as far as it is known."""

    def __init__(self, key: str, scene: Scene, world: World) -> None:
        self.key = key
        self._scene, self.world = scene, world
        N, frames = max(len(world.bodies), 1), world.times
        finer = FINER if len(frames) * FINER * N <= FEW else 1
        times = frames
        if finer > 1 and len(frames) > 1:
            between = frames[:-1, None] + np.diff(frames)[:, None] * (np.arange(finer) / finer)
            times = np.unique(np.concatenate([between.ravel(), frames]))
        self._frames = np.searchsorted(times, frames)
        self._running = Running(world, times)
        self._problems: list[Problem] = []

    def show(self, scene: Scene) -> None:
        """The same motion, of a scene that differs in what does not move: labels, the clip's rate, order."""
        self._scene = scene

    @property
    def total(self) -> int:
        """Samples in all."""
        return len(self._running.times)

    @property
    def done(self) -> bool:
        """Whether nothing is left to be simulated."""
        return bool(self._problems) or self._running.done >= self.total

    def trajectory(self) -> Trajectory:
        """What is known; samples from `upto` on are zeros until they are simulated."""
        return self._running.told()

    @property
    def upto(self) -> int:
        """Samples that are simulated."""
        return self._running.done

    def part(self, start: int, deadline: float) -> Data:
        """Samples from `start` on; what is missing is simulated until `deadline`, of `time.perf_counter`.

        There is one sample more than before at least, unless the motion has ended.
        """
        begun = time.perf_counter()
        start = max(0, min(start, self.total))
        self._simulate(start + 1, deadline)
        run, N = self._running, max(len(self.world.bodies), 1)
        upto = max(start, min(run.done, start + max(1, MOST // N)))
        told = run.told()
        found: Data = {
            "key": self.key,
            "id": self.key,
            "from": start,
            "upto": upto,
            "total": self.total,
            "done": self.done and upto == run.done,
            "problems": [],
        }
        turning = told.turns.shape[1] > 0
        found["bodies"] = [
            {
                "name": body.name,
                **{name: packed(told.poses[start:upto, k, c]) for c, name in enumerate(COLUMNS[:3])},
                **{name: packed(told.velocities[start:upto, k, c]) for c, name in enumerate(COLUMNS[3:])},
                "q": [packed(part) for part in told.turns[start:upto, k].T] if turning else None,
            }
            for k, body in enumerate(self.world.bodies)
        ]
        found["contacts"] = found["energy"] = None
        if found["done"] and not self._problems:
            e = told.energy
            rows = {
                "kinetic": e.kinetic,
                "potential": e.potential,
                "dissipated": e.dissipated,
                "work": e.work,
            }
            found["energy"] = {name: packed(values) for name, values in rows.items()}
            found["contacts"] = {"surfaces": list(told.contacts.surfaces), "touches": touches(told)}
        if start == 0:
            self._begin(found)
        found["took_ms"] = round(1000 * (time.perf_counter() - begun), 1)
        return found

    def problems(self) -> list[Problem]:
        """Why the motion ends early."""
        return self._problems

    def on(self, deadline: float) -> None:
        """Simulate what is left until the deadline."""
        self._simulate(0, deadline)

    def _simulate(self, least: int, deadline: float) -> None:
        """Until the deadline, and until at least so many samples are taken."""
        run = self._running
        if self.done:
            return
        try:
            while not self.done:
                run.on(run.end, enough=partial(_late, deadline))
                run.read()
                if run.done >= min(least, self.total) and _late(deadline):
                    break
                deadline = max(deadline, time.perf_counter() + 0.01)
        except InputError as error:
            self._problems = error.problems

    def _begin(self, found: Data) -> None:
        """What only the first part tells: all that does not change with time."""
        scene, world = self._scene, self.world
        for k, body in enumerate(world.bodies):
            found["bodies"][k] |= figure(scene, k, body)
        found |= {
            "times": packed(self._running.times),
            "frames": self._frames.tolist(),
            "name": scene.name,
            "size": list(world.size),
            "scale": world.pixels_per_meter if "world.pixels_per_meter" in scene.places else None,
            "gravity": world.gravity.tolist(),
            "top": world.view is View.TOP,
            "clip": {"fps": scene.render.fps, "order": scene.render.play.value},
            "camera": None,
            "walls": walls(world),
            "pushes": pushes(world),
            "joints": joints(world),
            "fields": fields(world),
        }


def _late(deadline: float) -> bool:
    return time.perf_counter() > deadline


def packed(values: Array) -> str:
    """Little-endian float64, base64.

    >>> packed(np.array([1.0]))
    'AAAAAAAA8D8='
    """
    return b64encode(np.ascontiguousarray(values, "<f8").tobytes()).decode("ascii")


def unpacked(text: str) -> Array:
    """The numbers again.

    >>> unpacked('AAAAAAAA8D8=').tolist()
    [1.0]
    """
    return np.frombuffer(b64decode(text), "<f8").astype(np.float64)
