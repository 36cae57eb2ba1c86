"""`verify`: renders clips again and compares them."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.cli import output
from physgen.cli.arguments import WRONG_INPUT, count
from physgen.cli.output import FAILED, OK, Bar, print_error

if TYPE_CHECKING:
    from physgen.batch.verify import Verdict, VerifyRequest


# ----------------------------------------------------------------------
# `verify`: clips rendered again and compared.


def verify(options: argparse.Namespace) -> int:
    from physgen.batch.clips import clip_folders
    from physgen.batch.verify import Outcome, VerifyRequest, failed
    from physgen.batch.verify import verify as run
    from physgen.batch.workers import run_parallel

    folders = clip_folders(options.folders)
    claims = [
        VerifyRequest(folder, options.scene, options.allow_outside, options.device) for folder in folders
    ]
    many = len(claims) > 1
    bar = Bar()
    work = run if many else partial(_watched, bar=bar)
    counts: Counter[Outcome] = Counter()
    with (
        output.Counter(len(claims) if many else 0) as counter,
        closing(run_parallel(work, claims, min(options.jobs, len(claims)), failed)) as verdicts,
    ):
        for verdict in verdicts:
            bar.clear()
            counts[verdict.outcome] += 1
            line = json.dumps(verdict.as_dict(), ensure_ascii=False) if options.json else verdict.line()
            counter.line(line)
            counter.step(counts.total() - counts[Outcome.EQUAL])
    code = WRONG_INPUT if counts[Outcome.UNKNOWN] else FAILED if counts[Outcome.DIFFERS] else OK
    if options.json:
        told = {outcome.name.lower(): counts[outcome] for outcome in Outcome}
        print(json.dumps({"clips": len(claims), **told, "passed": code == OK}))
    elif many:
        parts = [f"{counts[outcome]} {outcome.value}" for outcome in Outcome if counts[outcome]]
        print_error(f"{len(claims)} clips: {', '.join(parts)}")
    return code


def _watched(claim: VerifyRequest, bar: Bar) -> Verdict:
    from physgen.batch.verify import verify as run

    return run(claim, bar.show)


# ----------------------------------------------------------------------
# Flags of `verify`.


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
