"""Physics from tracks: synthetic motions whose values are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physgen.arrays import F64
from physgen.cli.main import main
from physgen.fit import search
from physgen.fit.intervals import Fit
from physgen.fit.parameters import Kind, free_parameters, with_values
from physgen.fit.residuals import Model
from physgen.fit.solve import absent_kinds, fit_scene
from physgen.fit.starts import estimate_starts
from physgen.fit.tracks import Tracks, read_tracks, tracks_csv
from physgen.pipeline import stages
from physgen.problems import InputError
from physgen.scene.load import OpenedScene
from physgen.scene.provenance import source
from physgen.simulate.engine import simulate

NOISE = 0.5
"""px."""
SLIDE = """\
physgen: 1
size: [400, 200]
world: {duration: 1}
objects:
  crate:  # a parcel
    shape: {box: {center: [60, 130], size: [40, 40]}}
    mass: 200
    friction: 0.5
    velocity: [400, 0]
boundaries: {floor: {segment: [[-500, 150.5], [1500, 150.5]], friction: 0.5}}
"""
DROP = """\
physgen: 1
size: [200, 400]
world: {duration: 0.8}
objects:
  ball: {shape: {circle: {center: [100, 40], radius: 12}}, mass: 50, elasticity: 0.7}
boundaries: {floor: {segment: [[-500, 350.5], [1500, 350.5]], elasticity: 0.7}}
"""
GLIDE = """\
physgen: 1
size: [300, 100]
world: {view: top, duration: 1, table: {friction: 0}}
objects:
  puck: {shape: {circle: {center: [40, 50], radius: 12}}, velocity: [400, 0]}
"""


def scene_of(text: str, *edits: str) -> tuple[object, object]:
    scene = OpenedScene("scene.yaml", text=text).scene(edits)
    return scene, stages.compile(scene, None)


def observed(text: str, seconds: float, seed: int = 0) -> Tracks:
    """Return noisy tracks of a scene's motion at 30 frames per second."""
    _, compiled = scene_of(text)
    times = np.arange(0.0, seconds + 1e-9, 1 / 30)
    poses = simulate(compiled.world, times).poses.copy()
    generator = np.random.default_rng(seed)
    for k, body in enumerate(compiled.world.bodies):
        gyration = (body.moment / body.mass) ** 0.5
        widths = NOISE * np.array([1.0, 1.0, 1 / gyration])
        poses[:, k] += generator.normal(size=(len(times), 3)) * widths
    names = tuple(body.name for body in compiled.world.bodies)
    return Tracks(times, names, poses)


def fitted(
    text: str, tracks: Tracks, kinds: Sequence[Kind], *edits: str
) -> dict[str, object]:
    fit = fit_scene(*scene_of(text, *edits), tracks, kinds)
    estimates = {one.parameter.path: one for one in fit.estimates}
    return {"fit": fit, **estimates}


@pytest.mark.slow
def test_fit_tells_friction_of_a_sliding_crate() -> None:
    tracks = observed(SLIDE, 0.9)
    kinds = (Kind.VELOCITY, Kind.FRICTION, Kind.ELASTICITY)
    edits = ("objects.crate.friction=0.2", "objects.crate.velocity=[0, 0]")
    result = fitted(SLIDE, tracks, kinds, *edits)
    friction = result["objects.crate.friction"]
    assert friction.low < 0.5 < friction.high
    assert friction.value == pytest.approx(0.5, rel=0.05)
    velocity = result["objects.crate.velocity.0"]
    assert velocity.low < 400 < velocity.high
    assert velocity.value == pytest.approx(400, rel=0.02)
    # nothing bounces
    assert not result["objects.crate.elasticity"].is_determined
    fit = result["fit"]
    assert isinstance(fit, Fit)
    assert fit.flat_directions == ("objects.crate.elasticity",)
    assert fit.noise == pytest.approx(NOISE, rel=0.25)


