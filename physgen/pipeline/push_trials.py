"""Choice of the push that perception writes: trial simulations and their score.

A push should start a short story that stays in the picture: an object moves visibly,
like others of its kind, and at the end all moving objects are in the picture and at
rest. Lengths are shares of the photo's longer side, and the unit of time is that of a
fall over half of this side, so that small and large scenes are judged alike.
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
    """Minimum confidence of a pushed object; below it, its mask needs a check."""
    pairs: int = 6
    """Number of objects with a direction to try."""
    patience: int = 2
    """Number of further pairs to try after a story without a better one."""
    more: int = 16
    """The same while no push makes a story, as in a heap of objects that block each
    other.
    """
    most: int = 28
    """Number of trials; twice as many while no push makes a story."""
    poor: float = 0.4
    """Score below which a push is no story, whatever its grade."""
    work: float = 2500.0
    """Work of all trials together, in steps of the engine: about half a second."""
    more_work: float = 7500.0
    """The same while no calm push moves an object by `travel`."""
    one: float = 1500.0
    """Work after which a single trial ends: jammed objects take long."""
    longest: float = 6.0
    """Maximum duration of a trial, s: a scale wrong by powers of ten would take
    minutes.
    """
    units: float = 20.0
    """Duration of a trial, units of time: 4.5 s in a photo of 0.5 m."""
    samples: int = 16
    """Samples per unit of time."""
    rate: float = 120.0
    """Steps per second of a trial; the best pushes are tried again in those of the
    scene, since no coarser steps give all of its grades.
    """
    ramp_frames: int = 3
    """Frames of a push: one alone looks like a jump."""
    fps: int = 30
    """Frames a second of perceived scenes."""
    gentlest: float = 0.12
    """Gentlest push, relative to the ordinary speed: 0.15 m/s in a photo of 0.5 m."""
    hardest: float = 1.5
    """Hardest push, relative to the ordinary speed."""
    steps: tuple[float, float] = (1.25, 2.5)
    """Minimum and maximum factor of the speed from one trial to the next."""
    doubling: float = 2.0
    """The factor after a visible story in the top view: rolling objects move far and
    long.
    """
    slides: float = 0.8
    """First speed, relative to that at which friction permits a visible slide."""
    halvings: int = 3
    """Number of speeds between one without and one with objects that leave the
    picture.
    """
    verified: int = 3
    """Maximum number of pushes that are tried again."""
    tips: tuple[float, float] = (1.25, 2.0)
    """Range of speeds for a thin object, relative to its tipping speed."""
    thin: float = 3.0
    """Height over width above which an object is tipped as by a finger."""
    tall: float = 1.4
    """Height over width above which a fall of an object is worth more."""
    fallen: float = 50.0
    """Rotation above which an object has fallen over, degrees."""
    travel: float = 0.05
    """Minimum displacement of a story."""
    least: float = 0.03
    """Minimum visible displacement: in a heap, no object moves farther."""
    far: float = 0.15
    """Displacement of the full score: a hand's breadth in a photo of 0.5 m."""
    slide: float = 0.08
    """The same for a sliding object, which uncovers filled background."""
    beside: float = 0.005
    """Margin beyond the border that still counts as inside the picture."""
    unrest: float = 0.004
    """Displacement in the last unit of time that still counts as rest."""
    visible: float = 0.0015
    """Distance from the last place above which an object still moves: 2 px of 1280."""
    falls: float = 0.5
    """Score of each fallen object, relative to an object with a long path."""
    worth: float = 1.1
    """Gain of the score above which a harder push or another object is preferred."""
    enough: float = 0.85
    """Share of the best score above which a gentler push is preferred."""
    wrong_way: float = 0.3
    """Factor of the score for a vehicle driving backwards."""
    rebound: float = 0.25
    """Factor for the return of an object from an obstacle."""
    border: float = 0.02
    """Gap to the picture's border below which an object ends crowded."""
    crowded: float = 0.8
    """Factor for a push after which an object ends crowded, without such a start."""
    overhang: float = 0.2
    """Factor for a push after which an object stands half beyond a visible edge."""
    tumble: float = 35.0
    """Rotation above which a low object tumbles instead of sliding, degrees."""
    tumbling: float = 0.3
    """Factor for a push by which a low object tumbles."""
    rise: float = 0.25
    """Smallest climb over an obstacle or throw upwards, by an object's height."""
    edge: float = 0.02
    """Tolerance of the position on an edge."""
    thrown: float = 0.25
    """Share of an object's momentum that an invisible wall takes in a rebound."""
    wild: float = 2.5
    """Ratio to the speeds of the push and of a fall over the photo above which the
    simulation explodes.
    """


TRIAL = TrialLimits()


