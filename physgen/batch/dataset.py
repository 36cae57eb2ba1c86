"""Gather clips into a data set for training, with its card.

The folder layout, which Hugging Face's `videofolder` loads; a second run makes only what is missing or has changed:

    train/metadata.jsonl               a row per clip: file_name, caption, and other metadata
    train/<key>/video.mp4              with clip.json, trajectory.npz and labels, a folder per format

WebDataset shards, which are the same bytes every time:

    train/shard-000000.tar             <key>.mp4 <key>.json <key>.txt <key>.trajectory.npz <key>.<format>.<file> ...
"""

from __future__ import annotations

import io
import json
import re
import shlex
import shutil
import tarfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

from physgen import __version__
from physgen.batch.clips import checked_folders, find_clips
from physgen.batch.dataset_samples import Sample, Splits, read_sample
from physgen.files import partial, resource, write_atomic
from physgen.problems import InputError, Problem
from physgen.report.folders import atomic_folder, remove_leftovers_once

DATASET_FILE, CARD = "dataset.json", "README.md"
SHARD = re.compile(r"shard-\d{6}\.tar")
ROWS, ABOUT = "metadata.jsonl", "clip.json"
SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))
"""Size categories of the Hugging Face Hub."""


@dataclass(frozen=True)
class DatasetOptions:
    """What kind of data set is made."""

    layout: str
    """`folder` or `webdataset`."""
    splits: Splits
    formats: tuple[str, ...] = ()
    """Labels to include; empty: all that clips have."""
    shard_clips: int = 1000

    def settings(self) -> dict[str, Any]:
        """What must not change from run to run."""
        settings: dict[str, Any] = {"dataset": 1, "layout": self.layout, "seed": self.splits.seed}
        settings |= {"splits": dict(self.splits.shares), "formats": list(self.formats)}
        return settings | ({"shard_clips": self.shard_clips} if self.layout == "webdataset" else {})


@dataclass
class Count:
    """Content of one split."""

    clips: int = 0
    frames: int = 0
    seconds: float = 0.0
    bytes: int = 0
    photos: set[str] = field(default_factory=set)
    captions: int = 0
    """Clips that have one."""

    def add(self, sample: Sample) -> None:
        """Adds one sample."""
        self.clips += 1
        self.frames += int(sample.about["frames"])
        self.seconds += float(sample.about["seconds"])
        self.bytes += sample.size
        self.photos.add(str(sample.about["photo"]))
        self.captions += bool(sample.caption)

    def as_dict(self) -> dict[str, Any]:
        """For `dataset.json`."""
        return {**vars(self), "photos": len(self.photos), "seconds": round(self.seconds, 6)}


@dataclass
class DatasetSummary:
    """What was done."""

    counts: dict[str, Count]
    """By split."""
    made: int = 0
    kept: int = 0
    left_out: int = 0
    """Clips that cannot be used."""
    strays: int = 0
    """Folders of clips that lie there and are not of this data set."""
    lacking: Mapping[str, int] = field(default_factory=dict)
    """Requested formats -> number of clips that lack them."""
    files: Sequence[Path] = ()
    """Those that readers open, the card first."""


