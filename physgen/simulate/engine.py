"""The simulation of a World to a Trajectory: a leapfrog with Chipmunk's contacts.

Positions are those at the ends of steps and velocities those at their middles (Störmer
and Verlet). A half step comes first, so that free fall is exact. Steps do not depend on
the times of the samples. `Space` finds the contacts and solves normal forces, friction
and joints. `collisions` computes bounces, because Chipmunk solves all contacts of a
step at once, which would send back the first ball in a row of balls. `StepDivider`
divides the steps of fast bodies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import takewhile
from math import ceil, nan
from threading import Lock
from typing import NamedTuple

import numpy as np

from physgen.compile.world import World
from physgen.messages import Message
from physgen.problems import UNKNOWN_PLACE
from physgen.progress import Progress, silent
from physgen.scene.scene import Motion
from physgen.simulate.breaking import Breakages
from physgen.simulate.collisions import Impacts, ImpactSolver, StepMotion, WorkBudget
from physgen.simulate.contacts import (
    CONTACT_BYTES,
    NO_CONTACTS,
    WORDS,
    Array,
    ContactProperties,
    Flags,
    Order,
    contact_points,
    contacts_jumped,
    new_contacts,
    pairs_with_more_contacts,
)
from physgen.simulate.curves import CurvedWalls
from physgen.simulate.forces import (
    EnergyEvent,
    ForceFields,
    Forces,
    Impulses,
    ScriptedMotion,
    StepForces,
    stiffest_spring,
)
from physgen.simulate.joints import Assemblies
from physgen.simulate.ramps import has_ramp
from physgen.simulate.recorder import NO_BRAKING, Recorder, Step
from physgen.simulate.space import Space
from physgen.simulate.step_control import Governor, StepDivider
from physgen.simulate.trajectory import Effort, Trajectory
from physgen.simulate.wheels import fold_wheels, world_on_wheels

EffortCounts = tuple[int, int, int, int, int, float, int, int]
"""Fields of `Effort`."""

PHASE = 0.1
"""rad: largest phase of the stiffest spring, or of a pass by an attractor, in a
step.
"""
MAX_PARTS = 1024
"""Largest number of parts of a step, for springs and attractors."""
ATTEMPTS = 8
"""Largest number of trials of a step with impacts."""
ABRUPT = 8.0
"""Ratio of a velocity's change in a step to that by gravity and lasting forces.

