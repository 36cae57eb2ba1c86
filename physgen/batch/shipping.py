"""Exchange scenes and clips through a store of `fsspec`, for workers without a folder
in common with the user.

    URL/inputs/<SHA-256>              each scene file, photo and map, once
    URL/<output folder>/<clip>/...    each clip, as on one machine; its manifest.json is written last
    URL/<data set>/...                a data set, as on one machine; its dataset.json is written last

Paths are relative to the user's working folder. A worker uses its own folder with the
same relative paths, so that clips have the same bytes as on one machine.
"""

from __future__ import annotations

import atexit
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from uuid import uuid4

import fsspec

from physgen import pipeline
from physgen.batch.clips import MANIFEST, FoundClip, check_distinct
from physgen.batch.dataset import (
    DATASET_FILE,
    DatasetSummary,
    Gathering,
    check_apart,
    check_clips,
)
from physgen.batch.layouts import Members
from physgen.batch.run import Job, State
from physgen.batch.verify import VerifyRequest
from physgen.messages import Message
from physgen.problems import InputError, collect
from physgen.report.record import TIMING, file_hash, inputs
from physgen.text import natural

if TYPE_CHECKING:
    from physgen.scene.scene import Scene

Result = TypeVar("Result")

FLAG = "--ship"
INPUTS = "inputs"
"""Folder of scene files, photos and maps in a store."""
FILE_KEYS = ("image", "assets")
"""Scene keys with file paths: an edit of one changes the input files."""


class Store:
    """A folder of files for `fsspec`."""

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")
        try:
            # A cached listing would miss the files of other workers.
            file_system = fsspec.core.url_to_fs(self.url, use_listings_cache=False)
        except (ImportError, ValueError, OSError) as error:
            reason = str(error).split("\n")[0]
            raise Message.NOT_A_STORE.error(FLAG, f'"{url}"', reason=reason) from None
        self._files, self._root = file_system

    def size(self, name: str) -> int | None:
        """Return the size of a file in bytes, or None if it is missing."""
        try:
            return int(self._files.info(self._path(name))["size"])
        except FileNotFoundError:
            return None

    def holds(self, name: str) -> bool:
        """Return whether a file or folder exists."""
        return bool(self._files.exists(self._path(name)))

    def put(self, path: Path, name: str) -> None:
        """Write a local file into the store."""
        parent = self._path(name).rpartition("/")[0]
        try:
            self._files.makedirs(parent, exist_ok=True)
            self._files.put_file(str(path), self._path(name))
        except OSError as error:
            raise Message.STORE_UNWRITABLE.error(
                FLAG, f'"{self.url}"', reason=error.strerror or error
            ) from None

    def get(self, name: str, path: Path) -> None:
        """Read a file of the store into a local one. Raise FileNotFoundError."""
        path.parent.mkdir(parents=True, exist_ok=True)
        self._files.get_file(self._path(name), str(path))

    def remove(self, folder: str) -> None:
        """Remove a folder if it exists."""
        with suppress(FileNotFoundError):
            self._files.rm(self._path(folder), recursive=True)

    def clips(self, folder: str) -> Iterator[Path]:
        """Yield the paths of all clips in or below a folder. List each folder once."""
        # Stores return paths with or without a leading slash.
        root = self._root.strip("/")
        for place, folders, files in self._files.walk(self._path(folder)):
            if MANIFEST in files:
                # A clip contains no other clips: do not list its subfolders.
                folders.clear()
                yield Path(place.strip("/").removeprefix(root).strip("/"))

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}"


@dataclass(frozen=True)
class Shipment:
    """An item of work, with the input files for the worker."""

    # A Job, a VerifyRequest or a FoundClip.
    item: Any
    # Path below the working folder -> SHA-256.
    inputs: Mapping[str, str]


