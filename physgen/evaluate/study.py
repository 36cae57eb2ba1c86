"""A blind page on which people rate clips of several methods, and the key that opens their answers.

Every clip is decoded and encoded again, by one encoder with one setting: container, codec, metadata, sound and marks
of the encoder would reveal the method. What stays is what is seen: size, rate and length.

Clips are `METHODS/<method>/<scene>.mp4`, or `METHODS/<method>/<scene>/video.mp4` as `physgen render` leaves them;
`METHODS/photos/<scene>.png` and `METHODS/photos/<scene>.txt` may lie beside them.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np

from physgen.evaluate.measure import Progress
from physgen.export.video import Format, open_video
from physgen.files import check_writable, resource, write_with_backup
from physgen.photos import read_photo
from physgen.problems import InputError, collect
from physgen.report.html import script_json, template, webp
from physgen.text import natural, shown
from physgen.videos import U8, Video, is_picture, plays, read_video

FILMS = (".mp4", ".webm", ".mov", ".m4v", ".mkv", ".avi", ".gif", ".webp")
"""What a clip may be."""
PICTURES = (".png", ".jpg", ".jpeg", ".webp")
PHOTOS = "photos"
"""The folder in METHODS that is no method."""
FORM = "put clips at METHOD/SCENE.mp4 or METHOD/SCENE/video.mp4 in it"
SIDE = 1024
"""px of a clip's and a photo's longer side, at most."""
QUALITY = 90
"""Of a photo's WebP."""
TITLE = "How real are these videos?"
SCRIPTS = ("keep", "order", "save", "clip", "page")
"""Parts of the page's script, in the order in which they build on each other."""
KEY, ANSWERS = "physgen-study-key", "physgen-study-answers"
"""Kinds of files, with the version of their form."""
VERSION = 1


@dataclass(frozen=True)
class Question:
    """One statement that a rater agrees with, or not."""

    key: str
    name: str  # as the paper has it; raters do not see it
    claim: str
    hint: str


QUESTIONS = (
    Question(
        "physical",
        "physical-realism",
        "The video is physically realistic.",
        "Things move, fall and meet as they would in reality, and as was asked for, where that is shown.",
    ),
    Question(
        "photo",
        "photo-realism",
        "The video is photo-realistic.",
        "Every picture of it could have been taken by a camera.",
    ),
)
"""The paper, Human evaluation: "whether the content of the generated video is realistic in its dynamics and object
interactions and accurately reflects the instructed movements"."""
SCALE = ("strongly disagree", "disagree", "neither", "agree", "strongly agree")
"""Of scores 1 to 5; the paper names the ends, and calls 4 "Agree"."""


# ---- the methods -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Methods:
    """What lies in a folder of methods."""

    folder: Path
    names: tuple[str, ...]  # in natural order, as the scenes are
    scenes: tuple[str, ...]
    films: Mapping[tuple[str, str], Path]  # (method, scene) -> its clip
    photos: Mapping[str, Path]  # scene -> the photo that its clips begin with
    words: Mapping[str, str]  # scene -> what was asked of the methods

    @property
    def complete(self) -> tuple[str, ...]:
        """Scenes that every method has made."""
        return tuple(
            s
            for s in self.scenes
            if all((name, s) in self.films for name in self.names)
        )


def methods_in(folder: Path) -> Methods:
    """Folders in `folder` that hold clips are methods; raises InputError where there are none, or one scene twice."""
    if not folder.is_dir():
        raise InputError.of(
            str(folder),
            "",
            "is no folder",
            "name a folder with a folder for each method",
        )
    beside = folder / PHOTOS
    films: dict[tuple[str, str], Path] = {}
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
                raise InputError.of(
                    str(home), f'"{before}" and "{film}"', expected, "leave one there"
                )
    if not films:
        raise InputError.of(str(folder), "", "holds no methods", FORM)
    names, scenes = (
        tuple(sorted({pair[k] for pair in films}, key=natural)) for k in (0, 1)
    )
    pictures: dict[str, Path] = {}
    words: dict[str, str] = {}
    for path in _sorted(beside) if beside.is_dir() else ():
        if path.stem in scenes and path.suffix.lower() in PICTURES:
            pictures.setdefault(path.stem, path)
        elif path.stem in scenes and path.suffix.lower() == ".txt":
            words[path.stem] = " ".join(
                path.read_text(encoding="utf-8", errors="replace").split()
            )[:500]
    return Methods(folder, names, scenes, films, pictures, words)


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
                yield (
                    path.name,
                    min(
                        named or inside,
                        key=lambda film: FILMS.index(film.suffix.lower()),
                    ),
                )
        elif _is_film(path):
            yield path.stem, path


