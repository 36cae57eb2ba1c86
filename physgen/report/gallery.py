"""The gallery page of many clips: cards, filters and sorting.

Posters are in `<page>.files` beside the page, with the hash of their film as a name, so
that a second gallery makes only new ones. All external text is escaped.
"""

from __future__ import annotations

import json
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
from physgen.messages import Message
from physgen.problems import InputError
from physgen.progress import Progress, silent
from physgen.report.clips import Clip, clips_in
from physgen.report.films import poster, result_still
from physgen.report.folders import remove_leftovers
from physgen.report.html import script_json, template
from physgen.report.links import document_links, link
from physgen.report.listening import write_listening_page
from physgen.report.sweep_keys import SweptKey, swept_keys
from physgen.text import counted, natural, rounded, value_text

KINDS = {".mp4": "video/mp4", ".webp": "image/webp", ".gif": "image/gif"}
"""Film formats of browsers."""


@dataclass(frozen=True)
class GalleryLimits:
    """Sizes of the page's parts."""

    most_choices: int = 8
    """Maximum number of values of a key with one button each; more become a range."""
    common_labels: int = 6
    """Number of labels without a further click, the most frequent."""
    max_cards: int = 200
    """Maximum number of cards with an immediate layout and with pictures of results."""
    min_searchable: int = 12
    """Minimum number of clips for search, sorting and filters; sweeps always
    have them.
    """


LIMITS = GalleryLimits()

MARK = '<meta name="generator" content="physgen gallery">'
SCRIPTS = ("state", "choose", "shots", "slide", "clock", "sheet", "look", "page")
"""Scripts of the page, in the order of their dependencies."""
NEIGHBOURS = "clips.js"
"""File with the list of clips for their reports, beside the pictures."""
_OURS = re.compile(r"[0-9a-f]{20}\.(photo|result|poster|strip)\.webp").fullmatch


@dataclass(frozen=True)
class Gallery:
    """A written page."""

    index: Path
    clips: int
    failures: int
    bytes: int
    """Size of the page itself."""


def write_gallery(
    roots: Sequence[Path],
    index: Path,
    *,
    title: str | None = None,
    progress: Progress = silent,
    keep: Callable[[Path], None] = lambda kept: None,
) -> Gallery:
    """Write the page of all clips below `roots`.

    Back up a file of another program at `index`; `keep` gets its new path. Raise
    InputError for roots that are not folders.
    """
    if index.is_dir():
        raise Message.FOLDER_FOR_PAGE.error("-o", f'"{index}"')
    check_writable(index.parent)
    clips = clips_in(roots)
    index.parent.mkdir(parents=True, exist_ok=True)
    files = index.with_name(f"{index.stem}.files")
    # Pictures are made first, since the page contains their sizes and links.
    shots, results = [], []
    for k, clip in enumerate(clips):
        progress("gallery", k, len(clips))
        shots.append(clip_poster(clip, files))
        results.append(clip_result(clip, files, len(clips)))
    if title is None:
        names = [
            root.resolve().name.replace("-", " ").replace("_", " ") for root in roots
        ]
        title = "Gallery"
        if len(set(names)) <= 3 and all(names):
            title = ", ".join(dict.fromkeys(names))
        title = title[:1].upper() + title[1:]
    title = title or "Gallery"
    listening = write_listening_page(clips, index, title)
    if listening is None:
        listen = ""
    else:
        listen = quote(listening.name)
    # The page is made before the old one is touched.
    text = gallery_page(clips, shots, index.parent, title, results, listen)
    if index.exists() and not _has_mark(index):
        back_up(index, keep)
    data = text.encode("utf-8")
    write_atomic(index, data)
    # Only after the new page: the old one needs its pictures until then.
    sweep_files(files, {Path(shot).name for shot in (*shots, *results)})
    _write_neighbours(clips, files)
    return Gallery(
        index, len(clips), sum(bool(clip.problems) for clip in clips), len(data)
    )


def keep_pictures(home: Path, index: Path) -> None:
    """Make the pictures of one clip for a later gallery at `index`.

    Ignore errors: the gallery will report them.
    """
    with suppress(OSError, InputError):
        for clip in clips_in([home]):
            clip_poster(clip, index.with_name(f"{index.stem}.files"))


