"""`physgen evaluate study`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.arguments import count, seed
from physgen.cli.measures.output import hand_over
from physgen.cli.output import OK, Bar, print_backup, print_error, print_json, print_problem
from physgen.problems import InputError

ABOUT = "A blind page of clips for people to rate; and with --key, what their answers say."
EXAMPLE = "study METHODS -o study.html, then: physgen evaluate study answers/*.json --key study.key.json -o out/study"


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "paths",
        metavar="PATH",
        type=Path,
        nargs="+",
        help="a folder of methods with METHOD/SCENE.mp4 or METHOD/SCENE/video.mp4 in it; with --key: files that "
        "raters saved, or a folder of them",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="PATH",
        type=Path,
        help="the page to rate on, its key beside it (default: study.html, study.key.json); with --key: a folder "
        "for a page of the result",
    )
    parser.add_argument("--key", metavar="FILE", type=Path, help="read answers with the key of their study")
    parser.add_argument("--videos", metavar="N", type=count, help="scenes shown of every method; default: 15")
    parser.add_argument("--seed", metavar="N", type=seed, default=0, help="of what is drawn; default: 0")


VIDEOS = 15
"""As in the paper."""


def run(options: argparse.Namespace) -> int:
    return _read(options) if options.key else _make(options)


def _make(options: argparse.Namespace) -> int:
    from physgen.evaluate.methods import methods_in
    from physgen.evaluate.study import check_page, make, write_study
    from physgen.report.films import size_warning

    if any(path.suffix == ".json" for path in options.paths):
        fix = "name the key that was made with the page, e.g. --key study.key.json"
        raise InputError.of("--key", "", "is missing: answers are read with it", fix)
    if len(options.paths) > 1:
        raise InputError.of(
            str(options.paths[1]), "", "is a second folder", "name one that holds all methods' folders"
        )
    page: Path = options.output or Path("study.html")
    check_page(page)
    bar = Bar()
    methods = methods_in(options.paths[0])
    made = make(methods, options.videos or VIDEOS, options.seed, bar.show)
    bar.clear()
    key = write_study(made, page, print_backup)
    if left_out := set(methods.scenes) - set(methods.complete):
        print_error(f"left out, since not every method has made them: {', '.join(sorted(left_out))}")
    if (large := size_warning(page, "name fewer with --videos")) is not None:
        print_problem(large)
    count, scenes = len(methods.names), len(made.key.scenes)
    if options.json:
        record = {"page": str(page), "key": str(key), "study": made.key.study, "clips": len(made.clips)}
        print_json({**record, "methods": made.key.methods, "scenes": made.key.scenes, "seed": options.seed})
        return OK
    print(page)
    several = f"{count} method{'s' * (count != 1)}, {scenes} scene{'s' * (scenes != 1)}"
    clips = f"{len(made.clips)} clip{'s' * (len(made.clips) != 1)}"
    print_error(f"{clips}: {several}. Send {page.name} to those who rate.")
    if count == 1:
        print_error("It is of one method alone: there is nothing to compare its scores with.")
    print_error(
        f"{key} says which clip is of which method: keep it to yourself, and read answers with --key {key}"
    )
    return OK


def _read(options: argparse.Namespace) -> int:
    from physgen.evaluate.measure import check_folder
    from physgen.evaluate.ratings import files_in, findings, read_answers
    from physgen.evaluate.study import read_key

    if options.videos is not None:
        raise InputError.of("--videos", "", "has no part in reading answers", "leave it out, or --key")
    check_folder(options.output)
    key = read_key(options.key)
    answers = read_answers(files_in(options.paths, options.key), key)
    return hand_over(findings(answers, options.seed), options)
