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


def run(options: argparse.Namespace) -> int:
    from physgen.evaluate.leaderboard import findings, make_board, write_board
    from physgen.evaluate.measure import check_folder
    from physgen.evaluate.methods import methods_in

    check_folder(options.output)
    bar = Bar()
    board = make_board(methods_in(options.folder), bar.show)
    bar.clear()
    if options.output:
        index = write_board(board, options.output, options.command_line, print_backup)
        print_error(f"the page: {index}")
    show(findings(board), options)
    return OK
