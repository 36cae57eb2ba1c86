"""`render`: scenes to clips, once or again on every save."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.cli.arguments import Command, Parser, place
from physgen.cli.clips import add_clips, add_overlays, check_names, check_places, jobs_of, make_all
from physgen.cli.output import OK, print_error
from physgen.files import Stamp, file_stamp

if TYPE_CHECKING:
    from physgen.batch.run import Job


def render(options: argparse.Namespace) -> int:
    check_places(options)
    if options.watch:
        return watch(options, lambda: _jobs(options), lambda jobs: make_all(jobs, len(jobs), options))
    jobs = _jobs(options)
    return make_all(jobs, len(jobs), options)


def _jobs(options: argparse.Namespace) -> list[Job]:
    jobs = list(jobs_of(options))
    check_names(jobs)
    return jobs


POLL = 0.05
"""s between two looks at the files."""
SETTLE = 1.0
"""s for which a missing file may come back, and writing may continue."""


def watch(
    options: argparse.Namespace, jobs: Callable[[], list[Job]], make: Callable[[list[Job]], int]
) -> int:
    """Makes the jobs, and again after each save; errors are printed, and the next save may fix them."""
    from physgen.problems import InputError

    kept: set[Path] = set()  # inputs of the last clips that could be made
    scenes = [Path(scene) for scene in options.scenes]
    try:
        while True:
            begun = time.perf_counter()
            before: dict[Path, Stamp] = {path: file_stamp(path) for path in (*scenes, *kept)}
            files = set(scenes)
            try:
                made = jobs()
                make(made)
                kept = {path for job in made for path in _inputs(job)} or kept
            except InputError as error:
                for problem in error.problems:
                    print_error(str(problem))
                files |= {Path(problem.place.file) for problem in error.problems if problem.place.line}
            files |= kept
            took = time.perf_counter() - begun
            print_error(f"{took:.1f} s; watching {len(files)} files, Ctrl-C ends it")
            if gone := [str(path) for path in scenes if not path.exists()]:
                print_error(f"{', '.join(gone)}: gone; rendered again when it is back")
            _wait({path: before.get(path) or file_stamp(path) for path in files})
    except KeyboardInterrupt:
        return OK


def _inputs(job: Job) -> list[Path]:
    """The input files of a clip, and the folder of its maps; none for a pack."""
    if Path(job.scene).suffix not in (".yaml", ".yml"):
        return []
    try:
        manifest = json.loads((job.folder / "manifest.json").read_bytes())
        home = Path(job.scene).resolve().parent
        files = [home / name for name in manifest["inputs"]]
        assets = manifest["document"].get("assets")
        return [*files, home / assets] if assets else files
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return []


def _wait(seen: dict[Path, Stamp]) -> None:
    """Returns when one of the files was saved and writing has ended: some editors save in several steps."""
    while all(file_stamp(path) == stamp for path, stamp in seen.items()):
        time.sleep(POLL)
    now = {path: file_stamp(path) for path in seen}
    for _ in range(round(SETTLE / POLL)):
        time.sleep(POLL)
        later = {path: file_stamp(path) for path in seen}
        if later == now and all(path.exists() for path in seen):
            return
        now = later


def add(parser: Parser) -> None:
    parser.add_argument("scenes", metavar="SCENE", nargs="+", type=place, help="a file, a pack, or a URL")
    parser.option("-o --output", "DIR", place, "folder of the results, or its URL; default: out", "out")
    add_clips(parser)
    parser.flag("--watch", "render again whenever the scene or one of its files is saved")
    add_overlays(parser)


RENDER = Command(
    "render",
    "Renders scenes to videos, reports and manifests.",
    "physgen render scene.yaml -o out --format mp4,gif",
    add,
    render,
    mixed=True,
)
