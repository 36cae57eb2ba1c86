"""Steps of a run to samples: poses, contacts and the energy balance at exact times.

Steps are read a block at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.geometry.polygon import cross
from physgen.messages import Message
from physgen.problems import UNKNOWN_PLACE
from physgen.scene.scene import SPRINGS, Motion
from physgen.simulate.collisions import Impacts
from physgen.simulate.contacts import (
    CONTACT_BYTES,
    Array,
    Order,
    Touching,
    touching,
)
from physgen.simulate.forces import EnergyEvent, ForceFields, Forces, ScriptedMotion
from physgen.simulate.surfaces import belt_energies
from physgen.simulate.trajectory import (
    Contacts,
    Effort,
    Energy,
    Trajectory,
    cumulative_quaternions,
    quaternions_from_vectors,
)
from physgen.simulate.trajectory import compose_quaternions as then

Index = NDArray[np.int64]


def _totals(codes: Index, impulse: Array) -> tuple[Index, Array]:
    """Each code once, and the sum (K, 2) of its impulses."""
    found, row = np.unique(codes, return_inverse=True)
    sums = [np.bincount(row, impulse[:, k], len(found)) for k in (0, 1)]
    return found, np.stack(sums, axis=1).astype(np.float64)


class ContactLog:
    """Collects, a block of steps at a time, who touched whom and with what impulse."""

    def __init__(self, surfaces: tuple[str, ...], gap: float) -> None:
        """Two touches of a pair that lie at most `gap` s apart are one."""
        self._surfaces, self._gap = surfaces, gap
        self._open: dict[int, float] = {}
        self._touches: list[tuple[int, float, float]] = []
        self._sums: list[tuple[Index, Array]] = []

    def block(
        self,
        times: Array,
        step: Index,
        sample: Index,
        first: Index,
        second: Index,
        impulse: Array,
        when: Array,
    ) -> None:
        """S steps that end at `times` (S,), and R contacts of them.

        step, sample (R,): in which step, before which sample each acted; impulse (R, 2) g·px/s is on the first; when
        (R,) s: the end of its step, or the very time of an impact.
        """
        N = len(self._surfaces)
        swap = first > second
        key = np.where(swap, second, first) * N + np.where(swap, first, second)
        signed = np.where(swap[:, None], -impulse, impulse)
        self._sums.append(_totals(sample * (N * N) + key, signed))
        self._touch(times, step, key, when)

    def _touch(self, times: Array, step: Index, key: Index, when: Array) -> None:
        """Runs of steps in a row, by pair; a run that goes on from the block before stays open."""
        S = len(times)
        order = np.lexsort((when, step, key))
        key, step, when = key[order], step[order], when[order]
        fresh = np.ones(len(key), bool)
        fresh[1:] = (key[1:] != key[:-1]) | (step[1:] != step[:-1])
        key, step, when = key[fresh], step[fresh], when[fresh]
        starts = np.ones(len(key), bool)
        starts[1:] = (key[1:] != key[:-1]) | (step[1:] != step[:-1] + 1)
        begins = np.flatnonzero(starts)
        ends = np.append(begins[1:], len(key))[: len(begins)] - 1
        still, carried = {}, set()
        for pair, begin, last, at in zip(
            key[begins].tolist(),
            step[begins].tolist(),
            step[ends].tolist(),
            when[begins].tolist(),
            strict=True,
        ):
            since = at
            if begin == 0 and pair in self._open:
                since = self._open[pair]
                carried.add(pair)
            if last == S - 1:
                still[pair] = since
            else:
                self._touches.append((pair, since, float(times[last + 1])))
        for pair in self._open.keys() - carried:
            self._touches.append((pair, self._open[pair], float(times[0])))
        self._open = still

    def _joined(
        self, touches: list[tuple[int, float, float]]
    ) -> list[tuple[int, float, float]]:
        """One touch for those of a pair that follow each other at once; sorted by pair and begin."""
        joined: list[tuple[int, float, float]] = []
        for pair, begin, end in touches:
            if joined and joined[-1][0] == pair and begin - joined[-1][2] <= self._gap:
                joined[-1] = (pair, joined[-1][1], max(end, joined[-1][2]))
            else:
                joined.append((pair, begin, end))
        return joined

    def result(self) -> Contacts:
        """All of it; touches by begin, then by pair."""
        N = len(self._surfaces)
        touches = [
            *self._touches,
            *((pair, begin, np.inf) for pair, begin in self._open.items()),
        ]
        touches = self._joined(sorted(touches))
        touches.sort(key=lambda touch: (touch[1], touch[0], touch[2]))
        pairs = np.array([divmod(pair, N) for pair, _, _ in touches], np.int32).reshape(
            -1, 2
        )
        codes, parts = zip(
            (np.zeros(0, np.int64), np.zeros((0, 2))), *self._sums, strict=True
        )
        rows, total = _totals(np.concatenate(codes), np.concatenate(parts))
        given = total.any(axis=1)
        rows, total = rows[given], total[given]
        first, second = np.divmod(rows % (N * N), N) if N else (rows, rows)
        return Contacts(
            surfaces=self._surfaces,
            touch_pairs=pairs,
            touch_times=np.array([(begin, end) for _, begin, end in touches]).reshape(
                -1, 2
            ),
            impulse_rows=np.stack([rows // max(N * N, 1), first, second], axis=1)
            .astype(np.int32)
            .reshape(-1, 3),
            impulses=total,
        )


BLOCK = 256
"""Steps that are read together; fewer at first, so that the engine soon knows how accurate it is."""
BLOCK_BYTES = 2_000_000
"""Of their contacts, at most."""
MISPLACED = 0.05
"""Of a body's energy: smaller errors of where a contact acts are left as they are; see `Recorder._misplaced`."""


