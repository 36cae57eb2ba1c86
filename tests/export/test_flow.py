"""Optical flow by readers of other makes, and by the pictures themselves."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from physgen.cli.main import main
from physgen.export.flow import HIDDEN, OUTSIDE, VISIBLE
from physgen.export.kitti import kitti_codes
from physgen.simulate.trajectory import read_trajectory

F32 = NDArray[np.float32]


def flows(folder: Path, way: str = "forward") -> list[F32]:
    """As OpenCV reads them."""
    return [
        cv2.readOpticalFlow(str(path))
        for path in sorted((folder / "flo" / way).glob("*.flo"))
    ]


def seen(folder: Path, way: str = "forward") -> list[np.ndarray]:
    paths = sorted((folder / "flo" / "visible" / way).glob("*.png"))
    return [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in paths]


def frames(folder: Path) -> list[np.ndarray]:
    return [
        cv2.imread(str(path))[:, :, ::-1]
        for path in sorted((folder / "frames").glob("*.png"))
    ]


def warped(picture: np.ndarray, moved: F32) -> np.ndarray:
    """What `picture` shows at the places that pixels have moved to."""
    y, x = np.indices(moved.shape[:2], np.float32)
    return cv2.remap(
        picture,
        x + moved[..., 0],
        y + moved[..., 1],
        cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REPLICATE,
    )


CASES = {
    "side": ("side", ()),
    "camera": (
        "side",
        ("render.camera=[{time: 0}, {time: 0.4, center: [70, 60], zoom: 1.5}]",),
    ),
    "follow": ("side", ("render.camera=[{time: 0, zoom: 1.3, follow: ball}]",)),
    "scaled": ("side", ("render.size=[200, 160]",)),
    "there-and-back": ("side", ("render.play=there-and-back",)),
    "slow": ("side", ("render.slow=2",)),
    "table": ("top", ()),
}


@pytest.mark.parametrize("case", CASES)
def test_pictures_warped_by_the_flow_are_those_that_follow(case: str, export) -> None:
    scene, edits = CASES[case]
    folder = export(scene, "frames,flo", *edits)
    pictures, forward, backward = (
        frames(folder),
        flows(folder),
        flows(folder, "backward"),
    )
    assert len(forward) == len(backward) == len(pictures) - 1
    worst = 0.0
    for k, moved in enumerate(forward):
        mask = seen(folder)[k] == VISIBLE
        assert mask.mean() > 0.7
        apart = np.abs(
            warped(pictures[k + 1], moved)[mask].astype(int) - pictures[k][mask]
        )
        still = np.abs(pictures[k + 1][mask].astype(int) - pictures[k][mask])
        assert apart.mean() <= 2
        things = mask & (np.hypot(*np.moveaxis(moved, 2, 0)) > 0.5)
        if (
            things.sum() > 300
        ):  # inside of what moves it is the flow, not the still background, that makes it fit
            inner = cv2.erode(things.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
            fit = np.abs(
                warped(pictures[k + 1], moved)[inner].astype(int) - pictures[k][inner]
            ).mean()
            astray = np.abs(
                pictures[k + 1][inner].astype(int) - pictures[k][inner]
            ).mean()
            assert fit <= 4 + 0.1 * astray
            worst = max(worst, astray)
        assert still.mean() >= apart.mean() - 0.5
    assert worst > 8  # without the flow they do not fit


def test_flow_is_the_motion_of_the_poses(export) -> None:
    """By another formula: the velocity of a rigid body's points, of the turn between two poses."""
    folder = export("side", "flo")
    track = read_trajectory(folder / "trajectory.npz")
    for k, moved in enumerate(flows(folder)):
        for body in range(2):
            (x0, y0, a0), (x1, y1, a1) = track.poses[k, body], track.poses[k + 1, body]
            column, row = round(x0), round(y0)
            turn = np.exp(1j * (a1 - a0))
            there = complex(x1, y1) + (complex(column, row) - complex(x0, y0)) * turn
            want = there - complex(column, row)
            assert moved[row, column] == pytest.approx([want.real, want.imag], abs=1e-4)
        assert (moved[0, 0] == 0).all()


