"""Callbacks for the progress of long stages."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Called with the stage's name, how much is done and how much there is."""


def silent(stage: str, done: int, total: int) -> None:
    """Report no progress."""
