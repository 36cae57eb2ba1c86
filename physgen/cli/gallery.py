"""`gallery`: folders of clips to one page."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.output import OK, Bar, print_backup, print_json, print_problem
from physgen.problems import InputError

# ----------------------------------------------------------------------
# `gallery`: folders of clips to one page.


def gallery(options: argparse.Namespace) -> int:
    from physgen.report.clips import clips_in
    from physgen.report.films import size_warning
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
        keep=print_backup,
    )
    bar.clear()
    if options.single_file and (large := size_warning(made.index, "name fewer folders")) is not None:
        print_problem(large)
    if options.json:
        print_json(
            {"index": str(made.index), "clips": made.clips, "failures": made.failures, "bytes": made.bytes}
        )
    else:
        print(made.index)
    return OK


# ----------------------------------------------------------------------
# Flags of `gallery`.


def add_gallery(sub: argparse.ArgumentParser) -> None:
    """Folders of clips, and the page that shows them."""
    sub.add_argument(
        "folders", metavar="DIR", type=Path, nargs="+", help="what physgen rendered into, at any depth"
    )
    sub.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        type=Path,
        help="write the page here, pictures beside it; default: index.html in DIR, or here for several",
    )
    sub.add_argument("--title", metavar="TEXT", help="what stands above it; default: the folders' names")
    sub.add_argument(
        "--single-file", action="store_true", help="put pictures and videos into the page, to be mailed"
    )
    sub.add_argument("--json", action="store_true", help="print what was written as JSON")
