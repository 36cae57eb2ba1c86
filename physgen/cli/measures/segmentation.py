"""`physgen evaluate segmentation`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.arguments import Parser, part
from physgen.cli.measures.output import add_output, hand_over
from physgen.cli.output import Bar, print_problems
from physgen.problems import InputError

ABOUT = "Objects found in photos against their true masks, as COCO counts them."
EXAMPLE = "segmentation photos -o out/segmentation --recall 0.8"


def add(parser: Parser) -> None:
    about = (
        "photos with label maps: NAME.png and NAME.labels.png, or folders of photo.png and photo.assets/masks.png; or "
        "a COCO file (*.json) with its photos"
    )
    parser.add_argument("folder", metavar="FOLDER", type=Path, help=about)
    parser.option("--backend", "ROLE=NAME", str, "what segments: segment=NAME", [], action="append")
    add_output(parser, "write a page with plots, and the result as JSON, in this folder")
    parser.option("--precision", "BAR", part, "least for the share of detections that are right, 0 to 1")
    parser.option("--recall", "BAR", part, "least for the share of true objects that are found, 0 to 1")
    parser.option("--iou", "BAR", part, "least for the mean overlap of matches, 0 to 1")


def run(options: argparse.Namespace) -> int:
    from physgen.evaluate.measure import check_folder
    from physgen.evaluate.segmentation import BARS, evaluate, findings, illustrated, pairs
    from physgen.registry import Backends, Plan, choices

    chosen = choices(options.backend)
    if set(chosen) - {"segment"}:
        role = f'"{", ".join(sorted(set(chosen) - {"segment"}))}"'
        raise InputError.of("--backend", role, "has no part in this", "write segment=NAME")
    bars = {name: bar for name in BARS if (bar := getattr(options, name)) is not None}
    found, warnings = pairs(options.folder)
    print_problems(warnings)
    check_folder(options.output, plots=True)
    bar = Bar()
    segment = Backends(Plan(chosen)).get("segment")
    result = evaluate(found, segment, progress=bar.show)
    bar.clear()
    report = findings(result, bars)
    return hand_over(illustrated(report, result) if options.output else report, options)
