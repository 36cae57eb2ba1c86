"""`--cluster` -> a client of a Dask cluster: one of this process's own, that of a scheduler, or Slurm's machines."""

from __future__ import annotations

import logging
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, Protocol

from physgen.problems import InputError

if TYPE_CHECKING:
    from distributed import Client

TIMEOUT = 10.0
"""s in which a scheduler must answer."""
PATIENCE, HURRY = 10.0, 1.0
"""s in which a client or a cluster of our own must close, and the same where somebody waits to be let go."""
INSTALL = "pip install 'physgen[cluster]'"
QUIET = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.limit": "1h",
    "distributed.comm.timeouts.connect": f"{TIMEOUT:g}s",
}
"""Of Dask's settings, while we use it: what it would look at, or tell of, is of no use here."""
OWN = {"distributed.scheduler.allowed-failures": 1}
"""Of a scheduler of our own: the third worker that a job may take along is one that has nothing else to do."""


class Closes(Protocol):
    """What has to be closed."""

    def close(self, timeout: float) -> object:
        """Within so many seconds, or raise."""


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
        from physgen.batch.cluster.slurm import slurm

        ours = slurm(workers) if "slurm" in kind else _local(workers)
        with dask.config.set(OWN), ours as cluster, _client(cluster) as client:
            yield client


@contextmanager
def closed(what: Closes) -> Iterator[Any]:
    """A client or a cluster, until the block ends."""
    patience = PATIENCE
    try:
        yield what
    except BaseException:
        patience = HURRY
        raise
    finally:
        with suppress(Exception):
            what.close(timeout=patience)


@contextmanager
def _quiet() -> Iterator[None]:
    """Dask logs what we tell in our own words, and much that nobody asked for; some of asyncio's comes at the end."""
    loggers = [logging.getLogger(name) for name in ("distributed", "tornado", "asyncio", "dask_jobqueue")]
    loggers += [
        logging.getLogger(name)
        for name in list(logging.root.manager.loggerDict)
        if name.startswith(("distributed.", "tornado.", "dask_jobqueue."))
    ]
    before = [(logger, logger.level) for logger in loggers if logger.name != "asyncio"]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        finally:
            for logger, level in before:
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
    with closed(client):
        yield client


@contextmanager
def _local(workers: int) -> Iterator[Any]:
    """As many workers in this process, each of which has its clips made by a process of its own."""
    from distributed import LocalCluster

    from physgen.batch.cluster.hands import end_all

    ours = LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=False,
        dashboard_address=None,
        memory_limit=0,
        silence_logs=logging.CRITICAL + 1,
    )
    try:
        with closed(ours) as cluster:
            yield cluster
    finally:
        end_all()
