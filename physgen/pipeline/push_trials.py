"""Choice of the push that perception writes: trial simulations and their score.

A push should tell a short story that stays in the picture: something moves visibly, as
objects of its kind do, and everything that moves is still in the picture and at rest at
the end. Lengths are shares of the photo's longer side, and times are in units of the
time in which a body falls over half of that side, so that small and large scenes are
judged alike.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from math import hypot, inf, log, radians, sqrt
from types import MappingProxyType
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import cross
from physgen.geometry.scale import PLAYBACK, push_speed, slow_motion, story_slow_motion
from physgen.materials import is_living
from physgen.scene.scene import Motion, Object, Scene, View

if TYPE_CHECKING:
    from physgen.compile.shapes import Shapes
    from physgen.compile.world import Body, World
    from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]
Direction = tuple[float, float]
SIDES = {"right": 1.0, "left": -1.0}
"""Signs of x by the names of sides."""


@dataclass(frozen=True)
class TrialLimits:
    """Limits of trial simulations and weights of their scores."""

    confidence: float = 0.33
    """Least confidence of an object that is pushed; below, its mask is to be checked."""
    pairs: int = 6
    """Objects with a direction that are tried."""
    more: int = 16
    """The same while no push makes a story, as in a heap whose objects block another."""
    most: int = 28
    """Trials; twice as many while no push makes a story."""
    poor: float = 0.4
    """Score up to which a push is no story, whatever its grade."""
    work: float = 2500.0
    """Work of all trials together, in steps of the engine: about half a second."""
    more_work: float = 7500.0
    """The same while no calm push moves an object by `travel`."""
    one: float = 1500.0
    """Work of one trial, after which it ends: objects that are jammed take long."""
    longest: float = 6.0
    """s of a trial; a scale that is wrong by powers of ten would take minutes."""
    units: float = 20.0
    """Units of time of a trial: 4.5 s in a photo that shows 0.5 m."""
    samples: int = 16
    """Samples in a unit of time."""
    rate: float = 120.0
    """Steps in a second of a trial; the chosen push is tried again at the scene's own."""
    gentlest: float = 0.12
    """Of the ordinary speed: 0.15 m/s in a photo that shows 0.5 m."""
    hardest: float = 1.5
    """Of the ordinary speed."""
    steps: tuple[float, float] = (1.25, 2.5)
    """Factors of the speed from one trial to the next: at least, and at most."""
    doubling: float = 2.0
    """The factor after one by which what rolls is seen to move: it goes far, and long."""
    slides: float = 0.8
    """Share of the speed at which friction lets an object slide visibly; the first."""
    halvings: int = 3
    """Speeds between one at which all stays and one at which something leaves."""
    verified: int = 3
    """Pushes that are simulated again at the scene's own rate, at most."""
    tips: tuple[float, float] = (1.25, 2.0)
    """Of the speed that tips a thin object, which need not slide: from, to."""
    thin: float = 3.0
    """Height over width from which an object is tipped as by a finger."""
    tall: float = 1.4
    """Height over width from which an object that falls over tells more."""
    fallen: float = 50.0
    """Degrees of a turn from which an object has fallen over."""
    travel: float = 0.05
    """Least motion that tells a story."""
    least: float = 0.03
    """Least motion that is visible: in a heap, nothing goes farther."""
    far: float = 0.15
    """Motion that counts in full: a hand's breadth in a photo that shows 0.5 m."""
    slide: float = 0.08
    """The same of an object that slides: what it uncovers is filled, and may show."""
    beside: float = 0.005
    """Share of an object beyond the border that is still counted as in the picture."""
    unrest: float = 0.004
    """Motion in the last unit of time that is still rest."""
    visible: float = 0.0015
    """Distance from its last place at which something still moves: 2 px of 1280."""
    falls: float = 0.5
    """Weight of each object that falls over, in objects that move far."""
    worth: float = 1.1
    """Gain from which a harder push or another object is preferred."""
    enough: float = 0.85
    """Of the best score, from which a gentler push is taken."""
    wrong_way: float = 0.3
    """Weight of a vehicle that drives backwards."""
    rebound: float = 0.25
    """Weight of an object that returns: something stands in its way."""
    border: float = 0.02
    """Gap to the picture's border below which an object ends crowded."""
    crowded: float = 0.8
    """Weight of a push after which an object ends at the border, but did not start so."""
    overhang: float = 0.2
    """Weight of a push after which something stands half beyond a seen edge."""
    tumble: float = 35.0
    """Degrees of a turn from which a low object tumbles, where its kind slides."""
    tumbling: float = 0.3
    """Weight of a push by which a low object tumbles."""
    rise: float = 0.25
    """Of an object's height, by which it climbs something in its way or is thrown up."""
    edge: float = 0.02
    """Share of the longer side between an edge and what stands on it."""
    thrown: float = 0.25
    """Share of its momentum that an invisible wall takes from an object that rebounds."""
    wild: float = 2.5
    """Times the speeds of the push and of a fall over the photo; faster is an explosion."""


