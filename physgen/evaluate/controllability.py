"""The effect of direction and size of a push on the motion of one object (the paper's
figure 6).

A push is an impulse at t = 0 through the centre of mass (the paper's F0), given in px/s
as the resulting speed. The answer is the displacement at the end relative to the motion
without the push.
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
from physgen.messages import Message
from physgen.registry import suggestion
from physgen.scene.scene import Load, Motion, Scene, Solid, View
from physgen.simulate.trajectory import Trajectory, new_touches


@dataclass(frozen=True)
class Constants:
    """Constants of the sweep and its analysis."""

    sizes: int = 5
    """Default number of sizes of pushes."""
    reach: float = 1 / 3
    """Default travel of the hardest push over the canvas's shorter side."""
    min_length: float = 0.5
    """Minimum length of an answer with a direction, px."""
    tolerance: float = 0.01
    """Maximum difference of equal answers, px."""
    plot_side: int = 400
    """Maximum longer side of the photo in a plot, px."""
    contrast: float = 0.55
    """Remaining contrast of the photo under the paths."""
    plot_width: float = 120.0
    """Width of a plot, mm."""
    plot_heights: tuple[float, float] = (60.0, 150.0)
    """Minimum and maximum height of a plot, mm."""


CONSTANTS = Constants()
MM_PER_INCH = 25.4
ROLL_PART = 5 / 7
"""Speed of a rolling sphere over its first sliding speed."""


# ---- pushes and motions


@dataclass(frozen=True)
class Course:
    """Path of one object."""

    places: Array
    """(T, 2) px: centre of mass."""
    free_samples: int
    """Number of first samples before a new contact with an object."""


def course_of(trajectory: Trajectory, name: str) -> Course:
    """Return the path of an object. Raise ValueError if the trajectory has no
    such object.
    """
    body = trajectory.names.index(name)
    contacts = trajectory.contacts
    is_own = (contacts.touch_pairs == body).any(axis=1)
    touch_times = contacts.touch_times[new_touches(trajectory) & is_own, 0]
    # Without any contact the time is infinite, and all samples are free.
    first_time = float(touch_times.min(initial=np.inf))
    free_samples = int(np.searchsorted(trajectory.times, first_time, side="right"))
    return Course(trajectory.poses[:, body, :2], free_samples)


@dataclass(frozen=True)
class Push:
    """A push as impulse over mass, px/s, y down."""

    x: float
    y: float

    @property
    def size(self) -> float:
        return hypot(self.x, self.y)

    @property
    def angle(self) -> float:
        """Return the direction in degrees, [0, 360): 0 to the right, 90 down."""
        return round(degrees(atan2(self.y, self.x)), 6) % 360


@dataclass(frozen=True)
class Outcome:
    """One push and its effect."""

    push: Push
    path: Course
    response: Array
    """(2,) px at the end, relative to the place without the push."""
    free_response: Array
    """(2,) px: the response at the last sample before a contact with an object, or at
    the end.
    """

    @property
    def has_contact(self) -> bool:
        """Return whether the object meets another one."""
        return self.path.free_samples < len(self.path.places)

    @property
    def length(self) -> float:
        """Return the length of the response, px."""
        return float(np.hypot(*self.response))

    @property
    def deviation(self) -> float | None:
        """Return the degrees between the push and the free response; None for a
        short one.
        """
        x, y = self.free_response
        if hypot(x, y) < CONSTANTS.min_length:
            return None
        push = self.push
        # Both products give the signed angle without an arccosine, which is inaccurate
        # for small angles.
        cross = push.x * y - push.y * x
        dot = push.x * x + push.y * y
        return abs(degrees(atan2(cross, dot)))


def outcome(push: Push, path: Course, rest_path: Course) -> Outcome:
    """Return the effect of a push; `rest_path` is the path without a push."""
    # The difference from the path without a push is the effect of the push alone.
    offsets = path.places - rest_path.places
    # The sample before the contact still belongs to the push alone.
    last_free_sample = max(path.free_samples - 1, 0)
    return Outcome(push, path, offsets[-1], offsets[last_free_sample])


@dataclass(frozen=True)
class PushSweep:
    """All pushes of one object."""

    scene: str
    object: str
    view: View
    outcomes: tuple[Outcome, ...]
    rest_path: Course
    """Path without a push."""
    photo: NDArray[np.uint8] | None = None
    """(H, W, 3) sRGB."""


