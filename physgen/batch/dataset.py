"""Gather clips into a data set for training, with its card; a second run makes only what is missing or has changed."""

from __future__ import annotations

import json
import shlex
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from physgen import __version__
from physgen.batch.clips import checked_folders, find_clips
from physgen.batch.dataset_layouts import Folders, Layout, Shards
from physgen.batch.dataset_samples import Sample, Splits, read_sample
from physgen.files import resource, write_atomic
from physgen.problems import InputError, Problem

DATASET_FILE, CARD = "dataset.json", "README.md"
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
    shard_bytes: int = 1_000_000_000
    link: bool = False
    """In the folder layout, hard links where the disk allows."""

    def settings(self) -> dict[str, Any]:
        """What must not change from run to run."""
        settings: dict[str, Any] = {"dataset": 1, "layout": self.layout, "seed": self.splits.seed}
        settings |= {"splits": dict(self.splits.shares), "formats": list(self.formats)}
        if self.layout == "webdataset":
            settings |= {"shard_clips": self.shard_clips, "shard_bytes": self.shard_bytes}
        return settings


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
    """Clips that lie there and are not of this data set."""
    stray: Path | None = None
    """One of them."""
    uneven: Path | None = None
    """A clip whose files differ from those of the first one."""
    silent: Path | None = None
    """A clip without a caption."""
    lacking: Mapping[str, int] = field(default_factory=dict)
    """Requested formats -> number of clips that lack them."""
    files: Sequence[Path] = ()
    """Those that readers open, the card first."""


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
    names, splits = None, options.splits.names
    layout: Layout = (
        Folders(out, splits, options.link)
        if options.layout == "folder"
        else Shards(out, splits, options.shard_clips, options.shard_bytes)
    )
    try:
        for number, sample in enumerate(_samples(roots, options, summary, warn), 1):
            if names is None:
                out.mkdir(parents=True, exist_ok=True)
                write_atomic(out / DATASET_FILE, _json(options.settings()))
            layout.add(sample)
            summary.counts[sample.split].add(sample)
            formats.update(sample.about["labels"])
            own_names = frozenset(member.name for member in sample.members)
            names = names or own_names
            if own_names != names:
                summary.uneven = summary.uneven or sample.folder
            if not sample.caption:
                summary.silent = summary.silent or sample.folder
            progress(number)
        if names is None:
            fix = "name folders that physgen rendered or exported into"
            found = "holds no clip that can be used"
            raise InputError.of(", ".join(map(str, roots)), "", found, fix)
        files = layout.close()
    except BaseException:
        layout.abort()
        raise
    write_atomic(out / CARD, _card(options, summary, sorted(formats), command, files).encode())
    counts = {name: count.as_dict() for name, count in summary.counts.items()}
    content = {**options.settings(), "physgen": __version__, "counts": counts}
    write_atomic(out / DATASET_FILE, _json(content))
    summary.strays, summary.stray = layout.strays()
    summary.made, summary.kept = layout.made, layout.kept
    total = layout.made + layout.kept
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
            found = (
                f"lies in {root}, which is read" if read in mine.parents else f"holds {root}, which is read"
            )
            found = "is read itself" if mine == read else found
            raise InputError.of(str(out), "", found, "name a folder beside it with -o")
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
        uneven=summary.uneven is not None,
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
