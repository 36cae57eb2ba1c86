"""Flags of `dataset`."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from physgen.flags.values import labels, number_of_clips, seed

_BYTES = re.compile(r"(\d{1,15}(?:\.\d{1,3})?) ?([kMGT]?)B?", re.IGNORECASE)
_TIMES = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12}


def add_dataset(sub: argparse.ArgumentParser) -> None:
    """Which clips, where to, and how."""
    sub.add_argument(
        "folders",
        metavar="DIR",
        type=Path,
        nargs="+",
        help="what physgen rendered or exported into, at any depth",
    )
    sub.add_argument(
        "-o", "--output", metavar="DATASET", type=Path, required=True, help="folder of the data set"
    )
    sub.add_argument(
        "--layout",
        choices=("folder", "webdataset"),
        default="folder",
        help="folder (the default): a folder a clip, and metadata.jsonl as Hugging Face's datasets read it; or shards",
    )
    sub.add_argument(
        "--format",
        metavar="LIST",
        type=labels,
        default=(),
        help="labels that go along; default: all that clips have",
    )
    sub.add_argument(
        "--split",
        metavar="SHARES",
        default="train=0.8,validation=0.1,test=0.1",
        help="shares of the photos: all clips of one are in one split; default: train=0.8,validation=0.1,test=0.1",
    )
    sub.add_argument(
        "--seed",
        metavar="S",
        type=seed,
        default=0,
        help="which photo is in which split follows from it; default: 0",
    )
    sub.add_argument(
        "--shard-clips",
        metavar="N",
        type=number_of_clips,
        default=1000,
        help="in a shard at most; default: 1000",
    )
    sub.add_argument(
        "--shard-size", metavar="SIZE", type=size, default=10**9, help="of a shard at most; default: 1GB"
    )
    sub.add_argument(
        "--link",
        action="store_true",
        help="folder: names of the same files where the disk allows, in place of copies",
    )
    sub.add_argument("--json", action="store_true", help="print a line of JSON")


def size(text: str) -> int:
    """`500MB` -> bytes.

    >>> size("500MB"), size("1.5g"), size("65536")
    (500000000, 1500000000, 65536)
    """
    found = _BYTES.fullmatch(text.strip())
    value = float(found[1]) * _TIMES[found[2].lower()] if found else 0
    if not 65536 <= value <= 10**15:
        raise argparse.ArgumentTypeError(f"{text} is not a size of 65536 bytes or more, e.g. 500MB")
    return round(value)
