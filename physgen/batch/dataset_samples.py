"""One clip as one sample of a data set: its files, its metadata and its split."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from physgen.batch.clips import FoundClip
from physgen.batch.values import parse_yaml
from physgen.problems import InputError
from physgen.scene.load import scene_name

LABELS = "truth"
"""Folder of a clip's labels."""
VIDEO, CAPTION = "video.mp4", "events/caption.txt"
MAX_KEY_LENGTH = 80
"""Characters of a key, without the digits that make it unique."""
_UNSAFE = re.compile(r"[^A-Za-z0-9_-]+")
_SPLIT_NAME = re.compile(r"[a-z][a-z0-9_]{0,30}")


@dataclass(frozen=True)
class Splits:
    """Names of splits and their shares of the photos, which add up to 1."""

    shares: tuple[tuple[str, float], ...]
    seed: int

    def of(self, photo: str) -> str:
        """The split of all clips of a photo, by its SHA-256 and the seed only, so that more photos change nothing.

        >>> even = Splits((("train", 0.5), ("test", 0.5)), 0)
        >>> [even.of(photo) for photo in "abcdef"]
        ['test', 'test', 'test', 'train', 'test', 'train']
        """
        digest = hashlib.sha256(f"{self.seed}:{photo}".encode()).digest()
        place = (int.from_bytes(digest[:8], "big") >> 12) / 2**52
        for name, share in self.shares:
            if place < share:
                return name
            place -= share
        return self.shares[-1][0]  # the shares add up to less by rounding

    @property
    def names(self) -> tuple[str, ...]:
        """Of the splits."""
        return tuple(name for name, _ in self.shares)


def read_splits(text: str, seed: int) -> Splits:
    """Parses `train=0.8,test=0.2`. Raises InputError."""
    shares: dict[str, float] = {}
    for part in text.split(","):
        name, _, share = (piece.strip() for piece in part.partition("="))
        try:
            value = float(share)
        except ValueError:
            value = -1.0
        if not _SPLIT_NAME.fullmatch(name) or not 0 < value <= 1 or name in shares:
            fix = "write e.g. train=0.8,validation=0.1,test=0.1"
            found = "is no split with its share of the photos"
            raise InputError.of("--split", f'"{part.strip()}"', found, fix)
        shares[name] = value
    total = sum(shares.values())
    if abs(total - 1) > 1e-6:
        raise InputError.of("--split", f'"{text}"', f"adds up to {total:.6g}", "make the shares add up to 1")
    return Splits(tuple(shares.items()), seed)


@dataclass(frozen=True, slots=True)
class Member:
    """One file; thousands are held for a shard."""

    name: str
    """In the sample: `video.mp4`, or `format/...` of a label."""
    file: str
    """In the clip's folder."""
    size: int
    """Bytes."""
    sha256: str


@dataclass(frozen=True)
class Sample:
    """One clip in the data set."""

    key: str
    """Letters, digits, - and _: the name of the sample."""
    split: str
    folder: Path
    members: tuple[Member, ...]
    """The video first."""
    about: Mapping[str, Any]
    """Metadata as JSON."""

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(member.size for member in self.members)

    @property
    def caption(self) -> str:
        """Empty where there is none."""
        return str(self.about["caption"])

    @property
    def digest(self) -> str:
        """SHA-256 of the metadata and of the files' hashes."""
        digest = hashlib.sha256(json.dumps(self.about, sort_keys=True).encode())
        for member in self.members:
            digest.update(f"{member.name}\0{member.size}\0{member.sha256}\0".encode())
        return digest.hexdigest()


def key(name: str) -> str:
    """The end of a path in safe characters, with a hash of the whole that makes it unique.

    >>> key("sweep/00-1,mass=2.5")
    'sweep_00-1-mass-2-5-261caf6945'
    """
    text = _UNSAFE.sub("-", name.replace("/", "_")).strip("-")[-MAX_KEY_LENGTH:]
    return f"{text}-{hashlib.sha256(name.encode('utf-8', 'surrogateescape')).hexdigest()[:10]}"


def read_sample(clip: FoundClip, splits: Splits, formats: Collection[str]) -> Sample:
    """With labels of the `formats`, of all where there are none. Raises InputError where the clip cannot be used."""
    manifest = clip.manifest
    if manifest is None:
        raise InputError.of(str(clip.folder), "", "has no manifest that can be read", "render it again")
    try:
        members = tuple(_members(clip.folder, manifest["files"], formats))
        about = _about(clip, manifest, members, splits)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError):
        raise InputError.of(str(clip.folder), "", "has a damaged manifest", "render it again") from None
    return Sample(about["key"], about["split"], clip.folder, members, about)


def _members(folder: Path, files: Mapping[str, str], formats: Collection[str]) -> Iterator[Member]:
    """Raises InputError where a file is missing, or there is no video."""
    if VIDEO not in files:
        raise InputError.of(str(folder), "", f"has no {VIDEO}", "render it with --export")
    chosen = {name: name for name in (VIDEO, "trajectory.npz") if name in files}
    labels = {name.removeprefix(f"{LABELS}/"): name for name in files if name.startswith(f"{LABELS}/")}
    for label, name in sorted(labels.items()):
        if not formats or label.partition("/")[0] in formats:
            chosen[label] = name
    for name, file in chosen.items():
        for path in map(PurePosixPath, (name, file)):  # a manifest is untrusted
            if ".." in path.parts or path.is_absolute():
                raise ValueError(file)
        try:
            size = (folder / file).stat().st_size
        except OSError:
            raise _missing(folder / file) from None
        yield Member(name, file, size, str(files[file]))


def _missing(path: Path) -> InputError:
    return InputError.of(str(path), "", "is missing", "render the clip again")


def _about(
    clip: FoundClip, manifest: Mapping[str, Any], members: Collection[Member], splits: Splits
) -> dict[str, Any]:
    document, video = manifest["document"], manifest["video"]
    photo = photo_of(document, manifest["inputs"])
    width, height = map(int, video["size"])
    frames, fps = len(manifest["frames"]), float(video["fps"])
    formats = sorted({member.name.partition("/")[0] for member in members if "/" in member.name})
    source = manifest.get("source")
    refine = manifest.get("refine")
    return {
        "key": key(clip.name),
        "clip": clip.name,
        "scene": scene_name(Path(source)) if source else str(manifest["scene"]),
        "variant": manifest["variant"] or "",
        # as text: readers that make columns of it need the same ones in every clip
        "parameters": json.dumps(dict(map(_parameter, manifest["overrides"])), ensure_ascii=False),
        "caption": _caption(clip.folder, manifest["files"]),
        "split": splits.of(photo),
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
    """SHA-256 of the photo; without one, of the scene file."""
    image = document.get("image")
    if image is not None:
        name = PurePosixPath(str(image)).name
        for path, digest in inputs.items():
            if path == str(image) or PurePosixPath(path).name == name:
                return digest
    return next(iter(inputs.values()))


def _parameter(text: str) -> tuple[str, Any]:
    """`KEY=VALUE`, as `--set` takes it."""
    name, _, value = str(text).partition("=")
    try:
        return name, parse_yaml(value).data
    except InputError:
        return name, value


def _caption(folder: Path, files: Mapping[str, str]) -> str:
    if f"{LABELS}/{CAPTION}" not in files:
        return ""
    path = folder / LABELS / CAPTION
    try:
        return path.read_text(encoding="utf-8").strip()
    except OSError:
        raise _missing(path) from None
