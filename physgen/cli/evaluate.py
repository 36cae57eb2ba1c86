"""Run `evaluate`: flags and handlers of the measures."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import physgen.evaluate
from physgen.cli import measures
from physgen.cli.arguments import (
    Command,
    Parser,
    check_folder_name,
    count,
    integer_reader,
    seed,
)
from physgen.cli.output import (
    FAILED,
    OK,
    Bar,
    print_backup,
    print_error,
    print_json,
    print_problems,
)
from physgen.files import install
from physgen.messages import Message
from physgen.problems import collect
from physgen.registry import Backends, Plan, choices

if TYPE_CHECKING:
    from physgen.evaluate.backends.inception import Inception
    from physgen.evaluate.measure import Findings

# Maximum size of a page for most mailboxes, MB.
MAILED = 50.0
REFERENCE = "reference"
"""Name of the other side in the result of fid."""


def check_output(folder: Path | None) -> None:
    """Raise InputError if no page can be written into the folder of `-o`."""
    check_folder_name(folder)
    physgen.evaluate.measure.check_folder(folder)


def add_output(parser: Parser) -> None:
    """Add the flag `-o`."""
    help_text = "write a page and the result as JSON to this folder"
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, help=help_text)


def show(findings: Findings, options: argparse.Namespace) -> int:
    """Print the result. Return exit code 1 if a bar is missed."""
    sys.stdout.write(
        physgen.evaluate.measure.as_json(findings)
        if options.json
        else physgen.evaluate.measure.text(findings)
    )
    if findings.has_passed:
        return OK
    return FAILED


def hand_over(findings: Findings, options: argparse.Namespace) -> int:
    """Print the result, and write its page with `-o`. Return exit code 1 if a bar is
    missed.
    """
    code = show(findings, options)
    if options.output:
        page = physgen.evaluate.measure.write_page(
            findings, options.output, options.command_line, print_backup
        )
        print_error(f"the page: {page}")
    return code


# ---- segmentation


def add_segmentation(parser: Parser) -> None:
    help_text = (
        "a folder with NAME.png and NAME.labels.png, or with folders of photo.png and "
        "photo.assets/masks.png"
    )
    parser.add_argument("folder", metavar="FOLDER", type=Path, help=help_text)
    parser.option(
        "--backend",
        "ROLE=NAME",
        str,
        "backend that finds the objects: segment=NAME",
        [],
        action="append",
    )
    add_output(parser)


def run_segmentation(options: argparse.Namespace) -> int:
    backend_choices = choices(options.backend)
    if set(backend_choices) - {"segment"}:
        role = f'"{", ".join(sorted(set(backend_choices) - {"segment"}))}"'
        raise Message.ROLE_NOT_SEGMENT.error("--backend", role)
    photo_pairs, warnings = physgen.evaluate.segmentation.pairs(options.folder)
    print_problems(warnings)
    check_output(options.output)
    bar = Bar()
    segment = Backends(Plan(backend_choices)).get("segment")
    result = physgen.evaluate.segmentation.evaluate(
        photo_pairs, segment, progress=bar.show
    )
    bar.clear()
    return hand_over(physgen.evaluate.segmentation.findings(result), options)


# ---- fid


def add_fid(parser: Parser) -> None:
    help_text = (
        "clips of one method: a folder of videos, of physgen's clips or of folders of "
        "frames; the name of the folder is the name of the method"
    )
    parser.add_argument("clips", metavar="CLIPS", type=Path, nargs="+", help=help_text)
    parser.option(
        "--reference",
        "DIR",
        Path,
        "reference clips, in the same form as CLIPS",
        action="append",
        required=True,
    )
    help_text = "inception-2015-12-05.pt, the TorchScript file that published FIDs use"
    parser.option("--inception", "FILE", Path, help_text, required=True)
    help_text = "number of evenly spaced frames of each clip; default: all"
    parser.option("--frames", "N", count, help_text)
    help_text = (
        "number of first frames of the methods' clips to leave out; use 1 if only these "
        "clips begin with the photo; default: 0"
    )
    parser.option("--skip", "N", count, help_text, 0)
    parser.option(
        "--size",
        "PX",
        integer_reader(16, 4096),
        "shorter side of all frames (px); default: 256",
        256,
    )
    help_text = "number of random samples of the clips for intervals; 0: no intervals; default: 200"
    parser.option("--draws", "N", integer_reader(0, 10_000), help_text, 200)
    add_output(parser)


def run_fid(options: argparse.Namespace) -> int:
    check_output(options.output)
    method_clips = methods(options.clips)
    # A missing file of Inception and missing clips are reported together.
    calls: list[Callable[[], Any]] = [partial(_features, options.inception)]
    calls += [
        partial(physgen.evaluate.clip_frames.sources, paths)
        for paths in (options.reference, *method_clips.values())
    ]
    features, truth, *sides = collect(calls)
    settings = physgen.evaluate.fid.Settings(
        physgen.evaluate.clip_frames.Rule(options.size, options.frames), options.draws
    )
    # Only clips of methods begin with the photo: the reference keeps all frames.
    shortened_sides = (
        [replace(source, skip=options.skip) for source in side] for side in sides
    )
    clips = dict(zip(method_clips, shortened_sides, strict=True))
    bar = Bar()
    try:
        comparison = physgen.evaluate.fid.measure(
            truth, clips, features, settings, bar.show
        )
    except MemoryError:
        raise Message.FRAMES_TOO_LARGE.error("--size", str(options.size)) from None
    bar.clear()
    print_problems(comparison.warnings)
    return hand_over(physgen.evaluate.fid.findings(comparison, options.skip), options)


def _features(file: Path) -> Inception:
    """Return the features of Inception's file. Raise InputError."""
    try:
        return physgen.evaluate.backends.inception.Inception(file)
    except ModuleNotFoundError as error:
        message, command = Message.INCEPTION_NEEDS, install("models")
        raise message.error(
            "--inception", package=error.name, install=command
        ) from None


