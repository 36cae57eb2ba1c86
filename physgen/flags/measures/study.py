"""Flags of `evaluate study`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.flags.values import count, seed

ABOUT = "A blind page of clips for people to rate; and with --key, what their answers say."
EXAMPLE = "study METHODS -o study.html, then: physgen evaluate study answers/*.json --key study.key.json -o out/study"


def add(parser: argparse.ArgumentParser) -> None:
    """Clips to be rated, or answers."""
    parser.add_argument(
        "paths",
        metavar="PATH",
        type=Path,
        nargs="+",
        help="a folder of methods with METHOD/SCENE.mp4 or METHOD/SCENE/video.mp4 in it; with --key: files that "
        "raters saved, or a folder of them",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="PATH",
        type=Path,
        help="the page to rate on, its key beside it (default: study.html, study.key.json); with --key: a folder "
        "for a page of the result with its plots",
    )
    parser.add_argument("--key", metavar="FILE", type=Path, help="read answers with the key of their study")
    parser.add_argument(
        "--videos", metavar="N", type=count, help="scenes that are shown of every method; default: 15"
    )
    parser.add_argument("--seed", metavar="N", type=seed, default=0, help="of what is drawn; default: 0")
    parser.add_argument(
        "--photos",
        metavar="DIR",
        type=Path,
        help="photos that the clips begin with, SCENE.png, and what was asked for, SCENE.txt; default: METHODS/photos",
    )
    parser.add_argument("--title", metavar="TEXT", help="what stands above the page to rate on")
