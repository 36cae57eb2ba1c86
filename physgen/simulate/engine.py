"""World to Trajectory: a leapfrog on Chipmunk's contacts, with impacts of our own and steps divided where needed.

Positions are those of whole steps, velocities those of the middles between them (Störmer and Verlet): a half step is
taken first, so that free fall is exact. Steps never depend on the samples: both lie on their own grids. `Space` finds
contacts and solves normal forces, friction and joints. Bounces are computed in `collisions`, because Chipmunk solves
all contacts of a step at once, which sends the first of a row of balls back.
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
"""rad that the stiffest spring, or a pass by an attractor, may turn in a step."""
MOST_PARTS = 1024
"""Of a step that springs or attractors divide."""
ATTEMPTS = 8
"""Times that a step is taken again because impacts changed what it does."""
ABRUPT = 8.0
"""Times the change by gravity and lasting forces in a step: contacts that change a velocity by more do so at once,
and not in the course of the step. A body at rest on another is at 1, one that slides or rolls below 3."""
KEPT_PARTS = 64
"""Parts of a step that the next one keeps after an abrupt contact, at most: more would take long."""
LEFT = 0.5
"""Closing speed, in units of gravity x step, that contacts of bodies on joints may keep."""
HIDINGS = 4
"""Times that a step is taken again because contacts at internal edges acted in it."""
JUST_BEFORE = 4e-9
"""s by which an event is earlier than the sample at a step's end that shows it."""
LOOK = 8
"""Steps after which speeds are looked at again."""


def simulate(
    world: World, times: Array | None = None, progress: Progress = silent
) -> Trajectory:
    """Run the world and sample it at `times` (s, rising, the world's own frame times unless given).

    Raises InputError where a body leaves all numbers.
    """
    running = Running(world, times)
    running.on(running.end, progress)
    return running.trajectory()