TRIAL = TrialLimits()


class Grade(IntEnum):
    """How far the outcome of a push is suitable, the best last."""

    NOTHING = 0
    """Nothing moves visibly, or all explodes."""
    LEAVES = 1
    """Something leaves the picture, or rebounds from a wall that it does not show."""
    RESTLESS = 2
    """Something still moves at the end of the trial, or climbs what is in its way."""
    SHORT = 3
    """All stays and rests, but moves for less than a second of video."""
    STORY = 4
    """Something moves for a second of video, and all stays and rests."""


@dataclass(frozen=True)
class Outcome:
    """The motion that a push causes, from a simulation without pictures."""

    grade: Grade
    score: float
    """Objects that move far, with bonuses and penalties."""
    travel: float
    """Longest displacement of a point, as a share of the photo's longer side."""
    seconds: float
    """s of simulated time in which something moves."""
    moved: tuple[str, ...]
    """Names of the objects that move visibly."""
    left: tuple[str, ...]
    """Names of the objects that leave the picture."""
    work: float = 0.0
    """Work of the trial, in steps of the engine."""

    @property
    def is_inside(self) -> bool:
        """Return whether something moves and nothing leaves the picture."""
        return self.grade > Grade.LEAVES

    @property
    def is_calm(self) -> bool:
        """Return whether something moves, and all stays and rests."""
        return self.grade >= Grade.SHORT


NO_MOTION = Outcome(Grade.NOTHING, 0.0, 0.0, 0.0, (), ())


@dataclass(frozen=True)
class Candidate:
    """A push and its outcome."""

    item: Object
    direction: Direction
    """Unit vector, image axes."""
    speed: float
    """px/s."""
    outcome: Outcome

    @property
    def velocity(self) -> tuple[float, float]:
        """px/s, whole numbers."""
        x, y = self.direction
        return (round(self.speed * x), round(self.speed * y))


@dataclass(frozen=True)
class TrialScene:
    """What all trials of a scene share."""

    scene: Scene
    world: World
    unseen: frozenset[str]
    """Walls that the photo does not show."""
    barred: Mapping[str, str] = field(default_factory=dict)
    """Sides, `left` or `right`, to which objects are not pushed, by name."""

    @property
    def side(self) -> int:
        """px: the photo's longer side."""
        return max(self.scene.size)

    @property
    def ordinary(self) -> float:
        """px/s: the speed of a push that crosses the photo."""
        return push_speed(self.side, self.scene.world.pixels_per_meter)

    @property
    def unit(self) -> float:
        """s: time in which a body falls over half of the longer side."""
        gravity = PLAYBACK.gravity * self.scene.world.pixels_per_meter
        return sqrt(self.side / gravity)


def compile_trials(
    scene: Scene,
    shapes: Shapes,
    unseen: Collection[str] = (),
    barred: Mapping[str, str] = MappingProxyType({}),
) -> TrialScene:
    """Compile the world that all trials of a scene share. Raises InputError."""
    from physgen.compile.compile import compile_shapes

    world = compile_shapes(scene, shapes).world
    return TrialScene(scene, world, frozenset(unseen), barred)


def choose_push(
    trials: TrialScene,
    confidence: Mapping[str, float],
    facing: Mapping[str, str],
) -> Candidate | None:
    """Return the push that tells most and stays in the picture; None if none moves.

    `confidence` are confidences of objects by name; `facing` are the sides, `left` or
    `right`, to which vehicles drive. If every push leaves the picture, the gentlest
    one is returned.
    """
    tried = list(_candidates(trials, confidence, facing))
    tried = [one for one in tried if one.outcome.grade > Grade.NOTHING]
    if not tried:
        return None
    tried = [_weighted(one, confidence) for one in tried]
    ordered = sorted(tried, key=_preference, reverse=True)
    verified: list[Candidate] = []
    for candidate in ordered[: TRIAL.verified]:
        if sum(one.outcome.work for one in verified) > TRIAL.work:
            break
        again = _try(trials, candidate, facing, trials.world)
        again = _weighted(again, confidence)
        verified.append(again)
        if again.outcome.grade >= candidate.outcome.grade:
            break
    moving = [one for one in verified if one.outcome.grade > Grade.NOTHING]
    return max(moving, key=_preference, default=ordered[0])


