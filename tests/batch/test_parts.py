"""A batch in parts, as several machines make them at the same time."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path

import pytest

from physgen.cli.main import main


def made(out: Path) -> dict[str, bytes]:
    """Videos and trajectories by name."""
    return {
        str(path.relative_to(out)): path.read_bytes()
        for path in out.rglob("*")
        if path.suffix in (".mp4", ".npz")
    }


@pytest.mark.slow
def test_parts_made_at_the_same_time_are_the_sweep_of_one_machine(
    lesson: Path, tmp_path: Path, capsys
) -> None:
    sweep = ["sweep", str(lesson), "objects.ball.mass=10:500:5", "--report", "none"]
    assert main([*sweep, "-o", str(tmp_path / "alone")]) == 0
    out = str(tmp_path / "shared")
    parts = [
        subprocess.Popen(
            [sys.executable, "-m", "physgen", *sweep, "-o", out, "--part", f"{k}/3"],
            stdout=subprocess.PIPE,
        )
        for k in (1, 2, 3)
    ]
    counts = [len(part.communicate()[0].splitlines()) for part in parts]
    assert [part.returncode for part in parts] == [0, 0, 0]
    assert counts == [2, 2, 1]
    assert not (Path(out) / "sweep.csv").exists()
    capsys.readouterr()
    assert main([*sweep, "-o", out, "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["unchanged"] == 5
    assert made(Path(out)) == made(tmp_path / "alone")
    tables = [
        list(csv.reader((tmp_path / name / "sweep.csv").open()))
        for name in ("alone", "shared")
    ]
    assert tables[0] == tables[1]


def test_parts_of_variants_divide_them(lesson: Path, tmp_path: Path, capsys) -> None:
    found = []
    for k in (1, 2):
        flags = [
            "--variant",
            "all",
            "--report",
            "none",
            "-o",
            str(tmp_path / "out"),
            "--part",
            f"{k}/2",
        ]
        assert main(["render", str(lesson), *flags]) == 0
        found.append(len(capsys.readouterr().out.splitlines()))
    assert found == [2, 2]
    assert len(list((tmp_path / "out").glob("*/manifest.json"))) == 4
    assert not (tmp_path / "out/index.html").exists()


@pytest.mark.parametrize("part", ["0/2", "3/2", "1", "a/b"])
def test_what_is_no_part_is_refused(part: str, lesson: Path, capsys) -> None:
    with pytest.raises(SystemExit) as error:
        main(["render", str(lesson), "--part", part])
    assert error.value.code == 2
    assert f"{part} is not a part; write e.g. 2/8" in capsys.readouterr().err


def test_a_part_without_clips_is_said_and_leaves_nothing(
    lesson: Path, tmp_path: Path, capsys
) -> None:
    assert (
        main(["render", str(lesson), "-o", str(tmp_path / "out"), "--part", "2/2"]) == 0
    )
    assert "this part has no clip" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_dry_run_lists_its_part(lesson: Path, capsys) -> None:
    assert (
        main(
            [
                "sweep",
                str(lesson),
                "objects.ball.mass=10:500:5",
                "--part",
                "2/3",
                "--dry-run",
            ]
        )
        == 0
    )
    numbers = [
        row["number"] for row in csv.DictReader(capsys.readouterr().out.splitlines())
    ]
    assert numbers == ["1", "4"]


def test_a_folder_in_the_place_of_the_table_is_refused_before_rendering(
    lesson: Path, tmp_path: Path, capsys
) -> None:
    (tmp_path / "sweep.csv").mkdir()
    assert (
        main(["sweep", str(lesson), "objects.ball.mass=10:500:5", "-o", str(tmp_path)])
        == 2
    )
    assert "has a folder sweep.csv" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir() if path.name != lesson.name] == [
        "sweep.csv"
    ]
