"""`render`: scenes to clips, one or very many; what is told while they are made, and at the end."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.cli.printing import FAILED, OK, Bar, print_line, tell, tell_kept
from physgen.cli.progress import Counter
from physgen.flags import WRONG_INPUT
from physgen.problems import InputError

if TYPE_CHECKING:
    from physgen.batch.pool import Done, Job, Refiner

PREVIEWED = 24
"""Frames of a preview, at most."""
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


def render(options: argparse.Namespace) -> int:
    if options.watch:
        from physgen.cli.watching import watch

        return watch(options, lambda: _jobs(options), lambda jobs: make_all(jobs, len(jobs), options))
    jobs = _jobs(options)
    return make_all(jobs, len(jobs), options)


def _jobs(options: argparse.Namespace) -> list[Job]:
    jobs = list(jobs_of(options))
    refuse_twins(jobs)
    return jobs


def jobs_of(options: argparse.Namespace) -> Iterator[Job]:
    """What `render` is to make: scenes times variants. Raises InputError."""
    make = job_maker(options)
    for path in options.scenes:
        for variant in variants_of(path, options):
            yield make(path, variant, quick(path, variant, options) if options.preview else ())


def quick(path: str, variant: str | None, options: argparse.Namespace) -> tuple[str, ...]:
    """Edits that make a clip quick to draw: few frames, of the photo's size."""
    from physgen import pipeline

    try:
        scene = pipeline.load(path, options.set, variant, options.allow_outside)
    except InputError:  # told of where it is rendered
        return ()
    film, length = scene.render, scene.world.duration * scene.render.slow
    count = film.frames or max(1, round(film.fps * length))
    few = min(count, PREVIEWED)
    edits = [f"render.frames={few}", f"render.fps={max(1.0, film.fps * few / count):g}"]
    edits += ["render.motion_blur=0", "render.supersample=1"]
    edits += [f"render.{key}=" for key in ("size", "scale") if getattr(film, key) is not None]
    return tuple(edits)


def job_maker(options: argparse.Namespace) -> Callable[..., Job]:
    """Scene, variant, further overrides and a name -> a job as the flags say. Raises InputError."""
    from physgen import pipeline
    from physgen.batch.pool import Job
    from physgen.report.video import Format

    formats = tuple(Format(name) for name in options.format)
    if options.export:
        from physgen.cli.exporting import exportable

        exportable(options.export)
    refiner, overrides = _refining(options)

    def make(
        path: str,
        variant: str | None,
        further: tuple[str, ...] = (),
        name: str | None = None,
        tracked: tuple[str, ...] | None = None,
    ) -> Job:
        return Job(
            path,
            options.output,
            (*overrides, *further),
            variant,
            options.allow_outside,
            formats,
            tuple(options.command_line),
            options.chaos,
            options.device,
            refiner,
            options.cache,
            pipeline.Page(options.report or ("none" if options.preview else "full")),
            name,
            tracked,
            options.export,
        )

    return make


