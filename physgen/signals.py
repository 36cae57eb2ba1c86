"""Ctrl-C and termination signals that arrive while C code calls Python.

An exception that Python raises in a callback of C code is printed and lost, and C continues with a wrong result. The
physics engine is such code. A lost interrupt is therefore raised again after a moment, until Python's own code gets it.
"""

from __future__ import annotations

import signal
import sys
from contextlib import suppress
from types import FrameType

DELAY = 0.001  # s after which a lost interrupt is raised again


def install_handler() -> None:
    """Raises lost interrupts again, in the main thread of this process."""
    before = sys.unraisablehook
    if getattr(before, "is_ours", False):
        return

    def hook(unraisable: sys.UnraisableHookArgs) -> None:
        error = unraisable.exc_value
        if not isinstance(error, KeyboardInterrupt | SystemExit):
            before(unraisable)
            return

        def again(number: int, frame: FrameType | None) -> None:
            while frame is not None and frame.f_code is not hook.__code__:
                frame = frame.f_back
            if (
                frame is None
            ):  # else the hook has not ended, and what is raised in it is lost too
                signal.setitimer(signal.ITIMER_REAL, 0)
                raise error.with_traceback(None)

        with suppress(ValueError):  # not the main thread, which alone gets signals
            signal.signal(signal.SIGALRM, again)
            signal.setitimer(
                signal.ITIMER_REAL, DELAY, 0.01
            )  # and again, until it is raised

    hook.is_ours = True  # type: ignore[attr-defined]
    sys.unraisablehook = hook
