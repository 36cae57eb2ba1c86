"""Flags, jobs and progress of the commands for clips."""

from __future__ import annotations

import argparse
import json
import os
from collections import Counter as Counts
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING, Any

import physgen.scene
from physgen import batch, export, pipeline, registry, report
from physgen.cli.arguments import (
    FORMATS,
    WRONG_INPUT,
    Parser,
    choice_reader,
    count,
    draws,
    names,
    seed,
    wrong_value,
)
from physgen.cli.clusters import is_parallel, run_all
from physgen.cli.output import (
    FAILED,
    OK,
    Bar,
    named_by_flag,
    print_backup,
    print_error,
    print_line,
    print_problem,
)
from physgen.messages import Message
from physgen.problems import (
    InputError,
    OutputError,
    Problem,
    as_warnings,
    collect,
    variant_named,
)
from physgen.text import listed

if TYPE_CHECKING:
    from physgen.batch.run import Job, JobResult, Refiner
    from physgen.compile.compile import CompiledScene
    from physgen.scene.load import OpenedScene
    from physgen.scene.scene import Scene


PREVIEW_FRAMES = 24
"""Maximum number of frames in a preview."""
DEFAULT_FORMATS = ("mp4",)
"""Formats of a video without --format."""
INDEX = "index.html"
GALLERY_CLIPS = 20_000
"""Maximum number of clips in one gallery; a larger page opens slowly."""


def jobs_of(options: argparse.Namespace) -> Iterator[Job]:
    """Yield the jobs of `render`: scenes times variants. Raise InputError."""
    clips = []
    for path in options.scenes:
        for variant in variants_of(path, options):
            clips.append((path, variant))
    # Collect the problems of all scenes, so that the user sees them at once.
    calls: list[Callable[[], Any]] = [partial(job_maker, options)]
    calls += [partial(_motion_edits, *clip, options) for clip in clips]
    make, *push_edits = collect(calls)
    for clip, edits in zip(clips, push_edits, strict=True):
        if options.preview:
            preview = preview_edits(*clip, options, edits)
        else:
            preview = ()
        yield make(*clip, edits, preview=preview)


def _motion_edits(
    path: str, variant: str | None, options: argparse.Namespace
) -> tuple[str, ...]:
    """Return the edits of --push, --drop, --kick and --story, and print how to keep
    them. Raise InputError.
    """
    # Without pushes, the scene need not be compiled here.
    if not (options.push or options.drop or options.kick) and options.story is None:
        return ()

    # Shorthands need the shapes of the objects: a kick by its place, a drop by the room
    # above.
    scene = _open_scene(path, options.allow_outside).scene(options.set, variant)
    with variant_named(variant):
        compilation = pipeline.compile(scene, pipeline.percepts(scene))
    if options.story is not None:
        edits = _story_edits(path, scene, compilation, variant, options)
    else:
        edits = pipeline.pushes.motion_edits(
            scene, compilation, options.push, options.drop, options.kick
        )
    # Print the edits as text for the file, since shorthands change this clip only.
    if edits:
        _print_edits(path, edits, physgen.scene.write.scene_text(_nested_values(edits)))
    else:
        print_error(f"{path}: the scene has this motion already")
    return physgen.scene.write.edit_texts(edits)


def _nested_values(edits: Mapping[str, Any]) -> dict[str, Any]:
    """Return edits as nested mappings instead of dotted keys, without removals."""
    values: dict[str, Any] = {}
    for key, value in edits.items():
        if value is None:
            continue
        *parents, last = key.split(".")
        part = values
        for name in parents:
            part = part.setdefault(name, {})
        part[last] = value
    return values


def _print_edits(path: str, edits: Mapping[str, Any], text: str) -> None:
    """Print the YAML text of edits, which can be copied into the file."""
    lines = indent(text, "  ").rstrip()
    print_error(f"{path}: to keep this motion, write\n{lines}")
    removed_keys = []
    for key, value in edits.items():
        if value is None:
            removed_keys.append(key)
    if removed_keys:
        print_error(f"{path}: and remove {listed(removed_keys, 'and')}")


