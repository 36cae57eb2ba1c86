"""A CSV of `frame or time, name, x, y[, angle][, radius | width, height]` -> tracks. px, image axes; s."""

from __future__ import annotations

import csv
from math import isfinite, radians
from pathlib import Path

import numpy as np

from physgen.evaluate.plausibility.reading.asked import FPS, Asked, Row, frames_of, from_rows, title
from physgen.evaluate.plausibility.tracks import Tracks
from physgen.problems import InputError, Place, Problem

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
"""px: nobody writes places more exactly than that who has measured them."""
FARTHEST = 1e6
"""px."""
MOST = 20
"""Problems told of one file."""


def from_csv(path: Path, asked: Asked) -> Tracks:
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
        raise InputError.of(str(path), "", "has no tracks", "write a line a frame and thing")
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
        name = str(line[columns["name"]] or "") if "name" in columns else "thing"
        moments.append(values.get("frame", values.get("time", np.nan)))
        rows.append(_row(name, values))
    if problems:
        raise InputError(problems[:MOST])
    if "frame" in columns:
        first = min(moments)
        frames, fps = [round(m - first) for m in moments], asked.fps or FPS
    else:
        frames, fps = frames_of(np.array(moments), str(path))
    said = "" if "frame" not in columns or asked.fps else ", 30 frames a second assumed"
    return from_rows(title(path), frames, rows, fps, SHAKE, f"a table{said}", asked)


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