def _cards(
    clips: Sequence[Clip],
    shots: Sequence[str],
    home: Path,
    keys: Sequence[SweptKey],
    results: Sequence[str],
) -> list[dict[str, Any]]:
    """Return the cards of all clips; see `gallery_page`."""
    # A name alone does not identify a clip if several clips have it.
    names = Counter(clip.name for clip in clips)
    cards = []
    for k, (clip, shot) in enumerate(zip(clips, shots, strict=True)):
        values = [key.values[k] for key in keys]
        card = _card(k, clip, shot, keys, values, home)
        if results and not clip.problems:
            card["result"] = results[k]
        else:
            card["result"] = ""
        # Only an ambiguous name needs the clip's folder.
        folder = ""
        if names[clip.name] > 1:
            folder = _folder(clip, home)
        card["where"] = card["data"]["where"] = folder
        cards.append(card)
    return cards


def gallery_page(
    clips: Sequence[Clip],
    shots: Sequence[str],
    home: Path,
    title: str,
    results: Sequence[str] = (),
    listen: str = "",
) -> str:
    """Return the page's HTML, with paths relative to `home`.

    `listen` is the listening page, if any. `results` are pictures of the clips' ends,
    empty without one.
    """
    keys = swept_keys(clips)
    cards = _cards(clips, shots, home, keys, results)
    subjects = {clip.subject for clip in clips if clip.document}
    # Clips of different scenes differ in everything and are not a sweep.
    free_keys: list[SweptKey] = []
    if len(subjects) == 1:
        free_keys = [key for key in keys if not key.follows]
    is_sweep = bool(free_keys)
    is_grid = is_sweep and _is_grid(clips, free_keys)
    data = {
        "clips": [card.pop("data") for card in cards],
        "keys": list(map(_axis, keys)),
        "swept": is_sweep,
        "grid": is_grid,
    }
    hero = None
    # A table of a sweep has no room for a large clip.
    if not is_grid:
        hero = next((card for card in cards if card["moves"]), None)
    times = [clip.time for clip in clips]
    page: str = template("gallery.html.j2").render(
        title=title,
        mark=MARK,
        cards=cards,
        failures=sum(bool(clip.problems) for clip in clips),
        warned=sum(bool(clip.warnings) for clip in clips),
        earliest=_day(min(times, default=0.0)),
        latest=_day(max(times, default=0.0)),
        labels=_label_choices(clips),
        common=LIMITS.common_labels,
        many=LIMITS.max_cards,
        keys=list(map(_filter, filter(_is_filter, keys))),
        swept=is_sweep,
        listen=listen,
        sentence=_sentence(clips, free_keys),
        hero=hero,
        documents=document_links(home),
        searchable=is_sweep or len(cards) >= LIMITS.min_searchable,
        aspect=_aspect(clips),
        data=script_json(data),
        script=_script(),
        version=__version__,
    )
    return page


def _is_grid(clips: Sequence[Clip], free_keys: Sequence[SweptKey]) -> bool:
    """Return whether the page shows a sweep over two keys as a table."""
    # A table of so few cells says less than cards.
    if len(clips) <= 3 or len(free_keys) != 2:
        return False
    return all(None not in key.values for key in free_keys)


def _is_filter(key: SweptKey) -> bool:
    """Return whether at least half of the clips have a value of a key."""
    unknown = sum(value is None for value in key.values)
    return 2 * unknown <= len(key.values)


def _label_choices(clips: Sequence[Clip]) -> list[tuple[str, int]]:
    """Return labels of some but not all clips, with their counts.

    Return an empty list for a single label.
    """
    labels = Counter(label for clip in clips for label in clip.labels)
    scene_count = sum(bool(clip.document) for clip in clips)
    choices = []
    for label, count in labels.most_common():
        if count < scene_count:
            choices.append((label, count))
    if len(choices) > 1:
        return choices
    return []


def _script() -> str:
    """Return the page's script, joined from several files."""
    # One function around all files keeps their names out of the page's scope.
    texts = []
    for name in SCRIPTS:
        path = resource("templates", "gallery", f"{name}.js")
        texts.append(path.read_text(encoding="utf-8"))
    return '(() => {\n"use strict";\n' + "\n".join(texts) + "})();"


