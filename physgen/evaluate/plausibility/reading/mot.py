"""MOT Challenge's text -> tracks: `frame, id, left, top, width, height, ...`; the middles of boxes."""

from __future__ import annotations

import configparser
from math import hypot
from pathlib import Path

from physgen.evaluate.plausibility.reading.asked import FPS, Asked, Row, from_rows, title
from physgen.evaluate.plausibility.tracks import Tracks
from physgen.problems import InputError, Place, Problem

FINE, WHOLE = 0.15, 0.4
"""px that middles of boxes shake, at least; of boxes in whole px."""
MOST = 20


def from_mot(path: Path, asked: Asked) -> Tracks:
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
    said = "" if fps else ", 30 frames a second assumed"
    first = min(frames, default=0)
    source = f"middles of boxes, MOT{said}"
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
