"""Where each number of a scene comes from: a flag, a variant, an estimate, the file or a default."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from physgen.problems import Place
from physgen.scene.scene import Scene

_SURE = re.compile(r"^(.*?)\s*(?<![\d.])(0(?:\.\d+)?|1(?:\.0+)?)$")
"""A source, and a confidence in 0..1 behind it: `table 0.4`."""


@dataclass(frozen=True)
class Source:
    """Where a number comes from."""

    kind: str
    """`flag`, `variant`, `guess`, `file`, `default` or `computed`."""
    text: str
    sure: float | None = None
    """0..1."""


def source(text: str) -> Source:
    """The source that an entry of `from` names.

    >>> source("table 0.4")
    Source(kind='guess', text='table', sure=0.4)
    """
    match = _SURE.match(text.strip())
    if match is None or not match[1]:
        return Source("guess", text)
    return Source("guess", match[1], float(match[2]))


class Provenance:
    """Where the values of a scene come from."""

    def __init__(self, scene: Scene, variant: str | None) -> None:
        self._scene = scene
        start = f"variants.{variant}"
        self._edited = {
            place for key, place in scene.places.items() if variant is not None and key.startswith(start)
        }
        self._variant = variant
        root = scene.places.get("", Place(""))
        self._file = root.file

    def of(
        self, path: str, provenance: str | None, *, written_at: str | None = None, near: bool = False
    ) -> Source:
        """The source of the value at `path`, or its `provenance`, the text at `written_at`, if that was written later.

        With `near`, a value that is written nowhere by itself stands where what it belongs to does.
        """
        place = self._scene.places.get(path)
        if place is None and near:
            place = self._scene.place(path)
        if provenance is not None and self._counts(
            place, None if written_at is None else self._scene.place(written_at)
        ):
            return source(provenance)
        if place is None:
            return Source("default", "default")
        if not place.line:
            return Source("flag", "--set")
        if place in self._edited:
            return Source("variant", f"variant {self._variant}")
        name = Path(place.file).name
        return Source(
            "file", f"line {place.line}" if place.file == self._file else f"{name}, line {place.line}"
        )

    def _counts(self, value: Place | None, entry: Place | None) -> bool:
        """Whether an entry of `from` still describes a number, which no later place sets again."""
        if value is None or entry is None:
            return value is None or self._rank(value) < 2
        if self._rank(value) == self._rank(entry) == 0:
            return (
                value.file == entry.file
            )  # of the files that are extended, which comes later is not known here
        return self._rank(value) <= self._rank(entry)

    def _rank(self, place: Place) -> int:
        """Flags are read after variants, those after the file, and that after what it extends."""
        if not place.line:
            return 3
        if place in self._edited:
            return 2
        return 1 if place.file == self._file else 0