def _card(
    number: int,
    clip: Clip,
    shot: str,
    keys: Sequence[SweptKey],
    values: Sequence[float | str | None],
    home: Path,
) -> dict[str, Any]:
    """Return variables of the template for one clip; `data` is for the script."""
    data = _card_data(clip, shot, values, home)
    labels = list(clip.labels.items())
    changes = list(dict.fromkeys(clip.overrides))
    known_values = []
    for key, value in zip(keys, values, strict=True):
        if value is not None:
            known_values.append((key.name, value_text(value), key.unit, key.path))
    width, height = clip.size
    return {
        "name": clip.name,
        "title": data["title"],
        "sentence": clip.sentence,
        "masks": clip.masks,
        "slow": value_text(clip.slow) if clip.slow != 1 else "",
        "source": "" if clip.source is None else link(clip.source, home),
        "href": data["href"],
        "size": clip.size,
        "variant": clip.variant,
        "data": data,
        "number": number,
        "poster": shot,
        "facts": _facts(clip),
        "picture": f"{width} × {height} px",
        "labels": labels[:3],
        "more": len(labels) - 3,
        "values": known_values[:4],
        "ratio": round(width / height, 3),
        "moves": data["kind"] == "video/mp4" and bool(shot) and not clip.problems,
        "warnings": clip.warnings,
        "settings": counted(len(changes), "change") if changes else "",
        "notes": "\n".join(f"--set {text}" for text in changes),
        "problems": clip.problems,
    }


def _card_data(
    clip: Clip, shot: str, values: Sequence[float | str | None], home: Path
) -> dict[str, Any]:
    """Return a clip's data for the script."""
    film = kind = ""
    if clip.film is not None and clip.film.suffix in KINDS:
        film, kind = link(clip.film, home), KINDS[clip.film.suffix]
    changes = list(dict.fromkeys(clip.overrides))
    return {
        "name": clip.name,
        "title": clip.title,
        "sentence": clip.sentence,
        "href": "" if clip.report is None else link(clip.report, home),
        "size": clip.size,
        "variant": clip.variant,
        "scene": clip.scene,
        "labels": list(clip.labels),
        "time": round(clip.time, 3),
        "objects": clip.objects,
        "fps": clip.fps,
        "frames": clip.frames,
        "poster": bool(shot),
        "film": film,
        "kind": kind,
        "values": values,
        "failed": bool(clip.problems),
        "why": " ".join(clip.problems),
        "made": bool(clip.document),
        "warned": bool(clip.warnings),
        "notes": [*changes, *clip.warnings, *clip.problems],
    }


def _sentence(clips: Sequence[Clip], swept_keys: Sequence[SweptKey]) -> str:
    """Return a sentence about the page's clips."""
    failure_count = sum(bool(clip.problems) for clip in clips)
    count, failure_note = counted(len(clips), "clip"), ""
    if failure_count:
        count = f"{len(clips) - failure_count:,} of {count}"
        failure_note = f"; {failure_count:,} failed, as {'its card says' if failure_count == 1 else 'their cards say'}"
    if swept_keys:
        ranges = []
        for key in swept_keys[:3]:
            texts = list(map(value_text, _sorted_values(key)))
            ranges.append(
                f"{key.name} {' to '.join(dict.fromkeys((texts[0], texts[-1])))} {key.unit}".strip()
            )
        return (
            f"{count} of one scene, simulated with {', '.join(ranges)}{failure_note}."
        )
    photos = {clip.photo for clip in clips} - {""}
    source = ""
    if photos:
        source = f" from {counted(len(photos), 'photo')}"
    return f"{count}, simulated{source}{failure_note}."


def _folder(clip: Clip, home: Path) -> str:
    """Return the folder of a clip, to distinguish clips with the same name."""
    return unquote(link(clip.home.parent, home)).removeprefix("./").removeprefix(".")


def _facts(clip: Clip) -> str:
    if not clip.document:
        return "no clip"
    parts = (
        counted(clip.objects, "object") if clip.objects else "no objects",
        f"{rounded(clip.duration)} s",
    )
    return " · ".join(part.replace(" ", "\u00a0") for part in parts)


def clip_poster(clip: Clip, files: Path) -> str:
    """Return the URL of the poster. Make it unless it exists. Return "" for an
    unreadable film.
    """
    # The seal becomes a file name, and a manifest is untrusted.
    if clip.film is None or not re.fullmatch("[0-9a-f]{20}", clip.seal):
        return ""
    path = files / f"{clip.seal}.photo.webp"
    if not path.is_file():
        try:
            picture = poster(clip.film)
        except OSError:
            return ""
        files.mkdir(parents=True, exist_ok=True)
        write_atomic(path, picture)
    return link(path, files.parent)


