"""Simulate a scene many times with drawn values, and classify the outcomes of each
object.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from math import ceil, degrees, radians, sqrt
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.compile import CompiledScene, compile_shapes
from physgen.compile.world import Body, World
from physgen.geometry.polygon import Array
from physgen.problems import InputError, Problem
from physgen.progress import Progress, silent
from physgen.scene.scene import Motion, Scene, View
from physgen.simulate.engine import simulate
from physgen.simulate.forces import area
from physgen.simulate.trajectory import Trajectory
from physgen.simulate.uncertain_values import (
    UncertainValue,
    draw_values,
    uncertain_values,
    with_draw,
)
from physgen.text import rounded

Flags = NDArray[np.bool_]

RATE = 120.0
"""Samples per second for the classification of outcomes."""
KEPT_SAMPLES = 121
"""Maximum number of stored samples of a draw, evenly over its time."""
TIP_ANGLE = radians(45)
"""Rotation beyond which an object stands on another side."""
SIZE_SHARE = 0.5
"""Share of its size within which an object stays at its place, and does not fall."""


COLUMNS = ("fate", "x_px", "y_px", "angle_degrees")  # of each object in the table


class Fate(IntEnum):
    """The outcome of an object; if several apply, the largest."""

    STAYS = 0
    """It never moves farther than half its size."""
    MOVES = 1
    LEAVES = 2
    """At the end, no part of it is in the photo."""
    FALLS = 3
    """It tips over or drops."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of one simulation of B bodies."""

    fates: NDArray[np.int32]  # (B,) numbers of `Fate`
    final: Array  # (B, 3): px, px, rad at the end


@dataclass(frozen=True)
class Ensemble:
    """N simulations of a scene with B bodies and P uncertain values, with K samples
    each.
    """

    seed: int
    doubts: tuple[UncertainValue, ...]
    values: Array  # (N, P): the draws
    names: tuple[str, ...]  # of bodies
    sizes: Array  # (B,) px; see `size`
    times: Array  # (K,) s
    poses: Array  # (N, K, B, 3): px, px, rad; NaN for failed draws
    outcomes: tuple[Outcome | None, ...]  # one per draw
    clip_outcome: Outcome  # outcome with the values of the file, as in the clip
    own_poses: Array  # (K, B, 3)
    failures: tuple[Problem, ...] = ()
    """Reasons of failed draws, each once."""

    @property
    def complete_draws(self) -> list[int]:
        """Return the numbers of the simulated draws."""
        draws = []
        for k, outcome in enumerate(self.outcomes):
            if outcome is not None:
                draws.append(k)
        return draws

    def table(self) -> str:
        """Return CSV with a line per draw: the values, then the outcome of each body.

        docs/rendering.md describes the columns.
        """
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        outcomes = []
        for name in self.names:
            for column in COLUMNS:
                outcomes.append(f"{name}.{column}")
        rows.writerow(["draw", *(value.path for value in self.doubts), *outcomes])
        for number, outcome in enumerate(self.outcomes):
            cells: list[Any] = [number, *self.values[number].tolist()]
            if outcome is None:
                # A draw that could not be simulated keeps its line with its values.
                cells += [""] * len(outcomes)
            else:
                for fate, (x, y, angle) in zip(
                    outcome.fates.tolist(), outcome.final.tolist(), strict=True
                ):
                    cells += [Fate(fate).name.lower(), x, y, degrees(angle)]
            rows.writerow(cells)
        return text.getvalue()


def simulate_ensemble(
    scene: Scene,
    compiled_scene: CompiledScene,
    count: int,
    seed: int = 0,
    variant: str | None = None,
    progress: Progress = silent,
) -> Ensemble:
    """Simulate `count` draws of a scene with the edits of `variant`.

    Failed draws are in `failures`. Raises InputError if the scene itself cannot be
    simulated.
    """
    world = compiled_scene.world
    doubts = uncertain_values(scene, variant)
    values = draw_values(doubts, seed, count)
    # Outcomes need far fewer samples than a video.
    times = np.linspace(0, world.duration, max(ceil(world.duration * RATE), 2) + 1)
    stored_samples = _stored_samples(len(times))
    # A scene with invalid values of its own raises an error here.
    own_run = simulate(world, times)
    own_poses = own_run.poses[stored_samples]
    poses = np.full((count, *own_poses.shape), np.nan)
    outcomes: list[Outcome | None] = []
    failures: dict[str, Problem] = {}
    for number in range(count):
        progress("fan", number, count)
        try:
            draw = with_draw(scene, doubts, values[number])
            drawn_world = compile_shapes(draw, compiled_scene.shapes).world
            run = simulate(drawn_world, times)
        except InputError as error:
            failures |= _new_failures(error, failures)
            outcomes.append(None)
            continue
        poses[number] = run.poses[stored_samples]
        outcomes.append(outcome(drawn_world, run))
    return Ensemble(
        seed=seed,
        doubts=doubts,
        values=values,
        names=tuple(body.name for body in world.bodies),
        sizes=np.array(list(map(size, world.bodies))),
        times=times[stored_samples],
        poses=poses,
        outcomes=tuple(outcomes),
        clip_outcome=outcome(world, own_run),
        own_poses=own_poses,
        failures=tuple(failures.values()),
    )


