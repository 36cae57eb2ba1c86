"""Trial scenes of pushes, their limits, and the outcomes of trials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physgen.geometry.scale import PLAYBACK, push_speed, slow_motion, story_slow_motion
from physgen.scene.scene import Object, Scene

if TYPE_CHECKING:
    from physgen.compile.world import World

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
    pairs_without_story: int = 16
    """The same while no push makes a story, as in a heap of objects that block each
    other.
    """
    trial_count: int = 28
    """Number of trials; twice as many while no push makes a story."""
    poor: float = 0.4
    """Score below which a push is no story, whatever its grade."""
    work: float = 2500.0
    """Work of all trials together, in steps of the engine: about half a second."""
    more_work: float = 7500.0
    """The same while no calm push moves an object by `travel`."""
    trial_work: float = 1500.0
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
    verification_count: int = 3
    """Maximum number of pushes that are tried again."""
    tips: tuple[float, float] = (1.25, 2.0)
    """Range of speeds for a thin object, relative to its tipping speed."""
    tipping_ratio: float = 3.0
    """Height over width above which an object is tipped as by a finger."""
    fall_ratio: float = 1.4
    """Height over width above which a fall of an object is worth more."""
    fall_angle: float = 50.0
    """Rotation above which an object has fallen over, degrees."""
    travel: float = 0.05
    """Minimum displacement of a story."""
    least_travel: float = 0.03
    """Minimum visible displacement: in a heap, no object moves farther."""
    full_travel: float = 0.15
    """Displacement of the full score: a hand's breadth in a photo of 0.5 m."""
    slide: float = 0.08
    """The same for a sliding object, which uncovers filled background."""
    border_margin: float = 0.005
    """Margin beyond the border that still counts as inside the picture."""
    unrest: float = 0.004
    """Displacement in the last unit of time that still counts as rest."""
    visible: float = 0.0015
    """Distance from the last place above which an object still moves: 2 px of 1280."""
    rocks: tuple[float, ...] = (10.0, 6.0, 14.0)
    """Rotations by which an object is tipped over its lower corner, degrees: the second
    if the first is too hard, the third if the first is hardly visible.
    """
    rocks_most: float = 0.5
    """Largest such rotation, relative to that at which the object falls over."""
    rocks_visible: float = 2.0
    """Rotation from which an object rocks; it returns to half of it, degrees."""
    rocking: float = 0.3
    """Score of an object that rocks and settles, relative to one with a long path: a
    slide in one piece looks dull, and uncovers more background.
    """
    rocking_work: float = 2.5
    """Work of a trial of a rocking object, relative to `trial_work`: each return to the ground
    is an impact.
    """
    hand_ratio: float = 0.75
    """Height over width below which no hand tips an object."""
    foot: float = 0.04
    """Height of the foot of an object, by its height."""
    filling: float = 0.8
    """Extent of an object, by the picture's, above which no hand tips it."""
    round_foot: float = 0.05
    """Height of the outline above the ground at the end of its support, by the height
    of the object, above which the visible foot is round: such an object would float if
    it tipped over that end.
    """
    falls: float = 0.5
    """Score of each fallen object, relative to an object with a long path."""
    worth: float = 1.1
    """Gain of the score above which a harder push or another object is preferred."""
    score_share: float = 0.85
    """Share of the best score above which a gentler push is preferred."""
    wrong_way: float = 0.3
    """Factor of the score for a vehicle driving backwards."""
    rebound: float = 0.25
    """Factor for the return of an object from an obstacle."""
    border: float = 0.02
    """Gap to the picture's border below which an object ends crowded."""
    crowding: float = 0.8
    """Factor for a push after which an object ends crowded, without such a start."""
    overhang: float = 0.2
    """Factor for a push after which an object stands half beyond a visible edge."""
    tumble: float = 35.0
    """Rotation above which a low object tumbles instead of sliding, degrees."""
    overturned: float = 15.0
    """Rotation above which a vehicle turns over, degrees."""
    tumbling: float = 0.3
    """Factor for a push by which a low object tumbles."""
    rise: float = 0.25
    """Smallest climb over an obstacle or throw upwards, by an object's height."""
    edge: float = 0.02
    """Tolerance of the position on an edge."""
    momentum_share: float = 0.25
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
    mover_names: tuple[str, ...]
    """Names of the visibly moving objects."""
    left: tuple[str, ...]
    """Names of the objects outside the picture at the end."""
    work: float = 0.0
    """Work of the trial, in steps of the engine."""
    turn: float = 0.0
    """Largest rotation of a pushed object, degrees."""

    @property
    def is_inside(self) -> bool:
        """Check whether an object moves and none leaves the picture."""
        return self.grade > Grade.LEAVES

    @property
    def has_calm_end(self) -> bool:
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
    spin: float = 0.0
    """Angular velocity of an object that is tipped, degrees/s."""

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
    barred_sides: Mapping[str, str] = field(default_factory=dict)
    """Sides, `left` or `right`, to which an object is not pushed, by the
    object's name.
    """
    ramp: float | None = None
    """Given time of a push, s; None: that of some frames, or at once."""
    round_ends: frozenset[tuple[str, str]] = frozenset()
    """Names of objects with a round foot, and the side, `left` or `right`, over which
    no hand tips them.
    """

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


def playback_of(trials: TrialScene, seconds: float) -> int:
    """Return the slow motion of a clip with a motion of these seconds."""
    default_slow = slow_motion(trials.side, trials.scene.world.pixels_per_meter)
    return story_slow_motion(default_slow, seconds)


def ramp_of(slow: int) -> float:
    """Return the time, s, of a push in a clip with this slow motion."""
    return float(f"{TRIAL.ramp_frames / (TRIAL.fps * slow):.2g}")