class Grade(IntEnum):
    """The suitability of a push's outcome, the best last."""

    NOTHING = 0
    """No object moves visibly, or all explode."""
    LEAVES = 1
    """An object leaves the picture, or rebounds from an invisible wall."""
    RESTLESS = 2
    """An object still moves at the end of the trial, or climbs an obstacle."""
    SHORT = 3
    """All objects stay and rest, after motion of less than a second of video."""
    STORY = 4
    """An object moves for a second of video, and all stay and rest."""


@dataclass(frozen=True)
class Outcome:
    """The motion by a push, from a simulation without pictures."""

    grade: Grade
    score: float
    """Number of objects that move far, with bonuses and penalties."""
    travel: float
    """Largest displacement of a point, as a share of the photo's longer side."""
    seconds: float
    """Simulated time with motion, s."""
    moved: tuple[str, ...]
    """Names of the visibly moving objects."""
    left: tuple[str, ...]
    """Names of the objects outside the picture at the end."""
    work: float = 0.0
    """Work of the trial, in steps of the engine."""

    @property
    def is_inside(self) -> bool:
        """Check whether an object moves and none leaves the picture."""
        return self.grade > Grade.LEAVES

    @property
    def is_calm(self) -> bool:
        """Check whether an object moves, and all stay and rest."""
        return self.grade >= Grade.SHORT


NO_MOTION = Outcome(Grade.NOTHING, 0.0, 0.0, 0.0, (), ())


@dataclass(frozen=True)
class Candidate:
    """A push and its outcome."""

    item: Object
    direction: Direction
    """Unit vector, image axes."""
    speed: float
    """Speed, px/s."""
    outcome: Outcome
    ramp: float | None = None
    """Time, s, within which the object reaches its velocity; 0: at once; None: as in
    the scene.
    """

    @property
    def velocity(self) -> tuple[float, float]:
        """Return the velocity, px/s, in whole numbers."""
        x, y = self.direction
        return (round(self.speed * x), round(self.speed * y))


@dataclass(frozen=True)
class TrialScene:
    """The common data of all trials of a scene."""

    scene: Scene
    world: World
    unseen: frozenset[str]
    """Walls outside the photo."""
    barred: Mapping[str, str] = field(default_factory=dict)
    """Sides, `left` or `right`, to which an object is not pushed, by the
    object's name.
    """
    ramp: float | None = None
    """Given time of a push, s; None: that of some frames, or at once."""

    @property
    def side(self) -> int:
        """Return the photo's longer side, px."""
        return max(self.scene.size)

    @property
    def ordinary(self) -> float:
        """Return the speed of a push across the photo, px/s."""
        return push_speed(self.side, self.scene.world.pixels_per_meter)

    @property
    def unit(self) -> float:
        """Return the time of a fall over half of the longer side, s."""
        gravity = PLAYBACK.gravity * self.scene.world.pixels_per_meter
        return sqrt(self.side / gravity)


def compile_trials(
    scene: Scene,
    shapes: Shapes,
    unseen: Collection[str] = (),
    barred: Mapping[str, str] = MappingProxyType({}),
    ramp: float | None = None,
) -> TrialScene:
    """Compile the common world of all trials of a scene. Raises InputError."""
    from physgen.compile.compile import compile_shapes

    world = compile_shapes(scene, shapes).world
    return TrialScene(scene, world, frozenset(unseen), barred, ramp)


def choose_push(
    trials: TrialScene,
    confidence: Mapping[str, float],
    facing: Mapping[str, str],
) -> Candidate | None:
    """Return the best push that stays in the picture; None if no push moves an object.

    `confidence` are confidences of objects by name; `facing` are the driving
    directions, `left` or `right`, of vehicles. If all pushes leave the picture, the
    gentlest one is returned.
    """
    # Search at a coarse step first, and verify only the best pushes at the scene's own
    # rate: a coarse step may miss an impact.
    candidates = list(_candidates(trials, confidence, facing))
    candidates = [trial for trial in candidates if trial.outcome.grade > Grade.NOTHING]
    if not candidates:
        return None
    candidates = list(_free_of_load(trials, candidates))
    candidates = [_weight_candidate(trial, confidence) for trial in candidates]
    sorted_candidates = sorted(candidates, key=_preference, reverse=True)
    verified_candidates: list[Candidate] = []
    for candidate in sorted_candidates[: TRIAL.verified]:
        if sum(trial.outcome.work for trial in verified_candidates) > TRIAL.work:
            break
        verified_candidate = _verify(trials, candidate, facing)
        verified_candidate = _weight_candidate(verified_candidate, confidence)
        verified_candidates.append(verified_candidate)
        if verified_candidate.outcome.grade >= candidate.outcome.grade:
            break
    moving_candidates = [
        trial for trial in verified_candidates if trial.outcome.grade > Grade.NOTHING
    ]
    return max(moving_candidates, key=_preference, default=sorted_candidates[0])