A contact with a larger ratio changes the velocity at once, not in the course of the
step. The ratio is 1 for a body at rest on another, and below 3 if it slides or rolls.
"""
MAX_REPEATED_PARTS = 64
"""Largest number of parts of a step that the next step keeps after an abrupt
contact.
"""
CLOSING_SHARE = 0.5
"""Closing speed that contacts of bodies on joints may keep, by gravity x step."""
HIDINGS = 4
"""Largest number of repetitions of a step for contacts at internal edges."""
JUST_BEFORE = 4e-9
"""s from an event to the first sample with it, at the end of its step."""
SEARCH_INTERVAL = 8
"""Number of steps between two searches for fast bodies."""


def simulate(
    world: World, times: Array | None = None, progress: Progress = silent
) -> Trajectory:
    """Simulate the world and sample it at `times`.

    `times`: s, rising; by default the frame times of the world. Raises InputError if a
    body leaves the range of numbers.
    """
    running = Running(world, times)
    running.advance(running.end, progress)
    return running.trajectory()


def spring_parts(world: World) -> int:
    """Return the number of parts into which the stiffest spring divides every step.

    Raises InputError if it is above MAX_PARTS.
    """
    rate, name = stiffest_spring(world)
    parts = max(1, ceil(rate / world.steps_per_second / PHASE))
    if parts > MAX_PARTS:
        path = f"joints.{name}.stiffness"
        raise Message.SPRING_TOO_STIFF.error_at(
            UNKNOWN_PLACE, path, parts=parts, most_parts=MAX_PARTS
        )
    return parts


class Running:
    """A simulation that can stop and continue; its result is that of `simulate`.

    Its steps do not depend on the samples. They are stored, so that the motion can be
    sampled again at other times.
    """

    def __init__(
        self, world: World, times: Array | None = None, max_bytes: int = 64_000_000
    ) -> None:
        """Prepare the simulation; steps are stored up to `max_bytes` bytes."""
        if times is None:
            self.times = world.times
        else:
            self.times = np.asarray(times, np.float64)
        self._vehicles = world
        world = world_on_wheels(world)
        self._base_step = 1.0 / world.steps_per_second
        self._step_number = -1
        bodies = world.bodies
        self._world = world
        self._space = Space(world)
        self._governor = Governor(world)
        moving = self._space.moving
        self._force_fields = ForceFields(world)
        self._scripted_motion = ScriptedMotion(world)
        self._forces = StepForces(world, moving, self._force_fields)
        self._new_recorder = partial(
            Recorder, world, moving, self._force_fields, self._scripted_motion
        )
        self._recorder = self._new_recorder(self.times)
        self._step_records: list[tuple[Step, EffortCounts]] = []
        self._bytes = 0
        self._max_bytes = max_bytes
        # Several threads may sample the same motion.
        self._lock = Lock()
        self._row = {int(body): row for row, body in enumerate(moving)}
        self._stepper = Stepper(world, self._space, self._forces, self._governor)
        self._impulses = Impulses(world)
        self._divider = StepDivider(world, moving)
        self._center = np.array([[*b.center, 0.0] for b in bodies]).reshape(-1, 3)
        self._gravity = float(np.hypot(*world.gravity))
        self._step_length = 0.0
        self._has_own_motion = self._force_fields.busy or self._scripted_motion.busy
        self._spring_parts = spring_parts(world)
        self._divided_steps = self._max_parts = self._reviewed_steps = 0
        self._parts = 1
        """Number of parts of the last base step."""

    @property
    def end(self) -> float:
        """Return the time of the last sample, s."""
        if len(self.times):
            return float(self.times[-1])
        return 0.0

    @property
    def work(self) -> float:
        """Return the work so far, in steps, the same on every machine.

        A step without contacts takes about as long as 7 kB of contacts.
        """
        return self._stepper.steps + self._bytes / 7000

    @property
    def sample_count(self) -> int:
        """Return the number of samples so far."""
        return self._recorder.sample_count

    def advance(
        self,
        until: float,
        progress: Progress = silent,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> None:
        """Continue the simulation to the time `until`, s, or until `should_stop`
        returns True.

        `should_stop` is called before each step. Raises InputError if a body leaves the
        range of numbers.
        """
        with self._report_overflow():
            if self._step_number < 0:
                self._step_number = 0
                self._start()
            # Rounding must not add a step for a time that is a whole number of steps.
            last = ceil(until / self._base_step - 1e-9)
            while self._step_number < last and not should_stop():
                old_number = self._step_number
                self._advance()
                # A report for each step would cost more than the step.
                if self._step_number // 256 > old_number // 256:
                    progress("simulate", self._recorder.sample_count, len(self.times))
            self._recorder.read()

    def trajectory(self) -> Trajectory:
        """Return the motion so far; its samples from `sample_count` on are zeros."""
        trajectory = self._recorder.trajectory(Effort(*self._effort()), self.resample)
        return fold_wheels(trajectory, self._vehicles)

    def resample(self, times: Array) -> Trajectory:
        """Return the motion at the times `times`, s, rising, to the same bits as
        `simulate`.
        """
        # The steps may already be known: continue only as far as the times require.
        until = float(times.max(initial=0.0))
        recorder = self._new_recorder(times)
        last = (ceil(until / self._base_step - 1e-9) + 1e-6) * self._base_step
        with self._lock:
            self.advance(until, should_stop=lambda: self._bytes > self._max_bytes)
            records = list(
                takewhile(lambda record: record[0].time < last, self._step_records)
            )
            # Too many steps to store: simulate once more, for these times alone.
            if self._bytes > self._max_bytes:
                return simulate(self._vehicles, times)
        begin, effort = self._first_record
        with self._report_overflow():
            recorder.begin(*begin)
            for step, effort in records:  # noqa: B007 - the last effort is used
                recorder.add(step)
            recorder.read()
        return fold_wheels(
            recorder.trajectory(Effort(*effort), self.resample), self._vehicles
        )

    def _effort(self) -> EffortCounts:
        """Return the fields of the engine's `Effort` so far."""
        # A tuple, because one is stored for every step.
        stepper = self._stepper
        governor = self._governor
        # Report the pair of the used up budget, or the body of the used up parts.
        first, second = stepper.budget.exceeded_by or (-1, -1)
        fast_row = self._divider.exceeded_by
        if fast_row is not None:
            first = int(self._space.moving[fast_row])
            second = -1
        return (
            stepper.steps,
            self._divided_steps,
            self._max_parts,
            governor.max_sweeps,
            stepper.impacts,
            governor.threshold(self._base_step, governor.max_rest_factor),
            first,
            second,
        )

    @contextmanager
    def _report_overflow(self) -> Iterator[None]:
        """Raise InputError with the time of the step if numbers overflow."""
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                yield
        except (OverflowError, np.linalg.LinAlgError) as error:
            time = self._step_number * self._base_step
            raise Message.MOTION_DIVERGED.error_at(
                UNKNOWN_PLACE, "world", "the motion", time=time
            ) from error

    def _start(self) -> None:
        """Take the half step to t = 0, after which velocities are those of the first
        middle.
        """
        world = self._world
        h = self._base_step / self._spring_parts
        pose = self._center.copy()
        velocities = [[*body.velocity, body.spin] for body in world.bodies]
        velocity = np.array(velocities).reshape(-1, 3)
        # A hand brings these bodies to their velocities in the course of time.
        velocity[[has_ramp(body) for body in world.bodies]] = 0.0
        roll = self._forces.roll
        if self._scripted_motion.busy:
            self._scripted_motion.sample(0.0, pose, velocity)
        events = []
        while self._impulses.has_due(2e-12):
            events.append(self._impulses.give(velocity, pose, 0.0))
        velocity, lost_energy = self._stepper.project_on_joints(pose, velocity)
        events.append(EnergyEvent(0.0, lost_energy, 0.0))
        start_velocity = velocity.copy()
        moving = self._space.moving
        state = np.concatenate(
            [pose[moving] - velocity[moving] * h, velocity[moving]], axis=1
        )
        self._space.place(state)
        self._step_length = h
        # Take a whole step with half the gravity: the engine stores impulses of
        # contacts, which would be wrong after a change of the step's length.
        self._space.weaken(0.5)
        step = self._stepper.take(0.0, h, state, events, is_half_step=True)
        self._space.weaken(1.0)
        if step.velocities is None:
            step.velocities = state[:, 3:].copy()
        self._recorder.begin(step, pose, start_velocity, roll)
        self._first_record = (step, pose, start_velocity, roll), self._effort()

    def _advance(self) -> None:
        """Take a base step, in as many parts as its speeds and forces require."""
        begin = self._step_number * self._base_step
        end = (self._step_number + 1) * self._base_step
        h = end - begin
        # Fast bodies and stiff springs need shorter steps than the scene's own.
        parts = self._parts_of_step(end, h)
        has_fewer_parts = parts < self._parts <= MAX_REPEATED_PARTS
        if has_fewer_parts and self._stepper.has_abrupt_change:
            # Chipmunk starts from the impulses of the last step, scaled to the new
            # step's length. The impulse of a contact that opens would thus be too large
            # in a longer step.
            parts = self._parts
        self._parts = parts
        self._step_number += 1
        if parts > 1:
            self._divided_steps += 1
            self._max_parts = max(self._max_parts, parts)
        for part in range(parts):
            self._take_part(begin + h * part / parts, h / parts)

    def _parts_of_step(self, end: float, h: float) -> int:
        """Return the parts into which springs, fast bodies and attractors divide a step."""
        parts = self._spring_parts
        stepper = self._stepper
        # Compute speeds only every SEARCH_INTERVAL steps while nothing changes them at
        # once, to save time in quiet scenes.
        if not self._divider.has_fast_bodies and (
            stepper.has_unchecked_speeds
            or self._has_own_motion
            or stepper.steps % SEARCH_INTERVAL == 0
        ):
            stepper.has_unchecked_speeds = False
            state = self._state_for_search(end, h)
            self._divider.search(state, h * SEARCH_INTERVAL, self._gravity, h)
        if self._divider.has_fast_bodies:
            parts = max(parts, self._divider.parts(self._state_for_search(end, h), h))
        # Near an attractor, the direction of its pull changes within a step.
        if self._force_fields.has_centres:
            pose, velocity = stepper.expand_state(stepper.state())
            rate = self._force_fields.fastest_rate(pose, velocity)
            parts = max(parts, min(MAX_PARTS, ceil(rate * h / PHASE)))
        return parts

    def _state_for_search(self, end: float, h: float) -> Array:
        """Return the state (M, 6) for the search of fast bodies, in a step of h s to
        `end`.

        The velocities of scripted bodies are their fastest in this step and the next.
        """
        state = self._stepper.state()
        if self._scripted_motion.busy:
            velocities = [state[:, 3:]]
            state = state.copy()
            # A path may jump to a higher velocity at a knot: the faster of both steps
            # decides.
            for time in (end, end - h):
                scripted_state = state.copy()
                self._scripted_motion.drive(time, h, scripted_state, self._row)
                velocities.append(scripted_state[:, 3:])
            for row in self._scripted_motion.rows(self._row):
                state[row, 3:] = max((v[row] for v in velocities), key=_linear_speed)
        return state

    def _take_part(self, begin: float, h: float) -> None:
        """Take one part of a base step, of h s from `begin`."""
        end = begin + h
        state: Array | None = None
        if abs(h - self._step_length) > 1e-9 * h:
            state = self._stepper.state().copy()
            # Velocities are those at the middle of a step, which moves if its length
            # changes: carry them there with the acceleration of the last step.
            share = (h - self._step_length) / (2 * self._step_length)
            state[:, 3:] += self._stepper.smooth_change * share
            self._step_length = h
        events: list[EnergyEvent] = []
        if self._impulses.has_due(end):
            if state is None:
                state = self._stepper.state().copy()
            events = self._give_due_impulses(begin, end, state)
        if self._scripted_motion.busy:
            if state is None:
                state = self._stepper.state().copy()
            # A jump of a script closes contacts that the motion of the last step did
            # not announce.
            self._scripted_motion.drive(end, h, state, self._row)
            has_jump = self._scripted_motion.has_jump(end - h / 2, end + h / 2)
            self._stepper.has_unchecked_contacts |= has_jump
        if state is not None:
            self._space.place(state)
        # All changes of velocity at the begin of the step are placed in the engine now:
        # it moves the bodies by them, and only then finds the contacts.
        step = self._stepper.take(end, h, state, events)
        if step.impacts:
            self._governor.note(sum(len(impact.first) for impact in step.impacts))
        self._record(step, h)

    def _record(self, step: Step, h: float) -> None:
        """Store a step of h s, and let the governor review its results from time to
        time.
        """
        if self._recorder.add(step):
            recorder = self._recorder
            step_count = self._stepper.steps - self._reviewed_steps
            self._reviewed_steps = self._stepper.steps
            contacts = len(step.numbers) // CONTACT_BYTES
            self._governor.review(
                step_count, contacts, recorder.residual, recorder.overlap, h
            )
        # About 600 bytes are the Python objects of a step.
        self._bytes += len(step.numbers) + 2 * len(step.states) + 600
        self._step_records.append((step, self._effort()))
        # A long motion keeps only the samples; its steps would fill the memory.
        if self._bytes > self._max_bytes:
            self._step_records.clear()

    def _give_due_impulses(
        self, begin: float, end: float, state: Array
    ) -> list[EnergyEvent]:
        """Apply the impulses of a step from `begin` to `end` to the state (M, 6).

        Return the energy that each gives and that joints take from it.
        """
        moving = self._space.moving
        events = []
        while self._impulses.has_due(end):
            delay = self._impulses.time_until_next(begin)
            pose, velocity = self._stepper.expand_state(state)
            events.append(self._impulses.give(velocity, pose, delay))
            velocity, lost_energy = self._stepper.project_on_joints(pose, velocity)
            events.append(EnergyEvent(begin + delay, lost_energy, 0.0))
            change = velocity[moving] - state[:, 3:]
            state[:, 3:] += change
            # The engine will move the bodies with the new velocity for the whole step;
            # subtract the displacement of the time before the impulse.
            state[:, :3] -= change * delay
        self._stepper.has_unchecked_contacts = self._stepper.has_unchecked_speeds = True
        return events


