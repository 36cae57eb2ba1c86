"""Run `verify`: render clips again and compare."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from physgen import batch
from physgen.cli.arguments import WRONG_INPUT, Command, Parser, count
from physgen.cli.clusters import (
    add_cluster,
    add_ship,
    check_cluster,
    run_all,
    stored_clips,
)
from physgen.cli.output import FAILED, OK, Bar, print_error, print_line

if TYPE_CHECKING:
    from physgen.batch.verify import Outcome


def verify(options: argparse.Namespace) -> int:
    check_cluster(options)
    if options.ship is None:
        folders = batch.clips.clip_folders(options.folders)
    else:
        folders = stored_clips(options)
    requests = []
    for folder in folders:
        requests.append(
            batch.verify.VerifyRequest(folder, options.scene, options.allow_outside)
        )
    has_many = len(requests) > 1
    bar = Bar()
    work = batch.verify.verify
    # One clip that runs here shows its own progress; several share a bar of clips.
    if not has_many and options.cluster is None:
        work = partial(batch.verify.verify, progress=bar.show)
    counts = Counter(dict.fromkeys(batch.verify.Outcome, 0))
    with closing(
        run_all(options, work, requests, len(requests), batch.verify.report_failure)
    ) as verdicts:
        for verdict in verdicts:
            bar.clear()
            counts[verdict.outcome] += 1
            line = verdict.line()
            if options.json:
                line = json.dumps(verdict.as_dict(), ensure_ascii=False)
            print_line(line)
            if has_many:
                bar.show("clips", counts.total(), len(requests))
    bar.clear()
    code = OK
    # An unknown outcome decides the exit code before a difference does.
    if counts[batch.verify.Outcome.UNKNOWN]:
        code = WRONG_INPUT
    elif counts[batch.verify.Outcome.DIFFERS]:
        code = FAILED
    return _sum_up(counts, code, options)


def _sum_up(counts: Counter[Outcome], code: int, options: argparse.Namespace) -> int:
    """Print the counts of all outcomes. Return the exit code."""
    total = counts.total()
    if options.json:
        outcomes = {outcome.name.lower(): number for outcome, number in counts.items()}
        print(json.dumps({"clips": total, **outcomes, "passed": code == OK}))
    elif total > 1:
        parts = []
        for outcome, number in counts.items():
            if number:
                parts.append(f"{number} {outcome.value}")
        print_error(f"{total:,} clips: {', '.join(parts)}")
    return code


def add(parser: Parser) -> None:
    help_text = "folders of rendered clips, at any depth"
    parser.add_argument("folders", metavar="DIR", type=Path, nargs="+", help=help_text)
    help_text = "the scene file of all these clips; default: the one that each clip's manifest names"
    parser.option("--scene", "FILE", Path, help_text)
    parser.option("--jobs", "N", count, "clips verified at a time; default: 1", 1)
    add_cluster(parser)
    add_ship(parser)
    parser.flag("--json", "print a line of JSON for each clip, and one with the counts")
    parser.flag("--allow-outside", "let scenes read files outside their folders")


VERIFY = Command(
    "verify",
    "Renders clips again and compares: names the first difference and its size. Exit code 1 when something differs.",
    "physgen verify out --jobs 2",
    add,
    verify,
    is_order_free=True,
)
