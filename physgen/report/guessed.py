"""Numbers that are drawn -> one sentence's worth of which, with their values, and whose guesses they are."""

from __future__ import annotations

from collections.abc import Sequence

from physgen.fan.doubt import Doubt
from physgen.fan.verdict import percent

MOST_GUESSES = 6
"""Numbers that are named as guesses above the picture; the table has all."""


def guesses(doubts: Sequence[Doubt]) -> str:
    """Which numbers are drawn; those that are alike once. No file tells which was edited since it was guessed."""
    said: dict[tuple[object, ...], list[Doubt]] = {}
    for doubt in doubts:
        kind = (doubt.label or doubt.thing, doubt.parameter, doubt.value, doubt.source)
        said.setdefault(kind, []).append(doubt)
    named = []
    for first, *others in said.values():
        whose = f"of all {1 + len(others)} called “{first.label}”" if others else f"of {first.thing}"
        sure = f", {percent(first.source.sure)} sure" if first.source.sure is not None else ""
        named.append(f"{first.parameter} {whose}, {first.value:.4g} ({first.source.text}{sure})")
    shown, more = named[:MOST_GUESSES], len(named) - MOST_GUESSES
    return "; ".join([*shown, f"{more} more" if more > 0 else ""]).removesuffix("; ")
