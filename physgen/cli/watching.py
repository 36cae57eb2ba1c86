"""`render --watch`: clips made again whenever a file that they are made of is saved, until Ctrl-C."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.cli.printing import OK, tell
from physgen.whole import Stamp, stamped

if TYPE_CHECKING:
    from physgen.batch.pool import Job

LOOK = 0.05
"""s between looks."""


def watch(
    options: argparse.Namespace, jobs: Callable[[], list[Job]], make: Callable[[list[Job]], int]
) -> int:
    """`make` them, and again after each save; a mistake is told, and mended by the next save."""
    from physgen.problems import InputError

    seen: dict[Path, Stamp] = {}
    try:
        while True:
            begun = time.perf_counter()
            before = {path: stamped(path) for path in _first(options.scenes)} | {
                path: stamped(path) for path in seen
            }
            made: list[Job] = []
            try:
                made = jobs()
                make(made)
            except InputError as error:
                for problem in error.problems:
                    tell(str(problem))
            took = time.perf_counter() - begun
            files = {*_first(options.scenes), *(path for job in made for path in _inputs(job)), *seen}
            seen = {path: before.get(path) or stamped(path) for path in files}
            tell(f"{took:.1f} s; watching {len(files)} files, Ctrl-C ends it")
            _wait(seen)
    except KeyboardInterrupt:
        return OK


def _first(scenes: Sequence[str]) -> list[Path]:
    """What is there to be watched before anything was made."""
    return [Path(scene) for scene in scenes]


def _inputs(job: Job) -> list[Path]:
    """Files that the clip was made of, and the folder in which maps may appear."""
    try:
        told = json.loads((job.folder / "manifest.json").read_bytes())
        home = Path(job.path).parent
        files = [home / name for name in told["inputs"]]
        assets = told["document"].get("assets")
        return [*files, home / assets] if assets else files
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return []


def _wait(seen: dict[Path, Stamp]) -> None:
    """Until one of the files was saved, and nobody writes any more: some editors save in several steps."""
    while all(stamped(path) == stamp for path, stamp in seen.items()):
        time.sleep(LOOK)
    now = {path: stamped(path) for path in seen}
    while True:
        time.sleep(LOOK)
        later = {path: stamped(path) for path in seen}
        if later == now and all(path.exists() for path in seen if str(path).endswith((".yaml", ".yml"))):
            return
        now = later
