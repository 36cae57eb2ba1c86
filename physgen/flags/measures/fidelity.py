"""Flags of `evaluate fidelity`."""

from __future__ import annotations

import argparse
from pathlib import Path

ABOUT = "Frames against the studio's truth videos."
EXAMPLE = "fidelity --scenes curling,shelf"


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
        type=lambda t: t.split(","),
        default=[],
        help="some scenes, e.g. curling,shelf",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="only write strips of frames there: the paper's way, ours and the truth",
    )
