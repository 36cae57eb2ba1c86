"""Scenes and bodies of strangers take little memory, hold nobody up, and end nothing."""

from __future__ import annotations

import json
import logging
import subprocess
import sys
import threading
import time
import tracemalloc
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from served import Served, client

from physgen.edit import api
from physgen.edit.errors import EditError
from physgen.edit.guard import BODY, MAX_VALUES
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
MEMORY = 200 * 2**20
"""Bytes that one body may take at most."""


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


# A body


def filled(most: int, one: Callable[[int], bytes], around: tuple[bytes, bytes]) -> bytes:
    """As many items as a body can hold, `most` at the most."""
    size = len(one(most)) + 1
    count = min(most, (BODY - 20) // size)
    return around[0] + b",".join(one(k) for k in range(count)) + around[1]


LISTED, KEYED, TEXT = (b'{"x":[', b"]}"), (b'{"x":{', b"}}"), (b'{"text":[', b"]}")
KINDS: dict[str, tuple[Callable[[int], bytes], tuple[bytes, bytes]]] = {
    "lists": (lambda k: b"[]", LISTED),
    "objects": (lambda k: b'{"a":%d}' % (k % 10), LISTED),
    "other objects": (lambda k: b'{"a%06x":2.5}' % k, LISTED),
    "numbers": (lambda k: b"1.5", LISTED),
    "numbers of a text": (lambda k: b"1.5", TEXT),
    "texts": (lambda k: b'"%06x\\u0101"' % k, LISTED),
    "keys": (lambda k: b'"%06x":1.5' % k, KEYED),
    "keys of four bytes a character": (lambda k: b'"%06x\\ud83d\\ude00":1.5' % k, KEYED),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_body_takes_little_memory(kind) -> None:
    one, around = KINDS[kind]
    with pytest.raises(EditError) as refused:
        api.parsed(filled(10**9, one, around))
    assert refused.value.why.value == 400
    for part in (1, 2, 3, 4, 5):  # the largest of these that is taken is near the limit
        body = filled(MAX_VALUES // part - 10, one, around)
        taken = True

        def work(body: bytes = body) -> None:
            nonlocal taken
            try:
                api.parsed(body)
            except EditError:
                taken = False

        assert peak(work) < MEMORY
        if taken:
            break
    assert taken


def test_a_refused_body_is_never_made_into_values() -> None:
    body = filled(10**9, *KINDS["numbers of a text"])

    def work() -> None:
        with pytest.raises(EditError):
            api.parsed(body)

    assert peak(work) < 2**20 < len(body)


def test_a_long_text_is_one_value() -> None:
    text = ', [{\\"\n' * (BODY // 11)
    body = json.dumps({"text": text}).encode()
    assert BODY * 0.8 < len(body) < BODY
    assert api.parsed(body) == {"text": text}


PLAIN = st.none() | st.booleans() | st.integers() | st.text()
DEEP = st.recursive(PLAIN, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner))


def values(told: Any) -> int:
    below = told.values() if isinstance(told, dict) else told if isinstance(told, list) else ()
    return 1 + sum(map(values, below))


@given(st.dictionaries(st.text(), DEEP))
def test_no_body_has_more_values_than_are_counted(told) -> None:
    for text in (json.dumps(told), json.dumps(told, ensure_ascii=False, separators=(",", ":"))):
        try:
            data = text.encode()
        except UnicodeEncodeError:
            continue
        counted = sum(1 for _ in api._MARKS.finditer(data))
        assert values(told) - 1 <= counted <= 3 * values(told)


def test_others_are_answered_while_a_body_is_read(serving: Serve, monkeypatch) -> None:
    served = serving("physics/05-slide")
    parsed, begun, done = api.parsed, threading.Event(), threading.Event()
    order: list[str] = []

    def slow(data: bytes) -> dict[str, Any]:
        begun.set()
        done.wait(20)
        return parsed(data)

    version = served.look()["version"]
    body = {"version": version, "variant": None, "text": served.state["text"] + "# more\n"}
    monkeypatch.setattr(api, "parsed", slow)
    with ThreadPoolExecutor(1) as pool, client(served.address) as other:

        def large() -> int:
            status = other.put("/api/text", json=body).status_code
            order.append("large")
            return status

        future = pool.submit(large)
        assert begun.wait(30)
        assert served.client.get("/static/page.css").status_code == 200
        assert served.get("/api/state")["version"] == version
        order.append("small")
        done.set()
        assert future.result(60) == 200
    assert order == ["small", "large"]


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
