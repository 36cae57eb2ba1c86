"""Trajectory -> what became of the clip, as cells of a table: of all objects together, and of each that is tracked.

All that is told of a time is as fine as the samples, which are the video's frames, but for touches, which the engine
times itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees

import numpy as np
from numpy.typing import NDArray

from physgen.batch.columns import Cell, Column, Kind
from physgen.simulate.trajectory import Trajectory

STILL = 1.0
"""px/s: what is slower is at rest, if it turns slower than `STILL_TURN` too."""
STILL_TURN = 1.0
"""degrees/s."""
LASTING = 0.1
"""s for which it must have been so at the clip's end: what hangs at the top of its way does not rest."""
START = 0.005
"""s: whom an object touches so early, it stood at or on before; it counts in `touches`, and not as a `first_touch`."""

TOGETHER = (
    Column("peak_speed", Kind.NUMBER, "px/s"),
    Column("rest_time", Kind.NUMBER, "s"),
    Column("first_touch", Kind.NUMBER, "s"),
    Column("touches", Kind.WHOLE),
)
EACH = (
    Column("x", Kind.NUMBER, "px"),
    Column("y", Kind.NUMBER, "px"),
    Column("angle", Kind.NUMBER, "degrees"),
    *TOGETHER,
)


def columns(tracked: Sequence[str]) -> tuple[Column, ...]:
    """Of all together, then `objects.NAME.` each."""
    each = (Column(f"objects.{name}.{c.name}", c.kind, c.unit) for name in tracked for c in EACH)
    return (*TOGETHER, *each)


def outcomes(trajectory: Trajectory, tracked: Sequence[str]) -> dict[str, Cell]:
    """Cells by the columns' names; empty ones are left out.

    x, y, angle: of the centre of mass at the last sample, turned since t = 0 by more than 360 degrees perhaps.
    peak_speed: of the centre of mass, the greatest of all samples. rest_time: the first sample from which on it rests,
    up to one frame late; empty where it moves to the end; of all together the last one's. first_touch: when it met
    somebody whom it did not touch from the start. touches: how often it met anybody, a touch from the start among
    them; of all together each once.
    """
    if not len(trajectory.times):
        return {}
    speeds = np.hypot(trajectory.velocities[..., 0], trajectory.velocities[..., 1])
    rests = [_rest(trajectory, body) for body in range(len(trajectory.names))]
    touches = trajectory.contacts.touch_pairs
    fresh = _fresh(trajectory)
    cells: dict[str, Cell] = {"touches": len(touches)}
    if trajectory.names:
        cells["peak_speed"] = float(speeds.max())
        cells["rest_time"] = None if None in rests else max(rest for rest in rests if rest is not None)
        cells["first_touch"] = _first(fresh)
    for body, name in enumerate(trajectory.names):
        if name not in tracked:
            continue
        x, y, angle = trajectory.poses[-1, body].tolist()
        found: Mapping[str, Cell] = {
            "x": x,
            "y": y,
            "angle": degrees(angle),
            "peak_speed": float(speeds[:, body].max()),
            "rest_time": rests[body],
            "first_touch": _first(fresh[(touches == body).any(axis=1)]),
            "touches": int((touches == body).any(axis=1).sum()),
        }
        cells |= {f"objects.{name}.{key}": value for key, value in found.items()}
    return {key: value for key, value in cells.items() if value is not None}


def _rest(trajectory: Trajectory, body: int) -> float | None:
    """s."""
    velocity = trajectory.velocities[:, body]
    turning = np.abs(velocity[:, 2:])
    if trajectory.rolls.shape[1]:
        turning = np.concatenate([turning, np.abs(trajectory.rolls[:, body])], axis=1)
    slow = np.hypot(velocity[:, 0], velocity[:, 1]) < STILL
    still = slow & (np.degrees(turning) < STILL_TURN).all(axis=1)
    moving = np.flatnonzero(~still)
    since = int(moving[-1]) + 1 if len(moving) else 0
    if since == len(still) or trajectory.times[-1] - trajectory.times[since] < LASTING - 1e-9:
        return None
    return float(trajectory.times[since])


def _fresh(trajectory: Trajectory) -> NDArray[np.float64]:
    """(E,) s: when each touch began; infinite for those of pairs that touched from the start."""
    begins = trajectory.contacts.touch_times[:, 0]
    pairs = [tuple(pair) for pair in trajectory.contacts.touch_pairs.tolist()]
    old = {pair for pair, begin in zip(pairs, begins.tolist(), strict=True) if begin < START}
    return np.array([np.inf if pair in old else b for pair, b in zip(pairs, begins.tolist(), strict=True)])


def _first(begins: NDArray[np.float64]) -> float | None:
    """s."""
    first = float(begins.min(initial=np.inf))
    return first if np.isfinite(first) else None