class Shipper:
    """Uploads the inputs of items into a store, each once."""

    def __init__(self, store: Store) -> None:
        self.store = store
        self._home = Path.cwd().resolve()
        self._inputs: dict[object, Mapping[str, str]] = {}

    def shipments(self, items: Iterable[Any]) -> Iterator[Shipment]:
        """Yield the items with their inputs. Raise InputError for a path outside the
        working folder.
        """
        for item in items:
            if isinstance(item, Job):
                self.name(Path(item.out))
                yield Shipment(item, self._job_inputs(item))
            elif isinstance(item, VerifyRequest):
                yield Shipment(item, self._request_inputs(item))
            else:
                yield Shipment(item, {})

    def _job_inputs(self, job: Job) -> Mapping[str, str]:
        """Return the inputs of a clip. Clips with the same scene and photo share one
        result.
        """
        options = job.options
        edits = []
        for edit in options.overrides:
            if edit.split("=")[0] in FILE_KEYS:
                edits.append(edit)
        # Only overrides that name files can change the inputs.
        key = (job.scene, options.variant, *edits)
        if key not in self._inputs:
            load = partial(pipeline.load, allow_outside=options.allow_outside)
            # If an override has a fault, the worker reports it, and needs the scene's
            # own files for the report.
            attempts = [
                partial(load, job.scene, options.overrides, options.variant),
                partial(load, job.scene),
            ]
            self._inputs[key] = self._ship(Path(job.scene), attempts)
        return self._inputs[key]

    def _request_inputs(self, request: VerifyRequest) -> Mapping[str, str]:
        """Return the inputs of the user's scene file. Without one, the clip's manifest
        names the inputs.
        """
        if request.scene is None:
            return {}
        if request.scene not in self._inputs:
            load = partial(
                pipeline.load, request.scene, allow_outside=request.allow_outside
            )
            self._inputs[request.scene] = self._ship(request.scene, [load])
        return self._inputs[request.scene]

    def _ship(
        self, path: Path, attempts: Sequence[Callable[[], Scene]]
    ) -> Mapping[str, str]:
        """Upload the inputs of a scene. If the scene does not load, upload only
        its file.
        """
        # The first attempt that loads gives the files of the scene.
        hashes: dict[Path, str] = {}
        for load in attempts:
            # The worker reports the fault.
            with suppress(InputError):
                scene = load()
                folder = scene.folder.resolve()
                for name, digest in inputs(scene, path).items():
                    hashes[folder / name] = digest
                break
        if not hashes and path.is_file():
            hashes[path] = file_hash(path)
        # Jobs with equal inputs share the uploaded files.
        names = {}
        for file, digest in hashes.items():
            name = f"{INPUTS}/{digest}"
            # Names are hashes: a file of the same size under this name is the same
            # file.
            if self.store.size(name) != file.stat().st_size:
                self.store.put(file, name)
            names[self.name(file)] = digest
        return names

    def name(self, path: Path) -> str:
        """Return a path relative to the working folder. Raise InputError for a path
        outside it.
        """
        # Links are not resolved: the worker needs the path in the scene's words.
        name = Path(os.path.normpath(self._home / path))
        if not name.is_relative_to(self._home):
            raise Message.OUTSIDE_WORKING_FOLDER.error(str(path))
        return name.relative_to(self._home).as_posix()


def run_shipped(
    store: Store,
    work: Callable[[Any], Result],
    items: Iterable[Any],
    lost_result: Callable[[Any, Exception], Result],
) -> tuple[Callable[[Shipment], Any], Iterator[Shipment], Callable[..., Result]]:
    """Return the arguments work, items and `lost_result` of `run_on_cluster` for items with
    files in a store.
    """

    def lost_shipment(shipment: Shipment, error: Exception) -> Result:
        return lost_result(shipment.item, error)

    shipped_work = partial(run_shipment, store.url, uuid4().hex, work)
    return shipped_work, Shipper(store).shipments(items), lost_shipment


def run_shipment(
    url: str, command: str, work: Callable[[Any], Any], shipment: Shipment
) -> Any:
    """Fetch the files of an item, work on it, and store the results; called on a
    worker.

    Items of the same `command` share a folder, because they have the same inputs.
    """
    store = _store(url)
    root = _worker_folder(command)
    os.chdir(root)
    for name, digest in shipment.inputs.items():
        _fetch_input(store, digest, root, Path(name))
    item = shipment.item
    if isinstance(item, Job):
        return _run_job(store, root, work, item)
    if isinstance(item, VerifyRequest):
        return _run_request(store, root, work, item)
    return _copy_clip(store, root, work, item)


def _run_request(
    store: Store, root: Path, work: Callable[[Any], Any], request: VerifyRequest
) -> Any:
    """Fetch a clip with its inputs, and verify it."""
    manifest = _fetch_clip(store, root, request.folder)
    if request.scene is None:
        folder = (request.folder / str(manifest.get("source", ""))).parent
        for name, digest in dict(manifest.get("inputs", {})).items():
            _fetch_input(store, str(digest), root, folder / str(name))
    verdict = work(request)
    # Fetched clips must not fill the worker's disk.
    shutil.rmtree(request.folder, ignore_errors=True)
    return verdict


def _copy_clip(
    store: Store, root: Path, work: Callable[[Any], Any], clip: FoundClip
) -> Any:
    """Fetch a clip, and store its copy for a data set."""
    manifest = _fetch_clip(store, root, clip.folder)
    sample = work(clip._replace(manifest=manifest or None))
    if sample.folder is not None:
        _store_folder(store, sample.folder)
        shutil.rmtree(sample.folder, ignore_errors=True)
    shutil.rmtree(clip.folder, ignore_errors=True)
    return sample


def _run_job(store: Store, root: Path, work: Callable[[Any], Any], job: Job) -> Any:
    """Make a clip and store it, unless the store has it unchanged."""
    # A scene may have no valid folder name.
    with suppress(InputError):
        _fetch_clip(store, root, job.folder)
    result = work(job)
    with suppress(InputError):
        if result.state is not State.UNCHANGED and (job.folder / MANIFEST).is_file():
            _store_folder(store, job.folder)
        shutil.rmtree(job.folder, ignore_errors=True)
    return result


