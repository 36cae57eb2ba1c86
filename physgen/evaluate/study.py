"""Make a blind page on which people rate clips of several methods, and the key for
their answers.

Every clip is decoded and encoded again, with one encoder and one setting: container,
codec, metadata, sound and traces of the encoder would reveal the method. Only size,
rate and length of a clip stay.

Clips are `METHODS/<method>/<scene>.mp4`, or `METHODS/<method>/<scene>/video.mp4` of
`physgen render`. `METHODS/photos/<scene>.png` and `METHODS/photos/<scene>.txt` are
optional.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np

from physgen.evaluate.measure import Progress
from physgen.export.video import Format, open_video
from physgen.files import check_writable, resource, write_with_backup
from physgen.messages import Message
from physgen.photos import read_photo
from physgen.problems import InputError, collect
from physgen.report.html import script_json, template, webp
from physgen.text import natural, shown
from physgen.videos import U8, Video, is_picture, plays, read_video

CLIP_SUFFIXES = (".mp4", ".webm", ".mov", ".m4v", ".mkv", ".avi", ".gif", ".webp")
"""Suffixes of clips, the preferred one first."""
STILL_SUFFIXES = (".gif", ".webp")
"""Suffixes of clips or stills."""
MAX_WORDS = 500
"""Maximum length of a request to the methods, characters."""
PICTURES = (".png", ".jpg", ".jpeg", ".webp")
PHOTOS = "photos"
"""The folder in METHODS without a method."""
SIDE = 1024
"""Maximum longer side of a clip and a photo, px."""
QUALITY = 90
"""Quality of a photo's WebP."""
TITLE = "How real are these videos?"
SCRIPTS = ("keep", "order", "save", "clip", "page")
"""Parts of the page's script, in the order of their dependencies."""
KEY, ANSWERS = "physgen-study-key", "physgen-study-answers"
"""Kinds of files; VERSION is the version of their form."""
VERSION = 1


@dataclass(frozen=True)
class Question:
    """A statement for agreement or disagreement of a rater."""

    key: str
    name: str
    """The paper's name, invisible to raters."""
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
"""Words for scores 1 to 5. The paper names the ends, and calls 4 "Agree"."""


# ---- the methods


@dataclass(frozen=True)
class Methods:
    """Content of a folder of methods."""

    folder: Path
    names: tuple[str, ...]
    """In natural order, as the scenes."""
    scenes: tuple[str, ...]
    clips: Mapping[tuple[str, str], Path]
    """Clips by method and scene."""
    photos: Mapping[str, Path]
    """Photos by scene: the first frame of its clips."""
    words: Mapping[str, str]
    """Requests to the methods, by scene."""

    @property
    def common_scenes(self) -> tuple[str, ...]:
        """Return the scenes with a clip of every method."""
        scenes = []
        for scene in self.scenes:
            if all((name, scene) in self.clips for name in self.names):
                scenes.append(scene)
        return tuple(scenes)


def methods_in(folder: Path) -> Methods:
    """Return the methods in a folder: its folders with clips.

    Raise InputError if there are none, or for a repeated scene.
    """
    if not folder.is_dir():
        raise Message.METHODS_NOT_FOLDER.error(str(folder))
    photo_folder = folder / PHOTOS
    clips: dict[tuple[str, str], Path] = {}
    for method_folder in _sorted_paths(folder):
        if method_folder.is_dir() and method_folder != photo_folder:
            for scene, clip in _clips_of_method(method_folder).items():
                clips[method_folder.name, scene] = clip
    if not clips:
        raise Message.NO_METHODS.error(str(folder))
    names = tuple(sorted({method for method, _ in clips}, key=natural))
    scenes = tuple(sorted({scene for _, scene in clips}, key=natural))
    photos: dict[str, Path] = {}
    words: dict[str, str] = {}
    for path in _sorted_paths(photo_folder) if photo_folder.is_dir() else ():
        if path.stem not in scenes:
            continue
        suffix = path.suffix.lower()
        if suffix in PICTURES:
            photos.setdefault(path.stem, path)
        elif suffix == ".txt":
            text = path.read_text(encoding="utf-8", errors="replace")
            words[path.stem] = " ".join(text.split())[:MAX_WORDS]
    return Methods(folder, names, scenes, clips, photos, words)


