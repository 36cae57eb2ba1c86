"""The pack for video models, read by OpenCV and FFmpeg, against the scene and its trajectory."""

from __future__ import annotations

import json
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from physgen.cli.main import main
from physgen.simulate.trajectory import read_trajectory

W, H, FRAMES, FPS = 72, 48, 7, 8
SCENE = """\
physgen: 1
image: photo.png
assets: photo.assets
maps: {depth: [2.0, 6.0]}
world: {duration: 0.5, gravity: [0, 0]}
objects:
  ball: {mask: 1, shape: {circle: {center: [30, 40], radius: 10}}, mass: 100, velocity: [60, 0]}
  crate: {mask: 2, shape: {box: {center: [100, 40], size: [20, 24]}}, mass: 200}
forces:
  - {object: crate, impulse: [0, -4000]}
  - {object: crate, force: [3000, 0], start: 0.25}
render: {relight: false, shadows: false}
"""


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A slope of depth behind two things, each at a depth of its own."""
    folder = tmp_path_factory.mktemp("pack")
    (folder / "photo.assets").mkdir()
    y, x = np.mgrid[:80, :120]
    masks = np.zeros((80, 120), np.uint16)
    masks[np.hypot(x - 30, y - 40) <= 10] = 1
    masks[28:52, 90:110] = 2
    depth = 3 + 2 * x / 119
    depth[masks == 1], depth[masks == 2] = 2.0, 2.5
    picture = np.full((80, 120, 3), 110, np.uint8)
    picture[masks == 1], picture[masks == 2] = (40, 60, 200), (60, 160, 70)
    cv2.imwrite(str(folder / "photo.png"), picture)
    cv2.imwrite(str(folder / "photo.assets" / "masks.png"), masks)
    codes = np.rint((depth - 2) / 4 * 65535).astype(np.uint16)
    cv2.imwrite(str(folder / "photo.assets" / "depth.png"), codes)
    (folder / "scene.yaml").write_text(SCENE)
    return folder


@pytest.fixture(scope="module")
def pack(photo: Path) -> Path:
    film = ["--frames", str(FRAMES), "--size", f"{W}x{H}", "--fps", str(FPS)]
    out = photo / "labels"
    assert (
        main(["export", str(photo / "scene.yaml"), "--format", "conditioning,events", *film, "-o", str(out)])
        == 0
    )
    return next(out.iterdir())


@pytest.fixture(scope="module")
def about(pack: Path) -> dict:
    return json.loads((pack / "conditioning" / "conditioning.json").read_text())


def picture(pack: Path, name: str, index: int) -> np.ndarray:
    """In the order R, G, B."""
    read = cv2.imread(str(pack / "conditioning" / name / f"{index:05d}.png"), cv2.IMREAD_UNCHANGED)
    return read if read.ndim == 2 else read[..., ::-1]


def film(path: Path) -> tuple[list[np.ndarray], float]:
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)], float(
            stream.average_rate
        )


def test_every_file_is_named_and_every_name_is_a_file(pack: Path, about: dict) -> None:
    named = {"conditioning.json"}
    for told in about["files"].values():
        count = told.get("count")
        named |= {told["path"]} if count is None else {told["path"] % k for k in range(count)}
    home = pack / "conditioning"
    assert {path.relative_to(home).as_posix() for path in home.rglob("*") if path.is_file()} == named
    assert (about["frames"], about["size"], about["fps"]) == (FRAMES, [W, H], FPS)
    assert about["seconds"] == FRAMES / FPS
    assert about["slower"] == pytest.approx(FRAMES / FPS / 0.5)
    prompt = (home / "prompt.txt").read_text().strip()
    assert prompt == about["prompt"] == (pack / "events" / "caption.txt").read_text().strip()


def test_films_and_pictures_have_the_size_and_rate_that_was_asked(pack: Path, about: dict) -> None:
    home = pack / "conditioning"
    for name in ("video.mp4", "force.mp4"):
        frames, rate = film(home / name)
        assert (len(frames), rate) == (FRAMES, FPS)
        assert frames[0].shape == (H, W, 3)
    first = cv2.imread(str(home / "first.png"))[..., ::-1].astype(int)
    assert np.abs(film(home / "video.mp4")[0][0] - first).mean() < 4
    for name in ("masks", "depth", "force", "flow"):
        assert picture(pack, name, 0).shape[:2] == (H, W)


def lens(about: dict, frame: int, point: list[float]) -> np.ndarray:
    return np.array(about["lenses"][frame]) @ [*point, 1]


def test_masks_and_flow_move_as_the_trajectory_does(pack: Path, about: dict) -> None:
    trajectory = read_trajectory(pack / "trajectory.npz")
    scale = about["lenses"][0][0][0]
    for frame in range(FRAMES - 1):
        ids, flow = picture(pack, "masks", frame), picture(pack, "flow", frame).astype(float)
        assert set(np.unique(ids)) == {0, 1, 2}
        assert (flow[..., 2] == 1).all()
        for told in about["objects"]:
            body = trajectory.names.index(told["name"])
            step = (trajectory.poses[frame + 1, body, :2] - trajectory.poses[frame, body, :2]) * scale
            seen = (flow[..., :2][ids == told["id"]] - 32768) / 64
            assert np.abs(seen - step).max() <= 1 / 128 + 1e-6
        assert (flow[..., :2][ids == 0] == 32768).all()


def test_force_maps_add_up_to_what_the_scene_gives(pack: Path, about: dict) -> None:
    told = about["files"]["force"]
    trajectory = read_trajectory(pack / "trajectory.npz")
    crate = trajectory.names.index("crate")
    down = rightward = 0.0
    for frame in range(FRAMES):
        codes = (
            (picture(pack, "force", frame).astype(float) - told["zero"])
            / told["code"]
            * told["impulse_at_code"]
        )
        x, y = np.rint(lens(about, frame, trajectory.poses[frame, crate, :2])).astype(int)
        down += codes[y, x, 1]
        rightward += codes[y, x, 0]
        if frame == 0:  # the crate's impulse, and the ball's motion as the impulse that it stands for
            bx, by = np.rint(lens(about, 0, [30, 40])).astype(int)
            assert codes[by, bx, 0] == pytest.approx(100 * 60, rel=0.05)
            assert codes[y, x, 1] == pytest.approx(-4000, rel=0.05)
            assert codes[y, x, 0] == pytest.approx(0, abs=10)
        elif frame <= 2:  # 0.25 s is in the fourth of seven
            assert not (picture(pack, "force", frame) != told["zero"]).any()
    assert down == pytest.approx(-4000, rel=0.05)
    assert rightward == pytest.approx(3000 * 0.25, rel=0.05)
    assert [(p["object"], p["is"]) for p in about["pushes"]] == [
        ("crate", "impulse"),
        ("crate", "force"),
        ("ball", "velocity"),
    ]
    assert about["pushes"][1]["frame"] == 4  # the first that shows what came of it


def test_blobs_go_where_pushes_point_the_farther_the_stronger(pack: Path, about: dict) -> None:
    frames, _ = film(pack / "conditioning" / "force.mp4")
    told = about["files"]["blobs"]
    assert told["impulse_at_farthest"] == 6000
    start = lens(about, 0, [30, 40])
    last = frames[-1].mean(axis=2)
    row = last[round(start[1])]
    assert abs(int(row.argmax()) - (start[0] + W / 2)) <= 2  # the strongest goes half of the width
    crate = lens(about, 0, [100, 40])
    column = last[: round(crate[1]), round(crate[0])]
    far = W * (1 / 8 + 3 / 8 * 4000 / 6000)
    if crate[1] - far > 0:
        assert abs(int(column.argmax()) - (crate[1] - far)) <= 2
    assert frames[0].max() > 200


def test_depth_goes_along_with_things_and_is_filled_behind_them(pack: Path, about: dict) -> None:
    told = about["files"]["depth"]
    low, high = told["at_0"], told["at_65535"]
    for frame in (0, FRAMES - 1):
        depth = low + (high - low) * picture(pack, "depth", frame) / 65535
        ids = picture(pack, "masks", frame)
        inside = cv2.erode((ids == 1).astype(np.uint8), np.ones((3, 3))) > 0
        assert np.abs(depth[inside] - 2).max() < 0.02
        assert np.abs(depth[ids == 2] - 2.5).max() < 0.02
        x, y = np.rint(lens(about, frame, [30, 40])).astype(int)
        if frame:  # the ball has gone: what was behind it is the slope
            assert ids[y, x] == 0
            assert depth[y, x] == pytest.approx(3 + 2 * 30 / 119, abs=0.05)


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (
            ["--size", "71x48"],
            "--size: 71x48 has an odd side, which H.264 with 4:2:0 cannot hold; write 72x48",
        ),
        (["--size", "72"], "argument --size: 72 is not a size from 2x2 to 16384x16384, e.g. 832x480"),
        (["--frames", "1"], "argument --frames: 1 is not a whole number from 2 to 100000"),
        (
            ["--set", "render.frames=1"],
            "--format conditioning: 1 frame has no motion; write --frames 2 or more",
        ),
        (["--set", "render.size=[71, 48]"], "--format conditioning: 71 x 48 px has an odd side"),
    ],
)
def test_films_that_cannot_be_are_refused(
    photo: Path, tmp_path: Path, capsys, flags: list[str], said: str
) -> None:
    command = [
        "export",
        str(photo / "scene.yaml"),
        "--format",
        "conditioning",
        "-o",
        str(tmp_path / "out"),
        *flags,
    ]
    try:
        code = main(command)
    except SystemExit as left:
        code = left.code
    assert code == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.rglob("*.json"))
