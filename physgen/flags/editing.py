"""Flags of `edit`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.flags.perceiving import add_backends


def add_edit(sub: argparse.ArgumentParser) -> None:
    """A scene or a photo, and where its page is served."""
    sub.add_argument(
        "scene",
        metavar="SCENE or PHOTO",
        type=Path,
        help="a photo is perceived first, into a scene beside it that has its name; one that is there is opened",
    )
    sub.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        default=Path("out"),
        help="folder of what is rendered from the page; default: out",
    )
    sub.add_argument("--port", metavar="N", type=port, help="default: one that is free")
    sub.add_argument(
        "--host",
        default="127.0.0.1",
        help="name or address to listen at; default: 127.0.0.1, which this machine alone reaches",
    )
    sub.add_argument(
        "--no-browser", dest="browser", action="store_false", help="only print the address, open nothing"
    )
    sub.add_argument(
        "--allow-outside", action="store_true", help="let the scene read files outside its folder"
    )
    sub.add_argument("--json", action="store_true", help="print the address as a line of JSON")
    add_backends(sub)


def port(text: str) -> int:
    """A port of this machine; 0: one that is free."""
    if not (text.isascii() and text.isdecimal()) or int(text[:6]) > 65535:
        raise argparse.ArgumentTypeError(f"{text} is not a port; write a number up to 65535")
    return int(text)
