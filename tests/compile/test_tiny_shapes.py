"""Shapes of every size: each is refused when it is loaded, or simulated and drawn."""

from __future__ import annotations

from math import cos, pi, sin
from pathlib import Path

import numpy as np
import pytest

from physgen import pipeline
from physgen.problems import InputError

SIZES = (1e-6, 1e-3, 0.01, 0.02, 0.05, 0.0999, 0.1, 0.3, 1.0, 1e3)
"""px."""
PLACES = ((100.0, 100.0), (-5000.0, 100.0), (9e5, -9e5))
"""px: in the picture, beside it, and where a float has few digits left."""
KINDS = ("box", "turned box", "rod", "circle", "triangle", "sliver", "star", "pieces")


def corners(points: list[tuple[float, float]], x: float, y: float) -> str:
    """Return the outline of points about (x, y) as YAML."""
    return "[" + ", ".join(f"[{x + a!r}, {y + b!r}]" for a, b in points) + "]"


def shape(kind: str, size: float, x: float, y: float) -> str:
    """Return a shape as YAML."""
    triangle = [(0.0, 0.0), (size, 0.0), (0.0, size)]
    star = [
        (radius * cos(k * pi / 10), radius * sin(k * pi / 10))
        for k in range(20)
        for radius in [size if k % 2 else 0.3 * size]
    ]
    beside = [(a + 2 * size, b) for a, b in triangle]
    one, other = corners(triangle, x, y), corners(beside, x, y)
    shapes = {
        "box": f"box: {{center: [{x}, {y}], size: [{size}, {size}]}}",
        "turned box": f"box: {{center: [{x}, {y}], size: [{size}, {size}], angle: 33}}",
        "rod": f"box: {{center: [{x}, {y}], size: [{size}, 50]}}",
        "circle": f"circle: {{center: [{x}, {y}], radius: {size}}}",
        "triangle": f"polygon: {one}",
        "sliver": f"polygon: {corners([(0, 0), (60, 0), (60, size)], x, y)}",
        "star": f"polygon: {corners(star, x, y)}",
        "pieces": f"polygons: [{{outline: {one}}}, {{outline: {other}}}]",
    }
    return f"{{{shapes[kind]}}}"


def write(folder: Path, written_shape: str) -> Path:
    """Write a scene with one object that falls."""
    path = folder / "scene.yaml"
    path.write_text(
        "physgen: 1\nsize: [200, 200]\nworld: {duration: 0.05}\n"
        f"objects: {{a: {{shape: {written_shape}, mass: 5}}}}\n"
        "boundaries: {floor: {segment: [[0, 160], [200, 160]]}}\n"
    )
    return path


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("kind", KINDS)
def test_any_size_is_refused_or_simulated(
    kind: str, place: tuple[float, float], tmp_path: Path
) -> None:
    accepted, refused = list[float](), list[int]()
    for size in SIZES:
        path = write(tmp_path, shape(kind, size, *place))
        try:
            scene = pipeline.load(path)
        except InputError as error:
            refused.append(error.problems[0].place.line)
            continue
        compiled = pipeline.compile(scene, None)
        pipeline.lint(scene, compiled)
        assert np.isfinite(pipeline.simulate(compiled.world).poses).all()
        accepted.append(size)
    assert set(refused) == {4}
    assert set(SIZES[-3:]) <= set(accepted)
    assert 1e-6 not in accepted


@pytest.mark.parametrize("kind", KINDS)
def test_least_size_is_drawn(kind: str, tmp_path: Path) -> None:
    size = 0.15 if kind in ("triangle", "star", "pieces") else 0.1
    path = write(tmp_path, shape(kind, size, 100.0, 100.0))
    # In a scene without a visible motion, the advice would simulate many pushes.
    moving = path.read_text().replace("mass:", "velocity: [400, 0], mass:")
    path.write_text(moving)
    folder = pipeline.render_scene(path, tmp_path / "out", page=pipeline.Page.NONE)
    assert (folder / "video.mp4").is_file()


@pytest.mark.parametrize(
    ("written", "suggestion"),
    [
        ("{box: {center: [9, 9], size: [0.05, 20]}}", "0.05 m"),
        ("{circle: {center: [9, 9], radius: 0.02}}", "0.02 m"),
        ("{circle: {center: [9, 9], radius: 0.1 mm}}", None),
    ],
)
def test_size_in_meters_gets_a_suggestion(
    written: str, suggestion: str | None, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        pipeline.load(write(tmp_path, written))
    (problem,) = caught.value.problems
    assert (" m" in problem.fix.split("; ")[-1]) == (suggestion is not None)
    assert suggestion is None or suggestion in problem.fix
    assert suggestion is not None or problem.found == '"0.1 mm"'


def test_frame_too_thin_is_refused(tmp_path: Path) -> None:
    outer = "[[50, 50], [90, 50], [90, 90], [50, 90]]"
    hole = "[[50.000001, 50.000001], [89.999999, 50.000001], [89.999999, 89.999999], [50.000001, 89.999999]]"
    path = write(tmp_path, f"{{polygons: [{{outline: {outer}, holes: [{hole}]}}]}}")
    scene = pipeline.load(path)
    with pytest.raises(InputError) as caught:
        pipeline.compile(scene, None)
    assert caught.value.problems[0].path == "objects.a.shape"


@pytest.mark.parametrize(
    "written_shape",
    [
        "{circle: {center: [100, 100], radius: 30 m}}",
        "{box: {center: [100, 100], size: [150 m, 40]}}",
        "{polygon: [[0, 0], [9000, 0], [0, 30]]}",
    ],
)
def test_shapes_far_larger_than_the_picture_are_refused(
    written_shape: str, tmp_path: Path
) -> None:
    path = write(tmp_path, written_shape)
    with pytest.raises(InputError) as error:
        pipeline.load(path)
    (problem,) = error.value.problems
    assert problem.place.line > 0
    assert "shape" in str(problem)


def test_large_static_ground_is_accepted(tmp_path: Path) -> None:
    path = write(tmp_path, "{box: {center: [100, 900], size: [20000, 400]}}")
    text = path.read_text()
    path.write_text(text.replace("mass:", "motion: static, mass:"))
    assert pipeline.load(path).objects
