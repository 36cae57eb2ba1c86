"""Misspelt words on the command line."""

from __future__ import annotations

import pytest

from physgen.cli.main import main


@pytest.mark.parametrize(
    ("command", "meant"),
    [(["exprot"], "export"), (["evaluate", "studdy"], "study"), (["rendr"], "render")],
)
def test_a_word_that_is_misspelt(command: list[str], meant: str, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        main(command)
    assert ended.value.code == 2
    assert (
        f"invalid choice: '{command[-1]}', did you mean {meant}?"
        in capsys.readouterr().err
    )


def test_each_wrong_value_is_reported(capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        main(
            [
                "render",
                "scene.yaml",
                "--jobs",
                "none",
                "--fan",
                "-1",
                "--format",
                "avi",
                "--pusch",
                "a=right",
            ]
        )
    assert ended.value.code == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 4
    for line, word in zip(
        lines, ("--jobs", "--fan", "--format", "did you mean --push?"), strict=True
    ):
        assert word in line
        assert line.startswith("physgen render: ")


def test_each_wrong_name_is_reported(lesson, tmp_path, capsys) -> None:
    wrong = {
        "--push": "bal=left",
        "--drop": "crat",
        "--kick": "1,2,3",
        "--export": "bad",
        "--refine": "bad",
    }
    command = [
        "render",
        str(lesson),
        "-o",
        str(tmp_path / "out"),
        "--push",
        "ball=sideways",
    ]
    assert main([*command, *(text for pair in wrong.items() for text in pair)]) == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 6
    assert {line.partition(":")[0] for line in told} == set(wrong)
    assert (
        main(
            [
                "perceive",
                "photo.png",
                "--box",
                "1,2,3",
                "--point",
                "x",
                "--backend",
                "segment=bad",
                "-o",
                "a.txt",
            ]
        )
        == 2
    )
    flags = {line.partition(":")[0] for line in capsys.readouterr().err.splitlines()}
    assert {"--box", "--point", "-o"} < flags
    assert len(flags) == 4
    assert main(["perceive", "photo.png", "--refresh", "a.yaml", "--side", "300"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 2


def test_wrong_values_of_a_measure_are_reported(capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["evaluate", "study", "methods", "--seed", "x", "--foo"])
    assert ended.value.code == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert "--seed" in lines[0]
    assert "--foo" in lines[1]


@pytest.mark.parametrize(
    "order",
    [
        ["-o", "out", "--", "-lesson.yaml"],
        ["lesson.yaml", "-o", "out", "--", "-lesson.yaml"],
    ],
)
def test_double_dash_admits_names_with_dash(
    order: list[str], lesson, tmp_path, monkeypatch, capsys
) -> None:
    """The second command is one whose flags may stand between its arguments."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "-lesson.yaml").write_text(lesson.read_text())
    assert main(["check", "--", "-lesson.yaml"]) == 0
    assert main(["render", *order]) == 0
    assert (tmp_path / "out" / "-lesson" / "video.mp4").is_file()
