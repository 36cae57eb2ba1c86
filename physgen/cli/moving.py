"""`check`, `simulate` and `render`: scenes to problems, motion and video."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.cli.printing import OK, Bar, print_json, tell, tell_kept, tell_problems
from physgen.flags import WRONG_INPUT
from physgen.problems import InputError, Problem, Severity
from physgen.whole import write_whole

if TYPE_CHECKING:
    from physgen.batch.pool import Job, Refiner


def check(options: argparse.Namespace) -> int:
    from physgen import pipeline
    from physgen.compile.pairs import pair_header
    from physgen.scene.write import scene_text

    report: list[Problem] = []
    resolved = []
    for path in options.scenes:
        try:
            for variant in _variants(path, options):
                scene = pipeline.load(path, options.set, variant, options.allow_outside)
                compiled = pipeline.compile(scene, pipeline.percepts(scene))
                report += [p for p in pipeline.lint(scene, compiled) if p not in report]
                if options.resolved:
                    resolved.append(scene_text(scene.document, header=pair_header(compiled.world)))
        except InputError as error:
            report += [p for p in error.problems if p not in report]
    failed = any(p.severity is Severity.ERROR or options.strict for p in report)
    if options.json:
        print_json(
            {"problems": [p.as_dict() for p in report], "passed": not failed, "resolved": resolved or None}
        )
    else:
        tell_problems(report)
        sys.stdout.write("---\n".join(resolved))
        if not failed and not options.resolved and sys.stderr.isatty():
            tell(f"{len(options.scenes)} scene{'s' * (len(options.scenes) != 1)} checked")
    return WRONG_INPUT if failed else OK


def simulate(options: argparse.Namespace) -> int:
    from physgen import pipeline

    kind = _trajectory_kind(options.output)
    scene = pipeline.load(options.scene, options.set, _one_variant(options), options.allow_outside)
    compiled = pipeline.compile(scene, pipeline.percepts(scene))
    tell_problems(pipeline.lint(scene, compiled))
    bar = Bar()
    if options.chaos:
        found = pipeline.chaos(compiled.world, bar.show)
        bar.clear()
        if options.json:
            print_json(found.as_dict())
        else:
            print("\n".join((*found.lines(), "", found.verdict())))
        if options.output is None:
            return OK
    trajectory = pipeline.simulate(compiled.world, options.rate, bar.show)
    bar.clear()
    if kind == "npz":
        trajectory.save(options.output)
    if options.output is None or kind != "npz":
        text = trajectory.as_json() if options.json or kind == "json" else trajectory.as_csv()
        if options.output is None:
            sys.stdout.write(text)
        else:
            write_whole(options.output, text.encode("utf-8"))
    elif options.json and not options.chaos:
        sys.stdout.write(trajectory.as_json())
    return OK


def _trajectory_kind(output: Path | None) -> str:
    """`npz`, `csv` or `json` by the file's ending; refused before anything is computed or overwritten."""
    if output is None:
        return ""
    if output.suffix not in (".npz", ".csv", ".json") or output.is_dir():
        raise InputError.of(
            "-o", f'"{output}"', "is no name for a trajectory", "end it in .npz, .csv or .json"
        )
    return output.suffix[1:]


def render(options: argparse.Namespace) -> int:
    from physgen import pipeline
    from physgen.batch.pool import Job, ended, run_all
    from physgen.report.video import Format

    if options.single_file and options.report == "none":
        raise InputError.of(
            "--single-file", "", "needs a page to put the video into", "leave out --report none"
        )
    formats = tuple(Format(name) for name in options.format)
    refiner, overrides = _refining(options)
    jobs = [
        Job(
            path,
            options.output,
            overrides,
            variant,
            options.allow_outside,
            formats,
            tuple(options.command_line),
            options.chaos,
            options.device,
            refiner,
            options.cache,
            pipeline.Page(options.report),
            options.single_file,
        )
        for path in options.scenes
        for variant in _variants(path, options)
    ]
    _refuse_twins(jobs)
    root = Path(options.output)
    gallery = len(jobs) > 1 or (root / "index.html").exists()
    bar = Bar()
    folders = []
    told: set[str] = set()
    for done in run_all(jobs, options.jobs, lambda job: bar.of(Path(job.path).name if len(jobs) > 1 else "")):
        bar.clear()
        tell_problems([p for p in done.problems if str(p) not in told])
        told.update(map(str, done.problems))
        ended(done, root, gallery)
        if done.folder is not None:
            folders.append(done.folder)
            if not options.json:
                print(done.folder, flush=True)
    index = _gallery(root, bar) if gallery and (folders or root.is_dir()) else None
    if index is not None and len(jobs) > 1 and not options.json:
        print(index)
    if options.json:
        print_json(
            {
                "folders": list(map(str, folders)),
                "index": str(index) if index else None,
                "passed": len(folders) == len(jobs),
            }
        )
    return OK if len(folders) == len(jobs) else WRONG_INPUT


def _gallery(root: Path, bar: Bar) -> Path:
    """The page of all that is in the folder, made again."""
    from physgen.report.gallery import write_gallery

    made = write_gallery([root], root / "index.html", progress=bar.show, keep=tell_kept)
    bar.clear()
    return made.index


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


def _one_variant(options: argparse.Namespace) -> str | None:
    if options.variant == "all":
        raise InputError.of("--variant", "all", "names more than one", "write one name, or use render")
    return str(options.variant) if options.variant else None


def _variants(path: str, options: argparse.Namespace) -> list[str | None]:
    """None for the file itself; with `all`, it and every variant."""
    if options.variant != "all":
        return [options.variant]
    from physgen import pipeline

    return [None, *pipeline.load(path, options.set, None, options.allow_outside).variants]


def _refuse_twins(jobs: Sequence[Job]) -> None:
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
