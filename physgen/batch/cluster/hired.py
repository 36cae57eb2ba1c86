"""`--cluster` -> a client of a Dask cluster: one of this process's own, that of a scheduler, or Slurm's machines."""

from __future__ import annotations

import logging
import os
import shutil
import signal
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from physgen.problems import InputError

if TYPE_CHECKING:
    from distributed import Client

TIMEOUT = 10.0
"""s in which a scheduler must answer."""
CLOSING = 1.0
"""s in which one of our own must close."""
INSTALL = "pip install 'physgen[cluster]'"
QUIET = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.limit": "1h",
    "distributed.comm.timeouts.connect": f"{TIMEOUT:g}s",
}
"""Of Dask's settings, while we use it: what it would look at, or tell of, is of no use here."""
OWN = {"distributed.scheduler.allowed-failures": 1}
"""Of a scheduler of our own: the third worker that a job may take along is one that has nothing else to do."""


@contextmanager
def hired(where: str, workers: int) -> Iterator[Client]:
    """A client, closed when the block ends, with what we started; `where` is as `flags.clusters.cluster` allows it.

    Raises InputError where Dask is not installed, no scheduler answers, or Slurm cannot be asked.
    """
    try:
        import dask
        import distributed  # noqa: F401
    except ImportError:
        raise InputError.of(
            "--cluster", f'"{where}"', "needs Dask, which is not installed", INSTALL
        ) from None
    kind, _, address = where.partition("=")
    address = os.path.expanduser(address)
    with _quiet(), dask.config.set(QUIET):
        if address:
            with _client(address) as client:
                yield client
            return
        ours = _slurm(workers) if "slurm" in kind else _local(workers)
        with dask.config.set(OWN), ours as cluster, _client(cluster) as client:
            yield client


@contextmanager
def _quiet() -> Iterator[None]:
    """Dask logs what we tell in our own words, and much that nobody asked for."""
    loggers = [logging.getLogger(name) for name in ("distributed", "tornado", "asyncio", "dask_jobqueue")]
    loggers += [
        logging.getLogger(name)
        for name in list(logging.root.manager.loggerDict)
        if name.startswith(("distributed.", "tornado.", "dask_jobqueue."))
    ]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        finally:
            for logger, level in zip(loggers, before, strict=True):
                logger.setLevel(level)


@contextmanager
def _client(cluster: Any) -> Iterator[Client]:
    """Of a cluster of ours, or of a scheduler's address or file, which is left alone when the block ends."""
    from distributed import Client

    try:
        if isinstance(cluster, str) and cluster.endswith(".json"):
            if not os.path.exists(cluster):
                fix = "start it: dask scheduler --scheduler-file FILE.json"
                raise InputError.of("--cluster", f'"{cluster}"', "is no scheduler file", fix)
            client = Client(scheduler_file=cluster, timeout=TIMEOUT, set_as_default=False)
        else:
            client = Client(cluster, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError) as error:  # a time-out is an OSError
        fix = "see that it runs, and that this machine may reach it; dask scheduler starts one"
        found = str(error).split("\n")[0]
        expected = f"is no scheduler that answers within {TIMEOUT:g} s"
        raise InputError.of("--cluster", f'"{cluster}"', f"{expected} ({found})", fix) from None
    try:
        yield client
    finally:
        with suppress(Exception):
            client.close(timeout=CLOSING)


@contextmanager
def _local(workers: int) -> Iterator[Any]:
    """As many workers in this process, each of which has its clips made by a process of its own."""
    from distributed import LocalCluster

    from physgen.batch.cluster.hands import end_all

    cluster = LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=False,
        dashboard_address=None,
        memory_limit=0,
        silence_logs=logging.CRITICAL + 1,
    )
    try:
        yield cluster
    finally:
        with suppress(Exception):
            cluster.close(timeout=CLOSING)
        end_all()


@contextmanager
def _slurm(workers: int) -> Iterator[Any]:
    """As many workers in jobs of Slurm; what kind of jobs is for Dask's own settings to say."""
    from distributed.core import Status

    if shutil.which("sbatch") is None:
        fix = "run this on a machine of the cluster, or name a scheduler: --cluster dask=tcp://HOST:8786"
        raise InputError.of("--cluster", '"slurm"', "needs Slurm, and there is no sbatch on the PATH", fix)
    try:
        cluster = slurm_cluster()
    except ImportError:
        expected = "needs dask-jobqueue, which is not installed"
        raise InputError.of("--cluster", '"slurm"', expected, INSTALL) from None
    except (OSError, RuntimeError, TypeError, ValueError) as error:
        raise _refused(error) from None

    async def ask() -> None:
        cluster.scale(workers)
        await cluster._correct_state()  # by itself it would tell nobody that Slurm said no

    try:
        try:
            cluster.sync(ask)
        except (OSError, RuntimeError, ValueError) as error:
            for job in cluster.workers.values():  # closing the cluster waits for those that seem to begin
                job.status = Status.failed if job.status is Status.created else job.status
            raise _refused(error) from None
        yield cluster
    finally:
        with suppress(Exception):
            cluster.close(timeout=CLOSING)


@contextmanager
def _signals_kept() -> Iterator[None]:
    """dask-jobqueue, once imported, would have Ctrl-C end the program without a word, as if all were well."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    with suppress(ValueError):  # not the main thread: then it could not set any, either
        for number, handler in before.items():
            signal.signal(number, handler)


def _refused(error: Exception) -> InputError:
    said = " ".join(str(error).rpartition("stderr:")[2].split())
    fix = "see jobqueue.slurm in Dask's settings, e.g. ~/.config/dask/jobqueue.yaml"
    return InputError.of("--cluster", '"slurm"', f"gives no workers ({said})", fix)


def slurm_cluster() -> Any:
    """As `jobqueue.slurm` of Dask's settings says; jobs of one worker, of one core and 4 GB, where it does not."""
    import dask

    with _signals_kept():
        from dask_jobqueue import SLURMCluster

    otherwise = {"cores": 1, "processes": 1, "memory": "4GB"}
    settings = {k: v for k, v in otherwise.items() if dask.config.get(f"jobqueue.slurm.{k}", None) is None}
    return SLURMCluster(scheduler_options={"dashboard": False}, silence_logs=logging.CRITICAL + 1, **settings)