def _story_edits(
    path: str,
    scene: Scene,
    compilation: CompiledScene,
    variant: str | None,
    options: argparse.Namespace,
) -> dict[str, Any]:
    """Return the edits of --story and print the outcome. Raise InputError."""
    for flag in ("push", "drop", "kick"):
        if getattr(options, flag):
            found = f'"{options.story}"'
            raise Message.STORY_WITH_OTHERS.error("--story", found, flag=f"--{flag}")
    # A story needs a duration, which `auto` leaves to the simulation.
    compilation, _ = pipeline.stages.ended(scene, compilation)
    opened = _open_scene(path, options.allow_outside)

    def edited(edits: Mapping[str, Any]) -> Scene:
        return opened.scene(
            (*options.set, *physgen.scene.write.edit_texts(edits)), variant
        )

    subject = pipeline.story_server.StoryScene(scene, compilation, edited)
    plan = pipeline.story_server.load_plan(config=options.config)
    telling = pipeline.story_server.tell(subject, options.story, plan, print_problem)
    verdict = "the nearest outcome"
    if telling.comes_true:
        verdict = "the story happens"
    print_error(f"{path}: {verdict}: {telling.outcome} ({telling.trials} tried)")
    return telling.edits


def preview_edits(
    path: str, variant: str | None, options: argparse.Namespace, further: Sequence[str]
) -> tuple[str, ...]:
    """Return edits for a fast preview with these `further` edits: few frames, of the
    photo's size.
    """
    try:
        scene_file = _open_scene(path, options.allow_outside)
        scene = scene_file.scene((*options.set, *further), variant)
        has_fixed_end = not scene.world.until_rest
        duration = scene.world.duration
        if not has_fixed_end:
            compiled = pipeline.compile(scene, pipeline.percepts(scene))
            duration = compiled.world.duration
    except InputError:
        # The render reports this error.
        return ()
    # The frame rate falls with the number of frames, so that the preview has the clip's
    # duration.
    film = scene.render
    length = duration * scene.render.slow
    count = film.frames or max(1, round(film.fps * length))
    frame_count = min(count, PREVIEW_FRAMES)
    edits = [
        f"render.frames={frame_count}",
        f"render.fps={max(1.0, film.fps * frame_count / count):g}",
    ]
    if not has_fixed_end:
        # The preview ends as the clip does, without a further search for rest.
        edits.append(f"world.duration={duration}")
    edits += ["render.motion_blur=0", "render.supersample=1"]
    edits += ["render.hold=0", "render.grain=none"]
    # The user's own edits of the size stay.
    stated_edits = [edit.partition("=")[0] for edit in (*options.set, *further)]
    if not {"render.size", "render.scale"} & set(stated_edits):
        edits += [
            f"render.{key}="
            for key in ("size", "scale")
            if getattr(film, key) is not None
        ]
    return tuple(edits)


def _open_scene(path: str, allow_outside: bool) -> OpenedScene:
    """Read a file once for many clips. Read it again after a change."""
    # Relative paths depend on the working folder: it is a part of the cache's key.
    scene_file = _read(path, allow_outside, os.getcwd())
    # A scene may change during a long batch, for example by `--refresh`.
    if not scene_file.stale():
        return scene_file
    _read.cache_clear()
    return _read(path, allow_outside, os.getcwd())


@lru_cache(maxsize=1)
def _read(path: str, allow_outside: bool, folder: str) -> OpenedScene:
    return physgen.scene.load.OpenedScene(path, allow_outside)


