"""Gather clips into a data set for training. All clips of a photo are in one split.

Hugging Face's `videofolder` loads the layout `folder`:

    train/metadata.jsonl               a row per clip: file_name and other metadata
    train/<key>/video.mp4              with clip.json, trajectory.npz and labels, a folder per format

The layout `webdataset` has shards, `train/shard-000000.tar` and so on, with <key>.mp4,
.json, .trajectory.npz, .<format>.<file>.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

from physgen import __version__
from physgen.batch.clips import FoundClip, checked_folders, find_clips
from physgen.batch.layouts import (
    LAYOUTS,
    SHARD_CLIPS,
    VIDEO,
    Copier,
    Layout,
    Members,
    card,
)
from physgen.batch.values import parse_yaml
from physgen.files import check_writable
from physgen.messages import Message
from physgen.problems import InputError, Problem
from physgen.report.folders import atomic_folder
from physgen.scene.load import scene_name

DATASET_FILE = "dataset.json"
CARD = "README.md"
"""The data set card of Hugging Face."""
LABELS = "truth"
"""Folder of a clip's labels."""
MAX_KEY_LENGTH = 80
"""Maximum number of characters in a key, without the hash at its end."""
_UNSAFE = re.compile(r"[^A-Za-z0-9_-]+")
_SPLIT_NAME = re.compile(r"[a-z][a-z0-9_]{0,30}")


