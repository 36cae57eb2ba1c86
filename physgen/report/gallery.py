"""The gallery page of many clips: cards, filters and sorting.

Posters lie in `<page>.files` beside the page, named by the hash of their film: a page that is made again
creates only new ones. All text from outside is escaped.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

from physgen import __version__
from physgen.files import back_up, check_writable, resource, write_atomic
from physgen.problems import InputError
from physgen.progress import Progress, silent
from physgen.report.clips import Clip, clips_in
from physgen.report.films import poster
from physgen.report.folders import remove_leftovers
from physgen.report.html import script_json, template
from physgen.report.sweep_keys import SweptKey, swept_keys
from physgen.text import counted, natural, rounded, value_text

KINDS = {".mp4": "video/mp4", ".webp": "image/webp", ".gif": "image/gif"}
"""Films that a page can play."""


@dataclass(frozen=True)
class GalleryLimits:
    """What the page shows."""

    most_choices: int = (
        8  # values of a key that are offered one by one; more become a range
    )
    common_labels: int = 6  # labels that are offered at once, the most frequent
    many: int = 200  # cards; of more, those out of sight are laid out as they come


LIMITS = GalleryLimits()

MARK = '<meta name="generator" content="physgen gallery">'
SCRIPTS = ("state", "choose", "shots", "clock", "sheet", "look", "page")
"""In the order in which they build on each other."""
_OURS = re.compile(r"[0-9a-f]{20}\.(photo|poster|strip)\.webp").fullmatch


@dataclass(frozen=True)
class Gallery:
    """A written page."""

    index: Path
    clips: int
    failures: int
    bytes: int  # of the page itself


def write_gallery(
    roots: Sequence[Path],
    index: Path,
    *,
    title: str | None = None,
    progress: Progress = silent,
    keep: Callable[[Path], None] = lambda kept: None,
) -> Gallery:
    """The page of all clips below `roots`.

    A file at `index` that physgen did not write is backed up, and `keep` gets its new path. Raises InputError for
    roots that are no folders.
    """
    if index.is_dir():
        raise InputError.of(
            "-o", f'"{index}"', "is a folder", "name a file, e.g. -o out/index.html"
        )
    check_writable(index.parent)
    clips = clips_in(roots)
    index.parent.mkdir(parents=True, exist_ok=True)
    files = index.with_name(f"{index.stem}.files")
    shots = []
    for k, clip in enumerate(clips):
        progress("gallery", k, len(clips))
        shots.append(clip_poster(clip, files))
    if title is None:
        names = [
            root.resolve().name.replace("-", " ").replace("_", " ") for root in roots
        ]
        title = (
            ", ".join(dict.fromkeys(names))
            if len(set(names)) <= 3 and all(names)
            else "Gallery"
        )
        title = title[:1].upper() + title[1:]
    text = gallery_page(clips, shots, index.parent, title or "Gallery")
    if index.exists() and not _ours(index):
        back_up(index, keep)
    data = text.encode("utf-8")
    write_atomic(index, data)
    sweep_files(files, {Path(shot).name for shot in shots})
    return Gallery(
        index, len(clips), sum(bool(clip.problems) for clip in clips), len(data)
    )


def keep_pictures(home: Path, index: Path) -> None:
    """Makes the pictures of one clip for a gallery that will be written to `index`; errors are left to that."""
    with suppress(OSError, InputError):
        for clip in clips_in([home]):
            clip_poster(clip, index.with_name(f"{index.stem}.files"))


def gallery_page(
    clips: Sequence[Clip], shots: Sequence[str], home: Path, title: str
) -> str:
    """The HTML; paths are relative to `home`."""
    keys = swept_keys(clips)
    names = Counter(clip.name for clip in clips)
    cards = []
    for k, (clip, shot) in enumerate(zip(clips, shots, strict=True)):
        values = [key.values[k] for key in keys]
        card = _card(k, clip, shot, keys, values, home)
        card["where"] = card["data"]["where"] = (
            _folder(clip, home) if names[clip.name] > 1 else ""
        )
        cards.append(card)
    labels = Counter(label for clip in clips for label in clip.labels).most_common()
    choices = [
        (label, count)
        for label, count in labels
        if count < sum(bool(clip.document) for clip in clips)
    ]
    free = [key for key in keys if not key.follows]
    swept = bool(free) and len({clip.subject for clip in clips if clip.document}) == 1
    data = {
        "clips": [card.pop("data") for card in cards],
        "keys": [_axis(key) for key in keys],
        "swept": swept,
        # a sweep over two keys is shown as a table of both
        "grid": swept
        and len(clips) > 3
        and len(free) == 2
        and all(None not in key.values for key in free),
    }
    scripts = [
        resource("templates", "gallery", f"{name}.js").read_text(encoding="utf-8")
        for name in SCRIPTS
    ]
    times = [clip.time for clip in clips]
    page: str = template("gallery.html.j2").render(
        title=title,
        mark=MARK,
        cards=cards,
        failures=sum(bool(clip.problems) for clip in clips),
        warned=sum(bool(clip.warnings) for clip in clips),
        earliest=_day(min(times, default=0.0)),
        latest=_day(max(times, default=0.0)),
        labels=choices if len(choices) > 1 else [],
        common=LIMITS.common_labels,
        many=LIMITS.many,
        keys=[
            _filter(key)
            for key in keys
            if 2 * sum(value is None for value in key.values) <= len(clips)
        ],
        swept=swept,
        sentence=_sentence(clips, free if swept else []),
        hero=None
        if data["grid"]
        else next((card for card in cards if card["moves"]), None),
        aspect=_aspect(clips),
        data=script_json(data),
        script='(() => {\n"use strict";\n' + "\n".join(scripts) + "})();",
        version=__version__,
    )
    return page


def _card(
    number: int,
    clip: Clip,
    shot: str,
    keys: Sequence[SweptKey],
    values: Sequence[float | str | None],
    home: Path,
) -> dict[str, Any]:
    """Variables of the template for one clip; `data` is for the script."""
    film = (
        ""
        if clip.film is None or clip.film.suffix not in KINDS
        else link(clip.film, home)
    )
    labels = list(clip.labels.items())
    changes = list(dict.fromkeys(clip.overrides))
    href = "" if clip.report is None else link(clip.report, home)
    shared = {
        "name": clip.name,
        "href": href,
        "size": clip.size,
        "variant": clip.variant,
    }
    data = shared | {
        "scene": clip.scene,
        "labels": [label for label, _ in labels],
        "time": round(clip.time, 3),
        "objects": clip.objects,
        "fps": clip.fps,
        "frames": clip.frames,
        "poster": bool(shot),
        "film": film,
        "kind": "" if clip.film is None else KINDS.get(clip.film.suffix, ""),
        "values": values,
        "failed": bool(clip.problems),
        "why": " ".join(clip.problems),
        "made": bool(clip.document),
        "warned": bool(clip.warnings),
        "notes": [*changes, *clip.warnings, *clip.problems],
    }
    shown = [
        (key.name, value_text(value), key.unit, key.path)
        for key, value in zip(keys, values, strict=True)
        if value is not None
    ]
    return shared | {
        "data": data,
        "number": number,
        "poster": shot,
        "facts": _facts(clip),
        "labels": labels[:3],
        "more": len(labels) - 3,
        "values": shown[:4],
        "ratio": round(clip.size[0] / clip.size[1], 3),
        "moves": data["kind"] == "video/mp4" and bool(shot) and not clip.problems,
        "warnings": clip.warnings,
        "settings": counted(len(changes), "change") if changes else "",
        "notes": "\n".join(f"--set {text}" for text in changes),
        "problems": clip.problems,
    }


def _sentence(clips: Sequence[Clip], swept: Sequence[SweptKey]) -> str:
    """What the page shows, and how to look at it."""
    failed = sum(bool(clip.problems) for clip in clips)
    count, lost = counted(len(clips), "clip"), ""
    if failed:
        count = f"{len(clips) - failed:,} of {count}"
        lost = f"; {failed:,} failed, as {'its card says' if failed == 1 else 'their cards say'}"
    if swept:
        ranges = []
        for key in swept[:3]:
            texts = [value_text(value) for value in _sorted_values(key)]
            ranges.append(
                f"{key.name} {' to '.join(dict.fromkeys((texts[0], texts[-1])))} {key.unit}".strip()
            )
        return f"{count} of one scene, simulated with {', '.join(ranges)}{lost}."
    photos = {clip.photo for clip in clips} - {""}
    source = f" from {counted(len(photos), 'photo')}" if photos else ""
    return f"{count}, simulated{source}{lost}. Point at a card or tap it to play; open it for its report."


def _folder(clip: Clip, home: Path) -> str:
    """Of clips with the same name."""
    return unquote(link(clip.home.parent, home)).removeprefix("./").removeprefix(".")


def _facts(clip: Clip) -> str:
    if not clip.document:
        return "no clip"
    wide, high = clip.size
    parts = (
        counted(clip.objects, "object") if clip.objects else "no objects",
        f"{rounded(clip.duration)} s",
        f"{wide} × {high}",
    )
    return " · ".join(part.replace(" ", "\u00a0") for part in parts)


def link(path: Path, home: Path) -> str:
    """From the folder `home` to a file, as a relative URL."""
    relative = Path(os.path.relpath(path.absolute(), home.absolute())).as_posix()
    return quote(relative if relative.startswith("../") else f"./{relative}")


def clip_poster(clip: Clip, files: Path) -> str:
    """URL of the poster, made unless it exists; empty where the film cannot be read."""
    if clip.film is None or not re.fullmatch("[0-9a-f]{20}", clip.seal):
        return ""
    path = files / f"{clip.seal}.photo.webp"
    if not path.is_file():
        try:
            made = poster(clip.film)
        except OSError:
            return ""
        files.mkdir(parents=True, exist_ok=True)
        write_atomic(path, made)
    return link(path, files.parent)


def sweep_files(files: Path, used: set[str]) -> None:
    """Removes pictures and films of clips that no longer exist, and what killed processes left."""
    if files.is_dir():
        remove_leftovers(files)
        for path in files.iterdir():
            if _OURS(path.name) and path.name not in used:
                path.unlink(missing_ok=True)


def _ours(index: Path) -> bool:
    with index.open("rb") as file:
        return MARK.encode() in file.read(2000)


def _day(time: float) -> str:
    return datetime.fromtimestamp(time, UTC).date().isoformat() if time > 0 else ""


def _sorted_values(key: SweptKey) -> list[float | str]:
    """Numbers by size, then words in natural order."""
    have = {value for value in key.values if value is not None}
    return sorted(
        have, key=lambda v: (0, v, []) if isinstance(v, float) else (1, 0.0, natural(v))
    )


def _axis(key: SweptKey) -> dict[str, Any]:
    """A key for the script."""
    values = _sorted_values(key)
    plain = {
        name: getattr(key, name)
        for name in ("path", "name", "unit", "numeric", "follows")
    }
    return {**plain, "values": values, "texts": [value_text(value) for value in values]}


def _filter(key: SweptKey) -> dict[str, Any]:
    """A key as a filter: its values with the number of clips, or a range."""
    have = [value for value in key.values if value is not None]
    values = _sorted_values(key)
    found: dict[str, Any] = {
        "path": key.path,
        "name": key.name,
        "unit": key.unit,
        "range": None,
    }
    if key.numeric and len(values) > LIMITS.most_choices:
        ends = [value_text(values[0]), value_text(values[-1])]
        return found | {"range": ends, "last": len(values) - 1}
    often = Counter(map(value_text, have))
    return found | {
        "values": [
            (text, often[text]) for text in dict.fromkeys(map(value_text, values))
        ]
    }


def _aspect(clips: Sequence[Clip]) -> str:
    """Of all films; empty where they differ."""
    sizes = {clip.size for clip in clips if clip.document}
    return (
        "{} / {}".format(*max(sizes))
        if len({round(w / h, 2) for w, h in sizes}) == 1
        else ""
    )