def _weighted(candidate: Candidate, confidence: Mapping[str, float]) -> Candidate:
    """Return a candidate whose score counts as far as its object is sure."""
    outcome = candidate.outcome
    score = outcome.score * confidence.get(candidate.item.name, 1.0)
    return replace(candidate, outcome=replace(outcome, score=score))


def choose_speed(
    trials: TrialScene, item: Object, direction: Direction, facing: Mapping[str, str]
) -> float | None:
    """Return the speed, px/s, of the best push of this object.

    The rules are those of `choose_push`. None if no push moves anything visibly.
    """
    world = replace(trials.world, steps_per_second=TRIAL.rate)
    tried = list(_search(trials, item, direction, facing, world))
    moving = [one for one in tried if one.outcome.grade > Grade.NOTHING]
    best = max(moving, key=_preference, default=None)
    return None if best is None else best.speed


def _preference(candidate: Candidate) -> tuple[float, ...]:
    """Return the key by which pushes are ordered, the best last.

    Of pushes by which something leaves the picture, the gentlest is the best.
    """
    outcome = candidate.outcome
    gentle = -candidate.speed
    if outcome.grade is Grade.LEAVES:
        return (outcome.grade, gentle, outcome.score)
    level = int(log(max(outcome.score, 1e-3), 1 / TRIAL.enough))
    return (outcome.grade, level, gentle)


def _candidates(
    trials: TrialScene, confidence: Mapping[str, float], facing: Mapping[str, str]
) -> Iterator[Candidate]:
    """Yield pushes and their outcomes in coarse steps, as far as the work allows."""
    world = replace(trials.world, steps_per_second=TRIAL.rate)
    ranked = rank_pushes(trials, confidence)[: TRIAL.more]
    highest = _highest_score(trials)
    work, count, has_story, is_visible = 0.0, 0, False, False
    for order, pair in enumerate(ranked):
        if has_story and order >= TRIAL.pairs:
            return
        for candidate in _search(trials, *pair, facing, world):
            yield candidate
            outcome = candidate.outcome
            work += outcome.work
            count += 1
            has_story |= outcome.is_calm and outcome.score > TRIAL.poor
            score = outcome.score * confidence.get(candidate.item.name, 1.0)
            is_best = outcome.grade is Grade.STORY and score >= TRIAL.enough * highest
            most = TRIAL.most if has_story else 2 * TRIAL.most
            is_visible |= outcome.is_calm and outcome.travel >= TRIAL.travel
            most_work = TRIAL.work if is_visible else TRIAL.more_work
            if is_best or work > most_work or count >= most:
                return


def _highest_score(trials: TrialScene) -> float:
    """Return the score of a push after which all move far, and what is tall falls."""
    total = 0.0
    for body in trials.world.bodies:
        if body.motion is Motion.DYNAMIC:
            total += 1 + (TRIAL.falls if _is_tall(body) else 0)
    return total


def _search(
    trials: TrialScene,
    item: Object,
    direction: Direction,
    facing: Mapping[str, str],
    world: World,
) -> Iterator[Candidate]:
    """Yield pushes of an object in a direction, from gentle to hard.

    The search ends when a harder push does not tell more, or, between one by which all
    stays in the picture and one by which something leaves, after a few halvings.
    """

    def tried(speed: float) -> Candidate:
        start = Candidate(item, direction, float(f"{speed:.2g}"), NO_MOTION)
        return _try(trials, start, facing, world)

    speeds = _speed_limits(trials, item)
    speed, hardest = speeds
    calm, leaving = 0.0, inf
    best, halvings = 0.0, 0
    previous = NO_MOTION
    while speed <= hardest and halvings <= TRIAL.halvings:
        candidate = tried(speed)
        outcome = candidate.outcome
        if calm and _is_too_hard(outcome, previous):
            yield tried(sqrt(calm * speed))
        yield candidate
        if outcome.grade is Grade.STORY and outcome.score <= TRIAL.worth * best:
            if calm and outcome.travel > TRIAL.slide:
                yield tried(sqrt(calm * speed))
            return
        if outcome.grade is Grade.LEAVES:
            leaving = speed
        else:
            calm = speed
            previous = outcome
        if outcome.grade is not Grade.LEAVES:
            best = max(best, outcome.score)
        if leaving < inf:
            halvings += 1
            speed = sqrt(calm * leaving) if calm else leaving / 2
        else:
            speed = calm * _next_step(trials, outcome)