@dataclass(frozen=True)
class Splits:
    """Names of splits and their shares of the photos. The shares add up to 1."""

    shares: tuple[tuple[str, float], ...]
    seed: int

    def assign(self, photo: str) -> str:
        """Return the split of all clips of a photo. It depends only on the photo's
        SHA-256 and the seed: more photos do not move a clip to another split.

        >>> even = Splits((("train", 0.5), ("test", 0.5)), 0)
        >>> [even.assign(photo) for photo in "abcdef"]
        ['test', 'test', 'test', 'train', 'test', 'train']
        """
        digest = hashlib.sha256(f"{self.seed}:{photo}".encode()).digest()
        # 52 bits fit a float exactly, so that every machine finds the same split.
        place = (int.from_bytes(digest[:8], "big") >> 12) / 2**52
        for name, share in self.shares:
            if place < share:
                return name
            place -= share
        # Rounding may leave the sum of the shares a little below 1.
        return self.shares[-1][0]

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the splits."""
        return tuple(name for name, _ in self.shares)


def read_splits(text: str, seed: int) -> Splits:
    """Parse `train=0.8,test=0.2`. Raise InputError."""
    shares: dict[str, float] = {}
    for part in text.split(","):
        name, _, share = (piece.strip() for piece in part.partition("="))
        try:
            value = float(share)
        except ValueError:
            value = -1.0
        if not _SPLIT_NAME.fullmatch(name) or not 0 < value <= 1 or name in shares:
            raise Message.NOT_A_SPLIT.error("--split", f'"{part.strip()}"')
        shares[name] = value
    total = sum(shares.values())
    if abs(total - 1) > 1e-6:
        raise Message.SPLITS_NOT_ONE.error("--split", f'"{text}"', total=total)
    return Splits(tuple(shares.items()), seed)


def key(name: str) -> str:
    """Return a key for a path: its end in safe characters, and a hash of the whole
    path, which makes the key unique.

    >>> key("sweep/00-1,mass=2.5")
    'sweep_00-1-mass-2-5-261caf6945'
    """
    # The end of a path tells clips apart better than its beginning.
    text = _UNSAFE.sub("-", name.replace("/", "_")).strip("-")[-MAX_KEY_LENGTH:]
    return f"{text}-{hashlib.sha256(name.encode('utf-8', 'surrogateescape')).hexdigest()[:10]}"


def read_sample(
    clip: FoundClip, splits: Splits
) -> tuple[dict[str, Path], dict[str, Any]]:
    """Return the files of a clip by their names in the data set, and its metadata as
    JSON.

    Raise InputError for an unusable clip.
    """
    manifest = clip.manifest
    if manifest is None:
        raise Message.NO_MANIFEST.error(str(clip.folder))
    try:
        members = _members(clip.folder, manifest["files"])
        return members, _metadata(clip, manifest, members, splits)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError):
        raise Message.SAMPLE_MANIFEST_DAMAGED.error(str(clip.folder)) from None


def _members(folder: Path, files: Mapping[str, str]) -> dict[str, Path]:
    """Return the files of a clip by their names in the data set: `video.mp4`,
    `FORMAT/...` of a label.

    Raise InputError if a file or the video is missing.
    """
    if VIDEO not in files:
        raise Message.NO_VIDEO_IN_CLIP.error(str(folder), file=VIDEO)
    members = {}
    for name in (VIDEO, "trajectory.npz"):
        if name in files:
            members[name] = name
    labels = sorted(name for name in files if name.startswith(f"{LABELS}/"))
    members |= {name.removeprefix(f"{LABELS}/"): name for name in labels}
    for name, file in members.items():
        # A manifest is untrusted: its paths must not lead out of the clip or the data
        # set.
        for path in map(PurePosixPath, (name, file)):
            if ".." in path.parts or path.is_absolute():
                raise ValueError(file)
        if not (folder / file).is_file():
            raise Message.FILE_OF_CLIP_MISSING.error(str(folder / file))
    return {name: folder / file for name, file in members.items()}


def _metadata(
    clip: FoundClip,
    manifest: Mapping[str, Any],
    members: Collection[str],
    splits: Splits,
) -> dict[str, Any]:
    document, video = manifest["document"], manifest["video"]
    photo = photo_of(document, manifest["inputs"])
    width, height = map(int, video["size"])
    frames, fps = len(manifest["frames"]), float(video["fps"])
    formats = sorted({name.partition("/")[0] for name in members if "/" in name})
    source = manifest.get("source")
    refine = manifest.get("refine")
    return {
        "key": key(clip.name),
        "clip": clip.name,
        "scene": scene_name(Path(source)) if source else str(manifest["scene"]),
        "variant": manifest["variant"] or "",
        # Text, because readers make columns of a mapping, the same ones for every clip.
        "parameters": json.dumps(
            dict(map(_parameter, manifest["overrides"])), ensure_ascii=False
        ),
        "split": splits.assign(photo),
        "photo": photo,
        "frames": frames,
        "fps": fps,
        "seconds": frames / fps,
        "duration": float(document["world"]["duration"]),
        "width": width,
        "height": height,
        "objects": [
            {"name": name, "label": str(item.get("label") or "")}
            for name, item in document["objects"].items()
        ],
        "labels": formats,
        "refined": str(refine["backend"]) if refine else "",
        "physgen": str(manifest["versions"]["physgen"]),
    }


def photo_of(document: Mapping[str, Any], inputs: Mapping[str, str]) -> str:
    """Return the SHA-256 of the photo, or of the scene file if the scene has no
    photo.
    """
    image = document.get("image")
    if image is not None:
        name = PurePosixPath(str(image)).name
        for path, digest in inputs.items():
            if path == str(image) or PurePosixPath(path).name == name:
                return digest
    return next(iter(inputs.values()))


def _parameter(text: str) -> tuple[str, Any]:
    """Return key and value of `KEY=VALUE`, in the syntax of `--set`."""
    name, _, value = str(text).partition("=")
    try:
        return name, parse_yaml(value).data
    except InputError:
        return name, value


@dataclass
class DatasetSummary:
    """The result of gathering clips."""

    # Number of clips in each split.
    counts: Counter[str]
    photos: set[str] = field(default_factory=set)
    # Number of unusable clips.
    left_out: int = 0
    # Files to open with a reader.
    files: Sequence[Path] = ()

    @property
    def total(self) -> int:
        """Return the number of clips."""
        return self.counts.total()


@dataclass(frozen=True)
class Sample:
    """A clip in the data set: metadata and files, or the problems of an
    unusable clip.
    """

    metadata: Mapping[str, Any]
    members: Mapping[str, Path] = field(default_factory=dict)
    # Folder of the copy.
    folder: Path | None = None
    problems: tuple[Problem, ...] = ()


def copy_sample(splits: Splits, copier: Copier, root: Path, clip: FoundClip) -> Sample:
    """Read the metadata of a clip, and copy its files into the data set at `root`."""
    try:
        members, metadata = read_sample(clip, splits)
        folder = copier(root, members, metadata)
    except InputError as error:
        return Sample({}, problems=tuple(error.problems))
    return Sample(metadata, members, folder)


def lost_sample(clip: FoundClip, error: Exception) -> Sample:
    """Return the sample of a clip after its workers died."""
    problems = Message.SAMPLE_FAILED.error(str(clip.folder), error=error).problems
    return Sample({}, problems=tuple(problems))


Copies = Callable[
    [Callable[[FoundClip], Sample], Iterator[FoundClip]], Iterator[Sample]
]
"""A function like `map`: it calls another one for each clip, in order."""


@dataclass(frozen=True)
class Gathering:
    """Settings and services for a data set."""

    splits: Splits
    warn: Callable[[Problem], None]
    progress: Callable[[int], None] = lambda count: None
    copies: Copies = map
    """Copies clips, on this machine or on a cluster."""
    # A name of LAYOUTS.
    layout: str = "folder"
    shard_clips: int = SHARD_CLIPS
    root: Path | None = None
    """The data set for the copies, if its tables are written elsewhere."""
    fetch_members: Callable[[Members], AbstractContextManager[Members]] = nullcontext
    """Brings the files of a clip to this machine while the layout reads them."""

    def write(self, folder: Path, clips: Iterator[FoundClip]) -> DatasetSummary:
        """Write the clips into the new folder of a data set.

        Warn of unusable clips and leave them out. Raise InputError if no clip remains.
        """
        summary = DatasetSummary(Counter(dict.fromkeys(self.splits.names, 0)))

        def reject(problems: Sequence[Problem]) -> None:
            summary.left_out += 1
            for problem in problems:
                self.warn(problem)

        with ExitStack() as stack:
            writer = LAYOUTS[self.layout](folder, stack, self.shard_clips)
            copy = partial(copy_sample, self.splits, writer.copier, self.root or folder)
            for sample in self.copies(copy, _distinct_clips(clips, reject)):
                if sample.problems:
                    reject(sample.problems)
                    continue
                self._add(writer, sample)
                summary.counts[sample.metadata["split"]] += 1
                summary.photos.add(sample.metadata["photo"])
                self.progress(summary.total)
        if summary.total:
            summary.files = writer.files()
            self._write_card(folder, summary, writer.patterns)
        return summary

    def _add(self, writer: Layout, sample: Sample) -> None:
        if not writer.reads_clips:
            writer.add(sample.members, sample.metadata)
            return
        with self.fetch_members(sample.members) as members:
            writer.add(members, sample.metadata)

    def _write_card(
        self, folder: Path, summary: DatasetSummary, patterns: Sequence[str]
    ) -> None:
        """Write the card and the settings of the data set."""
        names = []
        for name in self.splits.names:
            if summary.counts[name]:
                names.append(name)
        (folder / CARD).write_text(card(names, patterns), encoding="utf-8")
        shares = dict(self.splits.shares)
        settings = {"dataset": 1, "seed": self.splits.seed, "splits": shares}
        if self.layout != "folder":
            settings["layout"] = self.layout
        content = {**settings, "physgen": __version__, "clips": summary.counts}
        text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
        (folder / DATASET_FILE).write_text(text, encoding="utf-8")


def gather(roots: Sequence[Path], out: Path, gathering: Gathering) -> DatasetSummary:
    """Make a data set of the clips below `roots` in the new folder `out`. The folder
    appears only when complete.

    Raise InputError for unusable folders, or if there is no clip.
    """
    roots = checked_folders(roots)
    _check_output(out, roots)
    with atomic_folder(out.resolve()) as folder:
        summary = gathering.write(folder, find_clips(roots))
        check_clips(summary, roots)
    # The temporary folder has its final name now.
    summary.files = [out / path.relative_to(folder) for path in summary.files]
    return summary


def check_clips(summary: DatasetSummary, roots: Sequence[Path]) -> None:
    """Raise InputError if a data set has no clips."""
    if not summary.total:
        raise Message.NO_USABLE_CLIP.error(", ".join(map(str, roots)))


def _distinct_clips(
    clips: Iterator[FoundClip], reject: Callable[[Sequence[Problem]], None]
) -> Iterator[FoundClip]:
    """Yield clips with different keys, and reject the others."""
    keys: set[str] = set()
    for clip in clips:
        name = key(clip.name)
        if name in keys:
            reject(
                Message.SAMPLES_CALLED_ALIKE.error(str(clip.folder), name=name).problems
            )
            continue
        keys.add(name)
        yield clip


def _check_output(out: Path, roots: Sequence[Path]) -> None:
    """Raise InputError unless the folder is new or empty, and outside the input
    folders.
    """
    check_writable(out)
    check_apart(out, roots)
    if out.exists() and any(out.iterdir()):
        raise Message.OUTPUT_NOT_EMPTY.error(str(out))
    # The folder is replaced by a rename, which a mount point and the working folder do
    # not allow.
    if out.is_mount() or out.resolve() == Path.cwd():
        raise Message.OUTPUT_NOT_REPLACEABLE.error(str(out))


def check_apart(out: Path, roots: Sequence[Path]) -> None:
    """Raise InputError if a data set lies within or around an input folder."""
    for root in roots:
        output_folder, read = out.resolve(), root.resolve()
        if output_folder.is_relative_to(read) or read.is_relative_to(output_folder):
            place = "lies in"
            if output_folder in read.parents:
                place = "holds"
            raise Message.OUTPUT_AMONG_INPUTS.error(str(out), place=place, root=root)
