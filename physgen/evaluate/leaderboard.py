"""Methods side by side: a table with scores of other measures, and a page with the clips of each scene in step.

Scores are read from `result.json` files that lie beside the clips. A row names its method by `method`; one of a
single clip names its scene by `scene`.
"""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import quote

from physgen import __version__
from physgen.evaluate.measure import RESULT, Findings, Progress, Section, Table, counted, write_files
from physgen.evaluate.methods import Methods, read_clip, within
from physgen.export.video import Format, open_video
from physgen.files import resource, write_atomic
from physgen.photos import read_photo
from physgen.problems import InputError
from physgen.report.html import template, webp
from physgen.text import natural
from physgen.videos import plays_anywhere

OWN = "leaderboard"
FILES = "index.files"
"""Folder for films that were made for the page."""
SIDE, QUALITY = 640, 85
"""px of a photo's longer side, and its WebP's quality."""
NO_SCORES = {
    "low", "high", "counts", "count", "answers", "clips", "frames", "pairs", "seed", "row", "rank", "passed", "number",
}  # fmt: skip
"""Names of numbers that are no scores."""
NO_ENDINGS = ("_95", "_more", "_sure", "_low", "_high", "_count")
LOWER = {"fid", "error", "distance", "alde", "seconds", "lpips"}
HIGHER = {
    "physical", "photo", "psnr", "ssim", "iou", "precision", "recall", "plausible", "plausibility", "score",
}  # fmt: skip
"""Words in names of scores of which less, or more, is better."""
MOST_SCORES, UNDER_CLIP = 5, 4
"""In the terminal's table, and under a clip; the page's table and the JSON have all."""


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
    """From `ANY/result.json` in the methods' folder, and from the files or folders `more`.

    Raises InputError where one of these is no result; other files in the methods' folder are left out.
    """
    found: dict[str, Score] = {}
    for path in sorted(methods.folder.glob(f"*/{RESULT}"), key=lambda path: natural(str(path))):
        _add(found, _read(path), methods)
    for path in more:
        record = _read(path / RESULT if path.is_dir() else path)
        if not record:
            fix = f"name a {RESULT} that physgen evaluate -o DIR wrote, or its folder"
            raise InputError.of("--scores", f'"{path}"', "is no result of a measure", fix)
        if not _add(found, record, methods):
            fix = f'give its rows "method", one of {", ".join(methods.names[:4])}'
            raise InputError.of("--scores", f'"{path}"', "has no number of any of these methods", fix)
    return list(found.values())


def _read(path: Path) -> Mapping[str, Any]:
    """Empty where it is no result of another measure."""
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(record, dict) or not isinstance(record.get("rows"), list):
        return {}
    return record if isinstance(record.get("measure"), str) and record["measure"] != OWN else {}


def _add(found: dict[str, Score], record: Mapping[str, Any], methods: Methods) -> bool:
    """Whether there was a number."""
    any_number = False
    for row in record.get("rows", ()):
        if not isinstance(row, dict) or row.get("method") not in methods.names:
            continue
        method, scene = row["method"], row.get("scene") if row.get("scene") in methods.scenes else None
        for name, value in _numbers(row):
            label = f"{record['measure'][:40]}: {name}"
            label += " (not comparable)" if record.get("comparable") is False else ""
            words = set(name.lower().split())
            better = "low" if words & LOWER else "high" if words & HIGHER else ""
            score = found.setdefault(label, Score(label, better))
            if scene is None:
                score.methods.setdefault(method, value)
            else:
                score.clips.setdefault((method, scene), value)
            any_number = True
    return any_number


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
class Film:
    """A clip that every browser plays."""

    path: Path
    size: tuple[int, int]
    """Width and height, px."""
    fps: float
    frames: int


@dataclass(frozen=True)
class Board:
    """Methods with their scores, what can be shown, and why the rest cannot."""

    methods: Methods
    scores: Sequence[Score]
    films: Mapping[tuple[str, str], Film]
    failures: Mapping[tuple[str, str], str]


def make_board(methods: Methods, scores: Sequence[Score], folder: Path | None, progress: Progress) -> Board:
    """Reads every clip; films that have to be made for browsers go to `index.files` in `folder`, if there is one."""
    films, failures = {}, dict(methods.failures)
    for done, (pair, path) in enumerate(methods.films.items()):
        progress("clips", done, len(methods.films))
        try:
            films[pair] = _film(path, folder)
        except InputError as error:
            problem = error.problems[0]
            failures[pair] = " ".join(part for part in (path.name, problem.found, problem.expected) if part)
    return Board(methods, scores, films, failures)