def test_what_is_hidden_is_hidden_by_somebody(export) -> None:
    folder = export(
        "side",
        "frames,flo",
        "objects.ball.velocity=[400, 0]",
        "world.gravity=[0, 0]",
        "world.duration=0.2",
    )
    hidden = [told == HIDDEN for told in seen(folder)]
    assert any(mask.sum() > 50 for mask in hidden)
    pictures, forward = frames(folder), flows(folder)
    k = int(np.argmax([mask.sum() for mask in hidden]))
    apart = np.abs(warped(pictures[k + 1], forward[k]).astype(int) - pictures[k]).mean(
        axis=2
    )
    assert apart[hidden[k]].mean() > 5 * apart[seen(folder)[k] == VISIBLE].mean()


def test_a_ball_that_rolls_carries_its_top_on(export) -> None:
    """Rolled by an angle a, its middle has moved on by r a, and the point that was on top by r sin a more."""
    folder = export("top", "flo", "objects.ball.velocity=[120, 0]")
    track = read_trajectory(folder / "trajectory.npz")
    moved = flows(folder)[0]
    radius, step = 16.0, float(track.poses[1, 0, 0] - track.poses[0, 0, 0])
    assert step == pytest.approx(6.0, abs=0.2)
    want = step + radius * np.sin(step / radius)
    assert moved[60, 40] == pytest.approx([want, 0.0], abs=1e-3)


def test_labels_beside_a_clip_are_those_of_the_export_and_change_no_frame(
    photo: Path, tmp_path: Path, export
) -> None:
    alone = export("side", "flo,frames")
    for name, more in (("out", ["--export", "flo,frames"]), ("plain", [])):
        flags = ["-o", str(tmp_path / name), "--report", "none", *more]
        assert main(["render", str(photo / "side.yaml"), *flags]) == 0
    beside, plain = tmp_path / "out" / "side", tmp_path / "plain" / "side"
    for path in alone.rglob("*"):
        if path.is_file() and path.name != "manifest.json" and path.parent != alone:
            assert (
                beside / "truth" / path.relative_to(alone)
            ).read_bytes() == path.read_bytes()
    assert (beside / "video.mp4").read_bytes() == (plain / "video.mp4").read_bytes()
    told = json.loads((beside / "manifest.json").read_text())
    assert "truth/flo/forward/00000.flo" in told["files"]
    assert (
        json.loads((beside / "timing.json").read_text())["stages"]["export"]["cpu"] > 0
    )


def kitti(path: Path) -> tuple[F32, np.ndarray]:
    """As the devkit's readme says: (I - 2^15) / 64 of two channels; the third says what is valid."""
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[:, :, ::-1]
    assert picture.dtype == np.uint16
    return (picture[..., :2].astype(np.float32) - 2**15) / 64, picture[..., 2] == 1


def test_kitti_agrees_with_flo_to_half_a_code(export) -> None:
    folder = export("side", "flo,kitti,frames", "objects.ball.velocity=[3000, 0]")
    files = sorted((folder / "kitti/flow_occ").glob("*.png"))
    assert len(files) == len(list((folder / "flo/forward").glob("*.flo"))) > 1
    outside = 0
    for path in files:
        k = int(path.name[:6])
        moved = cv2.readOpticalFlow(str(folder / f"flo/forward/{k:05d}.flo"))
        visible = cv2.imread(
            str(folder / f"flo/visible/forward/{k:05d}.png"), cv2.IMREAD_UNCHANGED
        )
        flow, valid = kitti(path)
        assert valid.all()
        assert np.abs(flow - moved).max() <= 1 / 128
        _, not_hidden = kitti(folder / "kitti/flow_noc" / path.name)
        np.testing.assert_array_equal(not_hidden, visible == VISIBLE)
        outside += int((visible == OUTSIDE).sum())
        for number, frame in ((10, k), (11, k + 1)):
            picture = cv2.imread(str(folder / f"kitti/image_2/{k:06d}_{number}.png"))
            same = cv2.imread(str(folder / f"frames/{frame:05d}.png"))
            np.testing.assert_array_equal(picture, same)
    assert outside > 0  # some pixels have left the picture, and have flow all the same


def test_kitti_codes_refuse_flow_beyond_512_px() -> None:
    flow = np.array([[[0, 0], [511.9, -512], [512.1, 0], [0, -600]]], np.float32)
    codes = kitti_codes(flow)
    assert codes[0, :, 2].tolist() == [1, 1, 0, 0]
    assert codes[0, 0].tolist() == [2**15, 2**15, 1]
    assert codes[0, 1, 1] == 0