def _is_too_hard(outcome: Outcome, gentler: Outcome) -> bool:
    """Return whether a push between two may tell more than the harder one.

    What goes too far uncovers much, and what rocks for long may be pushed less.
    """
    if outcome.grade is Grade.STORY:
        return gentler.grade is not Grade.STORY and outcome.travel > TRIAL.far
    is_short = gentler.grade is Grade.SHORT and gentler.travel < TRIAL.travel
    return is_short and outcome.grade is Grade.RESTLESS


def _next_step(trials: TrialScene, outcome: Outcome) -> float:
    """Return the factor to the next speed: motion grows with the speed squared."""
    if trials.scene.world.view is View.TOP and outcome.grade is Grade.STORY:
        return TRIAL.doubling
    lacking = sqrt(1.6 * TRIAL.slide / max(outcome.travel, 1e-6))
    return min(max(lacking, TRIAL.steps[0]), TRIAL.steps[1])


def _try(
    trials: TrialScene, candidate: Candidate, facing: Mapping[str, str], world: World
) -> Candidate:
    """Simulate a push in a world at rest."""
    item = candidate.item
    outcome = simulate_push(trials, {item.name: candidate.velocity}, world)
    forwards = SIDES.get(facing.get(item.name, ""), 0.0)
    if forwards * candidate.direction[0] < 0:
        outcome = replace(outcome, score=TRIAL.wrong_way * outcome.score)
    return replace(candidate, outcome=outcome)


def _speed_limits(trials: TrialScene, item: Object) -> tuple[float, float]:
    """Return the gentlest and the hardest speed of an object, px/s.

    A thin object is tipped as by a finger: it falls and need not slide.
    """
    ordinary = trials.ordinary
    gentlest, hardest = TRIAL.gentlest * ordinary, TRIAL.hardest * ordinary
    body = next(body for body in trials.world.bodies if body.name == item.name)
    tips = _tipping_speed(body, hypot(*trials.world.gravity))
    width, height = _extent(body)
    if tips is None:
        return gentlest, hardest
    if height < TRIAL.thin * width:
        first = min(tips, TRIAL.slides * _sliding_speed(trials, item.name))
        return min(max(gentlest, first), hardest), hardest
    return TRIAL.tips[0] * tips, max(TRIAL.tips[1] * tips, gentlest)


def _sliding_speed(trials: TrialScene, name: str) -> float:
    """Return the speed, px/s, from which an object slides visibly on what is smoothest."""
    surfaces = dict(trials.world.surfaces)
    own = surfaces.pop(name).friction
    least = min((one.friction for one in surfaces.values()), default=0.0)
    gravity = hypot(*trials.world.gravity)
    return sqrt(2 * own * least * gravity * TRIAL.travel * trials.side)


def _is_tall(body: Body) -> bool:
    """Return whether a body may fall over."""
    width, height = _extent(body)
    return body.radius is None and height >= TRIAL.tall * width


def _extent(body: Body) -> tuple[float, float]:
    """Return width and height of a body, px."""
    corners = np.concatenate(body.rings)
    width, height = np.ptp(corners, axis=0).tolist()
    return float(width), float(height)


def _tipping_speed(body: Body, gravity: float) -> float | None:
    """Return the speed, px/s, that tips a body over its lower corner.

    Its foot is stopped: angular momentum about the corner and then energy are
    conserved. None for what rolls, and seen from above.
    """
    if body.radius is not None or not gravity:
        return None
    corners = np.concatenate(body.rings)
    x0, x1 = float(corners[:, 0].min()), float(corners[:, 0].max())
    height = float(corners[:, 1].max())  # of the centre of mass above its foot
    rise = hypot((x1 - x0) / 2, height) - height
    inertia = body.moment / body.mass + (rise + height) ** 2
    return sqrt(2 * gravity * rise * inertia) / height