class Folders:
    """The folder layout. Only complete files appear."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._rows: dict[str, TextIO] = {}
        self._keys: dict[str, set[str]] = {}
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
                    shutil.copyfile(sample.folder / member.file, place)
                (folder / ABOUT).write_bytes(_json_line({**sample.about, "digest": sample.digest}))
            self.made += 1
        if sample.split not in self._rows:
            path = partial(self._root / sample.split / ROWS)
            self._rows[sample.split] = path.open("w", encoding="utf-8")
        row = {"file_name": f"{sample.key}/{sample.members[0].name}", **sample.about}
        self._rows[sample.split].write(_json_line(row).decode())
        self._keys.setdefault(sample.split, set()).add(sample.key)

    def close(self, *, complete: bool) -> list[Path]:
        """Publishes the rows, or removes unfinished ones; returns the files that readers open."""
        made = []
        for split, rows in self._rows.items():
            rows.close()
            path = self._root / split / ROWS
            if complete:
                made.append(partial(path).replace(path))
            else:
                partial(path).unlink(missing_ok=True)
        return sorted(made)

    def strays(self) -> int:
        """Folders of clips of earlier runs: they are not removed, as they may be wanted."""
        return sum(
            path.is_dir() and path.name[0] != "." and path.name not in keys
            for split, keys in self._keys.items()
            for path in (self._root / split).iterdir()
        )


def _folder_digest(home: Path) -> str | None:
    """Of the sample in a folder."""
    try:
        return str(json.loads((home / ABOUT).read_bytes())["digest"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


class Shards:
    """WebDataset shards; those of an earlier run are written again."""

    kept = 0

    def __init__(self, root: Path, most_clips: int) -> None:
        self._root, self._most_clips = root, most_clips
        self._open: dict[str, tarfile.TarFile] = {}
        """The unfinished shard of each split."""
        self._counts: Counter[str] = Counter()
        """Samples of each split."""
        self.made = 0

    def add(self, sample: Sample) -> None:
        """Adds the sample to the last shard of its split."""
        split = sample.split
        path = self._path(split, self._counts[split] // self._most_clips)
        if split not in self._open:
            path.parent.mkdir(parents=True, exist_ok=True)
            remove_leftovers_once(path.parent)
            self._open[split] = tarfile.open(partial(path), "w", format=tarfile.PAX_FORMAT)  # noqa: SIM115
        for name, source in _entries(sample):
            with io.BytesIO(source) if isinstance(source, bytes) else source.open("rb") as file:
                header = tarfile.TarInfo(name)  # without time and owner
                header.size = file.seek(0, io.SEEK_END)
                file.seek(0)
                self._open[split].addfile(header, file)
        self.made += 1
        self._counts[split] += 1
        if self._counts[split] % self._most_clips == 0:
            self._finish(split, path)

    def _path(self, split: str, number: int) -> Path:
        return self._root / split / f"shard-{number:06d}.tar"

    def _finish(self, split: str, path: Path) -> None:
        self._open.pop(split).close()
        partial(path).replace(path)

    def close(self, *, complete: bool) -> list[Path]:
        """Publishes the last shards; returns all."""
        paths = []
        for split, count in self._counts.items():
            number = -(-count // self._most_clips)
            last = self._path(split, number - 1)
            if split in self._open and complete:
                self._finish(split, last)
            paths += [self._path(split, k) for k in range(number)]
        for tar in self._open.values():
            tar.close()
            Path(str(tar.name)).unlink(missing_ok=True)
        if complete:
            found = (path for split in self._counts for path in (self._root / split).glob("shard-*.tar"))
            _remove_others((path for path in found if SHARD.fullmatch(path.name)), paths)
        return sorted(paths)

    def strays(self) -> int:
        """None: they were removed."""
        return 0


def _remove_others(paths: Iterable[Path], ours: Sequence[Path]) -> None:
    """Removes files of an earlier run that this one did not write."""
    for path in [path for path in paths if path not in ours]:
        path.unlink()


def _entries(sample: Sample) -> Iterator[tuple[str, bytes | Path]]:
    """Name and content; those that most readers use come first."""
    video, *others = sample.members
    yield f"{sample.key}.mp4", sample.folder / video.file
    yield f"{sample.key}.json", _json_line(sample.about)
    yield f"{sample.key}.txt", sample.caption.encode()
    for member in others:
        yield f"{sample.key}.{member.name.replace('/', '.')}", sample.folder / member.file


def _json_line(data: Mapping[str, Any]) -> bytes:
    return (json.dumps(data, ensure_ascii=False, allow_nan=False) + "\n").encode()


def gather(
    roots: Sequence[Path],
    out: Path,
    options: DatasetOptions,
    command: Sequence[str],
    warn: Callable[[Problem], None],
    progress: Callable[[int], None] = lambda count: None,
) -> DatasetSummary:
    """Makes a data set in `out` of the clips below `roots`; clips that cannot be used are warned of and left out.

    Raises InputError where the folders or `out` cannot be used, or where there is no clip.
    """
    roots = checked_folders(roots)
    _check_output(out, options, roots)
    summary = DatasetSummary({name: Count() for name in options.splits.names})
    formats: Counter[str] = Counter()
    layout = Folders(out) if options.layout == "folder" else Shards(out, options.shard_clips)
    total = 0
    try:
        for total, sample in enumerate(_samples(roots, options, summary, warn), 1):
            if total == 1:
                out.mkdir(parents=True, exist_ok=True)
                write_atomic(out / DATASET_FILE, _json(options.settings()))
            layout.add(sample)
            summary.counts[sample.split].add(sample)
            formats.update(sample.about["labels"])
            progress(total)
        if not total:
            fix = "name folders that physgen rendered or exported into"
            found = "holds no clip that can be used"
            raise InputError.of(", ".join(map(str, roots)), "", found, fix)
    except BaseException:
        layout.close(complete=False)
        raise
    files = layout.close(complete=True)
    write_atomic(out / CARD, _card(options, summary, sorted(formats), command, files).encode())
    counts = {name: count.as_dict() for name, count in summary.counts.items()}
    write_atomic(out / DATASET_FILE, _json({**options.settings(), "physgen": __version__, "counts": counts}))
    summary.strays = layout.strays()
    summary.made, summary.kept = layout.made, layout.kept
    summary.lacking = {name: total - formats[name] for name in options.formats if formats[name] < total}
    summary.files = [out / CARD, *files]
    return summary


def _samples(
    roots: Sequence[Path],
    options: DatasetOptions,
    summary: DatasetSummary,
    warn: Callable[[Problem], None],
) -> Iterator[Sample]:
    keys: set[str] = set()
    for clip in find_clips(roots):
        try:
            sample = read_sample(clip, options.splits, options.formats)
            if sample.key in keys:
                found = f"is called {sample.key}, as another clip is"
                raise InputError.of(str(clip.folder), "", found, "give one of their folders another name")
        except InputError as error:
            summary.left_out += 1
            for problem in error.problems:
                warn(problem)
            continue
        keys.add(sample.key)
        yield sample


def _check_output(out: Path, options: DatasetOptions, roots: Sequence[Path]) -> None:
    """The folder must be empty or new, or hold a data set of the same settings. Raises InputError."""
    if out.exists() and not out.is_dir():
        raise InputError.of(str(out), "", "is a file", "name a folder with -o")
    for root in roots:
        mine, read = out.resolve(), root.resolve()
        if mine.is_relative_to(read) or read.is_relative_to(mine):
            place = "holds" if mine in read.parents else "lies in"
            raise InputError.of(
                str(out), "", f"{place} {root}, which is read", "name a folder beside it with -o"
            )
    if not out.exists() or not any(out.iterdir()):
        return
    try:
        content = json.loads((out / DATASET_FILE).read_bytes())
        ours = bool(content["dataset"] == 1)
    except (OSError, ValueError, KeyError, TypeError):
        ours = False
    if not ours:
        found = "is not empty and holds no data set of ours"
        raise InputError.of(str(out), "", found, "choose another folder with -o")
    for name, value in options.settings().items():
        if content.get(name) != value:
            before, now = ("all" if v == [] else json.dumps(v) for v in (content.get(name), value))
            found = f"holds a data set with {name} {before}, not {now}"
            raise InputError.of(str(out), "", found, "choose another folder with -o, or remove it")


def _card(
    options: DatasetOptions,
    summary: DatasetSummary,
    formats: Sequence[str],
    command: Sequence[str],
    files: Sequence[Path],
) -> str:
    """README.md with the front matter of the Hugging Face Hub."""
    import jinja2

    total = sum(count.clips for count in summary.counts.values())
    there = [name for name in options.splits.names if summary.counts[name].clips]
    shards = Counter(path.parent.name for path in files)
    text = resource("templates", "dataset.md.j2").read_text(encoding="utf-8")
    template = jinja2.Template(text, undefined=jinja2.StrictUndefined, keep_trailing_newline=True)
    card: str = template.render(
        layout=options.layout,
        counts=summary.counts,
        splits=options.splits,
        formats=formats,
        total=total,
        there=there,
        size=next((name for most, name in SIZES if total < most), "n>1M"),
        last=shards[there[0]] - 1,
        command=shlex.join(command),
        version=__version__,
    )
    return card


def _json(data: Mapping[str, Any]) -> bytes:
    return (json.dumps(data, indent=1, ensure_ascii=False) + "\n").encode()
