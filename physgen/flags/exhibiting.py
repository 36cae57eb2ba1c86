"""Flags of `gallery`."""

from __future__ import annotations

import argparse
from pathlib import Path


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
