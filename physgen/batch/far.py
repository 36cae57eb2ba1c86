"""A job whose scene or folder is a URL -> the clip there: the scene fetched, the clip made here, and sent whole.

An object store knows no rename: a clip's manifest goes away before its files change and comes back after the last of
them, so that a clip without manifest is not there. While files change, `.sending.json` names them, so that what a
killed run left is known for ours.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from shutil import rmtree
from typing import Any
from uuid import uuid4

from physgen import pipeline
from physgen.batch.fetched import fetched
from physgen.batch.finished import made_of_the_same
from physgen.batch.finished import warnings as warned
from physgen.batch.places import Far, far
from physgen.batch.pool import Done, Here, Job, State, failed, hash_of, run, with_outcomes
from physgen.problems import InputError
from physgen.report.leftovers import in_use, sweep_once
from physgen.report.record import source_of
from physgen.urls import is_url
from physgen.whole import partial

MANIFEST, SENDING = "manifest.json", ".sending.json"
MOST_MANIFEST = 200_000_000
"""Bytes."""


def run_far(job: Job, progress: pipeline.Progress = pipeline.silent, scene: str | None = None) -> Done:
    """One clip, unless it is there; of a copy of its `scene`, where there is one already."""
    try:
        scene = scene or readable(job.path, job.overrides, job.variant)
        if not is_url(job.out):
            return as_known(run(at_hand(job, scene, job.out), progress), job)
        there = far(job.out).below(job.called)
        if job.cached and (told := finished_there(there, job.mark, scene)) is not None:
            return unchanged_there(job, there, told)
        with own_folder() as out:
            done = as_known(run(at_hand(job, scene, str(out)), progress), job)
            made = out / job.called
            if made.is_dir() and not (done.folder is None and is_refined(there)):
                send(made, there)
            return done
    except (InputError, OSError) as error:
        return failed(job, error)


def unchanged_there(job: Job, there: Far, told: Mapping[str, Any]) -> Done:
    """A clip that is there, as its manifest tells, with its outcomes if they are asked for."""
    done = Done(job, job.folder, tuple(warned(told)), State.UNCHANGED)
    if job.tracked is None:
        return done
    with own_folder() as folder:
        file = folder / "trajectory.npz"
        there.fetch(file.name, file, MOST_MANIFEST)
        return with_outcomes(done, file)


def readable(path: str, overrides: Sequence[str] = (), variant: str | None = None) -> str:
    """A path under which a scene can be read: its own, or that of a copy. Raises InputError or OSError."""
    return str(fetched(path, overrides, variant)) if is_url(path) else path


def at_hand(job: Job, scene: str, out: str) -> Job:
    """The job for a process that has the scene as `scene` and makes the clip in `out`."""
    shown = job.path if is_url(job.path) else str(Path(job.path))
    known = job.here.known if job.here else pipeline.Known(shown, _source(job))
    return replace(job, here=Here(scene, out, job.called, job.mark, known))


def _source(job: Job) -> str:
    """Relative to the clip's folder, as in any manifest, unless one of both is a URL."""
    if is_url(job.path):
        return job.path
    return os.path.abspath(job.path) if is_url(job.out) else source_of(Path(job.path), job.folder)


def as_known(done: Done, job: Job) -> Done:
    """What became of the job at hand, told of the job as the user has it."""
    out = done.job.here.out if done.job.here else ""

    def said(text: str) -> str:
        return text.replace(out, job.out) if out else text

    problems = tuple(
        replace(at, place=at.place._replace(file=said(at.place.file)), expected=said(at.expected))
        for at in done.problems
    )
    folder = None if done.folder is None else job.folder
    return replace(done, job=job, folder=folder, problems=problems)


def finished_there(there: Far, mark: str, scene: str) -> Mapping[str, Any] | None:
    """As `finished.finished`, of a distant clip: its files count by sizes, which are known without reading them."""
    data = there.read(MANIFEST, MOST_MANIFEST)
    if data is None:
        return None
    try:
        told = made_of_the_same(data, mark, pipeline.scene_file(scene), hash_of)
        if told is None:
            return None
        expected: Mapping[str, int] = told["sizes"]
        files = there.files()
        sizes = {name: files[name].size for name in files.keys() & expected.keys()}
        whole = expected.keys() == told["files"].keys() and SENDING not in files
        return told if whole and sizes == expected else None
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    except OSError as error:
        if error.filename is not None and is_url(str(error.filename)):
            raise
        return None  # an input that is gone


def is_refined(there: Far) -> bool:
    """Whether an earlier run left a refined clip there: hours of work may be in it."""
    try:
        told = json.loads(there.read(MANIFEST, MOST_MANIFEST) or b"")
        return bool(told["refine"] and told["frames"])
    except (ValueError, KeyError, TypeError):
        return False


def send(folder: Path, there: Far) -> None:
    """A clip's folder, whole. Raises InputError where something else is there, OSError where it cannot be written."""
    files = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    manifest = files.pop(MANIFEST)
    old = there.files()
    ours = {MANIFEST, SENDING, *_named(there, MANIFEST, "files"), *_named(there, SENDING, "sending")}
    if strange := sorted(old.keys() - ours):
        found = ", ".join(strange[:3]) + (", ..." if len(strange) > 3 else "")
        expected = f"would be replaced, and holds {found}, which physgen did not make"
        raise InputError.of(there.url, "", expected, "move it out, or choose another folder with -o")
    names = sorted({*files, *(old.keys() - {MANIFEST, SENDING})})
    there.write(SENDING, json.dumps({"sending": names}).encode())
    there.remove([name for name in (MANIFEST,) if name in old])
    there.send(files)
    there.remove([name for name in old if name not in (*files, MANIFEST, SENDING)])
    there.write(MANIFEST, manifest.read_bytes())
    there.remove([SENDING])


def _named(there: Far, file: str, key: str) -> set[str]:
    """Files that a manifest, or the list of a run that was killed, names; none where there is none."""
    try:
        told = json.loads(there.read(file, MOST_MANIFEST) or b"")
        return {str(name) for name in told[key]}
    except (ValueError, KeyError, TypeError):
        return set()


@contextmanager
def own_folder() -> Iterator[Path]:
    """A folder for this process alone, which is gone when the block ends; what killed ones left is gone, too."""
    home = Path(tempfile.gettempdir(), f"physgen-{os.getuid()}")
    home.mkdir(mode=0o700, exist_ok=True)
    if home.stat().st_uid != os.getuid() or home.is_symlink():  # somebody was here first
        with tempfile.TemporaryDirectory(prefix="physgen-") as folder:
            yield Path(folder)
        return
    sweep_once(home)
    beside = partial(home / uuid4().hex)
    beside.mkdir()
    with in_use(beside):
        try:
            yield beside
        finally:
            rmtree(beside, ignore_errors=True)
