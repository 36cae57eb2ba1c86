"""Layouts of a data set: folders with a table, and WebDataset shards.

A layout writes one sample after the other. A row in LAYOUTS makes it a choice of
`physgen dataset --layout`.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO, Protocol

from physgen.files import install
from physgen.messages import Message

ROWS, METADATA_FILE = "metadata.jsonl", "clip.json"
VIDEO = "video.mp4"
SHARD_CLIPS = 1000
"""Default number of clips in a shard: 0.1 to 1 GB, as WebDataset advises."""

Members = Mapping[str, Path]
"""Files of a clip by their names in the data set."""
Metadata = Mapping[str, Any]
"""Metadata of a clip, as JSON."""


Copier = Callable[[Path, Members, Metadata], Path | None]
"""A function that copies the files of a clip into the data set at a path and returns
the new folder.
"""


class Layout(Protocol):
    """A writer of samples into a data set."""

    copier: Copier
    """Runs on any machine, before `add`."""
    reads_clips: bool
    """True if `add` reads the files of clips."""

    def add(self, members: Members, metadata: Metadata) -> None:
        """Write the next sample into its split."""
        ...

    patterns: Sequence[str]
    """Patterns of the files for loaders, relative to the folder of a split."""

    def files(self) -> Sequence[Path]:
        """Return the files to open with a reader, in order."""
        ...


class Folders:
    """One folder per clip and one table per split, for Hugging Face's `videofolder`."""

    patterns: Sequence[str] = (ROWS, f"*/{VIDEO}")
    reads_clips = False

    def __init__(self, root: Path, stack: ExitStack, shard_clips: int) -> None:
        self.copier: Copier = write_folder
        self._root, self._stack = root, stack
        self._rows: dict[str, BinaryIO] = {}

    def add(self, members: Members, metadata: Metadata) -> None:
        """Write the clip's row. `copier` has written its folder."""
        split = metadata["split"]
        if split not in self._rows:
            (self._root / split).mkdir(exist_ok=True)
            table = (self._root / split / ROWS).open("wb")
            self._rows[split] = self._stack.enter_context(table)
        row = {"file_name": f"{metadata['key']}/{VIDEO}", **metadata}
        self._rows[split].write(json_line(row))

    def files(self) -> Sequence[Path]:
        """Return the tables."""
        return sorted(self._root.glob(f"*/{ROWS}"))


class Shards:
    """WebDataset shards, written by WebDataset itself. The same clips give the same
    bytes.
    """

    patterns: Sequence[str] = ("*.tar",)
    reads_clips = True

    def __init__(self, root: Path, stack: ExitStack, shard_clips: int) -> None:
        """Check that webdataset is installed. Raise InputError."""
        if find_spec("webdataset") is None:
            message, command = Message.WEBDATASET_MISSING, install("labels")
            raise message.error("--layout", '"webdataset"', install=command)
        self.copier: Copier = leave_files
        self._root, self._stack, self._shard_clips = root, stack, shard_clips
        self._writers: dict[str, Any] = {}

    def add(self, members: Members, metadata: Metadata) -> None:
        """Add the clip to the last shard of its split."""
        split = metadata["split"]
        if split not in self._writers:
            self._writers[split] = self._stack.enter_context(self._open(split))
        sample: dict[str, Any] = {
            "__key__": metadata["key"],
            "json": json_line(metadata),
        }
        for name, file in members.items():
            # WebDataset takes the name up to the first dot as the key, and the rest as
            # the extension.
            extension = name.replace("/", ".").replace(VIDEO, "mp4")
            sample[extension] = file.read_bytes()
        self._writers[split].write(sample)

    def _open(self, split: str) -> Any:
        from webdataset import ShardWriter

        folder = self._root / split
        folder.mkdir()
        # The writer formats its pattern with `%`.
        escaped_folder = str(folder).replace("%", "%%")
        # Without the time and the owner, equal clips give equal bytes.
        return ShardWriter(
            f"{escaped_folder}/shard-%06d.tar",
            maxcount=self._shard_clips,
            verbose=0,
            encoder=False,
            mtime=0,
            user="",
            group="",
        )

    def files(self) -> Sequence[Path]:
        """Return the shards."""
        return sorted(self._root.glob("*/shard-*.tar"))


LAYOUTS: Mapping[str, Callable[[Path, ExitStack, int], Layout]] = {
    "folder": Folders,
    "webdataset": Shards,
}
"""Layouts by name; the first is the default."""


def card(splits: Sequence[str], patterns: Sequence[str]) -> str:
    """Return the text of `README.md`, with the files of each split for
    `datasets.load_dataset`.

    Without this file, the loader takes label files for the data.
    """
    lines = ["---", "configs:", "- config_name: default", "  data_files:"]
    for split in splits:
        lines += [f"  - split: {split}", "    path:"]
        lines += [f"    - {split}/{pattern}" for pattern in patterns]
    return "\n".join([*lines, "---", ""])


def write_folder(root: Path, members: Members, metadata: Metadata) -> Path:
    """Write the folder of a clip into the data set at `root`."""
    home: Path = root / metadata["split"] / metadata["key"]
    for name, file in members.items():
        place = home / name
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, place)
    (home / METADATA_FILE).write_bytes(json_line(metadata))
    return home


def leave_files(root: Path, members: Members, metadata: Metadata) -> None:
    """Copy nothing: `Shards.add` reads the clip itself."""


def json_line(data: Mapping[str, Any]) -> bytes:
    """Return a line of JSON, UTF-8."""
    return (json.dumps(data, ensure_ascii=False, allow_nan=False) + "\n").encode()
