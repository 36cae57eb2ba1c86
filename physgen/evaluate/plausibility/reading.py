"""Readers of tracks: CSV and MOT here, other formats in array_tracks."""

from __future__ import annotations

import configparser
import csv
from collections.abc import Iterator
from math import hypot, isfinite, radians
from pathlib import Path

import numpy as np

from physgen.evaluate.plausibility.request import FPS, Request, Row, frames_of, from_rows, title
from physgen.evaluate.plausibility.tracks import Tracks
from physgen.problems import InputError, Place, Problem

FIX = "give a clip's folder, a scene file, a CSV, MOT's gt.txt, or a folder of PNG masks"


def read(path: Path, asked: Request) -> Iterator[Tracks]:
    """Every clip that a path holds. Raises InputError, which says what it is not."""
    if not path.exists():
        raise InputError.of(str(path), "", "is not there", FIX)
    if path.is_dir():
        yield from _folder(path, asked)
        return
    ending = path.suffix.lower()
    if ending in (".yaml", ".yml"):
        from physgen.evaluate.plausibility.array_tracks import from_scene

        yield from_scene(path)
    elif ending == ".csv":
        yield from_csv(path, asked)
    elif ending == ".txt":
        yield from_mot(path, asked)
    else:
        raise InputError.of(str(path), f'"{ending or path.name}"', "is no kind of tracks", FIX)


def _folder(path: Path, asked: Request) -> Iterator[Tracks]:
    from physgen.batch.clips import clip_folders
    from physgen.evaluate.plausibility.array_tracks import from_pictures, pictures_in

    for name in ("gt.txt", "gt/gt.txt", "scene.yaml"):
        if (path / name).is_file():
            yield from read(path / name, asked)
            return
    if not (path / "manifest.json").exists() and pictures_in(path):
        yield from_pictures(path, asked)
        return
    try:
        folders = clip_folders([path])
    except InputError:
        raise InputError.of(str(path), "", "holds no clip and no tracks", FIX) from None
    from physgen.evaluate.plausibility.array_tracks import from_clip

    for folder in folders:
        yield from_clip(folder)


NAMES = {
    "frame": ("frame", "frame_index", "frame_id", "image_id"),
    "time": ("time", "time_s", "t", "seconds"),
    "name": ("name", "object", "id", "track", "track_id", "label"),
    "x": ("x", "x_px", "cx", "center_x"),
    "y": ("y", "y_px", "cy", "center_y"),
    "angle": ("angle", "angle_rad"),
    "degrees": ("angle_deg", "degrees"),
    "radius": ("radius", "r", "radius_px"),
    "width": ("width", "w", "box_width"),
    "height": ("height", "h", "box_height"),
}
SHAKE = 0.05
"""px: no one writes places more exactly than that who has measured them."""
FARTHEST = 1e6
"""px."""
MOST = 20
"""Problems reported of one file."""