# Outcome of one push


def simulate_push(
    trials: TrialScene,
    velocities: Mapping[str, tuple[float, float]],
    world: World | None = None,
) -> Outcome:
    """Simulate pushes until all rests or something leaves the picture.

    `velocities` are those of objects by name, px/s. `world` is that of `trials` unless
    another one, at rest, is given.
    """
    world = _pushed_world(trials, velocities, world or trials.world)
    motion, has_left, work = _run(trials, world)
    travel = _travel(world, motion) / trials.side
    speed = max(hypot(*velocity) for velocity in velocities.values())
    if travel.max(initial=0.0) < TRIAL.least or _explodes(trials, motion, speed):
        farthest = float(travel.max(initial=0.0))
        return replace(NO_MOTION, travel=farthest, work=work)
    names = [body.name for body in world.bodies]
    moved = tuple(names[k] for k in np.flatnonzero(travel >= TRIAL.least))
    gone = tuple(names[k] for k in np.flatnonzero(has_left))
    seconds = _moving_time(world, motion, TRIAL.unrest * trials.side)
    is_resting = seconds <= float(motion.times[-1]) - trials.unit
    slow = playback_of(trials, seconds)
    shown = _moving_time(world, motion, TRIAL.visible * trials.side)
    film = min(shown * slow / PLAYBACK.least_motion, 1.0)
    film = min(film, float(travel.max()) / TRIAL.travel)
    fallen = _fallen(world, motion)
    score = float(np.minimum(travel / _full_travel(world, fallen), 1.0).sum())
    score += TRIAL.falls * len(fallen)
    if any(_returns(motion, *push) for push in velocities.items()):
        score *= TRIAL.rebound
    is_thrown = any(_is_thrown(trials, motion, *push) for push in velocities.items())
    if _overhangs(trials, world, motion):
        score *= TRIAL.overhang
        film = min(film, TRIAL.overhang)
    if _crowds_border(trials, world, motion):
        score *= TRIAL.crowded
    climbs = _climbs(trials, world, motion)
    if climbs or any(_tumbles(world, motion, name) for name in velocities):
        score *= TRIAL.tumbling
        film = min(film, TRIAL.tumbling)
    grade = Grade.STORY
    if gone or is_thrown:
        grade = Grade.LEAVES
    elif climbs or not is_resting:
        grade = Grade.RESTLESS
    elif film < 1:
        grade = Grade.SHORT
        score *= film
    return Outcome(grade, score, float(travel.max()), seconds, moved, gone, work)


def playback_of(trials: TrialScene, seconds: float) -> int:
    """Return the slow motion of a clip in which something moves for these s."""
    usual = slow_motion(trials.side, trials.scene.world.pixels_per_meter)
    return story_slow_motion(usual, seconds)


def _pushed_world(
    trials: TrialScene, velocities: Mapping[str, tuple[float, float]], world: World
) -> World:
    """Return a world with some of its objects in motion."""
    from physgen.compile.compile import set_velocity

    bodies = list(world.bodies)
    for index, item in enumerate(trials.scene.objects):
        if item.name in velocities:
            pushed = replace(item, velocity=velocities[item.name])
            view = trials.scene.world.view
            bodies[index] = set_velocity(bodies[index], pushed, view)
    return replace(world, bodies=tuple(bodies))


def _run(
    trials: TrialScene, world: World
) -> tuple[Trajectory, NDArray[np.bool_], float]:
    """Simulate until all rests or something leaves.

    Return the motion, which bodies leave (N,), and the work.
    """
    from physgen.simulate.engine import Running

    end = min(TRIAL.units * trials.unit, TRIAL.longest)
    step = trials.unit / TRIAL.samples
    count = max(int(end / step), 2)
    running = Running(world, np.linspace(0.0, end, count + 1))
    limit = TRIAL.one * max(world.steps_per_second / TRIAL.rate, 1.0)
    still = TRIAL.unrest * trials.side / 4
    frame = _Frame.of(trials, world)
    has_left = np.zeros(len(world.bodies), bool)
    done = 0
    while done < len(running.times):
        stop = min(done + TRIAL.samples, len(running.times))
        running.on(float(running.times[stop - 1]))
        motion = running.trajectory()
        poses = motion.poses[done:stop]
        has_left = frame.leaving(poses)
        is_still = done > 0 and _sweep(world, poses).max(initial=0.0) < still
        done = stop
        if has_left.any() or is_still or running.work > limit:
            break
    known = motion.poses[:done]
    return (
        replace(motion, times=motion.times[:done], poses=known),
        has_left,
        running.work,
    )


