"""Choice of the push that perception writes: search by trial simulations.

A push should start a short story that stays in the picture: an object moves visibly,
like others of its kind, and at the end all moving objects are in the picture and at
rest. Lengths are shares of the photo's longer side, and the unit of time is that of a
fall over half of this side, so that small and large scenes are judged alike.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from math import hypot, inf, log, sqrt
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physgen import simulate
from physgen.compile.compile import compile_shapes, set_velocity
from physgen.geometry.scale import PLAYBACK
from physgen.pipeline.push_motion import (
    PictureBorder,
    climbs,
    crowds_border,
    explodes,
    find_fallen_objects,
    full_travel,
    is_tall_body,
    measure_extent,
    measure_moving_time,
    measure_sweep,
    measure_travel,
    measure_turn,
    overhangs,
    overturns,
    returns,
    rocks,
    throws,
    tumbles,
)
from physgen.pipeline.push_outcomes import (
    NO_MOTION,
    SIDES,
    TRIAL,
    Candidate,
    Direction,
    Grade,
    Outcome,
    TrialScene,
    playback_of,
    ramp_of,
)
from physgen.pipeline.push_ranks import loaded_names, rank_pushes
from physgen.pipeline.push_tips import Hand
from physgen.scene.scene import Motion, Object, Scene, View

if TYPE_CHECKING:
    from physgen.compile.shapes import Shapes
    from physgen.compile.world import Body, World
    from physgen.simulate.trajectory import Trajectory


def compile_trials(
    scene: Scene,
    shapes: Shapes,
    unseen: Collection[str] = (),
    barred_sides: Mapping[str, str] = MappingProxyType({}),
    ramp: float | None = None,
    round_ends: Collection[tuple[str, str]] = (),
) -> TrialScene:
    """Compile the common world of all trials of a scene. Raises InputError."""
    world = compile_shapes(scene, shapes).world
    ends = frozenset(round_ends)
    return TrialScene(scene, world, frozenset(unseen), barred_sides, ramp, ends)


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
    # A push without a visible motion is no candidate: with nothing left, the caller
    # keeps the scene at rest.
    candidates = [trial for trial in candidates if trial.outcome.grade > Grade.NOTHING]
    if not candidates:
        return None
    # An object under a load is pushed only if no other object makes a story. The score
    # then counts the confidence of the mask: a wrong mask tears the picture apart.
    candidates = list(_free_of_load(trials, candidates))
    candidates = [_weight_candidate(trial, confidence) for trial in candidates]
    sorted_candidates = sorted(candidates, key=_preference, reverse=True)
    verified_candidates: list[Candidate] = []
    # Verify in order of preference and stop at the first push that keeps its grade:
    # each verification simulates at the scene's own rate and costs several trials.
    for candidate in sorted_candidates[: TRIAL.verification_count]:
        if sum(trial.outcome.work for trial in verified_candidates) > TRIAL.work:
            break
        verified_candidate = _verify(trials, candidate, facing)
        verified_candidate = _weight_candidate(verified_candidate, confidence)
        verified_candidates.append(verified_candidate)
        if verified_candidate.outcome.grade >= candidate.outcome.grade:
            break
    # At the finer rate a push may move nothing any more. If this happens to all
    # verified pushes, the best unverified one is better than none.
    moving_candidates = []
    for trial in verified_candidates:
        if trial.outcome.grade > Grade.NOTHING:
            moving_candidates.append(trial)
    return max(moving_candidates, key=_preference, default=sorted_candidates[0])


def _verify(
    trials: TrialScene, candidate: Candidate, facing: Mapping[str, str]
) -> Candidate:
    """Try a push again, in the scene's own steps and as a hand gives it.

    The push is at once if the hand makes the outcome worse, unless the time of the push
    is given. The work of the outcome is that of both trials.
    """
    # A hand needs some frames to bring an object to its speed. The number of frames
    # depends on the slow motion, and the slow motion on the duration of the motion.
    world, given_ramp = trials.world, trials.ramp
    ramp = ramp_of(playback_of(trials, candidate.outcome.seconds))
    ramp = ramp if given_ramp is None else given_ramp
    ramped = _try(trials, replace(candidate, ramp=ramp), facing, world)
    is_as_good = ramped.outcome.grade >= candidate.outcome.grade
    if is_as_good or given_ramp is not None:
        return ramped
    # A slow push may not topple what a sudden one does.
    sudden = _try(trials, replace(candidate, ramp=0.0), facing, world)
    is_better = sudden.outcome.grade > ramped.outcome.grade
    if is_better:
        best = sudden
    else:
        best = ramped
    work = ramped.outcome.work + sudden.outcome.work
    return replace(best, outcome=replace(best.outcome, work=work))


def _free_of_load(
    trials: TrialScene, candidates: Sequence[Candidate]
) -> Sequence[Candidate]:
    """Return the pushes of objects without a load; all if none of those is a story."""
    load_names = loaded_names(trials)
    free = []
    for trial in candidates:
        if trial.item.name not in load_names:
            free.append(trial)
    has_story = any(trial.outcome.grade is Grade.STORY for trial in free)
    if has_story:
        return free
    return candidates


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
    # The search needs many trials: coarse steps tell grades apart, and the best
    # pushes are tried again in fine steps.
    world = replace(trials.world, steps_per_second=TRIAL.rate)
    candidates = list(_search(trials, item, direction, facing, world))
    moving_candidates = []
    for candidate in candidates:
        if candidate.outcome.grade > Grade.NOTHING:
            moving_candidates.append(candidate)
    best = max(moving_candidates, key=_preference, default=None)
    if best is None:
        return None
    return best.speed


def _preference(candidate: Candidate) -> tuple[float, ...]:
    """Return the sort key of pushes, the best last.

    If objects leave the picture, the gentlest push is the best.
    """
    # Every push of this grade spoils the clip. The gentlest one loses the fewest
    # objects, whatever its score.
    outcome = candidate.outcome
    gentleness = -candidate.speed
    if outcome.grade is Grade.LEAVES:
        return (outcome.grade, gentleness, outcome.score)
    # Compare scores on a logarithmic scale with steps of 1 / `score_share`: within one
    # step the scores count as equal, and the gentlest push wins. Gentle pushes uncover
    # less of the filled background. The lower bound of the score keeps the logarithm
    # finite.
    level = int(log(max(outcome.score, 1e-3), 1 / TRIAL.score_share))
    return (outcome.grade, level, gentleness)


def _candidates(
    trials: TrialScene, confidence: Mapping[str, float], facing: Mapping[str, str]
) -> Iterator[Candidate]:
    """Yield pushes and their outcomes in coarse steps, within the limit of work."""
    world = replace(trials.world, steps_per_second=TRIAL.rate)
    # A search yields the same speed again if it halves an interval to it.
    known_pushes: set[tuple[str, Direction, float]] = set()
    sorted_pushes = rank_pushes(trials, confidence)[: TRIAL.pairs_without_story]
    highest_score = _highest_score(trials)
    search = _search
    # Among others, an object should touch them: only a lone object rocks.
    lone_body = _lone_body(world)
    if lone_body is not None:
        search = _pushes_of_pair
        # A slide to one side is no reason not to try the other side.
        if not is_tall_body(lone_body) and any(
            _hand(trials, item, direction[0], facing).can_sway
            for item, direction in sorted_pushes
        ):
            highest_score += TRIAL.rocking
    highest_score *= max(
        (confidence.get(item.name, 1.0) for item, _ in sorted_pushes), default=1.0
    )
    effort = _SearchEffort(highest_score, loaded_names(trials))
    # Rank first, simulate later: the limits below end the search after a good story, so
    # that the most promising objects and directions must come first.
    for pair in sorted_pushes:
        if effort.ends_before_pair():
            return
        for candidate in search(trials, *pair, facing, world):
            push = (candidate.item.name, candidate.direction, candidate.speed)
            if push in known_pushes:
                continue
            known_pushes.add(push)
            yield candidate
            if effort.ends_after(_weight_candidate(candidate, confidence), candidate):
                return


def _lone_body(world: World) -> Body | None:
    """Return the body that alone can move, if there is one."""
    bodies = []
    for body in world.bodies:
        if body.motion is Motion.DYNAMIC:
            bodies.append(body)
    if len(bodies) != 1:
        return None
    return bodies[0]


@dataclass
class _SearchEffort:
    """Work of a search and its best story, which decide when the search ends.

    Every limit is larger while no push has led to a visible motion or a story.
    """

    highest: float
    """Score that no story exceeds."""
    load_names: Collection[str]
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
        self.has_story |= outcome.has_calm_end and outcome.score > TRIAL.poor
        self.is_visible |= outcome.has_calm_end and outcome.travel >= TRIAL.travel
        # The count of `patience` begins only with a story of an object without a load,
        # since pulling an object out of a stack is rarely the motion that a user
        # expects.
        is_story = outcome.grade is Grade.STORY
        is_free = candidate.item.name not in self.load_names
        if is_story and is_free and score > TRIAL.worth * self.best:
            self.best, self.best_pair = score, self.pairs
        if is_story and score >= TRIAL.score_share * self.highest:
            return True
        if self.has_story:
            # Without a story so far, the search may go on for longer.
            most_trials = TRIAL.trial_count
        else:
            most_trials = 2 * TRIAL.trial_count
        if self.is_visible:
            most_work = TRIAL.work
        else:
            most_work = TRIAL.more_work
        return self.work > most_work or self.trials >= most_trials


def _highest_score(trials: TrialScene) -> float:
    """Return the score if all objects move far, and all tall objects fall."""
    # Each path contributes at most 1 to the score, and each fall `TRIAL.falls`; see
    # `_score_run`.
    total = 0.0
    for body in trials.world.bodies:
        if body.motion is Motion.DYNAMIC:
            total += 1 + (TRIAL.falls if is_tall_body(body) else 0)
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

    def try_speed(speed: float) -> Candidate:
        # Two digits are enough for a scene file, and they let two ways to nearly the
        # same speed share one simulation.
        rounded_speed = float(f"{speed:.2g}")
        if rounded_speed not in known:
            start = Candidate(item, direction, rounded_speed, NO_MOTION)
            known[rounded_speed] = _try(trials, start, facing, world)
        return known[rounded_speed]

    # The displacement grows with the speed until an object leaves the picture. Raise
    # the speed in steps while all objects stay; after the first departure, bisect
    # between the fastest calm push and the slowest leaving one.
    speeds = _speed_limits(trials, item)
    speed, hardest = speeds
    calm_speed, leaving_speed = 0.0, inf
    best_score, halvings = 0.0, 0
    previous = NO_MOTION
    while speed <= hardest and halvings <= TRIAL.halvings:
        candidate = try_speed(speed)
        outcome = candidate.outcome
        # Between a push that moves hardly anything and one that moves too much, the
        # geometric mean may be the best: displacements grow with the square of the
        # speed, so that ratios of speeds count rather than differences.
        if calm_speed and _is_too_hard_push(outcome, previous):
            yield try_speed(sqrt(calm_speed * speed))
        yield candidate
        # A harder push without a better story ends the search. A gentler one between
        # the last two may tell the same story with less uncovered background.
        if outcome.grade is Grade.STORY and outcome.score <= TRIAL.worth * best_score:
            if calm_speed and outcome.travel > TRIAL.slide:
                yield try_speed(sqrt(calm_speed * speed))
            return
        if outcome.grade is Grade.LEAVES:
            leaving_speed = speed
        else:
            calm_speed = speed
            previous = outcome
        # Scores of pushes out of the picture count paths that nobody sees.
        if outcome.grade is not Grade.LEAVES:
            best_score = max(best_score, outcome.score)
        # The speed that just keeps all objects in the picture is between two known
        # speeds: take their geometric mean.
        if leaving_speed < inf:
            halvings += 1
            # Without a calm push yet there is no lower bound for a mean: halve the
            # speed instead.
            if calm_speed:
                speed = sqrt(calm_speed * leaving_speed)
            else:
                speed = leaving_speed / 2
        else:
            speed = calm_speed * _next_step(trials, outcome)


def _pushes_of_pair(
    trials: TrialScene,
    item: Object,
    direction: Direction,
    facing: Mapping[str, str],
    world: World,
) -> Iterator[Candidate]:
    """Yield all pushes of an object in a direction.

    Pushes through the centre come first for a tall object, which they may topple.
    """
    body = next(body for body in trials.world.bodies if body.name == item.name)

    def attempt(candidate: Candidate) -> Candidate:
        return _try(trials, candidate, facing, world)

    # A tall object may fall after a push through its centre, which is a better story
    # than rocking. A low object can only slide then, and is tipped first.
    slides = _search(trials, item, direction, facing, world)
    hand = _hand(trials, item, direction[0], facing)
    tips = chain(hand.tips(attempt), hand.sways(attempt))
    yield from chain(slides, tips) if is_tall_body(body) else chain(tips, slides)


def _hand(
    trials: TrialScene, item: Object, side: float, facing: Mapping[str, str]
) -> Hand:
    """Return the hand that pushes an object at its top."""
    return Hand(trials, item, side, item.name in facing)


def _is_too_hard_push(outcome: Outcome, gentler: Outcome) -> bool:
    """Check whether a push between two may be better than the harder one.

    Objects that move too far uncover much background; rocking objects may need less.
    """
    # The harder push makes a story but a long one, after a gentler push without any: a
    # push in between may make a shorter story.
    if outcome.grade is Grade.STORY:
        return gentler.grade is not Grade.STORY and outcome.travel > TRIAL.full_travel
    # The harder push never comes to rest, and the gentler one is hardly visible: a push
    # in between may be visible and end calmly.
    is_short = gentler.grade is Grade.SHORT and gentler.travel < TRIAL.travel
    return is_short and outcome.grade is Grade.RESTLESS


def _next_step(trials: TrialScene, outcome: Outcome) -> float:
    """Return the factor to the next speed: displacement grows with the speed
    squared.
    """
    # On a table rolling objects have hardly any friction, and the law of sliding below
    # does not hold for them.
    if trials.scene.world.view is View.TOP and outcome.grade is Grade.STORY:
        return TRIAL.doubling
    # Friction of deceleration mu g stops a slide after v² / (2 mu g): a displacement
    # that is n times as long takes sqrt(n) times the speed. The goal is 1.6 times the
    # displacement of a full score, so that the next push clearly reaches it. Bounds
    # limit the step, since other objects may change this law at any speed.
    wanted_factor = sqrt(1.6 * TRIAL.slide / max(outcome.travel, 1e-6))
    return min(max(wanted_factor, TRIAL.steps[0]), TRIAL.steps[1])


def _try(
    trials: TrialScene, candidate: Candidate, facing: Mapping[str, str], world: World
) -> Candidate:
    """Simulate a push in a world at rest."""
    item = candidate.item
    velocities = {item.name: candidate.velocity}
    spins = {item.name: candidate.spin}
    outcome = simulate_push(trials, velocities, world, candidate.ramp, spins)
    # A vehicle that drives backwards looks wrong, even if its motion is a good story
    # otherwise.
    forwards = SIDES.get(facing.get(item.name, ""), 0.0)
    if forwards * candidate.direction[0] < 0:
        outcome = replace(outcome, score=TRIAL.wrong_way * outcome.score)
    return replace(candidate, outcome=outcome)


def _speed_limits(trials: TrialScene, item: Object) -> tuple[float, float]:
    """Return the gentlest and the hardest speed of an object, px/s.

    A thin object is tipped as by a finger: it falls and need not slide.
    """
    ordinary = trials.ordinary
    gentlest = TRIAL.gentlest * ordinary
    hardest = TRIAL.hardest * ordinary
    body = next(body for body in trials.world.bodies if body.name == item.name)
    tipping_speed = _tipping_speed(body, hypot(*trials.world.gravity))
    # Without a tipping speed, as for a ball or in the top view, only the ordinary speed
    # of the scene sets the range.
    width, height = measure_extent(body)
    if tipping_speed is None:
        return gentlest, hardest
    # A flat object slides before it tips; a tall one tips first.
    if height < TRIAL.tipping_ratio * width:
        first_speed = min(
            tipping_speed, TRIAL.slides * _sliding_speed(trials, item.name)
        )
        return min(max(gentlest, first_speed), hardest), hardest
    # A bottle or a pole falls from a touch: its range begins just above the tipping
    # speed, since every slower push lets it swing back.
    return TRIAL.tips[0] * tipping_speed, max(TRIAL.tips[1] * tipping_speed, gentlest)


def _sliding_speed(trials: TrialScene, name: str) -> float:
    """Return the speed of a visible slide on the smoothest surface, px/s."""
    surfaces = dict(trials.world.surfaces)
    # The engine multiplies the coefficients of both surfaces. Nobody knows yet which
    # surface the object slides on: the smoothest one gives the lowest speed, at which
    # the search may begin.
    own_friction = surfaces.pop(name).friction
    lowest_friction = min(
        (surface.friction for surface in surfaces.values()), default=0.0
    )
    gravity = hypot(*trials.world.gravity)
    # Work of friction: v² / 2 = mu g s, solved for the speed with the path s =
    # `TRIAL.travel` of the photo's longer side.
    return sqrt(
        2 * own_friction * lowest_friction * gravity * TRIAL.travel * trials.side
    )


def _tipping_speed(body: Body, gravity: float) -> float | None:
    """Return the tipping speed of a body over its lower corner, px/s.

    Its foot is stopped: angular momentum about the corner is conserved, and then
    energy. None for rolling bodies and in the top view.
    """
    if body.radius is not None or not gravity:
        return None
    # The corner that is stopped lies at the height of the foot, half a width to the
    # side of the centre of mass. To tip over, the centre must rise from `height` to its
    # distance from the corner, which is `rise` higher.
    corners = np.concatenate(body.rings)
    x0 = float(corners[:, 0].min())
    x1 = float(corners[:, 0].max())
    # Height of the centre of mass above the foot.
    height = float(corners[:, 1].max())
    rise = hypot((x1 - x0) / 2, height) - height
    # Moment of inertia about the corner by the mass (parallel axes): `moment / mass` +
    # distance².
    inertia = body.moment / body.mass + (rise + height) ** 2
    # Angular momentum about the corner just before and after the stop: v * height =
    # inertia * spin. Energy at the highest point: inertia * spin² / 2 = gravity * rise.
    # Without the spin, v = sqrt(2 * gravity * rise * inertia) / height.
    return sqrt(2 * gravity * rise * inertia) / height


# Outcome of one push


@dataclass(frozen=True)
class _TrialRun:
    """The simulated motion of one trial."""

    trials: TrialScene
    world: World
    motion: Trajectory
    travel: NDArray[np.float64]
    """Displacements (N,) of the bodies, by the photo's longer side."""
    has_left: NDArray[np.bool_]
    """Bodies (N,) that leave the picture."""

    @cached_property
    def seconds(self) -> float:
        """Return the time until all objects rest, s."""
        least_distance = TRIAL.unrest * self.trials.side
        return measure_moving_time(self.world, self.motion, least_distance)

    def find_names(self, mask: NDArray[np.bool_]) -> tuple[str, ...]:
        """Return the names of the bodies of a mask (N,)."""
        return tuple(self.world.bodies[k].name for k in np.flatnonzero(mask))


