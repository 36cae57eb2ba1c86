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
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from threading import Thread
from typing import Any, TypeVar

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
            state = (
                f"ended by {names.get(-code, -code)}"
                if code < 0
                else f"ended with exit code {code}"
            )
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
    source = enumerate(items)
    idle: list[Child] = []
    busy: dict[Any, tuple[Child, int, Item, int]] = {}
    """Line -> process, number of its item, item, attempts."""
    retries: list[tuple[int, Item, int]] = []
    results: dict[int, Result] = {}
    due = next_item = 0
    try:
        while True:
            while len(busy) < workers:
                if retries:
                    number, item, tries = retries.pop()
                elif (
                    next_item < due + AHEAD * workers
                    and (entry := next(source, None)) is not None
                ):
                    (number, item), tries = entry, 0
                    next_item += 1
                else:
                    break
                child = idle.pop() if idle else Child(work)
                busy[child.line] = child, number, item, tries + 1
                child.send(item)
            if due in results:
                yield results.pop(due)
                due += 1
                continue
            if not busy:
                return
            for line in wait(list(busy)):
                child, number, item, tries = busy.pop(line)
                try:
                    results[number] = child.receive()
                    idle.append(child)
                except LostError as error:
                    if tries < TRIES:
                        retries.append((number, item, tries))
                    else:
                        results[number] = lost_result(item, error)
                except BaseException:
                    idle.append(child)
                    raise
    finally:
        ending = [*idle, *(child for child, *_ in busy.values())]
        for child in ending:
            child.stop()
        until = time.monotonic() + GRACE
        for child in ending:
            child.end(until)


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
