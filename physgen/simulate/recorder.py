"""From steps of a run to samples: poses, contacts and the energy balance at exact
times.

Steps are read in blocks, so that arrays can be used instead of loops.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
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
    Flags,
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
    compose_quaternions,
    cumulative_quaternions,
    quaternions_from_vectors,
)

Index = NDArray[np.int64]
Index32 = NDArray[np.int32]


def _sum_by_code(codes: Index, impulse: Array) -> tuple[Index, Array]:
    """Return each code once, with the sum (K, 2) of its impulses."""
    unique_codes, rows = np.unique(codes, return_inverse=True)
    x_sums = np.bincount(rows, impulse[:, 0], len(unique_codes))
    y_sums = np.bincount(rows, impulse[:, 1], len(unique_codes))
    return unique_codes, np.stack([x_sums, y_sums], axis=1).astype(np.float64)


Touch = tuple[int, float, float]
"""Code of a pair, and begin and end of its touch, s."""


class ContactLog:
    """Collects the touches and impulses of all pairs, block by block."""

    def __init__(self, surfaces: tuple[str, ...], gap: float) -> None:
        """Create an empty log; touches of a pair with a gap of at most `gap` s
        are one.
        """
        self._surfaces = surfaces
        self._gap = gap
        self._open_touches: dict[int, float] = {}
        """Begins, s, of the touches that last at the end of the block, by pair."""
        self._touches: list[Touch] = []
        self._sums: list[tuple[Index, Array]] = []
        """Codes of sample and pair, with the sums of impulses, of each block."""

    def add_block(
        self,
        times: Array,
        step: Index,
        sample: Index,
        first: Index,
        second: Index,
        impulse: Array,
        contact_time: Array,
    ) -> None:
        """Add R contacts of S steps that end at `times` (S,).

        `step`, `sample` (R,): the step of each contact, and the sample after it;
        `impulse` (R, 2) g·px/s on the first; `contact_time` (R,) s: the end of the
        step, or the time of an impact.
        """
        surface_count = len(self._surfaces)
        # A pair has one code in both orders: the lesser object comes first.
        is_swapped = first > second
        lesser = np.where(is_swapped, second, first)
        greater = np.where(is_swapped, first, second)
        pair_codes = lesser * surface_count + greater
        impulses = np.where(is_swapped[:, None], -impulse, impulse)
        sample_codes = sample * (surface_count * surface_count) + pair_codes
        self._sums.append(_sum_by_code(sample_codes, impulses))
        self._collect_touches(times, step, pair_codes, contact_time)

    def _collect_touches(
        self, times: Array, step: Index, pair: Index, contact_time: Array
    ) -> None:
        """Collect runs of consecutive steps with a contact, by pair.

        A run at the end of the block stays open, and continues in the next block.
        """
        # Sort by pair, step and time, and keep the earliest contact of a pair in each
        # step.
        order = np.lexsort((contact_time, step, pair))
        pair = pair[order]
        step = step[order]
        contact_time = contact_time[order]
        is_first = np.ones(len(pair), bool)
        is_first[1:] = (pair[1:] != pair[:-1]) | (step[1:] != step[:-1])
        pair = pair[is_first]
        step = step[is_first]
        contact_time = contact_time[is_first]
        # A touch begins with a new pair, or after a step without contact.
        is_start = np.ones(len(pair), bool)
        is_start[1:] = (pair[1:] != pair[:-1]) | (step[1:] != step[:-1] + 1)
        begins = np.flatnonzero(is_start)
        ends = np.append(begins[1:], len(pair))[: len(begins)] - 1
        runs = zip(
            pair[begins].tolist(),
            step[begins].tolist(),
            step[ends].tolist(),
            contact_time[begins].tolist(),
            strict=True,
        )
        self._close_touches(times, runs)

    def _close_touches(
        self, times: Array, runs: Iterable[tuple[int, int, int, float]]
    ) -> None:
        """Add the touches that ended in a block, and keep the open ones.

        `runs`: pair, first and last step, and first time of each run of contacts.
        """
        # A touch may last over several blocks of steps. It is open until a step without
        # it follows.
        open_touches = {}
        continued_pairs = set()
        for pair, first_step, last_step, first_time in runs:
            begin_time = first_time
            if first_step == 0 and pair in self._open_touches:
                begin_time = self._open_touches[pair]
                continued_pairs.add(pair)
            if last_step == len(times) - 1:
                open_touches[pair] = begin_time
            else:
                self._touches.append((pair, begin_time, float(times[last_step + 1])))
        # Touches of the block before that did not continue ended with it.
        for pair in self._open_touches.keys() - continued_pairs:
            self._touches.append((pair, self._open_touches[pair], float(times[0])))
        self._open_touches = open_touches

    def _merge_touches(self, touches: list[Touch]) -> list[Touch]:
        """Merge touches of a pair with a gap of at most `gap` s; sorted by pair and
        begin.
        """
        merged_touches: list[Touch] = []
        for pair, begin, end in touches:
            last_pair = -1
            last_begin = 0.0
            last_end = 0.0
            if merged_touches:
                last_pair, last_begin, last_end = merged_touches[-1]
            # Contacts at rest flicker: a short gap does not end a touch.
            if last_pair == pair and begin - last_end <= self._gap:
                merged_touches[-1] = pair, last_begin, max(end, last_end)
            else:
                merged_touches.append((pair, begin, end))
        return merged_touches

    def result(self) -> Contacts:
        """Return all contacts; touches are sorted by begin, then by pair."""
        surface_count = len(self._surfaces)
        open_touches = [(pair, t, np.inf) for pair, t in self._open_touches.items()]
        touches = self._merge_touches(sorted([*self._touches, *open_touches]))
        touches.sort(key=_begin_and_pair)
        pairs = [divmod(pair, surface_count) for pair, _, _ in touches]
        touch_times = [(begin, end) for _, begin, end in touches]
        impulse_rows, impulses = self._sum_impulses()
        return Contacts(
            surfaces=self._surfaces,
            touch_pairs=np.array(pairs, np.int32).reshape(-1, 2),
            touch_times=np.array(touch_times).reshape(-1, 2),
            impulse_rows=impulse_rows,
            impulses=impulses,
        )

    def _sum_impulses(self) -> tuple[Index32, Array]:
        """Return sample, first and second object (R, 3) of the impulses (R, 2)."""
        # Sum the impulses again over all blocks, since a sample may span two of them.
        all_codes = [np.zeros(0, np.int64)]
        all_impulses = [np.zeros((0, 2))]
        for codes, impulses in self._sums:
            all_codes.append(codes)
            all_impulses.append(impulses)
        sample_codes, sums = _sum_by_code(
            np.concatenate(all_codes), np.concatenate(all_impulses)
        )
        is_nonzero = sums.any(axis=1)
        sample_codes = sample_codes[is_nonzero]
        sums = sums[is_nonzero]
        surface_count = max(len(self._surfaces), 1)
        # Codes number sample, first and second object in one integer; two divisions
        # recover them.
        samples, pair_codes = np.divmod(sample_codes, surface_count * surface_count)
        first, second = np.divmod(pair_codes, surface_count)
        rows = np.stack([samples, first, second], axis=1)
        return rows.astype(np.int32).reshape(-1, 3), sums


def _begin_and_pair(touch: Touch) -> tuple[float, int, float]:
    """Return the sort key of a touch."""
    pair, begin, end = touch
    return begin, pair, end


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


@dataclass(frozen=True)
class BlockMotion:
    """The motion of the N bodies in the S steps of a block."""

    times: Array  # (S,) s: ends of the steps
    poses: Array  # (S, N, 3) at the ends
    velocities: Array  # (S, N, 3): means of the velocities before and after the ends
    balance: Array  # (S, 2) g·px²/s²: loss and work up to the ends
    rolls: Array  # (S + 1, N, 2) rad/s, from the begin of the first step on
    rotation_vectors: Array  # (S, N, 3) rad: rotations in the steps, if any body rolls
    turns: Array  # (S, N, 4): rotations up to the ends, if any body rolls


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
        world = self.world
        names = tuple(name for name, _ in world.surfaces)
        self.log = ContactLog(names, 2 / world.steps_per_second)
        self._steps: list[Step] = []
        self._block_steps = self._block_bytes = 0
        self._max_block_steps = BLOCK // 8
        self.residual = 0.0
        """Fastest remaining closing of a contact in the last block, px/s."""
        self.overlap = 0.0
        """Deepest overlap in the last block, px."""
        self._equal_speeds = (
            0.1 * float(np.hypot(*world.gravity)) / world.steps_per_second + 1e-6
        )
        """Difference of opening speeds, px/s, below which two points share an
        impulse.
        """
        self._time = 0.0
        self._is_first_block = True
        self._prepare_samples()
        self._prepare_bodies()
        self._prepare_balance()

    def _prepare_samples(self) -> None:
        """Create the arrays of samples."""
        sample_count = len(self.times)
        body_count = len(self.world.bodies)
        self.poses = np.zeros((sample_count, body_count, 3))
        self.velocities = np.zeros((sample_count, body_count, 3))
        self.rolls = np.zeros((sample_count, body_count, 2))
        self.turns = np.zeros((sample_count, body_count, 4))
        self._balance = np.zeros((sample_count, 4))
        self._has_rolls = False
        self.sample_count = 0
        """Number of samples so far."""

    def _prepare_bodies(self) -> None:
        """Collect the properties of bodies that their energies depend on."""
        world = self.world
        bodies = world.bodies
        motions = [body.motion for body in bodies]
        is_dynamic = np.array([motion is Motion.DYNAMIC for motion in motions], bool)
        is_scripted = [motion is Motion.SCRIPTED for motion in motions]
        masses = np.array([body.mass for body in bodies]).reshape(-1)
        moments = np.array([body.moment for body in bodies]).reshape(-1)
        # A mass of zero excludes static and scripted bodies from all sums of energy.
        self._mass = np.where(is_dynamic, masses, 0.0)
        self._moment = np.where(is_dynamic, moments, 0.0)
        self._is_scripted = np.array(is_scripted + [False] * len(world.walls), bool)
        self._conveyors = np.array([part.conveyor for _, part in world.surfaces])
        self._centers = np.array([[*b.center, 0.0] for b in bodies]).reshape(-1, 3)
        self._is_unjointed = is_dynamic & ~_has_joint(world)
        """Whether a body is dynamic without joints, (N,)."""

    def _prepare_balance(self) -> None:
        """Start the energy balance, in g·px²/s²."""
        self._flow_to_middle = np.zeros(2)
        """Loss and work up to the middle of the last step."""
        self._flow_after_middle = np.zeros(2)
        """Loss and work of the other half of the last step."""
        self._impact_flows: list[tuple[float, float, float]] = []
        """Time, loss and work of the impacts in this block."""
        self._earlier_impact_flow = np.zeros(2)
        """Loss and work of the impacts of earlier blocks."""

    def begin(self, step: Step, pose: Array, velocity: Array, roll: Array) -> None:
        """Record the half step to t = 0.

        `pose` (N, 3), `velocity` (N, 3) and `roll` (N, 2) at t = 0 are those of the
        scene.
        """
        self._pose = pose
        self._mean_velocity = velocity
        self._roll = roll
        self._turn = np.tile([1.0, 0.0, 0.0, 0.0], (len(pose), 1))
        self._last_velocities = np.zeros((len(self.moving), 3))
        self._steps.append(step)
        self.flush()

    def add(self, step: Step) -> bool:
        """Record a step; return True once a block is full and has been read."""
        if not self._block_steps:
            self.residual = self.overlap = 0.0
        self._steps.append(step)
        self._block_steps += 1
        self._block_bytes += len(step.numbers)
        if (
            self._block_steps < self._max_block_steps
            and self._block_bytes < BLOCK_BYTES
        ):
            return False
        self.flush()
        self._max_block_steps = BLOCK
        return True

    def flush(self) -> None:
        """Read the recorded steps, and begin a new block."""
        self.read()
        self._block_steps = self._block_bytes = 0

    def read(self) -> None:
        """Read the recorded steps, also in the middle of a block.

        Reading does not change the boundaries of blocks, so that results do not depend
        on it.
        """
        steps = self._steps
        self._steps = []
        if not steps:
            return
        # The mean of the velocities before and after a step gives its work without
        # error.
        states, velocities_before = self._read_states(steps)
        velocities_after = states[:, :, 3:]
        self._last_velocities = velocities_after[-1].copy()
        mean_velocities = self._expand((velocities_before + velocities_after) / 2)
        poses = self._expand(states[:, :, :3], self._centers)
        rolls = self._cumulative_rolls(steps)
        energy_flow = self._read_contacts(
            steps,
            poses,
            self._expand(velocities_before),
            self._expand(velocities_after),
        )
        lift_works = self._compute_lift_work(steps, states, velocities_before)
        energy_flow += self._lasting_flow(steps, mean_velocities, rolls, lift_works)
        balance, remainder = self._balance_at_ends(energy_flow)
        if self._is_first_block:
            poses[0], mean_velocities[0] = self._pose, self._mean_velocity
            self._is_first_block = False
        times = _end_times(steps)
        vectors, turns = self._rotations(times, poses, rolls)
        motion = BlockMotion(
            times, poses, mean_velocities, balance, rolls, vectors, turns
        )
        self._take_samples(steps, motion)
        self._end_block(motion, remainder)

    def _balance_at_ends(self, energy_flow: Array) -> tuple[Array, Array]:
        """Return loss and work up to the ends of steps (S, 2), and the remainder (2,) of
        the last step after its end.

        `energy_flow` (S, 2): loss and work in each step.
        """
        # At t = 0, nothing of the half step to t = 0 has occurred yet.
        if self._is_first_block:
            return np.zeros((1, 2)), energy_flow[-1]
        # The velocities of a step are those of the middle between two steps: at its
        # end, half of its loss and work has occurred.
        balance = np.cumsum(energy_flow, axis=0) + self._flow_to_middle
        balance = balance + self._flow_after_middle - energy_flow / 2
        return balance, energy_flow[-1] / 2

    def _lasting_flow(
        self, steps: list[Step], velocities: Array, rolls: Array, lift_works: Array
    ) -> Array:
        """Return loss and work (S, 2) of lasting forces, rolling, motors and lifts.

        `velocities` (S, N, 3): the mean ones of each step; `lift_works` (S,).
        """
        losses, works = self._compute_load_work(steps, velocities, rolls)
        motor_works = [step.motor_work for step in steps]
        rolling_losses = self._compute_rolling_loss(steps, velocities[:, :, 2])
        all_losses = losses + rolling_losses
        all_works = works + motor_works + lift_works
        return np.stack([all_losses, all_works], axis=1)

    def _read_states(self, steps: list[Step]) -> tuple[Array, Array]:
        """Return the states (S, M, 6) at the ends of steps, and the velocities (S, M, 3)
        within the steps.
        """
        states = np.frombuffer(b"".join(step.states for step in steps), np.float64)
        states = states.reshape(len(steps), len(self.moving), 6)
        velocities = np.concatenate([self._last_velocities[None], states[:-1, :, 3:]])
        for row, step in enumerate(steps):
            if step.velocities is not None:
                velocities[row] = step.velocities
        return states, velocities

    def _cumulative_rolls(self, steps: list[Step]) -> Array:
        """Return the roll of spheres from the begin of the first step on.

        Its shape is (S + 1, N, 2), or (1, N, 2) without spheres that roll.
        """
        # Either all steps have loads or none.
        loads = [step.load for step in steps if step.load is not None]
        changes = [load.roll_change for load in loads if load.roll_change is not None]
        self._has_rolls |= bool(changes)
        return np.cumsum([self._roll, *changes], axis=0)

    def _rotations(
        self, times: Array, poses: Array, rolls: Array
    ) -> tuple[Array, Array]:
        """Return the rotation vectors of the steps, and the rotations up to their ends.

        Both are empty if no body rolls.
        """
        if not self._has_rolls:
            no_rotations = np.zeros((0, 0, 3))
            return no_rotations, no_rotations
        # A sphere turns about the two axes in the picture by its roll, and about the
        # viewing axis by its angle. Rotations do not commute: they are composed step by
        # step as quaternions.
        durations = np.diff(np.concatenate([[self._time], times]))[:, None]
        vectors = np.empty(poses.shape)
        mean_rolls = (rolls[1:] + rolls[:-1]) / 2
        vectors[:, :, :2] = mean_rolls * durations[..., None]
        angles = np.concatenate([self._pose[None], poses])[:, :, 2]
        vectors[:, :, 2] = np.diff(angles, axis=0)
        return vectors, cumulative_quaternions(vectors, self._turn)

    def _end_block(self, motion: BlockMotion, remainder: Array) -> None:
        """Let the next block start from the end of this one.

        `remainder` (2,): loss and work of the second half of the last step.
        """
        if self._has_rolls:
            self._roll = motion.rolls[-1]
            self._turn = motion.turns[-1]
        self._flow_to_middle = motion.balance[-1]
        self._flow_after_middle = remainder
        self._time = float(motion.times[-1])
        self._pose = motion.poses[-1]
        self._mean_velocity = motion.velocities[-1]
        self._impact_flows.clear()

    def _expand(self, rows: Array, static_rows: Array | None = None) -> Array:
        """Expand rows (S, M, 3) of moving bodies to all bodies (S, N, 3)."""
        step_count = len(rows)
        body_count = len(self.world.bodies)
        if static_rows is None:
            expanded_rows = np.zeros((step_count, body_count, 3))
        else:
            expanded_rows = np.tile(static_rows, (step_count, 1, 1))
        expanded_rows[:, self.moving] = rows
        return expanded_rows

    def _compute_load_work(self, steps: list[Step], mean: Array, rolls: Array) -> Array:
        """Return loss and work (2, S) of lasting forces.

        `mean`: velocities (S, N, 3), `rolls` (S + 1, N, 2).
        """
        balance = np.zeros((2, len(steps)))
        durations = np.array([step.h for step in steps])
        loads = [step.load for step in steps if step.load is not None]
        if not loads:
            return balance
        balance[0] -= _work([load.spend for load in loads], mean, durations)
        balance[1] += _work([load.drive for load in loads], mean, durations)
        balance += [load.table_work for load in loads]
        is_scripted = self._is_scripted[: mean.shape[1], None]
        # The loads on a scripted body are balanced by the work of its script.
        if is_scripted.any():
            loads_of_scripts = [load.total * is_scripted for load in loads]
            balance[1] -= _work(loads_of_scripts, mean, durations)
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
        if self._is_first_block:
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
        # Power of a torque between two bodies: the torque times their relative spin.
        # Rolling resistance always opposes this spin.
        spin_differences = np.abs(spins[rows, pairs[:, 0]] - spins[rows, pairs[:, 1]])
        impulse = np.array(
            [angular_impulse for step in steps for angular_impulse in step.braking[1]]
        )
        return np.bincount(rows, impulse * spin_differences, len(steps)).astype(
            np.float64
        )

    def _read_contacts(
        self, steps: list[Step], pose: Array, before: Array, after: Array
    ) -> Array:
        """Return loss and work (S, 2) of the steps' contacts, and add all contacts to
        the log.

        The energies of impacts go into a list of their own, as they occur within a
        step. `pose`, `before`, `after` (S, N, 3): poses at the ends of the steps,
        velocities before and after.
        """
        counts = [len(step.numbers) // CONTACT_BYTES for step in steps]
        step_rows = np.repeat(np.arange(len(steps)), counts)
        words = b"".join(step.order.words for step in steps)
        touch = touching(words, b"".join(_sorted_numbers(steps)))
        # Work of contacts is the impulse times the mean velocity of the contact point.
        first, second = self._partner_motions(touch, step_rows, pose, before, after)
        opening = _opening_speeds(touch, first, second)
        places = self._impulse_places(touch, opening)
        losses, works = self._contact_works(touch, first, second, places)
        loss_sums = np.bincount(step_rows, losses, len(steps))
        work_sums = np.bincount(step_rows, works, len(steps))
        energy_flow = np.stack([loss_sums, work_sums], axis=1).astype(np.float64)
        if (touch.count == 2).any():
            energy_flow[:, 0] += self._compute_displaced_loss(
                steps, touch, step_rows, places, (pose, before, after)
            )
        self._note_accuracy(opening, touch)
        end_times = np.array([step.time for step in steps])
        self._collect_impact_flows(steps, end_times)
        self._log_contacts(steps, end_times, step_rows, touch)
        return energy_flow

    def _partner_motions(
        self,
        touch: Touching,
        step_rows: Index,
        pose: Array,
        before: Array,
        after: Array,
    ) -> tuple[PartnerMotion, PartnerMotion]:
        """Return the motions of the first and of the second partners of contacts."""
        # Walls are bodies at rest at the origin.
        zeros = np.zeros((len(pose), len(self.world.walls), 3))
        poses = np.concatenate([pose, zeros], axis=1)
        mean_velocities = np.concatenate([(before + after) / 2, zeros], axis=1)
        last_velocities = np.concatenate([after, zeros], axis=1)
        # A script sets the velocity for the whole step, and no contact changes it.
        mean_velocities[:, self._is_scripted] = last_velocities[:, self._is_scripted]
        partners = []
        for objects in (touch.first, touch.second):
            flat_rows = step_rows * poses.shape[1] + objects
            partners.append(
                PartnerMotion(
                    _columns(poses, flat_rows),
                    _columns(mean_velocities, flat_rows),
                    _columns(last_velocities, flat_rows),
                )
            )
        return partners[0], partners[1]

    def _impulse_places(self, touch: Touching, opening: Array) -> list[Array]:
        """Return the places of the impulses of R contacts, two of (R, 2), px.

        `opening` (2, R): speeds at which the two points open. The engine reports the
        sum of the impulses of two points. A point that opens after the step has no
        impulse (Signorini's condition): the sum acts at the other one, or between both
        if they open equally fast. The impulse acts on each body at the body's own
        point: overlaps shorten levers.
        """
        # The share falls from 1 to 0 within a small range of speeds: a jump would let
        # the point of an impulse flicker.
        speed_difference = opening[1] - opening[0]
        share_of_first = np.clip(
            0.5 + speed_difference / (2 * self._equal_speeds), 0.0, 1.0
        )
        # A contact of one point has its whole impulse there.
        share_of_first[touch.count == 1] = 1.0
        share = share_of_first[:, None]
        places = []
        for points in (touch.on_first, touch.on_second):
            places.append(share * points[:, 0] + (1 - share) * points[:, 1])
        return places

    def _contact_works(
        self,
        touch: Touching,
        first: PartnerMotion,
        second: PartnerMotion,
        places: Sequence[Array],
    ) -> tuple[Array, Array]:
        """Return the loss and the work of each contact, two of (R,), g·px²/s².

        An impulse does its work at the mean of the velocities before and after the
        step.
        """
        impulse = touch.impulse
        velocity1 = first.point_velocity(first.mean_velocity, *places[0].T)
        velocity2 = second.point_velocity(second.mean_velocity, *places[1].T)
        losses = -_relative_speed(velocity1, velocity2, impulse)
        works = np.zeros(len(impulse))
        if self._conveyors.any():
            belt_losses, belt_works = belt_energies(
                self._conveyors, touch.first, touch.second, touch.normal, impulse
            )
            losses = losses + belt_losses
            works = works + belt_works
        # The path of a scripted body does the work of its contacts.
        partners = (touch.first, -1.0, velocity1), (touch.second, 1.0, velocity2)
        for objects, sign, velocity in partners:
            is_scripted = self._is_scripted[objects]
            if is_scripted.any():
                powers = velocity[0] * impulse[:, 0] + velocity[1] * impulse[:, 1]
                works[is_scripted] += sign * powers[is_scripted]
        return losses, works

    def _collect_impact_flows(self, steps: list[Step], end_times: Array) -> None:
        """Collect the times and energies of impacts and other events in these steps."""
        # A sample at the time of an impulse shows the energy before it, except at
        # t = 0, where the impulse belongs to the scene's start.
        delay = 1e-9
        if self._is_first_block:
            delay = 0.0
        for step in steps:
            for event in step.events:
                flow = event.time + delay, event.loss, event.work
                self._impact_flows.append(flow)
        begin_times = [self._time, *end_times[:-1].tolist()]
        for step, begin, end in zip(
            steps, begin_times, end_times.tolist(), strict=True
        ):
            for impacts in step.impacts:
                time = end - float(impacts.earlier.max(initial=0.0))
                # An impact at the very begin of the step comes after the last sample.
                time = max(time, begin + 1e-9)
                self._impact_flows.append((time, impacts.loss, impacts.work))

    def _log_contacts(
        self, steps: list[Step], end_times: Array, step_rows: Index, touch: Touching
    ) -> None:
        """Add the contacts and impacts before the last sample to the log."""
        contact_steps = [step_rows]
        contact_times = [end_times[step_rows]]
        first = [touch.first]
        second = [touch.second]
        impulse = [touch.impulse]
        # Impacts occur at their own times within the step, before the contacts at its
        # end.
        for number, step in enumerate(steps):
            for impacts in step.impacts:
                contact_steps.append(np.full(len(impacts.first), number))
                contact_times.append(end_times[number] - impacts.earlier)
                first.append(impacts.first)
                second.append(impacts.second)
                impulse.append(impacts.impulse)
        all_times = np.concatenate(contact_times)
        next_samples = np.searchsorted(self.times, all_times - 1e-12)
        # Contacts after the last sample belong to no frame.
        is_in_clip = next_samples < len(self.times)
        self.log.add_block(
            end_times,
            np.concatenate(contact_steps).astype(np.int64)[is_in_clip],
            next_samples[is_in_clip],
            np.concatenate(first)[is_in_clip],
            np.concatenate(second)[is_in_clip],
            np.concatenate(impulse)[is_in_clip],
            all_times[is_in_clip],
        )

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
        # Angular momentum is exact: moment * change of spin = torques of contacts +
        # torques of loads. A difference shows that the impulses act at other places
        # than estimated.
        torque, leeway = self._torques(touch, row, places, pose)
        error = self._moment * (after - before)[:, :, 2] - torque
        for step_number, step in enumerate(steps):
            if step.load is not None:
                error[step_number] -= step.load.total[:, 2] * step.h
        # A larger error has another cause, which the balance must show.
        error[np.abs(error) > leeway] = 0.0
        # The missing torque does its work at the mean spin of the step.
        losses = -error * (before + after)[:, :, 2] / 2
        inertia = np.stack([self._mass, self._mass, self._moment], axis=1)
        weights = self._mass * float(np.hypot(*self.world.gravity))
        # The smallest energy for the balance is a fall by a pixel.
        energy = (inertia * np.maximum(before**2, after**2)).sum(axis=2) / 2 + weights
        is_unbraked = np.array([[step.braking is NO_BRAKING] for step in steps])
        is_counted = is_unbraked & self._is_unjointed
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
        torque = np.zeros(pose.shape[:2])
        leeway = np.zeros(pose.shape[:2])
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

    def _take_samples(self, steps: list[Step], motion: BlockMotion) -> None:
        """Take the samples within these steps.

        Poses change linearly between the ends of two steps, as do the energies.
        """
        # The engine's steps do not depend on the frame rate: a sample lies anywhere
        # within its step, or at one of its ends within rounding errors.
        end_times = motion.times
        sample_end = int(
            np.searchsorted(self.times, end_times[-1] + 1e-12, side="right")
        )
        samples = slice(self.sample_count, sample_end)
        times = self.times[samples]
        step_rows = np.searchsorted(end_times, times - 1e-12)
        begin_times = _values_before(end_times, step_rows, self._time)
        durations = end_times[step_rows] - begin_times
        fractions = (times - begin_times) / np.maximum(durations, 1e-300)
        fractions = np.maximum(0.0, fractions)
        is_at_end = times > end_times[step_rows] - 1e-9 * durations
        # A sample at the end of a step must not mix in the pose before, not even by a
        # rounding error.
        fractions[(durations <= 0) | is_at_end] = 1.0
        self._sample_motion(samples, steps, motion, step_rows, fractions, durations)
        self._sample_energy(samples, motion, step_rows, fractions)
        self.sample_count = sample_end

    def _sample_motion(
        self,
        samples: slice,
        steps: list[Step],
        motion: BlockMotion,
        step_rows: Index,
        fractions: Array,
        durations: Array,
    ) -> None:
        """Write the poses, velocities and rotations of samples.

        `step_rows`, `fractions`, `durations` (K,): the step of each sample, the part of
        the step before the sample, and the step's length, s.
        """
        times = self.times[samples]
        # Between the ends of a step, poses and velocities are linear.
        factors = fractions[:, None, None]
        old_poses = _values_before(motion.poses, step_rows, self._pose)
        old_velocities = _values_before(
            motion.velocities, step_rows, self._mean_velocity
        )
        poses = old_poses + factors * (motion.poses[step_rows] - old_poses)
        velocities = old_velocities + factors * (
            motion.velocities[step_rows] - old_velocities
        )
        # An impact within the step bends the path at its own time.
        for k in np.flatnonzero((fractions > 0) & (fractions < 1)).tolist():
            step = steps[step_rows[k]]
            if step.velocities_before_impacts is not None:
                self._correct_sample(
                    step,
                    float(times[k]),
                    fractions[k] * durations[k],
                    durations[k],
                    poses[k],
                    velocities[k],
                    old_poses[k],
                    motion.poses[step_rows[k]],
                )
        if self.scripts.busy:
            for k, time in enumerate(times.tolist()):
                self.scripts.sample(time, poses[k], velocities[k])
        self.poses[samples], self.velocities[samples] = poses, velocities
        self._sample_rotations(samples, motion, step_rows, factors)
        _refuse_infinities(self.world, poses, velocities, times)

    def _sample_rotations(
        self, samples: slice, motion: BlockMotion, step_rows: Index, factors: Array
    ) -> None:
        """Write the rolls and rotations of spheres on a table."""
        if not self._has_rolls:
            self.rolls[samples] = self._roll[None]
            return
        rolls = motion.rolls
        roll_changes = rolls[step_rows + 1] - rolls[step_rows]
        self.rolls[samples] = rolls[step_rows] + factors * roll_changes
        old_turns = _values_before(motion.turns, step_rows, self._turn)
        rotations = quaternions_from_vectors(
            factors * motion.rotation_vectors[step_rows]
        )
        self.turns[samples] = compose_quaternions(rotations, old_turns)

    def _sample_energy(
        self, samples: slice, motion: BlockMotion, step_rows: Index, fractions: Array
    ) -> None:
        """Write the energies and the balance of samples."""
        times = self.times[samples]
        # Impacts change the balance at once: each counts from the first sample after
        # it.
        impact_balance = np.tile(self._earlier_impact_flow, (len(times), 1))
        impact_times = [time for time, _, _ in self._impact_flows]
        first_samples = np.searchsorted(times + 1e-12, impact_times)
        for number, (_, loss, work) in enumerate(self._impact_flows):
            impact_balance[first_samples[number] :] += [loss, work]
            self._earlier_impact_flow += [loss, work]
        old_balance = _values_before(motion.balance, step_rows, self._flow_to_middle)
        changes = fractions[:, None] * (motion.balance[step_rows] - old_balance)
        balance = old_balance + changes + impact_balance
        kinetic, potential = self._energy(
            times, self.poses[samples], self.velocities[samples], self.rolls[samples]
        )
        self._balance[samples] = np.column_stack([kinetic, potential, balance])

    def _correct_sample(
        self,
        step: Step,
        time: float,
        seconds: float,
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
        # Before the first impact, count forward from the beginning of the step with the
        # old velocity; after it, count back from the end with the new one. Both ends
        # then agree with the engine.
        if time < step.time - impact_age:
            v[bodies] = step.velocities_before_impacts[changed_rows]
            x[bodies] = (
                pose0[bodies] + step.velocities_before_impacts[changed_rows] * seconds
            )
        else:
            v[bodies] = step.velocities[changed_rows]
            x[bodies] = pose1[bodies] - step.velocities[changed_rows] * (h - seconds)

    def _energy(
        self, times: Array, pose: Array, velocity: Array, roll: Array
    ) -> tuple[Array, Array]:
        """Return kinetic and potential energy (S,) of the dynamic bodies in S poses (S,
        N, 3).
        """
        # Kinetic energy m v² / 2 + I w² / 2, with the roll of spheres about the other
        # two axes; the moments of a sphere are equal about all axes. Potential energy
        # -m g·x in gravity, plus that of springs and fields.
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
        self, effort: Effort, sample_at: Callable[[Array], Trajectory]
    ) -> Trajectory:
        """Return the motion after the last step; `sample_at` returns it at other
        times.
        """
        if self._has_rolls:
            columns = slice(None)
        else:
            columns = slice(0)
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
            resample=sample_at,
        )


@dataclass(frozen=True)
class PartnerMotion:
    """Motion of one partner of each of R contacts."""

    center: Array  # (3, R): px, px, rad
    mean_velocity: Array  # (3, R): mean of the velocities before and after the step
    last_velocity: Array  # (3, R) after the step

    def point_velocity(
        self, velocity: Array, x: Array, y: Array
    ) -> tuple[Array, Array]:
        """Return the velocities (R,), (R,) px/s of points of the partners.

        The velocity of a point at the arm r is v + spin x r.
        """
        vx, vy, spin = velocity
        cx, cy, _ = self.center
        return vx - spin * (y - cy), vy + spin * (x - cx)


def _end_times(steps: list[Step]) -> Array:
    """Return the times of the ends of steps, (S,) s."""
    return np.array([step.time for step in steps])


def _has_joint(world: World) -> Flags:
    """Return whether each body has a joint other than a spring, (N,)."""
    jointed_bodies = set[int | None]()
    for joint in world.joints:
        if joint.kind not in SPRINGS:
            jointed_bodies |= {joint.first, joint.second}
    return np.array([k in jointed_bodies for k in range(len(world.bodies))], bool)


def _work(forces: list[Array | None], mean: Array, durations: Array) -> Array | float:
    """Return the work (S,) of forces (N, 3) at the mean velocities (S, N, 3)."""
    present_forces = [force for force in forces if force is not None]
    if not present_forces:
        return 0.0
    powers = (np.array(present_forces) * mean).sum(axis=(1, 2))
    return np.asarray(powers * durations)


def _columns(values: Array, flat_rows: Index) -> Array:
    """Return the values (3, R) of some rows of an array (S, N, 3)."""
    return np.ascontiguousarray(values.reshape(-1, 3).take(flat_rows, axis=0).T)


def _relative_speed(
    first: tuple[Array, Array], second: tuple[Array, Array], direction: Array
) -> Array:
    """Return the speed (R,) of the first relative to the second along directions."""
    x_parts = (first[0] - second[0]) * direction[:, 0]
    return x_parts + (first[1] - second[1]) * direction[:, 1]


def _opening_speeds(
    touch: Touching, first: PartnerMotion, second: PartnerMotion
) -> Array:
    """Return the speeds (2, R) at which the two points of contacts open, px/s."""
    points = (touch.on_first + touch.on_second) / 2
    speeds = []
    for number in (0, 1):
        x = points[:, number, 0]
        y = points[:, number, 1]
        velocity1 = first.point_velocity(first.last_velocity, x, y)
        velocity2 = second.point_velocity(second.last_velocity, x, y)
        speeds.append(_relative_speed(velocity2, velocity1, touch.normal))
    return np.stack(speeds)


def _sorted_numbers(steps: list[Step]) -> list[bytes]:
    """Return the numbers of the contacts of each step in our order.

    Contacts of steps with the same order are sorted at once.
    """
    steps_by_order: dict[Order, list[int]] = {}
    for step_number, step in enumerate(steps):
        steps_by_order.setdefault(step.order, []).append(step_number)
    numbers = [step.numbers for step in steps]
    for order, step_numbers in steps_by_order.items():
        size = len(numbers[step_numbers[0]])
        sorted_numbers = order.sort(b"".join(numbers[k] for k in step_numbers))
        for position, step_number in enumerate(step_numbers):
            begin = size * position
            numbers[step_number] = sorted_numbers[begin : begin + size]
    return numbers


def _values_before(values: Array, step_rows: Index, first: Array | float) -> Array:
    """Return the values at the begin of steps, given those (S, ...) at the ends.

    `first`: the value at the begin of the first step.
    """
    old_values = values[step_rows - 1]
    old_values[step_rows == 0] = first
    return old_values


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
