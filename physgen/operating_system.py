"""What differs between operating systems: locks, processes, signals and memory.

All other modules call these functions and no function of POSIX. `fcntl` exists on every POSIX system and on no other,
so its absence selects the second way, which uses `psutil` and threads. Tests take it on Linux.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from _thread import interrupt_main
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import IO, TYPE_CHECKING, Any

try:
    import fcntl
    import resource
except ImportError:
    IS_POSIX = False
    import psutil  # a dependency on Windows alone
else:
    IS_POSIX = True

if TYPE_CHECKING:
    import subprocess

Handler = Callable[[int, "FrameType | None"], Any]
NEW_PROCESS_GROUP = 0x200
"""Windows' flag, as `subprocess` has it there."""
PATH_BYTES = 1024
"""Buffer that macOS fills with the path of an open file: MAXPATHLEN."""
RESET_PEAK = "5"
"""What Linux's /proc/self/clear_refs takes to set VmHWM to the memory of now."""
OTHER_USERS = 0o077
"""Permissions of a file's group and of everybody else."""


def open_standard_streams() -> None:
    """Open the null device for each standard stream that is closed.

    The next file or pipe would get its number, and what is printed would go there.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            stream = open(os.devnull, mode, encoding="utf-8")  # noqa: SIM115 - to the end
            setattr(sys, name, stream)


# --- files -----------------------------------------------------------------------------------------------------------


def open_file_path(descriptor: int) -> Path | None:
    """Return the absolute path of an open file, if Linux or macOS gives it."""
    link = f"/proc/self/fd/{descriptor}"
    if os.path.lexists(link):
        return Path(os.readlink(link))
    if sys.platform == "darwin":
        path = fcntl.fcntl(descriptor, fcntl.F_GETPATH, bytes(PATH_BYTES))
        return Path(os.fsdecode(path.partition(b"\0")[0]))
    return None


def lock_file(stream: IO[Any]) -> bool:
    """Lock an open file of a POSIX system until it is closed.

    Return False if another process holds it.
    """
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass  # this file system has no locks
    return True


def is_private(status: os.stat_result) -> bool:
    """Return whether a file belongs to this user alone.

    Elsewhere the folder's access list decides.
    """
    if not IS_POSIX:
        return True
    return status.st_uid == os.getuid() and not status.st_mode & OTHER_USERS


# --- the machine -----------------------------------------------------------------------------------------------------


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # Linux has it, macOS and Windows do not
        return os.cpu_count() or 1


def installed_memory() -> int | None:
    """Return the bytes of memory of the machine, or None if unknown."""
    try:
        size = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None if IS_POSIX else int(psutil.virtual_memory().total)
    return size if size > 0 else None


def reset_peak_memory() -> None:
    """Let `peak_memory` count from now on; other systems than Linux keep the peak of the whole process."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text(RESET_PEAK, encoding="ascii")


def peak_memory() -> int:
    """Return the most bytes that this process has held so far, or since `reset_peak_memory`.

    On Linux from /proc; `getrusage` there includes the process that started this one.
    """
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    if not IS_POSIX:
        memory = psutil.Process().memory_info()
        return int(getattr(memory, "peak_wset", memory.rss))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


# --- processes -------------------------------------------------------------------------------------------------------


def is_running(process: int) -> bool:
    """Return whether there is a process of this id, of any user."""
    if not IS_POSIX:  # there, `os.kill` ends the process whatever the signal
        return bool(psutil.pid_exists(process))
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass  # of another user
    return True


def is_parent_running(parent: int) -> bool:
    """Return whether the process that started this one is running."""
    return os.getppid() == parent if IS_POSIX else is_running(parent)


def terminate_self() -> None:
    """End this process from any of its threads, as `terminate` of another process does."""
    os.kill(os.getpid(), signal.SIGTERM)


def separate_session() -> dict[str, Any]:
    """Return the arguments of Popen for a process that Ctrl-C in this one's terminal does not reach."""
    if IS_POSIX:
        return {"start_new_session": True}
    return {"creationflags": NEW_PROCESS_GROUP if sys.platform == "win32" else 0}


def stop_process(process: subprocess.Popen[str]) -> None:
    """Ask a process of `separate_session` to end cleanly."""
    stop_signal = getattr(signal, "CTRL_BREAK_EVENT", signal.SIGTERM)
    try:
        process.send_signal(stop_signal)
    except OSError:  # it has ended, or has no console
        process.terminate()


def handle_termination(handler: Handler) -> None:
    """Call `handler` for each signal that asks a process to end, apart from Ctrl-C.

    Only the main thread may.
    """
    for name in ("SIGTERM", "SIGBREAK"):  # the second one is what Windows has
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), handler)


# --- alarms ----------------------------------------------------------------------------------------------------------


def start_alarm(handler: Handler, delay: float, interval: float) -> Callable[[], None]:
    """Call `handler` in the main thread after `delay` s, then every `interval` s. Return a function that stops it.

    Raise ValueError if this is not the main thread, which alone gets signals.
    """
    if hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, handler)
        signal.setitimer(signal.ITIMER_REAL, delay, interval)
        return _stop_timer
    return _ThreadAlarm(handler, delay, interval).stop


def _stop_timer() -> None:
    signal.setitimer(signal.ITIMER_REAL, 0)


class _ThreadAlarm:
    """A thread that raises SIGINT in the main thread, which calls the handler in place of the one for Ctrl-C."""

    def __init__(self, handler: Handler, delay: float, interval: float) -> None:
        self._previous_handler = signal.signal(signal.SIGINT, handler)
        self._lock = threading.Lock()
        self._is_stopped = threading.Event()
        arguments = (delay, interval)
        threading.Thread(target=self._repeat, args=arguments, daemon=True).start()

    def _repeat(self, delay: float, interval: float) -> None:
        self._is_stopped.wait(delay)
        while True:
            with self._lock:
                if self._is_stopped.is_set():
                    return
                interrupt_main(signal.SIGINT)
            self._is_stopped.wait(interval)

    def stop(self) -> None:
        self._is_stopped.set()
        with self._lock:
            signal.signal(signal.SIGINT, self._previous_handler)