def make_all(
    jobs: Iterable[Job],
    count: int,
    options: argparse.Namespace,
    heard: Callable[[Done], None] = lambda done: None,
    beside: Callable[[], Sequence[Path]] = lambda: (),
    shown: Shown = Shown.GALLERY,
) -> int:
    """Make `count` jobs, telling of each, and `heard` too; write the gallery, sum up; returns the exit code.

    `beside` finishes what else there is at the end, and returns the files to tell of; `shown` says who looks at it.
    """
    from physgen.batch.pool import ended, run_all
    from physgen.report.leftovers import cleared

    root = Path(options.output)
    many = count > 1
    gallery = shown is Shown.GALLERY and (many or (root / "index.html").exists())
    tally, told = Tally(), _Told()
    bar = Bar()
    with Counter(count if many else 0) as counter:
        done_ones = run_all(jobs, min(options.jobs, count), lambda job: bar.show if not many else _silent)
        with cleared(root), closing(done_ones):  # type: ignore[type-var]
            for done in done_ones:
                bar.clear()
                if done.full:  # of every clip that follows the same would be said
                    tally.full = True
                    break
                _count(tally, done)
                for line in told.new(done):
                    counter.tell(line)
                ended(done, root, gallery)
                heard(done)
                _told_of(done, options.json, counter)
                counter.step(tally.failed)
    changed = tally.made or tally.failed or not (root / "index.html").exists()
    if gallery and changed and not tally.full and root.is_dir():
        _gallery(root, bar, tally)
    return _sum_up(tally, count, root, beside(), options)


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
                "folder": None if done.folder is None else str(done.folder),
                "seconds": round(done.seconds, 3),
                "problems": [problem.as_dict() for problem in done.problems],
            }
            counter.line(json.dumps(line, ensure_ascii=False, default=str))
    elif done.folder is not None:
        counter.line(str(done.folder))


def _gallery(root: Path, bar: Bar, tally: Tally) -> None:
    """The page of all that is in the folder, made again."""
    if tally.all > MOST_SHOWN:
        tell(f"{root}: too many clips for one gallery; physgen gallery shows parts of them")
        return
    from physgen.report.gallery import write_gallery

    write_gallery([root], root / "index.html", progress=bar.show, keep=tell_kept)
    bar.clear()


def _sum_up(tally: Tally, count: int, root: Path, beside: Sequence[Path], options: argparse.Namespace) -> int:
    """The last line, and the exit code."""
    import json

    index = root / "index.html"
    index = index if count > 1 and index.exists() else None  # type: ignore[assignment]
    if options.json:
        line = {
            "clips": count,
            "made": tally.made,
            "unchanged": tally.unchanged,
            "failed": tally.failed,
            "index": None if index is None else str(index),
            **{path.name: str(path) for path in beside},
            "passed": tally.failed == 0 and tally.all == count,
        }
        print_line(json.dumps(line))
    else:
        for path in ([] if index is None else [index]) + [*beside]:
            print_line(str(path))
    if tally.full:
        left = count - tally.made - tally.unchanged
        tell(
            f"{root}: no room left: {left:,} of {count:,} clips are missing; make room and run the same command again"
        )
        return FAILED
    if count > 1 and tally.failed:
        tell(str(tally))
    return WRONG_INPUT if tally.failed else OK


def _refining(options: argparse.Namespace) -> tuple[Refiner, tuple[str, ...]]:
    """Whose weights refine, and on what; and what the flags set in every scene."""
    from physgen import backends
    from physgen.batch.pool import Refiner

    device = (
        None if options.device == "cpu" else options.device
    )  # the processor draws, unless one says otherwise
    who = Refiner(options.refine or "", options.config, device)
    if options.refine is None:
        return who, tuple(options.set)
    name = options.refine.partition(":")[0]
    if name not in backends.names("refine"):
        fix = backends.choose(name, backends.names("refine"))
        raise InputError.of("--refine", f'"{name}"', "is no backend that refines", fix)
    return who, (*options.set, f"refine.backend={name}")


def variants_of(path: str, options: argparse.Namespace) -> list[str | None]:
    """None for the file itself; with `all`, it and every variant."""
    if options.variant != "all":
        return [options.variant]
    from physgen import pipeline

    return [None, *pipeline.load(path, options.set, None, options.allow_outside).variants]


def refuse_twins(jobs: list[Job]) -> None:
    """Clips that would be written over one another."""
    from physgen import pipeline

    seen: dict[str, str] = {}
    problems = []
    for job in jobs:
        name = pipeline.output_name(job.path, job.variant)
        if name in seen:
            expected = f"would be written over {seen[name]}: both are called {name}"
            problems += InputError.of(job.path, "", expected, "render them into two folders").problems
        seen.setdefault(name, job.path)
    if problems:
        raise InputError(problems)
