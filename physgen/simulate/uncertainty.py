"""Simulate a scene many times with drawn values, and classify what becomes of each object."""

from __future__ import annotations

import csv
import io
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
    draw_directions,
    draw_values,
    uncertain_light,
    uncertain_values,
    with_draw,
)

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Index = NDArray[np.int32]

RATE = 120.0
"""Samples per second that outcomes are derived from."""
MAX_SAMPLES = 100_000
"""Of one draw."""
KEPT_SAMPLES = 121
"""Samples of a draw that are kept, at most, evenly over its time."""
MAX_KEPT_POSES = 10_000_000
"""Of all draws together: 240 MB."""
TIP_ANGLE = radians(45)
"""An object turned further stands on another side."""
SIZE_SHARE = 0.5
"""Of its size: an object that goes no further stays, and one that comes down by no more does not fall."""
REST_DISTANCE = 0.5
"""px within which an object at rest stays to the end."""
REST_SHARE = 0.1
"""Of the clip's time for which an object has to rest, at least."""
TOUCHING_DISTANCE = 1.0
"""px by which two objects have moved, at most, when they touch, if they touched from the start."""
COLUMNS = (
    "fate", "tips", "drops", "x_px", "y_px", "angle_degrees", "turned_degrees", "rests_s", "touches_first",
)  # fmt: skip
"""Of each object in the table."""


class Fate(IntEnum):
    """What becomes of an object; where several hold, the largest."""

    STAYS = 0
    """It never goes further from its place than half its size."""
    MOVES = 1
    LEAVES = 2
    """At the end, no part of it is in the photo."""
    FALLS = 3
    """It tips over or drops."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of one simulation of B bodies."""

    fates: Index
    """(B,) numbers of `Fate`."""
    tips: Flags
    """(B,): turns by more than 45 degrees from how it stood; not of circles, nor of what a joint holds."""
    drops: Flags
    """(B,): gets lower by more than half its size, and comes down as far at once: through the air, or more steeply than
    at 45 degrees. What slides or rolls down a slope does not."""
    final: Array
    """(B, 3): px, px, rad at the end."""
    turned: Array
    """(B,) rad from how it stood, at most."""
    rests: Array
    """(B,) s since when it rests to the end; infinite where it does not."""
    first: Index
    """(B,): the first new contact, an index into `World.surfaces`; -1: none."""

    def cells(self, b: int, surfaces: tuple[str, ...]) -> list[Any]:
        """Of one body, for `COLUMNS`."""
        first, rests = int(self.first[b]), float(self.rests[b])
        return [
            Fate(int(self.fates[b])).name.lower(),
            int(self.tips[b]),
            int(self.drops[b]),
            *self.final[b, :2].tolist(),
            degrees(self.final[b, 2]),
            degrees(self.turned[b]),
            "" if np.isinf(rests) else rests,
            "" if first < 0 else surfaces[first],
        ]


@dataclass(frozen=True)
class Ensemble:
    """N simulations of a scene with B bodies and P uncertain values, K samples of each."""

    seed: int
    doubts: tuple[UncertainValue, ...]
    values: Array
    """(N, P): the draws."""
    light: UncertainLight | None
    directions: Array
    """(N, 3): towards the light, as drawn; (0, 3) where it is certain."""
    names: tuple[str, ...]
    """Of bodies."""
    surfaces: tuple[str, ...]
    """Of bodies, then of boundaries."""
    sizes: Array
    """(B,) px; see `size`."""
    times: Array
    """(K,) s."""
    poses: Array
    """(N, K, B, 3): px, px, rad; NaN where a draw could not be simulated."""
    outcomes: tuple[Outcome | None, ...]
    """One per draw."""
    own: Outcome
    """With the values of the file, which the clip shows."""
    own_poses: Array
    """(K, B, 3)."""
    failures: tuple[Problem, ...] = ()
    """Why draws could not be simulated, each reason once."""

    @property
    def whole(self) -> list[int]:
        """Numbers of the draws that could be simulated."""
        return [k for k, outcome in enumerate(self.outcomes) if outcome is not None]

    def table(self) -> str:
        """CSV with a line per draw: the drawn values, then the outcome of each body; docs/fan.md has the columns."""
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        lights = [f"light.direction.{axis}" for axis in "xyz"] if self.light is not None else []
        paths = [value.path for value in self.doubts]
        columns = [f"{name}.{column}" for name in self.names for column in COLUMNS]
        rows.writerow(["draw", *paths, *lights, *columns])
        for k, outcome in enumerate(self.outcomes):
            cells: list[Any] = [k, *self.values[k].tolist(), *(self.directions[k].tolist() if lights else [])]
            for b in range(len(self.names)):
                cells += [""] * len(COLUMNS) if outcome is None else outcome.cells(b, self.surfaces)
            rows.writerow(cells)
        return text.getvalue()


def uncertain(scene: Scene, variant: str | None = None) -> bool:
    """Whether anything of the scene is uncertain."""
    return bool(uncertain_values(scene, variant)) or uncertain_light(scene, variant) is not None


