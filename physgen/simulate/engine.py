"""World -> Trajectory: a leapfrog on Chipmunk's contacts, with blows of our own and steps divided where they must be.

Positions are those of whole steps, velocities those of the middles between them (Störmer and Verlet): a half step is
taken first, so that free fall is exact. Steps never depend on the samples: both lie on their own grids.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, nan

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.scene.model import Load, Motion
from physgen.simulate.chipmunk import CONTACT_BYTES, Chipmunk, leapt, places
from physgen.simulate.divide import Reach
from physgen.simulate.governor import Governor
from physgen.simulate.impacts import Blows, Things, strike
from physgen.simulate.joined import Assemblies
from physgen.simulate.lasting import Lasting, Settled
from physgen.simulate.lasting import Load as Lasted
from physgen.simulate.ledger import Ledger, Step
from physgen.simulate.loads import Loads
from physgen.simulate.points import contact_points
from physgen.simulate.scripts import Scripts
from physgen.simulate.trajectory import Effort, Trajectory

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

ATTEMPTS = 24
"""Times that a step is taken again because blows changed what it does."""
PHASE = 0.2
"""rad that the stiffest spring may turn in a step."""

NOTHING = Settled(0.0, 0.0, None)

Progress = Callable[[str, int, int], None]
"""Told the stage, samples done and samples in all."""


def silent(stage: str, done: int, total: int) -> None:
    """Progress that nobody watches."""


def simulate(
    world: World, times: Array | None = None, progress: Progress = silent, iterations: int | None = None
) -> Trajectory:
    """Run the world and sample it at `times` (s, rising, the world's own frame times unless given).

    `iterations` fixes the contact solver's sweeps a step, which are otherwise chosen as contacts need them. Raises
    InputError where a body leaves all numbers.
    """
    times = world.times if times is None else np.asarray(times, np.float64)
    run = _Run(world, times, iterations)
    ledger, h = run.ledger, 1.0 / world.steps_per_second
    with np.errstate(over="ignore", invalid="ignore"):  # what leaves all numbers is told by name
        run.start()
        last = ceil(float(times[-1]) / h - 1e-9) if len(times) else 0
        for number in range(1, last + 1):
            run.advance((number - 1) * h, number * h)
            if number % 256 == 0:
                progress("simulate", ledger.done, len(times))
        ledger.flush()
    return Trajectory(
        times=times,
        names=tuple(body.name for body in world.bodies),
        poses=ledger.poses,
        velocities=ledger.velocities,
        rolls=ledger.rolled(),
        contacts=ledger.log.result(),
        energy=ledger.energy(),
        effort=run.effort(),
    )


class _Run:
    """One world in motion."""

    def __init__(self, world: World, times: Array, iterations: int | None) -> None:
        bodies, walls = world.bodies, world.walls
        self._world = world
        self._space = Chipmunk(world)
        self._governor = Governor(world, iterations)
        loads, self._scripts = Loads(world), Scripts(world)
        self._lasting = Lasting(world, self._space, loads)
        self.ledger = Ledger(world, self._space, loads, self._scripts, times)
        moving = self._space.moving
        self._row = {int(body): row for row, body in enumerate(moving)}
        self._dynamic = np.array([b.motion is Motion.DYNAMIC for b in bodies], bool)
        self._mass = np.array([b.mass for b in bodies]).reshape(-1)
        self._moment = np.array([b.moment for b in bodies]).reshape(-1)
        nothing = [0.0] * len(walls)
        surfaces = [surface for _, surface in world.surfaces]
        self._things = Things(
            lightness=[1 / b.mass if b.motion is Motion.DYNAMIC else 0.0 for b in bodies] + nothing,
            ease=[1 / b.moment if b.motion is Motion.DYNAMIC else 0.0 for b in bodies] + nothing,
            friction=[surface.friction for surface in surfaces],
            elasticity=[surface.elasticity for surface in surfaces],
            radius=[b.radius if b.radius is not None else nan for b in bodies] + [nan] * len(walls),
        )
        self._joined = Assemblies(world)
        self._held = self._joined.held()
        self._gravity = float(np.hypot(*world.gravity))
        self._impulses = sorted(
            (p for p in world.pushes if p.load is Load.IMPULSE and self._dynamic[p.body]),
            key=lambda p: p.start,
        )
        self._reach = Reach(world, moving)
        self._center = np.array([[*b.center, 0.0] for b in bodies]).reshape(-1, 3)
        wide = np.zeros((len(bodies) + len(walls), 3))
        wide[: len(bodies)] = self._center
        self._wide, self._fast = wide, np.zeros_like(wide)
        self._words, self._places = b"", places(b"")
        self._cornered = any(b.radius is None for b in bodies)
        self._states = b""
        self._h = 0.0
        self._kicks: list[tuple[float, float]] = []
        self._suspicious = self._stirred = True
        """Whether velocities were changed since the last step: what touches may close, what was slow may be fast."""
        spring = loads.fastest() / world.steps_per_second / PHASE
        self._stiff = min(256, max(1, ceil(spring)))
        self._steps = self._divided = self._most_parts = self._impacts = self._reviewed = 0
        self._calm = True

    def effort(self) -> Effort:
        """What it took."""
        return Effort(
            steps=self._steps,
            divided=self._divided,
            most_parts=self._most_parts,
            iterations=self._governor.most_sweeps,
            impacts=self._impacts,
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
        shown = velocity.copy()
        while self._impulses and self._impulses[0].start <= 1e-12:
            self._impulse(velocity, pose, 0.0)
            shown = velocity.copy()
        moving = self._space.moving
        state = np.concatenate([pose[moving] - velocity[moving] * h, velocity[moving]], axis=1)
        self._space.place(state)
        self._h = h
        # a whole step of half the strength: the engine's stored impulses do not bear a change of step
        self._space.weaken(0.5)
        step = self._take(0.0, h, state, first=True)
        self._space.weaken(1.0)
        self._states = step.states
        if step.before is None:
            step.before = state[:, 3:].copy()
        self.ledger.begin(step, pose, shown, roll)

    def advance(self, begin: float, end: float) -> None:
        """A base step, in as many parts as it needs."""
        h = end - begin
        parts = self._stiff
        if not self._reach.watchful and (self._stirred or self._steps % 8 == 0):
            self._stirred = False
            self._reach.look(self._state(), h * 8, self._gravity, h)
        if self._reach.watchful:
            parts = max(parts, self._reach.parts(self._state(), h))
        if parts > 1:
            self._divided += 1
            self._most_parts = max(self._most_parts, parts)
        for part in range(parts):
            self._part(begin + h * part / parts, h / parts)

    def _state(self) -> Array:
        return np.frombuffer(self._states, np.float64).reshape(-1, 6)

    def _part(self, begin: float, h: float) -> None:
        end = begin + h
        state: Array | None = None
        if abs(h - self._h) > 1e-9 * h:
            state = self._state().copy()
            # velocities belong to the middle of a step: carry them to the middle of one of another length
            state[:, 3:] += self._pull * ((h - self._h) / (2 * self._h))
            self._h = h
        if self._impulses and self._impulses[0].start < end - 1e-12:
            state = self._state().copy() if state is None else state
            self._struck_in(begin, end, state)
        if self._scripts.busy:
            state = self._state().copy() if state is None else state
            self._scripts.drive(end, h, state, self._row)
            self._suspicious |= self._scripts.jump(end - h / 2, end + h / 2)
        if state is not None:
            self._space.place(state)
        step = self._take(end, h, state)
        self._states = step.states
        if step.blows:
            self._governor.note(sum(len(blow.first) for blow in step.blows))
        if self.ledger.add(step):
            ledger, since = self.ledger, self._steps - self._reviewed
            self._reviewed = self._steps
            contacts = len(step.words) // CONTACT_BYTES
            self._governor.review(since, contacts, ledger.residual, ledger.overlap, h)

    def _struck_in(self, begin: float, end: float, state: Array) -> None:
        """Impulses that are given within this step, at their times."""
        moving = self._space.moving
        while self._impulses and self._impulses[0].start < end - 1e-12:
            since = max(0.0, self._impulses[0].start - begin)
            velocity, pose = np.zeros((len(self._center), 3)), self._center.copy()
            velocity[moving], pose[moving] = state[:, 3:], state[:, :3]
            was = velocity.copy()
            self._impulse(velocity, pose, since)
            change = (velocity - was)[moving]
            state[:, 3:] += change
            state[:, :3] -= change * since

    def _impulse(self, velocity: Array, pose: Array, since: float) -> None:
        """Give the next impulse to the velocities (N, 3), `since` s after the bodies had the pose (N, 3)."""
        push = self._impulses.pop(0)
        body = push.body
        angle = pose[body, 2] + velocity[body, 2] * since
        c, s = np.cos(angle), np.sin(angle)
        arm = np.array([c * push.at[0] - s * push.at[1], s * push.at[0] + c * push.at[1]])
        change = np.zeros(3)
        change[:2] = push.vector / self._mass[body]
        change[2] = (arm[0] * push.vector[1] - arm[1] * push.vector[0]) / self._moment[body]
        work = self._mass[body] * (change[:2] @ (velocity[body, :2] + change[:2] / 2))
        work += self._moment[body] * change[2] * (velocity[body, 2] + change[2] / 2)
        self._kicks.append((push.start, float(work)))
        velocity[body] += change
        self._suspicious = self._stirred = True

    def _take(self, end: float, h: float, state: Array | None, first: bool = False) -> Step:
        """Step to the time `end`; again, with other velocities, where blows fall. state (M, 6): as placed."""
        self._steps += 1
        M = len(self._space.moving)
        before = None if state is None else state[:, 3:].copy()
        original: Array | None = None
        blows: list[Blows] = []
        self._lasting.begin()
        probing = self._governor.crowded and not self._calm
        if probing and state is None:
            state = self._state().copy()
        sweeps = self._governor.sweeps
        self._space.iterations = 1 if probing else sweeps
        for _ in range(ATTEMPTS):
            load: Lasted | None = None
            if self._lasting.pushes:
                placed = self._state() if state is None else state
                load = self._lasting.push(placed, end, h, first)
            if self._lasting.brakes:
                self._lasting.press()
            states, words, numbers = self._space.step(h)
            blow = None
            if (
                words != self._words
                or self._suspicious
                or (self._cornered and leapt(places(numbers), self._places))
            ):
                if state is None:
                    state = self._state().copy()
                after = np.frombuffer(states, np.float64).reshape(M, 6)
                blow = self._strike(after[:, :3], state[:, 3:], words, numbers, h, first, load)
            if blow is None and not probing:
                break
            assert state is not None
            if blow is not None:
                if original is None:
                    original = state[:, 3:].copy()
                blows.append(blow)
                self._impacts += len(blow.first)
                moving = self._space.moving
                state[:, 3:] = blow.velocity[moving]
                before = state[:, 3:].copy()
                state[:, :3] = after[:, :3] + blow.shift[moving] - before * h
            self._space.iterations = self._governor.sweeps if blow is None else self._governor.after_blows
            probing = False
            self._space.place(state)
        self._calm = original is None
        if state is not None and not self._calm:
            # the first try pushed overlaps apart that the blows have undone
            exact = np.frombuffer(states, np.float64).reshape(M, 6).copy()
            exact[:, :3] = state[:, :3] + state[:, 3:] * h
            self._space.place(exact)
            states = exact.tobytes()
        self._stirred |= not self._calm
        self._words, self._suspicious = words, False
        if self._cornered:
            self._places = places(numbers)
        velocity = np.frombuffer(states, np.float64).reshape(M, 6)
        used = before if before is not None else self._state()[:, 3:]
        self._pull = velocity[:, 3:] - used
        settled = NOTHING
        if self._lasting.accounts:
            settled = self._lasting.settle(load, used, velocity, words, numbers, h)
        kicks, self._kicks = self._kicks, []
        return Step(end, states, words, numbers, before, original, blows, settled, kicks)

    def _strike(
        self,
        pose: Array,
        velocity: Array,
        words: bytes,
        numbers: bytes,
        h: float,
        first: bool,
        load: Lasted | None,
    ) -> Blows | None:
        """What closes at the step's end, given the poses (M, 3) then and the velocities (M, 3) on the way."""
        touch = self._space.touching(words, numbers)
        threshold = self._governor.threshold(h)
        wide, fast = self._wide, self._fast
        wide[self._space.moving], fast[self._space.moving] = pose, velocity
        points = contact_points(touch, wide, fast)
        if not (points.closing > threshold).any():
            return None
        things = len(wide)
        was = touch if first else self._space.touching(self._words, None)
        keys = set((was.first * things + was.second).tolist())
        touched = np.array([k in keys for k in (touch.first * things + touch.second).tolist()], bool)
        drift = np.zeros((things, 2))
        drift[: len(self._dynamic)] = self._lasting.drift(load)
        drift[was.first] = drift[was.second] = 0.0
        drift[self._held] = 0.0
        return strike(self._things, self._joined, wide, fast, drift, points, touched, h, threshold)
