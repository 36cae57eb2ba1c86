"""The formats there are, and those that the help names."""

from __future__ import annotations

from physgen.cli.export import NAMES
from physgen.export.formats import FORMATS


def test_the_help_names_the_formats_there_are() -> None:
    assert tuple(kind.name for kind in FORMATS) == NAMES
