"""`physgen cache` as a person runs it."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from physgen.cli.main import main
from physgen.pipeline.cache import SUFFIX, open_store


def put(key: str, size: int) -> None:
    open_store().write(key, b"x" * size)


def test_show_of_nothing_makes_nothing(capsys) -> None:
    assert main(["cache", "show"]) == 0
    root = open_store().root
    assert capsys.readouterr().out == f"{root}\nall       0 entries, 0 bytes of 5 GB\n"
    assert main(["cache", "clear"]) == 0
    assert capsys.readouterr().out == f"{root}: 0 entries removed, 0 bytes freed\n"
    assert not root.exists()


def test_show_and_clear(capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PHYSGEN_CACHE_BYTES", "2.5GB")
    monkeypatch.setenv("TZ", "UTC")
    put("guidance-a", 1_500_000)
    put("guidance-b", 2_500_000)
    put("other-c", 300)
    store = open_store()
    os.utime(store.root / f"guidance-b{SUFFIX}", (1_000_000_000, 1_000_000_000))
    small = (store.root / f"other-c{SUFFIX}").stat().st_size
    assert main(["cache", "show"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[:4] == [
        str(store.root),
        "guidance  2 entries, 4 MB",
        f"other     1 entry, {small} bytes",
        "all       3 entries, 4 MB of 2.5 GB",
    ]
    assert main(["cache", "show", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["path"] == str(store.root)
    assert told["count"] == 3
    assert told["most_bytes"] == 2_500_000_000
    assert told["bytes"] == sum(entry["bytes"] for entry in told["entries"])
    assert told["bytes"] == sum(p.stat().st_size for p in store.root.glob(f"*{SUFFIX}"))
    assert told["entries"][0]["key"] == "guidance-b"
    assert main(["cache", "clear"]) == 0
    assert capsys.readouterr().out == f"{store.root}: 3 entries removed, 4 MB freed\n"
    put("other-c", 300)
    assert main(["cache", "clear", "--json"]) == 0
    cleared = json.loads(capsys.readouterr().out)
    assert (cleared["removed"], cleared["freed_bytes"], cleared["in_use"]) == (1, small, 0)
    assert store.sizes() == []


def test_answers_of_a_language_model_stay(capsys) -> None:
    answer = open_store().root.parent / "vlm" / "ab" / "answer.json"
    answer.parent.mkdir(parents=True)
    answer.write_text("{}")
    assert main(["cache", "clear"]) == 0
    assert answer.exists()


def test_a_wrong_bound_gets_one_line(capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PHYSGEN_CACHE_BYTES", "much")
    assert main(["cache", "show"]) == 2
    told = capsys.readouterr().err
    assert (
        told
        == 'PHYSGEN_CACHE_BYTES: "much" is not a number of bytes; write e.g. 20e9 or 20GB; 0 keeps nothing\n'
    )


def test_a_folder_that_cannot_be_cleared_is_told_of(capsys, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (open_store().root / f"s-a{SUFFIX}").mkdir(parents=True)
    assert main(["cache", "clear"]) == 1
    told = capsys.readouterr().err
    assert told == f"{open_store().root / f's-a{SUFFIX}'}: Is a directory\n"
