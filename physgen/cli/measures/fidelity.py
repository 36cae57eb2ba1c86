"""`evaluate fidelity`."""

from __future__ import annotations

import argparse
from dataclasses import replace

from physgen.cli.measures.findings import hand_over
from physgen.cli.printing import Bar


def fidelity(options: argparse.Namespace) -> int:
    from physgen.evaluate import fidelity as measure
    from physgen.evaluate.fidelity_told import findings
    from physgen.evaluate.findings import Section
    from physgen.evaluate.page import check_folder

    check_folder(options.output)
    if options.output:
        from physgen.report.plots.look import needed

        needed()
    bar = Bar()
    result = measure.evaluate(options.truth, options.scenes, bar.show)
    told = findings(result)
    if options.output:
        from physgen.evaluate.fidelity_told import plot, strips

        first, *rest = told.sections
        frames = Section("Frames", (), tuple(strips(measure.truths(options.truth, options.scenes))))
        told = replace(
            told, sections=(replace(first, parts=(*first.parts, plot(result["rows"]))), *rest, frames)
        )
    bar.clear()
    return hand_over(told, options)