def methods(paths: Sequence[Path]) -> dict[str, list[Path]]:
    """Return the methods by folder name, in the given order. Raise InputError if two
    have the same name.
    """
    paths_by_name = {path.resolve().stem: [path] for path in paths}
    # The result has the reference as a further side of this name.
    if len(paths_by_name) < len(paths) or REFERENCE in paths_by_name:
        names = ", ".join(path.resolve().stem for path in paths)
        raise Message.METHODS_CALLED_ALIKE.error("evaluate fid", names)
    return paths_by_name


# ---- study


def add_study(parser: Parser) -> None:
    help_text = (
        "a folder with METHOD/SCENE.mp4 or METHOD/SCENE/video.mp4; with --key: the "
        "answer files of raters, or a folder of these files"
    )
    parser.add_argument("paths", metavar="PATH", type=Path, nargs="+", help=help_text)
    help_text = (
        "the page for raters; the key is written beside the page (default: study.html, "
        "study.key.json); with --key: a folder for a page of the results"
    )
    parser.option("-o --output", "PATH", Path, help_text)
    help_text = "compute the results from answers, with the key of the study"
    parser.option("--key", "FILE", Path, help_text)
    parser.option(
        "--videos", "N", count, "number of scenes of each method; default: 15"
    )
    parser.option("--seed", "N", seed, "seed of the random values; default: 0", 0)


VIDEOS = 15
"""Number of scenes in a study, as in the paper."""


def run_study(options: argparse.Namespace) -> int:
    if options.key:
        return _read_study(options)

    # Answers without a key are a mistake, since they need the key of their study.
    if any(path.suffix == ".json" for path in options.paths):
        raise Message.KEY_MISSING.error("--key")
    if len(options.paths) > 1:
        raise Message.SECOND_FOLDER.error(str(options.paths[1]))
    page: Path = options.output or Path("study.html")
    physgen.evaluate.study.check_page(page)
    bar = Bar()
    methods = physgen.evaluate.study.methods_in(options.paths[0])
    study = physgen.evaluate.study.make(
        methods, options.videos or VIDEOS, options.seed, bar.show
    )
    bar.clear()
    key = physgen.evaluate.study.write_study(study, page, print_backup)
    if left_out := set(methods.scenes) - set(methods.common_scenes):
        print_error(
            f"left out, since not every method has made them: {', '.join(sorted(left_out))}"
        )
    if (size := page.stat().st_size / 1e6) > MAILED:
        print_error(
            f"{page} has {size:.0f} MB, more than most mailboxes take: name fewer with --videos"
        )
    count = len(methods.names)
    scenes = len(study.key.scenes)
    if options.json:
        record = {
            "page": str(page),
            "key": str(key),
            "study": study.key.study,
            "clips": len(study.clips),
        }
        print_json(
            {
                **record,
                "methods": study.key.methods,
                "scenes": study.key.scenes,
                "seed": options.seed,
            }
        )
        return OK
    print(page)
    size_text = (
        f"{count} method{'s' * (count != 1)}, {scenes} scene{'s' * (scenes != 1)}"
    )
    clips = f"{len(study.clips)} clip{'s' * (len(study.clips) != 1)}"
    print_error(f"{clips}: {size_text}. Send {page.name} to those who rate.")
    if count == 1:
        print_error(
            "It is of one method alone: there is nothing to compare its scores with."
        )
    print_error(
        f"{key} says which clip is of which method: keep it to yourself, and read answers with --key {key}"
    )
    return OK


