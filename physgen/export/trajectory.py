"""Poses and velocities of objects per frame, in px of photo and video and in SI units,
as CSV and npz.
"""

from __future__ import annotations

from math import isnan

import numpy as np
from numpy.typing import NDArray

from physgen.export.labels import Clip, Writer
from physgen.geometry.polygon import Array
from physgen.render.camera import Shot
from physgen.tables import Cell, Table

COLUMNS = (
    *(
        "frame",
        "clip_time",
        "time",
        "object",
        "x",
        "y",
        "angle_rad",
        "vx",
        "vy",
        "spin_rad_s",
    ),
    *("video_x", "video_y", "video_vx", "video_vy", "x_m", "y_m", "vx_m", "vy_m"),
)
"""s, s, px, rad and px/s of the photo; px of the video; m and m/s."""
CAMERA_STEP = 1e-5
"""Time step of the camera's velocity, s."""


class TrajectoryTables(Writer):
    """Writes a row per frame and object."""

    def close(self) -> None:
        """Write both tables."""
        arrays = motion_arrays(self._clip)
        names = self._clip.names
        with Table(self._folder / "trajectory.csv", COLUMNS) as table:
            for row in rows(arrays, names):
                table.add(row)
            table.publish()
        np.savez_compressed(
            self._folder / "trajectory.npz", allow_pickle=False, **arrays
        )


def motion_arrays(clip: Clip) -> dict[str, NDArray[np.generic]]:
    """Return the arrays of the archive, for T frames and N objects. Names end in their
    units, except px and rad.
    """
    trajectory = clip.trajectory
    # Frames in playing order: a clip may run backwards or there and back.
    order = np.array(clip.shot.order, np.int64)
    times = trajectory.times[order]
    poses = trajectory.poses[order]
    velocities = trajectory.velocities[order]
    places, speeds = video_motion(clip.shot, times, poses, velocities)
    lenses = np.array([clip.shot.affine(float(time)) for time in times])
    scale = clip.scale
    if scale.is_known:
        px_per_meter = scale.pixels_per_meter
    else:
        px_per_meter = np.nan
    arrays: dict[str, NDArray[np.generic]] = {
        "names": np.array(clip.names, np.str_),
        "labels": np.array(clip.labels, np.str_),
        "frames": np.arange(len(order)),
        "clip_times": np.arange(len(order)) / clip.fps,
        "times": times,
        "poses": poses,
        "velocities": velocities,
        "video_places": places,
        "video_velocities": speeds,
        "lenses": lenses.reshape(-1, 2, 3),
        "places_m": poses[..., :2] / px_per_meter,
        "velocities_m_s": velocities[..., :2] / px_per_meter,
        "pixels_per_meter": np.array(px_per_meter),
    }
    if trajectory.turns.size:
        arrays |= {"rolls": trajectory.rolls[order], "turns": trajectory.turns[order]}
    return arrays


def video_motion(
    shot: Shot, times: Array, poses: Array, velocities: Array
) -> tuple[Array, Array]:
    """Return places (T, N, 2) video px and velocities of the centres of mass, video px
    per second of the motion.

    Both include the camera's motion: a followed object hardly moves.
    """
    places = np.empty((*poses.shape[:2], 2))
    speeds = np.empty((*poses.shape[:2], 2))
    for t, time in enumerate(times.tolist()):
        lens = shot.affine(time)
        # The camera has no motion before t = 0.
        early = max(time - CAMERA_STEP, 0.0)
        late = time + CAMERA_STEP
        lens_rate = (shot.affine(late) - shot.affine(early)) / (late - early)
        ones = np.ones(len(poses[t]))
        points = np.column_stack([poses[t, :, :2], ones])
        places[t] = points @ lens.T
        own_speeds = velocities[t, :, :2] @ lens[:, :2].T
        speeds[t] = own_speeds + points @ lens_rate.T
    return places, speeds


def rows(
    arrays: dict[str, NDArray[np.generic]], names: tuple[str, ...]
) -> list[dict[str, Cell]]:
    """Return cells by column name. Metres are empty without a known scale."""
    keys = (
        "poses",
        "velocities",
        "video_places",
        "video_velocities",
        "places_m",
        "velocities_m_s",
    )
    parts = [arrays[key] for key in keys]
    # One conversion to lists is far faster than one per cell.
    columns = np.concatenate(parts, axis=2).tolist()
    clip_times = arrays["clip_times"].tolist()
    times = arrays["times"].tolist()
    table_rows = []
    for t, time in enumerate(times):
        for n, name in enumerate(names):
            row: dict[str, Cell] = {"frame": t, "clip_time": clip_times[t]}
            row |= {"time": time, "object": name}
            for key, value in zip(COLUMNS[4:], columns[t][n], strict=True):
                if not isnan(value):
                    row[key] = value
            table_rows.append(row)
    return table_rows
