"""Samples -> a folder for each, and `metadata.jsonl` beside them: what Hugging Face's `videofolder` loads.

train/metadata.jsonl               a row a clip: file_name, caption, and what else is told of it
train/<key>/video.mp4              with clip.json, trajectory.npz and its labels, a folder a format
"""

from __future__ import annotations

import json
import os
import shutil
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TextIO

from physgen.batch.dataset.sample import Sample
from physgen.report.folder import whole_folder
from physgen.whole import partial

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
        with whole_folder(home) as folder:
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
