"""`physgen evaluate`: the measures, each with its flags and its handler in `physgen.cli.measures`."""

from __future__ import annotations

import argparse

from physgen.cli.arguments import Parser
from physgen.cli.measures import (
    controllability,
    fid,
    fidelity,
    leaderboard,
    plausibility,
    properties,
    runtime,
    segmentation,
    study,
)

MEASURES = {
    "fidelity": fidelity,
    "segmentation": segmentation,
    "plausibility": plausibility,
    "fid": fid,
    "properties": properties,
    "controllability": controllability,
    "runtime": runtime,
    "study": study,
    "leaderboard": leaderboard,
}
"""Modules with ABOUT, EXAMPLE, `add(parser)` and `run(options)`."""


def measures(subparsers: argparse._SubParsersAction[Parser]) -> None:
    """Add one parser a measure."""
    for name, measure in MEASURES.items():
        sub = subparsers.add_parser(
            name,
            help=measure.ABOUT,
            description=measure.ABOUT,
            epilog=f"example: physgen evaluate {measure.EXAMPLE}",
        )
        form = sub.add_mutually_exclusive_group()
        form.add_argument("--json", action="store_true", help="print as JSON")
        form.add_argument("--markdown", action="store_true", help="print as a page")
        measure.add(sub)


def evaluate(options: argparse.Namespace) -> int:
    """Run the measure that was chosen."""
    code: int = MEASURES[options.what].run(options)
    return code
