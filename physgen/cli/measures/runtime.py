"""`evaluate runtime`."""

from __future__ import annotations

import argparse
from dataclasses import replace

from physgen.cli.measures.findings import hand_over
from physgen.cli.printing import Bar, tell_one
from physgen.problems import InputError


def runtime(options: argparse.Namespace) -> int:
    from physgen.evaluate.page import check_folder
    from physgen.evaluate.runtime.measured import measure
    from physgen.evaluate.runtime.runs import read_runs
    from physgen.evaluate.runtime.told import findings, plot
    from physgen.machine import gpu, this_machine

    check_folder(options.output)
    if not options.folders and options.measure is None:
        fix = "name folders of clips, or add --measure"
        raise InputError.of("evaluate runtime", "", "was given no records", fix)
    if options.output:
        from physgen.report.plots.look import needed

        needed()
    runs = read_runs(options.folders, tell_one) if options.folders else []
    if options.measure is not None:
        bar = Bar()
        runs += measure(options.measure, options.repeat, bar.show)
        bar.clear()
    graphics = gpu()
    told = findings(runs, f"{this_machine()}{f', {graphics}' if graphics else ', no GPU'}")
    if options.output:
        first, *rest = told.sections
        told = replace(told, sections=(replace(first, parts=(plot(runs), *first.parts)), *rest))
    return hand_over(told, options)
