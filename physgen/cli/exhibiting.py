"""`gallery`: folders of clips to one page."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.printing import OK, Bar, print_json, tell_kept, tell_one
from physgen.problems import InputError, Place, Problem, Severity


def gallery(options: argparse.Namespace) -> int:
    from physgen.report.clips import clips_in
    from physgen.report.gallery import MAILED, write_gallery

    folders: list[Path] = options.folders
    index = options.output or (folders[0] if len(folders) == 1 else Path()) / "index.html"
    if not index.is_dir() and not clips_in(folders):
        fix = "physgen render scene.yaml -o DIR makes some"
        raise InputError.of(", ".join(map(str, folders)), "", "holds no clips of physgen", fix)
    bar = Bar()
    made = write_gallery(
        folders,
        index,
        title=options.title,
        single=options.single_file,
        progress=bar.show,
        keep=tell_kept,
    )
    bar.clear()
    if options.single_file and made.bytes > MAILED:
        found, fix = f"has {made.bytes / 1e6:.0f} MB", "few mailboxes take more than 50: name fewer folders"
        tell_one(Problem(Place(str(index)), "", "", found, fix, Severity.WARNING))
    if options.json:
        print_json(
            {"index": str(made.index), "clips": made.clips, "failures": made.failures, "bytes": made.bytes}
        )
    else:
        print(made.index)
    return OK
