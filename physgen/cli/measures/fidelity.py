"""`physgen evaluate fidelity`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from physgen.cli.arguments import names
from physgen.cli.measures.output import add_output, hand_over
from physgen.cli.output import Bar

ABOUT = "Frames against the studio's truth videos; ends with 1 below the bar in docs/fidelity.md."
EXAMPLE = "fidelity --scenes curling,shelf"


def scenes(text: str) -> list[str]:
    """`curling,shelf`, one at least."""
    found = names(text)
    if not found:
        raise argparse.ArgumentTypeError("it names no scene; write e.g. curling,shelf")
    return found


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--truth",
        metavar="DIR",
        type=Path,
        default=Path("studio/truth"),
        help="the studio's truth; default: studio/truth",
    )
    parser.add_argument(
        "--scenes",
        metavar="LIST",
        type=scenes,
        default=[],
        help="some scenes, e.g. curling,shelf",
    )
    add_output(
        parser,
        "write a page with a plot and strips of frames in this folder",
    )


def run(options: argparse.Namespace) -> int:
    from physgen.evaluate import fidelity
    from physgen.evaluate.measure import Section, check_folder

    check_folder(options.output, plots=True)
    bar = Bar()
    result = fidelity.evaluate(options.truth, options.scenes, bar.show)
    found = fidelity.findings(result)
    if options.output:
        sheets = tuple(fidelity.strips(fidelity.truths(options.truth, options.scenes)))
        found = found.with_parts({found.sections[0].title: (fidelity.plot(result["rows"]),)}, first=False)
        found = replace(found, sections=(*found.sections, Section("Frames", (), sheets)))
    bar.clear()
    return hand_over(found, options)
