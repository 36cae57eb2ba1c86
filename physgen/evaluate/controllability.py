"""How the motion of one object answers to the direction and size of a push (the paper's figure 6).

A push is an impulse at t = 0 through the centre of mass (the paper's F0), in px/s: the speed that it gives. The
answer is the displacement at the end from where the object would be without the push.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import atan2, cos, degrees, hypot, pi, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen import pipeline
from physgen.compile.world import Body, World
from physgen.compile.world import Push as WorldPush
from physgen.evaluate.measure import Findings, Progress, Section, Table, number
from physgen.geometry.polygon import Array
from physgen.problems import InputError
from physgen.registry import suggestion
from physgen.scene.scene import Load, Motion, Scene, Solid, View
from physgen.simulate.trajectory import Trajectory, new_touches


@dataclass(frozen=True)
class Constants:
    """Of the sweep and its reading."""

    sizes: int = 5
    """Sizes of pushes, by default."""
    reach: float = 1 / 3
    """Part of the canvas's shorter side that the hardest push takes an object, by default."""
    seen: float = 0.5
    """px from which on an answer has a direction."""
    equal: float = 0.01
    """px up to which two answers are the same."""
    short: int = 400
    """px of the photo's longer side in a plot at most."""
    pale: float = 0.55
    """Part of the photo's contrast that is kept under the paths."""


CONSTANTS = Constants()


# ---- pushes and motions ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Course:
    """Path of one object."""

    places: Array
    """(T, 2) px: its centre of mass."""
    free: int
    """Number of first samples before it touches an object that it did not touch at the start."""


def course_of(trajectory: Trajectory, name: str) -> Course:
    """Raises ValueError where the trajectory has no such object."""
    body = trajectory.names.index(name)
    mine = new_touches(trajectory) & (trajectory.contacts.touch_pairs == body).any(
        axis=1
    )
    first = float(trajectory.contacts.touch_times[mine, 0].min(initial=np.inf))
    free = int(np.searchsorted(trajectory.times, first, side="right"))
    return Course(trajectory.poses[:, body, :2], free)


@dataclass(frozen=True)
class Push:
    """Impulse over mass, px/s, y down."""

    x: float
    y: float

    @property
    def size(self) -> float:
        return hypot(self.x, self.y)

    @property
    def angle(self) -> float:
        """degrees in [0, 360): 0 to the right, 90 down."""
        return round(degrees(atan2(self.y, self.x)), 6) % 360


@dataclass(frozen=True)
class Outcome:
    """One push and its effect."""

    push: Push
    path: Course
    response: Array
    """(2,) px at the end, from where it would be without the push."""
    at_first: Array
    """(2,) px: the same at the last sample before it meets an object, at the end where it meets none."""

    @property
    def met(self) -> bool:
        return self.path.free < len(self.path.places)

    @property
    def length(self) -> float:
        """px of the response."""
        return float(np.hypot(*self.response))

    @property
    def off(self) -> float | None:
        """degrees between the push and the answer until it meets an object; None where that is too short."""
        x, y = self.at_first
        if hypot(x, y) < CONSTANTS.seen:
            return None
        push = self.push
        return abs(degrees(atan2(push.x * y - push.y * x, push.x * x + push.y * y)))


def outcome(push: Push, path: Course, still: Course) -> Outcome:
    """`still` is the path without a push."""
    off = path.places - still.places
    return Outcome(push, path, off[-1], off[max(path.free - 1, 0)])


@dataclass(frozen=True)
class Swept:
    """All pushes of one object."""

    scene: str
    object: str
    view: View
    outcomes: tuple[Outcome, ...]
    still: Course
    """Without a push."""
    photo: NDArray[np.uint8] | None = None
    """(H, W, 3) sRGB."""


