"""Pushes above the centre of mass, by which an object rocks on its foot and settles."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import degrees, hypot, radians, sqrt
from typing import TYPE_CHECKING

from physgen.pipeline.push_motion import measure_extent, measure_foot, tipping_motion
from physgen.pipeline.push_outcomes import (
    NO_MOTION,
    TRIAL,
    Candidate,
    Grade,
    Outcome,
    TrialScene,
    playback_of,
    ramp_of,
)
from physgen.pipeline.push_ranks import loaded_names
from physgen.scene.scene import Object, View

if TYPE_CHECKING:
    from physgen.compile.world import Body

Attempt = Callable[[Candidate], Candidate]
"""Simulate a push; return it with its outcome."""


@dataclass(frozen=True)
class SwayLimits:
    """Limits of small rotations; lengths are shares of the photo's longer side."""

    turn: float = 4.0
    """Wanted rotation, degrees: visible, without showing the hidden foot."""
    round_turn: float = 2.5
    """The same of an object with a round foot, which seems to float, degrees."""
    range: tuple[float, float] = (0.6, 1.35)
    """Rotations that are taken, relative to the wanted one."""
    lift: float = 0.04
    """Largest lift of an end of the foot: that of a wide object shows much ground."""
    tip_lift: float = 0.06
    """Largest lift of a side of an object that tips and returns. A point has to move by
    0.05 (`TRIAL.travel`), and more only opens the gap below the object.
    """
    units: float = 2.0
    """Expected time of the motion, units of time."""
    trials: int = 5
    """Number of trials to reach the rotation."""
    least_turn: float = 0.2
    """Smallest measured rotation, relative to the wanted one."""
    largest_factor: float = 3.0
    """Largest factor of the push from one trial to the next."""
    speed_factor: float = 1.15
    """Factor of the slide's speed if the motion is short."""
    turn_factor: float = 0.75
    """Factor of the rotation of an object that leaves the picture where it stands."""
    path: float = 0.06
    """Path of the top of the object, by the slide and by the rotation. A longer
    slide uncovers more background: of six clips, blind raters preferred those whose
    object nearly returned.
    """
    slide_paths: tuple[float, float] = (0.01, 0.06)
    """Smallest and largest path of the slide."""
    least_torque: float = 0.25
    """Smallest share of the weight's torque that friction leaves during the slide."""
    oblique: float = 30.0
    """Angle of the camera, degrees, from which no object with a round foot rocks."""
    flat_ratio: float = 0.3
    """Height over width below which a rotation is not visible."""


SWAY = SwayLimits()


