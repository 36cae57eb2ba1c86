"""Layouts of a data set: one folder per clip with metadata.jsonl, or WebDataset shards.

The folder layout, which Hugging Face's `videofolder` loads:

    train/metadata.jsonl               a row per clip: file_name, caption, and other metadata
    train/<key>/video.mp4              with clip.json, trajectory.npz and labels, a folder per format

Shards, which are the same bytes every time:

    train/shard-000000.tar             <key>.mp4 <key>.json <key>.txt <key>.trajectory.npz <key>.<format>.<file> ...
    index/train-000000.json            its content: a shard that is there already is not written again
"""

from __future__ import annotations

import io
import json
import os
import shutil
import tarfile
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any, TextIO

from physgen.batch.dataset_samples import Sample
from physgen.files import partial, write_atomic
from physgen.report.folders import atomic_folder, remove_leftovers_once

ROWS = "metadata.jsonl"
ABOUT = "clip.json"
TAR_BLOCK = 512
TAR_RECORD = 10240
"""Bytes of which the size of a tar file is a multiple."""
MAX_TAR_SIZE = 8**11
"""Bytes from which on the size of a file does not fit a header of one block."""


class Folders:
    """The folder layout; files are copied, or linked where the disk allows. Only complete files appear."""

    def __init__(self, root: Path, splits: tuple[str, ...], link: bool) -> None:
        self._root, self._splits, self._link = root, splits, link
        self._rows: dict[str, TextIO] = {}
        self._keys: dict[str, int] = dict.fromkeys(splits, 0)
        """Number of samples of each split."""
        self._open = ExitStack()
        self.made = self.kept = 0
        """Samples that were written, and that were there unchanged."""

    def add(self, sample: Sample) -> None:
        """Writes the sample's folder, unless it is there unchanged, and its row."""
        home = self._root / sample.split / sample.key
        if _folder_digest(home) == sample.digest:
            self.kept += 1
        else:
            with atomic_folder(home) as folder:
                for member in sample.members:
                    place = folder / member.name
                    place.parent.mkdir(parents=True, exist_ok=True)
                    self._copy(sample.folder / member.file, place)
                about = {**sample.about, "digest": sample.digest}
                (folder / ABOUT).write_bytes(_json_line(about))
            self.made += 1
        if sample.split not in self._rows:
            path = partial(self._root / sample.split / ROWS)
            self._rows[sample.split] = self._open.enter_context(path.open("w", encoding="utf-8"))
        row = {"file_name": f"{sample.key}/{sample.members[0].name}", **sample.about}
        self._rows[sample.split].write(_json_line(row).decode())
        self._keys[sample.split] += 1

    def _copy(self, source: Path, target: Path) -> None:
        if self._link:
            with suppress(OSError):
                os.link(source.resolve(), target)
                return
        shutil.copyfile(source, target)

    def close(self) -> list[Path]:
        """Publishes the rows; returns the files that readers open."""
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

    def abort(self) -> None:
        """Removes unfinished rows; the folders of clips are complete."""
        self._open.close()
        for split in self._rows:
            partial(self._root / split / ROWS).unlink(missing_ok=True)

    def strays(self) -> tuple[int, Path | None]:
        """Number of clips of earlier runs, and one of them; they are not removed, as they may be wanted."""
        found, one = 0, None
        for split in self._splits:
            home = self._root / split
            if not home.is_dir():
                continue
            with os.scandir(home) as entries:
                names = sorted(e.name for e in entries if e.is_dir() and not e.name.startswith("."))
            found += len(names) - self._keys[split]
            if one is None and len(names) > self._keys[split]:
                rows = home / ROWS
                lines = rows.read_text(encoding="utf-8").splitlines() if rows.is_file() else []
                keys = {str(json.loads(line)["key"]) for line in lines}
                one = next((home / name for name in names if name not in keys), None)
        return found, one


