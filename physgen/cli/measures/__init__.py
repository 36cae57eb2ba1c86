"""`evaluate`: one file a measure, and its row here and in `flags/measures`."""

from __future__ import annotations

import argparse

from physgen.cli.measures.controllability import controllability
from physgen.cli.measures.fid import fid
from physgen.cli.measures.fidelity import fidelity
from physgen.cli.measures.leaderboard import leaderboard
from physgen.cli.measures.physics import physics
from physgen.cli.measures.plausibility import plausibility
from physgen.cli.measures.properties import properties
from physgen.cli.measures.runtime import runtime
from physgen.cli.measures.segmentation import segmentation
from physgen.cli.measures.study import study

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


def evaluate(options: argparse.Namespace) -> int:
    return MEASURES[options.what](options)
