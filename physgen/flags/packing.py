"""Flags of `pack` and `unpack`."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_pack(sub: argparse.ArgumentParser) -> None:
    """A scene, and the file that it goes to."""
    sub.add_argument("scene", metavar="SCENE")
    sub.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        type=Path,
        help="write the pack here, ending in .physgen; default: NAME.physgen in this folder",
    )
    sub.add_argument(
        "--allow-outside",
        action="store_true",
        help="let the scene read files outside its folder; they come along, and the pack does not need this",
    )


def add_unpack(sub: argparse.ArgumentParser) -> None:
    """A pack, and the folder that its files go to."""
    sub.add_argument("pack", metavar="FILE", type=Path, help="what physgen pack wrote")
    sub.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="write the files here, a new or empty folder; default: the pack's name without .physgen",
    )
