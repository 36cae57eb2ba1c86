"""How the motion of one object answers to the direction and size of a push (the paper's figure 6).

A push is an impulse at t = 0 through the centre of mass (the paper's F0), in px/s: the speed that it gives. The
answer is the displacement at the end from where the object would be without the push.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import atan2, cos, degrees, hypot, isclose, pi, sin, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physgen import pipeline
from physgen.compile.world import Push as WorldPush
from physgen.compile.world import World
from physgen.evaluate.measure import Figure, Findings, Progress, Section, Table, number, plotted
from physgen.problems import InputError
from physgen.registry import suggestion
from physgen.scene.scene import Load, Motion, Scene, Solid, View
from physgen.simulate.trajectory import Trajectory, new_touches
from physgen.simulate.uncertainty_summary import ranks

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from physgen.report.plots.style import Palette

Array = NDArray[np.float64]

SIZES = 5
"""Sizes of pushes, by default."""
REACH = 1 / 3
"""Part of the canvas's shorter side that the hardest push takes an object, by default."""
FASTEST = 1e5
"""px/s: the hardest push, by default."""
SEEN = 0.5
"""px from which on an answer has a direction."""
EQUAL = 0.01
"""px up to which two answers are the same."""
SPHERE = 5 / 2
"""m R²/I of a solid sphere."""


# ---- pushes and motions ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Course:
    """Path of one object."""

    times: Array
    """(T,) s."""
    places: Array
    """(T, 2) px: its centre of mass."""
    free: int
    """Number of first samples before it touches an object that it did not touch at the start."""


def course_of(trajectory: Trajectory, name: str) -> Course:
    """Raises ValueError where the trajectory has no such object."""
    body = trajectory.names.index(name)
    mine = new_touches(trajectory) & (trajectory.contacts.touch_pairs == body).any(axis=1)
    first = float(trajectory.contacts.touch_times[mine, 0].min(initial=np.inf))
    free = int(np.searchsorted(trajectory.times, first, side="right"))
    return Course(trajectory.times, trajectory.poses[:, body, :2], free)


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
    moved: float
    """px from where it began."""

    @property
    def met(self) -> bool:
        return self.path.free < len(self.path.times)

    @property
    def length(self) -> float:
        """px of the response."""
        return float(np.hypot(*self.response))


def outcome(push: Push, path: Course, still: Course) -> Outcome:
    """`still` is the path without a push."""
    off = path.places - still.places
    moved = float(np.hypot(*(path.places[-1] - path.places[0])))
    return Outcome(push, path, off[-1], off[max(path.free - 1, 0)], moved)


@dataclass(frozen=True)
class Law:
    """Closed form of the distance."""

    formula: str
    way: Callable[[float, float], float]
    """(px/s, s) -> px."""


def law(world: World, index: int) -> Law | None:
    """Of a body on a table; None seen from the side, or under joints, fields or the scene's own pushes."""
    body = world.bodies[index]
    held = any(index in (joint.first, joint.second) for joint in world.joints)
    blown = any(index in field.bodies for field in world.fields)
    if world.view is not View.TOP or held or blown or any(push.body == index for push in world.pushes):
        return None
    brake = body.surface.friction * world.table.friction * world.press
    if body.solid is Solid.SPHERE and body.radius is not None:
        resist = body.rolling * world.press
        if resist >= brake:
            return None
        formula = "slides until v = R w, then rolls: v falls by mu g, then by 5/7 c g"
        return Law(formula, lambda speed, time: rolled(speed, time, brake, resist))
    formula = "v²/(2 mu g), or v t - mu g t²/2 while it slides" if brake > 0 else "v t"
    return Law(formula, lambda speed, time: slid(speed, time, brake))


def slid(speed: float, time: float, brake: float) -> float:
    """px after `time` s of sliding, slowed by `brake` px/s².

    >>> slid(100, 10, 50), slid(100, 1, 50), slid(100, 2, 0)
    (100.0, 75.0, 200.0)
    """
    lasts = min(time, speed / brake) if brake > 0 else time
    return speed * lasts - brake * lasts**2 / 2