def sweep(
    scene: Scene,
    name: str | None,
    angles: int,
    sizes: Sequence[float],
    progress: Progress,
) -> Swept:
    """`sizes` are px/s, none: chosen by the scene. Raises InputError where no such object can be pushed."""
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    index = pushed(scene, compiled.world, name)
    world = quiet(compiled.world, index)
    body = world.bodies[index]
    sizes = list(sizes) or usual(world, body)
    turns = directions(angles, world.view)
    pushes = [
        Push(size * cos(turn), size * sin(turn)) for turn in turns for size in sizes
    ]
    progress("no push", 0, len(pushes) + 1)
    still = course_of(pipeline.simulate(world), body.name)
    outcomes = []
    for k, push in enumerate(pushes, 1):
        progress(f"push {k}", k, len(pushes) + 1)
        vector = body.mass * np.array([push.x, push.y])
        load = WorldPush(index, Load.IMPULSE, vector, 0.0, np.zeros(2), 0.0, 0.0)
        run = pipeline.simulate(replace(world, pushes=(*world.pushes, load)))
        outcomes.append(outcome(push, course_of(run, body.name), still))
    photo = None if maps is None else maps.rgb
    return Swept(scene.name, body.name, world.view, tuple(outcomes), still, photo)


def pushed(scene: Scene, world: World, name: str | None) -> int:
    """Index of the object; unless it is named, the one that the scene pushes, or that moves first, or the first."""
    free = [body.name for body in world.bodies if body.motion is Motion.DYNAMIC]
    if not free:
        place = str(scene.place("objects").file)
        raise InputError.of(
            place, "", "has no object that can be pushed", "give it a dynamic object"
        )
    if name is None:
        forced = [world.bodies[push.body].name for push in world.pushes]
        moving = [body.name for body in world.bodies if np.hypot(*body.velocity) > 0]
        name = next((one for one in (*forced, *moving) if one in free), free[0])
    names = [body.name for body in world.bodies]
    if name not in free:
        known = name in names
        expected = (
            "cannot be pushed: it is not dynamic"
            if known
            else "is no object of the scene"
        )
        raise InputError.of(
            "--object",
            f'"{name}"',
            expected,
            suggestion(name, free if known else names),
        )
    return names.index(name)


def quiet(world: World, index: int) -> World:
    """The world with that body at rest and without pushes of it; all others move as they do."""
    rest = replace(
        world.bodies[index], velocity=np.zeros(2), spin=0.0, roll=np.zeros(2)
    )
    bodies = (*world.bodies[:index], rest, *world.bodies[index + 1 :])
    return replace(
        world,
        bodies=bodies,
        pushes=tuple(push for push in world.pushes if push.body != index),
    )


def directions(count: int, view: View) -> list[float]:
    """rad. Seen from above all round; from the side from right over up to left, never down into the ground."""
    if view is View.TOP:
        return [2 * pi * k / count for k in range(count)]
    return [-pi * k / max(count - 1, 1) for k in range(count)]


def usual(world: World, body: Body) -> list[float]:
    """px/s: even steps up to what takes the body about a third of the canvas, sliding or rolling."""
    kept = 1.0
    if world.view is View.TOP and body.solid is Solid.SPHERE:
        kept = 5 / 7  # of its speed, once it rolls
        brake = kept * body.rolling * world.press
    elif world.view is View.TOP:
        brake = body.surface.friction * world.table.friction * world.press
    else:
        ground = max((wall.surface.friction for wall in world.walls), default=0.0)
        slides = body.radius is None
        brake = (
            body.surface.friction * ground * float(np.hypot(*world.gravity))
            if slides
            else 0.0
        )
    reach = CONSTANTS.reach * min(world.size)
    most = sqrt(2 * brake * reach)  # it stops there
    if most >= brake * world.duration:  # it does not stop within the clip
        most = reach / world.duration + brake * world.duration / 2
    step = float(f"{most / kept / CONSTANTS.sizes:.2g}")
    return [step * k for k in range(1, CONSTANTS.sizes + 1)]


# ---- answers -----------------------------------------------------------------------------------------------------

Share = tuple[int, int]
"""Number of those that are as they should be, and of all."""


def growing(outcomes: Sequence[Outcome]) -> Share:
    """Steps from a push to the next harder one: those with a larger answer, and all."""
    steps = [b - a for a, b in pairwise(_lengths(outcomes))]
    return sum(step > CONSTANTS.equal / 2 for step in steps), len(steps)


def _lengths(outcomes: Sequence[Outcome]) -> list[float]:
    return [round(one.length / CONSTANTS.equal) * CONSTANTS.equal for one in outcomes]


