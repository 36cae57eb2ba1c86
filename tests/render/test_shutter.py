"""Motion blur is the mean of the light of an exposure."""

from __future__ import annotations

import numpy as np
import pytest

from physgen import pipeline
from physgen.photometry import decode
from physgen.pipeline.film import Film
from physgen.pipeline.stages import Keep, Stages
from physgen.render import camera as camera_module
from physgen.render.camera import exposure_times, film_frames, mean_exposures
from physgen.render.frames import render_frames
from physgen.report.record import RunRecord
from physgen.simulate.engine import simulate

SCENE = """\
physgen: 1
size: [160, 60]
world: {view: top, duration: 0.5}
objects: {a: {shape: {circle: {center: [30, 30], radius: 12}}, velocity: [200, 0]}}
"""


def frames(tmp_path, part):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    scene = pipeline.load(path)
    compiled = pipeline.compile(scene, None)
    times, parts = exposure_times(simulate(compiled.world), compiled.world, part)
    return list(
        pipeline.render(
            pipeline.stage(scene, compiled, None),
            simulate(compiled.world, times),
            parts,
        )
    )


def test_a_closed_shutter_changes_nothing(tmp_path) -> None:
    assert [f.time for f in frames(tmp_path, 0.0)] == pytest.approx(
        [k / 30 for k in range(15)]
    )


def test_the_first_frame_is_sharp_and_the_rest_are_smeared_backwards(tmp_path) -> None:
    sharp, smeared = frames(tmp_path, 0.0), frames(tmp_path, 1.0)
    assert len(sharp) == len(smeared)
    assert np.array_equal(sharp[0].rgb, smeared[0].rgb)
    assert [f.time for f in smeared] == pytest.approx([f.time for f in sharp])
    for before, after in zip(sharp[5:], smeared[5:], strict=True):
        paper = decode(before.rgb[0, 0])
        dark = [np.abs(decode(f.rgb) - paper).sum(-1) for f in (before, after)]
        # as much is hidden, spread over the way of an exposure, which lies behind: 200 px/s / 30 fps in 4 moments
        assert dark[1].sum() == pytest.approx(dark[0].sum(), rel=0.02)
        x = np.arange(160)
        middle = [(d.sum(0) * x).sum() / d.sum() for d in dark]
        assert middle[0] - middle[1] == pytest.approx(200 / 30 * 3 / 4 / 2, abs=0.15)


