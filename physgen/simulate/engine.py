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
from dataclasses import replace
from functools import partial
from itertools import takewhile
from math import ceil, nan
from threading import Lock

import numpy as np
from numpy.typing import NDArray

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
from physgen.simulate.ramps import is_ramped
from physgen.simulate.recorder import (
    NOT_BRAKED,
    Recorder,
    Step,
)
from physgen.simulate.space import Space
from physgen.simulate.step_control import Governor, StepDivider
from physgen.simulate.trajectory import Effort, Trajectory
from physgen.simulate.wheels import fold_wheels, world_on_wheels

Index = NDArray[np.int64]

PHASE = 0.1
"""rad: largest phase of the stiffest spring, or of a pass by an attractor, in a
step.
"""
MOST_PARTS = 1024
"""Largest number of parts of a step, for springs and attractors."""
ATTEMPTS = 8
"""Largest number of trials of a step with impacts."""
ABRUPT = 8.0
"""Ratio of a velocity's change in a step to that by gravity and lasting forces.

A contact with a larger ratio changes the velocity at once, not in the course of the
step. The ratio is 1 for a body at rest on another, and below 3 if it slides or rolls.
"""
KEPT_PARTS = 64
"""Largest number of parts of a step that the next step keeps after an abrupt
contact.
"""
LEFT = 0.5
"""Closing speed that contacts of bodies on joints may keep, by gravity x step."""
HIDINGS = 4
"""Largest number of repetitions of a step for contacts at internal edges."""
JUST_BEFORE = 4e-9
"""s from an event to the first sample with it, at the end of its step."""
LOOK = 8
"""Number of steps between two searches for fast bodies."""


def simulate(
    world: World, times: Array | None = None, progress: Progress = silent
) -> Trajectory:
    """Simulate the world and sample it at `times`.

    `times`: s, rising; by default the frame times of the world. Raises InputError if a
    body leaves the range of numbers.
    """
    running = Running(world, times)
    running.on(running.end, progress)
    return running.trajectory()


def spring_parts(world: World) -> int:
    """Return the number of parts into which the stiffest spring divides every step.

    Raises InputError if it is above MOST_PARTS.
    """
    rate, name = stiffest_spring(world)
    parts = max(1, ceil(rate / world.steps_per_second / PHASE))
    if parts > MOST_PARTS:
        path = f"joints.{name}.stiffness"
        raise Message.SPRING_TOO_STIFF.error_at(
            UNKNOWN_PLACE, path, parts=parts, most_parts=MOST_PARTS
        )
    return parts


