"""Flags, jobs and progress of the commands that make clips."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from enum import Enum
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.batch.remote import is_private, is_url
from physgen.cli.arguments import FORMATS, WRONG_INPUT, Parser, add_device, among, count, draws, labels, seed
from physgen.cli.output import FAILED, OK, Bar, Counter, print_error, print_line
from physgen.problems import InputError

if TYPE_CHECKING:
    from physgen.batch.gallery import ResultsFolder
    from physgen.batch.run import Done, Job, Refiner
    from physgen.scene.load import Opened


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
        opened = _opened(local_path(path, options), options.allow_outside)
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
    from physgen.scene.load import Opened

    return Opened(pipeline.scene_file(path), allow_outside)


def job_maker(options: argparse.Namespace) -> Callable[..., Job]:
    """Scene, variant, further overrides and a name -> a job as the flags say. Raises InputError."""
    from physgen import pipeline
    from physgen.batch.run import Job
    from physgen.export.video import Format
    from physgen.pipeline import RenderOptions

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
        chosen = RenderOptions(
            overrides=(*look, *overrides, *further),
            variant=variant,
            name=name,
            allow_outside=options.allow_outside,
            formats=formats,
            command=tuple(options.command_line),
            chaos=options.chaos,
            draws=options.fan,
            draw_seed=options.fan_seed,
            device=options.device,
            cached=options.cache,
            page=page,
            single_file=options.single_file,
            export=tuple(options.export),
        )
        return Job(path, chosen, options.output, refiner, tracked)

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
    from physgen import registry
    from physgen.batch.run import Refiner

    device = (
        None if options.device == "cpu" else options.device
    )  # the processor draws, unless one says otherwise
    who = Refiner(options.refine or "", options.config, device)
    if options.refine is None:
        return who, tuple(options.set)
    name = options.refine.partition(":")[0]
    if name not in registry.names("refine"):
        fix = registry.suggestion(name, registry.names("refine"))
        raise InputError.of("--refine", f'"{name}"', "is no backend that refines", fix)
    return who, (*options.set, f"refine.backend={name}")


def variants_of(path: str, options: argparse.Namespace) -> list[str | None]:
    """None for the file itself; with `all`, it and every variant."""
    if options.variant != "all":
        return [options.variant]
    from physgen import pipeline

    try:
        known = pipeline.load(local_path(path, options), options.set, None, options.allow_outside).variants
    except InputError:  # told of where it is rendered; the others are
        return [None]
    return [None, *known]


def local_path(path: str, options: argparse.Namespace) -> str:
    """Where a scene can be read, of which a URL may have been given."""
    if not is_url(path):
        return path
    from physgen.batch.run import local_copy

    return local_copy(path, options.set)


def refuse_twins(jobs: list[Job]) -> None:
    """Clips that would be written over one another."""
    from physgen import pipeline

    seen: dict[str, str] = {}
    problems = []
    for job in jobs:
        name = pipeline.output_name(job.scene, job.options.variant)
        if name in seen:
            expected = f"would be written over {seen[name]}: both are called {name}"
            problems += InputError.of(job.scene, "", expected, "render them into two folders").problems
        seen.setdefault(name, job.scene)
    if problems:
        raise InputError(problems)


def check_formats(formats: Sequence[str], flag: str) -> None:
    """Raises InputError where a format is none, by the `flag`; tells what is left out without an optional library."""
    from physgen.export.formats import chosen_formats
    from physgen.tables import HINT, has_parquet

    chosen_formats(formats, flag)
    if "trajectory" in formats and not has_parquet():
        print_error(HINT)


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
    from physgen.batch.gallery import results_folder

    kept_in = results_folder(options.output)
    many = count > 1
    gallery = shown is Shown.GALLERY and (many or kept_in.has_index())
    if gallery and count <= MOST_SHOWN:
        jobs = (replace(job, pictures=True) for job in jobs)
    tally, told = Tally(), _Told()
    bar = Bar()
    with (
        Counter(count if many else 0) as counter,
        kept_in.cleaned_up(),
        closing(_made(jobs, count, options, bar, counter)) as done_ones,
    ):
        for done in done_ones:
            bar.clear()
            if done.disk_full:  # of every clip that follows the same would be said
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
        from physgen.batch.cluster import run_on_cluster

        return run_on_cluster(options.cluster, workers, jobs, options.ship, counter.tell)
    from physgen.batch.run import run_all

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
    from physgen.batch.run import State

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
                "clip": done.job.name,
                "scene": done.job.scene,
                "variant": done.job.options.variant,
                "state": done.state.value,
                "folder": done.where,
                "seconds": round(done.seconds, 3),
                "problems": [problem.as_dict() for problem in done.problems],
            }
            counter.line(json.dumps(line, ensure_ascii=False, default=str))
    elif done.where is not None:
        counter.line(done.where)


def _gallery(kept_in: ResultsFolder, bar: Bar, tally: Tally, out: str) -> None:
    """The page of all that is in the folder, made again."""
    if tally.all > MOST_SHOWN:
        print_error(f"{out}: too many clips for one gallery; physgen gallery shows parts of them")
        return
    kept_in.write_index(
        bar.show,
        lambda name: print_error(f"{kept_in.index}: was there already and differed; kept as {name}"),
        tally.all,
    )
    bar.clear()


def _sum_up(
    tally: Tally, count: int, kept_in: ResultsFolder, beside: Sequence[str], options: argparse.Namespace
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
        print_error(
            f"{options.output}: no room left: {left:,} of {count:,} clips are missing; "
            "make room and run the same command again"
        )
        return FAILED
    if count > 1 and (tally.failed or tally.unchanged) and not (options.json and not tally.failed):
        print_error(str(tally))
    elif tally.unchanged and not options.json:
        print_error("1 clip, unchanged")
    return WRONG_INPUT if tally.failed else OK


CLUSTERS = ("dask", "slurm", "dask-slurm")
REPORTS = ("full", "plain", "none")


def cluster(text: str) -> str:
    """Any of CLUSTERS, or `dask=` and the address of its scheduler."""
    kind, equals, where = text.partition("=")
    if text in CLUSTERS:
        return text
    if kind == "dask" and equals and (where.endswith(".json") or "://" in where.strip("/:")):
        return text
    expected = "is not dask, dask=tcp://HOST:PORT, dask=FILE.json or slurm"
    raise argparse.ArgumentTypeError(f"{text} {expected}")


def add_clips(parser: Parser) -> None:
    """Adds the flags of commands that render clips."""
    parser.option("--jobs", "N", count, "scenes rendered at a time; default: 1", 1)
    about = (
        "render on a Dask cluster: dask, on this machine with --jobs workers; dask=tcp://HOST:8786, the one of a "
        "scheduler (or dask=FILE.json, a scheduler file); slurm, --jobs workers as jobs of Slurm; see docs/clusters.md"
    )
    parser.option("--cluster", "WHERE", cluster, about)
    about = "with --cluster: send scenes to workers and fetch clips from them, without shared folders"
    parser.flag("--ship", about)
    parser.option("--format", "LIST", among(FORMATS), "any of mp4,gif,webp,png; default: mp4", ["mp4"])
    parser.flag("--chaos", "report how long the motion is predictable; see simulate")
    about = (
        "simulate N draws of the values that `from` marks as uncertain, and report which outcomes the photo decides; "
        "see docs/fan.md"
    )
    parser.option("--fan", "N", draws, about, 0)
    parser.option("--fan-seed", "S", seed, "seed of the draws; default: 0", 0)
    add_device(parser)
    about = "refine the clip by a video diffusion model: animatediff, wan, cogvideox, or none; see physgen backends"
    parser.option("--refine", "NAME[:WEIGHTS]", str, about)
    parser.option("--config", "FILE", Path, "read this in place of physgen.toml")
    about = "full (the default); plain: without player, charts and perceived maps, faster; none"
    parser.add_argument("--report", choices=REPORTS, help=about)
    about = "ground truth beside the clip, in truth/: any of the formats of physgen export"
    parser.option("--export", "LIST", labels, about, ())
    parser.flag("--single-file", "embed the video in report.html, to send it alone")
    parser.flag("--preview", "a quick look: at most 24 frames of the photo's size, without a report")
    parser.flag("--no-cache", "render existing clips again, and neither read nor keep results of stages")
    parser.flag("--json", "print a line of JSON for each clip, and one at the end")


def add_overlays(parser: Parser) -> None:
    """Adds the flags that edit a scene, and the one that lets it read other folders."""
    about = "edit a key: objects.ball-1.mass=200; * stands for every object"
    parser.option("--set", "KEY=VALUE", str, about, [], action="append")
    parser.option("--variant", "NAME", str, "apply a named variant of the file, or all")
    parser.flag("--allow-outside", "let the scene read files outside its folder")
