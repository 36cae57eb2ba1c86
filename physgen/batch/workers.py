"""Run work in child processes: results in the order of the items; a process that dies is replaced.

Items are pulled as processes get free, and at most `AHEAD` per process further than the oldest unfinished one, so that
memory does not grow with their number.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from threading import Thread
from typing import Any, Generic, TypeVar

from physgen.signals import install_handler

Item = TypeVar("Item")
Result = TypeVar("Result")

AHEAD = 16
"""Items per process that may be under way or done while an older one is not."""
TRIES = 2
"""How often an item is begun: what kills its process twice is the item itself."""
GRACE = 1.4
"""s that a process gets to remove what it was writing."""
PARENT_CHECK = 0.2
"""s between checks whether the parent process is alive."""


class LostError(Exception):
    """The process of an item died, each time that it was tried."""


class Child:
    """A process that works on one item after the other; `work` must be importable.

    It has a session of its own, so that Ctrl-C reaches the parent only, which ends it.
    """

    def __init__(self, work: Callable[[Any], Any]) -> None:
        self.line, theirs = Pipe()
        self.number: int | None = None
        """Of the item that it works on; None: idle."""
        paths = [name or os.getcwd() for name in sys.path]
        code = (
            f"import sys; sys.path[:] = {paths!r}\n"
            f"from physgen.batch.workers import child_main; child_main({theirs.fileno()}, {os.getpid()})"
        )
        # no multiprocessing.Process: a Dask worker is a daemonic process, which may have none
        self._process = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            start_new_session=True,
        )
        theirs.close()
        self.send(work)

    def send(self, item: Any) -> None:
        """Hands it an item."""
        with suppress(OSError):  # where it died while idle, `receive` notices
            self.line.send(item)

    def receive(self) -> Any:
        """The result of the last item. Raises what the work raised, or LostError where the process died."""
        try:
            result, error = self.line.recv()
        except (EOFError, OSError):
            self.line.close()
            self.end()
            raise LostError(_describe_exit(self._process.returncode)) from None
        if error is not None:
            raise error
        return result

    def stop(self) -> None:
        """An idle process ends by itself when the line is closed; a busy one is terminated."""
        if self.number is not None:
            self._process.terminate()
        self.line.close()

    def end(self, until: float | None = None) -> None:
        """Waits until it has ended; kills it where that takes too long."""
        try:
            self._process.wait(GRACE if until is None else max(0.0, until - time.monotonic()))
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def end_children(children: Iterable[Child]) -> None:
    """Ends all of them together."""
    ending = list(children)
    for child in ending:
        child.stop()
    until = time.monotonic() + GRACE
    for child in ending:
        child.end(until)


def run_parallel(
    work: Callable[[Item], Result],
    items: Iterable[Item],
    workers: int,
    lost: Callable[[Item, LostError], Result],
) -> Generator[Result, None, None]:
    """`work(item)` for each item, in order; `lost(item, error)` where its process died each time.

    One worker is this process. Several are child processes: `work`, items and results are pickled, and what `work`
    raises is raised here. A caller that stops early must close the generator, which ends the processes.
    """
    if workers <= 1:
        yield from map(work, items)
        return
    pool = _Pool(work, iter(items), workers, lost)
    try:
        yield from pool.results()
    finally:
        end_children(pool.children)


class _Pool(Generic[Item, Result]):
    def __init__(
        self,
        work: Callable[[Item], Result],
        items: Iterator[Item],
        workers: int,
        lost: Callable[[Item, LostError], Result],
    ) -> None:
        self._work, self._items, self._workers, self._lost = work, items, workers, lost
        self.children: list[Child] = []
        self._begun: dict[int, tuple[Item, int]] = {}
        """Number -> item and how often it was begun."""
        self._again: list[int] = []
        """Numbers of items whose process died."""
        self._count = 0
        """Items pulled."""
        self._done: dict[int, Result] = {}

    def results(self) -> Iterator[Result]:
        due = 0
        while True:
            self._hand_out(due)
            while due in self._done:
                yield self._done.pop(due)
                due += 1
                self._hand_out(due)
            busy = {child.line: child for child in self.children if child.number is not None}
            if not busy and due == self._count:
                return
            for line in wait(list(busy)):
                assert isinstance(line, Connection)
                self._take(busy[line])

    def _hand_out(self, due: int) -> None:
        """Gives every idle process an item, and starts processes while there are too few."""
        while True:
            idle = next((child for child in self.children if child.number is None), None)
            if idle is None and len(self.children) >= self._workers:
                return
            number = self._next(due + AHEAD * self._workers)
            if number is None:
                return
            if idle is None:
                idle = Child(self._work)
                self.children.append(idle)
            idle.number = number
            idle.send(self._begun[number][0])

    def _next(self, limit: int) -> int | None:
        """The number of an item to begin now, below `limit`; items whose process died come first."""
        if self._again:
            number = self._again.pop(0)
            item, tries = self._begun[number]
            self._begun[number] = item, tries + 1
            return number
        if self._count < limit:
            for item in self._items:
                self._begun[self._count] = item, 1
                self._count += 1
                return self._count - 1
        return None

    def _take(self, child: Child) -> None:
        """Stores the result of a process, or notices its death."""
        number = child.number
        assert number is not None
        item, tries = self._begun[number]
        child.number = None
        try:
            self._done[number] = child.receive()
        except LostError as error:
            self.children.remove(child)
            if tries < TRIES:
                self._again.append(number)
                return
            self._done[number] = self._lost(item, error)
        del self._begun[number]


def _describe_exit(code: int | None) -> str:
    if code is not None and code < 0:
        with suppress(ValueError):
            return f"its process was ended by {signal.Signals(-code).name}"
    return f"its process ended with exit code {code}"


def child_main(number: int, parent: int) -> None:
    """Main function of a Child: `number` is the file descriptor of its line, `parent` the process that asks."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))
    install_handler()
    Thread(target=_watch_parent, args=(parent,), daemon=True).start()
    line = Connection(number)
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        work = line.recv()
        while True:
            item = line.recv()
            try:
                answer: tuple[Any, Exception | None] = work(item), None
            except Exception as error:
                answer = None, error
            line.send_bytes(_pickled(answer))


def _pickled(answer: tuple[Any, Exception | None]) -> bytes:
    """The answer; where it cannot be pickled, a RuntimeError that says why."""
    try:
        data = pickle.dumps(answer)
        pickle.loads(data)
    except Exception as error:
        cause = answer[1] or error
        return pickle.dumps((None, RuntimeError(f"{type(cause).__name__}: {cause}")))
    return data


def _watch_parent(parent: int) -> None:
    """Ends this process when the parent is gone: nobody waits for its results."""
    while os.getppid() == parent:
        time.sleep(PARENT_CHECK)
    os.kill(os.getpid(), signal.SIGTERM)
