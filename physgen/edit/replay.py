"""The lines of a journal -> the states that it tells of, up to the first line that is none or does not fit."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from physgen.edit.history import History, State, patched

FORMAT = 1


@dataclass
class Found:
    """What a journal holds."""

    history: History
    saved: State
    """What the file held last."""
    good: int
    """Bytes that were taken; what follows was cut short, or is of no use."""
    newest: str | None = None
    """Id of the newest request."""
    saving: State | None = None
    """What was being written when the editor ended: maps, and perhaps the text."""


def replayed(data: bytes) -> Found | None:
    """None where there is nothing to go on with."""
    lines = data.splitlines(keepends=True)
    first = _line(lines[0]) if lines else None
    if first is None or first.get("journal") != FORMAT or not isinstance(first.get("text"), str):
        return None
    saved = State(first["text"], first.get("maps", 0))
    found = Found(History(saved), saved, len(lines[0]))
    for raw in lines[1:]:
        line = _line(raw)
        if line is None or not _taken(found, line):
            break
        found.good += len(raw)
    return found


def _line(raw: bytes) -> dict[str, Any] | None:
    try:
        line = json.loads(raw)
    except ValueError:
        return None
    return line if raw.endswith(b"\n") and isinstance(line, dict) else None


def _taken(found: Found, line: dict[str, Any]) -> bool:
    """Whether a line fits to what was before; then it is done."""
    history = found.history
    try:
        match line["do"]:
            case "push":
                text = patched(history.now.text, line["text"])
                state = State(text, line["maps"], line["what"], line["tag"], line["id"], line["time"])
                history.push(state)
                found.newest = state.id or found.newest
            case "step" if history.can(line["by"]):
                history.step(line["by"])
                found.newest = line["id"] or found.newest
            case "saving":
                found.saving = history.now
            case "base":
                found.saved = State(patched(history.now.text, line["text"]), line["maps"])
                found.saving = None
                history.end_step()
            case _:
                return False
        history.version = max(history.version, line.get("version", 0))
    except (KeyError, TypeError, ValueError):
        return False
    return True
