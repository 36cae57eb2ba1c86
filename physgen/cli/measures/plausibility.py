"""`physgen evaluate plausibility`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.arguments import positive
from physgen.cli.measures.output import hand_over
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
        help="clips that physgen rendered, a scene file, or tracks of any video: MOT (gt.txt), a CSV of "
        "frame,name,x,y[,angle,radius], or a folder of PNG masks",
    )
    parser.add_argument(
        "--fps", type=positive, help="frames a second of tracks that do not say it; default: 30"
    )
    parser.add_argument(
        "--view", choices=("side", "top"), default="side", help="of tracks that do not say it; default: side"
    )
    parser.add_argument(
        "--mass",
        metavar="NAME=G",
        action="append",
        default=[],
        type=mass,
        help="what a body weighs; areas by default",
    )
    parser.add_argument(
        "--held",
        metavar="NAME",
        action="append",
        default=[],
        help="a body on a rope or in a hand: only jumps are asked",
    )
    parser.add_argument(
        "--pushed",
        metavar="NAME@A-B",
        action="append",
        default=[],
        type=push,
        help="the caller pushes it from A to B seconds, e.g. ball@0.5-0.8",
    )
    parser.add_argument(
        "--skip",
        metavar="LIST",
        type=questions,
        default=(),
        help=f"questions to leave out, of {','.join(QUESTIONS)}: overlap, where bodies pass before each other",
    )
    parser.add_argument(
        "--noise", metavar="PX", type=positive, help="of the tracks; estimated from them by default"
    )
    parser.add_argument(
        "-o", "--output", metavar="DIR", type=Path, help="write a page with plots in this folder"
    )


def mass(text: str) -> tuple[str, float]:
    """`ball=170`."""
    name, _, number = text.rpartition("=")
    if not name:
        raise argparse.ArgumentTypeError(f"{text} is not NAME=G, e.g. ball=170")
    return name, positive(number)


def push(text: str) -> tuple[str, float, float]:
    """`ball@0.5-0.8`, or `ball` for all the time."""
    name, at, span = text.rpartition("@")
    if not at:
        return text, 0.0, float("inf")
    start, _, end = span.partition("-")
    try:
        times = float(start), float(end or start)
    except ValueError:
        times = (1.0, 0.0)
    if not name or not 0 <= times[0] <= times[1]:
        raise argparse.ArgumentTypeError(f"{text} is not NAME@FROM-UNTIL in seconds, e.g. ball@0.5-0.8")
    return name, *times


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
    from physgen.evaluate.plausibility.judge import Verdict, judge
    from physgen.evaluate.plausibility.reading import read
    from physgen.evaluate.plausibility.report import summary
    from physgen.evaluate.plausibility.request import Request
    from physgen.scene.scene import View

    check_folder(options.output)
    if options.output:
        from physgen.report.plots.style import require_matplotlib

        require_matplotlib()
    asked = Request(
        options.fps, View(options.view), dict(options.mass), tuple(options.held), tuple(options.pushed)
    )
    bar = Bar()
    verdicts: list[Verdict] = []
    for path in options.clips:
        for tracks in read(path, asked):
            bar.show(tracks.name, len(verdicts), len(verdicts) + 1)
            verdicts.append(judge(asked.applied(tracks), options.noise, options.skip))
    bar.clear()
    return hand_over(summary(verdicts, plots=options.output is not None), options)
