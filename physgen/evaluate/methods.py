"""Methods in a folder, each with its clips by scene, and photos and words of the scenes beside them.

`METHODS/<method>/<scene>.mp4`, or `METHODS/<method>/<scene>/video.mp4` as `physgen render -o METHODS/<method>`
leaves them; `METHODS/photos/<scene>.png` and `METHODS/photos/<scene>.txt` where they are there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from physgen.problems import InputError
from physgen.report.clips import ENDING, read_failure
from physgen.text import natural
from physgen.videos import U8, Video, is_picture, plays, read_video

FILMS = (".mp4", ".webm", ".mov", ".m4v", ".mkv", ".avi", ".gif", ".webp")
"""What a clip may be."""
PICTURES = (".png", ".jpg", ".jpeg", ".webp")
PHOTOS = "photos"
"""The folder in METHODS that is no method."""
FORM = "put clips at METHOD/SCENE.mp4 or METHOD/SCENE/video.mp4 in it"


@dataclass(frozen=True)
class Methods:
    """What lies in a folder of methods."""

    folder: Path
    names: tuple[str, ...]
    """In natural order, as the scenes are."""
    scenes: tuple[str, ...]
    films: Mapping[tuple[str, str], Path]
    """(method, scene) -> its clip."""
    failures: Mapping[tuple[str, str], str]
    """(method, scene) -> why there is none, where that is recorded."""
    photos: Mapping[str, Path]
    """Scene -> the photo that its clips begin with."""
    words: Mapping[str, str]
    """Scene -> what was asked of the methods."""

    @property
    def complete(self) -> tuple[str, ...]:
        """Scenes that every method has made."""
        return tuple(s for s in self.scenes if all((name, s) in self.films for name in self.names))


def methods_in(folder: Path) -> Methods:
    """Folders in `folder` that hold clips are methods; raises InputError where there are none, or one scene twice."""
    if not folder.is_dir():
        raise InputError.of(str(folder), "", "is no folder", "name a folder with a folder for each method")
    beside = folder / PHOTOS
    films: dict[tuple[str, str], Path] = {}
    failures: dict[tuple[str, str], str] = {}
    for home in _sorted(folder):
        if not home.is_dir() or home == beside:
            continue
        if (home / "manifest.json").is_file() and any(home.glob("video.*")):
            expected = "is a clip, and no method: its folder holds the clips of one method alone"
            fix = "name the folder above it, in which each method has one"
            raise InputError.of(str(home), "", expected, fix)
        for scene, film in _films(home):
            before = films.setdefault((home.name, scene), film)
            if before != film:
                expected = f'are two clips of the scene "{scene}"'
                raise InputError.of(str(home), f'"{before}" and "{film}"', expected, "leave one there")
        for path in home.glob(f"*{ENDING}"):
            scene, failure = path.name.removesuffix(ENDING), read_failure(path)
            if (home.name, scene) not in films:
                unread = f"{path.name} is there, and cannot be read as a record of a failure"
                failures[home.name, scene] = (
                    unread if failure is None else " ".join(failure.problems or ("failed",))
                )
    known = {*films, *failures}
    if not known:
        raise InputError.of(str(folder), "", "holds no methods", FORM)
    names, scenes = (tuple(sorted({pair[k] for pair in known}, key=natural)) for k in (0, 1))
    pictures: dict[str, Path] = {}
    words: dict[str, str] = {}
    for path in _sorted(beside) if beside.is_dir() else ():
        if path.stem in scenes and path.suffix.lower() in PICTURES:
            pictures.setdefault(path.stem, path)
        elif path.stem in scenes and path.suffix.lower() == ".txt":
            words[path.stem] = " ".join(path.read_text(encoding="utf-8", errors="replace").split())[:500]
    return Methods(folder, names, scenes, films, failures, pictures, words)


def _sorted(folder: Path) -> list[Path]:
    inside = (path for path in folder.iterdir() if not path.name.startswith("."))
    return sorted(inside, key=lambda path: natural(path.name))


def _films(home: Path) -> Iterator[tuple[str, Path]]:
    """Scene and clip, of one method: a file, or in a folder of its own `video.mp4` or the only film."""
    for path in _sorted(home):
        if path.is_dir():
            inside = [film for film in _sorted(path) if _is_film(film)]
            named = [film for film in inside if film.stem == "video"]
            if named or len(inside) == 1:
                yield path.name, min(named or inside, key=lambda film: FILMS.index(film.suffix.lower()))
        elif _is_film(path):
            yield path.stem, path


def _is_film(path: Path) -> bool:
    """A WebP or GIF may be a poster."""
    if path.suffix.lower() not in FILMS or not path.is_file():
        return False
    try:
        return path.suffix.lower() not in (".gif", ".webp") or (is_picture(path) and plays(path))
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