@dataclass(frozen=True)
class Hand:
    """A hand that pushes an object at its top to a side."""

    trials: TrialScene
    item: Object
    side: float
    """1 right, or -1 left."""
    is_vehicle: bool

    @cached_property
    def body(self) -> Body:
        """Return the body of the object at rest."""
        bodies = self.trials.world.bodies
        return next(body for body in bodies if body.name == self.item.name)

    @property
    def ramp(self) -> float:
        """Return the time of the push in a clip of a rocking object, s."""
        if self.trials.ramp is not None:
            return self.trials.ramp
        return ramp_of(playback_of(self.trials, SWAY.units * self.trials.unit))

    @property
    def gravity(self) -> float:
        """Return the gravity, px/s²."""
        return hypot(*self.trials.world.gravity)

    @property
    def is_free(self) -> bool:
        """Check whether the object stands on a foot that can leave the ground."""
        if self.trials.scene.world.view is not View.SIDE:
            return False
        is_driving = self.item.wheels or self.item.facing or self.is_vehicle
        has_load = self.item.name in loaded_names(self.trials)
        return self.body.radius is None and not (is_driving or has_load)

    @property
    def has_round_foot(self) -> bool:
        """Check whether the object stands on a hidden base."""
        return any(name == self.item.name for name, _ in self.trials.round_ends)

    @property
    def is_filling(self) -> bool:
        """Check whether the object fills the picture."""
        return max(measure_extent(self.body)) > TRIAL.filling * self.trials.side

    @property
    def can_rock(self) -> bool:
        """Check whether a hand tips the object far: wide and flat ones glide."""
        if self.side > 0:
            end = "right"
        else:
            end = "left"
        if not self.is_free or (self.item.name, end) in self.trials.round_ends:
            return False
        width, height = measure_extent(self.body)
        return not self.is_filling and height >= TRIAL.hand_ratio * width

    @property
    def can_sway(self) -> bool:
        """Check whether a small rotation of the object is visible."""
        width, height = measure_extent(self.body)
        # At an angle, a round foot lies far above the front of its hidden base.
        is_oblique = self.trials.scene.world.tilt >= SWAY.oblique
        seems_to_float = is_oblique and self.has_round_foot
        is_flat = height < SWAY.flat_ratio * width
        return self.is_free and not (seems_to_float or is_flat)

    def tips(self, attempt: Attempt) -> Iterator[Candidate]:
        """Yield pushes at the top of the object, by which it rocks without a slide."""
        if not self.can_rock:
            return
        width, _ = measure_extent(self.body)
        largest_angle = degrees(SWAY.tip_lift * self.trials.side / width)
        angles = [min(angle, largest_angle) for angle in TRIAL.rocks]
        first_angle, smaller_angle, larger_angle = angles
        candidate = attempt(self._push(first_angle, 0.0, self.ramp))
        yield candidate
        outcome = candidate.outcome
        is_hard = outcome.grade in (Grade.LEAVES, Grade.RESTLESS)
        if is_hard or outcome.travel > TRIAL.full_travel:
            yield attempt(self._push(smaller_angle, 0.0, self.ramp))
        elif outcome.travel < TRIAL.slide and larger_angle > first_angle:
            yield attempt(self._push(larger_angle, 0.0, self.ramp))

    def sways(self, attempt: Attempt) -> Iterator[Candidate]:
        """Yield pushes above the centre, by which the object slides and rocks a little.

        Friction at the foot adds to the rotation during the slide: repeat the push
        until the rotation is small, and visible.
        """
        # An object with one round end tips only to its other side: leave it to the push
        # from there.
        rocks_to_other_side = replace(self, side=-self.side).can_rock
        if not self.can_sway or (rocks_to_other_side and not self.can_rock):
            return
        wanted_turn = self._wanted_turn()
        speed, angle = self._sway_start(wanted_turn)
        ramp = self.ramp
        for _ in range(SWAY.trials):
            candidate = attempt(self._push(angle, speed, ramp))
            outcome = candidate.outcome
            if outcome.grade is Grade.NOTHING or outcome.turn > TRIAL.tumble:
                return
            # The rotation grows with the push: correct the push by the ratio of the
            # wanted rotation to the simulated one.
            factor = wanted_turn / max(outcome.turn, SWAY.least_turn * wanted_turn)
            if SWAY.range[0] <= outcome.turn / wanted_turn <= SWAY.range[1]:
                yield candidate
                change = _change_of_push(outcome, speed)
                if change is None:
                    return
                factor, speed = change
            angle *= min(factor, SWAY.largest_factor)
            # The clip's slow motion follows from the time of the motion.
            if self.trials.ramp is None and outcome.seconds:
                ramp = ramp_of(playback_of(self.trials, outcome.seconds))

    def _wanted_turn(self) -> float:
        """Return the wanted rotation, degrees."""
        if self.has_round_foot:
            turn = SWAY.round_turn
        else:
            turn = SWAY.turn
        _, left, right = measure_foot(self.body)
        largest = SWAY.lift * self.trials.side / max(right - left, 1.0)
        return min(turn, degrees(largest))

    def _sway_start(self, turn: float) -> tuple[float, float]:
        """Return speed, px/s, and angle, degrees, of the first push for a rotation."""
        if self.is_filling:
            return 0.0, turn
        _, height = measure_extent(self.body)
        # The rotation itself moves the top: the rest of the visible path is a slide.
        top_path = radians(turn) * height / self.trials.side
        smallest, largest = SWAY.slide_paths
        path = min(max(SWAY.path - top_path, smallest), largest)
        friction = self._friction()
        low, left, right = measure_foot(self.body)
        if self.side > 0:
            arm = right
        else:
            arm = -left
        share = 1 - friction * low / max(arm, 1.0)
        # A slide over a path s stops from the speed sqrt(2 mu g s).
        speed = sqrt(2 * friction * self.gravity * path * self.trials.side)
        return speed, turn * max(share, SWAY.least_torque)

    def _friction(self) -> float:
        """Return the friction on the smoothest surface."""
        surfaces = dict(self.trials.world.surfaces)
        own_friction = surfaces.pop(self.item.name).friction
        others = [surface.friction for surface in surfaces.values()]
        return own_friction * min(others, default=0.0)

    def _push(self, angle: float, slide: float, ramp: float) -> Candidate:
        """Return the push for an angle, degrees, and the speed of a slide, px/s.

        The push takes `ramp`, s.
        """
        (x, y), spin = tipping_motion(self.body, self.side, angle, self.gravity, ramp)
        x += self.side * slide
        speed = hypot(x, y)
        direction = (x / speed, y / speed)
        return Candidate(self.item, direction, speed, NO_MOTION, ramp, round(spin, 1))


def _change_of_push(outcome: Outcome, speed: float) -> tuple[float, float] | None:
    """Return the factor of the angle and the speed, px/s, of a better push.

    None if the outcome is good. `speed` is that of the slide.
    """
    if outcome.grade is Grade.LEAVES:
        # Beside the border, an object still rocks where it stands.
        if speed:
            return (1.0, 0.0)
        return (SWAY.turn_factor, 0.0)
    if outcome.grade is Grade.SHORT and speed:
        return 1.0, SWAY.speed_factor * speed
    return None
