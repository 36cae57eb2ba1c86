"""What the user's machine does for clips that workers make: which folders they share, what is sent, what comes back."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from physgen.batch.cluster.errands import Errand, with_names
from physgen.batch.far import (
    as_known,
    finished_there,
    is_refined,
    own_folder,
    readable,
    send,
    unchanged_there,
)
from physgen.batch.fetched import fetched_pack, packed_for
from physgen.batch.finished import finished
from physgen.batch.finished import warnings as warned
from physgen.batch.places import far
from physgen.batch.pool import Done, Job, State, failed, hash_of, with_outcomes
from physgen.pipeline.packs import scene_file
from physgen.problems import InputError
from physgen.report.folder import output_folder, whole_folder
from physgen.urls import is_private, is_url
from physgen.whole import partial, stamped


class Home:
    """What is sent, and what is not: folders are used as if they were shared until a worker says that it misses one."""

    def __init__(self, ship: bool) -> None:
        self._ship = ship
        self._scenes = self._clips = ship
        self._tokens: dict[str, Path] = {}

    def missed(self, scene: bool, folder: bool) -> None:
        """A worker does not see what others may see: from now on it is sent."""
        self._scenes |= scene
        self._clips |= folder

    def sends(self, job: Job) -> bool:
        """Whether its scene is sent to the worker."""
        if is_url(job.path):
            return self._ship or is_private(job.path)
        return self._scenes

    def _returns(self, job: Job) -> bool:
        """Whether the clip is sent back."""
        if is_url(job.out):
            return self._ship or is_private(job.out)
        return self._clips

    def errand(self, job: Job) -> Errand:
        """What a worker is told. Raises InputError or OSError where the folder of results cannot be used."""
        sends, back = self.sends(job), self._returns(job)
        known = with_names(job) if sends or back else replace(job, refiner=job.refiner.settled())
        scene = None if sends or is_url(job.path) else stamped(Path(job.path))
        token = None if back or is_url(job.out) else self._token(job.out)
        return Errand(known, os.getcwd(), scene, token, back)

    def _token(self, out: str) -> str:
        """The name of a file in the folder, by which a worker knows that it sees the same."""
        if out not in self._tokens:
            folder = Path(out)
            folder.mkdir(parents=True, exist_ok=True)
            self._tokens[out] = partial(folder / secrets.token_hex(8))
        self._tokens[out].touch()  # an old one is taken for a leftover, and a run may take days
        return self._tokens[out].name

    def close(self) -> None:
        """Nobody asks any more."""
        for token in self._tokens.values():
            with suppress(OSError):
                token.unlink()

    def early(self, job: Job) -> Done | None:
        """How a job ends without any worker: the clip is there, or its folder is somebody else's."""
        if not self._returns(job):
            return None
        try:
            if not is_url(job.out):
                output_folder(Path(job.out), job.called)
            if not job.cached:
                return None
            scene = readable(job.path, job.overrides, job.variant)
            if is_url(job.out):
                there = far(job.out).below(job.called)
                told = finished_there(there, job.mark, scene)
                return None if told is None else unchanged_there(job, there, told)
            told = finished(job.folder, job.mark, scene_file(scene), hash_of)
            if told is None:
                return None
            done = Done(job, job.folder, tuple(warned(told)), State.UNCHANGED)
            return with_outcomes(done, job.folder / "trajectory.npz")
        except (InputError, OSError) as error:
            return failed(job, error)


def pack_for(job: Job) -> bytes:
    """Its scene. Raises InputError with what is wrong with it, or OSError."""
    if is_url(job.path):
        return fetched_pack(job.path, job.overrides, job.variant)
    return packed_for(job.scene, job.overrides, job.variant, job.allow_outside)


def brought(job: Job, done: Done, files: Mapping[str, bytes] | None) -> Done:
    """What became of a job, told of the user's own, with the clip where it belongs, whole or not at all."""
    told = as_known(done, job)
    if files is None:
        return told
    try:
        if is_url(job.out):
            there = far(job.out).below(job.called)
            if told.folder is not None or not is_refined(there):
                with own_folder() as folder:
                    _write(files, folder)
                    send(folder, there)
        elif told.folder is not None or not _is_refined(job.folder):
            with whole_folder(job.folder) as folder:
                _write(files, folder)
    except (InputError, OSError) as error:
        return failed(job, error, seconds=done.seconds)
    return told


def _write(files: Mapping[str, bytes], folder: Path) -> None:
    for name, data in files.items():
        path = Path(os.path.normpath(folder / name))
        if not path.is_relative_to(folder):
            raise InputError.of(name, "", "leads out of the clip's folder", "see what the workers run")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def _is_refined(folder: Path) -> bool:
    """As `far.is_refined`, of a folder of this machine."""
    try:
        told = json.loads((folder / "manifest.json").read_bytes())
        return bool(told["refine"] and told["frames"])
    except (OSError, ValueError, KeyError, TypeError):
        return False


@contextmanager
def at_home(ship: bool) -> Iterator[Home]:
    """For the jobs of one command."""
    home = Home(ship)
    try:
        yield home
    finally:
        home.close()
