"""`a:b:n` -> evenly spaced numbers, `a:b:n:log` -> evenly spaced in their logarithm; any one of them by its index."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction

from physgen.batch.quantiles import FINE, between
from physgen.batch.values import Value, WrongError, numeric, of

MOST = 10_000_000
WIDE = 2**53
"""Whole numbers from which on a float does not hold every one: they are floats here."""
_LOOKS = re.compile(r"[-+.\d][^:\s\[\]{}'\"]*(?::[^:\s\[\]{}'\"]*)+").fullmatch
_PLAIN = re.compile(r"[-+]?(?:\d{1,40}(?:\.\d{0,40})?|\.\d{1,40})(?:[eE][-+]?\d{1,3})?").fullmatch


@dataclass(frozen=True)
class Steps:
    """Numbers from one end to the other, both among them."""

    begin: Fraction
    end: Fraction
    count: int
    log: bool = False
    """Each is the one before times the same factor."""

    def at(self, index: int) -> Value:
        """One of them; worked out exactly, so that 0:1:11 holds 0.3 and not 0.30000000000000004."""
        last = self.count - 1
        if self.log and 0 < index < last:
            share = FINE.divide(Decimal(index), Decimal(last))
            return of(_short(Fraction(between(float(self.begin), float(self.end), share))))
        return of(_short(self.begin + (self.end - self.begin) * Fraction(index, last)))

    @property
    def whole(self) -> bool:
        """Whether all of them are whole numbers, and small enough to be written as such."""
        step = (self.end - self.begin) / (self.count - 1)
        exact = not self.log and self.begin.denominator == step.denominator == 1
        return exact and max(abs(self.begin), abs(self.end)) < WIDE


def looks_like(text: str) -> bool:
    """Whether text is meant as a range: `1:2:3`, and `1:2` and `1:2:x` too."""
    return _LOOKS(text) is not None


def read(text: str) -> Steps:
    """Raises WrongError."""
    parts = text.split(":")
    ends = [numeric(part) for part in parts[:2]]
    example = f"{parts[0]}:{parts[1]}:5" if None not in ends else "0.1:0.9:5"
    if len(parts) not in (3, 4) or None in ends:
        raise WrongError("is not start:end:count", f"write e.g. {example}; text goes in quotes within quotes")
    count = int(parts[2]) if re.fullmatch("[0-9]{1,18}", parts[2]) else 0
    if not 2 <= count <= MOST:
        fix = f"write start:end:count, e.g. {example}"
        raise WrongError(f"has no count from 2 to {MOST:,} behind its ends", fix)
    begin, end = (_exact(part) for part in parts[:2])
    if begin == end:
        raise WrongError("ends where it begins", f"write {parts[0]} alone, or another end")
    if parts[3:] not in ([], ["log"]):
        raise WrongError(f'ends in "{parts[3]}"', f"write {':'.join(parts[:3])} or {':'.join(parts[:3])}:log")
    if parts[3:] and begin * end <= 0:
        raise WrongError(
            "has no logarithm: 0 lies between its ends, or is one", "take both above 0, or both below"
        )
    return Steps(begin, end, count, bool(parts[3:]))


def _exact(text: str) -> Fraction:
    """What the text says, not the float next to it; of odd spellings the float."""
    value = numeric(text)
    assert value is not None
    return Fraction(text) if _PLAIN(text) else Fraction(value)


def _short(value: Fraction) -> int | float:
    return int(value) if value.denominator == 1 and abs(value) < WIDE else float(value)