def from_csv(path: Path, asked: Request) -> Tracks:
    """Raises InputError for columns that are missing and numbers that are none, with their lines."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            lines, heads = list(reader), list(reader.fieldnames or [])
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError.of(
            str(path), "", f"cannot be read as CSV: {error}", "save it as UTF-8 with commas"
        ) from None
    columns = _columns(path, heads)
    if not lines:
        raise InputError.of(str(path), "", "has no tracks", "write a line a frame and body")
    problems: list[Problem] = []
    moments, rows = [], []
    for number, line in enumerate(lines, 2):
        values = {}
        for key, column in columns.items():
            if key == "name":
                continue
            try:
                values[key] = float(line[column] or "nan")
            except (TypeError, ValueError):
                values[key] = np.nan
            wrong = _wrong(key, values[key], bool((line[column] or "").strip()))
            if wrong:
                found = f'"{(line[column] or "")[:40]}"'
                problems.append(Problem(Place(str(path), number, 1), column, found, *wrong))
        name = str(line[columns["name"]] or "") if "name" in columns else "body"
        moments.append(values.get("frame", values.get("time", np.nan)))
        rows.append(_row(name, values))
    if problems:
        raise InputError(problems[:MOST])
    if "frame" in columns:
        first = min(moments)
        frames, fps = [round(m - first) for m in moments], asked.fps or FPS
    else:
        frames, fps = frames_of(np.array(moments), str(path))
    assumed = "" if "frame" not in columns or asked.fps else ", 30 frames a second assumed"
    return from_rows(title(path), frames, rows, fps, SHAKE, f"a table{assumed}", asked)


def _columns(path: Path, heads: list[str]) -> dict[str, str]:
    known = {head.strip().lower(): head for head in heads if head}
    found = {key: known[name] for key, names in NAMES.items() for name in reversed(names) if name in known}
    missing = [key for key in ("x", "y") if key not in found]
    if "frame" not in found and "time" not in found:
        missing.insert(0, "frame or time")
    if missing:
        fix = "begin with a line such as frame,name,x,y,angle,radius"
        raise InputError.of(str(path), f'columns "{", ".join(heads)}"', f"lack {', '.join(missing)}", fix)
    return found


def _wrong(key: str, value: float, written: bool) -> tuple[str, str] | None:
    """What is wrong with a cell, and its fix."""
    if key in ("frame", "time", "x", "y") and not isfinite(value):
        return "is no number", "write px, s"
    if key in ("x", "y") and abs(value) > FARTHEST:
        return f"is farther than {FARTHEST:g} px", "write px"
    if key == "frame" and not value.is_integer():
        return "is no whole number", "number frames, or give a column time in s"
    if key in ("radius", "width", "height") and written and not 0 < value <= FARTHEST:
        return "is no length in px above 0", "write px, or leave it empty"
    return None


def _row(name: str, values: dict[str, float]) -> Row:
    angle = values.get("angle", radians(values["degrees"]) if "degrees" in values else np.nan)
    radius, width, height = (values.get(key, np.nan) for key in ("radius", "width", "height"))
    core = reach = 0.0
    if isfinite(radius):
        core = reach = radius
    elif isfinite(width) and isfinite(height):
        core, reach = min(width, height) / 2, float(np.hypot(width, height)) / 2
    return Row(name, values.get("x", np.nan), values.get("y", np.nan), angle, core, reach)


FINE, WHOLE = 0.15, 0.4
"""px that middles of boxes shake, at least; of boxes in whole px."""


def from_mot(path: Path, asked: Request) -> Tracks:
    """Rows of confidence 0 are left out, as the challenge has it. Raises InputError with lines."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError.of(str(path), "", f"cannot be read: {error}", "give MOT's text") from None
    problems: list[Problem] = []
    frames, rows, whole = [], [], True
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            frame, one, left, top, width, height, *rest = (float(cell) for cell in line.split(","))
            if not (width > 0 and height > 0 and abs(left) < 1e7 and abs(top) < 1e7 and 0 <= frame < 1e7):
                raise ValueError
        except ValueError:
            fix = "write frame,id,left,top,width,height,confidence"
            problems.append(
                Problem(Place(str(path), number, 1), "", f'"{line[:60]}"', "is no row of MOT", fix)
            )
            continue
        if rest and rest[0] == 0:
            continue
        whole &= all(number == round(number) for number in (left, top, width, height))
        frames.append(int(frame))
        middle = left + width / 2 - 1.5, top + height / 2 - 1.5
        rows.append(Row(f"{one:g}", *middle, core=min(width, height) / 2, reach=hypot(width, height) / 2))
    if problems:
        raise InputError(problems[:MOST])
    fps = asked.fps or _rate(path)
    assumed = "" if fps else ", 30 frames a second assumed"
    first = min(frames, default=0)
    source = f"middles of boxes, MOT{assumed}"
    floor = WHOLE if whole else FINE
    return from_rows(title(path), [frame - first for frame in frames], rows, fps or FPS, floor, source, asked)


def _rate(path: Path) -> float | None:
    """1/s, as `seqinfo.ini` beside or above it says."""
    for folder in (path.parent, path.parent.parent):
        info = configparser.ConfigParser()
        try:
            info.read(folder / "seqinfo.ini", encoding="utf-8")
            return info.getfloat("Sequence", "frameRate")
        except (configparser.Error, ValueError, UnicodeDecodeError):
            continue
    return None
