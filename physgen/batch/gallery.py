"""The gallery of a folder of clips, local or remote, with traces of failed clips."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Set
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from typing import Protocol

from physgen.batch.remote import RemoteFile, RemoteFolder, is_url, open_folder, url_below
from physgen.batch.run import MANIFEST, MOST_MANIFEST, Done, ended, own_folder
from physgen.batch.workers import LostError, run_parallel
from physgen.problems import InputError
from physgen.report.clips import ENDING, Clip, clips_in
from physgen.report.films import poster_and_strip
from physgen.report.gallery import ASKED, TABLE, Progress, write_gallery

# ----------------------------------------------------------------------
# A folder of clips behind a URL -> its gallery there, and what clips that failed leave for it.
#
# The page is made on this machine of the clips' manifests. Posters and strips lie beside it as those of a
# local gallery:
# only films that have none yet are fetched, one at a time.

INDEX, FILES = "index.html", "index.files"
ENDINGS = (ENDING, f"{ENDING.removesuffix('json')}html")
MOST_FILM = 10_000_000_000
"""Bytes."""


class RemoteResults:
    """Where the clips of a command go, and what is beside them there. Methods raise OSError unless they say."""

    def __init__(self, url: str) -> None:
        self._there = open_folder(url)
        self._failed: set[str] | None = None
        """Clips of which there are traces."""

    @property
    def index(self) -> str:
        """The gallery's URL."""
        return url_below(self._there.url, INDEX)

    def has_index(self, since: float = 0.0) -> bool:
        """Whether there is a gallery; not how old it is."""
        return self._there.read(INDEX, 0) is not None

    def ended(self, done: Done, gallery: bool) -> None:
        """As `pool.ended`."""
        with suppress(InputError, OSError):
            name = done.job.called
            if self._failed is None:
                self._failed = {
                    file.removesuffix(ENDING) for file in self._there.top() if file.endswith(ENDING)
                }
            if name not in self._failed and (done.folder is not None or not gallery):
                return
            with own_folder() as beside:
                for ending in ENDINGS if name in self._failed else ():
                    self._there.fetch(f"{name}{ending}", beside / f"{name}{ending}", MOST_MANIFEST)
                before = _files(beside)
                ended(done, beside, gallery)
                after = _files(beside)
                self._there.send(after)
                self._there.remove(sorted(before.keys() - after.keys()))
            self._failed.add(name)

    def cleared(self) -> AbstractContextManager[None]:
        """Nothing is half-written there: each file is sent whole."""
        return nullcontext()

    def write_index(self, progress: Progress, kept: Callable[[str], None], count: int) -> None:
        """The page of all that is in the folder, made again; a file of somebody else's there is `kept` by that name."""
        with own_folder() as beside:
            there = self._there.files()
            root = beside / "clips"
            (root / FILES).mkdir(parents=True)
            for name, told in there.items():
                if name.startswith(f"{FILES}/"):
                    (root / name).touch()  # a picture's name says all of it
                elif name in (INDEX, TABLE, ASKED) or ("/" not in name and name.endswith(ENDINGS)):
                    _fetch(self._there, name, told, root)
                elif name.endswith(f"/{MANIFEST}"):
                    _mirror(self._there, there, name.removesuffix(f"/{MANIFEST}"), root)
            before = _files(root).keys()
            title = self._there.url.rstrip("/").rpartition("/")[2] or "Gallery"
            write_gallery(
                [root], root / INDEX, title=title, progress=progress, keep=lambda path: kept(path.name)
            )
            after = _files(root)
            new = {name: path for name, path in after.items() if _is_new(name, path, there, before)}
            self._there.send(new)
            self._there.send({INDEX: after[INDEX]})
            self._there.remove([name for name in there if name.startswith(f"{FILES}/") and name not in after])


def _is_new(name: str, path: Path, there: Mapping[str, RemoteFile], before: Set[str]) -> bool:
    """Whether a file is one that making the page made, beside the page."""
    if name.startswith(f"{FILES}/"):
        return name not in there and path.stat().st_size > 0
    return "/" not in name and name not in before and name != INDEX


def _files(folder: Path) -> dict[str, Path]:
    return {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}


def _fetch(source: RemoteFolder, name: str, told: RemoteFile, root: Path, most: int = MOST_MANIFEST) -> None:
    """A file as it is there, its time too."""
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if source.fetch(name, path, most) and told.time:
        os.utime(path, (told.time, told.time))


