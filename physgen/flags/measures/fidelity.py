"""Flags of `evaluate fidelity`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.flags.values import names

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
