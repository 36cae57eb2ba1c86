"""The steps of a run as the engine took them -> the same motion at other times, without running it again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import ceil

import numpy as np
from numpy.typing import NDArray

from physgen.simulate.ledger import Ledger, Step
from physgen.simulate.trajectory import Effort, Trajectory

Array = NDArray[np.float64]

MOST = 64_000_000
"""Bytes of steps that are kept; a longer run is not."""


class Tape:
    """Hand one to `simulate`, then ask it. Reading costs a tenth of running, and gives the same numbers."""

    def __init__(self, most: int = MOST) -> None:
        self._most, self._held = most, 0
        self._begin: tuple[Step, Array, Array, Array] | None = None
        self._steps: list[Step] = []
        self._ledger: Ledger | None = None
        self._effort: Effort | None = None
        self._on: Callable[[float], None] | None = None

    def begin(self, ledger: Ledger, step: Step, pose: Array, velocity: Array, roll: Array) -> None:
        """What `Ledger.begin` was told, and which ledger."""
        self._ledger = ledger
        self._begin = step, pose.copy(), velocity.copy(), roll.copy()

    def add(self, step: Step) -> None:
        """Keep a step; all are let go once they are too many."""
        if self._begin is None:
            return
        self._held += len(step.states) + len(step.words) + len(step.numbers)
        self._steps.append(step)
        if self._held > self._most:
            self._steps, self._begin, self._ledger = [], None, None

    def end(self, effort: Effort, on: Callable[[float], None]) -> None:
        """The run is over; `on` takes it on to a later time, s, should somebody ask for that."""
        self._effort, self._on = effort, on

    def read(self, times: Array) -> Trajectory | None:
        """As `simulate` samples at `times` (T,) s, rising; None where the steps were not kept.

        Times after the run's last take it on: as far as the run itself would have come, and no step is taken twice.
        """
        if self._begin is None or self._ledger is None or len(times) == 0:
            return None
        h = 1.0 / self._ledger.world.steps_per_second
        last = ceil(float(times[-1]) / h - 1e-9) * h
        if last > (self._steps[-1].time if self._steps else 0.0) + 1e-9 * h and self._on is not None:
            self._on(last)
        return self._sampled(times, last + 1e-9 * h)

    def _sampled(self, times: Array, last: float) -> Trajectory | None:
        """From the steps that end at `last` s at most; they may have become too many."""
        if self._begin is None or self._ledger is None or self._effort is None:
            return None
        ledger = replace(self._ledger, times=times)
        with np.errstate(over="ignore", invalid="ignore"):
            ledger.begin(*self._begin)
            for step in self._steps:
                if step.time > last:
                    break
                ledger.add(step)
            ledger.flush()
        return told(ledger, self._effort)


def told(ledger: Ledger, effort: Effort) -> Trajectory:
    """What a ledger knows once its last step is read."""
    return Trajectory(
        times=ledger.times,
        names=tuple(body.name for body in ledger.world.bodies),
        poses=ledger.poses,
        velocities=ledger.velocities,
        rolls=ledger.rolled(),
        turns=ledger.turned(),
        contacts=ledger.log.result(),
        energy=ledger.energy(),
        effort=effort,
    )