def job_maker(options: argparse.Namespace) -> Callable[..., Job]:
    """Return a function of scene, variant, further overrides and name that makes a job.
    Raise InputError.
    """
    page = pipeline.Page(options.report or ("none" if options.preview else "full"))
    # Problems of both options are reported together, before the first job.
    checks: list[Callable[[], Any]] = [partial(_refining, options)]
    if options.export:
        checks.append(
            partial(export.formats.choose_formats, options.export, "--export")
        )
    refiner, overrides = collect(checks)[0]
    models = {"refine": options.refine, "config": options.config}
    # All jobs of a command share these options; each job adds its scene and edits.
    common = pipeline.RenderOptions(
        allow_outside=options.allow_outside,
        formats=tuple(
            map(export.video_formats.Format, options.format or DEFAULT_FORMATS)
        ),
        command=tuple(options.command_line),
        models=tuple(
            f"--{flag}={value}" for flag, value in models.items() if value is not None
        ),
        draws=options.fan,
        draw_seed=options.fan_seed,
        cached=options.cache,
        page=page,
        sound=getattr(options, "sound", True) and not options.preview,
        export=tuple(options.export),
    )

    def make(
        path: str,
        variant: str | None,
        further: tuple[str, ...] = (),
        name: str | None = None,
        tracked_names: tuple[str, ...] | None = None,
        preview: tuple[str, ...] = (),
    ) -> Job:
        # Later edits win: those of the user over those of the preview.
        edits = (*preview, *overrides, *further)
        job_options = replace(common, overrides=edits, variant=variant, name=name)
        return batch.run.Job(path, job_options, options.output, refiner, tracked_names)

    return make


def _refining(options: argparse.Namespace) -> tuple[Refiner, tuple[str, ...]]:
    """Return the refining backend, and the edits of all scenes from flags."""
    refiner = batch.run.Refiner(options.refine or "", options.config)
    if options.refine is None:
        return refiner, tuple(options.set)
    name = options.refine.partition(":")[0]
    if name not in registry.names("refine"):
        raise Message.UNKNOWN_REFINER.error(
            "--refine",
            f'"{name}"',
            fix=registry.suggestion(name, registry.names("refine")),
        )
    return refiner, (*options.set, f"refine.backend={name}")


def variants_of(path: str, options: argparse.Namespace) -> list[str | None]:
    """Return the variants to render, None for the file itself. `all` means the file and
    every variant.
    """
    if options.variant != "all":
        return [options.variant]
    try:
        return [None, *_open_scene(path, options.allow_outside).variants]
    except InputError:
        # The render reports this error.
        return [None]


def problems_of_variants(path: str, allow_outside: bool) -> Sequence[Problem]:
    """Return the errors of all variants of a file, or nothing if the file itself is
    unreadable.
    """
    try:
        return _open_scene(path, allow_outside).variant_problems
    except InputError:
        # Loading the file reports this error.
        return ()


def other_variants(path: str, options: argparse.Namespace) -> list[Problem]:
    """Return warnings about faulty variants of the file, if the file itself is used."""
    if options.variant:
        return []
    return as_warnings(problems_of_variants(path, options.allow_outside))


def check_names(jobs: list[Job]) -> None:
    """Raise InputError if clips would overwrite each other."""
    scenes_by_folder: dict[str, str] = {}
    problems = []
    for job in jobs:
        name = pipeline.output_name(job.scene, job.options.variant)
        if name in scenes_by_folder:
            problems += Message.CLIPS_CALLED_ALIKE.error(
                job.scene, name=name, other=scenes_by_folder[name]
            ).problems
        scenes_by_folder.setdefault(name, job.scene)
    if problems:
        raise InputError(problems)


class Tally:
    """Numbers of clips by state, and the printed warnings."""

    def __init__(self) -> None:
        self.counts: Counts[str] = Counts()
        self.newest = 0.0
        """Time of the newest clip, s since 1970."""
        self.disk_full = False
        self._warnings: set[str] = set()

    def add(self, result: JobResult) -> None:
        """Count one clip."""
        self.counts[result.state.name.lower()] += 1
        if result.folder is not None:
            # Another run may be replacing the clip.
            with suppress(OSError):
                self.newest = max(
                    self.newest, (result.folder / "manifest.json").stat().st_mtime
                )

    def accept(self, result: JobResult) -> bool:
        """Count one clip and print its new problems; return False if the disk is full.

        Raise OutputError if no further clip can be written to the folder.
        """
        if not result.can_write:
            raise OutputError(result.problems)
        if result.disk_full:
            self.disk_full = True
            return False
        self.add(result)
        for line in self.new_warnings(result):
            print_error(line)
        return True

    def new_warnings(self, result: JobResult) -> Iterator[str]:
        """Yield the problems of a clip, without those of earlier clips."""
        for problem in result.problems:
            text = str(problem)
            if text not in self._warnings:
                self._warnings.add(text)
                yield text

    def __str__(self) -> str:
        parts = [f"{self.counts.total():,} clips: {self.counts['made']:,} made"]
        parts += [
            f"{self.counts[name]:,} {name}"
            for name in ("unchanged", "failed")
            if self.counts[name]
        ]
        return ", ".join(parts)


