"""How a file begins and how its lines end, which an edit leaves as it is."""

from __future__ import annotations

import codecs
from dataclasses import dataclass


@dataclass(frozen=True)
class Ends:
    """Of one file."""

    bom: bool = False
    """Whether it begins with a byte order mark."""
    crlf: bool = False
    """Whether its lines end as on Windows."""

    def encoded(self, text: str) -> bytes:
        """The bytes of the file that holds a text."""
        return (codecs.BOM_UTF8 if self.bom else b"") + text.encode("utf-8")

    def adapted(self, text: str) -> str:
        """A text from a page, whose fields have no carriage returns, with the line ends of the file."""
        text = text.removeprefix("\ufeff")
        return text.replace("\n", "\r\n") if self.crlf and "\r" not in text else text
