"""`evaluate`: one file a measure, and its row here and in `flags/measures`."""

from __future__ import annotations

import argparse

from physgen.cli.measures.fid import fid
from physgen.cli.measures.fidelity import fidelity
from physgen.cli.measures.physics import physics
from physgen.cli.measures.segmentation import segmentation

MEASURES = {
    "physics": physics,
    "fidelity": fidelity,
    "segmentation": segmentation,
    "fid": fid,
}


def evaluate(options: argparse.Namespace) -> int:
    return MEASURES[options.what](options)
