"""Samples -> tar files as WebDataset reads them, each of so many clips and bytes at most; the same bytes every time.

train/shard-000000.tar             <key>.mp4 <key>.json <key>.txt <key>.trajectory.npz <key>.<format>.<file> ...
index/train-000000.json            what is in it: a shard that is there already is not written again
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

from physgen.batch.dataset.sample import Sample
from physgen.report.leftovers import sweep_once
from physgen.whole import partial, write_whole

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
            sweep_once(path.parent)
            index.unlink(missing_ok=True)  # it speaks of the shard that goes
            _write(path, plan.samples)
            told = {
                "shard": f"{split}/{path.name}",
                "plan": plan.digest,
                "bytes": path.stat().st_size,
                "clips": [sample.key for sample in plan.samples],
            }
            write_whole(index, _json(told))
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
