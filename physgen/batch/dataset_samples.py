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
from physgen.batch.values import ValueTextError, parse_yaml
from physgen.problems import InputError
from physgen.scene.load import scene_name

# ----------------------------------------------------------------------
# A photo and shares -> the split of all its clips: the same photo is never in two.

FLAG = "--split"
_NAME = re.compile(r"[a-z][a-z0-9_]{0,30}")
BITS = 52


@dataclass(frozen=True)
class Splits:
    """Names and shares of photos, in their order; shares add up to 1."""

    shares: tuple[tuple[str, float], ...]
    seed: int

    def of(self, photo: str) -> str:
        """By the photo's SHA-256 and the seed alone: more photos, or fewer, leave it where it is.

        >>> even = Splits((("train", 0.5), ("test", 0.5)), 0)
        >>> [even.of(photo) for photo in "abcdef"]
        ['test', 'test', 'test', 'train', 'test', 'train']
        """
        digest = hashlib.sha256(f"{self.seed}:{photo}".encode()).digest()
        place = (int.from_bytes(digest[:8], "big") >> (64 - BITS)) / 2**BITS
        for name, share in self.shares:
            if place < share:
                return name
            place -= share
        return self.shares[-1][0]  # for the last bit alone

    @property
    def names(self) -> tuple[str, ...]:
        """Of the splits."""
        return tuple(name for name, _ in self.shares)


def read_splits(text: str, seed: int) -> Splits:
    """`train=0.8,test=0.2` -> splits. Raises InputError."""
    shares: dict[str, float] = {}
    for part in text.split(","):
        name, _, share = (piece.strip() for piece in part.partition("="))
        try:
            value = float(share)
        except ValueError:
            value = -1.0
        if not _NAME.fullmatch(name) or not 0 < value <= 1 or name in shares:
            fix = "write e.g. train=0.8,validation=0.1,test=0.1"
            raise InputError.of(FLAG, f'"{part.strip()}"', "is no split with its share of the photos", fix)
        shares[name] = value
    total = sum(shares.values())
    if abs(total - 1) > 1e-6:
        raise InputError.of(FLAG, f'"{text}"', f"adds up to {total:.6g}", "make the shares add up to 1")
    return Splits(tuple(shares.items()), seed)


# ----------------------------------------------------------------------
# A clip's folder and its manifest -> one sample of a data set: which files it is made of, and what is told of
# it.

LABELS = "truth"
"""Folder of a clip's labels; where there is no video beside them, they lie in the clip's own."""
FILM, COARSE = "video.mp4", "conditioning/video.mp4"
CAPTIONS = ("events/caption.txt", "conditioning/prompt.txt")
LONGEST = 80
"""Characters of a key, without the digits that tell it from others."""
_SAFE = re.compile(r"[^A-Za-z0-9_-]+")


@dataclass(frozen=True, slots=True)
class Member:
    """One file; of a shard's, thousands are held."""

    name: str
    """In the sample: `video.mp4`, or `format/...` of a label."""
    file: str
    """In the clip's folder."""
    size: int
    """Bytes."""
    sha256: str


@dataclass(frozen=True)
class Sample:
    """One clip as the data set has it."""

    key: str
    """Letters, digits, - and _: the name of the sample everywhere."""
    split: str
    folder: Path
    members: tuple[Member, ...]
    """The video first."""
    about: Mapping[str, Any]
    """What is told of it, as JSON."""

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(member.size for member in self.members)

    @property
    def caption(self) -> str:
        """What happens; empty where nobody said."""
        return str(self.about["caption"])

    @property
    def digest(self) -> str:
        """SHA-256 of all that goes into the data set."""
        whole = hashlib.sha256(json.dumps(self.about, sort_keys=True).encode())
        for member in self.members:
            whole.update(f"{member.name}\0{member.size}\0{member.sha256}\0".encode())
        return whole.hexdigest()


