"""Point tracks by a reader of TAP-Vid's layout, and against poses, flow and ids."""

from __future__ import annotations

import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from physgen.simulate.trajectory import read_trajectory

FREE = ("world.gravity=[0, 0]", "boundaries={}", "objects.*.spin=0")
CAMERA = "render.camera=[{time: 0}, {time: 0.4, center: [70, 60], zoom: 1.5}]"
PASSING = (
    *FREE,
    "objects.ball.motion={path: [[0, 40, 60], [0.4, 140, 62]]}",
    "objects.ball.velocity=[0, 0]",
    "objects.crate.motion=static",
    "objects.crate.velocity=[0, 0]",
    "objects.ball.layer=2",
)
BALL, CRATE = 1, 2


class Read:
    """As TAP-Vid's published code reads it (tapnet, `tapvid/evaluation_datasets.py`).

    Points times the video's size are px from the picture's corner; there is no package of it.
    """

    def __init__(self, folder: Path) -> None:
        with np.load(folder / "tapvid" / "tapvid.npz", allow_pickle=False) as file:
            found = dict(file)
        self.video, self.occluded, self.queries = (
            found["video"],
            found["occluded"],
            found["query_points"],
        )
        self.size = np.array([self.video.shape[2], self.video.shape[1]])
        self.points = found["points"] * self.size
        self.object, self.names = found["object"], found["names"]
        self.px = self.points - 0.5
        """With pixel centres at whole numbers, as flow and poses have them."""
        self.inside = ((self.px >= -0.5) & (self.px < self.size - 0.5)).all(axis=2)

    def first(self) -> NDArray[np.float64]:
        """The protocol `first`: (t, y, x) of each track's first sight; one that is never seen has none."""
        seen = ~self.occluded
        assert seen.any(axis=1).all()
        t = seen.argmax(axis=1)
        x, y = self.points[np.arange(len(t)), t].T
        return np.column_stack([t, y, x])

    def strided(self, stride: int) -> NDArray[np.float64]:
        """The protocol `strided`: (t, y, x) of whatever is seen in every so many frames."""
        rows = []
        for t in range(0, self.video.shape[0], stride):
            seen = ~self.occluded[:, t]
            x, y = self.points[seen, t].T
            rows.append(np.column_stack([np.full(len(x), t), y, x]))
        return np.concatenate(rows)


def shown(folder: Path) -> NDArray[np.uint16]:
    """(T, H, W) ids: who is where."""
    return np.stack(
        [
            np.asarray(Image.open(path))
            for path in sorted((folder / "davis").rglob("Annotations/**/*.png"))
        ]
    )


def test_the_file_is_what_tap_vid_readers_expect(export) -> None:
    folder = export("side", "tapvid,frames")
    read = Read(folder)
    count = len(read.points)
    assert read.video.dtype == np.uint8
    assert (read.points.shape, read.occluded.shape) == ((count, 8, 2), (count, 8))
    assert (read.points.dtype, read.occluded.dtype, read.queries.dtype) == (
        np.float64,
        np.bool_,
        np.float32,
    )
    for frame, path in zip(
        read.video, sorted((folder / "frames").glob("*.png")), strict=True
    ):
        np.testing.assert_array_equal(frame, cv2.imread(str(path))[:, :, ::-1])
    np.testing.assert_allclose(read.queries, read.first(), atol=1e-4)
    strided = read.strided(5)
    assert set(strided[:, 0]) == {0, 5}
    assert len(strided) > count
    assert read.names.tolist() == ["background", "ball", "crate"]
    assert count == 256
    assert np.bincount(read.object)[0] == 64
    assert np.bincount(read.object).min() >= 4
    with zipfile.ZipFile(folder / "tapvid" / "tapvid.npz") as file:
        assert {info.date_time for info in file.infolist()} == {
            (1980, 1, 1, 0, 0, 0)
        }  # bytes stay the same