def simulate_ensemble(
    scene: Scene,
    compiled: Compiled,
    count: int,
    seed: int = 0,
    variant: str | None = None,
    progress: Progress = silent,
) -> Ensemble:
    """Simulates `count` draws; `variant` is the one that was applied to the scene.

    Draws that cannot be simulated are in `failures`. Raises InputError where the scene itself cannot be.
    """
    world = compiled.world
    found, light = uncertain_values(scene, variant), uncertain_light(scene, variant)
    values = draw_values(found, seed, count)
    samples = int(np.clip(np.ceil(world.duration * RATE), 2, MAX_SAMPLES)) + 1
    times = np.linspace(0, world.duration, samples)
    most = min(KEPT_SAMPLES, samples)
    kept_count = int(np.clip(MAX_KEPT_POSES // (count * max(len(world.bodies), 1)), 2, most))
    kept = np.unique(np.linspace(0, samples - 1, kept_count).round().astype(np.intp))
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
            drawn_world = compile_shapes(with_draw(scene, found, values[k]), compiled.shapes).world
            run = simulate(drawn_world, times)
        except InputError as error:
            failures |= {f"{p.path} {p.expected}": p for p in error.problems if p.path not in failures}
            outcomes.append(None)
            continue
        poses[k] = run.poses[kept]
        outcomes.append(outcome(drawn_world, run))
    return Ensemble(
        seed=seed,
        doubts=found,
        values=values,
        light=light,
        directions=np.zeros((0, 3)) if light is None else draw_directions(light, seed, count),
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


def size(body: Body) -> float:
    """px: the diameter of a disc of the body's area."""
    if body.radius is not None:
        return 2 * body.radius
    area = sum(abs(polygon_moments(piece).area) for piece in body.pieces)
    return float(2 * np.sqrt(area / np.pi))


def outcome(world: World, run: Trajectory) -> Outcome:
    """The outcome of a densely sampled simulation."""
    start, final = run.poses[0], run.poses[-1]
    sizes = np.array([size(body) for body in world.bodies])
    away = np.hypot(*np.moveaxis(run.poses[:, :, :2] - start[:, :2], 2, 0)).max(axis=0)
    turned = np.abs(run.poses[:, :, 2] - start[:, 2]).max(axis=0)
    can_fall = _can_fall(world)
    tips = can_fall & (turned > TIP_ANGLE) & np.array([body.radius is None for body in world.bodies], bool)
    drops = can_fall & _drops(world, run, SIZE_SHARE * sizes)
    fates = np.where(away > SIZE_SHARE * sizes, Fate.MOVES, Fate.STAYS)
    fates = np.where(_outside(world, final), Fate.LEAVES, fates)
    fates = np.where(tips | drops, Fate.FALLS, fates)
    rests, first = _rests(run), _first_contacts(world, run)
    return Outcome(fates.astype(np.int32), tips, drops, final, turned, rests, first)


def _can_fall(world: World) -> Flags:
    """Dynamic bodies of a scene with gravity that no joint holds in the world."""
    free = np.array([body.motion is Motion.DYNAMIC for body in world.bodies], bool)
    if world.view is View.TOP or not world.gravity.any():
        return np.zeros(len(free), bool)
    held, more = ~free, True
    while more:  # what is joined to a held body is held
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
    falling = steep | ~_touching(run)
    fallen = np.zeros(len(least), bool)
    top = depth[0]
    for k in range(1, len(depth)):
        top = np.where(falling[k - 1], np.minimum(top, depth[k]), depth[k])
        fallen |= (depth[k] - top > least) & (depth[k] > least)
    return fallen


def _touching(run: Trajectory) -> Flags:
    """(T - 1, B): whether a body has a contact between two samples."""
    count = len(run.names)
    found = np.zeros((len(run.times) - 1, count), bool)
    contacts = run.contacts
    begins = np.searchsorted(run.times, contacts.touch_times[:, 0], side="right") - 1
    ends = np.searchsorted(run.times, contacts.touch_times[:, 1], side="left")
    for pair, begin, end in zip(contacts.touch_pairs.tolist(), begins.tolist(), ends.tolist(), strict=True):
        for body in pair:
            if body < count:
                found[max(begin, 0) : end, body] = True
    return found


def _outside(world: World, poses: Array) -> Flags:
    """(B,): bodies of which no part is on the canvas."""
    width, height = world.size
    reach = np.array([body.reach for body in world.bodies])
    x, y = poses[:, 0], poses[:, 1]
    out = (x + reach < -0.5) | (x - reach > width - 0.5) | (y + reach < -0.5) | (y - reach > height - 0.5)
    return np.asarray(out)


def _rests(run: Trajectory) -> Array:
    off = np.hypot(*np.moveaxis(run.poses[:, :, :2] - run.poses[-1, :, :2], 2, 0)) > REST_DISTANCE
    later = len(off) - np.argmax(off[::-1], axis=0)  # the sample after the last one that is off
    since = run.times[np.where(off.any(axis=0), np.minimum(later, len(off) - 1), 0)]
    return np.asarray(np.where(since <= (1 - REST_SHARE) * run.times[-1], since, np.inf))


def _first_contacts(world: World, run: Trajectory) -> Index:
    first = np.full(len(run.names), -1, np.int32)
    reach = np.array([body.reach for body in world.bodies])
    from_start: set[tuple[int, ...]] = set()
    begins = run.contacts.touch_times[:, 0]
    samples = np.maximum(np.searchsorted(run.times, begins, side="right") - 1, 0)
    for pair, sample in zip(run.contacts.touch_pairs.tolist(), samples.tolist(), strict=True):
        if tuple(pair) in from_start:
            continue
        bodies = [body for body in pair if body < len(first)]
        off = run.poses[sample, bodies] - run.poses[0, bodies]
        moved = float((np.hypot(off[:, 0], off[:, 1]) + reach[bodies] * np.abs(off[:, 2])).sum())
        if moved < TOUCHING_DISTANCE:
            from_start.add(tuple(pair))
            continue
        for body, other in (pair, pair[::-1]):
            if body < len(first) and first[body] < 0:
                first[body] = other
    return first
