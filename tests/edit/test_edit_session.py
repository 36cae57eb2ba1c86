"""One file and whoever else writes it: taken in or asked about, saved whole with its rights."""

from __future__ import annotations

import os
import re
import stat
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from served import Killable, Served

from physgen.cli.edit import edit as _edit  # noqa: F401 the command imports without the server
from physgen.cli.main import main
from physgen.edit.session import EditRequest, Session
from physgen.files import install

ROOT = Path(__file__).resolve().parents[2]

Serve = Callable[..., Served]


@contextmanager
def hearing(served: Served, kind: str) -> Iterator[Callable[[], dict[str, Any]]]:
    """The next event of a kind, waited for."""
    found: list[dict[str, Any]] = []
    listens, came = threading.Event(), threading.Event()

    def listen() -> None:
        news: dict[str, Any] = {"run": "", "next": 0}
        while not came.wait(0.05):
            news = served.get("/api/events", run=news["run"], since=news["next"])
            found.extend(event for event in news["events"] if event["type"] == kind)
            listens.set()
            if found:
                came.set()

    thread = threading.Thread(target=listen)
    thread.start()
    assert listens.wait(30)

    def next_one() -> dict[str, Any]:
        assert came.wait(30)
        return found[-1]

    yield next_one
    thread.join(30)


def mass(text: str, grams: int, which: int = 0) -> str:
    """Another mass of one of the things."""
    found = list(re.finditer(r"mass: [\d.]+", text))[which]
    return text[: found.start()] + f"mass: {grams}" + text[found.end() :]


@pytest.mark.parametrize("resolve", ["mine", "theirs"])
def test_what_clashes_is_asked_about_and_neither_is_lost(
    resolve, serving: Serve
) -> None:
    served = serving("billiards")
    text = served.look()["text"]
    mine = served.edit({"set": ["objects", "cue-ball", "mass"], "value": 99})["text"]
    theirs = mass(text, 55)
    with hearing(served, "file") as next_one:
        served.scene.write_text(theirs)
        assert next_one()["outcome"] == "clash"
    assert served.look()["file"]["outside"] == "changed"
    answer = served.send("/api/save")
    assert answer.status_code == 409
    assert answer.json()["conflict"]
    assert served.scene.read_text() == theirs  # nothing was written over
    assert served.send("/api/save", resolve=resolve).status_code == 200
    kept = {"mine": mine, "theirs": theirs}[resolve]
    assert served.state["text"] == served.scene.read_text() == kept
    assert served.state["file"] == served.state["file"] | {
        "saved": True,
        "outside": None,
    }
    served.send("/api/undo")
    assert served.state["text"] == {"mine": theirs, "theirs": mine}[resolve]


def test_what_is_no_text_is_not_taken_for_the_scene(serving: Serve) -> None:
    served = serving("physics/05-slide")
    text = served.look()["text"]
    with hearing(served, "file") as next_one:
        served.scene.write_bytes(b"\xff\xfe\0")
        assert next_one()["outcome"] == "clash"
    assert served.look()["text"] == text
    assert served.send("/api/save").status_code == 409
    assert served.scene.read_bytes() == b"\xff\xfe\0"
    assert served.send("/api/save", resolve="mine").status_code == 200
    assert served.scene.read_text() == text


@pytest.mark.parametrize("mode", [0o600, 0o644, 0o664])
def test_a_save_keeps_the_rights_of_the_file_and_the_link_to_it(
    mode, serving: Serve, copied
) -> None:
    path = copied("physics/05-slide")
    path.chmod(mode)
    link = path.with_name("link.yaml")
    link.symlink_to("scene.yaml")
    served = serving(link)
    text = served.look()["text"]
    served.send("/api/text", "PUT", text=text + "# more\n")
    served.send("/api/save")
    assert link.is_symlink()
    assert path.read_text() == text + "# more\n"
    assert stat.S_IMODE(path.stat().st_mode) == mode
    assert sorted(os.listdir(path.parent)) == [
        ".scene.yaml.editing",
        "link.yaml",
        "scene.yaml",
    ]


def test_a_save_that_fails_leaves_the_old_file(serving: Serve, monkeypatch) -> None:
    served = serving("physics/05-slide")
    text = served.look()["text"]
    served.send("/api/text", "PUT", text=text + "# more\n")
    replace = Path.replace

    def full(self: Path, target: Path) -> Path:
        if target.name == "scene.yaml":
            raise OSError(28, "No space left on device", str(target))
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", full)
    answer = served.send("/api/save")
    assert answer.status_code == 507
    assert "no space left" in answer.json()["error"]["message"]
    assert served.scene.read_text() == text
    assert sorted(os.listdir(served.scene.parent)) == [
        ".scene.yaml.editing",
        "scene.yaml",
    ]
    monkeypatch.undo()
    assert served.send("/api/save").status_code == 200
    assert served.scene.read_text() == text + "# more\n"


@pytest.fixture
def disc(tmp_path: Path) -> Path:
    """A small photo of a disc, with its mask: corrections of it take no time."""
    folder = tmp_path / "disc"
    assets = folder / "photo.assets"
    assets.mkdir(parents=True)
    photo = (
        np.random.default_rng(1)
        .normal(200, 2, (72, 96, 3))
        .clip(0, 255)
        .astype(np.uint8)
    )
    masks = np.zeros((72, 96), np.uint16)
    cv2.circle(photo, (40, 30), 14, (40, 60, 160), -1)
    cv2.circle(masks, (40, 30), 14, 1, -1)  # type: ignore[call-overload]
    cv2.imwrite(str(folder / "photo.png"), photo)
    cv2.imwrite(str(assets / "masks.png"), masks)
    scene = folder / "scene.yaml"
    scene.write_text(
        "physgen: 1\nimage: photo.png\nassets: photo.assets\n"
        "objects:\n  disc: {mask: 1, shape: {circle: {center: [40, 30], radius: 14}}, mass: 20}\n"
        "boundaries:\n  floor: {segment: [[0, 60], [96, 60]]}\n"
    )
    return scene