def _verify(
    trials: TrialScene, candidate: Candidate, facing: Mapping[str, str]
) -> Candidate:
    """Try a push again, in the scene's own steps and as a hand gives it.

    The push is at once if the hand makes the outcome worse, unless the time of the push
    is given. The work of the outcome is that of both trials.
    """
    world, given_ramp = trials.world, trials.ramp
    ramp = ramp_of(playback_of(trials, candidate.outcome.seconds))
    ramp = ramp if given_ramp is None else given_ramp
    ramped = _try(trials, replace(candidate, ramp=ramp), facing, world)
    is_as_good = ramped.outcome.grade >= candidate.outcome.grade
    if is_as_good or given_ramp is not None:
        return ramped
    sudden = _try(trials, replace(candidate, ramp=0.0), facing, world)
    is_better = sudden.outcome.grade > ramped.outcome.grade
    best = sudden if is_better else ramped
    work = ramped.outcome.work + sudden.outcome.work
    return replace(best, outcome=replace(best.outcome, work=work))


def ramp_of(slow: int) -> float:
    """Return the time, s, of a push in a clip with this slow motion."""
    return float(f"{TRIAL.ramp_frames / (TRIAL.fps * slow):.2g}")


def _free_of_load(
    trials: TrialScene, candidates: Sequence[Candidate]
) -> Sequence[Candidate]:
    """Return the pushes of objects without a load; all if none of those is a story."""
    loaded = _loaded_names(trials)
    free = [trial for trial in candidates if trial.item.name not in loaded]
    has_story = any(trial.outcome.grade is Grade.STORY for trial in free)
    return free if has_story else candidates


def _loaded_names(trials: TrialScene) -> set[str]:
    """Return the names of objects on which others lie."""
    corners = [np.concatenate(body.rings) + body.center for body in trials.world.bodies]
    objects = enumerate(trials.scene.objects)
    return {item.name for k, item in objects if _is_loaded(trials.scene, corners, k)}


def _weight_candidate(
    candidate: Candidate, confidence: Mapping[str, float]
) -> Candidate:
    """Multiply a candidate's score by the confidence of its object."""
    outcome = candidate.outcome
    score = outcome.score * confidence.get(candidate.item.name, 1.0)
    return replace(candidate, outcome=replace(outcome, score=score))


def choose_speed(
    trials: TrialScene, item: Object, direction: Direction, facing: Mapping[str, str]
) -> float | None:
    """Return the speed of the best push of this object, px/s.

    The rules are those of `choose_push`. None if no push moves an object visibly.
    """
    world = replace(trials.world, steps_per_second=TRIAL.rate)
    candidates = list(_search(trials, item, direction, facing, world))
    moving_candidates = [
        candidate for candidate in candidates if candidate.outcome.grade > Grade.NOTHING
    ]
    best = max(moving_candidates, key=_preference, default=None)
    return None if best is None else best.speed


def _preference(candidate: Candidate) -> tuple[float, ...]:
    """Return the sort key of pushes, the best last.

    If objects leave the picture, the gentlest push is the best.
    """
    outcome = candidate.outcome
    gentleness = -candidate.speed
    if outcome.grade is Grade.LEAVES:
        return (outcome.grade, gentleness, outcome.score)
    level = int(log(max(outcome.score, 1e-3), 1 / TRIAL.enough))
    return (outcome.grade, level, gentleness)


def _candidates(
    trials: TrialScene, confidence: Mapping[str, float], facing: Mapping[str, str]
) -> Iterator[Candidate]:
    """Yield pushes and their outcomes in coarse steps, within the limit of work."""
    world = replace(trials.world, steps_per_second=TRIAL.rate)
    # A search yields the same speed again if it halves an interval to it.
    known_pushes: set[tuple[str, Direction, float]] = set()
    sorted_pushes = rank_pushes(trials, confidence)[: TRIAL.more]
    effort = _SearchEffort(_highest_score(trials), _loaded_names(trials))
    for pair in sorted_pushes:
        if effort.ends_before_pair():
            return
        for candidate in _search(trials, *pair, facing, world):
            push = (candidate.item.name, candidate.direction, candidate.speed)
            if push in known_pushes:
                continue
            known_pushes.add(push)
            yield candidate
            if effort.ends_after(_weight_candidate(candidate, confidence), candidate):
                return


