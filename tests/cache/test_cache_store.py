"""Entries of the store: whole or not there, for many processes at once, the least recently used gone first."""

from __future__ import annotations

import errno
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from physgen.pipeline import cache as stores
from physgen.pipeline.cache import INDEX, LEASE, MOST_BYTES, Store, open_store
from physgen.problems import InputError, Problem

KB = 1000


def put(store: Store, key: str, data: bytes = b"x" * KB) -> None:
    with store.fill(key) as filling:
        assert filling is not None
        (filling.folder / "one.bin").write_bytes(data)
        (filling.folder / "more").mkdir()
        (filling.folder / "more" / "two.bin").write_bytes(data[::-1])


def got(store: Store, key: str) -> tuple[bytes, bytes] | None:
    with store.find(key) as folder:
        if folder is None:
            return None
        return (folder / "one.bin").read_bytes(), (folder / "more" / "two.bin").read_bytes()


def remains(store: Store) -> list[Path]:
    return list(store.root.glob(".*.part"))


def keys(store: Store) -> set[str]:
    return {entry.key for entry in store.sizes()}


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "stages")


def test_what_was_filled_is_found(store: Store) -> None:
    assert got(store, "s-a") is None
    put(store, "s-a", b"alpha")
    assert got(store, "s-a") == (b"alpha", b"ahpla")
    assert got(store, "s-b") is None
    [entry] = store.sizes()
    assert (entry.key, entry.stage) == ("s-a", "s")
    on_disk = sum(p.stat().st_size for p in (store.root / "s-a").rglob("*") if p.is_file())
    assert entry.bytes == on_disk
    assert remains(store) == []


def test_nothing_is_there_before_it_is_whole(store: Store) -> None:
    def interrupted() -> None:
        with store.fill("s-a") as filling:
            assert filling is not None
            (filling.folder / "one.bin").write_bytes(b"half")
            assert got(store, "s-a") is None
            assert store.sizes() == []
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert got(store, "s-a") is None
    assert remains(store) == []


def test_what_was_given_up_is_not_kept_and_told_of_once(tmp_path: Path) -> None:
    told: list[Problem] = []
    store = Store(tmp_path, warn=told.append)
    for key in ("s-a", "s-b"):
        with store.fill(key) as filling:
            assert filling is not None
            filling.give_up(OSError(28, "No space left on device"))
            assert not filling.folder.exists()
    assert store.sizes() == []
    assert len(told) == 1
    assert "No space left on device" in str(told[0])


def test_of_two_who_fill_at_once_one_wins_and_both_go_on(store: Store) -> None:
    other = Store(store.root)
    with store.fill("s-a") as one:
        assert one is not None
        put(other, "s-a", b"first to end")
        (one.folder / "one.bin").write_bytes(b"second")
    assert got(store, "s-a") == (b"first to end", b"dne ot tsrif")
    assert remains(store) == []


