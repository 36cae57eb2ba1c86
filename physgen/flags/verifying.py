"""Flags of `verify`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.flags.values import count


def add_verify(sub: argparse.ArgumentParser) -> None:
    """Folders of clips, and where their scenes are."""
    sub.add_argument(
        "folders", metavar="DIR", type=Path, nargs="+", help="what physgen rendered into, at any depth"
    )
    sub.add_argument(
        "--scene",
        metavar="FILE",
        type=Path,
        help="the scene file or pack of all these clips; default: where each clip's manifest says",
    )
    sub.add_argument(
        "--jobs", metavar="N", type=count, default=1, help="clips verified at a time; default: 1"
    )
    sub.add_argument(
        "--device",
        choices=("cpu", "cuda"),
        default="cpu",
        help="what draws the frames: cuda is an NVIDIA GPU, by way of torch; default: cpu",
    )
    sub.add_argument(
        "--json", action="store_true", help="print a line of JSON a clip, and one that counts them"
    )
    sub.add_argument(
        "--allow-outside", action="store_true", help="let scenes read files outside their folders"
    )