def _film(path: Path, folder: Path | None) -> Film:
    """Raises InputError for what is no video."""
    clip, fps = read_clip(path)
    film = path
    if folder is not None and not (path.suffix == ".mp4" and plays_anywhere(path)):
        film = folder / FILES / f"{sha256(path.read_bytes()).hexdigest()[:20]}.film.mp4"
        if not film.is_file():
            with TemporaryDirectory() as place:
                with open_video(Path(place), Format.MP4, clip.size, fps) as write:
                    for frame in clip.frames:
                        write(frame)
                film.parent.mkdir(parents=True, exist_ok=True)
                write_atomic(film, (Path(place) / Format.MP4.file).read_bytes())
    return Film(film, clip.size, fps, len(clip.frames))


# ---- report ------------------------------------------------------------------------------------------------------


def findings(board: Board) -> Findings:
    """The table of methods."""
    methods, scores, failures = board.methods, board.scores, board.failures
    rows: list[dict[str, Any]] = []
    for name in methods.names:
        failed = [scene for scene in methods.scenes if (name, scene) in failures]
        made = [scene for scene in methods.scenes if (name, scene) in board.films]
        own = {
            s: {one.name: one.clips[name, s] for one in scores if (name, s) in one.clips}
            for s in methods.scenes
        }
        rows.append(
            {
                "method": name,
                "clips": len(made),
                "failed": failed,
                "missing": [scene for scene in methods.scenes if scene not in (*failed, *made)],
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
            word, value = "lowest" if score.better == "low" else "highest", four_digits(score.of(best[0]))
            sentences.append(f"{score.name}: {' and '.join(best)} {word}, {value}.")
    if not scores:
        sentences.append("No scores lie beside the clips: physgen evaluate MEASURE -o DIR makes some.")
    more = {
        "scenes": list(methods.scenes),
        "scores": [{"name": score.name, "better": score.better or None} for score in scores],
    }
    return Findings(OWN, "Leaderboard", tuple(sentences), tuple(sections), rows, more=more)


def write_board(
    board: Board, folder: Path, title: str, command: Sequence[str], keep: Callable[[Path], None]
) -> Path:
    """`index.html` and `result.json`; those of an earlier run are replaced, a page of another origin is set aside."""
    page = write_files(findings(board), html(board, folder, title, command), folder, keep)
    used = {film.path.name for film in board.films.values()}
    for path in (folder / FILES).glob("*.film.mp4"):
        if path.name not in used:
            path.unlink()
    return page


def html(board: Board, folder: Path, title: str, command: Sequence[str]) -> str:
    """Addresses of films are relative to `folder`."""
    methods = board.methods
    scripts = (
        resource("templates", "board", f"{part}.js").read_text(encoding="utf-8") for part in ("table", "page")
    )
    standing = []
    for name in methods.names:
        values = [(score.of(name), name in score.best(methods.names)) for score in board.scores]
        cells = [{"text": four_digits(value), "value": value, "best": best} for value, best in values]
        there = sum((name, scene) in board.films for scene in methods.scenes)
        standing.append({"name": name, "clips": there, "of": len(methods.scenes), "cells": cells})
    page: str = template("board.html.j2").render(
        title=title,
        methods=methods.names,
        heads=[{"name": score.name, "better": score.better} for score in board.scores],
        standing=standing,
        rows=[_scene_row(board, scene, folder) for scene in methods.scenes],
        photos=bool(methods.photos),
        script='(() => {\n"use strict";\n' + "\n".join(scripts) + "})();",
        command=shlex.join(command),
        version=__version__,
    )
    return page


def _scene_row(board: Board, scene: str, folder: Path) -> dict[str, Any]:
    """A scene: a cell a method, with its clip or the reason why there is none."""
    methods = board.methods
    cells: list[dict[str, Any]] = []
    for name in methods.names:
        pair = name, scene
        film = board.films.get(pair)
        scores = [(s.name, four_digits(s.clips[pair])) for s in board.scores if pair in s.clips]
        cell: dict[str, Any] = {
            "name": name,
            "film": "",
            "why": board.failures.get(pair, ""),
            "scores": scores[:UNDER_CLIP],
        }
        if film is not None:
            address = Path(os.path.relpath(film.path.absolute(), folder.absolute())).as_posix()
            cell |= {
                "film": quote(address),
                "size": film.size,
                "fps": film.fps,
                "seconds": film.frames / film.fps,
            }
        cells.append(cell)
    photo = ""
    if scene in methods.photos:
        try:
            photo = webp(within(read_photo(methods.photos[scene]).rgb, SIDE), QUALITY)
        except InputError:  # the row stands without it
            photo = ""
    size = next((cell["size"] for cell in cells if "size" in cell), (4, 3))
    words = methods.words.get(scene, "")
    return {
        "scene": scene,
        "cells": cells,
        "words": words,
        "photo": photo,
        "aspect": f"{size[0]} / {size[1]}",
    }