def sweep(
    scene: Scene,
    name: str | None,
    angles: int,
    sizes: Sequence[float],
    progress: Progress,
) -> PushSweep:
    """Push an object in many ways; `sizes` are in px/s, by default chosen for the
    scene.

    Raise InputError if the object does not exist or cannot be pushed.
    """
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    index = choose_object(scene, compiled.world, name)
    # Other motion of the scene would mix with the effect of the pushes.
    world = quiet(compiled.world, index)
    body = world.bodies[index]
    sizes = list(sizes) or usual_sizes(world, body)
    pushes = []
    for angle in directions(angles, world.view):
        pushes += [Push(size * cos(angle), size * sin(angle)) for size in sizes]
    progress("no push", 0, len(pushes) + 1)
    # The motion without a push is the reference: an object that falls anyway is not
    # controlled by a push.
    rest_path = course_of(pipeline.simulate(world), body.name)
    outcomes = []
    for k, push in enumerate(pushes, 1):
        progress(f"push {k}", k, len(pushes) + 1)
        outcomes.append(outcome(push, _pushed_course(world, index, push), rest_path))
    photo = None
    if maps is not None:
        photo = maps.rgb
    return PushSweep(
        scene.name, body.name, world.view, tuple(outcomes), rest_path, photo
    )


def _pushed_course(world: World, index: int, push: Push) -> Course:
    """Return the path of a body after a push."""
    body = world.bodies[index]
    impulse = body.mass * np.array([push.x, push.y])
    # An impulse through the centre changes the velocity and not the spin.
    load = WorldPush(index, Load.IMPULSE, impulse, 0.0, np.zeros(2), 0.0, 0.0)
    trajectory = pipeline.simulate(replace(world, pushes=(*world.pushes, load)))
    return course_of(trajectory, body.name)


def choose_object(scene: Scene, world: World, name: str | None) -> int:
    """Return the index of the named object.

    Without a name, choose the pushed object of the scene, or the first moving one, or
    the first. Raise InputError if the object cannot be pushed.
    """
    # Fixed and scripted objects do not answer to a push.
    dynamic_names = []
    for body in world.bodies:
        if body.motion is Motion.DYNAMIC:
            dynamic_names.append(body.name)
    if not dynamic_names:
        raise Message.NOTHING_TO_PUSH.error(str(scene.place("objects").file))
    if name is None:
        name = _default_object(world, dynamic_names)
    names = [body.name for body in world.bodies]
    if name in dynamic_names:
        return names.index(name)
    message, known_names = Message.PUSHED_NAME_UNKNOWN, names
    if name in names:
        message, known_names = Message.OBJECT_NOT_DYNAMIC, dynamic_names
    raise message.error("--object", f'"{name}"', fix=suggestion(name, known_names))


def _default_object(world: World, dynamic_names: Sequence[str]) -> str:
    # A pushed object of the scene comes first, then moving ones.
    candidates = [world.bodies[push.body].name for push in world.pushes]
    for body in world.bodies:
        if np.hypot(*body.velocity) > 0:
            candidates.append(body.name)
    for name in candidates:
        if name in dynamic_names:
            return name
    return dynamic_names[0]


def quiet(world: World, index: int) -> World:
    """Return the world with this body at rest and without its pushes. All other bodies
    move as before.
    """
    bodies = list(world.bodies)
    # A roll of the body would also move it on a table.
    bodies[index] = replace(
        bodies[index], velocity=np.zeros(2), spin=0.0, roll=np.zeros(2)
    )
    pushes = tuple(push for push in world.pushes if push.body != index)
    return replace(world, bodies=tuple(bodies), pushes=pushes)


def directions(count: int, view: View) -> list[float]:
    """Return directions in rad.

    Seen from above, they go around the circle; from the side, from right over up to
    left, never down into the ground.
    """
    if view is View.TOP:
        return [2 * pi * k / count for k in range(count)]
    # y points down, so negative angles point up.
    return [-pi * k / max(count - 1, 1) for k in range(count)]