def _new_failures(
    error: InputError, failures: Mapping[str, Problem]
) -> dict[str, Problem]:
    """Return the problems of an error that are not known, by path and expectation."""
    new_failures = {}
    for problem in error.problems:
        key = f"{problem.path} {problem.expected}"
        if key not in failures:
            new_failures[key] = problem
    return new_failures


def _stored_samples(count: int) -> NDArray[np.intp]:
    """Return the evenly spaced samples of `count` that an ensemble keeps."""
    positions = np.linspace(0, count - 1, min(KEPT_SAMPLES, count))
    return positions.round().astype(np.intp)


def size(body: Body) -> float:
    """Return the diameter of a disc with the body's area, px."""
    return float(2 * np.sqrt(area(body) / np.pi))


def outcome(world: World, run: Trajectory) -> Outcome:
    """Return the outcome of a densely sampled simulation.

    A body falls if it tips by more than 45 degrees, or drops by more than half its
    size, more steeply than at 45 degrees: a body that slides or rolls down a slope does
    not fall. Circles do not tip, and bodies with joints do not fall.
    """
    start = run.poses[0]
    final = run.poses[-1]
    sizes = np.array(list(map(size, world.bodies)))
    # The farthest place on the way counts, not the last one: an object that swings
    # back has moved.
    distances = np.hypot(*np.moveaxis(run.poses[:, :, :2] - start[:, :2], 2, 0)).max(
        axis=0
    )
    rotations = np.abs(run.poses[:, :, 2] - start[:, 2]).max(axis=0)
    is_tipped = (rotations > TIP_ANGLE) & np.array(
        [body.radius is None for body in world.bodies], bool
    )
    is_fallen = _can_fall(world) & (
        is_tipped | (_drop(world, run) > SIZE_SHARE * sizes)
    )
    # A later fate replaces an earlier one: to fall tells more than to leave, and to
    # leave more than to move.
    fates = np.where(distances > SIZE_SHARE * sizes, Fate.MOVES, Fate.STAYS)
    fates = np.where(_outside(world, final), Fate.LEAVES, fates)
    return Outcome(np.where(is_fallen, Fate.FALLS, fates).astype(np.int32), final)


def _can_fall(world: World) -> Flags:
    """Return the mask (B,) of dynamic bodies without joints, if gravity acts in a side
    view.
    """
    jointed_bodies: set[int | None] = set()
    for joint in world.joints:
        jointed_bodies.update((joint.first, joint.second))
    has_gravity = world.view is View.SIDE and world.gravity.any()
    can_fall = []
    for number, body in enumerate(world.bodies):
        can_fall.append(
            has_gravity
            and body.motion is Motion.DYNAMIC
            and number not in jointed_bodies
        )
    return np.array(can_fall, bool)


def _drop(world: World, run: Trajectory) -> Array:
    """Return the steep drop of each body, px, (B,).

    It is the sum over the samples in which a body moves more down than sideways, and at
    most its largest depth below its start.
    """
    if not world.gravity.any():
        return np.zeros(len(world.bodies))
    down = world.gravity / np.hypot(*world.gravity)
    steps = np.diff(run.poses[:, :, :2], axis=0)
    descents = steps @ down
    sideways_steps = np.abs(steps @ np.array([-down[1], down[0]]))
    steep_drops = np.where(descents > sideways_steps, descents, 0.0).sum(axis=0)
    return np.asarray(
        np.minimum(steep_drops, (descents.cumsum(axis=0)).max(axis=0, initial=0.0))
    )


def _outside(world: World, poses: Array) -> Flags:
    """Return the mask (B,) of bodies with no part on the canvas."""
    width, height = world.size
    reach = np.array([body.reach for body in world.bodies])
    x = poses[:, 0]
    y = poses[:, 1]
    is_outside = (
        (x + reach < -0.5)
        | (x - reach > width - 0.5)
        | (y + reach < -0.5)
        | (y - reach > height - 0.5)
    )
    return np.asarray(is_outside)


LEVEL = 0.95
"""Level of confidence intervals."""
MOST = 0.9
"""Share of the draws within the radius of final places."""
VERBS = {
    Fate.STAYS: "stays",
    Fate.MOVES: "moves",
    Fate.LEAVES: "leaves the photo",
    Fate.FALLS: "falls",
}


def wilson(count: int, total: int) -> tuple[float, float]:
    """Return the 95 % interval of a share of `count` in `total` draws.

    Wilson's score interval (J. Am. Stat. Assoc. 22, 1927).

    >>> [round(end, 3) for end in wilson(13, 32)]
    [0.255, 0.577]
    """
    z = NormalDist().inv_cdf((1 + LEVEL) / 2)
    # The interval is not centred at the share: its middle is drawn towards 1/2.
    share, correction = count / total, z * z / total
    middle = (share + correction / 2) / (1 + correction)
    half_width = (
        z
        / (1 + correction)
        * sqrt(share * (1 - share) / total + correction / (4 * total))
    )
    return max(middle - half_width, 0.0), min(middle + half_width, 1.0)


