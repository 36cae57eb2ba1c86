"""Measures of the paper under `evaluate` for motion, properties, frames and times."""

from __future__ import annotations

import argparse
import os
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import physgen.evaluate
import physgen.scene
from physgen import pipeline
from physgen.cli.arguments import Parser, integer_reader, names, positive, wrong_value
from physgen.cli.clips import add_overlays
from physgen.cli.output import Bar, print_error, print_problem
from physgen.environment import this_machine
from physgen.messages import Message
from physgen.registry import Backends, choices, load_plan

if TYPE_CHECKING:
    from physgen.evaluate.measure import Findings
    from physgen.evaluate.plausibility.tracks import Tracks

QUESTIONS = ("gravity", "momentum", "energy", "overlap", "jumps")
"""Questions about a motion."""


def add_properties(parser: Parser) -> None:
    """Add the flags of `evaluate properties`."""
    help_text = "YAML table of objects and true values; default: 42 objects of the YCB set, and published comparisons"
    parser.add_argument("table", metavar="TABLE", nargs="?", type=Path, help=help_text)
    help_text = "backend that estimates the values: physics=NAME"
    parser.option("--backend", "ROLE=NAME", str, help_text, [], action="append")
    help_text = "use this file in place of ~/.config/physgen/physgen.toml"
    parser.option("--config", "FILE", Path, help_text)
    parser.flag("--hide-size", "send only the name of each object to the backend")


def find_properties(options: argparse.Namespace, bar: Bar) -> Findings:
    """Ask a physics backend for the properties of objects."""
    if others := set(choices(options.backend)) - {"physics"}:
        role = f'"{", ".join(sorted(others))}"'
        raise Message.ROLE_NOT_PHYSICS.error("--backend", role)
    table = physgen.evaluate.properties.read_table(
        options.table or physgen.evaluate.properties.SHIPPED
    )
    plan = load_plan(options.backend, config=options.config).of(("physics",))
    backends = Backends(plan)
    answers = physgen.evaluate.properties.ask(
        table, backends, not options.hide_size, bar.show
    )
    backends.close()
    origin = physgen.evaluate.properties.Origin(
        backends.name("physics"), not options.hide_size
    )
    return physgen.evaluate.properties.findings(table, answers, origin)


def add_controllability(parser: Parser) -> None:
    """Add the flags of `evaluate controllability`."""
    parser.add_argument("scene", metavar="SCENE")
    help_text = "the object to push; default: the object that the scene pushes, or the first object that moves"
    parser.option("--object", "NAME", str, help_text)
    help_text = (
        "number of directions: around the circle in a view from above, from right over up to left in a view from "
        "the side; default: 8"
    )
    parser.option("--angles", "N", integer_reader(1, 360), help_text, 8)
    help_text = (
        "speeds of the pushes (px/s), e.g. 50,100,200; default: five speeds that move the object by up to about a "
        "third of the picture"
    )
    parser.option("--sizes", "LIST", read_speeds, help_text, [])
    add_overlays(parser)


def read_speeds(text: str) -> list[float]:
    """Return the speeds in `50,100,200`, px/s above 0, sorted and without
    repetitions.
    """
    speeds = sorted({positive(part.strip()) for part in text.split(",")})
    most = 100
    if not 2 <= len(speeds) <= most:
        raise wrong_value(text, Message.NOT_SPEEDS.refusal(most=most))
    return speeds


def find_controllability(options: argparse.Namespace, bar: Bar) -> Findings:
    """Push one object in many ways. Draw `paths.svg` beside the page if matplotlib is
    installed.
    """
    if options.variant == "all":
        raise Message.VARIANT_ALL.error("--variant", "all")
    scene = pipeline.load(
        options.scene, options.set, options.variant, options.allow_outside
    )
    pushes = physgen.evaluate.controllability.sweep(
        scene, options.object, options.angles, options.sizes, bar.show
    )
    if options.output and find_spec("matplotlib"):
        physgen.evaluate.controllability.plot(pushes, options.output / "paths.svg")
    elif options.output:
        print_error("without matplotlib there is no plot of the paths")
    return physgen.evaluate.controllability.findings(pushes)


def add_plausibility(parser: Parser) -> None:
    """Add the flags of `evaluate plausibility`."""
    help_text = "folders of clips, or CSV files of tracks with the columns frame, name, x, y (px) and, if known, radius"
    parser.add_argument("clips", metavar="CLIP", nargs="+", type=Path, help=help_text)
    parser.option("--fps", "N", positive, "frame rate of the tracks; default: 30")
    help_text = "view of the tracks; default: side"
    parser.add_argument(
        "--view", choices=("side", "top"), default="side", help=help_text
    )
    help_text = "a body on a rope or in a hand; only its jumps and overlap are measured"
    parser.option("--held", "NAME", str, help_text, [], action="append")
    parser.add_argument(
        "--skip",
        metavar="QUESTION",
        action="append",
        default=[],
        choices=QUESTIONS,
        help="leave out gravity, momentum, energy, overlap or jumps",
    )


