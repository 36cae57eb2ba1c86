"""An errand from the user's machine -> its answer: the clip where it belongs, or what the worker misses to make it.

A worker that sees the user's folders makes the clip as the user's machine would, in the same folder with the same
words. One that does not is sent the scene, or sends the clip back.
"""

from __future__ import annotations

import os
import pickle
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from physgen.batch.cluster.versions import Versions, here
from physgen.batch.far import at_hand, own_folder, readable, run_far
from physgen.batch.pool import Done, Job, failed, run
from physgen.problems import InputError
from physgen.urls import is_url
from physgen.whole import Stamp, stamped


@dataclass(frozen=True)
class Errand:
    """A clip to make, and how to tell whether folders are the user's."""

    job: Job
    """`here` says what the clip is called where a file of it is sent."""
    folder: str
    """The user's working folder."""
    scene: Stamp | None
    """Of the scene's file as the user sees it; None for a URL, and where the scene is sent."""
    token: str | None
    """A file in the folder of results; None for a URL, and where the clip is to be sent back."""
    back: bool = False
    """Whether the clip is to be sent back."""


@dataclass(frozen=True)
class Answer:
    """How an errand went; or why it was not begun."""

    done: Done | None = None
    files: Mapping[str, bytes] | None = None
    """Of the clip, by their names in its folder, where it is sent back."""
    versions: Versions | None = None
    """Of a worker that would make other clips."""
    scene_unseen: bool = False
    folder_unseen: bool = False


def answered(asked: tuple[Versions, bytes, str | None]) -> bytes:
    """What a hand does with what `hands.run_errands` was given: versions, errand, and the path of a pack."""
    versions, errand, pack = asked
    if versions != here():
        return pickle.dumps(Answer(versions=here()))
    return pickle.dumps(_answered(pickle.loads(errand), pack))


def _answered(errand: Errand, pack: str | None) -> Answer:
    job = errand.job
    if os.path.isabs(errand.folder) and (errand.scene or errand.token):
        with suppress(OSError):
            os.chdir(errand.folder)
    scene_unseen = errand.scene is not None and stamped(Path(job.path)) != errand.scene
    folder_unseen = errand.token is not None and not Path(job.out, errand.token).is_file()
    if scene_unseen or folder_unseen:
        return Answer(scene_unseen=scene_unseen, folder_unseen=folder_unseen)
    if pack is None and not errand.back:
        return Answer(run(job))
    try:
        scene = pack or readable(job.path, job.overrides, job.variant)
        if not errand.back:
            if is_url(job.out):
                return Answer(run_far(job, scene=scene))
            return Answer(run(at_hand(job, scene, job.out)))
        with own_folder() as out:
            done = run(at_hand(job, scene, str(out)))
            return Answer(done, _files(out / job.called))
    except (InputError, OSError) as error:
        return Answer(failed(job, error))


def _files(folder: Path) -> dict[str, bytes] | None:
    if not folder.is_dir():
        return None
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def with_names(job: Job) -> Job:
    """With all that a worker cannot know of it: for one that is sent the scene, or sends the clip."""
    return at_hand(replace(job, refiner=job.refiner.settled()), "", "")
