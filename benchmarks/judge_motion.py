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

from plausibility.judge import findings, judge
from plausibility.tracks import read

from physgen.evaluate.measure import as_json, check_folder, text, write_page
from physgen.problems import InputError
from physgen.scene.scene import View

QUESTIONS = ("gravity", "momentum", "energy", "overlap", "jumps")


def main(arguments: list[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("clips", metavar="CLIP", nargs="+", type=Path)
    parser.add_argument("--fps", metavar="N", type=float, help="of tracks that do not say it; default: 30")
    parser.add_argument("--view", choices=("side", "top"), default="side", help="of tracks; default: side")
    about = "a body on a rope or in a hand: only jumps and overlap are asked"
    parser.add_argument("--held", metavar="NAME", action="append", default=[], help=about)
    parser.add_argument("--skip", metavar="QUESTION", action="append", default=[], choices=QUESTIONS)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("-o", "--output", metavar="DIR", type=Path)
    options = parser.parse_args(arguments)
    try:
        check_folder(options.output)
        clips = [tracks for path in options.clips for tracks in read(path, options.fps, View(options.view))]
        found = findings([judge(tracks.holding(options.held), options.skip) for tracks in clips])
    except InputError as error:
        print(*error.problems, sep="\n", file=sys.stderr)
        return 2
    if options.output:
        print(f"the page: {write_page(found, options.output, sys.argv, lambda kept: None)}", file=sys.stderr)
    sys.stdout.write(as_json(found) if options.json else text(found))
    return 0 if found.passed else 1


if __name__ == "__main__":
    sys.exit(main())
