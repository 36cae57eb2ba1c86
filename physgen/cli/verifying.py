"""`verify`: clips rendered again and compared."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING

from physgen.cli import progress
from physgen.cli.printing import FAILED, OK, Bar, tell
from physgen.flags.parser import WRONG_INPUT

if TYPE_CHECKING:
    from physgen.batch.verify.again import Claim
    from physgen.batch.verify.verdict import Verdict


def verify(options: argparse.Namespace) -> int:
    from physgen.batch.verify.again import Claim, failed
    from physgen.batch.verify.again import verify as run
    from physgen.batch.verify.told import clip_folders
    from physgen.batch.verify.verdict import Outcome
    from physgen.batch.workers import spread

    folders = clip_folders(options.folders)
    claims = [Claim(folder, options.scene, options.allow_outside, options.device) for folder in folders]
    many = len(claims) > 1
    bar = Bar()
    work = run if many else partial(_watched, bar=bar)
    counts: Counter[Outcome] = Counter()
    with (
        progress.Counter(len(claims) if many else 0) as counter,
        closing(spread(work, claims, min(options.jobs, len(claims)), failed)) as verdicts,
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
        tell(f"{len(claims)} clips: {', '.join(parts)}")
    return code


def _watched(claim: Claim, bar: Bar) -> Verdict:
    from physgen.batch.verify.again import verify as run

    return run(claim, bar.show)
