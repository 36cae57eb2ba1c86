"""`gallery`: folders of clips to one page."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.printing import OK, Bar, print_json, tell_kept, tell_one
from physgen.problems import InputError


def gallery(options: argparse.Namespace) -> int:
    from physgen.report.clips import clips_in
    from physgen.report.embedded import heavy
    from physgen.report.gallery import write_gallery

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
    if options.single_file and (large := heavy(made.index, "name fewer folders")) is not None:
        tell_one(large)
    if options.json:
        print_json(
            {"index": str(made.index), "clips": made.clips, "failures": made.failures, "bytes": made.bytes}
        )
    else:
        print(made.index)
    return OK
