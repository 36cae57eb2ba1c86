"""Workers as jobs of Slurm, by dask-jobqueue -> a cluster that a client may be made of."""

from __future__ import annotations

import logging
import shutil
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from physgen.batch.cluster.hired import INSTALL, closed
from physgen.problems import InputError


@contextmanager
def slurm(workers: int) -> Iterator[Any]:
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

    with closed(cluster):
        try:
            cluster.sync(ask)
        except (OSError, RuntimeError, ValueError) as error:
            for job in cluster.workers.values():  # closing the cluster waits for those that seem to begin
                job.status = Status.failed if job.status is Status.created else job.status
            raise _refused(error) from None
        yield cluster


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
