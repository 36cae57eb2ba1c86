"""Printing: results to stdout, messages and progress to stderr."""

from __future__ import annotations

import json
import os
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from physgen.messages import Note
from physgen.operating_system import open_file_path
from physgen.problems import Place, Problem

OK, FAILED, INTERRUPTED = 0, 1, 130


def print_error(text: str) -> None:
    """One line to stderr."""
    print(text, file=sys.stderr, flush=True)


def print_line(text: str) -> None:
    """Print one line of a result, at once."""
    print(text, flush=True)


FLAGS = {"story": "--story", "free": "--free", "fitted": "-o"}
"""The flag whose value a lower layer calls by the key."""


def named_by_flag(problem: Problem) -> Problem:
    """Return the problem of a key at the flag that sets it."""
    flag = FLAGS.get(problem.place.file)
    return problem if flag is None else replace(problem, place=Place(flag))


def print_problems(problems: Sequence[Problem]) -> None:
    """Print one line for each problem to stderr."""
    for problem in problems:
        print_problem(problem)


def print_problem(problem: Problem) -> None:
    """One line to stderr."""
    print_error(str(named_by_flag(problem)))


def print_backup(kept: Path) -> None:
    """Print a line to stderr for an older file that was kept."""
    name = str(kept).rpartition("~")[0]
    print_error(Note.BACKUP.text(name=name, backup=kept.name))


def print_json(data: Any) -> None:
    """Print a result as JSON."""
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
    from physgen.scene.yaml_edit import mark_values

    assets = mark_values(text).data()["assets"]
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
TICK = 0.5
"""s between two looks at how long a stage has taken."""
SHOWN_FROM = 1.0
"""s from which a stage's time is shown: most stages are over by then."""


class Bar:
    """Progress on one line of a terminal; silent in pipes, except for programs that ask."""

    def __init__(self) -> None:
        self.as_json = os.environ.get(PROGRESS) == "json"
        self._live = sys.stderr.isatty() and not self.as_json
        self._width = 0
        self._last = "", 0.0
        self._text, self._begun = "", 0.0
        self._lock = threading.RLock()
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
        with self._lock:
            if text != self._text:
                self._text, self._begun = text, time.monotonic()
            self._draw(text)

    def clear(self) -> None:
        """Leave an empty line for the next print."""
        with self._lock:
            if self._width:
                self._draw("")
                self._draw("\r")
            self._width, self._text = 0, ""

    @contextmanager
    def ticking(self) -> Iterator[None]:
        """Show for how many seconds a stage has been at work; clear the line at the end."""
        stop = threading.Event()
        ticker = threading.Thread(target=self._tick, args=(stop,), daemon=True)
        if self._live:
            ticker.start()
        try:
            yield
        finally:
            stop.set()
            if self._live:
                ticker.join()
            self.clear()

    def aside(self, print_one: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return a function that prints on a line of its own, not behind the progress."""

        def print_aside(what: Any) -> None:
            with self._lock:
                self.clear()
                print_one(what)

        return print_aside

    def _tick(self, stop: threading.Event) -> None:
        while not stop.wait(TICK):
            with self._lock:
                seconds = time.monotonic() - self._begun
                if self._text and seconds >= SHOWN_FROM and not stop.is_set():
                    self._draw(f"{self._text}, {seconds:.0f} s")

    def _draw(self, text: str) -> None:
        if self._live:
            print("\r" + text.ljust(self._width), end="", file=sys.stderr, flush=True)
            self._width = len(text)

    def _print_json(self, stage: str, done: int, total: int) -> None:
        time_now = time.monotonic()
        if (
            stage != self._last[0]
            or time_now - self._last[1] >= JSON_INTERVAL
            or done >= total
        ):
            self._last = stage, time_now
            print_error(json.dumps({"progress": stage, "done": done, "total": total}))
