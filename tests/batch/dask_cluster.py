"""A Dask scheduler in the tests' process, and workers as users start them: processes of the `dask worker` command."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from distributed import LocalCluster

PATIENCE = 180
"""s."""


def waited(
    done: Callable[[], bool], process: subprocess.Popen[bytes] | None = None, seconds: float = PATIENCE
) -> None:
    """Until it is; far longer than a slow machine takes, so that a test fails and none hangs."""
    until = time.monotonic() + seconds
    while not done():
        assert process is None or process.poll() is None, "the process ended"
        assert time.monotonic() < until, "waited in vain"
        time.sleep(0.02)


@contextmanager
def alarmed(seconds: int = 2 * PATIENCE) -> Iterator[None]:
    """What takes longer fails, wherever it waits in the main thread."""

    def stop(number: int, frame: object) -> None:
        pytest.fail(f"took longer than {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


class Cluster:
    """Workers may be hired, and killed."""

    def __init__(self, scheduler: LocalCluster, folder: Path) -> None:
        self._scheduler, self._folder = scheduler, folder
        self.workers: list[subprocess.Popen[bytes]] = []

    @property
    def flag(self) -> str:
        return f"dask={self._scheduler.scheduler_address}"

    @property
    def scheduler(self):
        return self._scheduler.scheduler

    def lose(self) -> None:
        """The scheduler goes, as on a machine that is switched off."""
        self._scheduler.close(timeout=10)

    def hire(self) -> None:
        """One more worker, which has registered when this returns."""
        before = len(self.scheduler.workers)
        command = [sys.executable, "-m", "distributed.cli.dask_worker", self._scheduler.scheduler_address]
        command += ["--nthreads", "1", "--no-dashboard", "--no-nanny", "--local-directory", str(self._folder)]
        worker = subprocess.Popen(
            command,
            cwd=self._folder,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self.workers.append(worker)
        waited(lambda: len(self.scheduler.workers) > before, worker)

    def staff(self, count: int) -> None:
        """At least so many workers, and none that is dead."""
        self.workers = [worker for worker in self.workers if worker.poll() is None]
        waited(lambda: len(self.scheduler.workers) <= len(self.workers))
        while len(self.workers) < count:
            self.hire()


@contextmanager
def cluster(folder: Path) -> Iterator[Cluster]:
    scheduler = LocalCluster(
        n_workers=0,
        processes=True,
        dashboard_address=None,
        host="127.0.0.1",
        silence_logs=logging.CRITICAL,
    )
    made = Cluster(scheduler, folder)
    try:
        yield made
    finally:
        for worker in made.workers:
            worker.kill()
            worker.wait()
        scheduler.close(timeout=5)