def spring_parts(world: World) -> int:
    """Return into how many parts the stiffest spring divides every step.

    Raises InputError if they are more than MOST_PARTS.
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
    """A simulation under way: taken on piece by piece, however the pieces are cut, it becomes what `simulate` gives.

    Its steps do not depend on the samples: they are kept, to be read again at other times.
    """

    def __init__(
        self, world: World, times: Array | None = None, most: int = 64_000_000
    ) -> None:
        """A run whose steps take more than `most` bytes is not kept."""
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
        self._lock = Lock()  # motions are read in several threads
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
        """Parts of the last base step."""

    @property
    def end(self) -> float:
        """s: the last sample."""
        return float(self.times[-1]) if len(self.times) else 0.0

    @property
    def work(self) -> float:
        """A measure of the work so far that is the same on every machine: steps, with contacts as parts of a step.

        A step without contacts takes about as long as 7 kB of contacts.
        """
        return self._stepper.steps + self._bytes / 7000

    @property
    def done(self) -> int:
        """Samples taken, of all."""
        return self._ledger.done

    def on(
        self,
        until: float,
        progress: Progress = silent,
        enough: Callable[[], bool] = lambda: False,
    ) -> None:
        """Steps from where the run stands to a time, s; fewer where `enough`, asked before each step, says so.

        Raises InputError where a body leaves all numbers.
        """
        with self._overflow_named():
            if self._number < 0:
                self._number = 0
                self._start()
            last = ceil(until / self._base - 1e-9)
            while self._number < last and not enough():
                before = self._number
                self._advance()
                if self._number // 256 > before // 256:
                    progress("simulate", self._ledger.done, len(self.times))
            self._ledger.read()

    def trajectory(self) -> Trajectory:
        """What is known; samples from `done` on are not taken yet, and zeros."""
        known = self._ledger.trajectory(self._effort(), self.sampled)
        return fold_wheels(known, self._vehicles)

    def sampled(self, times: Array) -> Trajectory:
        """The motion at these times, s, rising, bit for bit as `simulate` gives it."""
        until, ledger = float(times.max(initial=0.0)), self._recorder(times)
        last = (ceil(until / self._base - 1e-9) + 1e-6) * self._base
        with self._lock:
            self.on(until, enough=lambda: self._bytes > self._most)
            kept = list(takewhile(lambda kept: kept[0].time < last, self._kept))
            if self._bytes > self._most:
                return simulate(self._vehicles, times)
        begin, effort = self._begun
        with self._overflow_named():
            ledger.begin(*begin)
            for step, effort in kept:  # noqa: B007 - the last one's counts
                ledger.add(step)
            ledger.read()
        return fold_wheels(ledger.trajectory(effort, self.sampled), self._vehicles)

    def _effort(self) -> Effort:
        stepper, governor, alone = (
            self._stepper,
            self._governor,
            self._reach.overworked_by,
        )
        pair = stepper.budget.exceeded_by or (-1, -1)
        if alone is not None:
            pair = int(self._space.moving[alone]), -1
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
        """Raises InputError where numbers overflow."""
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                yield
        except (OverflowError, np.linalg.LinAlgError) as error:
            time, diverged = self._number * self._base, Message.MOTION_DIVERGED
            raise diverged.error_at(
                UNKNOWN_PLACE, "world", "the motion", time=time
            ) from error

    def _start(self) -> None:
        """The half step to t = 0: velocities from t = 0 to the middle of the first step."""
        world = self._world
        h = self._base / self._stiff
        pose = self._center.copy()
        velocity = np.array([[*b.velocity, b.spin] for b in world.bodies]).reshape(
            -1, 3
        )
        roll = self._lasting.roll
        if self._scripts.busy:
            self._scripts.sample(0.0, pose, velocity)
        kicks = []
        while self._kicks.due(2e-12):
            kicks.append(self._kicks.give(velocity, pose, 0.0))
        velocity, lost = self._stepper.fit(pose, velocity)
        kicks.append(EnergyEvent(0.0, lost, 0.0))
        shown = velocity.copy()
        moving = self._space.moving
        state = np.concatenate(
            [pose[moving] - velocity[moving] * h, velocity[moving]], axis=1
        )
        self._space.place(state)
        self._h = h
        # a whole step of half the strength: the engine's stored impulses do not bear a change of step
        self._space.weaken(0.5)
        step = self._stepper.take(0.0, h, state, kicks, first=True)
        self._space.weaken(1.0)
        if step.before is None:
            step.before = state[:, 3:].copy()
        self._ledger.begin(step, pose, shown, roll)
        self._begun = (step, pose, shown, roll), self._effort()

    def _advance(self) -> None:
        """A base step, in as many parts as it needs."""
        begin, end = self._number * self._base, (self._number + 1) * self._base
        h = end - begin
        parts = self._stiff
        if not self._reach.watchful and (
            self._stepper.stirred or self._restless or self._stepper.steps % LOOK == 0
        ):
            self._stepper.stirred = False
            self._reach.look(self._ahead(end, h), h * LOOK, self._gravity, h)
        if self._reach.watchful:
            parts = max(parts, self._reach.parts(self._ahead(end, h), h))
        if self._loads.steers:
            pace = self._loads.pace(*self._stepper.everybody(self._stepper.state()))
            parts = max(parts, min(MOST_PARTS, ceil(pace * h / PHASE)))
        if parts < self._parts <= KEPT_PARTS and self._stepper.is_abrupt:
            # Chipmunk starts from the last step's impulses and scales them by the change of the step's length: of a
            # contact that opens, the excess stays.
            parts = self._parts
        self._parts = parts
        self._number += 1
        if parts > 1:
            self._divided += 1
            self._most_parts = max(self._most_parts, parts)
        for part in range(parts):
            self._part(begin + h * part / parts, h / parts)

    def _ahead(self, end: float, h: float) -> Array:
        """The state (M, 6), scripted bodies with the fastest of this step and the next."""
        state = self._stepper.state()
        if self._scripts.busy:
            speeds, state = [state[:, 3:]], state.copy()
            for time in (end, end - h):
                driven = state.copy()
                self._scripts.drive(time, h, driven, self._row)
                speeds.append(driven[:, 3:])
            for row in self._scripts.rows(self._row):
                state[row, 3:] = max(
                    (v[row] for v in speeds), key=lambda v: float(np.hypot(*v[:2]))
                )
        return state

    def _part(self, begin: float, h: float) -> None:
        end = begin + h
        state: Array | None = None
        if abs(h - self._h) > 1e-9 * h:
            state = self._stepper.state().copy()
            # velocities belong to the middle of a step: carry them to the middle of one of another length
            state[:, 3:] += self._stepper.pull * ((h - self._h) / (2 * self._h))
            self._h = h
        kicks: list[EnergyEvent] = []
        if self._kicks.due(end):
            state = self._stepper.state().copy() if state is None else state
            kicks = self._kicked(begin, end, state)
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
        if self._ledger.add(step):
            ledger, since = self._ledger, self._stepper.steps - self._reviewed
            self._reviewed = self._stepper.steps
            contacts = len(step.numbers) // CONTACT_BYTES
            self._governor.review(since, contacts, ledger.residual, ledger.overlap, h)
        self._bytes += len(step.numbers) + 2 * len(step.states) + 600  # of Python's own
        self._kept.append((step, self._effort()))
        if self._bytes > self._most:
            self._kept.clear()

    def _kicked(self, begin: float, end: float, state: Array) -> list[EnergyEvent]:
        """Impulses that are given within this step, at their times, in the state (M, 6)."""
        moving, given = self._space.moving, []
        while self._kicks.due(end):
            since = self._kicks.since(begin)
            pose, velocity = self._stepper.everybody(state)
            given.append(self._kicks.give(velocity, pose, since))
            velocity, lost = self._stepper.fit(pose, velocity)
            given.append(EnergyEvent(begin + since, lost, 0.0))
            change = velocity[moving] - state[:, 3:]
            state[:, 3:] += change
            state[:, :3] -= change * since
        self._stepper.suspicious = self._stepper.stirred = True
        return given


class Stepper:
    """Takes one step after the other."""

    def __init__(
        self, world: World, space: Space, lasting: StepForces, governor: Governor
    ) -> None:
        bodies, walls = world.bodies, world.walls
        self._space, self._lasting, self._governor = space, lasting, governor
        self._dynamic = np.array([b.motion is Motion.DYNAMIC for b in bodies], bool)
        nothing = [0.0] * len(walls)
        surfaces = [surface for _, surface in world.surfaces]
        self._properties = ContactProperties(
            lightness=[
                1 / b.mass if b.motion is Motion.DYNAMIC else 0.0 for b in bodies
            ]
            + nothing,
            ease=[1 / b.moment if b.motion is Motion.DYNAMIC else 0.0 for b in bodies]
            + nothing,
            friction=[surface.friction for surface in surfaces],
            elasticity=[surface.elasticity for surface in surfaces],
            radius=[b.radius if b.radius is not None else nan for b in bodies]
            + [nan] * len(walls),
            conveyor=[surface.conveyor for surface in surfaces],
        )
        self._reach = np.array([b.reach for b in bodies]).reshape(-1)
        self._weight = max(float(np.hypot(*world.gravity)), world.press)
        """px/s² that presses bodies together."""
        self._last: tuple[float, Forces | None, float] = (0.0, None, 1.0)
        """s of the last step, its lasting forces, and the part of gravity that acted."""
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
        """Velocities within the last step; None: those of the state before it."""
        self.suspicious = self.stirred = True
        """Whether velocities were changed since the last step: what touches may close, what was slow may be fast."""
        self.steps = self.impacts = 0
        """Steps taken, and points struck."""

    def state(self) -> Array:
        """(M, 6) of the bodies that move, read-only."""
        return np.frombuffer(self._states, np.float64).reshape(-1, 6)

    def everybody(self, state: Array) -> tuple[Array, Array]:
        """Poses and velocities (N, 3) of all bodies where the state (M, 6) is that of those that move."""
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
        """(M, 3): velocities within the last step."""
        velocity, before = self._within
        return (
            np.frombuffer(before).reshape(-1, 6)[:, 3:]
            if velocity is None
            else velocity
        )

    @property
    def pull(self) -> Array:
        """(M, 3): change of the velocities in the course of the last step, without what contacts gave at once."""
        change, lasting, abrupt = self._changes()
        return np.where(abrupt[:, None], lasting, change)

    @property
    def is_abrupt(self) -> bool:
        """Whether contacts changed a velocity at once in the last step."""
        return bool(self._changes()[2].any())

    def _changes(self) -> tuple[Array, Array, Flags]:
        """Return what the last step changed (M, 3), gravity's and lasting forces' part of it, and who was struck (M,).

        Bodies that joints hold are never struck: joints change velocities as much in the course of a step.
        """
        change: Array = self.state()[:, 3:] - self.within
        moving = self._space.moving
        h, load, strength = self._last
        lasting = self._lasting.change(load, h, strength)[moving]
        reach = self._reach[moving]
        speed, usual = (
            np.hypot(part[:, 0], part[:, 1]) + np.abs(part[:, 2]) * reach
            for part in (change, lasting)
        )
        abrupt = speed > ABRUPT * np.maximum(usual, self._weight * h)
        abrupt[np.isin(moving, self._held)] = False
        # the half step to t = 0 changes half as much as a step of its length
        return change / strength, lasting / strength, abrupt

    def fit(self, pose: Array, velocity: Array) -> tuple[Array, float]:
        """Velocities (N, 3) that joints allow, and the energy of what they forbid, which is lost at once."""
        if not self._joined.busy:
            return velocity, 0.0
        allowed = self._joined.allowed(pose, velocity)
        weight = 1 / self._inverse[self._dynamic]
        return allowed, float(
            (weight * (velocity**2 - allowed**2)[self._dynamic]).sum() / 2
        )

    def _begin(
        self, end: float, h: float, state: Array | None, first: bool
    ) -> tuple[Forces | None, bytes, Order, bytes]:
        """Take the step to `end` as things are, or as the state (M, 6) that was placed.

        Its forces; the states, contacts and their numbers that they led to.
        """
        load: Forces | None = None
        if self._lasting.pushes:
            placed = self.state() if state is None else state
            alone = state is None and not self._numbers and not self._joined.busy
            load = self._lasting.push(placed, end, h, first=first, alone=alone)
            self._push(load)
        resistance = self._lasting.resistance
        if resistance.busy:
            self._space.brake(resistance.brakes.pairs, resistance.torques)
        return load, *self._space.step(h)

    def _hides_contacts(
        self, order: Order, numbers: bytes, new: Sequence[int] | None
    ) -> bool:
        """Return whether contacts at internal edges acted, which later steps leave out."""
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

    def _again(
        self, h: float, state: Array | None, load: Forces | None
    ) -> tuple[bytes, Order, bytes]:
        """Take a step again, with other contacts; returns as `Space.step` does."""
        self._space.iterations = max(
            self._space.iterations, self._governor.after_impacts
        )
        self._space.place(self.state() if state is None else state)
        if load is not None:
            self._push(load)
        return self._space.step(h)

    def _push(self, load: Forces) -> None:
        every = len(load.total) == len(self._space.moving)
        self._space.push(load.total if every else load.total[self._space.moving])

    def _new_contacts(self, order: Order, numbers: bytes) -> Sequence[int] | None:
        """Return rows of contacts that the step before did not have; None if all may close.

        The first step is one of those after which all may close.
        """
        if self.suspicious or self._leaps(order, numbers):
            return None
        if order is self._order:
            return ()
        return new_contacts(order.raw, self._order.raw)

    def _leaps(self, order: Order, numbers: bytes) -> bool:
        """Whether a contact is elsewhere at once."""
        before = self._numbers
        if not self._cornered or not numbers or len(numbers) != len(before):
            return False
        if order is not self._order:
            numbers, before = order.sort(numbers), self._order.sort(before)
        return contacts_jumped(numbers, before, order.places)

    def take(
        self,
        end: float,
        h: float,
        state: Array | None,
        kicks: list[EnergyEvent],
        first: bool = False,
    ) -> Step:
        """Step to the time `end`; again, with other velocities, where impacts fall. state (M, 6): as placed."""
        before = None if state is None else state[:, 3:].copy()
        original: Array | None = None
        impacts: list[Impacts] = []
        probing = self._governor.crowded and not self._calm
        if probing and state is None:
            state = self.state().copy()
        self._space.iterations = 1 if probing else self._governor.sweeps
        for attempt in range(ATTEMPTS):
            load, states, order, numbers = self._begin(end, h, state, first)
            impact = None
            # the last try is taken as it comes: what still closes then does not bounce
            new = self._new_contacts(order, numbers)
            for _ in range(HIDINGS):
                if not self._hides_contacts(order, numbers, new):
                    break
                if self._space.nudges:
                    state = self._nudged(state)
                states, order, numbers = self._again(h, state, load)
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
                # the first try pushed overlaps apart that the impacts have undone
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
                    late = held.lost - held.early
                    part = held.led / held.lost
                    kicks += [
                        EnergyEvent(end - JUST_BEFORE, held.early, part * held.early),
                        EnergyEvent(end, late, part * late),
                    ]
                within = self.state()[:, 3:] if before is None else before
                carried = self._carry(exact, within, order, numbers, h)
                if carried is not None:
                    exact[:, 3:] = carried.velocity[moving]
                    impacts.append(carried)
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
                led, early = self._scripted_work(
                    entry, states, span, load, contacts, impacts
                )
                if self.suspicious or kicks:
                    # at once: the mean of the velocities shows a part of it
                    kicks += [
                        EnergyEvent(end - JUST_BEFORE, 0.0, early),
                        EnergyEvent(end, 0.0, led - early),
                    ]
                else:
                    driven += led
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
        braked, resistance = NOT_BRAKED, self._lasting.resistance
        if load is not None:
            self._lasting.end(load)
        if resistance.busy:
            braked = resistance.brakes.array, self._space.braked()
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
            braked,
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
        """Return what scripted partners of joints did in a step that began with the velocities `begun` (M, 3).

        And the part of it that the mean of the velocities before and after shows.
        """
        state = np.frombuffer(states, np.float64).reshape(-1, 6)
        pose, change = self.everybody(
            np.concatenate([state[:, :3], state[:, 3:] - begun], axis=1)
        )
        _, after = self.everybody(state)
        total = None if load is None else load.total
        impulse = self._breakages.unexplained(change, pose, h, total, contacts, impacts)
        speeds = np.stack([after - change / 2, after - 3 / 4 * change])
        led, early = self._joined.scripted_work(pose, impulse, speeds, bool(impacts))
        return float(led), float(early) / 2

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
        """Let joints go that broke in a step that began with the velocities `begun` (M, 3)."""
        state = np.frombuffer(states, np.float64).reshape(-1, 6)
        pose, change = self.everybody(
            np.concatenate([state[:, :3], state[:, 3:] - begun], axis=1)
        )
        total = None if load is None else load.total
        breakages = self._breakages
        impulse = breakages.unexplained(change, pose, h, total, contacts, impacts)
        blow = bool(impacts)
        broken = breakages.review(self._joined, pose, impulse, h, blow)
        if not broken:
            return []
        for joint in broken:
            self._space.release(joint)
        lost = [self._lasting.release(joint, pose, end) for joint in broken]
        whole = tuple(j for j in self._world.joints if j not in broken)
        self._world = replace(self._world, joints=whole)
        self._joined = Assemblies(self._world)
        self._held = self._joined.bodies
        self.suspicious = self.stirred = True
        return lost

    def _carry(
        self, state: Array, within: Array, order: Order, numbers: bytes, h: float
    ) -> Impacts | None:
        """Return what contacts of bodies that joints hold lack, given the state (M, 6) that joints leave.

        within: (M, 3) velocities within the step.

        The engine solves contacts and joints in turns, which carries no heavy load on
        light bodies; the rest is solved with the joints' responses, without rebound.
        """
        least = LEFT * max(self._weight * h, self._governor.threshold(h, 0.0))
        rows = self._joined.rows_held(order)
        moving = self._space.moving
        if not rows or order.fastest_closing(rows, numbers, moving, state) <= least:
            return None
        wide, fast = self._wide, self._fast
        wide[moving], fast[moving] = state[:, :3], state[:, 3:]
        points = contact_points(order.words, order.sort(numbers), wide, fast)
        nothing = [0.0] * len(self._properties.elasticity)
        begun = np.zeros_like(fast)
        begun[moving] = within
        solver = ImpactSolver(
            replace(self._properties, elasticity=nothing),
            self._joined,
            StepMotion(wide, fast, np.zeros((len(wide), 2))),
            points,
            np.ones(len(order.listed), bool),
            h,
            least,
            begun,
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
        """What closes at the step's end, given the poses (M, 3) then and the velocities (M, 3) on the way.

        What touched before closes by what the solver left undone, and does not bounce. `new`: rows of contacts that did
        not touch; None: velocities or corners jumped, and all may close.
        """
        threshold = self._governor.threshold(h, self._governor.loud)
        wide, fast = self._wide, self._fast
        wide[self._space.moving], fast[self._space.moving] = pose, velocity
        words, numbers = order.words, order.sort(numbers)
        points = contact_points(words, numbers, wide, fast)
        if not (points.closing > threshold).any():
            return None
        were = words if first else self._order.words
        touched = np.ones(len(order.listed), bool)
        touched[[*new_contacts(words, were)]] = False
        if new is not None:
            points.closing[touched[points.row]] = 0.0
            if not (points.closing > threshold).any():
                return None
        drift = np.zeros((len(wide), 2))
        drift[: len(self._dynamic)] = self._lasting.drift(load)
        drift[np.frombuffer(were, np.int64).reshape(-1, WORDS)[:, :2]] = 0.0
        drift[self._held] = 0.0
        motion = StepMotion(wide, fast, drift)
        solver = ImpactSolver(
            self._properties, self._joined, motion, points, touched, h, threshold
        )
        return solver.run(self.budget)
