"""Objects that are followed through films which physgen has rendered itself."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from physgen.arrays import F64, U8
from physgen.cli.main import main
from physgen.fit import clip
from physgen.fit.film import Follower, follow_film
from physgen.fit.template import Template, Window
from physgen.fit.tracks import Tracks
from physgen.photometry import decode, encode_u8
from physgen.pipeline import stages
from physgen.problems import Problem
from physgen.scene.load import OpenedScene
from physgen.simulate.engine import simulate

CROSSING = """\
physgen: 1
size: [200, 120]
world: {view: top, duration: 1}
objects:
  puck:
    shape: {circle: {center: [40, 60], radius: 12}}
    velocity: [150, 0]
    spin: 120
    collision_group: back
    collides_with: [back]
  post: {shape: {box: {center: [110, 60], size: [16, 70]}}, layer: 1, motion: static}
"""
SHOT = """\
physgen: 1
size: [240, 120]
world: {view: top, duration: 1}
objects:
  puck:
    shape: {circle: {center: [40, 50], radius: 14}}
    solid: disc
    velocity: [500, 0]
    spin: 900
  crate: {shape: {box: {center: [110, 60], size: [30, 30]}}}
"""
SLIDE = """\
physgen: 1
size: [240, 120]
world: {duration: 0.5}
objects:
  crate:
    shape: {box: {center: [50, 80], size: [30, 30]}}
    mass: 200
    friction: 0.5
    velocity: [300, 0]
boundaries: {floor: {segment: [[-500, 95], [1500, 95]], friction: 0.5}}
"""
DISC = """\
physgen: 1
size: [100, 100]
world: {view: top, duration: 1}
objects:
  wheel: {shape: {circle: {center: [50, 50], radius: 20}}, solid: disc}
"""
NOISE = 2.0
"""Codes of a frame's noise."""


class Filmed:
    """A scene's motion as noisy frames."""

    def __init__(self, text: str, times: F64) -> None:
        scene = OpenedScene("scene.yaml", text=text).scene()
        self.world = stages.compile(scene, None).world
        self.stage = stages.stage(scene, stages.compile(scene, None), None)
        self.times = times
        self.motion = simulate(self.world, times)
        generator = np.random.default_rng(0)
        self.frames = []
        for frame in stages.render(self.stage, self.motion):
            noisy = frame.rgb + generator.normal(size=frame.rgb.shape) * NOISE
            self.frames.append(np.clip(noisy, 0, 255).round().astype(np.uint8))

    def tracks(self, frames: Sequence[U8] | None = None) -> Tracks:
        chosen = self.frames if frames is None else frames
        return follow_film(iter(chosen), self.times, self.stage, self.world, False)

    def errors(self, tracks: Tracks, name: str) -> Any:
        k = tracks.names.index(name)
        return tracks.poses[:, k] - self.motion.poses[:, k]


@pytest.fixture(scope="module")
def crossing() -> Filmed:
    return Filmed(CROSSING, np.arange(26) / 30)


def test_poses_are_found_within_a_tenth_of_a_pixel(crossing: Filmed) -> None:
    tracks = crossing.tracks()
    errors = crossing.errors(tracks, "puck")
    assert np.nanmax(np.abs(errors[:, :2])) < 0.25
    assert np.sqrt(np.nanmean(errors[:8, :2] ** 2)) < 0.1
    assert np.nanmax(np.abs(errors[:8, 2])) < 0.05
    assert tracks.losses == ()
    assert np.nanmax(np.abs(crossing.errors(tracks, "post")[:, :2])) < 0.1


def test_borders_of_light_and_dark_stay_in_place() -> None:
    slide = Filmed(SLIDE, np.arange(8) / 30)
    errors = slide.errors(slide.tracks(), "crate")
    assert np.abs(errors[:, 1]).max() < 0.03
    assert np.abs(errors[:, 0]).max() < 0.06


def test_fast_turns_and_impacts_are_followed() -> None:
    shot = Filmed(SHOT, np.arange(9) / 30)
    tracks = shot.tracks()
    # 30 degrees a frame, of a thin mark
    assert np.nanmax(np.abs(shot.errors(tracks, "puck")[:, 2])) < 0.05
    errors = shot.errors(tracks, "crate")
    jump = np.abs(np.diff(shot.motion.poses[:, 1, 0])).max()
    assert jump > 8
    assert np.nanmax(np.abs(errors[:, :2])) < 0.25
    assert np.nanmax(np.abs(errors[:, 2])) < 0.02


def spoked_follower() -> tuple[Follower, Template, U8]:
    """Return a follower of a disc with four equal spokes, and its background."""
    world = Filmed(DISC, np.arange(1) / 30).world
    rows, columns = np.mgrid[-20:21, -20:21]
    alpha = np.clip(20.5 - np.hypot(rows, columns), 0, 1)
    away = np.minimum(np.abs(rows), np.abs(columns))
    light = (0.05 + 0.55 * np.clip(away - 2, 0, 2) / 2) * alpha
    paint = np.dstack([light, light, light, alpha]).astype(np.float32)
    center = tuple(world.bodies[0].center.tolist())
    template = Template(0, (30, 30), paint, center, 14.0, True, True)
    background = np.full((100, 100, 3), 128, np.uint8)
    return Follower([template], background, world), template, background


