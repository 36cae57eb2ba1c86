"""Scenes and clips in a store that `fsspec` reads and writes, for workers that share no folder with the user.

    URL/inputs/<SHA-256>              each scene file, photo and map, once
    URL/<output folder>/<clip>/...    each clip, as on one machine; its manifest.json is written last

Paths are those below the user's working folder. A worker works in a folder of its own that mirrors it, so that clips
have the same bytes as on one machine.
"""

from __future__ import annotations

import atexit
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from uuid import uuid4

import fsspec

from physgen import pipeline
from physgen.batch.clips import MANIFEST
from physgen.batch.run import Job, State, run
from physgen.batch.verify import VerifyRequest, verify
from physgen.problems import InputError
from physgen.report.record import TIMING, file_hash, inputs
from physgen.text import natural

if TYPE_CHECKING:
    from physgen.scene.scene import Scene

Result = TypeVar("Result")

FLAG = "--ship"
INPUTS = "inputs"
"""Folder of scene files, photos and maps in a store."""
FILE_KEYS = ("image", "assets")
"""Keys of a scene that name files: an edit of one changes what the scene reads."""


class Store:
    """A folder that `fsspec` reads and writes."""

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")
        try:
            # a listing that is kept would miss the files of other workers
            opened = fsspec.core.url_to_fs(self.url, use_listings_cache=False)
        except (ImportError, ValueError, OSError) as error:
            reason = str(error).split("\n")[0]
            fix = "write e.g. s3://BUCKET/NAME, and install the package for it"
            fault = f"is no store ({reason})"
            raise InputError.of(FLAG, f'"{url}"', fault, fix) from None
        self._files, self._root = opened

    def size(self, name: str) -> int | None:
        """Return the bytes of a file, or None if there is none."""
        try:
            return int(self._files.info(self._path(name))["size"])
        except FileNotFoundError:
            return None

    def put(self, path: Path, name: str) -> None:
        """Write a local file into the store."""
        parent = self._path(name).rpartition("/")[0]
        try:
            self._files.makedirs(parent, exist_ok=True)
            self._files.put_file(str(path), self._path(name))
        except OSError as error:
            fault = f"cannot be written ({error.strerror or error})"
            fix = "name a store in which you may write"
            raise InputError.of(FLAG, f'"{self.url}"', fault, fix) from None

    def get(self, name: str, path: Path) -> None:
        """Read a file of the store into a local one. Raises FileNotFoundError."""
        path.parent.mkdir(parents=True, exist_ok=True)
        self._files.get_file(self._path(name), str(path))

    def remove(self, folder: str) -> None:
        """Remove a folder, if it is there."""
        with suppress(FileNotFoundError):
            self._files.rm(self._path(folder), recursive=True)

    def clips(self, folder: str) -> Iterator[Path]:
        """Yield the paths of all clips in or below a folder, by one listing a folder."""
        root = self._root.strip("/")
        for place, folders, files in self._files.walk(self._path(folder)):
            if MANIFEST in files:
                folders.clear()
                yield Path(place.strip("/").removeprefix(root).strip("/"))

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}"


@dataclass(frozen=True)
class Shipment:
    """An item of work, and what a worker fetches for it."""

    item: Any  # a Job or a VerifyRequest
    inputs: Mapping[str, str]  # path below the working folder -> SHA-256


class Shipper:
    """Puts the inputs of items into a store, each once."""

    def __init__(self, store: Store) -> None:
        self.store = store
        self._home = Path.cwd().resolve()
        self._inputs: dict[object, Mapping[str, str]] = {}

    def shipments(self, items: Iterable[Any]) -> Iterator[Shipment]:
        """Yield the items with their inputs. Raise InputError for paths outside of the working folder."""
        for item in items:
            if isinstance(item, Job):
                self._name(Path(item.out))
                yield Shipment(item, self._job_inputs(item))
            else:
                yield Shipment(item, self._request_inputs(item))

    def _job_inputs(self, job: Job) -> Mapping[str, str]:
        """Return the inputs of a clip; clips with the same scene and photo share them."""
        options = job.options
        edits = [edit for edit in options.overrides if edit.split("=")[0] in FILE_KEYS]
        key = (job.scene, options.variant, *edits)
        if key not in self._inputs:
            load = partial(pipeline.load, allow_outside=options.allow_outside)
            attempts = [
                partial(load, job.scene, options.overrides, options.variant),
                partial(load, job.scene),
            ]
            self._inputs[key] = self._ship(Path(job.scene), attempts)
        return self._inputs[key]

    def _request_inputs(self, request: VerifyRequest) -> Mapping[str, str]:
        """Return the inputs of the scene that the user names; other clips name theirs."""
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
        """Put the inputs of a scene into the store; of one that cannot be loaded, the file."""
        hashes: dict[Path, str] = {}
        for load in attempts:
            with suppress(InputError):  # the worker reports it
                scene = load()
                folder = scene.folder.resolve()
                for name, digest in inputs(scene, path).items():
                    hashes[folder / name] = digest
                break
        if not hashes and path.is_file():
            hashes[path] = file_hash(path)
        names = {}
        for file, digest in hashes.items():
            name = f"{INPUTS}/{digest}"
            if self.store.size(name) != file.stat().st_size:
                self.store.put(file, name)
            names[self._name(file)] = digest
        return names

    def _name(self, path: Path) -> str:
        """Return a path below the working folder. Raise InputError for another one."""
        name = Path(os.path.normpath(self._home / path))
        if not name.is_relative_to(self._home):
            fault = "is outside of the working folder"
            fix = f"with {FLAG}, run the command in a folder that holds scenes and results"
            raise InputError.of(str(path), "", fault, fix)
        return name.relative_to(self._home).as_posix()


