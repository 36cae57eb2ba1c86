"""Ctrl-C, and a signal that ends a process, where C code calls Python -> heeded all the same.

What Python raises in a callback of C code goes no further: it is printed, and C goes on, with a wrong answer. The
engine is such code. So a wish to stop that is lost that way comes again a moment later, until it meets Python's own.
"""

from __future__ import annotations

import signal
import sys
from contextlib import suppress
from typing import NoReturn

SOON = 0.001
"""s."""


def heeded() -> None:
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