@dataclass(frozen=True)
class _Frame:
    """The picture's border, widened by what reaches out of it at the start."""

    points: Sequence[Array]
    """Corners of the bodies in their own frames, (P, 2) px."""
    low: Array
    """(N, 2) px."""
    high: Array
    """(N, 2) px."""
    is_watched: NDArray[np.bool_]
    """(N,): bodies that can move."""

    @staticmethod
    def of(trials: TrialScene, world: World) -> _Frame:
        points = [_corners(body) for body in world.bodies]
        centers = [body.center for body in world.bodies]
        low = np.array(
            [p.min(axis=0) + c for p, c in zip(points, centers, strict=True)]
        )
        high = np.array(
            [p.max(axis=0) + c for p, c in zip(points, centers, strict=True)]
        )
        slack = TRIAL.beside * trials.side
        movable = [body.motion is Motion.DYNAMIC for body in world.bodies]
        return _Frame(
            points,
            np.minimum(low.reshape(-1, 2), -0.5 - slack),
            np.maximum(high.reshape(-1, 2), np.array(world.size) - 0.5 + slack),
            np.array(movable, bool),
        )

    def leaving(self, poses: Array) -> NDArray[np.bool_]:
        """Return which bodies are outside in one of the poses (S, N, 3)."""
        result = np.zeros(len(self.points), bool)
        for k in np.flatnonzero(self.is_watched).tolist():
            places = _placed(self.points[k], poses[:, k])
            is_low = (places < self.low[k] - 1e-6).any()
            result[k] = is_low or (places > self.high[k] + 1e-6).any()
        return result


def _corners(body: Body) -> Array:
    """Return the corners of a body's convex hull in its own frame, (P, 2) px."""
    points = np.concatenate(body.rings).astype(np.float32)
    hull = cv2.convexHull(points).reshape(-1, 2)
    return np.asarray(hull, np.float64)


def _placed(points: Array, poses: Array) -> Array:
    """Return points (P, 2) of a body at its poses (S, 3): (S, P, 2) px."""
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = points[:, 0] * cosine[:, None] - points[:, 1] * sine[:, None]
    y = points[:, 0] * sine[:, None] + points[:, 1] * cosine[:, None]
    return np.stack([x, y], axis=-1) + poses[:, None, :2]


def _shift(body: Body, poses: Array) -> Array:
    """Return how far the outline is from its first pose, at each pose (S,), px.

    A disc that turns in place does not move; a polygon's farthest corner counts.
    """
    if body.radius is not None:
        return np.asarray(np.hypot(*(poses[:, :2] - poses[0, :2]).T))
    places = _placed(_corners(body), poses)
    return np.asarray(np.hypot(*np.moveaxis(places - places[0], -1, 0)).max(axis=1))


def _travel(world: World, motion: Trajectory) -> Array:
    """Return the farthest displacement of each body, (N,) px."""
    return _sweep(world, motion.poses)


def _sweep(world: World, poses: Array) -> Array:
    """Return the farthest displacement of each body from its first pose, (N,) px."""
    far = [_shift(body, poses[:, k]).max() for k, body in enumerate(world.bodies)]
    return np.array(far, np.float64)


def _moving_time(world: World, motion: Trajectory, least: float) -> float:
    """Return the s after which no body is `least` px from its last pose."""
    last = 0
    for k, body in enumerate(world.bodies):
        away = _shift(body, motion.poses[::-1, k])[::-1]
        moving = np.flatnonzero(away > least)
        last = max(last, int(moving.max(initial=0)))
    return float(motion.times[last])


def _fallen(world: World, motion: Trajectory) -> list[str]:
    """Return the names of tall objects that have fallen over at the end."""
    names = []
    for k, body in enumerate(world.bodies):
        turn = abs(float(motion.poses[-1, k, 2] - motion.poses[0, k, 2]))
        if _is_tall(body) and turn >= radians(TRIAL.fallen):
            names.append(body.name)
    return names


def _tumbles(world: World, motion: Trajectory, name: str) -> bool:
    """Return whether a low object turns over: bowls, cars and bags slide instead."""
    index = motion.names.index(name)
    body = world.bodies[index]
    if body.radius is not None or _is_tall(body):
        return False
    turns = motion.poses[:, index, 2] - motion.poses[0, index, 2]
    return bool(np.abs(turns).max() > radians(TRIAL.tumble))


