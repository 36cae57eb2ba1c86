"""`evaluate`: the scorecards."""

from __future__ import annotations

import argparse
import sys

from physgen.cli.printing import FAILED, OK, Bar, print_json, tell_kept, tell_problems
from physgen.problems import InputError


def evaluate(options: argparse.Namespace) -> int:
    import os

    if options.what != "physics":
        return {"fidelity": _fidelity, "segmentation": _segmentation}[options.what](options)

    from physgen.evaluate import physics, table

    bar = Bar()
    scores = physics.evaluate(
        physics.choose(options.rows),
        options.draws,
        () if options.no_convergence else physics.STEPS,
        options.jobs or os.cpu_count() or 1,
        options.output,
        bar.show,
        tell_kept,
    )
    bar.clear()
    result = {"rows": [score.as_dict() for score in scores], "passed": all(score.passed for score in scores)}
    if options.json:
        print_json(result)
    else:
        sys.stdout.write(table.markdown(result) if options.markdown else table.text(result))
    return OK if result["passed"] else FAILED


def _fidelity(options: argparse.Namespace) -> int:
    from physgen.evaluate import fidelity

    bar = Bar()
    if options.output:
        from physgen.evaluate.strips import write_strip

        for truth in fidelity.truths(options.truth, options.scenes):
            bar.show(f"{truth.name}: strip", 0, 1)
            path = write_strip(truth, options.output)
            bar.clear()
            print(path)
        return OK
    result = fidelity.evaluate(options.truth, options.scenes, bar.show)
    bar.clear()
    if options.json:
        print_json(result)
    else:
        sys.stdout.write(fidelity.markdown(result))
    if result["passed"] is None:
        print("no bar: none of these scenes is of the test half", file=sys.stderr)
        return OK if options.scenes else FAILED
    found = f"{result['ahead']:.2f} dB better than the paper's way, relit, over objects and shadows of the test half"
    print(f"{found}; the bar is {fidelity.BAR:g} dB", file=sys.stderr)
    return OK if result["passed"] else FAILED


def _segmentation(options: argparse.Namespace) -> int:
    from physgen.crew import Crew, Plan, choices
    from physgen.evaluate import segmentation, segmentation_table
    from physgen.evaluate.photos import pairs
    from physgen.evaluate.shown import Shown

    chosen = choices(options.backend)
    if set(chosen) - {"segment"}:
        role = f'"{", ".join(sorted(set(chosen) - {"segment"}))}"'
        raise InputError.of("--backend", role, "has no part in this", "write segment=NAME")
    bars = {name: bar for name in segmentation.BARS if (bar := getattr(options, name)) is not None}
    found, warnings = pairs(options.folder)
    tell_problems(warnings)
    shown = None if options.output is None else Shown(options.output, found)
    bar = Bar()
    result = segmentation.evaluate(
        found, Crew(Plan(chosen)).get("segment"), shown.photo if shown else lambda photo: None, bar.show
    )
    bar.clear()
    record = result.as_dict(bars)
    if shown:
        shown.totals(result, record)
    if options.json:
        print_json(record)
    else:
        form = segmentation_table.markdown if options.markdown else segmentation_table.text
        sys.stdout.write(form(record))
    return OK if record["passed"] else FAILED