@dataclass(frozen=True)
class _Faults:
    """Implausible parts of a motion."""

    has_rebound: bool
    """Whether a pushed object returns from an obstacle."""
    has_throwback: bool
    """Whether an invisible wall throws an object back."""
    has_overhang: bool
    """Whether an object ends half beyond a visible edge."""
    ends_at_border: bool
    """Whether an object ends at the picture's border."""
    is_climbing: bool
    is_tumbling: bool
    """Whether a low object climbs or tumbles instead of sliding."""


def simulate_push(
    trials: TrialScene,
    velocities: Mapping[str, tuple[float, float]],
    world: World | None = None,
    ramp: float | None = None,
    spins: Mapping[str, float] = MappingProxyType({}),
) -> Outcome:
    """Simulate pushes until all objects rest or one leaves the picture.

    `velocities` are those of objects by name, px/s. `world` is that of `trials` unless
    another one, at rest, is given. The objects reach their velocities within `ramp`, s;
    None: as in the scene. `spins` are angular velocities by name, degrees/s; others are
    as in the scene.
    """
    world = _pushed_world(trials, velocities, world or trials.world, ramp, spins)
    motion, has_left, work = _run(trials, world)
    # All lengths are shares of the photo's longer side from here on, so that one set of
    # limits suits every size of photo.
    travel = measure_travel(world, motion) / trials.side
    # A push without a visible motion needs no grades.
    farthest = float(travel.max(initial=0.0))
    speed = max(hypot(*velocity) for velocity in velocities.values())
    is_absurd = explodes(trials, motion, speed) or overturns(trials, motion)
    if farthest < TRIAL.least_travel or is_absurd:
        return replace(NO_MOTION, travel=farthest, work=work)
    # A grade orders outcomes of different kinds; a score orders outcomes of the same
    # grade.
    run = _TrialRun(trials, world, motion, travel, has_left)
    faults = _find_faults(run, velocities)
    film_share = _film_share(run, faults)
    grade = _grade_run(run, faults, film_share)
    score = _score_run(run, faults, is_spun=any(spins.values()))
    # Among motions that are too short, the one that fills more of a second is better.
    if grade is Grade.SHORT:
        score *= film_share
    return Outcome(
        grade,
        score,
        farthest,
        run.seconds,
        run.find_names(travel >= TRIAL.least_travel),
        run.find_names(has_left),
        work,
        measure_turn(motion, velocities),
    )


