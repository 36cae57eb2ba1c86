"""Division of steps for fast bodies, and the solver effort by recent accuracy."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import ceil

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.scene.scene import SPRINGS, Load, Motion

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class StepTuning:
    """Limits of steps and of the contact solver's effort."""

    share: float = 0.3
    """Share of its smallest extent that a body may move in a step, so that its centre
    never crosses a line without a contact."""
    max_parts: int = 4096
    """Maximum number of parts of a step."""
    parts_at_once: int = 10_000
    parts_a_step: int = 100
    """Budget of parts for a run, and its increase per step: a body with a distant
    corner would take hours otherwise."""
    min_sweeps: int = 12
    usual_sweeps: int = 60
    max_sweeps: int = 120
    """Sweeps of the contact solver per step: minimum; with overlaps, impacts or joints;
    maximum."""
    work: int = 50_000
    """Limit on sweeps times contacts of a step: heaps of hundreds get fewer sweeps."""
    slack: float = 0.02
    """Closing speed that a step may leave, in units of gravity x step."""
    overlap: float = 0.02
    """Overlap, px, above which more sweeps are made."""
    rest_share: float = 3.0
    """Smallest closing speed of a bounce, in units of gravity x step."""
    rest_speed: float = 0.01
    """Smallest closing speed of a bounce without gravity, px/s."""
    impact_rate: float = 6.0
    """Impacts per step above which faster and faster contacts stop to bounce.

    The limit is `max_rest_factor` times the speed of rest: 94 px/s at 980 px/s², near the limit
    of Box2D for any scene (1 m/s, at 100 px/m)."""
    max_rest_factor: float = 32.0
    crowd_contacts: int = 200
    """Contacts above which a step is first tried with a single sweep, which only shows
    whether impacts occur."""


TUNING = StepTuning()


def _static_boxes(world: World) -> Array:
    """Return the boxes of all shapes that never move, (K, 4) px: x, y, x, y.

    A fast body needs parts only near other shapes.
    """
    boxes = []
    for wall in world.walls:
        for chain in wall.chains:
            for start, end in pairwise(chain):
                boxes.append((*np.minimum(start, end), *np.maximum(start, end)))
    for body in world.bodies:
        if body.motion is Motion.STATIC:
            box = (*(body.center - body.reach), *(body.center + body.reach))
            boxes.append(box)
    return np.array(boxes, np.float64).reshape(-1, 4)


def _push_speeds(world: World, moving: list[int]) -> Array:
    """Return the largest changes of speed by pushes in a step, (M,) px/s."""
    speeds = np.zeros(len(moving))
    rows = {body: row for row, body in enumerate(moving)}
    for push in world.pushes:
        if push.load is Load.FORCE and push.body in rows:
            body = world.bodies[push.body]
            force = float(np.hypot(*push.vector)) / world.steps_per_second
            speeds[rows[push.body]] += force / body.mass * 2
    return speeds


class StepDivider:
    """Finds the bodies that move far in a step, and divides the step for them."""

    def __init__(self, world: World, moving: Index) -> None:
        bodies = [world.bodies[k] for k in moving.tolist()]
        self._limit = np.array([TUNING.share * body.size for body in bodies]).reshape(
            -1
        )
        self._reach = np.array([body.reach for body in bodies]).reshape(-1)
        is_circle = np.array([body.radius is not None for body in bodies], bool)
        self._rim_radius = np.where(is_circle, 0.0, self._reach)
        self._static_boxes = _static_boxes(world)
        self._push_speeds = _push_speeds(world, moving.tolist())
        """Largest changes of speed by pushes in a step, (M,) px/s."""
        self.has_fast_bodies = False
        """Whether a body is so fast that each step must be checked."""
        self._parts_left = TUNING.parts_at_once
        self.exceeded_by: int | None = None
        """The row of a body that needed more parts than the budget of the run."""

    def _movement_ratio(
        self, state: Array, h: float, extra_speed: Array | float = 0.0
    ) -> Array:
        """Return the movement (M,) in h seconds over the permitted movement."""
        speed = (
            np.hypot(state[:, 3], state[:, 4])
            + np.abs(state[:, 5]) * self._rim_radius
            + extra_speed
        )
        return np.asarray(speed * h / self._limit)

    def search(self, state: Array, duration: float, gravity: float, h: float) -> None:
        """Check whether a body may become too fast within `duration` s for a step
        of h s.
        """
        self.has_fast_bodies = bool(
            (
                self._movement_ratio(state, h, gravity * duration + self._push_speeds)
                > 1
            ).any()
        )

    def parts(self, state: Array, h: float) -> int:
        """Return the parts of a step of h seconds; 1 if fast bodies meet no other."""
        # A body that moves farther in a step than a share of its own size could jump
        # over another one. Infinite ratios are bodies out of control, which more steps
        # do not help.
        ratio = self._movement_ratio(state, h, self._push_speeds)
        fast_rows = np.flatnonzero((ratio > 1) & np.isfinite(ratio))
        if not len(fast_rows):
            self.has_fast_bodies = False
            return 1
        start_positions = state[:, :2]
        end_positions = state[:, :2] + state[:, 3:5] * h
        reach = self._reach[:, None] + 2.0
        # Boxes around the paths of all bodies in the step: only where they overlap can
        # a fast body pass through another one.
        lower_corners = np.minimum(start_positions, end_positions) - reach
        upper_corners = np.maximum(start_positions, end_positions) + reach
        self._parts_left += TUNING.parts_a_step
        parts = 1
        for k in fast_rows.tolist():
            is_near_body = (lower_corners[:, 0] < upper_corners[k, 0]) & (
                upper_corners[:, 0] > lower_corners[k, 0]
            )
            is_near_body &= (lower_corners[:, 1] < upper_corners[k, 1]) & (
                upper_corners[:, 1] > lower_corners[k, 1]
            )
            is_near_body[k] = False
            static_boxes = self._static_boxes
            is_near_static = (static_boxes[:, 0] < upper_corners[k, 0]) & (
                static_boxes[:, 2] > lower_corners[k, 0]
            )
            is_near_static &= (static_boxes[:, 1] < upper_corners[k, 1]) & (
                static_boxes[:, 3] > lower_corners[k, 1]
            )
            if is_near_body.any() or is_near_static.any():
                parts = max(parts, min(TUNING.max_parts, ceil(ratio[k])))
                if parts > self._parts_left and self.exceeded_by is None:
                    self.exceeded_by = k
        # The budget bounds the time of a run: a body at absurd speed must not divide
        # each step into thousands.
        parts = min(parts, self._parts_left)
        self._parts_left -= parts
        return parts


