"""Path of a value in a scene -> a warning about it."""

from __future__ import annotations

from physgen.problems import Problem, Severity
from physgen.scene.model import Scene


def warning(scene: Scene, path: str, found: str, expected: str, fix: str) -> Problem:
    """A Problem that stops nothing, at the place where `path` was written."""
    return Problem(scene.place(path), path, found, expected, fix, Severity.WARNING)
