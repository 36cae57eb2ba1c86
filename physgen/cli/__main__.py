"""`python -m physgen.cli`, understood for one version more; write `python -m physgen`."""

from __future__ import annotations

import sys

from physgen.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
