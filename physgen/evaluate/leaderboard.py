"""Methods side by side: a table with scores of other measures, and a page with the clips of each scene in step.

Scores are read from `result.json` files that lie beside the clips. A row says its method by `method`, and its scene
by `scene`, `clip`, `video` or `name`; where it does not, the folder that the file lies in does.
"""

from __future__ import annotations

import base64
import json
import shlex
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from hashlib import sha256
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from physgen import __version__
from physgen.evaluate.measure import RESULT, Findings, Progress, Section, Table, counted, write_files
from physgen.evaluate.methods import Entry, Methods, read_clip, within
from physgen.export.video import Format, open_video
from physgen.files import resource, write_atomic
from physgen.photos import read_photo
from physgen.problems import InputError
from physgen.report import clips
from physgen.report.films import SIDE, strip_columns, strip_frames
from physgen.report.gallery import ClipPictures, clip_pictures, link, sweep_files
from physgen.report.html import script_json, template, webp
from physgen.text import natural
from physgen.videos import plays_anywhere

OWN = "leaderboard"
FILES = "index.files"
SCRIPTS = (("gallery", ("state", "shots", "clock")), ("board", ("table", "page")))
"""The gallery's, which run films in step, and the page's own."""
QUALITY = 85
"""Of a photo's WebP."""
SCENE_KEYS = ("scene", "clip", "video", "name")
NO_SCORES = {
    "low", "high", "counts", "count", "answers", "clips", "frames", "pairs", "seed", "row", "rank", "passed", "number",
}  # fmt: skip
"""Names of numbers that are no scores."""
NO_ENDINGS = ("_95", "_more", "_sure", "_low", "_high", "_count")
LOWER = {"fid", "kid", "error", "distance", "alde", "seconds", "lpips"}
HIGHER = {
    "physical", "photo", "psnr", "ssim", "iou", "precision", "recall", "plausible", "plausibility", "score",
}  # fmt: skip
"""Words in names of scores of which less, or more, is better."""
MOST_BYTES = 50_000_000
MOST_SCORES = 5
"""In the terminal's table; the page and the JSON have all."""
UNDER_CLIP = 4
"""Scores under a clip."""


# ---- scores ------------------------------------------------------------------------------------------------------


@dataclass
class Score:
    """One number of one measure."""

    name: str
    """Measure and number."""
    better: str
    """`low`, `high`, or empty where it is not known."""
    methods: dict[str, float] = field(default_factory=dict)
    """Of a method as a whole."""
    clips: dict[tuple[str, str], float] = field(default_factory=dict)
    """(method, scene) -> of one clip."""

    def of(self, method: str) -> float | None:
        """Of the method, or the mean of its clips."""
        if method in self.methods:
            return self.methods[method]
        own = [value for (name, _), value in self.clips.items() if name == method]
        return sum(own) / len(own) if own else None

    def best(self, names: Sequence[str]) -> set[str]:
        """The best as shown; empty where one alone is known, all are equal, or the better direction is not known."""
        known = {name: float(four_digits(value)) for name in names if (value := self.of(name)) is not None}
        if "kid" in self.name.split():  # below 0 by chance, and no better than 0
            known = {name: max(value, 0.0) for name, value in known.items()}
        if not self.better or len(set(known.values())) < 2:
            return set()
        top = min(known.values()) if self.better == "low" else max(known.values())
        return {name for name, value in known.items() if value == top}


def four_digits(value: float | None) -> str:
    """A cell.

    >>> [four_digits(value) for value in (105.7012, 0.93, 4.0, 123456.7, 3e-14, None)]
    ['105.7', '0.9300', '4.000', '123457', '0', '-']
    """
    if value is None:
        return "-"
    if abs(value) < 1e-9:
        return "0"
    if 1e-4 <= abs(value) < 1e4:
        return f"{value:#.4g}".rstrip(".")
    return f"{value:.0f}" if abs(value) > 1 else f"{value:.3g}"


def scores_of(methods: Methods, more: Sequence[Path] = ()) -> list[Score]:
    """From all results in the methods' folder, and from the files or folders `more`.

    Raises InputError where one of these is no result; other files in the methods' folder are left out.
    """
    found: dict[str, Score] = {}
    for path, method, scene in _places(methods):
        if record := _read(path):
            _add(found, record, methods, method, scene)
    for path in more:
        record = _read(path / RESULT if path.is_dir() else path)
        if not record:
            fix = f"name a {RESULT} that physgen evaluate -o DIR wrote, or its folder"
            raise InputError.of("--scores", f'"{path}"', "is no result of a measure", fix)
        if not _add(found, record, methods, None, None):
            fix = f'give its rows "method", one of {", ".join(methods.names[:4])}'
            raise InputError.of("--scores", f'"{path}"', "has no number of any of these methods", fix)
    return [score for score in found.values() if score.methods or score.clips]


