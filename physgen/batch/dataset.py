"""Gather clips into a data set for training, with its card."""

from __future__ import annotations

import json
import shlex
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from physgen import __version__
from physgen.batch.clips import checked_folders, find_clips
from physgen.batch.dataset_layouts import Copy, Count, Folders, Layout, Link, Shards
from physgen.batch.dataset_samples import Splits, sample
from physgen.files import resource, write_atomic
from physgen.problems import InputError, Problem

# ----------------------------------------------------------------------
# What a data set holds -> README.md: its card, with the front matter that the Hugging Face Hub reads.

SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))
"""The Hub's words for how many there are."""


def card(
    layout: str,
    counts: Mapping[str, Count],
    splits: Splits,
    formats: Sequence[str],
    command: Sequence[str],
    shards: Mapping[str, int],
    uneven: bool,
) -> str:
    """`counts` by split; `formats` of labels that any clip has; `shards`: how many files a split is read from;
    `uneven`: clips differ in the names of their files."""
    import jinja2

    total = sum(count.clips for count in counts.values())
    there = [name for name in splits.names if counts[name].clips]
    text = resource("templates", "dataset.md.j2").read_text(encoding="utf-8")
    page = jinja2.Template(text, undefined=jinja2.StrictUndefined, keep_trailing_newline=True)
    told: str = page.render(
        layout=layout,
        uneven=uneven,
        counts=counts,
        splits=splits,
        formats=formats,
        total=total,
        there=there,
        size=next((name for most, name in SIZES if total < most), "n>1M"),
        last=shards.get(there[0], 1) - 1,
        command=shlex.join(command),
        version=__version__,
    )
    return told


# ----------------------------------------------------------------------
# Folders of clips -> a data set in a folder of its own; run again, it makes only what is missing or has
# changed.

DATASET_FILE = "dataset.json"
LAYOUTS = ("folder", "webdataset")


@dataclass(frozen=True)
class DatasetOptions:
    """What kind of data set."""

    layout: str
    """One of `LAYOUTS`."""
    splits: Splits
    formats: tuple[str, ...] = ()
    """Labels that go along; empty: all that clips have."""
    shard_clips: int = 1000
    shard_bytes: int = 1_000_000_000
    link: bool = False
    """In a folder, names of the same files where the disk allows, no copies."""

    def settings(self) -> dict[str, Any]:
        """What may not change from run to run."""
        told: dict[str, Any] = {"dataset": 1, "layout": self.layout, "seed": self.splits.seed}
        told |= {"splits": dict(self.splits.shares), "formats": list(self.formats)}
        if self.layout == "webdataset":
            told |= {"shard_clips": self.shard_clips, "shard_bytes": self.shard_bytes}
        return told


@dataclass(frozen=True)
class DatasetSummary:
    """What was done."""

    counts: Mapping[str, Count]
    """By split."""
    made: int
    kept: int
    left_out: int
    """Clips that cannot be used."""
    strays: int
    """Clips that lie there and are not of this data set."""
    stray: Path | None
    """One of them."""
    uneven: Path | None
    """A clip that has not the files of the first one."""
    silent: Path | None
    """A clip without a caption."""
    lacking: Mapping[str, int]
    """Formats that were asked for -> clips that do not have them; those alone that some lack."""
    files: Sequence[Path]
    """Those that readers open, the card first."""


def gather(
    roots: Sequence[Path],
    out: Path,
    asked: DatasetOptions,
    command: Sequence[str],
    warn: Callable[[Problem], None],
    progress: Callable[[int], None] = lambda count: None,
) -> DatasetSummary:
    """Raises InputError where the folders or `out` cannot be used, or where there is no clip at all.

    Clips that cannot be used are told of, left out and counted.
    """
    roots = checked_folders(roots)
    _own(out, asked, roots)
    counts = {name: Count() for name in asked.splits.names}
    seen = _Seen()
    layout = _layout(out, asked)
    try:
        left_out = _added(roots, out, asked, layout, counts, seen, warn, progress)
        files = layout.close()
    except BaseException:
        layout.drop()
        raise
    text = card(
        asked.layout,
        counts,
        asked.splits,
        sorted(seen.formats),
        command,
        _shards(files),
        seen.uneven is not None,
    )
    write_atomic(out / "README.md", text.encode())
    told = {name: _count(count) for name, count in counts.items()}
    write_atomic(out / DATASET_FILE, _json({**asked.settings(), "physgen": __version__, "counts": told}))
    strays, stray = layout.strays()
    total = layout.made + layout.kept
    lacking = {name: total - seen.formats[name] for name in asked.formats if seen.formats[name] < total}
    page = out / "README.md"
    return DatasetSummary(
        counts,
        layout.made,
        layout.kept,
        left_out,
        strays,
        stray,
        seen.uneven,
        seen.silent,
        lacking,
        [page, *files],
    )


