"""Ctrl-C and termination signals that arrive while C code calls Python."""

from __future__ import annotations

import signal
import sys
from contextlib import suppress
from typing import NoReturn

SOON = 0.001
"""s."""


def install_handler() -> None:
    """From now on, in the main thread of this process."""
    before = sys.unraisablehook
    if getattr(before, "heeds", False):
        return

    def hook(told: sys.UnraisableHookArgs) -> None:
        wish = told.exc_value
        if not isinstance(wish, KeyboardInterrupt | SystemExit):
            before(told)
            return

        def again(number: int, frame: object) -> NoReturn:
            raise wish.with_traceback(None)

        with suppress(ValueError):  # another thread: signals are none of its business
            signal.signal(signal.SIGALRM, again)
            signal.setitimer(signal.ITIMER_REAL, SOON)

    hook.heeds = True  # type: ignore[attr-defined]
    sys.unraisablehook = hook