def key(name: str) -> str:
    """The last parts of a path, with digits of the whole, so that no two paths have the same.

    >>> key("sweep/00-1,mass=2.5")
    'sweep_00-1-mass-2-5-2fc39e0a25'
    """
    text = _SAFE.sub("-", name.replace("/", "_")).strip("-")[-LONGEST:]
    return f"{text}-{hashlib.sha256(name.encode('utf-8', 'surrogateescape')).hexdigest()[:10]}"


def sample(found: FoundClip, splits: Splits, formats: Collection[str]) -> Sample:
    """With labels of the `formats`, of all where there are none. Raises InputError where the clip cannot be used."""
    told = found.told
    if told is None:
        raise InputError.of(str(found.folder), "", "has no manifest that can be read", "render it again")
    try:
        members = list(_members(found.folder, told["files"], formats))
        about = _about(found, told, members, splits)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError):
        raise InputError.of(str(found.folder), "", "has a damaged manifest", "render it again") from None
    return Sample(key(found.name), about["split"], found.folder, tuple(members), about)


def _members(folder: Path, files: Mapping[str, str], formats: Collection[str]) -> Iterator[Member]:
    """Raises InputError where a file is missing, or there is no video."""
    inside = f"{LABELS}/" if any(name.startswith(f"{LABELS}/") for name in files) else ""
    if inside == "" and FILM in files:
        labels = {}
    else:
        labels = {
            name.removeprefix(inside): name for name in files if name.startswith(inside) and "/" in name
        }
    film = FILM if FILM in files else labels.get(COARSE)
    if film is None:
        fix = "render it with --export, or export it with --format conditioning"
        raise InputError.of(str(folder), "", "has no video.mp4", fix)
    yield _member(folder, "video.mp4", film, files)
    if "trajectory.npz" in files:
        yield _member(folder, "trajectory.npz", "trajectory.npz", files)
    for label, name in sorted(labels.items()):
        if name != film and (not formats or label.partition("/")[0] in formats):
            yield _member(folder, label, name, files)


def _member(folder: Path, name: str, file: str, files: Mapping[str, str]) -> Member:
    for path in map(PurePosixPath, (name, file)):  # a manifest may be anybody's
        if ".." in path.parts or path.is_absolute():
            raise ValueError(file)
    try:
        size = (folder / file).stat().st_size
    except OSError:
        raise _missing(folder / file) from None
    return Member(name, file, size, str(files[file]))


def _missing(path: Path) -> InputError:
    return InputError.of(str(path), "", "is missing", "render the clip again")


def _about(
    found: FoundClip, told: Mapping[str, Any], members: list[Member], splits: Splits
) -> dict[str, Any]:
    document, video = told["document"], told["video"]
    photo = photo_of(document, told["inputs"])
    width, height = map(int, video["size"])
    frames, fps = len(told["frames"]), float(video["fps"])
    formats = sorted({member.name.partition("/")[0] for member in members if "/" in member.name})
    return {
        "key": key(found.name),
        "clip": found.name,
        "scene": scene_name(Path(told["source"])) if told.get("source") else str(told["scene"]),
        "variant": told["variant"] or "",
        # as text: readers that make columns of it want the same ones in every clip
        "parameters": json.dumps(dict(_parameter(text) for text in told["overrides"]), ensure_ascii=False),
        "caption": _caption(found.folder, told["files"]),
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
        "refined": str(told["refine"]["backend"]) if told.get("refine") else "",
        "physgen": str(told["versions"]["physgen"]),
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
    except (ValueTextError, InputError):
        return name, value


def _caption(folder: Path, files: Mapping[str, str]) -> str:
    for home in ("", f"{LABELS}/"):
        for name in CAPTIONS:
            if f"{home}{name}" in files:
                try:
                    return (folder / home / name).read_text(encoding="utf-8").strip()
                except OSError:
                    raise _missing(folder / home / name) from None
    return ""
