"""`evaluate segmentation`."""

from __future__ import annotations

import argparse
import sys

from physgen.cli.printing import FAILED, OK, Bar, print_json, tell_problems
from physgen.problems import InputError


def segmentation(options: argparse.Namespace) -> int:
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
