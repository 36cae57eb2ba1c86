"""`physgen evaluate leaderboard`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from physgen.cli.output import OK, Bar, print_backup, print_error, print_json, print_problem
from physgen.problems import InputError

ABOUT = "Methods side by side: their clips of every scene in step, and what other measures say of them."
EXAMPLE = "leaderboard METHODS -o board"


def add(parser: argparse.ArgumentParser) -> None:
    """Clips by method and scene, scores, and the page."""
    parser.add_argument(
        "folder",
        metavar="METHODS",
        type=Path,
        help="a folder of methods with METHOD/SCENE.mp4 or METHOD/SCENE/video.mp4 in it",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="write the page into this folder; default: the table alone",
    )
    parser.add_argument(
        "--scores",
        metavar="RESULT",
        type=Path,
        action="append",
        default=[],
        help="a result.json of another measure whose rows name these methods, or its folder; those in METHODS "
        "are found",
    )
    parser.add_argument(
        "--photos",
        metavar="DIR",
        type=Path,
        help="photos that the clips begin with, SCENE.png, and what was asked for, SCENE.txt; default: METHODS/photos",
    )
    parser.add_argument(
        "--title", metavar="TEXT", help="what stands above the page; default: the folder's name"
    )
    parser.add_argument(
        "--single-file", action="store_true", help="put pictures and videos into the page, to be mailed"
    )


def run(options: argparse.Namespace) -> int:
    from physgen.evaluate.board import page
    from physgen.evaluate.board.scores import scores_of
    from physgen.evaluate.board.standing import findings
    from physgen.evaluate.measure import check_folder, markdown, text
    from physgen.evaluate.methods import methods_in
    from physgen.report.films import size_warning

    if options.single_file and not options.output:
        raise InputError.of("--single-file", "", "needs a folder for the page", "name one with -o")
    check_folder(options.output)
    methods = methods_in(options.folder, options.photos)
    scores = scores_of(methods, options.scores)
    bar = Bar()
    with page.whole(options.output):
        made = page.films(methods, options.output, options.single_file, bar.show)
        bar.clear()
        found = findings(methods, made.broken, scores)
        if options.output:
            title = options.title or methods.folder.resolve().name
            how = (options.output, title, options.command_line, options.single_file, print_backup)
            index = page.write_board(methods, scores, made, found, *how)
    if options.json:
        print_json(found.as_dict())
    else:
        sys.stdout.write(markdown(found) if options.markdown else text(found))
    if options.output:
        if options.single_file and (large := size_warning(index, "leave out --single-file")) is not None:
            print_problem(large)
        print_error(f"the page: {index}")
    return OK
