"""World -> how long its motion can be foretold: run again a hair apart, with half the step, with other sweeps.

Where runs that no camera could tell apart at the start come apart, the motion is chaos, and the clip is one of many
that are equally true: a break of fifteen balls. Where they stay together, it is foretold: a row of dominoes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.progress import Progress, silent
from physgen.scene.scene import Motion
from physgen.simulate.engine import simulate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ChaosTuning:
    """Nudges and thresholds of compared runs."""

    nudge: float = 1e-4
    """px by which every object is moved: far below what a mask can tell."""
    apart: float = 1.0
    """px at which two runs have parted."""
    rate: float = 120.0
    """Samples a second at which runs are compared."""
    sweeps: int = 40
    """Of the run with other sweeps of the contact solver."""


TUNING = ChaosTuning()

NUDGES = 3
WILD = 10.0
"""px beyond which a nudge has grown into chaos; a row of dominoes answers any nudge with a pixel or two, no more."""


@dataclass(frozen=True)
class Chaos:
    """When runs of one scene part; N objects, R runs besides the scene's own."""

    names: tuple[str, ...]
    runs: tuple[str, ...]
    """What each run changed."""
    parted: Array
    """(N, R) s: when the object was first a pixel from where the scene's own run had it; infinite: never."""
    distance: Array
    """(N, R) px: how far apart the two were at most."""
    duration: float
    """s compared."""

    @property
    def first(self) -> Array:
        """(N,) s: the earliest over all runs; infinite where all stay together."""
        return np.asarray(self.parted.min(axis=1)) if self.parted.size else np.full(len(self.names), np.inf)

    def as_dict(self) -> dict[str, Any]:
        """Plain data; null where runs stay together."""
        return {
            "apart_px": TUNING.apart,
            "duration_s": self.duration,
            "verdict": self.verdict(),
            "runs": list(self.runs),
            "objects": {
                name: {
                    "parted_s": None if np.isinf(first) else round(float(first), 6),
                    "runs": [
                        {"parted_s": None if np.isinf(t) else round(float(t), 6), "distance_px": float(d)}
                        for t, d in zip(parted, distance, strict=True)
                    ],
                }
                for name, first, parted, distance in zip(
                    self.names, self.first, self.parted, self.distance, strict=True
                )
            },
        }

    def lines(self) -> list[str]:
        """A table for a terminal: when each object's runs part, and how far they come apart in each."""
        heads = ["object", "parts at", *self.runs]
        rows = [heads]
        for name, first, distance in zip(self.names, self.first, self.distance, strict=True):
            when = "stays" if np.isinf(first) else f"{first:.3f} s"
            rows.append([name, when, *(f"{d:.2g} px" for d in distance)])
        wide = [max(len(row[k]) for row in rows) for k in range(len(heads))]
        return ["  ".join(cell.ljust(w) for cell, w in zip(row, wide, strict=True)).rstrip() for row in rows]

    def verdict(self) -> str:
        """One sentence: chaos is what nudges do; the other runs tell how exact the engine is."""
        if not self.distance.size:
            return "Nothing moves."
        nudged, engine = self.distance[:, :NUDGES].max(axis=1), float(self.distance[:, NUDGES:].max())
        wild = nudged > WILD
        if not wild.any():
            return (
                f"Foretold: {TUNING.nudge:g} px at the start never become more than {float(nudged.max()):.2g} px in "
                f"{self.duration:g} s; half the step or other sweeps change places by {engine:.2g} px at most."
            )
        first = float(self.parted[wild, :NUDGES].min())
        return (
            f"Chaos: {TUNING.nudge:g} px at the start become {TUNING.apart:g} px at {first:.2f} s and up to "
            f"{float(nudged.max()):.2g} px by the end, for {int(wild.sum())} of {len(self.names)} objects; "
            "the clip is one of many that are equally true."
        )


def chaos(world: World, progress: Progress = silent) -> Chaos:
    """Compare a world's run with runs of its neighbours. Raises InputError as `simulate` does."""
    times = np.arange(int(world.duration * TUNING.rate + 1e-9) + 1) / TUNING.rate
    alike: list[tuple[str, Callable[[], Array]]] = [
        (f"nudged {k + 1}", partial(_poses, _nudged(world, k), times)) for k in range(NUDGES)
    ]
    alike += [
        (
            "half the step",
            partial(_poses, replace(world, steps_per_second=2 * world.steps_per_second), times),
        ),
        (f"{TUNING.sweeps} sweeps", partial(_poses, world, times, TUNING.sweeps)),
    ]
    own = simulate(world, times).poses
    parted, distance = [], []
    for number, (_, run) in enumerate(alike):
        progress("chaos", number, len(alike))
        apart = np.hypot(*np.moveaxis(run()[:, :, :2] - own[:, :, :2], 2, 0))
        first = np.where(
            (apart >= TUNING.apart).any(axis=0), times[(apart >= TUNING.apart).argmax(axis=0)], np.inf
        )
        parted.append(first)
        distance.append(apart.max(axis=0))
    return Chaos(
        names=tuple(body.name for body in world.bodies),
        runs=tuple(name for name, _ in alike),
        parted=np.array(parted).T.reshape(len(world.bodies), -1),
        distance=np.array(distance).T.reshape(len(world.bodies), -1),
        duration=float(times[-1]),
    )


def _poses(world: World, times: Array, iterations: int | None = None) -> Array:
    return simulate(world, times, iterations=iterations).poses


def _nudged(world: World, seed: int) -> World:
    """The world with every dynamic body a hair from where it was."""
    random = np.random.default_rng(seed)

    def moved(body: Body) -> Body:
        angle = random.uniform(0, 2 * np.pi)
        if body.motion is not Motion.DYNAMIC:
            return body
        return replace(body, center=body.center + TUNING.nudge * np.array([np.cos(angle), np.sin(angle)]))

    return replace(world, bodies=tuple(moved(body) for body in world.bodies))
