"""`physgen clip`: one command in place of `perceive` and `render`."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen.cli.main import main

FRAMES = ("--set", "render.frames=4", "--set", "world.duration=0.2")


@pytest.fixture
def ball_photos(tmp_path: Path) -> list[str]:
    """Two photos of a ball on a floor, and a mask `masks.png` of each ball."""
    paths = []
    for k, x in enumerate((50, 80)):
        rgb = np.full((90, 120, 3), (200, 190, 180), np.uint8)
        rgb[72:] = (90, 110, 130)
        cv2.circle(rgb, (x, 58), 14, (40, 90, 230), -1)
        paths.append(str(tmp_path / f"ball{k}.png"))
        cv2.imwrite(paths[-1], rgb)
    mask = np.zeros((90, 120), np.uint8)
    cv2.circle(mask, (50, 58), 14, 255, -1)
    cv2.imwrite(str(tmp_path / "masks.png"), mask)
    return paths


def test_clip_equals_perceive_and_render(ball_photos, tmp_path: Path, capsys) -> None:
    photo, masks = ball_photos[0], str(tmp_path / "masks.png")
    one, two = tmp_path / "one", tmp_path / "two"
    push = ("--masks", masks, "--push", "ball-1=right")
    label = ("--label", "*=ball")
    assert main(["clip", photo, "-o", str(one), *push, *label, *FRAMES]) == 0
    lines = capsys.readouterr().out.split()
    assert lines == [str(one / "ball0.yaml"), str(one / "ball0")]
    scene = two / "ball0.yaml"
    assert main(["perceive", photo, "-o", str(scene), *push, *label]) == 0
    assert main(["render", str(scene), "-o", str(two), *FRAMES]) == 0
    for name in ("ball0.yaml", "ball0/video.mp4"):
        assert (one / name).read_bytes() == (two / name).read_bytes()


@pytest.mark.slow
def test_clip_prints_json_only(ball_photos, tmp_path: Path, capsys) -> None:
    masks = ("--masks", str(tmp_path / "masks.png"))
    command = ["clip", ball_photos[0], "-o", str(tmp_path / "a.mp4"), *masks]
    assert main([*command, "--json", *FRAMES]) == 0
    clip, summary = map(json.loads, capsys.readouterr().out.splitlines())
    assert clip["scene"] == str(tmp_path / "a.yaml")
    assert summary["made"] == 1
    assert (tmp_path / "a.mp4").is_file()


def test_clip_checks_flags_before_it_perceives(ball_photos, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    wrong = [
        [ball_photos[0], "-o", str(out), "--refine", "nothing"],
        [ball_photos[0], "-o", str(out / "clip.mov")],
        [*ball_photos, "-o", str(out / "clip.mp4")],
        [str(tmp_path / "scene.yaml"), "-o", str(out)],
        [str(tmp_path / "missing.png"), "-o", str(out)],
    ]
    for arguments in wrong:
        assert main(["clip", *arguments]) == 2
        assert capsys.readouterr().err
        assert not out.exists()


@pytest.mark.slow
def test_clip_renders_the_other_photos(ball_photos, tmp_path: Path, capsys) -> None:
    out, broken = tmp_path / "out", tmp_path / "broken.png"
    broken.write_bytes(b"no picture")
    arguments = [str(broken), ball_photos[1], "-o", str(out), "--still", *FRAMES]
    assert main(["clip", *arguments]) == 2
    assert "broken.png" in capsys.readouterr().err
    assert (out / "ball1" / "video.mp4").is_file()