@dataclass
class _Seen:
    """Of the clips that went by."""

    formats: Counter[str] = field(default_factory=Counter)
    """How many have labels of each."""
    silent: Path | None = None
    names: frozenset[str] | None = None
    """Of the first clip's files."""
    uneven: Path | None = None


def _added(
    roots: Sequence[Path],
    out: Path,
    asked: DatasetOptions,
    layout: Layout,
    counts: Mapping[str, Count],
    seen: _Seen,
    warn: Callable[[Problem], None],
    progress: Callable[[int], None],
) -> int:
    """All clips into the layout; returns how many were left out. Raises InputError where none is left."""
    keys: set[str] = set()
    left_out = 0
    for number, found in enumerate(find_clips(roots)):
        try:
            one = sample(found, asked.splits, asked.formats)
            if one.key in keys:
                fix = "give one of their folders another name"
                raise InputError.of(str(found.folder), "", f"is called {one.key}, as another clip is", fix)
        except InputError as error:
            left_out += 1
            for problem in error.problems:
                warn(problem)
            continue
        if not keys:
            out.mkdir(parents=True, exist_ok=True)
            write_atomic(out / DATASET_FILE, _json(asked.settings()))
        keys.add(one.key)
        layout.add(one)
        counts[one.split].add(one)
        seen.formats.update(one.about["labels"])
        files = frozenset(member.name for member in one.members)
        seen.names = seen.names or files
        if files != seen.names and seen.uneven is None:
            seen.uneven = one.folder
        if not one.caption and seen.silent is None:
            seen.silent = one.folder
        progress(number + 1)
    if not keys:
        fix = "name folders that physgen rendered or exported into"
        names = ", ".join(map(str, roots))
        raise InputError.of(names, "", "holds no clip that can be used", fix)
    return left_out


def _layout(out: Path, asked: DatasetOptions) -> Layout:
    if asked.layout == "folder":
        return Folders(out, asked.splits.names, Link() if asked.link else Copy())
    return Shards(out, asked.splits.names, asked.shard_clips, asked.shard_bytes)


def _own(out: Path, asked: DatasetOptions, roots: Sequence[Path]) -> None:
    """The folder is empty or new, or holds a data set of the same settings. Raises InputError."""
    if out.exists() and not out.is_dir():
        raise InputError.of(str(out), "", "is a file", "name a folder with -o")
    for root in roots:
        if out.resolve().is_relative_to(root.resolve()) or root.resolve().is_relative_to(out.resolve()):
            fix = "name a folder beside it with -o"
            if out.resolve() == root.resolve():
                found = "is read itself"
            elif root.resolve() in out.resolve().parents:
                found = f"lies in {root}, which is read"
            else:
                found = f"holds {root}, which is read"
            raise InputError.of(str(out), "", found, fix)
    if not out.exists() or not any(out.iterdir()):
        return
    try:
        told = json.loads((out / DATASET_FILE).read_bytes())
        ours = bool(told["dataset"] == 1)
    except (OSError, ValueError, KeyError, TypeError):
        ours = False
    if not ours:
        raise InputError.of(
            str(out), "", "is not empty and holds no data set of ours", "choose another folder with -o"
        )
    for name, value in asked.settings().items():
        if told.get(name) != value:
            found = f"holds a data set with {name} {_setting(told.get(name))}, not {_setting(value)}"
            raise InputError.of(str(out), "", found, "choose another folder with -o, or remove it")


def _setting(value: Any) -> str:
    return "all" if value == [] else json.dumps(value)


def _shards(files: Sequence[Path]) -> dict[str, int]:
    """Number of shards of each split."""
    found: dict[str, int] = {}
    for path in files:
        found[path.parent.name] = found.get(path.parent.name, 0) + 1
    return found


def _count(count: Count) -> dict[str, Any]:
    return {
        "clips": count.clips,
        "photos": len(count.photos),
        "frames": count.frames,
        "seconds": round(count.seconds, 6),
        "bytes": count.bytes,
        "captions": count.captions,
    }


def _json(data: Mapping[str, Any]) -> bytes:
    return (json.dumps(data, indent=1, ensure_ascii=False) + "\n").encode()
