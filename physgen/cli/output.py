"""Printing: results to stdout, messages and progress to stderr."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from physgen.problems import Problem

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID


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
    print_error(f"{str(kept).rpartition('~')[0]}: was there already and differed; kept as {kept.name}")


def print_json(data: Any) -> None:
    """A result for a program."""
    import json

    print(json.dumps(data, indent=1, ensure_ascii=False, default=str))


def write_result(text: str, output: Path | None) -> None:
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
            print_error(json.dumps({"progress": stage, "done": done, "total": total}))

    def clear(self) -> None:
        """Leave an empty line for what is printed next."""
        if self._live and self._wide:
            print("\r" + " " * self._wide + "\r", end="", file=sys.stderr, flush=True)
            self._wide = 0


class Counter:
    """Counts clips up to `total`, 0 for one that shows its own progress."""

    def __init__(self, total: int) -> None:
        self._total = total
        self._progress: Progress | None = None
        self._task: TaskID | None = None

    def __enter__(self) -> Counter:
        if self._total and sys.stderr.isatty():
            self._progress = _bar()
            self._task = self._progress.add_task("", total=self._total, failed="")
            self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._progress is not None:
            self._progress.stop()

    def step(self, failed: int) -> None:
        """One more is done; so many of all failed."""
        if self._progress is not None and self._task is not None:
            self._progress.update(self._task, advance=1, failed=f"{failed:,} failed" if failed else "")

    def line(self, text: str) -> None:
        """A result, on stdout."""
        if self._progress is not None and sys.stdout.isatty():  # the same screen
            self._progress.console.print(text, markup=False, emoji=False, highlight=False, soft_wrap=True)
        else:
            print_line(text)

    def tell(self, text: str) -> None:
        """Anything else, on stderr."""
        if self._progress is not None:
            self._progress.console.print(text, markup=False, emoji=False, highlight=False, soft_wrap=True)
        else:
            print_error(text)


def _bar() -> Progress:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    class Rate(ProgressColumn):
        """Clips a second, or a minute where they are slow."""

        def render(self, task: object) -> Text:
            speed = getattr(task, "finished_speed", None) or getattr(task, "speed", None)
            if not speed:
                return Text("")
            return Text(f"{speed:.1f}/s" if speed >= 1 else f"{60 * speed:.1f}/min")

    return Progress(
        MofNCompleteColumn(),
        BarColumn(),
        Rate(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[failed]}"),
        console=Console(stderr=True),
        redirect_stdout=False,
        redirect_stderr=False,
        transient=True,
    )
