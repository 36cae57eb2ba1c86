"""Run work in child processes, with results in the order of the items. A dead process
is replaced.

A free process takes the next item, at most `AHEAD` items per process beyond the oldest
unfinished one, so that memory does not grow with the number of items.
"""

from __future__ import annotations

import pickle
import signal
import sys
import time
from collections.abc import Callable, Generator, Iterable
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from threading import Thread
from typing import Any, Generic, TypeVar

from physgen.batch.worker_process import start_worker
from physgen.environment import keep_freed_memory
from physgen.operating_system import is_parent_running, terminate_self
from physgen.signals import install_handler

Item = TypeVar("Item")
Result = TypeVar("Result")

AHEAD = 16
"""Maximum number of items per process ahead of the oldest unfinished one."""
TRIES = 2
"""Attempts for an item. If the process dies twice, the item itself is the cause."""
GRACE = 1.4
"""Time for a process to remove its partial files, s."""
PARENT_CHECK = 0.2
"""Interval between checks of the parent process, s."""


class LostError(Exception):
    """The process of an item died at each attempt."""


class Child:
    """A process for one item after the other; `work` must be importable.

    Ctrl-C reaches only the parent, and the parent ends its children.
    """

    def __init__(self, work: Callable[[Any], Any]) -> None:
        self.line, child_end = Pipe()
        self._process = start_worker(child_main, child_end)
        self.send(work)

    def send(self, item: Any) -> None:
        """Send an item to the process."""
        # If the process died while idle, `receive` notices.
        with suppress(OSError):
            self.line.send(item)

    def receive(self) -> Any:
        """Return the result of the last item. Raise the error of the work, or LostError
        if the process died.
        """
        try:
            result, error = self.line.recv()
        except (EOFError, OSError):
            code = self._process.wait() or 0
            names = {int(item): item.name for item in signal.Signals}
            if code < 0:
                state = f"ended by {names.get(-code, -code)}"
            else:
                state = f"ended with exit code {code}"
            raise LostError(f"its process {'was ' * (code < 0)}{state}") from None
        if error is not None:
            raise error
        return result

    def stop(self) -> None:
        """Ask the process to end at once."""
        self._process.terminate()
        self.line.close()

    def end(self, until: float) -> None:
        """Wait for the end until a time of the monotonic clock, then kill the
        process.
        """
        if self._process.wait(max(0.0, until - time.monotonic())) is None:
            self._process.kill()
            self._process.wait()


@dataclass(frozen=True)
class Attempt(Generic[Item]):
    """One attempt of a process to do an item."""

    number: int
    """Number of the item, from 0."""
    item: Item
    attempts: int
    """Number of attempts, this one included."""


class Queue(Generic[Item, Result]):
    """Items in the work of several processes, and their results in order."""

    def __init__(
        self, work: Callable[[Item], Result], items: Iterable[Item], workers: int
    ) -> None:
        self._work = work
        self._source = enumerate(items)
        self._workers = workers
        self._idle: list[Child] = []
        self._busy: dict[Any, tuple[Child, Attempt[Item]]] = {}
        """Line -> process, and the item of its work."""
        self._retries: list[Attempt[Item]] = []
        self._next_number = 0

    @property
    def is_busy(self) -> bool:
        """Return whether a process works."""
        return bool(self._busy)

    def start(self, due: int) -> None:
        """Give items to idle processes; `due` is the number of the next result."""
        while len(self._busy) < self._workers:
            attempt = self._next_attempt(due)
            if attempt is None:
                return
            child = self._idle.pop() if self._idle else Child(self._work)
            self._busy[child.line] = child, attempt
            child.send(attempt.item)

    def _next_attempt(self, due: int) -> Attempt[Item] | None:
        """Return the next item of work; None if there is none yet."""
        if self._retries:
            attempt = self._retries.pop()
            return replace(attempt, attempts=attempt.attempts + 1)
        # Results far ahead of the next one would only fill the memory.
        if self._next_number >= due + AHEAD * self._workers:
            return None
        for number, item in self._source:
            self._next_number += 1
            return Attempt(number, item, 1)
        return None

    def collect(
        self,
        results: dict[int, Result],
        lost_result: Callable[[Item, LostError], Result],
    ) -> None:
        """Wait for processes, and add their results by number."""
        for line in wait(list(self._busy)):
            child, attempt = self._busy.pop(line)
            try:
                results[attempt.number] = child.receive()
                self._idle.append(child)
            except LostError as error:
                if attempt.attempts < TRIES:
                    self._retries.append(attempt)
                else:
                    results[attempt.number] = lost_result(attempt.item, error)
            except BaseException:
                self._idle.append(child)
                raise

    def close(self) -> None:
        """End all processes."""
        children = [*self._idle, *(child for child, _ in self._busy.values())]
        for child in children:
            child.stop()
        until = time.monotonic() + GRACE
        for child in children:
            child.end(until)


def run_parallel(
    work: Callable[[Item], Result],
    items: Iterable[Item],
    workers: int,
    lost_result: Callable[[Item, LostError], Result],
) -> Generator[Result, None, None]:
    """Yield `work(item)` for each item in order, or `lost_result(item, error)` if its process
    died at each attempt.

    A single worker is this process. Several workers are child processes: `work`, items and results are
    pickled, and an exception of `work` is raised here. A caller must close the
    generator to stop early; this ends the processes.
    """
    if workers <= 1:
        yield from map(work, items)
        return
    results: dict[int, Result] = {}
    due = 0
    with closing(Queue(work, items, workers)) as queue:
        while True:
            queue.start(due)
            if due in results:
                yield results.pop(due)
                due += 1
            elif queue.is_busy:
                queue.collect(results, lost_result)
            else:
                return


def child_main(line: Connection, parent: int) -> None:
    """Run a child process; `parent` is the process id of its parent."""
    keep_freed_memory()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))
    install_handler()
    Thread(target=_watch_parent, args=(parent,), daemon=True).start()
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        work = line.recv()
        while True:
            item = line.recv()
            try:
                answer: tuple[Any, Exception | None] = work(item), None
            except Exception as error:
                answer = None, error
            line.send_bytes(_pickle_result(answer))


def _pickle_result(answer: tuple[Any, Exception | None]) -> bytes:
    """Return the pickled answer, or a RuntimeError with the reason if pickling
    fails.
    """
    try:
        data = pickle.dumps(answer)
        # Some exceptions can be pickled but not read again.
        pickle.loads(data)
    except Exception as error:
        cause = answer[1] or error
        return pickle.dumps((None, RuntimeError(f"{type(cause).__name__}: {cause}")))
    return data


def _watch_parent(parent: int) -> None:
    """Stop this process after the end of its parent: nobody needs the results then."""
    while is_parent_running(parent):
        time.sleep(PARENT_CHECK)
    terminate_self()
