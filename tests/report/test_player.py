"""The player's data against the trajectory that it comes from, and against nature."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from browser import lay, picture
from PIL import Image
from pytest import approx

from physgen import pipeline
from physgen.report.player import player_data

BOUNCE = """\
physgen: 1
size: [300, 400]
world: {pixels_per_meter: 200, gravity: [0, 600], duration: 1.5}
objects:
  ball: {shape: {circle: {center: [150, 60], radius: 20}}, mass: 50, elasticity: 0.8, friction: 0, velocity: [30, 0]}
  disc: {shape: {circle: {center: [60, 200], radius: 10}}, mass: 2, velocity: [0, -90], spin: 720}
boundaries:
  floor: {segment: [[-1000, 380], [1000, 380]], elasticity: 0.8, friction: 0}
"""


@cache
def made(path: Path, overrides: tuple[str, ...] = ()) -> SimpleNamespace:
    scene = pipeline.load(path, overrides)
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    trajectory = pipeline.simulate(compiled.world)
    stage = pipeline.stage(scene, compiled, maps)
    shot = pipeline.shot(scene, trajectory)
    data = player_data(scene, compiled.world, trajectory, stage, shot)
    return SimpleNamespace(
        scene=scene,
        world=compiled.world,
        run=trajectory,
        stage=stage,
        maps=maps,
        data=data,
    )


def written(tmp_path: Path, text: str, *overrides: str) -> SimpleNamespace:
    (tmp_path / "scene.yaml").write_text(text, encoding="utf-8")
    return made(tmp_path / "scene.yaml", overrides)


def values(data: dict, body: int, name: str, step: str) -> np.ndarray:
    return np.cumsum(data["bodies"][body][name]) * data["steps"][step]


def test_places_are_rounded_as_little_as_is_said(tmp_path: Path) -> None:
    got = written(tmp_path, BOUNCE)
    frames = got.data["frames"]
    assert len(frames) == len(got.run.times)
    times = np.cumsum(got.data["times"]) * got.data["steps"]["time"]
    assert times[frames] == approx(got.run.times, abs=1e-6)
    for k in range(2):
        assert values(got.data, k, "x", "place")[frames] == approx(
            got.run.poses[:, k, 0], abs=1 / 64 + 1e-9
        )
        assert values(got.data, k, "y", "place")[frames] == approx(
            got.run.poses[:, k, 1], abs=1 / 64 + 1e-9
        )
        assert values(got.data, k, "a", "angle")[frames] == approx(
            got.run.poses[:, k, 2], abs=1 / 8192 + 1e-9
        )
        most = np.abs(got.run.velocities[..., :2]).max()
        assert values(got.data, k, "vx", "speed")[frames] == approx(
            got.run.velocities[:, k, 0], abs=most / 8000
        )
        assert values(got.data, k, "vy", "speed")[frames] == approx(
            got.run.velocities[:, k, 1], abs=most / 8000
        )


def test_between_samples_a_ball_falls_as_a_ball_does(tmp_path: Path) -> None:
    """Slow motion looks between frames: y = y0 + g t² / 2 there too, to a twentieth of a pixel."""
    got = written(tmp_path, BOUNCE)
    times = np.cumsum(got.data["times"]) * got.data["steps"]["time"]
    lands = np.sqrt(2 * (380 - 20 - 60) / 600)
    any_time = np.linspace(0, lands - 1e-3, 997)
    seen = np.interp(any_time, times, values(got.data, 0, "y", "place"))
    assert seen == approx(60 + 300 * any_time**2, abs=0.05)
    assert np.abs(times - lands).min() < 2e-3, "there is a sample where it lands"


def test_a_touch_gives_what_the_motion_changes_by(tmp_path: Path) -> None:
    """J = m (1 + e) v."""
    got = written(tmp_path, BOUNCE)
    names = [body["name"] for body in got.data["bodies"]] + [
        wall["name"] for wall in got.data["walls"]
    ]
    _, second, begin, _, impulse = next(
        t for t in got.data["touches"] if names[t[0]] == "ball"
    )
    assert names[second] == "floor"
    speed = np.sqrt(2 * 600 * 300)
    assert begin == approx(speed / 600, abs=2e-3)
    assert impulse == approx(50 * 1.8 * speed, rel=5e-3)
    blow = next(b for b in got.data["impacts"] if names[b[4]] == "ball")
    assert blow[3] == approx(impulse, rel=1e-2)
    assert blow[1:3] == approx([150 + 30 * begin, 380], abs=0.5)


def test_what_a_camera_sees(tmp_path: Path) -> None:
    assert written(tmp_path, BOUNCE).data["camera"] is None
    views = written(
        tmp_path, BOUNCE, "render.camera={center: [150, 200], zoom: 2}"
    ).data["camera"]
    assert views[0] == approx([150 - 75, 200 - 100, 150, 200])
    assert views[-1] == views[0]


def test_scenes_of_nothing_and_of_one_frame(tmp_path: Path) -> None:
    nothing = written(tmp_path, "physgen: 1\nsize: [40, 30]\nobjects: {}\n").data
    assert (nothing["bodies"], nothing["touches"], nothing["sprites"]) == ([], [], [])
    assert picture(nothing["background"]).shape == (30, 40, 4)
    one = written(tmp_path, BOUNCE, "render.frames=1").data
    assert one["frames"] == [0]
    assert [len(body["x"]) for body in one["bodies"]] == [1, 1]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["billiards", "dominoes"])
def test_at_rest_its_parts_make_the_photo(bundled: Path, name: str) -> None:
    """Background, shadows and cut-outs were taken apart in linear light and come together in codes: nearly the same."""
    got = made(bundled / name / "scene.yaml")
    photo = np.asarray(Image.open(got.scene.image).convert("RGB"), np.float64)
    canvas = picture(got.data["background"])[..., :3].copy()
    assert canvas.shape[1::-1] == got.scene.size
    for row in [
        *(shadow["keys"][0] for shadow in got.data["shadows"]),
        *got.data["sprites"],
    ]:
        if "src" in row:
            lay(canvas, row)
    off = np.abs(canvas - photo)
    assert off.mean() < 2.5
    assert np.percentile(off, 99) < 20


def test_a_shadow_is_known_where_its_object_turns_away(bundled: Path) -> None:
    """Between the samples at which a shadow is worked out, its object's way is straight to a few px."""
    got = made(bundled / "dominoes" / "scene.yaml")
    assert got.data["shadows"]
    for shadow in got.data["shadows"]:
        samples = [key["sample"] for key in shadow["keys"]]
        assert samples == sorted(set(samples))
        way = got.run.poses[:, shadow["body"], :2]
        straight = np.stack(
            [np.interp(np.arange(len(way)), samples, way[samples, k]) for k in (0, 1)],
            axis=1,
        )
        assert np.abs(way - straight).max() < 12
