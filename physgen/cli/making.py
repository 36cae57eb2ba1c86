"""Jobs -> clips, one or very many; what is told while they are made, and at the end."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING

from physgen.cli.printing import FAILED, OK, Bar, print_line, tell
from physgen.cli.progress import Counter
from physgen.flags.parser import WRONG_INPUT
from physgen.problems import InputError

if TYPE_CHECKING:
    from physgen.batch.pool import Done, Job
    from physgen.batch.shelf import Shelf

MOST_SHOWN = 20_000
"""Clips of one gallery: above, its page is slow to open."""


class Shown(Enum):
    """Where clips are looked at."""

    GALLERY = "gallery"
    """In a page of all of them."""
    NOWHERE = "nowhere"
    """Programs read them."""


@dataclass
class Tally:
    """How many clips ended how."""

    made: int = 0
    unchanged: int = 0
    failed: int = 0
    newest: float = 0.0
    """s since 1970: when the newest clip was made."""
    full: bool = False
    """The disk: what is missing was not begun."""

    @property
    def all(self) -> int:
        """So far."""
        return self.made + self.unchanged + self.failed

    def __str__(self) -> str:
        parts = [f"{self.all:,} clips: {self.made:,} made"]
        parts += [f"{self.unchanged:,} unchanged"] if self.unchanged else []
        parts += [f"{self.failed:,} failed"] if self.failed else []
        return ", ".join(parts)


def make_all(
    jobs: Iterable[Job],
    count: int,
    options: argparse.Namespace,
    heard: Callable[[Done], None] = lambda done: None,
    beside: Callable[[], Sequence[str]] = lambda: (),
    shown: Shown = Shown.GALLERY,
) -> int:
    """Make `count` jobs, telling of each, and `heard` too; write the gallery, sum up; returns the exit code.

    `beside` finishes what else there is at the end, and returns the files to tell of; `shown` says who looks at it.
    """
    from physgen.batch.shelf import shelf

    kept_in = shelf(options.output)
    many = count > 1
    gallery = shown is Shown.GALLERY and (many or kept_in.has_index())
    if gallery and count <= MOST_SHOWN:
        jobs = (replace(job, pictured=True) for job in jobs)
    tally, told = Tally(), _Told()
    bar = Bar()
    with (
        Counter(count if many else 0) as counter,
        kept_in.cleared(),
        closing(_made(jobs, count, options, bar, counter)) as done_ones,
    ):
        for done in done_ones:
            bar.clear()
            if done.full:  # of every clip that follows the same would be said
                tally.full = True
                break
            _count(tally, done)
            for line in told.new(done):
                counter.tell(line)
            kept_in.ended(done, gallery)
            heard(done)
            _told_of(done, options.json, counter)
            counter.step(tally.failed)
    files = beside()
    if gallery and not tally.full and (tally.made or tally.failed or not kept_in.has_index(tally.newest)):
        _gallery(kept_in, bar, tally, options.output)
    return _sum_up(tally, count, kept_in, files, options)


def _made(
    jobs: Iterable[Job], count: int, options: argparse.Namespace, bar: Bar, counter: Counter
) -> Generator[Done, None, None]:
    """How each job ended, on this machine or on a cluster."""
    workers = min(options.jobs, count)
    if getattr(options, "cluster", None):
        from physgen.batch.cluster.farm import run_on

        return run_on(options.cluster, workers, jobs, count, options.ship, counter.tell)
    from physgen.batch.pool import run_all

    return run_all(jobs, workers, lambda job: bar.show if count == 1 or bar.told else _silent)


class _Told:
    """Warnings of one scene are those of its variants, too: each is told once."""

    def __init__(self) -> None:
        self._seen: set[str] = set()

    def new(self, done: Done) -> Iterator[str]:
        for problem in done.problems:
            text = str(problem)
            if text not in self._seen:
                if len(self._seen) < 10_000:
                    self._seen.add(text)
                yield text


def _silent(stage: str, done: int, total: int) -> None:
    """Many clips have one bar together."""


def _count(tally: Tally, done: Done) -> None:
    from physgen.batch.pool import State

    if done.folder is not None:
        with suppress(OSError):  # of one behind a URL there is nothing here
            tally.newest = max(tally.newest, (done.folder / "manifest.json").stat().st_mtime)
    match done.state:
        case State.MADE:
            tally.made += 1
        case State.UNCHANGED:
            tally.unchanged += 1
        case State.FAILED:
            tally.failed += 1


def _told_of(done: Done, as_json: bool, counter: Counter) -> None:
    """A line on stdout: the folder, or all about the clip as JSON."""
    import json

    if as_json:
        with suppress(InputError):
            line = {
                "clip": done.job.folder.name,
                "scene": done.job.path,
                "variant": done.job.variant,
                "state": done.state.value,
                "folder": done.where,
                "seconds": round(done.seconds, 3),
                "problems": [problem.as_dict() for problem in done.problems],
            }
            counter.line(json.dumps(line, ensure_ascii=False, default=str))
    elif done.where is not None:
        counter.line(done.where)


def _gallery(kept_in: Shelf, bar: Bar, tally: Tally, out: str) -> None:
    """The page of all that is in the folder, made again."""
    if tally.all > MOST_SHOWN:
        tell(f"{out}: too many clips for one gallery; physgen gallery shows parts of them")
        return
    kept_in.write_index(
        bar.show,
        lambda name: tell(f"{kept_in.index}: was there already and differed; kept as {name}"),
        tally.all,
    )
    bar.clear()


def _sum_up(
    tally: Tally, count: int, kept_in: Shelf, beside: Sequence[str], options: argparse.Namespace
) -> int:
    """The last line, and the exit code."""
    import json

    index = kept_in.index if count > 1 and kept_in.has_index() else None
    if options.json:
        line = {
            "clips": count,
            "made": tally.made,
            "unchanged": tally.unchanged,
            "failed": tally.failed,
            "index": index,
            **{file.rpartition("/")[2]: file for file in beside},
            "passed": tally.failed == 0 and tally.all == count,
        }
        print_line(json.dumps(line))
    else:
        for file in ([] if index is None else [index]) + [*beside]:
            print_line(file)
    if tally.full:
        left = count - tally.made - tally.unchanged
        tell(
            f"{options.output}: no room left: {left:,} of {count:,} clips are missing; "
            "make room and run the same command again"
        )
        return FAILED
    if count > 1 and (tally.failed or tally.unchanged) and not (options.json and not tally.failed):
        tell(str(tally))
    elif tally.unchanged and not options.json:
        tell("1 clip, unchanged")
    return WRONG_INPUT if tally.failed else OK
