"""`physgen evaluate leaderboard`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.measures.output import add_output, show
from physgen.cli.output import OK, Bar, print_backup, print_error, print_problem
from physgen.problems import InputError

ABOUT = "Methods side by side: their clips of every scene in step, and what other measures say of them."
EXAMPLE = "leaderboard METHODS -o board"


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "folder",
        metavar="METHODS",
        type=Path,
        help="a folder of methods with METHOD/SCENE.mp4 or METHOD/SCENE/video.mp4 in it",
    )
    add_output(parser, "write the page into this folder; default: the table alone")
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
    from physgen.evaluate.leaderboard import cleaned_on_failure, findings, make_board, scores_of, write_board
    from physgen.evaluate.measure import check_folder
    from physgen.evaluate.methods import methods_in
    from physgen.report.films import size_warning

    folder, single = options.output, options.single_file
    if single and not folder:
        raise InputError.of("--single-file", "", "needs a folder for the page", "name one with -o")
    check_folder(folder)
    methods = methods_in(options.folder, options.photos)
    scores = scores_of(methods, options.scores)
    bar = Bar()
    with cleaned_on_failure(folder):
        board = make_board(methods, scores, folder, single, bar.show)
        bar.clear()
        found = findings(board)
        if folder:
            title = options.title or methods.folder.resolve().name
            index = write_board(board, found, folder, title, options.command_line, single, print_backup)
    show(found, options)
    if folder:
        if single and (large := size_warning(index, "leave out --single-file")) is not None:
            print_problem(large)
        print_error(f"the page: {index}")
    return OK