def _linear_speed(velocity: Array) -> float:
    """Return the speed of a centre of mass, px/s."""
    return float(np.hypot(velocity[0], velocity[1]))


def contact_properties(world: World) -> ContactProperties:
    """Return the properties of the bodies and then of the walls in an impact."""
    inverse_masses = []
    inverse_moments = []
    radii = []
    for body in world.bodies:
        # Static and scripted bodies have infinite mass.
        is_dynamic = body.motion is Motion.DYNAMIC
        inverse_masses.append(1 / body.mass if is_dynamic else 0.0)
        inverse_moments.append(1 / body.moment if is_dynamic else 0.0)
        radii.append(nan if body.radius is None else body.radius)
    # The inverse mass of a wall is 0, as of any immovable body.
    wall_zeros = [0.0] * len(world.walls)
    surfaces = [surface for _, surface in world.surfaces]
    return ContactProperties(
        lightness=inverse_masses + wall_zeros,
        ease=inverse_moments + wall_zeros,
        friction=[surface.friction for surface in surfaces],
        elasticity=[surface.elasticity for surface in surfaces],
        radius=radii + [nan] * len(world.walls),
        conveyor=[surface.conveyor for surface in surfaces],
    )


@dataclass(slots=True)
class StepTrial:
    """A step while it is solved: its start, and the results of the latest trial."""

    end: float  # s
    h: float  # s
    is_half_step: bool
    """Whether this is the half step to t = 0."""
    events: list[EnergyEvent]
    state: Array | None
    """State (M, 6) at the start, if it was placed in the engine; None: that after the
    step before."""
    velocities: Array | None = None
    """Velocities (M, 3) of the step, after its impacts; None: those of the start."""
    velocities_before_impacts: Array | None = None
    """The same before the impacts, (M, 3); None without impacts."""
    impacts: list[Impacts] = field(default_factory=list)
    load: Forces | None = None
    states: bytes = b""
    """States (M, 6) at the end."""
    order: Order = NO_CONTACTS
    numbers: bytes = b""
    motor_work: float = 0.0


