"""Flags of `evaluate`: one file a measure, and its row here and in `cli/measures`."""

from __future__ import annotations

import argparse

from physgen.flags.measures import (
    controllability,
    fid,
    fidelity,
    leaderboard,
    physics,
    plausibility,
    properties,
    runtime,
    segmentation,
    study,
)

MEASURES = {
    "physics": physics,
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
"""A module each: ABOUT, EXAMPLE and `add(parser)`."""


def measures(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """What `evaluate` measures, each with flags of its own."""
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
