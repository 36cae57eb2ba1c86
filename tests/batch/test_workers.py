"""Work spread over processes: the results of a plain loop, in its order, whatever happens to the processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from physgen.batch import worker_process
from physgen.batch.workers import AHEAD, LostError, run_parallel


@pytest.fixture(autouse=True, params=[True, False], ids=["posix", "other"])
def _system(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both ways to start a process."""
    monkeypatch.setattr(worker_process, "IS_POSIX", request.param)


def slow_when_odd(item: int) -> tuple[int, int]:
    time.sleep(0.03 * (item % 2))
    return item * item, os.getpid()


def fatal_once(marks: Path, item: int) -> int:
    mark = marks / f"{item}"
    if item in (2, 5) and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return item


def fatal(item: int) -> int:
    if item == 3:
        os._exit(7)
    return item


def faulty(item: int) -> int:
    if item == 1:
        raise LookupError("no such thing")
    return item


def naps(folder: Path, item: int) -> int:
    (folder / f"{item}.{os.getpid()}").touch()
    time.sleep(30)
    return item


def never(item: int, error: LostError) -> int:
    raise AssertionError(item)


class SingularError(Exception):
    def __init__(self, one: str, other: str) -> None:
        super().__init__(one)
        self.other = other


def strange(item: int) -> object:
    if item == 1:
        raise SingularError("a", "b")  # it pickles, and does not come back
    return (lambda: item) if item == 2 else item  # does not pickle


def told(item: int, error: LostError) -> str:
    return f"{item}: {error}"


def test_results_come_in_the_order_of_the_items_from_several_processes() -> None:
    got = list(run_parallel(slow_when_odd, range(12), 2, never))
    assert [square for square, _ in got] == [n * n for n in range(12)]
    processes = {process for _, process in got}
    assert len(processes) == 2
    assert os.getpid() not in processes


def test_one_worker_is_this_process() -> None:
    assert {
        process for _, process in run_parallel(slow_when_odd, range(3), 1, never)
    } == {os.getpid()}


def test_items_are_pulled_as_workers_get_free() -> None:
    pulled = []

    def items() -> Iterator[int]:
        for n in range(1000):
            pulled.append(n)
            yield n

    results = run_parallel(slow_when_odd, items(), 2, never)
    assert not pulled
    for n in range(4):
        next(results)
        assert len(pulled) <= n + 1 + 2 * AHEAD
    results.close()  # type: ignore[attr-defined]
    assert len(pulled) < 100


def test_an_item_whose_process_is_killed_is_tried_again(tmp_path: Path) -> None:
    assert list(
        run_parallel(partial(fatal_once, tmp_path), range(8), 2, never)
    ) == list(range(8))
    assert {path.name for path in tmp_path.iterdir()} == {"2", "5"}


def test_an_item_that_kills_its_process_twice_is_lost_and_no_other() -> None:
    got = list(run_parallel(fatal, range(6), 2, told))
    assert got == [0, 1, 2, "3: its process ended with exit code 7", 4, 5]


def test_what_work_raises_is_raised_here() -> None:
    with pytest.raises(LookupError, match="no such thing"):
        list(run_parallel(faulty, range(4), 2, never))


@pytest.mark.parametrize(
    ("items", "said"), [([0, 1], "SingularError: a"), ([0, 2], "pickle")]
)
def test_what_cannot_be_handed_back_is_told_as_it_is(
    items: list[int], said: str
) -> None:
    with pytest.raises(RuntimeError, match=said):
        list(run_parallel(strange, items, 2, never))


def test_who_stops_early_leaves_no_process_behind(tmp_path: Path) -> None:
    results = run_parallel(partial(naps, tmp_path), range(4), 2, never)
    with pytest.raises(KeyboardInterrupt):
        _interrupted(results, tmp_path)
    assert _all_gone(tmp_path)


def _interrupted(results: Iterator[int], folder: Path) -> None:
    """As Ctrl-C would while results are waited for, when both processes are at work."""

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    def wait() -> None:
        until = time.monotonic() + 60
        while len(list(folder.iterdir())) < 2 and time.monotonic() < until:
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGUSR1)

    before = signal.signal(signal.SIGUSR1, interrupt)
    try:
        threading.Thread(target=wait, daemon=True).start()
        next(results)
    finally:
        signal.signal(signal.SIGUSR1, before)


def test_workers_of_a_killed_process_end(tmp_path: Path) -> None:
    code = (
        "from functools import partial; from pathlib import Path; import test_workers as t;"
        "from physgen.batch.workers import run_parallel;"
        f"list(run_parallel(partial(t.naps, Path({str(tmp_path)!r})), range(4), 2, t.never))"
    )
    run = subprocess.Popen(
        [sys.executable, "-c", f"if __name__ == '__main__':\n exec({code!r})"],
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path]),
        },
    )
    until = time.monotonic() + 60
    while len(list(tmp_path.iterdir())) < 2 and time.monotonic() < until:
        time.sleep(0.05)
    run.kill()
    run.wait()
    assert len(list(tmp_path.iterdir())) == 2
    assert _all_gone(tmp_path)


def _all_gone(folder: Path) -> bool:
    numbers = [int(path.suffix[1:]) for path in folder.iterdir()]
    until = time.monotonic() + 20
    while any(_lives(number) for number in numbers) and time.monotonic() < until:
        time.sleep(0.05)
    return bool(numbers) and not any(_lives(number) for number in numbers)


def _lives(process: int) -> bool:
    """One that has ended but whose parent has not asked how is no more alive."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"
