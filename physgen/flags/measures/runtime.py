"""Flags of `evaluate runtime`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.flags.values import count

ABOUT = "What each stage takes, from the records of clips or from runs made now."
EXAMPLE = "runtime out --measure -o out/runtime"
PHOTO = Path("scenes/billiards/photo.png")


def add(parser: argparse.ArgumentParser) -> None:
    """Whose records, or what is run."""
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
    parser.add_argument(
        "-o", "--output", metavar="DIR", type=Path, help="write a page with a plot in this folder"
    )