def _renew_gallery(out: Path, tally: Tally, bar: Bar) -> None:
    """Write the gallery of a batch, unless nothing has changed.

    An unchanged batch keeps its gallery, and its time stamp.
    """
    index = out / INDEX
    # An interrupted run leaves an old gallery.
    is_old = not index.exists() or index.stat().st_mtime < tally.newest
    if not (tally.counts["made"] or tally.counts["failed"] or is_old):
        return
    if tally.counts.total() > GALLERY_CLIPS:
        print_error(
            f"{out}: too many clips for one gallery; physgen gallery shows parts of them"
        )
    elif out.is_dir():
        report.gallery.write_gallery([out], index, progress=bar.show, keep=print_backup)
        bar.clear()


def make_all(
    jobs: Iterable[Job],
    count: int,
    options: argparse.Namespace,
    on_result: Callable[[JobResult], None] = lambda done: None,
    finish: Callable[[], Sequence[str]] = lambda: (),
    gallery: bool = True,
) -> int:
    """Make `count` jobs, print each, and write the gallery and a summary. Return the
    exit code.

    `on_result` is called after each job. `finish` is called at the end and returns the
    files to print.
    """
    out = Path(options.output)
    index = out / INDEX
    # Parts may outnumber the clips: an empty part is not an error.
    if count == 0 and options.part:
        print_error("this part has no clip: there are fewer clips than parts")
    store = getattr(options, "ship", None)
    # The clips of a store are not here, and have no gallery.
    gallery = gallery and (count > 1 or index.exists()) and store is None
    # The process of a clip makes its pictures while the frames are in memory.
    if gallery and count <= GALLERY_CLIPS:
        jobs = (replace(job, pictures=True) for job in jobs)
    tally, bar = Tally(), Bar()
    _announce(bar, 1, count)
    work = batch.run.run
    if not is_parallel(options, count):
        work = partial(batch.run.run, progress=bar.show)
    # Closing the results stops unfinished work, also after an error.
    with (
        report.folders.clean_up_after_error(out),
        closing(
            run_all(options, work, jobs, count, batch.run.report_failure)
        ) as results,
    ):
        for result in results:
            bar.clear()
            if not tally.accept(result):
                # Every further clip would fail in the same way.
                break
            batch.run.record_failure(result, out, gallery)
            on_result(result)
            _print_done(result, options.json, store)
            _announce(bar, tally.counts.total() + 1, count)
    bar.clear()
    bar.prefix = ""
    files = finish()
    if gallery and not tally.disk_full:
        _renew_gallery(out, tally, bar)
    gallery_page = None
    if count > 1 and index.exists():
        gallery_page = index
    return _sum_up(tally, count, gallery_page, files, options)


def _announce(bar: Bar, number: int, count: int) -> None:
    """Show the number of the current clip, if there are several."""
    if 1 < count >= number:
        bar.prefix = f"clip {number:,} of {count:,}: "
        bar.write(bar.prefix)


def _print_done(result: JobResult, as_json: bool, store: str | None) -> None:
    """Print the folder of a clip, in its store if there is one, or the clip's data as a
    line of JSON.
    """
    # A clip in a store has its address there.
    if result.folder is None:
        folder = None
    else:
        folder = str(result.folder)
    if store is not None and folder is not None:
        folder = f"{store.rstrip('/')}/{folder}"
    if as_json:
        with suppress(InputError):
            line = {
                "clip": result.job.name,
                "scene": result.job.scene,
                "variant": result.job.options.variant,
                "state": result.state.value,
                "folder": folder,
                **_video_entry(result),
                "seconds": round(result.seconds, 3),
                "problems": [
                    named_by_flag(problem).as_dict() for problem in result.problems
                ],
            }
            print_line(json.dumps(line, ensure_ascii=False, default=str))
    elif folder is not None:
        print_line(str(result.job.video or folder))


