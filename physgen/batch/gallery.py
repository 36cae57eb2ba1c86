"""The gallery of a folder of clips, local or remote, with records of failed clips."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path

from physgen.batch.remote import RemoteFile, RemoteFolder, is_url, open_folder, url_below
from physgen.batch.run import MANIFEST, MAX_FETCHED_BYTES, Done, own_folder, record_failure
from physgen.batch.workers import LostError, run_parallel
from physgen.problems import InputError
from physgen.report.clips import ENDING, Clip, clips_in
from physgen.report.films import poster_and_strip
from physgen.report.folders import cleaned_up
from physgen.report.gallery import ASKED, TABLE, Progress, write_gallery

INDEX, PICTURES = "index.html", "index.files"
FAILURE_ENDINGS = (ENDING, f"{ENDING.removesuffix('json')}html")
MANY = 1000
"""From so many clips on a gallery is made in a process of its own, whose memory is freed afterwards."""
MAX_FILM_BYTES = 10_000_000_000


class LocalResults:
    """A local folder of clips. Methods raise OSError where it cannot be written, unless noted."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self.index = str(root / INDEX)
        """The gallery as the user knows it."""

    def has_index(self, since: float = 0.0) -> bool:
        """Whether there is a gallery that was written since then, s since 1970."""
        index = self._root / INDEX
        return index.exists() and index.stat().st_mtime >= since

    def ended(self, done: Done, gallery: bool) -> None:
        """Keeps a record of a failed clip for the gallery, and removes that of a clip that was made; never raises."""
        record_failure(done, self._root, gallery)

    def cleaned_up(self) -> AbstractContextManager[None]:
        """Removes unfinished files where the block is left early."""
        return cleaned_up(self._root)

    def write_index(self, progress: Progress, kept: Callable[[str], None], count: int) -> None:
        """Writes the gallery of about `count` clips; `kept` gets the new names of files that were in its way."""
        if not self._root.is_dir():
            return
        if count <= MANY:
            names = _write_page(self._root, progress)
        else:
            progress("gallery", 0, 1)
            (names,) = run_parallel(_write_page, [self._root], 2, _raise_lost)
        for name in names:
            kept(name)


def _write_page(root: Path, progress: Progress = lambda stage, done, total: None) -> list[str]:
    kept: list[str] = []
    write_gallery([root], root / INDEX, progress=progress, keep=lambda path: kept.append(path.name))
    return kept


def _raise_lost(root: Path, error: LostError) -> list[str]:
    raise OSError(f"{root}: the gallery could not be made: {error}")


class RemoteResults:
    """A remote folder of clips; methods as those of LocalResults.

    The page is made here from the clips' manifests. Only films without a poster are fetched, one at a time.
    """

    def __init__(self, url: str) -> None:
        self._remote = open_folder(url)
        self._failed: set[str] | None = None
        """Clips with a record of a failure."""
        self.index = url_below(url, INDEX)

    def has_index(self, since: float = 0.0) -> bool:
        """Whether there is a gallery; its age is not known."""
        return self._remote.read(INDEX, 0) is not None

    def ended(self, done: Done, gallery: bool) -> None:
        """See LocalResults."""
        with suppress(InputError, OSError):
            name = done.job.name
            if self._failed is None:
                top = self._remote.top()
                self._failed = {file.removesuffix(ENDING) for file in top if file.endswith(ENDING)}
            if done.folder is not None and name in self._failed:
                self._remote.remove([f"{name}{ending}" for ending in FAILURE_ENDINGS])
                self._failed.remove(name)
            if done.folder is None and gallery:
                with own_folder() as folder:
                    record_failure(done, folder, gallery)
                    self._remote.send(_files(folder))
                self._failed.add(name)

    def cleaned_up(self) -> AbstractContextManager[None]:
        """Files are sent whole: nothing remains unfinished."""
        return nullcontext()

    def write_index(self, progress: Progress, kept: Callable[[str], None], count: int) -> None:
        """See LocalResults."""
        with own_folder() as folder:
            remote = self._remote.files()
            root = folder / "clips"
            (root / PICTURES).mkdir(parents=True)
            for name, file in remote.items():
                if name.startswith(f"{PICTURES}/"):
                    (root / name).touch()  # the name of a picture identifies its content
                elif name in (INDEX, TABLE, ASKED) or ("/" not in name and name.endswith(FAILURE_ENDINGS)):
                    _fetch(self._remote, name, file, root)
                elif name.endswith(f"/{MANIFEST}"):
                    _mirror_clip(self._remote, remote, name.removesuffix(f"/{MANIFEST}"), root)
            before = _files(root).keys()
            title = self._remote.url.rstrip("/").rpartition("/")[2] or "Gallery"
            write_gallery(
                [root], root / INDEX, title=title, progress=progress, keep=lambda path: kept(path.name)
            )
            after = _files(root)
            pictures = {name: path for name, path in after.items() if name.startswith(f"{PICTURES}/")}
            new = {
                name: path for name, path in pictures.items() if name not in remote and path.stat().st_size
            }
            new |= {name: path for name, path in after.items() if "/" not in name and name not in before}
            self._remote.send(new | {INDEX: after[INDEX]})
            stale = [name for name in remote if name.startswith(f"{PICTURES}/") and name not in pictures]
            self._remote.remove(stale)


def _files(folder: Path) -> dict[str, Path]:
    return {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}


def _fetch(
    source: RemoteFolder, name: str, file: RemoteFile, root: Path, most: int = MAX_FETCHED_BYTES
) -> None:
    """Copies a file with its time."""
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if source.fetch(name, path, most) and file.time:
        os.utime(path, (file.time, file.time))


def _mirror_clip(source: RemoteFolder, remote: Mapping[str, RemoteFile], clip: str, root: Path) -> None:
    """What a gallery reads of a clip: its manifest, the names of its files, and the pictures of its film."""
    for name in [name for name in remote if name.startswith(f"{clip}/")]:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).touch()
    _fetch(source, f"{clip}/{MANIFEST}", remote[f"{clip}/{MANIFEST}"], root)
    for found in clips_in([root / clip]):
        if found.film is None or not found.seal:
            continue
        pictures = [root / PICTURES / f"{found.seal}.{kind}.webp" for kind in ("poster", "strip")]
        if not all(picture.exists() for picture in pictures):
            _make_pictures(source, remote, found, pictures, root)


def _make_pictures(
    source: RemoteFolder, remote: Mapping[str, RemoteFile], clip: Clip, pictures: list[Path], root: Path
) -> None:
    """Poster and strip of a film that is fetched for them; none where it cannot be read."""
    assert clip.film is not None
    film = clip.film.relative_to(root).as_posix()
    folder = f"{film.rpartition('/')[0]}/"
    parts = [name for name in remote if name.startswith(folder)] if film.endswith(".png") else [film]
    for name in parts:
        _fetch(source, name, remote[name], root, MAX_FILM_BYTES)
    with suppress(OSError):
        for path, data in zip(pictures, poster_and_strip(clip.film, clip.frames), strict=True):
            path.write_bytes(data)
    for name in parts:
        (root / name).write_bytes(b"")


ResultsFolder = LocalResults | RemoteResults


def results_folder(out: str) -> ResultsFolder:
    """The folder of results as the user names it. Raises InputError for an unknown protocol."""
    return RemoteResults(out) if is_url(out) else LocalResults(Path(out))
