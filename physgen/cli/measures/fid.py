"""`physgen evaluate fid`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from physgen.cli.arguments import count, positive, seed
from physgen.cli.measures.output import add_output, hand_over
from physgen.cli.output import Bar, print_problems
from physgen.problems import InputError, Place, Problem

ABOUT = "Frames and motion of clips against a reference's: Image-FID and Motion-FID; see docs/fid.md."
EXAMPLE = "fid out/mine --reference filmed --features inception:inception-2015-12-05.pt -o out/fid"
LEAST_DRAWS = 20
"""For an interval."""
SIDES = 16, 4096
"""px: extractors shrink pictures below that."""


def shorter(text: str) -> int:
    """px of a frame's shorter side."""
    if not text.isdecimal() or len(text) > 6 or not SIDES[0] <= int(text) <= SIDES[1]:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from {SIDES[0]} to {SIDES[1]}")
    return int(text)


def draws(text: str) -> int:
    """Number of resamplings: 0, or enough for an interval."""
    if not text.isdecimal() or (int(text[:6]) != 0 and not LEAST_DRAWS <= int(text[:6]) <= 10_000):
        raise argparse.ArgumentTypeError(f"{text} is not 0 or a whole number from {LEAST_DRAWS} to 10000")
    return int(text)


def method(text: str) -> tuple[str, Path]:
    """`NAME=DIR`."""
    name, sign, path = text.partition("=")
    if not (sign and name.strip() and path):
        raise argparse.ArgumentTypeError(f"{text} is not NAME=DIR")
    return name.strip(), Path(path)


def full_colour(text: str) -> str | float:
    """`reference`, `frame` or a number of px."""
    if text in ("reference", "frame"):
        return text
    try:
        return positive(text)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(
            f"{text} is not reference, frame or a number of px above 0"
        ) from None


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "clips",
        metavar="CLIPS",
        type=Path,
        nargs="*",
        help="videos, folders of frames, or folders of such, physgen's output folders among them: one method's clips",
    )
    parser.add_argument(
        "--reference",
        metavar="DIR",
        type=Path,
        action="append",
        required=True,
        help="the same of what is true",
    )
    parser.add_argument(
        "--method",
        metavar="NAME=DIR",
        type=method,
        action="append",
        default=[],
        help="clips of a method, once for each; others are compared with the first",
    )
    parser.add_argument(
        "--features",
        metavar="NAME",
        default="bank",
        help="extractor: inception:PATH (the TorchScript file of published FIDs), "
        "module:PACKAGE.MODULE:FACTORY or module:FILE.py:FACTORY; default: bank, which needs no model and is NOT "
        "comparable with published FIDs",
    )
    parser.add_argument(
        "--flow", metavar="NAME", default="dis", help="optical flow: dis (default), or raft:PATH"
    )
    parser.add_argument(
        "--full-colour",
        metavar="WHAT",
        type=full_colour,
        default="reference",
        help="speed in full colour: reference (the speed of its fastest pair of frames, default), frame (each "
        "picture's own fastest, as RAFT's pictures have it), or a number of px",
    )
    parser.add_argument("--only", choices=("image", "motion"), help="one of both; default: both")
    parser.add_argument("--frames", metavar="N", type=count, help="frames of each clip, evenly; default: all")
    parser.add_argument(
        "--skip",
        metavar="N",
        type=count,
        default=0,
        help="first frames of the methods' clips that do not count: 1 where theirs begin with the photo and the "
        "reference's do not; default: 0",
    )
    parser.add_argument(
        "--size", metavar="PX", type=shorter, default=256, help="the shorter side of all frames; default: 256"
    )
    parser.add_argument(
        "--fit",
        choices=("whole", "crop", "stretch"),
        default="whole",
        help="frames as they are (default; all of one shape), their middle square, or stretched to a square",
    )
    parser.add_argument(
        "--draws",
        metavar="N",
        type=draws,
        default=200,
        help="resamplings of clips for intervals, 0 for none; default: 200",
    )
    parser.add_argument("--seed", metavar="N", type=seed, default=0, help="of those draws; default: 0")
    parser.add_argument(
        "--device", metavar="DEVICE", default="auto", help="where models run: auto, cpu, cuda, mps"
    )
    add_output(parser, "write a page with plots and pictures, and the result as JSON, in this folder")