@dataclass
class _SearchEffort:
    """Work of a search and its best story, which decide when the search ends.

    Every limit is larger while no push has led to a visible motion or a story.
    """

    highest: float
    """Score that no story exceeds."""
    loaded: Collection[str]
    """Names of objects under others: a story of another object is preferred."""
    pairs: int = 0
    """Number of pairs of an object and a direction so far."""
    work: float = 0.0
    trials: int = 0
    has_story: bool = False
    is_visible: bool = False
    best: float = TRIAL.poor
    """Score of the best story."""
    best_pair: int | None = None
    """Number of pairs when that story was found."""

    def ends_before_pair(self) -> bool:
        """Return whether no other pair is to be tried; else, count one."""
        self.pairs += 1
        if self.has_story and self.pairs > TRIAL.pairs:
            return True
        # Pairs are sorted by promise: few of the later ones are better.
        best = self.best_pair
        return best is not None and self.pairs > best + TRIAL.patience

    def ends_after(self, weighted_candidate: Candidate, candidate: Candidate) -> bool:
        """Count a trial, also with its score by confidence; return whether it is the
        last.
        """
        outcome, score = candidate.outcome, weighted_candidate.outcome.score
        self.work += outcome.work
        self.trials += 1
        self.has_story |= outcome.is_calm and outcome.score > TRIAL.poor
        self.is_visible |= outcome.is_calm and outcome.travel >= TRIAL.travel
        is_story = outcome.grade is Grade.STORY
        is_free = candidate.item.name not in self.loaded
        if is_story and is_free and score > TRIAL.worth * self.best:
            self.best, self.best_pair = score, self.pairs
        if is_story and score >= TRIAL.enough * self.highest:
            return True
        most_trials = TRIAL.most if self.has_story else 2 * TRIAL.most
        most_work = TRIAL.work if self.is_visible else TRIAL.more_work
        return self.work > most_work or self.trials >= most_trials


