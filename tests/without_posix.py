"""Hide what only POSIX systems have, then run `physgen`: python without_posix.py COMMAND ...

Stands in for a machine with Windows: `physgen` then takes its other way for locks, processes, signals and memory.
"""

from __future__ import annotations

import sys

# on Linux these use what is hidden below while they are imported
import numpy
import psutil

HIDDEN_MODULES = ("fcntl", "grp", "pwd", "resource", "termios", "tty")
HIDDEN_NAMES = {
    "os": (
        "chown", "fork", "forkpty", "getegid", "geteuid", "getgid", "getloadavg", "getpgid", "getuid", "killpg",
        "mkfifo", "nice", "sched_getaffinity", "setpgid", "setsid", "statvfs", "sysconf", "uname", "wait4",
    ),
    "signal": ("ITIMER_REAL", "SIGALRM", "SIGHUP", "SIGPIPE", "SIGUSR1", "SIGXFSZ", "alarm", "setitimer"),
}  # fmt: skip


def hide_posix() -> None:
    """Make imports of POSIX modules fail, and remove POSIX names from the others."""
    assert numpy
    assert psutil
    for name in HIDDEN_MODULES:
        sys.modules[name] = None  # type: ignore[assignment]
    for module, names in HIDDEN_NAMES.items():
        for name in names:
            vars(__import__(module)).pop(name, None)


if __name__ in ("__main__", "__mp_main__"):  # and in each process that it starts
    hide_posix()

if __name__ == "__main__":
    from physgen.__main__ import main

    sys.exit(main())
