"""`evaluate plausibility`."""

from __future__ import annotations

import argparse

from physgen.cli.measures.findings import hand_over
from physgen.cli.printing import Bar
from physgen.problems import InputError


def plausibility(options: argparse.Namespace) -> int:
    from physgen.evaluate.page import check_folder

    check_folder(options.output)
    if options.output:
        from physgen.report.plots.look import needed

        needed()
    return _proof(options) if options.proof else _judged(options)


def _judged(options: argparse.Namespace) -> int:
    from physgen.evaluate.plausibility.judge import Verdict, judge
    from physgen.evaluate.plausibility.reading import read
    from physgen.evaluate.plausibility.reading.asked import Asked
    from physgen.evaluate.plausibility.told import findings
    from physgen.scene.model import View

    if not options.clips:
        fix = "name a clip's folder, a scene file or a file of tracks, or ask for --proof"
        raise InputError.of("evaluate plausibility", "", "has nothing to judge", fix)
    asked = Asked(
        options.fps, View(options.view), dict(options.mass), tuple(options.held), tuple(options.pushed)
    )
    bar = Bar()
    verdicts: list[Verdict] = []
    for path in options.clips:
        for tracks in read(path, asked):
            bar.show(tracks.name, len(verdicts), len(verdicts) + 1)
            verdicts.append(judge(asked.applied(tracks), options.noise, options.skip))
    bar.clear()
    return hand_over(findings(verdicts, plots=options.output is not None), options)


def _proof(options: argparse.Namespace) -> int:
    from physgen.evaluate.plausibility.proof.confusion import counted, findings
    from physgen.evaluate.plausibility.proof.trial import HELD_OUT, processors, trial

    if options.clips:
        raise InputError.of(
            "--proof", f'"{options.clips[0]}"', "is not judged by it", "leave one of the two out"
        )
    bar = Bar()
    seeds = range(HELD_OUT, HELD_OUT + options.seeds)
    said = trial(seeds, options.jobs or processors(), bar.show)
    bar.clear()
    return hand_over(findings(counted(said), seeds, plots=options.output is not None), options)
