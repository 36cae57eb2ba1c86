"""Depth and normals against closed forms, read by others than those who wrote them."""

from __future__ import annotations

import json
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from PIL import Image

from physgen.cli.main import main
from physgen.simulate.trajectory import read_trajectory

SIZE = 160, 128
LOW, HIGH = 2.0, 8.0
FREE = (
    "world.gravity=[0, 0]",
    "boundaries={}",
    "objects.*.velocity=[0, 0]",
    "objects.*.spin=0",
)
BOX = "objects.crate.shape={box: {center: [112.5, 62.5], size: [34, 26]}}"
"""The crate's mask to the pixel: turned by a right angle, pixels fall on pixels."""


def ramp(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The background's depth, which a soap film goes on with."""
    return 3.0 + 0.01 * x + 0.02 * y


def smooth(seed: int) -> np.ndarray:
    field = (
        np.random.default_rng(seed)
        .normal(0, 1, (SIZE[1], SIZE[0], 3))
        .astype(np.float32)
    )
    field = cv2.GaussianBlur(field, None, 4)
    return field / np.abs(field).max()


@pytest.fixture
def mapped(photo: Path) -> Path:
    """The photo with a depth and normals."""
    y, x = np.indices(SIZE[::-1], np.float64)
    masks = cv2.imread(str(photo / "photo.assets" / "masks.png"), cv2.IMREAD_UNCHANGED)
    depth = ramp(x, y)
    depth[masks > 0] = (2.5 + 0.3 * masks + 0.1 * smooth(1)[..., 0])[masks > 0]
    normals = smooth(2) * 0.9 + [0, 0, 1.2]
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    maps = {
        "depth": (depth - LOW) / (HIGH - LOW) * 65535,
        "normals": 32768 + 32767 * normals[..., ::-1],
    }
    for name, values in maps.items():
        path = photo / "photo.assets" / f"{name}.png"
        cv2.imwrite(str(path), np.rint(values).astype(np.uint16))
    for name in ("side", "top"):
        scene = photo / f"{name}.yaml"
        text = scene.read_text().replace(
            "world:", f"maps: {{depth: [{LOW}, {HIGH}]}}\nworld:", 1
        )
        scene.write_text(text)
    return photo


def asset(photo: Path, name: str) -> np.ndarray:
    return picture(photo / "photo.assets" / f"{name}.png")


def picture(path: Path) -> np.ndarray:
    """By FFmpeg, which OpenCV has no part in: (H, W) or (H, W, 3) uint16."""
    with av.open(str(path)) as file:
        frame = next(file.decode(video=0))
    assert frame.format.name in ("gray16be", "rgb48be")
    return frame.to_ndarray().astype(np.uint16)


def pictures(folder: Path, name: str) -> list[np.ndarray]:
    return [picture(path) for path in sorted((folder / name).glob("*.png"))]


def vectors(codes: np.ndarray) -> np.ndarray:
    return (codes.astype(np.float64) - 32768) / 32767


def ids(folder: Path) -> list[np.ndarray]:
    """Who is where: 1 is the ball, 2 the crate."""
    return [
        np.asarray(Image.open(path))
        for path in sorted((folder / "davis").rglob("Annotations/**/*.png"))
    ]


def test_frame_0_is_the_photo_and_its_maps(mapped: Path, export) -> None:
    folder = export("side", "depth,normals,davis")
    shown = ids(folder)[0]
    assert (
        (shown > 0) & (shown != asset(mapped, "masks"))
    ).mean() < 1e-3  # a soft border, counted as the thing's
    thing = (shown > 0) & (shown == asset(mapped, "masks"))
    near = cv2.dilate(thing.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    for name in ("depth",):
        np.testing.assert_array_equal(
            pictures(folder, name)[0][thing], asset(mapped, name)[thing]
        )
        np.testing.assert_array_equal(
            pictures(folder, name)[0][~near], asset(mapped, name)[~near]
        )
    apart = np.abs(
        vectors(pictures(folder, "normals")[0]) - vectors(asset(mapped, "normals"))
    )
    assert apart[thing | ~near].max() < 1e-4
    scale = json.loads((folder / "depth" / "scale.json").read_text())
    assert scale == {"at_0": LOW, "at_65535": HIGH, "larger": "farther"}


def test_a_thing_that_moves_takes_its_maps_along(mapped: Path, export) -> None:
    folder = export(
        "side", "depth,normals,davis", *FREE, "objects.crate.velocity=[-60, 40]"
    )
    start = asset(mapped, "masks") == 2
    for k in (1, 5):
        shift = -3 * k, 2 * k
        there = np.roll(start, shift[::-1], (0, 1)) & (ids(folder)[k] == 2)
        assert there.sum() > 0.95 * start.sum()
        for name, loose in (("depth", 1), ("normals", 4)):
            moved = np.roll(asset(mapped, name), shift[::-1], (0, 1)).astype(int)
            assert (
                np.abs(pictures(folder, name)[k].astype(int) - moved)[there].max()
                <= loose
            )


def test_a_quarter_turn_turns_normals_by_a_quarter(mapped: Path, export) -> None:
    folder = export("side", "depth,normals,davis", *FREE, "objects.crate.spin=450", BOX)
    turned = read_trajectory(folder / "trajectory.npz").poses[4, 1, 2]
    assert turned == pytest.approx(np.pi / 2)
    rows, columns = np.nonzero(ids(folder)[4] == 2)
    # px that the picture shows come from there: turned back about the box' middle
    x, y = 112.5 + (rows - 62.5), 62.5 - (columns - 112.5)
    inner = (np.abs(x - 112.5) < 15) & (np.abs(y - 62.5) < 11)
    here = rows[inner], columns[inner]
    there = np.rint(y[inner]).astype(int), np.rint(x[inner]).astype(int)
    was, now = (
        vectors(asset(mapped, "normals"))[there],
        vectors(pictures(folder, "normals")[4])[here],
    )
    np.testing.assert_allclose(
        now, np.column_stack([-was[:, 1], was[:, 0], was[:, 2]]), atol=2e-3
    )
    deep = (
        pictures(folder, "depth")[4][here].astype(int) - asset(mapped, "depth")[there]
    )
    assert np.abs(deep).max() <= 20  # of 65535; places are read to 1/32 px


def test_normals_are_unit_and_those_of_balls_a_spheres(mapped: Path, export) -> None:
    camera = "render.camera=[{time: 0}, {time: 0.3, center: [70, 60], zoom: 1.6}]"
    for edits in ((), (camera,)):
        folder = export("top", "normals,davis", *edits, out=f"labels-{len(edits)}")
        for codes in pictures(folder, "normals"):
            np.testing.assert_allclose(
                np.linalg.norm(vectors(codes), axis=2), 1, atol=1e-4
            )
    folder = folder.parent.parent / "labels-0" / "top"
    x, y, _ = read_trajectory(folder / "trajectory.npz").poses[6, 0]
    rows, columns = np.nonzero(ids(folder)[6] == 1)
    u, v = (columns - x) / 16, (rows - y) / 16
    inside = u * u + v * v < 1
    assert inside.sum() > 700
    told = vectors(pictures(folder, "normals")[6])[rows, columns][inside]
    want = np.column_stack([u, v, np.sqrt(np.maximum(1 - u * u - v * v, 0))])[inside]
    np.testing.assert_allclose(told, want, atol=1e-4)


def test_scenes_without_maps_are_told_what_they_lack(
    photo: Path, tmp_path: Path, capsys
) -> None:
    scene = photo / "side.yaml"
    out = ["-o", str(tmp_path / "labels")]
    assert main(["export", str(scene), "--format", "depth,flo,normals", *out]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    where = f"{scene}:3:9: assets: --format "
    assert lines[1].startswith(
        f'{where}"normals" is made from normals.png, which does not exist; '
    )
    assert lines[0].startswith(
        f'{where}"depth" is made from depth.png, which does not exist; make it: physgen'
    )
    flat = tmp_path / "flat.yaml"
    flat.write_text("physgen: 1\nsize: [64, 48]\nobjects: {}\n")
    assert main(["export", str(flat), "--format", "normals", *out]) == 2
    assert "the scene has no photo; leave normals out" in capsys.readouterr().err
    assert not (tmp_path / "labels").exists()