def _find_faults(
    run: _TrialRun, velocities: Mapping[str, tuple[float, float]]
) -> _Faults:
    """Return the implausible parts of the motion after pushes by name, px/s."""
    trials = run.trials
    world = run.world
    motion = run.motion
    # A climbing object counts as tumbling, too: both faults end in the same penalty.
    is_climbing = climbs(trials, world, motion)
    return _Faults(
        has_rebound=any(returns(motion, *push) for push in velocities.items()),
        has_throwback=any(throws(trials, motion, *push) for push in velocities.items()),
        has_overhang=overhangs(trials, world, motion),
        ends_at_border=crowds_border(trials, world, motion),
        is_climbing=is_climbing,
        is_tumbling=is_climbing
        or any(tumbles(world, motion, name) for name in velocities),
    )


def _film_share(run: _TrialRun, faults: _Faults) -> float:
    """Return the share 0..1 of a second of video that is filled by visible motion."""
    trials, motion = run.trials, run.motion
    # Count only the time with a motion that the eye can see. Slow motion stretches this
    # time in the video.
    least_distance = TRIAL.visible * trials.side
    visible_time = measure_moving_time(run.world, motion, least_distance)
    slow_factor = playback_of(trials, run.seconds)
    film_share = min(visible_time * slow_factor / PLAYBACK.least_motion, 1.0)
    # A long motion over a few pixels is no story either: the path must reach
    # `TRIAL.travel`.
    film_share = min(film_share, float(run.travel.max()) / TRIAL.travel)
    # Implausible ends lower the share as well, so that such a motion is never graded as
    # a story.
    if faults.has_overhang:
        film_share = min(film_share, TRIAL.overhang)
    if faults.is_tumbling:
        film_share = min(film_share, TRIAL.tumbling)
    return film_share