def _sorted_paths(folder: Path) -> list[Path]:
    """Return the visible files and folders in a folder, in natural order."""
    paths = []
    for path in folder.iterdir():
        if not path.name.startswith("."):
            paths.append(path)
    return sorted(paths, key=lambda path: natural(path.name))


def _clips_of_method(folder: Path) -> dict[str, Path]:
    """Return the clips of one method by scene. Raise InputError for a repeated scene,
    or for a rendered clip.
    """
    if (folder / "manifest.json").is_file() and any(folder.glob("video.*")):
        raise Message.CLIP_FOR_METHOD.error(str(folder))
    clips: dict[str, Path] = {}
    for scene, clip in _find_clips(folder):
        previous = clips.setdefault(scene, clip)
        if previous != clip:
            raise Message.TWO_CLIPS_OF_SCENE.error(
                str(folder), f'"{previous}" and "{clip}"', scene=scene
            )
    return clips


def _find_clips(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield scene and clip of one method: a file, or `video.mp4` or the only clip in a
    folder of its own.
    """
    for path in _sorted_paths(folder):
        if path.is_dir():
            clips = []
            for part in _sorted_paths(path):
                if _is_clip(part):
                    clips.append(part)
            videos = []
            for clip in clips:
                if clip.stem == "video":
                    videos.append(clip)
            if videos or len(clips) == 1:
                yield path.name, min(videos or clips, key=_suffix_order)
        elif _is_clip(path):
            yield path.stem, path


def _suffix_order(path: Path) -> int:
    return CLIP_SUFFIXES.index(path.suffix.lower())


def _is_clip(path: Path) -> bool:
    """Return whether a file is a clip. A WebP or GIF may be a poster."""
    suffix = path.suffix.lower()
    if suffix not in CLIP_SUFFIXES or not path.is_file():
        return False
    if suffix not in STILL_SUFFIXES:
        return True
    try:
        return is_picture(path) and plays(path)
    except InputError:
        return False


def read_clip(path: Path) -> tuple[Video, float]:
    """Return a clip and its frames per second. Raise InputError for another kind of
    file.
    """
    clip = read_video(path)
    if clip.count < 2:
        raise Message.VIDEO_OF_ONE_FRAME.error(str(path))
    if clip.fps is None:
        raise Message.VIDEO_WITHOUT_RATE.error(str(path))
    return clip, clip.fps


def shrink(rgb: U8) -> U8:
    """Return a picture (H, W, 3) sRGB with sides of at most `SIDE` px."""
    height, width = rgb.shape[:2]
    scale = SIDE / max(height, width)
    if scale >= 1:
        return rgb
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)


# ---- the key


@dataclass(frozen=True)
class Key:
    """Method and scene of each clip of a page, in a file apart from the page."""

    study: str
    """Hexadecimal digits."""
    seed: int
    methods: tuple[str, ...]
    scenes: tuple[str, ...]
    clips: Mapping[str, tuple[str, str]]
    """Method and scene by the name on the page."""

    @property
    def is_consistent(self) -> bool:
        """Return whether every clip has a known method and scene."""
        pairs = set(self.clips.values())
        known_pairs = set(product(self.methods, self.scenes))
        has_one_clip_a_pair = len(pairs) == len(self.clips)
        return bool(pairs) and has_one_clip_a_pair and pairs <= known_pairs

    def text(self) -> str:
        """Return the content of the key's file."""
        clips = {}
        for name, (method, scene) in self.clips.items():
            clips[name] = {"method": method, "scene": scene}
        record = {
            KEY: VERSION,
            "study": self.study,
            "seed": self.seed,
            "methods": self.methods,
            "scenes": self.scenes,
            "clips": clips,
        }
        return json.dumps(record, indent=1, ensure_ascii=False) + "\n"


def read_key(path: Path) -> Key:
    """Return the key in a file. Raise InputError."""
    record = read_record(path, KEY)
    try:
        key = _parse_key(record)
    except (KeyError, TypeError, ValueError, AttributeError):
        key = None
    if key is None or not key.is_consistent:
        raise Message.STUDY_KEY_CHANGED.error(str(path))
    return key


def _parse_key(record: Mapping[str, Any]) -> Key:
    """Return the key of a record. Raise an error of Python for a wrong one."""
    clips = {}
    for name, clip in record["clips"].items():
        clips[name] = (clip["method"], clip["scene"])
    methods = tuple(record["methods"])
    scenes = tuple(record["scenes"])
    return Key(record["study"], int(record["seed"]), methods, scenes, clips)


RECORD_FAULTS = {KEY: Message.NOT_STUDY_KEY, ANSWERS: Message.NOT_STUDY_ANSWERS}
"""Templates for another file, by the expected kind."""


def read_record(path: Path, kind: str) -> Mapping[str, Any]:
    """Return the content of a key or of a rater's answers. Raise InputError for a file
    of another kind.
    """
    message = RECORD_FAULTS[kind]
    if not path.is_file():
        raise Message.NO_SUCH_PATH.error(str(path))
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        fix = message.refusal().fix
        raise Message.NOT_JSON.error(str(path), fix=fix) from None
    if not isinstance(record, dict) or kind not in record:
        raise message.error(str(path))
    if record[kind] != VERSION:
        raise Message.STUDY_VERSION.error(
            str(path), f"{kind} {shown(record[kind])}", known=VERSION
        )
    return record


# ---- making


@dataclass(frozen=True)
class PageClip:
    """One clip on the page."""

    name: str
    """Name on the page and in the key: c1, c2."""
    method: str
    scene: str
    video: bytes
    """An MP4."""
    size: tuple[int, int]
    """Width and height, px."""


@dataclass(frozen=True)
class Study:
    """Content of the page, and the key."""

    clips: tuple[PageClip, ...]
    photos: dict[str, str]
    """Data URI by scene."""
    words: dict[str, str]
    key: Key


def choose_scenes(methods: Methods, videos: int, seed: int) -> list[str]:
    """Return at most `videos` of the scenes of all methods, drawn with `seed`. Raise
    InputError without any.
    """
    scenes = methods.common_scenes
    if not scenes:
        names = ", ".join(methods.names)
        raise Message.NO_COMMON_SCENE.error(str(methods.folder), names)
    if len(scenes) <= videos:
        return list(scenes)
    random = np.random.default_rng(seed)
    numbers = random.choice(len(scenes), videos, replace=False)
    return [scenes[k] for k in sorted(numbers.tolist())]


def make(
    methods: Methods,
    videos: int,
    seed: int = 0,
    progress: Progress = lambda stage, done, total: None,
) -> Study:
    """Encode every clip, and return the study; the same bytes on every run.

    Raise InputError with all unreadable clips.
    """
    scenes = choose_scenes(methods, videos, seed)
    pairs = [(method, scene) for scene in scenes for method in methods.names]
    # A random order hides the methods from raters.
    order = np.random.default_rng([seed, len(pairs)]).permutation(len(pairs)).tolist()
    photos: dict[str, str] = {}

    def encode(count: int, method: str, scene: str) -> PageClip:
        progress("clips", count, len(pairs))
        video, size = _encode_clip(methods.clips[method, scene])
        return PageClip(f"c{count + 1}", method, scene, video, size)

    def encode_photo(scene: str) -> None:
        photos[scene] = webp(shrink(read_photo(methods.photos[scene]).rgb), QUALITY)

    calls: list[Callable[[], Any]] = []
    for done, k in enumerate(order):
        calls.append(partial(encode, done, *pairs[k]))
    for scene in scenes:
        if scene in methods.photos:
            calls.append(partial(encode_photo, scene))
    # The calls for photos come last, and return nothing.
    clips: list[PageClip] = collect(calls)[: len(order)]
    words = {scene: methods.words[scene] for scene in scenes if scene in methods.words}
    key = Key(
        study=_study_name(seed, words, photos, clips),
        seed=seed,
        methods=methods.names,
        scenes=tuple(scenes),
        clips={clip.name: (clip.method, clip.scene) for clip in clips},
    )
    return Study(tuple(clips), photos, words, key)


def _study_name(
    seed: int,
    words: Mapping[str, str],
    photos: Mapping[str, str],
    clips: Sequence[PageClip],
) -> str:
    """Return hexadecimal digits of a page's content."""
    claims = [(question.claim, question.hint) for question in QUESTIONS]
    digests = [sha256(clip.video).hexdigest() for clip in clips]
    parts = [seed, claims, SCALE, words, photos, digests]
    text = json.dumps(parts, sort_keys=True)
    return sha256(text.encode()).hexdigest()[:12]


def _encode_clip(path: Path) -> tuple[bytes, tuple[int, int]]:
    """Return a clip as an MP4 of ours, and its size. Raise InputError."""
    clip, fps = read_clip(path)
    first_frame = shrink(next(clip.frames()))
    size = first_frame.shape[1], first_frame.shape[0]
    with TemporaryDirectory() as folder:
        with open_video(Path(folder), Format.MP4, size, fps) as write:
            for frame in clip.frames():
                write(shrink(frame))
        return (Path(folder) / Format.MP4.file).read_bytes(), size


# ---- the page


def check_page(page: Path) -> None:
    """Raise InputError if no page can be written."""
    if page.is_dir() or page.suffix.lower() not in (".html", ".htm"):
        raise Message.NOT_PAGE_NAME.error("-o", f'"{page}"')
    check_writable(page.parent)


def write_study(
    study: Study,
    page: Path,
    report_backup: Callable[[Path], None] = lambda backup: None,
) -> Path:
    """Write the page and its key, and return the key's path.

    Files of another study are renamed to NAME~, and `report_backup` is called.
    """
    check_page(page)
    page.parent.mkdir(parents=True, exist_ok=True)
    key_path = page.with_name(f"{page.stem}.key.json")
    # The key comes first: a page without its key is worthless.
    write_with_backup(key_path, study.key.text().encode(), report_backup)
    write_with_backup(page, html(study).encode(), report_backup)
    return key_path


def html(study: Study) -> str:
    """Return the page, one file without network access."""
    scripts = []
    for part in SCRIPTS:
        path = resource("templates", "study", f"{part}.js")
        scripts.append(path.read_text(encoding="utf-8"))
    videos = []
    for clip in study.clips:
        videos.append((clip.name, base64.b64encode(clip.video).decode("ascii")))
    page: str = template("study.html.j2").render(
        title=TITLE,
        count=len(study.clips),
        questions=QUESTIONS,
        scale=SCALE,
        words=bool(study.words),
        photos=bool(study.photos),
        films=videos,
        data=script_json(_page_data(study)),
        script='(() => {\n"use strict";\n' + "\n".join(scripts) + "})();",
    )
    return page


def _page_data(study: Study) -> dict[str, Any]:
    """Return the data of the page's script.

    Scenes are numbers in the order of the clips: names would reveal them.
    """
    scenes = list(dict.fromkeys(clip.scene for clip in study.clips))
    clips = []
    for clip in study.clips:
        number = scenes.index(clip.scene)
        clips.append({"name": clip.name, "scene": number, "size": clip.size})
    scene_records = []
    for scene in scenes:
        photo = study.photos.get(scene, "")
        words = study.words.get(scene, "")
        scene_records.append({"photo": photo, "words": words})
    return {
        "form": ANSWERS,
        "version": VERSION,
        "study": study.key.study,
        "questions": [{"key": q.key, "claim": q.claim} for q in QUESTIONS],
        "clips": clips,
        "scenes": scene_records,
    }
