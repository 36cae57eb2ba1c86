"""Layouts of a data set: one folder per clip with metadata.jsonl, or WebDataset shards."""

from __future__ import annotations

import io
import json
import os
import shutil
import tarfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any, Protocol, TextIO

from physgen.batch.dataset_samples import Sample
from physgen.files import partial, write_atomic
from physgen.report.folders import atomic_folder, remove_leftovers_once

# ----------------------------------------------------------------------
# Samples -> a folder for each, and `metadata.jsonl` beside them: what Hugging Face's `videofolder` loads.
#
# train/metadata.jsonl               a row a clip: file_name, caption, and what else is told of it
# train/<key>/video.mp4              with clip.json, trajectory.npz and its labels, a folder a format

ROWS = "metadata.jsonl"
ABOUT = "clip.json"


class Copy:
    """Copies a file."""

    def __call__(self, source: Path, target: Path) -> None:
        """Raises OSError."""
        shutil.copyfile(source, target)


class Link(Copy):
    """Makes another name of the same file, where the disk allows."""

    def __call__(self, source: Path, target: Path) -> None:
        """Raises OSError."""
        try:
            os.link(source.resolve(), target)
        except OSError:
            super().__call__(source, target)


class Folders:
    """Files come by way of `copy`."""

    def __init__(self, root: Path, splits: tuple[str, ...], copy: Copy) -> None:
        self._root, self._splits, self._copy = root, splits, copy
        self._rows: dict[str, TextIO] = {}
        self._counts: dict[str, int] = {}
        self._open = ExitStack()
        self.made = self.kept = 0

    def add(self, sample: Sample) -> None:
        """A folder, unless it is there, made of the same; and a row."""
        home = self._root / sample.split / sample.key
        if _digest(home) == sample.digest:
            self.kept += 1
        else:
            self._write(sample, home)
            self.made += 1
        self._row(sample)

    def _write(self, sample: Sample, home: Path) -> None:
        with atomic_folder(home) as folder:
            for member in sample.members:
                place = folder / member.name
                place.parent.mkdir(parents=True, exist_ok=True)
                self._copy(sample.folder / member.file, place)
            about = {**sample.about, "digest": sample.digest}
            (folder / ABOUT).write_text(_line(about), encoding="utf-8")

    def _row(self, sample: Sample) -> None:
        if sample.split not in self._rows:
            path = partial(self._root / sample.split / ROWS)
            self._rows[sample.split] = self._open.enter_context(path.open("w", encoding="utf-8"))
        row = {"file_name": f"{sample.key}/{sample.members[0].name}", **sample.about}
        self._rows[sample.split].write(_line(row))
        self._counts[sample.split] = self._counts.get(sample.split, 0) + 1

    def close(self) -> list[Path]:
        """Rows appear when all are there."""
        self._open.close()
        made = []
        for split in self._splits:
            path = self._root / split / ROWS
            if split in self._rows:
                partial(path).replace(path)
                made.append(path)
            else:
                path.unlink(missing_ok=True)
        return made

    def drop(self) -> None:
        """Rows that were begun; folders of clips are whole."""
        self._open.close()
        for split in self._rows:
            partial(self._root / split / ROWS).unlink(missing_ok=True)

    def strays(self) -> tuple[int, Path | None]:
        """Counted, not removed: they may be wanted."""
        found, one = 0, None
        for split in self._splits:
            home = self._root / split
            if home.is_dir():
                with os.scandir(home) as entries:
                    names = [e.name for e in entries if e.is_dir() and not e.name.startswith(".")]
                found += len(names) - self._counts.get(split, 0)
                if one is None and len(names) > self._counts.get(split, 0):
                    one = self._unnamed(home, sorted(names))
        return found, one

    def _unnamed(self, home: Path, names: list[str]) -> Path | None:
        """The first folder that no row names."""
        rows = home / ROWS
        lines = rows.read_text(encoding="utf-8").splitlines() if rows.is_file() else []
        told = {str(json.loads(line)["key"]) for line in lines}
        return next((home / name for name in names if name not in told), None)


