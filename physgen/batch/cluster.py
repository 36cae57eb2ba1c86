"""Run work on a Dask cluster: connect to its scheduler, submit batches of items, return
results in order.

Only this module needs Dask.

Workers access the user's folders under the same paths, or exchange files through a
store (`batch.shipping`). A worker process does one item at a time.
"""

from __future__ import annotations

import json
import logging
import os
import pickle
import platform
import re
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from itertools import islice
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar

import dask
from distributed import (
    Client,
    Future,
    KilledWorker,
    LocalCluster,
    as_completed,
    default_client,
)
from distributed.comm import CommClosedError

from physgen.batch.shipping import Store, run_shipped
from physgen.batch.workers import LostError
from physgen.environment import keep_freed_memory
from physgen.messages import Message
from physgen.operating_system import available_cores
from physgen.pipeline.cache_keys import CODE, code_version
from physgen.problems import InputError
from physgen.report.record import versions

Item = TypeVar("Item")
Result = TypeVar("Result")
Versions = Mapping[str, str]

FLAG = "--cluster"
LOCAL = re.compile(r"local(?::(?P<workers>[1-9]\d{0,3}))?")
"""A cluster on this machine, with an optional number of processes."""
TIMEOUT = 10.0
"""Time for the answer of a scheduler and for the first worker, s."""
CLOSE_TIMEOUT = 2.0
"""Time for the client to close, s."""
BATCH_SECONDS = 1.0
"""Duration of a task, s. A task costs the scheduler about 1 ms, so that 1 s keeps its
share at 0.1 %.
"""
LARGEST_BATCH = 100
"""Maximum number of items in a task. If a worker dies, all of them are repeated."""
BATCHES_AHEAD = 4
"""Maximum number of batches per worker ahead of the oldest unfinished one."""
LONELY_TRIES = 2
"""Attempts for a suspect item without other tasks. At the first attempt, the scheduler
may still count a dead worker as alive, so that one attempt proves nothing.
"""
DASK_SETTINGS = {
    "distributed.worker.profile.enabled": False,
    # The clocks of 20 ms only warn of blocked loops; they cost 18 ms of CPU per second.
    "distributed.admin.tick.interval": "10s",
    "distributed.admin.tick.limit": "1h",
    "distributed.admin.system-monitor.interval": "10s",
    "distributed.comm.timeouts.connect": f"{TIMEOUT:g}s",
    # In a local cluster, two dead processes in a row mean a faulty item.
    "distributed.scheduler.allowed-failures": 1,
}
_ONE_AT_A_TIME = Lock()
"""Lock for one item at a time: the working folder belongs to the process, and a clip
uses all cores.
"""


@dataclass
class Batch:
    """Consecutive items of one task."""

    # Number of the first item.
    first: int
    items: list[Any]
    # Number of attempts without other tasks.
    lonely_tries: int


@dataclass
class BatchSize:
    """Number of items of the next task, from the durations of earlier tasks."""

    # Duration of one item.
    seconds: float = BATCH_SECONDS
    has_duration: bool = False

    def add(self, seconds: float, items: int) -> None:
        """Update the duration of an item. Each new batch weighs as much as all earlier
        ones together.
        """
        duration = seconds / items
        if self.has_duration:
            duration = (duration + self.seconds) / 2
        self.seconds, self.has_duration = duration, True

    @property
    def items(self) -> int:
        """Return the number of items with a total duration of about BATCH_SECONDS."""
        count = int(BATCH_SECONDS / max(self.seconds, BATCH_SECONDS / LARGEST_BATCH))
        return max(1, count)


@cache
def own_versions() -> Versions:
    """Return the versions of code and libraries. Equal versions give equal clips on one
    kind of processor.
    """
    code = {**code_version((*CODE, "batch")), **versions()}
    # The user's machine and the worker may differ: only their software must be the
    # same.
    code.pop("machine")
    return code


def run_batch(
    user_versions: Versions, folder: str, content: bytes
) -> tuple[bytes, float]:
    """Run a pickled function on pickled items, in the user's `folder`; called on a
    worker.

    Return the pickled results and their duration, s. Raise InputError if the worker has
    other versions or lacks the folder.
    """
    versions_here = own_versions()
    if versions_here != user_versions:
        raise _version_error(user_versions, versions_here)
    with _ONE_AT_A_TIME:
        _enter(folder)
        keep_freed_memory()
        work, items = pickle.loads(content)
        start = time.perf_counter()
        results = list(map(work, items))
        return pickle.dumps(results), time.perf_counter() - start


