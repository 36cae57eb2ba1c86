"""Flags of `export`."""

from __future__ import annotations

import argparse

from physgen.flags.values import DEVICES, count, labels, of, two_sides

NAMES = (
    "frames", "flo", "kitti", "wheel", "tapvid", "order", "depth", "normals", "albedo", "shading", "coco", "davis",
    "youtubevos", "mot", "mots", "events", "trajectory", "conditioning", "physics",
)  # fmt: skip


def add_export(sub: argparse.ArgumentParser) -> None:
    """Of the whole command."""
    sub.add_argument("scenes", metavar="SCENE", nargs="+")
    sub.add_argument(
        "--format",
        metavar="LIST",
        type=labels,
        required=True,
        help="any of " + ",".join(NAMES) + "; tapvid:512 has so many points; see docs/ground-truth.md",
    )
    sub.add_argument("-o", "--output", metavar="DIR", default="labels", help="default: labels")
    sub.add_argument(
        "--frames",
        metavar="N",
        type=of({"type": "integer", "minimum": 2, "maximum": 100_000}),
        help="so many frames, spread over the scene's duration, which stays: as --set render.frames=N",
    )
    sub.add_argument(
        "--size",
        metavar="WxH",
        type=two_sides,
        help="of the frames, px; what does not fit is cut off, e.g. 832x480",
    )
    sub.add_argument(
        "--fps",
        metavar="N",
        type=of({"type": "number", "minimum": 1, "maximum": 1000}),
        help="at which they play",
    )
    sub.add_argument("--jobs", metavar="N", type=count, default=1, help="scenes at a time; default: 1")
    sub.add_argument("--device", choices=DEVICES, default="cpu", help="what draws the frames; default: cpu")
    sub.add_argument(
        "--no-cache", dest="cache", action="store_false", help="simulate again, and make what is there again"
    )
    sub.add_argument("--json", action="store_true", help="print a line of JSON a scene")
