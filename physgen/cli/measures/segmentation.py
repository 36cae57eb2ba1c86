"""`physgen evaluate segmentation`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.arguments import part
from physgen.cli.measures.output import add_output, hand_over
from physgen.cli.output import Bar, print_problems
from physgen.problems import InputError

ABOUT = "Objects found in photos against their true masks, as COCO counts them."
EXAMPLE = "segmentation photos -o out/segmentation --recall 0.8"


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "folder",
        metavar="FOLDER",
        type=Path,
        help="photos with label maps: NAME.png and NAME.labels.png, or folders of photo.png and "
        "photo.assets/masks.png; or a COCO file (*.json) with its photos",
    )
    parser.add_argument(
        "--backend", metavar="ROLE=NAME", action="append", default=[], help="what segments: segment=NAME"
    )
    add_output(parser, "write plots, the result as JSON and every photo with what was found in this folder")
    for name, what in (
        ("precision", "the share of detections that are right"),
        ("recall", "the share of true objects that are found"),
        ("iou", "the mean overlap of matches"),
    ):
        parser.add_argument(f"--{name}", metavar="BAR", type=part, help=f"least for {what}, 0 to 1")


def run(options: argparse.Namespace) -> int:
    from physgen.evaluate.ground_truth import pairs
    from physgen.evaluate.segmentation import BARS, Folder, evaluate, findings
    from physgen.registry import Backends, Plan, choices

    chosen = choices(options.backend)
    if set(chosen) - {"segment"}:
        role = f'"{", ".join(sorted(set(chosen) - {"segment"}))}"'
        raise InputError.of("--backend", role, "has no part in this", "write segment=NAME")
    bars = {name: bar for name in BARS if (bar := getattr(options, name)) is not None}
    found, warnings = pairs(options.folder)
    print_problems(warnings)
    folder = None if options.output is None else Folder(options.output)
    bar = Bar()
    segment = Backends(Plan(chosen)).get("segment")
    result = evaluate(found, segment, folder.photo if folder else lambda photo: None, bar.show)
    bar.clear()
    report = findings(result, bars)
    return hand_over(folder.illustrated(report, result) if folder else report, options)
