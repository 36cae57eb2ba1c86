"""`physgen evaluate fidelity`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from physgen.cli.arguments import Parser, some_names
from physgen.cli.measures.output import add_output, hand_over
from physgen.cli.output import Bar

ABOUT = "Frames against the studio's truth videos; ends with 1 below the bar in docs/fidelity.md."
EXAMPLE = "fidelity --scenes curling,shelf"


def add(parser: Parser) -> None:
    truth = "studio/truth"
    parser.option("--truth", "DIR", Path, f"the studio's truth; default: {truth}", Path(truth))
    parser.option("--scenes", "LIST", some_names, "some scenes, e.g. curling,shelf", [])
    add_output(parser, "write a page with strips of frames in this folder")


def run(options: argparse.Namespace) -> int:
    from physgen.evaluate import fidelity
    from physgen.evaluate.measure import Section, check_folder

    check_folder(options.output, plots=True)
    bar = Bar()
    result = fidelity.evaluate(options.truth, options.scenes, bar.show)
    found = fidelity.findings(result)
    if options.output:
        sheets = tuple(fidelity.strips(fidelity.truths(options.truth, options.scenes)))
        found = replace(found, sections=(*found.sections, Section("Frames", (), sheets)))
    bar.clear()
    return hand_over(found, options)