def rolled(speed: float, time: float, slip: float, resist: float) -> float:
    """px of a solid sphere pushed at its centre: `slip` is mu g, `resist` is c g, px/s².

    While it slides, friction turns it and resistance acts against that: v = v0 - mu g t, R w = 5/2 (mu - c) g t.

    >>> round(rolled(70, 0.1, 100, 10), 3), round(rolled(70, 60, 100, 10), 2)
    (6.5, 177.15)
    """
    if slip <= 0:
        return speed * time
    until = speed / (slip + SPHERE * (slip - resist))
    if time <= until:
        return slid(speed, time, slip)
    slows = resist * SPHERE / (1 + SPHERE)
    return slid(speed, until, slip) + slid(speed - slip * until, time - until, slows)


@dataclass(frozen=True)
class Swept:
    """All pushes of one object."""

    scene: str
    object: str
    view: View
    outcomes: tuple[Outcome, ...]
    still: Course
    """Without a push."""
    law: Law | None
    photo: NDArray[np.uint8] | None = None
    """(H, W, 3) sRGB."""

    def exact(self, one: Outcome) -> float | None:
        """px by the closed form, where it holds."""
        if self.law is None or one.met:
            return None
        exact = self.law.way(one.push.size, float(one.path.times[-1]))
        return 0.0 if isclose(exact, 0) else exact


