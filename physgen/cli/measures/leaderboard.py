"""`evaluate leaderboard`: a table of methods, and a page with their clips side by side."""

from __future__ import annotations

import argparse
import sys

from physgen.cli.printing import OK, Bar, print_json, tell, tell_kept, tell_one
from physgen.problems import InputError


def leaderboard(options: argparse.Namespace) -> int:
    from physgen.evaluate.board import page
    from physgen.evaluate.board.scores import scores_of
    from physgen.evaluate.board.standing import findings
    from physgen.evaluate.findings import markdown, text
    from physgen.evaluate.methods import methods_in
    from physgen.evaluate.page import check_folder
    from physgen.report.embedded import heavy

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
            how = (options.output, title, options.command_line, options.single_file, tell_kept)
            index = page.write_board(methods, scores, made, found, *how)
    if options.json:
        print_json(found.as_dict())
    else:
        sys.stdout.write(markdown(found) if options.markdown else text(found))
    if options.output:
        if options.single_file and (large := heavy(index, "leave out --single-file")) is not None:
            tell_one(large)
        tell(f"the page: {index}")
    return OK
