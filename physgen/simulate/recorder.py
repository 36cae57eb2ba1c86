"""From steps of a run to samples: poses, contacts and the energy balance at exact
times.

Steps are read in blocks, so that arrays can be used instead of loops.
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
    """Return each code once, with the sum (K, 2) of its impulses."""
    unique_codes, rows = np.unique(codes, return_inverse=True)
    sums = [np.bincount(rows, impulse[:, k], len(unique_codes)) for k in (0, 1)]
    return unique_codes, np.stack(sums, axis=1).astype(np.float64)


class ContactLog:
    """Collects the touches and impulses of all pairs, block by block."""

    def __init__(self, surfaces: tuple[str, ...], gap: float) -> None:
        """Create an empty log; touches of a pair with a gap of at most `gap` s
        are one.
        """
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
        """Add R contacts of S steps that end at `times` (S,).

        `step`, `sample` (R,): the step of each contact, and the sample after it;
        `impulse` (R, 2) g·px/s on the first; `when` (R,) s: the end of the step, or the
        time of an impact.
        """
        surface_count = len(self._surfaces)
        is_swapped = first > second
        pair_codes = np.where(is_swapped, second, first) * surface_count + np.where(
            is_swapped, first, second
        )
        impulses = np.where(is_swapped[:, None], -impulse, impulse)
        self._sums.append(
            _totals(sample * (surface_count * surface_count) + pair_codes, impulses)
        )
        self._touch(times, step, pair_codes, when)

    def _touch(self, times: Array, step: Index, key: Index, when: Array) -> None:
        """Collect runs of consecutive steps with a contact, by pair.

        A run at the end of the block stays open, and continues in the next block.
        """
        step_count = len(times)
        # Sort by pair, step and time, and keep the earliest contact of a pair in each
        # step.
        order = np.lexsort((when, step, key))
        key, step, when = key[order], step[order], when[order]
        is_first = np.ones(len(key), bool)
        is_first[1:] = (key[1:] != key[:-1]) | (step[1:] != step[:-1])
        key, step, when = key[is_first], step[is_first], when[is_first]
        # A touch begins where a pair changes, or where a step without contact lies
        # between.
        is_start = np.ones(len(key), bool)
        is_start[1:] = (key[1:] != key[:-1]) | (step[1:] != step[:-1] + 1)
        begins = np.flatnonzero(is_start)
        ends = np.append(begins[1:], len(key))[: len(begins)] - 1
        open_touches, continued_pairs = {}, set()
        for pair, begin, last_step, first_time in zip(
            key[begins].tolist(),
            step[begins].tolist(),
            step[ends].tolist(),
            when[begins].tolist(),
            strict=True,
        ):
            begin_time = first_time
            if begin == 0 and pair in self._open:
                begin_time = self._open[pair]
                continued_pairs.add(pair)
            if last_step == step_count - 1:
                open_touches[pair] = begin_time
            else:
                self._touches.append((pair, begin_time, float(times[last_step + 1])))
        # Touches of the block before that did not continue ended with it.
        for pair in self._open.keys() - continued_pairs:
            self._touches.append((pair, self._open[pair], float(times[0])))
        self._open = open_touches

    def _joined(
        self, touches: list[tuple[int, float, float]]
    ) -> list[tuple[int, float, float]]:
        """Merge touches of a pair with a gap of at most `gap` s; sorted by pair and
        begin.
        """
        merged_touches: list[tuple[int, float, float]] = []
        for pair, begin, end in touches:
            # Contacts at rest flicker: a short gap does not end a touch.
            if (
                merged_touches
                and merged_touches[-1][0] == pair
                and begin - merged_touches[-1][2] <= self._gap
            ):
                merged_touches[-1] = (
                    pair,
                    merged_touches[-1][1],
                    max(end, merged_touches[-1][2]),
                )
            else:
                merged_touches.append((pair, begin, end))
        return merged_touches

    def result(self) -> Contacts:
        """Return all contacts; touches are sorted by begin, then by pair."""
        surface_count = len(self._surfaces)
        touches = [
            *self._touches,
            *((pair, begin, np.inf) for pair, begin in self._open.items()),
        ]
        touches = self._joined(sorted(touches))
        touches.sort(key=lambda touch: (touch[1], touch[0], touch[2]))
        pairs = np.array(
            [divmod(pair, surface_count) for pair, _, _ in touches], np.int32
        ).reshape(-1, 2)
        # Sum the impulses again over all blocks, since a sample may span two of them.
        codes, impulses_by_block = zip(
            (np.zeros(0, np.int64), np.zeros((0, 2))), *self._sums, strict=True
        )
        rows, sums = _totals(np.concatenate(codes), np.concatenate(impulses_by_block))
        is_nonzero = sums.any(axis=1)
        rows, sums = rows[is_nonzero], sums[is_nonzero]
        first, second = (
            np.divmod(rows % (surface_count * surface_count), surface_count)
            if surface_count
            else (rows, rows)
        )
        return Contacts(
            surfaces=self._surfaces,
            touch_pairs=pairs,
            touch_times=np.array([(begin, end) for _, begin, end in touches]).reshape(
                -1, 2
            ),
            impulse_rows=np.stack(
                [rows // max(surface_count * surface_count, 1), first, second], axis=1
            )
            .astype(np.int32)
            .reshape(-1, 3),
            impulses=sums,
        )


BLOCK = 256
"""Number of steps that are read together; the first block is shorter, so that the
engine soon learns its accuracy.
"""
BLOCK_BYTES = 2_000_000
"""Maximum size of a block's contacts."""
MISPLACED = 0.05
"""Share of a body's energy below which an error by the place of a contact is accepted;
see `Recorder._misplaced`.
"""