@pytest.mark.parametrize(
    "edits", [(), (CAMERA,), ("render.size=[200, 160]",), ("render.play=backward",)]
)
def test_tracks_are_the_motion_of_the_poses(edits: tuple, export) -> None:
    """By another formula: everything about the middle of a body turns with it as a vector."""
    folder = export("side", "tapvid", *edits)
    read, poses = Read(folder), read_trajectory(folder / "trajectory.npz").poses
    if "backward" in str(edits):
        poses = poses[::-1]
    still = read.px[read.object == 0]
    if not edits or "play" in edits[0]:
        assert np.abs(still - still[:, :1]).max() < 1e-3
    for body in (0, 1):
        points = read.px[read.object == body + 1]
        apart = np.linalg.norm(points[:, None] - points[None], axis=-1)  # (K, K, T)
        larger = apart.sum(axis=(0, 1)) / apart.sum(axis=(0, 1))[0]
        # a rigid body keeps its distances; the camera enlarges all of them alike
        np.testing.assert_allclose(apart, apart[..., :1] * larger, atol=2e-3)
        if "size" in str(edits):
            np.testing.assert_allclose(larger, 1, atol=1e-5)
        if edits and "play" not in edits[0]:
            continue
        turn = np.exp(1j * (poses[:, body, 2] - poses[0, body, 2]))
        middle = poses[:, body, 0] + 1j * poses[:, body, 1]
        spoke = points[:, 0] @ [1, 1j] - middle[0]
        want = middle + spoke[:, None] * turn
        np.testing.assert_allclose(points @ [1, 1j], want, atol=1e-3)


def test_points_are_queried_on_their_objects_and_hidden_by_others(export) -> None:
    folder = export("side", "tapvid,davis", *PASSING)
    read, ids = Read(folder), shown(folder)
    hidden = 0
    for k, owner in enumerate(read.object):
        for t in range(len(ids)):
            if not read.inside[k, t]:
                assert read.occluded[k, t]
                continue
            column, row = np.rint(read.px[k, t]).astype(int)
            assert read.occluded[k, t] == (ids[t, row, column] != owner)
            hidden += owner == CRATE and ids[t, row, column] == BALL
    assert hidden > 20
    came_back = read.occluded[:, :-1] & ~read.occluded[:, 1:]
    assert came_back[read.object == 0].any()


def angles_of_rolling(spoke, first, rolled):
    """(K, T) angles about +y, and (K, 1) radii of their circles, of points (K, T, 2) in radii.

    `first` (K,) are the frames in which the points are on top, `rolled` (T,) the way in radii.
    """
    own = spoke[np.arange(len(first)), first]
    height = np.sqrt(np.maximum(1 - (own**2).sum(axis=1), 0))
    angle = np.arctan2(own[:, 0], height)[:, None] + rolled - rolled[first][:, None]
    return angle, np.sqrt(np.maximum(1 - spoke[:, :1, 1] ** 2, 0))


def test_points_of_a_rolling_ball_go_under_and_come_back(export) -> None:
    rolling = (
        "objects.ball.velocity=[130, 0]",
        "world.duration=0.9",
        "objects.crate=null",
    )
    folder = export("top", "tapvid", *rolling)
    read, poses = Read(folder), read_trajectory(folder / "trajectory.npz").poses
    ball = read.object == BALL
    spoke = (read.px[ball] - poses[None, :, 0, :2]) / 16
    # about +y by the way over the radius; what is up at an angle stays on its circle across y
    first, rolled = (
        read.queries[ball, 0].astype(int),
        (poses[:, 0, 0] - poses[0, 0, 0]) / 16,
    )
    angle, ring = angles_of_rolling(spoke, first, rolled)
    sure = ring[:, 0] > 0.2  # near its poles nothing turns
    x = ring * np.sin(angle)
    np.testing.assert_allclose(spoke[..., 0][sure], x[sure], atol=0.02)
    np.testing.assert_allclose(spoke[..., 1], spoke[:, :1, 1] + 0 * angle, atol=1e-3)
    occluded, inside = read.occluded[ball], read.inside[ball]
    clear = (np.abs(np.cos(angle)) > 0.1) & inside & sure[:, None]
    clear &= np.hypot(*np.moveaxis(spoke, 2, 0)) < 0.8
    np.testing.assert_array_equal(occluded[clear], np.cos(angle)[clear] < 0)
    back = ~occluded[:, :1] & occluded & inside
    assert (back[:, :-1] & ~occluded[:, 1:]).any()