def _highest_score(trials: TrialScene) -> float:
    """Return the score if all objects move far, and all tall objects fall."""
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

    The search ends when a harder push is no better. Between a push without and one with
    objects that leave the picture, it ends after a few halvings.
    """

    known: dict[float, Candidate] = {}

    def tried(speed: float) -> Candidate:
        rounded_speed = float(f"{speed:.2g}")
        if rounded_speed not in known:
            start = Candidate(item, direction, rounded_speed, NO_MOTION)
            known[rounded_speed] = _try(trials, start, facing, world)
        return known[rounded_speed]

    speeds = _speed_limits(trials, item)
    speed, hardest = speeds
    calm_speed, leaving_speed = 0.0, inf
    best_score, halvings = 0.0, 0
    previous = NO_MOTION
    while speed <= hardest and halvings <= TRIAL.halvings:
        candidate = tried(speed)
        outcome = candidate.outcome
        if calm_speed and _is_too_hard(outcome, previous):
            yield tried(sqrt(calm_speed * speed))
        yield candidate
        if outcome.grade is Grade.STORY and outcome.score <= TRIAL.worth * best_score:
            if calm_speed and outcome.travel > TRIAL.slide:
                yield tried(sqrt(calm_speed * speed))
            return
        if outcome.grade is Grade.LEAVES:
            leaving_speed = speed
        else:
            calm_speed = speed
            previous = outcome
        if outcome.grade is not Grade.LEAVES:
            best_score = max(best_score, outcome.score)
        # The speed that just keeps all objects in the picture is between two known
        # speeds: take their geometric mean.
        if leaving_speed < inf:
            halvings += 1
            speed = (
                sqrt(calm_speed * leaving_speed) if calm_speed else leaving_speed / 2
            )
        else:
            speed = calm_speed * _next_step(trials, outcome)


def _is_too_hard(outcome: Outcome, gentler: Outcome) -> bool:
    """Check whether a push between two may be better than the harder one.

    Objects that move too far uncover much background; rocking objects may need less.
    """
    if outcome.grade is Grade.STORY:
        return gentler.grade is not Grade.STORY and outcome.travel > TRIAL.far
    is_short = gentler.grade is Grade.SHORT and gentler.travel < TRIAL.travel
    return is_short and outcome.grade is Grade.RESTLESS


def _next_step(trials: TrialScene, outcome: Outcome) -> float:
    """Return the factor to the next speed: displacement grows with the speed
    squared.
    """
    if trials.scene.world.view is View.TOP and outcome.grade is Grade.STORY:
        return TRIAL.doubling
    wanted_factor = sqrt(1.6 * TRIAL.slide / max(outcome.travel, 1e-6))
    return min(max(wanted_factor, TRIAL.steps[0]), TRIAL.steps[1])


def _try(
    trials: TrialScene, candidate: Candidate, facing: Mapping[str, str], world: World
) -> Candidate:
    """Simulate a push in a world at rest."""
    item = candidate.item
    velocities = {item.name: candidate.velocity}
    outcome = simulate_push(trials, velocities, world, candidate.ramp)
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
    tipping_speed = _tipping_speed(body, hypot(*trials.world.gravity))
    width, height = _extent(body)
    if tipping_speed is None:
        return gentlest, hardest
    # A flat object slides before it tips; a tall one tips first.
    if height < TRIAL.thin * width:
        first_speed = min(
            tipping_speed, TRIAL.slides * _sliding_speed(trials, item.name)
        )
        return min(max(gentlest, first_speed), hardest), hardest
    return TRIAL.tips[0] * tipping_speed, max(TRIAL.tips[1] * tipping_speed, gentlest)


def _sliding_speed(trials: TrialScene, name: str) -> float:
    """Return the speed of a visible slide on the smoothest surface, px/s."""
    surfaces = dict(trials.world.surfaces)
    own_friction = surfaces.pop(name).friction
    lowest_friction = min(
        (surface.friction for surface in surfaces.values()), default=0.0
    )
    gravity = hypot(*trials.world.gravity)
    return sqrt(
        2 * own_friction * lowest_friction * gravity * TRIAL.travel * trials.side
    )


def _is_tall(body: Body) -> bool:
    """Check whether a body may fall over."""
    width, height = _extent(body)
    return body.radius is None and height >= TRIAL.tall * width


def _extent(body: Body) -> tuple[float, float]:
    """Return width and height of a body, px."""
    corners = np.concatenate(body.rings)
    width, height = np.ptp(corners, axis=0).tolist()
    return float(width), float(height)


def _tipping_speed(body: Body, gravity: float) -> float | None:
    """Return the tipping speed of a body over its lower corner, px/s.

    Its foot is stopped: angular momentum about the corner is conserved, and then
    energy. None for rolling bodies and in the top view.
    """
    if body.radius is not None or not gravity:
        return None
    corners = np.concatenate(body.rings)
    x0, x1 = float(corners[:, 0].min()), float(corners[:, 0].max())
    # Height of the centre of mass above the foot.
    height = float(corners[:, 1].max())
    rise = hypot((x1 - x0) / 2, height) - height
    inertia = body.moment / body.mass + (rise + height) ** 2
    return sqrt(2 * gravity * rise * inertia) / height


# Outcome of one push


def simulate_push(
    trials: TrialScene,
    velocities: Mapping[str, tuple[float, float]],
    world: World | None = None,
    ramp: float | None = None,
) -> Outcome:
    """Simulate pushes until all objects rest or one leaves the picture.

    `velocities` are those of objects by name, px/s. `world` is that of `trials` unless
    another one, at rest, is given. The objects reach their velocities within `ramp`, s;
    None: as in the scene.
    """
    world = _pushed_world(trials, velocities, world or trials.world, ramp)
    motion, has_left, work = _run(trials, world)
    travel = _travel(world, motion) / trials.side
    speed = max(hypot(*velocity) for velocity in velocities.values())
    if travel.max(initial=0.0) < TRIAL.least or _explodes(trials, motion, speed):
        farthest = float(travel.max(initial=0.0))
        return replace(NO_MOTION, travel=farthest, work=work)
    names = [body.name for body in world.bodies]
    moving_names = tuple(names[k] for k in np.flatnonzero(travel >= TRIAL.least))
    leaving_names = tuple(names[k] for k in np.flatnonzero(has_left))
    seconds = _moving_time(world, motion, TRIAL.unrest * trials.side)
    is_resting = seconds <= float(motion.times[-1]) - trials.unit
    slow_factor = playback_of(trials, seconds)
    # The share of a second of video that is filled by visible motion.
    visible_time = _moving_time(world, motion, TRIAL.visible * trials.side)
    film_share = min(visible_time * slow_factor / PLAYBACK.least_motion, 1.0)
    film_share = min(film_share, float(travel.max()) / TRIAL.travel)
    fallen_names = _find_fallen_objects(world, motion)
    score = float(np.minimum(travel / _full_travel(world, fallen_names), 1.0).sum())
    score += TRIAL.falls * len(fallen_names)
    # Penalties for implausible motion.
    if any(_returns(motion, *push) for push in velocities.items()):
        score *= TRIAL.rebound
    is_thrown = any(_is_thrown(trials, motion, *push) for push in velocities.items())
    if _overhangs(trials, world, motion):
        score *= TRIAL.overhang
        film_share = min(film_share, TRIAL.overhang)
    if _crowds_border(trials, world, motion):
        score *= TRIAL.crowded
    is_climbing = _climbs(trials, world, motion)
    if is_climbing or any(_tumbles(world, motion, name) for name in velocities):
        score *= TRIAL.tumbling
        film_share = min(film_share, TRIAL.tumbling)
    grade = Grade.STORY
    if leaving_names or is_thrown:
        grade = Grade.LEAVES
    elif is_climbing or not is_resting:
        grade = Grade.RESTLESS
    elif film_share < 1:
        grade = Grade.SHORT
        score *= film_share
    return Outcome(
        grade, score, float(travel.max()), seconds, moving_names, leaving_names, work
    )


def playback_of(trials: TrialScene, seconds: float) -> int:
    """Return the slow motion of a clip with a motion of these seconds."""
    default_slow = slow_motion(trials.side, trials.scene.world.pixels_per_meter)
    return story_slow_motion(default_slow, seconds)


def _pushed_world(
    trials: TrialScene,
    velocities: Mapping[str, tuple[float, float]],
    world: World,
    ramp: float | None,
) -> World:
    """Return a world with the velocities of some objects, and their ramp if given."""
    from physgen.compile.compile import set_velocity

    bodies = list(world.bodies)
    for index, item in enumerate(trials.scene.objects):
        if item.name in velocities:
            moving_item = replace(item, velocity=velocities[item.name])
            view = trials.scene.world.view
            body = set_velocity(bodies[index], moving_item, view)
            bodies[index] = body if ramp is None else replace(body, ramp=ramp)
    return replace(world, bodies=tuple(bodies))


def _run(
    trials: TrialScene, world: World
) -> tuple[Trajectory, NDArray[np.bool_], float]:
    """Simulate until all objects rest or one leaves the picture.

    Returns the motion, the mask (N,) of bodies that leave, and the work.
    """
    from physgen.simulate.engine import Running

    duration = min(TRIAL.units * trials.unit, TRIAL.longest)
    step = trials.unit / TRIAL.samples
    count = max(int(duration / step), 2)
    running = Running(world, np.linspace(0.0, duration, count + 1))
    limit = TRIAL.one * max(world.steps_per_second / TRIAL.rate, 1.0)
    rest_distance = TRIAL.unrest * trials.side / 4
    frame = _Frame.of(trials, world)
    has_left = np.zeros(len(world.bodies), bool)
    sample_count = 0
    # Check after each unit of time whether the motion has ended, which saves most of
    # the time of short motions.
    while sample_count < len(running.times):
        next_count = min(sample_count + TRIAL.samples, len(running.times))
        running.on(float(running.times[next_count - 1]))
        motion = running.trajectory()
        poses = motion.poses[sample_count:next_count]
        has_left = frame.leaving(poses)
        is_still = (
            sample_count > 0 and _sweep(world, poses).max(initial=0.0) < rest_distance
        )
        sample_count = next_count
        if has_left.any() or is_still or running.work > limit:
            break
    poses_so_far = motion.poses[:sample_count]
    return (
        replace(motion, times=motion.times[:sample_count], poses=poses_so_far),
        has_left,
        running.work,
    )


@dataclass(frozen=True)
class _Frame:
    """The picture's border, widened by the parts of objects outside at the start."""

    points: Sequence[Array]
    """Corners of the bodies in their own frames, (P, 2) px."""
    low: Array
    """Lower limits of each body, (N, 2) px."""
    high: Array
    """Upper limits of each body, (N, 2) px."""
    is_watched: NDArray[np.bool_]
    """Mask (N,) of movable bodies."""

    @staticmethod
    def of(trials: TrialScene, world: World) -> _Frame:
        """Return the border for a world at its start."""
        points = [_corners(body) for body in world.bodies]
        centers = [body.center for body in world.bodies]
        lower_corners = np.array(
            [
                corners.min(axis=0) + center
                for corners, center in zip(points, centers, strict=True)
            ]
        )
        upper_corners = np.array(
            [
                corners.max(axis=0) + center
                for corners, center in zip(points, centers, strict=True)
            ]
        )
        # An object that begins beyond the border may stay there, so that the border is
        # wider.
        slack = TRIAL.beside * trials.side
        movable = [body.motion is Motion.DYNAMIC for body in world.bodies]
        return _Frame(
            points,
            np.minimum(lower_corners.reshape(-1, 2), -0.5 - slack),
            np.maximum(
                upper_corners.reshape(-1, 2), np.array(world.size) - 0.5 + slack
            ),
            np.array(movable, bool),
        )

    def leaving(self, poses: Array) -> NDArray[np.bool_]:
        """Return the mask of bodies that are outside in one of the poses (S, N, 3)."""
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
    """Return the distance of the outline from its first pose, (S,) px.

    A disc that turns in place does not move; for a polygon the farthest corner counts.
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
    distances = [_shift(body, poses[:, k]).max() for k, body in enumerate(world.bodies)]
    return np.array(distances, np.float64)


def _moving_time(world: World, motion: Trajectory, least: float) -> float:
    """Return the time after which no body is `least` px from its last pose, s."""
    last_sample = 0
    for k, body in enumerate(world.bodies):
        distances = _shift(body, motion.poses[::-1, k])[::-1]
        moving_samples = np.flatnonzero(distances > least)
        last_sample = max(last_sample, int(moving_samples.max(initial=0)))
    return float(motion.times[last_sample])


def _find_fallen_objects(world: World, motion: Trajectory) -> list[str]:
    """Return the names of fallen tall objects."""
    names = []
    for k, body in enumerate(world.bodies):
        turn = abs(float(motion.poses[-1, k, 2] - motion.poses[0, k, 2]))
        if _is_tall(body) and turn >= radians(TRIAL.fallen):
            names.append(body.name)
    return names


def _tumbles(world: World, motion: Trajectory, name: str) -> bool:
    """Check whether a low object turns over: bowls, cars and bags slide instead."""
    index = motion.names.index(name)
    body = world.bodies[index]
    if body.radius is not None or _is_tall(body):
        return False
    turns = motion.poses[:, index, 2] - motion.poses[0, index, 2]
    return bool(np.abs(turns).max() > radians(TRIAL.tumble))


def _full_travel(world: World, fallen: Collection[str]) -> Array:
    """Return the displacement (N,) of the full score for each body, as a share."""
    is_free = [body.radius is not None or body.name in fallen for body in world.bodies]
    return np.where(np.array(is_free, bool), TRIAL.far, TRIAL.slide)


def _climbs(trials: TrialScene, world: World, motion: Trajectory) -> bool:
    """Check whether a moving body rises by much: objects stay on their supports."""
    if trials.scene.world.view is not View.SIDE:
        return False
    for k, body in enumerate(world.bodies):
        lowest_rows = _placed(_corners(body), motion.poses[:, k])[..., 1].max(axis=1)
        _, height = _extent(body)
        if lowest_rows[0] - lowest_rows.min() > TRIAL.rise * height:
            return True
    return False


def _overhangs(trials: TrialScene, world: World, motion: Trajectory) -> bool:
    """Check whether a moved body ends beyond the end of its support."""
    tolerance = TRIAL.edge * trials.side
    ends = [chain[k] for wall in world.walls for chain in wall.chains for k in (0, -1)]
    for k, body in enumerate(world.bodies):
        if np.hypot(*(motion.poses[-1, k, :2] - motion.poses[0, k, :2])) < tolerance:
            continue
        places = _placed(_corners(body), motion.poses[-1:, k])[0]
        foot, left, right = places[:, 1].max(), places[:, 0].min(), places[:, 0].max()
        # An end of a wall below the body, away from both of its sides, is an edge under
        # it.
        for x, y in ends:
            if abs(y - foot) < tolerance and left + tolerance < x < right - tolerance:
                return True
    return False


def _crowds_border(trials: TrialScene, world: World, motion: Trajectory) -> bool:
    """Check whether a body ends at the border, and closer to it than at the start."""
    smallest_gap = TRIAL.border * trials.side
    size = np.array(world.size, np.float64)
    for k, body in enumerate(world.bodies):
        if body.motion is not Motion.DYNAMIC:
            continue
        places = _placed(_corners(body), motion.poses[[0, -1], k])
        gaps = np.minimum(places, size - places).min(axis=(1, 2))
        # A body that begins at the border may stay there.
        if gaps[1] < min(smallest_gap, gaps[0] - 1):
            return True
    return False


def _explodes(trials: TrialScene, motion: Trajectory, speed: float) -> bool:
    """Check whether a body is faster than a push and a fall over the photo explain."""
    if len(motion.times) < 2:
        return False
    steps = np.diff(motion.poses[..., :2], axis=0)
    lengths = np.hypot(*np.moveaxis(steps, -1, 0))
    fastest = float(lengths.max(initial=0.0)) / float(motion.times[1])
    fall = sqrt(2 * hypot(*trials.world.gravity) * trials.side)
    return fastest > TRIAL.wild * (speed + fall)


def _returns(motion: Trajectory, name: str, velocity: Sequence[float]) -> bool:
    """Check whether an object goes back farther than it went forward."""
    index = motion.names.index(name)
    displacements = motion.poses[:, index, :2] - motion.poses[0, index, :2]
    distances = displacements @ np.array(velocity, np.float64)
    return bool(-distances.min() > distances.max())


def _is_thrown(
    trials: TrialScene, motion: Trajectory, name: str, velocity: Sequence[float]
) -> bool:
    """Check whether an object rebounds from an invisible wall."""
    if not any(velocity):
        return False
    index = motion.names.index(name)
    direction = np.array(velocity, np.float64)
    stopped_mass = _stopped_mass(motion, index, direction, trials.unseen)
    return stopped_mass > TRIAL.thrown * trials.world.bodies[index].mass


def _stopped_mass(
    motion: Trajectory, index: int, velocity: Array, unseen: Collection[str]
) -> float:
    """Return the mass, g, with the momentum that `unseen` walls take; friction takes
    none.
    """
    _, first, second = motion.contacts.impulse_rows.T
    is_wall = np.isin(motion.contacts.surfaces, list(unseen))
    # An object may have the name of a wall.
    is_wall[: len(motion.names)] = False
    impulses = motion.contacts.impulses[(first == index) & is_wall[second]]
    backward_parts = -impulses @ velocity
    side_parts = np.abs(cross(velocity, impulses))
    return float(
        (backward_parts * (backward_parts > side_parts)).sum() / (velocity @ velocity)
    )


# Rank of pushes before they are simulated


@dataclass(frozen=True)
class RankWeights:
    """Weights for the surroundings of an object; lengths are shares of the
    longer side.
    """

    room: float = 0.3
    """Free distance ahead with full weight."""
    beyond: float = 0.1
    """Weight of the room behind the last object ahead, for its fall."""
    ahead: float = 1.5
    """Weight of objects ahead, relative to a free path: they will be struck."""
    loaded: float = 0.5
    """Weight of an object jammed under others in the side view."""
    beside: float = 0.1
    """Smallest share of an object's width in the path to be ahead."""
    touch: float = 2.0
    """Gap between objects on each other, px."""