NOT_BRAKED = np.zeros((0, 2), np.int64), list[float]()


@dataclass(slots=True)
class Step:
    """One step as it was read."""

    time: float  # s, of its end
    h: float  # s
    states: bytes
    order: Order  # of its contacts
    numbers: bytes  # of them, as they are listed
    before: (
        Array | None
    )  # (M, 3): velocities within the step; None: as the step before left them
    original: (
        Array | None
    )  # (M, 3): the same before impacts changed them; None without impacts
    impacts: list[Impacts]
    load: Forces | None  # lasting forces in it
    driven: float  # g·px²/s² that motors did
    braked: tuple[Index, list[float]]
    """(B, 2) and g·px²/s: angular impulses between bodies, or the world, -1, by rolling resistance."""
    kicks: list[EnergyEvent]


@dataclass
class Recorder:
    """Books of a run."""

    world: World
    moving: Index  # (M,): bodies that states list
    loads: ForceFields
    scripts: ScriptedMotion
    times: Array  # (T,) s to sample at
    log: ContactLog = field(init=False)

    def __post_init__(self) -> None:
        world, T, N = self.world, len(self.times), len(self.world.bodies)
        self.log = ContactLog(
            tuple(name for name, _ in world.surfaces), 2 / world.steps_per_second
        )
        self._steps: list[Step] = []
        self._count = self._held = 0  # steps and bytes of the block
        self.poses, self.velocities = np.zeros((T, N, 3)), np.zeros((T, N, 3))
        self._rolling = False
        self.rolls = np.zeros((T, N, 2))
        self.turns = np.zeros((T, N, 4))
        self._balance = np.zeros((T, 4))
        self.done = 0
        """Samples taken."""
        dynamic = np.array([b.motion is Motion.DYNAMIC for b in world.bodies], bool)
        self._mass = np.where(dynamic, [b.mass for b in world.bodies], 0.0).reshape(-1)
        self._moment = np.where(dynamic, [b.moment for b in world.bodies], 0.0).reshape(
            -1
        )
        scripted = [b.motion is Motion.SCRIPTED for b in world.bodies]
        self._scripted = np.array(scripted + [False] * len(world.walls), bool)
        self._conveyors = np.array([part.conveyor for _, part in world.surfaces])
        self._still = np.array([[*b.center, 0.0] for b in world.bodies]).reshape(-1, 3)
        self._even = (
            0.1 * float(np.hypot(*world.gravity)) / world.steps_per_second + 1e-6
        )
        """px/s: points of a contact that open no faster than this against each other share its impulse."""
        self._time = 0.0
        self._smooth = np.zeros(
            2
        )  # lost and work up to the middle of the last step's doing
        self._owed = np.zeros(2)  # the other half
        self._struck: list[tuple[float, float, float]] = []
        self._spent = np.zeros(2)  # lost and work of the impacts of earlier blocks
        held = {
            body
            for joint in world.joints
            if joint.kind not in SPRINGS
            for body in (joint.first, joint.second)
        }
        self._unheld = dynamic & np.array([k not in held for k in range(N)], bool)
        """(N,): dynamic bodies that contacts and forces alone turn."""
        self._first = True
        self._block = BLOCK // 8
        self.residual = 0.0
        """Fastest closing of a contact that a step of the last block left, px/s."""
        self.overlap = 0.0
        """Deepest overlap in the last block, px."""

    def begin(self, step: Step, pose: Array, velocity: Array, roll: Array) -> None:
        """The half step to t = 0: pose (N, 3), velocity (N, 3), roll (N, 2) at t = 0 as the scene has them."""
        self._pose, self._mean, self._roll = pose, velocity, roll
        self._turn = np.tile([1.0, 0.0, 0.0, 0.0], (len(pose), 1))
        self._after = np.zeros((len(self.moving), 3))
        self._steps.append(step)
        self.flush()

    def add(self, step: Step) -> bool:
        """Note a step; True once a block is full and has been read."""
        if not self._count:
            self.residual = self.overlap = 0.0
        self._steps.append(step)
        self._count += 1
        self._held += len(step.numbers)
        if self._count < self._block and self._held < BLOCK_BYTES:
            return False
        self.flush()
        self._block = BLOCK
        return True

    def flush(self) -> None:
        """Read the steps that are held, and begin a new block."""
        self.read()
        self._count = self._held = 0

    def read(self) -> None:
        """Read the steps that are held in the middle of a block: what the block is found to be stays the same."""
        steps, self._steps = self._steps, []
        if not steps:
            return
        M = len(self.moving)
        loads = [
            step.load for step in steps if step.load is not None
        ]  # of all steps, or of none
        rolled = [load.rolled for load in loads if load.rolled is not None]
        self._rolling |= bool(rolled)
        states = np.frombuffer(
            b"".join(step.states for step in steps), np.float64
        ).reshape(len(steps), M, 6)
        after = states[:, :, 3:]
        before = np.concatenate([self._after[None], after[:-1]])
        for s, step in enumerate(steps):
            if step.before is not None:
                before[s] = step.before
        self._after = after[-1].copy()
        mean = self._all((before + after) / 2)
        pose = self._all(states[:, :, :3], self._still)
        rolls = np.cumsum([self._roll, *rolled], axis=0)
        flow = self._contacts(steps, pose, self._all(before), self._all(after))
        lost, work = self._loaded(steps, mean, rolls)
        flow[:, 0] += lost + self._braked(steps, mean[:, :, 2])
        flow[:, 1] += (
            work + [step.driven for step in steps] + self._lifted(steps, states, before)
        )
        ends = np.array([step.time for step in steps])
        # at a step's end half of what it did is done: its velocities are those of the middle of two steps
        smooth = np.cumsum(flow, axis=0) + self._smooth + self._owed - flow / 2
        owed = flow[-1] / 2
        if self._first:  # of the half step to t = 0, nothing is done yet at t = 0
            pose[0], mean[0], smooth, owed = (
                self._pose,
                self._mean,
                np.zeros((1, 2)),
                flow[-1],
            )
            self._first = False
        vectors = turns = np.zeros((0, 0, 3))
        if self._rolling:
            spans = np.diff(np.concatenate([[self._time], ends]))[:, None]
            vectors = np.empty(pose.shape)
            vectors[:, :, :2] = (rolls[1:] + rolls[:-1]) / 2 * spans[..., None]
            vectors[:, :, 2] = np.diff(
                np.concatenate([self._pose[None], pose])[:, :, 2], axis=0
            )
            turns = cumulative_quaternions(vectors, self._turn)
        self._samples(steps, ends, pose, mean, smooth, rolls, vectors, turns)
        if self._rolling:
            self._roll, self._turn = rolls[-1], turns[-1]
        self._smooth, self._owed = smooth[-1], owed
        self._time = float(ends[-1])
        self._pose, self._mean = pose[-1], mean[-1]
        self._struck.clear()

    def _all(self, moving: Array, still: Array | None = None) -> Array:
        """(S, M, 3) of moving bodies -> (S, N, 3) of all bodies."""
        S, N = len(moving), len(self.world.bodies)
        out = np.zeros((S, N, 3)) if still is None else np.tile(still, (S, 1, 1))
        out[:, self.moving] = moving
        return out

    def _loaded(self, steps: list[Step], mean: Array, rolls: Array) -> Array:
        """(2, S) lost to and work of lasting forces; mean (S, N, 3) velocities, rolls (S + 1, N, 2)."""
        both, h = np.zeros((2, len(steps))), np.array([step.h for step in steps])

        def work(forces: list[Array | None]) -> Array | float:
            known = [force for force in forces if force is not None]
            return (np.array(known) * mean).sum(axis=(1, 2)) * h if known else 0.0

        loads = [step.load for step in steps if step.load is not None]
        both[0] -= work([load.spend for load in loads])
        both[1] += work([load.drive for load in loads])
        both += [load.carried for load in loads] if loads else 0.0
        scripted = self._scripted[: mean.shape[1], None]
        if scripted.any():  # a spring on a scripted body hands on what its script does
            both[1] -= work([load.total * scripted for load in loads])
        if (
            len(rolls) > 1
        ):  # what the table takes from a sphere's motion partly goes into its rolling
            rolled = np.array([load.rolled for load in loads])
            both[0] -= (self._moment[:, None] * rolled * (rolls[:-1] + rolled / 2)).sum(
                axis=(1, 2)
            )
        return both

    def _lifted(self, steps: list[Step], states: Array, before: Array) -> Array:
        """(S,) work against gravity where shapes that overlap are pushed apart: they move, without a velocity.

        states (S, M, 6); before (S, M, 3) velocities within the steps.
        """
        if self._first:
            return np.zeros(len(steps))
        h = np.array([step.h for step in steps])
        poses = np.concatenate([self._pose[None, self.moving], states[:, :, :3]])
        shift = np.diff(poses, axis=0) - h[:, None, None] * before
        for s, step in enumerate(steps):
            if step.original is not None:  # what is struck has two velocities in a step
                shift[s, (step.original != step.before).any(axis=1)] = 0.0
        scales = np.array([body.gravity_scale for body in self.world.bodies])
        weight: Array = self._mass * scales
        lifted: Array = -(shift[:, :, :2] @ self.world.gravity) @ weight[self.moving]
        return lifted

    def _braked(self, steps: list[Step], spin: Array) -> Array:
        """(S,) lost to rolling resistance; spin (S, N)."""
        if all(step.braked is NOT_BRAKED for step in steps):
            return np.zeros(len(steps))
        row = np.repeat(np.arange(len(steps)), [len(step.braked[1]) for step in steps])
        pairs = np.concatenate([step.braked[0] for step in steps])
        still = np.pad(spin, ((0, 0), (0, 1)))  # -1: the world
        turned = np.abs(still[row, pairs[:, 0]] - still[row, pairs[:, 1]])
        impulse = np.array([one for step in steps for one in step.braked[1]])
        return np.bincount(row, impulse * turned, len(steps)).astype(np.float64)

    def _contacts(
        self, steps: list[Step], pose: Array, before: Array, after: Array
    ) -> Array:
        """(S, 2) lost and work of the steps' contacts; impacts go into their own list, and all into the log."""
        S, W = len(steps), len(self.world.walls)
        ends = np.array([step.time for step in steps])
        row = np.repeat(
            np.arange(S), [len(step.numbers) // CONTACT_BYTES for step in steps]
        )
        alike: dict[Order, list[int]] = {}
        for s, order in enumerate([step.order for step in steps]):
            alike.setdefault(order, []).append(s)
        numbers = [step.numbers for step in steps]
        for order, some in alike.items():
            ordered, size = (
                order.sort(b"".join(numbers[s] for s in some)),
                len(numbers[some[0]]),
            )
            for k, s in enumerate(some):
                numbers[s] = ordered[size * k : size * (k + 1)]
        touch = touching(
            b"".join(step.order.words for step in steps), b"".join(numbers)
        )
        first, second, impulse, count = (
            touch.first,
            touch.second,
            touch.impulse,
            touch.count,
        )
        points, normal = (touch.on_first + touch.on_second) / 2, touch.normal

        def widen(array: Array) -> Array:
            return np.concatenate([array, np.zeros((S, W, 3))], axis=1)

        center, mean, last = widen(pose), widen((before + after) / 2), widen(after)
        mean[:, self._scripted] = last[:, self._scripted]

        at = [row * center.shape[1] + objects for objects in (first, second)]

        def columns(of: Array, partner: int) -> Array:
            """(3, R) of one partner of each contact."""
            return np.ascontiguousarray(of.reshape(-1, 3).take(at[partner], axis=0).T)

        centers = [columns(center, partner) for partner in (0, 1)]

        def speed(
            motion: Array, partner: int, x: Array, y: Array
        ) -> tuple[Array, Array]:
            (vx, vy, spin), (cx, cy, _) = motion, centers[partner]
            return vx - spin * (y - cy), vy + spin * (x - cx)

        def along(
            one: tuple[Array, Array], other: tuple[Array, Array], way: Array
        ) -> Array:
            return (one[0] - other[0]) * way[:, 0] + (one[1] - other[1]) * way[:, 1]

        # of two points, the one that opens after the step carried nothing (Signorini's condition)
        ends1, ends2 = columns(last, 0), columns(last, 1)
        spots = [(points[:, k, 0], points[:, k, 1]) for k in (0, 1)]
        opening = np.stack(
            [
                along(speed(ends2, 1, *spot), speed(ends1, 0, *spot), normal)
                for spot in spots
            ]
        )
        share = np.clip(0.5 + (opening[1] - opening[0]) / (2 * self._even), 0.0, 1.0)
        share[count == 1] = 1.0
        # the impulse acts on each body at the body's own point: overlaps shorten levers
        places = [
            share[:, None] * on[:, 0] + (1 - share[:, None]) * on[:, 1]
            for on in (touch.on_first, touch.on_second)
        ]
        v1, v2 = (
            speed(columns(mean, partner), partner, *places[partner].T)
            for partner in (0, 1)
        )
        lost = -along(v1, v2, impulse)
        work = np.zeros(len(row))
        if self._conveyors.any():
            moved, done = belt_energies(self._conveyors, first, second, normal, impulse)
            lost, work = lost + moved, work + done
        for objects, sign, v in ((first, -1.0, v1), (second, 1.0, v2)):
            driven = self._scripted[objects]
            if driven.any():
                part = v[0] * impulse[:, 0] + v[1] * impulse[:, 1]
                work[driven] += sign * part[driven]
        flow = np.stack(
            [np.bincount(row, values, S) for values in (lost, work)], axis=1
        ).astype(np.float64)
        if (count == 2).any():
            flow[:, 0] += self._misplaced(
                steps, touch, row, places, (pose, before, after)
            )
        self._note_accuracy(opening, touch)
        # a sample at the very time of an impulse shows what was before it; but t = 0 shows what the scene begins with
        late = 0.0 if self._first else 1e-9
        self._struck += [
            (kick.time + late, kick.lost, kick.work)
            for step in steps
            for kick in step.kicks
        ]
        blown = [
            (s, impacts) for s, step in enumerate(steps) for impacts in step.impacts
        ]
        for s, impacts in blown:
            time = float(
                ends[s] - (impacts.earlier.max() if len(impacts.earlier) else 0.0)
            )
            begun = (
                float(ends[s - 1]) if s else self._time
            ) + 1e-9  # what fell as the step began falls after the last
            self._struck.append((max(time, begun), impacts.lost, impacts.work))
        step = np.concatenate(
            [row, *(np.full(len(b.first), s) for s, b in blown)]
        ).astype(np.int64)
        when = np.concatenate([ends[row], *(ends[s] - b.earlier for s, b in blown)])
        sample = np.searchsorted(self.times, when - 1e-12)
        inside = sample < len(self.times)
        one, other = (
            np.concatenate([mine, *theirs])
            for mine, theirs in (
                (first, [b.first for _, b in blown]),
                (second, [b.second for _, b in blown]),
            )
        )
        given = np.concatenate([impulse, *(b.impulse for _, b in blown)])
        self.log.block(
            ends,
            step[inside],
            sample[inside],
            one[inside],
            other[inside],
            given[inside],
            when[inside],
        )
        return flow

    def _note_accuracy(self, opening: Array, touch: Touching) -> None:
        """Note the fastest closing, by the speeds (2, K) at which points open, and the deepest overlap."""
        if not len(touch.count):
            return
        least = np.where(touch.count == 1, opening[0], opening.min(axis=0))
        self.residual = max(self.residual, -float(least.min()))
        self.overlap = max(self.overlap, float(touch.depth.max()))

    def _misplaced(
        self,
        steps: list[Step],
        touch: Touching,
        row: Index,
        places: Sequence[Array],
        motion: tuple[Array, Array, Array],
    ) -> Array:
        """Return by how much more energy (S,) contacts lost than at their estimated places.

        Of the two points of a contact, the engine reports the sum of the impulses, and `places` (two of (R, 2), on the
        first and on the second body) are an estimate of where the sum acts in the step `row` (R,). Contacts that
        contradict each other, as those of pieces whose corners lie on a boundary, invalidate the estimate; the body's
        angular momentum then shows the error of the torque.
        motion: poses (S, N, 3), and velocities (S, N, 3) before and after.
        """
        pose, before, after = motion
        torque, leeway = self._torques(touch, row, places, pose)
        error = self._moment * (after - before)[:, :, 2] - torque
        for s, step in enumerate(steps):
            if step.load is not None:
                error[s] -= step.load.total[:, 2] * step.h
        # a larger error is not one of places: the balance must show it
        error[np.abs(error) > leeway] = 0.0
        lost = -error * (before + after)[:, :, 2] / 2
        inertia = np.stack([self._mass, self._mass, self._moment], axis=1)
        weight = self._mass * float(np.hypot(*self.world.gravity))
        # a fall by a pixel is the least energy that counts
        energy = (inertia * np.maximum(before**2, after**2)).sum(axis=2) / 2 + weight
        unbraked = np.array([[step.braked is NOT_BRAKED] for step in steps])
        counts = unbraked & self._unheld
        counts &= np.abs(lost) > MISPLACED * energy
        return np.asarray((lost * counts).sum(axis=1))

    def _torques(
        self, touch: Touching, row: Index, places: Sequence[Array], pose: Array
    ) -> tuple[Array, Array]:
        """Return angular impulses (S, N) of contacts at `places`, and by how much they may be wrong.

        The sum of a contact's two impulses acts somewhere between its two points.
        """
        N = pose.shape[1]
        torque, leeway = np.zeros(pose.shape[:2]), np.zeros(pose.shape[:2])
        points = (touch.on_first + touch.on_second) / 2
        apart = np.where((touch.count == 2)[:, None], points[:, 1] - points[:, 0], 0.0)
        range_ = np.abs(cross(apart, touch.impulse))
        partners = ((touch.first, 1.0), (touch.second, -1.0))
        for (objects, sign), place in zip(partners, places, strict=True):
            of_bodies = objects < N
            at = row[of_bodies], objects[of_bodies]
            lever = place[of_bodies] - pose[at][:, :2]
            np.add.at(torque, at, sign * cross(lever, touch.impulse[of_bodies]))
            np.add.at(leeway, at, range_[of_bodies])
        return torque, leeway

    def _samples(
        self,
        steps: list[Step],
        ends: Array,
        pose: Array,
        mean: Array,
        smooth: Array,
        rolls: Array,
        vectors: Array,
        turns: Array,
    ) -> None:
        """Take the samples that fall into these steps; rolls (S + 1, N, 2), their vectors and turns where any rolls."""
        done, first = (
            int(np.searchsorted(self.times, ends[-1] + 1e-12, side="right")),
            self.done,
        )
        time = self.times[first:done]
        s = np.searchsorted(ends, time - 1e-12)
        fresh = s == 0

        def start(of: Array, before: Array | float) -> Array:
            begun = of[s - 1]
            begun[fresh] = before
            return begun

        pose0, mean0, begin = (
            start(pose, self._pose),
            start(mean, self._mean),
            start(ends, self._time),
        )
        h = ends[s] - begin
        part = np.maximum(0.0, (time - begin) / np.maximum(h, 1e-300))
        part[(h <= 0) | (time > ends[s] - 1e-9 * h)] = 1.0
        along = part[:, None, None]
        x, v = pose0 + along * (pose[s] - pose0), mean0 + along * (mean[s] - mean0)
        for k in np.flatnonzero((part > 0) & (part < 1)).tolist():
            step = steps[s[k]]
            if step.original is not None:
                self._inside(
                    step,
                    float(time[k]),
                    part[k] * h[k],
                    h[k],
                    x[k],
                    v[k],
                    pose0[k],
                    pose[s[k]],
                )
        if self.scripts.busy:
            for k in range(len(time)):
                self.scripts.sample(float(time[k]), x[k], v[k])
        roll = self._roll[None]
        if self._rolling:
            roll = rolls[s] + along * (rolls[s + 1] - rolls[s])
            self.turns[first:done] = then(
                quaternions_from_vectors(along * vectors[s]), start(turns, self._turn)
            )
        self.poses[first:done], self.velocities[first:done], self.rolls[first:done] = (
            x,
            v,
            roll,
        )
        _refuse_infinities(self.world, x, v, time)
        balance0 = start(smooth, self._smooth)
        blown = np.tile(self._spent, (len(time), 1))
        for first_after, (_, *flow) in zip(
            np.searchsorted(time + 1e-12, [at for at, _, _ in self._struck]),
            self._struck,
            strict=True,
        ):
            blown[first_after:] += flow
        balance = balance0 + part[:, None] * (smooth[s] - balance0) + blown
        self._balance[first:done] = np.column_stack(
            [*self._energy(time, x, v, roll), balance]
        )
        self.done = done
        for _, lost, work in self._struck:
            self._spent += np.array([lost, work])

    def _inside(
        self,
        step: Step,
        time: float,
        since: float,
        h: float,
        x: Array,
        v: Array,
        pose0: Array,
        pose1: Array,
    ) -> None:
        """Within a step with impacts, what was struck moves as before until then, and as after from then on."""
        assert step.original is not None
        assert step.before is not None
        changed = np.flatnonzero((step.original != step.before).any(axis=1))
        bodies = self.moving[changed]
        at = max(float(b.earlier.max()) for b in step.impacts if len(b.earlier))
        if time < step.time - at:
            v[bodies] = step.original[changed]
            x[bodies] = pose0[bodies] + step.original[changed] * since
        else:
            v[bodies] = step.before[changed]
            x[bodies] = pose1[bodies] - step.before[changed] * (h - since)

    def _energy(
        self, times: Array, pose: Array, velocity: Array, roll: Array
    ) -> tuple[Array, Array]:
        """(S,) kinetic and potential energy of the dynamic bodies in S poses (S, N, 3)."""
        square = velocity[..., 0] ** 2 + velocity[..., 1] ** 2
        turning = velocity[..., 2] ** 2 + (roll**2).sum(axis=-1)
        kinetic = (self._mass * square + self._moment * turning).sum(axis=1) / 2
        height = -(self._mass * (pose[..., :2] @ self.world.gravity)).sum(axis=1)
        return kinetic, height + [
            self.loads.potential(x, time) if self.loads.busy else 0.0
            for time, x in zip(times.tolist(), pose, strict=True)
        ]

    def trajectory(
        self, effort: Effort, sampled: Callable[[Array], Trajectory]
    ) -> Trajectory:
        """What is known once the last step is read; `sampled` is the same motion at other times."""
        rolling = slice(None) if self._rolling else slice(0)
        return Trajectory(
            times=self.times,
            names=tuple(body.name for body in self.world.bodies),
            poses=self.poses,
            velocities=self.velocities,
            rolls=self.rolls[:, rolling],
            turns=self.turns[:, rolling],
            contacts=self.log.result(),
            energy=Energy(*np.ascontiguousarray(self._balance.T)),
            effort=effort,
            sampled=sampled,
        )


def _refuse_infinities(
    world: World, pose: Array, velocity: Array, times: Array
) -> None:
    wrong = np.argwhere(
        ~(np.isfinite(pose).all(axis=2) & np.isfinite(velocity).all(axis=2))
    ).tolist()
    if wrong:
        k, body = wrong[0]
        path = f"objects.{world.bodies[body].name}"
        diverged = Message.MOTION_DIVERGED
        raise diverged.error_at(UNKNOWN_PLACE, path, time=times[k])
