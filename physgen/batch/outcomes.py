"""Compute outcomes of a clip as table cells: of all objects together, and of each
tracked object.

Times have the resolution of the samples, which equals the frame interval. Contacts have
the engine's own times.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees

import numpy as np
from numpy.typing import NDArray

from physgen.simulate.trajectory import Trajectory, new_touches, rest_times
from physgen.tables import Cell

ALL_OBJECTS = ("peak_speed", "rest_time", "first_touch", "touches")
"""Columns of all objects together, px/s, s, s and a count."""
EACH_OBJECT = ("x", "y", "angle_degrees", *ALL_OBJECTS)
"""Columns of each tracked object, px, px, degrees, and as above."""


def columns(tracked_names: Sequence[str]) -> tuple[str, ...]:
    """Return columns of all objects together, then `objects.NAME.` columns of each
    tracked object.
    """
    return (
        *ALL_OBJECTS,
        *(
            f"objects.{name}.{column}"
            for name in tracked_names
            for column in EACH_OBJECT
        ),
    )


def outcomes(trajectory: Trajectory, tracked_names: Sequence[str]) -> dict[str, Cell]:
    """Return the non-empty cells by column name.

    x, y and angle_degrees belong to the centre of mass at the last sample; the angle
    counts whole turns since t = 0. peak_speed is the greatest speed of the centre of
    mass. rest_time is the time of the first sample of the final rest, up to one frame
    late, and empty if the object moves to the end; for all objects together it is the
    latest one. first_touch is the time of the first new contact after t = 0. touches is
    the number of contacts, with those at t = 0.
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
        # One object that moves to the end leaves all objects together without a rest.
        if None in rests:
            cells["rest_time"] = None
        else:
            cells["rest_time"] = max(rest for rest in rests if rest is not None)
        cells["first_touch"] = _earliest(begins)
    for body, name in enumerate(trajectory.names):
        if name not in tracked_names:
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
    """Return the earliest time, s, or None if there is none."""
    first = float(times.min(initial=np.inf))
    if np.isfinite(first):
        return first
    return None