def usual_sizes(world: World, body: Body) -> list[float]:
    """Return even steps (px/s) up to a push across about a third of the canvas, sliding
    or rolling.
    """
    speed_part = 1.0
    if world.view is View.TOP and body.solid is Solid.SPHERE:
        speed_part = ROLL_PART
    # A push of v slides v²/(2 a) until friction stops it.
    deceleration = _deceleration(world, body)
    reach = CONSTANTS.reach * min(world.size)
    speed = sqrt(2 * deceleration * reach)
    does_not_stop = speed >= deceleration * world.duration
    if does_not_stop:
        # Without a stop, the path is v t - a t²/2 at the end of the clip.
        speed = reach / world.duration + deceleration * world.duration / 2
    # Two digits: readable numbers for tables.
    step = float(f"{speed / speed_part / CONSTANTS.sizes:.2g}")
    return [step * k for k in range(1, CONSTANTS.sizes + 1)]


def _deceleration(world: World, body: Body) -> float:
    """Return the deceleration by friction, px/s²."""
    if world.view is View.TOP and body.solid is Solid.SPHERE:
        return ROLL_PART * body.rolling * world.press
    if world.view is View.TOP:
        return body.surface.friction * world.table.friction * world.press
    # A round body rolls on a floor.
    if body.radius is not None:
        return 0.0
    ground = max((wall.surface.friction for wall in world.walls), default=0.0)
    # The friction of a pair is the product of both factors, as in the engine.
    return body.surface.friction * ground * float(np.hypot(*world.gravity))


# ---- answers

Share = tuple[int, int]
"""Number of good cases, and of all."""


def count_growth(outcomes: Sequence[Outcome]) -> Share:
    """Return the number of steps to a harder push with a larger answer, and of all
    steps.
    """
    # Lengths are rounded to the tolerance, so that half of it separates a step from
    # none.
    steps = [b - a for a, b in pairwise(_lengths(outcomes))]
    return sum(step > CONSTANTS.tolerance / 2 for step in steps), len(steps)


def _lengths(outcomes: Sequence[Outcome]) -> list[float]:
    tolerance = CONSTANTS.tolerance
    return [round(outcome.length / tolerance) * tolerance for outcome in outcomes]


@dataclass(frozen=True)
class PushGroup:
    """Pushes of one direction, or of all."""

    outcomes: tuple[Outcome, ...]
    """Sorted by size."""
    steps: Share
    """See `count_growth`."""
    free_steps: Share
    """`steps` of the pushes without contact with objects."""
    spearman: float
    """Rank correlation of the push's size and the answer's length; 0 for a single push.
    For all directions: the mean.
    """

    @property
    def deviations(self) -> list[float]:
        """Return the angles between pushes and free responses with a direction,
        degrees.
        """
        deviations = [outcome.deviation for outcome in self.outcomes]
        return [value for value in deviations if value is not None]

    @property
    def sideways(self) -> Share:
        """Return the number of pushes to the left or right with an answer to the same
        side, and of all sideways pushes.

        Gravity brings down an object pushed up, and does not change x.
        """
        sides = []
        for outcome in self.outcomes:
            push = outcome.push
            x = float(outcome.free_response[0])
            # A push straight up has no side.
            is_sideways = abs(push.x) > 1e-6 * push.size
            if is_sideways and abs(x) >= CONSTANTS.min_length:
                sides.append(push.x * x > 0)
        return sum(sides), len(sides)


def group_by_direction(pushes: PushSweep) -> list[PushGroup]:
    """Return one group for each direction, in the order of angles."""
    by_angle: dict[int, list[Outcome]] = {}
    for outcome in sorted(pushes.outcomes, key=lambda outcome: outcome.push.size):
        # Sines and cosines leave rounding errors in the angles: group by whole degrees.
        angle = round(outcome.push.angle) % 360
        by_angle.setdefault(angle, []).append(outcome)
    groups = []
    for _, outcomes in sorted(by_angle.items()):
        sizes = np.array([outcome.push.size for outcome in outcomes])
        free = []
        for outcome in outcomes:
            if not outcome.has_contact:
                free.append(outcome)
        # Ranks instead of values: a harder push must go farther, by any law.
        spearman = correlation(sizes, np.array(_lengths(outcomes)))
        steps, free_steps = count_growth(outcomes), count_growth(free)
        groups.append(PushGroup(tuple(outcomes), steps, free_steps, spearman))
    return groups


def join_groups(groups: Sequence[PushGroup]) -> PushGroup:
    """Return the group of all directions."""
    outcomes: list[Outcome] = []
    for group in groups:
        outcomes += group.outcomes
    return PushGroup(
        outcomes=tuple(outcomes),
        steps=_sum_shares([group.steps for group in groups]),
        free_steps=_sum_shares([group.free_steps for group in groups]),
        spearman=float(np.mean([group.spearman for group in groups])),
    )