RANK = RankWeights()


def rank_pushes(
    trials: TrialScene, confidence: Mapping[str, float]
) -> list[tuple[Object, Direction]]:
    """Return objects with directions of pushes, the most promising first."""
    scene, bodies = trials.scene, trials.world.bodies
    corners = [np.concatenate(body.rings) + body.center for body in bodies]
    scored_pushes: list[tuple[float, int, Object, Direction]] = []
    for k, item in enumerate(scene.objects):
        object_confidence = confidence.get(item.name, 1.0)
        if item.motion is not Motion.DYNAMIC or object_confidence < TRIAL.confidence:
            continue
        if is_living(item.label):
            continue
        # Prefer objects without others on top, which would fall with them.
        weight = object_confidence * (
            RANK.loaded if _is_loaded(scene, corners, k) else 1.0
        )
        barred_side = SIDES.get(trials.barred.get(item.name, ""), 0.0)
        for direction in _directions(scene, bodies, k):
            if barred_side * direction[0] > 0:
                continue
            score = weight * _room_score(trials, corners, k, direction)
            scored_pushes.append((score, -len(scored_pushes), item, direction))
    scored_pushes.sort(key=lambda one: one[:2], reverse=True)
    return [(item, direction) for _, _, item, direction in scored_pushes]


def _is_loaded(scene: Scene, corners: Sequence[Array], k: int) -> bool:
    """Check whether another object lies on an object in the side view."""
    if scene.world.view is not View.SIDE:
        return False
    left, top = corners[k].min(axis=0)
    right = corners[k][:, 0].max()
    for n, points in enumerate(corners):
        (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
        # Boxes around outlines meet only roughly: allow a tenth of the upper object's
        # height.
        is_near = abs(y1 - top) < RANK.touch + 0.1 * (y1 - y0)
        if n != k and is_near and x0 < right and x1 > left:
            return True
    return False


def _directions(scene: Scene, bodies: Sequence[Body], k: int) -> list[Direction]:
    """Return the unit directions of possible pushes of an object.

    In the side view they are level; in the top view they point to the nearest object,
    to the centre of all objects, and to the centre of the photo.
    """
    if scene.world.view is View.SIDE:
        return [(1.0, 0.0), (-1.0, 0.0)]
    center = bodies[k].center
    others = [body.center for n, body in enumerate(bodies) if n != k]
    middle = (np.array(scene.size) - 1) / 2
    # From above, push towards the nearest object, the middle of all others and the
    # middle of the photo.
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
    """Return a score of the free path and the objects ahead of an object."""
    # In axes along and across the push, the picture's end and other objects are
    # intervals.
    frame = np.array([direction, (-direction[1], direction[0])])
    turned_corners = [points @ frame.T for points in corners]
    lower_corners = np.array([points.min(axis=0) for points in turned_corners])
    upper_corners = np.array([points.max(axis=0) for points in turned_corners])
    overlaps = np.minimum(upper_corners, upper_corners[k]) - np.maximum(
        lower_corners, lower_corners[k]
    )
    is_in_path = overlaps[:, 1] > RANK.beside * (upper_corners - lower_corners)[:, 1]
    is_ahead = is_in_path & (lower_corners[:, 0] > upper_corners[k, 0] - RANK.touch)
    objects_ahead = [n for n in np.flatnonzero(is_ahead).tolist() if n != k]
    picture_end = max(np.array([[0, 0], trials.scene.size]) @ frame[0])
    full_room = RANK.room * trials.side
    center = trials.world.bodies[k].center
    gaps = [
        picture_end - center @ frame[0],
        *(lower_corners[n, 0] - upper_corners[k, 0] for n in objects_ahead),
    ]
    free_share = float(np.clip(min(gaps) / full_room, 0, 1))
    last_edge = max(upper_corners[n, 0] for n in (k, *objects_ahead))
    room_beyond = float(np.clip((picture_end - last_edge) / full_room, 0, 1))
    return (
        free_share
        + RANK.beyond * room_beyond
        + RANK.ahead * (1 - 0.5 ** len(objects_ahead))
    )