def _is_film(path: Path) -> bool:
    """A WebP or GIF may be a poster."""
    if path.suffix.lower() not in FILMS or not path.is_file():
        return False
    try:
        return path.suffix.lower() not in (".gif", ".webp") or (
            is_picture(path) and plays(path)
        )
    except InputError:
        return False


def read_clip(path: Path) -> tuple[Video, float]:
    """A clip and its frames a second. Raises InputError for one that is no video."""
    clip = read_video(path)
    if clip.count < 2:
        raise InputError.of(
            str(path), "", "has one frame: it is no video", "make at least two frames"
        )
    if clip.fps is None:
        raise InputError.of(
            str(path), "", "does not say how fast it plays", "save it as MP4"
        )
    return clip, clip.fps


def within(rgb: U8) -> U8:
    """(H, W, 3) sRGB with no side longer than `SIDE` px."""
    high, wide = rgb.shape[:2]
    part = SIDE / max(high, wide)
    if part >= 1:
        return rgb
    size = max(round(wide * part), 1), max(round(high * part), 1)
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)


# ---- the key -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Key:
    """Which clip of a page is of which method; kept apart from the page."""

    study: str  # hexadecimal digits
    seed: int
    methods: tuple[str, ...]
    scenes: tuple[str, ...]
    clips: Mapping[str, tuple[str, str]]  # name on the page -> method and scene

    @property
    def fits(self) -> bool:
        """Whether every clip is one of a known method and scene."""
        pairs = set(self.clips.values())
        known = {(method, scene) for method in self.methods for scene in self.scenes}
        return bool(pairs) and len(pairs) == len(self.clips) and pairs <= known

    def text(self) -> str:
        clips = {
            name: {"method": method, "scene": scene}
            for name, (method, scene) in self.clips.items()
        }
        record = {
            KEY: VERSION,
            "study": self.study,
            "seed": self.seed,
            "methods": self.methods,
        }
        record |= {"scenes": self.scenes, "clips": clips}
        return json.dumps(record, indent=1, ensure_ascii=False) + "\n"


def read_key(path: Path) -> Key:
    """Raises InputError."""
    record = read_record(path, KEY)
    try:
        clips = {
            name: (clip["method"], clip["scene"])
            for name, clip in record["clips"].items()
        }
        key = Key(
            record["study"],
            int(record["seed"]),
            tuple(record["methods"]),
            tuple(record["scenes"]),
            clips,
        )
    except (KeyError, TypeError, ValueError, AttributeError):
        key = None
    if key is None or not key.fits:
        expected = "is a key that was changed: parts are missing or do not fit"
        raise InputError.of(str(path), "", expected, "use the file as it was made")
    return key


def read_record(path: Path, kind: str) -> Mapping[str, Any]:
    """Contents of a key or of a rater's answers. Raises InputError for a file that is not of that `kind`."""
    what, fix = {
        KEY: (
            "the key of a study",
            "name the NAME.key.json that was made with the page, with --key",
        ),
        ANSWERS: ("a rater's answers", "name files that the page of a study saved"),
    }[kind]
    if not path.is_file():
        raise InputError.of(str(path), "", "no such file", "check the path")
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        raise InputError.of(str(path), "", "cannot be read as JSON", fix) from None
    if not isinstance(record, dict) or kind not in record:
        raise InputError.of(str(path), "", f"is not {what}", fix)
    if record[kind] != VERSION:
        expected = f"is of a form that this physgen does not know (it knows {VERSION})"
        raise InputError.of(
            str(path),
            f"{kind} {shown(record[kind])}",
            expected,
            "use the physgen that made it",
        )
    return record


# ---- making ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PageClip:
    """One clip on the page."""

    name: str  # on the page and in the key: c1, c2
    method: str
    scene: str
    film: bytes  # an MP4
    size: tuple[int, int]  # width and height, px


@dataclass(frozen=True)
class Study:
    """Content of the page, and the key."""

    clips: tuple[PageClip, ...]
    photos: dict[str, str]  # scene -> data URI
    words: dict[str, str]
    key: Key


def choose(methods: Methods, videos: int, seed: int) -> list[str]:
    """At most `videos` of the scenes that every method has made, drawn with `seed`. Raises InputError without any."""
    scenes = methods.complete
    if not scenes:
        fix = "give all methods a clip of the same scene, under the same name"
        raise InputError.of(
            str(methods.folder),
            ", ".join(methods.names),
            "have no scene in common",
            fix,
        )
    if len(scenes) <= videos:
        return list(scenes)
    drawn = np.random.default_rng(seed).choice(len(scenes), videos, replace=False)
    return [scenes[k] for k in sorted(drawn.tolist())]