def _store_folder(store: Store, folder: Path) -> None:
    """Replace a folder in the store. The manifest of a clip comes last, because it
    marks the clip as complete.
    """
    store.remove(folder.as_posix())
    files = []
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            files.append(path)
    # False comes before True, so that the manifest is last.
    files.sort(key=lambda path: path == folder / MANIFEST)
    for path in files:
        store.put(path, path.as_posix())


def _fetch_clip(store: Store, root: Path, folder: Path) -> Mapping[str, Any]:
    """Fetch a clip and return its manifest, or an empty mapping if there is no readable
    one.
    """
    try:
        store.get((folder / MANIFEST).as_posix(), folder / MANIFEST)
        manifest: Mapping[str, Any] = json.loads((folder / MANIFEST).read_bytes())
        names = [*map(str, manifest["files"]), TIMING]
    except (OSError, ValueError, KeyError, TypeError):
        return {}
    for name in names:
        # A manifest is untrusted: its paths must not lead out of the folder.
        if _is_inside(root, folder / name):
            with suppress(FileNotFoundError):
                store.get((folder / name).as_posix(), folder / name)
    return manifest


def _fetch_input(store: Store, digest: str, root: Path, path: Path) -> None:
    """Fetch a file by its SHA-256, unless it exists."""
    # A digest from a manifest is untrusted and becomes part of a path.
    if not digest.isalnum() or not _is_inside(root, path):
        return
    if not path.is_file() or file_hash(path) != digest:
        with suppress(FileNotFoundError):
            store.get(f"{INPUTS}/{digest}", path)


def _is_inside(root: Path, path: Path) -> bool:
    """Return whether a path is below a folder."""
    return Path(os.path.normpath(root / path)).is_relative_to(root)


@cache
def _store(url: str) -> Store:
    """Open a store once per process."""
    return Store(url)


_WORKER_FOLDERS: dict[str, Path] = {}
"""Folder of the last command in this process, by the command's id."""


def _worker_folder(command: str) -> Path:
    """Return this process's copy of the user's working folder, and remove the folder of
    the previous command.
    """
    if command not in _WORKER_FOLDERS:
        for folder in _WORKER_FOLDERS.values():
            shutil.rmtree(folder, ignore_errors=True)
        _WORKER_FOLDERS.clear()
        folder = Path(tempfile.mkdtemp(prefix="physgen-")).resolve()
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        _WORKER_FOLDERS[command] = folder
    return _WORKER_FOLDERS[command]


def stored_clips(store: Store, roots: Sequence[Path]) -> list[Path]:
    """Return the paths of all clips in or below folders of a store. Raise InputError if
    a folder has none.
    """
    folders: set[Path] = set()
    problems = []
    for root in roots:
        clips = set(store.clips(root.as_posix()))
        if not clips:
            problems += Message.NO_CLIP_IN_STORE.error(
                str(root), url=store.url
            ).problems
        folders |= clips
    if problems:
        raise InputError(problems)
    return sorted(folders, key=lambda folder: list(map(natural, folder.parts)))


def gather_stored(
    store: Store, roots: Sequence[Path], out: Path, gathering: Gathering
) -> DatasetSummary:
    """Make a data set of the clips in or below `roots` at the path `out` of a store,
    complete or not at all.

    Raise InputError for unusable folders, or if there is no clip.
    """
    check_distinct(roots)
    check_apart(out, roots)
    target = Path(Shipper(store).name(out))
    if store.holds(target.as_posix()):
        raise Message.IN_STORE_ALREADY.error(str(out), url=store.url)
    gathering = replace(
        gathering, root=target, fetch_members=partial(_fetch_members, store)
    )
    clips = _found_clips(store, roots)
    with tempfile.TemporaryDirectory(prefix="physgen-") as name:
        folder = Path(name)
        try:
            summary = gathering.write(folder, iter(clips))
            check_clips(summary, roots)
            files = []
            for path in sorted(folder.rglob("*")):
                if path.is_file():
                    files.append(path)
            # The settings file comes last, because it marks the data set as complete.
            files.sort(key=lambda path: path == folder / DATASET_FILE)
            for path in files:
                store.put(path, (target / path.relative_to(folder)).as_posix())
        except BaseException:
            store.remove(target.as_posix())
            raise
        summary.files = [target / path.relative_to(folder) for path in summary.files]
    return summary


def _found_clips(store: Store, roots: Sequence[Path]) -> list[FoundClip]:
    """Return the clips in or below folders of a store, without manifests: workers read
    them. Raise InputError.
    """
    names = map(Shipper(store).name, roots)
    folders = collect(partial(stored_clips, store, [Path(name)]) for name in names)
    clips = []
    for root, clip_paths in zip(roots, folders, strict=True):
        parent = Path(root).resolve().parent
        for folder in clip_paths:
            name = folder.resolve().relative_to(parent).as_posix()
            clips.append(FoundClip(folder, name, None))
    return clips


@contextmanager
def _fetch_members(store: Store, members: Members) -> Iterator[Members]:
    """Fetch the files of a clip, and remove them at the end of the block."""
    with tempfile.TemporaryDirectory(prefix="physgen-") as name:
        copies = {}
        for member, path in members.items():
            copies[member] = Path(name) / member
            store.get(path.as_posix(), copies[member])
        yield copies