def clip_result(clip: Clip, files: Path, count: int) -> str:
    """Return the URL of a picture of the clip's end. Make it unless it exists.

    Return "" in galleries with too many clips, and for films other than readable MP4. A
    clip with equal ends shows its middle.
    """
    film = clip.film
    if film is None or film.suffix != ".mp4" or count > LIMITS.max_cards:
        return ""
    if not re.fullmatch("[0-9a-f]{20}", clip.seal):
        return ""
    path = files / f"{clip.seal}.result.webp"
    if not path.is_file():
        # Backward clips end at the photo, and clips there and back at their start.
        is_forward = clip.document.get("render", {}).get("play", "forward") == "forward"
        try:
            picture = result_still(film, middle=not is_forward)
        except (OSError, ValueError):
            return ""
        files.mkdir(parents=True, exist_ok=True)
        write_atomic(path, picture)
    return link(path, files.parent)


def _write_neighbours(clips: Sequence[Clip], files: Path) -> None:
    """Write the list of clips for reports opened from the gallery.

    The list is a script, because pages on disk cannot read other files.
    """
    home = files.parent
    rows = []
    for clip in clips:
        if clip.report is None:
            continue
        film = ""
        if clip.film is not None and clip.film.suffix == ".mp4":
            film = link(clip.film, home)
        row = {"name": clip.name, "href": link(clip.report, home), "film": film}
        rows.append(row | {"fps": clip.fps, "frames": clip.frames})
    files.mkdir(parents=True, exist_ok=True)
    text = f"window.physgenClips = {json.dumps(rows, separators=(',', ':'))};\n"
    write_atomic(files / NEIGHBOURS, text.encode("ascii"))


def sweep_files(files: Path, used_names: set[str]) -> None:
    """Remove pictures of clips that no longer exist, and leftovers of killed
    processes.
    """
    if files.is_dir():
        remove_leftovers(files)
        for path in files.iterdir():
            # Files of other programs stay.
            if _OURS(path.name) and path.name not in used_names:
                path.unlink(missing_ok=True)


def _has_mark(index: Path) -> bool:
    # The mark is in the head of the page, near its beginning.
    with index.open("rb") as file:
        return MARK.encode() in file.read(2000)


def _day(time: float) -> str:
    if time > 0:
        return datetime.fromtimestamp(time, UTC).date().isoformat()
    return ""


def _sorted_values(key: SweptKey) -> list[float | str]:
    """Return numbers by size, then words in natural order."""
    values = set()
    for value in key.values:
        if value is not None:
            values.add(value)
    numbers = []
    for value in values:
        if isinstance(value, float):
            numbers.append(value)
    words = []
    for value in values:
        if isinstance(value, str):
            words.append(value)
    return [*sorted(numbers), *sorted(words, key=natural)]


def _axis(key: SweptKey) -> dict[str, Any]:
    """Return a key for the script."""
    values = _sorted_values(key)
    return {
        "path": key.path,
        "name": key.name,
        "unit": key.unit,
        "numeric": key.numeric,
        "follows": key.follows,
        "values": values,
        "texts": list(map(value_text, values)),
    }


def _filter(key: SweptKey) -> dict[str, Any]:
    """Return a key as a filter: its values with the number of clips, or a range."""
    values = _sorted_values(key)
    entry: dict[str, Any] = {
        "path": key.path,
        "name": key.name,
        "unit": key.unit,
        "range": None,
    }
    if key.numeric and len(values) > LIMITS.most_choices:
        ends = [value_text(values[0]), value_text(values[-1])]
        return entry | {"range": ends, "last": len(values) - 1}
    counts = Counter(value_text(value) for value in key.values if value is not None)
    texts = dict.fromkeys(map(value_text, values))
    return entry | {"values": [(text, counts[text]) for text in texts]}


def _aspect(clips: Sequence[Clip]) -> str:
    """Return the common aspect ratio of all films, or "" if they differ."""
    sizes = set()
    for clip in clips:
        if clip.document:
            sizes.add(clip.size)
    # Videos have even sizes, so that equal ratios may differ a little.
    ratios = {round(width / height, 2) for width, height in sizes}
    if len(ratios) != 1:
        return ""
    width, height = max(sizes)
    return f"{width} / {height}"