def maps_of(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def test_maps_of_a_correction_are_a_folder_of_their_own_and_the_text_chooses(
    disc: Path,
) -> None:
    home, text = disc.parent, disc.read_text()
    before = maps_of(home / "photo.assets")
    session = Session(disc)

    def request() -> EditRequest:
        return EditRequest(version=session.history.version)

    for higher in (0, 6):
        op = {
            "kind": "eraser",
            "object": "disc",
            "strokes": [[37, 30 - higher], [43, 30 - higher]],
            "radius": 4,
        }
        session.correct(request(), op)
    assert "assets: scene-2.assets\n" in session.current_state.text
    session.save(request())
    assert disc.read_text() == session.current_state.text
    assert maps_of(home / "scene-2.assets")["masks.png"] != before["masks.png"]
    session.step(request(), -1)
    assert session.close() is not None
    assert (home / "scene.assets").is_dir()  # of the draft
    session = Session(disc)
    assert "assets: scene.assets\n" in session.current_state.text
    session.write(request(), text)
    session.save(request())
    assert session.close() is None
    assert maps_of(home / "photo.assets") == before
    assert sorted(path.name for path in home.glob("*.assets")) == ["photo.assets"]


# The command


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere.yaml"], "nowhere.yaml: no such file"),
        (["."], "is a folder; name a scene file in it"),
        (
            ["scene.yaml", "--port", "99999"],
            "99999 is not a whole number; write one from 0 to 65535",
        ),
        (
            ["scene.yaml", "--port", "x"],
            "x is not a whole number; write one from 0 to 65535",
        ),
        (
            ["scene.yaml", "--host", "no.such.host.example"],
            "--host no.such.host.example: cannot be listened on",
        ),
        (["scene.physgen"], "is a zip, not a scene file; unzip it"),
        (
            ["scene.yaml", "-o", "junk.txt"],
            "junk.txt: is a file",
        ),
        (["broken.png"], "broken.png"),
        (["junk.txt"], "junk.txt"),
        (["text.png"], "text.png"),
        (["page.md"], "page.md"),
        (["photo.yaml"], "is a picture, not a scene file"),
    ],
)
def test_what_is_wrong_is_told_in_a_line(
    arguments, said, tmp_path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.yaml").write_text("physgen: 1\nsize: [64, 48]\nobjects: {}\n")
    Path("scene.physgen").write_bytes(b"PK\x03\x04\x14\0\xff\xfe")
    Path("broken.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    Path("junk.txt").write_text("buy milk\nat 10:30\n")
    Path("text.png").write_text("not a picture")
    Path("page.md").write_text(
        "# A scene\n\nSave this:\n\n```yaml\nphysgen: 1\nobjects: {}\n```\n"
    )
    Path("photo.yaml").write_bytes(b"\x89PNG\r\n\x1a\n\xff")
    try:
        code = main(["edit", *arguments, "--no-browser"])
    except SystemExit as stop:
        code = int(str(stop.code))
    err = capsys.readouterr().err
    assert code == 2
    assert said in err
    assert "Traceback" not in err
    assert not list(Path().glob(".*.editing"))


def test_a_port_that_is_taken_is_told_of(serving: Serve, tmp_path, capsys) -> None:
    served = serving("physics/05-slide")
    other = tmp_path / "other.yaml"
    other.write_text("physgen: 1\nsize: [64, 48]\nobjects: {}\n")
    assert served.editor is not None
    assert (
        main(["edit", str(other), "--no-browser", "--port", str(served.editor.port)])
        == 2
    )
    assert "cannot be listened on: address already in use" in capsys.readouterr().err


def test_without_the_extra_one_line_says_how_to_get_it(
    tmp_path, monkeypatch, capsys
) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text("physgen: 1\nsize: [64, 48]\nobjects: {}\n")
    monkeypatch.setattr("physgen.cli.edit.find_spec", lambda name: None)
    assert main(["edit", str(scene), "--no-browser"]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert install("edit") in err


def test_the_same_scene_again_shows_the_editor_that_has_it(
    serving: Serve, capsys
) -> None:
    served = serving("physics/05-slide")
    assert main(["edit", str(served.scene), "--no-browser"]) == 0
    said = capsys.readouterr()
    assert said.out.strip() == served.address
    assert "is open in an editor already" in said.err


@pytest.mark.slow
def test_a_photo_is_perceived_first_and_its_scene_opened_the_next_time(
    killable, disc: Path
) -> None:
    photo = disc.with_name("photo.png")
    marbles = cv2.imread(str(ROOT / "scenes/marbles/photo.png"))
    cv2.imwrite(
        str(photo),
        cv2.resize(marbles, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA),
    )
    first: Killable = killable(photo)
    scene = photo.with_name("photo.yaml")
    state = first.look()
    assert state["file"]["name"] == "photo.yaml"
    assert state["scene"]["objects"]
    text = scene.read_text()
    first.client.close()
    first.process.terminate()
    assert first.process.wait(60) == 0
    again: Killable = killable(photo)
    assert again.look()["text"] == scene.read_text() == text
