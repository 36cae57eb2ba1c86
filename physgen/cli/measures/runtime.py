"""`physgen evaluate runtime`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.arguments import count
from physgen.cli.measures.output import add_output, hand_over
from physgen.cli.output import Bar, print_problem
from physgen.problems import InputError

ABOUT = "What each stage takes, from the records of clips or from runs made now."
EXAMPLE = "runtime out --measure -o out/runtime"
PHOTO = Path("scenes/billiards/photo.png")


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "folders", metavar="DIR", nargs="*", type=Path, help="folders of clips, whose manifests are read"
    )
    parser.add_argument(
        "--measure",
        metavar="PHOTO",
        nargs="?",
        const=PHOTO,
        type=Path,
        help=f"perceive and render a photo now, offline; default: {PHOTO}",
    )
    parser.add_argument("--repeat", metavar="N", type=count, default=3, help="runs of --measure; default: 3")
    add_output(parser, "write a page in this folder")


def run(options: argparse.Namespace) -> int:
    from physgen.environment import gpu, this_machine
    from physgen.evaluate.measure import check_folder
    from physgen.evaluate.runtime import findings, measure, read_runs

    check_folder(options.output)
    if not options.folders and options.measure is None:
        fix = "name folders of clips, or add --measure"
        raise InputError.of("evaluate runtime", "", "was given no records", fix)
    runs = read_runs(options.folders, print_problem) if options.folders else []
    if options.measure is not None:
        bar = Bar()
        runs += measure(options.measure, options.repeat, bar.show)
        bar.clear()
    graphics = gpu()
    found = findings(runs, f"{this_machine()}{f', {graphics}' if graphics else ', no GPU'}")
    return hand_over(found, options)
