"""The leaderboard: what is there, what failed, what is missing, and whose score is whose."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import av
import pytest
from contest import FPS, SIZE, contest, write_clip
from exhibits import failure

from physgen.cli.main import main
from physgen.evaluate.leaderboard import scores_of
from physgen.evaluate.methods import methods_in


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return contest(tmp_path_factory.mktemp("board") / "methods", photos=False)


@pytest.fixture
def home(made: Path, tmp_path: Path) -> Path:
    shutil.copytree(made, tmp_path / "methods")
    return tmp_path / "methods"


def result(folder: Path, measure: str, rows: list[dict[str, Any]], **more: Any) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "result.json"
    path.write_text(json.dumps({"measure": measure, "rows": rows, **more}))
    return path


def ran(capsys: pytest.CaptureFixture[str], *more: str) -> dict[str, Any]:
    assert main(["evaluate", "leaderboard", *more, "--json"]) == 0
    return dict(json.loads(capsys.readouterr().out))


def test_every_scene_of_every_method_is_there_failed_or_missing(
    home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (home / "melt" / "shelf.mp4").unlink()
    (home / "drift" / "shelf.mp4").write_bytes(b"no film")
    write_clip(home / "drift" / "still.mp4", "drift", frames=1)
    failure(home / "ours", "still", 'still.yaml:3:1: "<b>heavy</b>" is not a number')
    board = home.parent / "board"
    rows = {row["method"]: row for row in ran(capsys, str(home), "-o", str(board))["rows"]}
    assert {name: (row["clips"], row["failed"], row["missing"]) for name, row in rows.items()} == {
        "drift": (1, ["shelf", "still"], []),
        "melt": (1, [], ["shelf", "still"]),
        "ours": (2, ["still"], []),
    }
    page = (board / "index.html").read_text()
    assert page.count("No clip of this scene") == 2
    assert page.count(">Failed<") == 3
    assert "shelf.mp4 is not a video that can be read" in page
    assert "&lt;b&gt;heavy&lt;/b&gt;" in page
    assert "<b>heavy</b>" not in page
    assert str(home) not in page.replace(f"leaderboard {home} -o", "")
    assert json.loads((board / "result.json").read_text())["rows"] == list(rows.values())


def test_rows_name_methods(home: Path) -> None:
    result(home / "fid", "fid", [
        {"method": "ours", "image_fid": 105.7, "image_fid_95": [90, 120], "clips": 50},
        {"method": "drift", "image_fid": 111.0},
    ])  # fmt: skip
    result(home / "other", "energy", [{"method": "ours", "error": 0.25}])
    result(home / "study", "study", [
        {"method": "ours", "physical": {"mean": 4.14, "low": 3.9, "high": 4.4, "counts": [0, 1]}},
        {"method": "drift", "physical": {"mean": None, "low": None, "high": None}},
        {"method": "somebody", "physical": {"mean": 1.0}},
    ])  # fmt: skip
    (home / "melt" / "result.json").write_text("[broken")
    found = {score.name: score for score in scores_of(methods_in(home))}
    assert {name: score.better for name, score in found.items()} == {
        "fid: image fid": "low",
        "study: physical": "high",
    }
    assert found["fid: image fid"].methods == {"ours": 105.7, "drift": 111.0}
    assert found["fid: image fid"].best(("drift", "melt", "ours")) == {"ours"}
    assert found["study: physical"].methods == {"ours": 4.14}


def test_what_browsers_do_not_play_is_said(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """MPEG-4 part 2, as OpenCV writes it."""
    source = home / "drift" / "pool.mp4"
    with av.open(str(home / "melt" / "pool.mp4")) as old, av.open(str(source), "w") as new:
        stream = new.add_stream("mpeg4", rate=FPS)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for picture in old.decode(video=0):
            new.mux(stream.encode(picture.reformat(format="yuv420p")))
        new.mux(stream.encode(None))
    rows = {row["method"]: row for row in ran(capsys, str(home))["rows"]}
    assert rows["drift"]["failed"] == ["pool"]
    assert main(["evaluate", "leaderboard", str(home)]) == 0
    assert "pool.mp4 is not played by all browsers" in capsys.readouterr().out


def test_a_page_of_somebody_else_is_kept_and_a_file_is_no_folder(
    home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "index.html").write_text("mine")
    ran(capsys, str(home), "-o", str(tmp_path))
    assert (tmp_path / "index.html~").read_text() == "mine"
    assert main(["evaluate", "leaderboard", str(home), "-o", str(tmp_path / "index.html")]) == 2
    assert main(["evaluate", "leaderboard", str(tmp_path / "none")]) == 2
    said = capsys.readouterr().err
    assert "is a file" in said
    assert "is no folder" in said
