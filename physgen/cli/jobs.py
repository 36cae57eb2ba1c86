"""Flags of commands that make clips -> the jobs that they ask for."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

from physgen.cli.printing import tell
from physgen.problems import InputError
from physgen.urls import is_private, is_url

if TYPE_CHECKING:
    from physgen.batch.pool import Job
    from physgen.batch.refiner import Refiner
    from physgen.scene.build import Opened

PREVIEWED = 24
"""Frames of a preview, at most."""


def jobs_of(options: argparse.Namespace) -> Iterator[Job]:
    """What `render` is to make: scenes times variants. Raises InputError."""
    make = job_maker(options)
    for path in options.scenes:
        for variant in variants_of(path, options):
            look = quick(path, variant, options, ()) if options.preview else ()
            yield make(path, variant, look=look)


def quick(
    path: str, variant: str | None, options: argparse.Namespace, further: Sequence[str]
) -> tuple[str, ...]:
    """Edits that make a clip with these `further` edits quick to draw: few frames, of the photo's size."""
    try:
        opened = _opened(at_hand(path, options), options.allow_outside)
        scene = opened.scene((*options.set, *further), variant)
    except InputError:  # told of where it is rendered
        return ()
    film, length = scene.render, scene.world.duration * scene.render.slow
    count = film.frames or max(1, round(film.fps * length))
    few = min(count, PREVIEWED)
    edits = [f"render.frames={few}", f"render.fps={max(1.0, film.fps * few / count):g}"]
    edits += ["render.motion_blur=0", "render.supersample=1"]
    said = [edit.partition("=")[0] for edit in (*options.set, *further)]  # what a person asks for stays
    if not {"render.size", "render.scale"} & set(said):
        edits += [f"render.{key}=" for key in ("size", "scale") if getattr(film, key) is not None]
    return tuple(edits)


@lru_cache(maxsize=1)
def _opened(path: str, allow_outside: bool) -> Opened:
    """A file of which many clips are made is read once."""
    from physgen import pipeline
    from physgen.scene.build import Opened

    return Opened(pipeline.scene_file(path), allow_outside)


def job_maker(options: argparse.Namespace) -> Callable[..., Job]:
    """Scene, variant, further overrides and a name -> a job as the flags say. Raises InputError."""
    from physgen import pipeline
    from physgen.batch.pool import Job
    from physgen.report.video import Format

    refuse_unseen(options)
    page = pipeline.Page(options.report or ("none" if options.preview else "full"))
    if options.single_file and page is pipeline.Page.NONE:
        fix = f"leave out {'--report none' if options.report else '--preview'}"
        raise InputError.of("--single-file", "", "needs a page to put the video into", fix)
    formats = tuple(Format(name) for name in options.format)
    if options.export:
        check_formats(options.export, "--export")
    refiner, overrides = _refining(options)

    def make(
        path: str,
        variant: str | None,
        further: tuple[str, ...] = (),
        name: str | None = None,
        tracked: tuple[str, ...] | None = None,
        look: tuple[str, ...] = (),
    ) -> Job:
        return Job(
            path,
            options.output,
            (*look, *overrides, *further),
            variant,
            options.allow_outside,
            formats,
            tuple(options.command_line),
            options.chaos,
            options.device,
            refiner,
            options.cache,
            page,
            name,
            tracked,
            options.export,
            options.single_file,
            options.fan,
            options.fan_seed,
        )

    return make


def refuse_unseen(options: argparse.Namespace) -> None:
    """Flags that would have clips made where nobody looks for them."""
    places = [options.output, *getattr(options, "scenes", [getattr(options, "scene", "")])]
    if options.jobs > 1 and not options.cluster and any(map(is_private, places)):
        raise InputError.of(
            f"--jobs {options.jobs}",
            "",
            "cannot be, as memory:// is seen by one process alone",
            "leave it out",
        )
    if getattr(options, "watch", False) and (options.cluster or any(map(is_url, places))):
        raise InputError.of("--watch", "", "watches files of this machine, and renders here", "leave it out")
    if options.ship and not options.cluster:
        raise InputError.of("--ship", "", "is for clusters", "add --cluster, or leave it out")


def _refining(options: argparse.Namespace) -> tuple[Refiner, tuple[str, ...]]:
    """Whose weights refine, and on what; and what the flags set in every scene."""
    from physgen import backends
    from physgen.batch.refiner import Refiner

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

    try:
        known = pipeline.load(at_hand(path, options), options.set, None, options.allow_outside).variants
    except InputError:  # told of where it is rendered; the others are
        return [None]
    return [None, *known]


def at_hand(path: str, options: argparse.Namespace) -> str:
    """Where a scene can be read, of which a URL may have been given."""
    if not is_url(path):
        return path
    from physgen.batch.far import readable

    return readable(path, options.set)


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


def check_formats(formats: Sequence[str], flag: str) -> None:
    """Raises InputError where a format is none, by the `flag`; tells what is left out without an optional library."""
    from physgen.export.writing import kinds
    from physgen.tables import HINT, has_parquet

    kinds(formats, flag)
    if "trajectory" in formats and not has_parquet():
        tell(HINT)
