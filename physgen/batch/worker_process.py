"""Processes that run a function of a module, with a connection to the process that started them."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Protocol

from physgen.operating_system import IS_POSIX, separate_session

WorkerMain = Callable[[Connection, int], None]
"""Main function of a worker: its connection, and the id of the process that started it."""


class Worker(Protocol):
    """A process that runs a function; it has its own session, so that Ctrl-C reaches this process only."""

    def terminate(self) -> None:
        """Ask the process to end, at once."""

    def kill(self) -> None:
        """Stop the process."""

    def wait(self, timeout: float | None = None) -> int | None:
        """Wait until it ends. Return its exit code, minus the number of a signal, or None if it still runs."""


def start_worker(target: WorkerMain, connection: Connection) -> Worker:
    """Start a process that calls `target`, a function of a module, with `connection`. The caller's copy is closed."""
    try:
        if IS_POSIX:
            return _CommandWorker(target, connection)
        return _SpawnedWorker(target, connection)
    finally:
        connection.close()


class _CommandWorker:
    """A Python command with the connection's file descriptor: it does not import the user's `__main__`."""

    def __init__(self, target: WorkerMain, connection: Connection) -> None:
        paths = [name or os.getcwd() for name in sys.path]
        number = connection.fileno()
        code = (
            f"import sys; sys.path[:] = {paths!r}\n"
            "from multiprocessing.connection import Connection\n"
            f"from {target.__module__} import {target.__name__} as main\n"
            f"main(Connection({number}), {os.getpid()})"
        )
        self._process = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.DEVNULL,
            pass_fds=[number],
            **separate_session(),
        )
        self.terminate = self._process.terminate
        self.kill = self._process.kill

    def wait(self, timeout: float | None = None) -> int | None:
        try:
            return self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            return None


class _SpawnedWorker:
    """A process of `multiprocessing`, started anew as on systems that cannot copy a process."""

    def __init__(self, target: WorkerMain, connection: Connection) -> None:
        arguments = (connection, os.getpid())
        context = get_context("spawn")
        self._process = context.Process(target=target, args=arguments, daemon=True)
        self._process.start()
        self.terminate = self._process.terminate
        self.kill = self._process.kill

    def wait(self, timeout: float | None = None) -> int | None:
        self._process.join(timeout)
        return self._process.exitcode