def _sum_shares(shares: Sequence[Share]) -> Share:
    return sum(share[0] for share in shares), sum(share[1] for share in shares)


# ---- report

NOTE = (
    "Answer: from where the object would be at the end without the push, to where it is. Spearman: rank correlation "
    "of the push's size and the answer's length. 0 degrees is to the right, 90 down."
)
HEADS = (
    "direction, degrees",
    "pushes",
    "Spearman",
    "harder, farther",
    "longest answer, px",
    "off the push until it meets an object, at most",
    "met an object",
)


def findings(pushes: PushSweep) -> Findings:
    """Return the findings without the plot; see `plot`."""
    groups = group_by_direction(pushes)
    whole = join_groups(groups)
    rest_places = pushes.rest_path.places
    drift = float(np.hypot(*(rest_places[-1] - rest_places[0])))
    lowest = min(group.spearman for group in groups)
    deviations = whole.deviations
    extra = {
        "scene": pushes.scene,
        "object": pushes.object,
        "pushes": len(pushes.outcomes),
        "steps": whole.steps[1],
        "rising": whole.steps[0],
        "meeting_nobody": {
            "steps": whole.free_steps[1],
            "rising": whole.free_steps[0],
        },
        "spearman_mean": whole.spearman,
        "spearman_least": lowest,
        "off_until_met": {
            "median": float(np.median(deviations)) if deviations else None,
            "worst": max(deviations, default=None),
            "of": len(deviations),
        },
        "sideways": {"same": whole.sideways[0], "of": whole.sideways[1]},
        "still_px": drift,
    }
    return Findings(
        measure="controllability",
        title=f"Controllability: {pushes.object} of {pushes.scene}",
        sentences=tuple(_sentences(whole, pushes, lowest, drift)),
        sections=(_direction_section(groups),),
        rows=list(map(_row, whole.outcomes)),
        extra=extra,
    )


def _sentences(
    result: PushGroup, pushes: PushSweep, lowest: float, drift: float
) -> Iterator[str]:
    """Yield the sentences on all pushes. `lowest` is the lowest correlation, `drift`
    the motion without a push, px.
    """
    if result.steps[1]:
        yield (
            f"A harder push takes {pushes.object} farther in {_share_text(result.steps)} steps; Spearman's correlation "
            f"of push and answer is {result.spearman:.3f} on average over directions, {lowest:.3f} at the least."
        )
        has_contacts = any(outcome.has_contact for outcome in pushes.outcomes)
        if result.free_steps[1] and has_contacts:
            yield f"Where it meets no object, a harder push takes it farther in {_share_text(result.free_steps)} steps."
    deviations = result.deviations
    if pushes.view is View.SIDE and result.sideways[1]:
        yield (
            f"Until it meets an object it goes to the side that it is pushed to in {_share_text(result.sideways)} "
            "pushes. Seen from the side, angles say less: what is pushed up comes down again."
        )
    elif deviations:
        median = _format_angle(float(np.median(deviations)))
        largest = _format_angle(max(deviations))
        yield f"Until it meets an object it goes where it is pushed, off by {median} (median), {largest} at most."
    yield f"Without a push it moves by {drift:.2f} px."
    yield "The paper shows the same as pictures (figure 6) and gives no number."


def _share_text(share: Share) -> str:
    return f"{share[0]} of {share[1]}"


def _format_angle(angle: float) -> str:
    if angle < 0.01:
        return "under 0.01°"
    if angle < 10:
        return f"{angle:.2g}°"
    return f"{angle:.0f}°"


def _direction_section(groups: Sequence[PushGroup]) -> Section:
    """Return the table of all directions."""
    rows = tuple(map(_direction_row, groups))
    return Section("Each direction", (), (Table(HEADS, rows, note=NOTE),))


def _direction_row(group: PushGroup) -> tuple[str, ...]:
    longest = max(outcome.length for outcome in group.outcomes)
    deviations = group.deviations
    return (
        f"{round(group.outcomes[0].push.angle) % 360}",
        str(len(group.outcomes)),
        number(group.spearman, ".3f"),
        _share_text(group.steps),
        f"{longest:.1f}",
        _format_angle(max(deviations)) if deviations else "-",
        str(sum(outcome.has_contact for outcome in group.outcomes)),
    )