def _grade_run(run: _TrialRun, faults: _Faults, film_share: float) -> Grade:
    """Return the grade of a motion that fills a share of a second of video."""
    if run.has_left.any() or faults.has_throwback:
        return Grade.LEAVES
    # At rest means that nothing has moved for at least one unit of time before the
    # trial's end.
    is_resting = run.seconds <= float(run.motion.times[-1]) - run.trials.unit
    if faults.is_climbing or not is_resting:
        return Grade.RESTLESS
    if film_share < 1:
        return Grade.SHORT
    return Grade.STORY


def _score_run(run: _TrialRun, faults: _Faults, is_spun: bool) -> float:
    """Return the score of a motion: its paths and falls, times the faults' factors."""
    world = run.world
    motion = run.motion
    travel = run.travel
    fallen_names = find_fallen_objects(world, motion)
    # Each object adds its path, up to the full score of its kind: one object far away
    # counts no more than two at half the distance, and a longer path than the full one
    # adds nothing.
    score = float(np.minimum(travel / full_travel(world, fallen_names), 1.0).sum())
    score += TRIAL.falls * len(fallen_names)
    if is_spun and rocks(world, motion):
        # A small slide with a rotation tells as much as a long slide.
        score = max(score, min(float(travel.max()) / TRIAL.travel, 1.0))
        score += TRIAL.rocking
    # Penalties for implausible motion.
    if faults.has_rebound:
        score *= TRIAL.rebound
    if faults.has_overhang:
        score *= TRIAL.overhang
    if faults.ends_at_border:
        score *= TRIAL.crowding
    if faults.is_tumbling:
        score *= TRIAL.tumbling
    return score


