"""A folder of clips behind a URL -> its gallery there, and what clips that failed leave for it.

The page is made on this machine of the clips' manifests. Posters and strips lie beside it as those of a local gallery:
only films that have none yet are fetched, one at a time.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Set
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path

from physgen.batch.far import MANIFEST, MOST_MANIFEST, own_folder
from physgen.batch.places import Far, Told, far
from physgen.batch.pool import Done, ended
from physgen.problems import InputError
from physgen.report.became import ASKED, TABLE
from physgen.report.clips import Clip, clips_in
from physgen.report.gallery import Progress, write_gallery
from physgen.report.posters import pictures
from physgen.report.traces import ENDING
from physgen.urls import url_below

INDEX, FILES = "index.html", "index.files"
ENDINGS = (ENDING, f"{ENDING.removesuffix('json')}html")
MOST_FILM = 10_000_000_000
"""Bytes."""


class FarShelf:
    """Where the clips of a command go, and what is beside them there. Methods raise OSError unless they say."""

    def __init__(self, url: str) -> None:
        self._there = far(url)
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


def _is_new(name: str, path: Path, there: Mapping[str, Told], before: Set[str]) -> bool:
    """Whether a file is one that making the page made, beside the page."""
    if name.startswith(f"{FILES}/"):
        return name not in there and path.stat().st_size > 0
    return "/" not in name and name not in before and name != INDEX


def _files(folder: Path) -> dict[str, Path]:
    return {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}


def _fetch(source: Far, name: str, told: Told, root: Path, most: int = MOST_MANIFEST) -> None:
    """A file as it is there, its time too."""
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if source.fetch(name, path, most) and told.time:
        os.utime(path, (told.time, told.time))


def _mirror(source: Far, there: Mapping[str, Told], clip: str, root: Path) -> None:
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


def _draw(source: Far, there: Mapping[str, Told], clip: Clip, files: list[Path], root: Path) -> None:
    """Poster and strip of a film that is fetched for them; none where it cannot be read."""
    assert clip.film is not None
    film = clip.film.relative_to(root).as_posix()
    folder = f"{film.rpartition('/')[0]}/"
    parts = [name for name in there if name.startswith(folder)] if film.endswith(".png") else [film]
    for name in parts:
        _fetch(source, name, there[name], root, MOST_FILM)
    with suppress(OSError):
        for file, data in zip(files, pictures(clip.film, clip.frames), strict=True):
            file.write_bytes(data)
    for name in parts:
        (root / name).write_bytes(b"")
