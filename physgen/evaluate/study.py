"""A blind page on which people rate clips of several methods, and the key that opens their answers.

Every clip is decoded and encoded again, by one encoder with one setting: container, codec, metadata, sound and marks
of the encoder would reveal the method. What stays is what is seen: size, rate and length.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from physgen.evaluate.measure import Progress
from physgen.evaluate.methods import Methods, read_clip, within
from physgen.export.video import Format, open_video
from physgen.files import resource, write_with_backup
from physgen.photos import read_photo
from physgen.problems import InputError, Problem
from physgen.report.html import script_json, template, webp
from physgen.text import shown

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
    name: str
    """As the paper has it; raters do not see it."""
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


# ---- the key -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Key:
    """Which clip of a page is of which method; kept apart from the page."""

    study: str
    """Hexadecimal digits."""
    seed: int
    methods: tuple[str, ...]
    scenes: tuple[str, ...]
    clips: Mapping[str, tuple[str, str]]
    """Name on the page -> method and scene."""

    @property
    def fits(self) -> bool:
        """Whether every clip is one of a known method and scene."""
        pairs = set(self.clips.values())
        known = {(method, scene) for method in self.methods for scene in self.scenes}
        return bool(pairs) and len(pairs) == len(self.clips) and pairs <= known

    def text(self) -> str:
        clips = {name: {"method": method, "scene": scene} for name, (method, scene) in self.clips.items()}
        record = {KEY: VERSION, "study": self.study, "seed": self.seed, "methods": self.methods}
        record |= {"scenes": self.scenes, "clips": clips}
        return json.dumps(record, indent=1, ensure_ascii=False) + "\n"


def read_key(path: Path) -> Key:
    """Raises InputError."""
    record = read_record(path, KEY)
    try:
        clips = {name: (clip["method"], clip["scene"]) for name, clip in record["clips"].items()}
        key = Key(
            record["study"], int(record["seed"]), tuple(record["methods"]), tuple(record["scenes"]), clips
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
        KEY: ("the key of a study", "name the NAME.key.json that was made with the page, with --key"),
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
            str(path), f"{kind} {shown(record[kind])}", expected, "use the physgen that made it"
        )
    return record


# ---- making ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PageClip:
    """One clip on the page."""

    name: str
    """On the page and in the key: c1, c2 ..."""
    method: str
    scene: str
    film: bytes
    """An MP4."""
    size: tuple[int, int]
    """Width and height, px."""


@dataclass(frozen=True)
class Study:
    """Content of the page, and the key."""

    clips: tuple[PageClip, ...]
    photos: dict[str, str]
    """Scene -> data URI."""
    words: dict[str, str]
    key: Key


def choose(methods: Methods, videos: int, seed: int) -> list[str]:
    """At most `videos` of the scenes that every method has made, drawn with `seed`. Raises InputError without any."""
    scenes = methods.complete
    if not scenes:
        fix = "give all methods a clip of the same scene, under the same name"
        raise InputError.of(str(methods.folder), ", ".join(methods.names), "have no scene in common", fix)
    if len(scenes) <= videos:
        return list(scenes)
    drawn = np.random.default_rng(seed).choice(len(scenes), videos, replace=False)
    return [scenes[k] for k in sorted(drawn.tolist())]


def make(
    methods: Methods, videos: int, seed: int = 0, progress: Progress = lambda stage, done, total: None
) -> Study:
    """Encodes every clip; the same bytes on every run. Raises InputError with all clips that cannot be read."""
    scenes = choose(methods, videos, seed)
    pairs = [(method, scene) for scene in scenes for method in methods.names]
    order = np.random.default_rng([seed, len(pairs)]).permutation(len(pairs)).tolist()
    clips: list[PageClip] = []
    photos: dict[str, str] = {}
    problems: list[Problem] = []
    for done, k in enumerate(order):
        progress("clips", done, len(pairs))
        method, scene = pairs[k]
        try:
            film, size = _encoded(methods.films[method, scene])
            clips.append(PageClip(f"c{done + 1}", method, scene, film, size))
        except InputError as error:
            problems += error.problems
    for scene in (scene for scene in scenes if scene in methods.photos):
        try:
            photos[scene] = webp(within(read_photo(methods.photos[scene]).rgb, SIDE), QUALITY)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    words = {scene: methods.words[scene] for scene in scenes if scene in methods.words}
    asked = [(question.claim, question.hint) for question in QUESTIONS]
    parts = [seed, asked, SCALE, words, photos, [sha256(clip.film).hexdigest() for clip in clips]]
    name = sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:12]
    key = Key(
        name, seed, methods.names, tuple(scenes), {clip.name: (clip.method, clip.scene) for clip in clips}
    )
    return Study(tuple(clips), photos, words, key)


def _encoded(path: Path) -> tuple[bytes, tuple[int, int]]:
    """As an MP4 of ours, and its size. Raises InputError."""
    clip, fps = read_clip(path)
    first = within(clip.frames[0], SIDE)
    size = first.shape[1], first.shape[0]
    with TemporaryDirectory() as place:
        with open_video(Path(place), Format.MP4, size, fps) as write:
            for frame in clip.frames:
                write(within(frame, SIDE))
        return (Path(place) / Format.MP4.file).read_bytes(), size


# ---- the page ----------------------------------------------------------------------------------------------------


def check_page(page: Path) -> None:
    """Raises InputError where no page can be written."""
    if page.is_dir() or page.suffix.lower() not in (".html", ".htm"):
        raise InputError.of("-o", f'"{page}"', "is no name for a page", "end it in .html, e.g. -o study.html")


def write_study(study: Study, page: Path, keep: Callable[[Path], None] = lambda kept: None) -> Path:
    """The page and its key, whose path is returned. Those of another study are kept as NAME~; `keep` is called."""
    check_page(page)
    page.parent.mkdir(parents=True, exist_ok=True)
    key = page.with_name(f"{page.stem}.key.json")
    write_with_backup(key, study.key.text().encode(), keep)  # first: no page without its key
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
            {"name": clip.name, "scene": scenes.index(clip.scene), "size": clip.size} for clip in study.clips
        ],
        "scenes": [
            {"photo": study.photos.get(scene, ""), "words": study.words.get(scene, "")} for scene in scenes
        ],
    }
    parts = [resource("templates", "study", f"{part}.js").read_text(encoding="utf-8") for part in SCRIPTS]
    page: str = template("study.html.j2").render(
        title=TITLE,
        count=len(study.clips),
        questions=QUESTIONS,
        scale=SCALE,
        words=bool(study.words),
        photos=bool(study.photos),
        films=[(clip.name, base64.b64encode(clip.film).decode("ascii")) for clip in study.clips],
        data=script_json(data),
        script='(() => {\n"use strict";\n' + "\n".join(parts) + "})();",
    )
    return page
