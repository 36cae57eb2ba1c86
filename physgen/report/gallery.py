"""The gallery page of many clips: cards, filters and sorting."""

from __future__ import annotations

import base64
import csv
import json
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import islice
from math import isfinite
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

from physgen import __version__
from physgen.files import back_up, resource, write_atomic
from physgen.problems import InputError
from physgen.report.clips import Clip, clips_in
from physgen.report.films import poster_and_strip, strip_columns, strip_frames
from physgen.report.folders import remove_leftovers
from physgen.report.html import script_json, template
from physgen.report.sweep_keys import SweptKey, swept_keys
from physgen.text import natural

# ----------------------------------------------------------------------
# Tables of sweeps beside clips -> what became of each clip: numbers that a gallery sorts by.

TABLE, ASKED = "sweep.csv", "sweep.json"
BEFORE, BEHIND = "error", "video"
"""Columns between which outcomes stand."""
MOST, MOST_CELLS = 256, 200_000
"""Columns that are told of, the first ones, and values of all clips together: they stand in the page."""
MOST_ROWS = 1_000_000


@dataclass(frozen=True)
class SweepOutcome:
    """One outcome."""

    column: str
    """Of the table: `objects.ball.rest_time`."""
    name: str
    """For people: `ball rest time`."""
    unit: str
    values: tuple[float | None, ...]
    """One a clip; None where it has none."""


