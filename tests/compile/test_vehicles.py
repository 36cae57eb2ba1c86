"""Wheels of a scene file: what is wrong with them is answered at its place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physgen.cli.main import main
from physgen.compile.compile import compile_scene
from physgen.scene.load import load
from physgen.scene.scene import Facing

HEAD = """\
physgen: 1
size: [400, 200]
world: {pixels_per_meter: 1000}
objects:
  car:
    shape: {polygon: [[60, 60], [200, 60], [200, 160], [60, 160]]}
"""
FLOOR = "boundaries:\n  floor: {segment: [[-100, 180], [900, 180]]}\n"
MISTAKES = {
    "far away": ("[{center: [390, 20], radius: 10}]", "7:14", "184 px"),
    "twice": (
        "[{center: [90, 160], radius: 20}, {center: [90, 160], radius: 18}]",
        "7:47",
        "90, 160",
    ),
    "without a radius": ("[{center: [90, 160]}]", "7:14", "radius"),
    "none": ("[]", "7:13", "1"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_wrong_wheel_is_answered(name: str, tmp_path: Path, capsys):
    wheels, place, words = MISTAKES[name]
    file = tmp_path / "scene.yaml"
    file.write_text(f"{HEAD}    wheels: {wheels}\n{FLOOR}")
    assert main(["check", str(file)]) == 2
    told = capsys.readouterr().err
    assert f"scene.yaml:{place}: " in told
    assert "objects.car.wheels" in told
    assert words in told
    assert "Traceback" not in told


def test_wheels_of_a_circle_are_answered(tmp_path: Path, capsys):
    file = tmp_path / "scene.yaml"
    head = HEAD.replace(
        "{polygon: [[60, 60], [200, 60], [200, 160], [60, 160]]}",
        "{circle: {center: [90, 100], radius: 50}}",
    )
    file.write_text(f"{head}    wheels: [{{center: [90, 140], radius: 20}}]\n{FLOOR}")
    assert main(["check", str(file)]) == 2
    assert "scene.yaml:7:13: objects.car.wheels" in capsys.readouterr().err


def test_an_unknown_side_is_answered(tmp_path: Path, capsys):
    file = tmp_path / "scene.yaml"
    file.write_text(f"{HEAD}    facing: up\n{FLOOR}")
    assert main(["check", str(file)]) == 2
    assert "scene.yaml:7:13: objects.car.facing" in capsys.readouterr().err


def test_wheels_without_effect_are_answered(tmp_path: Path, capsys):
    """Seen from above, and on an object that is held."""
    file = tmp_path / "scene.yaml"
    wheels = "    wheels: [{center: [90, 160], radius: 20}]\n"
    top = HEAD.replace("world: {", "world: {view: top, ")
    for text in (top + wheels, f"{HEAD}{wheels}    motion: static\n"):
        file.write_text(text + FLOOR)
        assert main(["check", str(file)]) == 0
        assert "objects.car.wheels: warning" in capsys.readouterr().err


def test_wheels_move_with_an_object_that_is_put_elsewhere(tmp_path: Path):
    file = tmp_path / "scene.yaml"
    wheels = "    facing: left\n    wheels: [{center: [90, 160], radius: 20}]\n"
    file.write_text(f"{HEAD}{wheels}    place: [300, 100, 90]\n{FLOOR}")
    scene = load(file)
    body = compile_scene(scene, None).world.bodies[0]
    assert scene.objects[0].facing is Facing.LEFT
    # 40 px left of and 50 px below the centre, turned by a quarter from +x to +y
    assert body.wheels[0].axle == pytest.approx([-50, -40])
    assert np.allclose(body.center, [300, 100])
