"""`evaluate segmentation`."""

from __future__ import annotations

import argparse

from physgen.cli.measures.findings import hand_over
from physgen.cli.printing import Bar, tell_problems
from physgen.problems import InputError


def segmentation(options: argparse.Namespace) -> int:
    from physgen.crew import Crew, Plan, choices
    from physgen.evaluate import segmentation
    from physgen.evaluate.photos import pairs
    from physgen.evaluate.segmentation_told import BARS, findings
    from physgen.evaluate.shown import Shown

    chosen = choices(options.backend)
    if set(chosen) - {"segment"}:
        role = f'"{", ".join(sorted(set(chosen) - {"segment"}))}"'
        raise InputError.of("--backend", role, "has no part in this", "write segment=NAME")
    bars = {name: bar for name in BARS if (bar := getattr(options, name)) is not None}
    found, warnings = pairs(options.folder)
    tell_problems(warnings)
    shown = None if options.output is None else Shown(options.output, found)
    bar = Bar()
    result = segmentation.evaluate(
        found, Crew(Plan(chosen)).get("segment"), shown.photo if shown else lambda photo: None, bar.show
    )
    bar.clear()
    told = findings(result, bars)
    if shown:
        shown.plots(result)
        told = shown.illustrated(told)
    return hand_over(told, options)