def _digest(home: Path) -> str | None:
    """Of the sample in a folder; it is whole where its name has no dot in front."""
    try:
        return str(json.loads((home / ABOUT).read_bytes())["digest"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _line(data: dict[str, Any]) -> str:
    return json.dumps(data, ensure_ascii=False, allow_nan=False) + "\n"


# ----------------------------------------------------------------------
# What every layout of a data set is, and what was done.


@dataclass
class Count:
    """Of one split."""

    clips: int = 0
    frames: int = 0
    seconds: float = 0.0
    bytes: int = 0
    photos: set[str] = field(default_factory=set)
    captions: int = 0
    """Clips that have one."""

    def add(self, sample: Sample) -> None:
        """One more."""
        self.clips += 1
        self.frames += int(sample.about["frames"])
        self.seconds += float(sample.about["seconds"])
        self.bytes += sample.size
        self.photos.add(str(sample.about["photo"]))
        self.captions += bool(sample.caption)


class Layout(Protocol):
    """Writes samples below a folder, in the order in which they come; whole files alone appear."""

    made: int
    """Samples that were written."""
    kept: int
    """Samples that were there already, of the same."""

    def add(self, sample: Sample) -> None:
        """The next one."""

    def close(self) -> list[Path]:
        """All were added; returns the files that readers open."""

    def drop(self) -> None:
        """Something went wrong: what is half-written goes."""

    def strays(self) -> tuple[int, Path | None]:
        """Clips below the folder that are not of this data set, an earlier run's: how many, and one of them."""


# ----------------------------------------------------------------------
# Samples -> tar files as WebDataset reads them, each of so many clips and bytes at most; the same bytes every
# time.
#
# train/shard-000000.tar             <key>.mp4 <key>.json <key>.txt <key>.trajectory.npz <key>.<format>.<file>
# ...
# index/train-000000.json            what is in it: a shard that is there already is not written again

BLOCK = 512
"""Bytes that a tar file is counted in."""
END = 10240
"""Bytes that a tar file is a multiple of."""
LARGE = 8**11
"""Bytes that an entry of one block cannot tell."""


@dataclass
class _Plan:
    """A shard to be."""

    number: int
    samples: list[Sample] = field(default_factory=list)
    size: int = 0

    @property
    def digest(self) -> str:
        """SHA-256 of what goes into it."""
        whole = sha256()
        for sample in self.samples:
            whole.update(f"{sample.key} {sample.digest}\n".encode())
        return whole.hexdigest()


class Shards:
    """A shard is planned, and then written at one go or found there: one of each split is held."""

    def __init__(self, root: Path, splits: tuple[str, ...], most_clips: int, most_bytes: int) -> None:
        self._root, self._splits = root, splits
        self._most_clips, self._most_bytes = most_clips, most_bytes
        self._plans = {split: _Plan(0) for split in splits}
        self._files: list[Path] = []
        self.made = self.kept = 0

    def add(self, sample: Sample) -> None:
        """Into the shard of its split that is being filled; one that is larger than a shard may be has its own."""
        plan, size = self._plans[sample.split], _weight(sample)
        full = len(plan.samples) >= self._most_clips or plan.size + size > self._most_bytes - END
        if plan.samples and full:
            self._flush(sample.split)
            plan = self._plans[sample.split]
        plan.samples.append(sample)
        plan.size += size

    def close(self) -> list[Path]:
        """The last ones; shards of an earlier run beyond them go."""
        for split in self._splits:
            if self._plans[split].samples:
                self._flush(split)
            number = self._plans[split].number
            while (path := self._path(split, number)).exists() or self._index(split, number).exists():
                path.unlink(missing_ok=True)
                self._index(split, number).unlink(missing_ok=True)
                number += 1
        return sorted(self._files)

    def drop(self) -> None:
        """Shards are whole, or not there."""

    def strays(self) -> tuple[int, Path | None]:
        """They are gone."""
        return 0, None

    def _path(self, split: str, number: int) -> Path:
        return self._root / split / f"shard-{number:06d}.tar"

    def _index(self, split: str, number: int) -> Path:
        return self._root / "index" / f"{split}-{number:06d}.json"

    def _flush(self, split: str) -> None:
        plan = self._plans[split]
        path, index = self._path(split, plan.number), self._index(split, plan.number)
        if _there(path, index, plan.digest):
            self.kept += len(plan.samples)
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            index.parent.mkdir(parents=True, exist_ok=True)
            remove_leftovers_once(path.parent)
            index.unlink(missing_ok=True)  # it speaks of the shard that goes
            _write(path, plan.samples)
            told = {
                "shard": f"{split}/{path.name}",
                "plan": plan.digest,
                "bytes": path.stat().st_size,
                "clips": [sample.key for sample in plan.samples],
            }
            write_atomic(index, _json(told))
            self.made += len(plan.samples)
        self._files.append(path)
        self._plans[split] = _Plan(plan.number + 1)


def _there(path: Path, index: Path, digest: str) -> bool:
    try:
        told = json.loads(index.read_bytes())
        return bool(told["plan"] == digest and told["bytes"] == path.stat().st_size)
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _write(path: Path, samples: list[Sample]) -> None:
    """Whole, or not at all."""
    beside = partial(path)
    try:
        with tarfile.open(beside, "w", format=tarfile.PAX_FORMAT) as tar:
            for sample in samples:
                for name, size, source in _files(sample):
                    entry = _entry(name, size)
                    if isinstance(source, bytes):
                        tar.addfile(entry, io.BytesIO(source))
                    else:
                        with source.open("rb") as file:
                            _checked(file, source, size)
                            tar.addfile(entry, file)
        beside.replace(path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def _checked(file: io.BufferedReader, path: Path, size: int) -> None:
    """A tar file says how long a file is before it comes."""
    if file.seek(0, io.SEEK_END) != size:
        raise OSError(f"{path} changes while it is read")
    file.seek(0)


def _files(sample: Sample) -> Iterator[tuple[str, int, bytes | Path]]:
    """Name, bytes, and what they are: those that most read come first."""
    about = _json(dict(sample.about))
    caption = sample.caption.encode()
    film, *others = sample.members
    yield f"{sample.key}.mp4", film.size, sample.folder / film.file
    yield f"{sample.key}.json", len(about), about
    yield f"{sample.key}.txt", len(caption), caption
    for member in others:
        yield f"{sample.key}.{member.name.replace('/', '.')}", member.size, sample.folder / member.file


def _weight(sample: Sample) -> int:
    """Bytes that it takes in a tar file."""
    return sum(_head(name, size) + -(-size // BLOCK) * BLOCK for name, size, _ in _files(sample))


def _head(name: str, size: int) -> int:
    """Bytes before a file's own: names that are long, or not of ASCII, take more."""
    if len(name) <= tarfile.LENGTH_NAME and name.isascii() and size < LARGE:
        return BLOCK
    return len(_entry(name, size).tobuf(tarfile.PAX_FORMAT))


def _entry(name: str, size: int) -> tarfile.TarInfo:
    """Without a time and an owner."""
    entry = tarfile.TarInfo(name)
    entry.size = size
    return entry


def _json(data: dict[str, Any]) -> bytes:
    return (json.dumps(data, ensure_ascii=False, allow_nan=False) + "\n").encode()
