"""What passes between us and a model, wherever it runs: turns of a talk, and replies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from physgen.perceive.backends.vlm_answers import Query


@dataclass(frozen=True)
class Turn:
    """Something said after the question."""

    who: str
    """`assistant`, `user`."""
    text: str


@dataclass(frozen=True)
class Reply:
    """What a model said, and what it took."""

    text: str
    tokens_in: int = 0
    tokens_out: int = 0
    retries: int = 0
    """Times that the request was sent again."""
    cut: bool = False
    """Whether it was cut off for its length."""


class Model(Protocol):
    """Somebody who answers."""

    def complete(self, query: Query, turns: Sequence[Turn], seed: int) -> Reply:
        """What it says to a question, after `turns` of wrong answers. Raises InputError."""
        ...

    def close(self) -> None:
        """Memory and connections are let go."""
        ...
