"""Run `gallery`: make one page of folders of clips."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen import report
from physgen.cli.arguments import Command, Parser
from physgen.cli.output import OK, Bar, print_backup, print_json
from physgen.files import check_writable
from physgen.messages import Message

PAGE_SUFFIXES = (".html", ".htm")
"""Suffixes of pages in browsers."""


def gallery(options: argparse.Namespace) -> int:
    folders: list[Path] = options.folders
    index = (
        options.output or (folders[0] if len(folders) == 1 else Path()) / "index.html"
    )
    if not index.is_dir() and index.suffix.lower() not in PAGE_SUFFIXES:
        raise Message.NOT_A_PAGE_NAME.error(
            "-o", f'"{index}"', example=index.with_suffix(".html")
        )
    if not index.is_dir():
        check_writable(index.parent)
    if not index.is_dir() and not report.clips.clips_in(folders):
        raise Message.NO_PHYSGEN_CLIPS.error(", ".join(map(str, folders)))
    # The page is written last, after all checks of its name and folders.
    bar = Bar()
    page = report.gallery.write_gallery(
        folders, index, title=options.title, progress=bar.show, keep=print_backup
    )
    bar.clear()
    if options.json:
        print_json(
            {
                "index": str(page.index),
                "clips": page.clips,
                "failures": page.failures,
                "bytes": page.bytes,
            }
        )
    else:
        print(page.index)
    return OK


def add(parser: Parser) -> None:
    help_text = "folders of rendered clips, at any depth"
    parser.add_argument("folders", metavar="DIR", type=Path, nargs="+", help=help_text)
    help_text = "write the page here, pictures beside it; default: index.html in DIR, or here for several"
    parser.option("-o --output", "FILE", Path, help_text)
    parser.option(
        "--title", "TEXT", str, "title of the page; default: the names of the folders"
    )
    parser.flag("--json", "print what was written as JSON")


GALLERY = Command(
    "gallery",
    "Makes one page of clips; a sweep is shown as a grid of its values.",
    "physgen gallery out sweep -o gallery.html",
    add,
    gallery,
    is_order_free=True,
)
