"""`physgen evaluate plausibility`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.arguments import positive
from physgen.cli.measures.output import add_output, hand_over
from physgen.cli.output import Bar

ABOUT = "Physics judged without truth: does motion obey one gravity, keep momentum, never jump?"
EXAMPLE = "plausibility out tracks.csv -o out/plausibility"
QUESTIONS = ("gravity", "momentum", "energy", "overlap", "jumps", "starts", "speeding")


def add(parser: argparse.ArgumentParser) -> None:
    """What is judged, what is known of it, and what is left out."""
    parser.add_argument(
        "clips",
        metavar="CLIP",
        nargs="+",
        type=Path,
        help="clips that physgen rendered, a scene file, or tracks of any video: a CSV of frame,name,x,y[,radius], or "
        "a folder of PNG masks",
    )
    parser.add_argument(
        "--fps", type=positive, help="frames a second of tracks that do not say it; default: 30"
    )
    parser.add_argument(
        "--view", choices=("side", "top"), default="side", help="of tracks that do not say it; default: side"
    )
    parser.add_argument(
        "--held",
        metavar="NAME",
        action="append",
        default=[],
        help="a body on a rope or in a hand: only jumps and overlap are asked",
    )
    parser.add_argument(
        "--skip",
        metavar="LIST",
        type=questions,
        default=(),
        help=f"questions to leave out, of {','.join(QUESTIONS)}: overlap, where bodies pass before each other",
    )
    add_output(parser)


def questions(text: str) -> tuple[str, ...]:
    """`overlap,starts`."""
    names = tuple(text.split(","))
    for name in names:
        if name not in QUESTIONS:
            raise argparse.ArgumentTypeError(f"{name} is no question; they are {', '.join(QUESTIONS)}")
    if set(names) == set(QUESTIONS):
        raise argparse.ArgumentTypeError("leaving out every question leaves nothing to ask")
    return names


def run(options: argparse.Namespace) -> int:
    from physgen.evaluate.measure import check_folder
    from physgen.evaluate.plausibility.judge import Verdict, findings, judge
    from physgen.evaluate.plausibility.tracks import read
    from physgen.scene.scene import View

    check_folder(options.output, plots=True)
    bar = Bar()
    verdicts: list[Verdict] = []
    for path in options.clips:
        for tracks in read(path, options.fps, View(options.view)):
            bar.show(tracks.name, len(verdicts), len(verdicts) + 1)
            verdicts.append(judge(tracks.holding(options.held), options.skip))
    bar.clear()
    return hand_over(findings(verdicts, plots=options.output is not None), options)
