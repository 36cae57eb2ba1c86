"""`verify`: clips rendered again and compared."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING

from physgen.cli.printing import FAILED, OK, Bar, tell
from physgen.flags import WRONG_INPUT

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
    bar = Bar()
    alone = options.jobs == 1 or len(claims) == 1
    work = partial(_watched, bar=bar, many=len(claims) > 1) if alone else run
    counts: Counter[Outcome] = Counter()
    with closing(spread(work, claims, 1 if alone else min(options.jobs, len(claims)), failed)) as verdicts:
        if not alone:
            bar.show("verify", 0, len(claims))
        for done, verdict in enumerate(verdicts, 1):
            bar.clear()
            counts[verdict.outcome] += 1
            line = json.dumps(verdict.as_dict(), ensure_ascii=False) if options.json else verdict.line()
            print(line, flush=True)
            if not alone:
                bar.show("verify", done, len(claims))
    bar.clear()
    code = WRONG_INPUT if counts[Outcome.UNKNOWN] else FAILED if counts[Outcome.DIFFERS] else OK
    if options.json:
        told = {outcome.name.lower(): counts[outcome] for outcome in Outcome}
        print(json.dumps({"clips": len(claims), **told, "passed": code == OK}))
    elif len(claims) > 1:
        parts = [f"{counts[outcome]} {outcome.value}" for outcome in Outcome if counts[outcome]]
        tell(f"{len(claims)} clips: {', '.join(parts)}")
    return code


def _watched(claim: Claim, bar: Bar, many: bool) -> Verdict:
    from physgen.batch.verify.again import verify as run

    return run(claim, bar.of(claim.folder.name if many else ""))
