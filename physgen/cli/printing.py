"""Results to stdout, everything else to stderr: the only lines that print."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from physgen.problems import Problem

OK, FAILED, INTERRUPTED = 0, 1, 130


def tell(text: str) -> None:
    """One line to stderr."""
    print(text, file=sys.stderr, flush=True)


def print_line(text: str) -> None:
    """One line of a result, at once."""
    print(text, flush=True)


def tell_problems(problems: Sequence[Problem]) -> None:
    """One line each to stderr."""
    for problem in problems:
        tell(str(problem))


def tell_one(problem: Problem) -> None:
    """One line to stderr."""
    tell(str(problem))


def tell_kept(kept: Path) -> None:
    """One line to stderr for a file that stood in the way."""
    tell(f"{str(kept).rpartition('~')[0]}: was there already and differed; kept as {kept.name}")


def print_json(data: Any) -> None:
    """A result for a program."""
    import json

    print(json.dumps(data, indent=1, ensure_ascii=False, default=str))


def hand_over(text: str, output: Path | None) -> None:
    """The scene on stdout, or the path of the file that it went to."""
    sys.stdout.write(text if output is None else f"{output}\n")


class Bar:
    """Progress on one line of a terminal; silent in pipes."""

    def __init__(self) -> None:
        self._live = sys.stderr.isatty()
        self._wide = 0

    def of(self, name: str) -> Callable[[str, int, int], None]:
        """Progress of one scene."""
        return lambda stage, done, total: self.show(f"{name} {stage}".strip(), done, total)

    def show(self, stage: str, done: int, total: int) -> None:
        """Draw, at most."""
        if self._live:
            text = f"{stage} {done}/{total}" if total > 1 else stage
            print("\r" + text.ljust(self._wide), end="", file=sys.stderr, flush=True)
            self._wide = len(text)

    def clear(self) -> None:
        """Leave an empty line for what is printed next."""
        if self._live and self._wide:
            print("\r" + " " * self._wide + "\r", end="", file=sys.stderr, flush=True)
            self._wide = 0
