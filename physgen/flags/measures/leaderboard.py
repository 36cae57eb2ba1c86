"""Flags of `evaluate leaderboard`."""

from __future__ import annotations

import argparse
from pathlib import Path

ABOUT = "Methods side by side: their clips of every scene in step, and what other measures say of them."
EXAMPLE = "leaderboard METHODS -o board"


def add(parser: argparse.ArgumentParser) -> None:
    """Clips by method and scene, scores, and the page."""
    parser.add_argument(
        "folder",
        metavar="METHODS",
        type=Path,
        help="a folder of methods with METHOD/SCENE.mp4 or METHOD/SCENE/video.mp4 in it",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="write the page into this folder; default: the table alone",
    )
    parser.add_argument(
        "--scores",
        metavar="RESULT",
        type=Path,
        action="append",
        default=[],
        help="a result.json of another measure whose rows name these methods, or its folder; those in METHODS "
        "are found",
    )
    parser.add_argument(
        "--photos",
        metavar="DIR",
        type=Path,
        help="photos that the clips begin with, SCENE.png, and what was asked for, SCENE.txt; default: METHODS/photos",
    )
    parser.add_argument(
        "--title", metavar="TEXT", help="what stands above the page; default: the folder's name"
    )
    parser.add_argument(
        "--single-file", action="store_true", help="put pictures and videos into the page, to be mailed"
    )
