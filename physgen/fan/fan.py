"""Scene + Compiled -> Fan: the scene simulated again and again, each time with other numbers from its doubts."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.assemble import Compiled, assembled
from physgen.compile.world import World
from physgen.fan.doubt import Doubt, LightDoubt, doubts, light_doubt
from physgen.fan.draws import directions, drawn, numbers
from physgen.fan.outcome import Fate, Outcome, outcome, size
from physgen.problems import InputError, Problem
from physgen.scene.model import Scene
from physgen.simulate.engine import Progress, silent, simulate

Array = NDArray[np.float64]

RATE = 120.0
"""Samples a second from which outcomes are told."""
MOST_SAMPLES = 100_000
"""Of one draw."""
KEPT = 121
"""Samples of a draw that are kept, at most, evenly over its time."""
MOST_KEPT = 10_000_000
"""Poses that are kept of all draws together: 240 MB."""


@dataclass(frozen=True)
class Fan:
    """N draws of a scene with B bodies and P doubts, K samples of each."""

    seed: int
    doubts: tuple[Doubt, ...]
    values: Array
    """(N, P): what was drawn."""
    light: LightDoubt | None
    directions: Array
    """(N, 3): towards the light, as drawn; (0, 3) where it is certain."""
    names: tuple[str, ...]
    """Of bodies."""
    surfaces: tuple[str, ...]
    """Of bodies, then of walls."""
    sizes: Array
    """(B,) px; see `outcome.size`."""
    times: Array
    """(K,) s."""
    poses: Array
    """(N, K, B, 3): px, px, rad; NaN where a draw could not be simulated."""
    outcomes: tuple[Outcome | None, ...]
    """One a draw."""
    own: Outcome
    """Of the numbers of the file, which the clip shows."""
    own_poses: Array
    """(K, B, 3)."""
    failures: tuple[Problem, ...] = ()
    """Why draws could not be simulated, each reason once."""

    @property
    def whole(self) -> list[int]:
        """Numbers of the draws that could be simulated."""
        return [k for k, one in enumerate(self.outcomes) if one is not None]

    def table(self) -> str:
        """CSV: a line a draw, with what was drawn, then what became of each body; docs/fan.md has the columns."""
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        told = (
            "fate",
            "tips",
            "drops",
            "x_px",
            "y_px",
            "angle_degrees",
            "turned_degrees",
            "rests_s",
            "touches_first",
        )
        lights = [f"light.direction.{axis}" for axis in "xyz"] if self.light is not None else []
        paths = [doubt.path for doubt in self.doubts]
        rows.writerow(["draw", *paths, *lights, *(f"{name}.{what}" for name in self.names for what in told)])
        for k, one in enumerate(self.outcomes):
            drawn_light = self.directions[k].tolist() if lights else []
            cells: list[Any] = [k, *self.values[k].tolist(), *drawn_light]
            for b in range(len(self.names)):
                cells += [""] * len(told) if one is None else _cells(one, b, self.surfaces)
            rows.writerow(cells)
        return text.getvalue()


def _cells(one: Outcome, b: int, surfaces: Sequence[str]) -> list[Any]:
    """What became of one body."""
    first, rests = int(one.first[b]), float(one.rests[b])
    return [
        Fate(int(one.fates[b])).name.lower(),
        int(one.tips[b]),
        int(one.drops[b]),
        *one.final[b, :2].tolist(),
        degrees(one.final[b, 2]),
        degrees(one.turned[b]),
        "" if np.isinf(rests) else rests,
        "" if first < 0 else surfaces[first],
    ]


def uncertain(scene: Scene, variant: str | None = None) -> bool:
    """Whether anything of the scene can be drawn."""
    return bool(doubts(scene, variant)) or light_doubt(scene, variant) is not None


def fan(
    scene: Scene,
    compiled: Compiled,
    count: int,
    seed: int = 0,
    variant: str | None = None,
    progress: Progress = silent,
) -> Fan:
    """`count` draws of what is uncertain, simulated; `variant` is the one that was applied to the scene.

    A draw that cannot be simulated is told in `failures`. Raises InputError where the scene itself cannot be.
    """
    world = compiled.world
    found, light = doubts(scene, variant), light_doubt(scene, variant)
    values = numbers(found, seed, count)
    times = _times(world)
    kept = _kept(len(times), count * max(len(world.bodies), 1))
    own_run = simulate(world, times)
    own, own_poses = outcome(world, own_run), own_run.poses[kept]
    poses = np.full((count, *own_poses.shape), np.nan)
    outcomes: list[Outcome | None] = []
    failures: dict[str, Problem] = {}
    for k in range(count):
        progress("fan", k, count)
        if not found:  # light moves nothing
            poses[k] = own_poses
            outcomes.append(own)
            continue
        try:
            of_draw = assembled(drawn(scene, found, values[k]), compiled.shapes).world
            run = simulate(of_draw, times)
        except InputError as error:
            failures |= {f"{p.path} {p.expected}": p for p in error.problems if p.path not in failures}
            outcomes.append(None)
            continue
        poses[k] = run.poses[kept]
        outcomes.append(outcome(of_draw, run))
    return Fan(
        seed=seed,
        doubts=found,
        values=values,
        light=light,
        directions=np.zeros((0, 3)) if light is None else directions(light, seed, count),
        names=tuple(body.name for body in world.bodies),
        surfaces=tuple(name for name, _ in world.surfaces),
        sizes=np.array([size(body) for body in world.bodies]),
        times=times[kept],
        poses=poses,
        outcomes=tuple(outcomes),
        own=own,
        own_poses=own_poses,
        failures=tuple(failures.values()),
    )


def _times(world: World) -> Array:
    """From 0 to the end, `RATE` a second as far as that is not too many."""
    count = int(np.clip(np.ceil(world.duration * RATE), 2, MOST_SAMPLES))
    return np.asarray(np.linspace(0, world.duration, count + 1))


def _kept(samples: int, of_each: int) -> NDArray[np.intp]:
    """Indices of the samples that are kept."""
    count = int(np.clip(MOST_KEPT // of_each, 2, min(KEPT, samples)))
    return np.unique(np.linspace(0, samples - 1, count).round().astype(np.intp))