def _row(outcome: Outcome) -> dict[str, Any]:
    return {
        "push": [outcome.push.x, outcome.push.y],
        "size": outcome.push.size,
        "angle": outcome.push.angle,
        "answer": outcome.response.tolist(),
        "length": outcome.length,
        "until_met": outcome.free_response.tolist(),
        "met": outcome.has_contact,
    }


def plot(pushes: PushSweep, path: Path) -> None:
    """Write a picture of the paths over the photo, as in the paper's figure 6.

    Each direction has a colour; lines are thicker for harder pushes.
    """
    import matplotlib
    from matplotlib.figure import Figure

    # All paths and one aspect ratio of both axes: angles in the plot are those of the
    # photo.
    low, high = _plot_limits(pushes)
    width, height = high - low
    plot_height = float(
        np.clip(CONSTANTS.plot_width * height / width, *CONSTANTS.plot_heights)
    )
    wheel = matplotlib.colormaps["hsv"]
    with matplotlib.rc_context(
        {"svg.hashsalt": "physgen", "font.size": 7.5, "axes.linewidth": 0.6}
    ):
        size = (CONSTANTS.plot_width / MM_PER_INCH, plot_height / MM_PER_INCH)
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplots()
        if pushes.photo is not None:
            _plot_photo(axes, pushes.photo)
        for group in group_by_direction(pushes):
            hue = wheel(group.outcomes[0].push.angle / 360)
            _plot_group(axes, group, tuple(0.8 * channel for channel in hue[:3]))
        axes.set(
            xlim=(low[0], high[0]),
            ylim=(high[1], low[1]),
            xlabel="x (px)",
            ylabel="y (px)",
            aspect="equal",
        )
        title = f"Paths of {pushes.object} after each push; a dot is where it ends"
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, metadata={"Title": title, "Date": None})


def _plot_limits(pushes: PushSweep) -> tuple[Array, Array]:
    """Return the smallest and largest x and y (px) of a plot: all paths with a margin,
    and the photo.
    """
    places = np.concatenate([outcome.path.places for outcome in pushes.outcomes])
    low = places.min(axis=0)
    high = places.max(axis=0)
    margin = 0.04 * float((high - low).max()) + 1
    low, high = low - margin, high + margin
    if pushes.photo is not None:
        # Centres of pixels are integers, so that the photo begins at -0.5.
        size = np.array(pushes.photo.shape[1::-1])
        low = np.minimum(low, -0.5)
        high = np.maximum(high, size - 0.5)
    return low, high


def _plot_photo(axes: Any, photo: NDArray[np.uint8]) -> None:
    """Draw a pale and small photo."""
    height, width = photo.shape[:2]
    step = max(1, -(-max(height, width) // CONSTANTS.plot_side))
    colours = photo[::step, ::step].astype(np.float32) / 255
    pale_colours = 1 - CONSTANTS.contrast * (1 - colours)
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    axes.imshow(pale_colours, extent=extent, zorder=0)


def _plot_group(axes: Any, group: PushGroup, colour: tuple[float, ...]) -> None:
    """Draw the paths of one direction, with a dot at each end."""
    count = len(group.outcomes)
    for k, outcome in enumerate(group.outcomes, 1):
        strength = k / count
        places = outcome.path.places
        width = 0.6 + 0.7 * strength
        axes.plot(*places.T, color=colour, linewidth=width, zorder=2)
        size = 2 + 1.6 * strength
        axes.plot(*places[-1], "o", color=colour, markersize=size, zorder=3)


def mean_ranks(values: Array) -> Array:
    """Return the rank of each of (N,) values. Equal values share their mean rank.

    >>> mean_ranks(np.array([3.0, 1.0, 3.0])).tolist()
    [1.5, 0.0, 1.5]
    """
    _, places, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts) - 1
    return np.asarray((last - (counts - 1) / 2)[places], np.float64)


def correlation(first: Array, second: Array) -> float:
    """Return Spearman's rank correlation of two columns (N,); 0 if one of them
    is constant.
    """
    if len(first) < 2 or np.ptp(first) == 0 or np.ptp(second) == 0:
        return 0.0
    ranks = np.corrcoef(mean_ranks(first), mean_ranks(second))
    return float(ranks[0, 1])
