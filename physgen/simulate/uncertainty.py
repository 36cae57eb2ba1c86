"""Simulate a scene many times with drawn values and classify what becomes of each object."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from math import degrees, radians
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.compile import Compiled, compile_shapes
from physgen.compile.world import Body, World
from physgen.geometry.polygon import polygon_moments
from physgen.problems import InputError, Problem
from physgen.progress import Progress, silent
from physgen.scene.scene import Motion, Scene, View
from physgen.simulate.engine import simulate
from physgen.simulate.trajectory import Trajectory
from physgen.simulate.uncertain_values import (
    UncertainLight,
    UncertainValue,
    directions,
    drawn,
    numbers,
    uncertain_light,
    uncertain_values,
)

# ----------------------------------------------------------------------
# World + Trajectory -> what became of each body: whether it stays, moves, falls or leaves, and how.

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Index = NDArray[np.int32]

TIPPED = radians(45)
"""From how it stood: beyond, a thing stands on another side."""
PART = 0.5
"""Of its size: what goes no farther stays, and what comes down by no more does not fall."""
STILL = 0.5
"""px within which a thing that has come to rest stays to the end."""
LAST = 0.1
"""Of the clip's time that it has to be at rest, at least."""
NEAR = 1.0
"""px by which two have moved at most when they touch, to have touched from the start."""


class Fate(IntEnum):
    """What becomes of a thing; where several hold, the largest."""

    STAYS = 0
    """It never goes farther from its place than half its size."""
    MOVES = 1
    LEAVES = 2
    """At the end, nothing of it is in the photo."""
    FALLS = 3
    """It tips over or drops."""


@dataclass(frozen=True)
class Outcome:
    """Of one run; B bodies."""

    fates: Index
    """(B,) numbers of `Fate`."""
    tips: Flags
    """(B,): turns by more than 45 degrees from how it stood; not of circles, nor of what a joint holds."""
    drops: Flags
    """(B,): gets lower than it was by more than half its size, and comes down as far in one go: through the air, or
    more steeply than at 45 degrees. What slides or rolls down a slope does not."""
    final: Array
    """(B, 3): px, px, rad at the end."""
    turned: Array
    """(B,) rad from how it stood, at most."""
    rests: Array
    """(B,) s since when it is at rest to the end; infinite where it is not."""
    first: Index
    """(B,): whom it touches first that it did not touch at t = 0, an index into `World.surfaces`; -1: nobody."""


def size(body: Body) -> float:
    """px: the diameter of a disc of its area, as `its size` is meant here."""
    if body.radius is not None:
        return 2 * body.radius
    area = sum(abs(polygon_moments(piece).area) for piece in body.pieces)
    return float(2 * np.sqrt(area / np.pi))


def outcome(world: World, run: Trajectory) -> Outcome:
    """What a run, sampled often, ends in."""
    start, final = run.poses[0], run.poses[-1]
    sizes = np.array([size(body) for body in world.bodies])
    away = np.hypot(*np.moveaxis(run.poses[:, :, :2] - start[:, :2], 2, 0)).max(axis=0)
    turned = np.abs(run.poses[:, :, 2] - start[:, 2]).max(axis=0)
    can = _can_fall(world)
    tips = can & (turned > TIPPED) & np.array([body.radius is None for body in world.bodies], bool)
    drops = can & _drops(world, run, PART * sizes)
    fates = np.where(away > PART * sizes, Fate.MOVES, Fate.STAYS)
    fates = np.where(_outside(world, final), Fate.LEAVES, fates)
    fates = np.where(tips | drops, Fate.FALLS, fates)
    return Outcome(fates.astype(np.int32), tips, drops, final, turned, _rests(run), _first(world, run))


def _can_fall(world: World) -> Flags:
    """Bodies that are free to fall: dynamic ones of a scene with gravity that no joint holds in the world."""
    free = np.array([body.motion is Motion.DYNAMIC for body in world.bodies], bool)
    if world.view is View.TOP or not world.gravity.any():
        return np.zeros(len(free), bool)
    held, more = ~free, True
    while more:  # what is joined to what is held is held
        more = False
        for joint in world.joints:
            ends = [joint.first] if joint.second is None else [joint.first, joint.second]
            if (joint.second is None or held[ends].any()) and not held[ends].all():
                held[ends] = more = True
    return np.asarray(free & ~held)


