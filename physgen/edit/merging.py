"""Three texts, of which two come of the first -> one with the changes of both, line by line; or where they clash."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from difflib import SequenceMatcher
from typing import Any


@dataclass(frozen=True)
class Clash:
    """Lines that both changed, each in its own way; `line` counts from 1 in mine."""

    line: int
    base: str
    mine: str
    theirs: str

    def as_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        return {"line": self.line, "base": self.base, "mine": self.mine, "theirs": self.theirs}


@dataclass(frozen=True)
class Merged:
    """The text with both changes, None where they clash."""

    text: str | None
    clashes: tuple[Clash, ...] = ()


def merged(base: str, mine: str, theirs: str) -> Merged:
    """By lines, as diff3 does: what both left alone parts the changes.

    >>> merged("a\\nb\\nc\\n", "A\\nb\\nc\\n", "a\\nb\\nC\\n").text
    'A\\nb\\nC\\n'
    >>> merged("a\\n", "b\\n", "c\\n").clashes[0].theirs
    'c\\n'
    """
    old, one, two = (_lines(text) for text in (base, mine, theirs))
    made: list[str] = []
    clashes: list[Clash] = []
    at = a = b = 0
    for begin, end, first, second in [*_shared(old, one, two), (len(old), len(old), len(one), len(two))]:
        was, ours, others = old[at:begin], one[a:first], two[b:second]
        if ours == others or others == was:
            made += ours
        elif ours == was:
            made += others
        else:
            clashes.append(Clash(a + 1, "".join(was), "".join(ours), "".join(others)))
        made += old[begin:end]
        at, a, b = end, first + end - begin, second + end - begin
    return Merged(None if clashes else "".join(made), tuple(clashes))


def _lines(text: str) -> list[str]:
    """With their ends; of line feeds alone, as editors count."""
    return [line + "\n" for line in text.split("\n")[:-1]] + (
        [text.rpartition("\n")[2]] if text[-1:] != "\n" else []
    )


def _shared(old: list[str], one: list[str], two: list[str]) -> Iterator[tuple[int, int, int, int]]:
    """Runs of lines that neither changed: where they begin and end in the old, and begin in the others."""
    left, right = _kept(old, one), _kept(old, two)
    i = j = 0
    while i < len(left) and j < len(right):
        (a, m, long), (b, n, wide) = left[i], right[j]
        begin, end = max(a, b), min(a + long, b + wide)
        if begin < end:
            yield begin, end, m + begin - a, n + begin - b
        if a + long < b + wide:
            i += 1
        else:
            j += 1


def _kept(old: list[str], new: list[str]) -> list[tuple[int, int, int]]:
    return [
        (m.a, m.b, m.size)
        for m in SequenceMatcher(None, old, new, autojunk=False).get_matching_blocks()
        if m.size
    ]
