"""Trajectory -> what became of the clip, as cells of a table: of all objects together, and of each that is
tracked.

All that is told of a time is as fine as the samples, which are the video's frames, but for touches, which the engine
times itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees

import numpy as np
from numpy.typing import NDArray

from physgen.simulate.trajectory import Trajectory, new_touches, rest_times
from physgen.tables import Cell, Column, Kind

TOGETHER = (
    Column("peak_speed", Kind.NUMBER, "px/s"),
    Column("rest_time", Kind.NUMBER, "s"),
    Column("first_touch", Kind.NUMBER, "s"),
    Column("touches", Kind.WHOLE),
)
EACH = (
    Column("x", Kind.NUMBER, "px"),
    Column("y", Kind.NUMBER, "px"),
    Column("angle_degrees", Kind.NUMBER, "degrees"),
    *TOGETHER,
)


def columns(tracked: Sequence[str]) -> tuple[Column, ...]:
    """Of all together, then `objects.NAME.` each."""
    each = (Column(f"objects.{name}.{c.name}", c.kind, c.unit) for name in tracked for c in EACH)
    return (*TOGETHER, *each)


def outcomes(trajectory: Trajectory, tracked: Sequence[str]) -> dict[str, Cell]:
    """Cells by the columns' names; empty ones are left out.

    x, y, angle_degrees: of the centre of mass at the last sample, turned since t = 0 by more than 360 degrees perhaps.
    peak_speed: of the centre of mass, the greatest of all samples. rest_time: the first sample from which on it rests,
    up to one frame late; empty where it moves to the end; of all together the last one's. first_touch: when it met
    somebody whom it did not touch from the start. touches: how often it met anybody, a touch from the start among
    them; of all together each once.
    """
    if not len(trajectory.times):
        return {}
    speeds = np.hypot(trajectory.velocities[..., 0], trajectory.velocities[..., 1])
    resting = rest_times(trajectory)
    touches = trajectory.contacts.touch_pairs
    begins = np.where(new_touches(trajectory), trajectory.contacts.touch_times[:, 0], np.inf)
    cells: dict[str, Cell] = {"touches": len(touches)}
    if trajectory.names:
        cells["peak_speed"] = float(speeds.max())
        cells["rest_time"] = None if None in resting else max(rest for rest in resting if rest is not None)
        cells["first_touch"] = _first(begins)
    for body, name in enumerate(trajectory.names):
        if name not in tracked:
            continue
        x, y, angle = trajectory.poses[-1, body].tolist()
        found: Mapping[str, Cell] = {
            "x": x,
            "y": y,
            "angle_degrees": degrees(angle),
            "peak_speed": float(speeds[:, body].max()),
            "rest_time": resting[body],
            "first_touch": _first(begins[(touches == body).any(axis=1)]),
            "touches": int((touches == body).any(axis=1).sum()),
        }
        cells |= {f"objects.{name}.{key}": value for key, value in found.items()}
    return {key: value for key, value in cells.items() if value is not None}


def _first(begins: NDArray[np.float64]) -> float | None:
    """s."""
    first = float(begins.min(initial=np.inf))
    return first if np.isfinite(first) else None
