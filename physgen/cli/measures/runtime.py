"""`physgen evaluate runtime`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.measures.output import add_output, hand_over
from physgen.cli.output import print_problem

ABOUT = "What each stage takes, from the records of clips."
EXAMPLE = "runtime out -o out/runtime"


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "folders", metavar="DIR", nargs="+", type=Path, help="folders of clips, whose manifests are read"
    )
    add_output(parser, "write a page in this folder")


def run(options: argparse.Namespace) -> int:
    from physgen.environment import gpu, this_machine
    from physgen.evaluate.measure import check_folder
    from physgen.evaluate.runtime import findings, read_runs

    check_folder(options.output)
    runs = read_runs(options.folders, print_problem)
    graphics = gpu()
    found = findings(runs, f"{this_machine()}{f', {graphics}' if graphics else ', no GPU'}")
    return hand_over(found, options)
