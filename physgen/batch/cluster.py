"""Make clips on a Dask cluster: connect to its scheduler, submit jobs, collect results in order.

Workers see the user's folders. A worker makes one clip at a time.
"""

from __future__ import annotations

import logging
import os
import pickle
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from threading import Lock
from typing import TYPE_CHECKING, Any

from physgen.batch.resume import CODE
from physgen.batch.run import MANIFEST, Done, Job, failed, run
from physgen.batch.workers import AHEAD, LostError
from physgen.files import install
from physgen.pipeline.cache_keys import code_version
from physgen.problems import InputError
from physgen.report.record import versions

if TYPE_CHECKING:
    from distributed import Client, Future

TIMEOUT = 10.0
"""s in which a scheduler must answer."""
NO_WORKER_NOTICE = 10.0
"""s without any worker after which that is reported."""
CLOSE_TIMEOUT = 1.0
"""s in which the client must close."""
SAME_VERSIONS = "install the same on both"
DASK_SETTINGS = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.limit": "1h",
    "distributed.comm.timeouts.connect": f"{TIMEOUT:g}s",
}

Versions = Mapping[str, str]
_ONE_AT_A_TIME = Lock()
"""The working folder belongs to the process, and a clip uses all of its cores."""


@cache
def own_versions() -> Versions:
    """Versions of the code, libraries and processor; clips are equal where these are."""
    return {**code_version((*CODE, "batch")), **versions()}


def run_here(expected: Versions, folder: str, job: bytes) -> Done:
    """What a worker does: makes the clip of a pickled Job whose paths are relative to the user's `folder`.

    Raises InputError where the clip would differ, or where the worker does not see the folder.
    """
    ours = own_versions()
    if ours != expected:
        raise _version_error(expected, ours)
    with _ONE_AT_A_TIME:
        try:
            os.chdir(folder)
        except OSError:
            found = f"is not there on a worker, {os.uname().nodename}"
            fix = "run this from a folder that workers share"
            raise InputError.of("--cluster", f'"{folder}"', found, fix) from None
        return run(pickle.loads(job))


def _version_error(theirs: Versions, ours: Versions) -> InputError:
    """`theirs` are the user's, `ours` the worker's."""
    names = [name for name in dict.fromkeys((*ours, *theirs)) if ours.get(name) != theirs.get(name)]
    if len(names) > 1 and "sources" in names:
        names.remove("sources")  # a hash, which explains less than the other versions

    def text(found: Versions) -> str:
        return ", ".join(f"{name} {found.get(name, 'none')[:12]}" for name in names)

    expected = f"has {text(ours)}, and here is {text(theirs)}: its clips would not be the same"
    return InputError.of("--cluster", f"a worker on {os.uname().nodename}", expected, SAME_VERSIONS)


def run_on_cluster(
    where: str, jobs: Iterable[Job], report: Callable[[str], None] = lambda text: None
) -> Generator[Done, None, None]:
    """Results in the order of the jobs, from the cluster that `--cluster` names.

    `report` gets what there is to wait for. Raises InputError where there is no such cluster or the clips of a worker
    would differ, OSError where the scheduler is lost. A caller that stops early must close the generator.
    """
    with _connected(where) as client:
        try:
            client.wait_for_workers(1, timeout=NO_WORKER_NOTICE)
        except TimeoutError:
            report(f"{where}: has no workers yet; waiting for them")
        yield from _results(client, where, iter(jobs))


def _results(client: Client, where: str, jobs: Iterator[Job]) -> Iterator[Done]:
    """Submits at most AHEAD jobs a thread beyond the oldest unfinished one; more where workers join."""
    from distributed import as_completed

    answers = as_completed(loop=client.loop, with_results=True, raise_errors=False)
    under_way: dict[Future, tuple[int, Job]] = {}
    ended: dict[int, Done] = {}
    due = count = 0
    try:
        while True:
            limit = due + AHEAD * _threads(client, where)
            while count < limit and (job := next(jobs, None)) is not None:
                future = client.submit(run_here, own_versions(), os.getcwd(), pickle.dumps(job), pure=False)
                under_way[future] = count, job
                answers.add(future)
                count += 1
            if due == count:
                return
            for future, result in answers.next_batch(block=True):
                number, job = under_way.pop(future)
                ended[number] = _done(job, future, result, where)
            while due in ended:
                yield ended.pop(due)
                due += 1
    finally:
        with suppress(Exception):
            client.cancel(list(under_way), force=True)


def _threads(client: Client, where: str) -> int:
    """Clips that the cluster makes at a time, at least 1."""
    try:
        return max(1, int(sum(client.nthreads().values())))
    except OSError:
        raise _lost(where) from None


def _lost(where: str) -> ConnectionError:
    return ConnectionError(f"{where}: the scheduler is gone; once it is back, run the same command again")


def _done(job: Job, future: Future, result: Any, where: str) -> Done:
    """The result of a job. Raises what ends the run."""
    from distributed import KilledWorker

    if isinstance(result, Done):
        if result.folder is None or (result.folder / MANIFEST).is_file():
            return result
        fix = "choose a folder with -o that workers share"
        return failed(
            job, InputError.of(str(result.folder), "", "was made, and cannot be seen from here", fix)
        )
    if future.status != "error":
        raise _lost(where)
    error = result[1]
    if isinstance(error, KilledWorker):
        return failed(job, LostError("its workers died each time"))
    if isinstance(error, ModuleNotFoundError | AttributeError):
        found = f"has no physgen, or another one ({error})"
        raise InputError.of("--cluster", where, found, SAME_VERSIONS)
    raise error


@contextmanager
def _connected(where: str) -> Iterator[Client]:
    """A client of the scheduler `dask=ADDRESS` or `dask=FILE.json`."""
    try:
        import dask
        from distributed import Client
    except ImportError:
        found = "needs Dask, which is not installed"
        raise InputError.of("--cluster", f'"{where}"', found, install("cluster")) from None
    address = os.path.expanduser(where.removeprefix("dask="))
    with _quiet(), dask.config.set(DASK_SETTINGS):
        is_file = address.endswith(".json")
        if is_file and not os.path.exists(address):
            fix = "start it: dask scheduler --scheduler-file FILE.json"
            raise InputError.of("--cluster", f'"{address}"', "is no scheduler file", fix)
        named = {"scheduler_file": address} if is_file else {"address": address}
        try:
            client = Client(**named, timeout=TIMEOUT, set_as_default=False)
        except (OSError, ValueError, TypeError, ImportError) as error:  # a time-out is an OSError
            fix = "see that it runs, and that this machine may reach it; dask scheduler starts one"
            reason = str(error).split("\n")[0]
            found = f"is no scheduler that answers within {TIMEOUT:g} s ({reason})"
            raise InputError.of("--cluster", f'"{address}"', found, fix) from None
        try:
            yield client
        finally:
            with suppress(Exception):
                client.close(timeout=CLOSE_TIMEOUT)


@contextmanager
def _quiet() -> Iterator[None]:
    """Silences logs and warnings of Dask, whose errors are reported in our own words."""
    logging.getLogger("asyncio").setLevel(logging.CRITICAL + 1)  # for good: it still logs after the block
    disabled = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        finally:
            logging.disable(disabled)