def _places(methods: Methods) -> Iterator[tuple[Path, str | None, str | None]]:
    """Every result with the method and the scene of its folder, the whole before its parts."""

    def inside(folder: Path) -> list[Path]:
        return sorted(
            (path for path in folder.iterdir() if path.is_dir()), key=lambda path: natural(path.name)
        )

    yield methods.folder / RESULT, None, None
    for home in inside(methods.folder):
        if home.name.startswith("."):
            continue
        method = home.name if home.name in methods.names else None
        yield home / RESULT, method, None
        for folder in inside(home) if method else ():
            scene = folder.name if (method, folder.name) in methods.entries else None
            yield folder / RESULT, method, scene
            for inner in sorted(folder.glob(f"*/{RESULT}")) if scene else ():
                yield inner, method, scene


def _read(path: Path) -> Mapping[str, Any]:
    """Empty where it is no result of another measure."""
    try:
        if not path.is_file() or path.stat().st_size > MOST_BYTES:
            return {}
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(record, dict) or not isinstance(record.get("rows"), list):
        return {}
    return record if isinstance(record.get("measure"), str) and record["measure"] != OWN else {}


def _add(
    found: dict[str, Score],
    record: Mapping[str, Any],
    methods: Methods,
    method: str | None,
    scene: str | None,
) -> bool:
    """Whether there was a number."""
    measure, any_number = str(record["measure"])[:40], False
    rows = [row for row in record["rows"] if isinstance(row, dict)]
    for row in rows:
        owner = method or (row.get("method") if row.get("method") in methods.names else None)
        which = scene or _scene(row, methods)
        if owner is None or (which is None and len(rows) > 1 and method is not None):
            continue  # several rows of one method, none of which is all of it
        if scene is not None and len(rows) > 1:
            continue  # parts of one clip
        for name, value in _numbers(row):
            label = f"{measure}: {name}" + (" (not comparable)" if record.get("comparable") is False else "")
            words = set(name.lower().split())
            score = found.setdefault(
                label, Score(label, "low" if words & LOWER else "high" if words & HIGHER else "")
            )
            any_number = True
            if which is None:
                score.methods.setdefault(owner, value)
            else:
                score.clips.setdefault((owner, which), value)
    return any_number


def _scene(row: Mapping[str, Any], methods: Methods) -> str | None:
    """By its name, or by its file's."""
    for key in SCENE_KEYS:
        value = row.get(key)
        if isinstance(value, str):
            for name in (value, Path(value).stem, Path(value).parent.name):
                if name in methods.scenes:
                    return name
    return None


def _numbers(row: Mapping[str, Any], before: str = "", depth: int = 3) -> Iterator[tuple[str, float]]:
    """Scores by name; a truth value counts as 0 or 1."""
    for key, value in row.items():
        name = str(key)
        if name in NO_SCORES or name.endswith(NO_ENDINGS) or len(name) > 60:
            continue
        path = before if name == "mean" and before else f"{before} {name}".strip().replace("_", " ")
        if isinstance(value, dict) and depth:
            yield from _numbers(value, path, depth - 1)
        elif isinstance(value, bool | int | float) and isfinite(value):
            yield path, float(value)


# ---- clips -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Screened:
    """A clip that a page can play in step with others."""

    entry: Entry
    film: Path
    """An MP4: the clip itself, or one made of it that every browser plays."""
    data: bytes
    """The same, where the page is to carry it."""
    pictures: ClipPictures
    """Poster and strip."""
    size: tuple[int, int]
    fps: float
    frames: int


def screened(entry: Entry, files: Path, single: bool) -> Screened:
    """Films, posters and strips go to `files`, unless they go into a `single` file. Raises InputError."""
    path = entry.film
    assert path is not None
    clip, fps = read_clip(path)
    seal = sha256(path.read_bytes()).hexdigest()[:20]

    def of(film: Path) -> Screened:
        count = len(clip.frames)
        known = clips.Clip(
            film.parent, entry.scene, size=clip.size, fps=fps, frames=count, film=film, seal=seal
        )
        data = film.read_bytes() if single else b""
        return Screened(entry, film, data, clip_pictures(known, files, single), clip.size, fps, count)

    if path.suffix == ".mp4" and plays_anywhere(path):
        return of(path)
    film = files / f"{seal}.film.mp4"
    if single or not film.is_file():
        with TemporaryDirectory() as place:
            made = Path(place) / Format.MP4.file
            with open_video(made.parent, Format.MP4, clip.size, fps) as write:
                for frame in clip.frames:
                    write(frame)
            if single:
                return of(made)
            files.mkdir(parents=True, exist_ok=True)
            write_atomic(film, made.read_bytes())
    return of(film)


