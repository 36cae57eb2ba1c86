"""Trajectory -> when each body comes to rest, and which touches are new: what tables, events and sentences mean by it.

All that is told of rest is as fine as the samples; touches the engine times itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physgen.simulate.trajectory import Trajectory

STILL = 1.0
"""px/s: what is slower is at rest, if it turns slower than `STILL_TURN` too."""
STILL_TURN = 1.0
"""degrees/s."""
LASTING = 0.1
"""s for which it must have been so at the clip's end: what hangs at the top of its way does not rest."""
START = 0.005
"""s: whom an object touches so early, it stood at or on before: it meets nobody by that."""


def still(trajectory: Trajectory) -> NDArray[np.bool_]:
    """(T, N): whether a body moves and turns no faster than one at rest may."""
    velocity = trajectory.velocities
    turning = np.abs(velocity[..., 2:])
    if trajectory.rolls.shape[1]:
        turning = np.concatenate([turning, np.abs(trajectory.rolls)], axis=2)
    slow = np.hypot(velocity[..., 0], velocity[..., 1]) < STILL
    return np.asarray(slow & (np.degrees(turning) < STILL_TURN).all(axis=2))


def rests(trajectory: Trajectory) -> list[float | None]:
    """s of each body: the first sample from which on it rests, 0 where it always does; None: it moves to the end."""
    found = []
    for quiet in still(trajectory).T:
        moving = np.flatnonzero(~quiet)
        since = int(moving[-1]) + 1 if len(moving) else 0
        over = since == len(quiet) or trajectory.times[-1] - trajectory.times[since] < LASTING - 1e-9
        found.append(None if over else float(trajectory.times[since]))
    return found


def fresh(trajectory: Trajectory) -> NDArray[np.bool_]:
    """(E,): touches of pairs that did not touch from the start."""
    contacts = trajectory.contacts
    pairs = [tuple(pair) for pair in contacts.touch_pairs.tolist()]
    early = contacts.touch_times[:, 0] < START
    old = {pair for pair, soon in zip(pairs, early.tolist(), strict=True) if soon}
    return np.array([pair not in old for pair in pairs], bool)
