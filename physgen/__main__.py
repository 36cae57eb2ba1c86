"""The command `physgen`, and `python -m physgen`."""

from __future__ import annotations

import atexit
import gc
import os
import sys
import threading

from physgen.operating_system import open_standard_streams

INTERRUPTED = 130
"""Exit code, as of a shell."""
NEW_OBJECTS = 120_000
"""After so many, unused cycles of objects are looked for; a short clip makes 106,000, most of them by imports. At
Python's 700 that takes 6 % of such a clip, at 20,000 it takes 3 %."""


def main() -> int:
    """Run the command line; Ctrl-C during its import ends it without a traceback, too."""
    open_standard_streams()
    gc.set_threshold(NEW_OBJECTS)
    threads = {"OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"}
    is_evaluation = "evaluate" in sys.argv[1:2]
    if not threads & os.environ.keys() and not is_evaluation:
        # Matrices are small: more threads for them only wait, busily.
        os.environ["OPENBLAS_NUM_THREADS"] = "1"
    try:
        from physgen.cli.main import main as run
        from physgen.environment import keep_freed_memory

        keep_freed_memory()
        return _end(run())
    except KeyboardInterrupt:
        return INTERRUPTED


def _end(code: int) -> int:
    """Stop the process at once if nothing runs or waits to be written: taking modules apart is 4 % of a clip."""
    active_threads = [thread for thread in threading.enumerate() if not thread.daemon]
    if len(active_threads) > 1 or sys.getprofile():
        return code
    atexit._run_exitfuncs()
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (AttributeError, OSError, ValueError):
        # A stream is closed or full: Python's own end reports it.
        return code
    os._exit(code)


if __name__ == "__main__":
    sys.exit(main())
