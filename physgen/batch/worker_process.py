"""Start processes that run one function with a connection to their parent."""

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
"""Main function of a worker, with its connection and the id of the parent process."""


class Worker(Protocol):
    """A process with its own session, so that Ctrl-C reaches only the parent."""

    def terminate(self) -> None:
        """Ask the process to end at once."""

    def kill(self) -> None:
        """Stop the process."""

    def wait(self, timeout: float | None = None) -> int | None:
        """Wait for the end. Return the exit code, a negative signal number, or None if
        the process still runs.
        """


def start_worker(target: WorkerMain, connection: Connection) -> Worker:
    """Start a process for `target`, a module-level function, with `connection`,
    and close the caller's copy.
    """
    try:
        if IS_POSIX:
            return _CommandWorker(target, connection)
        return _SpawnedWorker(target, connection)
    finally:
        connection.close()


class _CommandWorker:
    """A Python command with the connection's file descriptor. It does not import the
    user's `__main__`.
    """

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
    """A process of `multiprocessing` with a new interpreter, for systems other than
    POSIX.
    """

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