def sweep(scene: Scene, name: str | None, angles: int, sizes: Sequence[float], progress: Progress) -> Swept:
    """`sizes` are px/s, none: chosen by the scene. Raises InputError where no such object can be pushed."""
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    index = pushed(scene, compiled.world, name)
    world = quiet(compiled.world, index)
    body = world.bodies[index]
    sizes = list(sizes) or usual(world, index)
    pushes = [
        Push(size * cos(turn), size * sin(turn)) for turn in directions(angles, world.view) for size in sizes
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
    return Swept(scene.name, body.name, world.view, tuple(outcomes), still, law(world, index), photo)


def pushed(scene: Scene, world: World, name: str | None) -> int:
    """Index of the object; unless it is named, the one that the scene pushes, or that moves first, or the first."""
    free = [body.name for body in world.bodies if body.motion is Motion.DYNAMIC]
    if not free:
        place = str(scene.place("objects").file)
        raise InputError.of(place, "", "has no object that can be pushed", "give it a dynamic object")
    if name is None:
        forced = [world.bodies[push.body].name for push in world.pushes]
        moving = [body.name for body in world.bodies if np.hypot(*body.velocity) > 0]
        name = next((one for one in (*forced, *moving) if one in free), free[0])
    names = [body.name for body in world.bodies]
    if name not in free:
        known = name in names
        expected = "cannot be pushed: it is not dynamic" if known else "is no object of the scene"
        raise InputError.of("--object", f'"{name}"', expected, suggestion(name, free if known else names))
    return names.index(name)


def quiet(world: World, index: int) -> World:
    """The world with that body at rest and without pushes of it; all others move as they do."""
    rest = replace(world.bodies[index], velocity=np.zeros(2), spin=0.0, roll=np.zeros(2))
    bodies = (*world.bodies[:index], rest, *world.bodies[index + 1 :])
    return replace(world, bodies=bodies, pushes=tuple(push for push in world.pushes if push.body != index))


def directions(count: int, view: View) -> list[float]:
    """rad. Seen from above all round; from the side from right over up to left, never down into the ground."""
    if view is View.TOP:
        return [2 * pi * k / count for k in range(count)]
    return [-pi * k / max(count - 1, 1) for k in range(count)]


def usual(world: World, index: int) -> list[float]:
    """px/s: even steps up to what takes the body about a third of the canvas, sliding or rolling."""
    body = world.bodies[index]
    known = law(world, index)
    if known is None:
        ground = max((wall.surface.friction for wall in world.walls), default=0.0)
        slides = body.radius is None and world.view is View.SIDE
        brake = body.surface.friction * ground * float(np.hypot(*world.gravity)) if slides else 0.0
        known = Law("", lambda speed, time: slid(speed, time, brake))
    reach, most = REACH * min(world.size), 1.0
    while known.way(most, world.duration) < reach and most < FASTEST:
        most *= 1.02
    step = float(f"{most / SIZES:.2g}")
    return [step * k for k in range(1, SIZES + 1)]


# ---- answers -----------------------------------------------------------------------------------------------------


def spearman(one: Array, other: Array) -> float | None:
    """Pearson's correlation of the ranks; None where one of the two never changes."""
    a, b = (rank - rank.mean() for rank in map(ranks, (one, other)))
    size = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / size if size > 0 else None


def kendall(one: Array, other: Array) -> float | None:
    """tau-b; None where one of the two never changes."""
    k, m = np.triu_indices(len(one), 1)
    a, b = np.sign(one[k] - one[m]), np.sign(other[k] - other[m])
    size = sqrt(float((a != 0).sum()) * float((b != 0).sum()))
    return float((a * b).sum()) / size if size > 0 else None


def growing(outcomes: Sequence[Outcome]) -> tuple[int, int]:
    """Steps from a push to the next harder one: those with a larger answer, and all."""
    order = sorted(outcomes, key=lambda one: one.push.size)
    lengths = [round(one.length / EQUAL) * EQUAL for one in order]
    steps = [
        b - a
        for (a, b), (x, y) in zip(pairwise(lengths), pairwise(order), strict=True)
        if y.push.size > x.push.size
    ]
    return sum(step > EQUAL / 2 for step in steps), len(steps)


@dataclass(frozen=True)
class Along:
    """Pushes of one direction."""

    angle: float
    """degrees."""
    outcomes: tuple[Outcome, ...]
    """By size."""
    spearman: float | None
    kendall: float | None
    steps: tuple[int, int]
    """See `growing`."""

    @property
    def met(self) -> int:
        return sum(one.met for one in self.outcomes)


@dataclass(frozen=True)
class Aim:
    """degrees between pushes and answers."""

    count: int
    """Answers that have a direction."""
    median: float | None
    worst: float | None


@dataclass(frozen=True)
class Answers:
    """Of one object."""

    along: tuple[Along, ...]
    first: Aim
    """Until it meets an object."""
    last: Aim
    """At the end."""
    sideways: tuple[int, int]
    """Pushes to the left or right: answers to the same side, and all that have a side."""
    turns: tuple[int, int]
    """From one direction to the next, hardest push: steps that turn the answer the same way, and all."""
    still: float
    """px that it moves without a push."""
    law: tuple[int, float] | None
    """Pushes that meet no object: their number, and the largest relative error of the closed form."""

    @property
    def correlations(self) -> list[float]:
        """Spearman's, of every direction that has one."""
        return [one.spearman for one in self.along if one.spearman is not None]

    @property
    def correlation(self) -> tuple[float, float] | None:
        """Spearman's over directions: the least and the mean."""
        found = self.correlations
        return (min(found), float(np.mean(found))) if found else None

    @property
    def steps(self) -> tuple[int, int]:
        return sum(one.steps[0] for one in self.along), sum(one.steps[1] for one in self.along)

    @property
    def free(self) -> tuple[int, int]:
        """`steps` of the pushes by which it meets no object."""
        found = [growing([each for each in one.outcomes if not each.met]) for one in self.along]
        return sum(rising for rising, _ in found), sum(steps for _, steps in found)


def answers(swept: Swept) -> Answers:
    """All pushes together."""
    by_angle: dict[int, list[Outcome]] = {}
    for one in swept.outcomes:
        by_angle.setdefault(round(one.push.angle) % 360, []).append(one)
    along = []
    for angle, some in sorted(by_angle.items()):
        part = sorted(some, key=lambda one: one.push.size)
        sizes = np.array([one.push.size for one in part])
        lengths = np.round(np.array([one.length for one in part]) / EQUAL) * EQUAL
        several = len(set(sizes.tolist())) > 1
        found = (spearman(sizes, lengths), kendall(sizes, lengths)) if several else (None, None)
        along.append(Along(float(angle), tuple(part), *found, growing(part)))
    sides = [
        one.push.x * float(one.at_first[0]) > 0  # gravity brings down what is pushed up, and leaves x alone
        for one in swept.outcomes
        if abs(one.push.x) > 1e-6 * one.push.size and abs(one.at_first[0]) >= SEEN
    ]
    pairs = [(one, swept.exact(one)) for one in swept.outcomes]
    errors = [abs(one.length / exact - 1) for one, exact in pairs if exact is not None and exact > EQUAL]
    return Answers(
        tuple(along),
        _aim([(one.push, one.at_first) for one in swept.outcomes]),
        _aim([(one.push, one.response) for one in swept.outcomes]),
        (sum(sides), len(sides)),
        _turns(along),
        float(np.hypot(*(swept.still.places[-1] - swept.still.places[0]))),
        (len(errors), max(errors)) if errors else None,
    )


def _aim(pairs: Sequence[tuple[Push, Array]]) -> Aim:
    off = []
    for push, (x, y) in pairs:
        if hypot(x, y) >= SEEN:
            off.append(abs(degrees(atan2(push.x * y - push.y * x, push.x * x + push.y * y))))
    return Aim(len(off), float(np.median(off)), max(off)) if off else Aim(0, None, None)


def _turns(along: Sequence[Along]) -> tuple[int, int]:
    """By order of angles; the last direction turns on to the first where they go all round."""
    hardest = [one.outcomes[-1] for one in along if one.outcomes[-1].length >= SEEN]
    pairs = list(pairwise(hardest))
    if len(hardest) > 2:
        pairs.append((hardest[-1], hardest[0]))
    same = count = 0
    for one, other in pairs:
        if 0 < (other.push.angle - one.push.angle) % 360 < 180:  # else the sense of rotation is unclear
            a, b = one.response, other.response
            count += 1
            same += bool(a[0] * b[1] - a[1] * b[0] > 0)
    return same, count


# ---- report ------------------------------------------------------------------------------------------------------

NOTE = (
    "Answer: from where the object would be at the end without the push, to where it is. Spearman, Kendall (tau-b): "
    "rank correlations of the push's size and the answer's length. 0 degrees is to the right, 90 down."
)


def findings(swept: Swept) -> Findings:
    """Without plots; see `plots`."""
    found = answers(swept)
    sections = (_summary_section(found, swept), _direction_section(found), _push_section(found, swept))
    return Findings(
        "controllability",
        f"Controllability: {swept.object} of {swept.scene}",
        tuple(_sentences(found, swept)),
        sections,
        [_row(one, swept) for along in found.along for one in along.outcomes],
        (),
        _more(found, swept),
    )


def _sentences(found: Answers, swept: Swept) -> Iterator[str]:
    rising, steps = found.steps
    meets = any(one.met for one in swept.outcomes)
    if steps and found.correlation is not None:
        least, mean = found.correlation
        count, others = len(found.correlations), len(found.along) - len(found.correlations)
        over = (
            f"on average over {count} directions, {least:.3f} at the least"
            if count > 1
            else "in one direction"
        )
        also = f" ({others} more without: of one push alone, or of equal answers)" if others else ""
        yield (
            f"A harder push takes {swept.object} farther in {rising} of {steps} steps; Spearman's correlation of push "
            f"and answer is {mean:.3f} {over}{also}."
        )
        if found.free[1] and meets:
            yield f"Where it meets no object, a harder push takes it farther in {_of(found.free)} steps."
    elif steps:
        yield f"{swept.object} answers to no push: it ends at one place, however hard it is pushed."
    if swept.view is View.SIDE and found.sideways[1]:
        yield (
            f"Until it meets an object it goes to the side that it is pushed to in {_of(found.sideways)} pushes. Seen "
            "from the side, angles say less: what is pushed up comes down again."
        )
    elif found.first.median is not None and found.first.worst is not None:
        off = f"{max(found.first.median, 0.01):.2g}° (median; {_degrees(found.first.worst)} at most)"
        off = "0.01°" if found.first.worst < 0.01 else off
        end = "" if found.last.median is None else f", and ends up {_degrees(found.last.median)} off (median)"
        yield f"Until it meets an object it goes where it is pushed to within {off}{end}."
    if found.turns[1]:
        yield f"Turning the push turns the answer the same way in {_of(found.turns)} steps."
    yield f"Without a push it moves by {found.still:.2f} px."
    if found.law is not None and swept.law is not None:
        count, worst = found.law
        within = _percent(worst).removeprefix("under ")
        form = f"{within} of the closed form, {swept.law.formula}"
        yield f"The {count} pushes by which it meets no object end within {form}."
    yield "The paper shows the same as pictures (figure 6) and gives no number."


def _of(pair: tuple[int, int]) -> str:
    return f"{pair[0]} of {pair[1]}"


def _degrees(angle: float) -> str:
    return "under 0.01°" if angle < 0.01 else f"{angle:.2g}°" if angle < 10 else f"{angle:.0f}°"


def _percent(part: float) -> str:
    return "under 0.01 %" if 100 * part < 0.01 else f"{100 * part:.2g} %"


def _summary_section(found: Answers, swept: Swept) -> Section:
    def aim(one: Aim) -> tuple[str, str]:
        if one.median is None or one.worst is None:
            return "-", f"no answer is longer than {SEEN:g} px"
        return _degrees(one.median), f"median of {one.count}; at most {_degrees(one.worst)}"

    count = len(found.along)
    rows = [
        ("pushes", str(len(swept.outcomes)), f"{count} direction{'s' * (count != 1)}"),
        ("harder, farther", _of(found.steps), "steps of one direction"),
    ]
    if found.free[1] and any(one.met for one in swept.outcomes):
        rows.append(("the same, meeting no object", _of(found.free), "steps of one direction"))
    if found.correlation is not None:
        least, mean = found.correlation
        of = f"least {least:.3f}" if len(found.correlations) > 1 else "one direction"
        rows.append(("Spearman, mean", f"{mean:.3f}", of))
    turned = _of(found.turns) if found.turns[1] else "-"
    rows += [
        ("off the push until it meets an object", *aim(found.first)),
        ("off the push at the end", *aim(found.last)),
        ("to the side it is pushed to", _of(found.sideways), "pushes, until it meets an object"),
        ("turns with the push", turned, "steps from one direction to the next"),
        ("moves without a push", f"{found.still:.2f} px", ""),
    ]
    if found.law is not None:
        rows.append(("off the closed form", _percent(found.law[1]), f"at most, of {found.law[0]} pushes"))
    return Section("All pushes", (), (Table(("measure", "found", "of"), tuple(rows), note=NOTE),))


def _direction_section(found: Answers) -> Section:
    rows = []
    for one in found.along:
        cells = (
            number(one.spearman, ".3f"),
            number(one.kendall, ".3f"),
            _of(one.steps) if one.steps[1] else "-",
        )
        longest = f"{max(each.length for each in one.outcomes):.1f}"
        rows.append((f"{one.angle:g}", str(len(one.outcomes)), *cells, longest, str(one.met)))
    heads = (
        "direction, degrees",
        "pushes",
        "Spearman",
        "Kendall",
        "harder, farther",
        "longest answer, px",
        "met an object",
    )
    return Section("Each direction", (), (Table(heads, tuple(rows)),))


def _push_section(found: Answers, swept: Swept) -> Section:
    rows = tuple(
        (
            f"{one.push.angle:g}", f"{one.push.size:.4g}", f"{one.length:.2f}", number(swept.exact(one)),
            f"{one.response[0]:+.1f}, {one.response[1]:+.1f}", "yes" if one.met else "no",
        )
        for along in found.along
        for one in along.outcomes
    )  # fmt: skip
    heads = ("direction, degrees", "push, px/s", "answer, px", "closed form, px", "x, y px", "met an object")
    note = "A push of v px/s is an impulse of mass x v at t = 0, through the centre of mass (the paper's F0)."
    return Section("Each push", (), (Table(heads, rows, note=note),))


def _row(one: Outcome, swept: Swept) -> dict[str, Any]:
    return {
        "push": [one.push.x, one.push.y],
        "size": one.push.size,
        "angle": one.push.angle,
        "answer": one.response.tolist(),
        "length": one.length,
        "until_met": one.at_first.tolist(),
        "met": one.met,
        "moved": one.moved,
        "closed_form": swept.exact(one),
    }


def _more(found: Answers, swept: Swept) -> dict[str, Any]:
    least, mean = found.correlation or (None, None)
    directions = [
        {
            "angle": one.angle, "spearman": one.spearman, "kendall": one.kendall, "steps": one.steps[1],
            "rising": one.steps[0],
        }
        for one in found.along
    ]  # fmt: skip
    law = None
    if found.law is not None and swept.law is not None:
        law = {"formula": swept.law.formula, "pushes": found.law[0], "worst": found.law[1]}
    return {
        "scene": swept.scene,
        "object": swept.object,
        "pushes": len(swept.outcomes),
        "steps": found.steps[1],
        "rising": found.steps[0],
        "meeting_nobody": {"steps": found.free[1], "rising": found.free[0]},
        "spearman_mean": mean,
        "spearman_least": least,
        "off_until_met": {"median": found.first.median, "worst": found.first.worst, "of": found.first.count},
        "off_at_end": {"median": found.last.median, "worst": found.last.worst, "of": found.last.count},
        "sideways": {"same": found.sideways[0], "of": found.sideways[1]},
        "turns": {"same": found.turns[0], "of": found.turns[1]},
        "still_px": found.still,
        "closed_form": law,
        "directions": directions,
    }


SHORT, PALE = 400, 0.55
"""px of the photo's longer side in a plot at most, and how much of its contrast is kept under the paths."""


def plots(swept: Swept) -> tuple[Figure, Figure]:
    """Paths over the photo, and the length of the answer over the size of the push."""
    found = answers(swept)
    return _paths_plot(swept, found), _reach_plot(swept, found)


def _colours(found: Answers) -> list[tuple[float, ...]]:
    """One a direction, round the colour circle."""
    import matplotlib

    wheel = matplotlib.colormaps["hsv"]
    return [tuple(0.8 * c for c in wheel(one.angle / 360)[:3]) for one in found.along]


def _paths_plot(swept: Swept, found: Answers) -> Figure:
    every = np.concatenate([one.path.places for one in swept.outcomes])
    low, high = every.min(axis=0), every.max(axis=0)
    margin = 0.04 * float((high - low).max()) + 1
    low, high = low - margin, high + margin
    if swept.photo is not None:
        size = np.array(swept.photo.shape[1::-1])
        low, high = np.minimum(low, -0.5), np.maximum(high, size - 0.5)

    def draw(axes: Axes, palette: Palette) -> None:
        if swept.photo is not None:
            step = max(1, -(-max(swept.photo.shape[:2]) // SHORT))
            small = swept.photo[::step, ::step].astype(np.float32) / 255
            axes.imshow(1 - PALE * (1 - small), extent=(-0.5, size[0] - 0.5, size[1] - 0.5, -0.5), zorder=0)
        for one, colour in zip(found.along, _colours(found), strict=True):
            for k, each in enumerate(one.outcomes):
                strong = (k + 1) / len(one.outcomes)
                axes.plot(*each.path.places.T, color=colour, linewidth=0.6 + 0.7 * strong, zorder=2)
                axes.plot(*each.path.places[-1], "o", color=colour, markersize=2 + 1.6 * strong, zorder=3)
                if each.met:
                    where = each.path.places[each.path.free - 1]
                    axes.plot(*where, "o", markersize=3.5, mfc="none", mec=palette.ink, mew=0.5, zorder=4)
        axes.plot(*swept.outcomes[0].path.places[0], "+", color=palette.ink, markersize=7, zorder=5)
        axes.set(
            xlim=(low[0], high[0]), ylim=(high[1], low[1]), xlabel="x (px)", ylabel="y (px)", aspect="equal"
        )

    rings = "; a ring is where it first met an object" if any(one.met for one in swept.outcomes) else ""
    about = (
        f"Paths of {swept.object} after each push, a colour a direction, thicker for harder pushes; a dot is where it "
        f"ends{rings}."
    )
    width, height = high - low
    return plotted(draw, about, 120, float(np.clip(120 * height / width, 60, 150)))


def _reach_plot(swept: Swept, found: Answers) -> Figure:
    def draw(axes: Axes, palette: Palette) -> None:
        most = max(one.push.size for one in swept.outcomes)
        for one, colour in zip(found.along, _colours(found), strict=True):
            sizes, lengths = [each.push.size for each in one.outcomes], [each.length for each in one.outcomes]
            label = f"{one.angle:g}°" if len(found.along) <= 8 else None  # a longer legend has no room
            axes.plot(
                sizes, lengths, "o-", color=colour, markersize=2.5, linewidth=0.7, label=label, zorder=3
            )
        if swept.law is not None:
            lasts = float(swept.outcomes[0].path.times[-1])
            grid = np.linspace(0, most, 100)
            exact = [swept.law.way(float(v), lasts) for v in grid]
            axes.plot(
                grid, exact, color=palette.ink, linewidth=1.6, alpha=0.35, label="closed form", zorder=1
            )
        axes.set(xlabel="push: impulse / mass (px/s)", ylabel="answer (px)", xlim=(0, 1.05 * most))
        axes.set_ylim(bottom=0)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="upper left", ncols=2)

    law = f" The closed form: {swept.law.formula}." if swept.law is not None else ""
    return plotted(draw, f"How far each push takes {swept.object}, a colour a direction.{law}", 120, 75)
