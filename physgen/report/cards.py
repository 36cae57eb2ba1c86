"""A clip -> its card in a gallery: what is written on it, and what the page's script needs to know of it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

from physgen.report.clips import Clip
from physgen.report.posters import across, shown
from physgen.report.swept import Swept

KINDS = {".mp4": "video/mp4", ".webp": "image/webp", ".gif": "image/gif"}
"""Films that a page can play."""


@dataclass(frozen=True)
class Pictured:
    """Where a clip's poster and strip are, as the page names them: paths or data URIs; empty where it has none."""

    poster: str = ""
    strip: str = ""


def card(
    number: int, clip: Clip, shot: Pictured, keys: Sequence[Swept], home: Path, alike: bool, single: bool
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
        "shown": shown(clip.frames),
        "across": across(clip.frames),
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
            (name, told(key.values[number]), key.unit, key.path) for name, key in list(split.items())[:4]
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


def told(value: float | str | None) -> str:
    """A value as the page writes it.

    >>> [told(value) for value in (0.1, 30625.0, 1234567.0, 1e-7, "side", None)]
    ['0.1', '30625', '1234570', '1e-07', 'side', '']
    """
    return f"{float(f'{value:.6g}'):.10g}" if isinstance(value, float) else value or ""


def link(path: Path, home: Path) -> str:
    """From the folder `home` to a file, as an address."""
    relative = Path(os.path.relpath(path.absolute(), home.absolute())).as_posix()
    return quote(relative if relative.startswith("../") else f"./{relative}")
