"""Flags of `evaluate physics`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.flags.values import count, rows

ABOUT = "Motion against closed forms."
EXAMPLE = "physics --rows 1,5,12"


def add(parser: argparse.ArgumentParser) -> None:
    """Which rows, how often, and where scenes are kept."""
    parser.add_argument(
        "--rows", metavar="LIST", type=rows, default=[], help="some rows, e.g. 1,5,12; default: all"
    )
    parser.add_argument(
        "--draws", metavar="N", type=count, default=5, help="seeded draws of a row's parameters; default: 5"
    )
    parser.add_argument(
        "--no-convergence",
        action="store_true",
        help="only at default settings, not at 240 to 1920 steps a second",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="keep every scene file that is run in this folder",
    )
    parser.add_argument(
        "--jobs", metavar="N", type=count, help="draws run at a time; default: one a processor"
    )