@dataclass(frozen=True)
class Along:
    """Pushes of one direction, or of all."""

    outcomes: tuple[Outcome, ...]
    """By size."""
    steps: Share
    """See `growing`."""
    free: Share
    """`steps` of the pushes by which it meets no object."""
    spearman: float
    """Rank correlation of the push's size and the answer's length; 0 of a single push. Of all: the mean."""

    @property
    def off(self) -> list[float]:
        """degrees between pushes and answers, until it meets an object; of answers that have a direction."""
        return [one.off for one in self.outcomes if one.off is not None]

    @property
    def sideways(self) -> Share:
        """Pushes to the left or right: answers to the same side, and all that have a side."""
        sides = [
            one.push.x * float(one.at_first[0])
            > 0  # gravity brings down what is pushed up, and leaves x alone
            for one in self.outcomes
            if abs(one.push.x) > 1e-6 * one.push.size
            and abs(one.at_first[0]) >= CONSTANTS.seen
        ]
        return sum(sides), len(sides)


def by_direction(swept: Swept) -> list[Along]:
    """In the order of angles."""
    by_angle: dict[int, list[Outcome]] = {}
    for one in sorted(swept.outcomes, key=lambda one: one.push.size):
        by_angle.setdefault(round(one.push.angle) % 360, []).append(one)
    along = []
    for _, part in sorted(by_angle.items()):
        sizes = np.array([one.push.size for one in part])
        free = growing([one for one in part if not one.met])
        spearman = correlation(sizes, np.array(_lengths(part)))
        along.append(Along(tuple(part), growing(part), free, spearman))
    return along


def together(along: Sequence[Along]) -> Along:
    """All directions."""
    steps, free = (
        (sum(share[0] for share in shares), sum(share[1] for share in shares))
        for shares in ([one.steps for one in along], [one.free for one in along])
    )
    outcomes = tuple(each for one in along for each in one.outcomes)
    return Along(outcomes, steps, free, float(np.mean([one.spearman for one in along])))


# ---- report ------------------------------------------------------------------------------------------------------

NOTE = (
    "Answer: from where the object would be at the end without the push, to where it is. Spearman: rank correlation "
    "of the push's size and the answer's length. 0 degrees is to the right, 90 down."
)


def findings(swept: Swept) -> Findings:
    """Without the plot, which `plot` makes."""
    along = by_direction(swept)
    found = together(along)
    still = float(np.hypot(*(swept.still.places[-1] - swept.still.places[0])))
    least = min(one.spearman for one in along)
    sentences = tuple(_sentences(found, swept, least, still))
    median = float(np.median(found.off)) if found.off else None
    more = {
        "scene": swept.scene,
        "object": swept.object,
        "pushes": len(swept.outcomes),
        "steps": found.steps[1],
        "rising": found.steps[0],
        "meeting_nobody": {"steps": found.free[1], "rising": found.free[0]},
        "spearman_mean": found.spearman,
        "spearman_least": least,
        "off_until_met": {
            "median": median,
            "worst": max(found.off, default=None),
            "of": len(found.off),
        },
        "sideways": {"same": found.sideways[0], "of": found.sideways[1]},
        "still_px": still,
    }
    title = f"Controllability: {swept.object} of {swept.scene}"
    rows = [_row(one) for one in found.outcomes]
    return Findings(
        "controllability",
        title,
        sentences,
        (_direction_section(along),),
        rows,
        (),
        more,
    )


def _sentences(found: Along, swept: Swept, least: float, still: float) -> Iterator[str]:
    if found.steps[1]:
        yield (
            f"A harder push takes {swept.object} farther in {_of(found.steps)} steps; Spearman's correlation of push "
            f"and answer is {found.spearman:.3f} on average over directions, {least:.3f} at the least."
        )
        if found.free[1] and any(one.met for one in swept.outcomes):
            yield f"Where it meets no object, a harder push takes it farther in {_of(found.free)} steps."
    if swept.view is View.SIDE and found.sideways[1]:
        yield (
            f"Until it meets an object it goes to the side that it is pushed to in {_of(found.sideways)} pushes. Seen "
            "from the side, angles say less: what is pushed up comes down again."
        )
    elif found.off:
        median, worst = _degrees(float(np.median(found.off))), _degrees(max(found.off))
        yield f"Until it meets an object it goes where it is pushed, off by {median} (median), {worst} at most."
    yield f"Without a push it moves by {still:.2f} px."
    yield "The paper shows the same as pictures (figure 6) and gives no number."


def _of(share: Share) -> str:
    return f"{share[0]} of {share[1]}"


