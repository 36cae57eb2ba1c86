"""Seed, key and number of a draw -> a share in 0..1, from these alone: no draw needs those before it, nor a table.

A draw is read off a SHA-256: the same on every machine, in any order, in any process; another key has other draws, so
that a sweep keeps the draws of its keys when it gets one more.
"""

from __future__ import annotations

from hashlib import sha256
from math import isqrt

BITS = 52
"""Of a draw; with half a unit added it is exact in a float, and never 0 or 1."""
FINE = 20
"""Bits that place a draw within its stratum: few enough that it never leaves it by rounding."""
ROUNDS = 8
"""Of the Feistel network that shuffles strata."""


def lot(seed: int, key: str, number: int) -> float:
    """A draw of the uniform distribution over 0 < x < 1, independent of those of all other seeds, keys and numbers."""
    return (_bits(f"{seed}\n{key}\n{number}", BITS) + 0.5) / float(2**BITS)


def stratified(seed: int, key: str, number: int, count: int) -> float:
    """The same where `count` draws are one design: a Latin hypercube (McKay and others 1979).

    Of the `count` equal strata of 0..1 each holds exactly one of the draws 0 .. count - 1, in an order that is
    another one for every key.
    """
    place = (_bits(f"{seed}\n{key}\n{number}\nplace", FINE) + 0.5) / float(2**FINE)
    return (shuffled(seed, key, number, count) + place) / count


def shuffled(seed: int, key: str, number: int, count: int) -> int:
    """Where a permutation of 0 .. count - 1 takes `number`.

    An alternating Feistel network over a rectangle of at least `count` cells (Black and Rogaway 2002, Ciphers with
    arbitrary finite domains); what falls off the count walks on.
    """
    wide = isqrt(count - 1) + 1 if count > 1 else 1
    high = -(-count // wide)
    while True:
        row, column = divmod(number, wide)
        for turn in range(ROUNDS):
            if turn % 2:
                column = (column + _bits(f"{seed}\n{key}\n{turn}\n{row}\norder", 64)) % wide
            else:
                row = (row + _bits(f"{seed}\n{key}\n{turn}\n{column}\norder", 64)) % high
        number = row * wide + column
        if number < count:
            return number


def _bits(text: str, count: int) -> int:
    return int.from_bytes(sha256(text.encode("utf-8")).digest()[:8], "big") >> (64 - count)