def _full_travel(world: World, fallen: Collection[str]) -> Array:
    """Return the motion (N,) of each body that counts in full."""
    is_free = [body.radius is not None or body.name in fallen for body in world.bodies]
    return np.where(np.array(is_free, bool), TRIAL.far, TRIAL.slide)


def _climbs(trials: TrialScene, world: World, motion: Trajectory) -> bool:
    """Return whether a body that moves rises by much: objects stay on what bears them."""
    if trials.scene.world.view is not View.SIDE:
        return False
    for k, body in enumerate(world.bodies):
        lows = _placed(_corners(body), motion.poses[:, k])[..., 1].max(axis=1)
        _, height = _extent(body)
        if lows[0] - lows.min() > TRIAL.rise * height:
            return True
    return False


def _overhangs(trials: TrialScene, world: World, motion: Trajectory) -> bool:
    """Return whether a body that moved ends beyond the end of what it stands on."""
    near = TRIAL.edge * trials.side
    ends = [chain[k] for wall in world.walls for chain in wall.chains for k in (0, -1)]
    for k, body in enumerate(world.bodies):
        if np.hypot(*(motion.poses[-1, k, :2] - motion.poses[0, k, :2])) < near:
            continue
        places = _placed(_corners(body), motion.poses[-1:, k])[0]
        low, left, right = places[:, 1].max(), places[:, 0].min(), places[:, 0].max()
        for x, y in ends:
            if abs(y - low) < near and left + near < x < right - near:
                return True
    return False


def _crowds_border(trials: TrialScene, world: World, motion: Trajectory) -> bool:
    """Return whether a body ends closer to the border than it began, and at it."""
    least = TRIAL.border * trials.side
    size = np.array(world.size, np.float64)
    for k, body in enumerate(world.bodies):
        if body.motion is not Motion.DYNAMIC:
            continue
        places = _placed(_corners(body), motion.poses[[0, -1], k])
        gaps = np.minimum(places, size - places).min(axis=(1, 2))
        if gaps[1] < min(least, gaps[0] - 1):
            return True
    return False


def _explodes(trials: TrialScene, motion: Trajectory, speed: float) -> bool:
    """Return whether something is faster than a push and a fall over the photo."""
    if len(motion.times) < 2:
        return False
    steps = np.diff(motion.poses[..., :2], axis=0)
    lengths = np.hypot(*np.moveaxis(steps, -1, 0))
    fastest = float(lengths.max(initial=0.0)) / float(motion.times[1])
    fall = sqrt(2 * hypot(*trials.world.gravity) * trials.side)
    return fastest > TRIAL.wild * (speed + fall)


def _returns(motion: Trajectory, name: str, velocity: Sequence[float]) -> bool:
    """Return whether an object goes back farther than it went."""
    index = motion.names.index(name)
    way = motion.poses[:, index, :2] - motion.poses[0, index, :2]
    along = way @ np.array(velocity, np.float64)
    return bool(-along.min() > along.max())


def _is_thrown(
    trials: TrialScene, motion: Trajectory, name: str, velocity: Sequence[float]
) -> bool:
    """Return whether an object rebounds from a wall that the photo does not show."""
    if not any(velocity):
        return False
    index = motion.names.index(name)
    way = np.array(velocity, np.float64)
    taken = _stopped_mass(motion, index, way, trials.unseen)
    return taken > TRIAL.thrown * trials.world.bodies[index].mass


def _stopped_mass(
    motion: Trajectory, index: int, velocity: Array, unseen: Collection[str]
) -> float:
    """Return the mass, g, whose momentum `unseen` walls take; friction takes none."""
    _, first, second = motion.contacts.impulse_rows.T
    is_wall = np.isin(motion.contacts.surfaces, list(unseen))
    is_wall[: len(motion.names)] = False  # objects
    hits = motion.contacts.impulses[(first == index) & is_wall[second]]
    back = -hits @ velocity
    aside = np.abs(cross(velocity, hits))
    return float((back * (back > aside)).sum() / (velocity @ velocity))


# Rank of pushes before they are simulated