class Running:
    """A simulation that can stop and continue; its result is that of `simulate`.

    Its steps do not depend on the samples. They are stored, so that the motion can be
    sampled again at other times.
    """

    def __init__(
        self, world: World, times: Array | None = None, most: int = 64_000_000
    ) -> None:
        """Prepare the simulation; steps are stored up to `most` bytes."""
        self.times = world.times if times is None else np.asarray(times, np.float64)
        self._vehicles = world
        world = world_on_wheels(world)
        self._base = 1.0 / world.steps_per_second
        self._number = -1
        bodies = world.bodies
        self._world = world
        self._space = Space(world)
        self._governor = Governor(world)
        moving = self._space.moving
        self._loads, self._scripts = ForceFields(world), ScriptedMotion(world)
        self._lasting = StepForces(world, moving, self._loads)
        self._recorder = partial(Recorder, world, moving, self._loads, self._scripts)
        self._ledger = self._recorder(self.times)
        self._kept, self._bytes, self._most = list[tuple[Step, Effort]](), 0, most
        # Several threads may sample the same motion.
        self._lock = Lock()
        self._row = {int(body): row for row, body in enumerate(moving)}
        self._stepper = Stepper(world, self._space, self._lasting, self._governor)
        self._kicks = Impulses(world)
        self._reach = StepDivider(world, moving)
        self._center = np.array([[*b.center, 0.0] for b in bodies]).reshape(-1, 3)
        self._gravity = float(np.hypot(*world.gravity))
        self._h = 0.0
        self._restless = self._loads.busy or self._scripts.busy
        self._stiff = spring_parts(world)
        self._divided = self._most_parts = self._reviewed = 0
        self._parts = 1
        """Number of parts of the last base step."""

    @property
    def end(self) -> float:
        """Return the time of the last sample, s."""
        return float(self.times[-1]) if len(self.times) else 0.0

    @property
    def work(self) -> float:
        """Return the work so far, in steps, the same on every machine.

        A step without contacts takes about as long as 7 kB of contacts.
        """
        return self._stepper.steps + self._bytes / 7000

    @property
    def done(self) -> int:
        """Return the number of samples so far."""
        return self._ledger.done

    def on(
        self,
        until: float,
        progress: Progress = silent,
        enough: Callable[[], bool] = lambda: False,
    ) -> None:
        """Continue the simulation to the time `until`, s, or until `enough` returns
        True.

        `enough` is called before each step. Raises InputError if a body leaves the
        range of numbers.
        """
        with self._overflow_named():
            if self._number < 0:
                self._number = 0
                self._start()
            last = ceil(until / self._base - 1e-9)
            while self._number < last and not enough():
                old_number = self._number
                self._advance()
                if self._number // 256 > old_number // 256:
                    progress("simulate", self._ledger.done, len(self.times))
            self._ledger.read()

    def trajectory(self) -> Trajectory:
        """Return the motion so far; its samples from `done` on are zeros."""
        trajectory = self._ledger.trajectory(self._effort(), self.sampled)
        return fold_wheels(trajectory, self._vehicles)

    def sampled(self, times: Array) -> Trajectory:
        """Return the motion at the times `times`, s, rising, to the same bits as
        `simulate`.
        """
        # The steps may already be known: continue only as far as the times require.
        until, ledger = float(times.max(initial=0.0)), self._recorder(times)
        last = (ceil(until / self._base - 1e-9) + 1e-6) * self._base
        with self._lock:
            self.on(until, enough=lambda: self._bytes > self._most)
            records = list(takewhile(lambda kept: kept[0].time < last, self._kept))
            # Too many steps to store: simulate once more, for these times alone.
            if self._bytes > self._most:
                return simulate(self._vehicles, times)
        begin, effort = self._begun
        with self._overflow_named():
            ledger.begin(*begin)
            for step, effort in records:  # noqa: B007 - the last effort is used
                ledger.add(step)
            ledger.read()
        return fold_wheels(ledger.trajectory(effort, self.sampled), self._vehicles)

    def _effort(self) -> Effort:
        """Return the effort of the engine so far."""
        stepper, governor, fast_row = (
            self._stepper,
            self._governor,
            self._reach.overworked_by,
        )
        # Report the pair of the used up budget, or the body of the used up parts.
        pair = stepper.budget.exceeded_by or (-1, -1)
        if fast_row is not None:
            pair = int(self._space.moving[fast_row]), -1
        counts = (
            stepper.steps,
            self._divided,
            self._most_parts,
            governor.most_sweeps,
            stepper.impacts,
        )
        return Effort(*counts, governor.threshold(self._base, governor.loudest), *pair)

    @contextmanager
    def _overflow_named(self) -> Iterator[None]:
        """Raise InputError with the time of the step if numbers overflow."""
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                yield
        except (OverflowError, np.linalg.LinAlgError) as error:
            time, message = self._number * self._base, Message.MOTION_DIVERGED
            raise message.error_at(
                UNKNOWN_PLACE, "world", "the motion", time=time
            ) from error

    def _start(self) -> None:
        """Take the half step to t = 0, after which velocities are those of the first
        middle.
        """
        world = self._world
        h = self._base / self._stiff
        pose = self._center.copy()
        velocity = np.array([[*b.velocity, b.spin] for b in world.bodies]).reshape(
            -1, 3
        )
        velocity[[is_ramped(body) for body in world.bodies]] = 0.0
        roll = self._lasting.roll
        if self._scripts.busy:
            self._scripts.sample(0.0, pose, velocity)
        kicks = []
        while self._kicks.due(2e-12):
            kicks.append(self._kicks.give(velocity, pose, 0.0))
        velocity, lost_energy = self._stepper.fit(pose, velocity)
        kicks.append(EnergyEvent(0.0, lost_energy, 0.0))
        start_velocity = velocity.copy()
        moving = self._space.moving
        state = np.concatenate(
            [pose[moving] - velocity[moving] * h, velocity[moving]], axis=1
        )
        self._space.place(state)
        self._h = h
        # Take a whole step with half the gravity: the engine stores impulses of
        # contacts, which would be wrong after a change of the step's length.
        self._space.weaken(0.5)
        step = self._stepper.take(0.0, h, state, kicks, first=True)
        self._space.weaken(1.0)
        if step.before is None:
            step.before = state[:, 3:].copy()
        self._ledger.begin(step, pose, start_velocity, roll)
        self._begun = (step, pose, start_velocity, roll), self._effort()

    def _advance(self) -> None:
        """Take a base step, in as many parts as its speeds and forces require."""
        begin, end = self._number * self._base, (self._number + 1) * self._base
        h = end - begin
        parts = self._stiff
        # Compute speeds only every LOOK steps while nothing changes them at once, to
        # save
        # time in quiet scenes.
        if not self._reach.watchful and (
            self._stepper.stirred or self._restless or self._stepper.steps % LOOK == 0
        ):
            self._stepper.stirred = False
            self._reach.look(self._ahead(end, h), h * LOOK, self._gravity, h)
        if self._reach.watchful:
            parts = max(parts, self._reach.parts(self._ahead(end, h), h))
        # Near an attractor, the direction of its pull changes within a step.
        if self._loads.steers:
            pace = self._loads.pace(*self._stepper.everybody(self._stepper.state()))
            parts = max(parts, min(MOST_PARTS, ceil(pace * h / PHASE)))
        if parts < self._parts <= KEPT_PARTS and self._stepper.is_abrupt:
            # Chipmunk starts from the impulses of the last step, scaled to the new
            # step's length. The impulse of a contact that opens would thus be too large
            # in a longer step.
            parts = self._parts
        self._parts = parts
        self._number += 1
        if parts > 1:
            self._divided += 1
            self._most_parts = max(self._most_parts, parts)
        for part in range(parts):
            self._part(begin + h * part / parts, h / parts)

    def _ahead(self, end: float, h: float) -> Array:
        """Return the state (M, 6) for the search of fast bodies, in a step of h s to
        `end`.

        The velocities of scripted bodies are their fastest in this step and the next.
        """
        state = self._stepper.state()
        if self._scripts.busy:
            speeds, state = [state[:, 3:]], state.copy()
            for time in (end, end - h):
                scripted_state = state.copy()
                self._scripts.drive(time, h, scripted_state, self._row)
                speeds.append(scripted_state[:, 3:])
            for row in self._scripts.rows(self._row):
                state[row, 3:] = max(
                    (v[row] for v in speeds), key=lambda v: float(np.hypot(*v[:2]))
                )
        return state

    def _part(self, begin: float, h: float) -> None:
        """Take one part of a base step, of h s from `begin`."""
        end = begin + h
        state: Array | None = None
        if abs(h - self._h) > 1e-9 * h:
            state = self._stepper.state().copy()
            # Velocities are those at the middle of a step, which moves if its length
            # changes: carry them there with the acceleration of the last step.
            state[:, 3:] += self._stepper.pull * ((h - self._h) / (2 * self._h))
            self._h = h
        kicks: list[EnergyEvent] = []
        if self._kicks.due(end):
            state = self._stepper.state().copy() if state is None else state
            kicks = self._give_due_impulses(begin, end, state)
        if self._scripts.busy:
            state = self._stepper.state().copy() if state is None else state
            self._scripts.drive(end, h, state, self._row)
            self._stepper.suspicious |= self._scripts.jump(end - h / 2, end + h / 2)
        if state is not None:
            self._space.place(state)
        step = self._stepper.take(end, h, state, kicks)
        if step.impacts:
            self._governor.note(sum(len(impact.first) for impact in step.impacts))
        self._record(step, h)

    def _record(self, step: Step, h: float) -> None:
        """Store a step of h s, and let the governor review its results from time to
        time.
        """
        if self._ledger.add(step):
            ledger, step_count = self._ledger, self._stepper.steps - self._reviewed
            self._reviewed = self._stepper.steps
            contacts = len(step.numbers) // CONTACT_BYTES
            self._governor.review(
                step_count, contacts, ledger.residual, ledger.overlap, h
            )
        # About 600 bytes are the Python objects of a step.
        self._bytes += len(step.numbers) + 2 * len(step.states) + 600
        self._kept.append((step, self._effort()))
        if self._bytes > self._most:
            self._kept.clear()

    def _give_due_impulses(
        self, begin: float, end: float, state: Array
    ) -> list[EnergyEvent]:
        """Apply the impulses of a step from `begin` to `end` to the state (M, 6).

        Return the energy that each gives and that joints take from it.
        """
        moving, events = self._space.moving, []
        while self._kicks.due(end):
            delay = self._kicks.since(begin)
            pose, velocity = self._stepper.everybody(state)
            events.append(self._kicks.give(velocity, pose, delay))
            velocity, lost_energy = self._stepper.fit(pose, velocity)
            events.append(EnergyEvent(begin + delay, lost_energy, 0.0))
            change = velocity[moving] - state[:, 3:]
            state[:, 3:] += change
            # The engine will move the bodies with the new velocity for the whole step;
            # subtract the displacement of the time before the impulse.
            state[:, :3] -= change * delay
        self._stepper.suspicious = self._stepper.stirred = True
        return events


