"""`physgen evaluate fid`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from physgen.cli.arguments import Parser, count, seed, whole
from physgen.cli.measures.output import add_output, hand_over
from physgen.cli.output import Bar, print_problems
from physgen.problems import InputError, Place, Problem

ABOUT = "Frames and motion of clips against a reference's: Image-FID and Motion-FID; see docs/fid.md."
EXAMPLE = "fid out/mine --reference filmed --features inception:inception-2015-12-05.pt -o out/fid"


def draws(text: str) -> int:
    """Number of resamplings: 0, or the 20 that an interval needs."""
    return 0 if text == "0" else whole(20, 10_000)(text)


def method(text: str) -> tuple[str, Path]:
    """`NAME=DIR`."""
    name, sign, path = text.partition("=")
    if not (sign and name.strip() and path):
        raise argparse.ArgumentTypeError(f"{text} is not NAME=DIR")
    return name.strip(), Path(path)


def add(parser: Parser) -> None:
    about = "videos, folders of frames, or folders of such, physgen's output folders among them: one method's clips"
    parser.add_argument("clips", metavar="CLIPS", type=Path, nargs="*", help=about)
    parser.option("--reference", "DIR", Path, "the same of what is true", action="append", required=True)
    about = "clips of a method, once for each; others are compared with the first"
    parser.option("--method", "NAME=DIR", method, about, [], action="append")
    about = (
        "extractor: inception:PATH (the TorchScript file of published FIDs); default: bank, which needs no model and "
        "is NOT comparable with published FIDs"
    )
    parser.option("--features", "NAME", str, about, "bank")
    parser.option("--flow", "NAME", str, "optical flow: dis (default), or raft:PATH", "dis")
    about = (
        "speed in full colour: reference (the speed of its fastest pair of frames, default), or frame (each picture's "
        "own fastest, as RAFT's pictures have it)"
    )
    parser.add_argument("--full-colour", choices=("reference", "frame"), default="reference", help=about)
    parser.add_argument("--only", choices=("image", "motion"), help="one of both; default: both")
    parser.option("--frames", "N", count, "frames of each clip, evenly; default: all")
    about = (
        "first frames of the methods' clips that do not count: 1 where theirs begin with the photo and the "
        "reference's do not; default: 0"
    )
    parser.option("--skip", "N", count, about, 0)
    parser.option("--size", "PX", whole(16, 4096), "the shorter side of all frames; default: 256", 256)
    about = "frames as they are (default; all of one shape), their middle square, or stretched to a square"
    parser.add_argument("--fit", choices=("whole", "crop", "stretch"), default="whole", help=about)
    parser.option("--draws", "N", draws, "resamplings of clips for intervals, 0 for none; default: 200", 200)
    parser.option("--seed", "N", seed, "of those draws; default: 0", 0)
    parser.option("--device", "DEVICE", str, "where models run: auto, cpu, cuda, mps", "auto")
    add_output(parser, "write a page with plots, and the result as JSON, in this folder")


def run(options: argparse.Namespace) -> int:
    from physgen.evaluate.clip_frames import Fit, Rule, Source, sources
    from physgen.evaluate.fid import IMAGE, MOTION, REFERENCE, Normalise, Settings, findings, measure
    from physgen.evaluate.measure import check_folder

    check_folder(options.output, plots=True)
    problems: list[Problem] = []
    clips: dict[str, list[Source]] = {}
    for name, paths in {REFERENCE: options.reference, **methods(options)}.items():
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
    if problems:
        raise InputError(dict.fromkeys(problems))
    settings = Settings(
        Rule(options.size, Fit(options.fit), options.frames),
        Normalise(options.full_colour),
        (IMAGE, MOTION) if options.only is None else (options.only,),
        options.draws,
        options.seed,
    )
    truth = clips.pop(REFERENCE)
    clips = {name: [replace(one, skip=options.skip) for one in side] for name, side in clips.items()}
    bar = Bar()
    try:
        found = measure(truth, clips, made["features"], made["flow"], settings, bar.show)
    except MemoryError:
        expected = "makes frames that do not fit into memory"
        fix = "give a smaller --size, or fewer --frames"
        raise InputError.of("--size", str(options.size), expected, fix) from None
    bar.clear()
    print_problems(found.warnings)
    tools: dict[str, Any] = {role: getattr(options, role).partition(":")[0] for role in made}
    tools |= {f"{role}_note": dict(one.note()) for role, one in made.items()}
    tools["skipped"] = options.skip
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


def backend(role: str, text: str, device: str) -> Any:
    """The backend of a role, from `NAME` or `NAME:WEIGHTS`. Raises InputError that names the flag."""
    from physgen import registry

    chosen = registry.choices([f"{role}={text}"], Place(f"--{role}"))[role]
    try:
        return registry.make(role, chosen.name, registry.Setup(chosen.weights, device))
    except InputError as error:
        flag = Place(f"--{role}")
        raise InputError([replace(problem, place=flag) for problem in error.problems]) from None
