"""The command `physgen`, and `python -m physgen`."""

from __future__ import annotations

import sys

INTERRUPTED = 130
"""Exit code, as of a shell."""


def main() -> int:
    """The command line; Ctrl-C while it is imported ends it without a traceback, too."""
    try:
        from physgen.cli.main import main as run

        return run()
    except KeyboardInterrupt:
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
