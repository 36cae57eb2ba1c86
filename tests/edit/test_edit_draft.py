"""A draft that outlives its server: killed in the middle of edits, its last line cut short, its disk full."""

from __future__ import annotations

import json
import os
import shutil
import threading
import time
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from served import Killable, Served

from physgen.edit.document import Document
from physgen.edit.draft import BusyError, Draft, draft_folder, running_at
from physgen.edit.errors import EditError
from physgen.edit.history import History, State, difference, patched
from physgen.problems import InputError

TEXT = "physgen: 1\nsize: [64, 48]\nobjects: {}\n"


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.yaml"
    path.write_text(TEXT)
    return path


@given(st.text(), st.text())
def test_a_difference_makes_the_new_text_of_the_old(old, new) -> None:
    told = json.loads(json.dumps(difference(old, new)))
    assert patched(old, told) == new


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("push"), st.text(max_size=8), st.sampled_from([None, "a", "b"])),
        st.tuples(st.just("step"), st.sampled_from([-1, 1]), st.none()),
        st.tuples(st.just("save"), st.none(), st.none()),
    ),
    max_size=12,
)


@settings(max_examples=50)
@given(steps=STEPS)
def test_what_was_stored_is_there_again_with_its_history(tmp_path_factory, steps) -> None:
    path = tmp_path_factory.mktemp("draft") / "scene.yaml"
    path.write_text(TEXT)
    document = Document(path)
    document.push(State(TEXT + "# first\n", 0, "first"))
    for kind, value, tag in steps:
        if kind == "push":
            document.push(State(value, with_maps(document) if tag else 0, f"write {value}", tag))
        elif kind == "step" and document.history.can(value):
            document.step(value, None)
        elif kind == "save" and document.now.maps == document.saved.maps:
            document.save(None)
    lost(document)
    path.write_text(document.saved.text)
    again = Document(path)
    assert told(again) == told(document)
    assert again.maps(again.now) is None or again.maps(again.now).is_dir()  # type: ignore[union-attr]
    again.push(State("later", 0, "go on"))
    lost(again)
    third = Document(path)
    assert third.now.text == "later"
    third.close()


def told(document: Document) -> tuple[str, int, str | None, str | None]:
    history = document.history
    return history.now.text, history.version, history.undo, history.redo


def test_the_history_forgets_the_eldest_first() -> None:
    history = History(State("0"))
    for number in range(1, 1500):
        history.push(State(str(number), 0, str(number)))
    steps = 0
    while history.can(-1):
        history.step(-1)
        steps += 1
    assert steps == 1000
    assert history.now.text == "499"


def test_a_second_editor_of_a_scene_is_refused_and_told_where_the_first_is(scene) -> None:
    first = Draft(scene)
    first.listens(1234, "secret", "http://127.0.0.1:1234/?token=secret")
    with pytest.raises(BusyError):
        Draft(scene)
    assert running_at(scene) == "http://127.0.0.1:1234/?token=secret"
    link = scene.with_name("link.yaml")
    link.symlink_to(scene)
    assert running_at(link) == running_at(scene)
    first.close(keep=False)
    assert running_at(scene) is None
    assert not draft_folder(scene).exists()


