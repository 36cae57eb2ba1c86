"""Intervals as confidences, flat directions in words, and where they are written."""

from __future__ import annotations

from math import exp, log
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from physgen.cli.main import main
from physgen.fit.intervals import Estimate, Fit, name_flat_directions
from physgen.fit.page import FitPage, object_rows, root_mean_square
from physgen.fit.parameters import Kind, Parameter, Scale, odds
from physgen.fit.tracks import Tracks
from physgen.fit.writing import fitted_text, interval_confidence
from physgen.pipeline import stages
from physgen.scene.load import OpenedScene
from physgen.simulate.uncertain_values import spread


def parameter(path: str, kind: Kind, scale: Scale) -> Parameter:
    return Parameter(path, kind, 0, 0, scale, 0.0, 1.0)


@pytest.mark.parametrize(
    ("kind", "scale", "value"),
    [(Kind.FRICTION, Scale.LOGARITHM, 0.4), (Kind.ELASTICITY, Scale.ODDS, 0.7)],
)
def test_draws_by_the_confidence_fill_the_interval(
    kind: Kind, scale: Scale, value: float
) -> None:
    one = parameter(f"objects.a.{kind.value}", kind, scale)
    transform = log if scale is Scale.LOGARITHM else odds
    low, high = (one.value(transform(value) + side * 0.2) for side in (-1, 1))
    sure = interval_confidence(Estimate(one, value, low, high, True))
    assert sure is not None
    distribution = spread(kind.value, value, sure)
    assert distribution is not None
    assert distribution.quantile(-1.645) == pytest.approx(low, rel=0.01)
    assert distribution.quantile(1.645) == pytest.approx(high, rel=0.01)


def test_velocities_have_no_confidence() -> None:
    one = parameter("objects.a.velocity.0", Kind.VELOCITY, Scale.LINEAR)
    assert interval_confidence(Estimate(one, 5.0, 4.0, 6.0, True)) is None


def test_flat_directions_name_single_values_and_combinations() -> None:
    names = ["a.friction", "b.friction", "a.mass", "a.rolling"]
    parameters = [parameter(name, Kind.FRICTION, Scale.LOGARITHM) for name in names]
    slopes = np.array([[30.0, 30.0, 0, 0], [0, 0, 50.0, 0]])
    covariance = np.linalg.inv(slopes.T @ slopes + np.eye(4))
    sentences = name_flat_directions(parameters, covariance, np.ones(4))
    assert set(sentences) == {
        "a.rolling",
        "a.friction against b.friction: only their combination",
    } or set(sentences) == {
        "a.rolling",
        "b.friction against a.friction: only their combination",
    }


def test_static_friction_of_a_base_follows_the_fitted_friction(tmp_path: Path) -> None:
    shape = "shape: {circle: {center: [20, 20], radius: 5}}"
    base, path = tmp_path / "base.yaml", tmp_path / "scene.yaml"
    base.write_text(
        "physgen: 1\nsize: [40, 40]\nobjects:\n"
        f"  a: {{{shape}, friction: 0.2, static_friction: 0.3}}\n"
    )
    path.write_text("extends: base.yaml\n")
    scene = OpenedScene(path).scene()
    one = parameter("objects.a.friction", Kind.FRICTION, Scale.LOGARITHM)
    estimate = Estimate(one, 0.5, 0.4, 0.6, True)
    empty = np.zeros((1, 1, 3))
    fit = Fit(scene, (estimate,), (), empty, empty, 0.5, 1)
    text = fitted_text(path.read_text(), path, path, scene, fit, "clip.mp4")
    (item,) = OpenedScene(path, text=text).scene().objects
    assert (item.friction, item.static_friction) == (0.5, 0.5)


def test_report_measures_errors_of_angles_too() -> None:
    text = (
        "physgen: 1\nsize: [40, 40]\n"
        "objects: {a: {shape: {circle: {center: [20, 20], radius: 5}}}}\n"
    )
    scene = OpenedScene("scene.yaml", text=text).scene()
    poses = np.full((4, 1, 3), 20.0)
    residuals = np.zeros((4, 1, 3))
    # px at the radius of gyration
    residuals[:, 0, 2] = 3.0
    fit = Fit(scene, (), (), poses, residuals, 0.5, 1)
    tracks = Tracks(np.arange(4) / 10, ("a",), poses)
    world = stages.compile(scene, None).world
    (row,) = object_rows(FitPage("a.yaml", "clip.mp4", scene, world, tracks, fit))
    assert float(row["rms"]) == pytest.approx(3**0.5, rel=0.01)
    assert root_mean_square(residuals) == pytest.approx(3**0.5)


def write_files(folder: Path) -> tuple[Path, Path]:
    """Write a scene with a photo, and tracks of its object."""
    Image.new("RGB", (40, 40)).save(folder / "photo.png")
    scene, tracks = folder / "scene.yaml", folder / "tracks.csv"
    scene.write_text(
        "physgen: 1\nimage: photo.png\nobjects:\n"
        "  a: {shape: {circle: {center: [20, 20], radius: 5}}}\n"
    )
    lines = [f"{k / 10},a,20,20" for k in range(6)]
    tracks.write_text("\n".join(["time,object,x,y", *lines]))
    return scene, tracks


@pytest.mark.parametrize(
    ("output", "text"),
    [
        ("fitted", "is not a name for the fitted scene; end it in .yaml"),
        ("fitted.mp4", "is not a name for the fitted scene; end it in .yaml"),
        ("folder.yaml", "is not a name for the fitted scene; end it in .yaml"),
        ("taken.yaml", 'taken" is a file where a folder is needed'),
        ("taken/fitted.yaml", 'taken" is a file where a folder is needed'),
        ("out/fitted.yaml", "leaves the files of the scene (photo.png) outside"),
    ],
)
def test_unusable_outputs_are_refused_before_the_fit(
    output: str, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, tracks = write_files(tmp_path)
    (tmp_path / "folder.yaml").mkdir()
    (tmp_path / "taken").write_text("")
    before = sorted(tmp_path.rglob("*"))
    flags = ["--tracks", str(tracks), "-o", str(tmp_path / output)]
    assert main(["fit", str(scene), *flags]) == 2
    assert text in capsys.readouterr().err
    assert sorted(tmp_path.rglob("*")) == before


def test_slow_is_refused_with_tracks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, tracks = write_files(tmp_path)
    assert main(["fit", str(scene), "--tracks", str(tracks), "--slow", "4"]) == 2
    assert "--slow: 4 has no effect on tracks" in capsys.readouterr().err


@pytest.mark.parametrize("value", [0.02, 0.5, 0.97])
def test_odds_and_values_are_inverse(value: float) -> None:
    one = parameter("objects.a.elasticity", Kind.ELASTICITY, Scale.ODDS)
    assert one.value(odds(value)) == pytest.approx(value)
    assert one.value(0.0) == pytest.approx(1 / (1 + exp(0)))