def test_it_is_the_mean_of_light(tmp_path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    scene = pipeline.load(path)
    compiled = pipeline.compile(scene, None)
    stage = pipeline.stage(scene, compiled, None)
    times, parts = exposure_times(simulate(compiled.world), compiled.world, 0.5)
    each = [f.rgb for f in pipeline.render(stage, simulate(compiled.world, times))]
    blurred = list(
        mean_exposures(pipeline.render(stage, simulate(compiled.world, times)), parts)
    )
    for k, frame in enumerate(blurred):
        mean = np.mean(
            [decode(rgb) for rgb in each[k * parts : (k + 1) * parts]], axis=0
        )
        assert np.abs(decode(frame.rgb) - mean).max() < 0.006


def spread(frames: list[np.ndarray], others: list[np.ndarray]) -> float:
    """Levels: the root of the mean square of their differences."""
    return float(
        np.sqrt(
            np.mean((np.array(frames, np.float32) - np.array(others, np.float32)) ** 2)
        )
    )


def three_ways(path, *edits: str) -> tuple[list[np.ndarray], ...]:
    """sRGB of a clip's frames without blur, smeared, and as the mean of every moment drawn by itself."""
    scene = pipeline.load(path, edits)
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    stage = pipeline.stage(scene, compiled, maps)
    trajectory = simulate(compiled.world)
    times, parts = exposure_times(trajectory, compiled.world, 0.5)
    fine = simulate(compiled.world, times)
    frames = pipeline.render(stage, trajectory), pipeline.render(stage, fine, parts)
    exact = mean_exposures(pipeline.render(stage, fine), parts)
    sharp, smeared, mean = ([frame.rgb for frame in some] for some in (*frames, exact))
    return sharp, smeared, mean


@pytest.mark.slow
def test_a_smeared_picture_is_the_mean_of_many(bundled) -> None:
    """Of balls that roll, throw shadows and shade each other, beside the mean of every moment drawn by itself."""
    sharp, smeared, exact = three_ways(
        bundled / "billiards" / "scene.yaml", "world.duration=0.3"
    )
    assert np.array_equal(smeared[0], sharp[0])
    one, other = (spread(frames, exact) for frames in (smeared, sharp))
    assert one < 0.5 * other


@pytest.mark.slow
def test_a_moving_camera_sees_the_mean_of_many(bundled, monkeypatch) -> None:
    """In four views, beside every moment filmed by itself."""
    camera = "[{time: 0, zoom: 2, center: [250, 200]}, {time: 0.1, follow: cue-ball, zoom: 3}]"
    scene = pipeline.load(
        bundled / "billiards" / "scene.yaml",
        ["world.duration=0.3", f"render.camera={camera}"],
    )
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    stage = pipeline.stage(scene, compiled, maps)
    trajectory = simulate(compiled.world)
    times, parts = exposure_times(trajectory, compiled.world, 0.5)
    assert parts > 4
    fine, through = simulate(compiled.world, times), pipeline.shot(scene, trajectory)
    exact = [
        f.rgb
        for f in mean_exposures(
            film_frames(render_frames(stage, fine, through.samples(parts)), through),
            parts,
        )
    ]
    sharp = [frame.rgb for frame in pipeline.render(stage, trajectory, 1, through)]
    views: list[int] = []
    resample = camera_module.resample_picture
    monkeypatch.setattr(
        camera_module, "resample_picture", lambda *a: views.append(1) or resample(*a)
    )
    smeared = [frame.rgb for frame in pipeline.render(stage, fine, parts, through)]
    assert len(views) <= 4 * len(smeared)
    one, other = (spread(frames, exact) for frames in (smeared, sharp))
    assert one < 0.15 * other


LEAVING = {
    "a box": ("{box: {center: [130, 30], size: [24, 24]}}", [900, 0], 0.0),
    "a box that turns": (
        "{box: {center: [130, 30], size: [24, 24]}}",
        [600, 120],
        900.0,
    ),
    "a disc": ("{circle: {center: [128, 30], radius: 12}}", [900, -250], 0.0),
    "a ball": ("{circle: {center: [30, 30], radius: 12}}", [-900, 0], 0.0),
}


@pytest.mark.parametrize("what", LEAVING)
def test_what_leaves_the_picture_is_the_mean_of_many_too(tmp_path, what) -> None:
    """Also where it is clipped at the closing time, or gone."""
    shape, velocity, spin = LEAVING[what]
    solid = ", solid: sphere" if what == "a ball" else ""
    path = tmp_path / "scene.yaml"
    path.write_text(
        "physgen: 1\nsize: [160, 60]\nworld: {view: top, duration: 0.2}\n"
        f"objects: {{a: {{shape: {shape}{solid}, velocity: {velocity}, spin: {spin}}}}}\n"
    )
    _, smeared, exact = three_ways(path)
    assert (exact[-1] == exact[-1][0, 0]).all(), "it has left"
    for one, other in zip(smeared, exact, strict=True):
        assert (
            np.abs(one.astype(int) - other).max() <= 25
        )  # levels; 120 and more where it was cut at the border


FLIGHT = """\
physgen: 1
size: [160, 120]
world: {pixels_per_meter: 100, duration: 0.2}
objects:
  thrown: {shape: {circle: {center: [60, 30], radius: 12}}, velocity: [300, 0]}
  pushed: {shape: {circle: {center: [40, 98], radius: 12}}, velocity: [300, 0]}
boundaries: {floor: {segment: [[-90, 110], [400, 110]]}}
render: {motion_blur: 0.5}
"""


def test_what_is_in_the_air_starts_with_blur(tmp_path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(FLIGHT)
    clips = []
    for overrides in ([], ["render.first_blur=true"]):
        stages = Stages(Keep.NOTHING)
        scene = pipeline.load(path, overrides)
        maps = stages.maps(scene)
        record = RunRecord(scene="", command=[])
        film = Film(scene, stages.compile(scene, maps), maps, record, stages)
        film.deliver()
        motion = film.simulate_motion(lambda *_: None)
        clips.append([frame.rgb for frame in film.frames(motion)])
    sharp, blurred = clips
    for before, after in zip(sharp[1:], blurred[1:], strict=True):
        assert np.array_equal(before, after)
    difference = np.abs(sharp[0].astype(int) - blurred[0]).max(axis=2) > 20
    rows, columns = np.nonzero(difference)
    # Its way of 5 px lies behind it; what touches the floor stays sharp.
    assert rows.max() < 45
    assert columns.min() < 60 - 12 - 2
