"""World -> Trajectory: a leapfrog on Chipmunk's contacts, with blows of our own and steps divided where they must be.

Positions are those of whole steps, velocities those of the middles between them (Störmer and Verlet): a half step is
taken first, so that free fall is exact. Steps never depend on the samples: both lie on their own grids.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import ceil, nan

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.problems import InputError
from physgen.scene.model import Load, Motion
from physgen.simulate.chipmunk import CONTACT_BYTES, Chipmunk, Touching, leapt, places
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

ATTEMPTS = 8
"""Times that a step is taken again because blows changed what it does."""
PHASE = 0.1
"""rad that the stiffest spring, or a pass by an attractor, may turn in a step."""
MOST_PARTS = 1024
"""Of a step that springs or attractors divide."""

LEFT = "raise steps_per_second, or look for a force, spring or joint that is too strong for its mass"

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
    number = 0
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # what leaves all numbers is told by name
            run.start()
            last = ceil(float(times[-1]) / h - 1e-9) if len(times) else 0
            for number in range(1, last + 1):
                run.advance((number - 1) * h, number * h)
                if number % 256 == 0:
                    progress("simulate", ledger.done, len(times))
            ledger.flush()
    except (OverflowError, np.linalg.LinAlgError) as error:
        found = f"leaves all numbers by t = {number * h:.3f} s"
        raise InputError.of("world", "the motion", found, LEFT) from error
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
        light, ease = (
            np.array(values[: len(bodies)]) for values in (self._things.lightness, self._things.ease)
        )
        self._inverse = np.stack([light, light, ease], axis=1)
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
        self._kicks: list[tuple[float, float, float]] = []
        self._suspicious = self._stirred = True
        """Whether velocities were changed since the last step: what touches may close, what was slow may be fast."""
        self._loads = loads
        self._restless = loads.busy or self._scripts.busy
        self._stiff = max(1, ceil(loads.fastest() / world.steps_per_second / PHASE))
        if self._stiff > MOST_PARTS:
            found = f"needs every step divided into {self._stiff:,} parts"
            fix = f"make it softer, what it joins heavier, or steps_per_second larger: at most {MOST_PARTS} parts"
            raise InputError.of(f"joints.{loads.stiffest()}.stiffness", "", found, fix)
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
        while self._impulses and self._impulses[0].start <= 1e-12:
            self._impulse(velocity, pose, 0.0)
        if self._joined.busy:
            velocity = self._fit(pose, velocity, 0.0)
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
        if not self._reach.watchful and (self._stirred or self._restless or self._steps % 8 == 0):
            self._stirred = False
            self._reach.look(self._ahead(end, h), h * 8, self._gravity, h)
        if self._reach.watchful:
            parts = max(parts, self._reach.parts(self._ahead(end, h), h))
        if self._loads.steers:
            pose, velocity = self._center.copy(), np.zeros_like(self._center)
            state, moving = self._state(), self._space.moving
            pose[moving], velocity[moving] = state[:, :3], state[:, 3:]
            parts = max(parts, min(MOST_PARTS, ceil(self._loads.pace(pose, velocity) * h / PHASE)))
        if parts > 1:
            self._divided += 1
            self._most_parts = max(self._most_parts, parts)
        for part in range(parts):
            self._part(begin + h * part / parts, h / parts)

    def _ahead(self, end: float, h: float) -> Array:
        """The state (M, 6), scripted bodies with the fastest of this step and the next."""
        state = self._state()
        if self._scripts.busy:
            state = state.copy()
            now = state[:, 3:].copy()
            self._scripts.drive(end, h, state, self._row)
            later = state[:, 3:].copy()
            self._scripts.drive(end + h, h, state, self._row)
            state[:, :3], state[:, 3:] = self._state()[:, :3], now
            for row in self._scripts.rows(self._row):
                state[row, 3:] = max(
                    (now[row], later[row], self._last_speed(row, end, h)),
                    key=lambda v: float(np.hypot(*v[:2])),
                )
        return state

    def _last_speed(self, row: int, end: float, h: float) -> Array:
        """Of a scripted row, within the step that ends at `end`."""
        state = self._state().copy()
        self._scripts.drive(end - h, h, state, self._row)
        return state[row, 3:]

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
            if self._joined.busy:
                velocity = self._fit(pose, velocity, begin + since)
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
        self._kicks.append((push.start, 0.0, float(work)))
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
        for attempt in range(ATTEMPTS):
            load: Lasted | None = None
            if self._lasting.pushes:
                placed = self._state() if state is None else state
                load = self._lasting.push(placed, end, h, first)
            if self._lasting.brakes:
                self._lasting.press()
            states, words, numbers = self._space.step(h)
            blow = None
            leap = self._cornered and leapt(places(numbers), self._places)
            surprise = self._suspicious or leap
            # the last try is taken as it comes: what still closes then does not bounce
            if attempt < ATTEMPTS - 1 and (surprise or words != self._words):
                if state is None:
                    state = self._state().copy()
                after = np.frombuffer(states, np.float64).reshape(M, 6)
                blow = self._strike(after[:, :3], state[:, 3:], words, numbers, h, surprise, first, load)
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
        driven = 0.0
        if self._joined.busy or (state is not None and not self._calm):
            exact = np.frombuffer(states, np.float64).reshape(M, 6).copy()
            if state is not None and not self._calm:
                # the first try pushed overlaps apart that the blows have undone
                exact[:, :3] = state[:, :3] + state[:, 3:] * h
            if self._joined.busy:
                exact[:, 3:], driven = self._hold(exact, h, 0.5 if first else 1.0)
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
        if driven:
            settled = replace(settled, work=settled.work + driven)
        kicks, self._kicks = self._kicks, []
        return Step(end, states, words, numbers, before, original, blows, settled, kicks)

    def _hold(self, state: Array, h: float, strength: float) -> tuple[Array, float]:
        """Velocities (M, 3) that keep all joints, and the motors' work; motors act with a part of their strength."""
        moving = self._space.moving
        pose, velocity = self._center.copy(), np.zeros_like(self._center)
        pose[moving], velocity[moving] = state[:, :3], state[:, 3:]
        velocity, work = self._joined.hold(pose, velocity, self._inverse, h, strength)
        return velocity[moving], work

    def _fit(self, pose: Array, velocity: Array, time: float) -> Array:
        """Velocities (N, 3) that joints allow: what they forbid is lost at once."""
        allowed, _ = self._joined.hold(pose, velocity, self._inverse, 1.0, None)
        weight = np.stack([self._mass, self._mass, self._moment], axis=1)[self._dynamic]
        gone = (weight * (velocity**2 - allowed**2)[self._dynamic]).sum() / 2
        self._kicks.append((time, float(gone), 0.0))
        return allowed

    def _strike(
        self,
        pose: Array,
        velocity: Array,
        words: bytes,
        numbers: bytes,
        h: float,
        surprise: bool,
        first: bool,
        load: Lasted | None,
    ) -> Blows | None:
        """What closes at the step's end, given the poses (M, 3) then and the velocities (M, 3) on the way.

        What touched before closes by what the solver left undone, and does not bounce, but for a `surprise`.
        """
        touch = self._space.touching(words, numbers)
        threshold = self._governor.threshold(h)
        wide, fast = self._wide, self._fast
        wide[self._space.moving], fast[self._space.moving] = pose, velocity
        points = contact_points(touch, wide, fast)
        if not (points.closing > threshold).any():
            return None
        things = len(wide)
        was = touch if first else self._space.touching(self._words, None)
        before = set(_pairs(was, things))
        touched = np.array([pair in before for pair in _pairs(touch, things)], bool)
        points = replace(points, closing=np.where(surprise | ~touched[points.row], points.closing, 0.0))
        if not (points.closing > threshold).any():
            return None
        drift = np.zeros((things, 2))
        drift[: len(self._dynamic)] = self._lasting.drift(load)
        drift[was.first] = drift[was.second] = 0.0
        drift[self._held] = 0.0
        return strike(self._things, self._joined, wide, fast, drift, points, touched, h, threshold)


def _pairs(touch: Touching, things: int) -> list[tuple[int, int]]:
    """Each contact's partners, in one order, and its number of points."""
    low, high = np.minimum(touch.first, touch.second), np.maximum(touch.first, touch.second)
    return list(zip((low * things + high).tolist(), touch.count.tolist(), strict=True))
