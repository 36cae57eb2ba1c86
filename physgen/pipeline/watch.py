"""Who is told how far a stage has come, and of what is odd on the way."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from physgen.problems import Warn, ignore_warning

__all__ = ["Keep", "Progress", "Warn", "ignore_warning", "silent"]

Progress = Callable[[str, int, int], None]
"""Called with the stage's name, how much is done and how much there is."""


def silent(stage: str, done: int, total: int) -> None:
    """Progress that nobody watches."""


Keep = Callable[[Path], None]
"""Told of every file that stood in the way and was kept under another name."""
