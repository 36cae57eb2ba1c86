"""How far many clips are: a bar with rate and time left on a terminal, nothing in a pipe."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import TYPE_CHECKING

from physgen.cli.printing import print_line, tell

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID


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
            tell(text)


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