def test_a_folder_that_may_not_be_written_is_told_of(scene, monkeypatch) -> None:
    def refused(*arguments: object, **named: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", refused)
    with pytest.raises(InputError, match="cannot have a draft beside it: permission denied"):
        Document(scene)


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_full_disk_leaves_the_state_as_it_was(call, scene, monkeypatch) -> None:
    document = Document(scene)
    document.push(State(TEXT + "# one\n", 0, "one"))
    data = document.draft.file.read_bytes()

    def full(*arguments: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os if call == "fsync" else Path, call, full)
    with pytest.raises(OSError, match="No space"):
        document.push(State(TEXT + "# two\n", 0, "two"))
    with pytest.raises(OSError, match="No space"):
        document.step(-1, None)
    monkeypatch.undo()
    assert document.now.text == TEXT + "# one\n"
    assert document.draft.file.read_bytes() == data
    document.push(State(TEXT + "# three\n", 0, "three"))
    document.close()
    again = Document(scene)
    assert again.now.text == TEXT + "# three\n"
    again.step(-1, None)
    assert again.now.text == TEXT + "# one\n"


def test_nothing_to_undo_is_told(scene) -> None:
    document = Document(scene)
    with pytest.raises(EditError, match="nothing to undo"):
        document.step(-1, None)


def lost(document: Document) -> None:
    """As when its process is gone."""
    os.close(document.draft._lock)


def with_maps(document: Document) -> int:
    """A copy of maps, as a correction makes one."""
    number = document.draft.new_maps()
    document.draft.maps(number).mkdir()
    (document.draft.maps(number) / "masks.png").write_bytes(b"masks")
    return number


def test_maps_that_no_state_has_any_more_are_in_nobodys_way(scene) -> None:
    document = Document(scene)
    document.push(State(TEXT + "# mask\n", with_maps(document), "correct"))
    document.step(-1, None)
    document.push(State(TEXT + "# other\n", 0, "other"))
    document.push(State(TEXT + "# last\n", 0, "last"))
    assert not document.draft.maps(1).exists()
    lost(document)
    again = Document(scene)
    assert again.now.text == TEXT + "# last\n"
    assert (again.history.undo, again.history.version) == ("last", document.history.version)


@pytest.mark.parametrize("saves", [False, True])
def test_maps_that_alone_were_corrected_stay_when_another_program_writes_the_text(saves, scene) -> None:
    scene.write_text(TEXT + "assets: scene.assets\n")
    document = Document(scene)
    document.push(State(document.now.text, with_maps(document), "correct"))
    theirs = document.now.text + "# theirs\n"
    scene.write_text(theirs)
    if not saves:
        assert document.look_outside() == "merged"
        assert (document.now.text, document.now.maps, document.is_saved) == (theirs, 1, False)
    document.save(None)
    assert (scene.with_name("scene.assets") / "masks.png").read_bytes() == b"masks"
    assert (scene.read_text(), document.is_saved) == (theirs, True)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("draft.json", b"{"),
        ("draft.json", b"[]"),
        ("draft.json", b'{"format": 3}'),
        ("draft.json", b'{"format": 2, "history": {}, "saved": {}, "ids": [], "saving": false}'),
        ("journal.jsonl", b'{"journal": 1, "text": "of an older version"}\n'),
    ],
)
def test_a_draft_that_cannot_be_read_is_kept_aside(name, data, scene) -> None:
    document = Document(scene)
    document.push(State(TEXT + "# one\n", 0, "one"))
    lost(document)
    (document.draft.folder / name).write_bytes(data)
    again = Document(scene)
    aside = again.draft.set_aside
    assert aside == document.draft.folder.with_name(f"{document.draft.folder.name}~1")
    assert (aside / name).read_bytes() == data
    assert again.now.text == TEXT
    again.push(State(TEXT + "# two\n", 0, "two"))
    lost(again)
    assert Document(scene).now.text == TEXT + "# two\n"


def test_a_draft_that_somebody_removed_is_made_anew(scene) -> None:
    document = Document(scene)
    document.push(State(TEXT + "# one\n", 0, "one"))
    shutil.rmtree(document.draft.folder)
    document.push(State(TEXT + "# two\n", 0, "two"))
    document.step(-1, None)
    with pytest.raises(BusyError):
        Document(scene)
    lost(document)
    again = Document(scene)
    assert told(again) == told(document)
    assert again.history.redo == "two"


def test_a_draft_that_came_with_the_scene_is_not_trusted(scene, tmp_path, capfd) -> None:
    precious = tmp_path / "precious"
    precious.write_text("mine")
    folder = draft_folder(scene)
    folder.mkdir(0o700)
    (folder / "draft.json").symlink_to(precious)
    (folder / "lock").touch()
    (folder / "server.json").write_text('{"port": 1, "token": "known", "address": "http://evil.example"}')
    (folder / "owner").write_text("1")
    assert running_at(scene) is None
    document = Document(scene)
    assert precious.read_text() == "mine"
    assert document.draft.last_address() == {}
    assert document.draft.set_aside == folder.with_name(f"{folder.name}~1")
    assert document.now.text == TEXT
    document.close()
    copy = tmp_path / "copy"  # nor is one that was copied with its scene
    again = Document(scene)
    again.push(State("hostile", 0, "x"))
    lost(again)
    shutil.copytree(scene.parent, copy)
    assert Document(copy / "scene.yaml").now.text == TEXT
    folder2 = draft_folder(scene)
    assert Document(scene).now.text == "hostile"
    assert folder2.is_dir()


