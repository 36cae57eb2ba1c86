"""Flags of `evaluate segmentation`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.flags.values import part

ABOUT = "Objects found in photos against their true masks, as COCO counts them."
EXAMPLE = "segmentation photos -o out/segmentation --recall 0.8"


def add(parser: argparse.ArgumentParser) -> None:
    """Photos with their truth, who segments, and what must be reached."""
    parser.add_argument(
        "folder",
        metavar="FOLDER",
        type=Path,
        help="photos with label maps: NAME.png and NAME.labels.png, folders of photo.png and masks.png, "
        "or a COCO file (*.json) with its photos",
    )
    parser.add_argument(
        "--backend", metavar="ROLE=NAME", action="append", default=[], help="who segments: segment=NAME"
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="write plots, the result as JSON and every photo with what was found in this folder",
    )
    for name, what in (
        ("precision", "the share of what is said that is right"),
        ("recall", "the share of true objects that is found"),
        ("iou", "the mean overlap of what is found"),
    ):
        parser.add_argument(f"--{name}", metavar="BAR", type=part, help=f"least for {what}, 0 to 1")
