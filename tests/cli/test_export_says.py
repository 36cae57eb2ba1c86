"""`export` says how long clips play, once it is so, and that nothing was to be done."""

from __future__ import annotations

from pathlib import Path

import pytest

from physgen.cli.main import main

SCENE = """\
physgen: 1
size: [48, 32]
world: {duration: 0.2, gravity: [0, 0]}
objects: {ball: {shape: {circle: {center: [16, 16], radius: 6}}, velocity: [60, 0]}}
render: {fps: 20}
"""


def test_how_long_it_plays_and_that_it_is_there(tmp_path: Path, capsys) -> None:
    scene, out = tmp_path / "scene.yaml", str(tmp_path / "out")
    scene.write_text(SCENE)
    asked = ["export", str(scene), "--format", "order", "-o", out, "--frames", "6"]
    assert main(asked) == 0
    said = capsys.readouterr().err
    assert "6 frames at 20 fps play for 0.3 s; the duration of the motion is still that of the scene" in said
    assert "--set world.duration=0.3" in said
    assert "unchanged" not in said
    assert main(asked) == 0
    assert "1 clip, unchanged" in capsys.readouterr().err
    assert main([*asked, "--set", "world.duration=0.25"]) == 0
    said = capsys.readouterr().err
    assert "6 frames at 20 fps play for 0.3 s\n" in said
    assert "--set" not in said


def test_nothing_is_said_of_what_is_refused(tmp_path: Path, capsys) -> None:
    scene = str(tmp_path / "none.yaml")
    assert main(["export", scene, "--format", "order", "-o", str(tmp_path / "out"), "--frames", "6"]) == 2
    assert "play" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "meant"), [(["exprot"], "export"), (["plot", "stirp"], "strip"), (["rendr"], "render")]
)
def test_a_word_that_is_misspelt(command: list[str], meant: str, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        main(command)
    assert ended.value.code == 2
    assert f"invalid choice: '{command[-1]}', did you mean {meant}?" in capsys.readouterr().err
