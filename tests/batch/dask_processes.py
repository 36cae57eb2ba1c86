"""A Dask scheduler and workers as users start them: processes of the commands `dask scheduler` and `dask worker`."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from distributed import Client

PATIENCE = 180
"""s: far longer than a slow machine takes, so that a test fails and none hangs."""


def wait_until(
    is_done: Callable[[], bool], process: subprocess.Popen[bytes] | None = None
) -> None:
    until = time.monotonic() + PATIENCE
    while not is_done():
        assert process is None or process.poll() is None, "the process ended"
        assert time.monotonic() < until, "waited in vain"
        time.sleep(0.02)


@contextmanager
def alarm(seconds: int = 2 * PATIENCE) -> Iterator[None]:
    """Let what takes longer fail, wherever it waits in the main thread."""

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
    """A scheduler, and workers that can be started and killed."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.file = folder, folder / "scheduler.json"
        self.workers: list[subprocess.Popen[bytes]] = []
        command = "dask_scheduler", "--scheduler-file", str(self.file), "--port", "0"
        self.scheduler = self._start(*command, "--host", "127.0.0.1", "--no-show")
        wait_until(self._has_scheduler, self.scheduler)

    def _has_scheduler(self) -> bool:
        try:
            return bool(json.loads(self.file.read_text())["address"])
        except (OSError, ValueError, KeyError):
            return False

    @property
    def address(self) -> str:
        return json.loads(self.file.read_text())["address"]

    def _start(self, module: str, *flags: str) -> subprocess.Popen[bytes]:
        settings = {
            "PYTHONPATH": os.pathsep.join(sys.path),
            "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1",
            "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "null",
        }
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.{module}", *flags],
            cwd=self.folder,
            env={**os.environ, **settings},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def add_worker(self) -> None:
        """Start a worker, which has registered when this returns."""
        flags = ["--scheduler-file", str(self.file), "--nthreads", "1", "--no-nanny"]
        flags += ["--no-dashboard", "--local-directory", str(self.folder)]
        worker = self._start("dask_worker", *flags)
        self.workers.append(worker)
        with Client(self.address, set_as_default=False) as client:
            count = len(self.workers)
            wait_until(lambda: len(client.nthreads()) >= count, worker)

    def have_workers(self, count: int) -> None:
        """Start workers until so many are alive."""
        self.workers = [worker for worker in self.workers if worker.poll() is None]
        while len(self.workers) < count:
            self.add_worker()

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@contextmanager
def cluster(folder: Path) -> Iterator[Cluster]:
    made = Cluster(folder)
    try:
        yield made
    finally:
        made.close()
