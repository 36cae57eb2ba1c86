"""Run `dataset`: turn rendered clips into a training data set."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from physgen import batch
from physgen.cli.arguments import (
    WRONG_INPUT,
    Command,
    Parser,
    check_folder_name,
    number_of_clips,
    seed,
)
from physgen.cli.clusters import (
    add_cluster,
    add_ship,
    check_cluster,
    gather_stored,
    run_all,
)
from physgen.cli.output import OK, print_error, print_line, print_problem
from physgen.messages import Message
from physgen.problems import Place, Problem
from physgen.text import counted

if TYPE_CHECKING:
    from physgen.batch.clips import FoundClip
    from physgen.batch.dataset import DatasetSummary, Sample

INTERVAL = 10_000
"""Number of clips between two lines of progress."""
MAX_WARNINGS = 20
"""Maximum number of warnings about unusable clips."""


def dataset(options: argparse.Namespace) -> int:
    check_folder_name(options.output)
    check_cluster(options)
    splits = batch.dataset.read_splits(options.split, options.seed)
    warnings = 0

    def warn(problem: Problem) -> None:
        nonlocal warnings
        warnings += 1
        # A wrong folder can hold thousands of unusable clips.
        if warnings <= MAX_WARNINGS:
            print_problem(problem)

    def progress(count: int) -> None:
        if count % INTERVAL == 0:
            print_error(f"{count:,} clips")

    def copies(
        copy: Callable[[FoundClip], Sample], clips: Iterator[FoundClip]
    ) -> Generator[Sample, None, None]:
        return run_all(options, copy, clips, 1, batch.dataset.lost_sample)

    gathering = batch.dataset.Gathering(
        splits, warn, progress, copies, options.layout, options.shard_clips
    )
    if options.ship is None:
        summary = batch.dataset.gather(options.folders, options.output, gathering)
    else:
        summary = gather_stored(options, gathering)
    if warnings > MAX_WARNINGS:
        print_error(f"... and {warnings - MAX_WARNINGS:,} more that cannot be used")
    _warn_of_empty_splits(summary, options.output)
    _print_summary(summary, options)
    if summary.left_out:
        return WRONG_INPUT
    return OK


def _warn_of_empty_splits(summary: DatasetSummary, output: Path) -> None:
    """Print a warning if a split has no clips."""
    empty = []
    for name, count in summary.counts.items():
        if not count:
            empty.append(name)
    if not empty:
        return
    photos = len(summary.photos)
    if photos == 1:
        photo_count = "there is 1 photo"
    else:
        photo_count = f"there are {photos:,} photos"
    place = Place(str(output))
    names = ", ".join(empty)
    print_problem(Message.SPLIT_EMPTY.warning(place, empty=names, there=photo_count))


def _print_summary(summary: DatasetSummary, options: argparse.Namespace) -> None:
    """Print the files for readers, in their store if there is one."""
    if options.ship is None:
        store = ""
    else:
        store = options.ship.rstrip("/") + "/"
    files = [f"{store}{path}" for path in summary.files]
    if options.json:
        line = {
            "dataset": f"{store}{options.output}",
            "clips": summary.counts,
            "left_out": summary.left_out,
        }
        print_line(json.dumps({**line, "files": files}))
        return
    for file in files:
        print_line(file)
    split = ", ".join(f"{name} {count:,}" for name, count in summary.counts.items())
    print_error(f"{counted(summary.total, 'clip')}: {split}")


def add(parser: Parser) -> None:
    help_text = "folders of rendered or exported clips, at any depth"
    parser.add_argument("folders", metavar="DIR", type=Path, nargs="+", help=help_text)
    parser.option(
        "-o --output", "DATASET", Path, "folder of the data set", required=True
    )
    layouts = ("folder", "webdataset")
    help_text = "folder (the default), as Hugging Face's datasets read it, or webdataset: shards"
    parser.add_argument("--layout", choices=layouts, default=layouts[0], help=help_text)
    help_text = "clips in a shard, at most; default: 1000"
    parser.option("--shard-clips", "N", number_of_clips, help_text, 1000)
    shares = "train=0.8,validation=0.1,test=0.1"
    help_text = f"shares of the photos: all clips of a photo are in the same split; default: {shares}"
    parser.option("--split", "SHARES", str, help_text, shares)
    parser.option(
        "--seed", "S", seed, "determines which photo is in which split; default: 0", 0
    )
    add_cluster(parser)
    add_ship(parser)
    parser.flag("--json", "print a line of JSON")


DATASET = Command(
    "dataset",
    "Makes a data set for training of rendered clips: folders, or WebDataset shards; split by photo.",
    "physgen dataset out sweep -o data",
    add,
    dataset,
    is_order_free=True,
)