def _enter(folder: str) -> None:
    """Change to the user's working folder. Raise InputError."""
    if not folder:
        return
    try:
        os.chdir(folder)
    except OSError:
        raise Message.WORKER_LACKS_FOLDER.error(
            FLAG, f'"{folder}"', node=platform.node()
        ) from None


def _version_error(user_versions: Versions, worker_versions: Versions) -> InputError:
    """Return the error for a worker with other versions than the user's machine."""
    names = []
    for name in user_versions:
        if worker_versions.get(name) != user_versions[name]:
            names.append(name)
    # A hash of the sources explains less than the version of a library.
    if len(names) > 1 and "sources" in names:
        names.remove("sources")

    def text(version_map: Versions) -> str:
        return ", ".join(
            f"{name} {version_map.get(name, 'none')[:12]}" for name in names
        )

    worker_text = f"a worker on {platform.node()}"
    return Message.WORKER_VERSION.error(
        FLAG, worker_text, version=text(worker_versions), here=text(user_versions)
    )


def run_on_cluster(
    address: str,
    work: Callable[[Item], Result],
    items: Iterable[Item],
    lost_result: Callable[[Item, Exception], Result],
    *,
    ship: str | None = None,
    report: Callable[[str], None] = lambda text: None,
) -> Generator[Result, None, None]:
    """Yield `work(item)` for each item in order, or `lost_result(item, error)` if its workers
    died at each attempt.

    `ship` is the URL of a store for files, if the workers do not share the user's
    folders. `report` gets the reason of a wait. Raise InputError if there is no such
    cluster or a worker has other versions, ConnectionError if the scheduler is lost. A
    caller must close the generator to stop early; this cancels the tasks.
    """
    if ship is not None:
        yield from run_on_cluster(
            address, *run_shipped(Store(ship), work, items, lost_result), report=report
        )
        return
    with _connect(address) as client:
        try:
            client.wait_for_workers(1, timeout=TIMEOUT)
        except TimeoutError:
            report(f"{address}: has no workers yet; waiting for them")
        run = _ClusterRun(client, address, work, os.getcwd())
        try:
            yield from run.results(iter(items), lost_result)
        finally:
            run.cancel()


