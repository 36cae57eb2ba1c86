"""A rendered clip as a value: its files are read back, and a notebook shows its video."""

from __future__ import annotations

import base64
import re
from pathlib import Path

import numpy as np
import pytest

from physgen.export.video import Format
from physgen.pipeline import Clip, Page, render_clip

SCENE = """\
physgen: 1
size: [64, 48]
world: {duration: 0.3}
objects:
  ball: {shape: {circle: {center: [16, 30], radius: 7}}, velocity: [100, 0]}
boundaries:
  floor: {segment: [[-100, 37], [300, 37]]}
render: {fps: 20}
"""


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    folder = tmp_path_factory.mktemp("clip")
    (folder / "ball.yaml").write_text(SCENE)
    formats = (Format.MP4, Format.GIF)
    return render_clip(folder / "ball.yaml", folder / "out", formats=formats)


def test_a_clip_has_video_frames_motion_and_report(clip: Clip) -> None:
    assert clip.video == clip.folder / "video.mp4"
    assert clip.report == clip.folder / "report.html"
    assert clip.trajectory.names == ("ball",)
    assert len(clip.frames) == len(clip.trajectory.times) == 6
    columns, rows = np.arange(64), slice(0, 35)  # above the floor's line
    middles = []
    for rgb in clip.frames:
        assert rgb.shape == (48, 64, 3)
        is_ball = (rgb[rows].mean(axis=2) < 190).sum(axis=0)
        middles.append((is_ball * columns).sum() / is_ball.sum())
    assert np.abs(middles - clip.trajectory.poses[:, 0, 0]).max() < 1.0


def test_a_notebook_shows_the_video_itself(clip: Clip, tmp_path: Path) -> None:
    (data,) = re.findall(r'src="data:video/mp4;base64,([^"]+)"', clip._repr_html_())
    assert base64.b64decode(data) == clip.video.read_bytes()
    (tmp_path / "video.gif").write_bytes((clip.folder / "video.gif").read_bytes())
    assert 'src="data:image/gif;base64,' in Clip(tmp_path)._repr_html_()
    with pytest.raises(FileNotFoundError, match="has no video"):
        Clip(tmp_path / "empty")._repr_html_()


def test_arguments_are_those_of_render_scene(clip: Clip, tmp_path: Path) -> None:
    scene = clip.folder.parent.parent / "ball.yaml"
    edits = ["render.frames=2"]
    other = render_clip(scene, tmp_path, overrides=edits, name="two", page=Page.NONE)
    assert (other.folder, other.report, len(other.frames)) == (
        tmp_path / "two",
        None,
        2,
    )
