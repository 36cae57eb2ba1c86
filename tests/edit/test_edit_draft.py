"""A draft that outlives its server: killed in the middle of edits, its disk full, its folder strange."""

from __future__ import annotations

import os
import shutil
import threading
import time
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest
from served import Killable

from physgen.edit.draft import BusyError, Draft, draft_folder
from physgen.edit.session import EditRequest, History, Session, State
from physgen.problems import EditError, InputError

SCENE = "physgen: 1\nsize: [64, 48]\nobjects: {}\n"


def write(session: Session, text: str, tag: str | None = None) -> None:
    session.write(EditRequest(version=session.history.version, tag=tag), text)


def step(session: Session, by: int) -> None:
    session.step(EditRequest(version=session.history.version), by)


def save(session: Session) -> None:
    session.save(EditRequest(version=session.history.version))


def test_edits_of_one_tag_are_one_step_until_one_is_saved_or_a_while_passed(
    scene,
) -> None:
    session = Session(scene)
    for number in range(3):
        write(session, SCENE + f"# {number}\n", "row")
    save(session)
    write(session, SCENE + "# later\n", "row")
    step(session, -1)
    assert session.current_state.text == SCENE + "# 2\n" == scene.read_text()
    session.close()
    history = History([State("0")])
    for at, text in ((0, "1"), (4, "2"), (8, "3"), (14, "4")):
        history.push(State(text, "type", "row", at))
    history.step(-1)
    assert history.current_state.text == "3"
    history.step(-1)
    assert history.current_state.text == "0"


def test_a_second_editor_of_a_scene_is_refused_and_has_the_address_of_the_first(
    scene,
) -> None:
    first = Draft(scene)
    first.listens("http://127.0.0.1:1234/?token=secret")
    link = scene.with_name("link.yaml")
    link.symlink_to(scene)
    for path in (scene, link):
        with pytest.raises(BusyError) as busy:
            Draft(path)
        assert busy.value.address == "http://127.0.0.1:1234/?token=secret"
    first.close(keep=False)
    assert not draft_folder(scene).exists()


def test_a_folder_that_may_not_be_written_is_refused(scene, monkeypatch) -> None:
    def refused(*arguments: object, **named: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", refused)
    with pytest.raises(
        InputError, match="cannot have a draft beside it: permission denied"
    ):
        Session(scene)


def test_a_full_disk_leaves_the_state_as_it_was(scene, monkeypatch) -> None:
    session = Session(scene)
    write(session, SCENE + "# one\n")
    file = draft_folder(scene) / "draft.json"
    data = file.read_bytes()

    def full(*arguments: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="No space"):
        write(session, SCENE + "# two\n")
    with pytest.raises(OSError, match="No space"):
        step(session, -1)
    monkeypatch.undo()
    assert session.current_state.text == SCENE + "# one\n"
    assert file.read_bytes() == data
    write(session, SCENE + "# three\n")
    assert session.close() == draft_folder(scene)
    again = Session(scene)
    assert again.recovered
    assert again.current_state.text == SCENE + "# three\n"
    step(again, -1)  # back to the saved file
    assert again.current_state.text == SCENE
    assert again.is_saved
    with pytest.raises(EditError, match="nothing to undo"):
        step(again, -1)
    assert again.close() is None


@pytest.mark.parametrize(
    "data",
    [
        b"{",
        b"[]",
        b'{"format": 2, "history": {}, "saved": {}}',
        b'{"format": 4, "text": "", "saved": "", "folders": ["../x.assets"]}',
    ],
)
def test_a_draft_that_cannot_be_read_is_named_and_kept(data, scene) -> None:
    folder = draft_folder(scene)
    folder.mkdir(0o700)
    (folder / "draft.json").write_bytes(data)
    for _ in range(2):
        with pytest.raises(InputError, match="a draft of another version") as error:
            Session(scene)
        assert error.value.problems[0].fix
        assert (folder / "draft.json").read_bytes() == data


def test_a_draft_that_came_with_the_scene_leads_nowhere(scene, tmp_path) -> None:
    precious = tmp_path / "precious"
    folder = draft_folder(scene)
    folder.mkdir(0o755)  # as an archive leaves it
    with pytest.raises(InputError, match="of another user"):
        Session(scene)
    folder.chmod(0o700)
    for name in ("draft.json", "address"):
        (folder / name).symlink_to(precious)
    session = Session(scene)
    session.draft.listens("http://127.0.0.1:1/")
    write(session, SCENE + "# one\n")
    session.close()
    assert not precious.exists()
    shutil.rmtree(folder)
    (tmp_path / "elsewhere").mkdir(0o700)
    folder.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="of another user"):
        Session(scene)


def test_a_draft_outlives_its_file(scene) -> None:
    session = Session(scene)
    write(session, SCENE + "# mine\n")
    session.close()
    os.unlink(scene)
    again = Session(scene)
    assert again.outside == "gone"
    assert again.current_state.text == SCENE + "# mine\n"
    save(again)
    assert scene.read_text() == SCENE + "# mine\n"
    assert again.close() is None


# A real server, killed


@pytest.mark.slow
def test_killed_in_the_middle_of_edits_it_has_every_one_that_was_answered(
    killable: Callable[..., Killable],
) -> None:
    first = killable("physics/05-slide")
    text = first.look()["text"]
    name = next(iter(first.state["scene"]["objects"]))
    answered: list[int] = []
    died = threading.Event()

    def edit() -> None:
        mass = 100
        while True:
            mass += 1
            try:
                first.edit({"set": ["objects", name, "mass"], "value": mass})
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
    assert first.scene.read_text() == text  # nothing was saved
    again = killable(first.scene)
    mass = again.look()["scene"]["objects"][name]["mass"]
    assert mass in (
        answered[-1],
        answered[-1] + 1,
    )  # the one that was asked when it died may be there
    assert again.state["file"]["recovered"]
    assert again.send("/api/save").status_code == 200
    assert f"mass: {mass}" in again.scene.read_text()


def test_a_draft_that_was_removed_is_made_anew_and_held(scene) -> None:
    session = Session(scene)
    shutil.rmtree(draft_folder(scene))
    write(session, SCENE + "# more\n")
    with pytest.raises(BusyError):
        Draft(scene)
    session.close()