@pytest.mark.slow
def test_dropped_ball_tells_gravity_and_elasticity() -> None:
    tracks = observed(DROP, 0.8)
    kinds = (Kind.VELOCITY, Kind.GRAVITY, Kind.ELASTICITY)
    edits = ("world.gravity=[0, 700]", "objects.ball.elasticity=0.3")
    result = fitted(DROP, tracks, kinds, *edits)
    gravity = result["world.gravity.1"]
    assert gravity.value == pytest.approx(980, rel=0.02)
    assert gravity.low < 980 < gravity.high
    assert result["objects.ball.elasticity"].value == pytest.approx(0.7, abs=0.03)


@pytest.mark.slow
def test_same_seed_gives_the_same_draws_and_fit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sparing = replace(
        search.SEARCH, horizons=(1.0,), draws=3, trial_steps=1, final_steps=1
    )
    monkeypatch.setattr(search, "SEARCH", sparing)
    limit, drawn = search.clip_numbers, []

    def noted(model: Model, numbers: F64) -> F64:
        drawn.append(numbers.tolist())
        return limit(model, numbers)

    monkeypatch.setattr(search, "clip_numbers", noted)
    # another gravity leaves residuals, so that other starts are tried
    text = DROP.replace("[100, 40]", "[100, 330]")
    parts = scene_of(text, "world.gravity=[0, 600]", "objects.ball.elasticity=0.1")
    tracks, runs = observed(text, 0.2), []
    for seed in (0, 0, 1):
        drawn.clear()
        estimates = fit_scene(*parts, tracks, [Kind.ELASTICITY], seed).estimates
        runs.append((estimates, list(drawn)))
    assert runs[0] == runs[1]
    # the first start, three draws, two refined, the last
    assert len(runs[0][1]) == 7
    assert runs[0][1][1:4] != runs[2][1][1:4]


def test_what_is_not_determined_stays() -> None:
    edits = ("objects.puck.friction=0", "objects.puck.static_friction=0.4")
    scene, compiled = scene_of(GLIDE, *edits)
    fit = fit_scene(scene, compiled, observed(GLIDE, 0.3), [Kind.FRICTION])
    assert not fit.estimates[0].is_determined
    assert fit.scene.objects == scene.objects


@pytest.mark.parametrize(
    ("text", "kinds", "offered"),
    [
        (SLIDE, (Kind.TABLE,), "velocity, spin, friction, elasticity, direction"),
        (SLIDE, (Kind.MASS, Kind.ROLLING), "velocity, spin, friction"),
        (GLIDE, (Kind.DIRECTION,), "rolling, table"),
        (GLIDE.replace("puck: {", "puck: {motion: static, "), (Kind.MASS,), "table"),
    ],
)
def test_kinds_that_the_scene_lacks_are_refused(
    text: str, kinds: tuple[Kind, ...], offered: str
) -> None:
    with pytest.raises(InputError) as error:
        fit_scene(*scene_of(text), observed(text, 0.3), kinds)
    (problem,) = error.value.problems
    assert problem.fix.startswith("choose from ")
    assert offered in problem.fix


RAMPED = GLIDE.replace("duration: 1", "duration: 1, ramp: 0.1 s")
SPARE = """\
  spare:
    shape: {box: {center: [300, 60], size: [20, 20]}}
    velocity: [70, 0]
    spin: 40
boundaries:"""


