"""Methods side by side: a table with scores of fid and study, and a page with the clips of each scene in step.

Scores are read from `result.json` files of these measures that lie beside the clips; rows name methods by `method`.
"""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any
from urllib.parse import quote

from physgen import __version__
from physgen.evaluate.measure import RESULT, Findings, Progress, Section, Table, counted, write_files
from physgen.evaluate.methods import Methods, read_clip, within
from physgen.files import resource
from physgen.photos import read_photo
from physgen.problems import InputError
from physgen.report.html import template, webp
from physgen.text import natural
from physgen.videos import plays_anywhere

OWN = "leaderboard"
SIDE, QUALITY = 640, 85
"""px of a photo's longer side, and its WebP's quality."""
BETTER = {
    "fid": {"image_fid": "low", "motion_fid": "low"},
    "study": {"physical": "high", "photo": "high"},
}
"""Scores by measure and key of its rows, and which way is better."""


# ---- scores ------------------------------------------------------------------------------------------------------


@dataclass
class Score:
    """One number of one measure."""

    name: str
    """Measure and number."""
    better: str
    """`low` or `high`."""
    methods: dict[str, float] = field(default_factory=dict)

    def best(self, names: Sequence[str]) -> set[str]:
        """The best as shown; empty where one alone is known or all are equal."""
        known = {name: float(four_digits(self.methods[name])) for name in names if name in self.methods}
        if len(set(known.values())) < 2:
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


def scores_of(methods: Methods) -> list[Score]:
    """From `ANY/result.json` in the methods' folder; other files are left out."""
    found: dict[str, Score] = {}
    for path in sorted(methods.folder.glob(f"*/{RESULT}"), key=lambda path: natural(str(path))):
        try:
            record = json.loads(path.read_text(encoding="utf-8"))
            measure, rows = record["measure"], [(row["method"], row) for row in record["rows"]]
        except (OSError, ValueError, RecursionError, KeyError, TypeError):
            continue
        for key, better in BETTER.get(measure, {}).items():
            label = f"{measure}: {key.replace('_', ' ')}"
            label += " (not comparable)" if record.get("comparable") is False else ""
            for method, row in rows:
                value = row.get(key)
                value = value.get("mean") if isinstance(value, dict) else value
                if method in methods.names and isinstance(value, int | float) and isfinite(value):
                    score = found.setdefault(label, Score(label, better))
                    score.methods.setdefault(method, float(value))
    return list(found.values())


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


def make_board(methods: Methods, progress: Progress) -> Board:
    """Reads every clip."""
    films, failures = {}, dict(methods.failures)
    for done, (pair, path) in enumerate(methods.films.items()):
        progress("clips", done, len(methods.films))
        try:
            films[pair] = _film(path)
        except InputError as error:
            problem = error.problems[0]
            failures[pair] = " ".join(part for part in (path.name, problem.found, problem.expected) if part)
    return Board(methods, scores_of(methods), films, failures)


def _film(path: Path) -> Film:
    """Raises InputError for what is no video, or one that browsers do not play."""
    clip, fps = read_clip(path)
    if not (path.suffix == ".mp4" and plays_anywhere(path)):
        raise InputError.of(str(path), "", "is not played by all browsers", "save it as MP4 (H.264, yuv420p)")
    return Film(path, clip.size, fps, len(clip.frames))


# ---- report ------------------------------------------------------------------------------------------------------


def findings(board: Board) -> Findings:
    """The table of methods."""
    methods, scores, failures = board.methods, board.scores, board.failures
    rows: list[dict[str, Any]] = []
    for name in methods.names:
        failed = [scene for scene in methods.scenes if (name, scene) in failures]
        made = [scene for scene in methods.scenes if (name, scene) in board.films]
        rows.append(
            {
                "method": name,
                "clips": len(made),
                "failed": failed,
                "missing": [scene for scene in methods.scenes if scene not in (*failed, *made)],
                "scores": {score.name: score.methods.get(name) for score in scores},
            }
        )
    cells = tuple(
        (
            row["method"], str(row["clips"]), str(len(row["failed"])), str(len(row["missing"])),
            *(four_digits(score.methods.get(row["method"])) for score in scores),
        )
        for row in rows
    )  # fmt: skip
    heads = ("method", "clips", "failed", "missing", *(score.name for score in scores))
    sections = [Section("Methods", (), (Table(heads, cells),))]
    if failures:
        lines = tuple(sorted((name, scene, why) for (name, scene), why in failures.items()))
        sections.append(Section("What failed", (), (Table(("method", "scene", "why"), lines),)))
    sentences = [f"{counted(len(methods.names), 'method')}, {counted(len(methods.scenes), 'scene')}."]
    for score in scores:
        if best := [name for name in methods.names if name in score.best(methods.names)]:
            word, value = (
                "lowest" if score.better == "low" else "highest",
                four_digits(score.methods[best[0]]),
            )
            sentences.append(f"{score.name}: {' and '.join(best)} {word}, {value}.")
    if not scores:
        sentences.append("No scores lie beside the clips: evaluate fid and study make some, with -o DIR.")
    more = {
        "scenes": list(methods.scenes),
        "scores": [{"name": score.name, "better": score.better} for score in scores],
    }
    return Findings(OWN, "Leaderboard", tuple(sentences), tuple(sections), rows, more=more)


def write_board(board: Board, folder: Path, command: Sequence[str], keep: Callable[[Path], None]) -> Path:
    """`index.html` and `result.json`; those of an earlier run are replaced, a page of another origin is set aside."""
    return write_files(findings(board), html(board, folder, command), folder, keep)


def html(board: Board, folder: Path, command: Sequence[str]) -> str:
    """Addresses of films are relative to `folder`."""
    methods = board.methods
    scripts = (
        resource("templates", "board", f"{part}.js").read_text(encoding="utf-8") for part in ("table", "page")
    )
    standing = []
    for name in methods.names:
        values = [(score.methods.get(name), name in score.best(methods.names)) for score in board.scores]
        cells = [{"text": four_digits(value), "value": value, "best": best} for value, best in values]
        there = sum((name, scene) in board.films for scene in methods.scenes)
        standing.append({"name": name, "clips": there, "of": len(methods.scenes), "cells": cells})
    page: str = template("board.html.j2").render(
        title=methods.folder.resolve().name,
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
        cell: dict[str, Any] = {"name": name, "film": "", "why": board.failures.get(pair, "")}
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