def run(options: argparse.Namespace) -> int:
    import cv2

    from physgen.evaluate.clip_frames import Fit, Rule, Source, sources
    from physgen.evaluate.fid import IMAGE, MOTION, REFERENCE, Normalise, Settings, findings, measure
    from physgen.evaluate.measure import check_folder

    check_folder(options.output, plots=True)
    named = methods(options)
    problems: list[Problem] = []
    clips: dict[str, list[Source]] = {}
    for name, paths in {REFERENCE: options.reference, **named}.items():
        try:
            clips[name] = sources(paths)
        except InputError as error:
            problems += error.problems
    made: dict[str, Any] = {}
    for role in ("features", "flow"):
        try:
            made[role] = backend(role, getattr(options, role), options.device)
        except InputError as error:
            problems += error.problems
    problems += _no_model(options)
    if problems:
        raise InputError(dict.fromkeys(problems))
    colour = options.full_colour
    settings = Settings(
        Rule(options.size, Fit(options.fit), options.frames),
        Normalise(colour) if isinstance(colour, str) else colour,
        (IMAGE, MOTION) if options.only is None else (options.only,),
        options.draws,
        options.seed,
    )
    bar = Bar()
    truth = clips.pop(REFERENCE)
    clips = {name: [replace(one, skip=options.skip) for one in side] for name, side in clips.items()}
    try:
        found = measure(truth, clips, made["features"], made["flow"], settings, bar.show)
    except (MemoryError, cv2.error) as error:
        if isinstance(error, cv2.error) and error.code != cv2.Error.StsNoMem:
            raise
        expected = "makes frames that do not fit into memory"
        fix = "give a smaller --size, or fewer --frames"
        raise InputError.of("--size", str(options.size), expected, fix) from None
    bar.clear()
    print_problems(found.warnings)
    tools = {role: getattr(options, role).partition(":")[0] for role in made}
    notes = {f"{role}_note": dict(one.note()) for role, one in made.items()}
    tools = {**tools, **notes, "skipped": options.skip}
    return hand_over(findings(found, tools, made["features"].comparable, bool(options.output)), options)


def methods(options: argparse.Namespace) -> dict[str, list[Path]]:
    """Paths of each, in the order given; what has no name is called by its folder. Raises InputError."""
    named: dict[str, list[Path]] = {}
    if options.clips:
        one = options.clips[0]
        named["clips" if len(options.clips) > 1 else one.resolve().name or "clips"] = list(options.clips)
    for name, path in options.method:
        if name in named:
            fix = "give each method a name of its own; of clips in several folders, name one above them"
            raise InputError.of("--method", f'"{name}"', "stands for two methods", fix)
        named[name] = [path]
    if not named:
        fix = "name clips, or methods with --method NAME=DIR"
        raise InputError.of("evaluate fid", "", "has nothing to compare with the reference", fix)
    if "reference" in named:
        raise InputError.of("--method", '"reference"', "is the other side's name", "choose another name")
    return named


def _no_model(options: argparse.Namespace) -> list[Problem]:
    """A device without a model that would run on it."""
    from physgen import registry

    names = {role: getattr(options, role).partition(":")[0] for role in ("features", "flow")}
    rows = [row for row in registry.BACKENDS if names.get(row.role) == row.name]
    if options.device in ("auto", "cpu") or any(row.weights or row.takes_setup for row in rows):
        return []
    expected = f"has no model to run there: {' and '.join(names.values())} need no model"
    return [Problem(Place("--device"), "", f'"{options.device}"', expected, "leave it out")]


def backend(role: str, text: str, device: str) -> Any:
    """The backend of a role, from `NAME` or `NAME:WHAT`. Raises InputError that names the flag."""
    from physgen import registry
    from physgen.registry import Setup, choice

    name, colon, rest = text.partition(":")
    flag = Place(f"--{role}")
    try:
        choice(role, name, rest, flag, colon=bool(colon))
        return registry.make(role, name, Setup(rest, device))
    except InputError as error:
        raise InputError([_of_flag(problem, role, flag) for problem in error.problems]) from None


def _of_flag(problem: Problem, role: str, flag: Place) -> Problem:
    """Problems name `--backend ROLE=NAME`; here the flag is `--ROLE NAME`."""
    found = problem.found.replace(f'"{role}={role}', f'"{role}').replace(f'"{role}=', '"')
    found = found.replace(f"{role}=", "")
    place = flag if problem.place.file == "--backend" else problem.place
    return replace(problem, place=place, found=found, fix=problem.fix.replace(f"{role}=", ""))