class Stepper:
    """The state of the engine and one step after the other."""

    def __init__(
        self, world: World, space: Space, lasting: StepForces, governor: Governor
    ) -> None:
        """Prepare the properties of bodies and walls for impacts."""
        bodies, walls = world.bodies, world.walls
        self._space, self._lasting, self._governor = space, lasting, governor
        self._dynamic = np.array([b.motion is Motion.DYNAMIC for b in bodies], bool)
        wall_zeros = [0.0] * len(walls)
        surfaces = [surface for _, surface in world.surfaces]
        self._properties = ContactProperties(
            lightness=[
                1 / b.mass if b.motion is Motion.DYNAMIC else 0.0 for b in bodies
            ]
            + wall_zeros,
            ease=[1 / b.moment if b.motion is Motion.DYNAMIC else 0.0 for b in bodies]
            + wall_zeros,
            friction=[surface.friction for surface in surfaces],
            elasticity=[surface.elasticity for surface in surfaces],
            radius=[b.radius if b.radius is not None else nan for b in bodies]
            + [nan] * len(walls),
            conveyor=[surface.conveyor for surface in surfaces],
        )
        self._reach = np.array([b.reach for b in bodies]).reshape(-1)
        self._weight = max(float(np.hypot(*world.gravity)), world.press)
        """px/s²: acceleration of bodies towards their supports."""
        self._last: tuple[float, Forces | None, float] = (0.0, None, 1.0)
        """Length of the last step, s, its lasting forces, and the factor on its
        gravity.
        """
        self.budget = WorkBudget(len(bodies))
        self._world, self._breakages = world, Breakages(world)
        self._curves = CurvedWalls(world, space.moving, Assemblies(world).bodies)
        self._joined = Assemblies(world)
        self._held = self._joined.bodies
        light, ease = self._properties.lightness, self._properties.ease
        self._inverse = np.array([light, light, ease]).T[: len(bodies)]
        self._center = np.array([[*b.center, 0.0] for b in bodies]).reshape(-1, 3)
        self._wide = np.concatenate([self._center, np.zeros((len(walls), 3))])
        self._fast = np.zeros_like(self._wide)
        self._cornered = any(b.radius is None for b in bodies)
        self._order, self._numbers, self._states = NO_CONTACTS, b"", b""
        self._calm = True
        self._within: tuple[Array | None, bytes] = np.zeros((len(space.moving), 3)), b""
        """Velocities (M, 3) within the last step, and the state before it.

        If the velocities are None, they are those of that state.
        """
        self.suspicious = self.stirred = True
        """True if velocities have changed since the last step.

        `suspicious`: any contact may close then; `stirred`: any body may be fast.
        """
        self.steps = self.impacts = 0
        """Numbers of steps and of struck points."""

    def state(self) -> Array:
        """Return the state (M, 6) of the moving bodies, read-only: px, px, rad, and per
        s.
        """
        return np.frombuffer(self._states, np.float64).reshape(-1, 6)

    def everybody(self, state: Array) -> tuple[Array, Array]:
        """Return poses and velocities (N, 3) of all bodies, given the state (M, 6) of
        the moving bodies.
        """
        if len(state) == len(self._center):
            return state[:, :3].copy(), state[:, 3:].copy()
        pose, velocity = self._center.copy(), np.zeros_like(self._center)
        pose[self._space.moving], velocity[self._space.moving] = (
            state[:, :3],
            state[:, 3:],
        )
        return pose, velocity

    @property
    def within(self) -> Array:
        """Return the velocities (M, 3) within the last step."""
        velocity, old_state = self._within
        return (
            np.frombuffer(old_state).reshape(-1, 6)[:, 3:]
            if velocity is None
            else velocity
        )

    @property
    def pull(self) -> Array:
        """Return the changes of velocity (M, 3) in the course of the last step.

        They exclude sudden changes by contacts.
        """
        change, force_change, is_abrupt = self._changes()
        return np.where(is_abrupt[:, None], force_change, change)

    @property
    def is_abrupt(self) -> bool:
        """Check whether contacts changed a velocity at once in the last step."""
        return bool(self._changes()[2].any())

    def _changes(self) -> tuple[Array, Array, Flags]:
        """Return the changes of velocity in the last step, and their abruptness.

        They are the whole change (M, 3), the part by gravity and lasting forces (M, 3),
        and whether the body was struck (M,). Bodies on joints never count as struck:
        joints change velocities as much in the course of a step.
        """
        change: Array = self.state()[:, 3:] - self.within
        moving = self._space.moving
        h, load, strength = self._last
        force_change = self._lasting.change(load, h, strength)[moving]
        reach = self._reach[moving]
        speed, usual_speed = (
            np.hypot(part[:, 0], part[:, 1]) + np.abs(part[:, 2]) * reach
            for part in (change, force_change)
        )
        is_struck = speed > ABRUPT * np.maximum(usual_speed, self._weight * h)
        is_struck[np.isin(moving, self._held)] = False
        # The half step to t = 0 changes velocities half as much as a whole step.
        return change / strength, force_change / strength, is_struck

    def fit(self, pose: Array, velocity: Array) -> tuple[Array, float]:
        """Return the velocities (N, 3) that joints allow, and the energy that they
        take.

        The energy, g·px²/s², of the other velocities is lost at once.
        """
        if not self._joined.busy:
            return velocity, 0.0
        joint_velocity = self._joined.allowed(pose, velocity)
        weight = 1 / self._inverse[self._dynamic]
        return joint_velocity, float(
            (weight * (velocity**2 - joint_velocity**2)[self._dynamic]).sum() / 2
        )

    def _begin(
        self, end: float, h: float, state: Array | None, first: bool
    ) -> tuple[Forces | None, bytes, Order, bytes]:
        """Take a first trial of the step to `end`, of h s, from the state (M, 6) if
        given.

        Return its forces and, as `Space.step`, the new states, the order of the
        contacts and their numbers.
        """
        load: Forces | None = None
        if self._lasting.pushes:
            start_state = self.state() if state is None else state
            is_free = state is None and not self._numbers and not self._joined.busy
            load = self._lasting.push(start_state, end, h, first=first, alone=is_free)
            self._push(load)
        resistance = self._lasting.resistance
        if resistance.busy:
            self._space.brake(resistance.brakes.pairs, resistance.torques)
        return load, *self._space.step(h)

    def _hides_contacts(
        self, order: Order, numbers: bytes, new: Sequence[int] | None
    ) -> bool:
        """Return whether contacts at internal edges acted, which later steps
        leave out.
        """
        if self.suspicious:
            return self._space.hide_internal_edges(None, order, numbers)
        if order is not self._order:
            pairs = pairs_with_more_contacts(order.raw, self._order.raw)
        elif new is None:
            pairs = order.pairs_turned(numbers, self._numbers)
        else:
            return False
        if not pairs:
            return False
        return self._space.hide_internal_edges(pairs, order, numbers)

    def _nudged(self, state: Array | None) -> Array:
        """Return the state (M, 6) at a step's begin with bodies moved off wrong contacts."""
        state = (self.state() if state is None else state).copy()
        moving = self._space.moving.tolist()
        for body, shift in self._space.nudges.items():
            state[moving.index(body), :2] += shift
        self._space.nudges.clear()
        return state

    def _repeat_step(
        self, h: float, state: Array | None, load: Forces | None
    ) -> tuple[bytes, Order, bytes]:
        """Repeat a step with other contacts; return the same values as `Space.step`."""
        self._space.iterations = max(
            self._space.iterations, self._governor.after_impacts
        )
        self._space.place(self.state() if state is None else state)
        if load is not None:
            self._push(load)
        return self._space.step(h)

    def _push(self, load: Forces) -> None:
        """Apply lasting forces to the bodies of the engine."""
        is_complete = len(load.total) == len(self._space.moving)
        self._space.push(load.total if is_complete else load.total[self._space.moving])

    def _new_contacts(self, order: Order, numbers: bytes) -> Sequence[int] | None:
        """Return the rows of contacts that the step before did not have.

        Return None if any contact may close: in the first step, and after jumps.
        """
        if self.suspicious or self._leaps(order, numbers):
            return None
        if order is self._order:
            return ()
        return new_contacts(order.raw, self._order.raw)

    def _leaps(self, order: Order, numbers: bytes) -> bool:
        """Check whether a contact of corners has jumped to another place."""
        old_numbers = self._numbers
        if not self._cornered or not numbers or len(numbers) != len(old_numbers):
            return False
        if order is not self._order:
            numbers, old_numbers = order.sort(numbers), self._order.sort(old_numbers)
        return contacts_jumped(numbers, old_numbers, order.places)

    def take(
        self,
        end: float,
        h: float,
        state: Array | None,
        kicks: list[EnergyEvent],
        first: bool = False,
    ) -> Step:
        """Take a step of h s to `end`, and repeat it with other velocities after
        impacts.

        `state` (M, 6): as it was placed in the engine, if it was; `first`: the half
        step to t = 0.
        """
        before = None if state is None else state[:, 3:].copy()
        original: Array | None = None
        impacts: list[Impacts] = []
        # In a crowd, a first trial with one sweep finds the impacts at a fraction of
        # the cost.
        probing = self._governor.crowded and not self._calm
        if probing and state is None:
            state = self.state().copy()
        self._space.iterations = 1 if probing else self._governor.sweeps
        for attempt in range(ATTEMPTS):
            load, states, order, numbers = self._begin(end, h, state, first)
            impact = None
            # Contacts that still close in the last trial do not bounce.
            new = self._new_contacts(order, numbers)
            for _ in range(HIDINGS):
                if not self._hides_contacts(order, numbers, new):
                    break
                if self._space.nudges:
                    state = self._nudged(state)
                states, order, numbers = self._repeat_step(h, state, load)
                new = self._new_contacts(order, numbers)
            if attempt < ATTEMPTS - 1 and (new is None or new):
                if state is None:
                    state = self.state().copy()
                after = np.frombuffer(states, np.float64).reshape(-1, 6)
                motion = after[:, :3], state[:, 3:]
                impact = self._strike(*motion, order, numbers, h, new, first, load)
            if impact is None and not probing:
                break
            assert state is not None
            # Continue from the velocities after the impacts. The start is moved such
            # that the step ends at the place of a body that bounced within it.
            if impact is not None:
                if original is None:
                    original = state[:, 3:].copy()
                impacts.append(impact)
                self.impacts += len(impact.first)
                moving = self._space.moving
                state[:, 3:] = impact.velocity[moving]
                before = state[:, 3:].copy()
                state[:, :3] = after[:, :3] + impact.shift[moving] - before * h
            self._space.iterations = (
                self._governor.sweeps
                if impact is None
                else self._governor.after_impacts
            )
            probing = False
            self._space.place(state)
        if self._space.hidden:
            self._space.review_internal_edges()
        self.steps += 1
        self.budget.grant(h)
        self._calm = original is None
        driven = 0.0
        if self._joined.busy or (state is not None and not self._calm):
            exact = np.frombuffer(states, np.float64).reshape(-1, 6).copy()
            if state is not None and not self._calm:
                # The first trial corrected overlaps that do not exist after the
                # impacts.
                exact[:, :3] = state[:, :3] + state[:, 3:] * h
            if self._joined.busy:
                strength = 0.5 if first else 1.0  # of the motors
                begun_all = None
                if self._joined.has_bounds:
                    begun = self.state() if before is None else before
                    begun_all = np.zeros_like(self._center)
                    begun_all[self._space.moving] = begun[:, -3:]
                held = self._joined.hold(*self.everybody(exact), h, strength, begun_all)
                driven, moving = held.work, self._space.moving
                exact[:, 3:] = held.velocity[moving]
                if held.lost:
                    exact[:, :3] += held.shift[moving]
                    late_loss = held.lost - held.early
                    led_share = held.led / held.lost
                    kicks += [
                        EnergyEvent(
                            end - JUST_BEFORE, held.early, led_share * held.early
                        ),
                        EnergyEvent(end, late_loss, led_share * late_loss),
                    ]
                # Joints have moved bodies: their contacts may now close again under a
                # load.
                step_velocity = self.state()[:, 3:] if before is None else before
                load_impacts = self._carry(exact, step_velocity, order, numbers, h)
                if load_impacts is not None:
                    exact[:, 3:] = load_impacts.velocity[moving]
                    impacts.append(load_impacts)
            self._space.place(exact)
            states = exact.tobytes()
        if self._curves.busy:
            exact = np.frombuffer(states, np.float64).reshape(-1, 6).copy()
            started = (self.state() if state is None else state).copy()
            if original is not None:
                started[:, 3:] = original
            given, lifted = self._curves.restore(
                started, exact, h, order, numbers, impacts
            )
            if given or lifted:
                kicks.append(EnergyEvent(end, -given, -lifted))
                self._space.place(exact)
                states = exact.tobytes()
        if (self._joined.has_scripts or self._breakages.busy) and len(self._states):
            entry = original
            if entry is None:
                entry = (self.state() if state is None else state)[:, 3:]
            contacts = order, numbers
            if self._joined.has_scripts:
                span = h / 2 if first else h
                script_work, early_work = self._scripted_work(
                    entry, states, span, load, contacts, impacts
                )
                if self.suspicious or kicks:
                    # The work was done at once, so that the mean of both velocities
                    # shows only a part.
                    kicks += [
                        EnergyEvent(end - JUST_BEFORE, 0.0, early_work),
                        EnergyEvent(end, 0.0, script_work - early_work),
                    ]
                else:
                    driven += script_work
            if self._breakages.busy and not first:
                kicks += self._break(entry, states, end, h, load, contacts, impacts)
        if self._space.parting:
            self._space.separate_broken()
        self.stirred |= not self._calm
        self._last = h, load, 0.5 if first else 1.0
        self._within = before, self._states
        self._order, self._numbers, self._states, self.suspicious = (
            order,
            numbers,
            states,
            False,
        )
        braking, resistance = NOT_BRAKED, self._lasting.resistance
        if load is not None:
            self._lasting.end(load)
        if resistance.busy:
            braking = resistance.brakes.array, self._space.braked()
            resistance.follow(order, numbers, h)
        return Step(
            end,
            h,
            states,
            order,
            numbers,
            before,
            original,
            impacts,
            load,
            driven,
            braking,
            kicks,
        )

    def _scripted_work(
        self,
        begun: Array,
        states: bytes,
        h: float,
        load: Forces | None,
        contacts: tuple[Order, bytes],
        impacts: list[Impacts],
    ) -> tuple[float, float]:
        """Return the work of scripted partners of joints in a step, g·px²/s².

        `begun` (M, 3): velocities before the step. The second value is the part of the
        work that the mean of the velocities before and after shows.
        """
        state = np.frombuffer(states, np.float64).reshape(-1, 6)
        pose, change = self.everybody(
            np.concatenate([state[:, :3], state[:, 3:] - begun], axis=1)
        )
        _, after = self.everybody(state)
        total = None if load is None else load.total
        impulse = self._breakages.unexplained(change, pose, h, total, contacts, impacts)
        speeds = np.stack([after - change / 2, after - 3 / 4 * change])
        work, double_early = self._joined.scripted_work(
            pose, impulse, speeds, bool(impacts)
        )
        return float(work), float(double_early) / 2

    def _break(
        self,
        begun: Array,
        states: bytes,
        end: float,
        h: float,
        load: Forces | None,
        contacts: tuple[Order, bytes],
        impacts: list[Impacts],
    ) -> list[EnergyEvent]:
        """Release the breaking joints of a step; return their loss of energy.

        `begun` (M, 3): velocities before the step.
        """
        state = np.frombuffer(states, np.float64).reshape(-1, 6)
        pose, change = self.everybody(
            np.concatenate([state[:, :3], state[:, 3:] - begun], axis=1)
        )
        total = None if load is None else load.total
        breakages = self._breakages
        impulse = breakages.unexplained(change, pose, h, total, contacts, impacts)
        blow = bool(impacts)
        broken_joints = breakages.review(self._joined, pose, impulse, h, blow)
        if not broken_joints:
            return []
        for joint in broken_joints:
            self._space.release(joint)
        events = [self._lasting.release(joint, pose, end) for joint in broken_joints]
        whole_joints = tuple(j for j in self._world.joints if j not in broken_joints)
        self._world = replace(self._world, joints=whole_joints)
        self._joined = Assemblies(self._world)
        self._held = self._joined.bodies
        self.suspicious = self.stirred = True
        return events

    def _carry(
        self, state: Array, within: Array, order: Order, numbers: bytes, h: float
    ) -> Impacts | None:
        """Return the impulses that contacts of bodies on joints lack; None without
        them.

        `state` (M, 6): after the joints; `within` (M, 3): velocities within the step.
        The engine solves contacts and joints in turns, and so cannot carry a heavy
        load on light bodies. The rest is solved here with the joints' responses,
        without rebound.
        """
        threshold = LEFT * max(self._weight * h, self._governor.threshold(h, 0.0))
        rows = self._joined.rows_held(order)
        moving = self._space.moving
        if not rows or order.fastest_closing(rows, numbers, moving, state) <= threshold:
            return None
        poses, velocities = self._wide, self._fast
        poses[moving], velocities[moving] = state[:, :3], state[:, 3:]
        points = contact_points(order.words, order.sort(numbers), poses, velocities)
        no_elasticity = [0.0] * len(self._properties.elasticity)
        start_velocities = np.zeros_like(velocities)
        start_velocities[moving] = within
        solver = ImpactSolver(
            replace(self._properties, elasticity=no_elasticity),
            self._joined,
            StepMotion(poses, velocities, np.zeros((len(poses), 2))),
            points,
            np.ones(len(order.listed), bool),
            h,
            threshold,
            start_velocities,
        )
        return solver.run(self.budget)

    def _strike(
        self,
        pose: Array,
        velocity: Array,
        order: Order,
        numbers: bytes,
        h: float,
        new: Sequence[int] | None,
        first: bool,
        load: Forces | None,
    ) -> Impacts | None:
        """Return the impacts of a step, or None.

        `pose` (M, 3): at the end of the step; `velocity` (M, 3): within it; `new`: rows
        of contacts that did not touch before, or None if any contact may close.
        Contacts that touched before do not bounce; only their remaining closing speed
        is removed.
        """
        threshold = self._governor.threshold(h, self._governor.loud)
        poses, velocities = self._wide, self._fast
        poses[self._space.moving], velocities[self._space.moving] = pose, velocity
        words, numbers = order.words, order.sort(numbers)
        points = contact_points(words, numbers, poses, velocities)
        if not (points.closing > threshold).any():
            return None
        old_words = words if first else self._order.words
        has_touched = np.ones(len(order.listed), bool)
        has_touched[[*new_contacts(words, old_words)]] = False
        if new is not None:
            points.closing[has_touched[points.row]] = 0.0
            if not (points.closing > threshold).any():
                return None
        # Only a free body falls further before its impact; contacts and
        # joints carry the weight of all others.
        drift = np.zeros((len(poses), 2))
        drift[: len(self._dynamic)] = self._lasting.drift(load)
        drift[np.frombuffer(old_words, np.int64).reshape(-1, WORDS)[:, :2]] = 0.0
        drift[self._held] = 0.0
        motion = StepMotion(poses, velocities, drift)
        solver = ImpactSolver(
            self._properties, self._joined, motion, points, has_touched, h, threshold
        )
        return solver.run(self.budget)