def shipped(
    store: Store,
    items: Iterable[Any],
    lost: Callable[[Any, Exception], Result],
) -> tuple[Callable[[Shipment], Any], Iterator[Shipment], Callable[..., Result]]:
    """Return work, items and `lost` of `run_on_cluster` for jobs or requests whose files are in a store."""

    def lost_shipment(shipment: Shipment, error: Exception) -> Result:
        return lost(shipment.item, error)

    work = partial(run_shipment, store.url, uuid4().hex)
    return work, Shipper(store).shipments(items), lost_shipment


def run_shipment(url: str, command: str, shipment: Shipment) -> Any:
    """Fetch the files of an item, work on it, and store the clip; on a worker.

    Items of one `command` share a folder: they have the same inputs.
    """
    store = _store(url)
    root = _worker_folder(command)
    os.chdir(root)
    for name, digest in shipment.inputs.items():
        _fetch_input(store, digest, root, Path(name))
    if isinstance(shipment.item, Job):
        return _run_job(store, root, shipment.item)
    request: VerifyRequest = shipment.item
    manifest = _fetch_clip(store, root, request.folder)
    if request.scene is None:
        folder = (request.folder / str(manifest.get("source", ""))).parent
        for name, digest in dict(manifest.get("inputs", {})).items():
            _fetch_input(store, str(digest), root, folder / str(name))
    verdict = verify(request)
    shutil.rmtree(request.folder, ignore_errors=True)
    return verdict


def _run_job(store: Store, root: Path, job: Job) -> Any:
    """Make a clip unless the store has it unchanged, and store it."""
    with suppress(InputError):  # a scene without a name for its folder
        _fetch_clip(store, root, job.folder)
    result = run(job)
    with suppress(InputError):
        if result.state is not State.UNCHANGED and (job.folder / MANIFEST).is_file():
            _store_clip(store, job.folder)
        shutil.rmtree(job.folder, ignore_errors=True)
    return result


def _store_clip(store: Store, folder: Path) -> None:
    """Replace a clip in the store; its manifest comes last, and says that it is complete."""
    store.remove(folder.as_posix())
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    files.sort(key=lambda path: path == folder / MANIFEST)
    for path in files:
        store.put(path, path.as_posix())


def _fetch_clip(store: Store, root: Path, folder: Path) -> Mapping[str, Any]:
    """Fetch a clip and return its manifest; empty if there is none that can be read."""
    try:
        store.get((folder / MANIFEST).as_posix(), folder / MANIFEST)
        manifest: Mapping[str, Any] = json.loads((folder / MANIFEST).read_bytes())
        names = [*map(str, manifest["files"]), TIMING]
    except (OSError, ValueError, KeyError, TypeError):
        return {}
    for name in names:
        if _is_inside(root, folder / name):  # a manifest is untrusted
            with suppress(FileNotFoundError):
                store.get((folder / name).as_posix(), folder / name)
    return manifest


def _fetch_input(store: Store, digest: str, root: Path, path: Path) -> None:
    """Fetch a file by its SHA-256, unless it is there."""
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
    """Open a store once a process."""
    return Store(url)


_WORKER_FOLDERS: dict[str, Path] = {}
"""The folder of the last command in this process, by its id."""


def _worker_folder(command: str) -> Path:
    """Return the folder that stands for the user's working folder; remove that of the command before."""
    if command not in _WORKER_FOLDERS:
        for folder in _WORKER_FOLDERS.values():
            shutil.rmtree(folder, ignore_errors=True)
        _WORKER_FOLDERS.clear()
        folder = Path(tempfile.mkdtemp(prefix="physgen-")).resolve()
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        _WORKER_FOLDERS[command] = folder
    return _WORKER_FOLDERS[command]


def stored_clips(store: Store, roots: Sequence[Path]) -> list[Path]:
    """Return the paths of all clips in or below folders of a store. Raise InputError for none."""
    folders: set[Path] = set()
    problems = []
    for root in roots:
        clips = set(store.clips(root.as_posix()))
        if not clips:
            fix = f"name a folder below {store.url} that holds clips"
            fault = f"holds no clip in {store.url}"
            problems += InputError.of(str(root), "", fault, fix).problems
        folders |= clips
    if problems:
        raise InputError(problems)
    return sorted(folders, key=lambda folder: [natural(part) for part in folder.parts])
