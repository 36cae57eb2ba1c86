"""`physgen evaluate physics`."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from physgen.cli.arguments import Parser, count, rows
from physgen.cli.measures.output import add_output, show
from physgen.cli.output import Bar

ABOUT = "Motion against closed forms."
EXAMPLE = "physics --rows 1,5,12"


def add(parser: Parser) -> None:
    about = (
        "a Python file or package that defines ROWS, closed forms of your own scenes; default: the engine's, "
        "benchmarks/physics of a checkout"
    )
    parser.add_argument("source", metavar="FORMS", nargs="?", type=Path, help=about)
    parser.option("--rows", "LIST", rows, "some rows, e.g. 1,5,12; default: all", [])
    parser.option("--draws", "N", count, "seeded draws of a row's parameters; default: 5", 5)
    parser.add_argument(
        "--no-convergence",
        action="store_true",
        help="only at default settings, not at 240 to 1920 steps a second",
    )
    add_output(parser, "keep every scene file that is run in this folder")
    parser.option("--jobs", "N", count, "draws run at a time; default: one a processor")


def run(options: argparse.Namespace) -> int:
    from physgen.evaluate import physics

    source = options.source or physics.ROWS
    bar = Bar()
    found = physics.evaluate(
        source,
        physics.choose(physics.load_rows(source), options.rows),
        options.draws,
        () if options.no_convergence else physics.STEPS,
        options.jobs or os.cpu_count() or 1,
        options.output,
        bar.show,
    )
    bar.clear()
    return show(physics.findings(found), options)
