"""Poses and velocities of objects per frame, in px of photo and video and in SI units, as CSV and npz."""

from __future__ import annotations

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
"""s before and after a moment between which the camera's velocity is measured."""


class TrajectoryTables(Writer):
    """A row a frame and object."""

    def close(self) -> None:
        """Write all."""
        arrays = motion(self._clip)
        names = self._clip.names
        with Table(self._folder / "trajectory.csv", COLUMNS) as table:
            for row in rows(arrays, names):
                table.add(row)
            table.publish()
        np.savez_compressed(
            self._folder / "trajectory.npz", allow_pickle=False, **arrays
        )


def motion(clip: Clip) -> dict[str, NDArray[np.generic]]:
    """T frames, N objects; the arrays of the archive; names end in their units where these are not px and rad."""
    trajectory, order = clip.trajectory, np.array(clip.shot.order, np.int64)
    times, poses, velocities = (
        array[order]
        for array in (trajectory.times, trajectory.poses, trajectory.velocities)
    )
    places, speeds = on_video(clip.shot, times, poses, velocities)
    scale = clip.scale
    per_meter = scale.pixels_per_meter if scale.known else np.nan
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
        "lenses": np.array([clip.shot.affine(float(time)) for time in times]).reshape(
            -1, 2, 3
        ),
        "places_m": poses[..., :2] / per_meter,
        "velocities_m_s": velocities[..., :2] / per_meter,
        "pixels_per_meter": np.array(per_meter),
    }
    if trajectory.turns.size:
        arrays |= {"rolls": trajectory.rolls[order], "turns": trajectory.turns[order]}
    return arrays


def on_video(
    shot: Shot, times: Array, poses: Array, velocities: Array
) -> tuple[Array, Array]:
    """Places (T, N, 2) video px of the centres of mass, and how fast they move there, px a second of the motion.

    What the camera does is in both: an object that it follows hardly moves.
    """
    places, speeds = np.empty((*poses.shape[:2], 2)), np.empty((*poses.shape[:2], 2))
    for t, time in enumerate(times.tolist()):
        lens = shot.affine(time)
        early, late = max(time - CAMERA_STEP, 0.0), time + CAMERA_STEP
        turning = (shot.affine(late) - shot.affine(early)) / (late - early)
        at = np.column_stack([poses[t, :, :2], np.ones(len(poses[t]))])
        places[t] = at @ lens.T
        speeds[t] = velocities[t, :, :2] @ lens[:, :2].T + at @ turning.T
    return places, speeds


def rows(
    arrays: dict[str, NDArray[np.generic]], names: tuple[str, ...]
) -> list[dict[str, Cell]]:
    """Cells by the columns' names; metres are empty without a known scale."""
    keys = (
        "poses",
        "velocities",
        "video_places",
        "video_velocities",
        "places_m",
        "velocities_m_s",
    )
    columns = np.concatenate([arrays[key] for key in keys], axis=2).tolist()
    values = COLUMNS[4:]
    clip_times, times = arrays["clip_times"].tolist(), arrays["times"].tolist()
    return [
        {"frame": t, "clip_time": clip_times[t], "time": times[t], "object": name}
        | {
            key: value
            for key, value in zip(values, columns[t][n], strict=True)
            if value == value
        }
        for t in range(len(times))
        for n, name in enumerate(names)
    ]
