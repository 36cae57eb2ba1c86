"""Ctrl-C and termination signals that arrive while C code calls Python.

An exception that Python raises in a callback of C code is printed and lost, and C continues with a wrong result. The
physics engine is such code. A lost interrupt is therefore raised again after a moment, until Python's own code gets it.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from types import FrameType

from physgen.operating_system import start_alarm

DELAY = 0.001
"""s after which a lost interrupt is raised again."""
INTERVAL = 0.01
"""s after which that is tried again, until it is raised."""


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
            # until the hook has ended, an error that is raised in it is lost, too
            if frame is None:
                stop_alarm()
                raise error.with_traceback(None)

        with suppress(ValueError):  # not the main thread, which alone gets signals
            stop_alarm = start_alarm(again, DELAY, INTERVAL)

    hook.is_ours = True  # type: ignore[attr-defined]
    sys.unraisablehook = hook
