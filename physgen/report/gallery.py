"""Folders of clips -> one page that shows them all, searches, sorts, filters, and lays a sweep out by two axes.

Posters and strips lie in `<page>.files` beside the page, named after the film that they are of: a page that is made
again makes only what is new. Everything from outside is escaped.
"""

from __future__ import annotations

import base64
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from physgen import __version__
from physgen.problems import InputError
from physgen.report.became import became
from physgen.report.cards import KINDS, Pictured, card, link, told
from physgen.report.clips import Clip, clips_in
from physgen.report.leftovers import sweep
from physgen.report.posters import pictures
from physgen.report.swept import Swept, swept
from physgen.report.templates import script_json, template
from physgen.resources import resource
from physgen.scene.words import natural
from physgen.whole import set_aside, write_whole

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
        shots.append(pictured(clip, files, single))
    names = [root.resolve().name for root in roots]
    text = gallery_page(clips, shots, index.parent, title or _title(names), single)
    if index.exists() and not _ours(index):
        set_aside(index, keep)
    data = text.encode("utf-8")
    write_whole(index, data)
    if not single:
        sweep_files(files, {Path(path).name for p in shots for path in (p.poster, p.strip)})
    return Gallery(index, len(clips), sum(bool(clip.problems) for clip in clips), len(data))


def keep_pictures(home: Path, index: Path) -> None:
    """Those of one clip, for the gallery that is to be written to `index`; it makes them itself where this fails."""
    with suppress(OSError, InputError):
        for clip in clips_in([home]):
            pictured(clip, index.with_name(f"{index.stem}.files"), single=False)


def gallery_page(
    clips: Sequence[Clip], shots: Sequence[Pictured], home: Path, title: str, single: bool = False
) -> str:
    """The HTML; paths are relative to `home`."""
    keys, ends = swept(clips), became(clips)
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


def pictured(clip: Clip, files: Path, single: bool) -> Pictured:
    """Poster and strip, made unless they are there; none where the film cannot be read."""
    if clip.film is None or not re.fullmatch("[0-9a-f]{20}", clip.seal):
        return Pictured()
    paths = [files / f"{clip.seal}.{kind}.webp" for kind in ("poster", "strip")]
    if all(path.is_file() for path in paths):
        made = [path.read_bytes() for path in paths] if single else []
    else:
        try:
            made = list(pictures(clip.film, clip.frames))
        except OSError:
            return Pictured()
        if not single:
            files.mkdir(parents=True, exist_ok=True)
            for path, data in zip(paths, made, strict=True):
                write_whole(path, data)
    if single:
        return Pictured(*(f"data:image/webp;base64,{base64.b64encode(data).decode()}" for data in made))
    return Pictured(*(link(path, files.parent) for path in paths))


def sweep_files(files: Path, used: set[str]) -> None:
    """Take away pictures and films of clips that are gone, and what was left of one by who was killed over it."""
    if files.is_dir():
        sweep(files)
        for path in files.iterdir():
            if _OURS(path.name) and path.name not in used:
                path.unlink(missing_ok=True)


def _ours(index: Path) -> bool:
    with index.open("rb") as file:
        head = file.read(2000).decode("utf-8", "replace")
    return MARK in head or FORMERLY in head


def _order(key: Swept) -> list[float | str]:
    """Its values: numbers by size, words as people sort them."""
    have = {value for value in key.values if value is not None}
    return [
        *sorted(v for v in have if isinstance(v, float)),
        *sorted((v for v in have if isinstance(v, str)), key=natural),
    ]


def _axis(key: Swept) -> dict[str, Any]:
    """A key as the script knows it."""
    values = _order(key)
    texts = [told(value) for value in values]
    plain = {name: getattr(key, name) for name in ("path", "name", "unit", "numeric", "follows", "swept")}
    return {**plain, "values": values, "texts": texts}


def _is_sheet(keys: Sequence[Swept], count: int) -> bool:
    """Whether the clips are a sweep over two keys, and best seen by these."""
    free = [key for key in keys if key.swept and not key.follows]
    return count > 3 and len(free) == 2 and all(None not in key.values for key in free)


def _facet(key: Swept) -> dict[str, Any]:
    """A key as something to filter by: its few values with how many clips have each, or a range with its histogram."""
    have = [value for value in key.values if value is not None]
    facet = {"path": key.path, "name": key.name, "unit": key.unit, "swept": key.swept}
    values = _order(key)
    if key.numeric and len(values) > FEW:
        low, high = float(values[0]), float(values[-1])
        counts = Counter(min(int(BARS * (float(value) - low) / (high - low)), BARS - 1) for value in have)
        bars = [round(100 * counts[k] / max(counts.values())) for k in range(BARS)]
        return {**facet, "range": [told(low), told(high)], "last": len(values) - 1, "bars": bars}
    counted = Counter(map(told, have))
    texts = dict.fromkeys(map(told, values))
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