def test_edits_of_one_tag_are_one_step_until_one_is_saved_or_a_while_passed(scene) -> None:
    document = Document(scene)
    for number in range(3):
        document.push(State(TEXT + f"# {number}\n", 0, "type", "row"))
    document.save(None)
    document.push(State(TEXT + "# later\n", 0, "type", "row"))
    document.step(-1, None)
    assert document.now.text == TEXT + "# 2\n" == scene.read_text()
    history = History(State("0"))
    for at, text in ((0, "1"), (4, "2"), (8, "3"), (14, "4")):
        history.push(State(text, 0, "type", "row", None, at))
    history.step(-1)
    assert history.now.text == "3"
    history.step(-1)
    assert history.now.text == "0"


# A real server, killed


def test_what_was_answered_is_there_after_a_kill(killable: Callable[..., Killable]) -> None:
    first = killable("physics/05-slide")
    text = first.look()["text"]
    name = next(iter(first.state["scene"]["objects"]))
    for mass in (11, 12, 13):
        first.edit({"set": ["objects", name, "mass"], "value": mass}, what=f"weigh {mass}")
    first.send("/api/undo")
    said = first.state
    first.kill()
    assert first.scene.read_text() == text  # nobody saved

    again = killable(first.scene)
    assert again.address == first.address  # an open page finds its server, with the same token
    now = again.look()
    assert now["file"]["recovered"]
    assert [now[key] for key in ("text", "undo", "redo", "version")] == [
        said[key] for key in ("text", "undo", "redo", "version")
    ]
    again.send("/api/redo")
    assert "mass: 13" in again.state["text"]
    for _ in range(3):
        again.send("/api/undo")
    assert again.state["text"] == text
    assert again.state["file"]["saved"]


def test_killed_in_the_middle_of_edits_it_has_every_one_that_was_answered(
    killable: Callable[..., Killable],
) -> None:
    first = killable("physics/05-slide")
    name = next(iter(first.look()["scene"]["objects"]))
    answered: list[int] = []
    died = threading.Event()

    def edit() -> None:
        mass = 100
        while True:
            mass += 1
            try:
                first.edit({"set": ["objects", name, "mass"], "value": mass}, id=str(mass))
            except httpx.HTTPError:
                died.set()
                return
            answered.append(mass)

    thread = threading.Thread(target=edit)
    thread.start()
    while len(answered) < 5:
        time.sleep(0.01)
    first.process.kill()
    assert died.wait(60)
    thread.join(60)
    again = killable(first.scene)
    mass = again.look()["scene"]["objects"][name]["mass"]
    assert mass in (answered[-1], answered[-1] + 1)  # the one that was asked when it died may be there
    assert again.state["id"] == str(mass)
    assert again.send("/api/save").status_code == 200
    assert f"mass: {mass}" in again.scene.read_text()


def test_a_file_that_another_changed_while_nobody_looked_is_merged(killable: Callable[..., Killable]) -> None:
    first = killable("physics/05-slide")
    name = next(iter(first.look()["scene"]["objects"]))
    first.edit({"set": ["objects", name, "mass"], "value": 77})
    first.kill()
    first.scene.write_text("# by hand\n" + first.scene.read_text())
    now = killable(first.scene).look()
    assert now["text"].startswith("# by hand\n")
    assert "mass: 77" in now["text"]
    assert now["file"]["outside"] is None


def test_an_editor_that_ends_saved_leaves_nothing(killable: Callable[..., Killable]) -> None:
    served = killable("physics/05-slide")
    before = sorted(served.scene.parent.iterdir())
    name = next(iter(served.look()["scene"]["objects"]))
    served.edit({"set": ["objects", name, "mass"], "value": 77})
    served.send("/api/save")
    served.client.close()
    served.process.terminate()
    assert served.process.wait(60) == 0
    assert [path for path in before if path.exists()] == [served.scene]


def test_an_editor_that_ends_unsaved_keeps_its_draft(serving: Callable[..., Served], copied) -> None:
    path = copied("physics/05-slide")
    document = Document(path)
    document.push(State(path.read_text() + "# more\n", 0, "more"))
    assert document.close() == draft_folder(path)
    served = serving(path)
    assert served.look()["file"]["recovered"]
    assert served.state["undo"] == "more"


def test_a_draft_outlives_its_file(scene) -> None:
    document = Document(scene)
    document.push(State(TEXT + "# mine\n", 0, "mine"))
    document.close()
    scene.unlink()
    again = Document(scene)
    assert again.outside == "gone"
    assert again.now.text == TEXT + "# mine\n"
    again.save(None)
    assert scene.read_text() == TEXT + "# mine\n"
    assert again.close() is None
