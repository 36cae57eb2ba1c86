"""`physgen evaluate leaderboard`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.measures.output import add_output, show
from physgen.cli.output import OK, Bar, print_backup, print_error

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


def run(options: argparse.Namespace) -> int:
    from physgen.evaluate.leaderboard import findings, make_board, scores_of, write_board
    from physgen.evaluate.measure import check_folder
    from physgen.evaluate.methods import methods_in

    folder: Path | None = options.output
    check_folder(folder)
    methods = methods_in(options.folder, options.photos)
    scores = scores_of(methods, options.scores)
    bar = Bar()
    board = make_board(methods, scores, folder, bar.show)
    bar.clear()
    if folder:
        title = options.title or methods.folder.resolve().name
        index = write_board(board, folder, title, options.command_line, print_backup)
        print_error(f"the page: {index}")
    show(findings(board), options)
    return OK
