"""Results to stdout, everything else to stderr: the only lines that print."""

from __future__ import annotations

import os
import sys
import time
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


PROGRESS = "PHYSGEN_PROGRESS"
"""Environment variable: `json` tells a program how far it is, a line of JSON on stderr ten times a second."""
OFTEN = 0.1
"""s between two such lines of one stage."""


class Bar:
    """Progress on one line of a terminal; silent in pipes, but for programs that ask."""

    def __init__(self) -> None:
        self.told = os.environ.get(PROGRESS) == "json"
        self._live = sys.stderr.isatty() and not self.told
        self._wide = 0
        self._last = "", 0.0

    def of(self, name: str) -> Callable[[str, int, int], None]:
        """Progress of one scene."""
        return lambda stage, done, total: self.show(f"{name} {stage}".strip(), done, total)

    def show(self, stage: str, done: int, total: int) -> None:
        """Draw, at most."""
        if self.told:
            self._tell(stage, done, total)
        elif self._live:
            text = f"{stage} {done}/{total}" if total > 1 else stage
            print("\r" + text.ljust(self._wide), end="", file=sys.stderr, flush=True)
            self._wide = len(text)

    def _tell(self, stage: str, done: int, total: int) -> None:
        import json

        now = time.monotonic()
        if stage != self._last[0] or now - self._last[1] >= OFTEN or done >= total:
            self._last = stage, now
            tell(json.dumps({"progress": stage, "done": done, "total": total}))

    def clear(self) -> None:
        """Leave an empty line for what is printed next."""
        if self._live and self._wide:
            print("\r" + " " * self._wide + "\r", end="", file=sys.stderr, flush=True)
            self._wide = 0