@dataclass(frozen=True)
class Board:
    """Methods with their scores, what can be shown, and why the rest cannot."""

    methods: Methods
    scores: Sequence[Score]
    clips: Mapping[tuple[str, str], Screened]
    broken: Mapping[tuple[str, str], str]

    @property
    def failures(self) -> dict[tuple[str, str], str]:
        """(method, scene) -> why there is no clip."""
        failed = {pair: entry.problems[0] for pair, entry in self.methods.entries.items() if entry.problems}
        return {**failed, **self.broken}


def make_board(
    methods: Methods, scores: Sequence[Score], folder: Path | None, single: bool, progress: Progress
) -> Board:
    """Decodes every clip; posters, strips and films that had to be made go to `index.files` in `folder`.

    Without a folder clips are decoded alone, to know which can be.
    """
    shown, broken = {}, {}
    entries = [entry for entry in methods.entries.values() if entry.film is not None]
    for done, entry in enumerate(entries):
        assert entry.film is not None
        progress("clips", done, len(entries))
        try:
            if folder is None:
                read_clip(entry.film)
            else:
                shown[entry.method, entry.scene] = screened(entry, folder / FILES, single)
        except InputError as error:
            problem = error.problems[0]
            text = " ".join(part for part in (problem.found, problem.expected) if part)
            broken[entry.method, entry.scene] = f"{Path(problem.place.file.partition(': ')[0]).name} {text}"
    return Board(methods, scores, shown, broken)


@contextmanager
def cleaned_on_failure(folder: Path | None) -> Iterator[None]:
    """Where the body fails or is stopped, no files without a page are left in `folder`."""
    there = [] if folder is None else [folder, folder / FILES]
    made = [path for path in there if not path.exists()]
    try:
        yield
    except BaseException:
        for path in reversed(made):
            if path.name == FILES:
                shutil.rmtree(path, ignore_errors=True)
            else:
                with suppress(OSError):
                    path.rmdir()
        raise


# ---- report ------------------------------------------------------------------------------------------------------


def findings(board: Board) -> Findings:
    """The table of methods."""
    methods, scores, failures = board.methods, board.scores, board.failures
    rows: list[dict[str, Any]] = []
    for name in methods.names:
        failed = [scene for scene in methods.scenes if (name, scene) in failures]
        missing = [scene for scene in methods.scenes if (name, scene) not in methods.entries]
        own = {
            scene: {s.name: s.clips[name, scene] for s in scores if (name, scene) in s.clips}
            for scene in methods.scenes
        }
        rows.append(
            {
                "method": name,
                "clips": len(methods.scenes) - len(failed) - len(missing),
                "failed": failed,
                "missing": missing,
                "scores": {score.name: score.of(name) for score in scores},
                "by_scene": {scene: some for scene, some in own.items() if some},
            }
        )
    first = scores[:MOST_SCORES]
    cells = tuple(
        (
            row["method"], str(row["clips"]), str(len(row["failed"])), str(len(row["missing"])),
            *(four_digits(score.of(row["method"])) for score in first),
        )
        for row in rows
    )  # fmt: skip
    left = len(scores) - len(first)
    note = f"{counted(left, 'score')} more: --json has all, and so has the page." if left else ""
    heads = ("method", "clips", "failed", "missing", *(score.name for score in first))
    sections = [Section("Methods", (), (Table(heads, cells, note=note),))]
    if failures:
        lines = tuple(sorted((name, scene, why) for (name, scene), why in failures.items()))
        sections.append(Section("What failed", (), (Table(("method", "scene", "why"), lines),)))
    sentences = [f"{counted(len(methods.names), 'method')}, {counted(len(methods.scenes), 'scene')}."]
    for score in first:
        if best := [name for name in methods.names if name in score.best(methods.names)]:
            word = "lowest" if score.better == "low" else "highest"
            values = dict.fromkeys(four_digits(score.of(name)) for name in best)
            sentences.append(f"{score.name}: {' and '.join(best)} {word}, {' and '.join(values)}.")
    if not scores:
        sentences.append("No scores lie beside the clips: physgen evaluate MEASURE -o DIR makes some.")
    more = {
        "scenes": list(methods.scenes),
        "scores": [{"name": score.name, "better": score.better or None} for score in scores],
    }
    return Findings(OWN, "Leaderboard", tuple(sentences), tuple(sections), rows, more=more)


