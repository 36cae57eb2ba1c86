"""A Dask scheduler in the tests' process, and workers as users start them: processes of the `dask worker` command."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import dask
from distributed import LocalCluster

ALLOWED = {"distributed.scheduler.allowed-failures": 0}
"""The first worker that dies of a job is told to the client."""


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

    def hire(self, *flags: str) -> subprocess.Popen[bytes]:
        """One more worker, which has registered when this returns."""
        before = len(self.scheduler.workers)
        command = [sys.executable, "-m", "distributed.cli.dask_worker", self._scheduler.scheduler_address]
        command += ["--nthreads", "1", "--no-dashboard", "--no-nanny", "--local-directory", str(self._folder)]
        worker = subprocess.Popen(
            [*command, *flags],
            cwd=self._folder,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self.workers.append(worker)
        until = time.monotonic() + 60
        while len(self.scheduler.workers) <= before and time.monotonic() < until:
            assert worker.poll() is None
            time.sleep(0.02)
        return worker

    def staff(self, count: int) -> None:
        """At least so many workers, and none that is dead."""
        self.workers = [worker for worker in self.workers if worker.poll() is None]
        until = time.monotonic() + 60
        while len(self.scheduler.workers) > len(self.workers) and time.monotonic() < until:
            time.sleep(0.02)
        while len(self.workers) < count:
            self.hire()

    def dismiss(self, worker: subprocess.Popen[bytes]) -> None:
        worker.send_signal(signal.SIGKILL)
        worker.wait()
        self.staff(0)


@contextmanager
def cluster(folder: Path) -> Iterator[Cluster]:
    with dask.config.set(ALLOWED):
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


def hands_of(worker: int) -> list[int]:
    """Processes that make clips for it."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdecimal() and b"cluster.hands" in (entry / "cmdline").read_bytes():
                told = (entry / "stat").read_text().rpartition(")")[2].split()
                if int(told[1]) == worker and told[0] != "Z":
                    found.append(int(entry.name))
        except OSError:
            continue
    return found
