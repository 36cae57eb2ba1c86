"""The store of results: complete entries alone, least recently used first out, for many processes at once."""

from __future__ import annotations

import multiprocessing
import os
import random
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from physgen.pipeline.cache import MOST_BYTES, SUFFIX, Store, open_store
from physgen.problems import Problem

KB = 1000
DATA = b"x" * 2 * KB


def keys(store: Store) -> set[str]:
    return {entry.key for entry in store.sizes()}


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "stages")


def test_what_was_written_is_read(store: Store) -> None:
    assert store.read("s-a") is None
    store.write("s-a", b"alpha")
    assert store.read("s-a") == b"alpha"
    assert store.read("s-b") is None
    [entry] = store.sizes()
    assert entry.key == "s-a"
    assert entry.bytes == (store.root / f"s-a{SUFFIX}").stat().st_size
    assert store.root.stat().st_mode & 0o077 == 0  # photos may be private


def _flipped(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


DAMAGES: dict[str, Callable[[Path], object]] = {
    "cut short": lambda path: os.truncate(path, 10),
    "empty": lambda path: os.truncate(path, 0),
    "a bit": _flipped,
    "longer": lambda path: path.write_bytes(path.read_bytes() + b"x"),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_entry_counts_as_missing_and_is_removed(
    damage: Callable[[Path], object], store: Store
) -> None:
    store.write("s-a", DATA)
    store.write("s-b", DATA)
    damage(store.root / f"s-a{SUFFIX}")
    assert store.read("s-a") is None
    assert keys(store) == {"s-b"}
    store.write("s-a", b"anew")
    assert store.read("s-a") == b"anew"


def test_the_least_recently_used_go_first(tmp_path: Path) -> None:
    store = Store(tmp_path, 8 * KB)
    for age, key in enumerate(("s-c", "s-b", "s-a")):
        store.write(key, DATA)
        os.utime(tmp_path / f"{key}{SUFFIX}", (1000 + age, 1000 + age))
    assert [entry.key for entry in store.sizes()] == ["s-c", "s-b", "s-a"]
    assert store.read("s-c") is not None  # used now
    store.write("s-d", DATA)
    assert keys(store) == {"s-a", "s-c", "s-d"}
    store.write("s-e", DATA)
    assert keys(store) == {"s-c", "s-d", "s-e"}


def test_one_that_is_larger_than_the_bound_removes_none(tmp_path: Path) -> None:
    warnings: list[Problem] = []
    store = Store(tmp_path, 8 * KB, warnings.append)
    store.write("s-a", DATA)
    store.write("s-large", b"x" * 20 * KB)
    assert keys(store) == {"s-a"}
    assert "PHYSGEN_CACHE_BYTES" in str(warnings[0])
    none = Store(tmp_path / "none", 0, warnings.append)
    none.write("s-a", DATA)
    assert none.sizes() == []
    assert len(warnings) == 1


def test_writing_removes_remains_of_killed_processes(store: Store) -> None:
    store.write("s-a", DATA)
    old, new = store.root / ".s-c.12-ab.part", store.root / ".s-d.13-ab.part"
    for path in (old, new):
        path.write_bytes(b"half")
    os.utime(old, (1000, 1000))
    store.write("s-b", DATA)
    assert not old.exists()
    assert new.exists()  # its process may live


def _hammer(root: Path, seed: int, rounds: int, most: int) -> tuple[int, list[str]]:
    """How often an entry was found, and what was wrong."""
    wrong: list[str] = []
    store, draw = Store(root, most, warn=lambda problem: wrong.append(str(problem))), random.Random(seed)
    found = 0
    for _ in range(rounds):
        key = f"s-{draw.randrange(5)}"
        data = store.read(key)
        if data is None:
            store.write(key, key.encode() * 500)
        else:
            found += 1
            time.sleep(0.001)
            wrong += [] if data == key.encode() * 500 else [f"{key} holds other data"]
    return found, wrong


@pytest.mark.parametrize("most", [MOST_BYTES, 4 * KB], ids=["room for all", "room for two"])
def test_many_processes_at_once(most: int, tmp_path: Path) -> None:
    with multiprocessing.get_context("spawn").Pool(3) as pool:
        results = pool.starmap(_hammer, [(tmp_path, seed, 60, most) for seed in range(3)])
    assert [wrong for _, wrong in results] == [[]] * 3
    assert all(found for found, _ in results)
    store = Store(tmp_path, most)
    assert sum(entry.bytes for entry in store.sizes()) <= most
    assert not list(tmp_path.glob(".*.part"))


def test_a_folder_that_cannot_be_written_warns_once(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    warnings: list[Problem] = []
    store = Store(tmp_path / "file" / "stages", warn=warnings.append)
    for _ in range(2):
        assert store.read("s-a") is None
        store.write("s-a", DATA)
    assert store.sizes() == []
    assert len(warnings) == 1
    assert "cannot be written" in str(warnings[0])
    assert "XDG_CACHE_HOME" in str(warnings[0])


@pytest.mark.parametrize(
    ("text", "most"),
    [
        ("", 5_000_000_000),
        ("0", 0),
        ("250", 250),
        ("2e9", 2_000_000_000),
        ("1.5 GB", 1_500_000_000),
        ("3kB", 3000),
    ],
)
def test_the_bound_comes_from_the_environment(text: str, most: int) -> None:
    assert open_store({"XDG_CACHE_HOME": "/a", "PHYSGEN_CACHE_BYTES": text}).most_bytes == most
