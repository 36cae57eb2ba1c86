"""`evaluate physics`."""

from __future__ import annotations

import argparse
import sys

from physgen.cli.printing import FAILED, OK, Bar, print_json, tell_kept


def physics(options: argparse.Namespace) -> int:
    import os

    from physgen.evaluate import physics, table

    bar = Bar()
    scores = physics.evaluate(
        physics.choose(options.rows),
        options.draws,
        () if options.no_convergence else physics.STEPS,
        options.jobs or os.cpu_count() or 1,
        options.output,
        bar.show,
        tell_kept,
    )
    bar.clear()
    result = {"rows": [score.as_dict() for score in scores], "passed": all(score.passed for score in scores)}
    if options.json:
        print_json(result)
    else:
        sys.stdout.write(table.markdown(result) if options.markdown else table.text(result))
    return OK if result["passed"] else FAILED
