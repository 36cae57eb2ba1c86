"""`physgen evaluate fidelity`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from physgen.cli.arguments import names
from physgen.cli.measures.output import hand_over
from physgen.cli.output import Bar

ABOUT = "Frames against the studio's truth videos; ends with 1 below the bar that docs/fidelity.md tells."
EXAMPLE = "fidelity --scenes curling,shelf"


def scenes(text: str) -> list[str]:
    """`curling,shelf`, one at least."""
    found = names(text)
    if not found:
        raise argparse.ArgumentTypeError("it names no scene; write e.g. curling,shelf")
    return found


def add(parser: argparse.ArgumentParser) -> None:
    """Where truth lies, and which scenes of it."""
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
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="write a page with a plot and strips of frames in this folder: the paper's way, ours and the truth",
    )


def run(options: argparse.Namespace) -> int:
    from physgen.evaluate import fidelity as measure
    from physgen.evaluate.fidelity_told import findings
    from physgen.evaluate.measure import Section, check_folder

    check_folder(options.output)
    if options.output:
        from physgen.report.plots.style import require_matplotlib

        require_matplotlib()
    bar = Bar()
    result = measure.evaluate(options.truth, options.scenes, bar.show)
    told = findings(result)
    if options.output:
        from physgen.evaluate.fidelity_told import plot, strips

        first, *rest = told.sections
        frames = Section("Frames", (), tuple(strips(measure.truths(options.truth, options.scenes))))
        told = replace(
            told, sections=(replace(first, parts=(*first.parts, plot(result["rows"]))), *rest, frames)
        )
    bar.clear()
    return hand_over(told, options)