def sweep_outcomes(clips: Sequence[Clip]) -> list[SweepOutcome]:
    """Outcomes that differ between clips, as tables beside their folders have them; none where there is no table."""
    places: dict[Path, dict[str, int]] = {}
    for k, clip in enumerate(clips):
        places.setdefault(clip.home.parent, {})[clip.home.name] = k
    found: dict[str, tuple[str, list[float | None]]] = {}
    most = min(MOST, MOST_CELLS // max(len(clips), 1))
    for folder, numbers in places.items():
        units = _units(folder / ASKED)
        for name, cells in _rows(folder / TABLE):
            if name in numbers:
                for column, value in cells:
                    if column not in found and len(found) >= most:
                        continue
                    _, values = found.setdefault(column, (units.get(column, ""), [None] * len(clips)))
                    values[numbers[name]] = value
    return [
        SweepOutcome(column, _name(column), unit, tuple(values))
        for column, (unit, values) in found.items()
        if len({value for value in values if value is not None}) > 1
    ]


def _rows(table: Path) -> Iterable[tuple[str, list[tuple[str, float]]]]:
    """Name of a clip's folder, and its outcomes; nothing where the table is none of ours, or cannot be read."""
    rows = []
    try:
        with table.open(encoding="utf-8", newline="") as file:
            lines = csv.reader(file)
            heading = next(lines, [])
            if heading[:1] != ["number"] or not {"folder", BEFORE, BEHIND} <= set(heading):
                return []
            where = heading.index("folder")
            columns = list(enumerate(heading))[heading.index(BEFORE) + 1 : heading.index(BEHIND)]
            for line in islice(lines, MOST_ROWS):
                rows.append((line[where], [(name, float(line[k])) for k, name in columns if line[k]]))
    except (OSError, ValueError, IndexError, csv.Error):
        return []
    return [(name, [(column, value) for column, value in cells if isfinite(value)]) for name, cells in rows]


def _units(asked: Path) -> dict[str, str]:
    try:
        return {str(name): str(unit) for name, unit in json.loads(asked.read_bytes())["units"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _name(column: str) -> str:
    """What a column is called.

    >>> _name("objects.ball-1.angle_degrees"), _name("peak_speed")
    ('ball-1 angle', 'peak speed')
    """
    thing, _, what = column.removeprefix("objects.").rpartition(".")
    return f"{thing} {what.removesuffix('_degrees').replace('_', ' ')}".strip()


# ----------------------------------------------------------------------
# A clip -> its card in a gallery: what is written on it, and what the page's script needs to know of it.

KINDS = {".mp4": "video/mp4", ".webp": "image/webp", ".gif": "image/gif"}
"""Films that a page can play."""


@dataclass(frozen=True)
class ClipPictures:
    """Where a clip's poster and strip are, as the page names them: paths or data URIs; empty where it has none."""

    poster: str = ""
    strip: str = ""


def card(
    number: int,
    clip: Clip,
    shot: ClipPictures,
    keys: Sequence[SweptKey],
    home: Path,
    alike: bool,
    single: bool,
) -> dict[str, Any]:
    """What the template shows of one clip; under `data`, what the script needs to know."""
    values = [key.values[number] for key in keys]
    film = "" if clip.film is None or single or clip.film.suffix not in KINDS else link(clip.film, home)
    where = unquote(link(clip.home.parent, home)).removeprefix("./").removeprefix(".") if alike else ""
    labels = list(clip.labels.items())
    data = {
        "name": clip.name,
        "scene": clip.scene,
        "variant": clip.variant,
        "where": where,
        "labels": [label for label, _ in labels],
        "time": round(clip.time, 3),
        "objects": clip.objects,
        "fps": clip.fps,
        "frames": clip.frames,
        "shown": strip_frames(clip.frames),
        "across": strip_columns(clip.frames),
        "size": clip.size,
        "poster": bool(shot.poster),
        "strip": shot.strip and ("held" if single else shot.strip),
        "film": film,
        "kind": "" if clip.film is None else KINDS.get(clip.film.suffix, ""),
        "href": "" if clip.report is None or single else link(clip.report, home),
        "values": values,
        "failed": bool(clip.problems),
        "why": " ".join(clip.problems),
        "made": bool(clip.document),
        "warned": bool(clip.warnings),
        "said": [*clip.overrides, *clip.warnings, *clip.problems],
    }
    split = {
        key.name: key for key, value in zip(keys, values, strict=True) if value is not None and key.swept
    }
    return {
        "data": data,
        "number": number,
        "name": clip.name,
        "href": data["href"],
        "where": where,
        "poster": shot.poster,
        "strip": shot.strip if single else "",
        "size": clip.size,
        "variant": clip.variant,
        "facts": _facts(clip),
        "labels": labels[:3],
        "more": len(labels) - 3,
        "values": [
            (name, format_value(key.values[number]), key.unit, key.path)
            for name, key in list(split.items())[:4]
        ],
        "warnings": _counted(len(clip.warnings), "warning"),
        "settings": _counted(len(clip.overrides), "setting"),
        "notes": "\n".join((*clip.warnings, *(f"--set {text}" for text in clip.overrides))),
        "problems": clip.problems,
    }


def _facts(clip: Clip) -> str:
    if not clip.document:
        return "no clip"
    wide, high = clip.size
    parts = (_counted(clip.objects, "object") or "no objects", f"{clip.duration:.3g} s", f"{wide} × {high}")
    return " · ".join(part.replace(" ", "\u00a0") for part in parts)


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' if count != 1 else ''}" if count else ""


def format_value(value: float | str | None) -> str:
    """A value as the page writes it.

    >>> [told(value) for value in (0.1, 30625.0, 1234567.0, 1e-7, "side", None)]
    ['0.1', '30625', '1234570', '1e-07', 'side', '']
    """
    return f"{float(f'{value:.6g}'):.10g}" if isinstance(value, float) else value or ""


def link(path: Path, home: Path) -> str:
    """From the folder `home` to a file, as an address."""
    relative = Path(os.path.relpath(path.absolute(), home.absolute())).as_posix()
    return quote(relative if relative.startswith("../") else f"./{relative}")


# ----------------------------------------------------------------------
# Folders of clips -> one page that shows them all, searches, sorts, filters, and lays a sweep out by two
# axes.
#
# Posters and strips lie in `<page>.files` beside the page, named after the film that they are of: a page that
# is made
# again makes only what is new. Everything from outside is escaped.

Progress = Callable[[str, int, int], None]

MARK = '<meta name="generator" content="physgen gallery">'
FORMERLY = "<title>physgen gallery</title>"
PARTS = ("state", "choose", "shots", "clock", "sheet", "look", "page")
"""Of the script, in the order in which they build on each other."""
FEW = 8
"""Values of a key that are offered one by one; more make a range."""
BARS = 16
"""Of a range's histogram."""
_OURS = re.compile(r"[0-9a-f]{20}\.((poster|strip)\.webp|film\.mp4)").fullmatch


@dataclass(frozen=True)
class Gallery:
    """What was written."""

    index: Path
    clips: int
    failures: int
    bytes: int
    """Of the page itself."""


def write_gallery(
    roots: Sequence[Path],
    index: Path,
    *,
    title: str | None = None,
    single: bool = False,
    progress: Progress = lambda stage, done, total: None,
    keep: Callable[[Path], None] = lambda kept: None,
) -> Gallery:
    """The page of all clips below `roots`, with pictures and films inside it where it is to be a `single` file.

    A file at `index` that is not ours is set aside, and `keep` is told. Raises InputError for roots that are none.
    """
    if index.is_dir():
        raise InputError.of("-o", f'"{index}"', "is a folder", "name a file, e.g. -o out/index.html")
    clips = clips_in(roots)
    index.parent.mkdir(parents=True, exist_ok=True)
    files = index.with_name(f"{index.stem}.files")
    shots = []
    for k, clip in enumerate(clips):
        progress("gallery", k, len(clips))
        shots.append(clip_pictures(clip, files, single))
    names = [root.resolve().name for root in roots]
    text = gallery_page(clips, shots, index.parent, title or _title(names), single)
    if index.exists() and not _ours(index):
        back_up(index, keep)
    data = text.encode("utf-8")
    write_atomic(index, data)
    if not single:
        sweep_files(files, {Path(path).name for p in shots for path in (p.poster, p.strip)})
    return Gallery(index, len(clips), sum(bool(clip.problems) for clip in clips), len(data))


def keep_pictures(home: Path, index: Path) -> None:
    """Those of one clip, for the gallery that is to be written to `index`; it makes them itself where this fails."""
    with suppress(OSError, InputError):
        for clip in clips_in([home]):
            clip_pictures(clip, index.with_name(f"{index.stem}.files"), single=False)


def gallery_page(
    clips: Sequence[Clip], shots: Sequence[ClipPictures], home: Path, title: str, single: bool = False
) -> str:
    """The HTML; paths are relative to `home`."""
    keys, ends = swept_keys(clips), sweep_outcomes(clips)
    parts = [resource("templates", "gallery", f"{part}.js").read_text(encoding="utf-8") for part in PARTS]
    alike = {name for name, count in Counter(clip.name for clip in clips).items() if count > 1}
    cards = [
        card(k, clip, shot, keys, home, clip.name in alike, single)
        for k, (clip, shot) in enumerate(zip(clips, shots, strict=True))
    ]
    for k, shown in enumerate(cards):
        if ends:
            shown["data"]["became"] = [_rounded(end.values[k]) for end in ends]
    labels = Counter(label for clip in clips for label in clip.labels)
    data = {
        "clips": [shown.pop("data") for shown in cards],
        "keys": [_axis(key) for key in keys],
        "became": [{"path": f"={end.column}", "name": end.name, "unit": end.unit} for end in ends],
        "grid": _is_sheet(keys, len(clips)),
        "single": single,
    }
    page: str = template("gallery.html.j2").render(
        title=title,
        mark=MARK,
        cards=cards,
        failures=sum(bool(clip.problems) for clip in clips),
        warned=sum(bool(clip.warnings) for clip in clips),
        earliest=_day(min((clip.time for clip in clips), default=0.0)),
        latest=_day(max((clip.time for clip in clips), default=0.0)),
        labels=labels.most_common() if len(labels) > 1 else [],
        variants=Counter(clip.variant or "" for clip in clips).most_common()
        if any(c.variant for c in clips)
        else [],
        keys=[_facet(key) for key in keys],
        aspect=_aspect(clips),
        films=list(_films(clips)) if single else [],
        data=script_json(data),
        script='(() => {\n"use strict";\n' + "\n".join(parts) + "})();",
        version=__version__,
    )
    return page


def _rounded(value: float | None) -> float | None:
    """As the page writes it."""
    return None if value is None else float(f"{value:.6g}")


def _title(names: Sequence[str]) -> str:
    return ", ".join(dict.fromkeys(names)) if 0 < len(set(names)) <= 3 and all(names) else "Gallery"


def _day(time: float) -> str:
    return datetime.fromtimestamp(time, UTC).date().isoformat() if time > 0 else ""


def clip_pictures(clip: Clip, files: Path, single: bool) -> ClipPictures:
    """Poster and strip, made unless they are there; none where the film cannot be read."""
    if clip.film is None or not re.fullmatch("[0-9a-f]{20}", clip.seal):
        return ClipPictures()
    paths = [files / f"{clip.seal}.{kind}.webp" for kind in ("poster", "strip")]
    if all(path.is_file() for path in paths):
        made = [path.read_bytes() for path in paths] if single else []
    else:
        try:
            made = list(poster_and_strip(clip.film, clip.frames))
        except OSError:
            return ClipPictures()
        if not single:
            files.mkdir(parents=True, exist_ok=True)
            for path, data in zip(paths, made, strict=True):
                write_atomic(path, data)
    if single:
        return ClipPictures(*(f"data:image/webp;base64,{base64.b64encode(data).decode()}" for data in made))
    return ClipPictures(*(link(path, files.parent) for path in paths))


def sweep_files(files: Path, used: set[str]) -> None:
    """Take away pictures and films of clips that are gone, and what was left of one by who was killed over it."""
    if files.is_dir():
        remove_leftovers(files)
        for path in files.iterdir():
            if _OURS(path.name) and path.name not in used:
                path.unlink(missing_ok=True)


def _ours(index: Path) -> bool:
    with index.open("rb") as file:
        head = file.read(2000).decode("utf-8", "replace")
    return MARK in head or FORMERLY in head


def _order(key: SweptKey) -> list[float | str]:
    """Its values: numbers by size, words as people sort them."""
    have = {value for value in key.values if value is not None}
    return [
        *sorted(v for v in have if isinstance(v, float)),
        *sorted((v for v in have if isinstance(v, str)), key=natural),
    ]


def _axis(key: SweptKey) -> dict[str, Any]:
    """A key as the script knows it."""
    values = _order(key)
    texts = [format_value(value) for value in values]
    plain = {name: getattr(key, name) for name in ("path", "name", "unit", "numeric", "follows", "swept")}
    return {**plain, "values": values, "texts": texts}


def _is_sheet(keys: Sequence[SweptKey], count: int) -> bool:
    """Whether the clips are a sweep over two keys, and best seen by these."""
    free = [key for key in keys if key.swept and not key.follows]
    return count > 3 and len(free) == 2 and all(None not in key.values for key in free)


def _facet(key: SweptKey) -> dict[str, Any]:
    """A key as something to filter by: its few values with how many clips have each, or a range with its histogram."""
    have = [value for value in key.values if value is not None]
    facet = {"path": key.path, "name": key.name, "unit": key.unit, "swept": key.swept}
    values = _order(key)
    if key.numeric and len(values) > FEW:
        low, high = float(values[0]), float(values[-1])
        counts = Counter(min(int(BARS * (float(value) - low) / (high - low)), BARS - 1) for value in have)
        bars = [round(100 * counts[k] / max(counts.values())) for k in range(BARS)]
        return {
            **facet,
            "range": [format_value(low), format_value(high)],
            "last": len(values) - 1,
            "bars": bars,
        }
    counted = Counter(map(format_value, have))
    texts = dict.fromkeys(map(format_value, values))
    return {**facet, "range": None, "values": [(text, counted[text]) for text in texts]}


def _aspect(clips: Sequence[Clip]) -> str:
    """Of all films, or a compromise where they differ."""
    sizes = Counter(clip.size for clip in clips if clip.document)
    if not sizes or len({round(w / h, 2) for w, h in sizes}) > 1:
        return "4 / 3"
    wide, high = next(iter(sizes))
    return f"{wide} / {high}" if 0.5 <= wide / high <= 2.5 else "4 / 3"


def _films(clips: Sequence[Clip]) -> Iterator[Mapping[str, Any]]:
    """Films of a single file, as text."""
    for number, clip in enumerate(clips):
        if clip.film is not None and clip.film.suffix in KINDS:
            yield {"number": number, "data": base64.b64encode(clip.film.read_bytes()).decode("ascii")}
