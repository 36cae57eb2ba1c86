"""The leaderboard: what is there, what failed, what is missing, and whose score is whose."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import av
import pytest
from contest import FPS, FRAMES, SIZE, contest, write_clip
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


def test_rows_name_methods_and_scenes(home: Path) -> None:
    result(
        home / "fid",
        "fid",
        [{"method": "ours", "frames_fid": 105.7, "frames_fid_95": [90, 120], "clips": 50}],
    )
    energy = [("ours", "pool", 0.25), ("ours", "shelf", 0.75), ("drift", "pool", 2.0), ("drift", "shelf", 4)]
    result(home / "energy", "energy", [
        *({"method": method, "scene": scene, "error": error, "passed": True} for method, scene, error in energy),
        {"scene": "pool", "error": 9},
    ])  # fmt: skip
    result(home / "study", "study", [
        {"method": "ours", "physical": {"mean": 4.14, "low": 3.9, "high": 4.4, "counts": [0, 1]}},
        {"method": "drift", "physical": {"mean": None, "low": None, "high": None}},
        {"method": "somebody", "physical": {"mean": 1.0}},
    ])  # fmt: skip
    (home / "melt" / "result.json").write_text("[broken")
    found = {score.name: score for score in scores_of(methods_in(home))}
    assert {name: score.better for name, score in found.items()} == {
        "fid: frames fid": "low", "energy: error": "low", "study: physical": "high",
    }  # fmt: skip
    assert found["fid: frames fid"].methods == {"ours": 105.7}
    assert found["energy: error"].clips == {(method, scene): error for method, scene, error in energy}
    assert [found["energy: error"].of(name) for name in ("ours", "drift", "melt")] == [0.5, 3.0, None]
    assert found["energy: error"].best(("drift", "melt", "ours")) == {"ours"}
    assert found["study: physical"].of("ours") == 4.14
    assert found["study: physical"].of("drift") is None


def test_what_browsers_do_not_play_is_made_into_what_they_do(
    home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """MPEG-4 part 2, as OpenCV writes it, and a GIF: both become H.264 beside the page, and stay as they are."""
    source, board = home / "drift" / "pool.mp4", tmp_path / "board"
    with av.open(str(home / "melt" / "pool.mp4")) as old, av.open(str(source), "w") as new:
        stream = new.add_stream("mpeg4", rate=FPS)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for picture in old.decode(video=0):
            new.mux(stream.encode(picture.reformat(format="yuv420p")))
        new.mux(stream.encode(None))
    write_clip(home / "melt" / "gif" / "video.gif", "melt")
    before = source.read_bytes()
    for _ in range(2):
        ran(capsys, str(home), "-o", str(board))
    films = sorted((board / "index.files").glob("*.film.mp4"))
    assert len(films) == 2
    for film in films:
        with av.open(str(film)) as container:
            assert container.streams.video[0].codec_context.name == "h264"
            assert sum(1 for _ in container.decode(video=0)) == FRAMES
    assert source.read_bytes() == before
    source.unlink()
    ran(capsys, str(home), "-o", str(board))
    assert len(list((board / "index.files").glob("*.film.mp4"))) == 1, "what is gone is swept"


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


def test_the_terminal_has_the_table_alone(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result(
        home / "study",
        "study",
        [{"method": "ours", "photo": {"mean": 3.86}}, {"method": "melt", "photo": {"mean": 2.0}}],
    )
    before = sorted(home.rglob("*"))
    assert main(["evaluate", "leaderboard", str(home)]) == 0
    told = capsys.readouterr().out
    assert "study: photo: ours highest, 3.860." in told
    assert [line.split() for line in told.splitlines() if line.startswith(("drift", "melt", "ours"))] == [
        ["drift", "2", "0", "0", "-"],
        ["melt", "2", "0", "0", "2.000"],
        ["ours", "2", "0", "0", "3.860"],
    ]
    assert sorted(home.rglob("*")) == before