def write_board(
    board: Board,
    findings: Findings,
    folder: Path,
    title: str,
    command: Sequence[str],
    single: bool = False,
    keep: Callable[[Path], None] = lambda kept: None,
) -> Path:
    """`index.html` and `result.json`; those of an earlier run are replaced, a page of another origin is set aside."""
    page = write_files(findings, html(board, folder, title, command, single), folder, keep)
    paths = (path for c in board.clips.values() for path in (c.pictures.poster, c.pictures.strip, c.film))
    used = {Path(path).name for path in paths if path}
    sweep_files(folder / FILES, set() if single else used)
    return page


def html(board: Board, folder: Path, title: str, command: Sequence[str], single: bool = False) -> str:
    """Addresses of films are relative to `folder`."""
    methods, shown = board.methods, list(board.clips.values())
    scripts = [resource("templates", home, f"{part}.js") for home, parts in SCRIPTS for part in parts]
    films = [
        {"number": k, "data": base64.b64encode(clip.data).decode("ascii"), "strip": clip.pictures.strip}
        for k, clip in enumerate(shown)
    ]
    data = {
        "clips": [_script_clip(clip, folder, single) for clip in shown],
        "keys": [],
        "grid": False,
        "single": single,
    }
    standing = []
    for name in methods.names:
        values = [(score.of(name), name in score.best(methods.names)) for score in board.scores]
        cells = [{"text": four_digits(value), "value": value, "best": best} for value, best in values]
        there = sum((name, scene) in board.clips for scene in methods.scenes)
        standing.append({"name": name, "clips": there, "of": len(methods.scenes), "cells": cells})
    page: str = template("board.html.j2").render(
        title=title,
        methods=methods.names,
        heads=[{"name": score.name, "better": score.better} for score in board.scores],
        standing=standing,
        rows=[_scene_row(board, scene, folder, single) for scene in methods.scenes],
        photos=bool(methods.photos),
        films=films if single else [],
        data=script_json(data),
        script='(() => {\n"use strict";\n'
        + "\n".join(s.read_text(encoding="utf-8") for s in scripts)
        + "})();",
        command=shlex.join(command),
        version=__version__,
    )
    return page


def _script_clip(clip: Screened, folder: Path, single: bool) -> dict[str, Any]:
    """A clip as a gallery's script has it."""
    strip = clip.pictures.strip
    return {
        "name": f"{clip.entry.method}, {clip.entry.scene}",
        "made": True,
        "fps": clip.fps,
        "frames": clip.frames,
        "shown": strip_frames(clip.frames),
        "across": strip_columns(clip.frames),
        "strip": strip and ("held" if single else strip),
        "film": "" if single else link(clip.film, folder),
        "kind": "video/mp4",
    }


def _scene_row(board: Board, scene: str, folder: Path, single: bool) -> dict[str, Any]:
    """A scene: a cell a method, with its clip or the reason why there is none."""
    methods, numbers = board.methods, {pair: k for k, pair in enumerate(board.clips)}
    cells = []
    for k, name in enumerate(methods.names):
        pair = name, scene
        entry, clip = methods.entries.get(pair), board.clips.get(pair)
        report = entry.report if entry else None
        cells.append(
            {
                "method": k,
                "name": name,
                "number": numbers.get(pair),
                "poster": clip.pictures.poster if clip else "",
                "size": clip.size if clip else (4, 3),
                "seconds": f"{clip.frames / clip.fps:.3g}\u00a0s" if clip else "",
                "why": (board.broken[pair],) if pair in board.broken else entry.problems if entry else (),
                "missing": entry is None,
                "href": link(report, folder) if report and not single else "",
                "scores": [(s.name, four_digits(s.clips[pair])) for s in board.scores if pair in s.clips][
                    :UNDER_CLIP
                ],
            }
        )
    wide, high = next(
        (board.clips[n, scene].size for n in methods.names if (n, scene) in board.clips), (4, 3)
    )
    photo = _photo(methods.photos[scene]) if scene in methods.photos else ""
    words = methods.words.get(scene, "")
    return {"scene": scene, "cells": cells, "words": words, "photo": photo, "aspect": f"{wide} / {high}"}


def _photo(path: Path) -> str:
    """A data URI; empty where it cannot be read."""
    try:
        rgb = read_photo(path).rgb
    except InputError:
        return ""
    return webp(within(rgb, SIDE), QUALITY)
