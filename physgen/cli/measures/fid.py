"""`physgen evaluate fid`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from physgen.cli.arguments import Parser, count, seed, whole
from physgen.cli.measures.output import add_output, hand_over
from physgen.cli.output import Bar, print_problems
from physgen.problems import InputError, Problem

ABOUT = "Frames and motion of clips against a reference's: Image-FID and Motion-FID; see docs/fid.md."
EXAMPLE = "fid out/mine --reference filmed --inception inception-2015-12-05.pt -o out/fid"


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
        "inception-2015-12-05.pt, the TorchScript file of published FIDs; without it, features that need no model and "
        "are NOT comparable with published FIDs"
    )
    parser.option("--inception", "FILE", Path, about)
    parser.option("--frames", "N", count, "frames of each clip, evenly; default: all")
    about = (
        "first frames of the methods' clips that do not count: 1 where theirs begin with the photo and the "
        "reference's do not; default: 0"
    )
    parser.option("--skip", "N", count, about, 0)
    parser.option("--size", "PX", whole(16, 4096), "the shorter side of all frames; default: 256", 256)
    parser.option("--draws", "N", draws, "resamplings of clips for intervals, 0 for none; default: 200", 200)
    parser.option("--seed", "N", seed, "of those draws; default: 0", 0)
    parser.option("--device", "DEVICE", str, "where Inception runs: auto, cpu, cuda, mps", "auto")
    add_output(parser, "write a page with plots, and the result as JSON, in this folder")


def run(options: argparse.Namespace) -> int:
    from physgen.evaluate.clip_frames import Rule, Source, sources
    from physgen.evaluate.fid import REFERENCE, Features, Settings, findings, measure
    from physgen.evaluate.fid_features import Bank
    from physgen.evaluate.measure import check_folder

    check_folder(options.output, plots=True)
    problems: list[Problem] = []
    clips: dict[str, list[Source]] = {}
    for name, paths in {REFERENCE: options.reference, **methods(options)}.items():
        try:
            clips[name] = sources(paths)
        except InputError as error:
            problems += error.problems
    features: Features = Bank()
    if options.inception:
        try:
            from physgen.evaluate.backends.inception import Inception

            features = Inception(options.inception, options.device)
        except InputError as error:
            problems += error.problems
        except ModuleNotFoundError as error:
            found, fix = f"needs {error.name}, which is not installed", 'pip install "physgen[models]"'
            problems += InputError.of("--inception", "", found, fix).problems
    if problems:
        raise InputError(dict.fromkeys(problems))
    settings = Settings(Rule(options.size, options.frames), options.draws, options.seed)
    truth = clips.pop(REFERENCE)
    clips = {name: [replace(one, skip=options.skip) for one in side] for name, side in clips.items()}
    bar = Bar()
    try:
        measured = measure(truth, clips, features, settings, bar.show)
    except MemoryError:
        expected = "makes frames that do not fit into memory"
        fix = "give a smaller --size, or fewer --frames"
        raise InputError.of("--size", str(options.size), expected, fix) from None
    bar.clear()
    print_problems(measured.warnings)
    return hand_over(findings(measured, options.skip, bool(options.output)), options)


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
