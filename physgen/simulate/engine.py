"""World -> Trajectory: a leapfrog on Chipmunk's contacts, with blows of our own and steps divided where they must
be.

Positions are those of whole steps, velocities those of the middles between them (Störmer and Verlet): a half step is
taken first, so that free fall is exact. Steps never depend on the samples: both lie on their own grids.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import ceil

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.problems import InputError, Problem
from physgen.simulate.forces import (
    EnergyEvent,
    ForceFields,
    Impulses,
    ScriptedMotion,
    StepForces,
    stiffest_spring,
)
from physgen.simulate.recorder import DIVERGED_FIX, UNKNOWN_PLACE, Recorder, StepLog, recorded_trajectory
from physgen.simulate.space import CONTACT_BYTES, Space
from physgen.simulate.step_control import Governor, StepDivider
from physgen.simulate.stepper import Stepper
from physgen.simulate.trajectory import Effort, Trajectory

Array = NDArray[np.float64]

PHASE = 0.1
"""rad that the stiffest spring, or a pass by an attractor, may turn in a step."""
MOST_PARTS = 1024
"""Of a step that springs or attractors divide."""

Progress = Callable[[str, int, int], None]
"""Told the stage, samples done and samples in all."""


def silent(stage: str, done: int, total: int) -> None:
    """Progress that nobody watches."""


def never() -> bool:
    """Nobody is in a hurry."""
    return False


def simulate(
    world: World,
    times: Array | None = None,
    progress: Progress = silent,
    iterations: int | None = None,
    tape: StepLog | None = None,
) -> Trajectory:
    """Run the world and sample it at `times` (s, rising, the world's own frame times unless given).

    `iterations` fixes the contact solver's sweeps a step, which are otherwise chosen as contacts need them; a `tape`
    keeps the steps, to be sampled again. Raises InputError where a body leaves all numbers.
    """
    running = Running(world, times, iterations, tape)
    running.on(running.end, progress)
    running.rest()
    made = running.told()
    if tape is not None:
        tape.end(made.effort, running.further)
    return made


class Running:
    """A simulation under way: taken on piece by piece, however the pieces are cut, it becomes what `simulate` gives."""

    def __init__(
        self,
        world: World,
        times: Array | None = None,
        iterations: int | None = None,
        tape: StepLog | None = None,
    ) -> None:
        self.times = world.times if times is None else np.asarray(times, np.float64)
        self._run = _Run(world, self.times, iterations, tape)
        self._h = 1.0 / world.steps_per_second
        self._number = -1

    @property
    def end(self) -> float:
        """s: the last sample."""
        return float(self.times[-1]) if len(self.times) else 0.0

    @property
    def done(self) -> int:
        """Samples taken, of all."""
        return self._run.ledger.done

    def on(self, until: float, progress: Progress = silent, enough: Callable[[], bool] = never) -> None:
        """Steps from where the run stands to a time, s; fewer where it was `enough` after one of them.

        Raises InputError where a body leaves all numbers.
        """
        ledger = self._run.ledger
        with self._told_by_name():
            if self._number < 0:
                self._number = 0
                self._run.start()
            last = ceil(until / self._h - 1e-9)
            while self._number < last and not enough():
                self._number += 1
                self._run.advance((self._number - 1) * self._h, self._number * self._h)
                if self._number % 256 == 0:
                    progress("simulate", ledger.done, len(self.times))

    def read(self) -> None:
        """Take the samples up to where the run stands."""
        with self._told_by_name():
            self._run.ledger.read()

    def rest(self) -> None:
        """The same, where the run is over, or pauses for long."""
        with self._told_by_name():
            self._run.ledger.flush()

    def further(self, until: float) -> None:
        """On to a later time than the last sample's."""
        self.on(until)
        self.rest()

    def told(self) -> Trajectory:
        """What is known; samples from `done` on are not taken yet, and zeros."""
        return recorded_trajectory(self._run.ledger, self._run.effort())

    @contextmanager
    def _told_by_name(self) -> Iterator[None]:
        """What leaves all numbers is told as a Problem."""
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                yield
        except (OverflowError, np.linalg.LinAlgError) as error:
            found = f"leaves all numbers by t = {self._number * self._h:.3f} s"
            raise InputError([Problem(UNKNOWN_PLACE, "world", "the motion", found, DIVERGED_FIX)]) from error


class _Run:
    """One world in motion."""

    def __init__(self, world: World, times: Array, iterations: int | None, tape: StepLog | None) -> None:
        bodies = world.bodies
        self._world, self._tape = world, tape
        self._space = Space(world)
        self._governor = Governor(world, iterations)
        loads, self._scripts = ForceFields(world), ScriptedMotion(world)
        self._lasting = StepForces(world, self._space, loads)
        self.ledger = Recorder(world, self._space, loads, self._scripts, times)
        moving = self._space.moving
        self._row = {int(body): row for row, body in enumerate(moving)}
        self._stepper = Stepper(world, self._space, self._lasting, self._governor)
        self._kicks = Impulses(world)
        self._reach = StepDivider(world, moving)
        self._center = np.array([[*b.center, 0.0] for b in bodies]).reshape(-1, 3)
        self._gravity = float(np.hypot(*world.gravity))
        self._h = 0.0
        self._loads = loads
        self._restless = loads.busy or self._scripts.busy
        rate, name = stiffest_spring(world)
        self._stiff = max(1, ceil(rate / world.steps_per_second / PHASE))
        if self._stiff > MOST_PARTS:
            found = f"needs every step divided into {self._stiff:,} parts"
            fix = f"make it softer, what it joins heavier, or steps_per_second larger: at most {MOST_PARTS} parts"
            raise InputError([Problem(UNKNOWN_PLACE, f"joints.{name}.stiffness", "", found, fix)])
        self._divided = self._most_parts = self._reviewed = 0

    def effort(self) -> Effort:
        """What it took."""
        return Effort(
            steps=self._stepper.steps,
            divided=self._divided,
            most_parts=self._most_parts,
            iterations=self._governor.most_sweeps,
            impacts=self._stepper.impacts,
            still=self._governor.stillest(1.0 / self._world.steps_per_second),
        )

    def start(self) -> None:
        """The half step to t = 0: velocities from t = 0 to the middle of the first step."""
        world = self._world
        h = 1.0 / world.steps_per_second / self._stiff
        pose = self._center.copy()
        velocity = np.array([[*b.velocity, b.spin] for b in world.bodies]).reshape(-1, 3)
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
        state = np.concatenate([pose[moving] - velocity[moving] * h, velocity[moving]], axis=1)
        self._space.place(state)
        self._h = h
        # a whole step of half the strength: the engine's stored impulses do not bear a change of step
        self._space.weaken(0.5)
        step = self._stepper.take(0.0, h, state, kicks, first=True)
        self._space.weaken(1.0)
        if step.before is None:
            step.before = state[:, 3:].copy()
        if self._tape is not None:
            self._tape.begin(self.ledger, step, pose, shown, roll)
        self.ledger.begin(step, pose, shown, roll)

    def advance(self, begin: float, end: float) -> None:
        """A base step, in as many parts as it needs."""
        h = end - begin
        parts = self._stiff
        if not self._reach.watchful and (
            self._stepper.stirred or self._restless or self._stepper.steps % 8 == 0
        ):
            self._stepper.stirred = False
            self._reach.look(self._ahead(end, h), h * 8, self._gravity, h)
        if self._reach.watchful:
            parts = max(parts, self._reach.parts(self._ahead(end, h), h))
        if self._loads.steers:
            pose, velocity = self._center.copy(), np.zeros_like(self._center)
            state, moving = self._stepper.state(), self._space.moving
            pose[moving], velocity[moving] = state[:, :3], state[:, 3:]
            parts = max(parts, min(MOST_PARTS, ceil(self._loads.pace(pose, velocity) * h / PHASE)))
        if parts > 1:
            self._divided += 1
            self._most_parts = max(self._most_parts, parts)
        for part in range(parts):
            self._part(begin + h * part / parts, h / parts)

    def _ahead(self, end: float, h: float) -> Array:
        """The state (M, 6), scripted bodies with the fastest of this step and the next."""
        state = self._stepper.state()
        if self._scripts.busy:
            state = state.copy()
            now = state[:, 3:].copy()
            self._scripts.drive(end, h, state, self._row)
            later = state[:, 3:].copy()
            self._scripts.drive(end + h, h, state, self._row)
            state[:, :3], state[:, 3:] = self._stepper.state()[:, :3], now
            for row in self._scripts.rows(self._row):
                state[row, 3:] = max(
                    (now[row], later[row], self._last_speed(row, end, h)),
                    key=lambda v: float(np.hypot(*v[:2])),
                )
        return state

    def _last_speed(self, row: int, end: float, h: float) -> Array:
        """Of a scripted row, within the step that ends at `end`."""
        state = self._stepper.state().copy()
        self._scripts.drive(end - h, h, state, self._row)
        return state[row, 3:]

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
        if step.blows:
            self._governor.note(sum(len(blow.first) for blow in step.blows))
        if self._tape is not None:
            self._tape.add(step)
        if self.ledger.add(step):
            ledger, since = self.ledger, self._stepper.steps - self._reviewed
            self._reviewed = self._stepper.steps
            contacts = len(step.words) // CONTACT_BYTES
            self._governor.review(since, contacts, ledger.residual, ledger.overlap, h)

    def _kicked(self, begin: float, end: float, state: Array) -> list[EnergyEvent]:
        """Impulses that are given within this step, at their times, in the state (M, 6)."""
        moving, given = self._space.moving, []
        while self._kicks.due(end):
            since = self._kicks.since(begin)
            velocity, pose = np.zeros((len(self._center), 3)), self._center.copy()
            velocity[moving], pose[moving] = state[:, 3:], state[:, :3]
            given.append(self._kicks.give(velocity, pose, since))
            velocity, lost = self._stepper.fit(pose, velocity)
            given.append(EnergyEvent(begin + since, lost, 0.0))
            change = velocity[moving] - state[:, 3:]
            state[:, 3:] += change
            state[:, :3] -= change * since
        self._stepper.suspicious = self._stepper.stirred = True
        return given