def _flipped(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


DAMAGES: dict[str, Callable[[Path], object]] = {
    "cut short": lambda entry: os.truncate(entry / "one.bin", 10),
    "empty": lambda entry: os.truncate(entry / "one.bin", 0),
    "a bit": lambda entry: _flipped(entry / "more" / "two.bin"),
    "a file gone": lambda entry: (entry / "one.bin").unlink(),
    "longer": lambda entry: (entry / "one.bin").write_bytes(b"x" * (KB + 1)),
    "no index": lambda entry: (entry / INDEX).unlink(),
    "half an index": lambda entry: os.truncate(entry / INDEX, 20),
    "no lease": lambda entry: (entry / LEASE).unlink(),
    "another index": lambda entry: (entry / INDEX).write_text("[]"),
    "an index of nothing": lambda entry: (entry / INDEX).write_text('{"cache": 1, "files": []}'),
    "another version": lambda entry: (entry / INDEX).write_text('{"cache": 0, "files": {}}'),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_entry_counts_as_not_there_and_goes(damage: Callable[[Path], object], store: Store) -> None:
    put(store, "s-a")
    put(store, "s-b")
    damage(store.root / "s-a")
    assert got(store, "s-a") is None
    assert keys(store) == {"s-b"}
    put(store, "s-a", b"anew")
    assert got(store, "s-a") == (b"anew", b"wena")


def test_a_folder_by_whoever_can_be_cleared(store: Store) -> None:
    put(store, "s-a")
    (store.root / "s-b").mkdir()
    assert store.clear().entries == 2
    assert store.sizes() == []


def test_the_least_recently_used_go_first(tmp_path: Path) -> None:
    store = Store(tmp_path, 8 * KB)  # three entries of a little more than 2 kB
    for age, key in enumerate(("s-c", "s-b", "s-a")):
        put(store, key)
        os.utime(tmp_path / key / LEASE, (1000 + age, 1000 + age))
    assert [entry.key for entry in store.sizes()] == ["s-c", "s-b", "s-a"]
    assert got(store, "s-c") is not None  # used now
    assert [entry.key for entry in store.sizes()] == ["s-b", "s-a", "s-c"]
    put(store, "s-d")
    assert keys(store) == {"s-a", "s-c", "s-d"}
    put(store, "s-e")
    assert keys(store) == {"s-c", "s-d", "s-e"}
    assert sum(entry.bytes for entry in store.sizes()) <= store.most_bytes
    assert remains(store) == []


def test_one_that_is_larger_than_the_bound_is_not_kept_and_drives_none_out(tmp_path: Path) -> None:
    told: list[Problem] = []
    store = Store(tmp_path, 8 * KB, told.append)
    put(store, "s-a")
    put(store, "s-large", b"x" * 20 * KB)
    assert keys(store) == {"s-a"}
    assert "PHYSGEN_CACHE_BYTES" in str(told[0])
    none = Store(tmp_path / "none", 0, told.append)
    with none.fill("s-a") as filling:
        assert filling is None
    assert none.sizes() == []
    assert len(told) == 1  # nothing is to be kept: nothing is said


def test_one_that_is_read_stays(tmp_path: Path) -> None:
    store, other = Store(tmp_path, 5 * KB), Store(tmp_path, 5 * KB)
    put(store, "s-a")
    with store.find("s-a") as folder, other.find("s-a") as again:
        assert folder is not None
        assert again == folder
        os.utime(folder / LEASE, (1000, 1000))  # however long ago
        put(other, "s-b")
        put(other, "s-c")
        assert keys(other) == {"s-a", "s-c"}
        freed = other.clear()
        assert (freed.entries, freed.held) == (1, 1)
        assert (folder / "one.bin").read_bytes() == b"x" * KB
    size = store.sizes()[0].bytes
    freed = other.clear()
    assert (freed.entries, freed.bytes, freed.held) == (1, size, 0)
    assert store.sizes() == []


WORK = """
import sys, time
from pathlib import Path
from physgen.pipeline.cache import Store
store = Store(Path(sys.argv[1]))
with getattr(store, sys.argv[2])("s-a") as got:
    if sys.argv[2] == "fill":
        (got.folder / "one.bin").write_bytes(b"x" * 5000)
    print("there", flush=True)
    time.sleep(600)
"""


def busy(store: Store, at: str) -> subprocess.Popen[bytes]:
    """A process that has begun to `fill` or to read what it could `find`, and does not end."""
    command = [sys.executable, "-c", WORK, str(store.root), at]
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"there\n"
    return process


def killed(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(signal.SIGKILL)
    process.communicate()


def test_one_that_was_killed_while_it_filled_leaves_nothing_that_counts(store: Store) -> None:
    process = busy(store, "fill")
    try:
        put(store, "s-b")
        assert len(remains(store)) == 1  # its owner lives
        assert store.clear().bytes > 0
        assert len(remains(store)) == 1
    finally:
        killed(process)
    assert got(store, "s-a") is None
    assert store.sizes() == []
    stores._SWEPT.clear()  # each process looks once
    put(store, "s-c")
    assert remains(store) == []
    assert got(store, "s-c") is not None


def test_clearing_sweeps_what_a_killed_process_left(store: Store) -> None:
    killed(busy(store, "fill"))
    assert len(remains(store)) == 1
    freed = store.clear()
    assert (freed.entries, freed.bytes) == (0, 5000)
    assert remains(store) == []


def test_a_killed_reader_holds_nothing(store: Store) -> None:
    put(store, "s-a")
    process = busy(store, "find")
    try:
        assert store.clear().held == 1
    finally:
        killed(process)
    assert store.clear().entries == 1


def _content(key: str) -> bytes:
    return key.encode() * 500


def _hammer(root: Path, seed: int, rounds: int, most: int) -> tuple[int, list[str]]:
    """How often something was found, and all that was not as it should be."""
    store, draw = Store(root, most, warn=lambda problem: wrong.append(str(problem))), random.Random(seed)
    found, wrong = 0, list[str]()
    for _ in range(rounds):
        key = f"s-{draw.randrange(5)}"
        with store.find(key) as folder:
            if folder is not None:
                found += 1
                time.sleep(0.001)
                if (folder / "one.bin").read_bytes() != _content(key):
                    wrong.append(f"{key} holds something else")
                if (folder / "more" / "two.bin").read_bytes() != _content(key)[::-1]:
                    wrong.append(f"{key} holds something else")
                continue
        put(store, key, _content(key))
    return found, wrong


@pytest.mark.parametrize("most", [MOST_BYTES, 7 * KB], ids=["room for all", "room for two"])
def test_many_processes_at_once(most: int, tmp_path: Path) -> None:
    with multiprocessing.get_context("spawn").Pool(4) as pool:
        results = pool.starmap(_hammer, [(tmp_path, seed, 60, most) for seed in range(4)])
    assert [wrong for _, wrong in results] == [[]] * 4
    assert all(found for found, _ in results)
    store = Store(tmp_path, most)
    assert sum(entry.bytes for entry in store.sizes()) <= most
    assert remains(store) == []
    if most == MOST_BYTES:
        assert keys(store) == {f"s-{k}" for k in range(5)}


def test_a_folder_that_cannot_be_written_fails_nobody_and_is_told_of_once(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    told: list[Problem] = []
    store = Store(tmp_path / "file" / "stages", warn=told.append)
    for _ in range(2):
        assert got(store, "s-a") is None
        with store.fill("s-a") as filling:
            assert filling is None
    assert store.sizes() == []
    assert store.clear().entries == 0
    assert len(told) == 1
    assert "cannot be written" in str(told[0])
    assert "XDG_CACHE_HOME" in str(told[0])


def test_a_folder_that_goes_meanwhile_fails_nobody(store: Store) -> None:
    with store.fill("s-a") as filling:
        assert filling is not None
        shutil.rmtree(store.root)
    assert got(store, "s-a") is None
    put(store, "s-a")
    assert got(store, "s-a") is not None


def test_others_cannot_look_into_it(store: Store) -> None:
    put(store, "s-a")
    assert store.root.stat().st_mode & 0o077 == 0


@pytest.mark.parametrize(
    ("said", "most"),
    [
        ("", 5_000_000_000),
        ("0", 0),
        ("250", 250),
        ("2e9", 2_000_000_000),
        ("1.5 GB", 1_500_000_000),
        ("20g", 20_000_000_000),
        ("3kB", 3000),
        ("1T", 10**12),
    ],
)
def test_the_bound_is_told_by_the_environment(said: str, most: int) -> None:
    assert open_store({"XDG_CACHE_HOME": "/a", "PHYSGEN_CACHE_BYTES": said}).most_bytes == most


@pytest.mark.parametrize("said", ["much", "-1", "1 GiB", "nan", "1e", "5 5"])
def test_a_bound_that_is_none_is_refused(said: str) -> None:
    with pytest.raises(InputError, match=r"PHYSGEN_CACHE_BYTES: .* is not a number of bytes; write"):
        open_store({"PHYSGEN_CACHE_BYTES": said})


def test_where_a_file_system_knows_no_locks_what_was_used_today_stays(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(descriptor: int, how: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", none)
    told: list[Problem] = []
    store = Store(store.root, 3000, told.append)
    put(store, "s-a")
    assert got(store, "s-a") is not None
    old = time.time() - 2 * 86400
    left = store.root / ".s-x.1234.part"
    left.mkdir()
    (left / LEASE).touch()
    for lease in (store.root / "s-a" / LEASE, left / LEASE):
        os.utime(lease, (old, old))
    put(store, "s-b")  # with it there are too many
    assert keys(store) == {"s-b"}
    assert remains(store) == []
    assert store.clear().held == 1
    assert got(store, "s-b") is not None
    assert told == []


def test_where_it_lies(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/somebody")
    assert open_store({"XDG_CACHE_HOME": "/a"}).root == Path("/a/physgen/stages")
    for home in ("", "relative"):  # the standard has relative ones ignored
        assert open_store({"XDG_CACHE_HOME": home}).root == Path("/home/somebody/.cache/physgen/stages")


def test_no_test_touches_the_users_own() -> None:
    assert Path.home() / ".cache" not in open_store().root.parents


def test_entries_are_listed_once_a_hundredth_of_the_bound_was_added(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Listing 100,000 entries for each new one would take longer than most entries save."""
    looked = []
    whole = Store._shrink
    monkeypatch.setattr(Store, "_shrink", lambda store, *most: (looked.append(most), whole(store, *most))[1])
    store = Store(tmp_path / "stages", most_bytes=1_000_000)
    for number in range(40):
        with store.fill(f"s-{number:x}") as filling:
            assert filling is not None
            (filling.folder / "data").write_bytes(bytes(2000))
    assert len(looked) in range(8, 12)  # 80,000 bytes and their seals, after each 10,000
    assert len(store.sizes()) == 40