def frame_of(template: Template, pose: F64, background: U8, seed: int) -> U8:
    paint = template.draw(pose, Window((0, 0), (100, 100)))
    light = paint[..., :3] + (1 - paint[..., 3:]) * decode(background)
    noise = np.random.default_rng(seed).normal(size=light.shape) * NOISE
    codes = encode_u8(light) + noise
    return np.asarray(np.clip(codes, 0, 255).round(), np.uint8)


def test_disc_with_equal_spokes_keeps_its_turn() -> None:
    follower, template, background = spoked_follower()
    for k in range(1, 13):
        pose = np.array([50, 50, 0.05 * k])
        found = follower.follow(frame_of(template, pose, background, k))
        assert found[0, 2] == pytest.approx(pose[2], abs=0.01)


def test_error_of_first_pose_turns_with_object() -> None:
    follower, template, background = spoked_follower()
    # the picture lies beside the centre that the scene states
    error = np.array([0.25, 0.0, 0.0])
    still = np.array([50.0, 50.0, 0.0])
    follower.calibrate(frame_of(template, still + error, background, 0))
    for k in range(1, 17):
        angle = 0.1 * k
        shift = 0.25 * np.array([np.cos(angle), np.sin(angle)])
        pose = np.array([*(still[:2] + shift), angle])
        found = follower.follow(frame_of(template, pose, background, k))
    assert found[0, :2] == pytest.approx([50, 50], abs=0.06)


def test_hidden_object_is_not_observed_and_comes_back(crossing: Filmed) -> None:
    tracks = crossing.tracks()
    puck = tracks.names.index("puck")
    seen = np.isfinite(tracks.poses[:, puck, 0])
    x = crossing.motion.poses[:, puck, 0]
    assert not seen[np.abs(x - 110) < 3].any()
    assert seen[x < 85].all()
    assert seen[x > 140].all()


def test_vanished_object_is_reported_as_lost(crossing: Filmed) -> None:
    frames = [*crossing.frames[:6], *[crossing.stage.background] * 3]
    losses = dict(crossing.tracks(frames).losses)
    assert losses["puck"] == pytest.approx(5 / 30)


def test_objects_that_leave_or_hide_are_not_lost(crossing: Filmed) -> None:
    # behind the post in the last frame
    tracks = crossing.tracks(crossing.frames[:15])
    assert not np.isfinite(tracks.poses[-1, tracks.names.index("puck"), 0])
    assert tracks.losses == ()
    post = CROSSING.index("  post:")
    edits = CROSSING[:post].replace("[150, 0]", "[600, 0]")
    tracks = Filmed(edits, np.arange(14) / 30).tracks()
    assert not np.isfinite(tracks.poses[-1, 0, 0])
    assert tracks.losses == ()


def test_uneven_frames_have_their_own_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "clip.gif"
    frames = [Image.new("L", (240, 120), 50 * k) for k in range(5)]
    shown = [100, 100, 400, 100, 100]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=shown)
    monkeypatch.setattr(clip, "MOST_FRAMES", 4)
    film = clip.FilmedClip(path, 2.0, OpenedScene("slide.yaml", text=SLIDE).scene())
    assert film.times == pytest.approx([0, 0.05, 0.1, 0.3])
    warnings: list[Problem] = []
    film.warn_of_frames(warnings.append)
    assert "warning: 1 frames at the end are left out: 4" in str(warnings[0])


def test_jump_of_an_object_is_found(crossing: Filmed) -> None:
    tracks = Filmed(CROSSING, np.array([0.0, 1 / 30, 0.23])).tracks()
    puck = tracks.names.index("puck")
    assert tracks.poses[2, puck, 0] == pytest.approx(40 + 150 * 0.23, abs=0.2)


@pytest.mark.slow
def test_clip_tells_the_physics_of_its_scene(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "slide.yaml"
    scene.write_text(SLIDE)
    clip = tmp_path / "clip.mp4"
    assert main(["render", str(scene), "-o", str(clip), "--report", "none"]) == 0
    scene.write_text(SLIDE.replace("friction: 0.5\n    v", "friction: 0.2\n    v"))
    output = tmp_path / "fitted.yaml"
    flags = ["--free", "velocity,friction", "-o", str(output)]
    assert main(["fit", str(scene), str(clip), *flags]) == 0
    crate = OpenedScene(str(output)).scene().objects[0]
    assert crate.friction == pytest.approx(0.5, rel=0.1)
    assert crate.velocity[0] == pytest.approx(300, rel=0.02)
    assert (tmp_path / "fitted" / "pair.mp4").stat().st_size > 1000
    assert "pair.mp4" in (tmp_path / "fitted" / "report.html").read_text()


def test_clip_of_another_size_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "slide.yaml"
    scene.write_text(SLIDE)
    clip = tmp_path / "clip.mp4"
    sparing = ["--set", "render.frames=6", "--set", "render.scale=0.5"]
    flags = ["-o", str(clip), "--report", "none", *sparing]
    assert main(["render", str(scene), *flags]) == 0
    capsys.readouterr()
    assert main(["fit", str(scene), str(clip)]) == 2
    error = capsys.readouterr().err
    assert f"{clip}: 120 x 60 px is not the photo's size, 240 x 120 px" in error
