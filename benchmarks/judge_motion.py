"""Plausibility of motion without a truth: gravity, momentum, energy, overlap, jumps.

    python benchmarks/judge_motion.py out                                   # every clip in or below out
    python benchmarks/judge_motion.py tracks.csv --fps 30 --skip overlap    # tracks of any video
    python benchmarks/judge_motion.py out -o out/plausibility               # a page with plots

A CSV has `frame`, `name`, `x`, `y` (px) and, if known, `radius`. Exit code 1 where a clip is called wrong.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from measure_command import run
from plausibility.judge import findings, judge
from plausibility.tracks import read

from physgen.cli.arguments import Parser, positive
from physgen.evaluate.measure import Findings, Progress
from physgen.scene.scene import View

QUESTIONS = ("gravity", "momentum", "energy", "overlap", "jumps")


def main(arguments: list[str] | None = None) -> int:
    """The command."""
    parser = Parser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("clips", metavar="CLIP", nargs="+", type=Path)
    parser.option("--fps", "N", positive, "of tracks that do not say it; default: 30")
    parser.add_argument(
        "--view",
        choices=("side", "top"),
        default="side",
        help="of tracks; default: side",
    )
    about = "a body on a rope or in a hand: only jumps and overlap are asked"
    parser.option("--held", "NAME", str, about, [], action="append")
    parser.add_argument(
        "--skip", metavar="QUESTION", action="append", default=[], choices=QUESTIONS
    )

    def find(options: argparse.Namespace, progress: Progress) -> Findings:
        clips = [
            tracks
            for path in options.clips
            for tracks in read(path, options.fps, View(options.view))
        ]
        return findings(
            [judge(tracks.holding(options.held), options.skip) for tracks in clips]
        )

    return run(parser, find, arguments)


if __name__ == "__main__":
    sys.exit(main())
