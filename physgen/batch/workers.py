"""Work and items -> results in the order of the items, made by several processes; a process that dies is replaced.

Items are pulled as workers get free, and no further ahead of the oldest unfinished one than `AHEAD` a worker: the
memory that this takes does not grow with their number. Workers leave Ctrl-C to this process, which ends them.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from threading import Thread
from typing import Generic, TypeVar

from physgen.signals import install_handler

Item = TypeVar("Item")
Result = TypeVar("Result")

AHEAD = 16
"""Items a worker that may be under way or done while an older one is not."""
TRIES = 2
"""Times that an item is begun: whatever kills its worker twice is the item itself."""
GRACE = 1.4
"""s that workers get to clear away what they were writing."""
LOOK = 0.2
"""s between looks whether the process that asked is alive."""


class LostError(Exception):
    """The worker of an item died, each time that it was tried."""


@dataclass(eq=False)
class _Worker(Generic[Item, Result]):
    process: BaseProcess
    line: Connection
    number: int | None = None
    """Of the item that it is at; None: idle."""


@dataclass
class _Queue(Generic[Item]):
    """What is still to be handed out: items that came back first."""

    fresh: Iterator[Item]
    again: list[int] = field(default_factory=list)
    begun: dict[int, tuple[Item, int]] = field(default_factory=dict)
    """Number -> item and how often it was begun."""
    count: int = 0

    def next(self, limit: int) -> int | None:
        """The number of an item to begin now, below `limit`; None: there is none."""
        if self.again:
            number = self.again.pop(0)
            item, tries = self.begun[number]
            self.begun[number] = item, tries + 1
            return number
        if self.count >= limit:
            return None
        for item in self.fresh:
            self.begun[self.count] = item, 1
            self.count += 1
            return self.count - 1
        return None


def run_parallel(
    work: Callable[[Item], Result],
    items: Iterable[Item],
    workers: int,
    lost: Callable[[Item, LostError], Result],
) -> Generator[Result, None, None]:
    """`work(item)` for each, in order; `lost(item, error)` where its process died each time.

    One worker is this process. Several are processes of their own, so `work`, items and results are pickled, and what
    `work` raises is raised here. Whoever stops early must close the iterator, which ends the workers.
    """
    if workers <= 1:
        yield from map(work, items)
        return
    queue: _Queue[Item] = _Queue(iter(items))
    done: dict[int, Result] = {}
    crew: list[_Worker[Item, Result]] = []
    due = 0
    try:
        while True:
            _hand_out(queue, crew, workers, due + AHEAD * workers, work)
            while due in done:
                yield done.pop(due)
                due += 1
                _hand_out(queue, crew, workers, due + AHEAD * workers, work)
            busy = [worker for worker in crew if worker.number is not None]
            if not busy and due == queue.count:
                break
            ready = wait([part for worker in busy for part in (worker.line, worker.process.sentinel)])
            for worker in busy:
                if worker.line in ready or worker.process.sentinel in ready:
                    _take(worker, queue, crew, done, lost)
    finally:
        _end(crew)


def _hand_out(
    queue: _Queue[Item],
    crew: list[_Worker[Item, Result]],
    workers: int,
    limit: int,
    work: Callable[[Item], Result],
) -> None:
    """Give every idle worker an item, and hire while there are fewer than `workers`."""
    while True:
        idle = next((worker for worker in crew if worker.number is None), None)
        if idle is None and len(crew) >= workers:
            return
        number = queue.next(limit)
        if number is None:
            return
        if idle is None:
            idle = _hired(work)
            crew.append(idle)
        idle.number = number
        with suppress(OSError):  # it died while idle: noticed where its answer is waited for
            idle.line.send(queue.begun[number][0])


def _take(
    worker: _Worker[Item, Result],
    queue: _Queue[Item],
    crew: list[_Worker[Item, Result]],
    done: dict[int, Result],
    lost: Callable[[Item, LostError], Result],
) -> None:
    """What a worker answers, or that it is dead."""
    number = worker.number
    assert number is not None
    try:
        result, error = worker.line.recv()
    except (EOFError, OSError):
        crew.remove(worker)
        _end([worker])
        item, tries = queue.begun[number]
        if tries < TRIES:
            queue.again.append(number)
            return
        code = worker.process.exitcode
        result, error = lost(item, LostError(reason(code))), None
    else:
        worker.number = None
    if error is not None:
        raise error
    del queue.begun[number]
    done[number] = result


def reason(code: int | None) -> str:
    """How a process ended, in words."""
    if code is not None and code < 0:
        with suppress(ValueError):
            return f"its process was ended by {signal.Signals(-code).name}"
    return f"its process ended with exit code {code}"


def _hired(work: Callable[[Item], Result]) -> _Worker[Item, Result]:
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=serve, args=(theirs, work, os.getpid()), daemon=True)
    # until it ignores Ctrl-C itself, it inherits that nobody tells it of one
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    theirs.close()
    return _Worker(process, ours)


def _end(crew: list[_Worker[Item, Result]]) -> None:
    """Idle ones go by themselves, busy ones are told to; who does not listen is killed."""
    for worker in crew:
        if worker.number is not None:
            worker.process.terminate()
        worker.line.close()
    until = time.monotonic() + GRACE
    for worker in crew:
        worker.process.join(max(0.0, until - time.monotonic()))
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join()


def serve(line: Connection, work: Callable[[Item], Result], parent: int) -> None:
    """A worker's life: an item, its result, the next one; until nobody asks any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))
    install_handler()
    Thread(target=_follow, args=(parent,), daemon=True).start()
    while True:
        try:
            item = line.recv()
        except (EOFError, OSError):
            return
        try:
            answer: tuple[Result | None, Exception | None] = work(item), None
        except Exception as error:
            answer = None, error
        try:
            line.send_bytes(_pickled(answer))
        except (BrokenPipeError, ConnectionResetError):
            return


def _pickled(answer: object) -> bytes:
    """What comes back as it was; where it would not, why."""
    try:
        data = pickle.dumps(answer)
        pickle.loads(data)
    except Exception as error:
        told = answer[1] if isinstance(answer, tuple) and answer[1] is not None else error
        return pickle.dumps((None, RuntimeError(f"{type(told).__name__}: {told}")))
    return data


def _follow(parent: int) -> None:
    """Who asked is gone, killed perhaps: nobody waits for the answer, and the next run shall not meet us."""
    while os.getppid() == parent:
        time.sleep(LOOK)
    os.kill(os.getpid(), signal.SIGTERM)