def find_plausibility(options: argparse.Namespace, bar: Bar) -> Findings:
    """Judge the motion of clips without ground truth."""
    clips: list[Tracks] = []
    for path in options.clips:
        clips += physgen.evaluate.plausibility.tracks.read(
            path, options.fps, physgen.scene.scene.View(options.view)
        )
    verdicts = [
        physgen.evaluate.plausibility.judge.judge(
            tracks.hold(options.held), options.skip
        )
        for tracks in clips
    ]
    return physgen.evaluate.plausibility.judge.findings(verdicts)


def add_physics(parser: Parser) -> None:
    """Add the flags of `evaluate physics`."""
    help_text = "numbers of the rows to run, e.g. 1,5,12; default: all"
    parser.option("--rows", "LIST", numbers, help_text, [])
    help_text = "number of random draws of the parameters of each row; default: 5"
    parser.option("--draws", "N", integer_reader(1, 1000), help_text)
    parser.flag("--no-convergence", "simulate only with the default time step")
    help_text = "number of draws at a time; default: one for each processor"
    parser.option("--jobs", "N", integer_reader(1, 1024), help_text)
    help_text = "keep the scene files of all simulations in this folder"
    parser.option("--scenes", "DIR", Path, help_text)


def numbers(text: str) -> list[int]:
    """Return the numbers in `1,5,12`."""
    try:
        return list(map(int, text.split(",")))
    except ValueError:
        raise wrong_value(text, Message.NOT_NUMBERS.refusal()) from None


def find_physics(options: argparse.Namespace, bar: Bar) -> Findings:
    """Compare the engine with closed forms."""
    scorecard = physgen.evaluate.physics.scorecard
    rows = scorecard.choose(physgen.evaluate.physics.ROWS, options.rows)
    steps: tuple[int, ...] = scorecard.STEPS
    if not options.convergence:
        steps = ()
    jobs = options.jobs or os.cpu_count() or 1
    draws = options.draws or scorecard.DRAWS
    return scorecard.findings(
        scorecard.evaluate(rows, draws, steps, jobs, options.scenes)
    )


def add_fidelity(parser: Parser) -> None:
    """Add the flags of `evaluate fidelity`."""
    help_text = "folder of path-traced videos, as studio/make.py writes them; default: studio/truth"
    parser.option("--truth", "DIR", Path, help_text)
    parser.option(
        "--scenes",
        "LIST",
        names,
        "names of the scenes, e.g. curling,shelf; default: all",
        [],
    )


def find_fidelity(options: argparse.Namespace, bar: Bar) -> Findings:
    """Compare rendered frames with path-traced ones. Write strips `SCENE.jpg` beside
    the page.
    """
    folder = options.truth or physgen.evaluate.fidelity.TRUTH
    result = physgen.evaluate.fidelity.findings(
        physgen.evaluate.fidelity.evaluate(folder, options.scenes, bar.show)
    )
    if options.output:
        options.output.mkdir(parents=True, exist_ok=True)
        for truth in physgen.evaluate.fidelity.truths(folder, options.scenes):
            physgen.evaluate.fidelity.write_strips(
                truth, options.output / f"{truth.name}.jpg"
            )
    return result


def add_runtime(parser: Parser) -> None:
    """Add the flags of `evaluate runtime`."""
    help_text = "folders of clips"
    parser.add_argument("folders", metavar="DIR", nargs="+", type=Path, help=help_text)


def find_runtime(options: argparse.Namespace, bar: Bar) -> Findings:
    """Collect the times of stages."""
    runs = physgen.evaluate.runtime.read_runs(options.folders, print_problem)
    gpu = physgen.evaluate.runtime.gpu() or "no GPU"
    return physgen.evaluate.runtime.findings(runs, f"{this_machine()}, {gpu}")


FINDERS = {
    "properties": find_properties,
    "controllability": find_controllability,
    "physics": find_physics,
    "plausibility": find_plausibility,
    "fidelity": find_fidelity,
    "runtime": find_runtime,
}


def find(options: argparse.Namespace) -> Findings:
    """Return the findings of the chosen measure."""
    bar = Bar()
    try:
        return FINDERS[options.what](options, bar)
    finally:
        bar.clear()
