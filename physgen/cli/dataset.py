"""`dataset`: rendered clips to a training data set."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

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
    gather_clips,
    run_all,
)
from physgen.cli.output import OK, print_error, print_line, print_problem
from physgen.problems import Place, Problem, Severity
from physgen.text import counted

if TYPE_CHECKING:
    from physgen.batch.clips import FoundClip
    from physgen.batch.dataset import Sample

INTERVAL = 10_000
"""Clips between two lines of progress."""
MAX_WARNINGS = 20
"""Unusable clips that are printed one by one."""


def dataset(options: argparse.Namespace) -> int:
    from physgen.batch.dataset import Gathering, lost_sample, read_splits

    check_folder_name(options.output)
    check_cluster(options)
    splits = read_splits(options.split, options.seed)
    warnings = 0

    def warn(problem: Problem) -> None:
        nonlocal warnings
        warnings += 1
        if warnings <= MAX_WARNINGS:
            print_problem(problem)

    def progress(count: int) -> None:
        if count % INTERVAL == 0:
            print_error(f"{count:,} clips")

    def copies(
        copy: Callable[[FoundClip], Sample], clips: Iterator[FoundClip]
    ) -> Generator[Sample, None, None]:
        return run_all(options, copy, clips, 1, lost_sample)

    how = Gathering(splits, warn, progress, copies, options.layout, options.shard_clips)
    done = gather_clips(options, how)
    place = "" if options.ship is None else options.ship.rstrip("/") + "/"
    files = [f"{place}{path}" for path in done.files]
    if warnings > MAX_WARNINGS:
        print_error(f"... and {warnings - MAX_WARNINGS:,} more that cannot be used")
    if empty := [name for name, count in done.counts.items() if not count]:
        photos = len(done.photos)
        there = "there is 1 photo" if photos == 1 else f"there are {photos:,} photos"
        fix = "splits are by photo: take more photos, another --seed, or other shares with --split"
        expected = f"has no clip in {', '.join(empty)}: {there}"
        print_problem(
            Problem(Place(str(options.output)), "", "", expected, fix, Severity.WARNING)
        )
    if options.json:
        line = {
            "dataset": f"{place}{options.output}",
            "clips": done.counts,
            "left_out": done.left_out,
        }
        print_line(json.dumps({**line, "files": files}))
    else:
        for file in files:
            print_line(file)
        split = ", ".join(f"{name} {count:,}" for name, count in done.counts.items())
        print_error(f"{counted(done.total, 'clip')}: {split}")
    return WRONG_INPUT if done.left_out else OK


def add(parser: Parser) -> None:
    about = "folders of rendered or exported clips, at any depth"
    parser.add_argument("folders", metavar="DIR", type=Path, nargs="+", help=about)
    parser.option(
        "-o --output", "DATASET", Path, "folder of the data set", required=True
    )
    layouts = ("folder", "webdataset")
    about = "folder (the default), as Hugging Face's datasets read it, or webdataset: shards"
    parser.add_argument("--layout", choices=layouts, default=layouts[0], help=about)
    about = "clips in a shard, at most; default: 1000"
    parser.option("--shard-clips", "N", number_of_clips, about, 1000)
    shares = "train=0.8,validation=0.1,test=0.1"
    about = f"shares of the photos: all clips of a photo are in the same split; default: {shares}"
    parser.option("--split", "SHARES", str, about, shares)
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
    mixed=True,
)
