"""Printing: results to stdout, messages and progress to stderr."""

from __future__ import annotations

import os
import stat
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from physgen.operating_system import open_file_path
from physgen.problems import Problem

OK, FAILED, INTERRUPTED = 0, 1, 130


def print_error(text: str) -> None:
    """One line to stderr."""
    print(text, file=sys.stderr, flush=True)


def print_line(text: str) -> None:
    """One line of a result, at once."""
    print(text, flush=True)


def print_problems(problems: Sequence[Problem]) -> None:
    """One line each to stderr."""
    for problem in problems:
        print_error(str(problem))


def print_problem(problem: Problem) -> None:
    """One line to stderr."""
    print_error(str(problem))


def print_backup(kept: Path) -> None:
    """One line to stderr for a file that stood in the way."""
    print_error(
        f"{str(kept).rpartition('~')[0]}: was there already and differed; kept as {kept.name}"
    )


def print_json(data: Any) -> None:
    """A result as JSON."""
    import json

    print(json.dumps(data, indent=1, ensure_ascii=False, default=str))


def write_result(
    text: str, output: Path | None, redirected: Path | None = None
) -> None:
    """Write a scene to stdout, or the path of the file that has it.

    `redirected` is the file that stdout goes to, as `stdout_file` returns it.
    """
    if output is None and redirected is None:
        _print_assets_place(text)
    sys.stdout.write(text if output is None else f"{output}\n")


def _print_assets_place(text: str) -> None:
    """Print where the assets of a scene on stdout are, and how to save the scene."""
    from physgen.scene.yaml_edit import marked

    assets = marked(text).data()["assets"]
    print_error(
        f"{assets}: holds the maps of the scene on stdout; save the scene as a file "
        f"in {Path().resolve()}, or name the file with -o"
    )


def stdout_file() -> Path | None:
    """Return the regular file that stdout is redirected to; None for a pipe or terminal.

    None, too, if the system does not tell the name of an open file.
    """
    try:
        descriptor = sys.stdout.fileno()
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            return None
        path = open_file_path(descriptor)
        # the file may have been renamed or removed since it was opened
        if path is None or not os.path.samestat(status, path.stat()):
            return None
        return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
    except (OSError, ValueError):
        return None


PROGRESS = "PHYSGEN_PROGRESS"
"""Environment variable: `json` makes progress a line of JSON on stderr, for programs."""
JSON_INTERVAL = 0.1
"""s between two such lines of one stage, at least."""


class Bar:
    """Progress on one line of a terminal; silent in pipes, except for programs that ask."""

    def __init__(self) -> None:
        self.as_json = os.environ.get(PROGRESS) == "json"
        self._live = sys.stderr.isatty() and not self.as_json
        self._width = 0
        self._last = "", 0.0
        self.prefix = ""
        """Before each text."""

    def show(self, stage: str, done: int, total: int) -> None:
        """Draw the line again."""
        if self.as_json:
            self._print_json(stage, done, total)
        else:
            self.write(
                self.prefix + (f"{stage} {done}/{total}" if total > 1 else stage)
            )

    def write(self, text: str) -> None:
        """Put a text in the line."""
        if self._live:
            print("\r" + text.ljust(self._width), end="", file=sys.stderr, flush=True)
            self._width = len(text)

    def clear(self) -> None:
        """Leave an empty line for the next print."""
        if self._width:
            self.write("")
            self.write("\r")
            self._width = 0

    def _print_json(self, stage: str, done: int, total: int) -> None:
        import json

        now = time.monotonic()
        if (
            stage != self._last[0]
            or now - self._last[1] >= JSON_INTERVAL
            or done >= total
        ):
            self._last = stage, now
            print_error(json.dumps({"progress": stage, "done": done, "total": total}))