class JointMomentum(NamedTuple):
    """The momentum that all joints together gave to the N bodies in a step."""

    pose: Array  # (N, 3)
    velocity: Array  # (N, 3) after the step
    change: Array  # (N, 3) of the velocities in the step
    impulse: Array  # (N, 3) g·px/s, g·px/s, g·px²/s


def _inverse_inertia(properties: ContactProperties, count: int) -> Array:
    """Return 1/mass, 1/mass and 1/moment of the bodies, (N, 3)."""
    light = properties.lightness
    return np.array([light, light, properties.ease]).T[:count]


class Stepper:
    """The state of the engine and one step after the other."""

    def __init__(
        self, world: World, space: Space, forces: StepForces, governor: Governor
    ) -> None:
        """Prepare the properties of bodies and walls for impacts."""
        bodies = world.bodies
        walls = world.walls
        self._space = space
        self._forces = forces
        self._governor = governor
        self._is_dynamic = np.array([b.motion is Motion.DYNAMIC for b in bodies], bool)
        self._properties = contact_properties(world)
        self._reach = np.array([b.reach for b in bodies]).reshape(-1)
        self._press = max(float(np.hypot(*world.gravity)), world.press)
        """px/s²: acceleration of bodies towards their supports."""
        self._last_load: tuple[float, Forces | None, float] = (0.0, None, 1.0)
        """Length of the last step, s, its lasting forces, and the factor on its
        gravity.
        """
        self.budget = WorkBudget(len(bodies))
        self._world = world
        self._breakages = Breakages(world)
        self._assemblies = Assemblies(world)
        self._jointed_bodies = self._assemblies.bodies
        self._curves = CurvedWalls(world, space.moving, self._jointed_bodies)
        self._inverse = _inverse_inertia(self._properties, len(bodies))
        self._center = np.array([[*b.center, 0.0] for b in bodies]).reshape(-1, 3)
        # Poses and velocities of bodies and walls; the rows of walls stay 0.
        self._all_poses = np.concatenate([self._center, np.zeros((len(walls), 3))])
        self._all_velocities = np.zeros_like(self._all_poses)
        self._has_corners = any(b.radius is None for b in bodies)
        self._order = NO_CONTACTS
        self._numbers = b""
        self._states = b""
        self._is_calm = True
        """Whether the last step had no impacts."""
        self._last_motion: tuple[Array | None, bytes] = (
            np.zeros((len(space.moving), 3)),
            b"",
        )
        """Velocities (M, 3) within the last step, and the state before it.

        If the velocities are None, they are those of that state.
        """
        self.has_unchecked_contacts = self.has_unchecked_speeds = True
        """True if velocities have changed since the last step.

        `has_unchecked_contacts`: any contact may close then; `has_unchecked_speeds`:
        any body may be fast.
        """
        self.steps = self.impacts = 0
        """Numbers of steps and of struck points."""

    def state(self) -> Array:
        """Return the state (M, 6) of the moving bodies, read-only: px, px, rad, and per
        s.
        """
        return np.frombuffer(self._states, np.float64).reshape(-1, 6)

    def expand_state(self, state: Array) -> tuple[Array, Array]:
        """Return poses and velocities (N, 3) of all bodies, given the state (M, 6) of
        the moving bodies.
        """
        if len(state) == len(self._center):
            return state[:, :3].copy(), state[:, 3:].copy()
        pose = self._center.copy()
        velocity = np.zeros_like(self._center)
        pose[self._space.moving] = state[:, :3]
        velocity[self._space.moving] = state[:, 3:]
        return pose, velocity

    @property
    def step_velocities(self) -> Array:
        """Return the velocities (M, 3) within the last step."""
        velocity, old_state = self._last_motion
        if velocity is None:
            return np.frombuffer(old_state).reshape(-1, 6)[:, 3:]
        return velocity

    @property
    def smooth_change(self) -> Array:
        """Return the changes of velocity (M, 3) in the course of the last step.

        They exclude sudden changes by contacts.
        """
        change, force_change, is_struck = self._velocity_changes()
        return np.where(is_struck[:, None], force_change, change)

    @property
    def has_abrupt_change(self) -> bool:
        """Check whether contacts changed a velocity at once in the last step."""
        return bool(self._velocity_changes()[2].any())

    def _velocity_changes(self) -> tuple[Array, Array, Flags]:
        """Return the changes of velocity in the last step, and their abruptness.

        They are the whole change (M, 3), the part by gravity and lasting forces (M, 3),
        and whether the body was struck (M,). Bodies on joints never count as struck:
        joints change velocities as much in the course of a step.
        """
        change: Array = self.state()[:, 3:] - self.step_velocities
        moving = self._space.moving
        h, load, strength = self._last_load
        force_change = self._forces.change(load, h, strength)[moving]
        # A spin counts by the speed of the rim, so that both parts have one unit.
        reach = self._reach[moving]
        speed, usual_speed = (
            np.hypot(part[:, 0], part[:, 1]) + np.abs(part[:, 2]) * reach
            for part in (change, force_change)
        )
        # Forces and resting contacts change velocities by about one step of gravity: a
        # much larger change is an impact.
        is_struck = speed > ABRUPT * np.maximum(usual_speed, self._press * h)
        is_struck[np.isin(moving, self._jointed_bodies)] = False
        # The half step to t = 0 changes velocities half as much as a whole step.
        return change / strength, force_change / strength, is_struck

    def project_on_joints(self, pose: Array, velocity: Array) -> tuple[Array, float]:
        """Return the velocities (N, 3) that joints allow, and the energy that they
        take.

        The energy, g·px²/s², of the other velocities is lost at once.
        """
        if not self._assemblies.busy:
            return velocity, 0.0
        joint_velocity = self._assemblies.project_velocities(pose, velocity)
        inertia = 1 / self._inverse[self._is_dynamic]
        square_loss = (velocity**2 - joint_velocity**2)[self._is_dynamic]
        return joint_velocity, float((inertia * square_loss).sum() / 2)

    def take(
        self,
        end: float,
        h: float,
        state: Array | None,
        events: list[EnergyEvent],
        is_half_step: bool = False,
    ) -> Step:
        """Take a step of h s to `end`, and repeat it with other velocities after
        impacts.

        `state` (M, 6): as it was placed in the engine, if it was; `is_half_step`: the half
        step to t = 0.
        """
        trial = StepTrial(end, h, is_half_step, events, state)
        if state is not None:
            trial.velocities = state[:, 3:].copy()
        # Contacts come first; joints, curves and breakages correct their result.
        self._solve_contacts(trial)
        if self._space.hidden:
            self._space.review_internal_edges()
        self.steps += 1
        self.budget.grant(h)
        self._is_calm = trial.velocities_before_impacts is None
        if self._assemblies.busy or not self._is_calm:
            self._correct_state(trial)
        if self._curves.busy:
            self._restore_energy_on_curves(trial)
        if (self._assemblies.has_scripts or self._breakages.busy) and self._states:
            self._review_joints(trial)
        if self._space.parting:
            self._space.separate_broken()
        return self._finish_step(trial)

    # The contacts of a step

    def _solve_contacts(self, trial: StepTrial) -> None:
        """Let the engine take the step, again and again until no contact bounces."""
        # In a crowd, a first trial with one sweep finds the impacts at a fraction of
        # the cost.
        is_probe = self._governor.has_crowd and not self._is_calm
        if is_probe and trial.state is None:
            trial.state = self.state().copy()
        if is_probe:
            self._space.iterations = 1
        else:
            self._space.iterations = self._governor.sweeps
        for attempt in range(ATTEMPTS):
            self._try_step(trial)
            new_rows = self._leave_out_internal_edges(trial)
            impact = None
            # Contacts that still close in the last trial do not bounce.
            if attempt < ATTEMPTS - 1 and (new_rows is None or new_rows):
                impact = self._solve_impacts(trial, new_rows)
            if impact is not None:
                self._start_after_impacts(trial, impact)
                self._space.iterations = self._governor.after_impacts
            elif is_probe:
                self._space.iterations = self._governor.sweeps
            else:
                break
            is_probe = False
            assert trial.state is not None
            self._space.place(trial.state)

    def _try_step(self, trial: StepTrial) -> None:
        """Take a trial of the step with its lasting forces and brakes."""
        # Lasting forces act before the contacts, which balance them within the step.
        if self._forces.is_acting:
            if trial.state is None:
                start_state = self.state()
            else:
                start_state = trial.state
            # A contact, a joint or any other change would invalidate friction that is
            # computed for many steps at once.
            is_free = (
                trial.state is None and not self._numbers and not self._assemblies.busy
            )
            trial.load = self._forces.push(
                start_state,
                trial.end,
                trial.h,
                is_half_step=trial.is_half_step,
                is_free=is_free,
            )
            self._push(trial.load)
        resistance = self._forces.resistance
        if resistance.busy:
            self._space.brake(resistance.brakes.pairs, resistance.torques)
        trial.states, trial.order, trial.numbers = self._space.step(trial.h)

    def _push(self, load: Forces) -> None:
        """Apply lasting forces to the bodies of the engine."""
        is_complete = len(load.total) == len(self._space.moving)
        self._space.push(load.total if is_complete else load.total[self._space.moving])

    def _leave_out_internal_edges(self, trial: StepTrial) -> Sequence[int] | None:
        """Repeat the step without the contacts at internal edges.

        Return the rows of its new contacts as `_new_contacts`.
        """
        new_rows = self._new_contacts(trial.order, trial.numbers)
        for _ in range(HIDINGS):
            if not self._hides_contacts(trial.order, trial.numbers, new_rows):
                break
            if self._space.nudges:
                trial.state = self._shift_off_corners(trial.state)
            self._repeat_step(trial)
            new_rows = self._new_contacts(trial.order, trial.numbers)
        return new_rows

    def _hides_contacts(
        self, order: Order, numbers: bytes, new_rows: Sequence[int] | None
    ) -> bool:
        """Return whether contacts at internal edges acted, which later steps
        leave out.
        """
        if self.has_unchecked_contacts:
            return self._space.hide_internal_edges(None, order, numbers)
        # New pairs of surfaces may touch at an internal edge; of the same pairs, only
        # those whose contacts have turned may.
        if order is not self._order:
            pairs = pairs_with_more_contacts(order.raw, self._order.raw)
        elif new_rows is None:
            pairs = order.pairs_turned(numbers, self._numbers)
        else:
            return False
        if not pairs:
            return False
        return self._space.hide_internal_edges(pairs, order, numbers)

    def _shift_off_corners(self, state: Array | None) -> Array:
        """Return the state (M, 6) at the start with bodies moved off wrong contacts."""
        state = (self.state() if state is None else state).copy()
        moving = self._space.moving.tolist()
        for body, shift in self._space.nudges.items():
            state[moving.index(body), :2] += shift
        self._space.nudges.clear()
        return state

    def _repeat_step(self, trial: StepTrial) -> None:
        """Repeat a step with other contacts and the same lasting forces."""
        self._space.iterations = max(
            self._space.iterations, self._governor.after_impacts
        )
        self._space.place(self.state() if trial.state is None else trial.state)
        if trial.load is not None:
            self._push(trial.load)
        trial.states, trial.order, trial.numbers = self._space.step(trial.h)

    def _new_contacts(self, order: Order, numbers: bytes) -> Sequence[int] | None:
        """Return the rows of contacts that the step before did not have.

        Return None if any contact may close: in the first step, and after jumps.
        """
        if self.has_unchecked_contacts or self._has_contact_jumped(order, numbers):
            return None
        if order is self._order:
            return ()
        return new_contacts(order.raw, self._order.raw)

    def _has_contact_jumped(self, order: Order, numbers: bytes) -> bool:
        """Check whether a contact of corners has jumped to another place."""
        old_numbers = self._numbers
        if not self._has_corners or not numbers or len(numbers) != len(old_numbers):
            return False
        if order is not self._order:
            numbers = order.sort(numbers)
            old_numbers = self._order.sort(old_numbers)
        return contacts_jumped(numbers, old_numbers, order.places)

    def _solve_impacts(
        self, trial: StepTrial, new_rows: Sequence[int] | None
    ) -> Impacts | None:
        """Return the impacts of a step, or None.

        `new_rows`: of contacts that did not touch before, or None if any contact may
        close. Contacts that touched before do not bounce; only their remaining closing
        speed is removed.
        """
        if trial.state is None:
            trial.state = self.state().copy()
        # Below this speed, contacts close without a rebound.
        threshold = self._governor.threshold(trial.h, self._governor.rest_factor)
        after = np.frombuffer(trial.states, np.float64).reshape(-1, 6)
        # Impacts happen within the step, at velocities before the engine's own
        # solution: the poses are those at its end, and the solver goes back from there.
        poses = self._all_poses
        velocities = self._all_velocities
        poses[self._space.moving] = after[:, :3]
        velocities[self._space.moving] = trial.state[:, 3:]
        words = trial.order.words
        numbers = trial.order.sort(trial.numbers)
        points = contact_points(words, numbers, poses, velocities)
        if not (points.closing > threshold).any():
            return None
        if trial.is_half_step:
            old_words = words
        else:
            old_words = self._order.words
        # Only new contacts bounce; old ones have lost their speed in an earlier step.
        has_touched = np.ones(len(trial.order.contacts), bool)
        has_touched[[*new_contacts(words, old_words)]] = False
        if new_rows is not None:
            points.closing[has_touched[points.row]] = 0.0
            if not (points.closing > threshold).any():
                return None
        motion = StepMotion(poses, velocities, self._drift(trial.load, old_words))
        # The step is then taken again with the velocities after these impacts.
        solver = ImpactSolver(
            self._properties,
            self._assemblies,
            motion,
            points,
            has_touched,
            trial.h,
            threshold,
        )
        return solver.run(self.budget)

    def _drift(self, load: Forces | None, old_words: bytes) -> Array:
        """Return the accelerations of bodies and walls before their impacts, px/s².

        Only a free body falls further before its impact; the contacts `old_words` of
        the step before and joints carry the weight of all others.
        """
        drift = np.zeros((len(self._all_poses), 2))
        drift[: len(self._is_dynamic)] = self._forces.drift(load)
        drift[np.frombuffer(old_words, np.int64).reshape(-1, WORDS)[:, :2]] = 0.0
        drift[self._jointed_bodies] = 0.0
        return drift

    def _start_after_impacts(self, trial: StepTrial, impact: Impacts) -> None:
        """Let the next trial continue from the velocities after the impacts."""
        assert trial.state is not None
        if trial.velocities_before_impacts is None:
            trial.velocities_before_impacts = trial.state[:, 3:].copy()
        trial.impacts.append(impact)
        self.impacts += len(impact.first)
        moving = self._space.moving
        velocities = impact.velocity[moving]
        trial.state[:, 3:] = trial.velocities = velocities
        # Move the start such that the step ends at the place of a body that bounced
        # within it.
        after = np.frombuffer(trial.states, np.float64).reshape(-1, 6)
        trial.state[:, :3] = after[:, :3] + impact.shift[moving] - velocities * trial.h

    # Corrections after the engine's step

    def _correct_state(self, trial: StepTrial) -> None:
        """Place the bodies after impacts, and close the joints exactly."""
        exact = np.frombuffer(trial.states, np.float64).reshape(-1, 6).copy()
        if trial.state is not None and not self._is_calm:
            # The first trial corrected overlaps that do not exist after the impacts.
            exact[:, :3] = trial.state[:, :3] + trial.state[:, 3:] * trial.h
        if self._assemblies.busy:
            self._hold_joints(trial, exact)
        self._space.place(exact)
        trial.states = exact.tobytes()

    def _hold_joints(self, trial: StepTrial, exact: Array) -> None:
        """Close the joints in the state (M, 6) at the end, and then load its contacts."""
        moving = self._space.moving
        h = trial.h
        step_velocities = trial.velocities
        if step_velocities is None:
            step_velocities = self.state()[:, 3:]
        start_velocities = None
        if self._assemblies.has_bounds:
            start_velocities = np.zeros_like(self._center)
            start_velocities[moving] = step_velocities
        # A motor acts for half the time in the half step to t = 0.
        motor_strength = 1.0
        if trial.is_half_step:
            motor_strength = 0.5
        pose, velocity = self.expand_state(exact)
        motion = self._assemblies.constrain(
            pose, velocity, h, motor_strength, start_velocities
        )
        trial.motor_work = motion.work
        exact[:, 3:] = motion.velocity[moving]
        # Bounds lose energy within the step: a part before the velocities of its end,
        # and the rest at its end.
        if motion.loss:
            exact[:, :3] += motion.shift[moving]
            late_loss = motion.loss - motion.early_loss
            script_share = motion.script_loss / motion.loss
            early_work = script_share * motion.early_loss
            trial.events += [
                EnergyEvent(trial.end - JUST_BEFORE, motion.early_loss, early_work),
                EnergyEvent(trial.end, late_loss, script_share * late_loss),
            ]
        # Joints have moved bodies: their contacts may now close again under a load.
        load_impacts = self._load_contacts(exact, step_velocities, trial)
        if load_impacts is not None:
            exact[:, 3:] = load_impacts.velocity[moving]
            trial.impacts.append(load_impacts)

    def _load_contacts(
        self, state: Array, step_velocities: Array, trial: StepTrial
    ) -> Impacts | None:
        """Return the impulses that contacts of bodies on joints lack; None without
        them.

        `state` (M, 6): after the joints; `step_velocities` (M, 3): within the step.
        The engine solves contacts and joints in turns, and so cannot carry a heavy
        load on light bodies. The rest is solved here with the joints' responses,
        without rebound.
        """
        h = trial.h
        order = trial.order
        # A contact that closes more slowly than a share of gravity's step is carried
        # well enough.
        rest_speed = self._governor.threshold(h, 0.0)
        threshold = CLOSING_SHARE * max(self._press * h, rest_speed)
        rows = self._assemblies.jointed_rows(order)
        moving = self._space.moving
        if not rows:
            return None
        if order.fastest_closing(rows, trial.numbers, moving, state) <= threshold:
            return None
        poses = self._all_poses
        velocities = self._all_velocities
        poses[moving], velocities[moving] = state[:, :3], state[:, 3:]
        numbers = order.sort(trial.numbers)
        points = contact_points(order.words, numbers, poses, velocities)
        # A load is not an impact: it must not rebound.
        no_elasticity = [0.0] * len(self._properties.elasticity)
        start_velocities = np.zeros_like(velocities)
        start_velocities[moving] = step_velocities
        solver = ImpactSolver(
            replace(self._properties, elasticity=no_elasticity),
            self._assemblies,
            StepMotion(poses, velocities, np.zeros((len(poses), 2))),
            points,
            np.ones(len(order.contacts), bool),
            h,
            threshold,
            start_velocities,
        )
        return solver.run(self.budget)

    def _restore_energy_on_curves(self, trial: StepTrial) -> None:
        """Return the energy that smooth curves took from bodies which slide on them."""
        # Chords of a curve turn the velocity by small impacts, each of which takes some
        # energy: a smooth curve takes none.
        exact = np.frombuffer(trial.states, np.float64).reshape(-1, 6).copy()
        start_state = (self.state() if trial.state is None else trial.state).copy()
        if trial.velocities_before_impacts is not None:
            start_state[:, 3:] = trial.velocities_before_impacts
        energy, lift_work = self._curves.restore(
            start_state, exact, trial.h, trial.order, trial.numbers, trial.impacts
        )
        if energy or lift_work:
            trial.events.append(EnergyEvent(trial.end, -energy, -lift_work))
            self._space.place(exact)
            trial.states = exact.tobytes()

    # The impulses of joints

    def _review_joints(self, trial: StepTrial) -> None:
        """Count the work of scripted partners of joints, and break joints."""
        if trial.is_half_step:
            duration = trial.h / 2
        else:
            duration = trial.h
        momentum = self._joint_momentum(trial, duration)
        if self._assemblies.has_scripts:
            self._count_script_work(trial, momentum)
        if self._breakages.busy and not trial.is_half_step:
            self._break_joints(trial, momentum)

    def _joint_momentum(self, trial: StepTrial, duration: float) -> JointMomentum:
        """Return the momentum by joints in a step of `duration` s."""
        old_velocities = trial.velocities_before_impacts
        if old_velocities is None:
            if trial.state is None:
                start_state = self.state()
            else:
                start_state = trial.state
            old_velocities = start_state[:, 3:]
        state = np.frombuffer(trial.states, np.float64).reshape(-1, 6)
        # The change of momentum that neither loads nor contacts explain is that by the
        # joints.
        pose, velocity = self.expand_state(state)
        change = np.zeros_like(velocity)
        change[self._space.moving] = state[:, 3:] - old_velocities
        impulse = self._breakages.joint_impulses(
            change,
            pose,
            duration,
            None if trial.load is None else trial.load.total,
            (trial.order, trial.numbers),
            trial.impacts,
        )
        return JointMomentum(pose, velocity, change, impulse)

    def _count_script_work(self, trial: StepTrial, momentum: JointMomentum) -> None:
        """Add the work of scripted partners of joints to the work of motors.

        Work that was done at once becomes events, because the mean of the velocities
        before and after the step shows only a part of it.
        """
        # Velocities in the middle of the step and of its first half: an impulse acts
        # between them.
        middle = momentum.velocity - momentum.change / 2
        early_middle = momentum.velocity - 3 / 4 * momentum.change
        script_work, double_early_work = self._assemblies.scripted_work(
            momentum.pose,
            momentum.impulse,
            np.stack([middle, early_middle]),
            bool(trial.impacts),
        )
        work = float(script_work)
        early_work = float(double_early_work) / 2
        if self.has_unchecked_contacts or trial.events:
            trial.events += [
                EnergyEvent(trial.end - JUST_BEFORE, 0.0, early_work),
                EnergyEvent(trial.end, 0.0, work - early_work),
            ]
        else:
            trial.motor_work += work

    def _break_joints(self, trial: StepTrial, momentum: JointMomentum) -> None:
        """Release the breaking joints of a step, and record their loss of energy."""
        pose = momentum.pose
        broken_joints = self._breakages.review(
            self._assemblies, pose, momentum.impulse, trial.h, bool(trial.impacts)
        )
        if not broken_joints:
            return
        for joint in broken_joints:
            self._space.release(joint)
            trial.events.append(self._forces.release(joint, pose, trial.end))
        intact_joints = tuple(j for j in self._world.joints if j not in broken_joints)
        # Without the broken joints, the groups of joined bodies are others: build them
        # anew.
        self._world = replace(self._world, joints=intact_joints)
        self._assemblies = Assemblies(self._world)
        self._jointed_bodies = self._assemblies.bodies
        self.has_unchecked_contacts = self.has_unchecked_speeds = True

    def _finish_step(self, trial: StepTrial) -> Step:
        """Make the end of a step the start of the next one, and return its record."""
        self.has_unchecked_speeds |= not self._is_calm
        # The next step needs the load of this one, to tell impacts from the usual
        # change of velocity.
        self._last_load = trial.h, trial.load, 0.5 if trial.is_half_step else 1.0
        self._last_motion = trial.velocities, self._states
        self._order = trial.order
        self._numbers = trial.numbers
        self._states = trial.states
        self.has_unchecked_contacts = False
        if trial.load is not None:
            self._forces.end(trial.load)
        # Rolling resistance of the next step follows from the normal forces of this
        # one, which are not known before.
        braking = NO_BRAKING
        resistance = self._forces.resistance
        if resistance.busy:
            braking = resistance.brakes.array, self._space.brake_impulses()
            resistance.follow(trial.order, trial.numbers, trial.h)
        return Step(
            trial.end,
            trial.h,
            trial.states,
            trial.order,
            trial.numbers,
            trial.velocities,
            trial.velocities_before_impacts,
            trial.impacts,
            trial.load,
            trial.motor_work,
            braking,
            trial.events,
        )
