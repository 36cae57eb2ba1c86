"""A folder of methods and scenes -> a blind study: clips all of one make, in an order that tells nothing, and the
key.

Every clip is decoded and encoded again, by one encoder with one setting: container, codec, metadata, sound and the
encoder's own marks in the stream would tell methods apart. What stays is what is seen: size, rate and length.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.methods import Methods
from physgen.evaluate.study.key import Key
from physgen.evaluate.study.questions import QUESTIONS, SCALE
from physgen.export.video import Format, open_video
from physgen.photos import read_photo
from physgen.problems import InputError, Problem
from physgen.report.html import webp
from physgen.videos import read_video

U8 = NDArray[np.uint8]
Progress = Callable[[str, int, int], None]

SIDE = 1024
"""px of a clip's and a photo's longer side, at most."""
QUALITY = 90
"""Of a photo's WebP."""


@dataclass(frozen=True)
class Shown:
    """One clip as the page has it."""

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
    """What becomes the page and the key."""

    name: str
    """Of its contents, hexadecimal digits: the same study has the same."""
    clips: tuple[Shown, ...]
    photos: dict[str, str]
    """Scene -> data URI."""
    words: dict[str, str]
    key: Key
    left_out: tuple[str, ...]
    """Scenes that not every method has made."""


def choose(methods: Methods, videos: int, seed: int) -> list[str]:
    """So many of the scenes that every method has made, drawn with `seed`; all where there are no more.

    Raises InputError where no scene is there of all methods.
    """
    scenes = methods.complete
    if not scenes:
        names = ", ".join(methods.names)
        fix = "give all methods a clip of the same scene, under the same name"
        raise InputError.of(str(methods.folder), names, "have no scene in common", fix)
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
    clips: list[Shown] = []
    problems: list[Problem] = []
    for done, k in enumerate(order):
        progress("clips", done, len(pairs))
        method, scene = pairs[k]
        path = methods.film(method, scene)
        assert path is not None  # the scene is complete
        try:
            clips.append(Shown(f"c{done + 1}", method, scene, *_encoded(path)))
        except InputError as error:
            problems += error.problems
    photos: dict[str, str] = {}
    for scene in (scene for scene in scenes if scene in methods.photos):
        try:
            photos[scene] = webp(_within(read_photo(methods.photos[scene]).rgb), QUALITY)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    words = {scene: methods.words[scene] for scene in scenes if scene in methods.words}
    asked = [(question.claim, question.hint) for question in QUESTIONS]
    name = _name([seed, asked, SCALE, words, photos, [sha256(clip.film).hexdigest() for clip in clips]])
    key = Key(
        name, seed, methods.names, tuple(scenes), {clip.name: (clip.method, clip.scene) for clip in clips}
    )
    return Study(
        name, tuple(clips), photos, words, key, tuple(s for s in methods.scenes if s not in methods.complete)
    )


def _encoded(path: Path) -> tuple[bytes, tuple[int, int]]:
    """As an MP4 of ours, and its size. Raises InputError."""
    clip = read_video(path)
    if len(clip.frames) < 2:
        raise InputError.of(str(path), "", "has one frame: it is no video", "make at least two frames")
    if clip.fps is None:
        raise InputError.of(str(path), "", "does not say how fast it plays", "save it as MP4")
    first = _within(clip.frames[0])
    size = first.shape[1], first.shape[0]
    with TemporaryDirectory() as place:
        with open_video(Path(place), Format.MP4, size, clip.fps) as write:
            for frame in clip.frames:
                write(_within(frame))
        return (Path(place) / Format.MP4.file).read_bytes(), size


def _within(rgb: U8) -> U8:
    """No side longer than SIDE."""
    high, wide = rgb.shape[:2]
    part = SIDE / max(high, wide)
    if part >= 1:
        return rgb
    size = max(round(wide * part), 1), max(round(high * part), 1)
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)


def _name(parts: Sequence[object]) -> str:
    return sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:12]
