"""Problems that an overlay causes elsewhere: at the overlay's key, under its name."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from physgen.cli.main import main
from physgen.problems import InputError, Place
from physgen.scene.load import OpenedScene, load

SCENE = """\
physgen: 1
size: [120, 100]
world: {duration: 0.2}
objects:
  ball:
    shape: {circle: {center: [50, 50], radius: 9}}
  crate:
    shape: {box: {center: [90, 50], size: [9, 9]}}
forces:
  - {object: ball, impulse: [1.0e4, 0]}
joints:
  pin: {objects: [ball], pivot: [50, 50]}
fields:
  breeze: {wind: [10, 0], drag: 0.001, objects: [ball]}
render:
  frames: 2
  camera: {follow: ball, zoom: 1.1}
"""
VARIANTS = """\
variants:
  no-ball:
    objects.crate.mass: 7
    objects.ball: null
  heavy: {objects.ball.mass: 200}
"""
USERS = {
    "forces[0].object": (10, 14),
    "joints.pin.objects[0]": (12, 19),
    "fields.breeze.objects[0]": (14, 50),
    "render.camera.follow": (17, 20),
}
"""Path of each value that names the ball -> its line and column."""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the scene and its variants, and a file that extends it."""
    monkeypatch.chdir(tmp_path)
    Path("scene.yaml").write_text(SCENE + VARIANTS)
    Path("child.yaml").write_text("extends: scene.yaml\nobjects:\n  ball: null\n")
    return tmp_path


def test_removing_variant_is_named_at_its_key() -> None:
    problems = OpenedScene("scene.yaml").variant_problems
    assert {p.variant for p in problems} == {"no-ball"}
    assert {p.place for p in problems} == {Place("scene.yaml", 21, 5)}
    assert {p.path: p.origin for p in problems} == {
        path: Place("scene.yaml", *place) for path, place in USERS.items()
    }
    assert str(problems[0]).startswith("scene.yaml:21:5: variant no-ball: ")


def test_failing_variant_is_refused_alone() -> None:
    opened = OpenedScene("scene.yaml")
    assert len(opened.scene().objects) == 2
    assert opened.scene(variant="heavy").objects[0].mass == 200
    with pytest.raises(InputError) as caught:
        opened.scene(variant="no-ball")
    assert {p.variant for p in caught.value.problems} == {"no-ball"}


def test_removing_override_is_named() -> None:
    with pytest.raises(InputError) as caught:
        load("scene.yaml", ["objects.ball="])
    problems = caught.value.problems
    assert {p.place.file for p in problems} == {"--set objects.ball="}
    origins = {p.path: (p.origin.line, p.origin.column) for p in problems if p.origin}
    assert origins == USERS


def test_removing_child_file_is_named() -> None:
    with pytest.raises(InputError) as caught:
        load("child.yaml")
    problems = caught.value.problems
    assert {p.place for p in problems} == {Place("child.yaml", 3, 3)}
    assert {p.path: p.origin for p in problems} == {
        path: Place("scene.yaml", *place) for path, place in USERS.items()
    }


def test_fault_of_file_is_not_blamed_on_variant() -> None:
    Path("scene.yaml").write_text(SCENE.replace("[ball], p", "[bal], p") + VARIANTS)
    with pytest.raises(InputError) as caught:
        load("scene.yaml", variant="heavy")
    (problem,) = caught.value.problems
    assert (problem.variant, problem.place) == ("", Place("scene.yaml", 12, 19))


def test_wrong_values_of_variants_are_named() -> None:
    text = SCENE + "variants:\n  odd: {objects.ball.mass: heavy, objects.bll.spin: 3}\n"
    Path("scene.yaml").write_text(text)
    problems = OpenedScene("scene.yaml").variant_problems
    assert [(p.variant, p.place.line) for p in problems] == [("odd", 19)]


@pytest.mark.parametrize(
    ("flags", "code", "clips"),
    [
        ([], 0, {"c"}),
        (["--variant", "all"], 2, {"c", "c-heavy"}),
        (["--variant", "heavy"], 0, {"c-heavy"}),
        (["--variant", "no-ball"], 2, set()),
    ],
)
def test_other_variants_still_render(
    flags: list[str],
    code: int,
    clips: set[str],
    folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (folder / "c.yaml").write_text(SCENE + VARIANTS)
    assert main(["render", "c.yaml", "-o", "out", "--report", "none", *flags]) == code
    assert {path.parent.name for path in folder.glob("out/*/video.mp4")} == clips
    printed = capsys.readouterr().err
    is_named = "c.yaml:21:5: variant no-ball: " in printed
    assert is_named == (flags != ["--variant", "heavy"])


def test_check_lists_failing_variants(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "scene.yaml", "--json"]) == 2
    problems = json.loads(capsys.readouterr().out)["problems"]
    assert [(p["variant"], p["line"]) for p in problems] == [("no-ball", 21)] * 4
    assert "scene.yaml:10:14" in {p["origin"] for p in problems}


def test_compile_fault_of_variant_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    text = SCENE + "variants:\n  light: {objects.ball.density: 1.0e-300}\n"
    Path("scene.yaml").write_text(text)
    assert main(["check", "scene.yaml", "--variant", "light", "--json"]) == 2
    (problem,) = json.loads(capsys.readouterr().out)["problems"]
    assert (problem["variant"], problem["line"]) == ("light", 19)