def make(
    methods: Methods,
    videos: int,
    seed: int = 0,
    progress: Progress = lambda stage, done, total: None,
) -> Study:
    """Encodes every clip; the same bytes on every run. Raises InputError with all clips that cannot be read."""
    scenes = choose(methods, videos, seed)
    pairs = [(method, scene) for scene in scenes for method in methods.names]
    order = np.random.default_rng([seed, len(pairs)]).permutation(len(pairs)).tolist()
    photos: dict[str, str] = {}

    def encode(done: int, method: str, scene: str) -> PageClip:
        progress("clips", done, len(pairs))
        return PageClip(
            f"c{done + 1}", method, scene, *_encoded(methods.films[method, scene])
        )

    def show(scene: str) -> None:
        photos[scene] = webp(within(read_photo(methods.photos[scene]).rgb), QUALITY)

    calls: list[Callable[[], Any]] = [
        partial(encode, done, *pairs[k]) for done, k in enumerate(order)
    ]
    calls += [partial(show, scene) for scene in scenes if scene in methods.photos]
    clips: list[PageClip] = collect(calls)[: len(order)]
    words = {scene: methods.words[scene] for scene in scenes if scene in methods.words}
    asked = [(question.claim, question.hint) for question in QUESTIONS]
    parts = [
        seed,
        asked,
        SCALE,
        words,
        photos,
        [sha256(clip.film).hexdigest() for clip in clips],
    ]
    name = sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:12]
    key = Key(
        name,
        seed,
        methods.names,
        tuple(scenes),
        {clip.name: (clip.method, clip.scene) for clip in clips},
    )
    return Study(tuple(clips), photos, words, key)


def _encoded(path: Path) -> tuple[bytes, tuple[int, int]]:
    """As an MP4 of ours, and its size. Raises InputError."""
    clip, fps = read_clip(path)
    first = within(next(clip.frames()))
    size = first.shape[1], first.shape[0]
    with TemporaryDirectory() as place:
        with open_video(Path(place), Format.MP4, size, fps) as write:
            for frame in clip.frames():
                write(within(frame))
        return (Path(place) / Format.MP4.file).read_bytes(), size


# ---- the page ----------------------------------------------------------------------------------------------------


def check_page(page: Path) -> None:
    """Raises InputError where no page can be written."""
    if page.is_dir() or page.suffix.lower() not in (".html", ".htm"):
        raise InputError.of(
            "-o",
            f'"{page}"',
            "is no name for a page",
            "end it in .html, e.g. -o study.html",
        )
    check_writable(page.parent)


def write_study(
    study: Study, page: Path, keep: Callable[[Path], None] = lambda kept: None
) -> Path:
    """The page and its key, whose path is returned. Those of another study are kept as NAME~; `keep` is called."""
    check_page(page)
    page.parent.mkdir(parents=True, exist_ok=True)
    key = page.with_name(f"{page.stem}.key.json")
    write_with_backup(
        key, study.key.text().encode(), keep
    )  # first: no page without its key
    write_with_backup(page, html(study).encode(), keep)
    return key


def html(study: Study) -> str:
    """One file that loads nothing from a network. Scenes are numbers, in the order of the clips: names would reveal
    them.
    """
    scenes = list(dict.fromkeys(clip.scene for clip in study.clips))
    data = {
        "form": ANSWERS,
        "version": VERSION,
        "study": study.key.study,
        "questions": [{"key": q.key, "claim": q.claim} for q in QUESTIONS],
        "clips": [
            {"name": clip.name, "scene": scenes.index(clip.scene), "size": clip.size}
            for clip in study.clips
        ],
        "scenes": [
            {"photo": study.photos.get(scene, ""), "words": study.words.get(scene, "")}
            for scene in scenes
        ],
    }
    parts = [
        resource("templates", "study", f"{part}.js").read_text(encoding="utf-8")
        for part in SCRIPTS
    ]
    page: str = template("study.html.j2").render(
        title=TITLE,
        count=len(study.clips),
        questions=QUESTIONS,
        scale=SCALE,
        words=bool(study.words),
        photos=bool(study.photos),
        films=[
            (clip.name, base64.b64encode(clip.film).decode("ascii"))
            for clip in study.clips
        ],
        data=script_json(data),
        script='(() => {\n"use strict";\n' + "\n".join(parts) + "})();",
    )
    return page
