"""Methods in a folder, each with its clips by scene, and photos and words of the scenes beside them.

`METHODS/<method>/<scene>.mp4`, or `METHODS/<method>/<scene>/video.mp4` as `physgen render -o METHODS/<method>`
leaves them; `METHODS/photos/<scene>.png` and `METHODS/photos/<scene>.txt` where they are there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.problems import InputError, Place, Problem
from physgen.report.clips import ENDING, clips_in, read_failure
from physgen.text import natural
from physgen.videos import Video, is_picture, plays, read_video

U8 = NDArray[np.uint8]

FILMS = (".mp4", ".webm", ".mov", ".m4v", ".mkv", ".avi", ".gif", ".webp")
"""What a clip may be, the best first."""
PICTURES = (".png", ".jpg", ".jpeg", ".webp")
PHOTOS = "photos"
"""The folder in METHODS that is no method."""
FORM = "put clips at METHOD/SCENE.mp4 or METHOD/SCENE/video.mp4 in it"


@dataclass(frozen=True)
class Entry:
    """One scene as one method made it, or why it did not."""

    method: str
    scene: str
    film: Path | None
    problems: tuple[str, ...] = ()
    """Of one that failed; empty where there is a film."""
    folder: Path | None = None
    """Its own, where it has one."""
    report: Path | None = None


@dataclass(frozen=True)
class Methods:
    """What lies in a folder of methods."""

    folder: Path
    names: tuple[str, ...]
    """In natural order, as the scenes are."""
    scenes: tuple[str, ...]
    entries: Mapping[tuple[str, str], Entry]
    """(method, scene) -> what was made; where nothing is there, nothing."""
    photos: Mapping[str, Path] = field(default_factory=dict)
    """Scene -> the photo that its clips begin with."""
    words: Mapping[str, str] = field(default_factory=dict)
    """Scene -> what was asked of the methods."""

    @property
    def complete(self) -> tuple[str, ...]:
        """Scenes that every method has made."""
        return tuple(scene for scene in self.scenes if all(self.film(name, scene) for name in self.names))

    def film(self, method: str, scene: str) -> Path | None:
        """None where there is no clip, or a failed one."""
        entry = self.entries.get((method, scene))
        return entry.film if entry else None


def methods_in(folder: Path, photos: Path | None = None) -> Methods:
    """Folders in `folder` that hold clips are methods; raises InputError where there are none, or one scene twice.

    `photos` is the folder of the scenes' photos; by default `photos` in `folder`, if it is there.
    """
    if not folder.is_dir():
        raise InputError.of(str(folder), "", "is no folder", "name a folder with a folder for each method")
    if photos is not None and not photos.is_dir():
        raise InputError.of("--photos", f'"{photos}"', "is no folder", "name a folder with SCENE.png in it")
    shown = photos or folder / PHOTOS
    entries: dict[tuple[str, str], Entry] = {}
    problems: list[Problem] = []
    homes = [path for path in folder.iterdir() if path.is_dir() and not path.name.startswith(".")]
    for home in sorted(homes, key=lambda path: natural(path.name)):
        if home.resolve() == shown.resolve():
            continue
        if (home / "manifest.json").is_file() and any(home.glob("video.*")):
            expected = "is a clip, and no method: its folder holds the clips of one method alone"
            fix = "name the folder above it, in which each method has one"
            problems.append(Problem(Place(str(home)), "", "", expected, fix))
            break
        for entry in _entries(home):
            before = entries.setdefault((entry.method, entry.scene), entry)
            if before is not entry:
                found = f'"{before.folder or before.film}" and "{entry.folder or entry.film}"'
                expected = f'are two clips of the scene "{entry.scene}"'
                problems.append(Problem(Place(str(home)), "", found, expected, "leave one there"))
    if problems:
        raise InputError(problems)
    if not entries:
        raise InputError.of(str(folder), "", "holds no methods", FORM)
    names = dict.fromkeys(method for method, _ in entries)
    scenes = sorted({scene for _, scene in entries}, key=natural)
    pictures, words = _beside(shown, set(scenes)) if shown.is_dir() else ({}, {})
    return Methods(folder, tuple(names), tuple(scenes), entries, pictures, words)


def _entries(home: Path) -> list[Entry]:
    """Of one method, a scene at a time."""
    flat: dict[str, Path] = {}
    found: list[Entry] = []
    broken: dict[str, str] = {}
    for path in sorted(home.iterdir(), key=lambda path: natural(path.name)):
        if path.name.startswith("."):
            continue
        if path.is_dir():
            entry = _made(home.name, path)
            found += [entry] if entry else []
        elif path.name.endswith(ENDING):
            trace, scene = read_failure(path), path.name.removesuffix(ENDING)
            if trace is None:
                broken[scene] = f"{path.name} is there, and cannot be read as a record of a failure"
            else:
                found.append(Entry(home.name, scene, None, trace.problems or ("failed",)))
        elif path.suffix.lower() in FILMS and _moves(path):
            other = flat.get(path.stem)
            flat[path.stem] = path if other is None else min(path, other, key=_rank)
    failed = {entry.scene for entry in found if entry.problems and entry.folder is None}
    # physgen leaves both where refining failed: the folder says so too
    found = [e for e in found if not (e.problems and e.folder is not None and e.scene in failed)]
    found += [Entry(home.name, scene, path) for scene, path in flat.items()]
    known = {entry.scene for entry in found}
    return [
        *found,
        *(Entry(home.name, scene, None, (why,)) for scene, why in broken.items() if scene not in known),
    ]


def _made(method: str, folder: Path) -> Entry | None:
    """A clip in a folder of its own; None where none is in it."""
    if (folder / "manifest.json").is_file():
        clips = clips_in([folder])
        if clips and clips[0].home == folder and clips[0].problems:
            return Entry(method, folder.name, None, clips[0].problems, folder, clips[0].report)
    films = [path for path in folder.iterdir() if path.suffix.lower() in FILMS and path.is_file()]
    named = [path for path in films if path.stem == "video"]
    others = [path for path in films if path.suffix.lower() not in (".gif", ".webp")]
    film = min(named, key=_rank) if named else others[0] if len(others) == 1 else None
    report = folder / "report.html"
    if film is None:
        return None
    return Entry(method, folder.name, film, (), folder, report if report.is_file() else None)


def _beside(folder: Path, scenes: set[str]) -> tuple[dict[str, Path], dict[str, str]]:
    """Photos and words of those scenes."""
    pictures: dict[str, Path] = {}
    words = {}
    for path in sorted(folder.iterdir()):
        if path.stem in scenes and path.is_file():
            if path.suffix.lower() in PICTURES:
                pictures.setdefault(path.stem, path)
            elif path.suffix.lower() == ".txt":
                words[path.stem] = " ".join(path.read_text(encoding="utf-8", errors="replace").split())[:500]
    return pictures, {scene: text for scene, text in words.items() if text}


def _rank(path: Path) -> int:
    return FILMS.index(path.suffix.lower())


def _moves(path: Path) -> bool:
    """A WebP or GIF may be a poster."""
    if path.suffix.lower() not in (".gif", ".webp"):
        return True
    try:
        return is_picture(path) and plays(path)
    except InputError:
        return False


def read_clip(path: Path) -> tuple[Video, float]:
    """A clip and its frames a second. Raises InputError for one that is no video."""
    clip = read_video(path)
    if len(clip.frames) < 2:
        raise InputError.of(str(path), "", "has one frame: it is no video", "make at least two frames")
    if clip.fps is None:
        raise InputError.of(str(path), "", "does not say how fast it plays", "save it as MP4")
    return clip, clip.fps


def within(rgb: U8, side: int) -> U8:
    """(H, W, 3) sRGB with no side longer than `side` px."""
    high, wide = rgb.shape[:2]
    part = side / max(high, wide)
    if part >= 1:
        return rgb
    size = max(round(wide * part), 1), max(round(high * part), 1)
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)