def _folder_digest(home: Path) -> str | None:
    """Of the sample in a folder."""
    try:
        return str(json.loads((home / ABOUT).read_bytes())["digest"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


@dataclass
class _Plan:
    """A shard to be written."""

    number: int
    samples: list[Sample] = field(default_factory=list)
    size: int = 0
    """Bytes in a tar file."""

    @property
    def digest(self) -> str:
        """SHA-256 of its content."""
        digest = sha256()
        for sample in self.samples:
            digest.update(f"{sample.key} {sample.digest}\n".encode())
        return digest.hexdigest()


class Shards:
    """WebDataset shards; one shard of each split is planned in memory before it is written."""

    def __init__(self, root: Path, splits: tuple[str, ...], most_clips: int, most_bytes: int) -> None:
        self._root, self._splits = root, splits
        self._most_clips, self._most_bytes = most_clips, most_bytes
        self._plans = {split: _Plan(0) for split in splits}
        self._files: list[Path] = []
        self.made = self.kept = 0

    def add(self, sample: Sample) -> None:
        """Adds the sample to the shard of its split; one that is larger than a shard has its own."""
        plan = self._plans[sample.split]
        size = sum(
            _header_size(name, size) + -(-size // TAR_BLOCK) * TAR_BLOCK for name, size, _ in _entries(sample)
        )
        full = len(plan.samples) >= self._most_clips or plan.size + size > self._most_bytes - TAR_RECORD
        if plan.samples and full:
            self._flush(sample.split)
            plan = self._plans[sample.split]
        plan.samples.append(sample)
        plan.size += size

    def close(self) -> list[Path]:
        """Writes the last shards, removes those of earlier runs beyond them, and returns all."""
        for split in self._splits:
            if self._plans[split].samples:
                self._flush(split)
            number = self._plans[split].number
            while any(path.exists() for path in self._paths(split, number)):
                for path in self._paths(split, number):
                    path.unlink(missing_ok=True)
                number += 1
        return sorted(self._files)

    def abort(self) -> None:
        """Shards are complete, or not there."""

    def strays(self) -> tuple[int, Path | None]:
        """None: they were removed."""
        return 0, None

    def _paths(self, split: str, number: int) -> tuple[Path, Path]:
        """Of a shard and its index."""
        index = self._root / "index" / f"{split}-{number:06d}.json"
        return self._root / split / f"shard-{number:06d}.tar", index

    def _flush(self, split: str) -> None:
        plan = self._plans[split]
        path, index = self._paths(split, plan.number)
        if _is_written(path, index, plan.digest):
            self.kept += len(plan.samples)
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            index.parent.mkdir(parents=True, exist_ok=True)
            remove_leftovers_once(path.parent)
            index.unlink(missing_ok=True)
            _write_tar(path, plan.samples)
            content = {
                "shard": f"{split}/{path.name}",
                "plan": plan.digest,
                "bytes": path.stat().st_size,
                "clips": [sample.key for sample in plan.samples],
            }
            write_atomic(index, _json_line(content))
            self.made += len(plan.samples)
        self._files.append(path)
        self._plans[split] = _Plan(plan.number + 1)


def _is_written(path: Path, index: Path, digest: str) -> bool:
    try:
        content = json.loads(index.read_bytes())
        return bool(content["plan"] == digest and content["bytes"] == path.stat().st_size)
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _write_tar(path: Path, samples: list[Sample]) -> None:
    unfinished = partial(path)
    try:
        with tarfile.open(unfinished, "w", format=tarfile.PAX_FORMAT) as tar:
            for name, size, source in (entry for sample in samples for entry in _entries(sample)):
                if isinstance(source, bytes):
                    tar.addfile(_header(name, size), io.BytesIO(source))
                    continue
                with source.open("rb") as file:
                    if file.seek(0, io.SEEK_END) != size:  # a header comes before its file
                        raise OSError(f"{source} changes while it is read")
                    file.seek(0)
                    tar.addfile(_header(name, size), file)
        unfinished.replace(path)
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise


def _entries(sample: Sample) -> Iterator[tuple[str, int, bytes | Path]]:
    """Name, size in bytes, and content; those that most readers use come first."""
    about, caption = _json_line(dict(sample.about)), sample.caption.encode()
    video, *others = sample.members
    yield f"{sample.key}.mp4", video.size, sample.folder / video.file
    yield f"{sample.key}.json", len(about), about
    yield f"{sample.key}.txt", len(caption), caption
    for member in others:
        yield f"{sample.key}.{member.name.replace('/', '.')}", member.size, sample.folder / member.file


def _header_size(name: str, size: int) -> int:
    """Bytes before a file's content: names that are long, or not ASCII, take more than a block."""
    if len(name) <= tarfile.LENGTH_NAME and name.isascii() and size < MAX_TAR_SIZE:
        return TAR_BLOCK
    return len(_header(name, size).tobuf(tarfile.PAX_FORMAT))


def _header(name: str, size: int) -> tarfile.TarInfo:
    """Without time and owner."""
    header = tarfile.TarInfo(name)
    header.size = size
    return header


def _json_line(data: dict[str, Any]) -> bytes:
    return (json.dumps(data, ensure_ascii=False, allow_nan=False) + "\n").encode()


Layout = Folders | Shards
