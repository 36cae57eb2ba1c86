"""Which clip of a page is whose: kept apart from it, by who made the study."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physgen.evaluate.study.told import KEY, VERSION, told
from physgen.problems import InputError


@dataclass(frozen=True)
class Key:
    """Opens the answers to a study."""

    study: str
    """Tells it from any other: hexadecimal digits."""
    seed: int
    methods: tuple[str, ...]
    scenes: tuple[str, ...]
    clips: Mapping[str, tuple[str, str]]
    """Name on the page -> method and scene."""

    def text(self) -> str:
        """As a file has it."""
        clips = {name: {"method": m, "scene": s} for name, (m, s) in self.clips.items()}
        record = {
            KEY: VERSION,
            "study": self.study,
            "seed": self.seed,
            "methods": self.methods,
            "scenes": self.scenes,
            "clips": clips,
        }
        return json.dumps(record, indent=1, ensure_ascii=False) + "\n"


def read_key(path: Path) -> Key:
    """Raises InputError."""
    record = told(path, KEY)
    try:
        key = _key(record)
    except (KeyError, TypeError, ValueError, AttributeError):
        fix = "use the file as it was made"
        raise InputError.of(
            str(path), "", "is a key that was changed: parts are missing or do not fit", fix
        ) from None
    return key


def _key(record: Mapping[str, Any]) -> Key:
    methods, scenes = (tuple(map(str, record[name])) for name in ("methods", "scenes"))
    clips = {str(name): (str(clip["method"]), str(clip["scene"])) for name, clip in record["clips"].items()}
    if not clips or any(m not in methods or s not in scenes for m, s in clips.values()):
        raise ValueError
    if len(set(clips.values())) < len(clips):
        raise ValueError
    return Key(str(record["study"]), int(record["seed"]), methods, scenes, clips)