@pytest.mark.slow
def test_film_in_motion_leaves_no_ramp(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, tracks = tmp_path / "glide.yaml", tmp_path / "tracks.csv"
    scene.write_text(RAMPED)
    tracks.write_text(tracks_csv(observed(GLIDE, 0.3)))
    flags = ["--tracks", str(tracks), "--free", "velocity", "--report", "none"]
    assert main(["fit", str(scene), *flags]) == 0
    after = OpenedScene(str(tmp_path / "glide-fitted.yaml")).scene()
    assert after.world.ramp == 0
    assert after.objects[0].velocity[0] == pytest.approx(400, rel=0.02)
    assert "remain between film" not in capsys.readouterr().err


def test_chaos_does_not_excuse_a_wrong_motion() -> None:
    tracks = observed(DROP, 0.8)
    scene, compiled = scene_of(DROP)
    wrong = replace(tracks, poses=tracks.poses + np.array([0, 15, 0]))
    for poses, is_good in ((tracks, True), (wrong, False)):
        starts = estimate_starts(compiled, tracks, [])
        parameters = free_parameters(scene, poses, [Kind.ELASTICITY], starts)
        model = Model(scene, compiled, poses, starts, parameters)
        # px, as after several impacts
        model.step_errors[:] = 20.0
        count = len(tracks.times)
        assert model.has_good_residuals(model.prior, count) is is_good


def test_supported_object_starts_without_fall() -> None:
    tracks = observed(SLIDE, 0.4)
    # noise of early frames looks like a slow motion
    drift = np.array([0, 3, 0]) * tracks.times[:, None, None]
    compiled = scene_of(SLIDE)[1]
    moved = replace(tracks, poses=tracks.poses + drift)
    starts = estimate_starts(compiled, moved, [Kind.VELOCITY])
    assert starts.supported_axes == ((False, True),)
    assert starts.velocities[0, 1] == 0
    assert starts.velocities[0, 0] == pytest.approx(400, rel=0.15)


@pytest.mark.slow
def test_motion_that_no_values_explain_is_told(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sparing = replace(
        search.SEARCH, horizons=(1.0,), draws=1, trial_steps=1, final_steps=1
    )
    monkeypatch.setattr(search, "SEARCH", sparing)
    scene, path = tmp_path / "glide.yaml", tmp_path / "tracks.csv"
    scene.write_text(GLIDE)
    tracks = observed(GLIDE, 0.3)
    # a puck that swerves, on a table without forces
    poses = (
        tracks.poses + np.array([0, 60, 0]) * np.sin(20 * tracks.times)[:, None, None]
    )
    path.write_text(tracks_csv(replace(tracks, poses=poses)))
    flags = ["--tracks", str(path), "--free", "velocity,table", "--report", "none"]
    assert main(["fit", str(scene), *flags]) == 0
    error = capsys.readouterr().err
    assert f"{path}: warning: " in error
    assert "px remain between film and simulation" in error
    assert "try the seed 1" in error


def test_kinds_without_effect_are_told(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sparing = replace(
        search.SEARCH, horizons=(1.0,), draws=1, trial_steps=1, final_steps=1
    )
    monkeypatch.setattr(search, "SEARCH", sparing)
    scene, path = tmp_path / "glide.yaml", tmp_path / "tracks.csv"
    scene.write_text(GLIDE)
    path.write_text(tracks_csv(observed(GLIDE, 0.3)))
    flags = ["--tracks", str(path), "--report", "none"]
    free = "velocity,mass,direction"
    assert main(["fit", str(scene), "--free", free, *flags]) == 0
    error = capsys.readouterr().err
    for kind in ("mass", "direction"):
        assert f"--free: warning: {kind} cannot be told by this scene" in error
    assert "warning: velocity" not in error
    assert main(["fit", str(scene), "--free", "velocity", *flags]) == 0
    assert "is ignored" not in capsys.readouterr().err


def test_direction_beside_gravity_is_told() -> None:
    kinds = (Kind.GRAVITY, Kind.DIRECTION)
    absent = absent_kinds(*scene_of(DROP), observed(DROP, 0.3), kinds)
    assert absent == (Kind.DIRECTION,)


@pytest.mark.parametrize(
    ("kinds", "velocity", "spin"),
    [
        ((Kind.VELOCITY,), 400, 30),
        ((Kind.SPIN,), 123, 30),
        ((Kind.FRICTION,), 123, 30),
    ],
)
def test_starts_that_tracks_do_not_tell_are_the_scenes(
    kinds: tuple[Kind, ...], velocity: float, spin: float
) -> None:
    text = SLIDE.replace("boundaries:", SPARE)
    edits = ("objects.crate.velocity=[123, 0]", "objects.crate.spin=30")
    tracks = observed(text, 0.3)
    poses = tracks.poses.copy()
    # the spare is never seen, and the crate without its angle
    poses[:, 1] = poses[:, 0, 2] = np.nan
    scene, compiled = scene_of(text, *edits)
    starts = estimate_starts(compiled, replace(tracks, poses=poses), kinds)
    crate, spare = with_values(scene, (), np.empty(0), starts).objects
    assert (spare.velocity, spare.spin) == ((70, 0), 40)
    assert crate.velocity[0] == pytest.approx(velocity, rel=0.1)
    assert crate.spin == spin


def test_tracks_survive_writing_and_reading(tmp_path: Path) -> None:
    tracks = observed(DROP, 0.3)
    poses = tracks.poses.copy()
    poses[2, 0, 2] = np.nan
    path = tmp_path / "tracks.csv"
    path.write_text(tracks_csv(replace(tracks, poses=poses)))
    result = read_tracks(path, tracks.names)
    np.testing.assert_allclose(result.poses, poses, atol=1e-3)
    np.testing.assert_allclose(result.times, tracks.times, atol=1e-5)


@pytest.mark.parametrize(
    ("lines", "text"),
    [
        (["time,object,x"], ':1:1: "y" is not a column; write the columns'),
        (["time,object,x,y", "0,bal,1,2"], ':2:1: "bal" is not an object'),
        (["time,object,x,y", "0,ball,1,two"], ':2:1: y: "two" is not a number'),
        (["time,object,x,y", "-1,ball,1,2"], ':2:1: time: "-1" is not a number'),
        (["time,object,x,y", "0,ball,1,2"], "1 times are too few"),
        (["time,object,x,y", "500,ball,1,2"], ':2:1: time: "500" is not within the'),
        (
            ["time,object,x,y", "1,ball,1,2", "1.0,ball,1,3"],
            ':3:1: "ball" is twice at 1 s; write one line',
        ),
        (["time,object,x,y", f"0,{'b' * 200_000},1,2"], "cannot be read as CSV: field"),
    ],
)
def test_wrong_tracks_are_refused(lines: list[str], text: str, tmp_path: Path) -> None:
    path = tmp_path / "tracks.csv"
    path.write_text("\n".join(lines))
    with pytest.raises(InputError) as error:
        read_tracks(path, ["ball"])
    assert text in "\n".join(map(str, error.value.problems))


@pytest.mark.slow
def test_command_writes_scene_and_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, tracks = tmp_path / "slide.yaml", tmp_path / "tracks.csv"
    scene.write_text(SLIDE.replace("friction: 0.5\n", "friction: 0.3\n", 1))
    tracks.write_text(tracks_csv(observed(SLIDE, 0.4)))
    output = tmp_path / "fitted.yaml"
    flags = ["--tracks", str(tracks), "--free", "velocity,friction", "-o", str(output)]
    assert main(["fit", str(scene), *flags]) == 0
    captured = capsys.readouterr()
    assert captured.out.strip() == str(output)
    assert "objects.crate.friction: 0.4" in captured.err
    text = output.read_text()
    assert "# a parcel" in text
    after = OpenedScene(str(output)).scene()
    assert after.objects[0].friction == pytest.approx(0.5, rel=0.1)
    sources = after.objects[0].provenance
    friction = source(sources["friction"])
    assert friction.text.startswith("fit 0.4")
    assert friction.confidence is not None
    assert friction.confidence > 0.8
    # the floor holds the other component at 0
    assert sources["velocity"].count(" px/s") == 1
    assert after.objects[0].velocity[1] == 0
    assert source(sources["velocity"]).confidence is None
    page = (tmp_path / "fitted" / "report.html").read_text()
    assert "What this clip cannot determine" in page
    assert (tmp_path / "fitted" / "tracks.csv").is_file()


@pytest.mark.parametrize(
    ("flags", "text"),
    [
        ([], "needs a clip or a table of tracks"),
        (["--tracks", "none.csv"], "none.csv: does not exist"),
        (["--tracks", "SCENE", "--free", "colour"], '--free: "colour" cannot be'),
    ],
)
def test_wrong_flags_are_refused(
    flags: list[str], text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "slide.yaml"
    scene.write_text(SLIDE)
    words = [str(scene) if flag == "SCENE" else flag for flag in flags]
    assert main(["fit", str(scene), *words]) == 2
    assert text in capsys.readouterr().err
