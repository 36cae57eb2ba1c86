"""Output appears whole or not at all, and nothing of the user's is lost."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from physgen.files import machine_id
from physgen.problems import InputError
from physgen.report import folders
from physgen.report.folders import atomic_folder, output_folder


def test_a_folder_appears_when_it_is_whole(tmp_path: Path) -> None:
    final = tmp_path / "deep" / "run"
    with atomic_folder(final) as folder:
        (folder / "a").write_text("1")
        assert not final.exists()
    assert [p.name for p in final.iterdir()] == ["a"]
    assert [p.name for p in final.parent.iterdir()] == ["run"]


def test_an_error_leaves_the_old_folder_as_it_was(tmp_path: Path) -> None:
    final = tmp_path / "run"
    final.mkdir()
    (final / "old").write_text("1")

    def interrupted() -> None:
        with atomic_folder(final) as folder:
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
    with pytest.raises(InputError, match=r"has notes\.txt, which physgen did not make"):
        output_folder(tmp_path, "pool")


DEAD = 2**22 + 12345
"""Above Linux's largest process number."""


def test_what_killed_runs_left_is_cleared_and_the_old_folder_comes_back(
    tmp_path: Path,
) -> None:
    (tmp_path / f".run.{DEAD}-{machine_id()}.part").mkdir()
    (tmp_path / f".run.{DEAD}-{machine_id()}.old").mkdir()
    (tmp_path / f".run.{DEAD}-{machine_id()}.old" / "kept").write_text("1")
    (tmp_path / "whole").mkdir()
    (tmp_path / f".whole.{DEAD}-{machine_id()}.old").mkdir()
    (tmp_path / f".index.html.{DEAD}-{machine_id()}.part").write_text("half")
    (
        tmp_path / f".run.{os.getpid()}-{machine_id()}.old"
    ).mkdir()  # of somebody who lives
    (tmp_path / ".running").mkdir()
    (tmp_path / ".mine.part").mkdir()
    (tmp_path / ".notes.2023.old").mkdir()
    (tmp_path / ".download.8831234.part").touch()

    def interrupted() -> None:
        with atomic_folder(tmp_path / "other"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert (tmp_path / "run" / "kept").read_text() == "1"
    left = [
        ".download.8831234.part",
        ".mine.part",
        ".notes.2023.old",
        f".run.{os.getpid()}-{machine_id()}.old",
        ".running",
        "run",
        "whole",
    ]
    assert sorted(p.name for p in tmp_path.iterdir()) == left


def test_what_another_machine_is_at_stays(tmp_path: Path) -> None:
    """Its processes and, on some shared disks, its locks are not seen from here."""
    (tmp_path / f".run.{DEAD}-0123abcd.part").mkdir()
    folders.remove_leftovers(tmp_path)
    assert len(list(tmp_path.iterdir())) == 1