def _read_study(options: argparse.Namespace) -> int:
    if options.videos is not None:
        raise Message.VIDEOS_WITH_KEY.error("--videos")
    check_output(options.output)
    key = physgen.evaluate.study.read_key(options.key)
    answers = physgen.evaluate.ratings.read_answers(
        physgen.evaluate.ratings.files_in(options.paths, options.key), key
    )
    return hand_over(physgen.evaluate.ratings.findings(answers, options.seed), options)


# ---- the measures of cli/measures.py


def _add_measure(add_flags: Callable[[Parser], None], parser: Parser) -> None:
    add_flags(parser)
    add_output(parser)


def _run_measure(options: argparse.Namespace) -> int:
    check_output(options.output)
    return hand_over(measures.find(options), options)


# ---- the command

MEASURES = (
    Command(
        "segmentation",
        "Compares the objects found in photos with true masks, as COCO does.",
        "segmentation photos -o out/segmentation",
        add_segmentation,
        run_segmentation,
    ),
    Command(
        "fid",
        "Compares frames and motion of clips with reference clips: Image-FID and Motion-FID; see docs/evaluation.md.",
        "fid out/mine --reference filmed --inception inception-2015-12-05.pt -o out/fid",
        add_fid,
        run_fid,
    ),
    Command(
        "study",
        "Makes a page on which people rate clips without knowing the methods; with --key, computes the results.",
        "study METHODS -o study.html, then: physgen evaluate study answers/*.json --key study.key.json -o out/study",
        add_study,
        run_study,
    ),
    Command(
        "properties",
        "Compares a backend's estimates of mass, friction and elasticity with measured values.",
        "properties --backend physics=vlm -o out/vlm",
        partial(_add_measure, measures.add_properties),
        _run_measure,
    ),
    Command(
        "controllability",
        "Measures how the motion of one object depends on the direction and speed of a push.",
        "controllability scene.yaml --object ball --angles 12",
        partial(_add_measure, measures.add_controllability),
        _run_measure,
    ),
    Command(
        "physics",
        "Compares the engine with closed forms of mechanics; the exit code is 1 if an error exceeds its limit.",
        "physics --rows 1,5,12 --no-convergence",
        partial(_add_measure, measures.add_physics),
        _run_measure,
    ),
    Command(
        "plausibility",
        "Scores motion by gravity, momentum, energy, overlap and jumps; the exit code is 1 if a clip counts as wrong.",
        "plausibility tracks.csv --fps 30",
        partial(_add_measure, measures.add_plausibility),
        _run_measure,
    ),
    Command(
        "fidelity",
        "Compares drawn frames with path-traced frames of the same poses: PSNR and SSIM.",
        "fidelity --truth studio/truth",
        partial(_add_measure, measures.add_fidelity),
        _run_measure,
    ),
    Command(
        "runtime",
        "Adds up the wall time and CPU time of each stage, and shows the times of the paper.",
        "runtime out",
        partial(_add_measure, measures.add_runtime),
        _run_measure,
    ),
)


def add(parser: Parser) -> None:
    kinds: Any = parser.add_subparsers(
        title="measures", metavar="MEASURE", dest="what", required=True
    )
    for measure in MEASURES:
        sub = kinds.add_parser(
            measure.name,
            help=measure.summary,
            description=measure.summary,
            epilog=f"example: physgen evaluate {measure.example}",
        )
        sub.flag("--json", "print as JSON")
        parser.commands[measure.name] = sub
        measure.add(sub)


def evaluate(options: argparse.Namespace) -> int:
    """Run the chosen measure."""
    return next(measure for measure in MEASURES if measure.name == options.what).run(
        options
    )


EVALUATE = Command(
    "evaluate",
    "Evaluates photos, scenes, clips, backends and human ratings with the measures of the paper.",
    "physgen evaluate segmentation photos",
    add,
    evaluate,
)