def radius(places: Array) -> float:
    """Return the radius, px, around the median with 9 of 10 places
    `(N, 2)`.
    """
    offsets = places - np.median(places, axis=0)
    if len(places):
        return float(np.quantile(np.hypot(*offsets.T), MOST, method="higher"))
    return 0.0


def percent(share: float) -> str:
    """Return a share as text.

    >>> percent(0.4062), percent(1.0), percent(0.997)
    ('41 %', '100 %', '99.7 %')
    """
    number = 100 * share
    if 0 < number < 1 or 99 < number < 100:
        return f"{number:.1f} %"
    return f"{number:.0f} %"


@dataclass(frozen=True)
class Verdict:
    """The outcomes of one body in all draws."""

    name: str
    counts: Mapping[Fate, int]  # numbers of simulated draws
    event: Fate  # the largest fate in any draw
    interval: tuple[float, float]
    """Confidence interval of the event's share, 0..1."""
    radius: float
    """Radius around the median final place with 9 of 10 draws, px."""
    size: float  # px; see `uncertainty.size`
    clip_fate: Fate  # fate in the clip

    @property
    def total(self) -> int:
        """Return the number of simulated draws."""
        return sum(self.counts.values())

    @property
    def share(self) -> float:
        """Return the event's share of all draws, 0..1."""
        return self.counts[self.event] / self.total

    @property
    def decided(self) -> bool:
        """Check whether every draw has the same fate."""
        return self.counts[self.event] == self.total

    @property
    def placed(self) -> bool:
        """Check whether the final place is also decided, relative to the body's
        size.
        """
        return self.radius <= SIZE_SHARE * self.size

    def sentences(self) -> list[str]:
        """Return sentences on certain and uncertain events, without the body's name."""
        low, high = (percent(end) for end in self.interval)
        count = self.counts[self.event]
        total = self.total
        verb = VERBS[self.event]
        interval = f"95 % interval {low} to {high}"
        if self.decided:
            lines = [f"Decided by the photo: {verb} in all {total} draws ({interval})."]
        else:
            others = ", ".join(
                f"{VERBS[fate]} in {self.counts[fate]}"
                for fate in sorted(Fate, reverse=True)
                if fate is not self.event and self.counts[fate]
            )
            lines = [
                f"Not decided: {verb} in {count} of {total} draws ({percent(self.share)}, {interval}), {others}."
            ]
        if self.event is not Fate.STAYS:
            phrase = "is not"
            if self.placed:
                phrase = "is"
            lines.append(
                f"Where it ends {phrase} decided: 9 of 10 draws lie within {rounded(self.radius)} px."
            )
        return lines

    def as_dict(self) -> dict[str, Any]:
        """Return the verdict as plain data."""
        return {
            "draws": {
                fate.name.lower(): self.counts[fate]
                for fate in Fate
                if self.counts[fate]
            },
            "decided": self.decided,
            "event": self.event.name.lower(),
            "share": round(self.share, 6),
            "interval": [round(end, 6) for end in self.interval],
            "place_decided": self.placed,
            "place_radius_px": round(self.radius, 3),
            "size_px": round(self.size, 3),
            "clip": self.clip_fate.name.lower(),
            "verdict": " ".join(self.sentences()),
        }


def verdicts(fan: Ensemble) -> list[Verdict]:
    """Return a verdict for each body; none if no draw could be simulated."""
    outcomes = []
    for outcome in fan.outcomes:
        if outcome is not None:
            outcomes.append(outcome)
    return [_verdict(fan, b, outcomes) for b in range(len(fan.names)) if outcomes]


def headline(fan: Ensemble, verdicts: Sequence[Verdict]) -> str:
    """Return one sentence about all bodies."""
    if not verdicts:
        if fan.names:
            return f"None of the {len(fan.outcomes)} draws could be simulated."
        return "Nothing can move."
    count = len(verdicts)
    fates = sum(v.decided for v in verdicts)
    places = sum(v.decided and v.placed for v in verdicts)
    objects = f"{count} object{'s' * (count != 1)}"
    return f"The photo decides what becomes of {fates} of {objects}, and where {places} of {count} end."


def _verdict(fan: Ensemble, b: int, outcomes: list[Outcome]) -> Verdict:
    """Return the verdict on body `b`."""
    fates = [Fate(int(outcome.fates[b])) for outcome in outcomes]
    counts = {fate: fates.count(fate) for fate in Fate}
    event = max(fates)
    return Verdict(
        name=fan.names[b],
        counts=counts,
        event=event,
        interval=wilson(counts[event], len(outcomes)),
        radius=radius(np.array([outcome.final[b, :2] for outcome in outcomes])),
        size=float(fan.sizes[b]),
        clip_fate=Fate(int(fan.clip_outcome.fates[b])),
    )
