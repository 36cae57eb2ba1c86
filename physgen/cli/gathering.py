"""`dataset`: clips that are there to a data set for training."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from physgen.cli.printing import OK, print_line, tell, tell_one
from physgen.flags.parser import WRONG_INPUT
from physgen.problems import InputError, Place, Problem, Severity

if TYPE_CHECKING:
    from physgen.batch.dataset.gathering import Gathered

OFTEN = 10_000
"""Clips after which it is told how far it is."""
MOST_TOLD = 20
"""Clips that cannot be used, told one by one."""


def dataset(options: argparse.Namespace) -> int:
    from physgen.batch.dataset.gathering import Asked, gather
    from physgen.batch.dataset.splits import read_splits
    from physgen.export.writing import check_names

    if options.link and options.layout != "folder":
        raise InputError.of("--link", "", "is of no use in shards", "leave it out, or take --layout folder")
    check_names(options.format)
    asked = Asked(
        options.layout,
        read_splits(options.split, options.seed),
        options.format,
        options.shard_clips,
        options.shard_size,
        options.link,
    )
    told = 0

    def warn(problem: Problem) -> None:
        nonlocal told
        told += 1
        if told <= MOST_TOLD:
            tell_one(problem)

    def far(count: int) -> None:
        if count % OFTEN == 0:
            tell(f"{count:,} clips")

    done = gather(options.folders, options.output, asked, options.command_line, warn, far)
    if told > MOST_TOLD:
        tell(f"... and {told - MOST_TOLD:,} more that cannot be used")
    _odd(done, options)
    if options.json:
        counts = {name: count.clips for name, count in done.counts.items()}
        line = {"dataset": str(options.output), "clips": counts, "made": done.made, "unchanged": done.kept}
        print_line(
            json.dumps({**line, "left_out": done.left_out, "files": [str(path) for path in done.files]})
        )
    else:
        for path in done.files:
            print_line(str(path))
        total = done.made + done.kept
        split = ", ".join(f"{name} {count.clips:,}" for name, count in done.counts.items())
        tell(f"{_clips(total)} ({split}): {done.made:,} written, {done.kept:,} unchanged")
    return WRONG_INPUT if done.left_out else OK


def _odd(done: Gathered, options: argparse.Namespace) -> None:
    """What is allowed and probably not meant."""

    def odd(expected: str, fix: str) -> None:
        tell_one(Problem(Place(str(options.output)), "", "", expected, fix, Severity.WARNING))

    silent = sum(count.clips - count.captions for count in done.counts.values())
    if silent:
        which = "" if done.silent is None else f", e.g. {done.silent}"
        odd(f"has {_clips(silent)} without a caption{which}", "render or export them with the format events")
    total = done.made + done.kept
    for name, count in done.lacking.items():
        said = f"no clip has {name}" if count == total else f"{_clips(count)} of {total:,} have no {name}"
        odd(said, f"render or export them with {name}, or leave it out of --format")
    if done.uneven is not None and options.layout == "webdataset":
        said = f"holds clips with different files, e.g. {done.uneven}: Hugging Face's loader makes no columns of them"
        odd(said, "choose what all have with --format, or read the shards with webdataset")
    empty = [name for name, count in done.counts.items() if not count.clips]
    if empty:
        photos = sum(len(count.photos) for count in done.counts.values())
        fix = "splits are by photo: take more photos, another --seed, or other shares with --split"
        there = "there is 1 photo" if photos == 1 else f"there are {photos:,} photos"
        odd(f"has no clip in {', '.join(empty)}: {there}", fix)
    if done.strays:
        folders = "1 folder" if done.strays == 1 else f"{done.strays:,} folders"
        which = "" if done.stray is None else f", e.g. {done.stray}"
        odd(
            f"holds {folders} of clips that are not named here{which}", "remove them, or name their clips too"
        )


def _clips(count: int) -> str:
    return "1 clip" if count == 1 else f"{count:,} clips"
