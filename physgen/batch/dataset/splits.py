"""A photo and shares -> the split of all its clips: the same photo is never in two."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass

from physgen.problems import InputError

FLAG = "--split"
_NAME = re.compile(r"[a-z][a-z0-9_]{0,30}")
BITS = 52


@dataclass(frozen=True)
class Splits:
    """Names and shares of photos, in their order; shares add up to 1."""

    shares: tuple[tuple[str, float], ...]
    seed: int

    def of(self, photo: str) -> str:
        """By the photo's SHA-256 and the seed alone: more photos, or fewer, leave it where it is.

        >>> even = Splits((("train", 0.5), ("test", 0.5)), 0)
        >>> [even.of(photo) for photo in "abcdef"]
        ['test', 'test', 'test', 'train', 'test', 'train']
        """
        digest = hashlib.sha256(f"{self.seed}:{photo}".encode()).digest()
        place = (int.from_bytes(digest[:8], "big") >> (64 - BITS)) / 2**BITS
        for name, share in self.shares:
            if place < share:
                return name
            place -= share
        return self.shares[-1][0]  # for the last bit alone

    @property
    def names(self) -> tuple[str, ...]:
        """Of the splits."""
        return tuple(name for name, _ in self.shares)


def read_splits(text: str, seed: int) -> Splits:
    """`train=0.8,test=0.2` -> splits. Raises InputError."""
    shares: dict[str, float] = {}
    for part in text.split(","):
        name, _, share = (piece.strip() for piece in part.partition("="))
        try:
            value = float(share)
        except ValueError:
            value = -1.0
        if not _NAME.fullmatch(name) or not 0 < value <= 1 or name in shares:
            fix = "write e.g. train=0.8,validation=0.1,test=0.1"
            raise InputError.of(FLAG, f'"{part.strip()}"', "is no split with its share of the photos", fix)
        shares[name] = value
    total = sum(shares.values())
    if abs(total - 1) > 1e-6:
        raise InputError.of(FLAG, f'"{text}"', f"adds up to {total:.6g}", "make the shares add up to 1")
    return Splits(tuple(shares.items()), seed)
