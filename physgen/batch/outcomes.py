"""Outcomes of a clip as cells of a table: of all objects together, and of each tracked object.

Times are as fine as the samples, which are the video's frames; contacts have the engine's own times.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees

import numpy as np
from numpy.typing import NDArray

from physgen.simulate.trajectory import Trajectory, new_touches, rest_times
from physgen.tables import Cell

ALL_OBJECTS = ("peak_speed", "rest_time", "first_touch", "touches")
"""px/s, s, s."""
EACH_OBJECT = ("x", "y", "angle_degrees", *ALL_OBJECTS)
"""px, px, degrees, and as above."""


def columns(tracked: Sequence[str]) -> tuple[str, ...]:
    """Return columns of all objects together, then `objects.NAME.` of each tracked one."""
    return (
        *ALL_OBJECTS,
        *(f"objects.{name}.{column}" for name in tracked for column in EACH_OBJECT),
    )


def outcomes(trajectory: Trajectory, tracked: Sequence[str]) -> dict[str, Cell]:
    """Return cells by the names of columns, without empty ones.

    x, y, angle_degrees: of the centre of mass at the last sample; the angle counts whole turns since t = 0.
    peak_speed: of the centre of mass, the greatest of all samples. rest_time: the first sample from which on the object
    rests, up to one frame late; empty where it moves to the end; of all together the latest one. first_touch: the first
    contact that did not exist at t = 0. touches: the number of contacts, those at t = 0 included.
    """
    if not len(trajectory.times):
        return {}
    speeds = np.hypot(trajectory.velocities[..., 0], trajectory.velocities[..., 1])
    rests = rest_times(trajectory)
    touches = trajectory.contacts.touch_pairs
    begins = np.where(
        new_touches(trajectory), trajectory.contacts.touch_times[:, 0], np.inf
    )
    cells: dict[str, Cell] = {"touches": len(touches)}
    if trajectory.names:
        cells["peak_speed"] = float(speeds.max())
        cells["rest_time"] = (
            None if None in rests else max(rest for rest in rests if rest is not None)
        )
        cells["first_touch"] = _earliest(begins)
    for body, name in enumerate(trajectory.names):
        if name not in tracked:
            continue
        x, y, angle = trajectory.poses[-1, body].tolist()
        is_touching = (touches == body).any(axis=1)
        cells_of_body: Mapping[str, Cell] = {
            "x": x,
            "y": y,
            "angle_degrees": degrees(angle),
            "peak_speed": float(speeds[:, body].max()),
            "rest_time": rests[body],
            "first_touch": _earliest(begins[is_touching]),
            "touches": int(is_touching.sum()),
        }
        cells |= {
            f"objects.{name}.{key}": value for key, value in cells_of_body.items()
        }
    return {key: value for key, value in cells.items() if value is not None}


def _earliest(times: NDArray[np.float64]) -> float | None:
    """Return the earliest time, s."""
    first = float(times.min(initial=np.inf))
    return first if np.isfinite(first) else None