@dataclass(frozen=True)
class RankWeights:
    """Weights of what lies ahead of an object; lengths are shares of the longer side."""

    room: float = 0.3
    """Free way ahead that counts in full."""
    beyond: float = 0.1
    """Weight of the room behind the last object ahead, where that one may fall."""
    ahead: float = 1.5
    """Weight of objects ahead, against that of a free way: something is struck."""
    loaded: float = 0.5
    """Weight of an object that carries others, seen from the side: it is jammed."""
    beside: float = 0.1
    """Of an object's width across the way, from which it lies ahead."""
    touch: float = 2.0
    """px between objects on each other."""


RANK = RankWeights()


def rank_pushes(
    trials: TrialScene, confidence: Mapping[str, float]
) -> list[tuple[Object, Direction]]:
    """Return objects and directions to push them, the most promising first."""
    scene, bodies = trials.scene, trials.world.bodies
    corners = [np.concatenate(body.rings) + body.center for body in bodies]
    ranked: list[tuple[float, int, Object, Direction]] = []
    for k, item in enumerate(scene.objects):
        sure = confidence.get(item.name, 1.0)
        if item.motion is not Motion.DYNAMIC or sure < TRIAL.confidence:
            continue
        if is_living(item.label):
            continue
        weight = sure * (RANK.loaded if _is_loaded(scene, corners, k) else 1.0)
        barred = SIDES.get(trials.barred.get(item.name, ""), 0.0)
        for direction in _directions(scene, bodies, k):
            if barred * direction[0] > 0:
                continue
            score = weight * _room_score(trials, corners, k, direction)
            ranked.append((score, -len(ranked), item, direction))
    ranked.sort(key=lambda one: one[:2], reverse=True)
    return [(item, direction) for _, _, item, direction in ranked]


def _is_loaded(scene: Scene, corners: Sequence[Array], k: int) -> bool:
    """Return whether something lies on an object that is seen from the side."""
    if scene.world.view is not View.SIDE:
        return False
    left, top = corners[k].min(axis=0)
    right = corners[k][:, 0].max()
    for n, points in enumerate(corners):
        (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
        is_near = abs(y1 - top) < RANK.touch + 0.1 * (y1 - y0)
        if n != k and is_near and x0 < right and x1 > left:
            return True
    return False


def _directions(scene: Scene, bodies: Sequence[Body], k: int) -> list[Direction]:
    """Return the unit directions in which an object may be pushed.

    Seen from the side they are level; from above they point to the nearest object, to
    the middle of all, and to the middle of the photo.
    """
    if scene.world.view is View.SIDE:
        return [(1.0, 0.0), (-1.0, 0.0)]
    center = bodies[k].center
    others = [body.center for n, body in enumerate(bodies) if n != k]
    middle = (np.array(scene.size) - 1) / 2
    goals = [middle]
    if others:
        distances = [float(np.hypot(*(other - center))) for other in others]
        goals = [others[int(np.argmin(distances))], np.mean(others, axis=0), middle]
    directions: list[Direction] = []
    for goal in goals:
        x, y = (float(part) for part in goal - center)
        length = hypot(x, y)
        directions.append((x / length, y / length) if length > 1 else (1.0, 0.0))
    return list(dict.fromkeys(directions))


def _room_score(
    trials: TrialScene, corners: Sequence[Array], k: int, direction: Direction
) -> float:
    """Return a score of the free way and the objects ahead of an object."""
    frame = np.array([direction, (-direction[1], direction[0])])
    turned = [points @ frame.T for points in corners]
    low = np.array([points.min(axis=0) for points in turned])
    high = np.array([points.max(axis=0) for points in turned])
    shared = np.minimum(high, high[k]) - np.maximum(low, low[k])
    is_beside = shared[:, 1] > RANK.beside * (high - low)[:, 1]
    is_ahead = is_beside & (low[:, 0] > high[k, 0] - RANK.touch)
    ahead = [n for n in np.flatnonzero(is_ahead).tolist() if n != k]
    end = max(np.array([[0, 0], trials.scene.size]) @ frame[0])
    room = RANK.room * trials.side
    center = trials.world.bodies[k].center
    gaps = [end - center @ frame[0], *(low[n, 0] - high[k, 0] for n in ahead)]
    free = float(np.clip(min(gaps) / room, 0, 1))
    last = max(high[n, 0] for n in (k, *ahead))
    beyond = float(np.clip((end - last) / room, 0, 1))
    return free + RANK.beyond * beyond + RANK.ahead * (1 - 0.5 ** len(ahead))