def _drops(world: World, run: Trajectory, least: Array) -> Flags:
    if not world.gravity.any() or len(run.times) < 2:
        return np.zeros(len(world.bodies), bool)
    down = world.gravity / np.hypot(*world.gravity)
    depth = (run.poses[:, :, :2] - run.poses[0, :, :2]) @ down
    across = (run.poses[:, :, :2] - run.poses[0, :, :2]) @ np.array([-down[1], down[0]])
    steep = np.diff(depth, axis=0) > np.abs(np.diff(across, axis=0))
    falling = steep | ~_touched(run)
    fallen = np.zeros(len(least), bool)
    top = depth[0]
    for k in range(1, len(depth)):
        top = np.where(falling[k - 1], np.minimum(top, depth[k]), depth[k])
        fallen |= (depth[k] - top > least) & (depth[k] > least)
    return fallen


def _touched(run: Trajectory) -> Flags:
    """(T - 1, B): whether a body touches anything between two samples."""
    count = len(run.names)
    found = np.zeros((len(run.times) - 1, count), bool)
    begins = np.searchsorted(run.times, run.contacts.touch_times[:, 0], side="right") - 1
    ends = np.searchsorted(run.times, run.contacts.touch_times[:, 1], side="left")
    for pair, begin, end in zip(
        run.contacts.touch_pairs.tolist(), begins.tolist(), ends.tolist(), strict=True
    ):
        for body in pair:
            if body < count:
                found[max(begin, 0) : end, body] = True
    return found


def _outside(world: World, poses: Array) -> Flags:
    """(B,): bodies of which nothing is on the canvas."""
    width, height = world.size
    reach = np.array([body.reach for body in world.bodies])
    x, y = poses[:, 0], poses[:, 1]
    out = (x + reach < -0.5) | (x - reach > width - 0.5) | (y + reach < -0.5) | (y - reach > height - 0.5)
    return np.asarray(out)


def _rests(run: Trajectory) -> Array:
    off = np.hypot(*np.moveaxis(run.poses[:, :, :2] - run.poses[-1, :, :2], 2, 0)) > STILL
    later = len(off) - np.argmax(off[::-1], axis=0)  # the sample after the last one that is off
    since = run.times[np.where(off.any(axis=0), np.minimum(later, len(off) - 1), 0)]
    return np.asarray(np.where(since <= (1 - LAST) * run.times[-1], since, np.inf))


def _first(world: World, run: Trajectory) -> Index:
    first = np.full(len(run.names), -1, np.int32)
    reach = np.array([body.reach for body in world.bodies])
    known: set[tuple[int, ...]] = set()
    begins = run.contacts.touch_times[:, 0]
    samples = np.maximum(np.searchsorted(run.times, begins, side="right") - 1, 0)
    for pair, sample in zip(
        run.contacts.touch_pairs.tolist(), samples.tolist(), strict=True
    ):  # by their begins
        if tuple(pair) in known:
            continue
        bodies = [one for one in pair if one < len(first)]
        off = run.poses[sample, bodies] - run.poses[0, bodies]
        if float((np.hypot(off[:, 0], off[:, 1]) + reach[bodies] * np.abs(off[:, 2])).sum()) < NEAR:
            known.add(tuple(pair))
            continue
        for one, other in (pair, pair[::-1]):
            if one < len(first) and first[one] < 0:
                first[one] = other
    return first


# ----------------------------------------------------------------------
# Scene + Compiled -> Fan: the scene simulated again and again, each time with other numbers from its doubts.

RATE = 120.0
"""Samples a second from which outcomes are told."""
MOST_SAMPLES = 100_000
"""Of one draw."""
KEPT = 121
"""Samples of a draw that are kept, at most, evenly over its time."""
MOST_KEPT = 10_000_000
"""Poses that are kept of all draws together: 240 MB."""


@dataclass(frozen=True)
class Ensemble:
    """N draws of a scene with B bodies and P doubts, K samples of each."""

    seed: int
    doubts: tuple[UncertainValue, ...]
    values: Array
    """(N, P): what was drawn."""
    light: UncertainLight | None
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
    return bool(uncertain_values(scene, variant)) or uncertain_light(scene, variant) is not None


def simulate_ensemble(
    scene: Scene,
    compiled: Compiled,
    count: int,
    seed: int = 0,
    variant: str | None = None,
    progress: Progress = silent,
) -> Ensemble:
    """`count` draws of what is uncertain, simulated; `variant` is the one that was applied to the scene.

    A draw that cannot be simulated is told in `failures`. Raises InputError where the scene itself cannot be.
    """
    world = compiled.world
    found, light = uncertain_values(scene, variant), uncertain_light(scene, variant)
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
            of_draw = compile_shapes(drawn(scene, found, values[k]), compiled.shapes).world
            run = simulate(of_draw, times)
        except InputError as error:
            failures |= {f"{p.path} {p.expected}": p for p in error.problems if p.path not in failures}
            outcomes.append(None)
            continue
        poses[k] = run.poses[kept]
        outcomes.append(outcome(of_draw, run))
    return Ensemble(
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
