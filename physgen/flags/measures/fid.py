"""Flags of `evaluate fid`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.flags.values import count, positive, seed

ABOUT = "Frames and motion of clips against a reference's: Image-FID and Motion-FID; see docs/fid.md."
EXAMPLE = "fid out/mine --reference filmed --features inception:inception-2015-12-05.pt -o out/fid"
LEAST_DRAWS = 20
"""Fewer give no interval worth the name."""
SIDES = 16, 4096
"""px; extractors make pictures smaller than that anyhow."""


def shorter(text: str) -> int:
    """px of a frame's shorter side."""
    if not text.isdecimal() or len(text) > 6 or not SIDES[0] <= int(text) <= SIDES[1]:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from {SIDES[0]} to {SIDES[1]}")
    return int(text)


def draws(text: str) -> int:
    """How often clips are drawn anew: 0, or enough for an interval."""
    if not text.isdecimal() or (int(text[:6]) != 0 and not LEAST_DRAWS <= int(text[:6]) <= 10_000):
        raise argparse.ArgumentTypeError(f"{text} is not 0 or a whole number from {LEAST_DRAWS} to 10000")
    return int(text)


def method(text: str) -> tuple[str, Path]:
    """`NAME=DIR`."""
    name, sign, path = text.partition("=")
    if not (sign and name.strip() and path):
        raise argparse.ArgumentTypeError(f"{text} is not NAME=DIR")
    return name.strip(), Path(path)


def full_colour(text: str) -> str | float:
    """`reference`, `frame` or a number of px."""
    if text in ("reference", "frame"):
        return text
    try:
        return positive(text)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(
            f"{text} is not reference, frame or a number of px above 0"
        ) from None


def add(parser: argparse.ArgumentParser) -> None:
    """Whose clips, what looks at them, and how they are made alike."""
    parser.add_argument(
        "clips",
        metavar="CLIPS",
        type=Path,
        nargs="*",
        help="videos, folders of frames, or folders of such, physgen's output folders among them: one method's clips",
    )
    parser.add_argument(
        "--reference",
        metavar="DIR",
        type=Path,
        action="append",
        required=True,
        help="the same of what is true",
    )
    parser.add_argument(
        "--method",
        metavar="NAME=DIR",
        type=method,
        action="append",
        default=[],
        help="clips of a method, once for each; the first is what others are held against",
    )
    parser.add_argument(
        "--features",
        metavar="NAME",
        default="bank",
        help="what looks at pictures: inception:PATH (the TorchScript file of published FIDs), "
        "module:PACKAGE.MODULE:FACTORY or module:FILE.py:FACTORY; default: bank, which needs no model and is NOT "
        "comparable with published FIDs",
    )
    parser.add_argument(
        "--flow", metavar="NAME", default="dis", help="what finds motion: dis (default), or raft:PATH"
    )
    parser.add_argument(
        "--full-colour",
        metavar="WHAT",
        type=full_colour,
        default="reference",
        help="speed in full colour: reference (the speed of its fastest pair of frames, default), frame (each "
        "picture's own fastest, as RAFT's pictures have it), or a number of px",
    )
    parser.add_argument("--only", choices=("image", "motion"), help="one of both; default: both")
    parser.add_argument("--frames", metavar="N", type=count, help="frames of each clip, evenly; default: all")
    parser.add_argument(
        "--skip",
        metavar="N",
        type=count,
        default=0,
        help="first frames of the methods' clips that do not count: 1 where theirs begin with the photo and the "
        "reference's do not; default: 0",
    )
    parser.add_argument(
        "--size", metavar="PX", type=shorter, default=256, help="the shorter side of all frames; default: 256"
    )
    parser.add_argument(
        "--fit",
        choices=("whole", "crop", "stretch"),
        default="whole",
        help="frames as they are (default; all of one shape), their middle square, or stretched to a square",
    )
    parser.add_argument(
        "--draws",
        metavar="N",
        type=draws,
        default=200,
        help="times that clips are drawn anew for intervals, 0 for none; default: 200",
    )
    parser.add_argument("--seed", metavar="N", type=seed, default=0, help="of those draws; default: 0")
    parser.add_argument(
        "--device", metavar="DEVICE", default="auto", help="where models run: auto, cpu, cuda, mps"
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="write a page with plots and pictures, and the result as JSON, in this folder",
    )
