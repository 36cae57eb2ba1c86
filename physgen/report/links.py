"""Relative links of pages to other files and to the documentation on this machine."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import quote

from physgen.files import resource

PAPER = "https://stevenlsw.github.io/physgen/"
"""The project page of the PhysGen paper."""
SITE = ("out", "site", "index.html")
"""The start page of `make docs`, relative to the clone's folder."""
DOCUMENTS = {
    "docs": ("docs", "index.md"),
    "scene file": ("docs", "scene.md"),
    "code": ("README.md",),
}
"""Words of a link -> file in a clone."""


def link(path: Path, home: Path) -> str:
    """Return a relative URL from the folder `home` to a file."""
    relative = Path(os.path.relpath(path.absolute(), home.absolute())).as_posix()
    return quote(relative if relative.startswith("../") else f"./{relative}")


def document_links(home: Path) -> list[tuple[str, str]]:
    """Return words and URLs of the documentation from the folder `home`.

    An installed physgen has no documentation, and only the link to the paper.
    """
    root = resource("templates").parent
    links = []
    for words, parts in DOCUMENTS.items():
        file = root.joinpath(*parts)
        if words == "docs" and root.joinpath(*SITE).is_file():
            file = root.joinpath(*SITE)
        if file.is_file():
            links.append((words, link(file, home)))
    return [*links, ("paper", PAPER)]
