"""Frames drawn by torch against those drawn by OpenCV, which the other tests hold against what light does."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from physgen import pipeline
from physgen.cli.main import main
from physgen.render import torch_frames
from physgen.render.frames import render_frames
from physgen.render.torch_frames import render_frames_torch

ROOT = Path(__file__).resolve().parents[2]
DEVICES = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
torch.set_num_threads(1)  # on pictures so small, threads wait for each other longer than they work
LESSON = """\
physgen: 1
size: [160, 120]
world: {duration: 0.25}
objects: {ball: {shape: {circle: {center: [40, 85], radius: 15}}, velocity: [300, 0]}}
render: {fps: 24, motion_blur: 0.5}
"""


def staged(name: str, frames: int = 6, bumpy: bool = False):
    """A scene's stage, its trajectory at a few times, and the photo; `bumpy`: with normals of waves."""
    scene = pipeline.load(ROOT / "scenes" / name, [f"render.frames={frames}"])
    maps = pipeline.percepts(scene)
    if bumpy:
        y, x = np.mgrid[: scene.size[1], : scene.size[0]]
        normals = np.stack([np.sin(x / 5), np.cos(y / 7), 1.2 + 0 * x], axis=-1)
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        maps = replace(maps, normals=normals.astype(np.float32))
    compiled = pipeline.compile(scene, maps)
    trajectory = pipeline.simulate(compiled.world)
    return pipeline.stage(scene, compiled, maps), trajectory, None if maps is None else maps.rgb


def tossed(trajectory):
    """All things fly apart and spin: over the borders, and some out of sight."""
    T, N, _ = trajectory.poses.shape
    each = np.linspace(0, 2 * np.pi, N, endpoint=False)
    far = np.linspace(200, 900, N)
    way = np.stack([far * np.cos(each), far * np.sin(each), 2 + 3 * np.sin(5 * each)], axis=-1)
    poses = trajectory.poses[:1] + np.linspace(0, 1, T)[:, None, None] * way
    return replace(trajectory, poses=poses)


def assert_same(found, expected, count: int) -> None:
    found, expected = list(found), list(expected)
    assert len(found) == len(expected) == count
    for ours, theirs in zip(found, expected, strict=True):
        assert (ours.index, ours.time) == (theirs.index, theirs.time)
        assert (ours.rgb.dtype, ours.ids.dtype) == (np.uint8, np.uint16)
        off = np.abs(ours.rgb.astype(int) - theirs.rgb)
        assert off.max() <= 1
        assert (off > 0).mean() < 1e-4  # codes whose border a rounding crosses
        assert (ours.ids != theirs.ids).mean() < 1e-4  # half covered pixels, likewise


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(
    "name", ["billiards/scene.yaml", "dominoes/scene.yaml", "physics/15-break.yaml", "physics/34-motor.yaml"]
)
def test_torch_draws_the_same_frames(name: str, device: str) -> None:
    stage, trajectory, photo = staged(name)
    assert (stage.lit is not None) == (photo is not None)
    frames = list(render_frames_torch(stage, trajectory, device=device, batch=4))
    assert_same(frames, render_frames(stage, trajectory), 6)
    assert photo is None or np.array_equal(frames[0].rgb, photo)


@pytest.mark.parametrize("device", DEVICES)
def test_normals_turn_and_things_leave_the_canvas(device: str) -> None:
    stage, trajectory, _ = staged("dominoes/scene.yaml", bumpy=True)
    assert all(sprite.relief is not None for sprite in stage.sprites)
    away = tossed(trajectory)
    expected = list(render_frames(stage, away))
    assert len(np.unique(expected[-1].ids)) < len(stage.sprites), "something is out of sight"
    assert_same(render_frames_torch(stage, away, device=device), expected, 6)


@pytest.fixture
def lesson(tmp_path: Path) -> Path:
    path = tmp_path / "lesson.yaml"
    path.write_text(LESSON)
    return path


def test_the_command_draws_by_torch(lesson: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(torch_frames, "opened", lambda name: torch.device("cpu" if name == "cuda" else name))
    assert main(["render", str(lesson), "-o", str(tmp_path / "a")]) == 0
    assert main(["render", str(lesson), "-o", str(tmp_path / "b"), "--device", "cuda"]) == 0
    plain, other = (json.loads((tmp_path / k / "lesson/manifest.json").read_text()) for k in "ab")
    assert plain["device"] == "cpu"
    assert other["device"] == f"cpu, torch {torch.__version__}"
    assert len(plain["frames"]) == len(other["frames"]) == 6


def test_no_gpu_is_told_in_one_line(lesson: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 0)
    assert main(["render", str(lesson), "-o", str(tmp_path / "out"), "--device", "cuda"]) == 2
    said = capsys.readouterr().err
    assert said.startswith('--device: "cuda" is no GPU that torch can use here; leave --device out')
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_without_torch_it_says_what_to_install(lesson: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.delitem(sys.modules, "physgen.render.torch_frames")
    monkeypatch.setitem(sys.modules, "torch", None)
    assert main(["render", str(lesson), "-o", str(tmp_path / "out"), "--device", "cuda"]) == 2
    said = capsys.readouterr().err
    assert said == '--device: "cuda" needs torch, which is not installed; pip install "physgen[models]"\n'
    assert main(["render", str(lesson), "-o", str(tmp_path / "out")]) == 0


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("name", ["billiards/scene.yaml", "pendulum/scene.yaml"])
def test_order_and_more_samples_a_pixel_are_the_same_too(name: str, device: str) -> None:
    stage, trajectory, _ = staged(name)
    fine = replace(stage, supersample=2)
    order = [5, 2, 3]
    expected = list(render_frames(fine, trajectory, order))
    assert_same(render_frames_torch(fine, trajectory, order, device=device), expected, 3)