NO_BRAKING = np.zeros((0, 2), np.int64), list[float]()


@dataclass(slots=True)
class Step:
    """One step as it was read from the engine."""

    time: float  # s, of its end
    h: float  # s
    states: bytes
    order: Order  # order of its contacts
    numbers: bytes  # numbers of its contacts, in pymunk's order
    velocities: Array | None
    """Velocities within the step, (M, 3); None: those after the step before."""
    velocities_before_impacts: Array | None
    """The same velocities before impacts, (M, 3); None without impacts."""
    impacts: list[Impacts]
    load: Forces | None  # lasting forces of the step
    motor_work: float  # g·px²/s² of work by motors
    braking: tuple[Index, list[float]]
    """Pairs (B, 2) of bodies, -1 for the world, and their angular impulses by rolling
    resistance, g·px²/s."""
    events: list[EnergyEvent]


@dataclass
class Recorder:
    """Record of a run: samples, contacts and the energy balance."""

    world: World
    moving: Index  # (M,): bodies in the order of states
    loads: ForceFields
    scripts: ScriptedMotion
    times: Array  # (T,) s to sample at
    log: ContactLog = field(init=False)

    def __post_init__(self) -> None:
        world, sample_count, N = self.world, len(self.times), len(self.world.bodies)
        self.log = ContactLog(
            tuple(name for name, _ in world.surfaces), 2 / world.steps_per_second
        )
        self._steps: list[Step] = []
        self._count = self._held = 0  # steps and bytes of the block
        self.poses, self.velocities = (
            np.zeros((sample_count, N, 3)),
            np.zeros((sample_count, N, 3)),
        )
        self._rolling = False
        self.rolls = np.zeros((sample_count, N, 2))
        self.turns = np.zeros((sample_count, N, 4))
        self._balance = np.zeros((sample_count, 4))
        self.sample_count = 0
        """Number of samples so far."""
        is_dynamic = np.array([b.motion is Motion.DYNAMIC for b in world.bodies], bool)
        self._mass = np.where(is_dynamic, [b.mass for b in world.bodies], 0.0).reshape(
            -1
        )
        self._moment = np.where(
            is_dynamic, [b.moment for b in world.bodies], 0.0
        ).reshape(-1)
        is_scripted = [b.motion is Motion.SCRIPTED for b in world.bodies]
        self._scripted = np.array(is_scripted + [False] * len(world.walls), bool)
        self._conveyors = np.array([part.conveyor for _, part in world.surfaces])
        self._still = np.array([[*b.center, 0.0] for b in world.bodies]).reshape(-1, 3)
        self._even = (
            0.1 * float(np.hypot(*world.gravity)) / world.steps_per_second + 1e-6
        )
        """Difference of opening speeds, px/s, below which two points share an
        impulse.
        """
        self._time = 0.0
        self._smooth = np.zeros(2)
        """Loss and work up to the middle of the last step."""
        self._owed = np.zeros(2)
        """Loss and work of the other half of the last step."""
        self._struck: list[tuple[float, float, float]] = []
        """Time, loss and work of the impacts in this block."""
        self._spent = np.zeros(2)
        """Loss and work of the impacts of earlier blocks."""
        jointed_bodies = {
            body
            for joint in world.joints
            if joint.kind not in SPRINGS
            for body in (joint.first, joint.second)
        }
        self._unheld = is_dynamic & np.array(
            [k not in jointed_bodies for k in range(N)], bool
        )
        """Dynamic bodies without joints, (N,)."""
        self._first = True
        self._block = BLOCK // 8
        self.residual = 0.0
        """Fastest remaining closing of a contact in the last block, px/s."""
        self.overlap = 0.0
        """Deepest overlap in the last block, px."""

    def begin(self, step: Step, pose: Array, velocity: Array, roll: Array) -> None:
        """Record the half step to t = 0.

        `pose` (N, 3), `velocity` (N, 3) and `roll` (N, 2) at t = 0 are those of the
        scene.
        """
        self._pose, self._mean, self._roll = pose, velocity, roll
        self._turn = np.tile([1.0, 0.0, 0.0, 0.0], (len(pose), 1))
        self._after = np.zeros((len(self.moving), 3))
        self._steps.append(step)
        self.flush()

    def add(self, step: Step) -> bool:
        """Record a step; return True once a block is full and has been read."""
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
        """Read the recorded steps, and begin a new block."""
        self.read()
        self._count = self._held = 0

    def read(self) -> None:
        """Read the recorded steps, also in the middle of a block.

        Reading does not change the boundaries of blocks, so that results do not depend
        on it.
        """
        steps, self._steps = self._steps, []
        if not steps:
            return
        moving_count = len(self.moving)
        # Either all steps have loads or none.
        loads = [step.load for step in steps if step.load is not None]
        roll_changes = [
            load.roll_change for load in loads if load.roll_change is not None
        ]
        self._rolling |= bool(roll_changes)
        states = np.frombuffer(
            b"".join(step.states for step in steps), np.float64
        ).reshape(len(steps), moving_count, 6)
        velocities_after = states[:, :, 3:]
        velocities_before = np.concatenate([self._after[None], velocities_after[:-1]])
        for row, step in enumerate(steps):
            if step.velocities is not None:
                velocities_before[row] = step.velocities
        self._after = velocities_after[-1].copy()
        mean_velocities = self._all((velocities_before + velocities_after) / 2)
        poses = self._all(states[:, :, :3], self._still)
        rolls = np.cumsum([self._roll, *roll_changes], axis=0)
        energy_flow = self._contacts(
            steps, poses, self._all(velocities_before), self._all(velocities_after)
        )
        losses, works = self._compute_load_work(steps, mean_velocities, rolls)
        energy_flow[:, 0] += losses + self._compute_rolling_loss(
            steps, mean_velocities[:, :, 2]
        )
        energy_flow[:, 1] += (
            works
            + [step.motor_work for step in steps]
            + self._compute_lift_work(steps, states, velocities_before)
        )
        end_times = np.array([step.time for step in steps])
        # The velocities of a step are those of the middle between two steps: at its
        # end, half of its loss and work has occurred.
        balance = (
            np.cumsum(energy_flow, axis=0) + self._smooth + self._owed - energy_flow / 2
        )
        remainder = energy_flow[-1] / 2
        # At t = 0, nothing of the half step to t = 0 has occurred yet.
        if self._first:
            poses[0], mean_velocities[0], balance, remainder = (
                self._pose,
                self._mean,
                np.zeros((1, 2)),
                energy_flow[-1],
            )
            self._first = False
        vectors = turns = np.zeros((0, 0, 3))
        if self._rolling:
            durations = np.diff(np.concatenate([[self._time], end_times]))[:, None]
            vectors = np.empty(poses.shape)
            vectors[:, :, :2] = (rolls[1:] + rolls[:-1]) / 2 * durations[..., None]
            vectors[:, :, 2] = np.diff(
                np.concatenate([self._pose[None], poses])[:, :, 2], axis=0
            )
            turns = cumulative_quaternions(vectors, self._turn)
        self._samples(
            steps, end_times, poses, mean_velocities, balance, rolls, vectors, turns
        )
        if self._rolling:
            self._roll, self._turn = rolls[-1], turns[-1]
        self._smooth, self._owed = balance[-1], remainder
        self._time = float(end_times[-1])
        self._pose, self._mean = poses[-1], mean_velocities[-1]
        self._struck.clear()

    def _all(self, moving: Array, still: Array | None = None) -> Array:
        """Expand rows (S, M, 3) of moving bodies to all bodies (S, N, 3)."""
        S, N = len(moving), len(self.world.bodies)
        out = np.zeros((S, N, 3)) if still is None else np.tile(still, (S, 1, 1))
        out[:, self.moving] = moving
        return out

    def _compute_load_work(self, steps: list[Step], mean: Array, rolls: Array) -> Array:
        """Return loss and work (2, S) of lasting forces.

        `mean`: velocities (S, N, 3), `rolls` (S + 1, N, 2).
        """
        balance, durations = (
            np.zeros((2, len(steps))),
            np.array([step.h for step in steps]),
        )

        def work(forces: list[Array | None]) -> Array | float:
            loads_of_steps = [force for force in forces if force is not None]
            return (
                (np.array(loads_of_steps) * mean).sum(axis=(1, 2)) * durations
                if loads_of_steps
                else 0.0
            )

        loads = [step.load for step in steps if step.load is not None]
        balance[0] -= work([load.spend for load in loads])
        balance[1] += work([load.drive for load in loads])
        balance += [load.table_work for load in loads] if loads else 0.0
        is_scripted = self._scripted[: mean.shape[1], None]
        # The loads on a scripted body are balanced by the work of its script.
        if is_scripted.any():
            balance[1] -= work([load.total * is_scripted for load in loads])
        # A part of the energy that the table takes from a sphere's motion goes into its
        # roll and is not lost.
        if len(rolls) > 1:
            roll_changes = np.array([load.roll_change for load in loads])
            balance[0] -= (
                self._moment[:, None] * roll_changes * (rolls[:-1] + roll_changes / 2)
            ).sum(axis=(1, 2))
        return balance

    def _compute_lift_work(
        self, steps: list[Step], states: Array, before: Array
    ) -> Array:
        """Return the work (S,) against gravity when overlapping shapes are pushed
        apart.

        The engine displaces them without a velocity. `states` (S, M, 6); `before` (S,
        M, 3): velocities within the steps.
        """
        if self._first:
            return np.zeros(len(steps))
        durations = np.array([step.h for step in steps])
        poses = np.concatenate([self._pose[None, self.moving], states[:, :, :3]])
        displacements = np.diff(poses, axis=0) - durations[:, None, None] * before
        for row, step in enumerate(steps):
            # A struck body has two velocities in a step: its displacement differs from
            # both.
            if step.velocities_before_impacts is not None:
                displacements[
                    row, (step.velocities_before_impacts != step.velocities).any(axis=1)
                ] = 0.0
        scales = np.array([body.gravity_scale for body in self.world.bodies])
        weight: Array = self._mass * scales
        moved = displacements[:, :, :2] @ self.world.gravity
        lifted: Array = -moved @ weight[self.moving]
        return lifted

    def _compute_rolling_loss(self, steps: list[Step], spin: Array) -> Array:
        """Return the loss (S,) to rolling resistance; `spin` (S, N)."""
        if all(step.braking is NO_BRAKING for step in steps):
            return np.zeros(len(steps))
        rows = np.repeat(
            np.arange(len(steps)), [len(step.braking[1]) for step in steps]
        )
        pairs = np.concatenate([step.braking[0] for step in steps])
        # The world, index -1, does not spin.
        spins = np.pad(spin, ((0, 0), (0, 1)))
        spin_differences = np.abs(spins[rows, pairs[:, 0]] - spins[rows, pairs[:, 1]])
        impulse = np.array(
            [angular_impulse for step in steps for angular_impulse in step.braking[1]]
        )
        return np.bincount(rows, impulse * spin_differences, len(steps)).astype(
            np.float64
        )

    def _contacts(
        self, steps: list[Step], pose: Array, before: Array, after: Array
    ) -> Array:
        """Return loss and work (S, 2) of the steps' contacts, and add all contacts to
        the log.

        The energies of impacts go into a list of their own, as they occur within a
        step.
        """
        step_count, wall_count = len(steps), len(self.world.walls)
        end_times = np.array([contact_steps.time for contact_steps in steps])
        step_rows = np.repeat(
            np.arange(step_count),
            [len(contact_steps.numbers) // CONTACT_BYTES for contact_steps in steps],
        )
        # Contacts of steps with the same order are sorted at once.
        steps_by_order: dict[Order, list[int]] = {}
        for step_number, order in enumerate(
            [contact_steps.order for contact_steps in steps]
        ):
            steps_by_order.setdefault(order, []).append(step_number)
        numbers = [contact_steps.numbers for contact_steps in steps]
        for order, steps_of_order in steps_by_order.items():
            sorted_numbers, size = (
                order.sort(
                    b"".join(numbers[step_number] for step_number in steps_of_order)
                ),
                len(numbers[steps_of_order[0]]),
            )
            for number, step_number in enumerate(steps_of_order):
                numbers[step_number] = sorted_numbers[
                    size * number : size * (number + 1)
                ]
        touch = touching(
            b"".join(contact_steps.order.words for contact_steps in steps),
            b"".join(numbers),
        )
        first, second, impulse, count = (
            touch.first,
            touch.second,
            touch.impulse,
            touch.count,
        )
        points, normal = (touch.on_first + touch.on_second) / 2, touch.normal

        def widen(array: Array) -> Array:
            return np.concatenate(
                [array, np.zeros((step_count, wall_count, 3))], axis=1
            )

        # Walls are bodies at rest at the origin.
        centre_poses, mean_velocities, last_velocities = (
            widen(pose),
            widen((before + after) / 2),
            widen(after),
        )
        mean_velocities[:, self._scripted] = last_velocities[:, self._scripted]

        flat_rows = [
            step_rows * centre_poses.shape[1] + objects for objects in (first, second)
        ]

        def columns(of: Array, partner: int) -> Array:
            """(3, R) of one partner of each contact."""
            return np.ascontiguousarray(
                of.reshape(-1, 3).take(flat_rows[partner], axis=0).T
            )

        centers = [columns(centre_poses, partner) for partner in (0, 1)]

        def speed(
            motion: Array, partner: int, x: Array, y: Array
        ) -> tuple[Array, Array]:
            (vx, vy, spin), (cx, cy, _) = motion, centers[partner]
            return vx - spin * (y - cy), vy + spin * (x - cx)

        def along(
            one: tuple[Array, Array], other: tuple[Array, Array], way: Array
        ) -> Array:
            return (one[0] - other[0]) * way[:, 0] + (one[1] - other[1]) * way[:, 1]

        # The engine reports the sum of the impulses of two points. A point that opens
        # after the step has no impulse (Signorini's condition): the sum acts at the
        # other one, or between both if they open equally fast.
        first_motion, second_motion = (
            columns(last_velocities, 0),
            columns(last_velocities, 1),
        )
        point_places = [
            (points[:, number, 0], points[:, number, 1]) for number in (0, 1)
        ]
        opening = np.stack(
            [
                along(
                    speed(second_motion, 1, *spot),
                    speed(first_motion, 0, *spot),
                    normal,
                )
                for spot in point_places
            ]
        )
        share_of_first = np.clip(
            0.5 + (opening[1] - opening[0]) / (2 * self._even), 0.0, 1.0
        )
        share_of_first[count == 1] = 1.0
        # The impulse acts on each body at the body's own point: overlaps shorten levers.
        places = [
            share_of_first[:, None] * on[:, 0]
            + (1 - share_of_first[:, None]) * on[:, 1]
            for on in (touch.on_first, touch.on_second)
        ]
        v1, v2 = (
            speed(columns(mean_velocities, partner), partner, *places[partner].T)
            for partner in (0, 1)
        )
        # An impulse does its work at the mean of the velocities before and after the
        # step.
        losses = -along(v1, v2, impulse)
        works = np.zeros(len(step_rows))
        if self._conveyors.any():
            belt_losses, belt_works = belt_energies(
                self._conveyors, first, second, normal, impulse
            )
            losses, works = losses + belt_losses, works + belt_works
        for objects, sign, v in ((first, -1.0, v1), (second, 1.0, v2)):
            is_driven = self._scripted[objects]
            if is_driven.any():
                powers = v[0] * impulse[:, 0] + v[1] * impulse[:, 1]
                works[is_driven] += sign * powers[is_driven]
        energy_flow = np.stack(
            [np.bincount(step_rows, values, step_count) for values in (losses, works)],
            axis=1,
        ).astype(np.float64)
        if (count == 2).any():
            energy_flow[:, 0] += self._compute_displaced_loss(
                steps, touch, step_rows, places, (pose, before, after)
            )
        self._note_accuracy(opening, touch)
        # A sample at the time of an impulse shows the energy before it, except at
        # t = 0, where the impulse belongs to the scene's start.
        delay = 0.0 if self._first else 1e-9
        self._struck += [
            (kick.time + delay, kick.loss, kick.work)
            for contact_steps in steps
            for kick in contact_steps.events
        ]
        impacts_by_step = [
            (step_number, impacts)
            for step_number, contact_steps in enumerate(steps)
            for impacts in contact_steps.impacts
        ]
        for step_number, impacts in impacts_by_step:
            time = float(
                end_times[step_number]
                - (impacts.earlier.max() if len(impacts.earlier) else 0.0)
            )
            # An impact at the very begin of the step comes after the last sample.
            earliest_time = (
                float(end_times[step_number - 1]) if step_number else self._time
            ) + 1e-9
            self._struck.append((max(time, earliest_time), impacts.lost, impacts.work))
        contact_steps = np.concatenate(
            [
                step_rows,
                *(
                    np.full(len(b.first), step_number)
                    for step_number, b in impacts_by_step
                ),
            ]
        ).astype(np.int64)
        contact_times = np.concatenate(
            [
                end_times[step_rows],
                *(
                    end_times[step_number] - b.earlier
                    for step_number, b in impacts_by_step
                ),
            ]
        )
        next_samples = np.searchsorted(self.times, contact_times - 1e-12)
        is_in_clip = next_samples < len(self.times)
        one, other = (
            np.concatenate([contact_partners, *impact_partners])
            for contact_partners, impact_partners in (
                (first, [b.first for _, b in impacts_by_step]),
                (second, [b.second for _, b in impacts_by_step]),
            )
        )
        impulses = np.concatenate([impulse, *(b.impulse for _, b in impacts_by_step)])
        self.log.block(
            end_times,
            contact_steps[is_in_clip],
            next_samples[is_in_clip],
            one[is_in_clip],
            other[is_in_clip],
            impulses[is_in_clip],
            contact_times[is_in_clip],
        )
        return energy_flow

    def _note_accuracy(self, opening: Array, touch: Touching) -> None:
        """Record the fastest closing and the deepest overlap.

        `opening`: speeds (2, K) at which points open, px/s.
        """
        if not len(touch.count):
            return
        smallest_speeds = np.where(touch.count == 1, opening[0], opening.min(axis=0))
        self.residual = max(self.residual, -float(smallest_speeds.min()))
        self.overlap = max(self.overlap, float(touch.depth.max()))

    def _compute_displaced_loss(
        self,
        steps: list[Step],
        touch: Touching,
        row: Index,
        places: Sequence[Array],
        motion: tuple[Array, Array, Array],
    ) -> Array:
        """Return the energy (S,) that contacts lost in addition to that at their
        estimated places.

        The engine reports the sum of the impulses of a contact's two points, and
        `places` (two of (R, 2), on the first and on the second body) are an estimate of
        the place of the sum in the step `row` (R,). Contacts that contradict each other,
        like those of pieces with corners on a boundary, invalidate the estimate; the
        body's angular momentum then shows the error of the torque. `motion`: poses
        (S, N, 3), and velocities (S, N, 3) before and after.
        """
        pose, before, after = motion
        torque, leeway = self._torques(touch, row, places, pose)
        error = self._moment * (after - before)[:, :, 2] - torque
        for step_number, step in enumerate(steps):
            if step.load is not None:
                error[step_number] -= step.load.total[:, 2] * step.h
        # A larger error has another cause, which the balance must show.
        error[np.abs(error) > leeway] = 0.0
        losses = -error * (before + after)[:, :, 2] / 2
        inertia = np.stack([self._mass, self._mass, self._moment], axis=1)
        weights = self._mass * float(np.hypot(*self.world.gravity))
        # The smallest energy for the balance is a fall by a pixel.
        energy = (inertia * np.maximum(before**2, after**2)).sum(axis=2) / 2 + weights
        is_unbraked = np.array([[step.braking is NO_BRAKING] for step in steps])
        is_counted = is_unbraked & self._unheld
        is_counted &= np.abs(losses) > MISPLACED * energy
        return np.asarray((losses * is_counted).sum(axis=1))

    def _torques(
        self, touch: Touching, row: Index, places: Sequence[Array], pose: Array
    ) -> tuple[Array, Array]:
        """Return the angular impulses (S, N) of contacts at `places`, and their
        tolerances.

        The sum of a contact's two impulses acts somewhere between its two points.
        """
        body_count = pose.shape[1]
        torque, leeway = np.zeros(pose.shape[:2]), np.zeros(pose.shape[:2])
        points = (touch.on_first + touch.on_second) / 2
        # The engine reports one impulse for both points of a contact. It may act
        # anywhere between them, so that its torque has a range.
        offsets = np.where(
            (touch.count == 2)[:, None], points[:, 1] - points[:, 0], 0.0
        )
        torque_ranges = np.abs(cross(offsets, touch.impulse))
        partners = ((touch.first, 1.0), (touch.second, -1.0))
        for (objects, sign), place in zip(partners, places, strict=True):
            is_body = objects < body_count
            targets = row[is_body], objects[is_body]
            levers = place[is_body] - pose[targets][:, :2]
            np.add.at(torque, targets, sign * cross(levers, touch.impulse[is_body]))
            np.add.at(leeway, targets, torque_ranges[is_body])
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
        """Take the samples within these steps.

        `rolls` (S + 1, N, 2); `vectors` and `turns` are the rotations, if any body
        rolls.
        """
        sample_end, sample_begin = (
            int(np.searchsorted(self.times, ends[-1] + 1e-12, side="right")),
            self.sample_count,
        )
        sample_times = self.times[sample_begin:sample_end]
        step_rows = np.searchsorted(ends, sample_times - 1e-12)
        is_in_first_step = step_rows == 0

        def start(of: Array, before: Array | float) -> Array:
            start_values = of[step_rows - 1]
            start_values[is_in_first_step] = before
            return start_values

        # Poses change linearly between the ends of two steps, as do the energies.
        pose0, mean0, begin_times = (
            start(pose, self._pose),
            start(mean, self._mean),
            start(ends, self._time),
        )
        durations = ends[step_rows] - begin_times
        fractions = np.maximum(
            0.0, (sample_times - begin_times) / np.maximum(durations, 1e-300)
        )
        fractions[
            (durations <= 0) | (sample_times > ends[step_rows] - 1e-9 * durations)
        ] = 1.0
        factors = fractions[:, None, None]
        sample_poses, sample_velocities = (
            pose0 + factors * (pose[step_rows] - pose0),
            mean0 + factors * (mean[step_rows] - mean0),
        )
        for k in np.flatnonzero((fractions > 0) & (fractions < 1)).tolist():
            step = steps[step_rows[k]]
            if step.velocities_before_impacts is not None:
                self._inside(
                    step,
                    float(sample_times[k]),
                    fractions[k] * durations[k],
                    durations[k],
                    sample_poses[k],
                    sample_velocities[k],
                    pose0[k],
                    pose[step_rows[k]],
                )
        if self.scripts.busy:
            for k in range(len(sample_times)):
                self.scripts.sample(
                    float(sample_times[k]), sample_poses[k], sample_velocities[k]
                )
        sample_rolls = self._roll[None]
        if self._rolling:
            sample_rolls = rolls[step_rows] + factors * (
                rolls[step_rows + 1] - rolls[step_rows]
            )
            self.turns[sample_begin:sample_end] = then(
                quaternions_from_vectors(factors * vectors[step_rows]),
                start(turns, self._turn),
            )
        (
            self.poses[sample_begin:sample_end],
            self.velocities[sample_begin:sample_end],
            self.rolls[sample_begin:sample_end],
        ) = (
            sample_poses,
            sample_velocities,
            sample_rolls,
        )
        _refuse_infinities(self.world, sample_poses, sample_velocities, sample_times)
        balance_before = start(smooth, self._smooth)
        # Impacts change the balance at once: each counts from the first sample after
        # it.
        impact_balance = np.tile(self._spent, (len(sample_times), 1))
        for first_after, (_, *flow) in zip(
            np.searchsorted(
                sample_times + 1e-12,
                [impact_time for impact_time, _, _ in self._struck],
            ),
            self._struck,
            strict=True,
        ):
            impact_balance[first_after:] += flow
        balance = (
            balance_before
            + fractions[:, None] * (smooth[step_rows] - balance_before)
            + impact_balance
        )
        self._balance[sample_begin:sample_end] = np.column_stack(
            [
                *self._energy(
                    sample_times, sample_poses, sample_velocities, sample_rolls
                ),
                balance,
            ]
        )
        self.sample_count = sample_end
        for _, loss, work in self._struck:
            self._spent += np.array([loss, work])

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
        """Correct a sample within a step with impacts, in place.

        A struck body has its old velocity until the impact, and its new velocity from
        then on.
        """
        assert step.velocities_before_impacts is not None
        assert step.velocities is not None
        changed_rows = np.flatnonzero(
            (step.velocities_before_impacts != step.velocities).any(axis=1)
        )
        bodies = self.moving[changed_rows]
        impact_age = max(float(b.earlier.max()) for b in step.impacts if len(b.earlier))
        if time < step.time - impact_age:
            v[bodies] = step.velocities_before_impacts[changed_rows]
            x[bodies] = (
                pose0[bodies] + step.velocities_before_impacts[changed_rows] * since
            )
        else:
            v[bodies] = step.velocities[changed_rows]
            x[bodies] = pose1[bodies] - step.velocities[changed_rows] * (h - since)

    def _energy(
        self, times: Array, pose: Array, velocity: Array, roll: Array
    ) -> tuple[Array, Array]:
        """Return kinetic and potential energy (S,) of the dynamic bodies in S poses (S,
        N, 3).
        """
        square_speeds = velocity[..., 0] ** 2 + velocity[..., 1] ** 2
        square_spins = velocity[..., 2] ** 2 + (roll**2).sum(axis=-1)
        kinetic = (self._mass * square_speeds + self._moment * square_spins).sum(
            axis=1
        ) / 2
        gravity_potential = -(self._mass * (pose[..., :2] @ self.world.gravity)).sum(
            axis=1
        )
        return kinetic, gravity_potential + [
            self.loads.potential(x, time) if self.loads.busy else 0.0
            for time, x in zip(times.tolist(), pose, strict=True)
        ]

    def trajectory(
        self, effort: Effort, sampled: Callable[[Array], Trajectory]
    ) -> Trajectory:
        """Return the motion after the last step; `sampled` returns it at other
        times.
        """
        columns = slice(None) if self._rolling else slice(0)
        return Trajectory(
            times=self.times,
            names=tuple(body.name for body in self.world.bodies),
            poses=self.poses,
            velocities=self.velocities,
            rolls=self.rolls[:, columns],
            turns=self.turns[:, columns],
            contacts=self.log.result(),
            energy=Energy(*np.ascontiguousarray(self._balance.T)),
            effort=effort,
            sampled=sampled,
        )


def _refuse_infinities(
    world: World, pose: Array, velocity: Array, times: Array
) -> None:
    """Refuse a motion with infinite numbers. Raises InputError with the first body and
    time.
    """
    bad_indices = np.argwhere(
        ~(np.isfinite(pose).all(axis=2) & np.isfinite(velocity).all(axis=2))
    ).tolist()
    if bad_indices:
        k, body = bad_indices[0]
        path = f"objects.{world.bodies[body].name}"
        template = Message.MOTION_DIVERGED
        raise template.error_at(UNKNOWN_PLACE, path, time=times[k])
