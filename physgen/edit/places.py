"""Places in a file's text: where lines and entries begin and end, and what stands around them."""

from __future__ import annotations

import re
from collections.abc import Sequence

from physgen.edit.marked import Marked

Patch = tuple[int, int, str]
"""First and last character of what goes, and what comes."""

BREAK = re.compile("\r\n|[\n\r\x85\u2028\u2029]")


def entry(text: str, parent: Marked, at: int) -> int:
    """Where the entry of a child begins: its key, or its dash."""
    if parent.is_map:
        return parent.keys[at][1]
    if parent.is_flow:
        return parent.children[at].begin
    if at == 0:
        return parent.begin
    place = line_after(text, parent.children[at - 1].end)
    while text[place : place + parent.column].strip(" ") or text[place + parent.column] != "-":
        place = line_after(text, place)
    return place + parent.column


def line_before(text: str, place: int) -> int:
    """The end of the line before the one that begins at `place`."""
    return place - (2 if text[:place].endswith("\r\n") else 1)


def line_begin(text: str, place: int) -> int:
    """Where the line of a place begins."""
    while place and not BREAK.match(text[place - 1]):
        place -= 1
    return place


def line_end(text: str, place: int) -> int:
    """Where the line of a place ends, before its break."""
    found = BREAK.search(text, place)
    return found.start() if found else len(text)


def line_after(text: str, place: int) -> int:
    """Where the next line begins."""
    found = BREAK.search(text, place)
    return found.end() if found else len(text)


def leads(text: str, place: int) -> bool:
    """Whether nothing stands before a place in its line."""
    return not text[line_begin(text, place) : place].strip(" ")


def newline(text: str) -> str:
    """How the lines of a text end."""
    found = BREAK.search(text)
    return found[0] if found and found[0] in ("\r\n", "\r") else "\n"


def below(text: str, place: int, lines: Sequence[str]) -> Patch:
    """Lines after that of a place."""
    stop, line = line_end(text, place), newline(text)
    return stop, stop, line + line.join(lines)


def joint(text: str, node: Marked, before: Marked) -> str:
    """What parts a new entry in brackets from the one before: a line's end, where each has a line of its own."""
    begin = node.keys[node.children.index(before)][1] if node.is_map else before.begin
    if leads(text, begin) and line_begin(text, begin) > node.begin:
        return "," + newline(text) + text[line_begin(text, begin) : begin]
    return ", "
