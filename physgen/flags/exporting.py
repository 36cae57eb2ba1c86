"""Flags of `export`."""

from __future__ import annotations

import argparse

from physgen.flags.values import count, names

DEVICES = ("cpu", "cuda")
NAMES = ("frames", "flo", "kitti", "wheel", "coco", "davis", "youtubevos", "mot", "mots")


def exports(sub: argparse.ArgumentParser) -> None:
    """Of the whole command."""
    sub.add_argument("scenes", metavar="SCENE", nargs="+")
    sub.add_argument(
        "--format",
        metavar="LIST",
        type=labels,
        required=True,
        help="any of " + ",".join(NAMES) + "; see docs/ground-truth.md",
    )
    sub.add_argument("-o", "--output", metavar="DIR", default="labels", help="default: labels")
    sub.add_argument("--jobs", metavar="N", type=count, default=1, help="scenes at a time; default: 1")
    sub.add_argument("--device", choices=DEVICES, default="cpu", help="what draws the frames; default: cpu")
    sub.add_argument(
        "--no-cache", dest="cache", action="store_false", help="simulate again, and make what is there again"
    )
    sub.add_argument("--json", action="store_true", help="print a line of JSON a scene")


def labels(text: str) -> tuple[str, ...]:
    """`flo,coco` -> names of formats; told of later where one is none, with what was meant."""
    return tuple(names(text))