class Governor:
    """Chooses the effort of the engine per step by the results of recent steps.

    The choice is the same in every run.
    """

    def __init__(self, world: World) -> None:
        self._gravity = float(np.hypot(*world.gravity))
        self._has_joints = any(joint.kind not in SPRINGS for joint in world.joints)
        self._sweep_limit = TUNING.max_sweeps
        self.rest_factor = 1.0
        """Factor on the speed of rest."""
        self._impacts = self._contacts = 0
        # The first steps have no impulses of earlier steps to start from.
        self.sweeps = TUNING.usual_sweeps
        self.max_sweeps = self.sweeps
        self.max_rest_factor = 1.0
        """The largest factor so far."""

    @property
    def after_impacts(self) -> int:
        """Return the sweeps of a repeated step after impacts.

        The solver starts from the wrong impulses of the first trial.
        """
        return min(self._sweep_limit, max(self.sweeps, TUNING.usual_sweeps))

    @property
    def has_crowd(self) -> bool:
        """Check whether a trial with a single sweep saves time."""
        return self._contacts > TUNING.crowd_contacts

    def threshold(self, h: float, rest_factor: float) -> float:
        """Return the speed below which a contact does not bounce, px/s.

        `h`: the step, s; `rest_factor`: factor on the speed of rest.
        """
        return max(
            TUNING.rest_share * rest_factor * self._gravity * h, TUNING.rest_speed
        )

    def note(self, impacts: int) -> None:
        """Count the impacts of a step."""
        self._impacts += impacts

    def review(
        self, steps: int, contacts: int, residual: float, overlap: float, h: float
    ) -> None:
        """Adapt sweeps and threshold to the results of the last steps.

        `contacts`: their present number; `residual`: the fastest closing, px/s;
        `overlap`: the deepest overlap, px.
        """
        self._contacts = contacts
        limit = TUNING.slack * max(self._gravity * h, TUNING.rest_speed)
        self._sweep_limit = max(
            2 * TUNING.min_sweeps,
            min(TUNING.max_sweeps, TUNING.work // max(self._contacts, 1)),
        )
        sweeps = self.sweeps
        minimum = TUNING.min_sweeps
        if overlap > TUNING.overlap or self._has_joints:
            minimum = TUNING.usual_sweeps
        # Grow fast and shrink slowly, against oscillations of the sweeps.
        if residual > limit:
            sweeps += sweeps // 2
        elif residual < limit / 10:
            sweeps -= sweeps // 8
        self.sweeps = min(self._sweep_limit, max(minimum, sweeps))
        self.max_sweeps = max(self.max_sweeps, self.sweeps)
        # Many impacts in a step mean objects that chatter at rest. A higher threshold
        # lets the engine treat them as resting contacts.
        if self._impacts > TUNING.impact_rate * steps:
            self.rest_factor = min(TUNING.max_rest_factor, self.rest_factor * 2)
        elif self._impacts < TUNING.impact_rate * steps / 4:
            self.rest_factor = max(1.0, self.rest_factor / 2)
        self.max_rest_factor = max(self.max_rest_factor, self.rest_factor)
        self._impacts = 0
