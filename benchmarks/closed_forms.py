"""Motion against closed forms: the rows of benchmarks/physics, run on the engine, and a table of errors.

python benchmarks/closed_forms.py                                   # all; exit code 1 where a bar is missed
python benchmarks/closed_forms.py --rows 1,5,12 --no-convergence    # some, at default settings alone
python benchmarks/closed_forms.py -o DIR                            # and keep every scene that is run
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from physics import ROWS
from physics.scorecard import DRAWS, STEPS, choose, evaluate, findings

from physgen.cli.evaluate import show
from physgen.problems import InputError


def main(arguments: list[str] | None = None) -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--rows", default="", help="some rows, e.g. 1,5,12; default: all"
    )
    parser.add_argument(
        "--draws", type=int, default=DRAWS, help="seeded draws of a row's parameters"
    )
    parser.add_argument(
        "--no-convergence", action="store_true", help="only at default settings"
    )
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="draws run at a time"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        help="keep every scene file that is run in this folder",
    )
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    steps = () if options.no_convergence else STEPS
    try:
        rows = choose(
            ROWS, [int(number) for number in options.rows.split(",") if number]
        )
        return show(
            findings(
                evaluate(rows, options.draws, steps, options.jobs, options.output)
            ),
            options,
        )
    except InputError as error:
        parser.error(str(error))


if __name__ == "__main__":
    sys.exit(main())