def _degrees(angle: float) -> str:
    return (
        "under 0.01°"
        if angle < 0.01
        else f"{angle:.2g}°"
        if angle < 10
        else f"{angle:.0f}°"
    )


def _direction_section(along: Sequence[Along]) -> Section:
    rows = []
    for one in along:
        longest = f"{max(each.length for each in one.outcomes):.1f}"
        off = _degrees(max(one.off)) if one.off else "-"
        met = str(sum(each.met for each in one.outcomes))
        angle, count = (
            f"{round(one.outcomes[0].push.angle) % 360}",
            str(len(one.outcomes)),
        )
        rows.append(
            (
                angle,
                count,
                number(one.spearman, ".3f"),
                _of(one.steps),
                longest,
                off,
                met,
            )
        )
    heads = (
        "direction, degrees",
        "pushes",
        "Spearman",
        "harder, farther",
        "longest answer, px",
        "off the push until it meets an object, at most",
        "met an object",
    )
    return Section("Each direction", (), (Table(heads, tuple(rows), note=NOTE),))


def _row(one: Outcome) -> dict[str, Any]:
    return {
        "push": [one.push.x, one.push.y],
        "size": one.push.size,
        "angle": one.push.angle,
        "answer": one.response.tolist(),
        "length": one.length,
        "until_met": one.at_first.tolist(),
        "met": one.met,
    }


def plot(swept: Swept, path: Path) -> None:
    """Paths over the photo, as in the paper's figure 6: a colour a direction, thicker for harder pushes."""
    every = np.concatenate([one.path.places for one in swept.outcomes])
    low, high = every.min(axis=0), every.max(axis=0)
    margin = 0.04 * float((high - low).max()) + 1
    low, high = low - margin, high + margin
    if swept.photo is not None:
        size = np.array(swept.photo.shape[1::-1])
        low, high = np.minimum(low, -0.5), np.maximum(high, size - 0.5)
    width, height = high - low
    tall = float(np.clip(120 * height / width, 60, 150))
    import matplotlib
    from matplotlib.figure import Figure

    wheel = matplotlib.colormaps["hsv"]
    with matplotlib.rc_context(
        {"svg.hashsalt": "physgen", "font.size": 7.5, "axes.linewidth": 0.6}
    ):
        figure = Figure(figsize=(120 / 25.4, tall / 25.4), layout="constrained")
        axes = figure.subplots()
        if swept.photo is not None:
            step = max(1, -(-max(swept.photo.shape[:2]) // CONSTANTS.short))
            small = swept.photo[::step, ::step].astype(np.float32) / 255
            pale = 1 - CONSTANTS.pale * (1 - small)
            axes.imshow(
                pale, extent=(-0.5, size[0] - 0.5, size[1] - 0.5, -0.5), zorder=0
            )
        for one in by_direction(swept):
            colour = tuple(0.8 * c for c in wheel(one.outcomes[0].push.angle / 360)[:3])
            for k, each in enumerate(one.outcomes):
                strong = (k + 1) / len(one.outcomes)
                axes.plot(
                    *each.path.places.T,
                    color=colour,
                    linewidth=0.6 + 0.7 * strong,
                    zorder=2,
                )
                axes.plot(
                    *each.path.places[-1],
                    "o",
                    color=colour,
                    markersize=2 + 1.6 * strong,
                    zorder=3,
                )
        axes.set(
            xlim=(low[0], high[0]),
            ylim=(high[1], low[1]),
            xlabel="x (px)",
            ylabel="y (px)",
            aspect="equal",
        )
        about = f"Paths of {swept.object} after each push; a dot is where it ends"
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, metadata={"Title": about, "Date": None})


def mean_ranks(values: Array) -> Array:
    """Return the rank of each of (N,) values; equal values share their mean rank.

    >>> mean_ranks(np.array([3.0, 1.0, 3.0])).tolist()
    [1.5, 0.0, 1.5]
    """
    _, places, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts) - 1
    return np.asarray((last - (counts - 1) / 2)[places], np.float64)


def correlation(first: Array, second: Array) -> float:
    """Spearman's rank correlation of two columns (N,); 0 where one of them is constant."""
    if len(first) < 2 or np.ptp(first) == 0 or np.ptp(second) == 0:
        return 0.0
    ranks = np.corrcoef(mean_ranks(first), mean_ranks(second))
    return float(ranks[0, 1])


# ---- the command -------------------------------------------------------------------------------------------------