@dataclass
class _ClusterRun:
    """The tasks of one call of `run_on_cluster`."""

    client: Client
    address: str
    work: Callable[[Any], Any]
    folder: str
    size: BatchSize = field(default_factory=BatchSize)
    tasks: dict[Future, Batch] = field(default_factory=dict)
    suspects: list[Batch] = field(default_factory=list)
    """Single items from the tasks of dead workers. Another item may have been the
    cause, so each is tried again alone.
    """
    finished_results: dict[int, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # Not `with_results`: it never returns if a worker dies during the transfer.
        self.completed = as_completed(loop=self.client.loop)

    def results(
        self, source: Iterator[Item], lost_result: Callable[[Item, Exception], Result]
    ) -> Iterator[Result]:
        """Yield results in order. Submit at most BATCHES_AHEAD batches per worker
        beyond the oldest unfinished one.
        """
        due = count = 0
        while True:
            # The limit bounds the memory of finished results behind a slow item.
            limit = due + BATCHES_AHEAD * self._workers() * self.size.items
            while count < limit and not self.suspects:
                items = list(islice(source, self.size.items))
                if not items:
                    break
                self._submit(Batch(count, items, 0))
                count += len(items)
            # A suspect runs alone, so that only the suspect itself can end its worker.
            if self.suspects and not self.tasks:
                suspect = self.suspects.pop(0)
                suspect.lonely_tries += 1
                self._submit(suspect)
            if due == count:
                return
            for future in self.completed.next_batch(block=True):
                self._add_results(future, lost_result)
            while due in self.finished_results:
                yield self.finished_results.pop(due)
                due += 1

    def _add_results(
        self, future: Future, lost_result: Callable[[Any, Exception], Any]
    ) -> None:
        """Store the results of a task until their turn. Make suspects of its items if
        its worker died.
        """
        batch = self.tasks.pop(future)
        try:
            results = self._read(future, len(batch.items))
        except KilledWorker:
            # The batch may hold one guilty item among innocent ones: split it.
            if batch.lonely_tries < LONELY_TRIES:
                for number, item in enumerate(batch.items, batch.first):
                    self.suspects.append(Batch(number, [item], batch.lonely_tries))
                return
            results = [
                lost_result(batch.items[0], LostError("its workers died each time"))
            ]
        self.finished_results.update(enumerate(results, batch.first))

    def cancel(self) -> None:
        """Cancel all unfinished tasks."""
        with suppress(Exception):
            self.client.cancel(list(self.tasks), force=True)

    def _submit(self, batch: Batch) -> None:
        # Pickled here, so that a worker compares versions before it reads the items.
        content = pickle.dumps((self.work, batch.items))
        future = self.client.submit(
            run_batch, own_versions(), self.folder, content, pure=False
        )
        self.tasks[future] = batch
        self.completed.add(future)

    def _workers(self) -> int:
        """Return the number of worker processes, at least 1."""
        try:
            return max(1, len(self.client.nthreads()))
        except OSError:
            raise self._scheduler_error() from None

    def _read(self, future: Future, items: int) -> list[Any]:
        """Return the results of a task. Raise KilledWorker, or an error to end the
        run.
        """
        try:
            content, seconds = future.result()
        except (ModuleNotFoundError, AttributeError) as error:
            raise Message.WORKER_WITHOUT_PHYSGEN.error(
                FLAG, self.address, error=error
            ) from None
        except (CancelledError, CommClosedError):
            raise self._scheduler_error() from None
        self.size.add(seconds, items)
        results: list[Any] = pickle.loads(content)
        return results

    def _scheduler_error(self) -> ConnectionError:
        text = "the scheduler is gone; once it is back, run the same command again"
        return ConnectionError(f"{self.address}: {text}")


@contextmanager
def _connect(address: str) -> Iterator[Client]:
    """Yield a client of the scheduler at an address, of the scheduler in a FILE.json,
    or of a new local cluster.
    """
    with ExitStack() as stack:
        stack.enter_context(_quiet())
        stack.enter_context(dask.config.set(DASK_SETTINGS))
        local = LOCAL.fullmatch(address)
        if local is not None:
            cluster = LocalCluster(
                n_workers=int(local["workers"] or available_cores()),
                # Clips use several cores themselves, and worker threads would share one
                # working folder.
                threads_per_worker=1,
                memory_limit=None,
                dashboard_address=None,
                host="127.0.0.1",
                silence_logs=logging.CRITICAL,
            )
            stack.callback(_close, cluster)
            place = {"address": cluster.scheduler_address}
        # A client from the user's script has the right certificates, and must stay
        # open.
        else:
            current = _current_client(address)
            if current is not None:
                yield current
                return
            place = _scheduler_place(address)
        try:
            client = Client(**place, timeout=TIMEOUT, set_as_default=False)
        except (OSError, ValueError, TypeError, ImportError) as error:
            reason = str(error).split("\n")[0]
            raise Message.NO_SCHEDULER_ANSWERS.error(
                FLAG, f'"{address}"', timeout=TIMEOUT, reason=reason
            ) from None
        stack.callback(_close, client)
        yield client


def _current_client(address: str) -> Client | None:
    """Return the script's own client of this scheduler, if any."""
    try:
        client = default_client()
    except ValueError:
        return None
    if client.scheduler.address == address:
        return client
    return None


def _scheduler_place(address: str) -> dict[str, str]:
    """Return the keyword argument of `Client` for an address or a scheduler file. Raise
    InputError.
    """
    if not address.endswith(".json"):
        return {"address": address}
    path = Path(address).expanduser()
    if not path.is_file():
        raise Message.NOT_A_SCHEDULER_FILE.error(FLAG, f'"{address}"')
    try:
        scheduler = json.loads(path.read_text(encoding="utf-8"))["address"]
    except (OSError, ValueError, KeyError, TypeError):
        scheduler = None
    if not isinstance(scheduler, str):
        raise Message.NO_SCHEDULER_IN_FILE.error(FLAG, f'"{address}"')
    return {"scheduler_file": str(path)}


def _close(part: Any) -> None:
    """Close a client or a local cluster, and ignore errors."""
    with suppress(Exception):
        part.close(timeout=CLOSE_TIMEOUT)


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence logs and warnings of Dask; our own messages report its errors."""
    # Not restored: asyncio still logs after the end of the block.
    logging.getLogger("asyncio").setLevel(logging.CRITICAL + 1)
    disabled_level = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        finally:
            logging.disable(disabled_level)