def _mirror(source: RemoteFolder, there: Mapping[str, RemoteFile], clip: str, root: Path) -> None:
    """What a gallery reads of a clip: its manifest, that a film and a report are there, and pictures of the film."""
    _fetch(source, f"{clip}/{MANIFEST}", there[f"{clip}/{MANIFEST}"], root)
    names = [name for name in there if name.startswith(f"{clip}/") and name != f"{clip}/{MANIFEST}"]
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).touch()
    for found in clips_in([root / clip]):
        if found.film is None or not found.seal:
            continue
        files = [root / FILES / f"{found.seal}.{kind}.webp" for kind in ("poster", "strip")]
        if not all(file.exists() for file in files):
            _draw(source, there, found, files, root)


def _draw(
    source: RemoteFolder, there: Mapping[str, RemoteFile], clip: Clip, files: list[Path], root: Path
) -> None:
    """Poster and strip of a film that is fetched for them; none where it cannot be read."""
    assert clip.film is not None
    film = clip.film.relative_to(root).as_posix()
    folder = f"{film.rpartition('/')[0]}/"
    parts = [name for name in there if name.startswith(folder)] if film.endswith(".png") else [film]
    for name in parts:
        _fetch(source, name, there[name], root, MOST_FILM)
    with suppress(OSError):
        for file, data in zip(files, poster_and_strip(clip.film, clip.frames), strict=True):
            file.write_bytes(data)
    for name in parts:
        (root / name).write_bytes(b"")


# ----------------------------------------------------------------------
# The folder of results -> what is beside the clips in it: a gallery, and traces of those that failed.

MANY = 1000
"""Clips whose gallery is made in a process of its own."""


class ResultsFolder(Protocol):
    """A folder, here or behind a URL. Methods raise OSError where it cannot be reached, or written."""

    @property
    def index(self) -> str:
        """The gallery's file, as the user knows it."""

    def has_index(self, since: float = 0.0) -> bool:
        """Whether there is a gallery, made since then, s since 1970, as far as that can be told."""

    def ended(self, done: Done, gallery: bool) -> None:
        """What `pool.ended` leaves or takes away; never raises."""

    def cleared(self) -> AbstractContextManager[None]:
        """What processes were ended over goes, where the block is left early."""

    def write_index(self, progress: Progress, kept: Callable[[str], None], count: int) -> None:
        """The gallery of all clips there, some `count`, made again; a file of somebody else's is `kept` elsewhere."""


class LocalResults:
    """A folder of this machine."""

    def __init__(self, root: Path) -> None:
        self._root = root

    @property
    def index(self) -> str:
        """The gallery's file."""
        return str(self._root / "index.html")

    def has_index(self, since: float = 0.0) -> bool:
        """Whether there is a gallery that is not older."""
        index = self._root / "index.html"
        return index.exists() and index.stat().st_mtime >= since

    def ended(self, done: Done, gallery: bool) -> None:
        """See `pool.ended`."""
        ended(done, self._root, gallery)

    def cleared(self) -> AbstractContextManager[None]:
        """See `report.leftovers`."""
        from physgen.report.folders import cleaned_up

        return cleaned_up(self._root)

    def write_index(self, progress: Progress, kept: Callable[[str], None], count: int) -> None:
        """The gallery, where there is a folder at all; many clips fill another process's memory."""
        if not self._root.is_dir():
            return
        if count <= MANY:
            for path in _page(self._root, progress):
                kept(path.name)
            return
        progress("gallery", 0, 1)
        for paths in run_parallel(_page, [self._root], 2, _lost):
            for path in paths:
                kept(path.name)


def _page(root: Path, progress: Progress = lambda stage, done, total: None) -> list[Path]:
    """The gallery of a folder; what stood in its way."""
    from physgen.report.gallery import write_gallery

    kept: list[Path] = []
    write_gallery([root], root / "index.html", progress=progress, keep=kept.append)
    return kept


def _lost(root: Path, error: LostError) -> list[Path]:
    raise OSError(f"{root}: the gallery could not be made: {error}")


def results_folder(out: str) -> ResultsFolder:
    """That of a folder as the user names it. Raises InputError where nobody knows its protocol."""
    if not is_url(out):
        return LocalResults(Path(out))

    return RemoteResults(out)
