"""Output appears whole or not at all, and nothing of the user's is lost."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from physgen.problems import InputError
from physgen.report.folder import output_folder, whole_folder


def test_a_folder_appears_when_it_is_whole(tmp_path: Path) -> None:
    final = tmp_path / "deep" / "run"
    with whole_folder(final) as folder:
        (folder / "a").write_text("1")
        assert not final.exists()
    assert [p.name for p in final.iterdir()] == ["a"]
    assert [p.name for p in final.parent.iterdir()] == ["run"]


def test_an_error_leaves_the_old_folder_as_it_was(tmp_path: Path) -> None:
    final = tmp_path / "run"
    final.mkdir()
    (final / "old").write_text("1")

    def interrupted() -> None:
        with whole_folder(final) as folder:
            (folder / "new").write_text("2")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [p.name for p in final.iterdir()] == ["old"]
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def test_a_folder_of_somebody_elses_is_refused(tmp_path: Path) -> None:
    mine = tmp_path / "pool"
    mine.mkdir()
    (mine / "scene.yaml").write_text("x")
    with pytest.raises(InputError, match="was not made by physgen"):
        output_folder(tmp_path, "pool")
    (mine / "manifest.json").write_text('{"manifest": 1, "files": {"scene.yaml": ""}}')
    assert output_folder(tmp_path, "pool") == mine
    (mine / "notes.txt").write_text("x")
    with pytest.raises(InputError, match=r"holds notes\.txt, which physgen did not make"):
        output_folder(tmp_path, "pool")


def test_what_killed_runs_left_is_cleared_and_the_old_folder_comes_back(tmp_path: Path) -> None:
    dead = 2**22 + 12345  # above Linux's largest process number
    (tmp_path / f".run.{dead}.part").mkdir()
    (tmp_path / f".run.{dead}.old").mkdir()
    (tmp_path / f".run.{dead}.old" / "kept").write_text("1")
    (tmp_path / f".run.{os.getpid()}.old").mkdir()  # of somebody who lives
    (tmp_path / ".running").mkdir()

    def interrupted() -> None:
        with whole_folder(tmp_path / "run"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert (tmp_path / "run" / "kept").read_text() == "1"
    assert sorted(p.name for p in tmp_path.iterdir() if p.name != "run") == [
        f".run.{os.getpid()}.old",
        ".running",
    ]
