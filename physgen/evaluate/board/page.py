"""Methods, scenes and scores -> a folder with one page: a table, and clips of each scene in a row, in step."""

from __future__ import annotations

import base64
import json
import shlex
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from physgen import __version__
from physgen.evaluate.board.scores import Score, told
from physgen.evaluate.board.screened import Screened, readable, screened
from physgen.evaluate.measure import PAGE, RESULT, Findings
from physgen.evaluate.methods import Entry, Methods
from physgen.files import back_up, resource, write_atomic
from physgen.photos import read_photo
from physgen.problems import InputError
from physgen.report.films import SIDE, strip_columns, strip_frames
from physgen.report.gallery import link, sweep_files
from physgen.report.html import script_json, template, webp

Progress = Callable[[str, int, int], None]
FILES = "index.files"
GALLERY, OWN = ("state", "shots", "clock"), ("table", "page")
"""Of the script: the gallery's, which run films in step, and the board's own."""
QUALITY = 85
MOST_SCORES = 4
"""Under a clip."""


@dataclass(frozen=True)
class Films:
    """What can be shown, and why the rest cannot."""

    clips: Mapping[tuple[str, str], Screened]
    broken: dict[tuple[str, str], str]


@contextmanager
def whole(folder: Path | None) -> Iterator[None]:
    """Where what is done within fails or is stopped, no files without a page are left in `folder`."""
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


def films(methods: Methods, folder: Path | None, single: bool, progress: Progress) -> Films:
    """Decodes every clip; posters, strips and films that had to be made go to `index.files` in `folder`.

    Without a folder clips are decoded alone, to know which can be.
    """
    clips, broken = {}, {}
    entries = [entry for entry in methods.entries.values() if entry.film is not None]
    for done, entry in enumerate(entries):
        progress("clips", done, len(entries))
        try:
            if folder is None:
                readable(entry)
            else:
                clips[entry.method, entry.scene] = screened(entry, folder / FILES, single)
        except InputError as error:
            problem = error.problems[0]
            text = " ".join(part for part in (problem.found, problem.expected) if part)
            broken[entry.method, entry.scene] = f"{Path(problem.place.file.partition(': ')[0]).name} {text}"
    return Films(clips, broken)


def write_board(
    methods: Methods,
    scores: Sequence[Score],
    made: Films,
    findings: Findings,
    folder: Path,
    title: str,
    command: Sequence[str],
    single: bool = False,
    keep: Callable[[Path], None] = lambda kept: None,
) -> Path:
    """`index.html` and `result.json`; those of an earlier run are replaced, a page of somebody else's is set aside."""
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / PAGE).exists() and not (folder / RESULT).exists():
        back_up(folder / PAGE, keep)
    write_atomic(folder / PAGE, html(methods, scores, made, folder, title, command, single).encode())
    data = json.dumps(findings.as_dict(), indent=1, ensure_ascii=False, allow_nan=False)
    write_atomic(folder / RESULT, data.encode())
    used = {
        Path(path).name for c in made.clips.values() for path in (c.shot.poster, c.shot.strip, c.film) if path
    }
    sweep_files(folder / FILES, set() if single else used)
    return folder / PAGE


def html(
    methods: Methods,
    scores: Sequence[Score],
    made: Films,
    folder: Path,
    title: str,
    command: Sequence[str],
    single: bool = False,
) -> str:
    """Addresses of films are relative to `folder`."""
    clips = list(made.clips.values())
    number = {(clip.entry.method, clip.entry.scene): k for k, clip in enumerate(clips)}
    data = {
        "clips": [_told(clip, folder, single) for clip in clips],
        "keys": [],
        "grid": False,
        "single": single,
    }
    scripts = [resource("templates", "gallery", f"{part}.js") for part in GALLERY]
    scripts += [resource("templates", "board", f"{part}.js") for part in OWN]
    page: str = template("board.html.j2").render(
        title=title,
        methods=methods.names,
        heads=[{"name": score.name, "better": score.better} for score in scores],
        standing=[_standing(methods, made, scores, name) for name in methods.names],
        rows=[_row(methods, made, scores, scene, number, folder, single) for scene in methods.scenes],
        photos=bool(methods.photos),
        films=[
            {"number": k, "data": base64.b64encode(clip.data).decode("ascii"), "strip": clip.shot.strip}
            for k, clip in enumerate(clips)
        ]
        if single
        else [],
        data=script_json(data),
        script='(() => {\n"use strict";\n'
        + "\n".join(s.read_text(encoding="utf-8") for s in scripts)
        + "})();",
        command=shlex.join(command),
        version=__version__,
    )
    return page


def _told(clip: Screened, folder: Path, single: bool) -> dict[str, Any]:
    """What the script knows of it, as a gallery's script has it."""
    return {
        "name": f"{clip.entry.method}, {clip.entry.scene}",
        "made": True,
        "fps": clip.fps,
        "frames": clip.frames,
        "shown": strip_frames(clip.frames),
        "across": strip_columns(clip.frames),
        "strip": clip.shot.strip and ("held" if single else clip.shot.strip),
        "film": "" if single else link(clip.film, folder),
        "kind": "video/mp4",
    }


def _standing(methods: Methods, made: Films, scores: Sequence[Score], name: str) -> dict[str, Any]:
    """A line of the table."""
    cells = []
    for score in scores:
        value = score.of(name)
        cells.append({"text": told(value), "value": value, "best": name in score.best(methods.names)})
    there = sum((name, scene) in made.clips for scene in methods.scenes)
    return {"name": name, "clips": there, "of": len(methods.scenes), "cells": cells}


def _row(
    methods: Methods,
    made: Films,
    scores: Sequence[Score],
    scene: str,
    number: Mapping[tuple[str, str], int],
    folder: Path,
    single: bool,
) -> dict[str, Any]:
    """A scene: a cell a method, whatever became of it."""
    cells = []
    for k, name in enumerate(methods.names):
        pair = name, scene
        entry, clip = methods.entries.get(pair), made.clips.get(pair)
        why = entry.problems if entry else ()
        cells.append(
            {
                "method": k,
                "name": name,
                "number": number.get(pair),
                "poster": clip.shot.poster if clip else "",
                "size": clip.size if clip else (4, 3),
                "seconds": f"{clip.frames / clip.fps:.3g}\u00a0s" if clip else "",
                "why": (made.broken[pair],) if pair in made.broken else why,
                "missing": entry is None,
                "href": _report(entry, folder) if entry and not single else "",
                "scores": [(s.name, told(s.clips[pair])) for s in scores if pair in s.clips][:MOST_SCORES],
            }
        )
    sizes = [made.clips[name, scene].size for name in methods.names if (name, scene) in made.clips]
    wide, high = sizes[0] if sizes else (4, 3)
    return {
        "scene": scene,
        "cells": cells,
        "words": methods.words.get(scene, ""),
        "photo": _photo(methods.photos[scene]) if scene in methods.photos else "",
        "aspect": f"{wide} / {high}",
    }


def _report(entry: Entry, folder: Path) -> str:
    return link(entry.report, folder) if entry.report else ""


def _photo(path: Path) -> str:
    """A data URI; empty where it cannot be read."""
    try:
        rgb = read_photo(path).rgb
    except InputError:
        return ""
    part = min(SIDE / max(rgb.shape[:2]), 1)
    size = max(round(rgb.shape[1] * part), 1), max(round(rgb.shape[0] * part), 1)
    return webp(np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8), QUALITY)