def _pushed_world(
    trials: TrialScene,
    velocities: Mapping[str, tuple[float, float]],
    world: World,
    ramp: float | None,
    spins: Mapping[str, float],
) -> World:
    """Return a world with the motion of some objects, and their ramp if given."""
    bodies = list(world.bodies)
    # Only the pushed bodies are compiled again: the shapes of the others and their
    # contacts at rest are the same for all trials.
    for index, item in enumerate(trials.scene.objects):
        if item.name in velocities:
            spin = spins.get(item.name, item.spin)
            moving_item = replace(item, velocity=velocities[item.name], spin=spin)
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
    # The unit of time scales with the photo, so that small scenes are simulated for a
    # shorter time than large ones.
    duration = min(TRIAL.units * trials.unit, TRIAL.longest)
    step = trials.unit / TRIAL.samples
    count = max(int(duration / step), 2)
    running = simulate.engine.Running(world, np.linspace(0.0, duration, count + 1))
    # Work counts steps of the engine: at a higher rate the same motion has more of
    # them.
    limit = TRIAL.trial_work * max(world.steps_per_second / TRIAL.rate, 1.0)
    # A rocking object meets the ground again at each return, and each of these impacts
    # costs extra steps.
    if any(body.spin for body in world.bodies):
        limit *= TRIAL.rocking_work
    # Distances here are from the first pose of the unit of time, and those of
    # `_TrialRun.seconds` from the last pose. With a quarter of that distance, two poses
    # of the unit differ by at most a half: the unit counts as rest there too.
    rest_distance = TRIAL.unrest * trials.side / 4
    frame = PictureBorder.from_trials(trials, world)
    has_left = np.zeros(len(world.bodies), bool)
    sample_count = 0
    # Check after each unit of time whether the motion has ended, which saves most of
    # the time of short motions.
    while sample_count < len(running.times):
        next_count = min(sample_count + TRIAL.samples, len(running.times))
        running.advance(float(running.times[next_count - 1]))
        motion = running.trajectory()
        poses = motion.poses[sample_count:next_count]
        has_left = frame.leaving(poses)
        # The first unit never counts as rest: a push with a ramp only begins there.
        is_still = (
            sample_count > 0
            and measure_sweep(world, poses).max(initial=0.0) < rest_distance
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
