"""One step of the engine."""

from __future__ import annotations

from dataclasses import replace
from math import nan

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.scene.scene import Motion
from physgen.simulate.collisions import ContactProperties, Impacts, contact_points, resolve_impacts
from physgen.simulate.forces import EnergyEvent, EnergyFlow, Forces, StepForces
from physgen.simulate.joints import Assemblies
from physgen.simulate.recorder import Step
from physgen.simulate.space import Space, Touching, contact_places, contacts_jumped
from physgen.simulate.step_control import Governor

Array = NDArray[np.float64]

ATTEMPTS = 8
"""Times that a step is taken again because blows changed what it does."""
NOTHING = EnergyFlow(0.0, 0.0, None)


class Stepper:
    """Takes one step after the other."""

    def __init__(self, world: World, space: Space, lasting: StepForces, governor: Governor) -> None:
        bodies, walls = world.bodies, world.walls
        self._space, self._lasting, self._governor = space, lasting, governor
        self._dynamic = np.array([b.motion is Motion.DYNAMIC for b in bodies], bool)
        nothing = [0.0] * len(walls)
        surfaces = [surface for _, surface in world.surfaces]
        self._things = ContactProperties(
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
        self._center = np.array([[*b.center, 0.0] for b in bodies]).reshape(-1, 3)
        wide = np.zeros((len(bodies) + len(walls), 3))
        wide[: len(bodies)] = self._center
        self._wide, self._fast = wide, np.zeros_like(wide)
        self._cornered = any(b.radius is None for b in bodies)
        self._words, self._places, self._states = b"", contact_places(b""), b""
        self._calm = True
        self.pull = np.zeros((len(space.moving), 3))
        """(M, 3): change of the velocities in the last step."""
        self.suspicious = self.stirred = True
        """Whether velocities were changed since the last step: what touches may close, what was slow may be fast."""
        self.steps = self.impacts = 0
        """Steps taken, and points struck."""

    def state(self) -> Array:
        """(M, 6) of the bodies that move, read-only."""
        return np.frombuffer(self._states, np.float64).reshape(-1, 6)

    def fit(self, pose: Array, velocity: Array) -> tuple[Array, float]:
        """Velocities (N, 3) that joints allow, and the energy of what they forbid, which is lost at once."""
        if not self._joined.busy:
            return velocity, 0.0
        allowed, _ = self._joined.hold(pose, velocity, self._inverse, 1.0, None)
        weight = 1 / self._inverse[self._dynamic]
        return allowed, float((weight * (velocity**2 - allowed**2)[self._dynamic]).sum() / 2)

    def take(
        self, end: float, h: float, state: Array | None, kicks: list[EnergyEvent], first: bool = False
    ) -> Step:
        """Step to the time `end`; again, with other velocities, where blows fall. state (M, 6): as placed."""
        self.steps += 1
        M = len(self._space.moving)
        before = None if state is None else state[:, 3:].copy()
        original: Array | None = None
        blows: list[Impacts] = []
        self._lasting.begin()
        probing = self._governor.crowded and not self._calm
        if probing and state is None:
            state = self.state().copy()
        sweeps = self._governor.sweeps
        self._space.iterations = 1 if probing else sweeps
        for attempt in range(ATTEMPTS):
            load: Forces | None = None
            if self._lasting.pushes:
                placed = self.state() if state is None else state
                load = self._lasting.push(placed, end, h, first)
            if self._lasting.brakes:
                self._lasting.press()
            states, words, numbers = self._space.step(h)
            blow = None
            leap = self._cornered and contacts_jumped(contact_places(numbers), self._places)
            surprise = self.suspicious or leap
            # the last try is taken as it comes: what still closes then does not bounce
            if attempt < ATTEMPTS - 1 and (surprise or words != self._words):
                if state is None:
                    state = self.state().copy()
                after = np.frombuffer(states, np.float64).reshape(M, 6)
                blow = self._strike(after[:, :3], state[:, 3:], words, numbers, h, surprise, first, load)
            if blow is None and not probing:
                break
            assert state is not None
            if blow is not None:
                if original is None:
                    original = state[:, 3:].copy()
                blows.append(blow)
                self.impacts += len(blow.first)
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
        self.stirred |= not self._calm
        self._words, self.suspicious = words, False
        if self._cornered:
            self._places = contact_places(numbers)
        velocity = np.frombuffer(states, np.float64).reshape(M, 6)
        used = before if before is not None else self.state()[:, 3:]
        self.pull = velocity[:, 3:] - used
        settled = NOTHING
        if self._lasting.accounts:
            settled = self._lasting.settle(load, used, velocity, words, numbers, h)
        if driven:
            settled = replace(settled, work=settled.work + driven)
        self._states = states
        return Step(end, states, words, numbers, before, original, blows, settled, kicks)

    def _hold(self, state: Array, h: float, strength: float) -> tuple[Array, float]:
        """Velocities (M, 3) that keep all joints, and the motors' work; motors act with a part of their strength."""
        moving = self._space.moving
        pose, velocity = self._center.copy(), np.zeros_like(self._center)
        pose[moving], velocity[moving] = state[:, :3], state[:, 3:]
        velocity, work = self._joined.hold(pose, velocity, self._inverse, h, strength)
        return velocity[moving], work

    def _strike(
        self,
        pose: Array,
        velocity: Array,
        words: bytes,
        numbers: bytes,
        h: float,
        surprise: bool,
        first: bool,
        load: Forces | None,
    ) -> Impacts | None:
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
        return resolve_impacts(self._things, self._joined, wide, fast, drift, points, touched, h, threshold)


def _pairs(touch: Touching, things: int) -> list[tuple[int, int]]:
    """Each contact's partners, in one order, and its number of points."""
    low, high = np.minimum(touch.first, touch.second), np.maximum(touch.first, touch.second)
    return list(zip((low * things + high).tolist(), touch.count.tolist(), strict=True))