def _video_entry(result: JobResult) -> dict[str, str]:
    """Return the entry of the video file of `-o`, if there is one."""
    if result.job.video and result.folder:
        return {"video": str(result.job.video)}
    return {}


def _sum_up(
    tally: Tally,
    count: int,
    index: Path | None,
    files: Sequence[str],
    options: argparse.Namespace,
) -> int:
    """Print the last line. Return the exit code."""
    index_files = [] if index is None else [str(index)]
    # Files come on stdout, and sentences for people on stderr: a script can read the
    # former.
    if options.json:
        _print_summary(tally, count, index_files, files)
    else:
        for file in [*index_files, *files]:
            print_line(file)
    unchanged = tally.counts["unchanged"]
    failed = tally.counts["failed"]
    # The finished clips are complete: the same command continues after room was made.
    if tally.disk_full:
        missing_count = count - tally.counts["made"] - unchanged
        shortage = f"{missing_count:,} of {count:,} clips are missing"
        fix = "make room and run the same command again"
        print_error(f"{options.output}: no room left: {shortage}; {fix}")
        return FAILED
    if failed:
        if count > 1:
            print_error(str(tally))
        return WRONG_INPUT
    if unchanged and not options.json:
        print_error(str(tally) if count > 1 else "1 clip, unchanged")
    return OK


def _print_summary(
    tally: Tally, count: int, index_files: Sequence[str], files: Sequence[str]
) -> None:
    """Print the counts of clips and the files as a line of JSON."""
    counts = {name: tally.counts[name] for name in ("made", "unchanged", "failed")}
    line = {
        "clips": count,
        **counts,
        "index": next(iter(index_files), None),
        **{file.rpartition("/")[2]: file for file in files},
        "passed": counts["failed"] == 0 and tally.counts.total() == count,
    }
    print_line(json.dumps(line))


REPORTS = ("full", "none")


def part(text: str) -> slice:
    """Return the slice of `K/N`: every N-th clip, from the K-th on."""
    first, _, step = text.partition("/")
    if first.isdecimal() and step.isdecimal() and 1 <= int(first) <= int(step):
        return slice(int(first) - 1, None, int(step))
    raise wrong_value(text, Message.NOT_A_PART.refusal())


def add_clips(parser: Parser) -> None:
    """Add the flags of commands that render clips."""
    parser.option("--jobs", "N", count, "scenes rendered at a time; default: 1", 1)
    help_text = "make the K-th of N parts of the clips, one on each machine; see docs/batches.md"
    parser.option("--part", "K/N", part, help_text)
    parser.option(
        "--format",
        "LIST",
        choice_reader(FORMATS),
        "any of mp4,gif,webp,png; default: mp4",
    )
    help_text = (
        "simulate N draws of the values that `from` marks as uncertain, and report which outcomes the photo decides; "
        "see docs/rendering.md"
    )
    parser.option("--fan", "N", draws, help_text, 0)
    parser.option("--fan-seed", "S", seed, "seed of the draws; default: 0", 0)
    help_text = "refine the clip by a video diffusion model: animatediff, wan, ltx-video, or none; see physgen backends"
    parser.option("--refine", "NAME[:WEIGHTS]", str, help_text)
    parser.option(
        "--config", "FILE", Path, "read this in place of ~/.config/physgen/physgen.toml"
    )
    help_text = "full (the default), or none"
    parser.add_argument("--report", choices=REPORTS, help=help_text)
    help_text = (
        "ground truth beside the clip, in truth/: any of the formats of physgen export"
    )
    parser.option("--export", "LIST", names, help_text, ())
    parser.flag(
        "--preview",
        "a quick look: at most 24 frames of the photo's size, without a report",
    )
    parser.flag("--no-cache", "render existing clips again")
    parser.flag("--json", "print a line of JSON for each clip, and one at the end")


def add_overlays(parser: Parser) -> None:
    """Add the flags for edits of a scene, and the flag for files outside its folder."""
    help_text = "edit a key: objects.ball-1.mass=200; * stands for every object, KEY= takes it away"
    parser.option("--set", "KEY=VALUE", str, help_text, [], action="append")
    parser.option("--variant", "NAME", str, "apply a named variant of the file, or all")
    parser.flag("--allow-outside", "let the scene read files outside its folder")
