"""Scenes and bodies of strangers take little memory, hold nobody up, and end nothing."""

from __future__ import annotations

import logging
import subprocess
import sys
import threading
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from served import Served

from physgen.edit.operations import edited
from physgen.edit.session import Watch

Serve = Callable[..., Served]
SCENE = """physgen: 1
size: [100, 100]
objects:
  a: {shape: {circle: {center: [10, 10], radius: 5}}}
  b: {shape: {circle: {center: [30, 10], radius: 5}}}
variants:
  v: {'KEY': VALUE}
"""


def until(met: Callable[[], bool], patience: float = 30) -> None:
    end = time.monotonic() + patience
    while not met():
        assert time.monotonic() < end
        time.sleep(0.02)


def peak(work: Callable[[], Any]) -> int:
    """Bytes that work takes at its height."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


# A scene


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("forces[{at}].object", "{name}"),
        ("forces[{at}]", "{{object: {name}}}"),
        ("joints.hinge.objects[{at}]", "{name}"),
        ("render.camera[{at}].follow", "{name}"),
    ],
)
def test_a_number_in_a_key_takes_no_memory(key, value) -> None:
    at = 2_000_000
    said = key.format(at=at)
    text = SCENE.replace("KEY", said).replace("VALUE", value.format(name="a"))

    def made(**op: Any) -> str:
        return edited(text, [op], None, Path("scene.yaml"), False).text

    for op in ({"rename": ["objects", "a"], "to": "c"}, {"remove": ["objects", "a"]}):
        assert peak(lambda op=op: made(**op)) < at  # not a byte an item
    told = made(rename=["objects", "a"], to="c").splitlines()[-1]
    assert told == f"  v: {{'{said}': {value.format(name='c')}}}"  # named, whichever item it is


# Another program's change


def test_what_goes_wrong_with_a_change_is_told_once_and_looked_at_again(tmp_path: Path, caplog) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text("a")
    wrong: list[Exception] = [OSError(28, "No space left on device"), KeyError("a"), OSError(5, "I/O error")]
    taken: list[str] = []
    came = threading.Event()

    def changed() -> None:
        if wrong:
            raise wrong.pop(0)
        taken.append(path.read_text())
        came.set()

    watch = Watch(path, changed)
    watch.start()
    with caplog.at_level(logging.WARNING):
        for text in ("bb", "ccc"):
            path.write_text(text)
            assert came.wait(30)
            came.clear()
    wrong.append(OSError(28, "No space left on device"))
    path.write_text("dddd")
    assert came.wait(30)
    watch.end()
    assert (taken[0], taken[-1]) == ("bb", "dddd")
    assert [record.getMessage() for record in caplog.records] == 2 * [
        f"{path}: was changed, and could not be taken in: [Errno 28] No space left on device"
    ]


def test_an_editor_goes_on_with_other_programs_after_a_full_disk(serving: Serve, monkeypatch) -> None:
    served = serving("physics/05-slide")
    assert served.editor is not None
    document = served.editor.session.document
    look, failed, taken = document.look_outside, threading.Event(), threading.Event()
    room = threading.Event()

    def full() -> str | None:
        if not room.is_set():
            failed.set()
            raise OSError(28, "No space left on device")
        outcome = look()
        taken.set()
        return outcome

    monkeypatch.setattr(document, "look_outside", full)
    text = served.look()["text"] + "# theirs\n"
    served.scene.write_text(text)
    assert failed.wait(30)
    until(lambda: served.look()["file"]["outside"] == "unread")  # and the page says so
    room.set()
    assert taken.wait(30)
    until(lambda: served.look()["file"]["outside"] is None)
    assert served.look()["text"] == text
    events = served.editor.windows.ask("w", served.editor.windows.run, 0)["events"]
    outcomes = [event["outcome"] for event in events if event["type"] == "file"]
    assert outcomes == ["failed", "taken"]


def test_a_change_that_cannot_be_taken_in_is_told_on_stderr(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text("a")
    program = f"""
import pathlib, threading
from physgen.edit.session import Watch
path, came, calls = pathlib.Path({str(path)!r}), threading.Event(), []
def changed():
    calls.append(1)
    if len(calls) < 3:
        raise OSError(28, "No space left on device")
    came.set()
watch = Watch(path, changed)
watch.start()
path.write_text("bb")
assert came.wait(30)
watch.end()
"""
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120)
    line = f"{path}: was changed, and could not be taken in: [Errno 28] No space left on device\n"
    assert (ran.returncode, ran.stderr, ran.stdout) == (0, line, "")
