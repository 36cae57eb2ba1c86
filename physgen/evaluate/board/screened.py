"""A method's clip -> what a page can play in step with others, with its poster and strip; or why it cannot."""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory

from physgen.evaluate.methods import Entry
from physgen.export.video import Format, open_video
from physgen.files import write_atomic
from physgen.problems import InputError
from physgen.report import clips
from physgen.report.gallery import ClipPictures, clip_pictures
from physgen.videos import Video, plays_anywhere, read_video


@dataclass(frozen=True)
class Screened:
    """One clip."""

    entry: Entry
    film: Path
    """An MP4: the clip itself, or one made of it that every browser plays."""
    data: bytes
    """The same, where the page is to carry it."""
    shot: ClipPictures
    size: tuple[int, int]
    fps: float
    frames: int


def readable(entry: Entry) -> tuple[Path, Video, float]:
    """Its file, its frames, and how many there are in a second. Raises InputError."""
    path = entry.film
    assert path is not None
    clip = read_video(path)
    if len(clip.frames) < 2:
        raise InputError.of(str(path), "", "has one frame: it is no video", "make at least two frames")
    if clip.fps is None:
        raise InputError.of(str(path), "", "does not say how fast it plays", "save it as MP4")
    return path, clip, clip.fps


def screened(entry: Entry, files: Path, single: bool) -> Screened:
    """Films, posters and strips go to `files`, unless they go into a `single` file. Raises InputError."""
    path, clip, fps = readable(entry)
    seal = sha256(path.read_bytes()).hexdigest()[:20]
    if path.suffix == ".mp4" and plays_anywhere(path):
        return _of(entry, path, seal, clip, fps, files, single)
    film = files / f"{seal}.film.mp4"
    if not single and film.is_file():
        return _of(entry, film, seal, clip, fps, files, single)
    with TemporaryDirectory() as place:
        made = Path(place) / Format.MP4.file
        with open_video(made.parent, Format.MP4, clip.size, fps) as write:
            for frame in clip.frames:
                write(frame)
        if single:
            return _of(entry, made, seal, clip, fps, files, single)
        files.mkdir(parents=True, exist_ok=True)
        write_atomic(film, made.read_bytes())
    return _of(entry, film, seal, clip, fps, files, single)


def _of(entry: Entry, film: Path, seal: str, clip: Video, fps: float, files: Path, single: bool) -> Screened:
    count = len(clip.frames)
    known = clips.Clip(film.parent, entry.scene, size=clip.size, fps=fps, frames=count, film=film, seal=seal)
    shot = clip_pictures(known, files, single)
    return Screened(entry, film, film.read_bytes() if single else b"", shot, clip.size, fps, count)
