"""Print results to stdout, messages and progress to stderr."""

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

from physgen import scene
from physgen.messages import Note
from physgen.operating_system import open_file_path
from physgen.problems import Place, Problem

OK, FAILED, INTERRUPTED = 0, 1, 130


def print_error(text: str) -> None:
    """Print one line to stderr."""
    print(text, file=sys.stderr, flush=True)


def print_line(text: str) -> None:
    """Print one line of a result, without buffering."""
    print(text, flush=True)


FLAGS = {"story": "--story", "free": "--free", "fitted": "-o"}
"""Keys of problems from lower layers -> the flags that set them."""


def named_by_flag(problem: Problem) -> Problem:
    """Return a problem with the flag as its place, if a flag sets its key."""
    flag = FLAGS.get(problem.place.file)
    if flag is None:
        return problem
    return replace(problem, place=Place(flag))


def print_problems(problems: Sequence[Problem]) -> None:
    """Print one line for each problem to stderr."""
    for problem in problems:
        print_problem(problem)


def print_problem(problem: Problem) -> None:
    """Print one line for a problem to stderr."""
    print_error(str(named_by_flag(problem)))


def print_backup(backup: Path) -> None:
    """Print a line to stderr about the backup of an older file."""
    name = str(backup).rpartition("~")[0]
    print_error(Note.BACKUP.text(name=name, backup=backup.name))


def print_json(data: Any) -> None:
    """Print a result as JSON."""
    print(json.dumps(data, indent=1, ensure_ascii=False, default=str))


def write_result(
    text: str, output: Path | None, stdout_target: Path | None = None
) -> None:
    """Write a scene to stdout, or the path of its file.

    `stdout_target` is the target file of stdout, from `stdout_file`.
    """
    if output is None and stdout_target is None:
        _print_assets_place(text)
    sys.stdout.write(text if output is None else f"{output}\n")


def _print_assets_place(text: str) -> None:
    """Print the place of the assets for a scene on stdout, and how to save
    the scene.
    """
    assets = scene.yaml_edit.mark_values(text).data()["assets"]
    print_error(
        f"{assets}: holds the maps of the scene on stdout; save the scene as a file "
        f"in {Path().resolve()}, or name the file with -o"
    )


def stdout_file() -> Path | None:
    """Return the regular file behind a redirected stdout, or None for a pipe or
    terminal.

    Also return None if the system does not tell the name of an open file.
    """
    try:
        descriptor = sys.stdout.fileno()
        status = os.fstat(descriptor)
        # A pipe or a terminal has no folder for assets.
        if not stat.S_ISREG(status.st_mode):
            return None
        path = open_file_path(descriptor)
        # Another process may have renamed or removed the open file.
        if path is None or not os.path.samestat(status, path.stat()):
            return None
        if path.is_relative_to(Path.cwd()):
            return path.relative_to(Path.cwd())
        return path
    except (OSError, ValueError):
        return None


PROGRESS = "PHYSGEN_PROGRESS"
"""Environment variable for programs: `json` prints progress as lines of JSON
on stderr.
"""
JSON_INTERVAL = 0.1
"""Minimum interval between two lines of JSON of one stage, s."""
TICK = 0.5
"""Interval between updates of a stage's duration, s."""
SHOWN_FROM = 1.0
"""Minimum duration to show, s. Most stages are shorter."""


class Bar:
    """Progress on one line of a terminal. In pipes it is silent, unless a program asks
    for JSON.
    """

    def __init__(self) -> None:
        self.as_json = os.environ.get(PROGRESS) == "json"
        self._live = sys.stderr.isatty() and not self.as_json
        self._width = 0
        self._last = "", 0.0
        self._text, self._begun = "", 0.0
        self._lock = threading.RLock()
        self.prefix = ""
        """Text before each stage."""

    def show(self, stage: str, done: int, total: int) -> None:
        """Show the progress of a stage."""
        if self.as_json:
            self._print_json(stage, done, total)
        else:
            self.write(
                self.prefix + (f"{stage} {done}/{total}" if total > 1 else stage)
            )

    def write(self, text: str) -> None:
        """Write a text to the line."""
        with self._lock:
            # The clock starts again with each new text.
            if text != self._text:
                self._text, self._begun = text, time.monotonic()
            self._draw(text)

    def clear(self) -> None:
        """Leave an empty line for the next print."""
        with self._lock:
            # Spaces cover the old text, and then the cursor returns to the margin.
            if self._width:
                self._draw("")
                self._draw("\r")
            self._width, self._text = 0, ""

    @contextmanager
    def ticking(self) -> Iterator[None]:
        """Show the duration of a running stage. Clear the line at the end."""
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
        """Return a function that prints on its own line, not behind the progress."""

        def print_aside(item: Any) -> None:
            with self._lock:
                self.clear()
                print_one(item)

        return print_aside

    def _tick(self, stop: threading.Event) -> None:
        while not stop.wait(TICK):
            with self._lock:
                seconds = time.monotonic() - self._begun
                # The stage may have ended while this thread waited for the lock.
                if self._text and seconds >= SHOWN_FROM and not stop.is_set():
                    self._draw(f"{self._text}, {seconds:.0f} s")

    def _draw(self, text: str) -> None:
        if self._live:
            print("\r" + text.ljust(self._width), end="", file=sys.stderr, flush=True)
            self._width = len(text)

    def _print_json(self, stage: str, done: int, total: int) -> None:
        time_now = time.monotonic()
        # A fast stage would otherwise print thousands of lines.
        if (
            stage != self._last[0]
            or time_now - self._last[1] >= JSON_INTERVAL
            or done >= total
        ):
            self._last = stage, time_now
            print_error(json.dumps({"progress": stage, "done": done, "total": total}))
