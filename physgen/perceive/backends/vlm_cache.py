"""A question to a model -> its answer from an earlier run, under `$XDG_CACHE_HOME/physgen/vlm`."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

from physgen.perceive.backends.vlm_answers import Query
from physgen.whole import write_whole

VERSION = 1
"""Counted up when what an answer means changes."""


def folder() -> Path:
    """Where answers lie."""
    home = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(home) if Path(home).is_absolute() else Path.home() / ".cache") / "physgen" / "vlm"


def name(query: Query, where: str, model: str, temperature: float, sample: int) -> Path:
    """The file of one answer, by all that it follows from: `where` too, since servers call unlike models `default`."""
    pictures: Sequence[str] = [sha256(picture).hexdigest() for picture in query.pictures]
    content = [VERSION, where, model, query.text, pictures, query.schema, temperature, sample]
    digest = sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return folder() / digest[:2] / f"{digest}.json"


def fingerprint(model: str, dtype: str) -> str:
    """A local model's name, with what tells that its files were changed."""
    path = Path(model).expanduser()
    files = sorted(path.iterdir()) if path.is_dir() else []
    told = [(file.name, file.stat().st_size, file.stat().st_mtime_ns) for file in files]
    return json.dumps([str(path.resolve()) if files else model, dtype, told])


def kept(path: Path) -> Any:
    """The answer in a file; None where there is none, or a broken one."""
    try:
        data = json.loads(path.read_bytes())
        return data["answer"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def keep(path: Path, answer: Any) -> None:
    """Write an answer whole; a folder that cannot be written to is no reason to fail."""
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, json.dumps({"answer": answer}, ensure_ascii=False).encode())
